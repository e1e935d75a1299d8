%% An application for tests: the option `script' is a function that is run once per robot and
%% whose value is the robot's result; `around' is merged into the scene.
-module(starl_blocks_script_app).
-behaviour(starl_app).
-behaviour(starl_scene).

-export([options/0, scene/1, init/2, step/2]).
-export([play/3, trace/1]).

options() ->
    [
        {script, {term, "a function of the robot", fun(F) -> is_function(F, 1) end}, fun starl:id/1,
            ""},
        {around, {term, "a map", fun is_map/1}, #{}, "merged into the scene"}
    ].

scene(#{options := #{script := Script, around := Around}}) ->
    Monitors = [{starl_blocks_recorder, #{}} | maps:get(monitors, Around, [])],
    {ok, maps:merge(#{app => {sequential, ?MODULE, Script}}, Around#{monitors => Monitors})}.

init(_Robot, Script) -> Script.

step(Robot, Script) -> {done, Script(Robot)}.

%% Plays a scenario to its end, at most half a minute of wall time; crashes that are planned make
%% no reports.
play(Script, Around, Scenario) ->
    Given = Scenario#{app => ?MODULE, script => Script, around => Around},
    starl_platform_ct:quietly(fun() ->
        starl_platform_ct:within(30000, fun() ->
            {ok, Sim} = starl_sim:start(Given),
            _ = starl_sim:run(Sim),
            {Outcome, _} = starl_sim:finish(Sim),
            Outcome
        end)
    end).

%% The events of a run, in order.
trace(#{monitors := #{starl_blocks_recorder := #{trace := Trace}}}) -> Trace.
