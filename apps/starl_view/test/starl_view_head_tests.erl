%% The facts of a run that the page gets first.
-module(starl_view_head_tests).
-include_lib("eunit/include/eunit.hrl").

%% Every contract of a run has a light, those of an application of its own too; by the word that its violations
%% have. The crashes of machines break contracts that are named after these.
contracts_test() ->
    Monitors = [
        {starl_sap_monitor, #{}},
        {starl_crash_monitor, #{}},
        {starl_sim_progress_monitor, #{}},
        {starl_exercise_monitor, #{}},
        {starl_election_bully_monitor, #{}},
        {flock_monitor, #{}}
    ],
    ?assertEqual(
        [<<"calls">>, <<"election">>, <<"flock">>, <<"progress">>, <<"sap">>], contracts(Monitors)
    ).

contracts(Monitors) ->
    Facts = #{
        app => starl_painting,
        scenario => #{},
        robots => [{1, {0.0, 0.0, 0.0}}],
        monitors => Monitors,
        waypoints => #{},
        machines => #{}
    },
    [[<<"run">>, #{contracts := Contracts}] | _] = starl_view_head:rows(Facts, #{}),
    Contracts.
