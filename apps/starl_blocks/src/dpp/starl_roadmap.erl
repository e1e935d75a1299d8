%% @doc Makes the paths on which robots drive when they do not paint: parking spots, the ring road
%% and a roadmap.
%%
%% The floor is the box from the origin to the world's size. Along its walls lie the parking spots,
%% one per robot. Inside them runs a rectangular ring road. A spur at right angles joins each spot
%% to the ring. Inside the ring is the area for the picture. R is the tube radius. All spots are
%% more than 2R from each other, from the ring and everything inside it, and from the spurs of
%% others. So a parked robot is in nobody's way, as the paper's argument for progress requires.
%% Inside the ring a roadmap of evenly scattered points lets robots drive around each other. The
%% points are joined to near neighbours, to the ring and to the picture. Lengths are millimetres.
%%
%% ```
%%   wall |  R  | spot |  2.1 R  | ring |  1.5 R  | area ...
%% '''
-module(starl_roadmap).

-export([layout/3, travel/4, format_error/1]).
-export_type([layout/0, travel/0, world/0, reason/0]).

-type world() :: {Width :: float(), Height :: float()}.
-type vertex() :: pos_integer().
-type layout() :: #{
    area := starl_geometry:box(),
    ring := [starl_geometry:point()],
    spots := #{starl:robot_id() => starl_geometry:point()},
    feet := #{starl:robot_id() => starl_geometry:point()}
}.
%% `area' is where pictures should be; `ring' goes round anticlockwise, without repeating its first
%% point, and holds every foot, the place where a spur meets the ring.
-type travel() :: #{
    points := [starl_geometry:point()],
    edges := [{vertex(), vertex()}],
    spots := #{starl:robot_id() => vertex()},
    ring := [vertex()]
}.
%% The roadmap as a graph whose vertices are numbered on from those of the picture.
-type reason() ::
    {world_too_small, #{robots := pos_integer(), most := non_neg_integer(), world := world()}}.

-define(GAP, 2.1).
%% Spacing of things that must be more than 2 R apart, in R.
-define(CORNER, 1.5).
%% Feet stay this many R from the ring's corners: spurs around a corner are then 2.12 R apart.
-define(SPACING, 2.5).
%% Mean spacing of the roadmap's points in R.
-define(REACH, 1.3).
%% The longest distance of two joined points, in that spacing: about five neighbours each.
%% Ways are cut short where a straight line is clear, so more of them make no way shorter: pictures
%% take as long to paint as with 1.7 (nine neighbours), and searches cost more.
-define(MOST_POINTS, 2000).

%% @doc Places `N' robots, numbered from 1, around the walls.
-spec layout(world(), Robots :: pos_integer(), R :: float()) ->
    {ok, layout()} | {error, reason()}.
layout({W, H} = World, N, R) ->
    Inset = (1.0 + ?GAP) * R,
    Box = {Inset, Inset, W - Inset, H - Inset},
    Sides = sides(Box, R),
    Usable = lists:sum([L || {_, _, L} <- Sides]),
    Roomy = lists:min([L || {_, _, L} <- Sides]) > 0.0,
    case Roomy andalso Usable / N >= ?GAP * R of
        true ->
            {ok, place(Box, Sides, Usable / N, N, R)};
        false ->
            Most =
                case Roomy of
                    true -> floor(Usable / (?GAP * R));
                    false -> 0
                end,
            {error, {world_too_small, #{robots => N, most => Most, world => World}}}
    end.

%% @doc The roadmap for a layout and a picture, given as its vertices in order and its edges.
%% `Seed' chooses where the roadmap's points fall.
-spec travel(layout(), R :: float(), Picture, Seed :: integer()) -> travel() when
    Picture :: starl_planar:graph().
travel(#{ring := Ring, spots := Spots, feet := Feet} = Layout, R, Picture, Seed) ->
    #{vertices := Targets, edges := TargetEdges} = Picture,
    First = length(Targets) + 1,
    {RingVs, SpotsFrom} = number(Ring, First),
    {SpotVs, SamplesFrom} = number([P || {_, P} <- lists:sort(maps:to_list(Spots))], SpotsFrom),
    Robots = lists:sort(maps:keys(Spots)),
    {Sampled, Spacing} = samples(Layout, R, Seed),
    {SampleVs, _} = number(Sampled, SamplesFrom),
    Inside = RingVs ++ SampleVs,
    Spurs = [{V, foot(maps:get(Id, Feet), RingVs)} || {Id, {V, _}} <- lists:zip(Robots, SpotVs)],
    {TargetVs, _} = number(Targets, 1),
    Edges =
        Spurs ++ around([V || {V, _} <- RingVs]) ++ mesh(RingVs, SampleVs, ?REACH * Spacing) ++
            links(sparse(TargetVs, R), Inside, Spacing),
    #{
        points => [P || {_, P} <- RingVs ++ SpotVs ++ SampleVs],
        edges => Edges ++ bridges(Inside, TargetVs, TargetEdges ++ Edges, Spacing),
        spots => maps:from_list(lists:zip(Robots, [V || {V, _} <- SpotVs])),
        ring => [V || {V, _} <- RingVs]
    }.

%% @doc One line that says what is wrong and what to do.
-spec format_error(reason()) -> iolist().
format_error({world_too_small, #{robots := N, most := Most, world := {W, H}}}) ->
    io_lib:format(
        "a floor of ~.1f m by ~.1f m has parking spots for ~b robots, not for ~b: "
        "use fewer robots or a larger floor",
        [W / 1000, H / 1000, Most, N]
    ).

%%% Layout

%% Each side of the ring, anticlockwise: where feet may begin, the direction, the usable length.
sides({X0, Y0, X1, Y1}, R) ->
    C = ?CORNER * R,
    [
        {{X0 + C, Y0}, {1.0, 0.0}, X1 - X0 - 2.0 * C},
        {{X1, Y0 + C}, {0.0, 1.0}, Y1 - Y0 - 2.0 * C},
        {{X1 - C, Y1}, {-1.0, 0.0}, X1 - X0 - 2.0 * C},
        {{X0, Y1 - C}, {0.0, -1.0}, Y1 - Y0 - 2.0 * C}
    ].

place({X0, Y0, X1, Y1} = Box, Sides, Step, N, R) ->
    Placed = [{Id, foot_at((Id - 0.5) * Step, Sides)} || Id <- lists:seq(1, N)],
    Feet = [{Id, Foot} || {Id, {Foot, _}} <- Placed],
    Corners = [{X0, Y0}, {X1, Y0}, {X1, Y1}, {X0, Y1}],
    #{
        area => starl_geometry:grow(Box, -1.5 * R),
        ring => ring(Corners, [Foot || {_, Foot} <- Feet], ?SPACING * R),
        spots => maps:from_list([{Id, outwards(F, D, ?GAP * R)} || {Id, {F, D}} <- Placed]),
        feet => maps:from_list(Feet)
    }.

foot_at(Along, [{{X, Y}, {DX, DY}, Length} | Sides]) when Along =< Length; Sides =:= [] ->
    {{X + Along * DX, Y + Along * DY}, {DX, DY}};
foot_at(Along, [{_, _, Length} | Sides]) ->
    foot_at(Along - Length, Sides).

%% Going round anticlockwise, outwards is to the right.
outwards({X, Y}, {DX, DY}, Mm) -> {X + Mm * DY, Y - Mm * DX}.

ring([A, B, C, D], Feet, Spacing) ->
    lists:append([side(P, Q, Feet, Spacing) || {P, Q} <- [{A, B}, {B, C}, {C, D}, {D, A}]]).

%% The first corner, the feet on this side, and points between them where they are far apart.
side(P, Q, Feet, Spacing) ->
    On = [
        {starl_geometry:distance(P, F), F}
     || F <- Feet, starl_geometry:point_segment(F, {P, Q}) < 1.0e-6
    ],
    Stops = [P] ++ [F || {_, F} <- lists:sort(On)] ++ [Q],
    #{vertices := Points} = subdivide(Stops, Spacing),
    Order = [{starl_geometry:distance(P, X), X} || X <- Points, X /= Q],
    [X || {_, X} <- lists:sort(Order)].

subdivide(Stops, Spacing) ->
    Segments = lists:zip(lists:droplast(Stops), tl(Stops)),
    starl_planar:planarise(Segments, #{max_length => Spacing}).

%%% Roadmap

number(Points, From) ->
    To = From + length(Points),
    {lists:zip(lists:seq(From, To - 1), Points), To}.

foot(Foot, RingVs) -> hd([V || {V, P} <- RingVs, P == Foot]).

around([First | _] = Vs) -> lists:zip(Vs, tl(Vs) ++ [First]).

%% The R2 low-discrepancy sequence: like random points, but evenly spread at any number.
samples(#{area := Area}, R, Seed) ->
    {X0, Y0, X1, Y1} = starl_geometry:grow(Area, 0.5 * R),
    Size = max(0.0, X1 - X0) * max(0.0, Y1 - Y0),
    Wanted = ceil(Size / math:pow(?SPACING * R, 2)),
    N = max(16, min(?MOST_POINTS, Wanted)),
    {U, Rand} = rand:uniform_s(rand:seed_s(exsss, Seed)),
    {V, _} = rand:uniform_s(Rand),
    G = 1.32471795724474602596,
    Points = [
        {X0 + frac(U + I / G) * (X1 - X0), Y0 + frac(V + I / (G * G)) * (Y1 - Y0)}
     || I <- lists:seq(1, N)
    ],
    {Points, max(math:sqrt(Size / N), R)}.

frac(X) -> X - math:floor(X).

%% Joins each sample to all points within the reach.
mesh(RingVs, SampleVs, Reach) ->
    Grid = index(RingVs ++ SampleVs, Reach),
    [
        {V, W}
     || {V, P} <- SampleVs,
        {W, Q} <- starl_grid:near({P, P}, Reach, Grid),
        V > W,
        starl_geometry:distance(P, Q) =< Reach
    ].

%% One target vertex per square of side R is enough to come and go anywhere.
sparse(TargetVs, R) ->
    Keep = fun({V, {X, Y} = P}, Acc) ->
        Cell = {floor(X / R), floor(Y / R)},
        case Acc of
            #{Cell := _} -> Acc;
            #{} -> Acc#{Cell => {V, P}}
        end
    end,
    lists:sort(maps:values(lists:foldl(Keep, #{}, TargetVs))).

%% Joins each of the vertices to three of the nearest points of the roadmap.
links(Vs, Inside, Spacing) ->
    Grid = index(Inside, Spacing),
    [{V, W} || {V, P} <- Vs, W <- nearest(P, Grid, Spacing, 3)].

index(Vs, Cell) ->
    lists:foldl(
        fun({_, P} = Key, G) -> starl_grid:add(Key, {P, P}, G) end,
        starl_grid:new(Cell),
        Vs
    ).

nearest(P, Grid, Radius, K) ->
    Near = lists:sort([
        {starl_geometry:distance(P, Q), V}
     || {V, Q} <- starl_grid:near({P, P}, Radius, Grid)
    ]),
    case length(Near) >= K of
        true -> [V || {_, V} <- lists:sublist(Near, K)];
        false -> nearest(P, Grid, 2.0 * Radius, K)
    end.

%% Joins every part that cannot be reached from the ring yet: its first vertex, to the nearest
%% points of the roadmap that can.
bridges([{Root, _} | _] = Inside, TargetVs, Edges, Spacing) ->
    Vertices = lists:max([V || {V, _} <- Inside ++ TargetVs]),
    Neighbours = neighbours(Edges, Vertices),
    Reached = flood(Root, Neighbours, starl_dpp_array:new(Vertices, false)),
    Grid = index([VP || {V, _} = VP <- Inside, starl_dpp_array:get(V, Reached)], Spacing),
    Bridge = fun({V, P}, {Seen, Acc}) ->
        case starl_dpp_array:get(V, Seen) of
            true ->
                {Seen, Acc};
            false ->
                New = [{V, W} || W <- nearest(P, Grid, Spacing, 2)],
                {flood(V, Neighbours, Seen), New ++ Acc}
        end
    end,
    Used = [VP || {V, _} = VP <- TargetVs, starl_dpp_array:get(V, Neighbours) =/= []],
    {_, Bridges} = lists:foldl(Bridge, {Reached, []}, Used ++ Inside),
    lists:reverse(Bridges).

neighbours(Edges, Vertices) ->
    Add = fun(V, W, Acc) -> starl_dpp_array:put(V, [W | starl_dpp_array:get(V, Acc)], Acc) end,
    Join = fun({V, W}, Acc) -> Add(W, V, Add(V, W, Acc)) end,
    lists:foldl(Join, starl_dpp_array:new(Vertices, []), Edges).

flood(Root, Neighbours, Seen) ->
    flood_on([Root], Neighbours, starl_dpp_array:put(Root, true, Seen)).

flood_on([], _Neighbours, Seen) ->
    Seen;
flood_on([V | Rest], Neighbours, Seen0) ->
    See = fun(W, {Found, Seen}) ->
        case starl_dpp_array:get(W, Seen) of
            true -> {Found, Seen};
            false -> {[W | Found], starl_dpp_array:put(W, true, Seen)}
        end
    end,
    {Next, Seen1} = lists:foldl(See, {Rest, Seen0}, starl_dpp_array:get(V, Neighbours)),
    flood_on(Next, Neighbours, Seen1).
