%% @doc The geometry of lines, Bézier curves and elliptic arcs: affine maps, exact bounds and
%% flattening. A part of the SVG reader, {@link starl_svg}.
%%
%% All four kinds are closed under affine maps (an arc is held as centre plus two conjugate
%% radii, `C + U cos t + V sin t'), so a curve is first mapped to the floor exactly and only then
%% cut into chords. The tolerance is therefore a distance on the floor.
%%
%% Flattening is uniform in the parameter. If the second derivative of a curve is at most `M', a
%% chord over a step `h' deviates from it by at most `M h^2 / 8'; on an arc, by at most the largest
%% radius times `1 - cos(h / 2)'. The number of steps follows from this, so the bound always holds.
-module(starl_svg_curve).

-export([start/1, finish/1, transform/2, bounds/1, merge_bounds/2, steps/2, flatten/2]).
-export([ellipse/4, arc/6]).
-export_type([t/0, bounds/0]).

-type line() :: {line, starl_geometry:point(), starl_geometry:point()}.
%% An arc carries both end points so that pieces join without a gap.
-type arc() ::
    {arc, Start :: starl_geometry:point(), End :: starl_geometry:point(),
        Centre :: starl_geometry:point(), U :: starl_geometry:point(), V :: starl_geometry:point(),
        Angle :: float(), Sweep :: float()}.
%% A piece of an outline.
-type t() ::
    line()
    | {quad, starl_geometry:point(), starl_geometry:point(), starl_geometry:point()}
    | {cubic, starl_geometry:point(), starl_geometry:point(), starl_geometry:point(),
        starl_geometry:point()}
    | arc().
%% Lower left and upper right corner.
-type bounds() :: {float(), float(), float(), float()}.

-define(PI, 3.141592653589793).
%% Radii and chords of arcs below this length (in user units) count as zero.
-define(NOTHING, 1.0e-9).

%% @doc The start of the curve.
-spec start(t()) -> starl_geometry:point().
start(Curve) -> element(2, Curve).

%% @doc The end of the curve.
-spec finish(t()) -> starl_geometry:point().
finish({line, _, P1}) -> P1;
finish({quad, _, _, P2}) -> P2;
finish({cubic, _, _, _, P3}) -> P3;
finish({arc, _, P1, _, _, _, _, _}) -> P1.

%% @doc The arc of an axis-parallel ellipse from angle `From', `Sweep' radians on.
-spec ellipse(
    Centre :: starl_geometry:point(),
    Radii :: starl_geometry:point(),
    From :: float(),
    Sweep :: float()
) -> arc().
ellipse(Centre, {RX, RY}, From, Sweep) ->
    U = {RX, 0.0},
    V = {0.0, RY},
    {arc, on_arc(Centre, U, V, From), on_arc(Centre, U, V, From + Sweep), Centre, U, V, From,
        Sweep}.

%% @doc The arc of path data: end points, radii, rotation in degrees and flags, by the conversion
%% of SVG 1.1, appendix F.6. A zero radius gives a line; too small radii are scaled up.
-spec arc(
    starl_geometry:point(),
    Radii :: starl_geometry:point(),
    Degrees :: float(),
    Large :: boolean(),
    Sweep :: boolean(),
    starl_geometry:point()
) -> line() | arc().
arc({X1, Y1} = From, {RX, RY}, _Degrees, _Large, _Sweep, {X2, Y2} = To) when
    abs(RX) < ?NOTHING;
    abs(RY) < ?NOTHING;
    abs(X1 - X2) < ?NOTHING, abs(Y1 - Y2) < ?NOTHING
->
    {line, From, To};
arc({X1, Y1} = From, {RX0, RY0}, Degrees, Large, Sweep, {X2, Y2} = To) ->
    Phi = Degrees * ?PI / 180.0,
    {Cos, Sin} = {math:cos(Phi), math:sin(Phi)},
    {HX, HY} = {(X1 - X2) / 2.0, (Y1 - Y2) / 2.0},
    {PX, PY} = {Cos * HX + Sin * HY, Cos * HY - Sin * HX},
    {RX, RY} = grown(abs(RX0), abs(RY0), PX, PY),
    {A, B} = {PX / RX, PY / RY},
    K = centre_factor(A, B, Large, Sweep),
    {CA, CB} = {K * B, -K * A},
    U = {RX * Cos, RX * Sin},
    V = {-RY * Sin, RY * Cos},
    Centre = on_basis({(X1 + X2) / 2.0, (Y1 + Y2) / 2.0}, U, V, CA, CB),
    Angle = math:atan2(B - CB, A - CA),
    Turn = turn(math:atan2(-B - CB, -A - CA) - Angle, Sweep),
    {arc, From, To, Centre, U, V, Angle, Turn}.

%% @doc The curve under an affine map, exactly.
-spec transform(starl_svg_transform:matrix(), t()) -> t().
transform(M, {line, P0, P1}) ->
    {line, at(M, P0), at(M, P1)};
transform(M, {quad, P0, P1, P2}) ->
    {quad, at(M, P0), at(M, P1), at(M, P2)};
transform(M, {cubic, P0, P1, P2, P3}) ->
    {cubic, at(M, P0), at(M, P1), at(M, P2), at(M, P3)};
transform(M, {arc, P0, P1, C, U, V, Angle, Sweep}) ->
    {arc, at(M, P0), at(M, P1), at(M, C), starl_svg_transform:apply_vector(M, U),
        starl_svg_transform:apply_vector(M, V), Angle, Sweep}.

%% @doc The smallest axis-parallel box around the curve (not around its control points).
-spec bounds(t()) -> bounds().
bounds({line, P0, P1}) ->
    box([P0, P1]);
bounds({quad, {X0, Y0} = P0, {X1, Y1}, {X2, Y2} = P2} = Curve) ->
    Ts = inner(linear_roots(X0 - 2 * X1 + X2, X0 - X1) ++ linear_roots(Y0 - 2 * Y1 + Y2, Y0 - Y1)),
    box([P0, P2 | [point_at(Curve, T) || T <- Ts]]);
bounds({cubic, {X0, Y0} = P0, {X1, Y1}, {X2, Y2}, {X3, Y3} = P3} = Curve) ->
    Ts = inner(turning_points(X0, X1, X2, X3) ++ turning_points(Y0, Y1, Y2, Y3)),
    box([P0, P3 | [point_at(Curve, T) || T <- Ts]]);
bounds({arc, P0, P1, C, {UX, UY} = U, {VX, VY} = V, Angle, Sweep}) ->
    TX = math:atan2(VX, UX),
    TY = math:atan2(VY, UY),
    Turning = [T || T <- [TX, TX + ?PI, TY, TY + ?PI], on_sweep(T, Angle, Sweep)],
    box([P0, P1 | [on_arc(C, U, V, T) || T <- Turning]]).

%% @doc The smallest box around two boxes.
-spec merge_bounds(bounds(), bounds()) -> bounds().
merge_bounds({A0, B0, A1, B1}, {C0, D0, C1, D1}) ->
    {min(A0, C0), min(B0, D0), max(A1, C1), max(B1, D1)}.

%% @doc The number of chords that approximate the curve to within `Tolerance' (in the units of the
%% curve).
-spec steps(t(), Tolerance :: float()) -> pos_integer().
steps({line, _, _}, _Tolerance) ->
    1;
steps({quad, P0, P1, P2}, Tolerance) ->
    loop_steps(P0, P2, square_steps(bend(P0, P1, P2) / 4.0, Tolerance));
steps({cubic, P0, P1, P2, P3}, Tolerance) ->
    loop_steps(P0, P3, square_steps(max(bend(P0, P1, P2), bend(P1, P2, P3)) * 0.75, Tolerance));
steps({arc, _, _, _, U, V, _, Sweep}, Tolerance) ->
    %% No chord spans more than a quarter turn: a small circle should not become a line.
    Ratio = min(1.0, Tolerance / max(longest(U, V), 1.0e-300)),
    Step = min(?PI / 2.0, 2.0 * math:acos(1.0 - Ratio)),
    max(1, ceil(abs(Sweep) / max(Step, 1.0e-7) - 1.0e-9)).

%% @doc The corners of `N' chords along the curve, without its first point.
-spec flatten(t(), N :: pos_integer()) -> [starl_geometry:point()].
flatten({line, _, P1}, _N) -> [P1];
flatten(Curve, N) -> [point_at(Curve, K / N) || K <- lists:seq(1, N - 1)] ++ [finish(Curve)].

%%% Internals

at(Matrix, Point) -> starl_svg_transform:apply(Matrix, Point).

point_at({quad, P0, P1, P2}, T) ->
    between(between(P0, P1, T), between(P1, P2, T), T);
point_at({cubic, P0, P1, P2, P3}, T) ->
    point_at({quad, between(P0, P1, T), between(P1, P2, T), between(P2, P3, T)}, T);
point_at({arc, _, _, C, U, V, Angle, Sweep}, T) ->
    on_arc(C, U, V, Angle + Sweep * T).

between({X0, Y0}, {X1, Y1}, T) -> {X0 + (X1 - X0) * T, Y0 + (Y1 - Y0) * T}.

on_arc(C, U, V, Angle) -> on_basis(C, U, V, math:cos(Angle), math:sin(Angle)).

on_basis({CX, CY}, {UX, UY}, {VX, VY}, A, B) -> {CX + A * UX + B * VX, CY + A * UY + B * VY}.

%% Radii too small to span the two end points are scaled up until they just do.
grown(RX, RY, PX, PY) ->
    case math:sqrt((PX / RX) * (PX / RX) + (PY / RY) * (PY / RY)) of
        Reach when Reach > 1.0 -> {RX * Reach, RY * Reach};
        _ -> {RX, RY}
    end.

%% On the unit circle: half a chord `{A, B}' away from the chord's middle lies the centre.
centre_factor(A, B, Large, Sweep) ->
    Half = A * A + B * B,
    Distance = math:sqrt(max(0.0, 1.0 - Half) / max(Half, 1.0e-300)),
    case Large =:= Sweep of
        true -> -Distance;
        false -> Distance
    end.

turn(Angle, true) when Angle < 0.0 -> Angle + 2.0 * ?PI;
turn(Angle, false) when Angle > 0.0 -> Angle - 2.0 * ?PI;
turn(Angle, _Sweep) -> Angle.

box([{X, Y} | Points]) ->
    Add = fun({PX, PY}, Box) -> merge_bounds(Box, {PX, PY, PX, PY}) end,
    lists:foldl(Add, {X, Y, X, Y}, Points).

inner(Ts) -> [T || T <- Ts, T > 0.0, T < 1.0].

%% A derivative in one coordinate: A t^2 - 2 B t + C, up to a constant factor.
turning_points(P0, P1, P2, P3) ->
    A = P3 - 3.0 * P2 + 3.0 * P1 - P0,
    B = -(P2 - 2.0 * P1 + P0),
    C = P1 - P0,
    Size = max(abs(A), max(abs(B), abs(C))),
    case abs(A) =< 1.0e-12 * Size of
        true -> linear_roots(2.0 * B, C);
        false -> square_roots(A, B, B * B - A * C)
    end.

square_roots(_A, _B, Discriminant) when Discriminant < 0.0 ->
    [];
square_roots(A, B, Discriminant) ->
    Root = math:sqrt(Discriminant),
    [(B + Root) / A, (B - Root) / A].

%% The roots of A t = B; none if A is negligible beside B.
linear_roots(A, B) when abs(A) =< 1.0e-12 * abs(B); A == 0.0 -> [];
linear_roots(A, B) -> [B / A].

on_sweep(T, Angle, Sweep) when Sweep < 0.0 -> on_sweep(T, Angle + Sweep, -Sweep);
on_sweep(T, Angle, Sweep) ->
    Turns = (T - Angle) / (2.0 * ?PI),
    (Turns - floor(Turns)) * 2.0 * ?PI =< Sweep.

bend({X0, Y0}, {X1, Y1}, {X2, Y2}) ->
    {DX, DY} = {X0 - 2.0 * X1 + X2, Y0 - 2.0 * Y1 + Y2},
    math:sqrt(DX * DX + DY * DY).

%% One chord from a point to itself would leave the curve out.
loop_steps(From, To, 1) when From =:= To -> 2;
loop_steps(_From, _To, N) -> N.

square_steps(Bend, Tolerance) -> max(1, ceil(math:sqrt(Bend / Tolerance) - 1.0e-9)).

%% The longer half axis of the ellipse with conjugate radii U and V.
longest({UX, UY}, {VX, VY}) ->
    Sum = UX * UX + UY * UY + VX * VX + VY * VY,
    Det = UX * VY - UY * VX,
    math:sqrt((Sum + math:sqrt(max(0.0, Sum * Sum - 4.0 * Det * Det))) / 2.0).
