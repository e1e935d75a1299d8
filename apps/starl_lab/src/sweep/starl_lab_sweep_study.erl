%% @doc A sweep in several directories: what its slices leave, so that they become one. Each slice
%% appends to a file of rows of its own, `slice-K-of-N.csv', and notes in `sweep.term' of which sweep it
%% is; so slices may share a directory, on one computer or on several.
-module(starl_lab_sweep_study).

-export([file/2, note/3, plain/1, noted/1, rows/2, parts/1, format_error/1]).

-export_type([reason/0]).

-type reason() ::
    {none, file:filename()}
    | {unreadable, file:filename()}
    | {other, file:filename(), file:filename()}
    | {version, file:filename(), string()}
    | starl_lab_sweep_rows:reason().

-define(NOTE, "sweep.term").

%% @doc The file of the rows of a slice in a directory.
-spec file(file:filename(), starl_lab_slice:t()) -> file:filename_all().
file(Dir, whole) -> filename:join(Dir, "runs.csv");
file(Dir, {K, N}) -> filename:join(Dir, lists:concat(["slice-", K, "-of-", N, ".csv"])).

%% @doc Notes of which sweep a directory is: its arguments without the flags that change no run.
-spec note(file:filename(), starl_lab_slice:t(), [string()]) -> ok | {error, unicode:chardata()}.
note(_Dir, whole, _Args) ->
    ok;
note(Dir, _Slice, Args) ->
    File = filename:join(Dir, ?NOTE),
    Note = #{sweep => plain(Args), starl => version()},
    Text = io_lib:format("%% A part of a study; ./starl join makes it whole.~n~tp.~n", [Note]),
    %% Another slice may write it at the same time: a whole file takes the place of another.
    New = File ++ "." ++ os:getpid(),
    _ = filelib:ensure_dir(File),
    case {file:write_file(New, unicode:characters_to_binary(Text)), file:rename(New, File)} of
        {ok, ok} -> ok;
        {{error, Posix}, _} -> {error, [File, ": ", file:format_error(Posix)]};
        {ok, {error, Posix}} -> {error, [File, ": ", file:format_error(Posix)]}
    end.

%% @doc The arguments of a sweep without those that change no run.
-spec plain([string()]) -> [string()].
plain([]) ->
    [];
plain([Arg | Args]) ->
    Valued = ["--slice", "--out", "--jobs", "--slurm"],
    case {lists:member(Arg, Valued), Args} of
        {true, [_Value | Others]} ->
            plain(Others);
        _ ->
            Same = lists:member(hd(string:split(Arg, "=")), ["--no-submit" | Valued]),
            [Arg || not Same] ++ plain(Args)
    end.

version() ->
    _ = application:load(starl_lab),
    {ok, Version} = application:get_key(starl_lab, vsn),
    Version.

%% @doc The arguments of the sweep that all these directories are of.
-spec noted([file:filename(), ...]) -> {ok, [string()]} | {error, reason()}.
noted(Dirs) ->
    Notes = [{Dir, read(filename:join(Dir, ?NOTE))} || Dir <- Dirs],
    case {[Reason || {_, {error, Reason}} <- Notes], Notes} of
        {[Reason | _], _} -> {error, Reason};
        {[], [{First, {ok, Args}} | Others]} -> same(Args, First, Others)
    end.

same(Args, First, Others) ->
    case [Dir || {Dir, {ok, Other}} <- Others, Other =/= Args] of
        [] -> {ok, Args};
        [Dir | _] -> {error, {other, Dir, First}}
    end.

read(File) ->
    case file:consult(File) of
        {ok, [#{sweep := [_ | _] = Args, starl := Version}]} ->
            case version() of
                Version -> {ok, Args};
                _ -> {error, {version, File, Version}}
            end;
        {error, enoent} ->
            {error, {none, filename:dirname(File)}};
        _ ->
            {error, {unreadable, File}}
    end.

%% @doc The rows of all slices in these directories, and of studies that are whole already.
-spec rows([file:filename()], starl_lab_sweep_rows:columns()) ->
    {ok, starl_lab_sweep_rows:rows()} | {error, starl_lab_sweep_rows:reason()}.
rows(Dirs, Columns) ->
    Files = [
        File
     || Dir <- Dirs, File <- filelib:wildcard(filename:join(Dir, "{runs,slice-*-of-*}.csv"))
    ],
    rows(Files, Columns, #{}).

rows([], _Columns, Rows) ->
    {ok, Rows};
rows([File | Files], Columns, Rows) ->
    case starl_lab_sweep_rows:read(File, Columns) of
        {ok, More, _Bytes} -> rows(Files, Columns, maps:merge(Rows, More));
        {error, _} = Error -> Error
    end.

%% @doc The number of slices that the study in these directories is cut into.
-spec parts([file:filename()]) -> pos_integer().
parts(Dirs) ->
    lists:max([
        list_to_integer(N)
     || Dir <- Dirs,
        File <- ["slice-1-of-1.csv" | filelib:wildcard("slice-*-of-*.csv", Dir)],
        {match, [N]} <- [re:run(File, "-of-([0-9]{1,9})[.]csv$", [{capture, all_but_first, list}])]
    ]).

%% @doc One line that states the problem and the remedy.
-spec format_error(reason()) -> unicode:chardata().
format_error({none, Dir}) ->
    [
        Dir,
        ": no slice of a sweep is here; ./starl sweep TARGET --slice K/N --out ",
        Dir,
        " makes one"
    ];
format_error({unreadable, File}) ->
    [File, ": this is not what a slice of a sweep leaves; run one of its slices again"];
format_error({other, Dir, First}) ->
    [Dir, ": this is of another sweep than ", First, "; join them apart"];
format_error({version, File, Version}) ->
    [
        File,
        ": its runs are of StarL ",
        Version,
        ", this is ",
        version(),
        "; join them with that one"
    ];
format_error(Reason) ->
    starl_lab_sweep_rows:format_error(Reason).
