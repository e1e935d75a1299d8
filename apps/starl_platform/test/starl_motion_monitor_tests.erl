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

%% At the end of its time itself it may drive still, and whoever stands then stands in time.
at_the_end_of_its_time_it_may_drive_test() ->
    Drives = [velocity(0), drives(0)],
    ?assertEqual([], judge(Drives, differential(), #{}, 1005000)),
    ?assertEqual(
        [{drives_beyond_its_time, 1005000}], judge(Drives, differential(), #{}, 1005001)
    ),
    %% another robot's time is over before: all are looked at
    Other = [setelement(2, velocity(-1), 2), setelement(2, stands(0), 2)],
    ?assertEqual([], judge(Other ++ Drives ++ [stands(1005000)])).

%% An event may show two violations: that of another robot's time, and its own.
two_robots_are_late_test() ->
    Late = [{T, 2, M, E} || {T, 1, M, E} <- [velocity(500000), drives(500000)]],
    Over = {1400000, 2, motion, {velocity_over, time}},
    ?assertEqual(
        [{drives_beyond_its_time, 1005000}], judge([velocity(0), drives(0)] ++ Late ++ [Over])
    ).

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

%% Where the robot stands still in the middle of the step, the command leaves when it goes on, if that is no
%% later than half a second. No other fault has the command leave later.
%% Holds: No fault but a computer that stands still lets a velocity leave later, and not later than
%% the robot goes on
%% Red: 1b63aeb: half a second for any fault
stands_still_before_it_leaves_test() ->
    Judge = fun(From, To, Broken) ->
        Still = #{bodies => [{1, From, To, Broken}]},
        judge([velocity(1000000), drives(1400000)], differential(), Still)
    end,
    [
        ?assertEqual([{drives_beyond_its_time, Us}], Judge(From, To, Broken))
     || Broken <- [still, pause],
        {From, To, Us} <- [
            {900000, 1400000, 2405000},
            {900000, 9000000, 2505000},
            {1500000, 1900000, 2005000}
        ]
    ],
    ?assertEqual([{drives_beyond_its_time, 2005000}], Judge(900000, 1400000, fault)).

%% A robot that drives to a goal three metres off is on its line, or at most r(v) off it.
%% Holds: A robot that drives to a goal keeps within r(v) of its line, and arrives, in every run
%% Red: d018c00, run: such runs are judged by nobody
near_its_line_test() ->
    Mm = starl_chassis:tracking_radius(differential()),
    ?assertEqual([], judge(drive([{0.0, 0.0}, {1000.0, Mm}, {3000.0, 0.0}]))),
    ?assertEqual(
        [{off_line, 2000000}], judge(drive([{0.0, 0.0}, {1000.0, Mm + 0.1}, {3000.0, 0.0}]))
    ).

%% What it has driven since its last event counts, too.
near_its_line_until_the_end_test() ->
    Drives = lists:droplast(drive([{0.0, 0.0}, {1000.0, 100.0}])),
    ?assertMatch([{off_line, 2999999}], judge(Drives, differential(), #{}, 2999999)).

%% So it is when its program has crashed meanwhile.
near_its_line_without_a_program_test() ->
    [Stands, Goal, Line | Moves] = drive([{0.0, 0.0}, {1000.0, 50.0}]),
    Crash = {1, 1, motion, crashed},
    ?assertMatch([{off_line, _}], judge([Stands, Goal, Line, Crash | Moves])).

%% One that bumps is held to no line that it has begun until half a second later.
bumped_off_its_line_test() ->
    [Stands, Goal, Line | Moves] = drive([{0.0, 0.0}, {1000.0, 50.0}]),
    Bump = fun(At) -> {At, 1, chassis, {sensed, {bump, left}}} end,
    ?assertEqual([], judge([Stands, Goal, Line, Bump(1) | Moves])),
    ?assertEqual([], judge([Stands, Bump(-499999), Goal, Line | Moves])),
    ?assertMatch([{off_line, _}], judge([Stands, Bump(-500000), Goal, Line | Moves])).

%% A robot that is told to drive along a line that it is not on is held to none; nor is one that sees
%% the place of another, nor one that drives with a velocity meanwhile.
held_to_its_own_line_test() ->
    Off = drive([{0.0, 0.0}, {1000.0, 50.0}, {3000.0, 0.0}]),
    Other = {0, 1, motion, {line, {{0.0, 500.0}, {3000.0, 500.0}}}},
    Own = {line, {{0.0, 0.0}, {3000.0, 0.0}}},
    ?assertEqual([], judge(lists:keyreplace(Own, 4, Off, Other))),
    Elsewhere = fun(Robot, From, To) -> #{bodies => [{Robot, From, To, position}]} end,
    ?assertEqual([], judge(Off, differential(), Elsewhere(1, 1000000, 1500000))),
    %% where the line begins was seen before it did
    ?assertEqual([], judge(Off, differential(), Elsewhere(1, -900000, -400000))),
    [
        ?assertMatch([{off_line, _}], judge(Off, differential(), Excuse))
     || Excuse <- [
            Elsewhere(2, 0, 9000000),
            Elsewhere(1, 3000000, 4000000),
            Elsewhere(1, -900000, -500000)
        ]
    ],
    [Stands, Goal, Line | Moves] = Off,
    Cruise = {0, 1, motion, {velocity, {100.0, 0.0}, 9000000}},
    ?assertEqual([], judge([Stands, Goal, Line, Cruise | Moves])).

%% By its chassis a drive of three metres takes so long at most; a robot that is paused begins anew.
arrives_test() ->
    Within = starl_chassis:arrives_us(3000.0, 65000, differential()) + 1500000,
    [_Stands, Goal, Line | _] = drive([{0.0, 0.0}]),
    ?assertEqual([{not_arrived, Within}], late([Goal, Line])),
    [
        ?assertEqual([], late([Goal, Line, {Within, 1, motion, End}]))
     || End <- [crashed, {goal_over, arrived}, {goal_over, command}]
    ],
    ?assertEqual([], late([Goal, Line, {Within, 1, robot, down}])),
    Pause = [{1, 1000000, 5000000, fault}],
    ?assertEqual([{not_arrived, 5000000 + Within}], late([Goal], #{bodies => Pause})),
    ?assertEqual([{not_arrived, Within}], late([Goal], #{bodies => [{2, 0, 9000000, fault}]})),
    ?assertEqual(
        [{not_arrived, Within}], late([Goal], #{bodies => [{1, 2 * Within, 3 * Within, fault}]})
    ),
    %% once
    Later = [stands(Within + N) || N <- [1, 2]],
    ?assertEqual([{not_arrived, Within}], late([Goal | Later])),
    %% it may have been anywhere
    ?assertEqual([], late([Goal], #{bodies => [{1, 0, 9, position}]})).

%% A fault that is known only when it has happened.
a_pause_by_hand_excuses_test() ->
    Within = starl_chassis:arrives_us(3000.0, 65000, differential()) + 1500000,
    New = starl_monitor:new([{starl_motion_monitor, #{profiles => [differential()]}}]),
    {ok, Told} = starl_monitor:step(drive([{0.0, 0.0}]), New),
    Paused = starl_monitor:broken({1, 0, 7000000, pause}, Told),
    ?assertMatch({[], _}, starl_monitor:finish(7000000 + Within, Paused)),
    ?assertMatch({[#{what := not_arrived}], _}, starl_monitor:finish(7000001 + Within, Paused)).

%% A fault of another robot that is known then excuses no arrival that is late.
a_fault_of_another_robot_excuses_nothing_test() ->
    Within = starl_chassis:arrives_us(3000.0, 65000, differential()) + 1500000,
    New = starl_monitor:new([{starl_motion_monitor, #{profiles => [differential()]}}]),
    {ok, Told} = starl_monitor:step(drive([{0.0, 0.0}]), New),
    Known = starl_monitor:broken({2, 0, 9, pause}, Told),
    Arrives = fun(At) -> starl_monitor:step({At, 1, motion, {goal_over, arrived}}, Known) end,
    ?assertMatch({ok, _}, Arrives(Within)),
    ?assertMatch({violation, #{what := not_arrived}, _}, Arrives(Within + 1)).

%% A soak is owed each event of motion, as the platform knows them, and what is counted beside them.
it_owes_each_event_of_motion_and_counts_what_else_it_owes_test() ->
    #{motion := Events, actuator := OfEveryMachine} = starl_event:platform(),
    ?assertEqual(#{motion => Events -- OfEveryMachine}, starl_motion_monitor:vocabulary()),
    {ok, #{sometimes := Counted}} = starl_motion_monitor:finish(
        0, starl_motion_monitor:init(#{profiles => [differential()]})
    ),
    ?assertEqual(
        lists:sort(maps:keys(Counted)),
        lists:sort([Name || {Name, _} <- starl_motion_monitor:sometimes()])
    ).

%% Where the bounds of its errors tell nothing, no time is told.
unbound_test() ->
    Blind = starl_chassis:profile(starl_chassis_differential, #{position_error_mm => 500.0}),
    ?assertEqual(never, starl_chassis:arrives_us(1000.0, 0, Blind)),
    ?assertEqual([], judge(drive([{0.0, 0.0}]), Blind)).

%% Stands at the first of these points, a second until the next one, and so on.
drive([From | Points]) ->
    Goal = {3000.0, 0.0},
    {Moves, _} = lists:mapfoldl(
        fun(To, {At, {N, A}}) ->
            {{At, 1, chassis, {motion, straight(At, A, To)}}, {At + 1000000, {N + 1, To}}}
        end,
        {1000000, {1, From}},
        Points
    ),
    [
        {0, 1, chassis, {motion, starl_trajectory:standing(0, From, 0.0)}},
        {0, 1, motion, {goal, to, Goal}},
        {0, 1, motion, {line, {From, Goal}}}
    ] ++ Moves ++ [stands(1000000 * (1 + length(Points)))].

straight(At, From, To) ->
    Mm = starl_geometry:distance(From, To),
    starl_trajectory:piece(At, From, starl_geometry:heading(From, To), Mm, 0.0).

differential() -> starl_chassis:profile(starl_chassis_differential, #{}).

velocity(T) -> {T, 1, motion, {velocity, {100.0, 0.0}, 1000000}}.

drives(T) -> {T, 1, chassis, {motion, starl_trajectory:piece(T, {0.0, 0.0}, 0.0, 100.0, 0.0)}}.

stands(T) -> {T, 1, chassis, {motion, starl_trajectory:standing(T, {0.0, 0.0}, 0.0)}}.

judge(Events) -> judge(Events, differential()).

judge(Events, Profile) -> judge(Events, Profile, #{}).

judge(Events, Profile, Facts) -> judge(Events, Profile, Facts, 5000000).

late(Events) -> late(Events, #{}).

late(Events, Facts) ->
    Stands = {0, 1, chassis, {motion, starl_trajectory:standing(0, {0.0, 0.0}, 0.0)}},
    judge([Stands | Events], differential(), Facts, 1000000000).

judge(Events, Profile, Facts, EndUs) ->
    New = starl_monitor:new([{starl_motion_monitor, Facts#{profiles => [Profile]}}]),
    {Found, Last} = lists:foldl(fun fed/2, {[], New}, Events),
    {Late, #{starl_motion_monitor := #{velocities := N}}} = starl_monitor:finish(EndUs, Last),
    ?assertEqual(length([V || {_, _, motion, {velocity, _, _}} = V <- Events]), N),
    [{What, At} || #{what := What, at_us := At} <- Found ++ Late].

fed(Event, {Found, Runner}) ->
    case starl_monitor:step(Event, Runner) of
        {ok, Next} -> {Found, Next};
        {violation, Violation, Next} -> {Found ++ [Violation], Next}
    end.
