%% @doc Motion in closed form: pieces of constant speed and constant turn rate, and pieces of
%% constant acceleration.
%%
%% A robot's trajectory is a sequence of pieces; between two commands nothing needs to be
%% simulated. Standing, turning in place, a straight line and an arc are the same piece with
%% different `V' and `W'. A <em>ramp</em> is a robot that does not turn, and whose velocity changes
%% evenly from one value to another and then stays so: a parabola, followed by a straight line.
%% Positions in millimetres, times in integer microseconds, headings in radians (not normalised:
%% they count full turns), `V' in mm/s, `W' in rad/s.
%%
%% Distances between two moving robots are found for <em>every instant</em> of an interval. For
%% pieces that do not bend, the minimum is a closed form. With an arc or a parabola, the relative
%% path stays within `A h^2 / 8' of the motion along its chord over a time `h' (`A' bounds
%% the relative acceleration, which is `|V W|' on an arc). This gives a lower bound for branch and
%% bound that converges quadratically: the returned distance is attained, and at most 1.0e-3 mm
%% above the infimum. At the end of a ramp the velocity may have a kink but no jump; the
%% acceleration jumps, so the interval is cut there.
-module(starl_trajectory).

-export([standing/3, piece/5, ramp/6, stop/2]).
-export([start_us/1, pose/2, position/2, velocity/2, moved/3, fastest/1, enclosing/3]).
-export([is_still/1, is_bent/1, rests_from/1]).
-export([closest_approach/4, closest_within/5, polyline/4, passing/4]).
-export_type([piece/0, arc/0, ramp/0, pose/0, velocity/0, approach/0]).

%% Position and heading (radians, counter-clockwise from the x axis).
-type pose() :: {X :: float(), Y :: float(), Heading :: float()}.
%% In mm/s.
-type velocity() :: {VX :: float(), VY :: float()}.
%% Constant speed `V' (mm/s) and turn rate `W' (rad/s) from time `T0us' on.
-type arc() ::
    {piece, T0us :: integer(), X :: float(), Y :: float(), Heading :: float(), V :: float(),
        W :: float()}.
%% A velocity that changes evenly from the first to the second within `Us', and then stays so.
-type ramp() ::
    {ramp, T0us :: integer(), X :: float(), Y :: float(), Heading :: float(), velocity(),
        velocity(), Us :: non_neg_integer()}.
-type piece() :: arc() | ramp().
%% The least distance (mm) and a moment at which it is attained (rounded to a microsecond).
-type approach() :: {MinDistanceMm :: float(), AtUs :: integer()}.

%% How far above the infimum a distance found by branch and bound may lie (mm).
-define(PRECISION_MM, 1.0e-3).
%% Below this half angle (radians), sin(x)/x is 1 - x^2/6 to the last bit.
-define(SMALL_ANGLE, 1.0e-4).

%% @doc A robot that stands at `Pose' from `T0us' on.
-spec standing(T0us :: integer(), starl_geometry:point(), Heading :: float()) -> arc().
standing(T0us, {X, Y}, Heading) ->
    {piece, T0us, X, Y, Heading, 0.0, 0.0}.

%% @doc A robot that moves from `Pose' at `T0us' on with `V' mm/s and `W' rad/s.
-spec piece(
    T0us :: integer(), starl_geometry:point(), Heading :: float(), V :: float(), W :: float()
) -> arc().
piece(T0us, {X, Y}, Heading, V, W) ->
    {piece, T0us, X, Y, Heading, V, W}.

%% @doc A robot that moves from `Pose' at `T0us' on and whose velocity changes evenly from `V0' to
%% `V1' within `Us'.
-spec ramp(
    T0us :: integer(), starl_geometry:point(), Heading :: float(), velocity(), velocity(), Us
) ->
    ramp()
when
    Us :: non_neg_integer().
ramp(T0us, {X, Y}, Heading, V0, V1, Us) ->
    {ramp, T0us, X, Y, Heading, V0, V1, Us}.

%% @doc The piece of a robot that stops at `T' while on `Piece': it stands. A robot that is coming
%% to rest by itself keeps its piece.
-spec stop(T :: integer(), piece()) -> piece().
stop(_T, {ramp, _T0, _X, _Y, _Heading, _V0, {VX, VY}, _Us} = Piece) when VX == 0, VY == 0 ->
    Piece;
stop(T, Piece) ->
    {X, Y, Heading} = pose(T, Piece),
    {piece, T, X, Y, Heading, 0.0, 0.0}.

%% @doc The time at which the piece begins.
-spec start_us(piece()) -> integer().
start_us(Piece) -> element(2, Piece).

%% @doc Position (mm) and heading (radians) at time `T' (us).
-spec pose(T :: integer(), piece()) -> pose().
pose(_T, {piece, _T0, X, Y, Heading, V, W}) when V == 0, W == 0 ->
    {X, Y, Heading};
pose(T, {piece, T0, _, _, Heading, _, W} = Piece) ->
    {X, Y} = after_s((T - T0) / 1.0e6, Piece),
    {X, Y, Heading + W * (T - T0) / 1.0e6};
pose(T, {ramp, T0, _, _, Heading, _, _, _} = Piece) ->
    {X, Y} = after_s((T - T0) / 1.0e6, Piece),
    {X, Y, Heading}.

%% @doc Position (mm) at time `T' (us).
-spec position(T :: integer(), piece()) -> starl_geometry:point().
position(_T, {piece, _T0, X, Y, _Heading, V, _W}) when V == 0 ->
    {X, Y};
position(T, Piece) ->
    after_s((T - element(2, Piece)) / 1.0e6, Piece).

%% @doc Velocity (mm/s) at time `T' (us).
-spec velocity(T :: integer(), piece()) -> velocity().
velocity(_T, {piece, _T0, _X, _Y, _Heading, V, _W}) when V == 0 ->
    {0.0, 0.0};
velocity(T, {piece, T0, _X, _Y, Heading, V, W}) ->
    Towards = Heading + W * (T - T0) / 1.0e6,
    {V * math:cos(Towards), V * math:sin(Towards)};
velocity(T, {ramp, T0, _X, _Y, _Heading, _V0, V1, Us}) when Us =:= 0; T >= T0 + Us ->
    V1;
velocity(T, {ramp, T0, _X, _Y, _Heading, {VX0, VY0}, {VX1, VY1}, Us}) ->
    Part = (T - T0) / Us,
    {VX0 + Part * (VX1 - VX0), VY0 + Part * (VY1 - VY0)}.

%% @doc Length of the path driven from `T1' to `T2' (mm).
-spec moved(T1 :: integer(), T2 :: integer(), piece()) -> float().
moved(T1, T2, {piece, _T0, _X, _Y, _Heading, V, _W}) ->
    abs(V) * (T2 - T1) / 1.0e6;
moved(T1, T2, {ramp, T0, _, _, _, _, V1, Us} = Piece) ->
    Even = min(T2, T0 + Us) - T1,
    case Even > 0 of
        true ->
            From = velocity(T1, Piece),
            To = velocity(T1 + Even, Piece),
            parabola(From, To, Even / 1.0e6) + speed(V1) * (T2 - T1 - Even) / 1.0e6;
        false ->
            speed(V1) * (T2 - T1) / 1.0e6
    end.

%% @doc The highest speed on this piece (mm/s).
-spec fastest(piece()) -> float().
fastest({piece, _T0, _X, _Y, _Heading, V, _W}) -> float(abs(V));
fastest({ramp, _T0, _X, _Y, _Heading, V0, V1, _Us}) -> max(speed(V0), speed(V1)).

%% @doc Does the robot keep its position (it may turn in place)?
-spec is_still(piece()) -> boolean().
is_still({piece, _T0, _X, _Y, _Heading, V, _W}) -> V == 0;
is_still({ramp, _T0, _X, _Y, _Heading, V0, V1, _Us}) -> speed(V0) == 0 andalso speed(V1) == 0.

%% @doc The time from which on the robot keeps its position, on this piece.
-spec rests_from(piece()) -> T :: integer() | never.
rests_from({piece, T0, _X, _Y, _Heading, V, _W}) when V == 0 -> T0;
rests_from({ramp, T0, _X, _Y, _Heading, _V0, {VX, VY}, Us}) when VX == 0, VY == 0 -> T0 + Us;
rests_from(_Moving) -> never.

%% @doc Is any of the path an arc or a parabola (which may lie on one straight line)?
-spec is_bent(piece()) -> boolean().
is_bent({piece, _T0, _X, _Y, _Heading, V, W}) -> V /= 0 andalso W /= 0;
is_bent({ramp, _T0, _X, _Y, _Heading, V0, V1, Us}) -> Us > 0 andalso V0 /= V1.

%% @doc A disc (centre, radius in mm) that holds the path from `T1' to `T2'.
-spec enclosing(T1 :: integer(), T2 :: integer(), piece()) -> {starl_geometry:point(), float()}.
enclosing(T1, T2, {piece, _, _, _, _, _, _} = Piece) ->
    %% Every point lies within half the path length of the path's middle.
    {position((T1 + T2) div 2, Piece), (moved(T1, T2, Piece) + moved(0, 2, Piece)) / 2};
enclosing(T1, T2, Piece) ->
    Middle = (T1 + T2) div 2,
    {position(Middle, Piece), max(moved(T1, Middle, Piece), moved(Middle, T2, Piece))}.

%% @doc The least distance of two robots over the closed interval from `T1' to `T2'.
%% Exact when no arc or ramp is involved, else attained and within 1.0e-3 mm of the infimum.
-spec closest_approach(piece(), piece(), T1 :: integer(), T2 :: integer()) -> approach().
closest_approach(A, B, T1, T2) when element(1, A) =:= piece, element(1, B) =:= piece, T1 =< T2 ->
    case is_bent(A) orelse is_bent(B) of
        false -> straight_approach(A, B, T1, T2);
        true -> bent_approach(A, B, T1, T2)
    end;
closest_approach(A, B, T1, T2) when T1 =< T2 ->
    Kinks = lists:usort([T || Piece <- [A, B], T <- kinks(Piece), T1 < T, T < T2]),
    [First | Later] = lists:zip([T1 | Kinks], Kinks ++ [T2]),
    lists:foldl(
        fun({From, To}, Least) -> nearer(Least, smooth_approach(A, B, From, To)) end,
        smooth_approach(A, B, element(1, First), element(2, First)),
        Later
    ).

%% The moments at which the acceleration jumps.
kinks({piece, _, _, _, _, _, _}) -> [];
kinks({ramp, T0, _, _, _, _, _, Us}) -> [T0 + Us].

smooth_approach(A, B, T1, T2) ->
    case {acceleration(T1, A), acceleration(T1, B)} of
        {Zero, None} when Zero == 0, None == 0 -> straight_approach(A, B, T1, T2);
        _ -> bent_approach(A, B, T1, T2)
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
    [starl_geometry:point(), ...].
polyline(Piece, T1, T2, ToleranceMm) when T1 =< T2, ToleranceMm > 0 ->
    case is_still(Piece) orelse T1 =:= T2 of
        true -> [position(T1, Piece)];
        false -> smooth_line(kinks(Piece), Piece, T1, T2, ToleranceMm)
    end.

smooth_line([Kink], Piece, T1, T2, ToleranceMm) when T1 < Kink, Kink < T2 ->
    chords(Piece, T1, Kink, chord_count(Piece, T1, Kink, ToleranceMm)) ++ [position(T2, Piece)];
smooth_line(_Elsewhere, Piece, T1, T2, ToleranceMm) ->
    chords(Piece, T1, T2, chord_count(Piece, T1, T2, ToleranceMm)).

%% @doc The moment at which a robot on this piece has driven this share of its way between two
%% times.
-spec passing(Share :: float(), piece(), T1 :: integer(), T2 :: integer()) -> integer().
passing(Share, {piece, _, _, _, _, _, _}, T1, T2) when is_integer(T1) ->
    T1 + round(Share * (T2 - T1));
passing(Share, Piece, T1, T2) ->
    passing(Share * moved(T1, T2, Piece), T1, Piece, T1, T2).

passing(_Mm, _T0, _Piece, T1, T2) when is_integer(T2), T2 - T1 =< 1 ->
    T2;
passing(Mm, T0, Piece, T1, T2) ->
    Middle = (T1 + T2) div 2,
    case moved(T0, Middle, Piece) < Mm of
        true -> passing(Mm, T0, Piece, Middle, T2);
        false -> passing(Mm, T0, Piece, T1, Middle)
    end.

%%% Along one piece

%% The chord of an arc of angle 2u is V * s * sin(u) / u long and points along Heading + u; this
%% form needs no radius and has no singularity for small turn rates.
after_s(S, {piece, _T0, X, Y, Heading, V, W}) ->
    Half = W * S / 2,
    Chord = V * S * sinc(Half),
    {X + Chord * math:cos(Heading + Half), Y + Chord * math:sin(Heading + Half)};
after_s(S, {ramp, _T0, X, Y, _Heading, {VX0, VY0}, {VX1, VY1}, Us}) ->
    %% the time on the ramp, and the mean velocity on it; the time after the ramp
    Even = min(S, Us / 1.0e6),
    Part = part(Even, Us) / 2,
    Rest = S - Even,
    {
        X + Even * (VX0 + Part * (VX1 - VX0)) + Rest * VX1,
        Y + Even * (VY0 + Part * (VY1 - VY0)) + Rest * VY1
    }.

part(_Even, 0) -> 0.0;
part(Even, Us) -> Even * 1.0e6 / Us.

speed({VX, VY}) -> length(VX, VY).

%% The length of a path on which the velocity changes evenly: the integral of the root of w^2 + q^2,
%% w and q being the speeds along and across the acceleration. Where the change is small against the
%% speed, the closed form would subtract two large numbers; Simpson's rule has a smaller error
%% there.
parabola({VX0, VY0} = V0, {VX1, VY1} = V1, S) ->
    DX = VX1 - VX0,
    DY = VY1 - VY0,
    Change = length(DX, DY),
    case Change =< 1.0e-3 * (speed(V0) + speed(V1)) of
        true ->
            S * (speed(V0) + 4 * speed({(VX0 + VX1) / 2, (VY0 + VY1) / 2}) + speed(V1)) / 6;
        false ->
            {UX, UY} = {DX / Change, DY / Change},
            Across = abs(VX0 * UY - VY0 * UX),
            Integral = fun(W) -> root_integral(W, Across) end,
            S / Change * (Integral(VX1 * UX + VY1 * UY) - Integral(VX0 * UX + VY0 * UY))
    end.

root_integral(W, Q) when Q =< 1.0e-9 * abs(W) -> W * abs(W) / 2;
root_integral(W, Q) -> (W * length(W, Q) + Q * Q * math:asinh(W / Q)) / 2.

sinc(U) when abs(U) < ?SMALL_ANGLE -> 1.0 - U * U / 6.0;
sinc(U) -> math:sin(U) / U.

%% The path over a time h stays within A h^2 / 8 of its chord. A path that turns neither aside nor
%% back lies on its chord.
chord_count({ramp, _, _, _, _, _, _, _} = Piece, T1, T2, Tolerance) ->
    {VX0, VY0} = V0 = velocity(T1, Piece),
    {VX1, VY1} = V1 = velocity(T2, Piece),
    S = (T2 - T1) / 1.0e6,
    Aside = abs(VX0 * VY1 - VY0 * VX1) * S,
    case Aside =< 1.0e-9 * (speed(V0) + speed(V1)) andalso VX0 * VX1 + VY0 * VY1 >= 0 of
        true -> 1;
        false -> max(1, ceil(S * math:sqrt(acceleration(T1, Piece) / 8 / Tolerance)))
    end;
chord_count({piece, _, _, _, _, _, W}, _T1, _T2, _Tolerance) when W == 0 ->
    1;
chord_count({piece, _, _, _, _, V, W}, T1, T2, Tolerance) ->
    %% The sagitta of a chord over the angle a is R (1 - cos(a / 2)).
    Ratio = min(1.0, Tolerance * abs(W / V)),
    Angle = 2 * math:acos(1.0 - Ratio),
    max(1, ceil(abs(W) * (T2 - T1) / 1.0e6 / max(Angle, 1.0e-6))).

chords(Piece, T1, T2, N) ->
    From = (T1 - element(2, Piece)) / 1.0e6,
    Step = (T2 - T1) / 1.0e6 / N,
    [after_s(From + I * Step, Piece) || I <- lists:seq(0, N - 1)] ++ [position(T2, Piece)].

%%% Pieces that do not bend: the relative motion is a straight line

straight_approach(A, B, T1, T2) ->
    {XA, YA} = position(T1, A),
    {XB, YB} = position(T1, B),
    {VXA, VYA} = velocity(T1, A),
    {VXB, VYB} = velocity(T1, B),
    Span = (T2 - T1) / 1.0e6,
    {Distance, S} = line_minimum(XA - XB, YA - YB, VXA - VXB, VYA - VYB, Span),
    {Distance, T1 + round(S * 1.0e6)}.

line_minimum(DX, DY, VX, VY, Span) ->
    Speed2 = VX * VX + VY * VY,
    S = closing_time(-(DX * VX + DY * VY), Speed2, Span),
    {length(DX + S * VX, DY + S * VY), S}.

closing_time(_Closing, Speed2, _Span) when Speed2 < 1.0e-24 -> 0.0;
closing_time(Closing, Speed2, Span) -> max(0.0, min(Span, Closing / Speed2)).

length(X, Y) -> math:sqrt(X * X + Y * Y).

nearer_than(Bound, {Distance, _AtUs} = Approach) when Distance < Bound -> Approach;
nearer_than(_Bound, _Approach) -> farther.

%%% Arcs and parabolas: branch and bound over time, in seconds after T1

bent_approach(A, B, T1, T2) ->
    Span = (T2 - T1) / 1.0e6,
    Acceleration = acceleration(T1, A) + acceleration(T1, B),
    Relative = fun(S) -> relative(S, T1, A, B) end,
    Start = Relative(0.0),
    End = Relative(Span),
    Best = nearer({norm(Start), 0.0}, {norm(End), Span}),
    {Distance, S} = bound(0.0, Start, Span, End, Relative, Acceleration / 8, Best),
    {Distance, T1 + round(S * 1.0e6)}.

%% The interval from `T' to the next kink.
acceleration(_T, {piece, _T0, _X, _Y, _Heading, V, W}) ->
    abs(V * W);
acceleration(T, {ramp, T0, _X, _Y, _Heading, {VX0, VY0}, {VX1, VY1}, Us}) when
    Us > 0, T < T0 + Us
->
    length(VX1 - VX0, VY1 - VY0) * 1.0e6 / Us;
acceleration(_T, {ramp, _T0, _X, _Y, _Heading, _V0, _V1, _Us}) ->
    0.0.

relative(S, T1, A, B) ->
    {XA, YA} = after_s((T1 - element(2, A)) / 1.0e6 + S, A),
    {XB, YB} = after_s((T1 - element(2, B)) / 1.0e6 + S, B),
    {XA - XB, YA - YB}.

%% `Best' is the least distance met so far; an interval whose lower bound cannot improve on it
%% by more than the precision is skipped. The earlier half comes first, so that equal
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
