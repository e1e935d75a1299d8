%% The chassis that ship, by their callbacks: which commands they take, how long these last, how a command that
%% was not obeyed is tried, and what their profiles promise; and the choice of chassis by names.
-module(starl_chassis_tests).
-include_lib("eunit/include/eunit.hrl").

%% This module is a chassis whose pace the test says.
-export([pace/1]).

-define(WHEELS, starl_chassis_differential).
-define(HOLONOMIC, starl_chassis_holonomic).
-define(KINDS, [?WHEELS, ?HOLONOMIC]).

pace(#{pace := Pace}) -> Pace.

%% -- commands ----------------------------------------------------------------------------------------

%% Speeds of at most 1000 m/s in whatever direction, and a whole number of microseconds from 1.
only_commands_within_the_limits_are_taken_test_() ->
    Right = [{0, 0, 1}, {1.0e6, -1.0e6, 1}, {-1.0e6, 1.0e6, 1 bsl 50}],
    Wrong = [
        {1000000.5, 0, 1},
        {-1000000.5, 0, 1},
        {0, 1000000.5, 1},
        {0, -1000000.5, 1},
        {fast, 0, 1},
        {0, fast, 1},
        {0, 0, 0},
        {0, 0, 1.0},
        {0, 0, (1 bsl 50) + 1},
        {0, 0},
        stop
    ],
    [
        ?_assertEqual(ok, starl_chassis:check({Kind, Script}))
     || Kind <- ?KINDS, Script <- [[], Right]
    ] ++
        [
            ?_assertMatch({error, "[{" ++ _}, starl_chassis:check({Kind, Before ++ [One]}))
         || Kind <- ?KINDS, One <- Wrong, Before <- [[], Right]
        ] ++
        [?_assertMatch({error, "[{" ++ _}, starl_chassis:check({Kind, stop})) || Kind <- ?KINDS].

%% A script names a module that is a chassis.
a_script_names_its_chassis_test_() ->
    [
        ?_assertMatch({error, "{Chassis, Commands}" ++ _}, starl_chassis:check(Script))
     || Script <- [{lists, []}, {starl_no_such_chassis, []}, {"wheels", []}, []]
    ].

%% It need not be loaded yet.
a_chassis_of_a_script_is_loaded_test() ->
    Own = starl_motion_chassis_tests,
    _ = code:purge(Own),
    _ = code:delete(Own),
    ?assertEqual(ok, starl_chassis:check({Own, [{1.0, 1.0, 1}]})).

%% Each kind has a next step on each of the three ways.
a_robot_at_the_end_has_arrived_test_() ->
    [
        ?_assertEqual(
            arrived, Kind:next(Way, {X, 0.0, 0.0}, {{0.0, 0.0}, {500.0, 0.0}}, profile(Kind, #{}))
        )
     || Kind <- ?KINDS, {Way, X} <- [{to, 497.0}, {along, 500.0}, {face, 0.0}]
    ] ++
        [
            ?_assertMatch(
                {drive, [_]},
                Kind:next(Way, {X, 0.0, 0.0}, {{0.0, 0.0}, {500.0, 0.0}}, profile(Kind, #{}))
            )
         || Kind <- ?KINDS, {Way, X} <- [{to, 480.0}, {along, 497.0}, {face, 4.0}]
        ].

%% Two wheels stand at the end of a script; who has to brake stands later, by what full speed takes.
a_script_lasts_as_long_as_its_commands_test() ->
    Script = [{100.0, 0.0, 300}, {0.0, 0.0, 7}],
    ?assertEqual({307, 307}, ?WHEELS:duration_us(Script, profile(?WHEELS, #{}))),
    Slow = profile(?HOLONOMIC, #{speed => 500.0, acceleration => 1000.0}),
    ?assertEqual({307, 500307}, ?HOLONOMIC:duration_us(Script, Slow)),
    ?assertEqual(0.0, starl_chassis:rests_s(profile(?WHEELS, #{}))),
    ?assertEqual(0.5, starl_chassis:rests_s(Slow)).

the_last_command_is_without_its_duration_test_() ->
    [
        ?_assertEqual(Last, Kind:last(Script))
     || Kind <- ?KINDS,
        {Last, Script} <- [{{0.0, 0.0}, []}, {{3, 4}, [{1, 2, 5}, {3, 4, 6}]}]
    ].

%% It is reversed for 20 ms, no faster than this; who was to stand tries nothing.
a_command_that_was_not_obeyed_is_tried_in_reverse_test_() ->
    [
        ?_assertEqual({Told, Try}, {Told, Kind:undo(Told)})
     || {Kind, Told, Try} <- [
            {?WHEELS, {50.0, -20.0}, tries(-50.0, 20.0)},
            {?WHEELS, {400.0, -200.0}, tries(-100.0, 50.0)},
            {?WHEELS, {-200.0, 400.0}, tries(50.0, -100.0)},
            {?WHEELS, {1.0e6, 1.0e6}, tries(-100.0, -100.0)},
            {?WHEELS, {-1.0e6, -1.0e6}, tries(100.0, 100.0)},
            {?HOLONOMIC, {3.0, -4.0}, tries(-3.0, 4.0)},
            {?HOLONOMIC, {300.0, 400.0}, tries(-6.0, -8.0)},
            {?HOLONOMIC, {-400.0, 300.0}, tries(8.0, -6.0)},
            {?HOLONOMIC, {1.0e6, 0.0}, tries(-10.0, -0.0)},
            {?HOLONOMIC, {-1.0e6, 0.0}, tries(10.0, -0.0)},
            {?HOLONOMIC, {0.0, 1.0e6}, tries(-0.0, -10.0)},
            {?HOLONOMIC, {0.0, -1.0e6}, tries(-0.0, 10.0)}
        ]
    ] ++
        [
            ?_assertEqual({Told, Try}, {Told, Kind:undo(Told)})
         || Kind <- ?KINDS,
            {Told, Try} <- [
                {{0, 0.0}, none},
                {{1, 0.0}, {ok, [{-1.0, -0.0, 20000}]}},
                {{0.0, 1}, {ok, [{-0.0, -1.0, 20000}]}},
                {stalled, unknown},
                {{fast, 1.0}, unknown},
                {{1.0, fast}, unknown},
                {{1000000.5, 1.0}, unknown},
                {{-1000000.5, 1.0}, unknown},
                {{1.0, 1000000.5}, unknown},
                {{1.0, -1000000.5}, unknown}
            ]
        ] ++
        [
            ?_assertEqual(2.0, ?WHEELS:try_mm(profile(?WHEELS, #{}))),
            ?_assertEqual(0.2, ?HOLONOMIC:try_mm(profile(?HOLONOMIC, #{})))
        ].

tries(A, B) -> {ok, [{A, B, 20000}]}.

%% Who drives in any direction keeps its heading; the speed leaves room for its error.
a_velocity_is_turned_into_the_robots_own_axes_test_() ->
    Exact = profile(?HOLONOMIC, #{distance_error => 0.25}),
    [
        ?_assertEqual(
            {Velocity, Forward, Left},
            begin
                [{F, L, 7}] = ?HOLONOMIC:cruise(Velocity, {9.0, 9.0, Heading}, 7, Exact),
                {Velocity, round(F), round(L)}
            end
        )
     || {Velocity, Heading, Forward, Left} <- [
            {{100.0, 0.0}, 0.0, 80, 0},
            {{0.0, 100.0}, 0.0, 0, 80},
            {{0.0, 100.0}, math:pi() / 2, 80, 0},
            {{100.0, 0.0}, math:pi() / 2, 0, -80},
            {{100.0, 200.0}, math:pi(), -80, -160}
        ]
    ].

%% -- what profiles promise ---------------------------------------------------------------------------

%% A profile names its chassis; what is given counts, the rest is as usual.
a_profile_is_whole_test() ->
    [
        begin
            Profile = profile(Kind, #{speed => 321.0}),
            ?assertEqual(Kind, starl_chassis:kind(Profile)),
            ?assertMatch(#{speed := 321.0, position_error_mm := 1.0}, Profile),
            ?assertEqual(165.0, starl_chassis:radius_mm(Profile)),
            ?assertEqual(80.0, starl_chassis:radius_mm(Profile#{radius_mm => 80})),
            ?assertEqual(5000, starl_chassis:latency_us(Profile)),
            ?assertEqual(1, starl_chassis:latency_us(Profile#{latency_ms => 0.0005}))
        end
     || Kind <- ?KINDS
    ].

robots_take_the_profiles_in_turn_test() ->
    Three = [profile(?WHEELS, #{speed => Speed}) || Speed <- [1.0, 2.0, 3.0]],
    ?assertEqual(
        [1.0, 2.0, 3.0, 1.0],
        [maps:get(speed, starl_chassis:of_robot(Robot, Three)) || Robot <- [1, 2, 3, 4]]
    ).

%% The bounds that the two derivations give, in micrometres, and the guarantee's 11 and 12 mm.
the_bounds_are_those_of_the_derivation_test() ->
    [Wheels, Holonomic] = Two = [profile(Kind, #{}) || Kind <- ?KINDS],
    ?assertEqual(10898, um(starl_chassis:tracking_radius(Wheels))),
    ?assertEqual(12225, um(starl_chassis:tracking_radius(Holonomic))),
    ?assertEqual(12225, um(starl_chassis:widest(Two))),
    %% w + s, with w = max(1 mm, s)
    [
        ?assertEqual(Ends, starl_chassis:ends_mm(profile(Kind, #{position_error_mm => Error})))
     || Kind <- ?KINDS, {Error, Ends} <- [{0.5, 1.5}, {1.0, 2.0}, {3.0, 6.0}]
    ].

um(Mm) -> round(1000 * Mm).

%% Legs that advance, four more, each with two steps; four turns; and for each leg two corrections, and 60.
a_drive_takes_no_longer_than_its_legs_test() ->
    Arrives = fun(Mm, Advance) ->
        Pace = #{advance_mm => Advance, leg_us => 1000, turn_us => 100, again_us => 10},
        starl_chassis:arrives_us(Mm, 1, #{chassis => ?MODULE, pace => Pace})
    end,
    ?assertEqual(6 * 1002 + 400 + (12 + 60) * 11, Arrives(200.0, 100.0)),
    ?assertEqual(7 * 1002 + 400 + (14 + 60) * 11, Arrives(200.1, 100.0)),
    ?assert(is_integer(Arrives(200.0, 0.5))),
    ?assertEqual(never, Arrives(200.0, 0.0)),
    ?assertEqual(never, Arrives(200.0, -1.0)).

%% -- the choice --------------------------------------------------------------------------------------

a_choice_is_a_name_or_some_test_() ->
    {chassis, {term, _, IsChoice}, differential, _} = starl_chassis_choice:option(),
    Right = [differential, create_1, mixed, [create, holonomic], [create]] ++ own(),
    Wrong = [
        tank,
        [],
        [mixed],
        [create, tank],
        [tank, create],
        [create | holonomic],
        [1],
        17,
        "robot.py",
        <<"robot.py">>,
        <<255>>,
        ["exec:a", "robot.py"],
        {"exec:./robot", #{}},
        {"robot.erl", none},
        {robot, #{}},
        {17, #{}}
    ],
    [
        ?_assertEqual({One, true}, {One, IsChoice(One)})
     || One <- Right ++ [own(), ["exec:a", create]]
    ] ++
        [?_assertEqual({One, false}, {One, IsChoice(One)}) || One <- Wrong].

own() ->
    ["exec:./robot.py -v", <<"exec:./robot">>, "robot.erl", <<"a/robot.erl">>, {"robot.erl", #{}}].

a_text_is_a_chassis_of_the_users_own_test() ->
    ?assertEqual(
        [
            {exec, "./robot.py -v"},
            {exec, "./robot"},
            {file, "robot.erl", #{}},
            {file, "a/robot.erl", #{}},
            {file, "robot.erl", #{}},
            {file, "robot.erl", #{port => 7}},
            none,
            none
        ],
        [
            starl_chassis_choice:own(Name)
         || Name <- own() ++ [{<<"robot.erl">>, #{port => 7}}, create, "robot.py"]
        ]
    ).

names_are_taken_in_turn_test() ->
    ?assertEqual(
        [differential, holonomic, create, create_1, mixed], starl_chassis_choice:names()
    ),
    %% each is in the words of the option
    {chassis, {term, Words, _}, differential, _} = starl_chassis_choice:option(),
    [
        ?assertNotEqual({nomatch, Name}, {string:find(Words, atom_to_list(Name) ++ ", "), Name})
     || Name <- starl_chassis_choice:names()
    ],
    ?assertEqual([differential, holonomic], starl_chassis_choice:in_turn(mixed)),
    ?assertEqual(["exec:a"], starl_chassis_choice:in_turn("exec:a")),
    ?assertEqual([create], starl_chassis_choice:in_turn(create)),
    ?assertEqual(
        [create, "exec:a", create_1, create],
        [starl_chassis_choice:of_robot(R, [create, "exec:a", create_1]) || R <- [1, 2, 3, 4]]
    ).

%% The measures of each; a serial line, and a program, hear a command no sooner than they can.
a_name_stands_for_measures_test() ->
    Choice = [differential, holonomic, create, create_1, "exec:a"],
    Measures = fun(Given) ->
        [
            {Kind, maps:get(axle_mm, Profile, none), maps:get(latency_ms, Profile, none)}
         || #{chassis := Kind} = Profile <- starl_chassis_choice:profiles(Choice, Given)
        ]
    end,
    ?assertEqual(
        [
            {?WHEELS, 258.0, none},
            {?HOLONOMIC, none, none},
            {?WHEELS, 235.0, 25},
            {?WHEELS, 258.0, 25},
            {?WHEELS, 258.0, 50}
        ],
        Measures(#{})
    ),
    ?assertEqual([10, 10, 25, 25, 50], [Ms || {_, _, Ms} <- Measures(#{latency_ms => 10})]),
    ?assertEqual([60, 60, 60, 60, 60], [Ms || {_, _, Ms} <- Measures(#{latency_ms => 60})]).

profile(Kind, Given) -> starl_chassis:profile(Kind, Given).
