%% How long a leg is.
-module(starl_motion_course_tests).
-include_lib("eunit/include/eunit.hrl").

%% What a robot at this point, headed for the leg's end, drives towards (1000, 0) from (0, 0), mm.
leg({X, Y} = Here, Towards) ->
    Profile = starl_motion_course:profile(#{speed => 500.0, leg_s => 0.3}),
    Pose = {X, Y, starl_geometry:heading(Here, Towards)},
    {drive, [{V, V, Us}]} =
        starl_motion_course:next(Pose, {{0.0, 0.0}, {1000.0, 0.0}}, Profile),
    round(V * Us / 1.0e6).

on_the_line_test() ->
    ?assertEqual(150, leg({0.0, 0.0}, {150.0, 0.0})),
    ?assertEqual(80, leg({920.0, 0.0}, {1000.0, 0.0})).

%% A robot that is taken for another one may seem to be anywhere: it drives a leg, and looks again.
far_off_the_line_test() ->
    ?assertEqual(150, leg({9000.0, 5000.0}, {1000.0, 0.0})),
    ?assertEqual(150, leg({200.0, -400.0}, {350.0, 0.0})),
    ?assertEqual(250, leg({200.0, 200.0}, {350.0, 0.0})).
