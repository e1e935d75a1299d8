%% @doc Dijkstra's search from where a robot stands over the edges that are safe for it.
%%
%% Costs are millimetres driven; a turn costs as much as the distance that could have been driven
%% in the same time. The turn is charged at the vertex, by the heading of the cheapest way into it,
%% which is not always the cheapest way on, but keeps one label per vertex.
-module(starl_dpp_search).

-export([run/4, trail/2, turn/3]).
-export_type([space/0, start/0, labels/0, visit/1]).

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
-type visit(Acc) ::
    fun((vertex(), CostMm :: float(), heading(), Acc) -> {continue | stop, Acc}).
%% Called once per vertex, cheapest first.

%% @doc Visits vertices in the order of their cost until none is left or the visitor stops.
-spec run([start()], space(), visit(Acc), Acc) -> {labels(), Acc}.
run(Starts, Space, Visit, Acc) ->
    Push = fun({Cost, V, Heading}, Heap) ->
        starl_dpp_heap:push(Cost, {V, start, Heading}, Heap)
    end,
    Heap = lists:foldl(Push, starl_dpp_heap:new(), Starts),
    settle(starl_dpp_heap:pop(Heap), Space, Visit, #{}, Acc).

%% @doc The vertices from the start to a visited vertex.
-spec trail(vertex(), labels()) -> [vertex(), ...].
trail(V, Labels) -> trail(V, Labels, []).

%% @doc The cost of turning from one heading to another.
-spec turn(heading(), heading(), MmPerRadian :: float()) -> float().
turn(none, _To, _Mm) -> 0.0;
turn(_From, none, _Mm) -> 0.0;
turn(From, To, Mm) when is_float(From), is_float(To), is_float(Mm) ->
    D = abs(To - From),
    case D > 3.141592653589793 of
        true -> Mm * abs(6.283185307179586 - D);
        false -> Mm * D
    end.

%%% Internals

settle(empty, _Space, _Visit, Labels, Acc) ->
    {Labels, Acc};
settle({_Cost, {V, _, _}, Heap}, Space, Visit, Labels, Acc) when is_map_key(V, Labels) ->
    settle(starl_dpp_heap:pop(Heap), Space, Visit, Labels, Acc);
settle({Cost, {V, From, Heading}, Heap0}, Space, Visit, Labels0, Acc0) ->
    Labels1 = Labels0#{V => {Cost, From, Heading}},
    case Visit(V, Cost, Heading, Acc0) of
        {stop, Acc1} ->
            {Labels1, Acc1};
        {continue, Acc1} ->
            #{graph := Graph} = Space,
            Steps = starl_dpp_graph:adjacent(V, Graph),
            Heap1 = relax(Steps, {Cost, V, Heading}, Space, Labels1, Heap0),
            settle(starl_dpp_heap:pop(Heap1), Space, Visit, Labels1, Acc1)
    end.

relax([], _At, _Space, _Labels, Heap) ->
    Heap;
relax([{_, W, _, _} | Steps], At, Space, Labels, Heap) when is_map_key(W, Labels) ->
    relax(Steps, At, Space, Labels, Heap);
relax([{E, W, Length, Out} | Steps], {Cost, V, In} = At, Space, Labels, Heap) ->
    #{masks := Masks, own := Own, turn_mm := Mm} = Space,
    case Masks of
        #{E := Mask} when Mask band (bnot Own) =/= 0 ->
            relax(Steps, At, Space, Labels, Heap);
        #{} ->
            Next = Cost + Length + turn(In, Out, Mm),
            relax(Steps, At, Space, Labels, starl_dpp_heap:push(Next, {W, V, Out}, Heap))
    end.

trail(start, _Labels, Trail) ->
    Trail;
trail(V, Labels, Trail) ->
    {_, From, _} = maps:get(V, Labels),
    trail(From, Labels, [V | Trail]).
