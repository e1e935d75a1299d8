%% A monitor that notes which events of each machine there were, and those that are not of the type
%% of the machine's events.
-module(starl_event_recorder).
-behaviour(starl_monitor).

-export([init/1, step/2, finish/2]).

%% `types': the types of the events of each machine.
init(#{types := Types}) -> {Types, #{}, []}.

step({_T, _Robot, Machine, Event}, {Types, Seen, Wrong}) ->
    Noted = Seen#{{Machine, name(Event)} => true},
    case lists:any(fun({M, T}) -> starl_event_type:is(Event, M, T) end, maps:get(Machine, Types)) of
        true -> {ok, {Types, Noted, Wrong}};
        false -> {ok, {Types, Noted, [{Machine, Event} | Wrong]}}
    end.

finish(_End, {_Types, Seen, Wrong}) ->
    {ok, #{seen => lists:sort(maps:keys(Seen)), wrong => lists:reverse(Wrong)}}.

name(Event) when is_tuple(Event) -> {element(1, Event), tuple_size(Event) - 1};
name(Event) -> {Event, 0}.
