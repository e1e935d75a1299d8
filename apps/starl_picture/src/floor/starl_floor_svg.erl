%% @doc Reads a floor plan from an SVG drawing. Its layers (groups) must have the names below, in
%% upper or lower case, as Inkscape's label, a title or an id:
%%
%% ```
%%   <svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 6000 4000">
%%     <g id="walls"><path d="M 3000 0 V 1500 M 3000 2500 V 4000" stroke="black" stroke-width="120"/></g>
%%     <g id="doors"><path d="M 3000 1500 V 2500" stroke="brown"/></g>
%%     <g id="rooms"><rect id="kitchen" width="3000" height="4000" fill="none" stroke="grey"/></g>
%%     <g id="places"><circle id="dock" cx="4500" cy="2000" r="50"/></g>
%%   </svg>
%% '''
%% What can be seen in the layer `walls' is solid: areas that are filled, and lines, as wide as
%% they are drawn. The drawing's viewBox, or else its width and height, is the floor.
-module(starl_floor_svg).

-export([parse/2]).

-type outline() :: starl_svg_shape:outline().

-define(LAYERS, ["walls", "rooms", "doors", "places"]).
-define(MOST_CURVES, 50000).
-define(MOST_NAMES, 1000).
%% The greatest distance of a wall from the curve of which it is a chord.
-define(TOLERANCE_MM, 2.0).
%% A point is so far from the end of a line if it is another point.
-define(NEAR_MM, 0.01).

%% @doc The floor plan of a document; `ScaleMm' is the width of a unit of its viewBox.
-spec parse(binary(), ScaleMm :: number()) ->
    {ok, starl_floor:t()} | {error, starl_floor_text:problem()}.
parse(Bytes, Scale) ->
    case starl_svg_bounded:run(fun() -> starl_svg:layers(Bytes, ?LAYERS, ?MOST_CURVES) end) of
        {ok, #{frame := none}} ->
            {error, {none, "the drawing needs a viewBox, or a width and a height"}};
        {ok, #{parts := []}} ->
            Text = "nothing is drawn in a layer (group) named walls, rooms, doors or places",
            {error, {none, Text}};
        {ok, Layers} ->
            plan(Layers, Scale);
        {error, Problem} ->
            {error, {none, starl_svg_error:format(Problem)}}
    end.

plan(#{parts := Parts, frame := {X0, Y0, X1, Y1}, title := Title}, Scale) ->
    Map = {Scale, 0.0, 0.0, -Scale, -X0 * Scale, Y1 * Scale},
    Floor = #{
        name => unicode:characters_to_binary(string:trim(Title)),
        size => {(X1 - X0) * Scale, (Y1 - Y0) * Scale}
    },
    try
        Drawn = [{Layer, on_floor(Part, Map, Scale)} || {Layer, Part} <- Parts],
        {ok, starl_floor:new(maps:merge(Floor, layers(Drawn)))}
    catch
        throw:{?MODULE, Problem} -> {error, Problem}
    end.

layers(Drawn) ->
    Of = fun(Layer) -> [Part || {Name, Part} <- Drawn, Name =:= Layer] end,
    Rooms = Of("rooms"),
    Places = Of("places"),
    length(Rooms) + length(Places) =< ?MOST_NAMES orelse
        throw({?MODULE, {none, io_lib:format("a plan has at most ~b names", [?MOST_NAMES])}}),
    #{
        walls => lists:append([walls(Part) || Part <- Of("walls")]),
        rooms => named([{Part, room(Part)} || Part <- Rooms]),
        doors => lists:append([doors(Part) || Part <- Of("doors")]),
        places => named([{Part, place(Part)} || Part <- Places])
    }.

%% Outlines as chains of points on the floor, in micrometres that agree on all computers.
on_floor(#{outlines := Outlines, line := Line} = Part, Map, Scale) ->
    Chains = [chain(Outline, Map) || Outline <- Outlines],
    Part#{chains => [Chain || [_, _ | _] = Chain <- Chains], line := Line * Scale}.

-spec chain(outline(), starl_svg_transform:matrix()) -> [starl_geometry:point()].
chain([First | _] = Outline, Map) ->
    Curves = [starl_svg_curve:transform(Map, Curve) || Curve <- Outline],
    Points = [
        starl_svg_transform:apply(Map, starl_svg_curve:start(First))
        | lists:append([flat(Curve) || Curve <- Curves])
    ],
    apart([{round(X * 1000) / 1000, round(Y * 1000) / 1000} || {X, Y} <- Points]).

flat(Curve) -> starl_svg_curve:flatten(Curve, starl_svg_curve:steps(Curve, ?TOLERANCE_MM)).

apart([A, B | Rest]) ->
    case is_near(A, B) of
        true -> apart([A | Rest]);
        false -> [A | apart([B | Rest])]
    end;
apart(Points) ->
    Points.

is_near(A, B) -> starl_geometry:distance(A, B) < ?NEAR_MM.

is_closed([A | _] = Chain) -> is_near(A, lists:last(Chain)).

%% -- walls ------------------------------------------------------------------------------------

walls(#{chains := Chains, is_filled := IsFilled, line := Width} = Part) ->
    Rings = [ring(Chain) || IsFilled, Chain <- Chains],
    solid([Ring || [_, _, _ | _] = Ring <- Rings], rule(Part)) ++
        [Wall || Width > 0, Chain <- Chains, Wall <- stripe(Chain, Width)].

ring(Chain) ->
    case is_closed(Chain) of
        true -> lists:droplast(Chain);
        false -> Chain
    end.

rule(#{elements := Elements}) ->
    Rules = [
        string:trim(Rule)
     || Element <- Elements,
        Rule <- [starl_svg_xml:attribute(<<"fill-rule">>, Element, none)],
        Rule =/= none
    ],
    case Rules of
        [<<"evenodd">> | _] -> evenodd;
        _ -> nonzero
    end.

%% The outlines that have the inside of a shape on one side only, with what is solid on their left.
solid(Rings, Rule) ->
    Numbered = lists:enumerate(Rings),
    [
        Wall
     || {N, [Point | _] = Ring} <- Numbered,
        Around <- [lists:sum([starl_floor:winding(Point, R) || {M, R} <- Numbered, M =/= N])],
        Wall <- side(starl_floor:area(Ring), Around, Rule, Ring)
    ].

side(Area, Around, Rule, Ring) ->
    Turn =
        case Area > 0 of
            true -> 1;
            false -> -1
        end,
    case {is_inside(Around + Turn, Rule), is_inside(Around, Rule)} of
        {true, false} when Turn > 0 -> [Ring];
        {true, false} -> [lists:reverse(Ring)];
        {false, true} when Turn > 0 -> [lists:reverse(Ring)];
        {false, true} -> [Ring];
        {Same, Same} -> []
    end.

is_inside(Winding, evenodd) -> Winding rem 2 =/= 0;
is_inside(Winding, nonzero) -> Winding =/= 0.

%% A line of this width: a block for each straight piece. Where two pieces meet, both reach as far
%% as the corner of a mitre, at most half the width.
stripe(Chain, Width) ->
    Sides = lists:zip(lists:droplast(Chain), tl(Chain)),
    {Before, After} =
        case is_closed(Chain) of
            true -> {lists:last(Sides), hd(Sides)};
            false -> {none, none}
        end,
    Half = Width / 2,
    [
        block(Side, Half, mitre(Last, Side, Half), mitre(Side, Next, Half))
     || {Last, Side, Next} <- lists:zip3(
            [Before | lists:droplast(Sides)], Sides, tl(Sides) ++ [After]
        )
    ].

mitre(Side, Other, _Half) when Side =:= none; Other =:= none ->
    0.0;
mitre({A, B}, {C, D}, Half) ->
    Turn = starl_geometry:angle_diff(
        starl_geometry:heading(C, D), starl_geometry:heading(A, B)
    ),
    Half * math:tan(min(abs(Turn), math:pi() / 2) / 2).

block({{AX, AY} = A, {BX, BY} = B}, Half, Before, After) ->
    Length = starl_geometry:distance(A, B),
    {UX, UY} = {(BX - AX) / Length, (BY - AY) / Length},
    At = fun({X, Y}, Along, Left) -> {X + Along * UX - Left * UY, Y + Along * UY + Left * UX} end,
    [At(A, -Before, -Half), At(B, After, -Half), At(B, After, Half), At(A, -Before, Half)].

%% -- rooms, doors, places ----------------------------------------------------------------------

named(Named) ->
    lists:foldl(
        fun({Part, Shape}, Names) ->
            Name = name(Part),
            is_map_key(Name, Names) andalso fail(Part, "the name ~ts is there twice", [Name]),
            Names#{Name => Shape}
        end,
        #{},
        Named
    ).

%% Their number and length are bounded. The layer's own name is no name of a room.
name(#{elements := Elements} = Part) ->
    Within = lists:takewhile(fun(Element) -> not is_layer(Element) end, Elements),
    case [Name || Element <- Within, Name <- [starl_svg:name(Element)], Name =/= ""] of
        [] ->
            fail(Part, "a room or place needs a name: a label, a title or an id", []);
        [Name | _] ->
            case starl_floor_text:name(Name) of
                {ok, Atom} -> Atom;
                {error, What} -> fail(Part, "~ts", [What])
            end
    end.

is_layer(Element) -> lists:member(string:lowercase(starl_svg:name(Element)), ?LAYERS).

room(#{chains := Chains} = Part) ->
    case
        [
            {abs(starl_floor:area(Ring)), Ring}
         || [_, _, _ | _] = Ring <- lists:map(fun ring/1, Chains)
        ]
    of
        [] ->
            fail(Part, "a room needs an area", []);
        Rings ->
            {_, Ring} = lists:max(Rings),
            case starl_floor:area(Ring) < 0 of
                true -> lists:reverse(Ring);
                false -> Ring
            end
    end.

%% A door is a line, or an area: the line through its middle along its longer sides.
doors(#{chains := Chains}) -> [door(Chain) || Chain <- Chains].

door([A | _] = Chain) ->
    {X0, Y0, X1, Y1} = starl_geometry:box(Chain),
    case is_closed(Chain) of
        false -> {A, lists:last(Chain)};
        true when X1 - X0 > Y1 - Y0 -> {{X0, (Y0 + Y1) / 2}, {X1, (Y0 + Y1) / 2}};
        true -> {{(X0 + X1) / 2, Y0}, {(X0 + X1) / 2, Y1}}
    end.

place(#{chains := Chains}) ->
    {X0, Y0, X1, Y1} = starl_geometry:box(lists:append(Chains)),
    {(X0 + X1) / 2, (Y0 + Y1) / 2}.

-spec fail(map(), io:format(), [term()]) -> no_return().
fail(#{elements := [Element | _]}, Format, Args) ->
    throw({?MODULE, {starl_svg_xml:line(Element), io_lib:format(Format, Args)}}).
