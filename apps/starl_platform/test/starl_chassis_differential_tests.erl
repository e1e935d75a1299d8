%% The next step of two wheels along a given line, here from (0, 0) to (1000, 0): exact at both ends.
-module(starl_chassis_differential_tests).
-include_lib("eunit/include/eunit.hrl").

-define(ROUTE, {{0.0, 0.0}, {1000.0, 0.0}}).

%% A goal is reached at 12.5 mm; a place at an end of the line is right from 1 mm within to 2 mm beyond, and it aims
%% at 0.5 mm beyond.
profile() -> starl_platform_ct:two_wheels().

along(Pose) -> starl_chassis_differential:next(along, Pose, ?ROUTE, profile()).

face(Pose) -> starl_chassis_differential:next(face, Pose, ?ROUTE, profile()).

straight(Speed, Us) -> {drive, [{Speed, Speed, Us}]}.

turn(Wheel, Us) -> {drive, [{-Wheel, Wheel, Us}]}.

%% A leg as usual; one that leaves 40 mm for the last, from 60 mm on the last, half a millimetre beyond the end.
a_line_ends_with_a_short_leg_test_() ->
    [
        ?_assertEqual({X, Step}, {X, along({X, 0.0, 0.0})})
     || {X, Step} <- [
            {0.0, straight(100.0, 1656250)},
            {-50.0, straight(100.0, 1000000)},
            {939.0, straight(100.0, 210000)},
            {940.0, straight(100.0, 605000)},
            {950.0, straight(100.0, 505000)},
            {987.4, straight(100.0, 131000)}
        ]
    ].

%% At the end it drives on to the right place, or back, without a turn.
the_end_is_reached_exactly_test_() ->
    [
        ?_assertEqual({X, Step}, {X, along({X, 0.0, 0.0})})
     || {X, Step} <- [
            {987.5, straight(100.0, 130000)},
            {998.9, straight(100.0, 16000)},
            {999.0, arrived},
            {1000.0, arrived},
            {1002.0, arrived},
            {1002.1, straight(-100.0, 16000)},
            {1012.5, straight(-100.0, 120000)}
        ]
    ] ++
        [
            ?_assertEqual(arrived, along({1000.0, 12.5, 0.0})),
            ?_assertMatch({{look, _}, _}, along({1000.0, 13.0, 0.0}))
        ].

%% Where legs are short, so are the last ones: two thirds of another leg.
slow_robots_end_with_shorter_legs_test_() ->
    [
        ?_assertEqual(
            {X, straight(30.0, Us)},
            {X,
                starl_chassis_differential:next(
                    along,
                    {X, 0.0, 0.0},
                    ?ROUTE,
                    (profile())#{speed := 30.0}
                )}
        )
     || {X, Us} <- [{965.0, 500000}, {975.0, 850000}]
    ].

%% ... if it looks along the line, or against it, to 0.2 rad; slowly, however fast it may be.
it_turns_at_the_end_if_it_looks_aside_test_() ->
    [
        ?_assertEqual({Heading, Step}, {Heading, along({998.0, 0.0, Heading})})
     || {Heading, Step} <- [
            {0.2, straight(100.0, 25000)},
            {-0.2, straight(100.0, 25000)},
            {0.21, turn(-100.0, 210000)},
            {-0.21, turn(100.0, 210000)},
            {3.0, straight(-100.0, 25000)},
            {-3.0, straight(-100.0, 25000)},
            {2.9, turn(-100.0, 2900000)}
        ]
    ] ++
        [
            ?_assertEqual(
                straight(Slow, Us),
                starl_chassis_differential:next(along, {998.0, 0.0, 0.0}, ?ROUTE, (profile())#{
                    speed := Speed
                })
            )
         || {Speed, Slow, Us} <- [{500.0, 100.0, 25000}, {50.0, 50.0, 50000}]
        ] ++
        [
            ?_assertEqual(
                straight(-100.0, 25000),
                starl_chassis_differential:next(along, {998.0, 0.0, 3.0}, ?ROUTE, (profile())#{
                    speed := 500.0
                })
            )
        ].

%% Near the end it drives parallel to the line, to the end from farther off, and far off back to the line by
%% a leg. It looks after each turn.
off_the_line_test_() ->
    [
        ?_assertEqual({X, Y, Mrad, Mm}, looks(X, Y))
     || {X, Y, Mrad, Mm} <- [
            %% at the point 50.5 mm ahead on the line
            {950.0, 10.0, -195, 51.48},
            {950.0, -19.9, 375, 54.28},
            %% at the end
            {950.0, 20.0, -381, 53.85},
            {950.0, -20.0, 381, 53.85},
            %% at the point a long leg ahead, at which it looks again
            {500.0, 100.0, -543, 100.0},
            {500.0, 20.0, -120, 165.63},
            {980.0, 300.0, -1571, 100.0},
            %% before the beginning, from which it is a long leg
            {-10.0, 30.0, -169, 165.63},
            %% beside the end, and beyond it
            {1000.0, 15.0, -359, 0.53},
            {1000.5, 15.0, -1604, 15.01},
            {1012.6, 0.0, 3142, 12.6}
        ]
    ].

looks(X, Y) ->
    {{look, Leg}, [{_, Wheel, Us}]} = along({X, Y, 0.0}),
    {Heading, Mm, 100.0, 1.0} = Leg,
    ?assertEqual(round(1000 * Heading), round(10 * Wheel * Us / 1.0e6)),
    {X, Y, round(1000 * Heading), round(100 * Mm) / 100}.

%% It stands at the beginning, half a millimetre before it, and looks along the line; from far off it drives there.
the_beginning_is_faced_test_() ->
    [
        ?_assertEqual({Pose, Step}, {Pose, face(Pose)})
     || {Pose, Step} <- [
            {{-25.1, 0.0, 0.0}, straight(100.0, 251000)},
            {{-25.0, 0.0, 0.0}, straight(100.0, 245000)},
            {{-2.1, 0.0, 0.0}, straight(100.0, 16000)},
            {{-2.0, 0.0, 0.0}, arrived},
            {{1.0, 0.0, 0.0}, arrived},
            {{1.0, 9.0, 0.1}, arrived},
            {{1.1, 0.0, 0.0}, straight(-100.0, 16000)},
            {{5.0, 3.0, -0.1}, straight(-100.0, 55000)},
            {{1.0, 0.0, 0.11}, turn(-100.0, 110000)},
            {{5.0, 0.0, -3.14}, turn(100.0, 3140000)}
        ]
    ].

%% On a line of any direction, half a millimetre beyond its end.
a_slanting_line_test() ->
    Line = {{100.0, 100.0}, {700.0, 900.0}},
    Heading = math:atan2(800.0, 600.0),
    {drive, [{100.0, 100.0, Us}]} = starl_chassis_differential:next(
        along,
        {670.0, 860.0, Heading},
        Line,
        profile()
    ),
    ?assertEqual(505, round(Us / 1000)),
    ?assertEqual(
        arrived, starl_chassis_differential:next(along, {701.1, 901.5, 0.0}, Line, profile())
    ),
    ?assertMatch(
        {drive, _}, starl_chassis_differential:next(along, {701.3, 901.7, 0.0}, Line, profile())
    ),
    ?assertEqual(
        arrived, starl_chassis_differential:next(face, {98.8, 98.4, Heading}, Line, profile())
    ),
    ?assertMatch(
        {drive, _}, starl_chassis_differential:next(face, {98.7, 98.3, Heading}, Line, profile())
    ).

%% Nor is a millimetre too short to have a direction.
a_short_line_test() ->
    Face = fun(End) ->
        starl_chassis_differential:next(face, {0.0, 0.0, 1.0}, {{0.0, 0.0}, {End, 0.0}}, profile())
    end,
    ?assertEqual(turn(-100.0, 1000000), Face(1.0)),
    ?assertEqual(turn(-100.0, 1000000), Face(1.0e-6)),
    ?assertEqual(arrived, Face(0.9e-6)).

%% A line without a length has no direction: where it begins is faced, and its end is a goal.
a_line_without_a_length_test() ->
    Line = {{0.0, 0.0}, {0.0, 0.0}},
    ?assertEqual(arrived, starl_chassis_differential:next(face, {50.0, 0.0, 0.0}, Line, profile())),
    ?assertEqual(
        straight(100.0, 500000),
        starl_chassis_differential:next(along, {-50.0, 0.0, 0.0}, Line, profile())
    ).

%% A leg is a turn from r(v) off the line, and 1.1 times the longest drive; a correction is the goal's distance,
%% with both errors, and the turn of 0.2 rad.
its_pace_test() ->
    Slant = 2 * 15.25 / 40.0 + 0.04,
    Leg = 1.1 * 165.625 / 50.0 + Slant / 0.5,
    ?assertEqual(
        #{
            advance_mm => 39.5,
            leg_us => ceil(1.0e6 * Leg),
            turn_us => 6283186,
            again_us => 730000
        },
        starl_chassis_differential:pace(profile())
    ),
    ?assertMatch(
        #{again_us := 365000},
        starl_chassis_differential:pace((profile())#{
            near_speed := 500.0, speed := 500.0, near_turn_rate := 1.0
        })
    ),
    ?assertMatch(
        #{again_us := 770000},
        starl_chassis_differential:pace((profile())#{position_error_mm := 3.0})
    ).
