%% @doc A sweep in several directories: joins the results of its slices. Each slice appends to its
%% own file of rows, `slice-K-of-N.csv'. A file beside it, `slice-K-of-N.term', notes the sweep and
%% the code of its runs. So slices may share a directory, on one computer or on several. Runs of
%% different code are not one study.
-module(starl_lab_sweep_study).

-export([begin_slice/4, note/2, plain/1, noted/1, is_ours/1, rows/2, parts/1, format_error/1]).

-export_type([note/0, reason/0]).

%% The arguments without those that change no run; the version; the code, where the note has it.
-type note() :: #{sweep := [string()], starl := string(), code := starl_build:code()}.

-type reason() ::
    {none, file:filename()}
    | {unreadable, file:filename()}
    | {unwritable, file:filename(), file:posix() | badarg | terminated | system_limit}
    | {other, file:filename(), file:filename()}
    | {version, file:filename(), string()}
    | {code, file:filename(), Rows :: string(), starl_build:code()}
    | {codes, [{file:filename(), starl_build:code()}, ...], starl_build:code()}
    | starl_lab_sweep_rows:reason().

-define(UNKNOWN, "unknown").

file(Dir, whole) -> filename:join(Dir, "runs.csv");
file(Dir, {K, N}) -> filename:join(Dir, lists:concat(["slice-", K, "-of-", N, ".csv"])).

note_of(File) -> filename:rootname(File) ++ ".term".

%% @doc Notes of which sweep and code a slice is; gives its file, the rows that are there already, which
%% must be of the same code, and the length of their lines.
-spec begin_slice(file:filename(), starl_lab_slice:t(), starl_lab_sweep_rows:columns(), What) ->
    {ok, {file:filename(), starl_lab_sweep_rows:rows(), Bytes :: non_neg_integer()}}
    | {error, reason()}
when
    What :: {Args :: [string()], starl_build:code()}.
begin_slice(Dir, Slice, Columns, {Args, Code}) ->
    File = file(Dir, Slice),
    case {starl_lab_sweep_rows:read(File, Columns), code_of(File)} of
        {{ok, Rows, _Bytes}, Other} when map_size(Rows) > 0, Other =/= Code ->
            {error, {code, File, Other, Code}};
        {{ok, Rows, Bytes}, _} ->
            begun(write(note_of(File), note(Args, Code)), {File, Rows, Bytes});
        {{error, _} = Error, _} ->
            Error
    end.

begun(ok, Known) -> {ok, Known};
begun({error, _} = Error, _Known) -> Error.

code_of(File) ->
    case read(note_of(File)) of
        {ok, #{code := Code}} -> Code;
        {error, _} -> ?UNKNOWN
    end.

%% @doc The text of the note.
-spec note([string()], starl_build:code()) -> unicode:chardata().
note(Args, Code) ->
    Sweep = plain(Args),
    Mark = [{made_here, M} || M <- [starl_cli_made_here:mark(signed(Sweep))], M =/= none],
    Note = maps:from_list([{sweep, Sweep}, {starl, version()}, {code, Code} | Mark]),
    io_lib:format("%% Of which sweep and code the rows beside this file are.~n~tp.~n", [Note]).

signed(Args) -> term_to_binary({starl_sweep, Args}).

%% @doc Has this user, on this computer, begun a slice of the sweep in these directories?
-spec is_ours([file:filename(), ...]) -> boolean().
is_ours(Dirs) ->
    lists:any(
        fun(File) ->
            case starl_terms:consult(File) of
                {ok, [#{sweep := Args, made_here := Mark}]} ->
                    starl_cli_made_here:is_marked(signed(Args), Mark);
                _ ->
                    false
            end
        end,
        lists:append([files("{runs,slice-*-of-*}.term", Dir) || Dir <- Dirs])
    ).

%% Another computer may write it at the same time: a whole file takes the place of another.
write(File, Text) ->
    New = File ++ "." ++ os:getpid(),
    _ = filelib:ensure_dir(File),
    case {file:write_file(New, unicode:characters_to_binary(Text)), file:rename(New, File)} of
        {ok, ok} -> ok;
        {{error, Posix}, _} -> {error, {unwritable, File, Posix}};
        {ok, {error, Posix}} -> {error, {unwritable, File, Posix}}
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

%% @doc The arguments of the sweep that all these directories are of, and the code of its runs.
-spec noted([file:filename(), ...]) -> {ok, [string()], starl_build:code()} | {error, reason()}.
noted(Dirs) ->
    Found = [{Dir, files("slice-*-of-*.csv", Dir)} || Dir <- Dirs],
    Whole = lists:append([files("runs.csv", Dir) || Dir <- Dirs]),
    Notes = [{F, read(note_of(F))} || F <- lists:append([Fs || {_, Fs} <- Found]) ++ Whole],
    Wrong = [{none, Dir} || {Dir, []} <- Found] ++ [Reason || {_, {error, Reason}} <- Notes],
    case {Wrong, Notes} of
        {[Reason | _], _} ->
            {error, Reason};
        {[], [{First, {ok, Note}} | Others]} ->
            same(Note, First, [{F, N} || {F, {ok, N}} <- Others])
    end.

files(Names, Dir) -> filelib:wildcard(filename:join(Dir, Names)).

same(#{sweep := Args, code := Code}, First, Others) ->
    case [File || {File, #{sweep := Other}} <- Others, Other =/= Args] of
        [] -> one_code([{First, Code} | [{File, C} || {File, #{code := C}} <- Others]], Args);
        [File | _] -> {error, {other, filename:dirname(File), filename:dirname(First)}}
    end.

%% What most slices have is what the others lack.
one_code(Files, Args) ->
    Codes = [Code || {_, Code} <- Files],
    Count = fun(Code) -> length([x || C <- Codes, C =:= Code]) end,
    {_, Most} = lists:max([{Count(Code), Code} || Code <- Codes]),
    case [Other || {_, Code} = Other <- Files, Code =/= Most] of
        [] -> {ok, Args, Most};
        Others -> {error, {codes, Others, Most}}
    end.

read(File) ->
    case starl_terms:consult(File) of
        {ok, [#{sweep := [_ | _] = Args, starl := Version} = Note]} ->
            case lists:all(fun io_lib:printable_unicode_list/1, Args) andalso version() of
                false ->
                    {error, {unreadable, File}};
                Version ->
                    {ok, #{
                        sweep => Args, starl => Version, code => maps:get(code, Note, ?UNKNOWN)
                    }};
                _ ->
                    {error, {version, File, Version}}
            end;
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
format_error({unwritable, File, Posix}) ->
    [File, ": ", file:format_error(Posix)];
format_error({code, File, Other, Code}) ->
    Line =
        "~ts: its runs are of other code, ~ts, this is ~ts; name another directory with --out, or remove this file",
    io_lib:format(Line, [File, Other, Code]);
format_error({codes, Others, Most}) ->
    Line = "~ts; the other slices are of ~ts: remove it and run its slice again with that",
    Named = lists:join(", ", [[File, " is of other code, ", Code] || {File, Code} <- Others]),
    io_lib:format(Line, [Named, Most]);
format_error({other, Dir, First}) ->
    [Dir, ": this is of another sweep than ", First, "; join them apart"];
format_error({version, File, Version}) ->
    Line = "~ts: its runs are of StarL ~ts, this is ~ts; join them with that one",
    io_lib:format(Line, [File, Version, version()]);
format_error(Reason) ->
    starl_lab_sweep_rows:format_error(Reason).
