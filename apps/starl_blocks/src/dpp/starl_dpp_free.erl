%% @doc The set of free edges (the paper's FE): target edges that no robot has painted or been
%% assigned. They are found by number, and by the vertices where a robot could begin or continue a
%% line.
-module(starl_dpp_free).

-export([new/1, take/2, give/2, count/1, has/2, edges/1, steps/2, fold_while/3]).
-export_type([t/0]).

-type edge_id() :: starl_dpp_graph:edge_id().

-record(free, {
    graph :: starl_dpp_graph:t(),
    edges :: #{edge_id() => true},
    %% at each vertex the free ones of its target edges, in their order
    steps :: starl_dpp_array:t([starl_dpp_graph:step()])
}).
-opaque t() :: #free{}.

%% @doc All target edges are free.
-spec new(starl_dpp_graph:t()) -> t().
new(Graph) ->
    Edges = maps:from_list([{E, true} || E <- lists:seq(1, starl_dpp_graph:targets(Graph))]),
    #free{graph = Graph, edges = Edges, steps = starl_dpp_graph:lines(Graph)}.

%% @doc Removes these edges: they are no longer free.
-spec take([edge_id()], t()) -> t().
take(Edges, #free{edges = Free} = All) ->
    update(Edges, All#free{edges = maps:without(Edges, Free)}).

%% @doc These target edges are free.
-spec give([edge_id()], t()) -> t().
give(Edges, #free{edges = Free} = All) ->
    update(Edges, All#free{edges = lists:foldl(fun(E, Acc) -> Acc#{E => true} end, Free, Edges)}).

%% @doc The number of free edges.
-spec count(t()) -> non_neg_integer().
count(#free{edges = Free}) -> map_size(Free).

%% @doc Is the edge free?
-spec has(edge_id(), t()) -> boolean().
has(E, #free{edges = Free}) -> is_map_key(E, Free).

%% @doc All of them, sorted.
-spec edges(t()) -> [edge_id()].
edges(#free{edges = Free}) -> lists:sort(maps:keys(Free)).

%% @doc The free edges out of a vertex.
-spec steps(starl_dpp_graph:vertex(), t()) -> [starl_dpp_graph:step()].
steps(V, #free{steps = Steps}) -> starl_dpp_array:get(V, Steps).

%% @doc Folds over the free edges, in no particular order, until the function says to stop.
-spec fold_while(fun((edge_id(), Acc) -> {continue | stop, Acc}), Acc, t()) -> Acc.
fold_while(Fun, Acc, #free{edges = Free}) -> fold_on(maps:next(maps:iterator(Free)), Fun, Acc).

%%% Internals

fold_on(none, _Fun, Acc) ->
    Acc;
fold_on({E, true, Rest}, Fun, Acc0) ->
    case Fun(E, Acc0) of
        {continue, Acc} -> fold_on(maps:next(Rest), Fun, Acc);
        {stop, Acc} -> Acc
    end.

%% Looks at the ends of the edges anew.
update(Edges, #free{graph = Graph, edges = Free, steps = Steps0} = All) ->
    Look = fun(V, Steps) ->
        Lines = starl_dpp_graph:lines(V, Graph),
        Left = [Step || {E, _, _, _} = Step <- Lines, is_map_key(E, Free)],
        starl_dpp_array:put(V, Left, Steps)
    end,
    Ends = lists:append([tuple_to_list(starl_dpp_graph:ends(E, Graph)) || E <- Edges]),
    All#free{steps = lists:foldl(Look, Steps0, Ends)}.
