%% @doc The coordinator's plan of distributed path planning: free edges, reservations, assignments.
%%
%% The picture's lines become target edges, numbered from 1; the plan knows which of them are free
%% (the paper's FE), assigned or painted, and what each robot has reserved (Unsafe). A robot either
%% stands or drives an assignment. Reservations of different robots are never less than 2R apart,
%% so robots that keep to their tubes never meet (Lemma 7).
%%
%% Life of a robot: {@link standing/3} when it has certified that it stands; {@link request/2} for
%% work; {@link passed/3} for each waypoint it reaches; {@link standing/3} again at the end. When
%% nobody moves, edges are free and every request got `none', {@link resolve/2} sends robots out of
%% the way. Nothing is assigned until every robot's place is known.
%%
%% The run is over when a request answers `complete', or when nobody moves, every request answers
%% `none' and {@link resolve/2} answers nothing: then robots that no longer answer close the rest.
%%
%% All functions are pure; equal inputs give equal plans. Lengths are millimetres.
-module(starl_dpp_plan).

-export([new/1, format_error/1]).
-export([standing/3, passed/3, request/2, retreat/2, make_way/2, resolve/2]).
-export([reserve/3, adopt/4, mark_painted/2]).
-export([counts/1, painted_edges/1, painted_segments/1, target/2, unsafe/1, unknown/1,
         tube_radius/1, spot/2, parked/2, blocking/2, reachable/2]).
-export_type([t/0, config/0, path/0, waypoint/0, pen/0, counts/0]).

-type robot_id() :: pos_integer().
-type point() :: starl_geometry:point().
-type segment() :: starl_geometry:segment().
-type edge_id() :: starl_dpp_graph:edge_id().
-type pen() :: up | {down, edge_id()}.
-type waypoint() :: {point(), pen()}.
%% Where to drive to, straight, and whether that paints a target edge.
-type path() :: [waypoint(), ...].
-type config() :: #{
    segments := [segment()],
    world := starl_roadmap:world(),
    robots := [robot_id()],
    tube_radius := float(),
    slack => float(),
    horizon => float(),
    edge_length => float(),
    leg => float(),
    detour_factor => float(),
    detour_mm => float(),
    turn_mm => float(),
    overhead_mm => float(),
    seed => integer()
}.
%% `slack' (0): how far from its path a robot may stand and still count as on it, the paper's
%% r(v). `horizon' (3000): paint per assignment. `edge_length' (500): longest target edge. `leg'
%% (500): longest segment without paint; what is behind a waypoint is free for others.
%% `turn_mm' (160): mm driven in the time of turning one radian. `overhead_mm' (100): mm driven in
%% the time of a request. `seed' (1): where the roadmap's points fall.
-type counts() :: #{
    free := non_neg_integer(),
    assigned := non_neg_integer(),
    painted := non_neg_integer(),
    total := non_neg_integer()
}.
-type mode() :: unknown | {standing, point()} | {moving, Done :: non_neg_integer(), [waypoint()]}.

-record(plan, {
    config :: config(),
    graph :: starl_dpp_graph:t(),
    robots :: [robot_id()],
    unsafe :: starl_dpp_unsafe:t(),
    free :: #{edge_id() => true},
    painted = #{} :: #{edge_id() => true},
    modes = #{} :: #{robot_id() => mode()},
    headings = #{} :: #{robot_id() => float()},
    spots :: #{robot_id() => starl_dpp_graph:vertex()},
    yielded = #{} :: #{robot_id() => true}
}).
-opaque t() :: #plan{}.

-define(JOINTS, 14).
-define(TRIES, 40).
-define(PARKED, 0.04).
%% A robot within this many R of its spot is parked: spots have this much room to spare.

%%% Building

%% @doc A plan with all edges free and no robot's place known.
-spec new(config()) -> {ok, t()} | {error, starl_dpp_graph:reason()}.
new(Config0) ->
    Config = maps:merge(defaults(), Config0),
    Robots = lists:usort(maps:get(robots, Config)),
    Keys = [segments, world, robots, tube_radius, edge_length, seed],
    case starl_dpp_graph:new(maps:with(Keys, Config#{robots => Robots})) of
        {ok, Graph} -> {ok, plan(Robots, Graph, maps:remove(segments, Config))};
        {error, _} = Error -> Error
    end.

%% @doc One line that says what is wrong and what to do.
-spec format_error(starl_dpp_graph:reason()) -> iolist().
format_error(Reason) -> starl_dpp_graph:format_error(Reason).

%%% What robots report

%% @doc The robot certified that it stands still, anywhere, and holds no assignment any more. Its
%% edges that are not painted yet become free.
-spec standing(robot_id(), point(), t()) -> t().
standing(Robot, P, #plan{unsafe = Unsafe, modes = Modes} = Plan0) ->
    Q = snap(P, starl_dpp_unsafe:held(Robot, Unsafe), Plan0),
    Plan1 = release(Robot, Plan0),
    claim_spot(Robot, Q, Plan1#plan{
        unsafe = starl_dpp_unsafe:set(Robot, [{Q, Q}], Unsafe),
        modes = Modes#{Robot => {standing, Q}}
    }).

%% @doc The robot has reached the waypoint with this index, counted from 1, of its assignment.
%% Reports that are late or repeated change nothing.
-spec passed(robot_id(), Index :: pos_integer(), t()) -> t().
passed(Robot, Index, #plan{modes = Modes, unsafe = Unsafe} = Plan) ->
    case Modes of
        #{Robot := {moving, Done, Left}} when Index > Done, Left =/= [] ->
            {Reached, Rest} = lists:split(min(Index - Done, length(Left)), Left),
            N = length(Reached),
            Heading = heading_after(Robot, N, Plan),
            paint(pens(Reached), Plan#plan{
                unsafe = starl_dpp_unsafe:drop(Robot, N, Unsafe),
                headings = maps:merge(Plan#plan.headings, Heading),
                modes = Modes#{Robot := {moving, Done + N, Rest}}
            });
        #{} ->
            Plan
    end.

%%% What robots ask for

%% @doc Work for a robot that stands: a path that paints at least one free edge, clear of all other
%% reservations, its own standing place included. `none' when no free edge can be reached safely
%% now; `complete' when no edge is free or waiting to be painted.
-spec request(robot_id(), t()) -> {{assign, path()} | none | complete, t()}.
request(Robot, #plan{free = Free} = Plan) ->
    case {counts(Plan), position(Robot, Plan), unknown(Plan)} of
        {#{free := 0, assigned := 0}, _, _} -> {complete, Plan};
        {_, {ok, P}, []} when map_size(Free) > 0 -> consider(P, find_work(Robot, P, Plan), Plan);
        _ -> {none, Plan}
    end.

%% @doc A way to a parking spot, without painting; `none' when the robot is parked or there is no
%% safe way. The nearest spot that can be reached is taken; robots exchange spots for that.
-spec retreat(robot_id(), t()) -> {{assign, path()} | none, t()}.
retreat(Robot, Plan) ->
    case position(Robot, Plan) of
        {ok, P} -> park(Robot, P, Plan);
        none -> {none, Plan}
    end.

%% @doc A way to the nearest place where the robot closes no free edge to others; `none' when it
%% closes none, or has made way already since the last assignment to paint. For idle robots.
-spec make_way(robot_id(), t()) -> {{assign, path()} | none, t()}.
make_way(Robot, #plan{yielded = Yielded} = Plan) ->
    case {position(Robot, Plan), blocking(Robot, Plan)} of
        {{ok, P}, N} when N > 0, not is_map_key(Robot, Yielded) ->
            step_aside(Robot, P, fun(V) -> closes(V, Plan) =:= [] end, Plan);
        _ ->
            {none, Plan}
    end.

%% @doc Resolves a deadlock among the robots that wait: when nobody moves and all requests got
%% `none', the ones in the way of the robot that is nearest to a free edge get paths out of the
%% way. `[]' when nobody can or need move. Between two assignments to paint a robot moves at most
%% twice: once aside, once to a parking spot.
-spec resolve([robot_id()], t()) -> {[{robot_id(), path()}], t()}.
resolve(Waiting0, #plan{} = Plan) ->
    Waiting = [Id || Id <- lists:usort(Waiting0), position(Id, Plan) =/= none],
    case unknown(Plan) of
        [] -> try_work(Waiting, Plan);
        _ -> {[], Plan}
    end.

%%% Rebuilding after a coordinator was lost

%% @doc What a robot holds when its assignment is not known any more: these segments.
-spec reserve(robot_id(), [segment(), ...], t()) -> t().
reserve(Robot, Segments, #plan{unsafe = Unsafe, modes = Modes} = Plan) ->
    Items = [{Q, up} || {_, Q} <- Segments],
    (release(Robot, Plan))#plan{
        unsafe = starl_dpp_unsafe:set(Robot, Segments, Unsafe),
        modes = Modes#{Robot => {moving, 0, Items}}
    }.

%% @doc Takes over the rest of an assignment that a robot holds from an earlier coordinator: the
%% robot is on its way from the point along the path; indices count from the path's begin.
-spec adopt(robot_id(), From :: point(), path(), t()) -> t().
adopt(Robot, From, Path, Plan) -> assign(Robot, From, Path, release(Robot, Plan)).

%% @doc These edges are painted already.
-spec mark_painted([edge_id()], t()) -> t().
mark_painted(Edges, Plan) -> paint(Edges, Plan).

%%% What the plan knows

%% @doc How many target edges are in which state.
-spec counts(t()) -> counts().
counts(#plan{graph = Graph, free = Free, painted = Painted}) ->
    Total = starl_dpp_graph:targets(Graph),
    #{free => map_size(Free), painted => map_size(Painted), total => Total,
      assigned => Total - map_size(Free) - map_size(Painted)}.

%% @doc The painted edges, sorted.
-spec painted_edges(t()) -> [edge_id()].
painted_edges(#plan{painted = Painted}) -> lists:sort(maps:keys(Painted)).

%% @doc The painted edges as segments.
-spec painted_segments(t()) -> [segment()].
painted_segments(Plan) -> [target(E, Plan) || E <- painted_edges(Plan)].

%% @doc A target edge as a segment.
-spec target(edge_id(), t()) -> segment().
target(E, #plan{graph = Graph}) -> starl_dpp_graph:segment(E, Graph).

%% @doc All reservations, sorted by robot. One that stands holds a segment of length zero.
-spec unsafe(t()) -> [{robot_id(), [segment()]}].
unsafe(#plan{unsafe = Unsafe}) -> starl_dpp_unsafe:all(Unsafe).

%% @doc The robots whose place is not known. Until there are none, nothing is assigned.
-spec unknown(t()) -> [robot_id()].
unknown(#plan{unsafe = Unsafe}) -> starl_dpp_unsafe:unknown(Unsafe).

%% @doc The radius R of tubes and disks in mm.
-spec tube_radius(t()) -> float().
tube_radius(#plan{graph = Graph}) -> starl_dpp_graph:radius(Graph).

%% @doc The robot's parking spot at present.
-spec spot(robot_id(), t()) -> point().
spot(Robot, #plan{spots = Spots, graph = Graph}) ->
    starl_dpp_graph:point(maps:get(Robot, Spots), Graph).

%% @doc Does the robot stand on its parking spot?
-spec parked(robot_id(), t()) -> boolean().
parked(Robot, Plan) ->
    case position(Robot, Plan) of
        {ok, P} -> on_spot(P, spot(Robot, Plan), Plan);
        none -> false
    end.

%% @doc How many free edges the robot's reservation closes to others.
-spec blocking(robot_id(), t()) -> non_neg_integer().
blocking(Robot, #plan{unsafe = Unsafe, free = Free}) ->
    length([E || E <- starl_dpp_unsafe:blocks(Robot, Unsafe), is_map_key(E, Free)]).

%% @doc Could one of the live robots reach a free edge if all of them were parked? False means that
%% robots that no longer answer close everything that is left.
-spec reachable(Live :: [robot_id()], t()) -> boolean().
reachable(Live, #plan{graph = Graph, unsafe = Unsafe, free = Free, spots = Spots}) ->
    Masks = starl_dpp_unsafe:masks(Unsafe),
    Ignored = mask(Live, Unsafe),
    Open = fun(E) -> maps:get(E, Masks, 0) band (bnot Ignored) =:= 0 end,
    Reached = starl_dpp_graph:reach([maps:get(Id, Spots) || Id <- lists:usort(Live)], Open, Graph),
    lists:any(fun(E) ->
                  {A, _} = starl_dpp_graph:ends(E, Graph),
                  Open(E) andalso is_map_key(A, Reached)
              end, maps:keys(Free)).

%%% Internals: state

defaults() ->
    #{slack => 0.0, horizon => 3000.0, edge_length => 500.0, leg => 500.0, detour_factor => 1.1, detour_mm => 150.0, turn_mm => 160.0,
      overhead_mm => 100.0, seed => 1}.

plan(Robots, Graph, Config) ->
    Numbered = lists:zip(Robots, lists:seq(1, length(Robots))),
    Spots = starl_dpp_graph:spots(Graph),
    #plan{
        config = Config,
        graph = Graph,
        robots = Robots,
        unsafe = starl_dpp_unsafe:new(Robots, Graph),
        free = maps:from_list([{E, true} || E <- lists:seq(1, starl_dpp_graph:targets(Graph))]),
        spots = maps:from_list([{Id, maps:get(N, Spots)} || {Id, N} <- Numbered])
    }.

position(Robot, #plan{modes = Modes}) ->
    case Modes of
        #{Robot := {standing, P}} -> {ok, P};
        #{} -> none
    end.

pens(Items) -> [E || {_, {down, E}} <- Items].

%% A robot off the middle of its tube is still covered by the tube's disk around the middle.
snap(P, Held, #plan{config = #{slack := Slack}}) ->
    Near = [{starl_geometry:distance(P, Q), Q}
            || S <- Held, Q <- [starl_geometry:closest_point(P, S)]],
    case lists:sort(Near) of
        [{D, Q} | _] when D =< Slack -> Q;
        _ -> P
    end.

%% Edges that are assigned and not painted become free.
release(Robot, #plan{modes = Modes, free = Free, painted = Painted} = Plan) ->
    case Modes of
        #{Robot := {moving, _, Left}} ->
            Back = [{E, true} || E <- pens(Left), not is_map_key(E, Painted)],
            Heading = heading_after(Robot, 1, Plan),
            Plan#plan{free = maps:merge(Free, maps:from_list(Back)),
                      headings = maps:merge(Plan#plan.headings, Heading),
                      modes = maps:remove(Robot, Modes)};
        #{} ->
            Plan
    end.

paint(Edges, #plan{free = Free, painted = Painted} = Plan) ->
    Plan#plan{free = maps:without(Edges, Free),
              painted = lists:foldl(fun(E, Acc) -> Acc#{E => true} end, Painted, Edges)}.

%% The heading along the N-th segment of what the robot still holds, if that has one.
heading_after(Robot, N, #plan{unsafe = Unsafe}) ->
    Held = starl_dpp_unsafe:held(Robot, Unsafe),
    case lists:nth(min(N, length(Held)), Held) of
        {P, P} -> #{};
        {P, Q} -> #{Robot => starl_geometry:heading(P, Q)}
    end.

assign(Robot, From, Path, #plan{} = Plan) ->
    #plan{unsafe = Unsafe, free = Free, modes = Modes, painted = Painted} = Plan,
    Points = [From | [P || {P, _} <- Path]],
    Segments = lists:zip(lists:droplast(Points), tl(Points)),
    New = [E || E <- pens(Path), not is_map_key(E, Painted)],
    Plan#plan{
        unsafe = starl_dpp_unsafe:set(Robot, Segments, Unsafe),
        free = maps:without(New, Free),
        modes = Modes#{Robot => {moving, 0, Path}}
    }.

mask(Robots, Unsafe) ->
    lists:foldl(fun(Id, Acc) -> Acc bor starl_dpp_unsafe:bit(Id, Unsafe) end, 0, Robots).

on_spot(P, Spot, Plan) -> starl_geometry:distance(P, Spot) < ?PARKED * tube_radius(Plan).

%% Who stands on another's spot while that one is away takes it over.
claim_spot(Robot, P, #plan{spots = Spots, graph = Graph} = Plan) ->
    Here = [Id || {Id, V} <- lists:sort(maps:to_list(Spots)), Id =/= Robot,
                  on_spot(P, starl_dpp_graph:point(V, Graph), Plan), not parked(Id, Plan)],
    case Here of
        [] -> Plan;
        [Owner | _] -> exchange(Robot, Owner, Plan)
    end.

exchange(Robot, Owner, #plan{spots = Spots} = Plan) ->
    #{Robot := V, Owner := W} = Spots,
    Plan#plan{spots = Spots#{Robot := W, Owner := V}}.

%%% Internals: search

space(Ignored, #plan{graph = Graph, unsafe = Unsafe, config = #{turn_mm := TurnMm}}) ->
    #{graph => Graph, masks => starl_dpp_unsafe:masks(Unsafe), turn_mm => TurnMm,
      own => mask(Ignored, Unsafe)}.

starts(Robot, P, Vertices, Obstacles, Plan) ->
    Heading = maps:get(Robot, Plan#plan.headings, none),
    starl_dpp_route:starts(P, Heading, Vertices, Obstacles, space([Robot], Plan)).

nearby(P, #plan{graph = Graph}) -> [V || {_, V} <- starl_dpp_graph:joints(P, ?JOINTS, Graph)].

%% A long way around robots that will soon have moved on is not worth its ink: better wait.
consider(P, {{assign, Path}, _} = Answer, #plan{modes = Modes} = Plan) ->
    Moving = [Id || {Id, {moving, _, [_ | _]}} <- maps:to_list(Modes)],
    case Moving =/= [] andalso detour(P, Path, Plan) of
        true -> {none, Plan};
        false -> Answer
    end;
consider(_P, {none, _} = Answer, _Plan) ->
    Answer.

detour(P, Path, #plan{config = #{detour_factor := Factor, detour_mm := Mm}}) ->
    Points = [P | [Q || {Q, up} <- Path]],
    Driven = lists:sum([starl_geometry:length(S)
                        || S <- lists:zip(lists:droplast(Points), tl(Points))]),
    Driven > Factor * starl_geometry:distance(P, lists:last(Points)) + Mm.

find_work(Robot, P, #plan{unsafe = Unsafe, free = Free} = Plan) ->
    #plan{config = #{horizon := Horizon, overhead_mm := Overhead}} = Plan,
    Obstacles = starl_dpp_unsafe:others(Robot, Unsafe),
    Starts = starts(Robot, P, nearby(P, Plan), Obstacles, Plan),
    Task = #{space => space([Robot], Plan), free => Free, horizon => Horizon,
             overhead_mm => Overhead, bias => bias(Robot, Plan)},
    case starl_dpp_choice:best(Starts, Task, ?TRIES) of
        {ok, Job} ->
            Path = job_path(P, Job, Obstacles, Plan),
            {{assign, Path}, (assign(Robot, P, Path, Plan))#plan{yielded = #{}}};
        none ->
            {none, Plan}
    end.

bias(Robot, #plan{graph = Graph, free = Free, unsafe = Unsafe, config = Config} = Plan) ->
    A = maps:get(b_odd, Config, 0.0), B = maps:get(b_left, Config, 0.0),
    C = maps:get(b_near, Config, 0.0),
    Others = [P || {Id, [_ | _] = L} <- starl_dpp_unsafe:all(Unsafe), Id =/= Robot, {_, P} <- [lists:last(L)],
              not parked(Id, Plan)],
    Deg = fun(V) -> length([E || {E,_,_,_} <- starl_dpp_graph:adjacent(V, Graph), is_map_key(E, Free)]) end,
    fun(V, End, Chain) ->
        Odd = case Deg(V) rem 2 of 1 -> 1.0; 0 -> 1.0 - A end,
        Left = case Deg(End) rem 2 of 1 -> 1.0; 0 -> 1.0 - B end,
        Q = starl_dpp_graph:point(End, Graph),
        Near = length([1 || O <- Others, starl_geometry:distance(O, Q) < 1500.0]),
        _ = Chain,
        Odd * Left / (1.0 + C * Near)
    end.

job_path(P, #{trail := Trail, chain := Chain}, Obstacles, #plan{graph = Graph} = Plan) ->
    travel(P, Trail, Obstacles, Plan)
        ++ [{starl_dpp_graph:point(V, Graph), {down, E}} || {V, E} <- Chain].

%% The way along vertices with the pen up, cut short where that is safe.
travel(P, Trail, Obstacles, #plan{graph = Graph, config = Config}) ->
    Points = [starl_dpp_graph:point(V, Graph) || V <- Trail],
    Way = starl_dpp_route:smooth(distinct([P | Points]), Obstacles),
    [{Q, up} || Q <- starl_dpp_route:legs(Way, maps:get(leg, Config))].

distinct([P, Q | Rest]) ->
    case starl_geometry:distance(P, Q) < 1.0e-3 of
        true -> distinct([P | Rest]);
        false -> [P | distinct([Q | Rest])]
    end;
distinct(Points) ->
    Points.

%%% Internals: getting out of the way

park(Robot, P, #plan{} = Plan) ->
    case parked(Robot, Plan) of
        true -> {none, Plan};
        false -> park_at(free_spots(Robot, Plan), Robot, P, Plan)
    end.

%% Spots whose owner is away, the own one included.
free_spots(Robot, #plan{spots = Spots, robots = Robots} = Plan) ->
    maps:from_list([{maps:get(Id, Spots), Id}
                    || Id <- Robots, Id =:= Robot orelse not parked(Id, Plan)]).

park_at(FreeSpots, Robot, P, #plan{graph = Graph, unsafe = Unsafe} = Plan) ->
    Obstacles = starl_dpp_unsafe:others(Robot, Unsafe),
    Wide = nearby(P, Plan) ++ starl_dpp_graph:ring(Graph) ++ lists:sort(maps:keys(FreeSpots)),
    Starts = starts(Robot, P, lists:usort(Wide), Obstacles, Plan),
    Found = fun(V, _, _, _) when is_map_key(V, FreeSpots) -> {stop, {ok, V}};
               (_, _, _, none) -> {continue, none}
            end,
    case starl_dpp_search:run(Starts, space([Robot], Plan), Found, none) of
        {_, none} ->
            {none, Plan};
        {Labels, {ok, V}} ->
            Path = travel(P, starl_dpp_search:trail(V, Labels), Obstacles, Plan),
            Swapped = exchange(Robot, maps:get(V, FreeSpots), Plan),
            {{assign, Path}, assign(Robot, P, Path, Swapped)}
    end.

%% The free edges that a disk at a vertex would close.
closes(V, #plan{graph = Graph, free = Free}) ->
    P = starl_dpp_graph:point(V, Graph),
    Mm = 2.0 * starl_dpp_graph:radius(Graph),
    starl_dpp_graph:within({P, P}, {Mm, fun(E) -> is_map_key(E, Free) end}, Graph).

%% To the nearest vertex that will do.
step_aside(Robot, P, Good, #plan{unsafe = Unsafe, yielded = Yielded} = Plan) ->
    Obstacles = starl_dpp_unsafe:others(Robot, Unsafe),
    Starts = starts(Robot, P, nearby(P, Plan), Obstacles, Plan),
    Spots = maps:from_list([{V, true} || V <- maps:values(Plan#plan.spots)]),
    Visit = fun(V, _, _, none) ->
        case not is_map_key(V, Spots) andalso Good(V) of
            true -> {stop, {ok, V}};
            false -> {continue, none}
        end
    end,
    case starl_dpp_search:run(Starts, space([Robot], Plan), Visit, none) of
        {_, none} ->
            {none, Plan};
        {Labels, {ok, V}} ->
            Path = travel(P, starl_dpp_search:trail(V, Labels), Obstacles, Plan),
            go_aside(Robot, P, Path, Plan#plan{yielded = Yielded#{Robot => true}})
    end.

go_aside(_Robot, _P, [], Plan) -> {none, Plan};
go_aside(Robot, P, Path, Plan) -> {{assign, Path}, assign(Robot, P, Path, Plan)}.

%% The robot that is nearest to a free edge when those that wait are not in the way, the way it
%% would take, and who is in that way.
favourite(Waiting, Plan) ->
    Wishes = [Wish || Robot <- Waiting, Wish <- wish(Robot, Waiting, Plan)],
    case lists:sort(Wishes) of
        [{_, Robot, Segments, Blockers} | _] -> {Robot, Segments, Blockers};
        [] -> none
    end.

wish(Robot, Waiting, #plan{graph = Graph, free = Free, unsafe = Unsafe} = Plan) ->
    {ok, P} = position(Robot, Plan),
    #{own := Own, masks := Masks} = Space = space(Waiting, Plan),
    Starts = starl_dpp_route:starts(P, none, nearby(P, Plan), [], Space),
    Open = fun(V) -> [E || {E, _, _, _} <- starl_dpp_graph:adjacent(V, Graph), is_map_key(E, Free),
                           maps:get(E, Masks, 0) band (bnot Own) =:= 0] end,
    Visit = fun(V, Cost, _, none) ->
        case Open(V) of
            [] -> {continue, none};
            [E | _] -> {stop, {Cost, V, E}}
        end
    end,
    case starl_dpp_search:run(Starts, Space, Visit, none) of
        {_, none} ->
            [];
        {Labels, {Cost, V, E}} ->
            Points = [P | [starl_dpp_graph:point(W, Graph)
                           || W <- starl_dpp_search:trail(V, Labels)]],
            Segments = [starl_dpp_graph:segment(E, Graph)
                        | lists:zip(lists:droplast(Points), tl(Points))],
            Blockers = [Id || Id <- Waiting, Id =/= Robot,
                              in_way(starl_dpp_unsafe:held(Id, Unsafe), Segments, Plan)],
            [{Cost + 1000.0 * length(Blockers), Robot, Segments, Blockers}]
    end.

in_way(Held, Segments, Plan) ->
    Mm = 2.0 * tube_radius(Plan) + 1.0,
    lists:any(fun(S) -> lists:any(fun(H) -> starl_geometry:closer(H, S, Mm) end, Held) end,
              Segments).

%% What requests declined out of patience is granted now.
try_work(Waiting, Plan0) ->
    Grant = fun(Id, {Moves, Acc}) ->
        {ok, P} = position(Id, Acc),
        moved(Id, find_work(Id, P, Acc), Moves)
    end,
    case lists:foldl(Grant, {[], Plan0}, Waiting) of
        {[], Plan1} -> unblock(favourite(Waiting, Plan1), Waiting, Plan1);
        {Moves, Plan1} -> {lists:reverse(Moves), Plan1}
    end.

unblock(none, Waiting, Plan) ->
    first_out(outermost(Waiting, Plan), Plan);
unblock({Robot, Segments, Blockers}, Waiting, Plan0) ->
    case lists:foldl(fun(Id, Acc) -> leave(Id, Segments, Acc) end, {[], Plan0},
                     outermost(Blockers, Plan0)) of
        {[], Plan1} -> first_out(outermost(Waiting -- [Robot], Plan1) ++ [Robot], Plan1);
        {Moves, Plan1} -> {lists:reverse(Moves), Plan1}
    end.

%% Aside when that was not tried since the last paint, else to a spot.
leave(Robot, Segments, {Moves, Plan0}) ->
    {ok, P} = position(Robot, Plan0),
    Good = fun(V) ->
        Q = starl_dpp_graph:point(V, Plan0#plan.graph),
        not in_way([{Q, Q}], Segments, Plan0)
    end,
    Aside = case is_map_key(Robot, Plan0#plan.yielded) orelse parked(Robot, Plan0) of
        true -> {none, Plan0};
        false -> step_aside(Robot, P, Good, Plan0)
    end,
    case Aside of
        {{assign, Path}, Plan1} -> {[{Robot, Path} | Moves], Plan1};
        {none, Plan1} -> moved(Robot, park(Robot, P, Plan1), Moves)
    end.

moved(Robot, {{assign, Path}, Plan}, Moves) -> {[{Robot, Path} | Moves], Plan};
moved(_Robot, {none, Plan}, Moves) -> {Moves, Plan}.

%% The first of these robots that can park does.
first_out([], Plan) ->
    {[], Plan};
first_out([Robot | Rest], Plan0) ->
    case retreat(Robot, Plan0) of
        {{assign, Path}, Plan1} -> {[{Robot, Path}], Plan1};
        {none, Plan1} -> first_out(Rest, Plan1)
    end.

%% Those nearest to a wall first: nobody is between them and the ring.
outermost(Robots, #plan{graph = Graph} = Plan) ->
    Box = starl_dpp_graph:floor_box(Graph),
    Depths = [{depth(P, Box), Id} || Id <- Robots, {ok, P} <- [position(Id, Plan)]],
    [Id || {_, Id} <- lists:sort(Depths)].

depth({X, Y}, {X0, Y0, X1, Y1}) -> min(min(X - X0, X1 - X), min(Y - Y0, Y1 - Y)).
