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
