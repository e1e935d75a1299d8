%% @doc Receives commands from other terminals to a running cluster, over a socket in a directory of
%% the user's own.
-module(starl_cluster_control).

-export([start_link/1, close/0, ask/2, ask/3]).

-export_type([handler/0]).

%% Carries out a command.
-type handler() :: fun(([string()]) -> {ok, unicode:chardata()} | {error, unicode:chardata()}).

-define(TIMEOUT_MS, 70000).
%% A client sends its line at once.
-define(LINE_MS, 2000).

%% @doc Opens the socket of this VM's cluster.
-spec start_link(handler()) -> {ok, pid()} | {error, unicode:chardata()}.
start_link(Handler) ->
    Caller = self(),
    Pid = spawn_link(fun() -> listen(Caller, Handler) end),
    receive
        {Pid, ok} -> {ok, Pid};
        {Pid, {error, Why}} -> {error, Why}
    end.

listen(Caller, Handler) ->
    File = file(os:getpid()),
    case opened(File) of
        {ok, Socket} ->
            Caller ! {self(), ok},
            serve(Socket, Handler);
        {error, Why} ->
            Caller ! {self(), {error, Why}}
    end.

%% A user without a home, as that of a service, may have no directory for it.
opened(File) ->
    _ = file:delete(File),
    case filelib:ensure_dir(File) of
        ok ->
            _ = file:change_mode(filename:dirname(File), 8#700),
            Options = [{ifaddr, {local, File}}, {active, false}, {packet, line}, binary],
            case gen_tcp:listen(0, Options) of
                {ok, Socket} -> {ok, Socket};
                {error, Posix} -> {error, [File, ": ", inet:format_error(Posix)]}
            end;
        {error, Posix} ->
            {error, [
                dir(),
                " cannot be made: ",
                file:format_error(Posix),
                "; set XDG_CACHE_HOME to a directory of yours"
            ]}
    end.

dir() -> filename:join(filename:basedir(user_cache, "starl"), "clusters").

file(OsPid) -> filename:join(dir(), OsPid ++ ".sock").

serve(Listening, Handler) ->
    case gen_tcp:accept(Listening) of
        {ok, Socket} ->
            Server = spawn(fun() -> served(Socket, Handler) end),
            _ = gen_tcp:controlling_process(Socket, Server),
            Server ! {Socket, yours},
            serve(Listening, Handler);
        {error, _} ->
            ok
    end.

%% Each command runs in its own process, so a slow or crashing one blocks nobody.
served(Socket, Handler) ->
    receive
        {Socket, yours} -> ok
    end,
    _ = answered(gen_tcp:recv(Socket, 0, ?LINE_MS), Socket, Handler),
    gen_tcp:close(Socket).

answered({ok, Line}, Socket, Handler) ->
    Words = string:lexemes(unicode:characters_to_list(Line), " \n"),
    Answer =
        case Handler(Words) of
            {ok, Text} -> ["ok\n", Text];
            {error, Why} -> ["error\n", Why]
        end,
    gen_tcp:send(Socket, unicode:characters_to_binary(Answer));
answered({error, _}, _Socket, _Handler) ->
    ok.

%% @doc Removes the socket of this VM's cluster.
-spec close() -> ok.
close() ->
    _ = file:delete(file(os:getpid())),
    ok.

%% @doc Sends a command to the cluster of this process number, or to the only one.
-spec ask([string(), ...], OsPid :: pos_integer() | none) ->
    {ok, unicode:chardata()} | {error, unicode:chardata()}.
ask(Words, OsPid) -> ask(Words, OsPid, ?TIMEOUT_MS).

%% @doc The same, with a limit on the milliseconds without a message of the cluster.
-spec ask([string(), ...], OsPid :: pos_integer() | none, Ms :: pos_integer()) ->
    {ok, unicode:chardata()} | {error, unicode:chardata()}.
ask(Words, OsPid, Ms) ->
    Running = [Pid || Pid <- pids(), OsPid =:= none orelse integer_to_list(OsPid) =:= Pid],
    case [Open || Pid <- Running, {ok, Socket} <- [connect(Pid)], Open <- [{Pid, Socket}]] of
        [] ->
            {error, "no cluster runs; start one first, as in ./starl cluster painting"};
        [{_, Socket}] ->
            asked(Words, Socket, Ms);
        [_, _ | _] = Several ->
            Each = lists:join(", ", [[Pid, doing(Pid)] || {Pid, _} <- Several]),
            {error, ["several clusters run; name one by --pid: ", Each]}
    end.

%% What the process was started with; only Linux tells.
doing(Pid) ->
    case file:read_file(filename:join(["/proc", Pid, "cmdline"])) of
        {ok, Line} ->
            case string:split(Line, <<0, "-extra", 0>>, trailing) of
                [_, Args] -> [" (", lists:join(" ", string:lexemes(Args, [0])), ")"];
                [_] -> ""
            end;
        {error, _} ->
            ""
    end.

pids() -> [filename:rootname(File) || File <- filelib:wildcard("*.sock", dir())].

%% The socket of a cluster that was killed is still there.
connect(Pid) ->
    File = file(Pid),
    case gen_tcp:connect({local, File}, 0, [{active, false}, binary], ?TIMEOUT_MS) of
        {ok, Socket} ->
            {ok, Socket};
        {error, _} = Error ->
            _ = file:delete(File),
            Error
    end.

asked(Words, Socket, Ms) ->
    ok = gen_tcp:send(Socket, [lists:join(" ", Words), "\n"]),
    Answer = all(Socket, Ms, []),
    ok = gen_tcp:close(Socket),
    case Answer of
        <<"ok\n", Text/binary>> ->
            {ok, Text};
        <<"error\n", Why/binary>> ->
            {error, Why};
        timeout ->
            {error, io_lib:format("no answer within ~b s; the cluster may be busy", [Ms div 1000])};
        _ ->
            {error, "the cluster has ended"}
    end.

all(Socket, Ms, Read) ->
    case gen_tcp:recv(Socket, 0, Ms) of
        {ok, Bytes} -> all(Socket, Ms, [Read, Bytes]);
        {error, timeout} -> timeout;
        {error, _} -> iolist_to_binary(Read)
    end.
