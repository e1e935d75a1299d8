%% Processes of the operating system that stand still for a time.
-module(starl_cluster_halts_tests).
-include_lib("eunit/include/eunit.hrl").

-export([busy/0]).

-define(H, starl_cluster_halts).

%% It stands; then it goes on, which is told, with those who wait for it.
stands_test() -> with_process(fun stands/1).

stands(OsPid) ->
    Halts = ?H:halt(3, {OsPid, 50}, now, ?H:new()),
    ?assert(?H:is_halted(3, Halts)),
    ?assertNot(?H:is_halted(4, Halts)),
    Waiting = ?H:wait(3, {self(), caller}, Halts),
    {{halted, 3, idle}, Standing} = heard(Waiting),
    {{resumed, 3, idle, [{Caller, caller}]}, Moving} = heard(Standing),
    ?assertEqual(self(), Caller),
    ?assertNotEqual("T", state(OsPid)),
    ?assertEqual(?H:new(), Moving).

%% It goes on at once when that is wanted, and its guard does not come later.
undone_test() -> with_process(fun undone/1).

undone(OsPid) ->
    {{halted, 3, idle}, Standing} = heard(?H:halt(3, {OsPid, 30000}, now, ?H:new())),
    ?assertEqual("T", state(OsPid)),
    {[{resumed, 3, idle, []}], Moving} = ?H:undo(3, Standing),
    ?assertNotEqual("T", state(OsPid)),
    ?assertEqual({[], ?H:new()}, ?H:undo_all(Moving)).

%% A process that has ended is not halted; that is told likewise.
ended_test() ->
    with_process(fun(OsPid) ->
        _ = os:cmd("kill -KILL " ++ OsPid ++ "; tail --pid=" ++ OsPid ++ " -f /dev/null"),
        ?assertMatch({{resumed, 3, idle, []}, _}, heard(?H:halt(3, {OsPid, 30000}, now, ?H:new())))
    end).

%% A node is found at work, where the kernel shows what its threads are in.
at_work_test_() ->
    {timeout, 60, fun at_work/0}.

at_work() ->
    Own = filename:dirname(code:which(?MODULE)),
    {ok, Peer, _} = peer:start(#{
        connection => standard_io, args => ["-nocookie", "-pa", filename:absname(Own)]
    }),
    OsPid = peer:call(Peer, os, getpid, []),
    _ = peer:call(Peer, erlang, spawn, [?MODULE, busy, []]),
    {{halted, 1, at_work}, Standing} = heard(?H:halt(1, {OsPid, 30000}, at_work, ?H:new())),
    ?assertEqual("T", state(OsPid)),
    _ = ?H:undo_all(Standing),
    peer:stop(Peer).

busy() -> busy().

heard(Halts) ->
    receive
        {Port, _} = Message when is_port(Port) ->
            case ?H:hear(Message, Halts) of
                unknown -> heard(Halts);
                Told -> Told
            end
    end.

state(OsPid) ->
    {ok, Stat} = file:read_file("/proc/" ++ OsPid ++ "/stat"),
    [_, After] = string:split(Stat, ") ", trailing),
    unicode:characters_to_list(binary:part(After, 0, 1)).

with_process(Do) ->
    Port = open_port({spawn_executable, "/bin/sh"}, [{args, ["-c", "exec sleep 1000"]}]),
    {os_pid, Pid} = erlang:port_info(Port, os_pid),
    OsPid = integer_to_list(Pid),
    try
        Do(OsPid)
    after
        os:cmd("kill -KILL " ++ OsPid)
    end.
