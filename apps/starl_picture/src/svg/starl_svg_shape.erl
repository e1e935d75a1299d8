%% @doc Converts the basic shapes and paths of SVG to outlines (SVG 1.1, chapter 9), and reads their
%% numbers from attributes. A part of the SVG reader, {@link starl_svg}.
-module(starl_svg_shape).

-export([names/0, outlines/3, number/4]).
-export([drawn/1]).
-export_type([problem/0, viewport/0, outline/0]).

%% Width and height that percentages refer to, in user units.
-type viewport() :: {float(), float()}.
%% A bad attribute and its text, or a mistake in path data; `too_many': the shape alone has more
%% curves than allowed.
-type problem() ::
    {bad_number, Attribute :: binary(), Text :: binary()}
    | {bad_path, Offset :: non_neg_integer(), starl_svg_path:problem()}
    | too_many.
-type axis() :: x | y | diagonal.
-type element_() :: starl_svg_xml:element_().

-define(PI, 3.141592653589793).

%% Curves that follow each other without a gap.
-type outline() :: [starl_svg_curve:t(), ...].

-record(pen, {
    at = {0.0, 0.0} :: starl_geometry:point(),
    %% The start of the subpath, to which `Z' returns.
    from = {0.0, 0.0} :: starl_geometry:point(),
    %% The last control point, for the smooth commands, and the kind of its curve.
    control = none :: none | {quad | cubic, starl_geometry:point()},
    current = [] :: [starl_svg_curve:t()],
    done = [] :: [outline()]
}).

%% @doc The names of the elements that are shapes.
-spec names() -> [binary()].
names() ->
    [
        <<"line">>,
        <<"polyline">>,
        <<"polygon">>,
        <<"rect">>,
        <<"circle">>,
        <<"ellipse">>,
        <<"path">>
    ].

%% @doc The outlines of one shape in the shape's user units; at most `Max' curves.
-spec outlines(element_(), viewport(), Max :: non_neg_integer()) ->
    {ok, [outline()]} | {error, problem()}.
outlines(Element, Viewport, Max) ->
    %% Several attributes are read in one expression; the first bad one throws.
    try shape(starl_svg_xml:name(Element), Element, Viewport, Max) of
        Outlines -> {ok, Outlines}
    catch
        throw:{?MODULE, Problem} -> {error, Problem}
    end.

%% @doc An attribute as a length in user units, `Default' when it is absent or `auto'.
-spec number(element_(), binary(), float(), Default) ->
    {ok, float() | Default} | {error, problem()}.
number(Element, Name, Whole, Default) ->
    case starl_svg_xml:attribute(Name, Element) of
        undefined ->
            {ok, Default};
        <<"auto">> ->
            {ok, Default};
        Text ->
            case starl_svg_number:length(Text, Whole) of
                {ok, Number} -> {ok, Number};
                {error, _} -> {error, {bad_number, Name, Text}}
            end
    end.

%%% Internals

shape(<<"line">>, E, View, _Max) ->
    From = {coordinate(E, <<"x1">>, x, View), coordinate(E, <<"y1">>, y, View)},
    [[{line, From, {coordinate(E, <<"x2">>, x, View), coordinate(E, <<"y2">>, y, View)}}]];
shape(<<"polyline">>, E, _View, Max) ->
    chain(points(E, Max));
shape(<<"polygon">>, E, _View, Max) ->
    case points(E, Max) of
        [] -> [];
        [First | _] = Points -> chain(Points ++ [First])
    end;
shape(<<"rect">>, E, View, _Max) ->
    rect(E, View);
shape(<<"circle">>, E, View, _Max) ->
    R = positive(E, <<"r">>, diagonal, View, 0.0),
    ellipse(E, View, {R, R});
shape(<<"ellipse">>, E, View, _Max) ->
    RX = positive(E, <<"rx">>, x, View, none),
    RY = positive(E, <<"ry">>, y, View, none),
    ellipse(E, View, {other(RX, RY), other(RY, RX)});
shape(<<"path">>, E, _View, Max) ->
    case starl_svg_path:parse(starl_svg_xml:attribute(<<"d">>, E, <<>>), Max) of
        {ok, Commands} -> drawn(Commands);
        {error, too_many} -> fail(too_many);
        {error, {Offset, Problem}} -> fail({bad_path, Offset, Problem})
    end.

rect(E, View) ->
    Corner = {coordinate(E, <<"x">>, x, View), coordinate(E, <<"y">>, y, View)},
    Size = {positive(E, <<"width">>, x, View, 0.0), positive(E, <<"height">>, y, View, 0.0)},
    RX = positive(E, <<"rx">>, x, View, none),
    RY = positive(E, <<"ry">>, y, View, none),
    rect(Corner, Size, radii(RX, RY, Size)).

rect(_Corner, {W, H}, _Radii) when W == 0.0; H == 0.0 ->
    [];
rect({X, Y}, {W, H}, {RX, RY}) when RX == 0.0; RY == 0.0 ->
    chain([{X, Y}, {X + W, Y}, {X + W, Y + H}, {X, Y + H}, {X, Y}]);
rect({X0, Y0}, {W, H}, {RX, RY}) ->
    {X1, Y1} = {X0 + W, Y0 + H},
    Corner = fun(CX, CY, Quarter) ->
        starl_svg_curve:ellipse({CX, CY}, {RX, RY}, Quarter * ?PI / 2.0, ?PI / 2.0)
    end,
    [
        [
            {line, {X0 + RX, Y0}, {X1 - RX, Y0}},
            Corner(X1 - RX, Y0 + RY, 3),
            {line, {X1, Y0 + RY}, {X1, Y1 - RY}},
            Corner(X1 - RX, Y1 - RY, 0),
            {line, {X1 - RX, Y1}, {X0 + RX, Y1}},
            Corner(X0 + RX, Y1 - RY, 1),
            {line, {X0, Y1 - RY}, {X0, Y0 + RY}},
            Corner(X0 + RX, Y0 + RY, 2)
        ]
    ].

%% A single radius counts for both; neither exceeds half the side.
radii(RX, RY, {W, H}) -> {min(other(RX, RY), W / 2.0), min(other(RY, RX), H / 2.0)}.

other(none, none) -> 0.0;
other(none, R) -> R;
other(R, _) -> R.

ellipse(_E, _View, {RX, RY}) when RX == 0.0; RY == 0.0 ->
    [];
ellipse(E, View, Radii) ->
    Centre = {coordinate(E, <<"cx">>, x, View), coordinate(E, <<"cy">>, y, View)},
    [[starl_svg_curve:ellipse(Centre, Radii, 0.0, 2.0 * ?PI)]].

points(E, Max) ->
    Text = starl_svg_xml:attribute(<<"points">>, E, <<>>),
    case starl_svg_number:list(Text) of
        {ok, Numbers} when length(Numbers) rem 2 =:= 1 -> fail({bad_number, <<"points">>, Text});
        {ok, Numbers} when length(Numbers) > 2 * Max + 2 -> fail(too_many);
        {ok, Numbers} -> pairs(Numbers);
        {error, _} -> fail({bad_number, <<"points">>, Text})
    end.

pairs([X, Y | Rest]) -> [{X, Y} | pairs(Rest)];
pairs([]) -> [].

chain([_, _ | _] = Points) -> [chain_lines(Points)];
chain(_) -> [].

chain_lines([P0, P1 | Rest]) -> [{line, P0, P1} | chain_lines([P1 | Rest])];
chain_lines([_]) -> [].

coordinate(E, Name, Axis, View) -> value(number(E, Name, whole(Axis, View), 0.0)).

positive(E, Name, Axis, View, Default) ->
    case value(number(E, Name, whole(Axis, View), Default)) of
        Number when is_float(Number), Number < 0.0 ->
            fail({bad_number, Name, starl_svg_xml:attribute(Name, E, <<>>)});
        Number ->
            Number
    end.

value({ok, Number}) -> Number;
value({error, Problem}) -> fail(Problem).

-spec whole(axis(), viewport()) -> float().
whole(x, {W, _H}) -> W;
whole(y, {_W, H}) -> H;
whole(diagonal, {W, H}) -> math:sqrt((W * W + H * H) / 2.0).

-spec fail(problem()) -> no_return().
fail(Problem) -> throw({?MODULE, Problem}).

%% -- the pen ----------------------------------------------------------------------------------

%% A virtual pen follows the commands of a path (SVG 1.1, section 8.3).

%% @doc The outlines of a path, one per non-empty subpath, in user units.
-spec drawn([starl_svg_path:command()]) -> [outline()].
drawn(Commands) ->
    #pen{done = Done} = lift(lists:foldl(fun command/2, #pen{}, Commands)),
    lists:reverse(Done).

command({Letter, Numbers}, #pen{at = {X, Y}} = Pen) when Letter >= $a ->
    draw(Letter - $a + $A, Numbers, {X, Y}, Pen);
command({Letter, Numbers}, Pen) ->
    draw(Letter, Numbers, {0.0, 0.0}, Pen).

%% Coordinates are relative to the origin `{OX, OY}'.
draw($M, [X, Y], {OX, OY}, Pen) ->
    To = {OX + X, OY + Y},
    (lift(Pen))#pen{at = To, from = To, control = none};
draw($Z, [], _Origin, #pen{at = At, from = From} = Pen) ->
    lift(add({line, At, From}, From, none, Pen));
draw($L, [X, Y], {OX, OY}, Pen) ->
    line_to({OX + X, OY + Y}, Pen);
draw($H, [X], {OX, _OY}, #pen{at = {_, AtY}} = Pen) ->
    line_to({OX + X, AtY}, Pen);
draw($V, [Y], {_OX, OY}, #pen{at = {AtX, _}} = Pen) ->
    line_to({AtX, OY + Y}, Pen);
draw($C, [X1, Y1, X2, Y2, X, Y], {OX, OY}, Pen) ->
    cubic({OX + X1, OY + Y1}, {OX + X2, OY + Y2}, {OX + X, OY + Y}, Pen);
draw($S, [X2, Y2, X, Y], {OX, OY}, Pen) ->
    cubic(reflected(cubic, Pen), {OX + X2, OY + Y2}, {OX + X, OY + Y}, Pen);
draw($Q, [X1, Y1, X, Y], {OX, OY}, Pen) ->
    quad({OX + X1, OY + Y1}, {OX + X, OY + Y}, Pen);
draw($T, [X, Y], {OX, OY}, Pen) ->
    quad(reflected(quad, Pen), {OX + X, OY + Y}, Pen);
draw($A, [RX, RY, Degrees, Large, Sweep, X, Y], {OX, OY}, #pen{at = At} = Pen) ->
    To = {OX + X, OY + Y},
    Arc = starl_svg_curve:arc(At, {RX, RY}, Degrees, Large == 1.0, Sweep == 1.0, To),
    add(Arc, To, none, Pen).

line_to(To, #pen{at = At} = Pen) ->
    add({line, At, To}, To, none, Pen).

quad(C, To, #pen{at = At} = Pen) ->
    add({quad, At, C, To}, To, {quad, C}, Pen).

cubic(C1, C2, To, #pen{at = At} = Pen) ->
    add({cubic, At, C1, C2, To}, To, {cubic, C2}, Pen).

%% The last control point reflected in the pen's position; after another kind of command the
%% position itself.
reflected(Kind, #pen{at = {X, Y}, control = {Kind, {CX, CY}}}) -> {2.0 * X - CX, 2.0 * Y - CY};
reflected(_Kind, #pen{at = At}) -> At.

add(Curve, To, Control, #pen{current = Current} = Pen) ->
    Pen#pen{at = To, control = Control, current = [Curve | Current]}.

%% Ends the subpath.
lift(#pen{current = []} = Pen) ->
    Pen;
lift(#pen{current = Current, done = Done} = Pen) ->
    Pen#pen{current = [], done = [lists:reverse(Current) | Done]}.
