%% @doc Halts nodes of a cluster for a time: stops their operating system processes (SIGSTOP) and
%% continues them later (SIGCONT).
%%
%% A guard, a shell of its own for each halt, sends both signals. It waits out the time even if this
%% VM is killed meanwhile, and no signal of a terminal reaches it. So no node stays halted. The
%% guard reports when the node has stopped, and ends when the node goes on.
%% ```
%%     halt -- "at_work" | "idle" --> stands -- the guard exits --> goes on
%% '''
-module(starl_cluster_halts).

-export([new/0, halt/4, wait/3, is_halted/2, hear/2, undo/2, undo_all/1]).

-export_type([t/0, moment/0, found/0, report/0]).

%% At once; or while one of the node's schedulers runs, in the middle of what it does, if it does
%% something within a second.
-type moment() :: now | at_work.

%% Where a halt found a node.
-type found() :: at_work | idle.

%% A node stands still; or it goes on, and these callers wait for that.
-type report() ::
    {halted, starl:robot_id(), found()}
    | {resumed, starl:robot_id(), found(), [gen_server:from()]}.

-record(halt, {
    robot :: starl:robot_id(),
    os_pid :: string(),
    found = idle :: found(),
    callers = [] :: [gen_server:from()]
}).

-opaque t() :: #{port() => #halt{}}.

%% A node is at work when the thread of a scheduler is in its own code, not in a system call. This is
%% certain only while the node stands. So the guard halts a node whose scheduler seems to run, and
%% looks. If it was too late, it lets the node go on and tries again. It starts no program meanwhile:
%% every command is the shell's own. Where the kernel does not show system calls, the first look
%% counts.
-define(GUARD,
    "trap '' HUP INT TERM PIPE\n"
    "some() {\n"
    "    for s in $schedulers; do\n"
    "        read -r line <\"$s/$1\" || return \"$3\"\n"
    "        case ${line##*) } in $2*) return 0 ;; esac\n"
    "    done\n"
    "    return 1\n"
    "}\n"
    "stopped() {\n"
    "    kill -STOP \"$1\" || exit 1\n"
    "    while some stat '[RSD]' 1; do :; done\n"
    "}\n"
    "exec 2>/dev/null\n"
    "schedulers=/proc/\"$1\"\n"
    "for t in /proc/\"$1\"/task/*; do\n"
    "    read -r name <\"$t/comm\" || name=\n"
    "    case $name in erts_sched_* | [0-9]*_scheduler) schedulers=\"$schedulers $t\" ;; esac\n"
    "done\n"
    "looks=$3\n"
    "how=idle\n"
    "while [ \"$looks\" -gt 0 ]; do\n"
    "    if some stat R 1; then\n"
    "        stopped \"$1\"\n"
    "        if some syscall -1 0; then how=at_work; break; fi\n"
    "        kill -CONT \"$1\"\n"
    "    fi\n"
    "    looks=$((looks - 1))\n"
    "done\n"
    "[ $how = at_work ] || stopped \"$1\"\n"
    "echo $how\n"
    "sleep \"$2\"\n"
    "kill -CONT \"$1\"\n"
).
%% A look takes a millisecond, on a computer with other work several.
-define(LOOKS, 1000).

%% @doc No node is halted.
-spec new() -> t().
new() -> #{}.

%% @doc Halts the node of a robot, with this process number, for a time.
-spec halt(starl:robot_id(), {OsPid :: string(), Ms :: pos_integer()}, moment(), t()) -> t().
halt(Robot, {OsPid, Ms}, Moment, Halts) ->
    Seconds = io_lib:format("~.3f", [Ms / 1000]),
    Port = open_port({spawn_executable, "/bin/sh"}, [
        {args, ["-c", ?GUARD, "sh", OsPid, lists:flatten(Seconds), looks(Moment)]},
        {line, 100},
        exit_status
    ]),
    Halts#{Port => #halt{robot = Robot, os_pid = OsPid}}.

looks(now) -> "0";
looks(at_work) -> integer_to_list(?LOOKS).

%% @doc Is the node of this robot halted?
-spec is_halted(starl:robot_id(), t()) -> boolean().
is_halted(Robot, Halts) -> guards(Robot, Halts) =/= [].

guards(Robot, Halts) ->
    [Guard || {_, #halt{robot = R}} = Guard <- maps:to_list(Halts), R =:= Robot].

%% @doc A caller waits until the node of a robot, which is halted, goes on.
-spec wait(starl:robot_id(), gen_server:from(), t()) -> t().
wait(Robot, From, Halts) ->
    [{Port, #halt{callers = Callers} = Halt}] = guards(Robot, Halts),
    Halts#{Port := Halt#halt{callers = [From | Callers]}}.

%% @doc Interprets a message, if it is a guard's.
-spec hear(term(), t()) -> {report(), t()} | unknown.
hear({Port, {data, {eol, Word}}}, Halts) when is_map_key(Port, Halts) ->
    #{Port := #halt{robot = Robot} = Halt} = Halts,
    Found = found(Word),
    {{halted, Robot, Found}, Halts#{Port := Halt#halt{found = Found}}};
hear({Port, {exit_status, _}}, Halts) when is_map_key(Port, Halts) ->
    {Halt, Left} = maps:take(Port, Halts),
    {resumed(Halt), Left};
hear(_Message, _Halts) ->
    unknown.

found("at_work") -> at_work;
found("idle") -> idle.

resumed(#halt{robot = Robot, found = Found, callers = Callers}) ->
    {resumed, Robot, Found, Callers}.

%% @doc Lets the node of a robot go on now, if it is halted.
-spec undo(starl:robot_id(), t()) -> {[report()], t()}.
undo(Robot, Halts) ->
    Own = guards(Robot, Halts),
    ok = lists:foreach(fun go_on/1, Own),
    {[resumed(Halt) || {_, Halt} <- Own], maps:without([Port || {Port, _} <- Own], Halts)}.

%% @doc Lets all nodes go on now.
-spec undo_all(t()) -> {[report()], t()}.
undo_all(Halts) ->
    ok = lists:foreach(fun go_on/1, maps:to_list(Halts)),
    {[resumed(Halt) || Halt <- maps:values(Halts)], new()}.

%% The guard first: it would end a later halt too early.
go_on({Port, #halt{os_pid = OsPid}}) ->
    Guard = erlang:port_info(Port, os_pid),
    _ = [os:cmd("kill -KILL " ++ integer_to_list(Pid)) || {os_pid, Pid} <- [Guard]],
    _ = os:cmd("kill -CONT " ++ OsPid),
    try
        true = port_close(Port),
        ok
    catch
        %% it has just ended
        error:badarg -> ok
    end.
