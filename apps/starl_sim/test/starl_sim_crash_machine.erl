%% A machine for tests: `boom', `match' and `throw' crash it, `{count, K}' is traced; a call is
%% answered by its incarnation.
-module(starl_sim_crash_machine).
-behaviour(starl_machine).

-export([init/1, handle_event/5]).

init(#{incarnation := Incarnation}) -> {ready, Incarnation, []}.

handle_event(cast, boom, ready, _, _) ->
    exit(boom);
handle_event(cast, match, ready, N, _) ->
    self_made = own_pid(N),
    keep_state_and_data;
handle_event(cast, throw, ready, _, _) ->
    throw(ball);
handle_event(cast, {count, K}, ready, _, _) ->
    {keep_state_and_data, [{trace, {counted, K}}]};
handle_event({call, From}, incarnation, ready, N, _) ->
    {keep_state_and_data, [{reply, From, N}]};
handle_event({call, _}, ignore, ready, _, _) ->
    keep_state_and_data;
handle_event(info, {restarted, Name}, ready, _, _) ->
    {keep_state_and_data, [{trace, {told, Name}}]};
handle_event(_, _, _, _, _) ->
    unknown_event.

own_pid(N) when N > 0 -> self().
