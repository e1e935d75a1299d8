%% How long a leg is.
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
