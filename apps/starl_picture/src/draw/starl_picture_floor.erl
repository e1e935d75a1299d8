%% @doc Draws a floor plan below a picture: walls, doors, the names of rooms and places, as SVG in
%% millimetres.
-module(starl_picture_floor).

-export([svg/2, obstacle/3]).

%% @doc The plan, with y down from the top of the floor; `DotMm' is the width of a dot.
-spec svg(starl_floor:t(), DotMm :: float()) -> iolist().
svg(#{size := {_, H}, walls := Walls, doors := Doors, places := Places, rooms := Rooms}, Dot) ->
    [
        path([polygon(Wall, H) || [_, _, _ | _] = Wall <- Walls], "fill=\"#8a8a8a\""),
        path([polygon(Wall, H) || [_, _] = Wall <- Walls], line("#5a5a5a", 3 * Dot, "")),
        path([polygon([A, B], H) || {A, B} <- Doors], line("#c08a3e", 1.5 * Dot, dashes(Dot))),
        [
            name(Name, starl_floor:middle(Room), H, 18 * Dot, "#b0b0b0")
         || {Name, Room} <- sorted(Rooms)
        ],
        [place(Name, Place, H, Dot) || {Name, Place} <- sorted(Places)]
    ].

%% @doc What stands in the way for a time, on a floor of this height.
-spec obstacle([starl_geometry:segment()], HeightMm :: float(), DotMm :: float()) -> iolist().
obstacle(Sides, H, Dot) ->
    path([polygon([A, B], H) || {A, B} <- Sides], line("#c40d2e", 3 * Dot, "")).

sorted(Names) -> lists:sort(maps:to_list(Names)).

dashes(Dot) -> [" stroke-dasharray=\"", number(5 * Dot), " ", number(4 * Dot), "\""].

line(Colour, Width, More) ->
    ["fill=\"none\" stroke=\"", Colour, "\" stroke-width=\"", number(Width), "\"", More].

path([], _Style) -> [];
path(Polygons, Style) -> ["<path ", Style, " d=\"", lists:join($\n, Polygons), "\"/>\n"].

polygon([A, B], H) -> [$M, point(A, H), $L, point(B, H)];
polygon(Points, H) -> [$M, lists:join($L, [point(Point, H) || Point <- Points]), $Z].

point({X, Y}, H) -> [number(X), $,, number(H - Y)].

place(Name, {X, Y}, H, Dot) ->
    [
        ["<circle cx=\"", number(X), "\" cy=\"", number(H - Y), "\" r=\"", number(3 * Dot)],
        "\" fill=\"#c0392b\"/>\n",
        name(Name, {X + 8 * Dot, Y}, H, 12 * Dot, "#c0392b")
    ].

name(Name, {X, Y}, H, Size, Colour) ->
    [
        ["<text x=\"", number(X), "\" y=\"", number(H - Y + 0.35 * Size)],
        ["\" font-family=\"sans-serif\" font-size=\"", number(Size), "\" fill=\"", Colour, "\">"],
        [atom_to_binary(Name), "</text>\n"]
    ].

number(Mm) -> float_to_list(float(Mm), [{decimals, 1}]).
