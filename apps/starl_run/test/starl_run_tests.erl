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

%% Whatever makes a run is of one version: they know each other's messages. The live ones, too.
unlike_versions_are_told_test_() ->
    [fun() -> unlike_version_is_told(App) end || App <- [starl_live, starl_world]].

unlike_version_is_told(App) ->
    _ = application:unload(App),
    ok = application:load({application, App, [{vsn, "0.0.9"}]}),
    Planned = starl_run:plan(starl_sim_script_app, #{}),
    ok = application:unload(App),
    ?assertMatch({error, {versions, _}}, Planned),
    {error, {versions, Versions}} = Planned,
    ?assertEqual("0.0.9", proplists:get_value(App, Versions)).

a_scenario_without_an_application_is_told_test() ->
    {error, Why} = starl_run:plan(#{robots => 3}, #{}),
    ?assertEqual(
        "which application? A scenario names it: #{app => painting, robots => 3}",
        lists:flatten(starl_run:format_error(Why))
    ).

%% Nobody has measured it: people put robots down on the floor that they have.
a_floor_of_the_usual_size_has_no_walls_test() ->
    HasWalls = fun(World) ->
        Given = #{app => starl_sim_script_app, world => World},
        {ok, Planned} = starl_run:plan(Given, #{}),
        is_map_key(walls, starl_run_floor:placing(Planned))
    end,
    ?assertNot(HasWalls({12000, 12000})),
    ?assertNot(HasWalls({12.0e3, 12.0e3})),
    ?assert(HasWalls({12000, 11999})).
