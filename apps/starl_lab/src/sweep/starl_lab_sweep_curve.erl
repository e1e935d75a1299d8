%% @doc Computes measures over time in a sweep (`starl:measure/3'): for one run, and for all runs of
%% a point of the grid. A pure module.
%%
%% A run is sampled in equal steps. At each step a robot's value is the last one that it has
%% measured, until its run ends; the run's values are the median over its robots, the least and the
%% greatest. A step is 0.1 s times a power of two, so that longer steps are among the shorter ones.
%% So runs of unlike length, and slices made on several computers, fit together exactly.
-module(starl_lab_sweep_curve).

-export([measures/1, of_run/3, text/1, parse/1, merge/1]).
-export([csv/2, svg/1]).

-export_type([t/0, moment/0, named/0]).

%% Of a run: the step, and what is at each from time 0 on; `none': nothing was measured yet.
-type t() :: {StepMs :: pos_integer(), [values() | none]}.
-type values() :: {Median :: number(), Least :: number(), Most :: number()}.

%% Of several runs: `Runs' have values then.
-type moment() :: {AtMs :: non_neg_integer(), Runs :: pos_integer(), values()}.

%% The curve of a measure at a point of the grid: the point's cells, its name, the measure, its text.
-type named() :: {Cells :: [string()], Name :: string(), atom(), Text :: string(), [moment()]}.

-define(STEP_MS, 100).
%% Steps of a run, at most.
-define(MOST, 100).
%% Curves of a panel, at most.
-define(CURVES, 8).

%% @doc The measures that a scenario's application declares.
-spec measures(#{app := module(), atom() => term()}) -> [{atom(), string()}].
measures(#{app := App}) -> starl_app:measures(App).

%% @doc The curve of a measure in a run that ended then.
-spec of_run(atom(), [starl_run_measures_monitor:value()], EndUs :: integer()) -> t().
of_run(Measure, Values, EndUs) ->
    Step = step(?STEP_MS, EndUs div 1000),
    Own = [{At, Robot, Value} || {At, Robot, Key, Value} <- Values, Key =:= Measure],
    {Step, held([T * 1000 || T <- lists:seq(0, EndUs div 1000, Step)], Own, #{})}.

step(Ms, EndMs) when EndMs div Ms >= ?MOST -> step(2 * Ms, EndMs);
step(Ms, _EndMs) -> Ms.

held([], _Values, _Held) ->
    [];
held([T | Times], Values, Held) ->
    {Before, Later} = lists:splitwith(fun({At, _, _}) -> At =< T end, Values),
    Now = lists:foldl(fun({_, Robot, Value}, H) -> H#{Robot => Value} end, Held, Before),
    [values(lists:sort(maps:values(Now))) | held(Times, Later, Now)].

values([]) -> none;
values(Sorted) -> {median(Sorted), hd(Sorted), lists:last(Sorted)}.

%% As the summary's, which is built on this module.
median(Sorted) ->
    N = length(Sorted),
    case N rem 2 of
        1 -> lists:nth(N div 2 + 1, Sorted);
        0 -> (lists:nth(N div 2, Sorted) + lists:nth(N div 2 + 1, Sorted)) / 2
    end.

%% @doc A curve as the cell of a table: the step in seconds, and at each `MEDIAN/LEAST/MOST' or `-'.
-spec text(t()) -> string().
text({Step, Values}) ->
    Words = [number(Step / 1000) | [lists:join("/", cells(V)) || V <- Values]],
    lists:flatten(lists:join(" ", Words)).

cells(none) -> ["-"];
cells({Median, Least, Most}) -> [number(N) || N <- [Median, Least, Most]].

number(N) when is_integer(N) -> integer_to_list(N);
number(N) when abs(N) >= 0.01, abs(N) < 1.0e15 -> float_to_list(N, [{decimals, 4}, compact]);
number(N) -> lists:flatten(io_lib:format("~w", [N])).

%% @doc The curve in a cell; `none' where there is none.
-spec parse(string()) -> {ok, t()} | none.
parse(Cell) ->
    try
        [Step | Values] = string:lexemes(Cell, " "),
        {ok, {round(1000 * read(Step)), [known(string:lexemes(V, "/")) || V <- Values]}}
    catch
        error:_ -> none
    end.

known(["-"]) -> none;
known([_, _, _] = Texts) -> list_to_tuple([read(Text) || Text <- Texts]).

read(Text) ->
    case string:to_float(Text) of
        {Float, ""} -> Float;
        _ -> list_to_integer(Text)
    end.

%% @doc The curve of several runs: the median of their medians, the least and the greatest value of all.
-spec merge([t()]) -> [moment()].
merge([]) ->
    [];
merge(Curves) ->
    Step = lists:max([Step || {Step, _} <- Curves]),
    at(0, Step, [thinned(Step div Own, Values) || {Own, Values} <- Curves]).

thinned(1, Values) -> Values;
thinned(Every, Values) -> [V || {N, V} <- lists:enumerate(0, Values), N rem Every =:= 0].

at(Ms, Step, Curves) ->
    case [Curve || [_ | _] = Curve <- Curves] of
        [] ->
            [];
        Left ->
            Known = [V || [V | _] <- Left, V =/= none],
            [{Ms, length(Known), over(Known)} || Known =/= []] ++
                at(Ms + Step, Step, [Rest || [_ | Rest] <- Left])
    end.

over(Known) ->
    {
        median(lists:sort([Median || {Median, _, _} <- Known])),
        lists:min([Least || {_, Least, _} <- Known]),
        lists:max([Most || {_, _, Most} <- Known])
    }.

%% @doc The table of curves; `Settings' name the cells.
-spec csv(Settings :: [string()], [named()]) -> unicode:chardata().
csv(Settings, Curves) ->
    Header = Settings ++ ["measure", "time_s", "runs", "median", "least", "most"],
    [
        starl_lab_csv:line(Line)
     || Line <- [
            Header
            | [
                Cells ++
                    [atom_to_list(Measure), number(Ms / 1000), integer_to_list(Runs)] ++
                    cells(Values)
             || {Cells, _, Measure, _, Moments} <- Curves, {Ms, Runs, Values} <- Moments
            ]
        ]
    ].

%% @doc The plot: a panel for each measure, a curve for each point of the grid, or for some of them.
-spec svg([named(), ...]) -> iolist().
svg(Curves) ->
    Measures = lists:uniq([{Measure, Text} || {_, _, Measure, Text, [_ | _]} <- Curves]),
    starl_picture_plot:svg(" s", [
        panel(Text, [{Name, Moments} || {_, Name, M, _, [_ | _] = Moments} <- Curves, M =:= Measure])
     || {Measure, Text} <- Measures
    ]).

panel(Text, All) ->
    Shown = some(length(All), All),
    #{
        title => [Text, shown(length(Shown), length(All))],
        legend => true,
        curves => [
            #{
                name => Name,
                colour => N,
                points => [{Ms / 1000, Median} || {Ms, _, {Median, _, _}} <- Moments],
                range => [{Ms / 1000, Least, Most} || {Ms, _, {_, Least, Most}} <- Moments]
            }
         || {N, {Name, Moments}} <- lists:enumerate(Shown)
        ]
    }.

shown(All, All) -> ": median and range";
shown(Some, All) -> io_lib:format(": median and range, ~b of ~b curves", [Some, All]).

%% The first, the last, and those evenly between.
some(All, Curves) when All =< ?CURVES ->
    Curves;
some(All, Curves) ->
    [lists:nth(1 + N * (All - 1) div (?CURVES - 1), Curves) || N <- lists:seq(0, ?CURVES - 1)].
