%% A monitor for tests that keeps, as its configuration, all that it is told of a run.
-module(starl_sim_told_monitor).
-behaviour(starl_monitor).

-export([init/1, context/2, step/2, finish/2, interests/0]).

init(Config) -> Config.

context(#{slack_us := Slack} = Known, #{bound_us := Bound} = Config) ->
    maps:merge(maps:remove(slack_us, Known), Config#{bound_us := Bound + Slack});
context(Known, Config) ->
    maps:merge(maps:remove(slack_us, Known), Config).

interests() -> [].

step(_Event, Config) -> {ok, Config}.

finish(_EndUs, Config) -> {ok, Config}.
