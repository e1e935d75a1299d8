%% @doc The geometry of points, segments and boxes in the plane.
%%
%% The floor is a plane with x to the right and y up. Lengths are millimetres, angles radians,
%% counted anticlockwise from the x axis. All functions are pure and total on finite floats; a
%% segment may have length zero and then behaves like a point.
-module(starl_geometry).

-export([
    distance/2,
    distance2/2,
    point_segment/2,
    point_segment2/2,
    segment_segment/2,
    closer/3,
    closer2/3,
    intersection/2,
    closest_point/2,
    interpolate/3,
    length/1,
    heading/2,
    angle_diff/2,
    normalise/1,
    box/1,
    grow/2,
    overlap/2,
    inside/2
]).
-export_type([point/0, segment/0, box/0, intersection/0]).

-type point() :: {X :: float(), Y :: float()}.
%% A place on the floor in millimetres.
-type segment() :: {From :: point(), To :: point()}.
%% A straight line between two points, both included.
-type box() :: {X0 :: float(), Y0 :: float(), X1 :: float(), Y1 :: float()}.
%% An axis-parallel box, `X0 =< X1' and `Y0 =< Y1', its edges included.
-type intersection() ::
    none | {proper, point()} | {touch, point()} | {overlap, segment()}.
%% How two segments meet: not at all; crossing in their interiors; in one point that is an end
%% of at least one of them; or along a common piece of positive length.

%% @doc The distance of two points.
-spec distance(point(), point()) -> float().
distance(P, Q) -> math:sqrt(distance2(P, Q)).

%% @doc The square of the distance of two points.
-spec distance2(point(), point()) -> float().
distance2({X0, Y0}, {X1, Y1}) when is_float(X0), is_float(Y0), is_float(X1), is_float(Y1) ->
    DX = X1 - X0,
    DY = Y1 - Y0,
    DX * DX + DY * DY;
distance2(P, Q) ->
    distance2(floats(P), floats(Q)).

%% @doc The distance of a point from a segment.
-spec point_segment(point(), segment()) -> float().
point_segment(P, S) -> math:sqrt(point_segment2(P, S)).

%% @doc The square of the distance of a point from a segment.
-spec point_segment2(point(), segment()) -> float().
point_segment2({PX, PY}, {{AX, AY}, {BX, BY}}) when
    is_float(PX), is_float(PY), is_float(AX), is_float(AY), is_float(BX), is_float(BY)
->
    DX = BX - AX,
    DY = BY - AY,
    EX = PX - AX,
    EY = PY - AY,
    Dot = EX * DX + EY * DY,
    Len2 = DX * DX + DY * DY,
    if
        Dot =< 0.0 ->
            EX * EX + EY * EY;
        Dot >= Len2 ->
            FX = PX - BX,
            FY = PY - BY,
            FX * FX + FY * FY;
        true ->
            Cross = DX * EY - DY * EX,
            Cross * Cross / Len2
    end;
point_segment2(P, {A, B}) ->
    point_segment2(floats(P), {floats(A), floats(B)}).

%% @doc The distance of two segments, 0 when they cross or touch.
-spec segment_segment(segment(), segment()) -> float().
segment_segment(S, T) -> math:sqrt(segment_segment2(S, T)).

%% The square of the distance of two segments.
-spec segment_segment2(segment(), segment()) -> float().
segment_segment2({A, B} = S, {C, D} = T) ->
    case crosses(A, B, C, D) of
        true ->
            0.0;
        false ->
            min(
                min(point_segment2(A, T), point_segment2(B, T)),
                min(point_segment2(C, S), point_segment2(D, S))
            )
    end.

%% @doc Are two segments less than `Mm' apart? Fast when they are far from each other, or when an
%% end of one is near the other.
-spec closer(segment(), segment(), Mm :: float()) -> boolean().
closer({{AX, AY} = A, {BX, BY} = B} = S, {{CX, CY} = C, {DX, DY} = D} = T, Mm) ->
    %% The boxes are compared first: nearly all pairs are far apart.
    not (beyond(CX, DX, AX, BX, Mm) orelse
        beyond(AX, BX, CX, DX, Mm) orelse
        beyond(CY, DY, AY, BY, Mm) orelse
        beyond(AY, BY, CY, DY, Mm)) andalso
        ends_closer(A, B, T, C, D, S, Mm * Mm).

%% @doc Are two segments less than the root of `Mm2' apart? Faster than {@link closer/3} when their
%% boxes are known to be near each other.
-spec closer2(segment(), segment(), Mm2 :: float()) -> boolean().
closer2({A, B} = S, {C, D} = T, Mm2) -> ends_closer(A, B, T, C, D, S, Mm2).

%% @doc How two segments meet, and where, decided without tolerance.
-spec intersection(segment(), segment()) -> intersection().
intersection({A, B}, {C, D} = T) when A == B ->
    %% 0.0 and -0.0 are one point for `==', but for `=:=' and for patterns only up to OTP 26.
    touch_if(point_segment2(A, T) == 0.0 orelse A == C orelse A == D, A);
intersection(S, {C, D} = T) when C == D ->
    intersection(T, S);
intersection({A, B}, {C, D}) ->
    O1 = side(A, B, C),
    O2 = side(A, B, D),
    O3 = side(C, D, A),
    O4 = side(C, D, B),
    case O1 == 0.0 andalso O2 == 0.0 of
        true ->
            collinear(A, B, C, D);
        false when O1 * O2 < 0.0, O3 * O4 < 0.0 ->
            case meet(A, B, C, D) of
                true -> {proper, interpolate(C, D, O1 / (O1 - O2))};
                false -> none
            end;
        false ->
            touching([{O1, C, {A, B}}, {O2, D, {A, B}}, {O3, A, {C, D}}, {O4, B, {C, D}}])
    end.

%% @doc The point of a segment that is closest to a point.
-spec closest_point(point(), segment()) -> point().
closest_point({PX, PY}, {{AX, AY} = A, {BX, BY} = B}) ->
    DX = BX - AX,
    DY = BY - AY,
    Dot = (PX - AX) * DX + (PY - AY) * DY,
    Len2 = DX * DX + DY * DY,
    if
        Dot =< 0.0 -> A;
        Dot >= Len2 -> B;
        true -> interpolate(A, B, Dot / Len2)
    end.

%% @doc The point at fraction `T' of the way from the first point to the second. The ends are
%% exact: 0.0 gives the first point and 1.0 the second.
-spec interpolate(point(), point(), T :: float()) -> point().
interpolate({X0, Y0}, {X1, Y1}, T) ->
    U = 1.0 - T,
    {U * X0 + T * X1, U * Y0 + T * Y1}.

%% @doc The length of a segment.
-spec length(segment()) -> float().
length({P, Q}) -> distance(P, Q).

%% @doc The direction from the first point to the second, in (-pi, pi]; 0.0 when they are equal.
-spec heading(point(), point()) -> float().
heading(P, P) -> 0.0;
heading({X0, Y0}, {X1, Y1}) -> normalise(math:atan2(Y1 - Y0, X1 - X0)).

%% @doc The turn from heading `B' to heading `A', A - B brought into (-pi, pi].
-spec angle_diff(A :: float(), B :: float()) -> float().
angle_diff(A, B) -> normalise(A - B).

%% @doc The same angle in (-pi, pi].
-spec normalise(float()) -> float().
normalise(Angle) ->
    Pi = math:pi(),
    if
        Angle > -Pi, Angle =< Pi -> Angle;
        true -> wrap(math:fmod(Angle, 2.0 * Pi), Pi)
    end.

%% @doc The smallest box around a segment or around a list of at least one point.
-spec box(segment() | [point(), ...]) -> box().
box({{AX, AY}, {BX, BY}}) ->
    {min(AX, BX), min(AY, BY), max(AX, BX), max(AY, BY)};
box([{X, Y} | Points]) ->
    lists:foldl(fun extend/2, {X, Y, X, Y}, Points).

%% @doc The box with each side moved outwards by `Mm'; a negative `Mm' shrinks it.
-spec grow(box(), Mm :: float()) -> box().
grow({X0, Y0, X1, Y1}, Mm) -> {X0 - Mm, Y0 - Mm, X1 + Mm, Y1 + Mm}.

%% @doc Do two boxes share a point?
-spec overlap(box(), box()) -> boolean().
overlap({AX0, AY0, AX1, AY1}, {BX0, BY0, BX1, BY1}) ->
    AX0 =< BX1 andalso BX0 =< AX1 andalso AY0 =< BY1 andalso BY0 =< AY1.

%% @doc Is the point in the box, its edge included?
-spec inside(point(), box()) -> boolean().
inside({X, Y}, {X0, Y0, X1, Y1}) ->
    X >= X0 andalso X =< X1 andalso Y >= Y0 andalso Y =< Y1.

%%% Internals

%% The compiler keeps values that are known to be floats off the heap, so the functions that are
%% called most check for floats first. All values are floats except whole numbers written by hand.
floats({X, Y}) -> {float(X), float(Y)}.

%% Segments that cross far from their ends are rare.
ends_closer(A, B, T, C, D, S, Mm2) ->
    point_segment2(A, T) < Mm2 orelse point_segment2(C, S) < Mm2 orelse
        point_segment2(B, T) < Mm2 orelse point_segment2(D, S) < Mm2 orelse
        (Mm2 > 0.0 andalso crosses(A, B, C, D)).

%% Are both of the first two larger than both of the others by this margin? Usually the first
%% comparison decides.
beyond(A, B, C, D, Mm) when is_float(A), is_float(B), is_float(C), is_float(D) ->
    A - C >= Mm andalso A - D >= Mm andalso B - C >= Mm andalso B - D >= Mm;
beyond(A, B, C, D, Mm) ->
    A - C >= Mm andalso A - D >= Mm andalso B - C >= Mm andalso B - D >= Mm.

wrap(Angle, Pi) when Angle > Pi -> Angle - 2.0 * Pi;
wrap(Angle, Pi) when Angle =< -Pi -> Angle + 2.0 * Pi;
wrap(Angle, _Pi) -> Angle.

extend({X, Y}, {X0, Y0, X1, Y1}) -> {min(X, X0), min(Y, Y0), max(X, X1), max(Y, Y1)}.

%% Twice the signed area of the triangle: positive when C is to the left of A to B.
side({AX, AY}, {BX, BY}, {CX, CY}) when
    is_float(AX), is_float(AY), is_float(BX), is_float(BY), is_float(CX), is_float(CY)
->
    (BX - AX) * (CY - AY) - (BY - AY) * (CX - AX);
side(A, B, C) ->
    side(floats(A), floats(B), floats(C)).

%% False for collinear pairs and pairs of length zero: the distances of the ends then decide.
crosses(A, B, C, D) ->
    O1 = side(A, B, C),
    O2 = side(A, B, D),
    case O1 * O2 > 0.0 orelse (O1 == 0.0 andalso O2 == 0.0) of
        true ->
            false;
        false ->
            O3 = side(C, D, A),
            O4 = side(C, D, B),
            O3 * O4 =< 0.0 andalso not (O3 == 0.0 andalso O4 == 0.0) andalso meet(A, B, C, D)
    end.

%% On segments that lie nearly on one line, rounding decides on which side an end lies, so they may
%% seem to cross where they are far apart. Only segments whose boxes overlap can cross.
meet(A, B, C, D) -> overlap(box([A, B]), box([C, D])).

touch_if(true, P) -> {touch, P};
touch_if(false, _) -> none.

touching([]) ->
    none;
touching([{Side, P, S} | Rest]) ->
    case Side == 0.0 andalso inside(P, box(S)) of
        true -> {touch, P};
        false -> touching(Rest)
    end.

%% On one line the order of points is their lexicographic order.
collinear(A, B, C, D) ->
    Low = max(min(A, B), min(C, D)),
    High = min(max(A, B), max(C, D)),
    if
        Low < High -> {overlap, {Low, High}};
        Low == High -> {touch, Low};
        true -> none
    end.
