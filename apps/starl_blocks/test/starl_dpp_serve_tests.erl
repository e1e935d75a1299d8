%% How a coordinator serves its robots (README, DPP, progress: requests are answered; a
%% deadlock is counted when there is one, and only then).
-module(starl_dpp_serve_tests).
-include_lib("eunit/include/eunit.hrl").

-define(R, 220.0).

%% A robot that waits when a term begins tells its place and asks anew, both at once. Whichever
%% message comes first, the request is answered.
report_and_request_in_either_order_test() ->
    {State, {_, Id, At, Painted, _} = Request} = state_and_request(),
    {_, Reported, Place, Told, _} = State,
    S0 = known([1], new([short()], 2)),
    Report = fun(S) -> starl_dpp_serve:reported(2, Reported, {Place, Told}, S) end,
    Ask = fun(S) -> starl_dpp_serve:requested(2, Id, {At, Painted}, S) end,
    [
        ?assertMatch([{2, Id, {assign, _, _}}], [A || {2, _, _} = A <- answers(Steps, S0)], Request)
     || Steps <- [[Report, Ask], [Ask, Report], [Report, Ask, Report, Ask]]
    ].

%% What a participant sends that asks when it hears of a new term.
state_and_request() ->
    {_, P0} = starl_machine:new(starl_dpp_participant, #{}, #{
        robot => 2, participants => [1, 2], name => dpp, incarnation => 1, stored => none,
        random => rand:seed_s(exsss, 1), now => 0
    }),
    {X, Y} = spot(2),
    {_, P} = events([
        {{call, {app, 0}}, {join, 1}}, {{call, {app, 1}}, request},
        {{reply, {halted, 1}}, ok}, {{reply, {pose, 1}}, {ok, {X, Y, 0.0}}}
    ], P0),
    {Sent, _} = events([
        {cast, {message, 1, dpp_recover, {{1, 1, 1}, 7, false}}}, {{timeout, again}, request}
    ], P),
    [State] = [Body || {cast, sap, {send, 1, dpp_state, Body}} <- Sent],
    [Request] = [Body || {call, sap, {send, 1, dpp_request, Body}, _} <- Sent],
    {State, Request}.

events(Events, P) ->
    lists:foldl(
        fun({Type, Content}, {Actions, P0}) ->
            {More, P1} = starl_machine:step(Type, Content, #{now => 0, robot => 2}, P0),
            {Actions ++ More, P1}
        end,
        {[], P}, Events
    ).

%% Who says that it has painted lines that are not in the picture is not believed: that is traced.
stray_lines_are_traced_test() ->
    {S, Actions} = starl_dpp_serve:reported(
        1, {1, 9}, {{standing, spot(1)}, [4711]}, new([short()], 2)
    ),
    ?assertEqual([{malformed, 1, {edges, [4711]}}], [E || {trace, E} <- Actions]),
    ?assertNot(starl_dpp_serve:knows(1, S)).

%% The last line is painted: all who wait are told at once, and nobody is sent anywhere.
completion_is_no_deadlock_test() ->
    {Actions, _} = chain(painted([short()], 3), [asks(3, 2)]),
    ?assertEqual([{2, {1, 2}, complete}, {3, {1, 2}, complete}], lists:sort(sent(Actions))),
    ?assertEqual([], resolved(Actions)).

%% Also while a robot that has nothing to paint is on its way.
completion_while_one_moves_test() ->
    S = painted([short()], 3),
    Way = {moving, 0, spot(1), [{spot(3), up}]},
    {Moving, _} = starl_dpp_serve:reported(1, {1, 9}, {Way, []}, S),
    {Actions, _} = chain(Moving, [asks(3, 2)]),
    ?assertEqual([{2, {1, 2}, complete}, {3, {1, 2}, complete}], lists:sort(sent(Actions))).

%% Robots 2 and 3 wait for the line's robot; robot 1 has painted it but not said so.
painted(Lines, N) ->
    S0 = known([1, 2, 3], new(Lines, N)),
    {First, S1} = chain(S0, [asks(1, 1), asks(2, 2)]),
    [{1, {1, 1}, {assign, _, Path}}] = sent(First),
    Edges = [E || {_, {down, E}} <- Path],
    {S2, _} = starl_dpp_serve:reported(1, {1, 2}, {{standing, spot(1)}, Edges}, S1),
    S2.

%% Robot 2 stands beside the line. The path of robot 1, all around both, closes the line to it, and
%% every way out. When robot 1 has stopped, far away, robot 2 gets the line in the same turn: no
%% deadlock.
granted_is_no_deadlock_test() ->
    Beside = {6050.0, 6300.0},
    Around = around(1, {5400.0, 5700.0}, {6700.0, 6900.0}),
    {Before, S1} = chain(new([short()], 2), [Around, stands(2, Beside), asks(2, 2, Beside)]),
    ?assertEqual([], sent(Before)),
    {Granted, _} = chain(S1, [asks(1, 6, {9000.0, 5800.0})]),
    ?assertMatch([{2, {1, 2}, {assign, _, _}}], sent(Granted)),
    ?assertEqual([], resolved(Granted)).

%% The last line is between two robots that stand too near to it to let the other paint it; they
%% cannot get away, for the path of a third is all around them. When that one has stopped, far away,
%% and asks as well, nobody moves and all are refused: a deadlock. One is sent out of the way.
deadlock_is_counted_test() ->
    {Left, Right} = {{5800.0, 6000.0}, {6300.0, 6000.0}},
    Stand = [around(3, {5300.0, 5500.0}, {6800.0, 6500.0}), stands(1, Left), stands(2, Right)],
    {Before, S} = chain(new([short()], 3), Stand ++ [asks(1, 1, Left), asks(2, 1, Right)]),
    ?assertEqual([], sent(Before)),
    {Actions, _} = chain(S, [asks(3, 9, {9000.0, 9000.0})]),
    ?assertMatch([[_ | _]], resolved(Actions)).

%% Two that close the last line to each other: who has been told to make way, and has not gone, is
%% sent to park, so nobody waits for a deadlock.
blockers_park_test() ->
    {Left, Right} = {{5800.0, 6000.0}, {6300.0, 6000.0}},
    Stand = [stands(1, Left), stands(2, Right), asks(1, 1, Left), asks(2, 1, Right)],
    {_, S} = chain(new([short()], 2), Stand),
    {Actions, _} = chain(S, [asks(1, 2, Left)]),
    [{1, {1, 2}, {assign, _, Path}}] = sent(Actions),
    {ok, Plan} = starl_dpp_plan:new(config([short()], 2)),
    {End, up} = lists:last(Path),
    ?assert(lists:member(End, [starl_dpp_plan:spot(Robot, Plan) || Robot <- [1, 2]])),
    ?assertEqual([], resolved(Actions)).

%% One whose lease has ended waits for nothing any more: it is told nothing before it is heard again.
silent_robot_waits_no_more_test() ->
    S0 = known([1, 2, 3], new([short()], 3)),
    {First, S1} = chain(S0, [asks(1, 1), asks(2, 1), asks(3, 1)]),
    [{1, {1, 1}, {assign, _, Path}}] = sent(First),
    Edges = [E || {_, {down, E}} <- Path],
    {Silent, S2} = chain(S1, [fun(S) -> starl_dpp_serve:rests(2, spot(2), S) end]),
    ?assertEqual({[], [2]}, {sent(Silent), [R || {trace, {silent, R}} <- Silent]}),
    Painted = fun(S) -> starl_dpp_serve:requested(1, {1, 2}, {spot(1), Edges}, S) end,
    {Last, S3} = chain(S2, [Painted]),
    ?assertEqual([{1, {1, 2}, complete}, {3, {1, 1}, complete}], lists:sort(sent(Last))),
    ?assertEqual([{2, {1, 2}, complete}], answers([asks(2, 2)], S3)).

%% A waypoint that is passed gives free what lies behind it, counted along the path of this very
%% request, also by a coordinator that has learnt of the path on its way.
passed_test() ->
    Points = [{{6000.0 + 100.0 * I, 8000.0}, up} || I <- lists:seq(1, 4)],
    Way = {moving, 2, {6000.0, 8000.0}, Points},
    S0 = known([2], new([short()], 2)),
    {S1, _} = starl_dpp_serve:reported(1, {1, 5}, {Way, []}, S0),
    Passed = fun(Id, N, S) ->
        {Next, Actions} = starl_dpp_serve:passed(1, Id, N, S),
        {[length(Held) || {trace, {reserved, 1, Held}} <- Actions], Next}
    end,
    ?assertEqual({[], S1}, Passed({1, 5}, 2, S1)),
    ?assertEqual({[], S1}, Passed({1, 4}, 3, S1)),
    {[3], S2} = Passed({1, 5}, 3, S1),
    {[1], _} = Passed({1, 5}, 5, S2).

%% -- helpers --------------------------------------------------------------------------------

short() -> {{6000.0, 6000.0}, {6100.0, 6000.0}}.

config(Lines, N) ->
    #{
        segments => Lines, world => {12000.0, 12000.0}, tube_radius => ?R, slack => 10.0,
        robots => lists:seq(1, N)
    }.

%% A coordinator that leads.
new(Lines, N) ->
    {ok, Plan} = starl_dpp_plan:new(config(Lines, N)),
    {S, _} = starl_dpp_serve:lead(starl_dpp_serve:new(Plan, {1, 1, 1})),
    S.

spot(Robot) ->
    {ok, Plan} = starl_dpp_plan:new(config([short()], 3)),
    starl_dpp_plan:spot(Robot, Plan).

known(Robots, S0) ->
    {_, S} = chain(S0, [stands(Robot, spot(Robot)) || Robot <- Robots]),
    S.

stands(Robot, At) ->
    fun(S) -> starl_dpp_serve:reported(Robot, {1, 0}, {{standing, At}, []}, S) end.

%% The robot drives all around a rectangle, but for the last bit.
around(Robot, {X0, Y0}, {X1, Y1}) ->
    Path = [{{X1, Y0}, up}, {{X1, Y1}, up}, {{X0, Y1}, up}, {{X0, Y0 + 100.0}, up}],
    fun(S) -> starl_dpp_serve:reported(Robot, {1, 5}, {{moving, 0, {X0, Y0}, Path}, []}, S) end.

asks(Robot, N) -> asks(Robot, N, spot(Robot)).

asks(Robot, N, At) -> fun(S) -> starl_dpp_serve:requested(Robot, {1, N}, {At, []}, S) end.

chain(S, Steps) ->
    lists:foldl(
        fun(Step, {Actions, S0}) ->
            {S1, More} = Step(S0),
            {Actions ++ More, S1}
        end,
        {[], S}, Steps
    ).

answers(Steps, S) ->
    {Actions, _} = chain(S, Steps),
    sent(Actions).

sent(Actions) ->
    [{R, Id, A} || {call, sap, {send, R, dpp_answer, {_, Id, A, _}}, _} <- Actions].

resolved(Actions) -> [Robots || {trace, {deadlock_resolved, Robots}} <- Actions].
