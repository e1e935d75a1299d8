%% @doc Judges the runs of the acceptance table and formats the results: rows for the terminal,
%% lines of CSV.
-module(starl_dev_table_rows).

-export([sound/1, wrong/1, header/1, line/2, figures/1, csv_header/0, csv/3]).

-export_type([result/0, cell/0]).

%% The results of a run; `separation' is `none' for a single robot.
-type result() ::
    #{
        covered := float(),
        violations := non_neg_integer(),
        separation := float() | none,
        safe := number(),
        makespan := float(),
        ratio := float(),
        detour := float(),
        deadlocks := non_neg_integer(),
        wall := float(),
        digest := binary()
    }
    | failed.

%% The setting of a row.
-type cell() :: {Picture :: string(), Robots :: pos_integer(), Loss :: number()}.
-define(COLUMNS, [
    {"picture", 14},
    {"robots", 6},
    {"loss", 4},
    {"painted", 9},
    {"broken", 6},
    {"mm apart", 8},
    {"time s", 7},
    {"x bound", 7},
    {"x ink", 5},
    {"stuck", 5}
]).

%% @doc Whether a run is acceptable: all lines painted, no robots too close, no contract violated.
-spec sound(result()) -> boolean().
sound(failed) ->
    false;
sound(#{covered := Covered, violations := Violations, separation := Separation, safe := Safe}) ->
    Covered >= 1.0 andalso Violations =:= 0 andalso
        (Separation =:= none orelse Separation >= Safe).

%% @doc The defects of an unacceptable run.
-spec wrong(result()) -> unicode:chardata().
wrong(failed) -> "the simulation failed";
wrong(#{violations := N}) when N > 0 -> "a contract was violated";
wrong(#{covered := Covered}) when Covered < 1.0 -> [percent(Covered), " painted"];
wrong(#{separation := Mm}) -> ["separation ", decimals(1, Mm), " mm"].

%% -- rows -----------------------------------------------------------------------------------

%% @doc The header: what the columns are, and their names.
-spec header(Seeds :: pos_integer()) -> unicode:chardata().
header(Seeds) ->
    [
        io_lib:format("seeds 1 to ~b in each row\n", [Seeds]),
        "painted, mm apart: the least; broken: contracts; stuck: deadlocks resolved;\n"
        "time s, x bound (time), x ink (driven length): medians\n",
        padded([Name || {Name, _} <- ?COLUMNS]),
        "\n"
    ].

%% @doc A row: its setting and the figures of its runs.
-spec line(cell(), [result(), ...]) -> unicode:chardata().
line(Cell, Results) -> [padded(cells(Cell, Results)), "\n"].

cells({Picture, Robots, Loss}, Results) ->
    [
        filename:rootname(filename:basename(Picture)),
        integer_to_list(Robots),
        starl_cli_flags:text({number, 0, 1}, Loss)
        | figures(Results)
    ].

%% @doc The figures of a row: least painted fraction, violations, least separation; the medians of
%% time, of its ratio to the bound, and of the ratio of driven length to ink; deadlocks.
-spec figures([result()]) -> [unicode:chardata()].
figures(Results) ->
    case [R || #{} = R <- Results] of
        Known when length(Known) =:= length(Results) ->
            [
                percent(lists:min(all(covered, Known))),
                integer_to_list(lists:sum(all(violations, Known))),
                least([S || S <- all(separation, Known), S =/= none]),
                decimals(1, median(all(makespan, Known))),
                decimals(2, median(all(ratio, Known))),
                decimals(2, median(all(detour, Known))),
                integer_to_list(lists:sum(all(deadlocks, Known)))
            ];
        Known ->
            Failed = integer_to_list(length(Results) - length(Known)),
            [Failed ++ " failed" | lists:duplicate(6, "-")]
    end.

all(Key, Results) -> [maps:get(Key, R) || R <- Results].

median(Values) -> lists:nth((length(Values) + 1) div 2, lists:sort(Values)).

least([]) -> "-";
least(Separations) -> decimals(1, floor(lists:min(Separations) * 10) / 10).

%% Rounded down: 99.99 % must not read 100 %.
percent(Covered) when Covered >= 1.0 -> "100 %";
percent(Covered) -> [decimals(2, floor(Covered * 10000) / 100), " %"].

decimals(N, X) -> float_to_list(float(X), [{decimals, N}]).

padded(Cells) ->
    [First | Others] = [
        {string:slice(Cell, 0, Width), Width}
     || {Cell, {_, Width}} <- lists:zip(Cells, ?COLUMNS)
    ],
    [pad(First, trailing) | [[" ", pad(Cell, leading)] || Cell <- Others]].

pad({Text, Width}, Side) -> string:pad(Text, Width, Side).

%% @doc The first line of CSV.
-spec csv_header() -> string().
csv_header() ->
    "picture,robots,loss,seed,ink_covered,violations,min_separation_mm,makespan_s,"
    "makespan_bound_ratio,driven_ink_ratio,deadlocks_resolved,wall_s,digest\n".

%% @doc A run as a line of CSV.
-spec csv(cell(), Seed :: integer(), result()) -> unicode:chardata().
csv({Picture, Robots, Loss}, Seed, Result) ->
    Keys = [covered, violations, separation, makespan, ratio, detour, deadlocks, wall, digest],
    Values = [csv_value(Key, Result) || Key <- Keys],
    Line = [["\"", Picture, "\""], text(Robots), text(Loss), text(Seed) | Values],
    [lists:join(",", Line), "\n"].

csv_value(_Key, failed) -> "failed";
csv_value(Key, Result) -> text(maps:get(Key, Result)).

text(none) -> "";
text(Text) when is_binary(Text) -> Text;
text(X) when is_float(X) -> io_lib:format("~w", [X]);
text(X) -> integer_to_list(X).
