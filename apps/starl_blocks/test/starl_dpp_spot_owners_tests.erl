%% Whose parking spot is where, who exchanges it, and how near to it is parked.
-module(starl_dpp_spot_owners_tests).
-include_lib("eunit/include/eunit.hrl").

%% 0.04 of this is a millimetre.
-define(R, 25.0).

graph() ->
    {ok, Plan} = starl_dpp_plan:new(#{
        segments => [{{2000.0, 2000.0}, {2100.0, 2000.0}}],
        world => {4000.0, 4000.0},
        robots => [3, 5, 7],
        tube_radius => ?R
    }),
    starl_dpp_plan:graph(Plan).

new() -> starl_dpp_spot_owners:new([3, 5, 7], graph()).

%% The robots get the spots in their order.
robots_get_the_spots_in_their_order_test() ->
    Spots = starl_dpp_graph:spots(graph()),
    ?assertEqual(
        [{3, maps:get(1, Spots)}, {5, maps:get(2, Spots)}, {7, maps:get(3, Spots)}],
        starl_dpp_spot_owners:all(new())
    ),
    ?assertEqual(
        starl_dpp_graph:point(maps:get(2, Spots), graph()), starl_dpp_spot_owners:place(5, new())
    ).

two_robots_exchange_their_spots_test() ->
    Spots = starl_dpp_spot_owners:exchange(3, 7, new()),
    Place = fun(Robot) -> starl_dpp_spot_owners:place(Robot, new()) end,
    ?assertEqual(
        [Place(7), Place(5), Place(3)],
        [starl_dpp_spot_owners:place(Robot, Spots) || Robot <- [3, 5, 7]]
    ).

%% Less than a millimetre away from its own spot, in any direction.
less_than_a_millimetre_away_is_on_its_spot_test() ->
    {X, Y} = starl_dpp_spot_owners:place(5, new()),
    On = fun(P) -> starl_dpp_spot_owners:on(P, 5, new()) end,
    ?assertEqual([true, true, true], [On({X, Y}), On({X + 0.99, Y}), On({X, Y - 0.99})]),
    ?assertEqual([false, false, false], [On({X + 1.0, Y}), On({X - 1.0, Y}), On({X + 0.8, Y + 0.8})]),
    ?assertNot(starl_dpp_spot_owners:on({X, Y}, 3, new())).

%% Of many robots, too, they come in the order of the robots.
all_in_order_test() ->
    Robots = lists:seq(1, 40),
    {ok, Plan} = starl_dpp_plan:new(#{
        segments => [{{2000.0, 2000.0}, {2100.0, 2000.0}}],
        world => {4000.0, 4000.0},
        robots => Robots,
        tube_radius => ?R
    }),
    Spots = starl_dpp_spot_owners:new(Robots, starl_dpp_plan:graph(Plan)),
    ?assertEqual(Robots, [Robot || {Robot, _} <- starl_dpp_spot_owners:all(Spots)]).
