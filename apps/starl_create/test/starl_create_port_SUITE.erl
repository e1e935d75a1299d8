%% The port program and its owner, on a pty: bytes and scripts by its clock, requests and their errors,
%% nonsense, links.
-module(starl_create_port_SUITE).
-include_lib("stdlib/include/assert.hrl").
-include("starl_create_port_ct.hrl").
-compile([export_all, nowarn_export_all]).

-import(starl_create_port_ct, [
    name/0,
    pty/0,
    line/0,
    line/2,
    in_pulse/0,
    raw_line/0,
    raw_line/1,
    tell/2,
    framed/1,
    answer/1,
    heard/2,
    until/3,
    said/3,
    contains/2,
    port_of/1,
    os_pid/1,
    kill/2,
    gone/1
]).

all() -> starl_create_port_ct:all().

groups() -> [{plain, cases() ++ [memory_is_constant]}, {ordinary, cases()}, {sanitized, cases()}].

cases() ->
    [bytes_both_ways, script_by_its_clock, script_replaced, script_malformed] ++
        [bytes_bear_their_time, garbage_on_stdin, garbage_on_the_line] ++
        [frames_at_every_boundary, refusals, busy, speeds, pulses] ++
        [pty_link, two_emulators_on_a_link, other_processor, no_program].

init_per_group(Group, Config) -> starl_create_port_ct:init_per_group(Group, Config).

end_per_group(Group, Config) -> starl_create_port_ct:end_per_group(Group, Config).

init_per_testcase(_, Config) -> Config.

end_per_testcase(_, Config) -> starl_create_port_ct:end_per_testcase(Config).

%% -- tests ------------------------------------------------------------------------------------------

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
