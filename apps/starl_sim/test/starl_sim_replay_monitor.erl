%% A contract that is broken on purpose: no application may trace more than 40 times.
-module(starl_sim_replay_monitor).
-behaviour(starl_monitor).

-export([init/1, step/2, finish/2]).

init(#{}) -> none.

step({At, Robot, app, 40}, none) ->
    Violation = #{
        contract => planted, what => forty, at_us => At, robots => [Robot], details => #{}
    },
    {violation, Violation, none};
step(_, none) ->
    {ok, none}.

finish(_, none) -> {ok, #{}}.
