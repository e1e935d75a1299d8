%% The port program stops the robot's wheels, whatever ends or halts: what the other end of a pty gets to hear
%% when something is killed, closed or pulled.
-module(starl_create_port_stop_SUITE).
-include_lib("stdlib/include/assert.hrl").
-include("starl_create_port_ct.hrl").
-compile([export_all, nowarn_export_all]).

-import(starl_create_port_ct, [
    wrapped/2,
    pty/0,
    line/0,
    line/2,
    going/0,
    go/1,
    in_pulse/0,
    stops_when/2,
    drives/2,
    vm/2,
    go_again/1,
    heard/2,
    until/3,
    contains/2,
    os_pid/1,
    guardian/1,
    child/2,
    kill/2,
    gone/1
]).

all() -> starl_create_port_ct:all().

groups() -> [{plain, cases()}, {ordinary, cases() ++ [unguarded]}, {sanitized, cases()}].

cases() ->
    [owner_killed, line_killed, program_killed, guardian_killed, reader_killed] ++
        [program_halted, guardian_halted, half_sent, killed_in_mid_pulse] ++
        [closed_in_mid_pulse, ended_while_out, free_after_a_kill, program_terminated] ++
        [vm_killed, vm_asleep, closed_by_request, half_command, brief_visit] ++
        [cable_pulled, unplugged_for_good].

init_per_group(Group, Config) -> starl_create_port_ct:init_per_group(Group, Config).

end_per_group(Group, Config) -> starl_create_port_ct:end_per_group(Group, Config).

init_per_testcase(_, Config) -> Config.

end_per_testcase(_, Config) -> starl_create_port_ct:end_per_testcase(Config).

%% -- tests ------------------------------------------------------------------------------------------

owner_killed(_) ->
    Self = self(),
    #{pty := Pty} = Line = pty(),
    Owner = spawn(fun() -> drives(Line, Self) end),
    receive
        {drives, Owner, _} -> ok
    after ?AFTER_MS -> error(late)
    end,
    ?assertEqual(?GO, heard(Pty, 5)),
    stops_when(Pty, fun() -> exit(Owner, kill) end).

line_killed(_) ->
    #{port := Port, pty := Pty} = going(),
    true = unlink(Port),
    stops_when(Pty, fun() -> exit(Port, kill) end).

program_killed(_) ->
    #{port := Port, pty := Pty} = going(),
    Pid = os_pid(Port),
    stops_when(Pty, fun() -> kill("KILL", Pid) end),
    receive
        {closed, {program, _}} -> ok
    after ?AFTER_MS -> error(late)
    end.

%% The wheels are stopped, the owner is told, and another guardian watches.
guardian_killed(_) ->
    #{port := Port, pty := Pty} = going(),
    Program = os_pid(Port),
    First = guardian(Program),
    stops_when(Pty, fun() -> kill("KILL", First) end),
    ok = stopped(guardian),
    another_watches(Program, Port, Pty).

stopped(Why) ->
    receive
        {stopped, Why, _} -> ok
    after ?AFTER_MS -> error(late)
    end.

another_watches(Program, Port, Pty) ->
    Port ! {send, ?GO},
    _ = heard(Pty, 5),
    stops_when(Pty, fun() -> kill("KILL", Program) end).

%% The guardian stops the wheels. What was sent to the halted program is not driven later.
%% Holds: What was sent to a port program while it was halted is not driven, though the halt falls
%% between its poll and its looks
%% Red: c27ddcd2, one run of a whole gate; not seen again in 48 runs with a delay there
program_halted(_) ->
    #{port := Port, pty := Pty} = going(),
    Program = os_pid(Port),
    stops_when(Pty, fun() -> kill("STOP", Program) end),
    Port ! {drive_script, 2, [{?GO, ?LONG_US}], ?STOP},
    %% the port has passed it on
    {messages, _} = process_info(Port, messages),
    _ = sys_free(Port),
    kill("CONT", Program),
    ok = stopped(halted),
    Port ! {send, <<9>>},
    ?assertEqual(<<?STOPS/binary, 9>>, heard(Pty, ?STOPS_SIZE + 1)),
    go(Port),
    ?assertEqual(?GO, heard(Pty, 5)).

%% Waits until the process has handled its messages.
sys_free(Port) ->
    case process_info(Port, message_queue_len) of
        {message_queue_len, 0} -> ok;
        _ -> sys_free(Port)
    end.

%% Another one takes its place.
guardian_halted(_) ->
    #{port := Port, pty := Pty} = going(),
    Program = os_pid(Port),
    First = guardian(Program),
    stops_when(Pty, fun() -> kill("STOP", First) end),
    ok = stopped(guardian),
    gone(First),
    another_watches(Program, Port, Pty).

%% The rest of a command that had begun is not taken from what stops the wheels: a robot of either
%% generation stands at the end.
half_sent(_) ->
    [
        begin
            #{port := Port, pty := Pty} = line(),
            Drive = starl_create_command:encode_all([start, safe, {drive_direct, 100, 100}], Model),
            Song = starl_create_command:encode({song, 0, lists:duplicate(16, {60, 8})}, Model),
            Sent = <<Drive/binary, (binary:part(Song, 0, Size))/binary>>,
            Port ! {send, Sent},
            Driven = heard(Pty, byte_size(Sent)),
            Pid = os_pid(Port),
            kill("KILL", Pid),
            Stop = heard(Pty, ?STOPS_SIZE),
            {_, Robot} = starl_create_emulator:hear(
                0, <<Driven/binary, Stop/binary>>, starl_create_emulator:new(#{model => Model})
            ),
            ?assertEqual({Model, Size, {0, 0}}, {Model, Size, told(Robot)})
        end
     || Model <- [1, 2], Size <- [1, 2, 3, 4, 20, 33]
    ].

told(Robot) ->
    {Left, Right} = starl_create_emulator:wheels(Robot),
    {round(Left), round(Right)}.

%% The line that a pulse asserts is released, whoever ends.
killed_in_mid_pulse(_) -> mid_pulse(fun(Port) -> kill("KILL", os_pid(Port)) end).

closed_in_mid_pulse(_) -> mid_pulse(fun(Port) -> Port ! close end).

mid_pulse(End) ->
    #{pty := Pty, port := Port} = in_pulse(),
    _ = End(Port),
    %% that of the program, or, as a busy computer sees it, that of the line that is given back
    receive
        {pty, Pty, {baud, Baud}} -> ?assert(lists:member(Baud, [57600, 38400]), Baud)
    after ?AFTER_MS -> error(late)
    end,
    ?assertEqual(?STOPS, heard(Pty, ?STOPS_SIZE)).

%% Nobody is left but the program: it stops the robot whose cable is put back, and ends. Meanwhile it holds no
%% stream of Erlang's open, for which the reader of a command's output would wait.
%% Holds: A port program that waits for a pulled cable after Erlang's end holds no stream of
%% Erlang's open
%% Red: 76a93e6a: it waits for ever, and whoever reads its output with it
ended_while_out(_) ->
    Self = self(),
    #{pty := Pty} = Line = pty(),
    Owner = spawn(fun() -> drives(Line, Self) end),
    Program =
        receive
            {drives, Owner, Port} -> os_pid(Port)
        after ?AFTER_MS -> error(late)
        end,
    ?assertEqual(?GO, heard(Pty, 5)),
    ok = starl_create_pty:pull(Pty),
    receive
        {said, {closed, unplugged}} -> ok
    after ?AFTER_MS -> error(late)
    end,
    exit(Owner, kill),
    lets_go(Program),
    stops_when(Pty, fun() -> starl_create_pty:put_back(Pty) end),
    gone(Program).

%% Its streams lead nowhere in a moment.
lets_go(Pid) ->
    Links = [file:read_link("/proc/" ++ Pid ++ "/fd/" ++ Fd) || Fd <- ["0", "1", "2"]],
    case lists:usort(Links) of
        [{ok, "/dev/null"}] ->
            ok;
        _ ->
            erlang:yield(),
            lets_go(Pid)
    end.

%% The next program may open the line.
free_after_a_kill(_) ->
    #{port := Port, pty := Pty, name := Name} = Line = going(),
    Guardian = guardian(os_pid(Port)),
    Pid = os_pid(Port),
    stops_when(Pty, fun() -> kill("KILL", Pid) end),
    gone(Guardian),
    #{name := Name} = line(Line, #{heartbeat_ms => 0}).

%% A computer that starts no further process gets no line that nobody guards.
unguarded(Config) ->
    #{pty := Pty, name := Name} = pty(),
    _ = wrapped("prlimit --nproc=1 ", Config),
    {ok, Port} = starl_create_port:start_link(self(), #{}),
    Port ! {stop_bytes, ?STOP},
    Port ! {open, Name, 57600},
    receive
        {error, {unguarded, Text}} -> contains("guards the line", Text)
    after ?AFTER_MS -> error(late)
    end,
    _ = wrapped("", Config),
    ok = starl_create_pty:stop(Pty).

%% As if the cable had been pulled: the line is opened anew, and the wheels are stopped first.
reader_killed(_) ->
    #{port := Port, pty := Pty} = going(),
    Reader = child("starl_reader\n", os_pid(Port)),
    stops_when(Pty, fun() -> kill("KILL", Reader) end),
    receive
        {closed, unplugged} -> ok
    after ?AFTER_MS -> error(late)
    end,
    receive
        {opened, _} -> ok
    after ?AFTER_MS -> error(late)
    end,
    Port ! {send, ?GO},
    ?assertEqual(?GO, heard(Pty, 5)).

program_terminated(_) ->
    #{port := Port, pty := Pty} = going(),
    Pid = os_pid(Port),
    stops_when(Pty, fun() -> kill("TERM", Pid) end),
    receive
        {closed, {program, Status}} -> ?assertEqual(0, Status)
    after ?AFTER_MS -> error(late)
    end.

vm_killed(_) ->
    #{pty := Pty} = Line = pty(),
    {_Peer, Pid} = vm(Line, #{heartbeat_ms => 0}),
    stops_when(Pty, fun() -> kill("KILL", Pid) end).

%% A VM that halts: the heartbeat stops the wheels. What the robot says meanwhile fills the pipe
%% and is dropped; then all goes on.
vm_asleep(_) ->
    #{pty := Pty} = Line = pty(),
    {Peer, Pid} = vm(Line, #{heartbeat_ms => 400}),
    try
        stops_when(Pty, fun() -> kill("STOP", Pid) end),
        [ok = starl_create_pty:send(Pty, binary:copy(<<N>>, 4000)) || N <- lists:seq(1, 200)]
    after
        kill("CONT", Pid)
    end,
    receive
        {said, {stopped, heartbeat, _}} -> ok
    after ?AFTER_MS -> error(late)
    end,
    ok = go_again(Peer),
    ?assertEqual(?GO, heard(Pty, 5)),
    peer:stop(Peer).

closed_by_request(_) ->
    #{port := Port, pty := Pty} = going(),
    stops_when(Pty, fun() -> Port ! {close} end),
    receive
        {pty, Pty, detached} -> ok
    after ?AFTER_MS -> error(late)
    end,
    Port ! {send, ?GO},
    receive
        {error, {closed, _}} -> ok
    after ?AFTER_MS -> error(late)
    end,
    Port ! {connect},
    receive
        {opened, _} -> ok
    after ?AFTER_MS -> error(late)
    end.

%% A line that takes no more: the command that has begun is finished before the stop bytes.
half_command(_) ->
    #{port := Port, pty := Pty} = going(),
    Helper = os_pid(Pty),
    kill("STOP", Helper),
    [Port ! {send, ?GO} || _ <- lists:seq(1, 5000)],
    Port ! {close},
    kill("CONT", Helper),
    Whole = until(Pty, ?STOPS, <<>>),
    Before = binary:part(Whole, 0, byte_size(Whole) - ?STOPS_SIZE),
    ?assertEqual([?GO], lists:usort(in_fives(Before))).

in_fives(<<>>) -> [];
in_fives(<<Five:5/binary, Rest/binary>>) -> [Five | in_fives(Rest)];
in_fives(Rest) -> [Rest].

%% A program that was there for a moment, which the other end notices only afterwards, was heard.
brief_visit(_) ->
    #{pty := Pty} = Line = pty(),
    Helper = os_pid(Pty),
    kill("STOP", Helper),
    try
        #{port := Port} = line(Line, #{heartbeat_ms => 0}),
        Port ! {send, ?GO},
        Port ! {close},
        Port ! {send, ?GO},
        receive
            {error, {closed, _}} -> ok
        after ?AFTER_MS -> error(late)
        end
    after
        kill("CONT", Helper)
    end,
    ?assertEqual(<<?GO/binary, ?STOPS/binary>>, heard(Pty, 5 + ?STOPS_SIZE)),
    receive
        {pty, Pty, detached} -> ok
    after ?AFTER_MS -> error(late)
    end.

%% Twenty times, while it drives: what the robot hears first is to stop.
cable_pulled(_) ->
    #{port := Port, pty := Pty} = going(),
    [pulled(Port, Pty, N) || N <- lists:seq(1, 20)].

pulled(Port, Pty, N) ->
    ok = starl_create_pty:pull(Pty),
    receive
        {closed, unplugged} -> ok
    after ?AFTER_MS -> error({late, N})
    end,
    ok = starl_create_pty:put_back(Pty),
    receive
        {opened, _} -> ok
    after ?AFTER_MS -> error({late, N})
    end,
    ?assertEqual(?STOPS, heard(Pty, ?STOPS_SIZE)),
    Port ! {drive_script, N, [{?GO, ?LONG_US}], ?STOP},
    ?assertEqual(?GO, heard(Pty, 5)).

%% While the cable is off, requests are errors in words.
unplugged_for_good(_) ->
    #{port := Port, pty := Pty, name := Name} = line(),
    ok = starl_create_pty:pull(Pty),
    receive
        {closed, unplugged} -> ok
    after ?AFTER_MS -> error(late)
    end,
    Port ! {send, ?GO},
    receive
        {error, {closed, _}} -> ok
    after ?AFTER_MS -> error(late)
    end,
    Port ! {open, Name, 57600},
    receive
        {error, {no_device, Text}} -> contains(Name, Text)
    after ?AFTER_MS -> error(late)
    end,
    %% nothing was driven, so nobody stays to stop it
    Program = os_pid(Port),
    true = unlink(Port),
    exit(Port, kill),
    gone(Program).
