%% @doc Ends a process from outside, as a supervisor ends its children.
-module(starl_sim_stop).

-export([shutdown/2]).

%% @doc Tells a process to shut down and waits for its end. A process that is still there after
%% `Ms' milliseconds is killed, and not waited for. It may be gone already. A caller that is
%% linked to it unlinks or traps exits.
-spec shutdown(pid(), Ms :: timeout()) -> ok.
shutdown(Pid, Ms) ->
    Ref = erlang:monitor(process, Pid),
    true = exit(Pid, shutdown),
    receive
        {'DOWN', Ref, process, Pid, _} -> ok
    after Ms ->
        true = erlang:demonitor(Ref, [flush]),
        true = exit(Pid, kill),
        ok
    end.
