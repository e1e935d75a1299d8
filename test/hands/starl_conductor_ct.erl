%% A VM for clusters: a cluster makes its VM a distributed node, which the one of the tests is to remain.
-module(starl_conductor_ct).

-export([start/0, stop/1, call/4]).
%% called in the conductor
-export([kept/3]).

-define(CALL_MS, 600000).

%% Held by its standard input, until it is stopped.
start() ->
    Own = [Dir || Dir <- code:get_path(), not lists:prefix(code:lib_dir(), Dir)],
    Paths = lists:append([["-pa", filename:absname(D)] || D <- Own, filelib:is_dir(D)]),
    Quiet = ["-nocookie", "-kernel", "logger_level", "none"],
    Whole = ["-kernel", "prevent_overlapping_partitions", "false"],
    {ok, Conductor, _} = peer:start(#{
        connection => standard_io,
        shutdown => close,
        wait_boot => 60000,
        args => Quiet ++ Whole ++ Paths
    }),
    %% held by the calling process otherwise, which ends
    true = unlink(Conductor),
    Conductor.

stop(Conductor) -> peer:stop(Conductor).

%% Calls a function there, in a process of its own that traps exits.
call(Conductor, Module, Function, Args) ->
    peer:call(Conductor, ?MODULE, kept, [Module, Function, Args], ?CALL_MS).

kept(Module, Function, Args) ->
    Caller = self(),
    {Pid, Ref} = spawn_monitor(fun() ->
        _ = process_flag(trap_exit, true),
        Caller ! {answer, self(), apply(Module, Function, Args)}
    end),
    receive
        {answer, Pid, Answer} -> Answer;
        {'DOWN', Ref, _, _, Reason} -> exit(Reason)
    end.
