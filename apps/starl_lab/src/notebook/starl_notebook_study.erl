%% @doc Runs a small study in a notebook: one run, and one row, for each combination of values. It
%% also shows the rows as a table and a plot. Use `./starl sweep' for studies of many runs: it can
%% be stopped, sliced and joined.
-module(starl_notebook_study).

-export([rows/2, median/1, markdown/1, svg/4]).

%% Values of measures that a run keeps.
-define(MOST, 100000).

%% @doc A row for each combination: the varied values, `complete' (are all applications done?),
%% `seconds' of virtual time, the number of `violations', and the median of each measure.
-spec rows(#{app := module(), atom() => term()}, #{atom() => [term(), ...]}) ->
    [starl_notebook:row(), ...].
rows(Scenario, Varied) ->
    Points = points(lists:sort(maps:to_list(Varied))),
    Chunk = erlang:system_info(schedulers_online),
    chunks(Points, Chunk, fun(Point) -> maps:merge(Point, ran(maps:merge(Scenario, Point))) end).

points([]) -> [#{}];
points([{Key, Values} | Others]) -> [P#{Key => V} || V <- Values, P <- points(Others)].

%% As many at a time as there are cores; in order.
chunks([], _N, _Run) ->
    [];
chunks(Points, N, Run) ->
    {Now, Later} = lists:split(min(N, length(Points)), Points),
    Tags = [begun(Point, Run) || Point <- Now],
    [ended(Tag) || Tag <- Tags] ++ chunks(Later, N, Run).

begun(Point, Run) ->
    Caller = self(),
    spawn_monitor(fun() -> Caller ! {self(), Run(Point)} end).

ended({Pid, Ref}) ->
    receive
        {Pid, Row} ->
            true = erlang:demonitor(Ref, [flush]),
            Row;
        {'DOWN', Ref, process, Pid, {{starl_notebook, Line}, _}} ->
            error({starl_notebook, Line});
        {'DOWN', Ref, process, Pid, Reason} ->
            exit(Reason)
    end.

ran(Scenario) ->
    Watch = [{starl_run_measures_monitor, #{most => ?MOST}}],
    case starl_sim_trial:run(Scenario, fun(_Sim) -> ok end, Watch) of
        {ok, #{ending := Ending, end_us := EndUs, violations := Violations, monitors := Monitors}} ->
            #{starl_run_measures_monitor := #{values := Values}} = Monitors,
            maps:merge(measured(Values), #{
                complete => Ending =:= done,
                seconds => EndUs / 1000000,
                violations => length(Violations)
            });
        {error, {start, Reason}} ->
            error({starl_notebook, unicode:characters_to_binary(starl_sim:format_error(Reason))});
        {error, Reason} ->
            exit(Reason)
    end.

measured(Values) ->
    Groups = maps:groups_from_list(
        fun({_, _, Key, _}) -> Key end, fun({_, _, _, Value}) -> Value end, Values
    ),
    maps:map(fun(_Key, Numbers) -> median(Numbers) end, Groups).

%% @doc The median; for an even number of values the mean of the two middle ones.
-spec median([number(), ...]) -> float().
median(Values) ->
    Sorted = lists:sort(Values),
    N = length(Sorted),
    (lists:nth((N + 1) div 2, Sorted) + lists:nth(N div 2 + 1, Sorted)) / 2.

%% @doc Rows as a table in Markdown; the columns are those of the first row.
-spec markdown([starl_notebook:row(), ...]) -> binary().
markdown([First | _] = Rows) ->
    Keys = lists:sort(maps:keys(First)),
    Lines = [
        [atom_to_list(Key) || Key <- Keys],
        ["---" || _ <- Keys]
        | [[cell(maps:get(Key, Row, "")) || Key <- Keys] || Row <- Rows]
    ],
    binary([["| ", lists:join(" | ", Line), " |\n"] || Line <- Lines]).

binary(Text) -> <<_/binary>> = unicode:characters_to_binary(Text).

cell(Value) when is_float(Value) -> float_to_list(Value, [{decimals, 3}, compact]);
cell(Value) when is_binary(Value) -> Value;
cell(Value) -> io_lib:format("~tp", [Value]).

%% @doc The plot of `Y' over `X': medians, and what lies between the least and the greatest value; a
%% curve for each value of `Curves', or one.
-spec svg([starl_notebook:row(), ...], X, Y, Curves) -> binary() when
    X :: atom(), Y :: atom(), Curves :: atom().
svg(Rows, X, Y, Curves) ->
    Groups = maps:groups_from_list(fun(Row) -> maps:get(Curves, Row, none) end, Rows),
    Named = lists:enumerate(lists:sort(maps:to_list(Groups))),
    Drawn = [
        #{
            name => [atom_to_list(Curves), " ", cell(Value)],
            colour => N,
            points => [{At, Median} || {At, Median, _, _} <- Ranges],
            range => [{At, Least, Most} || {At, _, Least, Most} <- Ranges]
        }
     || {N, {Value, Own}} <- Named, Ranges <- [ranges(X, Y, Own)], Ranges =/= []
    ],
    Panel = #{
        title => io_lib:format("~ts over ~ts: median and range", [Y, X]),
        curves => Drawn,
        legend => Curves =/= none
    },
    binary(starl_picture_plot:svg("", [Panel])).

ranges(X, Y, Rows) ->
    Groups = maps:groups_from_list(
        fun(Row) -> maps:get(X, Row) end,
        fun(Row) -> maps:get(Y, Row) end,
        [Row || #{Y := Value} = Row <- Rows, is_number(Value)]
    ),
    [
        {At, median(Values), lists:min(Values), lists:max(Values)}
     || {At, Values} <- lists:sort(maps:to_list(Groups))
    ].
