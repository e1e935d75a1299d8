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
%% The cheapest way found into each vertex; final for those that were visited.
-type visit(Acc) ::
    fun((vertex(), CostMm :: float(), heading(), Acc) -> {continue | stop, Acc}).
%% Called once per vertex, cheapest first.

%% @doc Visits vertices in the order of their cost until none is left or the visitor stops.
-spec run([start()], space(), visit(Acc), Acc) -> {labels(), Acc}.
run(Starts, Space, Visit, Acc) ->
    Reach = fun({Cost, V, Heading}, {Heap, Labels}) ->
        reach(Cost, V, start, Heading, Heap, Labels)
    end,
    {Heap, Labels} = lists:foldl(Reach, {starl_dpp_heap:new(), #{}}, Starts),
    settle(starl_dpp_heap:pop(Heap), Space, Visit, Labels, Acc).

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

%% A vertex is in the heap once for each way into it that was the cheapest so far; its label is of
%% the cheapest, so all others come out later, with a higher cost.
settle(empty, _Space, _Visit, Labels, Acc) ->
    {Labels, Acc};
settle({Cost, V, Heap}, Space, Visit, Labels, Acc0) ->
    case maps:get(V, Labels) of
        {Less, _, _} when Less < Cost ->
            settle(starl_dpp_heap:pop(Heap), Space, Visit, Labels, Acc0);
        {_, _, Heading} ->
            case Visit(V, Cost, Heading, Acc0) of
                {stop, Acc} -> {Labels, Acc};
                {continue, Acc} -> go_on({Cost, V, Heading}, Heap, Space, Visit, Labels, Acc)
            end
    end.

go_on({_, V, _} = At, Heap0, #{graph := Graph} = Space, Visit, Labels0, Acc) ->
    {Heap, Labels} = relax(starl_dpp_graph:adjacent(V, Graph), At, Space, Heap0, Labels0),
    settle(starl_dpp_heap:pop(Heap), Space, Visit, Labels, Acc).

relax([], _At, _Space, Heap, Labels) ->
    {Heap, Labels};
relax([{E, W, Length, Out} | Steps], {Cost, V, In} = At, Space, Heap0, Labels0) ->
    case Labels0 of
        #{W := {Known, _, _}} when Known =< Cost + Length ->
            relax(Steps, At, Space, Heap0, Labels0);
        #{} ->
            Next = Cost + Length + turn(In, Out, maps:get(turn_mm, Space)),
            {Heap, Labels} = step(E, Next, W, V, Out, Space, Heap0, Labels0),
            relax(Steps, At, Space, Heap, Labels)
    end.

step(E, Cost, V, From, Heading, #{masks := Masks, own := Own}, Heap, Labels) ->
    case Masks of
        #{E := Mask} when Mask band (bnot Own) =/= 0 -> {Heap, Labels};
        #{} -> reach(Cost, V, From, Heading, Heap, Labels)
    end.

%% A vertex can be reached at this cost.
reach(Cost, V, From, Heading, Heap, Labels) ->
    case Labels of
        #{V := {Known, _, _}} when Known =< Cost -> {Heap, Labels};
        #{} -> {starl_dpp_heap:push(Cost, V, Heap), Labels#{V => {Cost, From, Heading}}}
    end.

trail(start, _Labels, Trail) ->
    Trail;
trail(V, Labels, Trail) ->
    {_, From, _} = maps:get(V, Labels),
    trail(From, Labels, [V | Trail]).
