%% @doc The areas of geocasts: circles, rectangles and polygons. Decides whether a moving robot
%% stays inside or outside of an area, at every instant of a time span.
%%
%% The <em>depth</em> of a point is its distance from the area's border, positive inside and
%% negative outside. The border itself (depth 0) belongs to the area. The depth changes by at most
%% as much as the point moves. So a path of length l around a point of depth d stays between d - l
%% and d + l. The time span is halved until these bounds decide. This gives an answer for every
%% instant, for straight lines and arcs alike.
-module(starl_geocast_area).

-export([check/1, inside/2, depth/2, keeps_inside/5, keeps_outside/4, format_error/1]).

-export_type([area/0, reason/0]).

%% Lengths in millimetres. A polygon is closed from its last point to its first; where its sides
%% cross, the parts that a ray leaves after an odd number of sides are inside.
-type area() ::
    {circle, Centre :: starl_geometry:point(), RadiusMm :: float()}
    | {rectangle, starl_geometry:box()}
    | {polygon, [starl_geometry:point()]}.

%% Why a term is no area.
-type reason() :: not_an_area | negative_radius | upside_down | too_few_points.

%% Paths shorter than this (mm) are not halved any further.
-define(PRECISION_MM, 1.0e-3).

%% Nothing is farther off (mm): larger numbers have no square.
-define(FARTHEST, 1.0e9).
-define(IS_LENGTH(X), is_float(X), X =< ?FARTHEST, X >= -?FARTHEST).

%% @doc Is this an area?
-spec check(term()) -> ok | {error, reason()}.
check({circle, {X, Y}, R}) when ?IS_LENGTH(X), ?IS_LENGTH(Y), ?IS_LENGTH(R) ->
    verdict(R >= 0.0, negative_radius);
check({rectangle, {X0, Y0, X1, Y1}}) when
    ?IS_LENGTH(X0), ?IS_LENGTH(Y0), ?IS_LENGTH(X1), ?IS_LENGTH(Y1)
->
    verdict(X0 =< X1 andalso Y0 =< Y1, upside_down);
check({polygon, Points}) when length(Points) >= 0 ->
    case length(Points) >= 3 of
        true -> verdict(lists:all(fun is_point/1, Points), not_an_area);
        false -> {error, too_few_points}
    end;
check(_) ->
    {error, not_an_area}.

%% @doc One line that says what is wrong.
-spec format_error(reason()) -> string().
format_error(not_an_area) ->
    "an area is {circle, Centre, Radius}, {rectangle, {X0, Y0, X1, Y1}} or {polygon, Points},"
    " all numbers floats (mm) within 1.0e9";
format_error(negative_radius) ->
    "the radius of a circle must not be negative";
format_error(upside_down) ->
    "a rectangle is {X0, Y0, X1, Y1} with X0 =< X1 and Y0 =< Y1";
format_error(too_few_points) ->
    "a polygon has at least three points".

%% @doc Does the point belong to the area?
-spec inside(starl_geometry:point(), area()) -> boolean().
inside(Point, Area) -> depth(Point, Area) >= 0.0.

%% @doc The distance from the border in millimetres, negative outside.
-spec depth(starl_geometry:point(), area()) -> number().
depth(Point, {circle, Centre, Radius}) ->
    Radius - starl_geometry:distance(Point, Centre);
depth({X, Y}, {rectangle, {X0, Y0, X1, Y1}}) ->
    DX = max(X0 - X, X - X1),
    DY = max(Y0 - Y, Y - Y1),
    case DX =< 0.0 andalso DY =< 0.0 of
        true -> -max(DX, DY);
        false -> -math:sqrt(square(max(DX, 0.0)) + square(max(DY, 0.0)))
    end;
depth(Point, {polygon, [First | Rest] = Points}) ->
    Sides = lists:zip(Points, Rest ++ [First]),
    Distance = lists:min([starl_geometry:point_segment(Point, Side) || Side <- Sides]),
    Crossed = length([Side || Side <- Sides, right_of(Point, Side)]),
    case Crossed rem 2 of
        1 -> Distance;
        0 -> -Distance
    end.

%% @doc Is the robot on this piece of motion at least `MarginMm' inside at every instant from
%% `T1' to `T2' (us)? True only when that is certain to a thousandth of a millimetre.
-spec keeps_inside(
    starl_trajectory:piece(), T1 :: integer(), T2 :: integer(), area(), MarginMm :: float()
) -> boolean().
keeps_inside(Piece, T1, T2, Area, Margin) ->
    keeps(fun(Point) -> depth(Point, Area) - Margin end, Piece, T1, T2).

%% @doc Is the robot outside at every instant from `T1' to `T2'? Likewise.
-spec keeps_outside(starl_trajectory:piece(), T1 :: integer(), T2 :: integer(), area()) ->
    boolean().
keeps_outside(Piece, T1, T2, Area) ->
    keeps(fun(Point) -> -depth(Point, Area) - ?PRECISION_MM end, Piece, T1, T2).

%% -- internals ------------------------------------------------------------------------------

verdict(true, _Reason) -> ok;
verdict(false, Reason) -> {error, Reason}.

is_point({X, Y}) when ?IS_LENGTH(X), ?IS_LENGTH(Y) -> true;
is_point(_) -> false.

square(X) -> X * X.

%% Does the ray from the point to the right cross the side? A corner on the ray belongs to the
%% side above it only, so that it counts once.
right_of({_X, Y}, {{_, Y0}, {_, Y1}}) when Y0 > Y, Y1 > Y -> false;
right_of({_X, Y}, {{_, Y0}, {_, Y1}}) when Y0 =< Y, Y1 =< Y -> false;
right_of({X, Y}, {{X0, Y0}, {X1, Y1}}) -> X < X0 + (Y - Y0) * (X1 - X0) / (Y1 - Y0).

%% Is Slack, which changes no faster than the robot moves, never negative?
keeps(Slack, Piece, T1, T2) ->
    Middle = (T1 + T2) div 2,
    {Point, Reach} = starl_trajectory:enclosing(T1, T2, Piece),
    Here = Slack(Point),
    if
        Here >= Reach -> true;
        Here < 0.0 -> false;
        Reach =< ?PRECISION_MM -> false;
        T2 - T1 =< 1 -> false;
        true -> keeps(Slack, Piece, T1, Middle) andalso keeps(Slack, Piece, Middle, T2)
    end.
