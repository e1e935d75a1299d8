%% Ending a process from outside: it is gone in the end, whether it obeys, does not, or was gone
%% before, and nothing of it is left in the inbox.
-module(starl_sim_stop_tests).
-include_lib("eunit/include/eunit.hrl").

obeys_test() ->
    Pid = spawn(fun() ->
        receive
            never -> ok
        end
    end),
    ok = starl_sim_stop:shutdown(Pid, infinity),
    ?assertEqual({false, []}, {is_process_alive(Pid), inbox(Pid)}).

gone_before_test() ->
    {Pid, Ref} = spawn_monitor(fun() -> ok end),
    receive
        {'DOWN', Ref, process, Pid, normal} -> ok
    end,
    ok = starl_sim_stop:shutdown(Pid, infinity),
    ?assertEqual([], inbox(Pid)).

%% It is told to shut down before it is killed.
does_not_obey_test() ->
    Self = self(),
    {Pid, Ref} = spawn_monitor(fun() ->
        _ = process_flag(trap_exit, true),
        Self ! ready,
        receive
            {'EXIT', Self, shutdown} -> Self ! told
        end,
        receive
            never -> ok
        end
    end),
    receive
        ready -> ok
    end,
    ok = starl_sim_stop:shutdown(Pid, 10),
    receive
        told -> ok
    end,
    receive
        {'DOWN', Ref, process, Pid, Reason} -> ?assertEqual(killed, Reason)
    end,
    ?assertEqual([], inbox(Pid)).

%% What came from other processes is another test's.
inbox(Pid) ->
    {messages, Messages} = process_info(self(), messages),
    [Down || {'DOWN', _, _, From, _} = Down <- Messages, From =:= Pid].
