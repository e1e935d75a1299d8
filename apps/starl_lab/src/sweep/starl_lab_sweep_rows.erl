%% @doc The file `runs.csv' of a sweep. It has one row per run: the settings and the seed, which
%% identify the run, then the status, all figures of the report, and the measures over time. Rows are appended as runs
%% finish, so an interrupted sweep can continue.
-module(starl_lab_sweep_rows).

-export([columns/3, header/1, settings/1, key/4, row/3, status/2, figure/3, numbers/1]).
-export([curve/3]).
-export([read/2, open/3, append/2, close/1, ordered/3, format_error/1]).

-export_type([columns/0, key/0, row/0, rows/0, status/0, reason/0]).

%% The longest file of rows.
-define(MOST_BYTES, (1 bsl 30)).

%% `key': the names of the columns that identify a run; `figures': those of the report's figures and
%% the type of each; `measures': those of which there is a curve. The status stands after the key.
-record(columns, {
    key :: [string()],
    figures :: [{atom(), number | text}],
    measures :: [atom()]
}).

-opaque columns() :: #columns{}.

%% The cells that identify a run: application, settings, seed.
-type key() :: [string(), ...].
-type row() :: [string(), ...].
-type rows() :: #{key() => row()}.

%% `incomplete': the run ended before the work was complete; `unjudged': a part of it has no verdict;
%% `failed': the simulation failed.
-type status() :: complete | incomplete | violation | unjudged | failed.

-type reason() ::
    {columns, file:filename(), Lacking :: [string()], Besides :: [string()]}
    | {order, file:filename()}
    | {row, file:filename(), Line :: pos_integer()}
    | {file, file:filename(), file:posix() | badarg | terminated | system_limit}.

%% @doc The columns for a grid and for an application with the figures of a report. The wall time is
%% none of them: it alone differs between equal runs, so a sweep in slices would differ from the same
%% sweep in one piece.
-spec columns(starl_lab_sweep_grid:t(), starl_lab_report:t(), Measures :: [atom()]) -> columns().
columns(Grid, Report, Measures) ->
    Settings = [Key || {Key, _, _} <- starl_lab_sweep_grid:settings(Grid)],
    Known = [app, seed, contracts, waiting, wall_s | Settings],
    #columns{
        key = [atom_to_list(Key) || Key <- [app | Settings] ++ [seed]],
        figures = [
            {Key, kind(Value)}
         || {Key, Value} <- starl_lab_report:figures(Report), not lists:member(Key, Known)
        ],
        measures = Measures
    }.

%% Violations are counted.
kind(Value) when is_binary(Value); is_boolean(Value) -> text;
kind(_) -> number.

%% @doc The names of all columns.
-spec header(columns()) -> [string(), ...].
header(#columns{key = Key, figures = Figures, measures = Measures}) ->
    Key ++ ["status" | [atom_to_list(Figure) || {Figure, _} <- Figures]] ++
        [over_time(Measure) || Measure <- Measures].

over_time(Measure) -> atom_to_list(Measure) ++ "_over_time".

%% @doc The names of the columns of the application and the settings, without the seed.
-spec settings(columns()) -> [string()].
settings(#columns{key = Key}) -> lists:droplast(Key).

%% @doc The cells that identify a run.
-spec key(App :: string(), starl_lab_sweep_grid:t(), starl_run_scenario:t(), Seed) -> key() when
    Seed :: non_neg_integer().
key(App, Grid, Scenario, Seed) ->
    [App | starl_lab_sweep_grid:cells(Grid, Scenario)] ++ [integer_to_list(Seed)].

%% @doc A run as a row, with the curves of its measures as texts.
-spec row(columns(), key(), {ok, starl_lab_report:t(), #{atom() => string()}} | failed) -> row().
row(#columns{figures = Figures, measures = Measures}, Key, failed) ->
    Key ++ ["failed" | ["" || _ <- Figures ++ Measures]];
row(#columns{figures = Figures, measures = Measures}, Key, {ok, Report, Curves}) ->
    Cells = [cell(starl_lab_report:figure(Figure, Report)) || {Figure, _} <- Figures],
    Key ++ [atom_to_list(judged(Report)) | Cells] ++ [maps:get(M, Curves, "") || M <- Measures].

judged(Report) ->
    case {starl_lab_report:figure(violations, Report), starl_lab_report:judged(Report)} of
        {[_ | _], _} -> violation;
        {[], false} -> unjudged;
        {[], true} -> completed(starl_lab_report:complete(Report))
    end.

completed(true) -> complete;
completed(false) -> incomplete.

cell(null) -> "";
cell(Text) when is_binary(Text) -> unicode:characters_to_list(Text);
cell(Violations) when is_list(Violations) -> integer_to_list(length(Violations));
cell(Value) when is_float(Value) -> binary_to_list(iolist_to_binary(starl_json:encode(Value)));
cell(Value) -> lists:flatten(io_lib:format("~w", [Value])).

%% @doc The status of a run.
-spec status(columns(), row()) -> status().
status(#columns{key = Key}, Row) ->
    case lists:nth(length(Key) + 1, Row) of
        "complete" -> complete;
        "incomplete" -> incomplete;
        "violation" -> violation;
        "unjudged" -> unjudged;
        _ -> failed
    end.

%% @doc A figure of a run, if it is a number.
-spec figure(columns(), atom(), row()) -> {ok, number()} | none.
figure(Columns, Figure, Row) ->
    Texts = maps:from_list(lists:zip(header(Columns), Row)),
    case starl_options:parse({number, -1.0e300, 1.0e300}, maps:get(atom_to_list(Figure), Texts)) of
        {ok, Number} -> {ok, Number};
        error -> none
    end.

%% @doc The figures that are numbers.
-spec numbers(columns()) -> [atom()].
numbers(#columns{figures = Figures}) -> [Figure || {Figure, number} <- Figures].

%% @doc The curve of a measure in a run, if it has one.
-spec curve(columns(), atom(), row()) -> {ok, starl_lab_sweep_curve:t()} | none.
curve(Columns, Measure, Row) ->
    Texts = maps:from_list(lists:zip(header(Columns), Row)),
    starl_lab_sweep_curve:parse(maps:get(over_time(Measure), Texts)).

%% -- the file -------------------------------------------------------------------------------

%% @doc The rows of earlier runs, none without a file, and the length of the complete lines in
%% bytes.
-spec read(file:filename(), columns()) ->
    {ok, rows(), Bytes :: non_neg_integer()} | {error, reason()}.
read(File, Columns) ->
    case starl_small_file:read(File, ?MOST_BYTES) of
        {ok, Text} ->
            {Lines, Bytes} = starl_lab_csv:parse(Text),
            known(Lines, Bytes, File, Columns);
        {error, enoent} ->
            {ok, #{}, 0};
        {error, Posix} ->
            {error, {file, File, Posix}}
    end.

known([], Bytes, _File, _Columns) ->
    {ok, #{}, Bytes};
known([Found | Rows], Bytes, File, #columns{key = Key} = Columns) ->
    Header = header(Columns),
    case {Found, Header -- Found, Found -- Header} of
        {Header, [], []} -> keyed(Rows, length(Key), length(Header), Bytes, File);
        {_, [], []} -> {error, {order, File}};
        {_, Lacking, Besides} -> {error, {columns, File, Lacking, Besides}}
    end.

keyed(Rows, KeyLength, Length, Bytes, File) ->
    case lists:splitwith(fun(Row) -> length(Row) =:= Length end, Rows) of
        {_, []} ->
            {ok, maps:from_list([{lists:sublist(Row, KeyLength), Row} || Row <- Rows]), Bytes};
        {Sound, _} ->
            {error, {row, File, length(Sound) + 2}}
    end.

%% @doc Opens the file to append rows; an incomplete last line is cut off.
-spec open(file:filename(), columns(), Bytes :: non_neg_integer()) ->
    {ok, file:io_device()} | {error, reason()}.
open(File, Columns, Bytes) ->
    _ = filelib:ensure_dir(File),
    case file:open(File, [read, write, raw, binary]) of
        {ok, Device} ->
            {ok, Bytes} = file:position(Device, Bytes),
            ok = file:truncate(Device),
            ok = begin_with(header(Columns), Device, Bytes),
            {ok, Device};
        {error, Posix} ->
            {error, {file, File, Posix}}
    end.

begin_with(Header, Device, 0) -> append(Device, Header);
begin_with(_Header, _Device, _Bytes) -> ok.

%% @doc Appends a row, which is in the file when this call returns.
-spec append(file:io_device(), row()) -> ok.
append(Device, Row) ->
    Line = unicode:characters_to_binary(starl_lab_csv:line(Row)),
    starl_cli_out:sure("runs.csv", file:write(Device, Line)).

%% @doc Closes the file.
-spec close(file:io_device()) -> ok.
close(Device) -> ok = file:close(Device).

%% @doc The text of the file in the order of these keys; other rows follow in their own order.
-spec ordered(columns(), [key()], rows()) -> unicode:chardata().
ordered(Columns, Keys, Rows) ->
    Others = lists:sort(maps:values(maps:without(Keys, Rows))),
    Lines = [maps:get(Key, Rows) || Key <- Keys, is_map_key(Key, Rows)],
    [starl_lab_csv:line(Line) || Line <- [header(Columns) | Lines ++ Others]].

%% @doc One line that states the problem and the remedy.
-spec format_error(reason()) -> unicode:chardata().
format_error({columns, File, Lacking, Besides}) ->
    [
        File,
        " is of another sweep: ",
        lists:join(
            " and ",
            [listed("it lacks ", Lacking) || Lacking =/= []] ++
                [listed("it has ", Besides) || Besides =/= []]
        ),
        "; name another directory with --out"
    ];
format_error({order, File}) ->
    [File, " has its columns in another order; name another directory with --out"];
format_error({row, File, Line}) ->
    io_lib:format("~ts:~b: not as many cells as the header has; mend or delete this line", [
        File, Line
    ]);
format_error({file, File, Posix}) ->
    [File, ": ", file:format_error(Posix)].

listed(Words, Columns) -> [Words, lists:join(", ", Columns)].
