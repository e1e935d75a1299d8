%% The bounds that monitors get.
-module(starl_run_fault_tests).
-include_lib("eunit/include/eunit.hrl").

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
    {ok, Scenario} = starl_run_scenario:check(Given, starl_app:options(App)),
    Scene = #{
        app => {sequential, App, #{}},
        monitors => [
            {starl_sim_told_monitor, #{bound_us => 1000}},
            {starl_sim_order_monitor, #{bound_us => 7}}
        ]
    },
    Context = starl_run_plan:context(App, Scenario),
    #{monitors := Monitors} = starl_run_plan:make(Scenario, Scene, Context, {[], []}, #{}),
    maps:from_list([{M, Us} || {M, #{bound_us := Us}} <- Monitors, is_integer(Us)]).

%% The name of a fault is an atom, and that is said first.
a_number_is_no_name_test() ->
    [Problem] = starl_run_fault:check([{1, 15000, 16000, reboot, 3, #{}}]),
    ?assertEqual(
        "fault 1 of the list: its name is an atom, as in a1, not 1",
        lists:flatten(starl_run_fault:format_problem(Problem))
    ).
