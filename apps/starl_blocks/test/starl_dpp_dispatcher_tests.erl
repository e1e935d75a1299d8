%% How a coordinator serves its robots (README, DPP, progress: requests are answered; a
%% deadlock is counted when there is one, and only then).
-module(starl_dpp_dispatcher_tests).
-include_lib("eunit/include/eunit.hrl").

-define(R, 220.0).
-define(LEFT, {unreachable, [1, 2, 3]}).

%% A robot that waits when a term begins tells its place and asks anew, both at once. Whichever
%% message comes first, the request is answered.
report_and_request_in_either_order_test() ->
    {State, {_, Id, At, Painted, _} = Request} = state_and_request(),
    {_, Reported, Place, Told, _} = State,
    S0 = known([1], new([short()], 2)),
    Report = fun(S) -> starl_dpp_dispatcher:reported(2, Reported, {Place, Told}, S) end,
    Ask = fun(S) -> starl_dpp_dispatcher:requested(2, Id, {At, Painted}, S) end,
    [
        ?assertMatch([{2, Id, {assign, _, _}}], [A || {2, _, _} = A <- answers(Steps, S0)], Request)
     || Steps <- [[Report, Ask], [Ask, Report], [Report, Ask, Report, Ask]]
    ].

%% A request below a number that was heard from its robot is told that number; one of the same
%% number, or a first one, is not.
number_above_the_robots_own_is_told_test() ->
    S0 = known([1], new([short()], 2)),
    {S, _} = starl_dpp_dispatcher:requested(2, {9, 9}, {spot(2), []}, S0),
    Above = fun(Id) ->
        {_, Actions} = starl_dpp_dispatcher:requested(2, Id, {spot(2), []}, S),
        [{To, Of, N} || {cast, sap, {send, To, dpp_answer, {_, Of, {above, N}, []}}} <- Actions]
    end,
    [?assertEqual([{2, Id, {9, 9}}], Above(Id)) || Id <- [{1, 2}, {9, 8}, {8, 100}]],
    [?assertEqual([], Above(Id), Id) || Id <- [{9, 9}, {9, 10}, {10, 1}]].

%% What a participant sends that asks when it hears of a new term.
state_and_request() ->
    {_, P0} = starl_machine:new(starl_dpp_participant, #{}, #{
        robot => 2,
        participants => [1, 2],
        name => dpp,
        incarnation => 1,
        stored => none,
        random => rand:seed_s(exsss, 1),
        now => 0
    }),
    {X, Y} = spot(2),
    {_, P} = events(
        [
            {{call, {app, 0}}, {join, 1}},
            {{call, {app, 1}}, request},
            {{reply, {halted, 1}}, ok},
            {{reply, {pose, 1}}, {ok, {X, Y, 0.0}}}
        ],
        P0
    ),
    {Sent, _} = events(
        [
            {cast, {message, 1, dpp_recover, {{1, 1, 1}, 7, false}}}, {{timeout, again}, request}
        ],
        P
    ),
    [State] = [Body || {cast, sap, {send, 1, dpp_state, Body}} <- Sent],
    [Request] = [Body || {call, sap, {send, 1, dpp_request, Body}, _} <- Sent],
    {State, Request}.

events(Events, P) ->
    lists:foldl(
        fun({Type, Content}, {Actions, P0}) ->
            {More, P1} = starl_machine:step(Type, Content, #{now => 0, robot => 2}, P0),
            {Actions ++ More, P1}
        end,
        {[], P},
        Events
    ).

%% Who says that it has painted lines that are not in the picture is not believed: that is traced.
stray_lines_are_traced_test() ->
    {S, Actions} = starl_dpp_dispatcher:reported(
        1, {1, 9}, {{standing, spot(1)}, [4711]}, new([short()], 2)
    ),
    ?assertEqual([{malformed, 1, {edges, [4711]}}], [E || {trace, E} <- Actions]),
    ?assertNot(starl_dpp_dispatcher:knows(1, S)).

%% The last line is painted: all who wait are told at once, and nobody is sent anywhere.
completion_is_no_deadlock_test() ->
    {Actions, _} = chain(painted([short()], 3), [asks(3, 2)]),
    ?assertEqual([{2, {1, 2}, complete}, {3, {1, 2}, complete}], lists:sort(sent(Actions))),
    ?assertEqual([], resolved(Actions)).

%% Also while a robot that has nothing to paint is on its way.
completion_while_one_moves_test() ->
    S = painted([short()], 3),
    Way = {moving, 0, spot(1), [{spot(3), up}]},
    {Moving, _} = starl_dpp_dispatcher:reported(1, {1, 9}, {Way, []}, S),
    {Actions, _} = chain(Moving, [asks(3, 2)]),
    ?assertEqual([{2, {1, 2}, complete}, {3, {1, 2}, complete}], lists:sort(sent(Actions))).

%% Robots 2 and 3 wait for the line's robot; robot 1 has painted it but not said so.
painted(Lines, N) ->
    S0 = known([1, 2, 3], new(Lines, N)),
    {First, S1} = chain(S0, [asks(1, 1), asks(2, 2)]),
    [{1, {1, 1}, {assign, _, Path}}] = sent(First),
    Edges = [E || {_, {down, E}} <- Path],
    {S2, _} = starl_dpp_dispatcher:reported(1, {1, 2}, {{standing, spot(1)}, Edges}, S1),
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

%% What is in the way on the only line is closed, so nobody gets it; it is tried again after a while, and
%% after fifteen tries that brought no line no more.
a_closed_way_is_tried_again_test() ->
    {A, B} = short(),
    {ok, Plan} = starl_dpp_plan:new(config([short()], 1)),
    Spot = starl_dpp_plan:spot(1, Plan),
    Blocked = fun(S) -> starl_dpp_dispatcher:blocked(A, B, S) end,
    Closed = fun(N, S) -> chain(S, [Blocked, asks(1, N, Spot)]) end,
    {_, S0} = chain(new([short()], 1), [stands(1, Spot)]),
    {First, S1} = Closed(1, S0),
    ?assertMatch([[_]], [Segments || {trace, {closed, Segments}} <- First]),
    ?assertEqual([], sent(First)),
    ?assertEqual([20000000], tries(First)),
    {S2, Again} = starl_dpp_dispatcher:reopen(S1),
    ?assert(lists:member({trace, reopened}, Again)),
    ?assertMatch([{1, _, {assign, _, _}}], sent(Again)),
    {Tried, _} = lists:mapfoldl(
        fun(N, S) ->
            {Actions, Next} = Closed(N, S),
            {Open, _} = starl_dpp_dispatcher:reopen(Next),
            {length(tries(Actions)), Open}
        end,
        S2,
        lists:seq(2, 18)
    ),
    ?assertEqual(lists:duplicate(14, 1) ++ [0, 0, 0], Tried).

tries(Actions) -> [Us || {{timeout, reopen}, Us, reopen} <- Actions].

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
    {Silent, S2} = chain(S1, [fun(S) -> starl_dpp_dispatcher:rests(2, spot(2), S) end]),
    ?assertEqual({[], [2]}, {sent(Silent), [R || {trace, {silent, R}} <- Silent]}),
    Painted = fun(S) -> starl_dpp_dispatcher:requested(1, {1, 2}, {spot(1), Edges}, S) end,
    {Last, S3} = chain(S2, [Painted]),
    ?assertEqual([{1, {1, 2}, complete}, {3, {1, 1}, complete}], lists:sort(sent(Last))),
    ?assertEqual([{2, {1, 2}, complete}], answers([asks(2, 2)], S3)).

%% A waypoint that is passed gives free what lies behind it, counted along the path of this very
%% request, also by a coordinator that has learnt of the path on its way.
a_passed_waypoint_gives_free_what_lies_behind_test() ->
    Points = [{{6000.0 + 100.0 * I, 8000.0}, up} || I <- lists:seq(1, 4)],
    Way = {moving, 2, {6000.0, 8000.0}, Points},
    S0 = known([2], new([short()], 2)),
    {S1, _} = starl_dpp_dispatcher:reported(1, {1, 5}, {Way, []}, S0),
    Passed = fun(Id, N, S) ->
        {Next, Actions} = starl_dpp_dispatcher:passed(1, Id, N, S),
        {[length(Held) || {trace, {reserved, 1, Held}} <- Actions], Next}
    end,
    ?assertEqual({[], S1}, Passed({1, 5}, 2, S1)),
    ?assertEqual({[], S1}, Passed({1, 4}, 3, S1)),
    {[3], S2} = Passed({1, 5}, 3, S1),
    {[1], _} = Passed({1, 5}, 5, S2).

%% -- when it opens, and what it waits for -----------------------------------------------------

-define(SERVE, {{timeout, serve}, 200000, serve}).
-define(GIVE_UP, {{timeout, give_up}, 60000000, give_up}).

%% Once it leads and all places are known, whichever comes last, it tells what all hold, and serves
%% those who wait soon; those who gave up waiting for it are not told so.
service_opens_once_it_leads_and_knows_all_places_test() ->
    {ok, Plan} = starl_dpp_plan:new(config([short()], 2)),
    Idle = starl_dpp_dispatcher:new(Plan, {1, 1, 1}),
    Held = fun(R) -> {trace, {reserved, R, [{spot(R), spot(R)}]}} end,
    Opened = [
        {trace, {coordinator, {1, 1, 1}}}, Held(1), Held(2), {{timeout, give_up}, cancel}, ?SERVE
    ],
    {First, One} = chain(Idle, [stands(1, spot(1))]),
    ?assertEqual({[], {One, []}}, {First, stands_again(1, One)}),
    {[], Both} = chain(One, [stands(2, spot(2))]),
    ?assertMatch({_, Opened}, starl_dpp_dispatcher:lead(Both)),
    {Leads, []} = starl_dpp_dispatcher:lead(One),
    ?assertMatch({Opened, _}, chain(Leads, [stands(2, spot(2))])).

stands_again(Robot, S) ->
    starl_dpp_dispatcher:reported(Robot, {1, 0}, {{standing, spot(Robot)}, []}, S).

%% Robots that were seen a little too near to each other are moved apart, as far as the slack goes.
opens_apart_test() ->
    Near = fun(Y) -> {6000.0, 8000.0 + Y} end,
    {Actions, S} = chain(new([short()], 2), [stands(1, Near(0.0)), stands(2, Near(439.0))]),
    [{1, [{P, P}]}, {2, [{Q, Q}]}] = [{R, Held} || {trace, {reserved, R, Held}} <- Actions],
    ?assert(starl_geometry:distance(P, Q) >= 440.0),
    {Next, _} = chain(S, [
        fun(S0) -> starl_dpp_dispatcher:reported(1, {1, 1}, {{standing, Near(0.0)}, []}, S0) end
    ]),
    ?assertMatch([{trace, {reserved, 1, [_]}}], Next).

%% Nobody is told anything before it leads, though all is painted.
told_by_the_leader_only_test() ->
    {ok, Plan} = starl_dpp_plan:new(config([short()], 1)),
    Idle = starl_dpp_dispatcher:new(Plan, {1, 1, 1}),
    Ask = fun(S) -> starl_dpp_dispatcher:requested(1, {1, 1}, {spot(1), [1]}, S) end,
    {Actions, S} = chain(Idle, [Ask]),
    ?assertEqual([?GIVE_UP], Actions),
    {Led, _} = starl_dpp_dispatcher:lead(S),
    {Told, _} = chain(Led, [fun starl_dpp_dispatcher:serve/1]),
    ?assertEqual([{1, {1, 1}, complete}], sent(Told)).

%% While it waits for robots that are not found the time runs once, and is over once.
gives_up_test() ->
    {First, S1} = chain(new([short()], 2), [asks(1, 1)]),
    ?assertEqual([?GIVE_UP], First),
    {Second, S2} = chain(S1, [asks(1, 2)]),
    ?assertEqual([], Second),
    {Ended, S3} = chain(S2, [fun starl_dpp_dispatcher:give_up/1]),
    ?assertEqual([{1, {1, 2}, incomplete}], sent(Ended)),
    ?assertEqual([{trace, {unreachable, [1]}}], [A || {trace, _} = A <- Ended]),
    {Again, _} = chain(S3, [asks(1, 3)]),
    ?assertEqual([?GIVE_UP], Again),
    %% who has been told waits no more
    ?assertMatch(
        {[{trace, {unreachable, [1]}}], _}, chain(S3, [fun starl_dpp_dispatcher:give_up/1])
    ).

%% Robot 2 is dead on the only line: it waits for that one, from when nobody moves. Work that is
%% given out ends that.
dead_on_the_line_test() ->
    On = {6050.0, 6000.0},
    Dead = fun(S) -> starl_dpp_dispatcher:rests(2, On, S) end,
    S0 = known([1, 2, 3], new([short()], 3)),
    Way = {moving, 0, spot(3), [{{9000.0, 9000.0}, up}]},
    Moves = fun(S) -> starl_dpp_dispatcher:reported(3, {1, 5}, {Way, []}, S) end,
    {Waits, S1} = chain(S0, [Moves, Dead, asks(1, 1)]),
    ?assertEqual({[], [?SERVE]}, {sent(Waits), lists:usort(timers(Waits))}),
    Stops = fun(S) ->
        starl_dpp_dispatcher:reported(3, {1, 6}, {{standing, {9000.0, 9000.0}}, []}, S)
    end,
    {Stopped, S2} = chain(S1, [Stops]),
    ?assertEqual([?SERVE], timers(Stopped)),
    {Served, S3} = chain(S2, [fun starl_dpp_dispatcher:serve/1]),
    ?assertEqual({[], [?GIVE_UP]}, {sent(Served), timers(Served)}),
    {Again, _} = chain(S3, [fun starl_dpp_dispatcher:serve/1]),
    ?assertEqual([], Again),
    Back = fun(S) -> starl_dpp_dispatcher:reported(2, {1, 7}, {{standing, spot(2)}, []}, S) end,
    {Free, S4} = chain(S3, [Back, fun starl_dpp_dispatcher:serve/1]),
    ?assertMatch([{1, {1, 1}, {assign, _, _}}], sent(Free)),
    ?assertEqual([?SERVE, {{timeout, give_up}, cancel}], timers(Free)),
    ?assertMatch([{assigned, 1, {1, 1}, [_ | _]}], [E || {trace, {assigned, _, _, _} = E} <- Free]),
    {Stuck, _} = chain(S4, [asks_without(1, 2), Dead, asks(1, 3)]),
    ?assertEqual([?GIVE_UP], [T || {_, _, give_up} = T <- timers(Stuck)]).

%% Its path is over, and nothing of it is painted; then it stands, and does not ask.
asks_without(Robot, N) ->
    fun(S) -> starl_dpp_dispatcher:reported(Robot, {1, N}, {{standing, spot(Robot)}, []}, S) end.

timers(Actions) -> [A || A <- Actions, is_tuple(element(1, A))].

%% Who waits is served when space has become free, though another is still on its way.
served_while_one_moves_test() ->
    On = {6050.0, 6000.0},
    Way = {moving, 0, spot(3), [{{9000.0, 9000.0}, up}]},
    Moves = fun(S) -> starl_dpp_dispatcher:reported(3, {1, 5}, {Way, []}, S) end,
    Stands = fun(N, At) ->
        fun(S) -> starl_dpp_dispatcher:reported(2, {1, N}, {{standing, At}, []}, S) end
    end,
    S0 = known([1, 2, 3], new([short()], 3)),
    {Waits, S1} = chain(S0, [Moves, Stands(1, On), asks(1, 1), Stands(2, spot(2))]),
    ?assertEqual([], sent(Waits)),
    ?assertMatch([{1, {1, 1}, {assign, _, _}}], answers([fun starl_dpp_dispatcher:serve/1], S1)).

%% Who holds less than before is traced; who waits is served soon after, and else there is no need.
freed_space_is_traced_and_serves_who_waits_test() ->
    S0 = known([1, 2], new([short()], 2)),
    {Alone, _} = chain(S0, [asks_without(2, 1)]),
    ?assertEqual([{trace, {reserved, 2, [{spot(2), spot(2)}]}}], Alone),
    {[_ | _], S1} = chain(S0, [asks(1, 1), asks(2, 1)]),
    {Waited, _} = chain(S1, [fun(S) -> starl_dpp_dispatcher:passed(1, {1, 1}, 1, S) end]),
    ?assertMatch([{trace, {reserved, 1, [_ | _]}}, ?SERVE], Waited).

%% All is painted and nobody waits: there is nothing to be waited for.
nothing_left_test() ->
    S = known([1], new([short()], 1)),
    Ask = fun(S0) -> starl_dpp_dispatcher:requested(1, {1, 1}, {spot(1), [1]}, S0) end,
    {Actions, _} = chain(S, [Ask]),
    ?assertEqual({[{1, {1, 1}, complete}], [?SERVE]}, {sent(Actions), timers(Actions)}).

%% -- robots that are silent -------------------------------------------------------------------

a_silent_robot_rests_where_it_was_seen_test() ->
    Rests = fun(S) -> starl_dpp_dispatcher:rests(1, spot(1), S) end,
    S0 = known([1, 2], new([short()], 2)),
    {First, S1} = chain(S0, [Rests]),
    ?assertEqual(
        [{trace, {silent, 1}}, {trace, {reserved, 1, [{spot(1), spot(1)}]}}], First
    ),
    ?assertEqual({true, false}, {
        starl_dpp_dispatcher:silent(1, S1), starl_dpp_dispatcher:silent(2, S1)
    }),
    {_, Twice} = chain(S1, [Rests, asks_without(1, 1)]),
    ?assertNot(starl_dpp_dispatcher:silent(1, Twice)),
    %% it had a path: that is no more, and its line is free
    {[_ | _], S2} = chain(S0, [asks(1, 1), Rests]),
    ?assertEqual({S2, []}, starl_dpp_dispatcher:passed(1, {1, 1}, 1, S2)),
    ?assertMatch([{2, {1, 1}, {assign, _, _}}], answers([asks(2, 1)], S2)).

%% When who moved last rests, all wait: one is sent out of the way.
rests_settles_test() ->
    S0 = known([1, 2], new([short()], 2)),
    On = {6050.0, 6000.0},
    Way = {moving, 0, spot(2), [{On, up}]},
    Moves = fun(S) -> starl_dpp_dispatcher:reported(2, {1, 5}, {Way, []}, S) end,
    {Waits, S1} = chain(S0, [Moves, asks(1, 1)]),
    ?assertEqual({[], []}, {sent(Waits), [T || {_, _, give_up} = T <- timers(Waits)]}),
    {Actions, _} = chain(S1, [fun(S) -> starl_dpp_dispatcher:rests(2, On, S) end]),
    ?assertEqual([[1]], resolved(Actions)).

%% Two silent robots stand less than 2R from lines, one from two of them. One far away stands in nobody's way, and
%% neither does one beside a line that is heard. When they are heard again nothing is in the way.
a_silent_robot_in_the_way_is_named_test() ->
    Lines = [short(), {{6000.0, 6200.0}, {6100.0, 6200.0}}, {{6000.0, 9000.0}, {6100.0, 9000.0}}],
    Rests = fun(Robot, At) -> fun(S) -> starl_dpp_dispatcher:rests(Robot, At, S) end end,
    {_, S1} = chain(new(Lines, 4), [
        stands(4, {6500.0, 9000.0}),
        Rests(1, {6050.0, 6100.0}),
        Rests(2, {6050.0, 9000.0 - 2 * ?R}),
        Rests(3, {9000.0, 3000.0})
    ]),
    {GivenUp, S2} = chain(S1, [fun starl_dpp_dispatcher:give_up/1]),
    ?assertEqual(
        [{in_the_way, 1, lists:sublist(Lines, 2)}, {in_the_way, 2, [lists:last(Lines)]}, ?LEFT],
        traced(GivenUp)
    ),
    Heard = [stands(1, 9, {6050.0, 6100.0}), stands(2, 9, {3000.0, 3000.0})],
    {_, S3} = chain(S2, Heard),
    {Again, _} = chain(S3, [fun starl_dpp_dispatcher:give_up/1]),
    ?assertEqual([?LEFT], traced(Again)).

traced(Actions) -> [E || {trace, E} <- Actions].

%% What a silent robot said of a path before its leave ended is nothing.
late_path_test() ->
    S0 = known([1, 2], new([short()], 2)),
    {S1, _} = starl_dpp_dispatcher:rests(1, spot(1), S0),
    Way = {moving, 0, spot(1), [{{9000.0, 9000.0}, up}]},
    ?assertEqual({S1, []}, starl_dpp_dispatcher:reported(1, {1, 5}, {Way, []}, S1)),
    ?assertMatch(
        {_, [{trace, {reserved, 1, [_]}}]},
        starl_dpp_dispatcher:reported(1, {1, 5}, {Way, []}, S0)
    ).

%% -- what robots say ----------------------------------------------------------------------------

%% Of a path that is at its end nothing is held but the place.
path_at_its_end_test() ->
    At = {9000.0, 9000.0},
    {S, Actions} = starl_dpp_dispatcher:reported(
        1, {1, 5}, {{moving, 3, At, []}, []}, known([1, 2], new([short()], 2))
    ),
    ?assertEqual([{trace, {reserved, 1, [{At, At}]}}], Actions),
    ?assertEqual({S, []}, starl_dpp_dispatcher:passed(1, {1, 5}, 4, S)).

%% Lines that are not in the picture, painted or on the path, are traced, and nothing is believed;
%% an old word is nothing to speak of.
edges_that_cannot_be_are_traced_and_not_believed_test() ->
    S = known([1, 2], new([short()], 2)),
    Way = {moving, 0, spot(1), [{{9000.0, 9000.0}, {down, 99}}]},
    Stray = fun(Edges) -> {S, [{trace, {malformed, 1, {edges, Edges}}}]} end,
    ?assertEqual(Stray([99, 1]), starl_dpp_dispatcher:reported(1, {1, 5}, {Way, [1]}, S)),
    ?assertEqual(Stray([4711]), starl_dpp_dispatcher:requested(1, {1, 5}, {spot(1), [4711]}, S)),
    ?assertEqual({S, []}, starl_dpp_dispatcher:requested(1, {1, 0}, {spot(1), [1]}, S)),
    ?assertEqual({S, []}, starl_dpp_dispatcher:reported(1, {1, 0}, {{standing, spot(1)}, [1]}, S)).

%% One who asks twice waits once, behind the others.
asks_twice_test() ->
    {_, S} = chain(new([short()], 3), [asks(1, 1), asks(2, 1), asks(1, 2)]),
    {Told, _} = chain(S, [fun starl_dpp_dispatcher:give_up/1]),
    ?assertEqual([{2, {1, 1}, incomplete}, {1, {1, 2}, incomplete}], sent(Told)).

%% -- what is told of the paint ------------------------------------------------------------------

%% With an answer goes what the robot was not told yet: told is what has arrived.
an_answer_tells_what_the_robot_was_not_told_yet_test() ->
    Far = {{6000.0, 9000.0}, {6100.0, 9000.0}},
    S0 = known([1, 2], new([short(), Far], 2)),
    {S1, _} = starl_dpp_dispatcher:reported(2, {1, 5}, {{standing, spot(2)}, [1]}, S0),
    News = fun(N, S) ->
        {Actions, Next} = chain(S, [asks(1, N)]),
        {hd([New || {call, sap, {send, 1, dpp_answer, {_, _, _, New}}, _} <- Actions]), Next}
    end,
    %% an answer of another term, or none, has told nothing
    {[1], S2} = News(1, starl_dpp_dispatcher:answered(1, ok, S1)),
    {[1], S3} = News(2, S2),
    {[1], S4} = News(2, starl_dpp_dispatcher:answered(1, lost, S2)),
    ?assertEqual(S3, S4),
    {[], S5} = News(3, starl_dpp_dispatcher:answered(1, ok, S3)),
    {S6, _} = starl_dpp_dispatcher:reported(1, {1, 4}, {{standing, spot(1)}, [2]}, S5),
    {[2], _} = News(5, S6).

%% -- helpers --------------------------------------------------------------------------------

short() -> {{6000.0, 6000.0}, {6100.0, 6000.0}}.

config(Lines, N) ->
    #{
        segments => Lines,
        world => {12000.0, 12000.0},
        tube_radius => ?R,
        slack => 10.0,
        robots => lists:seq(1, N)
    }.

%% A coordinator that leads.
new(Lines, N) ->
    {ok, Plan} = starl_dpp_plan:new(config(Lines, N)),
    {S, _} = starl_dpp_dispatcher:lead(starl_dpp_dispatcher:new(Plan, {1, 1, 1})),
    S.

spot(Robot) ->
    {ok, Plan} = starl_dpp_plan:new(config([short()], 3)),
    starl_dpp_plan:spot(Robot, Plan).

known(Robots, S0) ->
    {_, S} = chain(S0, [stands(Robot, spot(Robot)) || Robot <- Robots]),
    S.

stands(Robot, At) -> stands(Robot, 0, At).

stands(Robot, N, At) ->
    fun(S) -> starl_dpp_dispatcher:reported(Robot, {1, N}, {{standing, At}, []}, S) end.

%% The robot drives all around a rectangle, but for the last bit.
around(Robot, {X0, Y0}, {X1, Y1}) ->
    Path = [{{X1, Y0}, up}, {{X1, Y1}, up}, {{X0, Y1}, up}, {{X0, Y0 + 100.0}, up}],
    fun(S) ->
        starl_dpp_dispatcher:reported(Robot, {1, 5}, {{moving, 0, {X0, Y0}, Path}, []}, S)
    end.

asks(Robot, N) -> asks(Robot, N, spot(Robot)).

asks(Robot, N, At) -> fun(S) -> starl_dpp_dispatcher:requested(Robot, {1, N}, {At, []}, S) end.

chain(S, Steps) ->
    lists:foldl(
        fun(Step, {Actions, S0}) ->
            {S1, More} = Step(S0),
            {Actions ++ More, S1}
        end,
        {[], S},
        Steps
    ).

answers(Steps, S) ->
    {Actions, _} = chain(S, Steps),
    sent(Actions).

sent(Actions) ->
    [{R, Id, A} || {call, sap, {send, R, dpp_answer, {_, Id, A, _}}, _} <- Actions].

resolved(Actions) -> [Robots || {trace, {deadlock_resolved, Robots}} <- Actions].
