%% @doc Starts the port program of this application (`c_src'), and says in one line why it cannot.
-module(starl_create_program).

-export([start/1, ended/1, broken/0, path/0, us/1, format_error/1]).

-export_type([reason/0]).

-type reason() :: no_program | other_processor.

-define(FILE_NAME, "starl_create_port").
%% The exit status of a file that is not executed (ENOEXEC).
-define(NO_EXEC, 8).
%% That of a program whose end was noticed by a broken pipe (EPIPE).
-define(BROKEN, 32).
%% How long we wait for the shell to report that the file cannot be executed.
-define(TELLS_MS, 1000).
%% Looks at two clocks that are no farther apart than this are as good as one.
-define(NEAR_US, 50).
-define(LOOKS, 5).

%% @doc Starts the program with these arguments; messages have their length in front.
-spec start([string()]) -> {ok, port()} | {error, reason()}.
start(Args) ->
    case path() of
        {ok, File} ->
            Options = [{packet, 2}, binary, exit_status, use_stdio, hide, {args, Args}],
            {ok, open_port({spawn_executable, File}, Options)};
        {error, _} = Error ->
            Error
    end.

%% @doc Has it ended since it cannot run on this computer?
-spec ended(Status :: non_neg_integer()) -> {error, reason()} | ended.
ended(?NO_EXEC) -> {error, other_processor};
ended(_Status) -> ended.

%% @doc The exit status of a program that had just ended when it was written to: then its pipe
%% breaks, and the VM does not report the status. So the program is started once more without any
%% input. A program that cannot run on this computer then ends by itself.
-spec broken() -> Status :: non_neg_integer().
broken() ->
    case start([]) of
        {ok, Again} ->
            receive
                {Again, {exit_status, Status}} -> Status
            after ?TELLS_MS ->
                true = port_close(Again),
                ?BROKEN
            end;
        {error, _} ->
            ?BROKEN
    end.

%% @doc Where the program is. The environment variable `STARL_CREATE_PORT' names another one.
-spec path() -> {ok, file:filename()} | {error, reason()}.
path() ->
    File =
        case os:getenv("STARL_CREATE_PORT") of
            false -> filename:join(priv(), ?FILE_NAME);
            Other -> Other
        end,
    case filelib:is_regular(File) of
        true -> {ok, File};
        false -> {error, no_program}
    end.

%% Beside the modules, also where no application is loaded.
priv() ->
    Ebin = filename:dirname(code:which(?MODULE)),
    filename:join(filename:dirname(Ebin), "priv").

%% @doc A moment of the program's clock as `erlang:monotonic_time(microsecond)'. Both clocks are the
%% monotonic one of the operating system, from different beginnings. A VM that loses its core between
%% two looks at the clocks looks again.
-spec us(non_neg_integer()) -> integer().
us(At) when is_integer(At) -> At + between_clocks(?LOOKS).

between_clocks(N) ->
    Before = os:perf_counter(microsecond),
    Own = erlang:monotonic_time(microsecond),
    After = os:perf_counter(microsecond),
    case After - Before > ?NEAR_US andalso N > 1 of
        true -> between_clocks(N - 1);
        false -> Own - (Before + After) div 2
    end.

%% @doc What to do about it, in a line.
-spec format_error(reason()) -> unicode:chardata().
format_error(no_program) ->
    "the port program is not built, without which no Create is driven; install a C compiler (Debian: "
    "apt-get install gcc libc6-dev), then run ./starl setup";
format_error(other_processor) ->
    "the port program is built for another processor than this computer's; build it here (sh "
    "apps/starl_create/c_src/build FILE) and name it in the environment: STARL_CREATE_PORT=FILE".
