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
    ?assertEqual({false, []}, {is_process_alive(Pid), inbox()}).

gone_before_test() ->
    {Pid, Ref} = spawn_monitor(fun() -> ok end),
    receive
        {'DOWN', Ref, process, Pid, normal} -> ok
    end,
    ok = starl_sim_stop:shutdown(Pid, infinity),
    ?assertEqual([], inbox()).

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
    ?assertEqual([], inbox()).

inbox() ->
    {messages, Messages} = process_info(self(), messages),
    [Down || {'DOWN', _, _, _, _} = Down <- Messages].
