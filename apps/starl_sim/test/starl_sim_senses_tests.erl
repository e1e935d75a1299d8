%% The senses of simulated robots, and their faults.
-module(starl_sim_senses_tests).
-include_lib("eunit/include/eunit.hrl").

%% Who asks is answered, who watches is told, and all ways of running say the same.
senses_of_a_run_test() ->
    Ways = [#{mode => process}, #{mode => inline}, #{shards => 2}],
    [{Told, Felt} | _] = Results = [result(1, Way) || Way <- Ways],
    ?assertEqual([{Told, Felt}], lists:usort(Results)),
    ?assertEqual({1, orange}, Told),
    ?assertEqual([], [One || Looks <- Felt, {_, {error, _}} = One <- Looks]),
    ?assertMatch([#{robot := 2}], last(bearing, Felt)),
    ?assertEqual(none, last(bump, Felt)),
    ?assert(last(light, Felt) > 0.3).

last(Kind, Felt) ->
    {ok, Reading} = proplists:get_value(Kind, lists:last(Felt)),
    Reading.

%% Each fault is seen, in its robot and its sense only.
faults_of_senses_test() ->
    Of = fun(Kind, Sense, Params) ->
        {_, Felt} = result(1, #{
            faults => [{f, 0, 1000000, Kind, 1, Params#{sense => Sense}}]
        }),
        Felt
    end,
    Gone = Of(sense_gone, camera, #{}),
    ?assertEqual(
        [{error, gone}], lists:usort([proplists:get_value(camera, Looks) || Looks <- Gone])
    ),
    ?assert(last(light, Gone) > 0.3),
    Frozen = Of(sense_frozen, all, #{}),
    ?assertEqual(1, length(lists:usort([proplists:get_value(range, Looks) || Looks <- Frozen]))),
    Wrong = [L || Looks <- Of(sense_wrong, battery, #{}), {battery, {ok, L}} <- Looks],
    ?assert(lists:max(Wrong) - lists:min(Wrong) > 0.3),
    Spread = fun(Felt) ->
        Lights = [L || Looks <- Felt, {light, {ok, L}} <- Looks],
        lists:max(Lights) - lists:min(Lights)
    end,
    {_, Usual} = result(1, #{}),
    ?assert(Spread(Of(sense_noisy, light, #{times => 10})) > 3 * Spread(Usual)).

%% Without a floor plan there is nothing to sense and nothing to close, and no such fault is drawn; without
%% doors none is closed.
no_floor_no_senses_test() ->
    Draw = fun(Floor) ->
        lists:usort([
            {starl_run_fault:class(Fault), element(4, Fault) =:= closed}
         || Seed <- lists:seq(1, 30),
            Fault <- starl_run_fault_draw:draw(#{
                seed => Seed,
                robots => 2,
                machines => [app],
                until_ms => 1000,
                floor => Floor,
                kinds => [all]
            }),
            lists:member(starl_run_fault:class(Fault), [sense, floor])
        ])
    end,
    ?assertEqual([], Draw(none)),
    ?assertEqual([{floor, false}, {sense, false}], Draw({0, {5000.0, 5000.0}})),
    ?assertEqual(
        [{floor, false}, {floor, true}, {sense, false}], Draw({2, {5000.0, 5000.0}})
    ).

faults_of_a_floor_need_one_test() ->
    Line = fun(Scenario) ->
        {error, Reason} = starl_sim:start(Scenario#{
            faults => [{shut, 0, 1000, closed, all, #{door => 3}}]
        }),
        lists:flatten(starl_sim:format_error(Reason))
    end,
    ?assertEqual(
        "fault shut is one of a floor plan: give a plan with --floor",
        Line(#{app => starl_exercise, block => sap})
    ),
    ?assertEqual(
        "fault shut: there is no door 3, the floor plan has doors 1 to 1",
        Line(#{app => starl_bumper, floor => "two_rooms"})
    ).

result(Robot, More) ->
    {ok, Sim} = starl_sim:start(maps:merge(#{app => starl_feeler, robots => 2, time => 60}, More)),
    _ = starl_sim:run(Sim),
    {#{robots := Robots, violations := []}, _} = starl_sim:finish(Sim),
    {Robot, #{result := {done, Result}}} = lists:keyfind(Robot, 1, Robots),
    Result.
