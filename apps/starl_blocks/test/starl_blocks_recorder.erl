%% A monitor that accepts everything and keeps the building blocks' events.
-module(starl_blocks_recorder).
-behaviour(starl_monitor).

-export([init/1, step/2, finish/2, interests/0]).

%% A run with one of the blocks has no machine of another.
interests() -> all.

init(_) -> [].

step({_, _, Machine, _} = Event, Trace) ->
    case lists:member(Machine, [geocast, election, registers, barrier, mutex, robot, app]) of
        true -> {ok, [Event | Trace]};
        false -> {ok, Trace}
    end.

finish(_, Trace) -> {ok, #{trace => lists:reverse(Trace)}}.
