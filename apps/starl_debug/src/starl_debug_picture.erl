%% @doc Draws a witness of a predicate (SVG). It shows where the robots were at that moment, and the
%% bound on where they can have been. It also shows their paths from a second before to a second
%% after, each by its own clock.
-module(starl_debug_picture).

-export([svg/4]).

-define(AROUND_US, 1000000).
-define(STEP_US, 25000).
-define(MARGIN_MM, 150).
-define(PIXELS, 800).
-define(COLOURS, {"#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9"}).

%% @doc The picture of a witness with a line of text.
-spec svg(
    starl_debug_ground:t(),
    starl_debug_search:witness(),
    starl_debug_recording:t(),
    unicode:chardata()
) -> {ok, iodata()} | {error, no_places}.
svg(Formula, {At, Offsets}, #{tracks := Tracks}, Title) ->
    Ways = [
        {R, way(maps:get(R, Tracks), At + maps:get(R, Offsets, 0))}
     || R <- starl_debug_ground:robots(Formula), is_map_key(R, Tracks)
    ],
    case Ways of
        [] -> {error, no_places};
        _ -> {ok, drawn(Ways, Title)}
    end.

%% The points before and after, and the place at the moment.
way(Track, Clock) ->
    {First, Last} = starl_debug_track:extent(Track),
    Points = fun(From, To) ->
        [
            element(1, starl_debug_track:place(Track, T))
         || T <- lists:seq(From, To, ?STEP_US), T >= First, T =< Last
        ]
    end,
    {
        Points(Clock - ?AROUND_US, Clock),
        Points(Clock, Clock + ?AROUND_US),
        starl_debug_track:place(Track, Clock)
    }.

drawn(Ways, Title) ->
    {X0, Y0, X1, Y1} = box(Ways),
    Unit = max(X1 - X0, Y1 - Y0) / ?PIXELS,
    Head = 40 * Unit,
    [
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"",
        number((X1 - X0) / Unit),
        "\" height=\"",
        number((Y1 - Y0 + Head) / Unit),
        "\" viewBox=\"",
        lists:join(" ", [number(N) || N <- [X0, -Y1 - Head, X1 - X0, Y1 - Y0 + Head]]),
        "\" font-family=\"sans-serif\">\n<rect x=\"",
        number(X0),
        "\" y=\"",
        number(-Y1 - Head),
        "\" width=\"100%\" height=\"100%\" fill=\"white\"/>\n",
        text(X0 + 10 * Unit, -Y1 - Head / 2, 14 * Unit, "#333", Title),
        links([Place || {_, {_, _, {Place, _}}} <- Ways], Unit),
        [robot(R, Way, Unit) || {R, Way} <- Ways],
        "</svg>\n"
    ].

box(Ways) ->
    Points = lists:append([
        [{X - E, Y - E}, {X + E, Y + E} | Before ++ After]
     || {_, {Before, After, {{X, Y}, E}}} <- Ways
    ]),
    {Xs, Ys} = lists:unzip(Points),
    {
        lists:min(Xs) - ?MARGIN_MM,
        lists:min(Ys) - ?MARGIN_MM,
        lists:max(Xs) + ?MARGIN_MM,
        lists:max(Ys) + ?MARGIN_MM
    }.

%% Two robots are joined by a line with their distance.
links([{X0, Y0} = P, {X1, Y1} = Q], Unit) ->
    [
        line(
            [P, Q], "#999", Unit, " stroke-dasharray=\"4 4\" vector-effect=\"non-scaling-stroke\""
        ),
        text(
            (X0 + X1) / 2 + 8 * Unit,
            -(Y0 + Y1) / 2,
            13 * Unit,
            "#333",
            io_lib:format("~.1f mm", [starl_geometry:distance(P, Q)])
        )
    ];
links(_Places, _Unit) ->
    "".

robot(R, {Before, After, {{X, Y}, Error}}, Unit) ->
    Colour = element(1 + R rem tuple_size(?COLOURS), ?COLOURS),
    [
        line(Before, Colour, 2 * Unit, ""),
        line(After, Colour, 2 * Unit, " stroke-opacity=\"0.35\""),
        circle(X, Y, Error, [" fill=\"", Colour, "\" fill-opacity=\"0.2\""]),
        circle(X, Y, 5 * Unit, [" fill=\"", Colour, "\""]),
        text(X + 9 * Unit, -Y - 9 * Unit, 15 * Unit, Colour, ["r", integer_to_list(R)])
    ].

line([_, _ | _] = Points, Colour, Width, More) ->
    [
        "<polyline points=\"",
        lists:join(" ", [[number(X), ",", number(-Y)] || {X, Y} <- Points]),
        "\" fill=\"none\" stroke=\"",
        Colour,
        "\" stroke-width=\"",
        number(Width),
        "\"",
        More,
        "/>\n"
    ];
line(_Points, _Colour, _Width, _More) ->
    "".

circle(X, Y, R, More) ->
    ["<circle cx=\"", number(X), "\" cy=\"", number(-Y), "\" r=\"", number(R), "\"", More, "/>\n"].

text(X, Y, Size, Colour, Words) ->
    [
        "<text x=\"",
        number(X),
        "\" y=\"",
        number(Y),
        "\" font-size=\"",
        number(Size),
        "\" fill=\"",
        Colour,
        "\">",
        escaped(Words),
        "</text>\n"
    ].

escaped(Words) ->
    lists:foldl(
        fun({From, To}, Text) -> string:replace(Text, From, To, all) end,
        unicode:characters_to_binary(Words),
        [{"&", "&amp;"}, {"<", "&lt;"}, {">", "&gt;"}]
    ).

number(N) -> float_to_binary(N * 1.0, [{decimals, 2}]).
