%% @doc The road of the intersection: an eight (Bernoulli's lemniscate), which crosses itself at a right angle in
%% the middle of the floor, in sections of equal length. A pure module; lengths are millimetres.
-module(starl_crossing_road).

-export([sections/1, most/1, starts/2, nearest/2, token/2, section/2, crossing/1]).

-export_type([road/0, token/0]).

%% The middles of the sections in the order of driving, the crossing first, and once more in the middle of
%% the list. Sections are counted from 0.
-type road() :: [starl_geometry:point(), ...].

-type token() :: crossing | {section, pos_integer()}.

%% What stays free at the edge of the floor, the length of a section at least, and the steps in which the
%% road's length is measured.
-define(EDGE_MM, 600).
-define(SECTION_MM, 1150).
-define(STEPS, 4000).
%% A section is free if no robot is nearer than this to its middle.
-define(FREE_MM, 700).

%% @doc The sections of the road on a floor of this size: an even number, eight at least.
-spec sections({WidthMm :: number(), HeightMm :: number()}) -> road().
sections({W, H}) ->
    Half = max(1.0, min(W / 2, 1.4 * H) - ?EDGE_MM),
    Points = [point(Half, {W / 2, H / 2}, I) || I <- lists:seq(0, ?STEPS)],
    Along = along(Points, 0.0),
    {Length, _} = lists:last(Along),
    N = 2 * max(4, trunc(Length / ?SECTION_MM / 2)),
    [at(I * Length / N, Along) || I <- lists:seq(0, N - 1)].

%% The road begins at the crossing.
point(Half, {CX, CY}, I) ->
    T = math:pi() / 2 + 2 * math:pi() * I / ?STEPS,
    {Sin, Cos} = {math:sin(T), math:cos(T)},
    Scale = Half / (1 + Sin * Sin),
    {CX + Scale * Cos, CY + Scale * Sin * Cos}.

along([P], Mm) -> [{Mm, P}];
along([P, Q | Points], Mm) -> [{Mm, P} | along([Q | Points], Mm + starl_geometry:distance(P, Q))].

at(Mm, [{From, P}, {To, Q} | _]) when Mm < To ->
    starl_geometry:interpolate(P, Q, (Mm - From) / (To - From));
at(Mm, [_ | Along]) ->
    at(Mm, Along).

%% @doc The most robots for which somebody can always drive on: not enough to fill one of the two loops.
-spec most(road()) -> pos_integer().
most(Road) -> length(Road) div 2 - 1.

%% @doc Where robots begin: evenly along the road, not in the crossing, each towards its next section.
-spec starts([starl:robot_id(), ...], road()) -> [{starl:robot_id(), starl:pose()}].
starts(Ids, Road) ->
    Sections = length(Road),
    Free = [I || I <- lists:seq(0, Sections - 1), token(I, Road) =/= crossing],
    Every = length(Free) / length(Ids),
    [
        {Id, pose(lists:nth(1 + trunc(K * Every), Free), Road)}
     || {K, Id} <- lists:enumerate(0, Ids)
    ].

pose(I, Road) ->
    {X, Y} = From = lists:nth(I + 1, Road),
    {X, Y, starl_geometry:heading(From, lists:nth((I + 1) rem length(Road) + 1, Road))}.

%% @doc The section whose middle is nearest.
-spec nearest(starl_geometry:point(), road()) -> non_neg_integer().
nearest(Point, Road) ->
    {_, I} = lists:min([
        {starl_geometry:distance(Point, Middle), I}
     || {I, Middle} <- lists:enumerate(0, Road)
    ]),
    I.

%% @doc The token of a section: both strands share that of the crossing.
-spec token(non_neg_integer(), road()) -> token().
token(I, Road) ->
    case I rem (length(Road) div 2) of
        0 -> crossing;
        _ -> {section, I}
    end.

%% @doc What is to be known of a section to drive there.
-spec section(non_neg_integer(), road()) -> starl_sections:section().
section(I, Road) ->
    #{token => token(I, Road), way => [lists:nth(I + 1, Road)], free_mm => ?FREE_MM}.

%% @doc The drawing of the crossing.
-spec crossing(road()) -> starl_drawing:shape().
crossing([Middle | _]) ->
    #{key => crossing, area => starl_drawing:circle(Middle, ?FREE_MM), colour => orange}.
