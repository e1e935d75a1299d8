%% The next step of two wheels on the line from (0, 0) to (1000, 0): along it, exact at both ends, and to a goal.
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

%% -- to a goal ---------------------------------------------------------------------------------

%% What a robot at this point, headed for the leg's end, drives towards (1000, 0) from (0, 0), mm.
leg({X, Y} = Here, Towards) ->
    Profile = starl_chassis_differential:profile(#{speed => 500.0, leg_s => 0.3}),
    Pose = {X, Y, starl_geometry:heading(Here, Towards)},
    {drive, [{V, V, Us}]} = to(Pose, Profile),
    round(V * Us / 1.0e6).

%% Twice as long as the last one may be, as long as more than that is left.
on_the_line_test() ->
    ?assertEqual(300, leg({0.0, 0.0}, {300.0, 0.0})),
    ?assertEqual(265, leg({600.0, 0.0}, {1000.0, 0.0})),
    ?assertEqual(150, leg({750.0, 0.0}, {1000.0, 0.0})),
    ?assertEqual(80, leg({920.0, 0.0}, {1000.0, 0.0})).

%% A robot that is taken for another one may seem to be anywhere: it drives a leg, and looks again.
far_off_the_line_test() ->
    ?assertEqual(150, leg({9000.0, 5000.0}, {1000.0, 0.0})),
    ?assertEqual(150, leg({200.0, -400.0}, {500.0, 0.0})),
    ?assertEqual(316, leg({200.0, 100.0}, {500.0, 0.0})).

%% A long leg takes it no farther off than what it may be off anyway: where headings are worse,
%% legs are no longer than the last.
no_farther_off_test_() ->
    [
        ?_assertEqual(Longest, long_leg(Heading))
     || {Heading, Longest} <- [{0.0, 300}, {0.02, 300}, {0.05, 191}, {0.1, 150}]
    ].

long_leg(Heading) ->
    Profile = starl_chassis_differential:profile(#{
        speed => 500.0, leg_s => 0.3, heading_error => Heading
    }),
    Line = {{0.0, 0.0}, {5000.0, 0.0}},
    {drive, [{V, V, Us}]} =
        starl_chassis_differential:next(to, {0.0, 0.0, 0.0}, Line, Profile),
    Long = V * Us / 1.0e6,
    %% what is off at the end of the leg, as the derivation has it; durations are whole us
    Aside = Long * (Heading + 0.001 + max(0.02, Heading) / 2) + 1.0,
    ?assert(Aside =< starl_chassis_differential:tracking_radius(Profile) + 1.0e-3),
    round(Long).

%% -- the next step, of a robot with round measures on the line from (0, 0) to (1000, 0) -----------------

%% The goal is reached at 12.5 mm; a leg that is not the last may take the robot as far off as that and the stall's
%% 0.75 mm, at 0.08 mm for each mm.
to(Pose, Profile) -> starl_chassis_differential:next(to, Pose, ?ROUTE, Profile).

the_bounds_follow_from_the_profile_test() ->
    Profile = profile(),
    Radius = fun(P) -> starl_chassis_differential:tracking_radius(P) end,
    Advance = fun(P) -> maps:get(advance_mm, starl_chassis_differential:pace(P)) end,
    ?assertMatch(#{goal_mm := 12.5}, Profile),
    ?assertEqual(15.25, Radius(Profile)),
    %% less its errors of 0.13 mm for each mm, and of both positions; the slower speed counts
    ?assertEqual(39.5, Advance(Profile)),
    ?assertEqual(83.0, Advance(Profile#{near_speed := 200.0})),
    ?assertEqual(0.0, Advance(Profile#{goal_mm := 12.0})),
    ?assertEqual(37.5, Advance(Profile#{goal_mm := 14.5, position_error_mm := 3.0})),
    %% where legs err by more than the goal may be missed by
    ?assertEqual(21.0, Radius(Profile#{heading_error := 0.12})),
    %% a leg is no longer than twice the last one
    ?assertEqual(straight(100.0, 2000000), to({0.0, 0.0, 0.0}, Profile#{goal_mm := 30.0})),
    %% a turn within the error of the heading is not worth a look
    ?assertMatch({drive, [_, _]}, to({0.0, 0.0, 0.25}, Profile#{heading_error := 0.3})).

%% A small turn and the drive are one command, after a larger turn it looks; a turn that is not worth it is none.
a_turn_comes_before_the_leg_test_() ->
    On = {100.0, 100.0, 1656250},
    [
        ?_assertEqual(
            {Heading, Script}, {Heading, drives(to({0.0, 0.0, Heading}, profile()))}
        )
     || {Heading, Script} <- [
            {0.0, [On]},
            {0.01, [On]},
            {-0.01, [On]},
            {0.05, [{100.0, -100.0, 50000}, On]},
            {-0.05, [{-100.0, 100.0, 50000}, On]},
            {0.1, [{100.0, -100.0, 100000}, On]}
        ]
    ].

drives({drive, Script}) -> Script;
drives(Other) -> Other.

%% What it sees after the turn says whether it drives the leg, however long a leg from its place would be.
after_a_look_it_keeps_to_its_leg_test() ->
    Profile = profile(),
    {{look, Leg}, [{100.0, -100.0, 110000}]} = to({0.0, 0.0, 0.11}, Profile),
    On = {100.0, 100.0, 1656250},
    Turned = fun(Heading) ->
        starl_chassis_differential:resume({990.0, 0.0, Heading}, Leg, Profile)
    end,
    ?assertEqual({drive, [On]}, Turned(0.01)),
    ?assertEqual({drive, [{100.0, -100.0, 20000}, On]}, Turned(0.02)),
    ?assertEqual({{look, Leg}, [{-100.0, 100.0, 2000000}]}, Turned(-2.0)).

%% The last two legs share the rest; a leg ends where the speed changes; one at the goal is none.
legs_end_where_they_should_test_() ->
    Far = profile(),
    Near = Far#{near_mm := 300.0},
    [
        ?_assertEqual({X, Step}, {X, to({X, 0.0, 0.0}, Profile)})
     || {Profile, X, Step} <- [
            {Far, 834.0, straight(100.0, 1000000)},
            {Far, 900.0, straight(100.0, 1000000)},
            {Far, 980.0, straight(100.0, 200000)},
            {Far, 987.4, straight(100.0, 126000)},
            {Far, 987.5, arrived},
            {Far, 1010.0, arrived},
            {Near, 0.0, straight(100.0, 1656250)},
            {Near, 600.0, straight(100.0, 1000000)},
            {Near, 650.0, straight(100.0, 500000)},
            %% at least a millimetre
            {Near, 699.5, straight(100.0, 10000)},
            {Near, 700.0, straight(50.0, 1656250)},
            {Near, 950.0, straight(50.0, 1000000)}
        ]
    ].

%% Near the goal it turns more slowly, too.
turns_near_the_goal_are_slower_test() ->
    ?assertEqual(
        {drive, [{50.0, -50.0, 100000}, {50.0, 50.0, 400000}]},
        to({980.0, 0.0, 0.05}, (profile())#{near_mm := 300.0})
    ).

%% From farther than a tenth more than the longest leg it looks again after a last leg.
the_farthest_leg_test() ->
    Towards = fun(Mm) ->
        starl_chassis_differential:next(face, {-Mm, 0.0, 0.0}, ?ROUTE, profile())
    end,
    Farthest = 1.1 * 1.65625 * 100.0,
    ?assertEqual(straight(100.0, 1656250), Towards(Farthest)),
    ?assertEqual(straight(100.0, 1000000), Towards(Farthest + 0.1)).

%% The measures of a Create: near the goal no other than far from it.
the_usual_profile_test() ->
    ?assertMatch(
        #{near_speed := 500.0, near_turn_rate := 3.0, near_mm := +0.0},
        starl_chassis_differential:profile(#{})
    ).

%% A line without a length is its end.
a_goal_where_its_line_begins_test() ->
    Line = {{0.0, 0.0}, {0.0, 0.0}},
    Next = fun(Pose) -> starl_chassis_differential:next(to, Pose, Line, profile()) end,
    ?assertEqual(arrived, Next({12.5, 0.0, 0.0})),
    ?assertEqual(straight(100.0, 400000), Next({-40.0, 0.0, 0.0})).
