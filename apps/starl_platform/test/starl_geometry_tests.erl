-module(starl_geometry_tests).
-include_lib("eunit/include/eunit.hrl").

-import(starl_geometry, [segment_segment/2, point_segment/2, intersection/2, closer/3, closer2/3]).

near(A, B) -> abs(A - B) < 1.0e-9.

point_segment_test() ->
    S = {{0.0, 0.0}, {10.0, 0.0}},
    ?assert(near(3.0, point_segment({5.0, 3.0}, S))),
    ?assert(near(5.0, point_segment({-3.0, 4.0}, S))),
    ?assert(near(5.0, point_segment({13.0, -4.0}, S))),
    ?assert(near(5.0, point_segment({3.0, 4.0}, {{0.0, 0.0}, {0.0, 0.0}}))).

touching_segments_have_distance_zero_test() ->
    S = {{0.0, 0.0}, {10.0, 0.0}},
    ?assertEqual(0.0, segment_segment(S, {{5.0, -5.0}, {5.0, 5.0}})),
    ?assertEqual(0.0, segment_segment(S, {{5.0, 0.0}, {5.0, 5.0}})),
    ?assertEqual(0.0, segment_segment(S, {{10.0, 0.0}, {20.0, 0.0}})),
    ?assertEqual(0.0, segment_segment(S, {{3.0, 0.0}, {20.0, 0.0}})),
    ?assertEqual(0.0, segment_segment(S, {{3.0, 0.0}, {3.0, 0.0}})).

parallel_segments_test() ->
    ?assert(near(2.0, segment_segment({{0.0, 0.0}, {10.0, 0.0}}, {{3.0, 2.0}, {4.0, 2.0}}))),
    ?assert(near(5.0, segment_segment({{0.0, 0.0}, {10.0, 0.0}}, {{15.0, 0.0}, {18.0, 0.0}}))).

intersection_kinds_test() ->
    S = {{0.0, 0.0}, {10.0, 0.0}},
    ?assertEqual({proper, {5.0, 0.0}}, intersection(S, {{5.0, -5.0}, {5.0, 5.0}})),
    ?assertEqual({touch, {5.0, 0.0}}, intersection(S, {{5.0, 0.0}, {5.0, 5.0}})),
    ?assertEqual({touch, {10.0, 0.0}}, intersection(S, {{20.0, 0.0}, {10.0, 0.0}})),
    ?assertEqual({overlap, {{3.0, 0.0}, {10.0, 0.0}}}, intersection(S, {{20.0, 0.0}, {3.0, 0.0}})),
    ?assertEqual(none, intersection(S, {{11.0, 0.0}, {12.0, 0.0}})),
    ?assertEqual(none, intersection(S, {{0.0, 1.0}, {12.0, 1.0}})),
    ?assertEqual(none, intersection(S, {{5.0, 1.0}, {5.0, 2.0}})),
    ?assertEqual({touch, {5.0, 0.0}}, intersection(S, {{5.0, 0.0}, {5.0, 0.0}})).

angles_test() ->
    Pi = math:pi(),
    ?assert(near(Pi, starl_geometry:angle_diff(Pi, 0.0))),
    ?assert(near(Pi, starl_geometry:angle_diff(0.0, Pi))),
    ?assert(near(0.2, starl_geometry:angle_diff(-Pi + 0.1, Pi - 0.1))),
    ?assert(near(Pi / 2, starl_geometry:heading({0.0, 0.0}, {0.0, 3.0}))),
    ?assert(near(Pi, starl_geometry:heading({0.0, 0.0}, {-1.0, -0.0}))).

%% normalise/1 lands in (-pi, pi] and keeps the direction.
normalise_random_test() ->
    each(500, fun([A | _]) ->
        Angle = A * 100.0 - 50.0,
        N = starl_geometry:normalise(Angle),
        N > -math:pi() andalso N =< math:pi() andalso abs(math:sin(N) - math:sin(Angle)) < 1.0e-9
    end).

%% The distance of segments agrees with the least distance of many points along both.
distance_random_test() ->
    each(300, fun(Xs) ->
        [S, T] = segments(Xs),
        D = segment_segment(S, T),
        Steps = lists:seq(0, 200),
        Sampled = lists:min([point_segment(along(S, K / 200), T) || K <- Steps]),
        D =< Sampled + 1.0e-9 andalso Sampled - D < starl_geometry:length(S) / 200
    end).

%% Two pieces of one slanted line, far apart: rounding puts the ends of either on both sides of the
%% other, and that is no crossing. (In a painting two tubes on one line seemed to meet.)
pieces_of_one_line_test() ->
    S = {{6305.493399170289, 6387.2642594777135}, {6032.79972691508, 6610.274612564272}},
    T = {{5689.556573740378, 6890.980710916254}, {5346.313420565675, 7171.686809268236}},
    ?assert(near(starl_geometry:distance(element(2, S), element(1, T)), segment_segment(S, T))),
    ?assertNot(closer(S, T, 424.999)),
    ?assertEqual(none, intersection(S, T)).

pieces_of_one_line_random_test() ->
    each(2000, fun([X, Y | _] = Xs) ->
        [{P, Q}, _] = segments(Xs),
        Cut = [along({P, Q}, K) || K <- [0.0, 0.2 + 0.2 * X, 0.5, 1.0 + Y]],
        [A, B, C, D] = Cut,
        abs(segment_segment({A, B}, {C, D}) - starl_geometry:distance(B, C)) < 1.0e-6 andalso
            intersection({A, B}, {C, D}) =:= none
    end).

%% closer/3 is the comparison of the distance, on either side of it; closer2/3 that of the square.
closer_random_test() ->
    each(300, fun(Xs) ->
        [S, T] = segments(Xs),
        D = segment_segment(S, T),
        {More, Less} = {D + 0.001, max(0.0, D - 0.001)},
        closer(S, T, More) andalso not closer(S, T, Less) andalso
            closer2(S, T, More * More) andalso not closer2(S, T, Less * Less)
    end).

%% Whole numbers, as in a configuration that was written by hand, are as good as floats.
whole_numbers_test() ->
    S = {{0, 0}, {100, 0}},
    T = {{50, -30}, {50, 30}},
    ?assertEqual(0.0, segment_segment(S, T)),
    ?assertEqual([true, false], [closer(S, {{0, 7}, {100, 7}}, Mm) || Mm <- [8, 7]]),
    ?assert(closer(S, T, 1)),
    ?assertEqual(5.0, starl_geometry:distance({0, 0}, {3, 4})),
    ?assertEqual(2.0, point_segment({50, 2}, S)).

%% A crossing lies on both segments; segments that do not meet are apart.
intersection_random_test() ->
    each(500, fun(Xs) ->
        [S, T] = segments(Xs),
        case intersection(S, T) of
            {proper, P} -> point_segment(P, S) < 1.0e-6 andalso point_segment(P, T) < 1.0e-6;
            none -> segment_segment(S, T) > 0.0;
            {touch, _} -> true
        end
    end).

closest_point_random_test() ->
    each(300, fun([X, Y | _] = Xs) ->
        [S, _] = segments(Xs),
        P = {100.0 * Y, 100.0 * X},
        Q = starl_geometry:closest_point(P, S),
        abs(starl_geometry:distance(P, Q) - point_segment(P, S)) < 1.0e-6
    end).

boxes_test() ->
    Box = starl_geometry:box([{1.0, 5.0}, {3.0, 2.0}]),
    ?assertEqual({1.0, 2.0, 3.0, 5.0}, Box),
    ?assertEqual({0.0, 1.0, 4.0, 6.0}, starl_geometry:grow(Box, 1.0)),
    ?assert(starl_geometry:overlap(Box, {3.0, 5.0, 9.0, 9.0})),
    ?assertNot(starl_geometry:overlap(Box, {3.1, 5.0, 9.0, 9.0})),
    ?assert(starl_geometry:inside({1.0, 2.0}, Box)),
    ?assertNot(starl_geometry:inside({0.9, 2.0}, Box)).

interpolate_ends_are_exact_test() ->
    P = {0.1, 0.7},
    Q = {12345.678, 1.0e-3},
    ?assertEqual(P, starl_geometry:interpolate(P, Q, 0.0)),
    ?assertEqual(Q, starl_geometry:interpolate(P, Q, 1.0)).

along({P, Q}, T) -> starl_geometry:interpolate(P, Q, T).

segments([A, B, C, D, E, F, G, H]) ->
    [
        {{100.0 * A, 100.0 * B}, {100.0 * C, 100.0 * D}},
        {{100.0 * E, 100.0 * F}, {100.0 * G, 100.0 * H}}
    ].

each(N, Holds) ->
    [
        ?assert(Holds(Xs), {seed, Seed, Xs})
     || Seed <- lists:seq(1, N), {Xs, _} <- [draw(8, rand:seed_s(exsss, Seed))]
    ].

draw(0, Rand) ->
    {[], Rand};
draw(N, Rand0) ->
    {X, Rand1} = rand:uniform_s(Rand0),
    {Xs, Rand2} = draw(N - 1, Rand1),
    {[X | Xs], Rand2}.

%% 0.0 and -0.0 are one coordinate, in every release of OTP: a point is a point, not a line.
negative_zero_test() ->
    Point = {{0.0, 5.0}, {-0.0, 5.0}},
    [
        ?assertMatch({touch, _}, intersection(S, T))
     || Line <- [{{0.0, 0.0}, {0.0, 10.0}}, {{-5.0, 5.0}, {5.0, 5.0}}],
        {S, T} <- [{Point, Line}, {Line, Point}]
    ],
    ?assertMatch({touch, _}, intersection(Point, {{-0.0, 5.0}, {0.0, 5.0}})),
    ?assertEqual(none, intersection(Point, {{1.0, 0.0}, {1.0, 10.0}})).
