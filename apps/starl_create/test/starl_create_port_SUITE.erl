%% The port program and its owner, on a pty: what a robot at the other end gets to hear, above all
%% when something is killed. Nothing here judges a time: that the stop bytes come is what is held;
%% `./starl create bench' measures when. Everything runs three times: as this user, as a user who may
%% nothing, and under sanitizers.
-module(starl_create_port_SUITE).
-include_lib("stdlib/include/assert.hrl").
-compile([export_all, nowarn_export_all]).

-define(STOP, <<145, 0, 0, 0, 0>>).
%% Zeros fill the rest of a command that was begun.
-define(STOPS, <<0:32, ?STOP/binary, 0:320, ?STOP/binary>>).
-define(STOPS_SIZE, 54).
-define(GO, <<145, 0, 100, 0, 100>>).
-define(LONG_US, 600000000).
%% A guard against waiting for ever.
-define(AFTER_MS, 20000).

all() -> [{group, plain}, {group, ordinary}, {group, sanitized}].

groups() ->
    [
        {plain, cases() ++ [memory_is_constant]},
        {ordinary, cases() ++ [unguarded]},
        {sanitized, cases()}
    ].

cases() ->
    [bytes_both_ways, script_by_its_clock, script_replaced, script_malformed] ++
        [owner_killed, line_killed, program_killed, guardian_killed, reader_killed] ++
        [program_halted, guardian_halted, half_sent, killed_in_mid_pulse, closed_in_mid_pulse] ++
        [ended_while_out, free_after_a_kill, other_processor, two_emulators_on_a_link] ++
        [program_terminated, bytes_bear_their_time] ++
        [
            vm_killed,
            vm_asleep,
            closed_by_request,
            half_command,
            brief_visit,
            cable_pulled,
            unplugged_for_good
        ] ++
        [garbage_on_stdin, garbage_on_the_line, frames_at_every_boundary] ++
        [refusals, busy, speeds, pulses, pty_link, no_program].

init_per_group(plain, Config) ->
    case starl_create_program:path() of
        {ok, _} -> Config;
        {error, Reason} -> {skip, lists:flatten(starl_create_program:format_error(Reason))}
    end;
%% The port program of a user without rights; the robot's end is the same user's.
init_per_group(ordinary, Config) ->
    case {starl_create_program:path(), os:cmd("id -u"), os:find_executable("setpriv")} of
        {{error, Reason}, _, _} ->
            {skip, lists:flatten(starl_create_program:format_error(Reason))};
        {_, "0\n", false} ->
            {skip, "no setpriv here, to run it as another user than root"};
        {{ok, File}, "0\n", _} ->
            Dir = filename:join("/tmp", "starl_ordinary_" ++ os:getpid()),
            ok = filelib:ensure_path(Dir),
            ok = file:change_mode(Dir, 8#755),
            Own = filename:join(Dir, "port"),
            {ok, _} = file:copy(File, Own),
            ok = file:change_mode(Own, 8#755),
            wrapped("", [{ordinary, {Dir, Own}} | Config]);
        {{ok, File}, _, _} ->
            wrapped("", [{ordinary, {proplists:get_value(priv_dir, Config), File}} | Config])
    end;
init_per_group(sanitized, Config) ->
    File = filename:join(proplists:get_value(priv_dir, Config), "sanitized_port"),
    Flags = " -g -fsanitize=address,undefined -fno-sanitize-recover=all",
    Said = os:cmd("sh " ++ build() ++ " " ++ File ++ Flags),
    case filelib:is_regular(File) of
        true ->
            Log = File ++ ".log",
            true = os:putenv("STARL_CREATE_PORT", File),
            true = os:putenv("ASAN_OPTIONS", "log_path=" ++ Log),
            true = os:putenv("UBSAN_OPTIONS", "log_path=" ++ Log),
            [{sanitizer_log, Log} | Config];
        false ->
            {skip, "no C compiler with AddressSanitizer and UBSan here: " ++ Said}
    end.

%% The folder of the application's sources, of which the build has a link.
build() ->
    Src = filename:join(code:lib_dir(starl_create), "src"),
    {ok, Link} = file:read_link(Src),
    filename:join([filename:dirname(Src), Link, "../c_src/build"]).

%% A user of whom there is no other process.
-define(NOBODY, "64913").

%% Another program stands between this user and the port program.
wrapped(Limit, Config) ->
    {Dir, Own} = proplists:get_value(ordinary, Config),
    File = filename:join(Dir, "wrapped"),
    As =
        case os:cmd("id -u") of
            "0\n" -> "setpriv --reuid=" ++ ?NOBODY ++ " --regid=" ++ ?NOBODY ++ " --clear-groups ";
            _ -> ""
        end,
    ok = file:write_file(File, ["#!/bin/sh\nexec ", As, Limit, Own, " \"$@\"\n"]),
    ok = file:change_mode(File, 8#755),
    true = os:putenv("STARL_CREATE_PORT", File),
    Config.

end_per_group(_, Config) ->
    _ = [file:del_dir_r(Dir) || {Dir, _} <- [proplists:get_value(ordinary, Config, none)]],
    [true = os:unsetenv(Name) || Name <- ["STARL_CREATE_PORT", "ASAN_OPTIONS", "UBSAN_OPTIONS"]].

init_per_testcase(_, Config) -> Config.

end_per_testcase(_, Config) ->
    case filelib:wildcard(proplists:get_value(sanitizer_log, Config, "none") ++ "*") of
        [] -> ok;
        [File | _] = Files -> {fail, {Files, file:read_file(File)}}
    end.

%% -- tests ----------------------------------------------------------------------------------

bytes_both_ways(_) ->
    #{port := Port, pty := Pty} = line(),
    All = <<<<N>> || N <- lists:seq(0, 255)>>,
    Port ! {send, All},
    ?assertEqual(All, heard(Pty, 256)),
    ok = starl_create_pty:send(Pty, All),
    ?assertEqual(All, said(Port, 256, <<>>)).

%% The bytes leave by the program's clock: never early; between the marks lies what was asked for. A
%% program that was held up for 25 ms cuts the script short, and another one is tried.
script_by_its_clock(_) -> by_its_clock(line(), 20).

by_its_clock(#{port := Port, pty := Pty} = Line, Tries) ->
    Asked = erlang:monotonic_time(microsecond),
    Port ! {drive_script, Tries, [{<<1>>, 20000}, {<<2>>, 0}, {<<3, 3>>, 30000}], ?STOP},
    Sent =
        receive
            {sent, Tries, SentUs} -> SentUs
        after ?AFTER_MS -> error(late)
        end,
    Ended =
        receive
            {ended, Tries, EndedUs} -> EndedUs
        after ?AFTER_MS -> error(late)
        end,
    ?assert(Asked =< Sent),
    ?assert(Sent =< Ended),
    ?assert(Ended =< erlang:monotonic_time(microsecond)),
    Bytes = until(Pty, ?STOP, heard(Pty, byte_size(?STOP))),
    case binary:part(Bytes, 0, byte_size(Bytes) - byte_size(?STOP)) of
        <<1, 2, 3, 3>> ->
            ?assert(Ended - Asked >= 50000);
        Cut when Tries > 1 ->
            ?assert(lists:member(Cut, [<<1>>, <<1, 2>>])),
            ?assert(Ended - Asked > 45000),
            by_its_clock(Line, Tries - 1)
    end.

script_replaced(_) ->
    #{port := Port, pty := Pty} = line(),
    Port ! {drive_script, 1, [{?GO, ?LONG_US}, {<<1, 1, 1>>, 0}], ?STOP},
    receive
        {sent, 1, _} -> ok
    after ?AFTER_MS -> error(late)
    end,
    Port ! {drive_script, 2, [{<<9>>, 1000}], ?STOP},
    receive
        {ended, 2, _} -> ok
    after ?AFTER_MS -> error(late)
    end,
    Port ! {drive_script, 3, [], ?STOP},
    receive
        {ended, 3, _} -> ok
    after ?AFTER_MS -> error(late)
    end,
    ?assertEqual(<<?GO/binary, 9, ?STOP/binary, ?STOP/binary>>, heard(Pty, 16)),
    receive
        {ended, 1, _} -> error(void_script_ended)
    after 0 -> ok
    end.

%% Nothing of a malformed script is done; the one that runs runs on.
script_malformed(_) ->
    #{raw := Raw, pty := Pty} = raw_line(),
    Good = <<$D, 5:64, 1:16, 99, 1000:32, 1:16, 42>>,
    Bad = [binary:part(Good, 0, N) || N <- lists:seq(1, byte_size(Good) - 1), N =/= 12],
    [tell(Raw, Some) || Some <- Bad ++ [<<Good/binary, 1>>]],
    [{error, "bad_message"} = answer(Raw) || _ <- [over | Bad]],
    tell(Raw, Good),
    ?assertEqual(<<42, 99>>, heard(Pty, 2)).

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
    receive
        {stopped, guardian, _} -> ok
    after ?AFTER_MS -> error(late)
    end,
    Port ! {send, ?GO},
    _ = heard(Pty, 5),
    stops_when(Pty, fun() -> kill("KILL", Program) end).

%% The guardian stops the wheels. What was sent to the halted program is not driven later.
program_halted(_) ->
    #{port := Port, pty := Pty} = going(),
    Program = os_pid(Port),
    stops_when(Pty, fun() -> kill("STOP", Program) end),
    Port ! {drive_script, 2, [{?GO, ?LONG_US}], ?STOP},
    %% the port has passed it on
    {messages, _} = process_info(Port, messages),
    _ = sys_free(Port),
    kill("CONT", Program),
    receive
        {stopped, halted, _} -> ok
    after ?AFTER_MS -> error(late)
    end,
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
    receive
        {stopped, guardian, _} -> ok
    after ?AFTER_MS -> error(late)
    end,
    gone(First),
    Port ! {send, ?GO},
    _ = heard(Pty, 5),
    stops_when(Pty, fun() -> kill("KILL", Program) end).

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

%% One line says it, as if there were no program.
other_processor(Config) ->
    Before = os:getenv("STARL_CREATE_PORT"),
    File = filename:join(proplists:get_value(priv_dir, Config), "other"),
    {ok, <<Head:18/binary, _Machine:16, Rest/binary>>} = file:read_file("/bin/true"),
    ok = file:write_file(File, <<Head/binary, 16#FFFF:16, Rest/binary>>),
    ok = file:change_mode(File, 8#755),
    true = os:putenv("STARL_CREATE_PORT", File),
    try
        %% now and then the program has ended when it is written to
        [
            begin
                {ok, Port} = starl_create_port:start_link(self(), #{}),
                Port ! {open, "/dev/null", 57600},
                receive
                    {error, {other_processor, Text}} -> contains("another processor", Text)
                after ?AFTER_MS -> error(late)
                end
            end
         || _ <- lists:seq(1, 100)
        ],
        ?assertEqual({error, other_processor}, starl_create_pty:start_link(self(), none))
    after
        _ = [os:unsetenv("STARL_CREATE_PORT") || Before =:= false],
        _ = [os:putenv("STARL_CREATE_PORT", Before) || Before =/= false]
    end.

%% The link is the second one's; the first leaves it alone.
two_emulators_on_a_link(_) ->
    #{pty := First, name := Link} = pty(),
    {ok, Second} = starl_create_pty:start_link(self(), Link),
    {ok, Target} = file:read_link(Link),
    Helper = os_pid(First),
    ok = starl_create_pty:stop(First),
    gone(Helper),
    ?assertEqual({ok, Target}, file:read_link(Link)),
    ok = starl_create_pty:stop(Second).

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

%% Bytes that wait for a reader bear the time at which they were written, and nothing counts as told
%% before they are.
bytes_bear_their_time(_) ->
    #{port := Port, pty := Pty} = line(),
    Helper = os_pid(Pty),
    kill("STOP", Helper),
    Port ! {drive_script, 1, [{?GO, 20000}], ?STOP},
    Times = [
        receive
            {Word, 1, Left} -> Left
        after ?AFTER_MS -> error(late)
        end
     || Word <- [sent, ended]
    ],
    ok = starl_create_pty:sync(Pty),
    kill("CONT", Helper),
    Stamps = [
        receive
            {pty, Pty, {data, Bytes, At}} -> At
        after ?AFTER_MS -> error(late)
        end
     || Bytes <- [?GO, ?STOP]
    ],
    %% two looks at the clock
    [?assert(At < Left + 1000) || {Left, At} <- lists:zip(Times, Stamps)],
    receive
        {pty, Pty, {upto, Upto}} -> ?assert(Upto > lists:last(Times))
    after ?AFTER_MS -> error(late)
    end.

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
    ok = peer:call(Peer, ?MODULE, go_again, [], ?AFTER_MS),
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

%% A million bytes in well-formed messages of nonsense, of which none may end it or reach the line.
garbage_on_stdin(_) ->
    #{raw := Raw, pty := Pty} = raw_line(),
    Seed = rand:seed(exsss),
    ct:pal("seed ~w", [rand:export_seed_s(Seed)]),
    nonsense(Raw, 1000000),
    tell(Raw, <<$W, "alive">>),
    ?assertEqual(<<"alive">>, heard(Pty, 5)).

nonsense(_Raw, Left) when Left =< 0 ->
    ok;
nonsense(Raw, Left) ->
    <<Tag, Rest/binary>> = rand:bytes(rand:uniform(2000)),
    %% known kinds, that would be done, are another test's
    case lists:member(Tag, "OWDZLBSCH") of
        true ->
            nonsense(Raw, Left);
        false ->
            tell(Raw, <<Tag, Rest/binary>>),
            {error, "bad_message"} = answer(Raw),
            nonsense(Raw, Left - byte_size(Rest) - 1)
    end.

%% What the robot says reaches the owner as it is, whatever it is.
garbage_on_the_line(_) ->
    #{port := Port, pty := Pty} = line(),
    Seed = rand:seed(exsss),
    ct:pal("seed ~w", [rand:export_seed_s(Seed)]),
    [
        begin
            Bytes = rand:bytes(2000),
            ok = starl_create_pty:send(Pty, Bytes),
            ?assertEqual(Bytes, said(Port, 2000, <<>>))
        end
     || _ <- lists:seq(1, 500)
    ],
    Port ! {send, <<"alive">>},
    %% on a busy computer the robot was told to stand before
    _ = until(Pty, <<"alive">>, <<>>),
    ok.

%% A message in two pieces: the answer to the one before it tells that the first has been read.
frames_at_every_boundary(_) ->
    #{raw := Raw, pty := Pty} = raw_line(stream),
    Ping = framed(<<"?">>),
    Message = framed(<<$W, "abcdef">>),
    [
        begin
            <<First:N/binary, Rest/binary>> = Message,
            true = port_command(Raw, [Ping, First]),
            {error, "bad_message"} = answer(Raw),
            true = port_command(Raw, [Rest, framed(<<>>), Ping]),
            {error, "bad_message"} = answer(Raw),
            {error, "bad_message"} = answer(Raw),
            ?assertEqual(<<"abcdef">>, heard(Pty, 6))
        end
     || N <- lists:seq(0, byte_size(Message))
    ].

%% An hour of the longest stream frame, as fast as it goes.
memory_is_constant(_) ->
    #{port := Port, pty := Pty} = line(),
    Pid = os_pid(Port),
    Frames = binary:copy(binary:copy(<<19>>, 84), 40),
    stream(Port, Pty, Frames, 100),
    Before = memory(Pid),
    stream(Port, Pty, Frames, 240000 div 40),
    ct:pal("240,000 frames: ~p before, ~p after", [Before, memory(Pid)]),
    ?assertEqual(Before, memory(Pid)).

stream(_Port, _Pty, _Frames, 0) ->
    ok;
stream(Port, Pty, Frames, N) ->
    ok = starl_create_pty:send(Pty, Frames),
    _ = said(Port, byte_size(Frames), <<>>),
    stream(Port, Pty, Frames, N - 1).

%% kB of memory that was asked for.
memory(Pid) ->
    {ok, Text} = file:read_file("/proc/" ++ Pid ++ "/status"),
    [
        Line
     || Line <- binary:split(Text, <<"\n">>, [global]),
        lists:member(binary:part(<<Line/binary, "        ">>, 0, 6), [<<"VmSize">>, <<"VmData">>])
    ].

refusals(_) ->
    {ok, Port} = starl_create_port:start_link(self(), #{}),
    Asked = fun(Request) ->
        Port ! Request,
        receive
            {error, {Reason, Text}} -> {Reason, Text}
        after ?AFTER_MS -> error(late)
        end
    end,
    {no_device, Missing} = Asked({open, "/dev/ttyNOT", 57600}),
    contains("/dev/ttyNOT: no such file or directory; plug the adapter in", Missing),
    {not_serial, _} = Asked({open, "/dev/null", 57600}),
    {not_serial, _} = Asked({open, "/tmp", 57600}),
    {no_device, _} = Asked({open, lists:duplicate(3000, $a), 57600}),
    {closed, _} = Asked({send, "x"}),
    {closed, _} = Asked({pulse, dtr, 100, 3}),
    {bad_message, _} = Asked({open, "/dev/null", 0}),
    {bad_message, _} = Asked({send, binary:copy(<<0>>, 70000)}),
    {bad_message, _} = Asked({stop_bytes, binary:copy(<<0>>, 2000)}),
    {bad_message, _} = Asked({pulse, cts, 100, 3}),
    {bad_message, _} = Asked({drive_script, 1, [{<<1>>, -1}], <<>>}),
    {bad_message, _} = Asked(nonsense).

%% Another program that has the line is named.
busy(_) ->
    #{name := Name, port := Port} = line(),
    {ok, Second} = starl_create_port:start_link(self(), #{}),
    Second ! {open, Name, 57600},
    %% with TIOCEXCL only root comes as far as to the lock
    receive
        {error, {busy, Text}} -> contains("in use by process ", Text)
    after ?AFTER_MS -> error(late)
    end,
    Port ! close,
    Second ! {open, Name, 57600},
    receive
        {opened, Name} -> ok
    after ?AFTER_MS -> error(late)
    end.

speeds(_) ->
    #{name := Name, pty := Pty, port := Port} = line(),
    [
        begin
            Port ! {speed, Baud},
            receive
                {pty, Pty, {baud, Baud}} -> ok
            after ?AFTER_MS -> error({late, Baud})
            end
        end
     || Baud <- [300, 9600, 14400, 19200, 28800, 38400, 57600, 115200, 230400, 250000]
    ],
    Port ! {open, Name, 19200},
    receive
        {pty, Pty, {baud, 19200}} -> ok
    after ?AFTER_MS -> error(late)
    end.

%% A line in a long pulse. A pty has no control lines: the other side sees the line hung up instead.
in_pulse() ->
    #{pty := Pty, port := Port} = Line = line(),
    receive
        {pty, Pty, {baud, 57600}} -> ok
    after ?AFTER_MS -> error(late)
    end,
    Port ! {pulse, dtr, 60000, 1},
    receive
        {pty, Pty, {baud, hung_up}} -> ok
    after ?AFTER_MS -> error(late)
    end,
    Line.

pulses(_) ->
    #{pty := Pty, port := Port} = in_pulse(),
    %% another request takes the place of the first
    Port ! {pulse, rts, 1, 2},
    receive
        {pty, Pty, {baud, 57600}} -> ok
    after ?AFTER_MS -> error(late)
    end,
    Port ! {send, ?GO},
    ?assertEqual(?GO, heard(Pty, 5)).

%% A link is replaced, a file is not; the link goes with its line.
pty_link(_) ->
    Dir = name(),
    ok = file:make_dir(Dir),
    ok = file:change_mode(Dir, 8#777),
    Link = filename:join(Dir, "robot"),
    ok = file:make_symlink("/dev/null", Link),
    {ok, Pty} = starl_create_pty:start_link(self(), Link),
    ?assertEqual(Link, starl_create_pty:name(Pty)),
    ?assertMatch({ok, "/dev/pts/" ++ _}, file:read_link(Link)),
    ok = file:write_file(Link ++ ".file", "kept"),
    {error, {link, Text}} = starl_create_pty:start_link(self(), Link ++ ".file"),
    contains("file exists", Text),
    ?assertEqual({ok, <<"kept">>}, file:read_file(Link ++ ".file")),
    Port = port_of(Pty),
    Ref = monitor(port, Port),
    Pid = os_pid(Pty),
    ok = starl_create_pty:stop(Pty),
    receive
        {'DOWN', Ref, _, _, _} -> ok
    after ?AFTER_MS -> error(late)
    end,
    gone(Pid),
    ?assertEqual({error, enoent}, file:read_link(Link)),
    ok = file:del_dir_r(Dir).

no_program(_) ->
    Before = os:getenv("STARL_CREATE_PORT"),
    true = os:putenv("STARL_CREATE_PORT", "/nowhere"),
    {ok, Port} = starl_create_port:start_link(self(), #{}),
    {error, no_program} = starl_create_pty:start_link(self(), none),
    _ = [os:unsetenv("STARL_CREATE_PORT") || Before =:= false],
    _ = [os:putenv("STARL_CREATE_PORT", Before) || Before =/= false],
    Port ! {send, "x"},
    Port ! {open, "/dev/null", 57600},
    receive
        {error, {no_program, Text}} -> contains("./starl setup", Text)
    after ?AFTER_MS -> error(late)
    end.

%% -- a line -----------------------------------------------------------------------------------

%% Where each user may make a link.
name() -> filename:join("/tmp", "starl_line_" ++ os:getpid() ++ integer_to_list(unique())).

pty() ->
    Link = name(),
    {ok, Pty} = starl_create_pty:start_link(self(), Link),
    #{pty => Pty, name => Link}.

unique() -> erlang:unique_integer([positive]).

%% A VM that waits for its turn must not look like one that halts; vm_asleep has a heartbeat.
line() -> line(pty(), #{heartbeat_ms => 0}).

line(#{name := Name} = Line, Options) ->
    {ok, Port} = starl_create_port:start_link(self(), Options),
    Port ! {stop_bytes, ?STOP},
    Port ! {open, Name, 57600},
    receive
        {opened, Name} -> Line#{port => Port};
        {error, Error} -> error(Error)
    after ?AFTER_MS -> error(late)
    end.

%% A robot that drives, for longer than any test.
going() ->
    #{port := Port, pty := Pty} = Line = line(),
    go(Port),
    ?assertEqual(?GO, heard(Pty, 5)),
    Line.

go(Port) -> Port ! {drive_script, 1, [{?GO, ?LONG_US}], ?STOP}.

%% The life of another owner.
drives(Line, Parent) -> drives(Line, #{heartbeat_ms => 0}, Parent).

drives(Line, Options, Parent) ->
    #{port := Port} = line(Line, Options),
    go(Port),
    receive
        {sent, 1, _} -> ok
    end,
    Parent ! {drives, self(), Port},
    tells(Parent).

tells(Parent) ->
    receive
        {ask, Request} ->
            Request(),
            tells(Parent);
        {data, _} ->
            tells(Parent);
        {priority, _} ->
            tells(Parent);
        Event ->
            Parent ! {said, Event},
            tells(Parent)
    end.

%% Another VM that drives, and its process of the operating system.
vm(#{pty := Pty} = Line, Options) ->
    Paths = lists:append([
        ["-pa", Dir]
     || Dir <- code:get_path(), string:find(Dir, "starl") =/= nomatch
    ]),
    {ok, Peer, _} = peer:start(#{connection => standard_io, args => Paths}),
    ok = peer:call(Peer, ?MODULE, drive, [maps:remove(pty, Line), Options], ?AFTER_MS),
    ?assertEqual(?GO, heard(Pty, 5)),
    Self = self(),
    _ = [
        spawn_link(fun() -> Self ! {said, peer:call(Peer, ?MODULE, next_event, [], infinity)} end)
     || Options =/= #{heartbeat_ms => 0}
    ],
    {Peer, peer:call(Peer, os, getpid, [])}.

%% In the other VM.
drive(Line, Options) ->
    Caller = self(),
    Teller = spawn(fun() ->
        Self = self(),
        Owner = spawn_link(fun() -> drives(Line, Options, Self) end),
        receive
            {drives, Owner, Port} ->
                true = register(port_of_test, Port),
                Caller ! driving,
                relay([])
        end
    end),
    true = register(teller_of_test, Teller),
    receive
        driving -> ok
    end.

relay(Waiting) ->
    receive
        {next, From} ->
            relay([From | Waiting]);
        {said, Event} ->
            [From ! {event, Event} || From <- Waiting],
            relay([])
    end.

next_event() ->
    teller_of_test ! {next, self()},
    receive
        {event, Event} -> Event
    end.

go_again() ->
    port_of_test ! {send, ?GO},
    ok.

%% The wheels go; after the deed they are told to stop, and nothing else.
stops_when(Pty, Deed) ->
    _ = Deed(),
    ?assertEqual(?STOPS, heard(Pty, ?STOPS_SIZE)).

%% The program without its owner, for messages that no owner sends.
raw_line() -> raw_line({packet, 2}).

raw_line(Kind) ->
    #{name := Name} = Line = pty(),
    {ok, File} = starl_create_program:path(),
    Raw = open_port({spawn_executable, File}, [Kind, binary, exit_status]),
    put(kind, Kind),
    tell(Raw, <<$O, 57600:32, 0:32, (list_to_binary(Name))/binary>>),
    <<$p, _/binary>> = next(Raw),
    <<$o, _/binary>> = next(Raw),
    Line#{raw => Raw}.

tell(Raw, Message) ->
    true = port_command(
        Raw,
        case get(kind) of
            stream -> framed(Message);
            _ -> Message
        end
    ),
    ok.

framed(Message) -> <<(byte_size(Message)):16, Message/binary>>.

answer(Raw) ->
    <<$e, Error/binary>> = next(Raw),
    {error, hd(string:split(binary_to_list(Error), [0]))}.

next(Raw) ->
    Buffer =
        case get(buffer) of
            undefined -> <<>>;
            Left -> Left
        end,
    case {get(kind), Buffer} of
        {stream, <<N:16, Message:N/binary, Rest/binary>>} ->
            put(buffer, Rest),
            Message;
        _ ->
            receive
                {Raw, {data, Bytes}} -> took(Raw, Buffer, Bytes);
                {Raw, {exit_status, Status}} -> error({ended, Status})
            after ?AFTER_MS -> error(late)
            end
    end.

took(Raw, Buffer, Bytes) ->
    case get(kind) of
        stream ->
            put(buffer, <<Buffer/binary, Bytes/binary>>),
            next(Raw);
        _ ->
            Bytes
    end.

%% -- what is heard ------------------------------------------------------------------------------

%% So many bytes at the robot's end.
heard(Pty, N) -> heard(Pty, N, <<>>).

heard(_Pty, N, Bytes) when byte_size(Bytes) >= N -> Bytes;
heard(Pty, N, Bytes) ->
    receive
        {pty, Pty, {data, More, _}} -> heard(Pty, N, <<Bytes/binary, More/binary>>)
    after ?AFTER_MS -> error({heard, Bytes})
    end.

until(Pty, End, Bytes) ->
    Before = byte_size(Bytes) - byte_size(End),
    case Bytes of
        <<_:Before/binary, End/binary>> ->
            Bytes;
        _ ->
            receive
                {pty, Pty, {data, More, _}} -> until(Pty, End, <<Bytes/binary, More/binary>>)
            after ?AFTER_MS -> error({heard, Bytes})
            end
    end.

said(_Port, N, Bytes) when byte_size(Bytes) >= N -> Bytes;
said(Port, N, Bytes) ->
    receive
        {data, More} -> said(Port, N, <<Bytes/binary, More/binary>>)
    after ?AFTER_MS -> error({said, byte_size(Bytes)})
    end.

in_fives(<<>>) -> [];
in_fives(<<Five:5/binary, Rest/binary>>) -> [Five | in_fives(Rest)];
in_fives(Rest) -> [Rest].

contains(Part, Text) ->
    ?assertNotEqual({Part, nomatch, Text}, {Part, string:find(Text, Part), Text}).

%% -- processes of the operating system -------------------------------------------------------------

port_of(Pid) ->
    {links, Links} = process_info(Pid, links),
    hd([Port || Port <- Links, is_port(Port)]).

os_pid(Pid) ->
    {os_pid, OsPid} = erlang:port_info(port_of(Pid), os_pid),
    integer_to_list(OsPid).

guardian(Program) -> child("starl_guardian\n", Program).

child(Name, Program) ->
    {ok, Children} = file:read_file("/proc/" ++ Program ++ "/task/" ++ Program ++ "/children"),
    Pids = string:lexemes(binary_to_list(Children), " \n"),
    [Child] = [
        Pid
     || Pid <- Pids, file:read_file("/proc/" ++ Pid ++ "/comm") =:= {ok, list_to_binary(Name)}
    ],
    Child.

kill(Signal, Pid) -> "" = os:cmd("kill -" ++ Signal ++ " " ++ Pid).

%% A process that is about to end.
gone(Pid) ->
    case filelib:is_dir("/proc/" ++ Pid) of
        true ->
            erlang:yield(),
            gone(Pid);
        false ->
            ok
    end.
