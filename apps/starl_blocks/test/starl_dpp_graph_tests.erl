%% The graph that is planned on: what it refuses.
-module(starl_dpp_graph_tests).
-include_lib("eunit/include/eunit.hrl").

-define(MOST, 40000).

new(Segments) -> new(Segments, 1.0e6).

new(Segments, EdgeLength) ->
    starl_dpp_graph:new(#{
        segments => Segments,
        world => {12000.0, 12000.0},
        robots => [1],
        tube_radius => 215.0,
        edge_length => EdgeLength,
        seed => 1
    }).

%% Of lines that cross at more places than there may be edges no edge is counted.
too_many_crossings_test_() ->
    [
        {timeout, 60,
            ?_assertEqual({error, {too_many_edges, more, ?MOST}}, new(crossing(118, 339)))},
        {timeout, 60,
            ?_assertMatch(
                {error, {too_many_edges, N, ?MOST}} when N > ?MOST, new(crossing(200, 200))
            )}
    ].

%% So many lines up and across.
crossing(Up, Across) ->
    At = fun(I, N) -> 2000.0 + 7000.0 * I / (N + 1) end,
    [{{At(I, Up), 2000.0}, {At(I, Up), 9000.0}} || I <- lists:seq(1, Up)] ++
        [{{2000.0, At(I, Across)}, {9000.0, At(I, Across)}} || I <- lists:seq(1, Across)].

too_many_pieces_test_() ->
    Line = {{2000.0, 2000.0}, {2000.0, 2000.0 + 0.1 * (?MOST + 1)}},
    {timeout, 60, ?_assertEqual({error, {too_many_edges, ?MOST + 1, ?MOST}}, new([Line], 0.1))}.

%%% What it tells, held against the plain geometry

%% Two lines that meet in a corner, and one by itself.
lines() ->
    Corner = {4000.0, 4000.0},
    [{{3000.0, 4000.0}, Corner}, {Corner, {4000.0, 4700.0}}, {{8000.0, 8000.0}, {8300.0, 8400.0}}].

graph() ->
    {ok, Graph} = new(lines(), 600.0),
    Graph.

ids(Graph) -> lists:seq(1, starl_dpp_graph:edges(Graph)).

%% A line longer than an edge may be is divided evenly.
targets_test() ->
    Graph = graph(),
    ?assertEqual(5, starl_dpp_graph:targets(Graph)),
    Lengths = [round(starl_dpp_graph:edge_length(E, Graph)) || E <- lists:seq(1, 5)],
    ?assertEqual([350, 350, 500, 500, 500], lists:sort(Lengths)),
    ?assertEqual(500.0, starl_dpp_graph:longest(Graph)),
    ?assertEqual(215.0, starl_dpp_graph:radius(Graph)),
    ?assertEqual(2000.0, starl_dpp_graph:depth({5000.0, 10000.0}, Graph)),
    {ok, Empty} = new([]),
    ?assertEqual({0, +0.0}, {starl_dpp_graph:targets(Empty), starl_dpp_graph:longest(Empty)}).

%% Every edge leads out of both of its ends, to the other, as long as it is and straight there; the
%% target edges among them come first.
adjacent_test() ->
    Graph = graph(),
    Point = fun(V) -> starl_dpp_graph:point(V, Graph) end,
    Out = [
        {V, E, W, Mm, Heading}
     || V <- lists:seq(1, starl_dpp_graph:vertices(Graph)),
        {E, W, Mm, Heading} <- starl_dpp_graph:adjacent(V, Graph)
    ],
    ?assertEqual(
        lists:sort(
            lists:append([
                [{E, A, B}, {E, B, A}]
             || E <- ids(Graph), {A, B} <- [starl_dpp_graph:ends(E, Graph)]
            ])
        ),
        lists:sort([{E, V, W} || {V, E, W, _, _} <- Out])
    ),
    [
        begin
            ?assertEqual(starl_geometry:distance(Point(V), Point(W)), Mm),
            ?assertEqual(starl_geometry:heading(Point(V), Point(W)), Heading),
            ?assert(
                lists:member(starl_dpp_graph:segment(E, Graph), [
                    {Point(V), Point(W)}, {Point(W), Point(V)}
                ])
            )
        end
     || {V, E, W, Mm, Heading} <- Out
    ],
    [
        ?assertEqual(
            [S || {E, _, _, _} = S <- starl_dpp_graph:adjacent(V, Graph), E =< 5],
            starl_dpp_graph:lines(V, Graph)
        )
     || V <- lists:seq(1, starl_dpp_graph:vertices(Graph))
    ],
    ?assertEqual(
        starl_dpp_graph:lines(1, Graph), starl_dpp_array:get(1, starl_dpp_graph:lines(Graph))
    ).

%% The edges that are nearer than so much to a line, of those that are wanted.
within_test() ->
    Graph = graph(),
    Wanted = fun(E) -> E rem 3 =/= 0 end,
    [
        ?assertEqual(
            {Line, Mm, [
                E
             || E <- ids(Graph),
                Wanted(E),
                starl_geometry:segment_segment(Line, starl_dpp_graph:segment(E, Graph)) < Mm
            ]},
            {Line, Mm, lists:sort(starl_dpp_graph:within(Line, {Mm, Wanted}, Graph))}
        )
     || Line <- [
            {{3500.0, 4400.0}, {3500.0, 4400.0}},
            {{2000.0, 9000.0}, {9000.0, 2000.0}},
            {{0.0, 500.0}, {0.0, 9000.0}}
        ],
        Mm <- [1.0, 215.0, 400.0, 400.1, 1500.0]
    ].

%% The nearest vertices, nearest first, as many as are asked for.
joints_test() ->
    Graph = graph(),
    All = fun(P) ->
        lists:sort([
            {starl_geometry:distance(P, starl_dpp_graph:point(V, Graph)), V}
         || V <- lists:seq(1, starl_dpp_graph:vertices(Graph))
        ])
    end,
    [
        begin
            Found = starl_dpp_graph:joints(P, K, Graph),
            ?assertEqual(K, length(Found)),
            ?assertEqual(lists:sort(Found), Found),
            ?assertEqual(hd(All(P)), hd(Found)),
            ?assertEqual([], Found -- All(P))
        end
     || P <- [{3990.0, 4010.0}, {6000.0, 6000.0}, {30.0, 11900.0}], K <- [1, 5, 14]
    ],
    Every = starl_dpp_graph:vertices(Graph),
    ?assertEqual(
        All({6000.0, 6000.0}), starl_dpp_graph:joints({6000.0, 6000.0}, Every + 1, Graph)
    ).

%% What can be reached over open edges, the roots included.
reach_test() ->
    Graph = graph(),
    Reached = fun(Roots, Open) ->
        lists:sort(maps:keys(starl_dpp_graph:reach(Roots, Open, Graph)))
    end,
    All = lists:seq(1, starl_dpp_graph:vertices(Graph)),
    ?assertEqual(All, Reached([1], fun(_) -> true end)),
    ?assertEqual([2, 7], Reached([7, 2], fun(_) -> false end)),
    ?assertEqual([], Reached([], fun(_) -> true end)),
    {A, B} = starl_dpp_graph:ends(5, Graph),
    ?assertEqual(lists:sort([A, B]), Reached([A], fun(E) -> E =:= 5 end)),
    Targets = fun(E) -> E =< 5 end,
    Corner = Reached([1], Targets),
    ?assertEqual(5, length(Corner)),
    ?assertEqual([], [V || V <- Corner, lists:member(V, Reached([A], Targets))]).

%% Lines may come as near to the walls as the ring road, and no nearer.
outside_test() ->
    Ring = 3.1 * 215.0,
    Line = fun(X) -> {{X, 5000.0}, {X, 6000.0}} end,
    ?assertMatch({ok, _}, new([Line(Ring)])),
    ?assertMatch({ok, _}, new([Line(12000.0 - Ring)])),
    Area = {Ring + 1.5 * 215.0, Ring + 1.5 * 215.0},
    {error, {outside_area, {X, _}, {X0, Y0, _, _}}} = new([Line(Ring - 1.0)]),
    ?assert(abs(X - (Ring - 1.0)) < 1.0e-6),
    ?assert(starl_geometry:distance(Area, {X0, Y0}) < 1.0e-6),
    ?assertEqual({error, no_robots}, starl_dpp_graph:new(#{robots => []})).
