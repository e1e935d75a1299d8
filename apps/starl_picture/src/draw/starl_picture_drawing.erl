%% @doc Draws the drawings of an application ({@link starl_drawing}) into an SVG picture. Its unit
%% is a millimetre of floor, with y downwards. A pure module.
-module(starl_picture_drawing).

-export([svg/4]).

-define(POINT_DOTS, 4).
-define(LINE_DOTS, 2).
-define(LETTER_DOTS, 15).

%% @doc The drawing of a robot whose own colour is this one, on a floor of this height; `DotMm' is the size of a dot, of which the longer
%% side has 800.
-spec svg(Own :: string(), starl_drawing:t(), HeightMm :: number(), DotMm :: float()) -> iolist().
svg(_Own, #{points := []}, _Height, _Dot) ->
    [];
svg(Own, #{kind := Kind, points := Points, text := Text} = Drawing, Height, Dot) ->
    Colour = colour(Own, Drawing),
    shape(Kind, [{round(X), round(Height - Y)} || {X, Y} <- Points], Text, Colour, Dot).

colour(Own, #{colour := own}) ->
    Own;
colour(_Own, #{colour := Name}) ->
    {Name, Colour} = lists:keyfind(Name, 1, starl_drawing:colours()),
    Colour.

shape(points, Points, _Text, Colour, Dot) ->
    [
        io_lib:format("<circle cx=\"~b\" cy=\"~b\" r=\"~b\" fill=\"~ts\"/>\n", [
            X, Y, ceil(?POINT_DOTS * Dot), Colour
        ])
     || {X, Y} <- Points
    ];
shape(line, Points, _Text, Colour, Dot) ->
    io_lib:format(
        "<polyline fill=\"none\" stroke=\"~ts\" stroke-width=\"~b\" stroke-dasharray=\"~b\" "
        "points=\"~ts\"/>\n",
        [Colour, ceil(?LINE_DOTS * Dot), ceil(3 * ?LINE_DOTS * Dot), places(Points)]
    );
shape(area, Points, _Text, Colour, Dot) ->
    io_lib:format(
        "<polygon fill=\"~ts\" fill-opacity=\".15\" stroke=\"~ts\" stroke-width=\"~b\" "
        "points=\"~ts\"/>\n",
        [Colour, Colour, ceil(Dot), places(Points)]
    );
shape(text, [{X, Y}], Text, Colour, Dot) ->
    io_lib:format(
        "<text x=\"~b\" y=\"~b\" font-family=\"sans-serif\" font-size=\"~b\" style=\"fill:~ts\">~ts</text>\n",
        [X, Y, ceil(?LETTER_DOTS * Dot), Colour, escape(Text)]
    ).

places(Points) -> lists:join($\s, [io_lib:format("~b,~b", [X, Y]) || {X, Y} <- Points]).

escape(Text) ->
    unicode:characters_to_binary([escaped(C) || C <- unicode:characters_to_list(Text)]).

escaped($<) -> "&lt;";
escaped($>) -> "&gt;";
escaped($&) -> "&amp;";
escaped(C) when C < 32; C =:= 16#FFFE; C =:= 16#FFFF -> $\s;
escaped(C) -> C.
