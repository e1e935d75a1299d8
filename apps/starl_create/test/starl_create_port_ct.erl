%% The port program and its owner on a pty, for their suites: groups, lines, owners, the robot's end, another
%% VM. No suite judges a time: that the stop bytes come is what is held; `./starl create bench' measures when.
%% Every case runs three times: as this user, as a user who may nothing, and under sanitizers.
-module(starl_create_port_ct).
-include_lib("stdlib/include/assert.hrl").
-include("starl_create_port_ct.hrl").

-export([all/0, init_per_group/2, end_per_group/2, end_per_testcase/1, wrapped/2]).
-export([name/0, pty/0, line/0, line/2, going/0, go/1, in_pulse/0, stops_when/2, drives/2]).
-export([vm/2, drive/2, next_event/0, go_again/1, drive_again/0]).
-export([raw_line/0, raw_line/1, tell/2, framed/1, answer/1]).
-export([heard/2, until/3, said/3, contains/2]).
-export([port_of/1, os_pid/1, guardian/1, child/2, kill/2, gone/1]).

%% -- groups -----------------------------------------------------------------------------------------

all() -> [{group, plain}, {group, ordinary}, {group, sanitized}].

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

%% A user without rights, of whom the tests alone have processes.
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

end_per_testcase(Config) ->
    case filelib:wildcard(proplists:get_value(sanitizer_log, Config, "none") ++ "*") of
        [] -> ok;
        [File | _] = Files -> {fail, {Files, file:read_file(File)}}
    end.

%% -- a line -----------------------------------------------------------------------------------------

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

%% The wheels go; after the deed they are told to stop, and nothing else.
stops_when(Pty, Deed) ->
    _ = Deed(),
    ?assertEqual(?STOPS, heard(Pty, ?STOPS_SIZE)).

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

%% -- another VM -------------------------------------------------------------------------------------

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

go_again(Peer) -> peer:call(Peer, ?MODULE, drive_again, [], ?AFTER_MS).

%% In the other VM.
drive_again() ->
    port_of_test ! {send, ?GO},
    ok.

%% -- a program without its owner --------------------------------------------------------------------

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

%% -- what is heard ----------------------------------------------------------------------------------

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

contains(Part, Text) ->
    ?assertNotEqual({Part, nomatch, Text}, {Part, string:find(Text, Part), Text}).

%% -- processes of the operating system --------------------------------------------------------------

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
