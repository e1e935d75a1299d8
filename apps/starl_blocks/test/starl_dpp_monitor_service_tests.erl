%% Path planning goes on: those who wait are answered, and no line is given up without a reason.
%%
%% Holds: When no robot is on its way and one waits, one is answered: free lines are assigned,
%% deadlocks resolved; no line is given up while all robots are heard; no robot moves without a
%% reservation
%% Red: d018c00, run: the planted coordinator, which takes no more requests, is not found
-module(starl_dpp_monitor_service_tests).
-include_lib("eunit/include/eunit.hrl").

-define(S, 1000000).
-define(TEAM, [1, 2, 3]).
%% An answer within three seconds, after a fault within another forty; everything together in a minute.
-define(TIMES, #{
    faults => [],
    answer_us => 3 * ?S,
    again_us => 40 * ?S,
    whole_us => 60 * ?S,
    silent_us => 30 * ?S
}).
-define(OPEN, {0, 1, dpp_coordinator, {coordinator, {1, 1, 1}}}).

answered_in_time_test() ->
    ?assertEqual([], judge([?OPEN, asks(1, 1), answered(3, 1, assign)])),
    ?assertEqual([], judge([?OPEN, asks(1, 1), answered(3, 1, complete)])),
    ?assertEqual([{unanswered, 4, [1]}], judge([?OPEN, asks(1, 1)])),
    ?assertEqual([{unanswered, 4, [1]}], judge([?OPEN, asks(1, 1), answered(5, 1, assign)])).

%% While one is on its way the others may wait for it: until all wait, which is a deadlock.
deadlock_is_resolved_test() ->
    One = [?OPEN, asks(1, 1), answered(2, 1, assign), asks(3, 2)],
    ?assertEqual([], judge(One)),
    ?assertEqual([{unanswered, 13, [1, 2]}], judge(One ++ [asks(10, 1)])),
    ?assertEqual([], judge(One ++ [asks(10, 1), answered(12, 2, assign)])),
    %% its coordinator takes it to be on its way, whatever it knows itself
    ?assertEqual([], judge(One ++ [{10, 1, dpp, crashed}, {10, 1, dpp, {void, {1, 1}}}])).

%% Without a coordinator that knows all places, and with a silent robot, it takes all its time.
another_coordinator_test() ->
    Whole = [{unanswered, 61, [1]}],
    ?assertEqual(Whole, judge([asks(1, 1)])),
    [
        ?assertEqual(Whole, judge([?OPEN, asks(1, 1), {2, 1, dpp_coordinator, Event}]))
     || Event <- [crashed, {claims, {2, 1, 1}}, {stepped_down, {1, 1, 1}}, {silent, 3}]
    ],
    ?assertEqual(
        [{unanswered, 62, [1]}], judge([?OPEN, asks(1, 1), {2, 3, robot, {died, killed}}])
    ),
    ?assertEqual([{unanswered, 23, [1]}], judge([asks(1, 1), setelement(1, ?OPEN, 20)])).

%% Without a quorum nobody leads, and a robot that is down comes back.
quorum_test() ->
    Dead = fun(Robot) -> {2, Robot, robot, {died, killed}} end,
    ?assertEqual([], judge([?OPEN, asks(1, 1), Dead(2), Dead(3)])),
    Down = [?OPEN, asks(1, 1), {2, 3, robot, down}],
    ?assertEqual([], judge(Down)),
    ?assertEqual([{unanswered, 33, [1]}], judge(Down ++ [{30, 3, robot, up}])).

%% What goes wrong elsewhere, or at another time, hides nothing.
faults_test() ->
    Told = [?OPEN, asks(100, 1)],
    Judge = fun(From, To) ->
        judge(Told, ?TIMES#{faults => [{2, From * ?S, To * ?S, fault}]})
    end,
    ?assertEqual([{unanswered, 103, [1]}], Judge(1, 59)),
    ?assertEqual([{unanswered, 103, [1]}], Judge(104, 200)),
    ?assertEqual([{unanswered, 104, [1]}], Judge(1, 61)),
    ?assertEqual([{unanswered, 145, [1]}], Judge(101, 102)),
    ?assertEqual([], judge(Told, ?TIMES#{answer_us => infinity})).

%% Lines are given up because of robots that are not heard.
given_up_test() ->
    GivesUp = fun(Before) ->
        judge([?OPEN | Before] ++ [{9, 1, dpp_coordinator, {unreachable, [4, 5]}}])
    end,
    ?assertEqual([{given_up, 9, [1]}], GivesUp([])),
    ?assertEqual([], GivesUp([{5, 2, robot, {died, killed}}])),
    ?assertEqual([], GivesUp([{5, 1, dpp_coordinator, {claims, {2, 1, 1}}}])).

%% A robot that is not heard is a reason where a fault of its own, of the coordinator or of the radio of all explains
%% that: not one of another robot, nor one that was over long before. The coordinator says it before it knows all
%% places, and in each term anew.
%% Holds: Lines are given up only for robots that a fault cuts off; nobody is accused of it
%% Red: 961f67c9, run
given_up_for_a_robot_that_is_cut_off_test() ->
    GivesUp = fun({Robot, From, To}, Events) ->
        judge(Events ++ [{50, 1, dpp_coordinator, {unreachable, [4, 5]}}], ?TIMES#{
            faults => [{Robot, From * ?S, To * ?S, fault}]
        })
    end,
    Leads = {30, 1, dpp_coordinator, {leads, {2, 1, 1}}},
    Silent = {41, 1, dpp_coordinator, {silent, 2}},
    Open = {41, 1, dpp_coordinator, {coordinator, {2, 1, 1}}},
    [
        ?assertEqual([], GivesUp({Robot, 20, 900}, Events))
     || Robot <- [2, 1, all], Events <- [[Leads, Silent, Open], [Leads, Open, Silent]]
    ],
    Accused = [{given_up, 50, [1]}],
    ?assertEqual(Accused, GivesUp({3, 20, 900}, [Leads, Silent, Open])),
    ?assertEqual(Accused, GivesUp({2, 0, 10}, [Leads, Silent, Open])),
    ?assertEqual(Accused, GivesUp({2, 45, 900}, [Leads, Silent, Open])),
    ?assertEqual(Accused, GivesUp({2, 20, 900}, [setelement(1, Silent, 29), Leads, Open])).

%% The time of a run: an answer of a coordinator that leads all the time, on any radio; the time for everything only
%% where a coordinator surely keeps its lease. Slow wheels prolong nothing, a place that is not known does.
times_test() ->
    Known = #{
        sap => #{}, loss => 0, delay_us => 20000, slack_us => 0, faults => [], bodies => []
    },
    Config = #{robots => ?TEAM, lease_us => 10 * ?S, jump_us => 2 * ?S, drift_ppm => 10000},
    Times = fun(Facts) -> starl_dpp_monitor_service:times(maps:merge(Known, Facts), Config) end,
    ?assertMatch(#{answer_us := 2240000}, Times(#{})),
    #{whole_us := Whole} = Times(#{}),
    ?assert(Whole > 100 * ?S andalso Whole < 200 * ?S),
    #{answer_us := Lossy} = Times(#{loss => 0.2}),
    ?assert(Lossy > 20 * ?S andalso Lossy < 60 * ?S),
    ?assertMatch(
        #{
            whole_us := infinity,
            unjudged := [{"a free line that can be reached is assigned" ++ _, _}]
        },
        Times(#{loss => 0.2})
    ),
    ?assertMatch(#{answer_us := infinity, unjudged := [_]}, Times(#{delay_us => 1000000})),
    ?assertMatch(#{answer_us := 3240000}, Times(#{slack_us => ?S})),
    Fault = {1, 2, 3, fault},
    ?assertMatch(
        #{faults := [Fault]},
        Times(#{faults => [Fault], bodies => [{1, 4, 5, fault}], places => []})
    ),
    ?assertMatch(#{faults := [Fault, Fault]}, Times(#{faults => [Fault], places => [Fault]})).

%% A coordinator that leads all the time answers, though the radio loses packets; after another has claimed nothing is
%% sure any more.
lossy_test() ->
    Lossy = ?TIMES#{whole_us := infinity},
    ?assertEqual([{unanswered, 44, [1]}], judge([?OPEN, asks(1, 1)], Lossy)),
    ?assertEqual(
        [], judge([?OPEN, asks(1, 1), {30, 2, dpp_coordinator, {claims, {2, 2, 1}}}], Lossy)
    ),
    ?assertEqual([], judge([?OPEN, asks(1, 1), {2, 1, dpp_coordinator, {silent, 3}}], Lossy)).

%% A fault that is known only when it has happened.
told_later_test() ->
    {ok, Asked} = fed([?OPEN, asks(1, 1)], ?TIMES),
    Paused = starl_monitor:broken({2, 2 * ?S, 3 * ?S, pause}, Asked),
    ?assertMatch({[], _}, starl_monitor:finish(40 * ?S, Paused)).

asks(T, Robot) -> {T, Robot, dpp, asks}.

answered(T, Robot, What) -> {T, Robot, dpp, {answered, What}}.

judge(Events) -> judge(Events, ?TIMES).

judge(Events, Times) ->
    {Found, Last} = lists:foldl(fun step/2, {[], new(Times)}, Events),
    {Late, _} = starl_monitor:finish(1000 * ?S, Last),
    [{What, At div ?S, Robots} || #{what := What, at_us := At, robots := Robots} <- Found ++ Late].

fed(Events, Times) ->
    {[], Last} = lists:foldl(fun step/2, {[], new(Times)}, Events),
    {ok, Last}.

new(Times) ->
    Config = #{tube_radius => 100.0, r_s => 150.0, robots => ?TEAM, service => Times},
    starl_monitor:new([{starl_dpp_monitor, Config}]).

step({T, Robot, Machine, Event}, {Found, Runner}) ->
    case starl_monitor:step({T * ?S, Robot, Machine, Event}, Runner) of
        {ok, Next} -> {Found, Next};
        {violation, Violation, Next} -> {Found ++ [Violation], Next}
    end.
