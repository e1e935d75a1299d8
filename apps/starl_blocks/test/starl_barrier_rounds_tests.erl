%% What the barrier machine stores, before what, and what it makes of it when it starts.
-module(starl_barrier_rounds_tests).
-include_lib("eunit/include/eunit.hrl").

-define(APP, {app, 1}).

%% It says that it has reached a round, and answers that it has passed one, when that is stored.
stores_before_it_speaks_test() ->
    {Reached, B1} = call({sync, gate, {1, 0}, 5000}, start(none)),
    ?assertMatch(
        [{store, _}, {trace, {reached, gate, 1}}, {call, sap, {broadcast, _, _}, _} | _], Reached
    ),
    {Passed, _} = passed(B1),
    ?assertMatch([{store, _}, {trace, {passed, gate, 1}}, {reply, ?APP, ok} | _], Passed).

%% It goes on with the round that it has reached and not passed, or with the one after it.
goes_on_where_it_was_test() ->
    {Reached, B1} = call({sync, gate, {1, 0}, 5000}, start(none)),
    ?assertMatch({[{reply, ?APP, {1, _}}], _}, call({round, gate}, start(stored(Reached)))),
    {Passed, _} = passed(B1),
    ?assertMatch({[{reply, ?APP, {2, _}}], _}, call({round, gate}, start(stored(Passed)))),
    ?assertMatch({[{reply, ?APP, {1, _}}], _}, call({round, other}, start(stored(Passed)))).

%% The machine crashed between storing that the round is passed and answering: the application knows
%% only that its call failed, and is given the answer when it calls again; nothing is traced.
passed_and_not_told_test() ->
    {_, B1} = call({sync, gate, {1, 0}, 5000}, start(none)),
    {Passed, _} = passed(B1),
    {[{reply, ?APP, ok}], B2} = call({resume, gate, {1, 0}}, start(stored(Passed))),
    {[{reply, ?APP, {1, _}}], B3} = call({round, gate}, B2),
    {[{reply, ?APP, ok}], B4} = call({sync, gate, {1, 0}, 5000}, B3),
    ?assertMatch({[{reply, ?APP, {2, _}}], _}, call({round, gate}, B4)).

%% While the others have not told it all that they know, it stores what is sure, and as no more.
stores_no_guess_test() ->
    {_, B1} = call({resume, gate, {4, 3}}, start(damaged)),
    {[], B2} = told(2, true, [{other, 3, 3, 2}], B1),
    {Reached, _} = call({sync, gate, {4, 3}, 5000}, B2),
    Again = start(stored(Reached)),
    ?assertMatch({[{reply, ?APP, {4, _}}], _}, call({round, gate}, Again)),
    ?assertMatch({[], _}, call({round, other}, Again)).

%% A round that somebody has surely not reached nobody has passed; one that all have reached, as far
%% as they themselves know for sure, may be passed, and counts as such.
damaged_test() ->
    Next = fun(Told) ->
        Knows = lists:foldl(
            fun({From, Sure, At, Mine}, B) ->
                {[], Learned} = told(From, Sure, [{gate, At, Mine, 1}], B),
                Learned
            end,
            start(damaged),
            Told
        ),
        {[{reply, ?APP, {Round, _}}], _} = call({round, gate}, Knows),
        Round
    end,
    ?assertEqual(2, Next([{2, true, 1, 2}, {3, true, 2, 1}])),
    ?assertEqual(3, Next([{2, true, 2, 2}, {3, true, 2, 1}])),
    ?assertEqual(3, Next([{2, false, 1, 2}, {3, true, 2, 1}])),
    ?assertEqual(2, Next([{2, true, 1, 0}, {3, true, 2, 0}])).

%% The application asks before the others have told all they know, and is answered then. The robot
%% says that it has reached a round only when that is stored, though others know that it had.
answers_when_it_knows_test() ->
    {[], B1} = told(2, true, [{gate, 4, 4, 3}], start(damaged)),
    {[], B2} = call({round, gate}, B1),
    ?assertMatch({[{reply, ?APP, {5, _}}], _}, told(3, true, [{gate, 4, 4, 3}], B2)),
    {_, B3} = call({resume, gate, {4, 3}}, B1),
    [
        ?assertMatch(
            {[{store, _}, {trace, {reached, gate, 4}} | _], _},
            call({sync, gate, {4, 3}, 5000}, B)
        )
     || B <- [B1, B3]
    ].

%% It passes only when all others know that it has reached the round: so it may die then.
passes_when_it_is_known_test() ->
    {_, B1} = call({sync, gate, {1, 0}, 5000}, start(none)),
    {[], B2} = event({reply, {announced, gate, 1}}, {error, {lost, [3]}}, B1),
    {[], B3} = event(cast, {message, 2, barrier, {reached, gate, 1, 0, false}}, B2),
    {[], B4} = event(cast, {message, 3, barrier, {reached, gate, 1, 0, false}}, B3),
    {Passed, _} = event(cast, {message, 3, barrier, {reached, gate, 1, 1, false}}, B4),
    ?assertMatch([{store, _}, {trace, {passed, gate, 1}} | _], Passed).

%% A new life tells what is stored, in the order of the names, however many those are; what its store says of
%% nobody it does not answer.
tells_what_is_stored_test() ->
    Names = lists:seq(1, 40),
    Many = {stored, {complete, maps:from_list([{Name, {Name, Name - 1, 0}} || Name <- Names])}},
    {Told, Barrier} = starting(Many),
    ?assertEqual(
        [{Name, Name, Name - 1} || Name <- Names],
        [{Name, At, Passed} || {trace, {recalled, Name, At, Passed}} <- Told]
    ),
    {[{cast, sap, {send, 2, barrier, {told, 9, _, Facts}}}], _} =
        event(cast, {message, 2, barrier, {who, 9}}, Barrier),
    ?assertEqual(Names, [Name || {Name, _, _, _} <- Facts]).

%% One store that is older than what the others know is told, though another name's is not.
outdated_store_is_told_test() ->
    {_, B0} = starting({stored, {complete, #{a => {1, 1, 0}, b => {1, 1, 0}}}}, #{life => {0, 2}}),
    Facts = fun(At) -> [{a, 1, 1, 1}, {b, 1, At, 1}] end,
    Actions = fun(At) ->
        {[], B1} = told(2, true, Facts(At), B0),
        element(1, told(3, true, Facts(At), B1))
    end,
    ?assertEqual([], [T || {trace, T} <- Actions(1)]),
    ?assertEqual([store_damaged], [T || {trace, T} <- Actions(2)]).

%% A message that it does not know is told to the machine.
unknown_message_test() ->
    Meta = #{now => 0, robot => 1},
    ?assertEqual(
        unknown_event,
        starl_barrier_rounds:handle_event(
            cast, {message, 2, barrier, nonsense}, ready, start(none), Meta
        )
    ).

told(From, Sure, Facts, Barrier) ->
    event(cast, {message, From, barrier, {told, 2, Sure, Facts}}, Barrier).

%% The outcome of its announcement, and what the others have reached.
passed(Barrier) ->
    {[], B1} = event({reply, {announced, gate, 1}}, ok, Barrier),
    {[], B2} = event(cast, {message, 2, barrier, {reached, gate, 1, 0, false}}, B1),
    event(cast, {message, 3, barrier, {reached, gate, 1, 0, false}}, B2).

stored(Actions) -> {stored, hd([Term || {store, Term} <- Actions])}.

start(Stored) -> element(2, starting(Stored)).

starting(Stored) -> starting(Stored, #{}).

starting(Stored, More) ->
    {ready, Barrier, Actions} = starl_barrier_rounds:init(More#{
        robot => 1,
        participants => starl_team:new([1, 2, 3]),
        name => barrier,
        incarnation => 2,
        stored => Stored,
        random => rand:seed_s(exsss, 1),
        now => 0
    }),
    {Actions, Barrier}.

call(Request, Barrier) -> event({call, ?APP}, Request, Barrier).

event(Type, Content, Barrier) ->
    Meta = #{now => 0, robot => 1},
    case starl_barrier_rounds:handle_event(Type, Content, ready, Barrier, Meta) of
        {keep_state, Next, Actions} -> {Actions, Next};
        keep_state_and_data -> {[], Barrier}
    end.
