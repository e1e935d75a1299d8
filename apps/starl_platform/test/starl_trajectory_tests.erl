%% Motion in closed form, and the closest approach of two robots at every instant: against
%% known cases and against dense sampling of seeded random pieces.
-module(starl_trajectory_tests).
-include_lib("eunit/include/eunit.hrl").

-define(SEED, 20240601).
-define(S, 1_000_000).

near(Expected, Actual, Tolerance) ->
    ?assert(abs(Expected - Actual) =< Tolerance, {expected, Expected, got, Actual}).

near_point({X, Y}, {X1, Y1}) ->
    near(X, X1, 1.0e-6),
    near(Y, Y1, 1.0e-6).

standing_stays_test() ->
    P = starl_trajectory:standing(5, {1.0, 2.0}, 0.5),
    ?assertEqual({1.0, 2.0, 0.5}, starl_trajectory:pose(7 * ?S, P)),
    ?assertEqual([{1.0, 2.0}], starl_trajectory:polyline(P, 5, ?S, 1.0)),
    ?assertEqual(0.0, starl_trajectory:moved(0, ?S, P)),
    ?assert(starl_trajectory:is_still(P)).

turning_in_place_turns_test() ->
    P = starl_trajectory:piece(0, {1.0, 2.0}, 0.5, 0.0, 0.25),
    {X, Y, Heading} = starl_trajectory:pose(2 * ?S, P),
    near_point({1.0, 2.0}, {X, Y}),
    near(1.0, Heading, 1.0e-12),
    ?assertNot(starl_trajectory:is_bent(P)).

straight_drives_along_heading_test() ->
    P = starl_trajectory:piece(?S, {0.0, 0.0}, math:pi() / 2, 200.0, 0.0),
    near_point({0.0, 300.0}, starl_trajectory:position(2 * ?S + ?S div 2, P)),
    near(200.0, starl_trajectory:moved(?S, 2 * ?S, P), 1.0e-9),
    ?assertMatch([_, _], starl_trajectory:polyline(P, ?S, 2 * ?S, 0.1)).

%% Half a circle of radius 100 to the left: from (0, 0) heading x to (0, 200) heading -x.
arc_drives_a_circle_test() ->
    P = starl_trajectory:piece(0, {0.0, 0.0}, 0.0, 100.0 * math:pi(), math:pi()),
    {X, Y, Heading} = starl_trajectory:pose(?S, P),
    near_point({0.0, 200.0}, {X, Y}),
    near(math:pi(), Heading, 1.0e-12),
    ?assert(starl_trajectory:is_bent(P)).

backwards_drives_backwards_test() ->
    P = starl_trajectory:piece(0, {0.0, 0.0}, 0.0, -100.0, 0.0),
    near_point({-100.0, 0.0}, starl_trajectory:position(?S, P)),
    near(100.0, starl_trajectory:moved(0, ?S, P), 1.0e-9).

%% The form without radius has no jump where the turn rate passes the small angle.
small_turn_rates_are_continuous_test() ->
    [
        near_point(
            starl_trajectory:position(?S, starl_trajectory:piece(0, {0.0, 0.0}, 0.3, 500.0, W)),
            starl_trajectory:position(?S, starl_trajectory:piece(0, {0.0, 0.0}, 0.3, 500.0, V))
        )
     || {W, V} <- [{0.0, 1.0e-9}, {1.999999999e-4, 2.000000001e-4}, {-1.0e-9, 1.0e-9}]
    ].

stop_keeps_the_place_test() ->
    P = starl_trajectory:piece(0, {0.0, 0.0}, 0.0, 100.0, 1.0),
    Stopped = starl_trajectory:stop(?S, P),
    near_point(starl_trajectory:position(?S, P), starl_trajectory:position(9 * ?S, Stopped)).

%% A polyline stays within the tolerance of the path, with its ends on it.
polyline_within_tolerance_test() ->
    P = starl_trajectory:piece(0, {0.0, 0.0}, 0.0, 300.0, 1.5),
    Points = starl_trajectory:polyline(P, 0, 3 * ?S, 0.1),
    Segments = lists:zip(lists:droplast(Points), tl(Points)),
    [
        begin
            At = starl_trajectory:position(I * 3000, P),
            Off = lists:min([starl_geometry:point_segment(At, Seg) || Seg <- Segments]),
            ?assert(Off =< 0.1 + 1.0e-9)
        end
     || I <- lists:seq(0, 1000)
    ],
    ?assert(length(Points) < 80).

enclosing_holds_the_path_test() ->
    P = starl_trajectory:piece(3, {10.0, -5.0}, 0.2, 300.0, 2.5),
    {Centre, Radius} = starl_trajectory:enclosing(5, 2 * ?S, P),
    [
        ?assert(starl_geometry:distance(Centre, starl_trajectory:position(T, P)) =< Radius)
     || T <- lists:seq(5, 2 * ?S, 9973)
    ].

%%% Closest approach: known cases

two_standing_test() ->
    A = starl_trajectory:standing(0, {0.0, 0.0}, 0.0),
    B = starl_trajectory:standing(0, {3.0, 4.0}, 0.0),
    ?assertEqual({5.0, 10}, starl_trajectory:closest_approach(A, B, 10, ?S)),
    ?assertEqual(farther, starl_trajectory:closest_within(5.0, A, B, 10, ?S)),
    ?assertEqual({5.0, 10}, starl_trajectory:closest_within(5.1, A, B, 10, ?S)).

%% Passing each other on parallel lanes 50 mm apart, abreast after 1 s.
passing_test() ->
    A = starl_trajectory:piece(0, {0.0, 0.0}, 0.0, 100.0, 0.0),
    B = starl_trajectory:piece(0, {200.0, 50.0}, math:pi(), 100.0, 0.0),
    {Distance, At} = starl_trajectory:closest_approach(A, B, 0, 5 * ?S),
    near(50.0, Distance, 1.0e-9),
    near(?S, At, 1),
    {Before, End} = starl_trajectory:closest_approach(A, B, 0, ?S div 2),
    near(math:sqrt(100.0 * 100.0 + 50.0 * 50.0), Before, 1.0e-6),
    ?assertEqual(?S div 2, End).

%% A meeting between two microseconds is still seen.
head_on_test() ->
    A = starl_trajectory:piece(0, {0.0, 0.0}, 0.0, 333.3, 0.0),
    B = starl_trajectory:standing(0, {100.0, 0.0}, 0.0),
    {Distance, _} = starl_trajectory:closest_approach(A, B, 0, ?S),
    near(0.0, Distance, 1.0e-9).

%% A circle of radius 100 around (0, 100) seen from (0, 150): 50 mm at all times.
around_a_standing_robot_test() ->
    A = starl_trajectory:piece(0, {0.0, 0.0}, 0.0, 100.0, 1.0),
    Centre = starl_trajectory:standing(0, {0.0, 100.0}, 0.0),
    Inside = starl_trajectory:standing(0, {0.0, 150.0}, 0.0),
    {Constant, _} = starl_trajectory:closest_approach(A, Centre, 0, 7 * ?S),
    near(100.0, Constant, 1.0e-3),
    {Near, At} = starl_trajectory:closest_approach(A, Inside, 0, 7 * ?S),
    near(50.0, Near, 1.0e-3),
    near(math:pi() * ?S, At, 20_000).

%%% Closest approach against dense sampling

closest_approach_against_sampling_test_() ->
    {timeout, 60, fun() ->
        State = rand:seed_s(exsss, ?SEED),
        lists:foldl(fun(N, S) -> sample_case(N, S) end, State, lists:seq(1, 300))
    end}.

sample_case(N, S0) ->
    {A, S1} = random_piece(S0),
    {B, S2} = random_piece(S1),
    {Distance, At} = starl_trajectory:closest_approach(A, B, 0, 2 * ?S),
    {Sampled, _} = sampled(A, B, 0, 2 * ?S, 4000),
    Reached = apart(At, A, B),
    Speed = abs(element(6, A)) + abs(element(6, B)),
    %% Never above the samples, attained to the microsecond, and not below what they allow.
    Good =
        Distance =< Sampled + 1.0e-3 andalso
            abs(Distance - Reached) =< Speed * 1.0e-6 + 1.0e-6 andalso
            Distance >= Sampled - Speed * 250.0e-6 - 1.0e-6 andalso
            starl_trajectory:closest_within(Sampled - Speed * 250.0e-6 - 1.0, A, B, 0, 2 * ?S) =:=
                farther,
    ?assert(Good, {seed, ?SEED, nth, N, A, B, Distance, Sampled, Reached}),
    S2.

sampled(A, B, T1, T2, N) ->
    lists:min([{apart(T, A, B), T} || I <- lists:seq(0, N), T <- [T1 + I * (T2 - T1) div N]]).

apart(T, A, B) ->
    starl_geometry:distance(starl_trajectory:position(T, A), starl_trajectory:position(T, B)).

random_piece(S0) ->
    {X, S1} = rand:uniform_s(S0),
    {Y, S2} = rand:uniform_s(S1),
    {H, S3} = rand:uniform_s(S2),
    {Kind, S4} = rand:uniform_s(4, S3),
    {V, S5} = rand:uniform_s(S4),
    {W, S6} = rand:uniform_s(S5),
    {Speed, Turn} = motion(Kind, 600.0 * (V - 0.3), 6.0 * (W - 0.5)),
    {{piece, -300_000, 1000.0 * X, 1000.0 * Y, 7.0 * H, Speed, Turn}, S6}.

motion(1, _V, _W) -> {0.0, 0.0};
motion(2, _V, W) -> {0.0, W};
motion(3, V, _W) -> {V, 0.0};
motion(4, V, W) -> {V, W}.
