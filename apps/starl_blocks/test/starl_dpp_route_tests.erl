%% Ways off the graph: where a search can begin, and what it costs to get there.
-module(starl_dpp_route_tests).
-include_lib("eunit/include/eunit.hrl").

-define(R, 215.0).

%% What robot 1 sees that stands here, while robot 2 stands there.
view(At, Other) ->
    {ok, Plan0} = starl_dpp_plan:new(#{
        segments => [{{4000.0, 4000.0}, {4500.0, 4000.0}}],
        world => {9000.0, 9000.0},
        robots => [1, 2],
        tube_radius => ?R
    }),
    starl_dpp_plan:view(
        1, starl_dpp_plan:standing(2, Other, starl_dpp_plan:standing(1, At, Plan0))
    ).

starts(At, Other) ->
    View = view(At, Other),
    starl_dpp_route:starts([1, 2], starl_dpp_route:obstacles(View), View).

%% Straight there, if nobody is in the way.
straight_test() ->
    ?assertMatch([{500.0, 1, _}, {1000.0, 2, _}], starts({3500.0, 4000.0}, {8000.0, 8000.0})),
    ?assertMatch([{500.0, 1, _}], starts({3500.0, 4000.0}, {4800.0, 4000.0})),
    ?assertEqual([], starts({3500.0, 4000.0}, {3750.0, 4100.0})).

%% A way is divided into legs that are not too long, a short one is not.
legs_test() ->
    Legs = fun(Points) -> starl_dpp_route:legs(Points, 4.0) end,
    ?assertEqual([], Legs([{0.0, 0.0}])),
    ?assertEqual([{4.0, 0.0}], Legs([{0.0, 0.0}, {4.0, 0.0}])),
    ?assertEqual(
        [{3.0, 0.0}, {6.0, 0.0}, {9.0, 0.0}, {9.0, 2.0}],
        Legs([{0.0, 0.0}, {9.0, 0.0}, {9.0, 2.0}])
    ).

%% Who is at a vertex need not drive there, though it stands a hair beside, and nearer to another
%% than it may be.
there_already_test() ->
    ?assertMatch([{0.0, 1, none}, {_, 2, _}], starts({4000.0005, 4000.0}, {3700.0, 4000.0})),
    ?assertMatch([{_, 2, _}], starts({4000.002, 4000.0}, {3700.0, 4000.0})).

%% What is half a millimetre away is driven, though that is little.
nearly_there_test() ->
    At = {4000.5, 4000.0},
    ?assertMatch([{0.5, 1, _}, {499.5, 2, _}], starts(At, {8000.0, 8000.0})),
    ?assertEqual([{{4000.0, 4000.0}, up}], travel([1], At)).

%% A search that begins with a turn pays for it.
turn_test() ->
    Other = {8000.0, 8000.0},
    View = (view({3500.0, 4000.0}, Other))#{heading := math:pi()},
    [{Cost, 1, _}] = starl_dpp_route:starts([1], starl_dpp_route:obstacles(View), View),
    ?assert(abs(Cost - 500.0 - 160.0 * math:pi()) < 1.0e-6).

%% Whose reservations do not count.
space_test() ->
    #{unsafe := Unsafe} = View = view({3500.0, 4000.0}, {8000.0, 8000.0}),
    Own = fun(Ids) -> maps:get(own, starl_dpp_route:space(Ids, View)) end,
    Bit = fun(Id) -> starl_dpp_unsafe:bit(Id, Unsafe) end,
    ?assertEqual(
        [0, Bit(1), Bit(2), Bit(1) bor Bit(2)], [Own(Ids) || Ids <- [[], [1], [2], [1, 2]]]
    ).

%% Fourteen vertices, the nearest ones first.
nearby_test() ->
    #{graph := Graph, at := At} = View = view({3900.0, 4000.0}, {8000.0, 8000.0}),
    [First | _] = Near = starl_dpp_route:nearby(View),
    ?assertEqual({14, 1}, {length(Near), First}),
    Away = fun(V) -> starl_geometry:distance(At, starl_dpp_graph:point(V, Graph)) end,
    Farthest = lists:max([Away(V) || V <- Near]),
    All = lists:seq(1, starl_dpp_graph:vertices(Graph)),
    ?assertEqual([], [V || V <- All -- Near, Away(V) < Farthest]).

travel(Trail, At) ->
    View = view(At, {8000.0, 8000.0}),
    starl_dpp_route:travel(Trail, starl_dpp_route:obstacles(View), View).

%% Along the vertices, straight where that is safe, in legs of half a metre; nothing where it is.
travel_test() ->
    ?assertEqual([], travel([1], {4000.0, 4000.0})),
    ?assertEqual([{{4500.0, 4000.0}, up}], travel([1, 2], {4000.0, 4000.0})),
    ?assertEqual(
        [{{4000.0, 4000.0}, up}, {{4500.0, 4000.0}, up}], travel([1, 2], {3500.0, 4000.0})
    ),
    ?assertEqual([{{4000.0, 4000.0}, up}], travel([1, 1], {4400.0, 4000.0})),
    ?assertEqual(
        [{{4500.0, 4000.0}, up}], travel([1, 2], {4250.0, 3600.0}) -- travel([1], {4250.0, 3600.0})
    ).

%% A way of many points past robot 2, three of them before it, the others behind: of those that are
%% tried, the farthest first and then ones nearer by half, six in all, the first that can be seen is
%% driven to.
smooth_test_() ->
    [
        {lists:concat([Behind, " behind"]), ?_assertEqual(Kept, kept(Behind))}
     || {Behind, Kept} <- [
            {0, [0, 3]}, {5, [0, 2, 3, 4, 8]}, {47, [0, 2, 3, 4, 50]}, {97, [0, 1, 2, 3, 4, 100]}
        ]
    ].

%% The numbers of the points that are left.
kept(Behind) ->
    At = {1000.0, 4000.0},
    Points =
        [At | [{1400.0 + 100.0 * I, 4000.0} || I <- [1, 2, 3]]] ++
            [{6000.0 + 10.0 * I, 4000.0} || I <- lists:seq(1, Behind)],
    #{graph := Graph} = View = view(At, {4000.0, 4000.0}),
    Smooth = starl_dpp_route:smooth(Points, starl_dpp_route:obstacles(View), Graph),
    Numbers = maps:from_list(lists:zip(Points, lists:seq(0, length(Points) - 1))),
    [maps:get(P, Numbers) || P <- Smooth].

%% Two points in one place are a leg, too.
no_way_at_all_test() ->
    ?assertEqual([{1.0, 1.0}], starl_dpp_route:legs([{1.0, 1.0}, {1.0, 1.0}], 4.0)),
    ?assertEqual([{1.0, 1.0}], starl_dpp_route:smooth([{1.0, 1.0}], [], graph)).
