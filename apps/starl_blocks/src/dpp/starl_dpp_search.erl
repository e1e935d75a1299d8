%% @doc A* search from where a robot stands over the edges that are safe for it.
%%
%% Costs are millimetres driven; a turn costs as much as the distance that could have been driven
%% in the same time. The turn is charged at the vertex, by the heading of the cheapest way into it,
%% which is not always the cheapest way on, but keeps one label per vertex.
%%
%% What is looked for lies in some boxes. The way from a vertex to the nearest of them is at least
%% the straight line, and vertices come in the order of their cost and that line. It is never more
%% than the way along an edge and the line from there, so labels and the order of the vertices in
%% the boxes are those of Dijkstra's search; what lies the other way is not looked at.
-module(starl_dpp_search).

-export([run/5, trail/2, turn/3]).
-export_type([space/0, start/0, labels/0, visit/1, within/0]).

-compile({inline, [turn/3, blocked/2]}).

-type vertex() :: starl_dpp_graph:vertex().
-type heading() :: float() | none.
%% `none': any heading, the first turn is free.
-type space() :: #{
    graph := starl_dpp_graph:t(),
    masks := starl_dpp_unsafe:masks(),
    own := integer(),
    turn_mm := float()
}.
%% Where to search: the graph, who blocks what, the mask of robots that do not block (at least
%% the searching robot itself) and the price of a turn in mm per radian.
-type start() :: {CostMm :: float(), vertex(), heading()}.
-type labels() :: #{
    vertex() => {CostMm :: float(), From :: vertex() | start, heading(), AheadMm :: float()}
}.
%% The cheapest way found into each vertex, final for those that were visited; and the least that
%% is left to drive from there.
-type within() :: float() | infinity.
%% A cost in mm.
-type visit(Acc) ::
    fun((vertex(), CostMm :: float(), heading(), Acc) -> {continue, within(), Acc} | {stop, Acc}).
%% Called once per vertex. What costs more than it says need not be visited.

%% What stays the same in a search.
-record(terms, {
    graph :: starl_dpp_graph:t(),
    masks :: starl_dpp_unsafe:masks(),
    others :: integer(),
    turn_mm :: float(),
    goals :: [starl_geometry:box()]
}).

%% The straight line less a hair: rounding must not bring a vertex out before those on its way.
-define(HAIR, 0.999999999).

%% @doc Visits vertices until none is left or the visitor stops. Those in the boxes come in the
%% order of their cost, and between them what may lie on the way to one; without boxes all vertices
%% do.
-spec run([start()], space(), Goals :: [starl_geometry:box()], visit(Acc), Acc) ->
    {labels(), Acc}.
run(Starts, #{graph := Graph, masks := Masks} = Space, Goals, Visit, Acc) ->
    #{own := Own, turn_mm := TurnMm} = Space,
    Terms = #terms{
        graph = Graph, masks = Masks, others = bnot Own, turn_mm = TurnMm, goals = Goals
    },
    Enter = fun({Cost, V, Heading}, {Heap, Labels}) ->
        case Labels of
            #{V := {Known, _, _, _}} when Known =< Cost -> {Heap, Labels};
            #{} -> reach(Cost, V, start, Heading, ahead(V, Terms), Heap, Labels)
        end
    end,
    {Heap, Labels} = lists:foldl(Enter, {starl_dpp_heap:new(), #{}}, Starts),
    settle(starl_dpp_heap:pop(Heap), Labels, Terms, Visit, Acc).

%% @doc The vertices from the start to a visited vertex.
-spec trail(vertex(), labels()) -> [vertex(), ...].
trail(V, Labels) -> trail(V, Labels, []).

%% @doc The cost of turning from one heading to another.
-spec turn(heading(), heading(), MmPerRadian :: float()) -> float().
turn(none, _To, _Mm) -> 0.0;
turn(_From, none, _Mm) -> 0.0;
turn(From, To, Mm) when is_float(From), is_float(To), is_float(Mm) ->
    case To - From of
        D when D > 3.141592653589793 -> Mm * abs(6.283185307179586 - D);
        D when D < -3.141592653589793 -> Mm * abs(6.283185307179586 + D);
        D when D < 0.0 -> Mm * -D;
        D -> Mm * D
    end.

%%% Internals

%% A vertex is in the heap once for each way into it that was the cheapest so far; its label is of
%% the cheapest, so all others come out later, with a higher rank.
settle(empty, Labels, _Terms, _Visit, Acc) ->
    {Labels, Acc};
settle({Rank, V, Heap}, Labels, Terms, Visit, Acc0) ->
    case Labels of
        #{V := {Cost, _, _, Ahead}} when Cost + Ahead < Rank ->
            settle(starl_dpp_heap:pop(Heap), Labels, Terms, Visit, Acc0);
        #{V := {Cost, _, Heading, _}} ->
            case Visit(V, Cost, Heading, Acc0) of
                {stop, Acc} ->
                    {Labels, Acc};
                {continue, Within, Acc} ->
                    Steps = starl_dpp_graph:adjacent(V, Terms#terms.graph),
                    {Open, Next} = relax(Steps, V, Cost, Heading, Within, Terms, Heap, Labels),
                    settle(starl_dpp_heap:pop(Open), Next, Terms, Visit, Acc)
            end
    end.

%% The label is asked first: mostly it is the cheaper one.
relax([], _V, _Cost, _In, _Within, _Terms, Heap, Labels) ->
    {Heap, Labels};
relax([{E, W, Length, Out} | Steps], V, Cost, In, Within, Terms, Heap0, Labels0) when
    is_float(Cost), is_float(Length)
->
    {Known, Least} =
        case Labels0 of
            #{W := {Cheapest, _, _, Line}} -> {Cheapest, Line};
            #{} -> {infinity, unknown}
        end,
    case Known =< Cost + Length of
        true ->
            relax(Steps, V, Cost, In, Within, Terms, Heap0, Labels0);
        false ->
            Next = Cost + Length + turn(In, Out, Terms#terms.turn_mm),
            case Known =< Next orelse Next > Within orelse blocked(E, Terms)
                 orelse left(Least, W, Terms) of
                true ->
                    relax(Steps, V, Cost, In, Within, Terms, Heap0, Labels0);
                Ahead when Next + Ahead > Within ->
                    relax(Steps, V, Cost, In, Within, Terms, Heap0, Labels0);
                Ahead ->
                    {Heap, Labels} = reach(Next, W, V, Out, Ahead, Heap0, Labels0),
                    relax(Steps, V, Cost, In, Within, Terms, Heap, Labels)
            end
    end.

blocked(E, #terms{masks = Masks, others = Others}) ->
    case Masks of
        #{E := Mask} -> Mask band Others =/= 0;
        #{} -> false
    end.

left(unknown, W, Terms) -> ahead(W, Terms);
left(Ahead, _W, _Terms) -> Ahead.

%% The least that is left to drive from a vertex, for any of the goals.
ahead(_V, #terms{goals = []}) ->
    0.0;
ahead(V, #terms{goals = [Goal | Goals], graph = Graph}) ->
    {X, Y} = starl_dpp_graph:point(V, Graph),
    ?HAIR * math:sqrt(nearest(Goals, X, Y, off(Goal, X, Y))).

nearest([], _X, _Y, Least) -> Least;
nearest([Goal | Goals], X, Y, Least) -> nearest(Goals, X, Y, min(Least, off(Goal, X, Y))).

%% The square of the distance of a point from a box.
off({X0, Y0, X1, Y1}, X, Y) -> square(beside(X0, X1, X)) + square(beside(Y0, Y1, Y)).

beside(Low, _High, X) when X < Low -> Low - X;
beside(_Low, High, X) when X > High -> X - High;
beside(_Low, _High, _X) -> 0.0.

square(D) -> D * D.

%% A vertex can be reached at this cost, the least so far.
reach(Cost, V, From, Heading, Ahead, Heap, Labels) ->
    {starl_dpp_heap:push(Cost + Ahead, V, Heap), Labels#{V => {Cost, From, Heading, Ahead}}}.

trail(start, _Labels, Trail) ->
    Trail;
trail(V, Labels, Trail) ->
    {_, From, _, _} = maps:get(V, Labels),
    trail(From, Labels, [V | Trail]).
