%% @doc Summarizes a sweep: for each point of its grid the median, the minimum and the maximum of
%% every figure over the seeds.
%%
%% Runs that violated a contract or failed are counted but not measured, because they stopped before
%% their end.
-module(starl_lab_sweep_summary).

-export([summarize/3, curve/3, csv/2, range/2, median/1]).

-export_type([t/0, range/0]).

%% A point: its settings as texts, the numbers of its runs and complete runs, and the ranges.
-type t() :: #{
    cells := [string()],
    runs := non_neg_integer(),
    complete := non_neg_integer(),
    ranges := #{Figure :: atom() => range()}
}.

%% `none': no run has the figure, such as the separation of a single robot.
-type range() :: {Median :: number(), Min :: number(), Max :: number()} | none.

%% @doc Summarizes the runs of a point.
-spec summarize(starl_lab_sweep_rows:columns(), Cells, [starl_lab_sweep_rows:row()]) -> t() when
    Cells :: [string()].
summarize(Columns, Cells, Rows) ->
    Measured = measured(Columns, Rows),
    #{
        cells => Cells,
        runs => length(Rows),
        complete => length([
            Row
         || Row <- Measured, starl_lab_sweep_rows:status(Columns, Row) =:= complete
        ]),
        ranges => maps:from_list([
            {Figure, range_of(Columns, Figure, Measured)}
         || Figure <- starl_lab_sweep_rows:numbers(Columns)
        ])
    }.

measured(Columns, Rows) ->
    [
        Row
     || Row <- Rows,
        How <- [starl_lab_sweep_rows:status(Columns, Row)],
        How =:= complete orelse How =:= incomplete
    ].

%% @doc A measure over time in the runs of a point.
-spec curve(starl_lab_sweep_rows:columns(), atom(), [starl_lab_sweep_rows:row()]) ->
    [starl_lab_sweep_curve:moment()].
curve(Columns, Measure, Rows) ->
    starl_lab_sweep_curve:merge([
        Curve
     || Row <- measured(Columns, Rows),
        {ok, Curve} <- [starl_lab_sweep_rows:curve(Columns, Measure, Row)]
    ]).

range_of(Columns, Figure, Rows) ->
    Found = [starl_lab_sweep_rows:figure(Columns, Figure, Row) || Row <- Rows],
    case [Number || {ok, Number} <- Found] of
        [] -> none;
        Numbers -> {median(Numbers), lists:min(Numbers), lists:max(Numbers)}
    end.

%% @doc The range of one figure.
-spec range(atom(), t()) -> range().
range(Figure, #{ranges := Ranges}) -> maps:get(Figure, Ranges).

%% @doc The median; for an even number of values the mean of the two middle ones.
-spec median([number(), ...]) -> number().
median(Values) ->
    Sorted = lists:sort(Values),
    N = length(Sorted),
    case N rem 2 of
        1 -> lists:nth(N div 2 + 1, Sorted);
        0 -> (lists:nth(N div 2, Sorted) + lists:nth(N div 2 + 1, Sorted)) / 2
    end.

%% @doc The text of `summary.csv'. The application is the first of the settings' columns.
-spec csv(starl_lab_sweep_rows:columns(), [t()]) -> unicode:chardata().
csv(Columns, Points) ->
    Figures = starl_lab_sweep_rows:numbers(Columns),
    Settings = starl_lab_sweep_rows:settings(Columns),
    Three = [[atom_to_list(F) ++ End || End <- ["_median", "_min", "_max"]] || F <- Figures],
    Header = Settings ++ ["runs", "complete" | lists:append(Three)],
    [starl_lab_csv:line(Line) || Line <- [Header | [line(Figures, Point) || Point <- Points]]].

line(Figures, #{cells := Cells, runs := Runs, complete := Complete} = Point) ->
    Ranges = lists:append([texts(range(Figure, Point)) || Figure <- Figures]),
    Cells ++ [integer_to_list(Runs), integer_to_list(Complete) | Ranges].

texts(none) -> ["", "", ""];
texts({Median, Min, Max}) -> [io_lib:format("~w", [X]) || X <- [Median, Min, Max]].
