%% @doc Chooses parking spots on a floor with walls. With robots on all spots neither a line that is
%% to be driven, nor some way from each spot to each line, comes within 2R of a parked robot. So a
%% robot can go to work and park again whatever the others do, once these are parked: the paper's
%% argument for progress. The spots are taken one by one, in the order of the candidates. Lengths
%% are millimetres.
-module(starl_dpp_parking).

-export([part/2, spots/6]).

-type point() :: starl_geometry:point().
-type segment() :: starl_geometry:segment().
-type vertex() :: starl_dpp_cells:vertex().
-type edge() :: {vertex(), vertex()}.
-type part() :: #{vertex() => true}.

-record(lot, {
    walls :: starl_walls:t(),
    wall_mm :: float(),
    r2 :: float(),
    reach :: float(),
    lines :: [segment()],
    points :: #{vertex() => point()},
    neighbours :: #{vertex() => [{vertex(), edge()}]},
    edges :: starl_grid:t(edge()),
    grid :: starl_grid:t({vertex(), point()}),
    %% for each end of a line the vertices that it is joined to
    ends :: [[vertex()]],
    %% the spots so far, with their feet, and the edges that they close
    spots = [] :: [{point(), vertex()}],
    closed = #{} :: #{edge() => true}
}).

%% More than 2R between a parked robot and what it must not close.
-define(ROOM, 1.05).

%% @doc The part of the roadmap that can be reached from a vertex.
-spec part(vertex(), starl_dpp_cells:roads()) -> part().
part(V, #{edges := Edges}) -> reach(V, #{}, neighbours(Edges)).

%% @doc This number of spots among the candidates, each with the vertex by which it is left; or the
%% most that there are.
-spec spots(N, [point()], [segment()], R, part(), starl_dpp_cells:roads()) ->
    {ok, [{point(), Foot :: vertex()}]} | {most, non_neg_integer()}
when
    N :: pos_integer(), R :: float().
spots(N, Candidates, Lines, R, Part, #{walls := Walls, wall_mm := Mm, reach_mm := Reach} = Roads) ->
    #{points := Points, edges := Edges} = Roads,
    Enter = fun({A, B} = E, G) ->
        starl_grid:add(E, {maps:get(A, Points), maps:get(B, Points)}, G)
    end,
    Add = fun({_, P} = VP, G) -> starl_grid:add(VP, {P, P}, G) end,
    Mine = [VP || {V, _} = VP <- lists:sort(maps:to_list(Points)), is_map_key(V, Part)],
    Lot = #lot{
        walls = Walls,
        wall_mm = Mm,
        r2 = ?ROOM * 2 * R,
        reach = max(Reach, 4 * R),
        lines = Lines,
        points = Points,
        neighbours = neighbours(Edges),
        edges = lists:foldl(Enter, starl_grid:new(2 * R), Edges),
        grid = lists:foldl(Add, starl_grid:new(max(Reach, 4 * R)), Mine),
        ends = []
    },
    place(N, Candidates, Lot#lot{ends = [near(P, Lot) || {A, B} <- Lines, P <- [A, B]]}).

place(0, _Candidates, #lot{spots = Spots}) ->
    {ok, lists:reverse(Spots)};
place(_N, [], #lot{spots = Spots}) ->
    {most, length(Spots)};
place(N, [P | Candidates], Lot) ->
    case with(P, Lot) of
        {ok, Next} -> place(N - 1, Candidates, Next);
        no -> place(N, Candidates, Lot)
    end.

%% Another spot, if all robots can still come and go.
with(P, #lot{r2 = R2, spots = Spots, lines = Lines} = Lot) ->
    Apart =
        lists:all(fun({Q, _}) -> starl_geometry:distance(P, Q) > R2 end, Spots) andalso
            lists:all(fun(Line) -> starl_geometry:point_segment(P, Line) > R2 end, Lines),
    case Apart of
        true -> roomy([P | [Q || {Q, _} <- Spots]], closed(P, Lot), Lot);
        false -> no
    end.

closed(P, #lot{r2 = R2, edges = Edges, closed = Closed, points = Points}) ->
    Near = [
        E
     || {A, B} = E <- starl_grid:near({P, P}, R2, Edges),
        starl_geometry:point_segment(P, {maps:get(A, Points), maps:get(B, Points)}) < R2
    ],
    maps:merge(Closed, maps:from_keys(Near, true)).

roomy(Places, Closed, #lot{neighbours = Neighbours} = Lot) ->
    case root(Places, Lot) of
        none ->
            no;
        Root ->
            Core = reach(Root, Closed, Neighbours),
            Feet =
                joins_lines(Core, Lot) andalso [foot(P, Places -- [P], Core, Lot) || P <- Places],
            case Feet =:= false orelse lists:member(none, Feet) of
                true -> no;
                false -> {ok, Lot#lot{spots = lists:zip(Places, Feet), closed = Closed}}
            end
    end.

joins_lines(Core, #lot{ends = Ends}) ->
    lists:all(fun(Vs) -> lists:any(fun(V) -> is_map_key(V, Core) end, Vs) end, Ends).

%% A vertex that every robot has to reach.
root(_Places, #lot{ends = [[V | _] | _]}) ->
    V;
root([P | _], #lot{grid = Grid, reach = Reach, r2 = R2}) ->
    Near = starl_grid:near({P, P}, 3 * Reach, Grid),
    case [V || {V, Q} <- Near, starl_geometry:distance(P, Q) > R2] of
        [V | _] -> V;
        [] -> none
    end.

%% The nearest vertex by which a robot can leave its spot while the others are parked.
foot(P, Others, Core, #lot{r2 = R2, points = Points} = Lot) ->
    Leaves = fun(V) ->
        Spur = {P, maps:get(V, Points)},
        is_map_key(V, Core) andalso
            lists:all(fun(O) -> starl_geometry:point_segment(O, Spur) > R2 end, Others)
    end,
    case lists:search(Leaves, near(P, Lot)) of
        {value, V} -> V;
        false -> none
    end.

%% The vertices to which a straight line leads, the nearest first.
near(P, #lot{grid = Grid, reach = Reach, walls = Walls, wall_mm = Mm}) ->
    Near = lists:sort([
        {starl_geometry:distance(P, Q), V, Q}
     || {V, Q} <- starl_grid:near({P, P}, Reach, Grid)
    ]),
    [V || {_, V, Q} <- Near, starl_walls:is_free({P, Q}, Mm, Walls)].

neighbours(Edges) ->
    Add = fun(A, B, E, Acc) -> maps:update_with(A, fun(L) -> [{B, E} | L] end, [{B, E}], Acc) end,
    lists:foldl(fun({A, B} = E, Acc) -> Add(A, B, E, Add(B, A, E, Acc)) end, #{}, Edges).

reach(V, Closed, Neighbours) -> reach([V], #{V => true}, Closed, Neighbours).

reach([], Seen, _Closed, _Neighbours) ->
    Seen;
reach([V | Vs], Seen, Closed, Neighbours) ->
    New = lists:usort([
        W
     || {W, E} <- maps:get(V, Neighbours, []), not is_map_key(W, Seen), not is_map_key(E, Closed)
    ]),
    reach(New ++ Vs, maps:merge(Seen, maps:from_keys(New, true)), Closed, Neighbours).
