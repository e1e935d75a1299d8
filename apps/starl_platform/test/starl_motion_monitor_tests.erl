-module(starl_motion_monitor_tests).
-include_lib("eunit/include/eunit.hrl").

%% A dead-man's time of one second; with the line's latency the robot must stand at 1,005,000 us.
stands_in_time_test() ->
    ?assertEqual([], judge([velocity(0), drives(0), stands(1000000)])).

drives_on_test() ->
    ?assertEqual([{drives_beyond_its_time, 1005000}], judge([velocity(0), drives(0)])),
    ?assertEqual(
        [{drives_beyond_its_time, 1005000}], judge([velocity(0), drives(0), stands(1005001)])
    ).

turns_on_the_spot_test() ->
    Turns = {0, 1, chassis, {motion, starl_trajectory:piece(0, {0.0, 0.0}, 0.0, 0.0, 1.0)}},
    ?assertEqual([{drives_beyond_its_time, 1005000}], judge([velocity(0), Turns])).

time_is_over_test() ->
    Over = {500000, 1, motion, {velocity_over, time}},
    ?assertEqual(
        [{drives_when_time_is_over, 500000}], judge([velocity(0), drives(0), Over])
    ),
    ?assertEqual([], judge([velocity(0), drives(0), stands(400000), Over])).

another_command_test() ->
    Over = {500000, 1, motion, {velocity_over, command}},
    ?assertEqual([], judge([velocity(0), drives(0), Over])).

a_later_velocity_counts_anew_test() ->
    Again = [velocity(0), drives(0), velocity(900000), stands(1900000)],
    ?assertEqual([], judge(Again)),
    ?assertEqual(
        [{drives_beyond_its_time, 1905000}], judge([velocity(0), drives(0), velocity(900000)])
    ).

%% The second velocity has a shorter time. A chassis that hears it begins a new piece at that moment;
%% one that does not keeps to the first.
shorter_test() ->
    Shorter = {500000, 1, motion, {velocity, {100.0, 0.0}, 100000}},
    ?assertEqual([], judge([velocity(0), drives(0), Shorter, drives(900000), stands(1000000)])),
    ?assertEqual(
        [{drives_beyond_its_time, 605000}],
        judge([velocity(0), drives(0), Shorter, drives(500000), stands(1000000)])
    ).

%% A holonomic robot brakes after its time: at 500 mm/s and 2000 mm/s2 for a quarter of a second.
brakes_test() ->
    Brakes = fun(Us) ->
        Ramp = starl_trajectory:ramp(1000000, {0.0, 0.0}, 0.0, {500.0, 0.0}, {0.0, 0.0}, Us),
        {1000000, 1, chassis, {motion, Ramp}}
    end,
    Profile = starl_chassis:profile(starl_chassis_holonomic, #{}),
    ?assertEqual([], judge([velocity(0), drives(0), Brakes(250000)], Profile)),
    ?assertEqual(
        [{drives_beyond_its_time, 1255000}],
        judge([velocity(0), drives(0), Brakes(260000)], Profile)
    ).

velocity(T) -> {T, 1, motion, {velocity, {100.0, 0.0}, 1000000}}.

drives(T) -> {T, 1, chassis, {motion, starl_trajectory:piece(T, {0.0, 0.0}, 0.0, 100.0, 0.0)}}.

stands(T) -> {T, 1, chassis, {motion, starl_trajectory:standing(T, {0.0, 0.0}, 0.0)}}.

judge(Events) -> judge(Events, starl_chassis:profile(starl_chassis_differential, #{})).

judge(Events, Profile) ->
    New = starl_monitor:new([{starl_motion_monitor, #{profiles => [Profile]}}]),
    {Found, Last} = lists:foldl(fun fed/2, {[], New}, Events),
    {Late, #{starl_motion_monitor := #{velocities := N}}} = starl_monitor:finish(5000000, Last),
    ?assertEqual(length([V || {_, _, motion, {velocity, _, _}} = V <- Events]), N),
    [{What, At} || #{what := What, at_us := At} <- Found ++ Late].

fed(Event, {Found, Runner}) ->
    case starl_monitor:step(Event, Runner) of
        {ok, Next} -> {Found, Next};
        {violation, Violation, Next} -> {Found ++ [Violation], Next}
    end.
