%% Times, and differences of clocks, in the data of machines.
%%
%% Holds: The checker ages times only: a difference of two clocks changes by their drift
%% Red: c27ddcd2, run: it goes back as a time does
-module(starl_check_term_tests).
-include_lib("eunit/include/eunit.hrl").

-define(TEAM, [1, 2, 3, 4, 5, 6, 7, 8]).
-define(HORIZON, 4000001).

%% Every pair of clocks that differ.
pairs() -> [{A, B} || A <- ?TEAM, B <- ?TEAM, A =/= B].

ahead({A, B}) -> starl_check_term:now(A) - starl_check_term:now(B).

%% The same rate for all clocks but the last.
rates(Last) -> list_to_tuple([100 || _ <- tl(?TEAM)] ++ [Last]).

%% What a clock is ahead of another stays as it is while both pass the same time.
differences_do_not_age_test() ->
    [
        ?assertEqual(
            ahead(Pair) + More,
            starl_check_term:shift(ahead(Pair) + More, 7, rates(100), ?HORIZON)
        )
     || Pair <- pairs(), More <- [0, -3000000]
    ].

%% Of two clocks with other rates, one gets ahead of what it was ahead: by what drift makes in the time up to
%% the horizon at most, since no time is older.
differences_drift_test() ->
    Aged = fun(Pair, Ticks) ->
        starl_check_term:shift(ahead(Pair), Ticks, rates(90), ?HORIZON) - ahead(Pair)
    end,
    ?assertEqual([-70, 70], [Aged(Pair, 7) || Pair <- [{1, 8}, {8, 1}]]),
    Most = ?HORIZON * 10 div 90,
    ?assertEqual([-Most, Most], [Aged(Pair, 1000000) || Pair <- [{1, 8}, {8, 1}]]),
    Late = ahead({8, 1}) - 3000000,
    ?assertEqual(Late, starl_check_term:shift(Late, 7, rates(90), ?HORIZON)).

%% A time that was told by another robot, on the own clock.
translated_times_age_test() ->
    [
        ?assertEqual(
            starl_check_term:now(A) - 5 - 700,
            starl_check_term:shift(
                starl_check_term:now(B) - 5 + ahead(Pair), 7, rates(100), ?HORIZON
            )
        )
     || {A, B} = Pair <- pairs()
    ].

%% Robots that change places change their clocks.
differences_are_renamed_test() ->
    To = {3, 1, 2, 4, 5, 6, 7, 8},
    [
        ?assertEqual(
            ahead({element(A, To), element(B, To)}) - 5,
            starl_check_term:rename(ahead(Pair) - 5, To)
        )
     || {A, B} = Pair <- pairs()
    ].

%% Other numbers are neither times nor differences.
numbers_stay_test() ->
    Others = [
        0, -7, 1 bsl 44, -(1 bsl 44), 900007, starl_check_term:now(1) + starl_check_term:now(2)
    ],
    ?assertEqual(Others, starl_check_term:shift(Others, 7, rates(90), ?HORIZON)).
