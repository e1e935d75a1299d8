%% An application for tests whose steps never block, in its first life.
-module(starl_sim_restless).
-behaviour(starl_app).

-export([init/2, step/2]).

init(_Robot, none) -> 0.

step(Robot, 0) ->
    ok = starl:sleep(Robot, 1000),
    {continue, 1};
step(Robot, 1) ->
    case starl:now(Robot) < 1500 of
        true -> {continue, 1};
        false -> {done, recovered}
    end.
