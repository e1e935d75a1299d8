%% @doc Plots a sweep with a script for gnuplot 5. Each figure has a panel with curves through the
%% medians, and error bars from the minimum to the maximum. The first swept setting with numbers is
%% the x axis; each combination of the other swept settings is a curve.
-module(starl_lab_sweep_plot).

-export([axis/1, chosen/3, point_name/2, script/1, data/5, put/3]).

-export_type([plot/0, panel/0, figure/0]).

%% A figure of the report, the label of its axis, and whether it is plotted always, or only if it
%% is not the same in all runs (it is, too, if there is no other).
-type figure() :: {Key :: atom(), Label :: string(), always | varying}.

-type plot() :: #{title := string(), x := string(), panels := [panel()]}.
-type panel() :: #{y := string(), curves := [curve(), ...]}.
%% A curve with an empty name needs no legend.
-type curve() :: {Name :: string(), [{X :: number(), Median :: number(), number(), number()}]}.

-define(PANEL_WIDTH, 480).
-define(HEIGHT, 400).
-define(LEGEND_LINE, 18).
%% The largest number of explicit tics; more would not fit.
-define(MOST_TICS, 16).
%% The part of a value by which another one is seen to differ.
-define(SEEN, 0.01).
%% The horizontal offset between curves, a fraction of the axis, which keeps error bars apart.
-define(BESIDE, 0.006).

%% @doc The setting of the x axis.
-spec axis(starl_lab_sweep_grid:t()) -> {ok, starl_lab_sweep_grid:setting()} | none.
axis(Grid) ->
    Numbers = fun({_, _, Values}) -> lists:all(fun is_number/1, Values) end,
    case lists:filter(Numbers, starl_lab_sweep_grid:swept(Grid)) of
        [First | _] -> {ok, First};
        [] -> none
    end.

%% @doc The figures to plot: the requested ones, or else the completion time and the figures that
%% the application marks for plots. Gives the names that are not figures, too.
-spec chosen(none | [string()], Known :: [atom()], #{atom() => starl_scene:format()}) ->
    {ok, [figure(), ...]} | {unknown, [string()]}.
chosen(none, Known, Formats) ->
    Plotted = [Key || Key <- Known, maps:get(plotted, maps:get(Key, Formats, #{}), false)],
    {ok, [labelled(virtual_s, Formats, varying) | [labelled(Key, Formats) || Key <- Plotted]]};
chosen(Names, Known, Formats) ->
    Texts = [{atom_to_list(Key), Key} || Key <- Known],
    case [Name || Name <- Names, not lists:keymember(Name, 1, Texts)] of
        [] ->
            Keys = [element(2, lists:keyfind(Name, 1, Texts)) || Name <- lists:uniq(Names)],
            {ok, [labelled(Key, Formats) || Key <- Keys]};
        Unknown ->
            {unknown, Unknown}
    end.

labelled(Key, Formats) -> labelled(Key, Formats, always).

labelled(Key, Formats, Shown) ->
    {Key, maps:get(label, maps:get(Key, Formats, #{}), label(Key)), Shown}.

%% @doc The plot of some figures over the points of a grid. A figure that no run has, such as the
%% separation of a single robot, gets no panel.
-spec data(App, starl_lab_sweep_grid:t(), X, [{Point, Summary}], Figures) -> plot() when
    App :: string(),
    Point :: starl_lab_sweep_grid:point(),
    X :: starl_lab_sweep_grid:setting(),
    Summary :: starl_lab_sweep_summary:t(),
    Figures :: [figure(), ...].
data(App, Grid, {Key, _, _}, Points, Figures) ->
    Others = [Setting || {K, _, _} = Setting <- starl_lab_sweep_grid:swept(Grid), K =/= Key],
    Named = [{named(Others, Point), maps:get(Key, Point), Sum} || {Point, Sum} <- Points],
    Names = lists:uniq([Name || {Name, _, _} <- Named]),
    #{
        title => title(App, starl_lab_sweep_grid:fixed(Grid), starl_lab_sweep_grid:seeds(Grid)),
        x => label(Key),
        panels => telling([
            {Shown, #{y => Label, curves => Curves}}
         || {Figure, Label, Shown} <- Figures,
            Curves <- [curves(Names, Figure, Named)],
            Curves =/= []
        ])
    }.

telling(Panels) ->
    case [Panel || {Shown, Panel} <- Panels, Shown =:= always orelse varies(Panel)] of
        [] -> [Panel || {_, Panel} <- Panels];
        Telling -> Telling
    end.

varies(#{curves := Curves}) ->
    Values = lists:append([[Min, Max] || {_, Points} <- Curves, {_, _, Min, Max} <- Points]),
    {Least, Most} = {lists:min(Values), lists:max(Values)},
    Most - Least > ?SEEN * max(abs(Least), abs(Most)).

curves(Names, Figure, Named) ->
    Curves = [{Name, curve(Name, Figure, Named)} || Name <- Names],
    [Curve || {_, [_ | _]} = Curve <- Curves].

curve(Name, Figure, Named) ->
    lists:sort([
        {X, Median, Min, Max}
     || {N, X, Sum} <- Named,
        N =:= Name,
        {Median, Min, Max} <- [starl_lab_sweep_summary:range(Figure, Sum)]
    ]).

%% @doc The name of a point: its values of the swept settings.
-spec point_name(starl_lab_sweep_grid:t(), starl_lab_sweep_grid:point()) -> string().
point_name(Grid, Point) ->
    case named(starl_lab_sweep_grid:swept(Grid), Point) of
        "" -> "all runs";
        Name -> Name
    end.

named(Settings, Point) ->
    Texts = [setting(Key, Type, maps:get(Key, Point)) || {Key, Type, _} <- Settings],
    lists:flatten(lists:join(", ", Texts)).

setting(Key, Type, Value) -> [words(Key), " ", starl_cli_flags:text(Type, Value)].

title(App, Fixed, Seeds) ->
    Texts = [setting(Key, Type, Value) || {Key, Type, [Value]} <- Fixed],
    N = length(Seeds),
    Runs = io_lib:format("median and range of ~b seed~ts", [N, [$s || N > 1]]),
    lists:flatten([App, ": ", lists:join(", ", Texts ++ [Runs])]).

%% Labels with units for the simulation's own options and figures.
label(robots) -> "number of robots";
label(virtual_s) -> "completion time, s";
label(loss) -> "part of the packets lost";
label(Key) -> with_unit(atom_to_list(Key)).

with_unit(Name) ->
    {Words, Unit} =
        case lists:reverse(string:lexemes(Name, "_")) of
            ["s", _ | _] -> {lists:droplast(string:lexemes(Name, "_")), ", s"};
            ["mm", _ | _] -> {lists:droplast(string:lexemes(Name, "_")), ", mm"};
            _ -> {string:lexemes(Name, "_"), ""}
        end,
    lists:flatten([lists:join(" ", Words), Unit]).

words(Key) -> lists:join(" ", string:lexemes(atom_to_list(Key), "_")).

%% -- the script -----------------------------------------------------------------------------

%% @doc The script. It writes `plot.svg' and `plot.png' to the current directory.
-spec script(plot()) -> unicode:chardata().
script(#{title := Title, x := X, panels := Panels}) ->
    Numbered = numbered(Panels),
    [
        "# Drawn by gnuplot 5 or newer: gnuplot plot.gp\n",
        [
            block(P, C, Curve)
         || {P, #{curves := Curves}} <- Numbered, {C, Curve} <- numbered(Curves)
        ],
        "do for [format in 'svg png'] {\n",
        terminals(length(Panels), lists:max([length(Curves) || #{curves := Curves} <- Panels])),
        "  set output 'plot.'.format\n",
        io_lib:format("  set multiplot layout 1,~b title ~ts\n", [length(Panels), quoted(Title)]),
        "  set xlabel ",
        quoted(X),
        "\n",
        "  set style data yerrorlines\n  set border 3\n  set tics nomirror out\n",
        "  set grid ytics linecolor rgb '#dddddd' linetype 1\n  set yrange [0:*]\n",
        tics(lists:usort([Value || #{curves := Curves} <- Panels, Value <- xs(Curves)])),
        [panel(P, Panel) || {P, Panel} <- Numbered],
        "  unset multiplot\n  unset output\n}\n"
    ].

numbered(List) -> lists:zip(lists:seq(1, length(List)), List).

block(P, C, {_Name, Points}) ->
    [
        name(P, C),
        " << EOD\n",
        [io_lib:format("~w ~w ~w ~w\n", tuple_to_list(Point)) || Point <- Points],
        "EOD\n"
    ].

name(P, C) -> io_lib:format("$panel~b_curve~b", [P, C]).

%% Without Cairo, gnuplot draws a coarser PNG.
terminals(Panels, Curves) ->
    Size = io_lib:format("size ~b,~b noenhanced", [
        Panels * ?PANEL_WIDTH, ?HEIGHT + (Curves - 1) * ?LEGEND_LINE
    ]),
    [
        "  if (format eq 'svg') {\n",
        "    set terminal svg ",
        Size,
        " font 'sans,13' background 'white'\n",
        "  } else { if (strstrt(GPVAL_TERMINALS, ' pngcairo ') > 0) {\n",
        "    set terminal pngcairo ",
        Size,
        " font 'sans,11'\n",
        "  } else {\n",
        "    set terminal png ",
        Size,
        "\n",
        "  } }\n"
    ].

tics([]) ->
    "";
tics([Only]) ->
    io_lib:format("  set xrange [~w:~w]\n  set xtics (~w)\n", [Only - 1, Only + 1, Only]);
tics(Values) ->
    {Least, Most} = {hd(Values), lists:last(Values)},
    Margin = 0.04 * (Most - Least),
    [
        io_lib:format("  set xrange [~w:~w]\n", [Least - Margin, Most + Margin]),
        [
            ["  set xtics (", lists:join(", ", [io_lib:format("~w", [V]) || V <- Values]), ")\n"]
         || length(Values) =< ?MOST_TICS
        ]
    ].

panel(P, #{y := Y, curves := Curves}) ->
    Width = width(xs(Curves)),
    Drawn = [one_curve(P, C, Curve, length(Curves), Width) || {C, Curve} <- numbered(Curves)],
    [
        "  set ylabel ",
        quoted(Y),
        "\n",
        legend(Curves),
        "  plot ",
        lists:join(", \\\n       ", Drawn),
        "\n"
    ].

xs(Curves) -> [X || {_, Points} <- Curves, {X, _, _, _} <- Points].

width(Values) -> lists:max(Values) - lists:min(Values).

legend([_]) -> "  unset key\n";
legend(_) -> "  set key below Left reverse samplen 2 height 1\n".

one_curve(P, C, {Name, _}, Curves, Width) ->
    Aside = (C - (Curves + 1) / 2) * ?BESIDE * Width,
    io_lib:format(
        "~ts using ($1 + ~w):2:3:4 linecolor rgb '~ts' linewidth 1.5 pointtype 7 "
        "pointsize 0.6 title ~ts",
        [
            name(P, C), Aside, starl_picture_draw:colour(C), quoted(Name)
        ]
    ).

quoted(Text) -> ["'", string:replace(starl_cli_terminal:flat(Text), "'", "''", all), "'"].

%% -- gnuplot --------------------------------------------------------------------------------

%% @doc Writes these files and the plot's script into a directory, and draws it. A plot that cannot be drawn
%% is said, and is not a failure: all other results exist.
-spec put(file:filename(), Files, plot()) -> ok | {error, unicode:chardata()} when
    Files :: [{file:filename(), unicode:chardata()}].
put(Dir, Files, Plot) ->
    case starl_lab_files:put_all(Dir, Files ++ [{"plot.gp", script(Plot)}]) of
        ok -> said(draw(Dir));
        {error, _} = Error -> Error
    end.

said(ok) -> ok;
said({error, Why}) -> starl_cli_terminal:complain(Why).

%% Runs gnuplot on the script; gives its message if it fails.
draw(Dir) ->
    case os:find_executable("gnuplot") of
        false ->
            {error, "no gnuplot: install it (package gnuplot-nox), then run gnuplot plot.gp there"};
        Program ->
            Options = [{args, ["plot.gp"]}, {cd, Dir}, exit_status, stderr_to_stdout, binary, hide],
            drawn(open_port({spawn_executable, Program}, Options), <<>>)
    end.

drawn(Port, Text) ->
    receive
        {Port, {data, More}} -> drawn(Port, <<Text/binary, More/binary>>);
        {Port, {exit_status, 0}} -> ok;
        {Port, {exit_status, _}} -> {error, ["gnuplot could not draw plot.gp: ", Text]}
    end.
