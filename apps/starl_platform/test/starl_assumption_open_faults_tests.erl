%% Faults of a live run excuse while they last, and hardly longer.
-module(starl_assumption_open_faults_tests).
-include_lib("eunit/include/eunit.hrl").

-define(L, starl_assumption_open_faults).
-define(S, 1000000).

fault(Id, From, To, Kind, Target) -> {Id, 1000 * From, ms(To), Kind, Target, #{}}.

ms(forever) -> forever;
ms(S) -> 1000 * S.

began(Fault, Lasting) -> ?L:report({began, Fault}, Lasting).

%% The windows that monitors were told when they have judged each second.
told(Lasting, From, To) ->
    {All, Left} = lists:mapfoldl(
        fun(S, L) -> ?L:windows(S * ?S, L) end, Lasting, lists:seq(From, To)
    ),
    {lists:append(All), Left}.

%% The slices follow each other without a hole, and end less than 5 s after the fault.
slices_follow_without_a_hole_test() ->
    Begun = began(fault(a, 10, forever, location_frozen, 3), ?L:new()),
    {Windows, Left} = told(Begun, 10, 60),
    ?assert(lists:all(fun({R, _, _, What}) -> {R, What} =:= {3, fault} end, Windows)),
    [{_, From, _, _} | _] = Windows,
    ?assertEqual(10 * ?S, From),
    Ends = [To || {_, _, To, _} <- Windows],
    ?assertEqual(lists:droplast(Ends), [Since || {_, Since, _, _} <- tl(Windows)]),
    ?assert(lists:last(Ends) > 62 * ?S andalso lists:last(Ends) =< 65 * ?S),
    Over = ?L:report({ended, fault(a, 10, 60, location_frozen, 3)}, Left),
    ?assertEqual({[], ?L:new()}, told(Over, 61, 99)).

%% Also what is over before anything was judged; a link is its two robots.
fault_over_before_judgement_is_told_test() ->
    Begun = began(fault(a, 10, forever, loss, {1, 2}), ?L:new()),
    Over = ?L:report({ended, fault(a, 10, 11, loss, {1, 2})}, Begun),
    {Windows, Left} = ?L:windows(12 * ?S, Over),
    ?assertEqual([{1, 10 * ?S, 11 * ?S, fault}, {2, 10 * ?S, 11 * ?S, fault}], lists:sort(Windows)),
    ?assertEqual(?L:new(), Left).

%% A fault of all excuses all; places that are told wrong mislead a robot, too.
%% Holds: Faults by hand of all robots, and of places, excuse in real time; the monitors of
%% applications are told of them
%% Red: d7c73771, run
what_a_fault_breaks_is_told_test() ->
    Breaks = fun(Kind, Target) ->
        {Windows, _} = ?L:windows(12 * ?S, began(fault(a, 10, forever, Kind, Target), ?L:new())),
        lists:sort([{Robot, What} || {Robot, _, _, What} <- Windows])
    end,
    [
        ?assertEqual([{all, fault}], Breaks(Kind, all))
     || Kind <- [sense_gone, sense_frozen, sense_noisy, sense_wrong, location_dropout]
    ],
    ?assertEqual([{2, fault}], Breaks(sense_wrong, 2)),
    [
        ?assertEqual([{all, fault}, {all, position}], Breaks(Kind, all))
     || Kind <- [location_bias, location_noise]
    ],
    ?assertEqual(
        [{1, fault}, {1, position}, {2, fault}, {2, position}], Breaks(location_swap, {1, 2})
    ).

%% A halt is waited for, a kill has no length, a schedule's faults are known from the beginning.
halts_kills_and_schedules_are_not_open_test() ->
    Faults = [
        fault(a, 10, forever, pause, 1),
        fault(b, 10, 10, kill_robot, 2),
        fault(c, 10, 20, loss, {1, 2})
    ],
    ?assertEqual(?L:new(), lists:foldl(fun began/2, ?L:new(), Faults)).

%% A robot that is down is a fault until it is up; one that is down twice is two.
a_robot_that_is_down_is_a_fault_test() ->
    Down = ?L:traced([{10 * ?S, 3, robot, down}, {10 * ?S, 3, sap, crashed}], ?L:new()),
    {Windows, Left} = told(Down, 10, 40),
    ?assert(lists:all(fun({R, _, _, What}) -> {R, What} =:= {3, fault} end, Windows)),
    ?assertMatch([{_, 10 * ?S, _, _} | _], Windows),
    Up = ?L:traced([{41 * ?S, 2, robot, up}], Left),
    ?assertNotEqual({[], ?L:new()}, ?L:windows(45 * ?S, Up)),
    ?assertEqual({[], ?L:new()}, ?L:windows(45 * ?S, ?L:traced([{41 * ?S, 3, robot, up}], Up))),
    Twice = [{T * ?S, 1, robot, What} || {T, What} <- [{1, down}, {3, up}, {5, down}, {6, up}]],
    {Both, None} = ?L:windows(7 * ?S, ?L:traced(Twice, ?L:new())),
    ?assertEqual([{1, ?S, 3 * ?S, fault}, {1, 5 * ?S, 6 * ?S, fault}], lists:sort(Both)),
    ?assertEqual(?L:new(), None).

%% A robot whose computer is switched on later than the others' is one until its first event.
a_robot_that_comes_later_is_a_fault_until_then_test() ->
    Absent = ?L:absent([1, 2], ?S, ?L:new()),
    Came = ?L:traced([{?S, 1, app, begins}, {2 * ?S, 1, app, goes_on}], Absent),
    {Windows, Left} = ?L:windows(2 * ?S, Came),
    ?assertEqual([{2, ?S, 7 * ?S, fault}], Windows),
    Late = ?L:traced([{9 * ?S, 2, app, begins}], Left),
    ?assertEqual({[{2, 7 * ?S, 9 * ?S, fault}], ?L:new()}, ?L:windows(9 * ?S, Late)).
