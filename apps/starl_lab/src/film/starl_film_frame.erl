%% @doc Draws one picture of a film at a given time, as SVG. A pure module.
-module(starl_film_frame).

-export([at/3]).

-define(INK_MM, 3.0).

%% @doc The team and its ink at a time.
-spec at(integer(), unicode:chardata(), starl_film_cast:scene()) -> binary().
at(T, Title, #{actors := Actors, lines := Lines, cuts := Cuts} = Scene) ->
    Page = starl_film_draw:page(Scene),
    #{drawings := Drawings} = Scene,
    Holding = starl_film_partitions:holds(T, Cuts),
    iolist_to_binary([
        starl_film_draw:open(day, foot, Page),
        starl_film_draw:style(Page),
        starl_film_draw:plan(maps:get(plan, Scene), Page),
        [
            starl_film_draw:obstacle(Sides, Page)
         || {Sides, {From, To}} <- maps:get(obstacles, Scene), From =< T, T < To
        ],
        starl_film_draw:target(Lines, Page),
        [ink(T, Actor, Page) || Actor <- Actors],
        [
            starl_film_draw:drawing(Robot, Drawing, Page)
         || {From, To, Robot, Drawing} <- Drawings, From =< T, T =< To
        ],
        [link(T, Link, Actors, Page) || Link <- starl_film_partitions:links(Holding)],
        [robot(T, Actor, Holding, Page) || Actor <- Actors],
        foot(T, Title, Scene, Page),
        curves(T, Scene, Page),
        "</svg>\n"
    ]).

ink(T, #{id := Id, ink := Strokes}, Page) ->
    Drawn = [stroke(T, Stroke, Page) || [{From, _} | _] = Stroke <- Strokes, From =< T],
    ["<path class=\"i\" stroke=\"", starl_film_draw:colour(Id), "\" d=\"", Drawn, "\"/>\n"].

stroke(T, [{From, _} | _] = Stroke, Page) ->
    {To, _} = lists:last(Stroke),
    Until = max(From, min(T, To)),
    Points = starl_film_series:thin(?INK_MM, starl_film_series:slice(From, Until, Stroke)),
    starl_film_draw:path([starl_film_draw:place({X, Y}, Page) || {_, [X, Y]} <- Points]).

link(T, {A, B, _}, Actors, Page) ->
    [{X1, Y1}, {X2, Y2}] = [
        place(T, Way, Page)
     || Id <- [A, B], #{id := Actor, way := Way} <- Actors, Actor =:= Id
    ],
    [
        io_lib:format("<line x1=\"~b\" y1=\"~b\" x2=\"~b\" y2=\"~b\" ", [X1, Y1, X2, Y2]),
        [starl_film_partitions:line(Page), "/>\n"]
    ].

place(T, Way, Page) ->
    [X, Y, _] = starl_film_series:at(T, Way),
    starl_film_draw:place({X, Y}, Page).

robot(T, #{id := Id, way := Way, down := Down}, Cuts, Page) ->
    [_, _, Heading] = starl_film_series:at(T, Way),
    {Body, Number} = starl_film_draw:body(Id, Page),
    {PX, PY} = place(T, Way, Page),
    Rings = [
        [starl_film_partitions:ring(Page), "/>"]
     || _ <- starl_film_partitions:rings(Id, Cuts)
    ],
    Opacity =
        case [Span || {From, To} = Span <- Down, From =< T, T =< To] of
            [] -> "";
            _ -> " opacity=\".3\""
        end,
    [
        io_lib:format("<g transform=\"translate(~b,~b)\"~s>", [PX, PY, Opacity]),
        io_lib:format("<g transform=\"rotate(~.1f)\">", [-Heading * 180 / math:pi()]),
        [Body, "</g>", Number, Rings, "</g>\n"]
    ].

foot(T, Title, #{end_us := End}, #{width := Width, height := Height, dot := Dot}) ->
    Seconds = min(T, End) div 1000000,
    Y = round(Height + 30 * Dot),
    [
        io_lib:format("<rect y=\"~b\" width=\"~b\" height=\"~b\" fill=\"#888\"/>\n", [
            Height, round(Width * min(T, End) / max(1, End)), round(4 * Dot)
        ]),
        io_lib:format("<text x=\"~b\" y=\"~b\" font-size=\"~b\">", [
            round(12 * Dot), Y, round(18 * Dot)
        ]),
        [escape(Title), "</text>\n"],
        io_lib:format(
            "<text x=\"~b\" y=\"~b\" font-size=\"~b\" text-anchor=\"end\">~b:~2..0b</text>\n", [
                round(Width - 12 * Dot), Y, round(20 * Dot), Seconds div 60, Seconds rem 60
            ]
        )
    ].

curves(_T, #{curves := []}, _Page) ->
    [];
curves(T, #{curves := Curves, end_us := End}, #{width := Width} = Page) ->
    [
        [starl_film_curves:strips(Curves, End, Page), starl_film_curves:mark(Page)],
        io_lib:format(" transform=\"translate(~b,0)\"/>\n", [
            round(Width * min(T, End) / max(1, End))
        ])
    ].

escape(Text) -> string:replace(string:replace(Text, "&", "&amp;", all), "<", "&lt;", all).
