%% @doc Motion in closed form: pieces of constant speed and constant turn rate.
%%
%% A robot's trajectory is a sequence of pieces; between two commands nothing needs to be
%% simulated. Standing, turning in place, a straight line and an arc are the same piece with
%% different `V' and `W'. Positions in millimetres, times in integer microseconds, headings
%% in radians (not normalised: they count full turns), `V' in mm/s, `W' in rad/s.
%%
%% Distances between two moving robots are found for <em>every instant</em> of an interval. For
%% pieces that do not bend, the minimum is a closed form. Where an arc is involved, the relative
%% path stays within `A h^2 / 8' of its chord over a time `h' (`A' bounds the relative
%% acceleration `|V W|'), which gives a lower bound for branch and bound that converges
%% quadratically: the returned distance is attained, and at most 1.0e-3 mm above the infimum.
-module(starl_trajectory).

-export([standing/3, piece/5, stop/2]).
-export([pose/2, position/2, moved/3, is_still/1, is_bent/1, enclosing/3]).
-export([closest_approach/4, closest_within/5, polyline/4]).
-export_type([piece/0, point/0, pose/0, approach/0]).

%% Position on the floor, mm; x to the right, y up.
-type point() :: {X :: float(), Y :: float()}.
%% Position and heading (radians, counter-clockwise from the x axis).
-type pose() :: {X :: float(), Y :: float(), Heading :: float()}.
%% Constant speed `V' (mm/s) and turn rate `W' (rad/s) from time `T0us' on.
-type piece() :: {piece, T0us :: integer(), X :: float(), Y :: float(),
                  Heading :: float(), V :: float(), W :: float()}.
%% The least distance (mm) and a moment at which it is attained (rounded to a microsecond).
-type approach() :: {MinDistanceMm :: float(), AtUs :: integer()}.

%% How far above the infimum a distance found by branch and bound may lie (mm).
-define(PRECISION_MM, 1.0e-3).
%% Below this half angle (radians), sin(x)/x is 1 - x^2/6 to the last bit.
-define(SMALL_ANGLE, 1.0e-4).

%% @doc A robot that stands at `Pose' from `T0us' on.
-spec standing(T0us :: integer(), point(), Heading :: float()) -> piece().
standing(T0us, {X, Y}, Heading) ->
    {piece, T0us, X, Y, Heading, 0.0, 0.0}.

%% @doc A robot that moves from `Pose' at `T0us' on with `V' mm/s and `W' rad/s.
-spec piece(T0us :: integer(), point(), Heading :: float(), V :: float(), W :: float()) -> piece().
piece(T0us, {X, Y}, Heading, V, W) ->
    {piece, T0us, X, Y, Heading, V, W}.

%% @doc The standing piece of a robot that stops at `T' while on `Piece'.
-spec stop(T :: integer(), piece()) -> piece().
stop(T, Piece) ->
    {X, Y, Heading} = pose(T, Piece),
    {piece, T, X, Y, Heading, 0.0, 0.0}.

%% @doc Position (mm) and heading (radians) at time `T' (us).
-spec pose(T :: integer(), piece()) -> pose().
pose(_T, {piece, _T0, X, Y, Heading, V, W}) when V == 0, W == 0 ->
    {X, Y, Heading};
pose(T, {piece, T0, _, _, Heading, _, W} = Piece) ->
    {X, Y} = after_s((T - T0) / 1.0e6, Piece),
    {X, Y, Heading + W * (T - T0) / 1.0e6}.

%% @doc Position (mm) at time `T' (us).
-spec position(T :: integer(), piece()) -> point().
position(_T, {piece, _T0, X, Y, _Heading, V, _W}) when V == 0 ->
    {X, Y};
position(T, {piece, T0, _, _, _, _, _} = Piece) ->
    after_s((T - T0) / 1.0e6, Piece).

%% @doc Length of the path driven from `T1' to `T2' (mm).
-spec moved(T1 :: integer(), T2 :: integer(), piece()) -> float().
moved(T1, T2, {piece, _T0, _X, _Y, _Heading, V, _W}) ->
    abs(V) * (T2 - T1) / 1.0e6.

%% @doc Whether the robot keeps its position (it may turn in place).
-spec is_still(piece()) -> boolean().
is_still({piece, _T0, _X, _Y, _Heading, V, _W}) -> V == 0.

%% @doc Whether the path is an arc.
-spec is_bent(piece()) -> boolean().
is_bent({piece, _T0, _X, _Y, _Heading, V, W}) -> V /= 0 andalso W /= 0.

%% @doc A disc (centre, radius in mm) that holds the path from `T1' to `T2'.
-spec enclosing(T1 :: integer(), T2 :: integer(), piece()) -> {point(), float()}.
enclosing(T1, T2, Piece) ->
    %% Every point lies within half the path length of the path's middle.
    {position((T1 + T2) div 2, Piece), (moved(T1, T2, Piece) + moved(0, 2, Piece)) / 2}.

%% @doc The least distance of two robots over the closed interval from `T1' to `T2'.
%% Exact when no arc is involved, else attained and within 1.0e-3 mm of the infimum.
-spec closest_approach(piece(), piece(), T1 :: integer(), T2 :: integer()) -> approach().
closest_approach(A, B, T1, T2) when T1 =< T2 ->
    case is_bent(A) orelse is_bent(B) of
        false -> straight_approach(A, B, T1, T2);
        true -> bent_approach(A, B, T1, T2)
    end.

%% @doc Like {@link closest_approach/4}, but may give up early with `farther' once the
%% distance is known to be at least `Bound' (mm) throughout.
-spec closest_within(Bound :: float(), piece(), piece(), T1 :: integer(), T2 :: integer()) ->
    approach() | farther.
closest_within(Bound, A, B, T1, T2) ->
    Reach = Bound + moved(T1, T2, A) + moved(T1, T2, B),
    {XA, YA} = position(T1, A),
    {XB, YB} = position(T1, B),
    DX = XA - XB,
    DY = YA - YB,
    case DX * DX + DY * DY >= Reach * Reach of
        true -> farther;
        false -> nearer_than(Bound, closest_approach(A, B, T1, T2))
    end.

%% @doc Points of the path from `T1' to `T2', such that the polyline through them stays within
%% `ToleranceMm' of the path. One point if the robot stands, two if it drives straight.
-spec polyline(piece(), T1 :: integer(), T2 :: integer(), ToleranceMm :: float()) ->
    [point(), ...].
polyline(Piece, T1, T2, ToleranceMm) when T1 =< T2, ToleranceMm > 0 ->
    case is_still(Piece) orelse T1 =:= T2 of
        true -> [position(T1, Piece)];
        false -> chords(Piece, T1, T2, chord_count(Piece, T1, T2, ToleranceMm))
    end.

%%% Along one piece

%% The chord of an arc of angle 2u is V * s * sin(u) / u long and points along Heading + u; this
%% form needs no radius and has no singularity for small turn rates.
after_s(S, {piece, _T0, X, Y, Heading, V, W}) ->
    Half = W * S / 2,
    Chord = V * S * sinc(Half),
    {X + Chord * math:cos(Heading + Half), Y + Chord * math:sin(Heading + Half)}.

sinc(U) when abs(U) < ?SMALL_ANGLE -> 1.0 - U * U / 6.0;
sinc(U) -> math:sin(U) / U.

chord_count({piece, _, _, _, _, _, W}, _T1, _T2, _Tolerance) when W == 0 ->
    1;
chord_count({piece, _, _, _, _, V, W}, T1, T2, Tolerance) ->
    %% The sagitta of a chord over the angle a is R (1 - cos(a / 2)).
    Ratio = min(1.0, Tolerance * abs(W / V)),
    Angle = 2 * math:acos(1.0 - Ratio),
    max(1, ceil(abs(W) * (T2 - T1) / 1.0e6 / max(Angle, 1.0e-6))).

chords({piece, T0, _, _, _, _, _} = Piece, T1, T2, N) ->
    From = (T1 - T0) / 1.0e6,
    Step = (T2 - T1) / 1.0e6 / N,
    [after_s(From + I * Step, Piece) || I <- lists:seq(0, N - 1)] ++ [position(T2, Piece)].

%%% Pieces that do not bend: the relative motion is a straight line

straight_approach(A, B, T1, T2) ->
    {XA, YA} = position(T1, A),
    {XB, YB} = position(T1, B),
    {VXA, VYA} = velocity(A),
    {VXB, VYB} = velocity(B),
    Span = (T2 - T1) / 1.0e6,
    {Distance, S} = line_minimum(XA - XB, YA - YB, VXA - VXB, VYA - VYB, Span),
    {Distance, T1 + round(S * 1.0e6)}.

velocity({piece, _T0, _X, _Y, _Heading, V, _W}) when V == 0 ->
    {0.0, 0.0};
velocity({piece, _T0, _X, _Y, Heading, V, _W}) ->
    {V * math:cos(Heading), V * math:sin(Heading)}.

line_minimum(DX, DY, VX, VY, Span) ->
    Speed2 = VX * VX + VY * VY,
    S = closing_time(-(DX * VX + DY * VY), Speed2, Span),
    {length(DX + S * VX, DY + S * VY), S}.

closing_time(_Closing, Speed2, _Span) when Speed2 < 1.0e-24 -> 0.0;
closing_time(Closing, Speed2, Span) -> max(0.0, min(Span, Closing / Speed2)).

length(X, Y) -> math:sqrt(X * X + Y * Y).

nearer_than(Bound, {Distance, _AtUs} = Approach) when Distance < Bound -> Approach;
nearer_than(_Bound, _Approach) -> farther.

%%% Arcs: branch and bound over time, in seconds after T1

bent_approach(A, B, T1, T2) ->
    Span = (T2 - T1) / 1.0e6,
    Acceleration = acceleration(A) + acceleration(B),
    Relative = fun(S) -> relative(S, T1, A, B) end,
    Start = Relative(0.0),
    End = Relative(Span),
    Best = nearer({norm(Start), 0.0}, {norm(End), Span}),
    {Distance, S} = bound(0.0, Start, Span, End, Relative, Acceleration / 8, Best),
    {Distance, T1 + round(S * 1.0e6)}.

acceleration({piece, _T0, _X, _Y, _Heading, V, W}) -> abs(V * W).

relative(S, T1, {piece, TA, _, _, _, _, _} = A, {piece, TB, _, _, _, _, _} = B) ->
    {XA, YA} = after_s((T1 - TA) / 1.0e6 + S, A),
    {XB, YB} = after_s((T1 - TB) / 1.0e6 + S, B),
    {XA - XB, YA - YB}.

%% `Best' is the least distance met so far; an interval whose lower bound cannot improve on it
%% by more than the precision is left out. The earlier half comes first, so that equal
%% distances give the earliest moment.
bound(S1, P1, S2, P2, Relative, Bend, {Least, _} = Best) ->
    H = S2 - S1,
    case origin_to_chord(P1, P2) - Bend * H * H >= Least - ?PRECISION_MM of
        true -> Best;
        false -> split(S1, P1, S2, P2, Relative, Bend, Best)
    end.

split(S1, P1, S2, P2, Relative, Bend, Best) ->
    Middle = (S1 + S2) / 2,
    P = Relative(Middle),
    Better = nearer(Best, {norm(P), Middle}),
    Left = bound(S1, P1, Middle, P, Relative, Bend, Better),
    bound(Middle, P, S2, P2, Relative, Bend, Left).

nearer({D1, _} = First, {D2, _}) when D1 =< D2 -> First;
nearer(_First, Second) -> Second.

norm({X, Y}) -> length(X, Y).

origin_to_chord({X1, Y1}, {X2, Y2}) ->
    {Distance, _S} = line_minimum(X1, Y1, X2 - X1, Y2 - Y1, 1.0),
    Distance.
