%% @doc Computes contacts of round bodies in closed form: when a moving disc first touches a wall,
%% or another disc.
%%
%% A wall is a segment. A disc of radius `R' touches it where its centre is `R' from it: on a line
%% beside the segment (its face), or on a circle around one of its ends. Straight lines and arcs
%% meet both in closed form. A parabola, and two bodies of which one bends, are cut into chords from
%% which the path strays by a bound on its acceleration; there the bodies stop short of the contact
%% by at most twice that much, since they count as thicker by it and may be on the other side of the
%% chord; and never later.
%%
%% A body that touches already is in contact only if the distance falls: it may always leave, and
%% slide along. One that is in the wall, because a door has closed on it, may move where it gets no
%% deeper. Nothing is ever pushed. A contact is reported a micrometre before it, and rounded down to
%% a microsecond.
-module(starl_contact).

-export([wall/5, bodies/5, towards/3]).

-export_type([wall/0]).

%% A wall with its number.
-type wall() :: {N :: pos_integer(), starl_geometry:segment()}.

%% A body stops so far before the contact (mm).
-define(GAP_MM, 1.0e-3).
%% Nearer than this is touching: more than rounding, less than the gap (mm).
-define(TOUCH_MM, 1.0e-6).
%% The distance falls if it falls by more than this part of the way.
-define(FALLS, 1.0e-9).
%% How far a path strays from its chords (mm): a parabola; one body as seen from another.
-define(CHORD_MM, 0.005).
-define(RELATIVE_CHORD_MM, 0.02).
%% An arc with less than this between itself and its chord is taken as straight (mm).
-define(STRAIGHT_MM, 1.0e-4).

%% @doc The first moment from `From' to `To' (us) at which the disc on this piece touches one of
%% these walls and would get nearer, and the number of the wall; of two at once the first in the
%% list.
-spec wall(starl_trajectory:piece(), RadiusMm :: float(), [wall()], From, To) ->
    {AtUs :: integer(), N :: pos_integer()} | none
when
    From :: integer(), To :: integer().
wall(_Piece, _R, [], _From, _To) ->
    none;
wall(Piece, R, Walls, From, To) when From =< To ->
    stretch(cut(Piece, From, To), Piece, R, Walls).

%% @doc The first moment from `From' to `To' (us) at which two discs touch and would get nearer.
%% `Sum' is the sum of their radii (mm).
-spec bodies(starl_trajectory:piece(), starl_trajectory:piece(), SumMm :: float(), From, To) ->
    AtUs :: integer() | none
when
    From :: integer(), To :: integer().
bodies(A, B, Sum, From, To) ->
    Bend = bend(A) + bend(B),
    case Bend == 0 of
        true -> straight_pair(A, B, Sum, From, To);
        false -> curved_pair(A, B, Sum, Bend, From, To)
    end.

%% @doc Does a body on this piece move towards that place at this time?
-spec towards(starl_geometry:point(), T :: integer(), starl_trajectory:piece()) -> boolean().
towards({X, Y}, T, Piece) ->
    {PX, PY} = starl_trajectory:position(T, Piece),
    {VX, VY} = starl_trajectory:velocity(T, Piece),
    falls((X - PX) * VX + (Y - PY) * VY, {VX, VY}, {X - PX, Y - PY}).

%% -- walls ----------------------------------------------------------------------------------

%% The stretches of a piece: an arc, or straight ones; `Stray' is how far the path strays from it.
cut({piece, _, _, _, _, V, W}, From, To) ->
    S = (To - From) / 1.0e6,
    case abs(V * W) * S * S / 8 < ?STRAIGHT_MM of
        true when W == 0; V == 0 -> [{straight, From, To, 0.0}];
        true -> [{straight, From, To, ?STRAIGHT_MM}];
        false -> [{arc, From, To}]
    end;
cut({ramp, T0, _, _, _, _, _, Us} = Piece, From, To) ->
    Kink = max(From, min(To, T0 + Us)),
    N = chords(bend(Piece), Kink - From, ?CHORD_MM),
    Bent = [
        {straight, From + I * (Kink - From) div N, From + (I + 1) * (Kink - From) div N, ?CHORD_MM}
     || Kink > From, I <- lists:seq(0, N - 1)
    ],
    Bent ++ [{straight, Kink, To, 0.0} || Kink < To].

chords(Bend, Us, Stray) -> max(1, ceil(Us / 1.0e6 * math:sqrt(Bend / 8 / Stray))).

%% The bound of the acceleration (mm/s2).
bend({piece, _, _, _, _, V, W}) ->
    float(abs(V * W));
bend({ramp, _, _, _, _, _, _, 0}) ->
    0.0;
bend({ramp, _, _, _, _, {VX0, VY0}, {VX1, VY1}, Us}) ->
    math:sqrt((VX1 - VX0) * (VX1 - VX0) + (VY1 - VY0) * (VY1 - VY0)) * 1.0e6 / Us.

stretch([], _Piece, _R, _Walls) ->
    none;
stretch([{arc, From, To} | _], Piece, R, Walls) ->
    Arc = arc(From, Piece),
    first([{N, arc_wall(Arc, R, Wall)} || {N, Wall} <- Walls], From, To, speed_of(Piece));
stretch([{straight, From, To, Stray} | Rest], Piece, R, Walls) ->
    Way = straight(From, To, Piece),
    case first([{N, straight_wall(Way, R + Stray, W)} || {N, W} <- Walls], From, To, speed(Way)) of
        none -> stretch(Rest, Piece, R, Walls);
        Contact -> Contact
    end.

%% The earliest contact within the stretch, a little before it.
first(Found, From, To, Speed) ->
    Times = [{S, N} || {N, S} <- Found, S =/= none, S * 1.0e6 =< To - From],
    case Times of
        [] ->
            none;
        _ ->
            {Least, _} = lists:min(Times),
            {_, N} = lists:keyfind(Least, 1, Times),
            {From + floor(1.0e6 * max(0.0, Least - ?GAP_MM / Speed)), N}
    end.

%% Place and velocity at the beginning: those of the chord, from end to end.
straight(From, To, {piece, _, _, _, _, V, W} = Piece) when W == 0; V == 0; From =:= To ->
    {starl_trajectory:position(From, Piece), starl_trajectory:velocity(From, Piece)};
straight(From, To, Piece) when From =:= To ->
    {starl_trajectory:position(From, Piece), starl_trajectory:velocity(From, Piece)};
straight(From, To, Piece) ->
    {X0, Y0} = starl_trajectory:position(From, Piece),
    {X1, Y1} = starl_trajectory:position(To, Piece),
    S = (To - From) / 1.0e6,
    {{X0, Y0}, {(X1 - X0) / S, (Y1 - Y0) / S}}.

speed({_, {VX, VY}}) -> max(1.0e-6, math:sqrt(VX * VX + VY * VY)).

speed_of({piece, _, _, _, _, V, _}) -> abs(V).

%% Straight: beside the segment, or at one of its ends.
straight_wall({P, V}, R, {A, A}) ->
    straight_end(P, V, R, A);
straight_wall({P, V}, R, {A, B} = Wall) ->
    Beside = straight_face(P, V, R, Wall),
    least(Beside, least(straight_end(P, V, R, A), straight_end(P, V, R, B))).

%% An atom is larger than any number.
least(A, B) -> min(A, B).

straight_face({PX, PY}, {VX, VY}, R, {{AX, AY}, {BX, BY}}) ->
    Length = math:sqrt((BX - AX) * (BX - AX) + (BY - AY) * (BY - AY)),
    {UX, UY} = {(BX - AX) / Length, (BY - AY) / Length},
    H = (PY - AY) * UX - (PX - AX) * UY,
    Across = VY * UX - VX * UY,
    C = closing(H, Across),
    case C > ?FALLS * (abs(VX) + abs(VY)) of
        false ->
            none;
        true ->
            S = max(0.0, (abs(H) - R) / C),
            Foot = (PX + VX * S - AX) * UX + (PY + VY * S - AY) * UY,
            within(S, Foot, Length)
    end.

closing(H, Across) when H >= 0.0 -> -Across;
closing(_H, Across) -> Across.

within(S, Foot, Length) when Foot >= 0.0, Foot =< Length -> S;
within(_S, _Foot, _Length) -> none.

straight_end({PX, PY}, V, R, {EX, EY}) ->
    meets({PX - EX, PY - EY}, V, R).

%% When does a point at M with velocity V come within R of the origin?
meets({MX, MY} = M, {VX, VY} = V, R) ->
    B = MX * VX + MY * VY,
    case falls(-B, V, M) of
        false ->
            none;
        true ->
            Speed = math:sqrt(VX * VX + VY * VY),
            Past = abs(MX * VY - MY * VX) / Speed,
            Away = math:sqrt(MX * MX + MY * MY),
            if
                Away =< R -> 0.0;
                Past >= R -> none;
                true -> (Away - R) * (Away + R) / (-B + Speed * root((R - Past) * (R + Past)))
            end
    end.

root(X) -> math:sqrt(max(0.0, X)).

%% Does the distance fall, beyond rounding?
falls(Dot, {VX, VY}, {MX, MY}) ->
    Dot > ?FALLS * (abs(VX) + abs(VY)) * (abs(MX) + abs(MY)).

%% -- arcs -----------------------------------------------------------------------------------

%% Place and velocity at the beginning, centre, radius, angle and turn rate.
arc(From, {piece, _, _, _, _, V, W} = Piece) ->
    {X, Y, Heading} = starl_trajectory:pose(From, Piece),
    Rho = V / W,
    Centre = {CX, CY} = {X - Rho * math:sin(Heading), Y + Rho * math:cos(Heading)},
    Velocity = {V * math:cos(Heading), V * math:sin(Heading)},
    {{X, Y}, Velocity, Centre, abs(Rho), math:atan2(Y - CY, X - CX), W}.

%% A body that touches at the beginning is in contact if it gets nearer. Otherwise it counts as a
%% little thinner for this wall: so its next contact lies ahead, and not a whole lap away.
arc_wall({P, V, _, _, _, _} = Arc, R, Wall) ->
    case starl_geometry:point_segment(P, Wall) of
        Away when Away > R + ?TOUCH_MM ->
            arc_enters(Arc, R, Wall);
        Away ->
            {PX, PY} = P,
            {QX, QY} = starl_geometry:closest_point(P, Wall),
            {VX, VY} = V,
            Dot = (QX - PX) * VX + (QY - PY) * VY,
            case falls(Dot, V, {QX - PX, QY - PY}) of
                true -> 0.0;
                false -> arc_enters(Arc, max(0.0, Away - ?TOUCH_MM), Wall)
            end
    end.

arc_enters(Arc, R, {A, A}) ->
    arc_end(Arc, R, A);
arc_enters(Arc, R, {A, B} = Wall) ->
    Beside = lists:min([arc_face(Side, Arc, R, Wall) || Side <- [1.0, -1.0]]),
    least(Beside, least(arc_end(Arc, R, A), arc_end(Arc, R, B))).

arc_end({_, _, {CX, CY}, Radius, _, W} = Arc, R, {EX, EY}) ->
    D = math:sqrt((EX - CX) * (EX - CX) + (EY - CY) * (EY - CY)),
    G = abs(Radius - D),
    case G >= R orelse Radius + D =< R orelse D == 0 of
        true ->
            none;
        false ->
            Half = math:asin(min(1.0, root((R - G) * (R + G) / (4 * Radius * D)))),
            Angle = math:atan2(EY - CY, EX - CX),
            turned(Angle - sign(W) * 2 * Half, Arc)
    end.

%% From the side to which Side * the normal of the wall points.
arc_face(Side, {_, _, {CX, CY}, Radius, _, W} = Arc, R, {{AX, AY}, {BX, BY}}) ->
    Length = math:sqrt((BX - AX) * (BX - AX) + (BY - AY) * (BY - AY)),
    {UX, UY} = {(BX - AX) / Length, (BY - AY) / Length},
    {NX, NY} = {-Side * UY, Side * UX},
    K = (CX - AX) * NX + (CY - AY) * NY,
    Part = (Radius - (R - K)) / (2 * Radius),
    case Part =< 0 orelse Part >= 1 of
        true ->
            none;
        false ->
            Half = math:asin(math:sqrt(Part)),
            Angle = math:atan2(NY, NX) + sign(W) * 2 * Half,
            X = CX + Radius * math:cos(Angle),
            Y = CY + Radius * math:sin(Angle),
            within(turned(Angle, Arc), (X - AX) * UX + (Y - AY) * UY, Length)
    end.

sign(W) when W > 0 -> 1.0;
sign(_) -> -1.0.

%% The time until the body has this angle as seen from the centre (s).
turned(Angle, {_, _, _, _, Angle0, W}) ->
    Lap = 2 * math:pi(),
    Turn = math:fmod((Angle - Angle0) * sign(W), Lap),
    case Turn < 0 of
        true -> (Turn + Lap) / abs(W);
        false -> Turn / abs(W)
    end.

%% -- two bodies -----------------------------------------------------------------------------

straight_pair(A, B, Sum, From, To) ->
    {M, V} = relative(From, A, B),
    case meets(M, V, Sum) of
        S when is_float(S), S * 1.0e6 =< To - From ->
            From + floor(1.0e6 * max(0.0, S - ?GAP_MM / speed({M, V})));
        _ ->
            none
    end.

%% The place of one as seen from the other, and its velocity.
relative(T, A, B) ->
    {AX, AY} = starl_trajectory:position(T, A),
    {BX, BY} = starl_trajectory:position(T, B),
    {VX, VY} = starl_trajectory:velocity(T, A),
    {UX, UY} = starl_trajectory:velocity(T, B),
    {{BX - AX, BY - AY}, {UX - VX, UY - VY}}.

%% Chords of the relative path; where the bodies are far apart they come no nearer than their speeds
%% allow.
curved_pair(A, B, Sum, Bend, From, To) ->
    Fastest = max(1.0, starl_trajectory:fastest(A) + starl_trajectory:fastest(B)),
    Us = max(1, floor(1.0e6 * math:sqrt(8 * ?RELATIVE_CHORD_MM / Bend))),
    pair(From, To, Us, Sum + ?RELATIVE_CHORD_MM, Fastest, A, B).

pair(From, To, _Us, _Sum, _Fastest, _A, _B) when From >= To ->
    none;
pair(From, To, Us, Sum, Fastest, A, B) ->
    {MX, MY} = M = between(From, A, B),
    Free = floor(1.0e6 * (math:sqrt(MX * MX + MY * MY) - Sum) / Fastest),
    case Free > Us of
        true ->
            pair(From + Free, To, Us, Sum, Fastest, A, B);
        false ->
            Next = min(To, From + Us),
            {NX, NY} = between(Next, A, B),
            S = (Next - From) / 1.0e6,
            case meets(M, {(NX - MX) / S, (NY - MY) / S}, Sum) of
                At when is_float(At), At =< S -> From + floor(1.0e6 * At);
                _ -> pair(Next, To, Us, Sum, Fastest, A, B)
            end
    end.

between(T, A, B) ->
    {AX, AY} = starl_trajectory:position(T, A),
    {BX, BY} = starl_trajectory:position(T, B),
    {BX - AX, BY - AY}.
