%% How far a robot follows numbers of terms that others say.
-module(starl_term_tests).
-include_lib("eunit/include/eunit.hrl").

-define(T, starl_term).
%% The largest incarnation that is taken from a message.
-define(LIFE, (1 bsl 58 - 1)).
-define(ROOM, (1 bsl 128 - 1)).

%% A guess is above all that the life before can have counted, and is believed at once by who knows nothing.
each_guess_is_believed_at_once_test() ->
    [
        begin
            Guess = ?T:guess(Life),
            ?assert(Guess > ?T:guess(Life - 1) + (1 bsl 31)),
            ?assertEqual(Guess, ?T:toward(Guess, 0))
        end
     || Life <- [1, 2, 60000, 1 bsl 57, ?LIFE]
    ].

%% Also what is counted from the largest of them.
counting_goes_on_above_all_guesses_test() ->
    Guess = ?T:guess(?LIFE),
    [?assertEqual(Guess + N, ?T:toward(Guess + N, 0)) || N <- [1, 2, 1 bsl 32]].

an_incarnation_that_is_too_large_guesses_no_more_test() ->
    Most = ?T:guess(1 bsl 70),
    ?assertEqual(Most, ?T:guess(1 bsl 100)),
    ?assertEqual(Most, ?T:toward(Most, 0)).

a_lower_number_is_no_way_back_test() ->
    ?assertEqual([0, 6, 7], [?T:toward(N, 7) || N <- [0, 6, 7]]).

%% The next numbers are always believed, wherever the team is.
small_steps_are_always_possible_test() ->
    [?assertEqual(N + S, ?T:toward(N + S, N)) || N <- [0, 1 bsl 90, 1 bsl 127], S <- [1, 1 bsl 32]].

%% Who says the largest number over and over does not come to its end in a hundred years at a thousand a second.
the_end_is_never_reached_test() ->
    Once = ?T:toward(?ROOM, 0),
    Step = ?T:toward(?ROOM, Once) - Once,
    Times = 100 * 366 * 86400 * 1000,
    ?assertEqual(Once + 2 * Step, ?T:toward(?ROOM, Once + Step)),
    ?assert(Once + Times * Step < ?ROOM div 2).

%% In as many messages as have raised the others.
found_in_as_many_messages_test() ->
    Raised = lists:foldl(fun(_, N) -> ?T:toward(?ROOM, N) end, 0, lists:seq(1, 1000)),
    Found = lists:foldl(fun(_, N) -> ?T:toward(Raised, N) end, 1, lists:seq(1, 1000)),
    ?assertEqual(Raised, Found).

%% What steps can have led to is kept; what they cannot, and what is no number, is not.
what_may_be_stored_test() ->
    [
        ?assert(?T:is_counted(N))
     || N <- [0, 1, ?T:guess(?LIFE), ?T:guess(?LIFE) + (1000000 bsl 32)]
    ],
    [
        ?assertNot(?T:is_counted(N))
     || N <- [?ROOM, 1 bsl 91, ?T:guess(?LIFE) + (1 bsl 65), -1, 1.0, many, {1}]
    ].
