%% @doc Draws a floor plan beneath a picture: walls, doors, the names of rooms and places, as SVG in
%% millimetres.
-module(starl_picture_floor).

-export([svg/2]).

%% @doc The plan, with y down from the top of the floor; `DotMm' is the width of a dot.
-spec svg(starl_floor:t(), DotMm :: float()) -> iolist().
svg(#{size := {_, H}, walls := Walls, doors := Doors, places := Places, rooms := Rooms}, Dot) ->
    [
        path([polygon(Wall, H) || [_, _, _ | _] = Wall <- Walls], "fill=\"#8a8a8a\""),
        path([polygon(Wall, H) || [_, _] = Wall <- Walls], line("#5a5a5a", 3 * Dot, "")),
        path([polygon([A, B], H) || {A, B} <- Doors], line("#c08a3e", 1.5 * Dot, dashes(Dot))),
        [name(Name, middle(Room), H, 18 * Dot, "#b0b0b0") || {Name, Room} <- sorted(Rooms)],
        [place(Name, Place, H, Dot) || {Name, Place} <- sorted(Places)]
    ].

sorted(Names) -> lists:sort(maps:to_list(Names)).

dashes(Dot) -> [" stroke-dasharray=\"", number(5 * Dot), " ", number(4 * Dot), "\""].

line(Colour, Width, More) ->
    ["fill=\"none\" stroke=\"", Colour, "\" stroke-width=\"", number(Width), "\"", More].

path([], _Style) -> [];
path(Polygons, Style) -> ["<path ", Style, " d=\"", lists:join($\n, Polygons), "\"/>\n"].

polygon([A, B], H) -> [$M, point(A, H), $L, point(B, H)];
polygon(Points, H) -> [$M, lists:join($L, [point(Point, H) || Point <- Points]), $Z].

point({X, Y}, H) -> [number(X), $,, number(H - Y)].

%% Where a room is widest.
middle(Points) ->
    {_, Low, _, High} = starl_geometry:box(Points),
    Heights = [Low + I * (High - Low) / 10 || I <- lists:seq(1, 9)],
    {_, X, Y} = lists:max([{0.0, 0.0, Low} | lists:append([widths(Y, Points) || Y <- Heights])]),
    {X, Y}.

%% The stretches of a room at a height, with their middles.
widths(Y, [First | Rest] = Points) ->
    Sides = lists:zip(Points, Rest ++ [First]),
    pairs(
        Y,
        lists:sort([
            AX + (Y - AY) * (BX - AX) / (BY - AY)
         || {{AX, AY}, {BX, BY}} <- Sides, (AY =< Y) =/= (BY =< Y)
        ])
    ).

pairs(Y, [From, To | Rest]) -> [{To - From, (From + To) / 2, Y} | pairs(Y, Rest)];
pairs(_Y, []) -> [].

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
