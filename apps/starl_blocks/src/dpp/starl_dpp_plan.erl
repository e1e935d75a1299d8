%% @doc The coordinator's plan of distributed path planning. It holds the free edges, the
%% reservations and the assignments.
%%
%% The picture's lines become target edges, numbered from 1; the plan knows which of them are free
%% (the paper's FE), assigned or painted, and what each robot has reserved (Unsafe). A robot either
%% stands or drives an assignment. Reservations of different robots are never less than 2R apart,
%% so robots that keep to their tubes never meet (Lemma 7).
%%
%% The calls for a robot come in this order. When it has certified that it stands:
%% {@link standing/3}. For work: {@link starl_dpp_assign:request/2}. For each waypoint that it
%% reaches: {@link passed/3}. At the end: {@link standing/3} again. When no robot moves, edges are
%% free and every request got `none', {@link starl_dpp_assign:resolve/2} sends robots aside. Nothing
%% is assigned until every robot's place is known.
%%
%% All functions are pure; equal inputs give equal plans. Lengths are millimetres.
-module(starl_dpp_plan).

-export([new/1, format_error/1]).
-export([standing/3, silent/3, passed/3, send/4, exchange/3, adopt/4, apart/1, mark_painted/2]).
-export([close/3, reopen/1]).
-export([
    counts/1,
    painted_since/2,
    target/2,
    are_targets/2,
    unsafe/1,
    unknown/1,
    spot/2,
    parked/2,
    closes/2,
    blocking/2
]).
-export([
    config/1,
    graph/1,
    free/1,
    masks/2,
    spots/1,
    held/2,
    rest/2,
    stands/2,
    yielded/2,
    others_move/2,
    at_work/1,
    view/2
]).
-export_type([t/0, config/0, path/0, waypoint/0, pen/0, counts/0]).

-type segment() :: starl_geometry:segment().
-type edge_id() :: starl_dpp_graph:edge_id().
-type pen() :: up | {down, edge_id()}.
-type waypoint() :: {starl_geometry:point(), pen()}.
%% A waypoint is the end of a straight line to drive, and tells whether that paints a target edge.
-type path() :: [waypoint(), ...].
-type config() :: starl_dpp_settings:t().
-type counts() :: #{free | assigned | painted | total => non_neg_integer()}.
-type mode() ::
    {standing, Reserved :: starl_geometry:point(), Really :: starl_geometry:point()}
    | {moving, Done :: non_neg_integer(), Left :: [waypoint()]}.

-record(plan, {
    %% without the segments and ways, defaults filled in
    config :: map(),
    graph :: starl_dpp_graph:t(),
    unsafe :: starl_dpp_unsafe:t(),
    free :: starl_dpp_free:t(),
    painted = #{} :: #{edge_id() => true},
    % the painted ones, the latest known first
    latest = [] :: [edge_id()],
    modes = #{} :: #{starl:robot_id() => mode()},
    %% robots that stand and are silent
    silent = #{} :: #{starl:robot_id() => true},
    headings = #{} :: #{starl:robot_id() => float()},
    spots :: starl_dpp_spot_owners:t(),
    yielded = #{} :: #{starl:robot_id() => true}
}).
-opaque t() :: #plan{}.

%%% Building

%% @doc A plan with all edges free and no robot's place known.
-spec new(config()) -> {ok, t()} | {error, starl_dpp_graph:reason()}.
new(Config0) ->
    Config = starl_dpp_settings:complete(Config0),
    Robots = lists:usort(maps:get(robots, Config)),
    Keys = [segments, world, robots, tube_radius, edge_length, ways, seed],
    case starl_dpp_graph:new(maps:with(Keys, Config#{robots => Robots})) of
        {ok, Graph} -> {ok, plan(Robots, Graph, maps:without([segments, ways], Config))};
        {error, _} = Error -> Error
    end.

%% @doc One line that says what is wrong and what to do.
-spec format_error(starl_dpp_graph:reason()) -> iolist().
format_error(Reason) -> starl_dpp_graph:format_error(Reason).

%%% Reports of robots

%% @doc Records a robot's certificate that it stands at some point and no longer holds an
%% assignment. Its edges that are not painted yet become free.
-spec standing(starl:robot_id(), starl_geometry:point(), t()) -> t().
standing(Robot, P, #plan{unsafe = Unsafe, modes = Modes} = Plan0) ->
    #plan{config = #{slack := Slack}} = Plan0,
    Q = starl_dpp_unsafe:nominal(P, starl_dpp_unsafe:held(Robot, Unsafe), Slack),
    Plan1 = release(Robot, Plan0),
    claim_spot(Robot, Q, Plan1#plan{
        silent = maps:remove(Robot, Plan1#plan.silent),
        unsafe = starl_dpp_unsafe:set(Robot, [{Q, Q}], Unsafe),
        modes = Modes#{Robot => {standing, Q, P}}
    }).

%% @doc Enters that a silent robot was seen to stand at this point: it holds no assignment, and gets
%% no work before it is heard again.
-spec silent(starl:robot_id(), starl_geometry:point(), t()) -> t().
silent(Robot, P, Plan) ->
    #plan{silent = Silent} = Stands = standing(Robot, P, Plan),
    Stands#plan{silent = Silent#{Robot => true}}.

%% @doc Enters that the robot has reached the N-th waypoint, counted from 1, of its assignment.
%% Reports that are late or repeated change nothing.
-spec passed(starl:robot_id(), Index :: pos_integer(), t()) -> t().
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

%% @doc Assigns a path to a robot that stands. `work' paints; a way `aside' counts as yielding
%% until some robot gets work again; a `retreat' leads to a parking spot.
-spec send(starl:robot_id(), path(), work | aside | retreat, t()) -> t().
send(Robot, Path, Why, #plan{modes = Modes, yielded = Yielded} = Plan) ->
    #{Robot := {standing, P, _}} = Modes,
    Sent = assign(Robot, P, Path, Plan),
    case Why of
        work -> Sent#plan{yielded = #{}};
        aside -> Sent#plan{yielded = Yielded#{Robot => true}};
        retreat -> Sent
    end.

%% @doc Two robots exchange their parking spots.
-spec exchange(starl:robot_id(), starl:robot_id(), t()) -> t().
exchange(Robot, Owner, #plan{spots = Spots} = Plan) ->
    Plan#plan{spots = starl_dpp_spot_owners:exchange(Robot, Owner, Spots)}.

%% @doc Takes over the rest of an assignment that a robot holds from an earlier coordinator: the
%% robot drives from the point along the path. If the robot has already driven a part, take over the
%% whole path and then report the last waypoint that it has {@link passed/3}.
-spec adopt(starl:robot_id(), From :: starl_geometry:point(), path(), t()) -> t().
adopt(Robot, From, Path, #plan{silent = Silent} = Plan) ->
    assign(Robot, From, Path, release(Robot, Plan#plan{silent = maps:remove(Robot, Silent)})).

%% @doc Moves the reservations of standing robots, within the slack, to 2R from all others: each of
%% two robots may report a place slightly off its reservation.
-spec apart(t()) -> t().
apart(#plan{modes = Modes} = Plan) ->
    Sorted = lists:sort(maps:to_list(Modes)),
    lists:foldl(fun apart/2, Plan, [{Id, Q, P} || {Id, {standing, Q, P}} <- Sorted]).

apart({Robot, Q0, P}, #plan{unsafe = Unsafe, modes = Modes} = Plan) ->
    case starl_dpp_unsafe:away(Robot, Q0, Unsafe) of
        Q0 ->
            Plan;
        Q ->
            Plan#plan{
                unsafe = starl_dpp_unsafe:set(Robot, [{Q, Q}], Unsafe),
                modes = Modes#{Robot := {standing, Q, P}}
            }
    end.

%% @doc Enters edges that are painted already.
-spec mark_painted([edge_id()], t()) -> t().
mark_painted(Edges, Plan) -> paint(Edges, Plan).

%% @doc A robot at a point could not go on towards another point: the obstacle is closed to all.
-spec close(starl_geometry:point(), Towards :: starl_geometry:point(), t()) ->
    {[segment(), ...], t()}.
close(At, Towards, #plan{graph = Graph, unsafe = Unsafe} = Plan) ->
    {Segments, Mm} = starl_dpp_graph:ahead(At, Towards, Graph),
    {Segments, Plan#plan{unsafe = starl_dpp_unsafe:close(Segments, Mm, Unsafe)}}.

%% @doc What was closed is perhaps open.
-spec reopen(t()) -> t().
reopen(#plan{unsafe = Unsafe} = Plan) -> Plan#plan{unsafe = starl_dpp_unsafe:open(Unsafe)}.

%%% Reading the plan

%% @doc The number of target edges in each state.
-spec counts(t()) -> counts().
counts(#plan{graph = Graph, free = Free, painted = Painted}) ->
    Total = starl_dpp_graph:targets(Graph),
    Left = starl_dpp_free:count(Free),
    #{
        free => Left,
        painted => map_size(Painted),
        total => Total,
        assigned => Total - Left - map_size(Painted)
    }.

%% @doc The painted edges without the first `Known' that became known, sorted.
-spec painted_since(Known :: non_neg_integer(), t()) -> [edge_id()].
painted_since(Known, #plan{painted = Painted, latest = Latest}) ->
    lists:sort(lists:sublist(Latest, map_size(Painted) - Known)).

%% @doc A target edge as a segment.
-spec target(edge_id(), t()) -> segment().
target(E, #plan{graph = Graph}) -> starl_dpp_graph:segment(E, Graph).

%% @doc Are these target edges of the picture?
-spec are_targets([pos_integer()], t()) -> boolean().
are_targets(Edges, #plan{graph = Graph}) ->
    Most = starl_dpp_graph:targets(Graph),
    lists:all(fun(E) -> E =< Most end, Edges).

%% @doc All reservations, sorted by robot. A standing robot holds a segment of length zero.
-spec unsafe(t()) -> [{starl:robot_id(), [segment()]}].
unsafe(#plan{unsafe = Unsafe}) -> starl_dpp_unsafe:all(Unsafe).

%% @doc The robots whose place is not known. Until there are none, nothing is assigned.
-spec unknown(t()) -> [starl:robot_id()].
unknown(#plan{unsafe = Unsafe}) -> starl_dpp_unsafe:unknown(Unsafe).

%% @doc The robot's parking spot at present.
-spec spot(starl:robot_id(), t()) -> starl_geometry:point().
spot(Robot, #plan{spots = Spots}) -> starl_dpp_spot_owners:place(Robot, Spots).

%% @doc Does the robot stand on its parking spot?
-spec parked(starl:robot_id(), t()) -> boolean().
parked(Robot, #plan{modes = Modes, spots = Spots}) ->
    case Modes of
        #{Robot := {standing, P, _}} -> starl_dpp_spot_owners:on(P, Robot, Spots);
        #{} -> false
    end.

%% @doc The free edges that the robot's reservation closes to others, sorted.
-spec closes(starl:robot_id(), t()) -> [edge_id()].
closes(Robot, #plan{unsafe = Unsafe, free = Free}) ->
    lists:sort([E || E <- starl_dpp_unsafe:blocks(Robot, Unsafe), starl_dpp_free:has(E, Free)]).

%% @doc The number of these edges.
-spec blocking(starl:robot_id(), t()) -> non_neg_integer().
blocking(Robot, Plan) -> length(closes(Robot, Plan)).

%% @doc The configuration, defaults filled in; without the segments.
-spec config(t()) -> map().
config(#plan{config = Config}) -> Config.

%% @doc The graph that is planned on.
-spec graph(t()) -> starl_dpp_graph:t().
graph(#plan{graph = Graph}) -> Graph.

%% @doc The free edges.
-spec free(t()) -> starl_dpp_free:t().
free(#plan{free = Free}) -> Free.

%% @doc The robots that block each edge, without the given robots.
-spec masks(Without :: [starl:robot_id()], t()) -> fun((edge_id()) -> non_neg_integer()).
masks(Without, #plan{unsafe = Unsafe}) ->
    Masks = starl_dpp_unsafe:masks(Unsafe),
    Bits = [starl_dpp_unsafe:bit(Id, Unsafe) || Id <- Without],
    Kept = bnot lists:foldl(fun erlang:'bor'/2, 0, Bits),
    fun(E) -> starl_dpp_array:get(E, Masks) band Kept end.

%% @doc Each robot's parking spot at present, sorted by robot.
-spec spots(t()) -> [{starl:robot_id(), starl_dpp_graph:vertex()}].
spots(#plan{spots = Spots}) -> starl_dpp_spot_owners:all(Spots).

%% @doc The segments that a robot holds, `[]' when its place is not known.
-spec held(starl:robot_id(), t()) -> [segment()].
held(Robot, #plan{unsafe = Unsafe}) -> starl_dpp_unsafe:held(Robot, Unsafe).

%% @doc The distance that a robot whose place is known still has to drive, and where its path ends.
-spec rest(starl:robot_id(), t()) -> {Mm :: float(), starl_geometry:point()}.
rest(Robot, #plan{unsafe = Unsafe}) -> starl_dpp_unsafe:rest(Robot, Unsafe).

%% @doc The place of a standing robot: the point reserved for it, and the point where it was seen.
-spec stands(starl:robot_id(), t()) ->
    {Reserved :: starl_geometry:point(), Really :: starl_geometry:point()} | false.
stands(Robot, #plan{modes = Modes}) ->
    case Modes of
        #{Robot := {standing, P, Really}} -> {P, Really};
        #{} -> false
    end.

%% @doc Has the robot moved aside since the last assignment to paint?
-spec yielded(starl:robot_id(), t()) -> boolean().
yielded(Robot, #plan{yielded = Yielded}) -> is_map_key(Robot, Yielded).

%% @doc Does another robot move?
-spec others_move(starl:robot_id(), t()) -> boolean().
others_move(Robot, #plan{modes = Modes}) ->
    [] =/= [Id || {Id, {moving, _, [_ | _]}} <- maps:to_list(Modes), Id =/= Robot].

%% @doc The robots that are not silent, sorted.
-spec at_work(t()) -> [starl:robot_id()].
at_work(#plan{silent = Silent} = Plan) ->
    [Id || {Id, _} <- spots(Plan), not is_map_key(Id, Silent)].

%% @doc The plan as a robot that stands sees it.
-spec view(starl:robot_id(), t()) -> starl_dpp_route:view().
view(Robot, #plan{modes = Modes, graph = Graph, unsafe = Unsafe, free = Free} = Plan) ->
    #plan{config = #{turn_mm := TurnMm, leg := Leg}, headings = Headings} = Plan,
    #{Robot := {standing, P, _}} = Modes,
    #{
        robot => Robot,
        at => P,
        heading => maps:get(Robot, Headings, none),
        graph => Graph,
        unsafe => Unsafe,
        free => Free,
        turn_mm => TurnMm,
        leg => Leg
    }.

%%% Internals: state

plan(Robots, Graph, Config) ->
    #plan{
        config = Config,
        graph = Graph,
        unsafe = starl_dpp_unsafe:new(Robots, Graph),
        free = starl_dpp_free:new(Graph),
        spots = starl_dpp_spot_owners:new(Robots, Graph)
    }.

pens(Items) -> [E || {_, {down, E}} <- Items].

%% Edges that are assigned and not painted become free.
release(Robot, #plan{modes = Modes, free = Free, painted = Painted} = Plan) ->
    case Modes of
        #{Robot := {moving, _, Left}} ->
            Back = [E || E <- pens(Left), not is_map_key(E, Painted)],
            Heading = heading_after(Robot, 1, Plan),
            Plan#plan{
                free = starl_dpp_free:give(Back, Free),
                headings = maps:merge(Plan#plan.headings, Heading),
                modes = maps:remove(Robot, Modes)
            };
        #{} ->
            Plan
    end.

paint(Edges, #plan{free = Free, painted = Painted, latest = Latest} = Plan) ->
    New = [E || E <- lists:usort(Edges), not is_map_key(E, Painted)],
    Plan#plan{
        free = starl_dpp_free:take(New, Free),
        painted = lists:foldl(fun(E, Acc) -> Acc#{E => true} end, Painted, New),
        latest = New ++ Latest
    }.

%% The heading along the N-th segment that the robot still holds, if that segment has a heading.
heading_after(Robot, N, #plan{unsafe = Unsafe}) ->
    Held = starl_dpp_unsafe:held(Robot, Unsafe),
    case lists:nth(min(N, length(Held)), Held) of
        {P, Q} when P == Q -> #{};
        {P, Q} -> #{Robot => starl_geometry:heading(P, Q)}
    end.

assign(Robot, From, Path, #plan{} = Plan) ->
    #plan{unsafe = Unsafe, free = Free, modes = Modes, painted = Painted} = Plan,
    Points = [From | [P || {P, _} <- Path]],
    Segments = lists:zip(lists:droplast(Points), tl(Points)),
    New = [E || E <- pens(Path), not is_map_key(E, Painted)],
    Plan#plan{
        unsafe = starl_dpp_unsafe:set(Robot, Segments, Unsafe),
        free = starl_dpp_free:take(New, Free),
        modes = Modes#{Robot => {moving, 0, Path}}
    }.

%% A robot that stands on the spot of another one that is away takes the spot over.
claim_spot(Robot, P, #plan{spots = Spots} = Plan) ->
    Here = [
        Id
     || {Id, _} <- spots(Plan),
        Id =/= Robot,
        starl_dpp_spot_owners:on(P, Id, Spots),
        not parked(Id, Plan)
    ],
    case Here of
        [] -> Plan;
        [Owner | _] -> exchange(Robot, Owner, Plan)
    end.
