%% @doc The roadmap of a floor with walls: points that robots can reach, and straight lines between
%% them.
%%
%% The free floor is where a robot's path may lead: at least `wall_mm' from every wall. It is cut
%% into fine cells, and these are grouped into buckets. The middle cell of each bucket's part
%% becomes a point of the roadmap, joined to nearby points by straight lines. Parts that no straight
%% line joins, as at the two sides of a door, are joined by a path over the cells. So the roadmap
%% joins whatever the cells join. Lengths are millimetres.
-module(starl_dpp_cells).

-export([roads/2]).

-export_type([roads/0, vertex/0]).

-type cell() :: {integer(), integer()}.
-type vertex() :: pos_integer().

%% The points by number, the lines between them; places at walls, each with a point of its part of
%% the floor. Whatever is free has a point within `reach_mm'.
-type roads() :: #{
    walls := starl_walls:t(),
    wall_mm := float(),
    reach_mm := float(),
    points := #{vertex() => starl_geometry:point()},
    edges := [{vertex(), vertex()}],
    nooks := [{starl_geometry:point(), vertex()}]
}.

-record(map, {
    walls :: starl_walls:t(),
    wall_mm :: float(),
    %% the width of a cell, and of a bucket in cells
    pitch :: float(),
    side :: pos_integer(),
    %% the free cells, each with the vertex of its bucket's part
    cells = #{} :: #{cell() => vertex() | none},
    count = 0 :: non_neg_integer(),
    points = #{} :: #{vertex() => starl_geometry:point()},
    edges = [] :: [{vertex(), vertex()}]
}).

%% The finest cells (mm), and the most of them.
-define(PITCH_MM, 100.0).
-define(MOST_CELLS, 40000).
%% The width of a bucket in R, and the most buckets.
-define(BUCKET, 1.3).
-define(MOST_BUCKETS, 1500).

%% @doc The roadmap for paths that keep this distance from walls, and tubes of this radius.
-spec roads(starl_floor:t(), #{wall_mm := float(), tube_radius := float(), atom() => term()}) ->
    roads().
roads(Floor, #{wall_mm := Mm} = Config) ->
    Map = joined(meshed(measured(Floor, Config))),
    #map{walls = Walls, side = Side, pitch = Pitch, points = Points, edges = Edges} = Map,
    #{
        walls => Walls,
        wall_mm => Mm,
        reach_mm => 2.5 * Side * Pitch,
        points => Points,
        edges => lists:sort(Edges),
        nooks => nooks(Map)
    }.

%% Free cells at walls; every third is enough.
nooks(#map{cells = Cells} = Map) ->
    [
        {middle(Cell, Map), V}
     || {{I, J} = Cell, V} <- lists:sort(maps:to_list(Cells)),
        (I + J) rem 3 =:= 0,
        [N || N <- beside(Cell), not is_map_key(N, Cells)] =/= []
    ].

%% -- cells ----------------------------------------------------------------------------------

measured(#{size := {W, H}} = Floor, #{wall_mm := Mm, tube_radius := R}) ->
    Pitch = max(?PITCH_MM, math:sqrt(W * H / ?MOST_CELLS)),
    Bucket = max(?BUCKET * R, math:sqrt(W * H / ?MOST_BUCKETS)),
    Map = #map{
        walls = starl_walls:new(Floor),
        wall_mm = Mm,
        pitch = Pitch,
        side = max(1, round(Bucket / Pitch))
    },
    %% a step from cell to cell stays free, too
    Free = math:sqrt(Mm * Mm + Pitch * Pitch / 4),
    Cells = [
        {I, J}
     || I <- lists:seq(0, trunc(W / Pitch) - 1),
        J <- lists:seq(0, trunc(H / Pitch) - 1),
        is_clear(middle({I, J}, Map), Free, Map)
    ],
    Clear = maps:from_keys(Cells, none),
    %% what is deep in a wall is far from its sides
    Open = [
        Part
     || [Cell | _] = Part <- parts(Cells, Clear, fun(_, _) -> true end),
        not starl_walls:is_solid(middle(Cell, Map), Map#map.walls)
    ],
    Map#map{cells = maps:from_keys(lists:append(Open), none)}.

is_clear(P, Mm, #map{walls = Walls}) -> starl_walls:clearance({P, P}, Mm, Walls) >= Mm.

middle({I, J}, #map{pitch = Pitch}) -> {(I + 0.5) * Pitch, (J + 0.5) * Pitch}.

%% The parts of the given cells that steps join which are allowed.
parts([], _Open, _May) ->
    [];
parts([Cell | Cells], Open, May) ->
    case maps:take(Cell, Open) of
        {_, Left} ->
            {Part, Rest} = spread([Cell], [Cell], Left, May),
            [lists:reverse(Part) | parts(Cells, Rest, May)];
        error ->
            parts(Cells, Open, May)
    end.

spread([], Part, Open, _May) ->
    {Part, Open};
spread([Cell | Cells], Part, Open, May) ->
    New = [Next || Next <- beside(Cell), is_map_key(Next, Open), May(Cell, Next)],
    spread(New ++ Cells, New ++ Part, maps:without(New, Open), May).

beside({I, J}) -> [{I + 1, J}, {I, J + 1}, {I - 1, J}, {I, J - 1}].

%% -- the roadmap ----------------------------------------------------------------------------

%% A vertex for each part of a bucket, and straight lines between those of buckets that touch.
meshed(#map{cells = Cells, side = Side} = Map) ->
    Bucket = fun({I, J}) -> {floordiv(I, Side), floordiv(J, Side)} end,
    Same = fun(A, B) -> Bucket(A) =:= Bucket(B) end,
    Parts = parts(lists:sort(maps:keys(Cells)), Cells, Same),
    Numbered = lists:enumerate(Parts),
    Points = maps:from_list([{V, middle(central(Part), Map)} || {V, Part} <- Numbered]),
    Buckets = lists:foldl(
        fun({V, [Cell | _]}, Acc) ->
            maps:update_with(Bucket(Cell), fun(Vs) -> [V | Vs] end, [V], Acc)
        end,
        #{},
        Numbered
    ),
    Map#map{
        cells = maps:from_list([{Cell, V} || {V, Part} <- Numbered, Cell <- Part]),
        count = length(Parts),
        points = Points,
        edges = touching(Buckets, Points, Map)
    }.

touching(Buckets, Points, Map) ->
    [
        {V, W}
     || {{I, J}, Vs} <- lists:sort(maps:to_list(Buckets)),
        {DI, DJ} <- [{0, 0}, {1, 0}, {-1, 1}, {0, 1}, {1, 1}],
        V <- Vs,
        W <- maps:get({I + DI, J + DJ}, Buckets, []),
        {DI, DJ} =/= {0, 0} orelse V < W,
        is_free({maps:get(V, Points), maps:get(W, Points)}, Map)
    ].

floordiv(I, Side) -> I div Side.

is_free(Line, #map{walls = Walls, wall_mm = Mm}) -> starl_walls:is_free(Line, Mm, Walls).

%% The cell nearest to the middle of all.
central(Part) ->
    N = length(Part),
    {X, Y} = {lists:sum([I || {I, _} <- Part]) / N, lists:sum([J || {_, J} <- Part]) / N},
    {_, Cell} = lists:min([{(I - X) * (I - X) + (J - Y) * (J - Y), {I, J}} || {I, J} <- Part]),
    Cell.

%% Joins parts of the roadmap where their buckets touch, one pair of parts after the other.
joined(#map{cells = Cells, edges = Edges, count = Count} = Map) ->
    Touching = [
        {V, W, Cell, Next}
     || {Cell, V} <- lists:sort(maps:to_list(Cells)),
        Next <- beside(Cell),
        {ok, W} <- [maps:find(Next, Cells)],
        V < W
    ],
    Groups = lists:foldl(
        fun({V, W}, Acc) -> element(2, united(V, W, Acc)) end,
        maps:from_list([{V, V} || V <- lists:seq(1, Count)]),
        Edges
    ),
    {_, Joined} = lists:foldl(fun join/2, {Groups, Map}, Touching),
    Joined.

join({V, W, Cell, Next}, {Groups0, Map}) ->
    case united(V, W, Groups0) of
        {same, Groups} ->
            {Groups, Map};
        {new, Groups} ->
            From = lists:reverse(way(Cell, V, Map)),
            {Groups, along(V, W, From ++ way(Next, W, Map), Map)}
    end.

%% A way within a bucket's part, from a cell to its vertex.
way(Cell, V, #map{cells = Cells, points = Points} = Map) ->
    Goal = maps:get(V, Points),
    walk([[Cell]], #{Cell => true}, fun(C) -> middle(C, Map) =:= Goal end, V, Cells).

walk([[Cell | _] = Way | Ways], Seen, IsGoal, V, Cells) ->
    case IsGoal(Cell) of
        true ->
            lists:reverse(Way);
        false ->
            New = [N || N <- beside(Cell), not is_map_key(N, Seen), maps:get(N, Cells, none) =:= V],
            Known = lists:foldl(fun(N, S) -> S#{N => true} end, Seen, New),
            walk(Ways ++ [[N | Way] || N <- New], Known, IsGoal, V, Cells)
    end.

%% The way over these cells as few straight lines, between two vertices.
along(V, W, Way, #map{} = Map) ->
    Points = straight([middle(Cell, Map) || Cell <- Way], Map),
    Inner = lists:droplast(tl(Points)),
    #map{count = N, points = Known, edges = Edges} = Map,
    New = lists:enumerate(N + 1, Inner),
    Chain = [V] ++ [U || {U, _} <- New] ++ [W],
    Map#map{
        count = N + length(New),
        points = maps:merge(Known, maps:from_list(New)),
        edges = lists:zip(lists:droplast(Chain), tl(Chain)) ++ Edges
    }.

straight([A], _Map) -> [A];
straight([A | Rest], Map) -> [A | straight(farthest(A, Rest, Map), Map)].

%% The rest from the farthest point on that a straight line reaches.
farthest(A, [_ | Others] = Rest, Map) ->
    case Others =/= [] andalso is_free({A, hd(Others)}, Map) of
        true -> farthest(A, Others, Map);
        false -> Rest
    end.

united(V, W, Groups) ->
    case {root(V, Groups), root(W, Groups)} of
        {Same, Same} -> {same, Groups};
        {A, B} -> {new, Groups#{max(A, B) := min(A, B)}}
    end.

root(V, Groups) ->
    case Groups of
        #{V := V} -> V;
        #{V := Up} -> root(Up, Groups)
    end.
