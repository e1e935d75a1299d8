%% @doc Measures how long wheels turn after something has been killed: from just before the kill to
%% the stop bytes at the robot's end of the line, both by the monotonic clock. The robot is a pty.
-module(starl_create_stop_times).

-export([rows/0, measure/1, drive/1]).

-export_type([row/0]).

-type row() :: vm | vm_halted | owner | line | program | terminated | guardian | put_back.

-define(STOP, <<145, 0, 0, 0, 0>>).
-define(GO, <<145, 0, 100, 0, 100>>).
-define(LONG_US, 600000000).
-define(LATE_MS, 20000).

%% @doc What is killed.
-spec rows() -> [{row(), string()}].
rows() ->
    [
        {vm, "kill -9 of the VM"},
        {owner, "the link (the owner of the line) killed"},
        {line, "the process of the line killed"},
        {program, "kill -9 of the port program"},
        {terminated, "kill (TERM) of the port program"},
        {guardian, "kill -9 of the guardian"},
        {vm_halted, "VM halted (kill -STOP; heartbeat 250 ms)"},
        {put_back, "cable put back (until then it drives)"}
    ].

%% @doc One measurement, in microseconds.
-spec measure(row()) -> {ok, non_neg_integer()} | {error, unicode:chardata()}.
measure(Row) ->
    Link = filename:join(
        temporary(),
        "starl-" ++ os:getpid() ++ "-" ++ integer_to_list(erlang:unique_integer([positive]))
    ),
    case starl_create_pty:start_link(self(), Link) of
        {ok, Pty} ->
            Us = measured(Row, Pty, Link),
            ok = starl_create_pty:stop(Pty),
            {ok, Us};
        {error, no_program} ->
            {error, starl_create_program:format_error(no_program)};
        {error, {link, Text}} ->
            {error, Text}
    end.

temporary() -> os:getenv("TMPDIR", "/tmp").

measured(put_back, Pty, Link) ->
    _ = driver(Link, Pty),
    ok = starl_create_pty:pull(Pty),
    receive
        {told, {closed, _}} -> ok
    after ?LATE_MS -> error(late)
    end,
    timed(Pty, fun() -> starl_create_pty:put_back(Pty) end);
measured(Row, Pty, Link) when Row =:= vm; Row =:= vm_halted ->
    Paths = lists:append([
        ["-pa", Dir]
     || Dir <- code:get_path(), string:find(Dir, "starl") =/= nomatch
    ]),
    {ok, Peer, _} = peer:start(#{connection => standard_io, args => Paths}),
    ok = peer:call(Peer, ?MODULE, drive, [Link]),
    driving(Pty),
    Pid = peer:call(Peer, os, getpid, []),
    Us = timed(Pty, fun() -> kill(signal(Row), Pid) end),
    _ = [kill("KILL", Pid) || Row =:= vm_halted],
    Us;
measured(Row, Pty, Link) ->
    {Owner, Line} = driver(Link, Pty),
    Deed = deed(Row, Owner, Line),
    timed(Pty, Deed).

signal(vm) -> "KILL";
signal(vm_halted) -> "STOP".

deed(owner, Owner, _Line) -> fun() -> exit(Owner, kill) end;
deed(line, _Owner, Line) -> fun() -> exit(Line, kill) end;
deed(program, _Owner, Line) -> killer("KILL", program(Line));
deed(terminated, _Owner, Line) -> killer("TERM", program(Line));
deed(guardian, _Owner, Line) -> killer("KILL", guardian(program(Line))).

killer(Signal, Pid) -> fun() -> kill(Signal, Pid) end.

kill(Signal, Pid) -> os:cmd("kill -" ++ Signal ++ " " ++ Pid).

program(Line) ->
    {links, Links} = process_info(Line, links),
    [Port] = [Link || Link <- Links, is_port(Link)],
    {os_pid, Pid} = erlang:port_info(Port, os_pid),
    integer_to_list(Pid).

guardian(Program) ->
    {ok, Children} = file:read_file("/proc/" ++ Program ++ "/task/" ++ Program ++ "/children"),
    Pids = string:lexemes(binary_to_list(Children), " \n"),
    [Guardian] = [Pid || Pid <- Pids, is_named("starl_guardian", Pid)],
    Guardian.

is_named(Name, Pid) ->
    file:read_file("/proc/" ++ Pid ++ "/comm") =:= {ok, list_to_binary(Name ++ "\n")}.

%% An owner of a line, on which a robot drives.
driver(Link, Pty) ->
    Self = self(),
    Owner = spawn(fun() -> owner(Link, Self) end),
    receive
        {line, Owner, Line} ->
            driving(Pty),
            {Owner, Line}
    after ?LATE_MS -> error(late)
    end.

%% @private In a VM that will be killed.
-spec drive(Link :: string()) -> ok.
drive(Link) ->
    Self = self(),
    _ = spawn(fun() -> owner(Link, Self) end),
    receive
        {line, _, _} -> ok
    end.

owner(Link, Parent) ->
    {ok, Line} = starl_create_port:start_link(self(), #{}),
    Line ! {stop_bytes, ?STOP},
    Line ! {open, Link, 57600},
    Line ! {drive_script, 1, [{?GO, ?LONG_US}], ?STOP},
    receive
        {sent, 1, _} -> Parent ! {line, self(), Line}
    end,
    tell(Parent).

tell(Parent) ->
    receive
        Event ->
            Parent ! {told, Event},
            tell(Parent)
    end.

driving(Pty) ->
    {_, _} = heard(Pty, ?GO, <<>>),
    ok.

timed(Pty, Deed) ->
    Begin = erlang:monotonic_time(microsecond),
    _ = Deed(),
    {_, At} = heard(Pty, ?STOP, <<>>),
    max(0, At - Begin).

heard(Pty, Wanted, Bytes) ->
    receive
        {pty, Pty, {data, More, At}} ->
            case <<Bytes/binary, More/binary>> of
                Wanted -> {Wanted, At};
                Part when byte_size(Part) < byte_size(Wanted) -> heard(Pty, Wanted, Part)
            end
    after ?LATE_MS -> error({late, Wanted, Bytes})
    end.
