%% An application whose contract is broken after two seconds, by robot 1.
-module(starl_lab_crasher).
-behaviour(starl_app).

-export([blocks/0, monitors/1, init/2, step/2]).

blocks() -> [].

monitors(_Context) -> [{starl_lab_crasher_monitor, #{}}].

init(Robot, _) -> starl:id(Robot).

step(Robot, Id) ->
    starl:sleep(Robot, 2000 * Id),
    starl:trace(Robot, slept),
    {continue, Id}.
