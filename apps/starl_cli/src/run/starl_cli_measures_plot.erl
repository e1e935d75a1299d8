%% @doc Draws measures over time as SVG: a panel for each measure, a line for each robot. A pure module.
-module(starl_cli_measures_plot).

-export([svg/1]).

-define(WIDTH, 800).
-define(HEIGHT, 260).
%% Beside a panel's frame, for its labels.
-define(LEFT, 80).
-define(RIGHT, 20).
-define(TOP, 36).
-define(BOTTOM, 34).
%% The points of a line at most: more cannot be told apart.
-define(POINTS, 2000).
-define(STEPS, 5).

%% @doc The plot of these values, which are in the order of time.
-spec svg([starl_sim_measures_monitor:value(), ...]) -> iolist().
svg(Values) ->
    Groups = maps:groups_from_list(fun({_, _, Key, _}) -> Key end, Values),
    Panels = lists:enumerate(lists:sort(maps:to_list(Groups))),
    End = lists:max([T || {T, _, _, _} <- Values]) / 1.0e6,
    Axis = axis(0, max(End, 0.001)),
    [
        io_lib:format(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 ~b ~b\" "
            "width=\"~b\" height=\"~b\">\n"
            "<rect width=\"100%\" height=\"100%\" fill=\"#fff\"/>\n"
            "<style>text{font:13px sans-serif;fill:#303030}.g{stroke:#e4e4e4}"
            ".l{fill:none;stroke-width:1.6;stroke-linejoin:round}</style>\n",
            [?WIDTH, ?HEIGHT * length(Panels), ?WIDTH, ?HEIGHT * length(Panels)]
        ),
        [panel(N, Key, Own, Axis) || {N, {Key, Own}} <- Panels],
        "</svg>\n"
    ].

panel(N, Key, Values, XAxis) ->
    Numbers = [Value || {_, _, _, Value} <- Values],
    YAxis = axis(lists:min([0 | Numbers]), lists:max(Numbers)),
    Lines = maps:groups_from_list(
        fun({_, Robot, _, _}) -> Robot end, fun({T, _, _, Value}) -> {T / 1.0e6, Value} end, Values
    ),
    [
        io_lib:format("<g transform=\"translate(0,~b)\">\n", [?HEIGHT * (N - 1)]),
        io_lib:format("<text x=\"~b\" y=\"22\" font-weight=\"bold\">~ts</text>\n", [?LEFT, Key]),
        [across(Y, YAxis) || Y <- ticks(YAxis)],
        [up(X, XAxis) || X <- ticks(XAxis)],
        [line(Robot, Points, XAxis, YAxis) || {Robot, Points} <- lists:sort(maps:to_list(Lines))],
        "</g>\n"
    ].

across(Value, Axis) ->
    Y = y(Value, Axis),
    io_lib:format(
        "<line class=\"g\" x1=\"~b\" x2=\"~b\" y1=\"~.1f\" y2=\"~.1f\"/>"
        "<text x=\"~b\" y=\"~.1f\" text-anchor=\"end\">~ts</text>\n",
        [?LEFT, ?WIDTH - ?RIGHT, Y, Y, ?LEFT - 8, Y + 4, label(Value, Axis)]
    ).

up(Value, Axis) ->
    X = x(Value, Axis),
    io_lib:format(
        "<line class=\"g\" x1=\"~.1f\" x2=\"~.1f\" y1=\"~b\" y2=\"~b\"/>"
        "<text x=\"~.1f\" y=\"~b\" text-anchor=\"middle\">~ts s</text>\n",
        [X, X, ?TOP, ?HEIGHT - ?BOTTOM, X, ?HEIGHT - ?BOTTOM + 18, label(Value, Axis)]
    ).

line(Robot, Points, XAxis, YAxis) ->
    [
        ["<polyline class=\"l\" stroke=\"", starl_picture_draw:colour(Robot), "\" points=\""],
        [
            io_lib:format("~.1f,~.1f ", [x(T, XAxis), y(Value, YAxis)])
         || {T, Value} <- thin(Points, max(1, ceil(length(Points) / ?POINTS)))
        ],
        io_lib:format("\"><title>robot ~b</title></polyline>\n", [Robot])
    ].

%% A single point is drawn as a short line.
thin([{T, Value}], _Every) ->
    [{T, Value}, {T, Value}];
thin(Points, 1) ->
    Points;
thin(Points, Every) ->
    [Point || {N, Point} <- lists:enumerate(Points), N rem Every =:= 1] ++ [lists:last(Points)].

x(T, {Low, High, _}) -> ?LEFT + (?WIDTH - ?LEFT - ?RIGHT) * (T - Low) / (High - Low).

y(Value, {Low, High, _}) ->
    float(?HEIGHT - ?BOTTOM - (?HEIGHT - ?TOP - ?BOTTOM) * (Value - Low) / (High - Low)).

%% -- axes -----------------------------------------------------------------------------------

%% From a whole step to a whole step, of 1, 2 or 5 times a power of ten.
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
