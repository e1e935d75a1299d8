%% @doc Clips lines to the window of a nested picture, or to the shapes of a `clipPath'. A convex
%% polygon cuts by its sides (Cyrus and Beck, 1978). For any other area the winding number decides
%% what is inside, as in browsers. Curves become chords on the floor, within a tolerance. A part of
%% the SVG reader, {@link starl_svg}.
-module(starl_svg_clip).

-export([rectangle/3, of_path/3, placed/3, box/1, covers/2, cut/2, edges/2]).
-export_type([t/0]).

-type segment() :: {starl_geometry:point(), starl_geometry:point()}.
-type matrix() :: starl_svg_transform:matrix().
%% What is inside of an outline that crosses itself, or of several: that round which they go in all, or an odd
%% number of times.
-type rule() :: nonzero | evenodd.
%% A convex polygon, by its corners in one or the other sense of rotation; shapes, which together are the
%% window, each by its closed outlines; the same by their sides.
-opaque t() ::
    {convex, [starl_geometry:point(), ...]}
    | {shapes, [{rule(), [starl_svg_shape:outline()]}, ...]}
    | {area, [{rule(), [segment()]}, ...]}.

%% Numbers of curves that a shape of a clipping path may have, and of its shapes.
-define(MOST, 100).
-define(MOST_SHAPES, 20).
%% What lies this little outside, in mm on the floor, is on the boundary, where it is seen.
-define(BOUNDARY, 0.01).
%% The part of a window's size by which chords may miss it while the floor is not known.
-define(ROUGH, 0.001).
-define(UNITS, {0.0, 0.0}).

%% @doc The image of a rectangle.
-spec rectangle(starl_geometry:point(), Size :: starl_geometry:point(), matrix()) -> t().
rectangle({X, Y}, {W, H}, Matrix) ->
    {convex, moved(Matrix, [{X, Y}, {X + W, Y}, {X + W, Y + H}, {X, Y + H}])}.

%% @doc The window of a `clipPath' element, which may name shapes elsewhere in the document by `use';
%% `empty' if it hides everything, `none' if it is no such element, `unknown' if it has too many shapes, or
%% what is none.
-spec of_path(starl_svg_xml:element_(), matrix(), #{Id :: binary() => starl_svg_xml:element_()}) ->
    {ok, t()} | empty | none | unknown.
of_path(Element, Matrix, Ids) ->
    Units = starl_svg_xml:attribute(<<"clipPathUnits">>, Element, <<"userSpaceOnUse">>),
    Shapes = [Child || Child <- starl_svg_xml:children(Element), is_shown(Child)],
    case {starl_svg_xml:name(Element), Units} of
        {<<"clipPath">>, <<"userSpaceOnUse">>} when length(Shapes) =< ?MOST_SHAPES ->
            Inner = starl_svg_window:transformed(Element, ?UNITS, Matrix),
            Rule = starl_svg_xml:attribute(<<"clip-rule">>, Element, <<"nonzero">>),
            of_shapes(lists:append([of_shape(Shape, Rule, Inner, Ids) || Shape <- Shapes]));
        {<<"clipPath">>, _} ->
            unknown;
        {_, _} ->
            none
    end.

is_shown(Child) ->
    starl_svg_xml:name(Child) =/= <<"title">> andalso starl_svg_paint:is_displayed(Child).

%% @doc The image of a window on the floor; its curves are chords that miss them by at most this tolerance.
-spec placed(matrix(), Tolerance :: float(), t()) -> t().
placed(Matrix, _Tolerance, {convex, Corners}) ->
    {convex, moved(Matrix, Corners)};
placed(Matrix, Tolerance, {shapes, Shapes}) ->
    {area, [
        {Rule, lists:append([chords(outline(Matrix, Outline), Tolerance) || Outline <- Outlines])}
     || {Rule, Outlines} <- Shapes
    ]}.

%% @doc The box around a window that is not on the floor yet.
-spec box(t()) -> starl_svg_curve:bounds().
box({convex, Corners}) ->
    {Xs, Ys} = lists:unzip(Corners),
    {lists:min(Xs), lists:min(Ys), lists:max(Xs), lists:max(Ys)};
box({shapes, Shapes}) ->
    starl_svg_area:box(lists:append([Outlines || {_, Outlines} <- Shapes])).

%% @doc Is all of a box seen through a window that is not on the floor yet?
-spec covers(t(), starl_svg_curve:bounds()) -> boolean().
covers({shapes, _} = Clip, Box) ->
    {X0, Y0, X1, Y1} = box(Clip),
    Rough = placed(starl_svg_transform:identity(), ?ROUGH * max(X1 - X0, Y1 - Y0), Clip),
    covers_sides(Rough, Box) andalso edges([Rough], box_sides(Box)) =:= [];
covers({convex, _} = Clip, Box) ->
    covers_sides(Clip, Box).

covers_sides(Clip, Box) ->
    lists:all(fun(Side) -> cut(Clip, Side) =:= [Side] end, box_sides(Box)).

box_sides({X0, Y0, X1, Y1}) -> sides([{X0, Y0}, {X1, Y0}, {X1, Y1}, {X0, Y1}]).

%% @doc The parts of a segment that lie inside of a window on the floor, in their order.
-spec cut(t(), segment()) -> [segment()].
cut({convex, Corners}, {P, Q} = Segment) ->
    Sense = sign(area(Corners)),
    Bounds = lists:foldl(
        fun(Side, Bounds) -> narrowed(depth(Sense, Side, P), depth(Sense, Side, Q), Bounds) end,
        {0.0, 1.0},
        [Side || {From, To} = Side <- sides(Corners), From =/= To]
    ),
    case Bounds of
        {0.0, 1.0} -> [Segment];
        {From, To} when From < To -> [{between(P, Q, From), between(P, Q, To)}];
        {_, _} -> []
    end;
cut({area, Shapes}, Segment) ->
    Sides = all_sides(Shapes),
    split(Segment, Sides, fun(Point) -> is_in(Point, Shapes) orelse is_near(Point, Sides) end).

%% @doc The edges that windows on the floor give to an area between them: what the other windows leave of
%% their boundaries, as far as it lies within the area (by the winding number, as browsers fill it). What
%% runs along the area's own boundary is not among them.
-spec edges([t()], Boundary :: [segment()]) -> [segment()].
edges(Clips, Boundary) ->
    [
        Part
     || Clip <- Clips,
        Side <- boundary(Clip),
        Seen <- cut_all(lists:delete(Clip, Clips), Side),
        Part <- within(Boundary, Seen)
    ].

%%% Internals

%% The sides of a window: where shapes overlap, their boundaries are none.
boundary({convex, Corners}) ->
    sides(Corners);
boundary({area, Shapes}) ->
    Sides = all_sides(Shapes),
    lists:append([
        split(Side, Sides, fun(Point) -> is_edge(Point, normal(Side), Shapes) end)
     || Side <- Sides
    ]).

%% Only on one side of an edge something is seen.
is_edge({X, Y}, {NX, NY}, Shapes) ->
    is_in({X + NX, Y + NY}, Shapes) =/= is_in({X - NX, Y - NY}, Shapes).

%% Beyond what counts as the boundary.
normal({{X0, Y0}, {X1, Y1}} = Side) ->
    Length = length_of(Side),
    {2.0 * ?BOUNDARY * (Y0 - Y1) / Length, 2.0 * ?BOUNDARY * (X1 - X0) / Length}.

all_sides(Shapes) -> lists:append([Sides || {_, Sides} <- Shapes]).

cut_all([], Segment) -> [Segment];
cut_all([Clip | Clips], Segment) -> [P || Part <- cut(Clip, Segment), P <- cut_all(Clips, Part)].

within(Boundary, Segment) ->
    split(Segment, Boundary, fun(Point) ->
        not is_near(Point, Boundary) andalso winding(Point, Boundary) =/= 0
    end).

%% The parts of a segment whose middles are taken: between two crossings of lines all is alike.
split({P, Q} = Segment, Lines, IsTaken) ->
    Crossings = [T || Line <- Lines, {ok, T} <- [crossing(Segment, Line)]],
    Taken = [
        Part
     || {From, To} = Part <- parts(lists:usort([0.0, 1.0 | Crossings])),
        IsTaken(between(P, Q, (From + To) / 2.0))
    ],
    [{at(P, Q, From), at(P, Q, To)} || {From, To} <- joined(Taken)].

parts([From | [To | _] = Rest]) -> [{From, To} | parts(Rest)];
parts([_Last]) -> [].

joined([{From, At}, {At, To} | Rest]) -> joined([{From, To} | Rest]);
joined([Part | Rest]) -> [Part | joined(Rest)];
joined([]) -> [].

%% Its ends are those of the segment itself.
at(P, _Q, 0.0) -> P;
at(_P, Q, 1.0) -> Q;
at(P, Q, T) -> between(P, Q, T).

%% Where on the segment it crosses a line, from 0 to 1. A parallel one it does not cross.
crossing({P, Q}, Line) ->
    case {left(Line, P), left(Line, Q)} of
        {Same, Same} ->
            none;
        {L0, L1} ->
            T = L0 / (L0 - L1),
            case
                T > 0.0 andalso T < 1.0 andalso
                    starl_geometry:point_segment(between(P, Q, T), Line) < ?BOUNDARY
            of
                true -> {ok, T};
                false -> none
            end
    end.

is_near(Point, Lines) ->
    lists:any(fun(Line) -> starl_geometry:point_segment(Point, Line) < ?BOUNDARY end, Lines).

is_in(Point, Shapes) ->
    lists:any(fun({Rule, Sides}) -> is_inside(Rule, winding(Point, Sides)) end, Shapes).

is_inside(nonzero, Turns) -> Turns =/= 0;
is_inside(evenodd, Turns) -> Turns rem 2 =/= 0.

winding(Point, Lines) -> lists:sum([turn(Point, Line) || Line <- Lines]).

%% How often a line goes round a point: upwards to the right of it, or downwards.
turn({_, Y} = Point, {{_, Y0}, {_, Y1}} = Line) ->
    case left(Line, Point) of
        L when Y0 =< Y, Y1 > Y, L > 0.0 -> 1;
        L when Y0 > Y, Y1 =< Y, L < 0.0 -> -1;
        _ -> 0
    end.

%% One convex polygon cuts faster than others.
of_shapes([]) ->
    empty;
of_shapes(Shapes) ->
    case {lists:member(unknown, Shapes), Shapes} of
        {true, _} -> unknown;
        {false, [{_, [Outline]} = Shape]} -> {ok, of_outline(Outline, Shape)};
        {false, _} -> {ok, {shapes, Shapes}}
    end.

of_shape(Shape, Inherited, Matrix0, Ids) ->
    Matrix = starl_svg_window:transformed(Shape, ?UNITS, Matrix0),
    Rule = starl_svg_xml:attribute(<<"clip-rule">>, Shape, Inherited),
    IsCut = starl_svg_xml:attribute(<<"clip-path">>, Shape, <<"none">>) =/= <<"none">>,
    case starl_svg_xml:name(Shape) of
        _ when IsCut ->
            [unknown];
        <<"use">> ->
            of_use(Shape, Rule, Matrix, Ids);
        Name ->
            IsShape = lists:member(Name, starl_svg_shape:names()),
            case IsShape andalso starl_svg_shape:outlines(Shape, ?UNITS, ?MOST) of
                {ok, []} ->
                    [];
                {ok, Outlines} ->
                    Closed = [outline(Matrix, starl_svg_area:closed(Each)) || Each <- Outlines],
                    [{rule(Rule), Closed}];
                _ ->
                    [unknown]
            end
    end.

%% As Illustrator writes its windows. One that names nothing, or what is not displayed, adds nothing.
of_use(Use, Rule, Matrix, Ids) ->
    Corner = starl_svg_window:corner(Use, ?UNITS),
    case starl_svg_xml:attribute(<<"href">>, Use, <<>>) of
        <<$#, Id/binary>> when is_map_key(Id, Ids) ->
            Target = maps:get(Id, Ids),
            case {is_shown(Target), starl_svg_xml:name(Target)} of
                {false, _} ->
                    [];
                {true, <<"use">>} ->
                    [unknown];
                {true, _} ->
                    of_shape(Target, Rule, starl_svg_window:moved(Use, Corner, Matrix), Ids)
            end;
        _ ->
            []
    end.

rule(<<"evenodd">>) -> evenodd;
rule(_) -> nonzero.

of_outline(Outline, Shape) ->
    Corners = [From || {line, From, To} <- Outline, From =/= To],
    IsPolygon = lists:all(fun(Curve) -> element(1, Curve) =:= line end, Outline),
    case IsPolygon andalso length(Corners) >= 3 andalso is_convex(Corners) of
        true -> {convex, Corners};
        false -> {shapes, [Shape]}
    end.

outline(Matrix, Outline) -> [starl_svg_curve:transform(Matrix, Curve) || Curve <- Outline].

moved(Matrix, Corners) -> [starl_svg_transform:apply(Matrix, Corner) || Corner <- Corners].

%% The chords of a closed outline.
chords([First | _] = Outline, Tolerance) ->
    Points = lists:append([
        starl_svg_curve:flatten(Curve, starl_svg_curve:steps(Curve, Tolerance))
     || Curve <- Outline
    ]),
    From = starl_svg_curve:start(First),
    [{P, Q} || {P, Q} <- lists:zip([From | lists:droplast(Points)], Points), P =/= Q].

%% Every corner lies on the inner side of every side.
is_convex(Corners) ->
    Area = area(Corners),
    Give = 1.0e-6 * abs(Area),
    Area /= 0.0 andalso
        lists:all(
            fun(Inside) -> Inside end,
            [
                sign(Area) * left(Side, Corner) >= -Give
             || Side <- sides(Corners), Corner <- Corners
            ]
        ).

sides([First | _] = Corners) -> lists:zip(Corners, tl(Corners) ++ [First]).

%% Twice the area, with the sign of the sense of rotation.
area(Corners) -> lists:sum([X0 * Y1 - X1 * Y0 || {{X0, Y0}, {X1, Y1}} <- sides(Corners)]).

sign(X) when X < 0.0 -> -1.0;
sign(_) -> 1.0.

%% How deep inside of a side a point lies.
depth(Sense, Side, Point) -> Sense * left(Side, Point) / length_of(Side).

length_of({{X0, Y0}, {X1, Y1}}) ->
    math:sqrt((X1 - X0) * (X1 - X0) + (Y1 - Y0) * (Y1 - Y0)).

%% Positive for points to the left of a side, seen along it.
left({{X0, Y0}, {X1, Y1}}, {X, Y}) -> (X1 - X0) * (Y - Y0) - (Y1 - Y0) * (X - X0).

%% The bounds of the parameter after one more side; A and B are the depths of the ends.
narrowed(A, B, Bounds) when A >= -?BOUNDARY, B >= -?BOUNDARY -> Bounds;
narrowed(A, B, _Bounds) when A =< 0.0, B =< 0.0 -> {1.0, 0.0};
narrowed(A, B, {From, To}) when A < 0.0 -> {max(From, A / (A - B)), To};
narrowed(A, B, {From, To}) -> {From, min(To, A / (A - B))}.

between({X0, Y0}, {X1, Y1}, T) -> {X0 + (X1 - X0) * T, Y0 + (Y1 - Y0) * T}.
