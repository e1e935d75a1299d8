%% @doc Computes with parts of a segment: the part near another segment, the union of several parts,
%% and the gaps between them. Lengths are in millimetres. A part of {@link starl_painting_monitor}.
-module(starl_painting_monitor_parts).

-export([within/3, beside/4, unite/2, gap/2, gaps/3]).

-export_type([part/0]).

-type segment() :: starl_geometry:segment().
%% A closed part of a segment, in mm from its start.
-type part() :: {FromMm :: float(), ToMm :: float()}.

%% Rounding (mm).
-define(SLACK_MM, 1.0e-6).
%% Directions with a smaller sine between them are parallel.
-define(PARALLEL, 1.0e-12).

%% @doc The part of a segment (mm from its start) that lies within `Reach' mm of another one.
%% It is one interval, since the points within `Reach' of a segment are a convex set: two discs
%% around the ends and the rectangle between them.
-spec within(Reach :: float(), segment(), segment()) -> part() | none.
within(Reach, {A, B} = Segment, {C, D} = Other) ->
    case starl_geometry:length(Segment) of
        Length when Length < 1.0e-9 ->
            dot_within(starl_geometry:point_segment(A, Other) =< Reach, Length);
        Length ->
            %% In most cases ink follows its line from end to end.
            case is_near(A, Other, Reach) andalso is_near(B, Other, Reach) of
                true -> {0.0, Length};
                false -> part_within(Reach, A, direction(A, B, Length), Length, C, D)
            end
    end.

%% @doc The part of a line (mm from its start) that has a piece of ink beside it, at most `Reach' mm
%% to the left or right. Ink before the start or past the end of the line counts for up to `Ends'
%% mm: the part may begin below 0 and end beyond the length.
-spec beside(Reach :: float(), Ends :: float(), Line :: segment(), Ink :: segment()) ->
    part() | none.
beside(Reach, Ends, {A, B}, {P, Q}) ->
    Length = starl_geometry:length({A, B}),
    {PX, PY} = in_frame(P, A, B, Length),
    {QX, QY} = in_frame(Q, A, B, Length),
    case both(slab(PY, QY - PY, -Reach, Reach), {0.0, 1.0}) of
        none ->
            none;
        {S, T} ->
            Ax = PX + S * (QX - PX),
            Bx = PX + T * (QX - PX),
            both({min(Ax, Bx), max(Ax, Bx)}, {-Ends, Length + Ends})
    end.

%% Coordinates of a point along the line and to its left.
in_frame({X, Y}, {AX, AY} = A, B, Length) ->
    {UX, UY} = direction(A, B, Length),
    {(X - AX) * UX + (Y - AY) * UY, (Y - AY) * UX - (X - AX) * UY}.

%% @doc The gaps that these ascending parts leave in a segment of this length. A gap at an end
%% counts if it is longer than `Ends', a gap between two parts if it is longer than twice `Ends',
%% because two strokes meet there.
-spec gaps(Length :: float(), Ends :: float(), [part()]) -> [part()].
gaps(Length, _Ends, []) ->
    [{0.0, Length}];
gaps(Length, Ends, [{First, To} | Parts]) ->
    [{0.0, min(First, Length)} || First > Ends + ?SLACK_MM] ++ between(To, Parts, Length, Ends).

between(To, [], Length, Ends) ->
    [{max(0.0, To), Length} || Length - To > Ends + ?SLACK_MM];
between(To, [{From, Next} | Parts], Length, Ends) ->
    [{To, From} || From - To > 2 * Ends + ?SLACK_MM] ++ between(Next, Parts, Length, Ends).

%% @doc Adds a part to ascending, disjoint parts.
-spec unite(part(), [part()]) -> [part(), ...].
unite(Part, []) ->
    [Part];
unite({_, High} = Part, [{Low, _} | _] = Parts) when High < Low -> [Part | Parts];
unite({Low, _} = Part, [{_, High} = First | Parts]) when Low > High ->
    [First | unite(Part, Parts)];
unite({Low, High}, [{Low1, High1} | Parts]) ->
    unite({min(Low, Low1), max(High, High1)}, Parts).

%% @doc The first gap that these parts leave in a segment of this length (mm); `none' if the gaps
%% are rounding errors only.
-spec gap(Length :: float(), [part()]) -> part() | none.
gap(Length, Covered) -> gap(0.0, Length, Covered).

gap(From, Length, []) when Length - From > ?SLACK_MM -> {From, Length};
gap(_From, _Length, []) -> none;
gap(From, _Length, [{Low, _} | _]) when Low - From > ?SLACK_MM -> {From, Low};
gap(From, Length, [{_, High} | Parts]) -> gap(max(From, High), Length, Parts).

%% -- internals ------------------------------------------------------------------------------

is_near(P, Segment, Reach) -> starl_geometry:point_segment2(P, Segment) < Reach * Reach.

part_within(Reach, A, U, Length, C, D) ->
    Parts = [disc(Reach, A, U, C), disc(Reach, A, U, D), strip(Reach, A, U, C, D)],
    hull([Part || {_, _} = Part <- Parts], Length).

dot_within(true, Length) -> {0.0, Length};
dot_within(false, _Length) -> none.

hull([], _Length) ->
    none;
hull(Parts, Length) ->
    From = max(0.0, lists:min([Low || {Low, _} <- Parts])),
    To = min(Length, lists:max([High || {_, High} <- Parts])),
    part(From, To).

part(From, To) when From > To -> none;
part(From, To) -> {From, To}.

direction({AX, AY}, {BX, BY}, Length) -> {(BX - AX) / Length, (BY - AY) / Length}.

%% The part of the line from A in direction U that is inside the disc.
disc(Reach, {AX, AY}, {UX, UY}, {CX, CY}) ->
    Along = (CX - AX) * UX + (CY - AY) * UY,
    Across = (CX - AX) * UY - (CY - AY) * UX,
    case Reach * Reach - Across * Across of
        Square when Square < 0 -> none;
        Square -> {Along - math:sqrt(Square), Along + math:sqrt(Square)}
    end.

%% The part of that line beside the segment from C to D, at most Reach to its left or right.
strip(Reach, {AX, AY}, {UX, UY}, {CX, CY} = C, D) ->
    case starl_geometry:distance(C, D) of
        Length when Length < 1.0e-9 ->
            none;
        Length ->
            {WX, WY} = direction(C, D, Length),
            Beside = slab((AX - CX) * WX + (AY - CY) * WY, UX * WX + UY * WY, 0.0, Length),
            Close = slab((AY - CY) * WX - (AX - CX) * WY, UY * WX - UX * WY, -Reach, Reach),
            both(Beside, Close)
    end.

%% The values of s for which Low =< Start + s * Slope =< High.
slab(Start, Slope, Low, High) when abs(Slope) < ?PARALLEL ->
    case Start >= Low andalso Start =< High of
        true -> {-1.0e12, 1.0e12};
        false -> none
    end;
slab(Start, Slope, Low, High) ->
    S1 = (Low - Start) / Slope,
    S2 = (High - Start) / Slope,
    {min(S1, S2), max(S1, S2)}.

both({Low1, High1}, {Low2, High2}) -> part(max(Low1, Low2), min(High1, High2));
both(_, _) -> none.
