%% A run is one thing, wherever its robots are: here in the simulator. Live ones: starl_first_hour_live_SUITE.
-module(starl_run_tests).
-include_lib("eunit/include/eunit.hrl").

%% It is started, goes on to its end, and tells its outcome as any other run does.
runs_to_its_end_test() ->
    {ok, Run} = starl_run:start(starl_sim, #{app => starl_sim_script_app, robots => 2}, #{}),
    ?assertEqual(simulation, starl_run:world(Run)),
    ?assertMatch(#{robots := 2, app := starl_sim_script_app}, starl_run:scenario(Run)),
    ?assertMatch(#{now_us := 0, ending := none}, starl_run:status(Run)),
    ?assertEqual(done, starl_run:await(Run)),
    ?assertMatch({#{ending := done, violations := []}, _Report}, starl_run:finish(Run)).

%% A scenario that cannot be run is a line.
a_mistake_is_a_line_test() ->
    {error, Why} = starl_run:start(starl_sim, #{app => starl_sim_script_app, robots => none}, #{}),
    ?assertNotEqual(nomatch, string:find(lists:flatten(Why), "robots")).
