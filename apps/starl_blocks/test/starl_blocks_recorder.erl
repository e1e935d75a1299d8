%% A monitor that accepts everything and keeps the building blocks' events.
-module(starl_blocks_recorder).
-behaviour(starl_monitor).

-export([init/1, step/2, finish/2, interests/0]).

interests() -> [geocast, election, registers, robot, app].

init(_) -> [].

step(Event, Trace) -> {ok, [Event | Trace]}.

finish(_, Trace) -> {ok, #{trace => lists:reverse(Trace)}}.
