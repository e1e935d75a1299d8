%% The facts of a run that the page gets first.
-module(starl_view_head_tests).
-include_lib("eunit/include/eunit.hrl").

%% Every contract of a run has a light, those of an application of its own too; by the word that its violations
%% have. The crashes of machines break contracts that are named after these.
contracts_test() ->
    Monitors = [
        {starl_sap_monitor, #{}},
        {starl_crash_monitor, #{}},
        {starl_run_progress_monitor, #{}},
        {starl_exercise_monitor, #{}},
        {starl_election_bully_monitor, #{}},
        {flock_monitor, #{}}
    ],
    ?assertEqual(
        [<<"calls">>, <<"election">>, <<"flock">>, <<"progress">>, <<"sap">>], contracts(Monitors)
    ).

%% Walls, doors, and a place for each room's name; null without a plan.
the_plan_test() ->
    Floor = starl_floor:new(#{
        size => {4000, 3000},
        walls => [starl_floor:box(1000, 0, 1100, 3000)],
        doors => [{{1050, 500}, {1050, 900}}],
        rooms => #{hall => starl_floor:box(0, 0, 1000, 3000)}
    }),
    [[<<"run">>, #{plan := Plan}] | _] = starl_view_head:rows((facts([]))#{floor => Floor}, #{}),
    #{walls := [[_, _, _, _]], doors := Doors, rooms := [[hall, X, _]]} = Plan,
    ?assertEqual({[[1050.0, 500.0, 1050.0, 900.0]], 500.0}, {Doors, X}),
    ?assertMatch([[<<"run">>, #{plan := null}] | _], starl_view_head:rows(facts([]), #{})).

contracts(Monitors) ->
    [[<<"run">>, #{contracts := Contracts}] | _] = starl_view_head:rows(facts(Monitors), #{}),
    Contracts.

facts(Monitors) ->
    #{
        app => starl_painting,
        scenario => #{},
        robots => [{1, {0.0, 0.0, 0.0}}],
        monitors => Monitors,
        waypoints => #{},
        machines => #{}
    }.
