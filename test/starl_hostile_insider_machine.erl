%% A machine with two kinds of messages, which crashes at a large number in a name's company.
-module(starl_hostile_insider_machine).
-behaviour(starl_machine).

-export([init/1, handle_event/5, accepts/2]).

init(_Config) -> {ready, none, [starl_sap:listen(a, victim), starl_sap:listen(b, victim)]}.

handle_event(cast, {message, _From, a, {tagged, _Name, N}}, ready, none, _Meta) when N > 1 bsl 50 ->
    error(too_large);
handle_event(_, _, _, _, _) ->
    keep_state_and_data.

accepts(a, {tagged, _, N}) -> starl_shape:is(count, N);
accepts(b, Body) -> starl_shape:is({list, natural}, Body);
accepts(_, _) -> false.
