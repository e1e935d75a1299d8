%% How much longer than usual anything may take because of faults, and the bounds that monitors get:
%% wider by that, and by no more.
-module(starl_sim_fault_tests).
-include_lib("eunit/include/eunit.hrl").

slack(Faults) ->
    starl_sim_fault:slack_us([{f, From, To, Kind, 1, P} || {From, To, Kind, P} <- Faults]).

%% A robot that is slow is late at most once at each of SAP's retransmissions, twenty at most.
slow_test() ->
    ?assertEqual(20 * 50 * 1000, slack([{100, 9000, slow, #{lag_ms => 50}}])).

%% One that stands still is late by that long, whatever became of it.
standing_test_() ->
    [
        {atom_to_list(Kind), ?_assertEqual(900 * 1000, slack([{100, 1000, Kind, #{}}]))}
     || Kind <- [pause, reboot, clock_freeze]
    ].

%% A clock that is wrong is late by how much it is wrong, to either side; drift by its part.
clocks_test() ->
    [
        ?assertEqual(700 * 1000, slack([{100, 1000, Kind, #{ms => Ms}}]))
     || Kind <- [clock_step, clock_offset], Ms <- [700, -700]
    ],
    [
        ?assertEqual(20 * 1000, slack([{0, 2000, clock_drift, #{ppm => Ppm}}]))
     || Ppm <- [10000, -10000]
    ],
    ?assertEqual(1000, slack([{0, 1, clock_drift, #{ppm => 1}}])).

others_test() ->
    ?assertEqual(0, slack([])),
    ?assertEqual(0, slack([{0, 9000, Kind, #{}} || Kind <- [kill_robot, kill_machine, loss]])).

sum_test() ->
    ?assertEqual(
        (20 * 50 + 900) * 1000,
        slack([{100, 9000, slow, #{lag_ms => 50}}, {100, 1000, pause, #{}}])
    ).

%% No fault of a schedule widens a bound of the whole run: monitors excuse what it explains.
bounds_test() ->
    Sound = bounds([]),
    Slow = bounds([{f, 100, 9000, slow, 1, #{lag_ms => 50}}]),
    ?assertEqual(
        [starl_sap_monitor, starl_sim_order_monitor, starl_sim_told_monitor],
        lists:sort(maps:keys(Sound))
    ),
    ?assertEqual(1000, maps:get(starl_sim_told_monitor, Sound)),
    ?assertEqual(Sound, Slow).

bounds(Faults) ->
    App = starl_sim_script_app,
    Given = #{app => App, robots => 3, faults => Faults, random_faults => []},
    {ok, Scenario} = starl_sim_scenario:check(Given, starl_app:options(App)),
    Scene = #{
        app => {sequential, App, #{}},
        monitors => [
            {starl_sim_told_monitor, #{bound_us => 1000}},
            {starl_sim_order_monitor, #{bound_us => 7}}
        ]
    },
    Context = starl_sim_plan:context(App, Scenario),
    #{monitors := Monitors} = starl_sim_plan:make(Scenario, Scene, Context, #{}),
    maps:from_list([{M, Us} || {M, #{bound_us := Us}} <- Monitors, is_integer(Us)]).

%% The name of a fault is an atom, and that is said first.
a_number_is_no_name_test() ->
    [Problem] = starl_sim_fault:check([{1, 15000, 16000, reboot, 3, #{}}]),
    ?assertEqual(
        "fault 1 of the list: its name is an atom, as in a1, not 1",
        lists:flatten(starl_sim_fault:format_problem(Problem))
    ).
