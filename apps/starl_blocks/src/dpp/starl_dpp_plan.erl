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
    turn_mm => float(),
    overhead_mm => float(),
    middle => float(),
    patience => {Factor :: float(), Mm :: float()} | infinity,
    seed => integer()
}.
%% `slack' (0): how far from its path a robot may stand and still count as on it, the paper's
%% r(v); must not be more than the tube radius allows for. `horizon' (3000): paint per assignment.
%% `edge_length' (500): longest target edge. `leg' (500): longest segment without paint; what is
%% behind a waypoint is free for others. `turn_mm' (160): mm driven in the time of turning one
%% radian. `overhead_mm' (100): mm driven in the time of a request. `middle' (0.7): how much a line
%% counts that is begun in its middle. `patience' ({1.05, 50}): while others move, a request is
%% answered `none' rather than with a way around them that is longer than this times the straight
%% way and so many mm; `infinity' takes every way. `seed' (1): where the roadmap's points fall.
-type counts() :: #{
    free := non_neg_integer(),
    assigned := non_neg_integer(),
    painted := non_neg_integer(),
    total := non_neg_integer()
}.
-type mode() ::
    {standing, Reserved :: point(), Really :: point()}
    | {moving, Done :: non_neg_integer(), Left :: [waypoint()]}.

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

-define(PARKED, 0.04).
%% A robot within this many R of its spot is parked: spots have this much room to spare.

-define(FAR, 2000.0).
%% Up to this far away a robot gets work even if another will be there first,
-define(LEAD, 1000.0).
%% which counts when it is so much nearer.

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
        modes = Modes#{Robot => {standing, Q, P}}
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
%% now, or only by a long way around robots that move (see `patience'); `complete' when no edge is
%% free or waiting to be painted.
-spec request(robot_id(), t()) -> {{assign, path()} | none | complete, t()}.
request(Robot, Plan) ->
    case {counts(Plan), is_standing(Robot, Plan), unknown(Plan)} of
        {#{free := 0, assigned := 0}, _, _} -> {complete, Plan};
        {#{free := Free}, true, []} when Free > 0 ->
            find_work(Robot, others_move(Robot, Plan), Plan);
        _ ->
            {none, Plan}
    end.

%% @doc A way to a parking spot, without painting; `none' when the robot is parked or there is no
%% safe way. The nearest spot that can be reached is taken; robots exchange spots for that.
-spec retreat(robot_id(), t()) -> {{assign, path()} | none, t()}.
retreat(Robot, Plan) ->
    case is_standing(Robot, Plan) andalso not parked(Robot, Plan) andalso unknown(Plan) =:= [] of
        true -> park(Robot, Plan);
        false -> {none, Plan}
    end.

%% @doc A way to the nearest place where the robot closes no free edge to others; `none' when it
%% closes none, or has made way already since the last assignment to paint. For idle robots.
-spec make_way(robot_id(), t()) -> {{assign, path()} | none, t()}.
make_way(Robot, Plan) ->
    case is_standing(Robot, Plan) andalso blocking(Robot, Plan) > 0 andalso unknown(Plan) =:= [] of
        true ->
            View = view(Robot, Plan),
            step_aside(Robot, fun(V) -> starl_dpp_yield:closes(V, View) =:= [] end, Plan);
        false ->
            {none, Plan}
    end.

%% @doc Resolves a deadlock among the robots that wait, when nobody moves and all requests got
%% `none'. Requests that were answered `none' out of patience are granted, so a path may paint;
%% else the robots in the way of the one that is nearest to a free edge get paths out of the way,
%% outermost first. `[]' when nobody can or need move. Between two assignments to paint a robot
%% makes way at most twice: once aside, once to a parking spot.
-spec resolve([robot_id()], t()) -> {[{robot_id(), path()}], t()}.
resolve(Waiting0, Plan0) ->
    Waiting = [Id || Id <- lists:usort(Waiting0), is_standing(Id, Plan0)],
    case unknown(Plan0) =:= [] andalso grant(Waiting, Plan0) of
        false -> {[], Plan0};
        {[], Plan1} -> unblock(favourite(Waiting, Plan1), Waiting, Plan1);
        {Moves, Plan1} -> {Moves, Plan1}
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
%% robot is on its way from the point along the path. For one that is part of the way, take over
%% the whole path and then report the last waypoint it has {@link passed/3}.
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
    case Plan of
        #plan{modes = #{Robot := {standing, P, _}}} -> on_spot(P, spot(Robot, Plan), Plan);
        #plan{} -> false
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
    #{slack => 0.0, horizon => 3000.0, edge_length => 500.0, leg => 500.0, turn_mm => 160.0,
      overhead_mm => 100.0, middle => 0.7, patience => {1.05, 50.0}, seed => 1}.

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

is_standing(Robot, #plan{modes = Modes}) ->
    case Modes of
        #{Robot := {standing, _, _}} -> true;
        #{} -> false
    end.

others_move(Robot, #plan{modes = Modes}) ->
    [] =/= [Id || {Id, {moving, _, [_ | _]}} <- maps:to_list(Modes), Id =/= Robot].

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

%%% Internals: work

view(Robot, #plan{modes = Modes, graph = Graph, unsafe = Unsafe, free = Free} = Plan) ->
    #plan{config = #{turn_mm := TurnMm, leg := Leg}, headings = Headings} = Plan,
    #{Robot := {standing, P, _}} = Modes,
    #{robot => Robot, at => P, heading => maps:get(Robot, Headings, none), graph => Graph,
      unsafe => Unsafe, free => Free, turn_mm => TurnMm, leg => Leg}.

find_work(Robot, Patient, #plan{modes = Modes, config = Config} = Plan) ->
    #{Robot := {standing, _, Really}} = Modes,
    Settings = maps:with([horizon, overhead_mm, middle], Config),
    case starl_dpp_choice:best(Really, view(Robot, Plan), Settings) of
        {ok, #{path := Path} = Job} ->
            case Patient andalso (detour(Robot, Job, Plan)
                                  orelse better_placed(Robot, Job, Plan)) of
                true -> {none, Plan};
                false -> {{assign, Path}, (send(Robot, Path, Plan))#plan{yielded = #{}}}
            end;
        none ->
            {none, Plan}
    end.

%% A long way around robots that will soon have moved on is not worth its ink, and closes much to
%% others: better wait.
detour(_Robot, _Job, #plan{config = #{patience := infinity}}) ->
    false;
detour(Robot, #{path := Path, travel_mm := Driven}, #plan{modes = Modes, config = Config}) ->
    #{patience := {Factor, Mm}} = Config,
    #{Robot := {standing, P, _}} = Modes,
    Straight = case [Q || {Q, up} <- Path] of
        [] -> 0.0;
        Points -> starl_geometry:distance(P, lists:last(Points))
    end,
    Driven > Factor * Straight + Mm.

%% Another will be there before this one, counting what it has to drive until then.
better_placed(_Robot, _Job, #plan{config = #{patience := infinity}}) ->
    false;
better_placed(Robot, #{path := Path, travel_mm := Driven}, #plan{robots = Robots} = Plan) ->
    Driven > ?FAR andalso begin
        Begin = lists:last([Q || {Q, up} <- Path]),
        lists:any(fun(Id) -> rival(Id, Begin, Plan) + ?LEAD < Driven end, Robots -- [Robot])
    end.

rival(Id, Target, #plan{unsafe = Unsafe}) ->
    Held = starl_dpp_unsafe:held(Id, Unsafe),
    {_, End} = lists:last(Held),
    lists:sum([starl_geometry:length(S) || S <- Held]) + starl_geometry:distance(End, Target).

send(Robot, Path, #plan{modes = Modes} = Plan) ->
    #{Robot := {standing, P, _}} = Modes,
    assign(Robot, P, Path, Plan).

%%% Internals: getting out of the way

park(Robot, #plan{spots = Spots, robots = Robots} = Plan) ->
    %% Spots whose owner is away, the own one included.
    Free = [{maps:get(Id, Spots), Id} || Id <- Robots, Id =:= Robot orelse not parked(Id, Plan)],
    case starl_dpp_yield:park([V || {V, _} <- Free], view(Robot, Plan)) of
        {ok, V, Path} ->
            {V, Owner} = lists:keyfind(V, 1, Free),
            {{assign, Path}, exchange(Robot, Owner, send(Robot, Path, Plan))};
        none ->
            {none, Plan}
    end.

%% Not twice between two assignments to paint, and never from a parking spot.
step_aside(Robot, Good, #plan{yielded = Yielded} = Plan) ->
    case is_map_key(Robot, Yielded) orelse parked(Robot, Plan)
         orelse starl_dpp_yield:aside(Good, view(Robot, Plan)) of
        {ok, _, Path} ->
            {{assign, Path}, (send(Robot, Path, Plan))#plan{yielded = Yielded#{Robot => true}}};
        _ ->
            {none, Plan}
    end.

grant(Waiting, Plan) ->
    moves(Waiting, fun(Id, Acc) -> find_work(Id, false, Acc) end, Plan).

%% All that can leave, each in sight of the ways of those before.
moves(Robots, Send, Plan0) ->
    Step = fun(Id, {Moves, Acc0}) ->
        case Send(Id, Acc0) of
            {{assign, Path}, Acc1} -> {[{Id, Path} | Moves], Acc1};
            {none, Acc1} -> {Moves, Acc1}
        end
    end,
    {Moves, Plan1} = lists:foldl(Step, {[], Plan0}, Robots),
    {lists:reverse(Moves), Plan1}.

%% The robot that is nearest to a free edge if those that wait were not in the way.
favourite(Waiting, Plan) ->
    Wishes = [{Cost, Id, Wish} || Id <- Waiting,
                                  {ok, #{cost_mm := Cost} = Wish}
                                      <- [starl_dpp_yield:wish(Waiting, view(Id, Plan))]],
    case lists:sort(Wishes) of
        [{_, _, Wish} | _] -> Wish;
        [] -> none
    end.

unblock(none, Waiting, Plan) ->
    first_out(outermost(Waiting, Plan), Plan);
unblock(#{robot := Robot, way := Way, blockers := Blockers}, Waiting, Plan0) ->
    case moves(outermost(Blockers, Plan0), fun(Id, Acc) -> leave(Id, Way, Acc) end, Plan0) of
        {[], Plan1} -> first_out(outermost(Waiting -- [Robot], Plan1) ++ [Robot], Plan1);
        {Moves, Plan1} -> {Moves, Plan1}
    end.

%% Aside, else to a spot.
leave(Robot, Way, #plan{graph = Graph} = Plan0) ->
    Good = fun(V) ->
        P = starl_dpp_graph:point(V, Graph),
        not starl_dpp_yield:in_way([{P, P}], Way, Graph)
    end,
    case step_aside(Robot, Good, Plan0) of
        {none, Plan1} -> retreat(Robot, Plan1);
        Assigned -> Assigned
    end.

%% The first of these robots that can park does.
first_out([], Plan) ->
    {[], Plan};
first_out([Robot | Rest], Plan0) ->
    case retreat(Robot, Plan0) of
        {{assign, Path}, Plan1} -> {[{Robot, Path}], Plan1};
        {none, Plan1} -> first_out(Rest, Plan1)
    end.

outermost(Robots, #plan{modes = Modes, graph = Graph}) ->
    starl_dpp_yield:outermost([{Id, P} || Id <- Robots, {standing, P, _} <- [maps:get(Id, Modes)]],
                              Graph).
