%% The next step of a robot that drives in any direction, here on the line from (0, 0) to (1000, 0).
-module(starl_chassis_holonomic_tests).
-include_lib("eunit/include/eunit.hrl").

-define(ROUTE, {{0.0, 0.0}, {1000.0, 0.0}}).

%% A last leg is 100 mm long, the goal is reached at 39.5 mm; commands are of 80 mm/s, as the distance may err by
%% a quarter, or less: a robot that has to brake after a short way does not get faster.
profile() ->
    starl_chassis_holonomic:profile(#{
        speed => 100.0,
        acceleration => 100.0,
        leg_s => 1.0,
        heading_error => 0.1,
        distance_error => 0.25,
        position_error_mm => 2.0
    }).

%% The length of the next step, mm, and its direction on the floor, degrees.
next(Way, {X, Y}) ->
    Heading = 0.5,
    case starl_chassis_holonomic:next(Way, {X, Y, Heading}, ?ROUTE, profile()) of
        arrived ->
            arrived;
        {drive, [{Forward, Left, Us}]} ->
            Speed = math:sqrt(Forward * Forward + Left * Left),
            Mm = Speed * Us / 1.0e6,
            ?assert(abs(min(80.0, math:sqrt(100.0 * Mm)) - Speed) < 1.0e-3),
            Angle = 180 / math:pi() * (math:atan2(Left, Forward) + Heading),
            {round(10 * Mm) / 10, round(Angle)}
    end.

the_bounds_follow_from_the_profile_test() ->
    Profile = profile(),
    ?assertMatch(#{goal_mm := 39.5}, Profile),
    %% g + s + A t^2 / 2 + t V / 2 + 0.4
    Stall = 100 * 0.015 * 0.015 / 2 + 0.015 * 100 / 2 + 0.4,
    ?assertEqual(39.5 + 2.0 + Stall, starl_chassis_holonomic:tracking_radius(Profile)),
    ?assertEqual(4.0, starl_chassis_holonomic:ends_mm(Profile)),
    %% a leg of 220 mm at 80 mm/s, a correction of 43.5 mm, each with what the braking takes
    ?assertEqual(
        #{advance_mm => 61.0, leg_us => 3550001, turn_us => 0, again_us => 1343750},
        starl_chassis_holonomic:pace(Profile)
    ),
    ?assertMatch(#{advance_mm := +0.0}, starl_chassis_holonomic:pace(Profile#{goal_mm := 39.0})),
    Blurred = Profile#{goal_mm := 41.5, position_error_mm := 3.0},
    ?assertMatch(
        #{advance_mm := 59.0, again_us := 1393750}, starl_chassis_holonomic:pace(Blurred)
    ),
    ?assertMatch(#{acceleration := 2000.0}, starl_chassis_holonomic:profile(#{})),
    %% a correction is no faster than 100 mm/s
    ?assertMatch(
        #{again_us := 703750},
        starl_chassis_holonomic:pace(Profile#{speed := 500.0, acceleration := 500.0})
    ).

%% Two last legs at most; of the rest a last leg is driven in one, and of more nine tenths of one are left.
to_a_point_test_() ->
    [
        ?_assertEqual({X, Step}, {X, next(to, {X, 0.0})})
     || {X, Step} <- [
            {-20.0, {220.0, 0}},
            {-21.0, {100.0, 0}},
            {0.0, {200.0, 0}},
            {709.0, {200.0, 0}},
            {711.0, {199.0, 0}},
            {800.0, {110.0, 0}},
            {899.0, {11.0, 0}},
            {900.0, {100.0, 0}},
            {960.4, {39.6, 0}},
            {960.5, arrived},
            {1039.5, arrived},
            {1050.0, {50.0, 180}}
        ]
    ].

%% Farther than g off the line it goes straight back; what is very far it looks at again after a leg.
off_the_line_test_() ->
    [
        ?_assertEqual({Place, Step}, {Place, next(to, Place)})
     || {Place, Step} <- [
            {{500.0, 39.0}, {203.8, -11}},
            {{500.0, -39.0}, {203.8, 11}},
            {{500.0, 39.5}, {203.9, -11}},
            {{500.0, 40.0}, {40.0, -90}},
            {{500.0, -40.0}, {40.0, 90}},
            {{500.0, 219.0}, {219.0, -90}},
            {{500.0, 1.1 * 200.0}, {220.0, -90}},
            {{500.0, 221.0}, {100.0, -90}}
        ]
    ].

%% The exact end: half a millimetre beyond, and right from 1 mm before to 2 mm beyond. The last leg is of about
%% 40 mm.
along_a_line_test_() ->
    [
        ?_assertEqual({X, Step}, {X, next(along, {X, 0.0})})
     || {X, Step} <- [
            {0.0, {200.0, 0}},
            {939.0, {21.0, 0}},
            {940.0, {60.5, 0}},
            {960.4, {40.1, 0}},
            {960.5, {40.0, 0}},
            {998.9, {1.6, 0}},
            {999.0, arrived},
            {1002.0, arrived},
            {1002.1, {1.6, 180}}
        ]
    ] ++
        [
            ?_assertEqual(arrived, next(along, {1000.0, 39.5})),
            ?_assertEqual({45.0, -90}, next(along, {1000.0, 45.0}))
        ].

%% Where legs are short, so are the last ones: two thirds of another leg.
slow_robots_end_with_shorter_legs_test_() ->
    Slow = (profile())#{speed := 30.0, goal_mm := 5.0},
    [
        ?_assertEqual(
            {X, Mm},
            begin
                Pose = {X, 0.0, 0.0},
                {drive, [{V, _, Us}]} = starl_chassis_holonomic:next(along, Pose, ?ROUTE, Slow),
                {X, round(10 * V * Us / 1.0e6) / 10}
            end
        )
     || {X, Mm} <- [{965.0, 15.0}, {975.0, 25.5}]
    ].

%% Where the direction errs much, legs are shorter than twice the last: by as much as ends in the bound.
legs_are_no_longer_than_the_bound_allows_test() ->
    Leg = fun(Given) ->
        Profile = maps:merge(profile(), Given),
        {drive, [{80.0, _, Us}]} = starl_chassis_holonomic:next(
            to, {0.0, 0.0, 0.0}, ?ROUTE, Profile
        ),
        round(80 * Us / 1.0e6)
    end,
    ?assertEqual(142, Leg(#{heading_error => 0.2})),
    ?assertEqual(134, Leg(#{heading_error => 0.2, position_error_mm => 3.0})),
    ?assertEqual(200, Leg(#{heading_error => 0.0})),
    ?assertEqual(100, Leg(#{heading_error => 0.9})).

%% And the exact beginning.
the_beginning_is_faced_test_() ->
    [
        ?_assertEqual({X, Step}, {X, next(face, {X, 0.0})})
     || {X, Step} <- [
            {-39.6, {39.6, 0}},
            {-39.5, {39.0, 0}},
            {-2.1, {1.6, 0}},
            {-2.0, arrived},
            {1.0, arrived},
            {1.1, {1.6, 180}},
            {39.5, {40.0, 180}},
            {300.0, {100.0, 180}}
        ]
    ] ++
        [
            ?_assertEqual(arrived, next(face, {0.0, 39.5})),
            ?_assertEqual({45.0, -90}, next(face, {0.0, 45.0}))
        ].

%% The rest is driven slowly, however fast and however long.
the_rest_is_slow_test() ->
    Fast = (profile())#{speed := 1000.0, acceleration := 1.0e6},
    {drive, [{Forward, _, Us}]} = starl_chassis_holonomic:next(
        along, {960.5, 0.0, 0.0}, ?ROUTE, Fast
    ),
    ?assertEqual({80.0, 500000}, {Forward, Us}).

%% On a line of any direction, in the robot's own axes.
a_slanting_line_test() ->
    Line = {{100.0, 100.0}, {700.0, 900.0}},
    Next = fun(Way, Pose) -> starl_chassis_holonomic:next(Way, Pose, Line, profile()) end,
    {drive, [{Forward, Left, 2500000}]} = Next(to, {100.0, 100.0, 0.0}),
    ?assertEqual({48, 64}, {round(Forward), round(Left)}),
    {drive, [{Rest, Aside, _}]} = Next(along, {694.0, 892.0, 0.0}),
    ?assertEqual({194, 259}, {round(10 * Rest), round(10 * Aside)}),
    ?assertEqual(arrived, Next(along, {701.1, 901.5, 0.0})),
    ?assertMatch({drive, _}, Next(along, {701.3, 901.7, 0.0})),
    ?assertEqual(arrived, Next(face, {98.8, 98.4, 0.0})),
    ?assertMatch({drive, _}, Next(face, {98.7, 98.3, 0.0})).

%% A line without a length has no direction: where it begins is faced, and its end is a goal.
a_line_without_a_length_test() ->
    Next = fun(Way) ->
        starl_chassis_holonomic:next(Way, {-50.0, 0.0, 0.0}, {{0.0, 0.0}, {0.0, 0.0}}, profile())
    end,
    ?assertEqual(arrived, Next(face)),
    ?assertMatch({drive, [{_, +0.0, 707107}]}, Next(to)),
    ?assertEqual(Next(to), Next(along)).

%% Nor is a millimetre too short to have one.
a_short_line_test() ->
    Face = fun(End) ->
        starl_chassis_holonomic:next(face, {-10.0, 0.0, 0.0}, {{0.0, 0.0}, {End, 0.0}}, profile())
    end,
    ?assertMatch({drive, [_]}, Face(1.0)),
    ?assertMatch({drive, [_]}, Face(1.0e-6)),
    ?assertEqual(arrived, Face(0.9e-6)).

%% A slow drive takes as long as it has to.
a_slow_drive_test() ->
    {drive, [{Forward, _, Us}]} = starl_chassis_holonomic:next(
        to, {900.0, 0.0, 0.0}, ?ROUTE, (profile())#{speed := 1.0}
    ),
    ?assertEqual({0.8, 2500000}, {Forward, Us}).

%% It drives for a microsecond at least.
the_shortest_way_test() ->
    Still = starl_chassis_holonomic:next(
        to, {1000.0, 0.0, 0.0}, ?ROUTE, (profile())#{goal_mm := -1.0}
    ),
    ?assertMatch({drive, [{+0.0, +0.0, 1}]}, Still).
