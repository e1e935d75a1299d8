%% The next step on a line: how long a leg is, what turn comes before it, and whether a look comes between.
-module(starl_differential_course_tests).
-include_lib("eunit/include/eunit.hrl").

%% What a robot at this point, headed for the leg's end, drives towards (1000, 0) from (0, 0), mm.
leg({X, Y} = Here, Towards) ->
    Profile = starl_differential_course:profile(#{speed => 500.0, leg_s => 0.3}),
    Pose = {X, Y, starl_geometry:heading(Here, Towards)},
    {drive, [{V, V, Us}]} =
        starl_differential_course:next(Pose, {{0.0, 0.0}, {1000.0, 0.0}}, Profile),
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
    Profile = starl_differential_course:profile(#{
        speed => 500.0, leg_s => 0.3, heading_error => Heading
    }),
    Line = {{0.0, 0.0}, {5000.0, 0.0}},
    {drive, [{V, V, Us}]} = starl_differential_course:next({0.0, 0.0, 0.0}, Line, Profile),
    Long = V * Us / 1.0e6,
    %% what is off at the end of the leg, as the derivation has it; durations are whole us
    Aside = Long * (Heading + 0.001 + max(0.02, Heading) / 2) + 1.0,
    ?assert(Aside =< starl_differential_course:tracking_radius(Profile) + 1.0e-3),
    round(Long).

%% -- the next step, of a robot with round measures on the line from (0, 0) to (1000, 0) -----------------

%% The goal is reached at 12.5 mm; a leg that is not the last may take the robot as far off as that and the stall's
%% 0.75 mm, at 0.08 mm for each mm.
round_profile() -> starl_platform_ct:two_wheels().

next(Pose, Profile) ->
    starl_differential_course:next(Pose, {{0.0, 0.0}, {1000.0, 0.0}}, Profile).

the_bounds_follow_from_the_profile_test() ->
    Profile = round_profile(),
    ?assertMatch(#{goal_mm := 12.5}, Profile),
    ?assertEqual(15.25, starl_differential_course:tracking_radius(Profile)),
    ?assertEqual(165.625, starl_differential_course:longest_mm(Profile)),
    ?assertEqual(100.0, starl_differential_course:last_mm(Profile)),
    ?assertEqual(0.1, starl_differential_course:look_from(Profile)),
    ?assertEqual(0.3, starl_differential_course:look_from(Profile#{heading_error := 0.3})),
    %% less its errors of 0.13 mm for each mm, and of both positions; the slower speed counts
    ?assertEqual(39.5, starl_differential_course:advance_mm(Profile)),
    ?assertEqual(83.0, starl_differential_course:advance_mm(Profile#{near_speed := 200.0})),
    ?assertEqual(0.0, starl_differential_course:advance_mm(Profile#{goal_mm := 12.0})),
    Blurred = Profile#{goal_mm := 14.5, position_error_mm := 3.0},
    ?assertEqual(37.5, starl_differential_course:advance_mm(Blurred)),
    %% where legs err by more than the goal may be missed by
    ?assertEqual(21.0, starl_differential_course:tracking_radius(Profile#{heading_error := 0.12})),
    %% no longer than twice the last one
    ?assertEqual(200.0, starl_differential_course:longest_mm(Profile#{goal_mm := 30.0})).

%% A small turn and the drive are one command, after a larger turn it looks; a turn that is not worth it is none.
a_turn_comes_before_the_leg_test_() ->
    On = {100.0, 100.0, 1656250},
    [
        ?_assertEqual(
            {Heading, Script}, {Heading, drives(next({0.0, 0.0, Heading}, round_profile()))}
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
    Profile = round_profile(),
    {{look, Leg}, [{100.0, -100.0, 110000}]} = next({0.0, 0.0, 0.11}, Profile),
    On = {100.0, 100.0, 1656250},
    Turned = fun(Heading) ->
        starl_differential_course:turned({990.0, 0.0, Heading}, Leg, Profile)
    end,
    ?assertEqual({drive, [On]}, Turned(0.01)),
    ?assertEqual({drive, [{100.0, -100.0, 20000}, On]}, Turned(0.02)),
    ?assertEqual({{look, Leg}, [{-100.0, 100.0, 2000000}]}, Turned(-2.0)).

%% The last two legs share the rest; a leg ends where the speed changes; one at the goal is none.
legs_end_where_they_should_test_() ->
    Far = round_profile(),
    Near = Far#{near_mm := 300.0},
    [
        ?_assertEqual({X, Step}, {X, next({X, 0.0, 0.0}, Profile)})
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

straight(Speed, Us) -> {drive, [{Speed, Speed, Us}]}.

%% Near the goal it turns more slowly, too.
turns_near_the_goal_are_slower_test() ->
    ?assertEqual(
        {drive, [{50.0, -50.0, 100000}, {50.0, 50.0, 400000}]},
        next({980.0, 0.0, 0.05}, (round_profile())#{near_mm := 300.0})
    ).

%% From farther than a tenth more than the longest leg it looks again after a last leg.
the_farthest_leg_test() ->
    Towards = fun(Mm) ->
        Pose = {0.0, 0.0, 0.0},
        starl_differential_course:towards(Pose, {500.0, 0.0}, Mm, 1000.0, round_profile())
    end,
    Farthest = 1.1 * 1.65625 * 100.0,
    ?assertEqual(straight(100.0, 1656250), Towards(Farthest)),
    ?assertEqual(straight(100.0, 1000000), Towards(Farthest + 0.1)).

%% The measures of a Create: near the goal no other than far from it.
the_usual_profile_test() ->
    ?assertMatch(
        #{near_speed := 500.0, near_turn_rate := 3.0, near_mm := +0.0},
        starl_differential_course:profile(#{})
    ).

%% A line without a length is its end.
a_line_without_a_length_test() ->
    Line = {{0.0, 0.0}, {0.0, 0.0}},
    Next = fun(Pose) -> starl_differential_course:next(Pose, Line, round_profile()) end,
    ?assertEqual(arrived, Next({12.5, 0.0, 0.0})),
    ?assertEqual(straight(100.0, 400000), Next({-40.0, 0.0, 0.0})).

%% What is too short for a clock takes a microsecond.
the_shortest_drive_test() ->
    ?assertEqual(straight(100.0, 1), starl_differential_course:straight(0.0, 100.0)),
    ?assertEqual(
        {drive, [{-100.0, -100.0, 20000}]}, starl_differential_course:straight(-2.0, 100.0)
    ),
    ?assertEqual(
        {drive, [{100.0, -100.0, 1500000}]}, starl_differential_course:turn(-1.5, round_profile())
    ).
