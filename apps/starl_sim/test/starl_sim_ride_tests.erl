%% What a vehicle does as plans and facts, in a square of 4 m with solid walls.
-module(starl_sim_ride_tests).
-include_lib("eunit/include/eunit.hrl").

-define(OWNER, {motion, m}).

a_script_for_another_chassis_is_told_and_changes_nothing_test() ->
    Vehicle = vehicle({2000.0, 2000.0, 0.0}),
    ?assertEqual(
        {same, [], [{not_understood, [x]}], Vehicle},
        starl_sim_ride:drive({other, [x]}, ?OWNER, Vehicle, place(0))
    ).

what_drives_has_its_next_touch_planned_test() ->
    {moved, Plans, Facts, Driving} = drive(vehicle({2000.0, 2000.0, 0.0})),
    Piece = starl_sim_vehicle:piece(Driving),
    ?assertEqual([{motion, Piece}], Facts),
    ?assertMatch([{_, {look, Piece}} | _], Plans).

what_stands_at_a_wall_is_blocked_and_feels_it_in_front_test() ->
    {moved, Plans, Facts, Blocked} = drive(at_wall()),
    ?assert(starl_trajectory:is_still(starl_sim_vehicle:piece(Blocked))),
    ?assertMatch([{motion, _}, {sensed, {bump, both}}], Facts),
    %% the chassis streams its sensors every 15 ms
    ?assertMatch({15000, {app, info, {sensed, {bump, both}}}}, lists:last(Plans)),
    Script = {starl_chassis_differential, [{100.0, 100.0, 60000000}]},
    {moved, Later, _, _} = starl_sim_ride:drive(Script, ?OWNER, at_wall(), place(29999)),
    ?assertMatch({1, {app, info, {sensed, {bump, both}}}}, lists:last(Later)).

a_touch_of_an_earlier_motion_is_void_test() ->
    {moved, _, _, Driving} = drive(vehicle({2000.0, 2000.0, 0.0})),
    Earlier = starl_trajectory:standing(0, {2000.0, 2000.0}, 0.0),
    Now = starl_sim_vehicle:piece(Driving),
    ?assertEqual({same, [], [], Driving}, touched({touch, Earlier, {wall, 1}}, Driving)),
    ?assertMatch({moved, _, [{motion, _}, _], _}, touched({touch, Now, {wall, 1}}, Driving)).

a_look_again_tells_no_motion_test() ->
    {moved, _, _, Driving} = drive(vehicle({2000.0, 2000.0, 0.0})),
    Piece = starl_sim_vehicle:piece(Driving),
    ?assertMatch({moved, [{_, {look, Piece}}], [], Driving}, touched({look, Piece}, Driving)).

an_actuator_tells_what_was_set_test() ->
    ?assertMatch(
        {same, [{_, {motion, info, {actuated, m, pen, down}}}], [{actuated, pen, down}], _},
        starl_sim_ride:actuate({pen, down}, ?OWNER, vehicle({2000.0, 2000.0, 0.0}), place(0))
    ).

the_robot_itself_is_seen_as_of_now_test() ->
    {Seen, _} = starl_sim_ride:sense([1, 2], 1, {300, 100}, vehicle({2000.0, 2000.0, 0.0})),
    ?assertMatch([{1, _, 0}, {2, _, 200}], Seen).

touched(Touch, Vehicle) -> starl_sim_ride:step(Touch, Vehicle, place(1000)).

drive(Vehicle) ->
    Script = {starl_chassis_differential, [{100.0, 100.0, 60000000}]},
    starl_sim_ride:drive(Script, ?OWNER, Vehicle, place(0)).

at_wall() ->
    Radius = starl_chassis:radius_mm(hd(maps:get(profiles, world()))),
    vehicle({4000.0 - Radius, 2000.0, 0.0}).

vehicle(Pose) -> starl_sim_vehicle:new(1, Pose, world()).

place(Now) -> {1, Now, Now + 1000, world()}.

world() ->
    Other = starl_trajectory:standing(0, {500.0, 500.0}, 0.0),
    #{
        seed => 1,
        team => starl_team:new([1, 2]),
        profiles => [starl_chassis:profile(starl_chassis_differential, #{})],
        location => [],
        actuation => [],
        walls => starl_walls:new(starl_floor:empty({4000, 4000})),
        sight => starl_sim_sight:new([{2, Other}], infinity)
    }.
