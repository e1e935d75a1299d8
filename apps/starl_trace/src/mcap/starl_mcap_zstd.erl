%% @doc Packs and unpacks chunks with Zstandard: by the module `zstd' of OTP 28 and later, or else
%% by the program `zstd'.
%%
%% The program runs once for each chunk, in a pipe: `head' gives it the end of its input, which a port
%% cannot do. Nothing of a file or a user becomes text of the shell. A program that hangs is killed.
-module(starl_mcap_zstd).

-export([is_there/0, compress/1, decompress/2, format_error/1]).
%% for the test of a program that hangs
-export([piped/4]).

-export_type([reason/0]).

%% `missing': there is neither the module nor the program; `damaged': these bytes do not unpack, or
%% not to that size; else the program could not do its work: it has hung or died.
-type reason() :: missing | damaged | hangs | died | {no_shell, file:posix()}.

-define(LEVEL, "-3").
%% Without an answer for so long the program hangs.
-define(PATIENCE_MS, 10000).
%% Whatever the program leaves is read: a pipe that breaks would hide why it has ended.
-define(PIPE,
    "exec 2>/dev/null\n"
    "head -c \"$1\" | { shift; \"$@\" || { was=$?; cat >/dev/null; exit $was; } }"
).
%% From here on the shell means that the program did not start, or was ended by a signal.
-define(NOT_ITS_OWN, 126).
-define(MAGIC, 16#28, 16#b5, 16#2f, 16#fd).

%% @doc Can chunks be packed and unpacked here?
-spec is_there() -> boolean().
is_there() -> way() =/= missing.

way() ->
    case code:ensure_loaded(zstd) of
        {module, zstd} -> {module, zstd};
        {error, _} -> program(os:find_executable("zstd"))
    end.

program(false) -> missing;
program(Path) -> {program, Path}.

%% @doc Packs bytes.
-spec compress(binary()) -> {ok, binary()} | {error, reason()}.
compress(Bytes) ->
    Size = integer_to_list(byte_size(Bytes)),
    %% the largest size that packed bytes have, and more
    Most = 2 * byte_size(Bytes) + 1000,
    case worked(way(), compress, [?LEVEL, "--stream-size=" ++ Size], Bytes, Most) of
        {ok, <<?MAGIC, _/binary>>} = Answer -> Answer;
        {ok, _} -> {error, died};
        {error, damaged} -> {error, died};
        {error, _} = Error -> Error
    end.

%% @doc Unpacks bytes that have this size when they are unpacked.
-spec decompress(binary(), Size :: non_neg_integer()) -> {ok, binary()} | {error, reason()}.
decompress(Bytes, Size) ->
    case worked(way(), decompress, ["-d"], Bytes, Size) of
        {ok, Whole} when byte_size(Whole) =/= Size -> {error, damaged};
        Answer -> Answer
    end.

worked(missing, _Function, _Args, _Bytes, _Most) ->
    {error, missing};
worked({module, Module}, Function, _Args, Bytes, _Most) ->
    try
        {ok, iolist_to_binary(Module:Function(Bytes))}
    catch
        error:_ -> {error, damaged}
    end;
worked({program, Path}, _Function, Args, Bytes, Most) ->
    piped([Path, "-q", "-c" | Args], Bytes, Most, ?PATIENCE_MS).

%% @private In a process of its own: nothing of the port comes to the caller.
-spec piped([string(), ...], binary(), Most :: non_neg_integer(), PatienceMs :: pos_integer()) ->
    {ok, binary()} | {error, reason()}.
piped(Command, Bytes, Most, Patience) ->
    Caller = self(),
    {Worker, Monitor} = spawn_monitor(fun() ->
        %% the port of a program that is killed ends while its answer is made
        process_flag(trap_exit, true),
        Caller ! {piped, self(), opened(Command, Bytes, Most, Patience)}
    end),
    receive
        {piped, Worker, Answer} ->
            true = erlang:demonitor(Monitor, [flush]),
            Answer;
        {'DOWN', Monitor, process, Worker, _Reason} ->
            {error, died}
    end.

opened(Command, Bytes, Most, Patience) ->
    Args = ["-c", ?PIPE, "sh", integer_to_list(byte_size(Bytes)) | Command],
    try open_port({spawn_executable, "/bin/sh"}, [{args, Args}, binary, exit_status, hide]) of
        Port ->
            Port ! {self(), {command, Bytes}},
            output(Port, [], Most, Patience)
    catch
        error:Reason -> {error, {no_shell, Reason}}
    end.

output(Port, _Output, Room, _Patience) when Room < 0 ->
    killed(erlang:port_info(Port, os_pid), damaged);
output(Port, Output, Room, Patience) ->
    receive
        {Port, {data, Data}} -> output(Port, [Output, Data], Room - byte_size(Data), Patience);
        {Port, {exit_status, 0}} -> {ok, iolist_to_binary(Output)};
        {Port, {exit_status, Status}} when Status >= ?NOT_ITS_OWN -> {error, died};
        {Port, {exit_status, _}} -> {error, damaged};
        {'EXIT', Port, _} -> {error, died}
    after Patience ->
        killed(erlang:port_info(Port, os_pid), hangs)
    end.

%% A port's program leads a group of its own: the shell and what it has started.
killed({os_pid, Pid}, Reason) ->
    _ = os:cmd("kill -9 -" ++ integer_to_list(Pid)),
    {error, Reason};
killed(undefined, Reason) ->
    {error, Reason}.

%% @doc What is wrong, and what to do.
-spec format_error(reason()) -> unicode:chardata().
format_error(missing) ->
    "it is packed with zstd: install the program zstd, or Erlang/OTP 28, to read it";
format_error(damaged) ->
    "what zstd has packed does not unpack";
format_error(hangs) ->
    "the program zstd does not answer";
format_error(died) ->
    "the program zstd has died";
format_error({no_shell, Posix}) ->
    io_lib:format("/bin/sh, for the program zstd, does not start: ~ts", [file:format_error(Posix)]).
