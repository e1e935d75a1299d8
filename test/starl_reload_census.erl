%% An application for the tests of reloads: it counts its steps, and has the machine of {@link
%% starl_reload_tally} count, too. Its state is like that machine's data.
-module(starl_reload_census).
-behaviour(starl_app).

-export([blocks/0, options/0, monitors/1, init/2, step/2]).

blocks() -> [starl_reload_tally].

options() -> [].

monitors(#{robots := Robots}) -> [{starl_reload_schedule, #{robots => Robots}}].

init(Robot, _Options) ->
    ok = starl:trace(Robot, begins),
    {[first], 0}.

step(Robot, {[first], N}) ->
    case starl_reload_tally:count(Robot, N) of
        {done, _} = Done -> Done;
        Next -> {continue, {[first], Next}}
    end.
