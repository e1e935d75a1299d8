%% @doc Plans and writes the directory of a run's results. The plan checks before the run that the
%% directory is writable. The files are made in a temporary directory beside it, which is renamed
%% when all are complete.
-module(starl_cli_out).

-export([
    directory/2, directory/3,
    file/3,
    overwrite/0,
    overwrite_file/0,
    recording/1, recording/2, recording/3
]).
-export([plan/2, beside/2, write/2, again/1, sure/2, shown/1, usual/1, free/1]).

-export_type([t/0]).

%% `fresh': a directory that does not exist yet; `existing': one into which the files are moved one
%% by one; `numbered': the first of NAME-1, NAME-2, ... that is free at the end of the run.
-opaque t() ::
    {fresh, file:filename()}
    | {existing, file:filename()}
    | {numbered, Parent :: file:filename(), Name :: string()}.

-include_lib("kernel/include/file.hrl").

-define(ANY_WRITES, 8#222).
-define(RECORDING, "run.mcap").
%% A run has all or some of these.
-define(OF_A_RUN, [
    "report.txt",
    "report.json",
    "scenario.term",
    "run.term",
    "run.log",
    ?RECORDING,
    "robots",
    "inputs"
]).

%% @doc Plans the directory of the results: the requested one, or a new one under `out/'.
-spec plan(none | file:filename(), Name :: string()) -> {ok, t()} | {error, unicode:chardata()}.
plan(none, Name) ->
    Parent = usual(""),
    checked(Parent, {numbered, Parent, Name});
plan(Dir0, _Name) ->
    Dir = string:trim(filename:absname(Dir0), trailing, "/"),
    case filelib:is_dir(Dir) of
        true -> checked(Dir, {existing, Dir});
        false -> checked(Dir, {fresh, Dir})
    end.

%% @doc The usual place of a result: `out/' in the working directory.
-spec usual(Name :: string()) -> file:filename_all().
usual(Name) -> filename:absname(filename:join("out", Name)).

%% @doc The name of a file that does not exist yet: this one, or with -2, -3, ... before its
%% extension.
-spec free(file:filename_all()) -> file:name_all().
free(File) -> free(filelib:is_file(File), 2, File).

free(false, _N, File) ->
    File;
free(true, N, File) ->
    Extension = filename:extension(File),
    Numbered = lists:concat([filename:rootname(File), "-", N, Extension]),
    case filelib:is_file(Numbered) of
        false -> Numbered;
        true -> free(true, N + 1, File)
    end.

%% Whether a directory holds the results of an earlier run.
-spec holds_a_run(file:filename()) -> boolean().
holds_a_run(Dir) ->
    lists:any(fun(Name) -> filelib:is_file(filename:join(Dir, Name)) end, ?OF_A_RUN).

checked(Dir, Plan) ->
    case writable(Dir) of
        ok -> {ok, Plan};
        {error, Why} -> {error, [shown(Dir), ": ", Why, "; name another directory with --out"]}
    end.

%% Tests the directory itself, or the nearest existing one above it.
writable(Dir) ->
    case file:read_file_info(Dir) of
        {ok, #file_info{type = directory, mode = Mode}} when Mode band ?ANY_WRITES =:= 0 ->
            {error, "this directory is read-only"};
        {ok, #file_info{type = directory}} ->
            probe(Dir);
        {ok, _} ->
            {error, "this is a file, not a directory"};
        {error, enoent} ->
            writable(filename:dirname(Dir));
        {error, enotdir} ->
            {error, "a part of this path is a file, not a directory"};
        {error, Posix} ->
            {error, file:format_error(Posix)}
    end.

probe(Dir) ->
    Probe = hidden(Dir, "starl"),
    case file:make_dir(Probe) of
        ok -> file:del_dir(Probe);
        {error, Posix} -> {error, ["cannot be written: ", file:format_error(Posix)]}
    end.

%% @doc A file of this process beside the directory of the results, before that has its name.
-spec beside(t(), Extension :: string()) -> file:filename().
beside({fresh, Dir}, Extension) -> named(filename:dirname(Dir), filename:basename(Dir), Extension);
beside({existing, Dir}, Extension) -> named(Dir, "run", Extension);
beside({numbered, Parent, Name}, Extension) -> named(Parent, Name, Extension).

named(Parent, Name, Extension) ->
    Parent ++ "/" ++ lists:concat([Name, ".", os:getpid(), Extension]).

%% @doc Calls a function that writes the files into a directory, and gives the final directory;
%% `partly': without a file that is not needed.
-spec write(t(), fun((file:filename()) -> ok | {partly, Why} | {error, Why})) ->
    {ok, file:filename()} | {partly, file:filename(), Why} | {error, unicode:chardata()}
when
    Why :: unicode:chardata().
write(Plan, Fill) ->
    Temporary = temporary(Plan),
    _ = filelib:ensure_dir(Temporary),
    %% a new one: nobody else has laid a link there
    case file:make_dir(Temporary) of
        ok -> filled(Fill(Temporary), Temporary, Plan);
        {error, Posix} -> {error, [shown(Temporary), ": ", file:format_error(Posix)]}
    end.

filled(ok, Temporary, Plan) ->
    case settle(Plan, Temporary) of
        {ok, Dir} ->
            {ok, Dir};
        {error, Posix} ->
            _ = file:del_dir_r(Temporary),
            {error, [shown(Temporary), ": ", file:format_error(Posix)]}
    end;
filled({partly, Why}, Temporary, Plan) ->
    case filled(ok, Temporary, Plan) of
        {ok, Dir} -> {partly, Dir, Why};
        {error, _} = Error -> Error
    end;
filled({error, Why}, Temporary, _Plan) ->
    _ = file:del_dir_r(Temporary),
    {error, Why}.

temporary({fresh, Dir}) -> hidden(filename:dirname(Dir), filename:basename(Dir));
temporary({existing, Dir}) -> hidden(Dir, "results");
temporary({numbered, Parent, Name}) -> hidden(Parent, Name).

hidden(Parent, Name) -> filename:join(Parent, "." ++ Name ++ "." ++ os:getpid() ++ "-" ++ random()).

%% The directory may be open to others: nobody knows the name before.
random() -> string:lowercase(binary_to_list(binary:encode_hex(crypto:strong_rand_bytes(8)))).

settle({fresh, Dir}, Temporary) -> renamed(file:rename(Temporary, Dir), Dir);
settle({existing, Dir}, Temporary) -> replace_all(Temporary, Dir);
settle({numbered, Parent, Name}, Temporary) -> number(next(Parent, Name), Parent, Name, Temporary).

renamed(ok, Dir) -> {ok, Dir};
renamed({error, _} = Error, _Dir) -> Error.

%% @doc The plan for the results of a run that was changed after its end: they take the place of the first ones.
-spec again(t()) -> t().
again({fresh, Dir}) -> {existing, Dir};
again(Plan) -> Plan.

%% What an earlier run has left goes first: not every run has a log, or inputs.
replace_all(Temporary, Dir) ->
    {ok, Names} = file:list_dir(Temporary),
    IsRun = lists:member("run.term", Names) orelse lists:member("run.log", Names),
    _ = [file:del_dir_r(filename:join(Dir, Name)) || IsRun, Name <- ?OF_A_RUN],
    move_all(Names, Temporary, Dir).

move_all(Names, Temporary, Dir) ->
    Moves = [file:rename(filename:join(Temporary, N), filename:join(Dir, N)) || N <- Names],
    case [Error || {error, _} = Error <- Moves] of
        [] -> renamed(file:del_dir(Temporary), Dir);
        [Error | _] -> Error
    end.

next(Parent, Name) ->
    Taken = [
        element(1, string:to_integer(lists:nthtail(length(Name) + 1, filename:basename(Dir))))
     || Dir <- filelib:wildcard(Name ++ "-[0-9]*", Parent)
    ],
    1 + lists:max([0 | [N || N <- Taken, is_integer(N)]]).

%% Another run may take the same number at the same time.
number(N, Parent, Name, Temporary) ->
    Dir = filename:join(Parent, Name ++ "-" ++ integer_to_list(N)),
    case filelib:is_file(Dir) orelse file:rename(Temporary, Dir) of
        ok ->
            {ok, Dir};
        true ->
            number(N + 1, Parent, Name, Temporary);
        {error, Taken} when Taken =:= eexist; Taken =:= enotempty ->
            number(N + 1, Parent, Name, Temporary);
        {error, _} = Error ->
            Error
    end.

%% @doc Ends the command with one line if a result could not be written.
-spec sure(file:filename(), ok | {error, file:posix() | badarg | terminated | system_limit}) -> ok.
sure(_File, ok) -> ok;
sure(File, {error, Posix}) -> throw({unwritable, File, Posix}).

%% @doc A path as the user would write it: relative if it lies below the working directory.
-spec shown(string()) -> string().
shown(Path) ->
    {ok, Cwd} = file:get_cwd(),
    case lists:prefix(Cwd ++ "/", Path) of
        true -> lists:nthtail(length(Cwd) + 1, Path);
        false -> Path
    end.

%% -- where a command line wants them -----------------------------------------------------------

%% @doc Checks the directory for the results; gives the problems and the plan.
-spec directory(none | file:filename(), Name :: string()) ->
    {[unicode:chardata()], t() | none}.
directory(Dir, Name) ->
    case plan(Dir, Name) of
        {ok, Plan} -> {[], Plan};
        {error, Why} -> {[["--out: ", Why]], none}
    end.

%% @doc The same for a run, which replaces the results of an earlier one only on request.
-spec directory(none | file:filename(), Name :: string(), Overwrite :: boolean()) ->
    {[unicode:chardata()], t() | none}.
directory(Dir, Name, Overwrite) ->
    case Dir =/= none andalso not Overwrite andalso holds_a_run(Dir) of
        true -> {[["--out: ", Dir, " holds an earlier run; --overwrite replaces it"]], none};
        false -> directory(Dir, Name)
    end.

%% @doc The file for a result: the one of --out, which replaces an earlier one only on request; else
%% the usual one, or one beside it if that exists.
-spec file(none | file:filename(), Usual :: file:filename(), Overwrite :: boolean()) ->
    {[unicode:chardata()], file:filename()}.
file(none, Usual, true) ->
    {[], Usual};
file(none, Usual, false) ->
    {[], free(Usual)};
file(File, _Usual, Overwrite) ->
    %% A device such as /dev/null holds nothing.
    case not Overwrite andalso filelib:is_regular(File) of
        true -> {[["--out: ", File, " is there already; --overwrite replaces it"]], File};
        false -> {[], File}
    end.

%% @doc The flag that allows the results of an earlier run to be replaced.
-spec overwrite() -> starl_cli_flags:flag().
overwrite() -> {overwrite, switch, false, "replaces the earlier run that --out holds"}.

%% @doc The flag that allows an earlier file to be replaced.
-spec overwrite_file() -> starl_cli_flags:flag().
overwrite_file() -> {overwrite, switch, false, "replaces an earlier file of that name"}.

%% -- the recording in it -----------------------------------------------------------------------

%% @doc The file of a recording as a user names it: a file, or the directory of a run.
-spec recording(file:filename()) -> file:filename().
recording(Path) when is_list(Path) ->
    case filelib:is_dir(Path) of
        true -> Path ++ "/" ++ ?RECORDING;
        false -> Path
    end.

%% @doc The file of a recording that is to be there; for the directory of a run without one, what a
%% user can do instead.
-spec recording(file:filename(), Instead :: unicode:chardata()) ->
    {ok, file:filename()} | {error, [unicode:chardata(), ...]}.
recording(Path, Instead) ->
    File = recording(Path),
    case filelib:is_dir(Path) andalso not filelib:is_regular(File) of
        true -> {error, [[Path, " holds no recording; ", Instead]]};
        false -> {ok, File}
    end.

%% @doc The same as the subject of a command, with the arguments that follow.
-spec recording(file:filename(), Instead :: unicode:chardata(), Args) ->
    {ok, file:filename(), Args} | {error, [unicode:chardata(), ...]}
when
    Args :: [string()].
recording(Path, Instead, Args) ->
    case recording(Path, Instead) of
        {ok, File} -> {ok, File, Args};
        {error, _} = Error -> Error
    end.
