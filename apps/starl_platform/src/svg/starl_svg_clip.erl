%% @doc Clipping by convex polygons: what the window of a nested picture, or a `clipPath' that is a
%% rectangle or another convex polygon, leaves of a line (Cyrus and Beck, 1978). A part of the SVG
%% reader, {@link starl_svg}.
-module(starl_svg_clip).

-export([rectangle/3, of_path/2, transform/2, box/1, covers/2, cut/2, edges/2]).
-export_type([t/0]).

-type point() :: starl_svg_curve:point().
-type matrix() :: starl_svg_transform:matrix().
%% The corners, in one or the other sense of rotation.
-opaque t() :: [point(), ...].

%% Numbers of curves that a clipping path may have.
-define(MOST, 100).
%% What lies this little outside, in mm on the floor, is on the boundary, where it is seen.
-define(BOUNDARY, 0.01).
-define(UNITS, {0.0, 0.0}).

%% @doc The image of a rectangle.
-spec rectangle(point(), Size :: point(), matrix()) -> t().
rectangle({X, Y}, {W, H}, Matrix) ->
    transform(Matrix, [{X, Y}, {X + W, Y}, {X + W, Y + H}, {X, Y + H}]).

%% @doc The polygon of a `clipPath' element; `unknown' if it is none, or not convex.
-spec of_path(starl_svg_xml:element_(), matrix()) -> {ok, t()} | none | unknown.
of_path(Element, Matrix) ->
    Units = starl_svg_xml:attribute(<<"clipPathUnits">>, Element, <<"userSpaceOnUse">>),
    case {starl_svg_xml:name(Element), Units, starl_svg_xml:children(Element)} of
        {<<"clipPath">>, <<"userSpaceOnUse">>, [Shape]} -> of_shape(Element, Shape, Matrix);
        {<<"clipPath">>, _, _} -> unknown;
        {_, _, _} -> none
    end.

%% @doc The image of a polygon.
-spec transform(matrix(), t()) -> t().
transform(Matrix, Corners) -> [starl_svg_transform:apply(Matrix, Corner) || Corner <- Corners].

%% @doc The box around a polygon.
-spec box(t()) -> starl_svg_curve:bounds().
box(Corners) ->
    {Xs, Ys} = lists:unzip(Corners),
    {lists:min(Xs), lists:min(Ys), lists:max(Xs), lists:max(Ys)}.

%% @doc Is all of a box seen?
-spec covers(t(), starl_svg_curve:bounds()) -> boolean().
covers(Clip, {X0, Y0, X1, Y1}) ->
    Sides = sides([{X0, Y0}, {X1, Y0}, {X1, Y1}, {X0, Y1}]),
    lists:all(fun(Side) -> cut(Clip, Side) =:= {ok, Side} end, Sides).

%% @doc The part of a segment that lies inside.
-spec cut(t(), {point(), point()}) -> {ok, {point(), point()}} | outside.
cut(Corners, {P, Q} = Segment) ->
    Sense = sign(area(Corners)),
    Bounds = lists:foldl(
        fun(Side, Bounds) -> narrowed(depth(Sense, Side, P), depth(Sense, Side, Q), Bounds) end,
        {0.0, 1.0},
        [Side || {From, To} = Side <- sides(Corners), From =/= To]
    ),
    case Bounds of
        {0.0, 1.0} -> {ok, Segment};
        {From, To} when From < To -> {ok, {between(P, Q, From), between(P, Q, To)}};
        {_, _} -> outside
    end.

%% @doc The edges that the polygons give to an area between them: what the other polygons leave of
%% their sides, as far as it lies within the area (by the winding number, as browsers fill it). What
%% runs along the area's own boundary is not among them.
-spec edges([t()], Boundary :: [{point(), point()}]) -> [{point(), point()}].
edges(Clips, Boundary) ->
    [
        Part
     || Clip <- Clips,
        Side <- sides(Clip),
        Seen <- cut_all(lists:delete(Clip, Clips), Side),
        Part <- within(Boundary, Seen)
    ].

%%% Internals

cut_all([], Segment) ->
    [Segment];
cut_all([Clip | Clips], Segment) ->
    case cut(Clip, Segment) of
        {ok, Part} -> cut_all(Clips, Part);
        outside -> []
    end.

%% The parts of a segment between two crossings of the boundary lie within the area or outside of it.
within(Boundary, {P, Q} = Segment) ->
    Crossings = [T || Line <- Boundary, {ok, T} <- [crossing(Segment, Line)]],
    Parts = parts(lists:usort([0.0, 1.0 | Crossings])),
    [
        {between(P, Q, From), between(P, Q, To)}
     || {From, To} <- Parts, is_within(between(P, Q, (From + To) / 2.0), Boundary)
    ].

parts([From | [To | _] = Rest]) -> [{From, To} | parts(Rest)];
parts([_Last]) -> [].

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

is_within(Point, Boundary) ->
    not lists:any(fun(Line) -> starl_geometry:point_segment(Point, Line) < ?BOUNDARY end, Boundary) andalso
        lists:sum([turn(Point, Line) || Line <- Boundary]) =/= 0.

%% How often a line goes round a point: upwards to the right of it, or downwards.
turn({_, Y} = Point, {{_, Y0}, {_, Y1}} = Line) ->
    case left(Line, Point) of
        L when Y0 =< Y, Y1 > Y, L > 0.0 -> 1;
        L when Y0 > Y, Y1 =< Y, L < 0.0 -> -1;
        _ -> 0
    end.

of_shape(Element, Shape, Matrix0) ->
    IsShape = lists:member(starl_svg_xml:name(Shape), starl_svg_shape:names()),
    Matrix = starl_svg_window:transformed(
        Shape, ?UNITS, starl_svg_window:transformed(Element, ?UNITS, Matrix0)
    ),
    case IsShape andalso starl_svg_shape:outlines(Shape, ?UNITS, ?MOST) of
        {ok, [Outline]} -> of_outline(Outline, Matrix);
        _ -> unknown
    end.

of_outline(Outline, Matrix) ->
    Closed = starl_svg_area:closed(Outline),
    Lines = [Line || {line, _, _} = Line <- Closed],
    Corners = [From || {line, From, To} <- Lines, From =/= To],
    case length(Corners) >= 3 andalso length(Lines) =:= length(Closed) of
        true -> convex(transform(Matrix, Corners));
        false -> unknown
    end.

%% Every corner lies on the inner side of every side.
convex(Corners) ->
    Area = area(Corners),
    Give = 1.0e-6 * abs(Area),
    Inside = [
        sign(Area) * left(Side, Corner) >= -Give
     || Side <- sides(Corners), Corner <- Corners
    ],
    case Area /= 0.0 andalso lists:all(fun(Is) -> Is end, Inside) of
        true -> {ok, Corners};
        false -> unknown
    end.

sides([First | _] = Corners) -> lists:zip(Corners, tl(Corners) ++ [First]).

%% Twice the area, with the sign of the sense of rotation.
area(Corners) -> lists:sum([X0 * Y1 - X1 * Y0 || {{X0, Y0}, {X1, Y1}} <- sides(Corners)]).

sign(X) when X < 0.0 -> -1.0;
sign(_) -> 1.0.

%% How deep inside of a side a point lies.
depth(Sense, {{X0, Y0}, {X1, Y1}} = Side, Point) ->
    Length = math:sqrt((X1 - X0) * (X1 - X0) + (Y1 - Y0) * (Y1 - Y0)),
    Sense * left(Side, Point) / Length.

%% Positive for points to the left of a side, seen along it.
left({{X0, Y0}, {X1, Y1}}, {X, Y}) -> (X1 - X0) * (Y - Y0) - (Y1 - Y0) * (X - X0).

%% The bounds of the parameter after one more side; A and B are the depths of the ends.
narrowed(A, B, Bounds) when A >= -?BOUNDARY, B >= -?BOUNDARY -> Bounds;
narrowed(A, B, _Bounds) when A =< 0.0, B =< 0.0 -> {1.0, 0.0};
narrowed(A, B, {From, To}) when A < 0.0 -> {max(From, A / (A - B)), To};
narrowed(A, B, {From, To}) -> {From, min(To, A / (A - B))}.

between({X0, Y0}, {X1, Y1}, T) -> {X0 + (X1 - X0) * T, Y0 + (Y1 - Y0) * T}.
