%% @doc Draws plots as SVG: panels one below the other, with curves over a common axis. A pure module.
%% ```
%%   starl_picture_plot:svg(" s", [
%%       #{
%%           title => "distance, mm",
%%           curves => [#{name => "robot 1", colour => 1, points => [{0, 500}, {1, 430}]}]
%%       }
%%   ])
%% '''
-module(starl_picture_plot).

-export([svg/2]).

-export_type([panel/0, curve/0]).

%% `legend': the names of the curves stand beside the title.
-type panel() :: #{
    title := unicode:chardata(), curves := [curve(), ...], legend => boolean()
}.

%% `colour': a number, as robots have. `range': what lies between two values, behind the curve.
-type curve() :: #{
    name := unicode:chardata(),
    colour := pos_integer(),
    points := [{X :: number(), Y :: number()}, ...],
    range => [{X :: number(), Low :: number(), High :: number()}]
}.

-type axis() :: {Low :: number(), High :: number(), Step :: number()}.

-define(WIDTH, 800).
-define(HEIGHT, 260).
%% Beside a panel's frame, for its labels.
-define(LEFT, 80).
-define(RIGHT, 20).
-define(TOP, 36).
-define(BOTTOM, 34).
%% A name of the legend, and the names of a line; more lines make the panel higher.
-define(NAME, 180).
-define(NAMES, 4).
-define(NAME_LINE, 18).
%% The points of a line at most: more cannot be told apart.
-define(POINTS, 2000).
-define(STEPS, 5).

%% @doc The plot of these panels. `Unit' follows the numbers of the common axis.
-spec svg(Unit :: string(), [panel(), ...]) -> iolist().
svg(Unit, Panels) ->
    Last = lists:max([X || Panel <- Panels, X <- xs(Panel)]),
    First = lists:min([0 | [X || Panel <- Panels, X <- xs(Panel)]]),
    Axis = axis(First, max(Last, 0.001)),
    {Drawn, Height} = lists:mapfoldl(
        fun(Panel, Top) ->
            {panel(Top, Panel, Axis, Unit), Top + ?HEIGHT + head(Panel)}
        end,
        0,
        Panels
    ),
    [
        io_lib:format(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 ~b ~b\" "
            "width=\"~b\" height=\"~b\">\n"
            "<rect width=\"100%\" height=\"100%\" fill=\"#fff\"/>\n"
            "<style>text{font:13px sans-serif;fill:#303030}.g{stroke:#e4e4e4}"
            ".b{stroke:none;fill-opacity:.15}"
            ".l{fill:none;stroke-width:1.6;stroke-linejoin:round}</style>\n",
            [?WIDTH, Height, ?WIDTH, Height]
        ),
        Drawn,
        "</svg>\n"
    ].

xs(#{curves := Curves}) -> [X || #{points := Points} <- Curves, {X, _} <- Points].

ys(#{curves := Curves}) ->
    [Y || #{points := Points} <- Curves, {_, Y} <- Points] ++
        [Y || #{range := Band} <- Curves, {_, Low, High} <- Band, Y <- [Low, High]].

%% The height of the legend.
head(#{legend := true, curves := Curves}) -> ?NAME_LINE * ceil(length(Curves) / ?NAMES);
head(_Panel) -> 0.

panel(Top, #{title := Title, curves := Curves} = Panel, XAxis, Unit) ->
    Numbers = ys(Panel),
    YAxis = axis(lists:min([0 | Numbers]), lists:max(Numbers)),
    [
        io_lib:format("<g transform=\"translate(0,~b)\">\n", [Top]),
        io_lib:format("<text x=\"~b\" y=\"22\" font-weight=\"bold\">~ts</text>\n", [
            ?LEFT, escaped(Title)
        ]),
        [[name(N, Curve) || {N, Curve} <- lists:enumerate(0, Curves)] || head(Panel) > 0],
        io_lib:format("<g transform=\"translate(0,~b)\">\n", [head(Panel)]),
        [across(Y, YAxis) || Y <- ticks(YAxis)],
        [up(X, XAxis, Unit) || X <- ticks(XAxis)],
        [range(Curve, XAxis, YAxis) || Curve <- Curves],
        [line(Curve, XAxis, YAxis) || Curve <- Curves],
        "</g></g>\n"
    ].

name(N, #{name := Name, colour := Colour}) ->
    X = ?LEFT + ?NAME * (N rem ?NAMES),
    Y = ?TOP + ?NAME_LINE * (N div ?NAMES) + 6,
    [
        io_lib:format(
            "<path class=\"l\" stroke=\"~ts\" d=\"M~b ~bh18\"/>"
            "<text x=\"~b\" y=\"~b\">~ts</text>\n",
            [starl_picture_draw:colour(Colour), X, Y - 4, X + 24, Y, escaped(Name)]
        )
    ].

across(Value, Axis) ->
    Y = y(Value, Axis),
    io_lib:format(
        "<line class=\"g\" x1=\"~b\" x2=\"~b\" y1=\"~.1f\" y2=\"~.1f\"/>"
        "<text x=\"~b\" y=\"~.1f\" text-anchor=\"end\">~ts</text>\n",
        [?LEFT, ?WIDTH - ?RIGHT, Y, Y, ?LEFT - 8, Y + 4, label(Value, Axis)]
    ).

up(Value, Axis, Unit) ->
    X = x(Value, Axis),
    io_lib:format(
        "<line class=\"g\" x1=\"~.1f\" x2=\"~.1f\" y1=\"~b\" y2=\"~b\"/>"
        "<text x=\"~.1f\" y=\"~b\" text-anchor=\"middle\">~ts~ts</text>\n",
        [
            X, X, ?TOP, ?HEIGHT - ?BOTTOM, X, ?HEIGHT - ?BOTTOM + 18, label(Value, Axis), Unit
        ]
    ).

range(#{range := [_ | _] = Band, colour := Colour}, XAxis, YAxis) ->
    Thin = thin(Band),
    Upper = [{X, High} || {X, _, High} <- Thin],
    Lower = lists:reverse([{X, Low} || {X, Low, _} <- Thin]),
    [
        ["<polygon class=\"b\" fill=\"", starl_picture_draw:colour(Colour), "\" points=\""],
        [points(Upper ++ Lower, XAxis, YAxis), "\"/>\n"]
    ];
range(_Curve, _XAxis, _YAxis) ->
    [].

line(#{name := Name, colour := Colour, points := Points}, XAxis, YAxis) ->
    [
        ["<polyline class=\"l\" stroke=\"", starl_picture_draw:colour(Colour), "\" points=\""],
        points(thin(Points), XAxis, YAxis),
        io_lib:format("\"><title>~ts</title></polyline>\n", [escaped(Name)])
    ].

points(Points, XAxis, YAxis) ->
    [io_lib:format("~.1f,~.1f ", [x(X, XAxis), y(Y, YAxis)]) || {X, Y} <- Points].

%% A single point is drawn as a short line.
thin([Point]) ->
    [Point, Point];
thin(Points) ->
    case ceil(length(Points) / ?POINTS) of
        1 ->
            Points;
        Every ->
            [Point || {N, Point} <- lists:enumerate(Points), N rem Every =:= 1] ++
                [lists:last(Points)]
    end.

x(T, {Low, High, _}) -> ?LEFT + (?WIDTH - ?LEFT - ?RIGHT) * (T - Low) / (High - Low).

y(Value, {Low, High, _}) ->
    float(?HEIGHT - ?BOTTOM - (?HEIGHT - ?TOP - ?BOTTOM) * (Value - Low) / (High - Low)).

escaped(Text) -> string:replace(string:replace(Text, "&", "&amp;", all), "<", "&lt;", all).

%% -- axes -----------------------------------------------------------------------------------

%% From a whole step to a whole step, of 1, 2 or 5 times a power of ten.
-spec axis(number(), number()) -> axis().
axis(Low, High) ->
    Step = step(max(High - Low, 1.0e-6 * max(1, abs(High))) / ?STEPS),
    {Step * floor(Low / Step), Step * max(ceil(High / Step), floor(Low / Step) + 1), Step}.

step(Least) ->
    Power = math:pow(10, floor(math:log10(Least))),
    hd([Factor * Power || Factor <- [1, 2, 5, 10], Factor * Power >= 0.999999 * Least]).

ticks({Low, High, Step}) -> [Low + N * Step || N <- lists:seq(0, round((High - Low) / Step))].

label(Value, {_, _, Step}) when Step >= 1 -> integer_to_list(round(Value));
label(Value, {_, _, Step}) ->
    float_to_list(float(Value), [{decimals, min(9, ceil(-math:log10(Step)))}]).
