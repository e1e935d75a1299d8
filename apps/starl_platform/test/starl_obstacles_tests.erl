%% Obstacles come and go at their times, and doors are those of the plan.
-module(starl_obstacles_tests).
-include_lib("eunit/include/eunit.hrl").

%% 4 m x 3 m with a door across the middle.
floor_with_door() ->
    starl_floor:new(#{size => {4000, 3000}, doors => [{{2000, 0}, {2000, 3000}}]}).

-define(WAY, {{1000.0, 1500.0}, {3000.0, 1500.0}}).

a_door_is_in_the_way_while_it_is_closed_test() ->
    Walls = starl_walls:new(floor_with_door()),
    {ok, Sides} = starl_obstacles:door(1, floor_with_door()),
    Obstacles = starl_obstacles:new([{10, 20, Sides}], Walls),
    ?assertEqual([true, false, false, true], [
        starl_walls:is_free(?WAY, 165.0, starl_obstacles:walls(T, Obstacles))
     || T <- [9, 10, 19, 20]
    ]),
    ?assertEqual([[], Sides, Sides, []], [
        starl_obstacles:sides(T, Obstacles)
     || T <- [9, 10, 19, 20]
    ]),
    ?assertEqual([[], Sides, [], []], [
        starl_obstacles:caught(T, Obstacles)
     || T <- [9, 10, 11, 20]
    ]).

obstacles_overlap_in_time_test() ->
    Walls = starl_walls:new(starl_floor:empty({4000, 3000})),
    Box = fun(X) -> starl_obstacles:box({X, 1400, 200, 200}) end,
    Obstacles = starl_obstacles:new([{10, 30, Box(500)}, {20, 40, Box(1500)}], Walls),
    ?assertEqual(
        [{5, 10, 0}, {10, 20, 4}, {20, 30, 8}, {30, 40, 4}, {40, 50, 0}],
        [
            {From, To, length(starl_walls:near({0.0, 0.0, 4000.0, 3000.0}, 0.0, At)) - 4}
         || {From, To, At} <- starl_obstacles:stretches(5, 50, Obstacles)
        ]
    ),
    ?assertMatch([{12, 13, _}], starl_obstacles:stretches(12, 13, Obstacles)).

a_door_that_is_not_there_test() ->
    ?assertEqual({error, 1}, starl_obstacles:door(2, floor_with_door())),
    ?assertEqual([], starl_obstacles:of_fault(closed, #{door => 2}, floor_with_door())).
