%% @doc Dijkstra's search from a robot's place, over the edges that are safe for the robot.
%%
%% Costs are millimetres driven; a turn costs as much as the distance that the robot could have
%% driven in the same time. The turn is charged at the vertex, by the heading of the cheapest path
%% into it. That is not always the cheapest path on, but it needs only one label per vertex.
-module(starl_dpp_search).

-export([run/4, trail/2, turn/3]).
-export_type([space/0, start/0, labels/0, visit/1, within/0]).

-compile({inline, [turn/3]}).

-type vertex() :: starl_dpp_graph:vertex().
-type heading() :: float() | none.
%% `none': any heading, the first turn is free.
-type space() :: #{
    graph := starl_dpp_graph:t(),
    masks := starl_dpp_unsafe:masks(),
    own := integer(),
    turn_mm := float()
}.
%% The search space: the graph, the robots that block each edge, the mask of robots that do not
%% count (at least the searching robot itself) and the price of a turn in mm per radian.
-type start() :: {CostMm :: float(), vertex(), heading()}.
-type label() :: {CostMm :: float(), From :: vertex() | start, heading()}.
-opaque labels() :: starl_dpp_array:t(label()).
%% The cheapest way found into each vertex; final for those that were visited.
-type within() :: float() | infinity.
%% A cost in mm.
-type visit(Acc) ::
    fun((vertex(), CostMm :: float(), heading(), Acc) -> {continue, within(), Acc} | {stop, Acc}).
%% Called once per vertex, cheapest first. It returns a cost: no vertex above it need be visited.

-type heap() :: starl_dpp_heap:t(float(), vertex()).

%% The constants of a search.
-record(terms, {
    graph :: starl_dpp_graph:t(),
    masks :: starl_dpp_unsafe:masks(),
    others :: integer(),
    turn_mm :: float()
}).

%% More than any way costs. To compare a number with `infinity' takes much longer.
-define(FAR, 1.0e300).

%% @doc Visits vertices in the order of their cost until none is left or the visitor stops.
-spec run([start()], space(), visit(Acc), Acc) -> {labels(), Acc}.
run(Starts, #{graph := Graph, masks := Masks, own := Own, turn_mm := TurnMm}, Visit, Acc) ->
    Terms = #terms{graph = Graph, masks = Masks, others = bnot Own, turn_mm = TurnMm},
    Reach = fun({Cost, V, Heading}, {Heap, Labels}) ->
        case starl_dpp_array:get(V, Labels) of
            {Known, _, _} when Known =< Cost -> {Heap, Labels};
            {_, _, _} -> reach(Cost, V, start, Heading, Heap, Labels)
        end
    end,
    Unknown = starl_dpp_array:new(starl_dpp_graph:vertices(Graph), {?FAR, start, none}),
    {Heap, Labels} = lists:foldl(Reach, {starl_dpp_heap:new(), Unknown}, Starts),
    settle(starl_dpp_heap:pop(Heap), Labels, Terms, Visit, Acc).

%% @doc The vertices from the start to a visited vertex.
-spec trail(vertex(), labels()) -> [vertex(), ...].
trail(V, Labels) -> trail(V, Labels, []).

%% @doc The cost of turning from one heading to another.
-spec turn(heading(), To :: float(), MmPerRadian :: float()) -> float().
turn(none, _To, _Mm) ->
    0.0;
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
-spec settle(Next, labels(), #terms{}, visit(Acc), Acc) -> {labels(), Acc} when
    Next :: empty | {float(), vertex(), heap()}.
settle(empty, Labels, _Terms, _Visit, Acc) ->
    {Labels, Acc};
settle({Cost, V, Heap}, Labels, Terms, Visit, Acc0) ->
    case starl_dpp_array:get(V, Labels) of
        {Less, _, _} when Less < Cost ->
            settle(starl_dpp_heap:pop(Heap), Labels, Terms, Visit, Acc0);
        {_, _, Heading} ->
            case Visit(V, Cost, Heading, Acc0) of
                {stop, Acc} ->
                    {Labels, Acc};
                {continue, Within, Acc} ->
                    Steps = starl_dpp_graph:adjacent(V, Terms#terms.graph),
                    Most = most(Within),
                    {Open, Next} = relax(Steps, V, Cost, Heading, Most, Terms, Heap, Labels),
                    settle(starl_dpp_heap:pop(Open), Next, Terms, Visit, Acc)
            end
    end.

most(infinity) -> ?FAR;
most(Mm) -> Mm.

%% The label is asked first: mostly it is the cheaper one.
relax([], _V, _Cost, _In, _Most, _Terms, Heap, Labels) ->
    {Heap, Labels};
relax([{E, W, Length, Out} | Steps], V, Cost, In, Most, Terms, Heap0, Labels0) when
    is_float(Cost), is_float(Length)
->
    {Known, _, _} = starl_dpp_array:get(W, Labels0),
    case Known =< Cost + Length of
        true ->
            relax(Steps, V, Cost, In, Most, Terms, Heap0, Labels0);
        false ->
            Next = Cost + Length + turn(In, Out, Terms#terms.turn_mm),
            Worth = Next < Known andalso Next =< Most,
            case Worth andalso starl_dpp_array:get(E, Terms#terms.masks) band Terms#terms.others of
                0 ->
                    {Heap, Labels} = reach(Next, W, V, Out, Heap0, Labels0),
                    relax(Steps, V, Cost, In, Most, Terms, Heap, Labels);
                _ ->
                    relax(Steps, V, Cost, In, Most, Terms, Heap0, Labels0)
            end
    end.

%% A vertex can be reached at this cost, the least so far.
reach(Cost, V, From, Heading, Heap, Labels) ->
    {starl_dpp_heap:push(Cost, V, Heap), starl_dpp_array:put(V, {Cost, From, Heading}, Labels)}.

trail(start, _Labels, Trail) ->
    Trail;
trail(V, Labels, Trail) ->
    {_, From, _} = starl_dpp_array:get(V, Labels),
    trail(From, Labels, [V | Trail]).
