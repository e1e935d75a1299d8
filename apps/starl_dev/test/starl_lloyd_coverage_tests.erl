%% The coverage workload: the middle of a cell, and a team that spreads.
-module(starl_lloyd_coverage_tests).
-include_lib("eunit/include/eunit.hrl").

%% Alone it stays; beside a wall, or another robot, it goes the other way; no farther than it sees.
middle_test() ->
    Middle = fun(At, Others) -> starl_lloyd_coverage:middle(At, Others, 1000, 10000) end,
    ?assertEqual({5000.0, 5000.0}, Middle({5000, 5000}, [])),
    ?assertMatch({X, 5000.0} when X > 5200, Middle({5000, 5000}, [{-400, 0}])),
    ?assertMatch({X, Y} when X > 300 andalso Y > 300, Middle({0, 0}, [])),
    ?assertEqual({5000.0, 5000.0}, Middle({5000, 5000}, [{-400, 0}, {400, 0}])),
    ?assertEqual({5000.0, 5000.0}, Middle({5000, 5000}, [{-2100, 0}])).

%% In the end robots are in every quarter of the floor; at first there were some in one.
spreads_test_() ->
    {timeout, 120, fun() ->
        Run = fun(Rounds) ->
            {ok, Sim} = starl_sim:start(#{
                app => starl_lloyd_coverage, robots => 16, rounds => Rounds
            }),
            _ = starl_sim:run(Sim),
            {#{violations := []}, #{figures := Figures}} = starl_sim:finish(Sim),
            Figures
        end,
        ?assertEqual(0.0, proplists:get_value(emptiest_quarter, Run(1))),
        ?assert(proplists:get_value(emptiest_quarter, Run(60)) >= 3 / 16)
    end}.
