%% @doc Makes the roadmap and the parking spots of a floor with walls. The roadmap
%% ({@link starl_dpp_cells}) leads through every door that is wide enough. The parking spots are
%% where a parked robot is in nobody's way. They are made once for a run, as the option `ways' of
%% path planning. Lengths are millimetres.
-module(starl_dpp_floor).

-export([new/2, new/3, reach/2, reachable/1, leads_to/2]).
-export([near/1, travel/2, clear/2, walls/1, places/1, is_ways/1, format_error/1]).

-export_type([t/0, walls/0, config/0, reason/0, reach/0]).

-type segment() :: starl_geometry:segment().

%% The robots, the radius of their tubes, the distance of their paths from walls, the lines that
%% they are to drive, and the place near which they park.
-type config() :: #{
    robots := pos_integer(),
    tube_radius := float(),
    wall_mm := float(),
    lines := [segment()],
    near := starl_geometry:point()
}.

%% The roadmap, with its points numbered from 1. Each spot has the point of the roadmap over which
%% robots leave it.
-type t() :: #{
    floor := starl_floor:t(),
    wall_mm := float(),
    reach_mm := float(),
    points := [starl_geometry:point()],
    edges := [{pos_integer(), pos_integer()}],
    spots := [{starl_geometry:point(), Foot :: pos_integer()}]
}.

%% The walls, and the distance that paths keep from them.
-type walls() :: {starl_walls:t(), Mm :: float()} | none.

-type reason() :: no_room | {spots, Most :: non_neg_integer(), Robots :: pos_integer()}.

%% The part of the floor that robots can come to.
-opaque reach() :: #{
    roads := starl_dpp_cells:roads(),
    part := part(),
    grid := starl_grid:t({vertex(), starl_geometry:point()})
}.

-type vertex() :: starl_dpp_cells:vertex().
-type edge() :: {vertex(), vertex()}.
-type part() :: #{vertex() => true}.

-record(lot, {
    walls :: starl_walls:t(),
    wall_mm :: float(),
    r2 :: float(),
    reach :: float(),
    lines :: [segment()],
    points :: #{vertex() => starl_geometry:point()},
    neighbours :: #{vertex() => [{vertex(), edge()}]},
    edges :: starl_grid:t(edge()),
    grid :: starl_grid:t({vertex(), starl_geometry:point()}),
    %% for each end of a line the vertices that it is joined to
    ends :: [[vertex()]],
    %% the spots so far, with their feet, and the edges that they close
    spots = [] :: [{starl_geometry:point(), vertex()}],
    closed = #{} :: #{edge() => true}
}).

%% More than 2R between a parked robot and what it must not close.
-define(ROOM, 1.05).

%% @doc The roadmap and the spots, with the lines that robots can reach from there and those that
%% they cannot.
-spec new(starl_floor:t(), config()) ->
    {ok, t(), #{reached := [segment()], lost := [segment()]}} | {error, reason()}.
new(Floor, Config) ->
    case reach(Floor, maps:remove(lines, Config)) of
        {ok, Reach} -> new(Floor, Config, Reach);
        {error, _} = Error -> Error
    end.

%% @doc The same for lines that were laid where robots can come to.
-spec new(starl_floor:t(), config(), reach()) ->
    {ok, t(), #{reached := [segment()], lost := [segment()]}} | {error, reason()}.
new(Floor, #{lines := Lines} = Config, #{part := Part, roads := Roads} = Reach) ->
    IsJoined = fun({A, B}) -> leads_to(A, Reach) andalso leads_to(B, Reach) end,
    {Reached, Lost} = lists:partition(IsJoined, Lines),
    parked(Floor, Reached, Lost, Part, Roads, Config).

%% @doc Where robots can come to from the place near which they park.
-spec reach(starl_floor:t(), #{
    robots := pos_integer(),
    tube_radius := float(),
    wall_mm := float(),
    near := starl_geometry:point()
}) -> {ok, reach()} | {error, no_room}.
reach(Floor, #{near := Near} = Config) ->
    #{points := Points, reach_mm := Mm} = Roads = starl_dpp_cells:roads(Floor, Config),
    case lists:sort([{starl_geometry:distance(Near, P), V} || {V, P} <- maps:to_list(Points)]) of
        [] ->
            {error, no_room};
        [{_, Root} | _] ->
            Grid = index(maps:to_list(Points), Mm),
            {ok, #{roads => Roads, part => part(Root, Roads), grid => Grid}}
    end.

%% @doc The points of the roadmap that robots can come to.
-spec reachable(reach()) -> [starl_geometry:point()].
reachable(#{part := Part, roads := #{points := Points}}) ->
    [P || {V, P} <- lists:sort(maps:to_list(Points)), is_map_key(V, Part)].

%% @doc Can robots come to this point?
-spec leads_to(starl_geometry:point(), reach()) -> boolean().
leads_to(P, #{part := Part, roads := Roads, grid := Grid}) ->
    lists:any(fun(V) -> is_map_key(V, Part) end, visible(P, Grid, Roads)).

parked(Floor, Reached, Lost, Part, Roads, #{robots := N, tube_radius := R, near := Near}) ->
    #{points := Points, edges := Edges, nooks := Nooks} = Roads,
    At = lists:sort([{starl_geometry:distance(Near, P), P} || {P, V} <- Nooks, is_map_key(V, Part)]),
    case spots(N, [P || {_, P} <- At], Reached, R, Part, Roads) of
        {ok, Spots} ->
            Ways = (maps:with([wall_mm, reach_mm], Roads))#{
                floor => Floor,
                points => [P || {_, P} <- lists:sort(maps:to_list(Points))],
                edges => Edges,
                spots => Spots
            },
            {ok, Ways, #{reached => Reached, lost => Lost}};
        {most, Most} ->
            {error, {spots, Most, N}}
    end.

%% @doc The place of a plan near which robots park by custom: the first of these that it has, or the
%% origin.
-spec near(starl_floor:t()) -> starl_geometry:point().
near(#{places := Places}) ->
    Known = [start, start5, start1, dock],
    case [maps:get(Name, Places) || Name <- Known, is_map_key(Name, Places)] of
        [Place | _] -> Place;
        [] -> {0.0, 0.0}
    end.

%% The four nearest points to which a straight line leads.
visible(P, Grid, #{walls := Walls, wall_mm := Mm, reach_mm := Reach}) ->
    Near = lists:sort([
        {starl_geometry:distance(P, Q), V, Q}
     || {V, Q} <- starl_grid:near({P, P}, Reach, Grid)
    ]),
    lists:sublist([V || {_, V, Q} <- Near, starl_walls:is_free({P, Q}, Mm, Walls)], 4).

index(Points, Size) ->
    Add = fun({_, P} = Key, Grid) -> starl_grid:add(Key, {P, P}, Grid) end,
    lists:foldl(Add, starl_grid:new(Size), Points).

%% @doc One line that says what is wrong and what to do.
-spec format_error(reason()) -> unicode:chardata().
format_error(no_room) ->
    "there is no room for a robot between the walls: use a larger scale, or another plan";
format_error({spots, Most, N}) ->
    io_lib:format(
        "the floor has parking spots out of everybody's way for ~b robots, not for ~b: use fewer robots, "
        "or another plan",
        [Most, N]
    ).

%% @doc Is this term the ways of a floor?
-spec is_ways(term()) -> boolean().
is_ways(#{floor := _, wall_mm := _, reach_mm := _, points := _, edges := _, spots := _}) -> true;
is_ways(_) -> false.

%% @doc The walls that paths keep away from.
-spec walls(t()) -> {starl_walls:t(), Mm :: float()}.
walls(#{floor := Floor, wall_mm := Mm}) -> {starl_walls:new(Floor), Mm}.

%% @doc Does a line keep away from the walls? A robot that begins nearer to a wall comes no nearer.
-spec clear(segment(), walls()) -> boolean().
clear(_Line, none) ->
    true;
clear({A, _} = Line, {Walls, Mm}) ->
    case starl_walls:clearance(Line, Mm, Walls) of
        Room when Room >= Mm -> true;
        Room -> Room >= starl_walls:clearance({A, A}, Mm, Walls) - 1.0e-3 andalso Room > 0.9 * Mm
    end.

%% @doc The poses of robots that stand on the spots, ready to leave.
-spec places(t()) -> [starl:pose()].
places(#{spots := Spots, points := Points}) ->
    All = list_to_tuple(Points),
    [{X, Y, starl_geometry:heading({X, Y}, element(Foot, All))} || {{X, Y}, Foot} <- Spots].

%% @doc The roadmap for a picture of lines, its vertices numbered on from those of the picture.
-spec travel(t(), starl_planar:graph()) -> starl_roadmap:travel().
travel(#{points := Points, edges := Edges, spots := Spots, reach_mm := Reach} = Ways, #{
    vertices := Targets
}) ->
    {Walls, Mm} = walls(Ways),
    Roads = #{walls => Walls, wall_mm => Mm, reach_mm => Reach},
    N = length(Targets),
    Grid = index(lists:enumerate(N + 1, Points), Reach),
    Parked = lists:enumerate(N + length(Points) + 1, Spots),
    #{
        points => Points ++ [P || {P, _} <- Spots],
        edges =>
            [{A + N, B + N} || {A, B} <- Edges] ++ [{V, Foot + N} || {V, {_, Foot}} <- Parked] ++
            [{V, W} || {V, P} <- lists:enumerate(Targets), W <- visible(P, Grid, Roads)],
        spots => maps:from_list([{Id, V} || {Id, {V, _}} <- lists:enumerate(Parked)]),
        ring => []
    }.

%% -- parking spots ----------------------------------------------------------------------------

%% Chooses parking spots on a floor with walls. Every line, and a path from every spot to every line, keeps
%% 2R clear of every parked robot. So a robot can go to work and park again whatever the others do, once
%% these are parked: the paper's argument for progress. The spots are taken one by one, in the order of the candidates. Lengths
%% are millimetres.

%% The part of the roadmap that can be reached from a vertex.
-spec part(vertex(), starl_dpp_cells:roads()) -> part().
part(V, #{edges := Edges}) -> reach(V, #{}, neighbours(Edges)).

%% This number of spots among the candidates, each with the vertex by which it is left; or the
%% most that there are.
-spec spots(N, [starl_geometry:point()], [segment()], R, part(), starl_dpp_cells:roads()) ->
    {ok, [{starl_geometry:point(), Foot :: vertex()}]} | {most, non_neg_integer()}
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
    park(N, Candidates, Lot#lot{ends = [near_vertices(P, Lot) || {A, B} <- Lines, P <- [A, B]]}).

park(0, _Candidates, #lot{spots = Spots}) ->
    {ok, lists:reverse(Spots)};
park(_N, [], #lot{spots = Spots}) ->
    {most, length(Spots)};
park(N, [P | Candidates], Lot) ->
    case with(P, Lot) of
        {ok, Next} -> park(N - 1, Candidates, Next);
        no -> park(N, Candidates, Lot)
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
    case lists:search(Leaves, near_vertices(P, Lot)) of
        {value, V} -> V;
        false -> none
    end.

%% The vertices to which a straight line leads, the nearest first.
near_vertices(P, #lot{grid = Grid, reach = Reach, walls = Walls, wall_mm = Mm}) ->
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
