%% The free edges are those that were not taken since they were given last; they are found by
%% number, in any order, and at both of their ends.
-module(starl_dpp_free_tests).
-include_lib("eunit/include/eunit.hrl").

taken_and_given_test_() ->
    [fun() -> taken_and_given(Seed) end || Seed <- lists:seq(1, 5)].

taken_and_given(Seed) ->
    Graph = graph(),
    N = starl_dpp_graph:targets(Graph),
    All = lists:seq(1, N),
    Free = starl_dpp_free:new(Graph),
    agree(All, Free, Graph, {Seed, new}),
    lists:foldl(
        fun(I, Acc) -> change(I, N, Graph, Acc) end,
        {All, Free, rand:seed_s(exsss, Seed)},
        [{Seed, I} || I <- lists:seq(1, 30)]
    ).

change(What, N, Graph, {Known, Free0, Rand0}) ->
    {Edges, Rand1} = draws(5, N, Rand0),
    {X, Rand2} = rand:uniform_s(Rand1),
    {Next, Free} =
        case X < 0.6 of
            true -> {Known -- lists:usort(Edges), starl_dpp_free:take(Edges, Free0)};
            false -> {lists:usort(Edges ++ Known), starl_dpp_free:give(Edges, Free0)}
        end,
    agree(Next, Free, Graph, What),
    {Next, Free, Rand2}.

agree(Known, Free, Graph, What) ->
    ?assertEqual({What, Known}, {What, starl_dpp_free:edges(Free)}),
    ?assertEqual(length(Known), starl_dpp_free:count(Free)),
    Folded = starl_dpp_free:fold_while(fun(E, Acc) -> {continue, [E | Acc]} end, [], Free),
    ?assertEqual(Known, lists:sort(Folded)),
    [
        ?assertEqual(lists:member(E, Known), starl_dpp_free:has(E, Free))
     || E <- lists:seq(1, starl_dpp_graph:targets(Graph))
    ],
    [
        ?assertEqual(
            [
                Step
             || {E, _, _, _} = Step <- starl_dpp_graph:lines(V, Graph), lists:member(E, Known)
            ],
            starl_dpp_free:steps(V, Free)
        )
     || V <- lists:seq(1, starl_dpp_graph:vertices(Graph))
    ].

stops_when_told_test() ->
    Free = starl_dpp_free:new(graph()),
    Two = fun(E, Acc) ->
        {
            case Acc of
                [] -> continue;
                _ -> stop
            end,
            [E | Acc]
        }
    end,
    ?assertMatch([_, _], starl_dpp_free:fold_while(Two, [], Free)).

%% Of its edges only the target edges count as lines, at both ends; the others are ways.
lines_are_the_target_edges_test() ->
    Graph = graph(),
    Targets = lists:seq(1, starl_dpp_graph:targets(Graph)),
    Ends = [{V, E} || E <- Targets, V <- tuple_to_list(starl_dpp_graph:ends(E, Graph))],
    Vertices = lists:seq(1, starl_dpp_graph:vertices(Graph)),
    ?assertEqual(
        lists:sort(Ends),
        lists:sort(
            [{V, E} || V <- Vertices, {E, _, _, _} <- starl_dpp_graph:lines(V, Graph)]
        )
    ),
    Longest = lists:max([starl_dpp_graph:edge_length(E, Graph) || E <- Targets]),
    ?assertEqual(Longest, starl_dpp_graph:longest(Graph)).

%% Also of so many that a map does not keep them in order.
edges_are_sorted_test() ->
    {ok, Plan} = starl_dpp_plan:new(#{
        segments => [{{2000.0, 2000.0}, {7000.0, 2000.0}}],
        edge_length => 50.0,
        world => {9000.0, 9000.0},
        robots => [1],
        tube_radius => 215.0
    }),
    Free = starl_dpp_free:new(starl_dpp_plan:graph(Plan)),
    ?assertEqual(lists:seq(1, 100), starl_dpp_free:edges(Free)).

graph() ->
    Row = fun(Y) -> [{{X, Y}, {X + 700.0, Y + 200.0}} || X <- [2000.0, 2700.0, 3400.0, 5000.0]] end,
    {ok, Plan} = starl_dpp_plan:new(#{
        segments => Row(2500.0) ++ Row(4000.0) ++ [{{2300.0, 2000.0}, {2400.0, 5000.0}}],
        world => {9000.0, 9000.0},
        robots => [1, 2],
        tube_radius => 215.0
    }),
    starl_dpp_plan:graph(Plan).

draws(N, Size, Rand) ->
    lists:mapfoldl(fun(_, R) -> rand:uniform_s(Size, R) end, Rand, lists:seq(1, N)).
