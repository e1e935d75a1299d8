-module(starl_lab_crasher_monitor).
-behaviour(starl_monitor).

-export([init/1, step/2, finish/2, interests/0]).

init(_) -> none.

interests() -> [app].

step({T, Robot, app, slept}, none) ->
    {violation, #{contract => sleep, what => slept, at_us => T, robots => [Robot], details => #{}},
        none};
step(_, none) ->
    {ok, none}.

finish(_, none) -> {ok, #{}}.
