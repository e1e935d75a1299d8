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

%% Without a floor plan there is nothing to sense, and no such fault is drawn.
no_floor_no_senses_test() ->
    Draw = fun(Senses) ->
        [
            Fault
         || Seed <- lists:seq(1, 30),
            Fault <- starl_sim_fault_draw:draw(#{
                seed => Seed,
                robots => 2,
                machines => [app],
                until_ms => 1000,
                senses => Senses,
                kinds => [all]
            }),
            starl_sim_fault:class(Fault) =:= sense
        ]
    end,
    ?assertEqual([], Draw(false)),
    ?assertNotEqual([], Draw(true)).

result(Robot, More) ->
    {ok, Sim} = starl_sim:start(maps:merge(#{app => starl_feeler, robots => 2, time => 60}, More)),
    _ = starl_sim:run(Sim),
    {#{robots := Robots, violations := []}, _} = starl_sim:finish(Sim),
    {Robot, #{result := {done, Result}}} = lists:keyfind(Robot, 1, Robots),
    Result.
