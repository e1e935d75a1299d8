%% Areas: what is one, where its border lies, and who keeps inside or outside of it.
-module(starl_geocast_area_tests).
-include_lib("eunit/include/eunit.hrl").

-define(FAR, 1.0e9).

box() -> {rectangle, {0.0, 0.0, 10.0, 20.0}}.

%% -- what is an area --------------------------------------------------------------------------

%% Each number of each shape in turn is replaced: floats up to 1.0e9 on either side are in.
numbers_test() ->
    [?assertEqual({Area, ok}, {Area, check(Area)}) || Area <- shapes(?FAR) ++ shapes(0.0)],
    Bad = [1.0000000005e9, -1.0000000005e9, 1.0e300, 1, 0, none, "1", {1.0}],
    [
        ?assertEqual({Area, {error, not_an_area}}, {Area, check(Area)})
     || N <- Bad, Area <- shapes(N) ++ lows(N)
    ],
    [?assertEqual({Area, ok}, {Area, check(Area)}) || Area <- lows(-?FAR)].

check(Area) -> starl_geocast_area:check(Area).

%% A large number stands where it may.
shapes(N) ->
    [
        {circle, {N, 0.0}, 1.0},
        {circle, {0.0, N}, 1.0},
        {circle, {0.0, 0.0}, N},
        {rectangle, {0.0, 0.0, N, 1.0}},
        {rectangle, {0.0, 0.0, 1.0, N}},
        {polygon, [{N, 0.0}, {1.0, 0.0}, {1.0, 1.0}]},
        {polygon, [{0.0, 0.0}, {1.0, N}, {1.0, 1.0}]},
        {polygon, [{0.0, 0.0}, {1.0, 0.0}, {N, 1.0}]}
    ].

%% A small number does.
lows(N) ->
    [
        {circle, {N, 0.0}, 1.0},
        {circle, {0.0, N}, 1.0},
        {rectangle, {N, 0.0, 1.0, 1.0}},
        {rectangle, {0.0, N, 1.0, 1.0}},
        {polygon, [{N, 0.0}, {1.0, 0.0}, {1.0, 1.0}]},
        {polygon, [{0.0, N}, {1.0, 0.0}, {1.0, 1.0}]}
    ].

radius_test() ->
    ?assertEqual(ok, check({circle, {0.0, 0.0}, 0.0})),
    ?assertEqual({error, negative_radius}, check({circle, {0.0, 0.0}, -0.001})),
    ?assertEqual({error, negative_radius}, check({circle, {0.0, 0.0}, -1.0e9})),
    ?assertEqual({error, not_an_area}, check({circle, {0.0, 0.0}, -1.0000000005e9})).

upside_down_test() ->
    ?assertEqual(ok, check({rectangle, {1.0, 2.0, 1.0, 2.0}})),
    ?assertEqual({error, upside_down}, check({rectangle, {1.1, 2.0, 1.0, 2.0}})),
    ?assertEqual({error, upside_down}, check({rectangle, {1.0, 2.1, 1.0, 2.0}})).

polygon_test() ->
    Points = [{0.0, 0.0}, {1.0, 0.0}, {1.0, 1.0}],
    ?assertEqual(ok, check({polygon, Points})),
    [
        ?assertEqual({error, too_few_points}, check({polygon, lists:sublist(Points, N)}))
     || N <- [0, 1, 2]
    ],
    [
        ?assertEqual({error, not_an_area}, check(Area))
     || Area <- [
            {polygon, Points ++ [none]},
            {polygon, Points ++ {1.0, 1.0}},
            {polygon, none},
            {circle, {0.0, 0.0}},
            {other, {0.0, 0.0}, 1.0},
            none
        ]
    ].

errors_are_lines_test() ->
    [
        ?assertMatch({R, [_ | _]}, {R, starl_geocast_area:format_error(R)})
     || R <- [not_an_area, negative_radius, upside_down, too_few_points]
    ].

%% -- depth ------------------------------------------------------------------------------------

%% Each side, each corner and the middle of a rectangle.
rectangle_test() ->
    [
        ?assertEqual({Point, Depth}, {Point, starl_geocast_area:depth(Point, box())})
     || {Point, Depth} <- [
            {{5.0, 10.0}, 5.0},
            {{1.0, 10.0}, 1.0},
            {{9.5, 10.0}, 0.5},
            {{5.0, 2.0}, 2.0},
            {{5.0, 19.0}, 1.0},
            {{-0.5, 10.0}, -0.5},
            {{10.5, 10.0}, -0.5},
            {{5.0, -0.5}, -0.5},
            {{5.0, 20.5}, -0.5},
            {{-3.0, -4.0}, -5.0},
            {{13.0, 24.0}, -5.0},
            {{13.0, -4.0}, -5.0},
            {{-3.0, 24.0}, -5.0}
        ]
    ],
    ?assert(starl_geocast_area:depth({10.0, 20.0}, box()) == 0).

%% A polygon that is a rectangle is that rectangle, also where corners lie at the point's height.
polygon_as_rectangle_test() ->
    Polygon = {polygon, [{0.0, 0.0}, {10.0, 0.0}, {10.0, 20.0}, {0.0, 20.0}]},
    [
        ?assertEqual(
            {X, Y, true},
            {X, Y,
                abs(
                    starl_geocast_area:depth({X, Y}, Polygon) -
                        starl_geocast_area:depth({X, Y}, box())
                ) < 1.0e-9}
        )
     || X <- [-7.0, -0.5, 0.5, 5.0, 9.5, 10.5], Y <- [-7.0, 0.0, 0.5, 10.0, 19.5, 20.0, 27.0]
    ],
    %% whichever way round
    {polygon, Points} = Polygon,
    ?assert(starl_geocast_area:depth({5.0, 10.0}, {polygon, lists:reverse(Points)}) > 4.9).

%% -- keeping ----------------------------------------------------------------------------------

still(X, Y) -> starl_trajectory:standing(0, {X, Y}, 0.0).

%% One that stands keeps inside up to the margin itself, and outside of the border.
standing_test() ->
    Inside = fun(X, Margin) ->
        starl_geocast_area:keeps_inside(still(X, 10.0), 0, 1000000, box(), Margin)
    end,
    ?assert(Inside(4.0, 4.0)),
    ?assertNot(Inside(4.0, 4.001)),
    ?assert(Inside(0.0, 0.0)),
    ?assertNot(Inside(-0.001, 0.0)),
    Outside = fun(X) ->
        starl_geocast_area:keeps_outside(still(X, 10.0), 0, 1000000, box())
    end,
    ?assert(Outside(-1.0)),
    ?assert(Outside(-0.01)),
    ?assertNot(Outside(0.0)),
    ?assertNot(Outside(1.0)).

%% Along the border it keeps inside if it does so by more than a thousandth of a millimetre.
precision_test() ->
    Along = fun(X) ->
        Drive = starl_trajectory:piece(0, {X, 5.0}, math:pi() / 2, 1.0, 0.0),
        starl_geocast_area:keeps_inside(Drive, 0, 5000000, box(), 0.0)
    end,
    ?assertEqual([false, false, true, true], [Along(X) || X <- [0.0, 0.0005, 0.0011, 1.0]]).

%% What is not certain within a moment is not claimed, however fast the robot is.
fast_test() ->
    Fast = starl_trajectory:piece(0, {0.001, 10.0}, 0.0, 5000.0, 0.0),
    ?assertNot(starl_geocast_area:keeps_inside(Fast, 0, 0, box(), 0.0)),
    ?assertNot(starl_geocast_area:keeps_inside(Fast, 1, 2, box(), 0.01)),
    ?assertNot(starl_geocast_area:keeps_inside(Fast, 1, 2, box(), 0.0)),
    Later = starl_trajectory:piece(1000, {0.001, 10.0}, 0.0, 5000.0, 0.0),
    ?assertNot(starl_geocast_area:keeps_inside(Later, 1000, 1000, box(), 0.0)).

%% The first and the last instant count.
ends_test() ->
    Drive = starl_trajectory:piece(0, {0.5, 10.0}, 0.0, 1.0, 0.0),
    Inside = fun(T1, T2) -> starl_geocast_area:keeps_inside(Drive, T1, T2, box(), 1.0) end,
    ?assert(Inside(510000, 8490000)),
    ?assertNot(Inside(480000, 8490000)),
    ?assertNot(Inside(510000, 8520000)),
    Outside = fun(T1, T2) ->
        starl_geocast_area:keeps_outside(
            starl_trajectory:piece(0, {-1.0, 10.0}, 0.0, 1.0, 0.0), T1, T2, box()
        )
    end,
    ?assert(Outside(0, 980000)),
    ?assertNot(Outside(0, 1020000)),
    ?assertNot(Outside(10980000, 12000000)),
    ?assert(Outside(11020000, 12000000)).
