%% @doc The graph that the coordinator plans on: the picture's edges and the roadmap.
%%
%% Edges 1 to {@link targets/1} are the target edges, in the order of the picture; the others are
%% for travel only. The graph never changes. Lengths are millimetres, headings radians.
-module(starl_dpp_graph).

-export([new/1, format_error/1]).
-export([targets/1, edges/1, vertices/1, radius/1, point/2, adjacent/2, lines/1, lines/2]).
-export([segment/2, ends/2, edge_length/2, longest/1, spots/1, ring/1, joints/3, within/3]).
-export([near/3, part/3, reach/3, clear/2, ahead/3, depth/2]).
-export_type([t/0, edge_id/0, vertex/0, step/0, near/0, config/0, reason/0]).

-type edge_id() :: pos_integer().
-type vertex() :: pos_integer().
-type segment() :: starl_geometry:segment().
-type step() :: {edge_id(), To :: vertex(), LengthMm :: float(), Heading :: float()}.
%% An edge out of a vertex.
-type near() :: {edge_id(), segment()}.
%% An edge and its segment.
-type config() :: #{
    segments := [segment()],
    world := starl_roadmap:world(),
    robots := [starl:robot_id()],
    tube_radius := float(),
    edge_length := float(),
    ways => starl_dpp_floor:t() | none,
    seed := integer()
}.
-type reason() ::
    no_robots
    | {too_many_edges, Edges :: pos_integer() | more, Most :: pos_integer()}
    | {outside_area, starl_geometry:point(), starl_geometry:box()}
    | {unreachable_edge, segment()}
    | starl_roadmap:reason().

-record(graph, {
    radius :: float(),
    world :: starl_roadmap:world(),
    targets :: non_neg_integer(),
    points :: tuple(),
    edges :: tuple(),
    adjacent :: starl_dpp_array:t([step()]),
    %% the target edges among them, few at most vertices: read far more often than all edges
    lines :: starl_dpp_array:t([step()]),
    longest :: float(),
    spots :: #{starl:robot_id() => vertex()},
    ring :: [vertex()],
    walls = none :: starl_dpp_floor:walls(),
    %% with walls: how far each vertex is from the nearest spot, over the roadmap
    depths = none :: starl_dpp_array:t(float()) | none,
    edge_grid :: starl_grid:t(edge_id()),
    vertex_grid :: starl_grid:t(vertex())
}).
-opaque t() :: #graph{}.

%% Memory and the time of planning grow with the edges: eight robots paint 30,000 with 0.5 GB.
-define(MOST_EDGES, 40000).
%% What is in the way of a robot is so near beyond its body (mm).
-define(AHEAD_MM, 100.0).

%% @doc Builds the graph and checks that every target edge can be driven from every spot while all
%% the others are parked.
-spec new(config()) -> {ok, t()} | {error, reason()}.
new(#{robots := []}) ->
    {error, no_robots};
new(#{world := World, robots := Robots, tube_radius := R} = Config) ->
    case maps:get(ways, Config, none) of
        none ->
            case starl_roadmap:layout(World, length(Robots), R) of
                {ok, Layout} -> drawn(fun(Picture) -> checked(Picture, Layout, Config) end, Config);
                {error, _} = Error -> Error
            end;
        Ways ->
            drawn(fun(Picture) -> walled(Picture, Ways, Config) end, Config)
    end.

drawn(Build, #{segments := Segments, edge_length := MaxLength}) ->
    case starl_planar:planarise(Segments, #{max_length => MaxLength, most => ?MOST_EDGES}) of
        too_many -> {error, {too_many_edges, more, ?MOST_EDGES}};
        Picture -> Build(Picture)
    end.

%% @doc One line that says what is wrong and what to do.
-spec format_error(reason()) -> iolist().
format_error(no_robots) ->
    "path planning needs at least one robot";
format_error({too_many_edges, more, Most}) ->
    io_lib:format(
        "the picture's lines cross at more than ~b places, at most ~b edges can be planned: "
        "simplify it",
        [Most, Most]
    );
format_error({too_many_edges, N, Most}) ->
    io_lib:format("the picture has ~b edges, at most ~b can be planned: simplify it", [N, Most]);
format_error({outside_area, {X, Y}, {X0, Y0, X1, Y1}}) ->
    io_lib:format(
        "the picture's point (~b, ~b) mm is outside the area that can be painted, "
        "x ~b to ~b and y ~b to ~b mm: scale or move the picture",
        [round(N) || N <- [X, Y, X0, X1, Y0, Y1]]
    );
format_error({unreachable_edge, {{AX, AY}, {BX, BY}}}) ->
    io_lib:format(
        "no way leads from the parking spots to the line from (~b, ~b) to "
        "(~b, ~b) mm: use a larger floor or fewer robots",
        [round(N) || N <- [AX, AY, BX, BY]]
    );
format_error({world_too_small, _} = Reason) ->
    starl_roadmap:format_error(Reason).

%% @doc The number of target edges.
-spec targets(t()) -> non_neg_integer().
targets(#graph{targets = N}) -> N.

%% @doc The number of edges; they are numbered from 1.
-spec edges(t()) -> non_neg_integer().
edges(#graph{edges = Edges}) -> tuple_size(Edges).

%% @doc The number of vertices; they are numbered from 1.
-spec vertices(t()) -> non_neg_integer().
vertices(#graph{points = Points}) -> tuple_size(Points).

%% @doc The tube radius R.
-spec radius(t()) -> float().
radius(#graph{radius = R}) -> R.

%% @doc Does a line keep away from the walls?
-spec clear(segment(), t()) -> boolean().
clear(Line, #graph{walls = Walls}) -> starl_dpp_floor:clear(Line, Walls).

%% @doc What is in the way of a robot that stands at a point and cannot go on towards another one: a door
%% of the floor plan that is closed, or else something at that place; and the distance to keep from it.
-spec ahead(starl_geometry:point(), Towards :: starl_geometry:point(), t()) ->
    {[segment(), ...], Mm :: float()}.
ahead({X, Y} = At, Towards, #graph{radius = R, walls = Walls}) ->
    {Mm, Doors} = kept(Walls, R),
    Heading = starl_geometry:heading(At, Towards),
    Far = fun(D) -> {X + D * math:cos(Heading), Y + D * math:sin(Heading)} end,
    Way = {At, Far(Mm + ?AHEAD_MM)},
    case [Door || Door <- Doors, starl_geometry:segment_segment(Way, Door) < 1.0] of
        [Door | _] -> {[Door], Mm};
        [] -> {[{Far(Mm), Far(Mm)}], Mm + ?AHEAD_MM}
    end.

kept(none, R) ->
    {R, []};
kept({Walls, Mm}, _R) ->
    #{doors := Doors} = starl_walls:floor(Walls),
    {Mm, Doors}.

%% @doc How far a point is from where robots park: from the border of the floor; with walls, from the nearest
%% spot over the roadmap.
-spec depth(starl_geometry:point(), t()) -> number().
depth({X, Y}, #graph{depths = none, world = {W, H}}) ->
    min(min(X, W - X), min(Y, H - Y));
depth(P, #graph{depths = Depths} = Graph) ->
    lists:min([Mm + starl_dpp_array:get(V, Depths) || {Mm, V} <- joints(P, 3, Graph)]).

%% @doc The point of a vertex.
-spec point(vertex(), t()) -> starl_geometry:point().
point(V, #graph{points = Points}) -> element(V, Points).

%% @doc The edges out of a vertex.
-spec adjacent(vertex(), t()) -> [step()].
adjacent(V, #graph{adjacent = Adjacent}) -> starl_dpp_array:get(V, Adjacent).

%% @doc The target edges out of a vertex.
-spec lines(vertex(), t()) -> [step()].
lines(V, #graph{lines = Lines}) -> starl_dpp_array:get(V, Lines).

%% @doc The same for all vertices.
-spec lines(t()) -> starl_dpp_array:t([step()]).
lines(#graph{lines = Lines}) -> Lines.

%% @doc The two ends of an edge.
-spec ends(edge_id(), t()) -> {vertex(), vertex()}.
ends(E, #graph{edges = Edges}) -> element(E, Edges).

%% @doc An edge as a segment.
-spec segment(edge_id(), t()) -> segment().
segment(E, #graph{edges = Edges, points = Points}) ->
    {A, B} = element(E, Edges),
    {element(A, Points), element(B, Points)}.

%% @doc The length of an edge.
-spec edge_length(edge_id(), t()) -> float().
edge_length(E, Graph) -> starl_geometry:length(segment(E, Graph)).

%% @doc The length of the longest target edge.
-spec longest(t()) -> float().
longest(#graph{longest = Mm}) -> Mm.

%% @doc The vertices of the parking spots, numbered as the layout does.
-spec spots(t()) -> #{starl:robot_id() => vertex()}.
spots(#graph{spots = Spots}) -> Spots.

%% @doc The vertices of the ring road.
-spec ring(t()) -> [vertex()].
ring(#graph{ring = Ring}) -> Ring.

%% @doc The edges less than `Mm' from a segment, among those that `Wanted' accepts.
-spec within(segment(), {Mm :: float(), fun((edge_id()) -> boolean())}, t()) -> [edge_id()].
within(Segment, {Mm, Wanted}, Graph) ->
    {Edges, _} = part(Segment, Mm, near(Segment, {Mm, Wanted}, Graph)),
    lists:reverse(Edges).

%% @doc The edges that may be less than `Mm' from a segment or a box, among those that `Wanted'
%% accepts.
-spec near(starl_grid:shape(), {Mm :: float(), fun((edge_id()) -> boolean())}, t()) -> [near()].
near(Shape, {Mm, Wanted}, #graph{edge_grid = Grid} = Graph) ->
    [{E, segment(E, Graph)} || E <- starl_grid:near(Shape, Mm, Grid), Wanted(E)].

%% @doc Those of the edges that are less than `Mm' from a segment, and the others.
-spec part(segment(), Mm :: float(), [near()]) -> {[edge_id()], [near()]}.
part(Segment, Mm, Near) ->
    {X0, Y0, X1, Y1} = starl_geometry:grow(starl_geometry:box(Segment), Mm),
    part(Near, X0, Y0, X1, Y1, Segment, Mm * Mm, [], []).

%% @doc Up to about `K' vertices nearest to a point, nearest first.
-spec joints(starl_geometry:point(), K :: pos_integer(), t()) -> [{Mm :: float(), vertex()}].
joints(P, K, #graph{radius = R} = Graph) -> joints(P, K, 1.5 * R, Graph).

%% @doc The vertices that can be reached from some vertices over edges that `Open' accepts.
-spec reach([vertex()], fun((edge_id()) -> boolean()), t()) -> #{vertex() => true}.
reach(Roots, Open, Graph) -> flood(Roots, Open, Graph, maps:from_list([{V, true} || V <- Roots])).

%%% Building

checked(#{vertices := Points, edges := Edges} = Picture, Layout, Config) ->
    #{area := Area} = Layout,
    R = maps:get(tube_radius, Config),
    %% The ring itself may be painted on; only lines beyond it are too near to the spots.
    Outside = [P || P <- Points, not starl_geometry:inside(P, starl_geometry:grow(Area, 1.5 * R))],
    case {length(Edges), Outside} of
        {N, _} when N > ?MOST_EDGES -> {error, {too_many_edges, N, ?MOST_EDGES}};
        {_, [P | _]} -> {error, {outside_area, P, Area}};
        {_, []} -> check_reach(build(Picture, Layout, Config))
    end.

build(Picture, Layout, #{tube_radius := R, seed := Seed} = Config) ->
    graph(Picture, starl_roadmap:travel(Layout, R, Picture, Seed), Config).

%% With walls the ways have been checked before: all lines can be reached.
walled(#{edges := Edges}, _Ways, _Config) when length(Edges) > ?MOST_EDGES ->
    {error, {too_many_edges, length(Edges), ?MOST_EDGES}};
walled(Picture, Ways, Config) ->
    Graph = graph(Picture, starl_dpp_floor:travel(Ways, Picture), Config),
    {ok, Graph#graph{walls = starl_dpp_floor:walls(Ways), depths = depths(Graph)}}.

%% Dijkstra's search from all spots at once.
depths(#graph{spots = Spots, points = Points} = Graph) ->
    Start = fun(V, Heap) -> starl_dpp_heap:push(0.0, V, Heap) end,
    Heap = lists:foldl(Start, starl_dpp_heap:new(), maps:values(Spots)),
    depths(starl_dpp_heap:pop(Heap), starl_dpp_array:new(tuple_size(Points), 1.0e9), Graph).

depths(empty, Depths, _Graph) ->
    Depths;
depths({Mm, V, Heap}, Depths, Graph) ->
    case starl_dpp_array:get(V, Depths) =< Mm of
        true ->
            depths(starl_dpp_heap:pop(Heap), Depths, Graph);
        false ->
            Push = fun({_, W, Length, _}, Acc) -> starl_dpp_heap:push(Mm + Length, W, Acc) end,
            Next = lists:foldl(Push, Heap, adjacent(V, Graph)),
            depths(starl_dpp_heap:pop(Next), starl_dpp_array:put(V, Mm, Depths), Graph)
    end.

graph(#{vertices := Drawn, edges := TargetEdges}, Travel, Config) ->
    #{tube_radius := R, world := World} = Config,
    Points = list_to_tuple(Drawn ++ maps:get(points, Travel)),
    All = TargetEdges ++ maps:get(edges, Travel),
    Targets = length(TargetEdges),
    Adjacent = adjacency(All, Points),
    #graph{
        radius = R,
        world = World,
        targets = Targets,
        points = Points,
        edges = list_to_tuple(All),
        adjacent = Adjacent,
        lines = lines_of(Drawn, Targets, Adjacent, Points),
        longest = lists:max([0.0 | [length_of(A, B, Points) || {A, B} <- TargetEdges]]),
        spots = maps:get(spots, Travel),
        ring = maps:get(ring, Travel),
        edge_grid = edge_grid(All, Points, R),
        vertex_grid = vertex_grid(Points, R)
    }.

length_of(A, B, Points) -> starl_geometry:distance(element(A, Points), element(B, Points)).

%% The ways out of each vertex, in the order of the edges.
adjacency(Edges, Points) ->
    Both = fun({A, B}, {E, Steps}) ->
        P = element(A, Points),
        Q = element(B, Points),
        D = starl_geometry:distance(P, Q),
        There = out(A, {E, B, D, starl_geometry:heading(P, Q)}, Steps),
        {E - 1, out(B, {E, A, D, starl_geometry:heading(Q, P)}, There)}
    end,
    Nothing = starl_dpp_array:new(tuple_size(Points), []),
    {0, Adjacent} = lists:foldr(Both, {length(Edges), Nothing}, Edges),
    Adjacent.

out(V, Step, Steps) -> starl_dpp_array:put(V, [Step | starl_dpp_array:get(V, Steps)], Steps).

%% Of these the ones along target edges, which come first; the picture's vertices do, too.
lines_of(Drawn, Targets, Adjacent, Points) ->
    Is = fun({E, _, _, _}) -> E =< Targets end,
    Enter = fun(V, Lines) ->
        starl_dpp_array:put(V, lists:takewhile(Is, starl_dpp_array:get(V, Adjacent)), Lines)
    end,
    Nothing = starl_dpp_array:new(tuple_size(Points), []),
    lists:foldl(Enter, Nothing, lists:seq(1, length(Drawn))).

edge_grid(Edges, Points, R) ->
    Enter = fun({A, B}, {E, Grid}) ->
        {E + 1, starl_grid:add(E, {element(A, Points), element(B, Points)}, Grid)}
    end,
    %% Mostly asked for what is less than 2R away.
    {_, Grid} = lists:foldl(Enter, {1, starl_grid:new(2.0 * R)}, Edges),
    Grid.

vertex_grid(Points, R) ->
    Enter = fun(V, Grid) ->
        P = element(V, Points),
        starl_grid:add(V, {P, P}, Grid)
    end,
    lists:foldl(Enter, starl_grid:new(R), lists:seq(1, tuple_size(Points))).

%% By symmetry of the spurs one search from the ring serves all robots: each spur is more than 2R
%% from the other spots, and what is inside of the ring is more than 2R from all.
check_reach(#graph{spots = Spots, ring = [Root | _], targets = N, radius = R} = Graph) ->
    Spurs = [S || {_, V} <- maps:to_list(Spots), S <- [{point(V, Graph), point(V, Graph)}]],
    Near = [E || S <- Spurs, E <- within(S, {2.0 * R, fun(_) -> true end}, Graph)],
    Closed = maps:from_list([{E, true} || E <- Near]),
    Reached = reach([Root], fun(E) -> not is_map_key(E, Closed) end, Graph),
    Lost = [
        E
     || E <- lists:seq(1, N),
        is_map_key(E, Closed) orelse not is_map_key(element(1, ends(E, Graph)), Reached)
    ],
    case Lost of
        [] -> {ok, Graph};
        [E | _] -> {error, {unreachable_edge, segment(E, Graph)}}
    end.

%% Nearly all are beside the box, and the first comparisons tell.
part([], _X0, _Y0, _X1, _Y1, _Segment, _Mm2, Within, Others) ->
    {Within, Others};
part([{_, {{AX, AY}, {BX, BY}}} = Edge | Near], X0, Y0, X1, Y1, Segment, Mm2, Within, Others) when
    AX =< X0, BX =< X0; AX >= X1, BX >= X1; AY =< Y0, BY =< Y0; AY >= Y1, BY >= Y1
->
    part(Near, X0, Y0, X1, Y1, Segment, Mm2, Within, [Edge | Others]);
part([{E, S} = Edge | Near], X0, Y0, X1, Y1, Segment, Mm2, Within, Others) ->
    case starl_geometry:closer2(S, Segment, Mm2) of
        true -> part(Near, X0, Y0, X1, Y1, Segment, Mm2, [E | Within], Others);
        false -> part(Near, X0, Y0, X1, Y1, Segment, Mm2, Within, [Edge | Others])
    end.

flood([], _Open, _Graph, Seen) ->
    Seen;
flood([V | Rest], Open, Graph, Seen0) ->
    Go = fun({E, W, _, _}, {New, Seen}) ->
        case is_map_key(W, Seen) orelse not Open(E) of
            true -> {New, Seen};
            false -> {[W | New], Seen#{W => true}}
        end
    end,
    {New, Seen1} = lists:foldl(Go, {Rest, Seen0}, adjacent(V, Graph)),
    flood(New, Open, Graph, Seen1).

joints(P, K, Radius, #graph{vertex_grid = Grid, world = {W, H}} = Graph) ->
    Near = starl_grid:near({P, P}, Radius, Grid),
    case length(Near) >= K orelse Radius > W + H of
        true ->
            %% keysort is stable, and they come by number
            Away = [{starl_geometry:distance(P, point(V, Graph)), V} || V <- Near],
            lists:sublist(lists:keysort(1, Away), K);
        false ->
            joints(P, K, 2.0 * Radius, Graph)
    end.
