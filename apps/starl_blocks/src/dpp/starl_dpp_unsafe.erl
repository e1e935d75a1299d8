%% @doc The paper's set Unsafe: each robot's reservation, and the edges that it closes to others.
%%
%% A reservation is a list of segments: the robot may be anywhere within the tube radius R of them.
%% A robot that stands holds one segment of length zero. Reservations of different robots must be at
%% least 2R apart, centre line to centre line (the paper's Lemma 7). Each graph edge has a bit mask
%% of the robots whose reservation is less than 2R away. The mask is updated when a reservation
%% changes, so a search reads one integer per edge. Each blocked edge is kept with the last segment
%% that blocks it: driving past that segment frees the edge.
-module(starl_dpp_unsafe).

-export([
    new/2,
    set/3,
    drop/3,
    held/2,
    rest/2,
    all/1,
    unknown/1,
    bit/2,
    masks/1,
    blocks/2,
    others/2,
    close/3,
    open/1,
    clear/2,
    away/3,
    nominal/3
]).
-export_type([t/0, masks/0, obstacle/0]).

-type segment() :: starl_geometry:segment().
-type edge_id() :: starl_dpp_graph:edge_id().
-type masks() :: starl_dpp_array:t(non_neg_integer()).
%% The robots that block each edge, a bit each.
-type obstacle() :: {ClearanceMm :: float(), starl_geometry:box(), [segment()]}.
%% Segments of another robot, their box, and the distance to keep from them.
-type item() :: {segment(), [edge_id()]}.

%% One robot's reservation, and two things derived from it: the obstacles that it is to others, and
%% the distance that the robot has to drive, with the end of its path.
-record(held, {
    items :: [item()],
    obstacles :: [obstacle()],
    rest :: {Mm :: float(), starl_geometry:point()}
}).

-record(unsafe, {
    graph :: starl_dpp_graph:t(),
    bits :: #{starl:robot_id() => pos_integer()},
    held = #{} :: #{starl:robot_id() => #held{}},
    masks :: masks(),
    %% the bit that stands for what is closed, with its edges, and as obstacles
    bit :: pos_integer(),
    closed = [] :: [item()],
    shut = [] :: [obstacle()]
}).
-opaque t() :: #unsafe{}.

-define(CHUNK, 8).
-define(STEPS, 20).
%% Tries to find a place that is far enough from several others.
-define(MARGIN, 1.0e-6).
%% Distances within rounding of 2R count as too near.

%% @doc No reservations yet.
-spec new([starl:robot_id()], starl_dpp_graph:t()) -> t().
new(Robots, Graph) ->
    Bits = lists:zip(Robots, [1 bsl I || I <- lists:seq(0, length(Robots) - 1)]),
    Masks = starl_dpp_array:new(starl_dpp_graph:edges(Graph), 0),
    #unsafe{
        graph = Graph, bits = maps:from_list(Bits), masks = Masks, bit = 1 bsl length(Robots)
    }.

%% @doc Replaces the reservation of a robot.
-spec set(starl:robot_id(), [segment(), ...], t()) -> t().
set(Robot, Segments, #unsafe{masks = Masks, graph = Graph} = Unsafe) ->
    Bit = bit(Robot, Unsafe),
    Freed = free(Bit, items(Robot, Unsafe), Masks),
    {Items, Blocked} = hold(groups(Segments, clearance(Graph)), Bit, Graph, {[], Freed}),
    holds(Robot, Items, Unsafe#unsafe{masks = Blocked}).

%% @doc Gives up the first `N' segments of a reservation; the last one always stays.
-spec drop(starl:robot_id(), N :: non_neg_integer(), t()) -> t().
drop(Robot, N, #unsafe{masks = Masks} = Unsafe) ->
    Items = items(Robot, Unsafe),
    {Passed, Kept} = lists:split(min(N, length(Items) - 1), Items),
    holds(Robot, Kept, Unsafe#unsafe{masks = free(bit(Robot, Unsafe), Passed, Masks)}).

%% @doc The segments of one robot, `[]' when its place is not known.
-spec held(starl:robot_id(), t()) -> [segment()].
held(Robot, Unsafe) -> [S || {S, _} <- items(Robot, Unsafe)].

%% @doc The distance that a robot whose place is known still has to drive, and where its path ends.
-spec rest(starl:robot_id(), t()) -> {Mm :: float(), starl_geometry:point()}.
rest(Robot, #unsafe{held = Held}) ->
    #{Robot := #held{rest = Rest}} = Held,
    Rest.

%% @doc All reservations in the order of the robots.
-spec all(t()) -> [{starl:robot_id(), [segment()]}].
all(#unsafe{held = Held} = Unsafe) -> [{Id, held(Id, Unsafe)} || Id <- lists:sort(maps:keys(Held))].

%% @doc The robots whose place is not known.
-spec unknown(t()) -> [starl:robot_id()].
unknown(#unsafe{bits = Bits, held = Held}) ->
    [Id || Id <- lists:sort(maps:keys(Bits)), not is_map_key(Id, Held)].

%% @doc The bit that stands for a robot.
-spec bit(starl:robot_id(), t()) -> pos_integer().
bit(Robot, #unsafe{bits = Bits}) -> maps:get(Robot, Bits).

%% @doc The robots that block each edge.
-spec masks(t()) -> masks().
masks(#unsafe{masks = Masks}) -> Masks.

%% @doc The edges that a robot blocks.
-spec blocks(starl:robot_id(), t()) -> [edge_id()].
blocks(Robot, Unsafe) -> lists:append([Edges || {_, Edges} <- items(Robot, Unsafe)]).

%% @doc The obstacles of a robot: the segments of others, and the distance to keep from them.
%%
%% Robots that were pushed together (no reservation allows that, but the world may do it) could
%% never drive apart under the full clearance. They must only not come nearer than they are.
-spec others(starl:robot_id(), t()) -> [obstacle()].
others(Robot, #unsafe{held = Held} = Unsafe) ->
    Others = [Obstacles || {Id, #held{obstacles = Obstacles}} <- maps:to_list(Held), Id =/= Robot],
    Shut = [[Obstacle] || Obstacle <- Unsafe#unsafe.shut],
    case items(Robot, Unsafe) of
        [{{P, _}, _} | _] -> lists:append([seen_from(P, Obstacles) || Obstacles <- Shut ++ Others]);
        [] -> lists:append(Shut ++ Others)
    end.

%% @doc Something else is there: all robots keep this distance from these segments.
-spec close([segment(), ...], Mm :: float(), t()) -> t().
close(Segments, Mm, #unsafe{graph = Graph, bit = Bit, masks = Masks, closed = Closed} = Unsafe) ->
    Box = starl_geometry:box(lists:append([[P, Q] || {P, Q} <- Segments])),
    Open = fun(E) -> starl_dpp_array:get(E, Masks) band Bit =:= 0 end,
    Near = starl_dpp_graph:near(Box, {Mm, Open}, Graph),
    {Items, Blocked} = hold_each(Segments, Near, Bit, Mm, Closed, Masks),
    Unsafe#unsafe{
        masks = Blocked, closed = Items, shut = chunks(Mm, Segments) ++ Unsafe#unsafe.shut
    }.

%% @doc It is perhaps gone.
-spec open(t()) -> t().
open(#unsafe{bit = Bit, masks = Masks, closed = Closed} = Unsafe) ->
    Unsafe#unsafe{masks = free(Bit, Closed, Masks), closed = [], shut = []}.

%% @doc Is the segment far enough from all obstacles?
-spec clear(segment(), [obstacle()]) -> boolean().
clear({{AX, AY}, {BX, BY}} = Segment, Obstacles) ->
    clear(Segment, {min(AX, BX), min(AY, BY), max(AX, BX), max(AY, BY)}, Obstacles).

%% @doc The point itself if the robot may stand there, else one near it that is clear of all
%% others' reservations. Only for robots that stand a few mm from a permitted place.
-spec away(starl:robot_id(), starl_geometry:point(), t()) -> starl_geometry:point().
away(Robot, P, #unsafe{graph = Graph} = Unsafe) ->
    Others = lists:append([Held || {Id, Held} <- all(Unsafe), Id =/= Robot]),
    away(?STEPS, P, Others, clearance(Graph)).

%% @doc The point at which a stopped robot counts as standing: the nearest point of its old
%% reservation, if the robot is within the slack of it, for then the tube covers its disk; else the
%% place where it is.
-spec nominal(P, Held :: [segment()], SlackMm :: float()) -> P when P :: starl_geometry:point().
nominal(P, Held, Slack) ->
    Near = [
        {starl_geometry:distance(P, Q), Q}
     || S <- Held, Q <- [starl_geometry:closest_point(P, S)]
    ],
    case lists:sort(Near) of
        [{D, Q} | _] when D =< Slack -> Q;
        _ -> P
    end.

%%% Internals

%% Moves away from the nearest obstacle, as far as needed; that may lead towards another one.
away(0, P, _Others, _Mm) ->
    P;
away(Steps, {X, Y} = P, Others, Mm) ->
    Near = [
        {starl_geometry:distance(P, Q), Q}
     || S <- Others, Q <- [starl_geometry:closest_point(P, S)]
    ],
    case lists:sort(Near) of
        [{D, {QX, QY}} | _] when D < Mm, D > 0.0 ->
            Out = (Mm + ?MARGIN) / D,
            away(Steps - 1, {QX + Out * (X - QX), QY + Out * (Y - QY)}, Others, Mm);
        _ ->
            P
    end.

clearance(Graph) -> 2.0 * starl_dpp_graph:radius(Graph) + ?MARGIN.

%% Segments that follow each other and fit into a box twice as wide as the clearance, from the last
%% to the first: the edges near them are looked up once for all of them.
groups([First | Segments], Mm) ->
    Join = fun(S, [{Box, Group} | Groups]) ->
        case around(Box, S) of
            {X0, Y0, X1, Y1} = Wider when X1 - X0 =< 2.0 * Mm, Y1 - Y0 =< 2.0 * Mm ->
                [{Wider, [S | Group]} | Groups];
            _ ->
                [{starl_geometry:box(S), [S]}, {Box, Group} | Groups]
        end
    end,
    lists:foldl(Join, [{starl_geometry:box(First), [First]}], Segments).

around({X0, Y0, X1, Y1}, {P, Q}) -> starl_geometry:box([{X0, Y0}, {X1, Y1}, P, Q]).

hold([], _Bit, _Graph, Held) ->
    Held;
hold([{Box, Group} | Groups], Bit, Graph, {Items, Masks}) ->
    Open = fun(E) -> starl_dpp_array:get(E, Masks) band Bit =:= 0 end,
    Near = starl_dpp_graph:near(Box, {clearance(Graph), Open}, Graph),
    hold(Groups, Bit, Graph, hold_each(Group, Near, Bit, clearance(Graph), Items, Masks)).

%% An edge blocked by a later segment stays blocked longer, so earlier segments need not block it.
hold_each([], _Near, _Bit, _Mm, Items, Masks) ->
    {Items, Masks};
hold_each([Segment | Group], Near, Bit, Mm, Items, Masks) ->
    {Edges, Rest} = starl_dpp_graph:part(Segment, Mm, Near),
    Next = [{Segment, Edges} | Items],
    hold_each(Group, Rest, Bit, Mm, Next, block(Bit, Edges, Masks)).

block(Bit, Edges, Masks) ->
    Block = fun(E, Acc) -> starl_dpp_array:put(E, starl_dpp_array:get(E, Acc) bor Bit, Acc) end,
    lists:foldl(Block, Masks, Edges).

free(Bit, Items, Masks) ->
    Others = bnot Bit,
    Free = fun(E, Acc) -> starl_dpp_array:put(E, starl_dpp_array:get(E, Acc) band Others, Acc) end,
    lists:foldl(fun({_, Edges}, Acc) -> lists:foldl(Free, Acc, Edges) end, Masks, Items).

items(Robot, #unsafe{held = Held}) ->
    case Held of
        #{Robot := #held{items = Items}} -> Items;
        #{} -> []
    end.

holds(Robot, Items, #unsafe{held = Held, graph = Graph} = Unsafe) ->
    Segments = [S || {S, _} <- Items],
    {_, End} = lists:last(Segments),
    Left = lists:sum([starl_geometry:length(S) || S <- Segments]),
    Unsafe#unsafe{
        held = Held#{
            Robot => #held{
                items = Items, obstacles = chunks(clearance(Graph), Segments), rest = {Left, End}
            }
        }
    }.

%% Mostly the robot is beside all boxes, so it is as far away as it should be.
seen_from(P, [{Full, _, _} | _] = Obstacles) ->
    Inside = lists:any(fun({_, Box, _}) -> starl_geometry:inside(P, Box) end, Obstacles),
    Segments = [S || Inside, {_, _, Chunk} <- Obstacles, S <- Chunk],
    case lists:min([Full | [starl_geometry:point_segment(P, S) || S <- Segments]]) of
        Full -> Obstacles;
        Now -> chunks(Now - ?MARGIN, Segments)
    end.

chunks(_Clearance, []) ->
    [];
chunks(Clearance, Segments) ->
    {Chunk, Rest} = lists:split(min(?CHUNK, length(Segments)), Segments),
    Box = starl_geometry:box(lists:append([[P, Q] || {P, Q} <- Chunk])),
    [{Clearance, starl_geometry:grow(Box, Clearance), Chunk} | chunks(Clearance, Rest)].

clear(_Segment, _Box, []) ->
    true;
clear(Segment, {X0, Y0, X1, Y1} = Box, [{Mm, {CX0, CY0, CX1, CY1}, Chunk} | Rest]) ->
    Far = CX0 > X1 orelse X0 > CX1 orelse CY0 > Y1 orelse Y0 > CY1,
    case Far orelse not lists:any(fun(S) -> starl_geometry:closer(S, Segment, Mm) end, Chunk) of
        true -> clear(Segment, Box, Rest);
        false -> false
    end.
