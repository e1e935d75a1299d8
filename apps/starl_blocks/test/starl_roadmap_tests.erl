-module(starl_roadmap_tests).
-include_lib("eunit/include/eunit.hrl").

-define(R, 215.0).

layout(N) ->
    {ok, Layout} = starl_roadmap:layout({12000.0, 12000.0}, N, ?R),
    Layout.

%% A parked robot is in nobody's way: spots are more than 2R from each other, from the ring, from
%% the area, from the spurs of others, and the disks on them are on the floor.
parked_is_out_of_the_way_test_() ->
    [
        {lists:concat([N, " robots"]), fun() -> out_of_the_way(N) end}
     || N <- [1, 2, 3, 4, 5, 8, 16, 40, 88]
    ].

out_of_the_way(N) ->
    #{spots := Spots, ring := Ring, feet := Feet, area := Area} = layout(N),
    Ids = lists:seq(1, N),
    ?assertEqual(Ids, lists:sort(maps:keys(Spots))),
    Road = lists:zip(Ring, tl(Ring) ++ [hd(Ring)]),
    Spur = fun(Id) -> {maps:get(Id, Spots), maps:get(Id, Feet)} end,
    [
        begin
            {X, Y} = Spot = maps:get(Id, Spots),
            ?assert(X >= ?R andalso Y >= ?R andalso X =< 12000.0 - ?R andalso Y =< 12000.0 - ?R),
            [?assert(starl_geometry:point_segment(Spot, S) > 2 * ?R) || S <- Road],
            [?assert(starl_geometry:point_segment(Spot, Spur(J)) > 2 * ?R) || J <- Ids, J =/= Id],
            [
                ?assert(starl_geometry:segment_segment(Spur(Id), Spur(J)) > 2 * ?R)
             || J <- Ids, J < Id
            ],
            ?assert(lists:member(maps:get(Id, Feet), Ring)),
            ?assertNot(starl_geometry:overlap(Area, starl_geometry:grow({X, Y, X, Y}, 2 * ?R)))
        end
     || Id <- Ids
    ].

few_are_spread_evenly_test() ->
    #{spots := Spots} = layout(4),
    Points = maps:values(Spots),
    Least = lists:min([starl_geometry:distance(P, Q) || P <- Points, Q <- Points, P < Q]),
    ?assert(Least > 5000.0).

%% Four robots get a wall each, and stand in its middle.
middle_of_the_walls_test() ->
    #{spots := Spots} = layout(4),
    Middles = [{6000.0, ?R}, {12000.0 - ?R, 6000.0}, {6000.0, 12000.0 - ?R}, {?R, 6000.0}],
    [
        ?assert(starl_geometry:distance(maps:get(Id, Spots), P) < 1.0e-6, {Id, Spots})
     || {Id, P} <- lists:zip([1, 2, 3, 4], Middles)
    ].

%% The ring leads round: each side straight on, from one point to the next no farther than 2.5 R,
%% with the feet of all spots on it.
ring_in_order_test() ->
    [
        begin
            #{ring := Ring, feet := Feet} = layout(N),
            Round = lists:zip(Ring, tl(Ring) ++ [hd(Ring)]),
            Legs = [starl_geometry:distance(A, B) || {A, B} <- Round],
            Side = 12000.0 - 2 * 3.1 * ?R,
            ?assert(abs(lists:sum(Legs) - 4 * Side) < 1.0e-3, {N, Legs}),
            ?assert(lists:max(Legs) =< 2.5 * ?R + 1.0e-6),
            ?assertEqual([], maps:values(Feet) -- Ring)
        end
     || N <- [1, 5, 16, 40, 88]
    ].

%% What is drawn near the ring is joined to it.
joined_to_the_ring_test() ->
    #{ring := [{X, Y} | _]} = Layout = layout(4),
    Line = {{X + 150.0, Y + 100.0}, {X + 250.0, Y + 100.0}},
    Picture = starl_planar:planarise([Line], #{}),
    #{ring := Ring, edges := Edges} = starl_roadmap:travel(Layout, ?R, Picture, 1),
    Joins = [
        E
     || {A, B} = E <- Edges,
        A =< 2 orelse B =< 2,
        lists:member(A, Ring) orelse lists:member(B, Ring)
    ],
    ?assertMatch([_ | _], Joins).

too_many_is_an_error_test() ->
    {error, Reason} = starl_roadmap:layout({12000.0, 12000.0}, 200, ?R),
    ?assertMatch({world_too_small, #{robots := 200, most := Most}} when Most > 80, Reason),
    ?assertMatch({match, _}, re:run(starl_roadmap:format_error(Reason), "larger floor")),
    ?assertMatch(
        {error, {world_too_small, #{most := 0}}},
        starl_roadmap:layout({1500.0, 12000.0}, 1, ?R)
    ),
    %% The stated number does fit.
    {world_too_small, #{most := Most}} = Reason,
    ?assertMatch({ok, _}, starl_roadmap:layout({12000.0, 12000.0}, Most, ?R)).

%% All of the roadmap hangs together, joins the picture, and but for the spurs is more than 2R
%% from all spots.
travel_test_() ->
    [
        {lists:concat([Name, " seed ", Seed]), fun() -> travel(Name, Seed) end}
     || Name <- [text, short_lines, single], Seed <- [1, 2]
    ].

travel(Name, Seed) ->
    Picture = starl_planar:planarise(starl_dpp_pictures:picture(Name, Seed), #{}),
    #{vertices := Targets, edges := TargetEdges} = Picture,
    #{spots := Spots} = Layout = layout(6),
    Travel = starl_roadmap:travel(Layout, ?R, Picture, Seed),
    ?assertEqual(Travel, starl_roadmap:travel(Layout, ?R, Picture, Seed)),
    #{points := Points, edges := Edges, spots := SpotVs} = Travel,
    All = list_to_tuple(Targets ++ Points),
    [?assertEqual(P, element(maps:get(Id, SpotVs), All)) || {Id, P} <- maps:to_list(Spots)],
    Inner = [
        E
     || {V, W} = E <- Edges,
        not lists:member(V, maps:values(SpotVs)),
        not lists:member(W, maps:values(SpotVs))
    ],
    ?assertEqual(length(Edges) - 6, length(Inner)),
    [
        ?assert(starl_geometry:point_segment(P, {element(V, All), element(W, All)}) > 2 * ?R)
     || P <- maps:values(Spots), {V, W} <- Inner
    ],
    Graph = digraph:new(),
    [digraph:add_vertex(Graph, V) || {A, B} <- Edges ++ TargetEdges, V <- [A, B]],
    [digraph:add_edge(Graph, A, B) || {A, B} <- Edges ++ TargetEdges],
    Parts = digraph_utils:components(Graph),
    digraph:delete(Graph),
    ?assertEqual(1, length(Parts)).

%% Inside of the ring there is about one point for each square of side 2.5 R, sixteen at least, 2000
%% at most. They are spread evenly: every place has one nearby, and no two are together.
points_are_spread_evenly_test_() ->
    [
        {lists:concat([R, " mm, seed ", Seed]), fun() -> spread_evenly(Side, R, Seed, N) end}
     || {Side, R, N} <- [
            {12000.0, 215.0, 363},
            {12000.0, 365.0, 98},
            {12000.0, 60.0, 2000},
            {4000.0, 365.0, 16}
        ],
        Seed <- [1, 2, 7]
    ].

spread_evenly(Side, R, Seed, N) ->
    {ok, Layout} = starl_roadmap:layout({Side, Side}, 2, R),
    Samples = samples(Layout, R, Seed),
    ?assertEqual(N, length(Samples)),
    {X0, Y0, X1, Y1} = Box = area(Layout, R),
    Apart = math:sqrt((X1 - X0) * (Y1 - Y0) / N),
    [?assert(starl_geometry:inside(P, Box)) || P <- Samples],
    N =< 400 andalso
        begin
            [
                ?assert(starl_geometry:distance(P, Q) > 0.4 * Apart)
             || P <- Samples, Q <- Samples, P < Q
            ],
            Places = [
                {X0 + I / 20 * (X1 - X0), Y0 + J / 20 * (Y1 - Y0)}
             || I <- lists:seq(1, 19), J <- lists:seq(1, 19)
            ],
            [
                ?assert(lists:min([starl_geometry:distance(P, Q) || Q <- Samples]) < 1.3 * Apart)
             || P <- Places
            ]
        end.

area(#{area := Area}, R) -> starl_geometry:grow(Area, 0.5 * R).

%% The points are those of the ring, the spots, and the scattered ones.
samples(#{ring := Ring, spots := Spots} = Layout, R, Seed) ->
    Picture = starl_planar:planarise([], #{}),
    #{points := Points} = starl_roadmap:travel(Layout, R, Picture, Seed),
    lists:nthtail(length(Ring) + map_size(Spots), Points).

%% Another seed, other points.
seeds_differ_test() ->
    Others = samples(layout(2), ?R, 2),
    ?assertEqual([], [P || P <- samples(layout(2), ?R, 1), lists:member(P, Others)]).

%% The ways of the roadmap: each spot to its foot, once around the ring, each scattered point to all
%% that are no farther than 1.3 of their mean spacing, and one end of lines per square of side R to
%% three of the nearest points.
ways_test_() ->
    [
        {lists:concat([Name, ", seed ", Seed]), {timeout, 30, fun() -> ways(Name, Seed) end}}
     || {Name, Seed} <- [{text, 1}, {short_lines, 2}]
    ].

ways(Name, Seed) ->
    Picture = starl_planar:planarise(starl_dpp_pictures:picture(Name, Seed), #{}),
    #{vertices := Targets} = Picture,
    #{ring := Ring, spots := Spots, feet := Feet} = Layout = layout(5),
    #{points := Points, edges := Edges, spots := SpotVs, ring := RingVs} =
        starl_roadmap:travel(Layout, ?R, Picture, Seed),
    At = list_to_tuple(Targets ++ Points),
    First = length(Targets) + 1,
    ?assertEqual(lists:seq(First, First + length(Ring) - 1), RingVs),
    ?assertEqual(Ring, [element(V, At) || V <- RingVs]),
    SampleVs = lists:seq(First + length(Ring) + map_size(Spots), tuple_size(At)),
    {X0, Y0, X1, Y1} = area(Layout, ?R),
    Spacing = math:sqrt((X1 - X0) * (Y1 - Y0) / length(SampleVs)),
    Far = fun(V, W) -> starl_geometry:distance(element(V, At), element(W, At)) end,
    Spurs = [
        {maps:get(Id, SpotVs), W}
     || Id <- lists:seq(1, 5), W <- RingVs, element(W, At) == maps:get(Id, Feet)
    ],
    Round = lists:zip(RingVs, tl(RingVs) ++ [hd(RingVs)]),
    Mesh = [
        {V, W}
     || V <- SampleVs, W <- RingVs ++ SampleVs, W < V, Far(V, W) =< 1.3 * Spacing
    ],
    Inside = RingVs ++ SampleVs,
    Links = [E || {V, _} = E <- Edges, V < First],
    [
        begin
            Sorted = lists:sort([{Far(V, W), W} || W <- Inside]),
            [{_, Nearest} | _] = Five = lists:sublist(Sorted, 5),
            Linked = [W || {Of, W} <- Links, Of =:= V],
            ?assertEqual({V, 3}, {V, length(lists:usort(Linked))}),
            ?assert(lists:member(Nearest, Linked)),
            ?assertEqual([], Linked -- [W || {_, W} <- Five])
        end
     || V <- first_of_each_square(Targets)
    ],
    ?assertEqual(3 * length(first_of_each_square(Targets)), length(Links)),
    ?assertEqual(5, length(Spurs)),
    All = Spurs ++ Round ++ Mesh ++ Links,
    ?assertEqual({[], []}, {All -- Edges, Edges -- All}).

first_of_each_square(Targets) ->
    Numbered = lists:zip(Targets, lists:seq(1, length(Targets))),
    {Vs, _} = lists:foldl(
        fun({{X, Y}, V}, {Vs, Seen}) ->
            Square = {floor(X / ?R), floor(Y / ?R)},
            case lists:member(Square, Seen) of
                true -> {Vs, Seen};
                false -> {[V | Vs], [Square | Seen]}
            end
        end,
        {[], []},
        Numbered
    ),
    Vs.
