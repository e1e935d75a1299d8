%% @doc Shows the measures of a run as a table, as figures of the report, and as a plot over time.
%% Applications measure with `starl:measure/3'.
%%
%% Monitors measure, too, for the whole team: by the key `measured' of their results, `[{AtUs, Key,
%% Value}]'.
-module(starl_lab_measures).

-export([watch/0, figures/2, formats/1, csv/1, svg/1]).

-export_type([value/0]).

%% `team': a monitor's.
-type value() ::
    starl_run_measures_monitor:value()
    | {AtUs :: integer(), team, Key :: atom(), Value :: number()}.

%% The number of values that are kept.
-define(MOST, 200000).

%% @doc The monitor that collects the values.
-spec watch() -> {module(), map()}.
watch() -> {starl_run_measures_monitor, #{most => ?MOST}}.

%% In the order of time.
-spec values(#{module() => map()}) -> [value()].
values(Monitors) ->
    Robots = [
        V
     || #{values := Values} <- [maps:get(starl_run_measures_monitor, Monitors, #{})], V <- Values
    ],
    Team = [
        {T, team, Key, Value}
     || {_, #{measured := Measured}} <- lists:sort(maps:to_list(Monitors)),
        {T, Key, Value} <- Measured
    ],
    lists:keymerge(1, Robots, lists:keysort(1, Team)).

%% -- figures --------------------------------------------------------------------------------

%% @doc The median and the range of each measure, of all its values in the run. Those that the
%% application declares are there in any case, so that a sweep has the same columns for every run.
-spec figures(App :: module(), #{module() => map()}) -> [{atom(), number() | null}].
figures(App, Monitors) ->
    Groups = maps:groups_from_list(
        fun({_, _, Key, _}) -> Key end, fun({_, _, _, Value}) -> Value end, values(Monitors)
    ),
    Declared = [Key || {Key, _} <- starl_app:measures(App)],
    Others = lists:sort(maps:keys(Groups)) -- Declared,
    lists:append([
        figures_of(Key, lists:sort(maps:get(Key, Groups, [])))
     || Key <- Declared ++ Others
    ]) ++
        cut(Monitors).

figures_of(Key, []) ->
    named(Key, {null, null, null});
figures_of(Key, Sorted) ->
    named(Key, {median(Sorted), hd(Sorted), lists:last(Sorted)}).

named(Key, {Median, Least, Most}) ->
    [{name(Key, "_median"), Median}, {name(Key, "_least"), Least}, {name(Key, "_most"), Most}].

%% Keys are the application's own atoms, each with three names.
name(Key, End) -> list_to_atom(atom_to_list(Key) ++ End).

median(Sorted) ->
    N = length(Sorted),
    (lists:nth((N + 1) div 2, Sorted) + lists:nth(N div 2 + 1, Sorted)) / 2.

cut(#{starl_run_measures_monitor := #{is_whole := false, until_us := Until}}) ->
    [{measures_kept_until_s, Until / 1.0e6}];
cut(#{}) ->
    [].

%% @doc How the figures of the declared measures are shown: the medians are plotted by sweeps.
-spec formats(App :: module()) -> #{atom() => starl_scene:format()}.
formats(App) ->
    maps:from_list([
        {name(Key, "_median"), #{label => lists:flatten(["median of ", Text]), plotted => true}}
     || {Key, Text} <- starl_app:measures(App)
    ]).

%% -- the table ------------------------------------------------------------------------------

%% @doc The values as CSV, in the order of time; none: nothing was measured.
-spec csv(#{module() => map()}) -> [{Name :: string(), unicode:chardata()}].
csv(Monitors) ->
    case values(Monitors) of
        [] ->
            [];
        Values ->
            Rows = [
                io_lib:format("~.6f,~p,~ts,~ts\n", [T / 1.0e6, Robot, Key, number(Value)])
             || {T, Robot, Key, Value} <- Values
            ],
            [{"measures.csv", ["time_s,robot,measure,value\n" | Rows]}]
    end.

number(Value) when is_integer(Value) -> integer_to_list(Value);
number(Value) -> io_lib:format("~w", [Value]).

%% -- the plot -------------------------------------------------------------------------------

%% @doc A plot over time, a panel for each measure and a line for each robot; none: nothing was
%% measured.
-spec svg(#{module() => map()}) -> [{Name :: string(), unicode:chardata()}].
svg(Monitors) ->
    case values(Monitors) of
        [] -> [];
        Values -> [{"measures.svg", panels(Values)}]
    end.

%% A panel for each measure, a line for each robot, or one for the team.
panels(Values) ->
    Groups = maps:groups_from_list(fun({_, _, Key, _}) -> Key end, Values),
    starl_picture_plot:svg(" s", [
        #{title => atom_to_list(Key), curves => curves(Own)}
     || {Key, Own} <- lists:sort(maps:to_list(Groups))
    ]).

curves(Values) ->
    Lines = maps:groups_from_list(
        fun({_, Robot, _, _}) -> Robot end, fun({T, _, _, Value}) -> {T / 1.0e6, Value} end, Values
    ),
    [
        (whose(Robot))#{points => Points}
     || {Robot, Points} <- lists:sort(maps:to_list(Lines))
    ].

whose(team) -> #{name => "team", colour => 1};
whose(Robot) -> #{name => ["robot ", integer_to_list(Robot)], colour => Robot}.
