%% @doc Dijkstra's search from where a robot stands over the edges that are safe for it.
%%
%% Costs are millimetres driven; a turn costs as much as the distance that could have been driven
%% in the same time. The turn is charged at the vertex, by the heading of the cheapest way into it,
%% which is not always the cheapest way on, but keeps one label per vertex.
-module(starl_dpp_search).

-export([run/4, start/1, onwards/5, trail/2, turn/3]).
-export_type([space/0, start/0, labels/0, visit/1, front/0, within/0]).

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
-type labels() :: #{vertex() => {CostMm :: float(), From :: vertex() | start, heading()}}.
%% The cheapest way found into each vertex; final for those that were visited.
-type within() :: float() | infinity.
%% A cost in mm.
-type visit(Acc) ::
    fun((vertex(), CostMm :: float(), heading(), Acc) -> {continue, within(), Acc} | {stop, Acc}).
%% Called once per vertex, cheapest first. What costs more than it says need not be visited.

-record(front, {
    heap :: starl_dpp_heap:t(float(), vertex()),
    labels :: labels()
}).
-opaque front() :: #front{}.
%% How far a search has come.

%% What stays the same in a search.
-record(terms, {
    graph :: starl_dpp_graph:t(),
    masks :: starl_dpp_unsafe:masks(),
    others :: integer(),
    turn_mm :: float()
}).

%% @doc Visits vertices in the order of their cost until none is left or the visitor stops.
-spec run([start()], space(), visit(Acc), Acc) -> {labels(), Acc}.
run(Starts, Space, Visit, Acc0) ->
    {stopped, _Cost, Labels, Acc} = onwards(start(Starts), infinity, Space, Visit, Acc0),
    {Labels, Acc}.

%% @doc A search that has visited nothing yet.
-spec start([start()]) -> front().
start(Starts) ->
    Reach = fun({Cost, V, Heading}, {Heap, Labels}) ->
        case Labels of
            #{V := {Known, _, _}} when Known =< Cost -> {Heap, Labels};
            #{} -> reach(Cost, V, start, Heading, Heap, Labels)
        end
    end,
    {Heap, Labels} = lists:foldl(Reach, {starl_dpp_heap:new(), #{}}, Starts),
    #front{heap = Heap, labels = Labels}.

%% @doc Visits vertices that cost less than `Until'. The answer is where to go on from, or the
%% labels and the cost at which it ended: that of the vertex where the visitor stopped, `infinity'
%% when none was left.
-spec onwards(front(), Until :: within(), space(), visit(Acc), Acc) ->
    {paused, front(), Acc} | {stopped, within(), labels(), Acc}.
onwards(#front{heap = Heap} = Front, Until, Space, Visit, Acc) ->
    #{graph := Graph, masks := Masks, own := Own, turn_mm := TurnMm} = Space,
    Terms = #terms{graph = Graph, masks = Masks, others = bnot Own, turn_mm = TurnMm},
    settle(starl_dpp_heap:pop(Heap), Front, Until, Terms, Visit, Acc).

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
%% the cheapest, so all others come out later, with a higher cost.
settle(empty, #front{labels = Labels}, _Until, _Terms, _Visit, Acc) ->
    {stopped, infinity, Labels, Acc};
settle({Cost, _, _}, Front, Until, _Terms, _Visit, Acc) when Cost >= Until ->
    {paused, Front, Acc};
settle({Cost, V, Heap}, #front{labels = Labels} = Front, Until, Terms, Visit, Acc0) ->
    case Labels of
        #{V := {Less, _, _}} when Less < Cost ->
            Next = Front#front{heap = Heap},
            settle(starl_dpp_heap:pop(Heap), Next, Until, Terms, Visit, Acc0);
        #{V := {_, _, Heading}} ->
            case Visit(V, Cost, Heading, Acc0) of
                {stop, Acc} ->
                    {stopped, Cost, Labels, Acc};
                {continue, Within, Acc} ->
                    Steps = starl_dpp_graph:adjacent(V, Terms#terms.graph),
                    Next = relax(Steps, V, Cost, Heading, Within, Terms, Heap, Labels),
                    Open = starl_dpp_heap:pop(Next#front.heap),
                    settle(Open, Next, Until, Terms, Visit, Acc)
            end
    end.

%% The label is asked first: mostly it is the cheaper one.
relax([], _V, _Cost, _In, _Within, _Terms, Heap, Labels) ->
    #front{heap = Heap, labels = Labels};
relax([{E, W, Length, Out} | Steps], V, Cost, In, Within, Terms, Heap0, Labels0) when
    is_float(Cost), is_float(Length)
->
    Known =
        case Labels0 of
            #{W := {Least, _, _}} -> Least;
            #{} -> infinity
        end,
    case Known =< Cost + Length of
        true ->
            relax(Steps, V, Cost, In, Within, Terms, Heap0, Labels0);
        false ->
            Next = Cost + Length + turn(In, Out, Terms#terms.turn_mm),
            case Known =< Next orelse Next > Within orelse blocked(E, Terms) of
                true ->
                    relax(Steps, V, Cost, In, Within, Terms, Heap0, Labels0);
                false ->
                    {Heap, Labels} = reach(Next, W, V, Out, Heap0, Labels0),
                    relax(Steps, V, Cost, In, Within, Terms, Heap, Labels)
            end
    end.

blocked(E, #terms{masks = Masks, others = Others}) ->
    case Masks of
        #{E := Mask} -> Mask band Others =/= 0;
        #{} -> false
    end.

%% A vertex can be reached at this cost, the least so far.
reach(Cost, V, From, Heading, Heap, Labels) ->
    {starl_dpp_heap:push(Cost, V, Heap), Labels#{V => {Cost, From, Heading}}}.

trail(start, _Labels, Trail) ->
    Trail;
trail(V, Labels, Trail) ->
    {_, From, _} = maps:get(V, Labels),
    trail(From, Labels, [V | Trail]).
