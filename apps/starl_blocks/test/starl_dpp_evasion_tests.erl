%% Out of the way: who stands outermost, what is in the way, where a robot parks or steps aside, and
%% what it would do if those that wait were not there.
-module(starl_dpp_evasion_tests).
-include_lib("eunit/include/eunit.hrl").

-define(R, 215.0).
-define(Y, starl_dpp_evasion).

%% Robots that stand at these places, and one line of a metre.
plan(Places) ->
    {ok, Plan} = starl_dpp_plan:new(#{
        segments => [{{6000.0, 6000.0}, {7000.0, 6000.0}}],
        world => {12000.0, 12000.0},
        robots => [Id || {Id, _} <- Places],
        tube_radius => ?R
    }),
    lists:foldl(fun({Id, P}, Acc) -> starl_dpp_plan:standing(Id, P, Acc) end, Plan, Places).

graph() -> starl_dpp_plan:graph(plan([{1, {3000.0, 3000.0}}])).

%% The nearest wall counts, whichever it is.
nearest_wall_counts_test() ->
    Places = [
        {1, {6000.0, 6000.0}},
        {2, {300.0, 6000.0}},
        {3, {6000.0, 11500.0}},
        {4, {11800.0, 5000.0}},
        {5, {5000.0, 100.0}},
        {6, {5100.0, 300.0}}
    ],
    ?assertEqual([5, 4, 2, 6, 3, 1], ?Y:outermost(Places, graph())),
    ?assertEqual([], ?Y:outermost([], graph())).

%% Two tubes and a millimetre away is out of the way; any segment of the one in any of the other.
in_way_test() ->
    In = fun(Held, Way) -> ?Y:in_way(Held, Way, graph()) end,
    Way = [{{0.0, 5000.0}, {1000.0, 5000.0}}, {{1000.0, 5000.0}, {1000.0, 9000.0}}],
    At = fun(X, Y) -> {{X, Y}, {X, Y}} end,
    ?assertEqual(
        [true, false, true, false],
        [
            In([P], Way)
         || P <- [At(500.0, 5430.9), At(500.0, 5431.1), At(1430.9, 8000.0), At(1431.1, 8000.0)]
        ]
    ),
    ?assert(In([At(5000.0, 5000.0), At(500.0, 5000.0)], Way)),
    ?assertNot(In([], Way)),
    ?assertNot(In([At(500.0, 5000.0)], [])).

%% The free edges that are nearer than two tubes.
free_edges_nearer_than_two_tubes_are_closed_test() ->
    Plan = plan([{1, {3000.0, 3000.0}}]),
    Graph = starl_dpp_plan:graph(Plan),
    View = starl_dpp_plan:view(1, Plan),
    Near = fun(V, E) ->
        starl_geometry:point_segment(
            starl_dpp_graph:point(V, Graph), starl_dpp_graph:segment(E, Graph)
        ) < 2 * ?R
    end,
    Closed = [{V, ?Y:closes(V, View)} || V <- lists:seq(1, starl_dpp_graph:vertices(Graph))],
    [?assertEqual({V, [E || E <- [1, 2], Near(V, E)]}, {V, lists:sort(Es)}) || {V, Es} <- Closed],
    Taken = starl_dpp_plan:view(1, starl_dpp_plan:mark_painted([1], Plan)),
    ?assertEqual([2], lists:usort(lists:append([?Y:closes(V, Taken) || {V, _} <- Closed]))).

%% It parks on the nearest of the spots; who is there already has no way to go.
parks_on_the_nearest_spot_test() ->
    Plan = plan([{1, {3000.0, 3000.0}}, {2, {9000.0, 9000.0}}, {3, {9000.0, 3000.0}}]),
    [{1, Own}, {2, Second}, {3, Third}] = starl_dpp_plan:spots(Plan),
    Graph = starl_dpp_plan:graph(Plan),
    {X, Y} = starl_dpp_graph:point(Second, Graph),
    Park = fun(At, Spots) ->
        ?Y:park(Spots, starl_dpp_plan:view(1, starl_dpp_plan:standing(1, At, Plan)))
    end,
    {ok, Second, Way} = Park({0.9 * X + 600.0, 0.9 * Y + 600.0}, [Own, Second, Third]),
    ?assertEqual({{X, Y}, up}, lists:last(Way)),
    {ok, Own, _} = Park({0.9 * X + 600.0, 0.9 * Y + 600.0}, [Own]),
    ?assertEqual(none, Park({0.9 * X + 600.0, 0.9 * Y + 600.0}, [])),
    ?assertEqual(none, Park({X, Y}, [Second])).

%% It drives to a spot straight along the wall, if the ring road beside it is closed.
park_along_the_wall_test() ->
    Plan = plan([{1, {3000.0, 3000.0}}, {2, {9000.0, 9000.0}}, {3, {9000.0, 3000.0}}]),
    [{1, Own} | _] = starl_dpp_plan:spots(Plan),
    {X, ?R} = starl_dpp_plan:spot(1, Plan),
    Ring = starl_dpp_plan:adopt(2, {1000.0, 655.0}, [{{11000.0, 655.0}, up}], Plan),
    View = starl_dpp_plan:view(1, starl_dpp_plan:standing(1, {X - 2600.0, ?R}, Ring)),
    {ok, Own, Way} = ?Y:park([Own], View),
    ?assertEqual([?R], lists:usort([Y || {{_, Y}, up} <- Way])),
    ?assertMatch({{X, ?R}, up}, lists:last(Way)).

%% It finds its way over the roadmap where no straight line leads out: out of a yard whose gate has a
%% wall before it.
park_out_of_a_yard_test() ->
    Plan = plan([{1, {3000.0, 3000.0}}, {2, {9000.0, 9000.0}}, {3, {9000.0, 3000.0}}]),
    Yard = [
        {{5500.0, 7500.0}, up},
        {{2500.0, 7500.0}, up},
        {{2500.0, 4500.0}, up},
        {{5500.0, 4500.0}, up},
        {{5500.0, 5000.0}, up}
    ],
    Wall = [{{7800.0, 9200.0}, up}],
    Shut = starl_dpp_plan:adopt(
        3, {7800.0, 2800.0}, Wall, starl_dpp_plan:adopt(2, {5500.0, 7000.0}, Yard, Plan)
    ),
    At = {4000.0, 6000.0},
    View = starl_dpp_plan:view(1, starl_dpp_plan:standing(1, At, Shut)),
    [{1, Own} | _] = starl_dpp_plan:spots(Plan),
    {ok, Own, Way} = ?Y:park([Own], View),
    Points = [At | [P || {P, up} <- Way]],
    [
        ?assert(starl_geometry:segment_segment(Leg, S) >= 2 * ?R)
     || Leg <- lists:zip(lists:droplast(Points), tl(Points)),
        Robot <- [2, 3],
        S <- starl_dpp_plan:held(Robot, Shut)
    ].

%% Aside is a vertex that will do and is nobody's spot; the way leads to it and is clear of others.
aside_is_nobodys_spot_and_clear_of_others_test() ->
    Plan = plan([{1, {6500.0, 6100.0}}, {2, {6500.0, 7000.0}}]),
    Graph = starl_dpp_plan:graph(Plan),
    View = starl_dpp_plan:view(1, Plan),
    Good = fun(V) -> ?Y:closes(V, View) =:= [] end,
    {ok, V, Way} = ?Y:aside(Good, View),
    ?assert(Good(V)),
    ?assertEqual({starl_dpp_graph:point(V, Graph), up}, lists:last(Way)),
    Points = [{6500.0, 6100.0} | [P || {P, _} <- Way]],
    [
        ?assert(starl_geometry:point_segment({6500.0, 7000.0}, S) >= 2 * ?R)
     || S <- lists:zip(lists:droplast(Points), tl(Points))
    ],
    ?assertEqual(none, ?Y:aside(fun(_) -> false end, View)),
    Spots = [Spot || {_, Spot} <- starl_dpp_plan:spots(Plan)],
    ?assertEqual(none, ?Y:aside(fun(W) -> lists:member(W, Spots) end, View)).

%% The way to the nearest free edge, that edge with it, and those that wait and stand in it; each of
%% these is as bad as a metre to drive. Who does not wait is not driven through.
wishes_the_nearest_free_edge_with_those_who_stand_in_it_test() ->
    Places = [{1, {5000.0, 6000.0}}, {2, {6000.0, 6100.0}}, {3, {9000.0, 9000.0}}],
    Plan = plan(Places),
    View = starl_dpp_plan:view(1, Plan),
    Graph = starl_dpp_plan:graph(Plan),
    {ok, #{robot := 1, blockers := [2], way := Way, cost_mm := Cost}} = ?Y:wish([1, 2, 3], View),
    [Edge | Driven] = Way,
    ?assert(lists:member(Edge, [starl_dpp_graph:segment(E, Graph) || E <- [1, 2]])),
    ?assertMatch([{{5000.0, 6000.0}, _} | _], Driven),
    Mm = lists:sum([starl_geometry:length(S) || S <- Driven]),
    ?assert(Cost >= Mm + 1000.0 andalso Cost < Mm + 2000.0),
    Alone = starl_dpp_plan:view(1, plan([{1, {5000.0, 6000.0}}, {2, {9000.0, 3000.0}}])),
    {ok, #{blockers := [], cost_mm := Less}} = ?Y:wish([1, 2], Alone),
    ?assert(abs(Cost - Less - 1000.0) < 1.0e-6),
    ?assertEqual(
        none,
        ?Y:wish([1], starl_dpp_plan:view(1, plan([{1, {5000.0, 6000.0}}, {2, {6500.0, 6000.0}}])))
    ),
    Done = starl_dpp_plan:view(1, starl_dpp_plan:mark_painted([1, 2], Plan)),
    ?assertEqual(none, ?Y:wish([1, 2], Done)).
