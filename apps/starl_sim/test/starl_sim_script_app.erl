%% An application for tests: the option `script' is a function that is run once per robot and
%% whose value is the robot's result; `scene' is merged into the scene.
-module(starl_sim_script_app).
-behaviour(starl_app).
-behaviour(starl_scene).

-export([options/0, scene/1, init/2, step/2]).

options() ->
    [
        {script, {term, "a function of the robot", fun(F) -> is_function(F, 1) end}, fun starl:id/1,
            ""},
        {around, {term, "a map", fun is_map/1}, #{}, "merged into the scene"}
    ].

scene(#{options := #{script := Script, around := Around}}) ->
    Monitors = [{starl_sim_order_monitor, #{}} | maps:get(monitors, Around, [])],
    {ok, maps:merge(#{app => {sequential, ?MODULE, Script}}, Around#{monitors => Monitors})}.

init(_Robot, Script) -> Script.

step(Robot, Script) -> {done, Script(Robot)}.
