%% The monitors of applications are told of faults before a run, or when they happen, as in real time.
-module(starl_app_monitors_tests).
-include_lib("eunit/include/eunit.hrl").

%% A fault of a sense that is told when it is over is like one that was known from the beginning.
told_later_test_() ->
    Window = {1, 5, 9, fault},
    Known = #{
        broken => [],
        faults => [],
        bodies => [Window],
        positions => [],
        healed_us => 9,
        delay_us => 0,
        loss => 0
    },
    [
        {
            atom_to_list(Monitor),
            ?_assertEqual(
                Monitor:init(Monitor:context(Known, Config)),
                Monitor:broken(Window, Monitor:init(Config))
            )
        }
     || {Monitor, Config} <- [
            {starl_convoy_monitor, #{robots => [1, 2], lane => []}},
            {starl_crossing_monitor, #{}},
            {starl_follow_monitor, #{robots => [1, 2]}},
            {starl_formation_monitor, #{robots => [1, 2], tolerance_mm => 50}},
            {starl_search_monitor, #{
                floor => starl_floor:empty({1000, 1000}),
                ball => none,
                ball_mm => 100.0,
                range_mm => 1000.0,
                field => 1.0,
                wall_mm => 181.0,
                profiles => [],
                off => {50.0, 0.1},
                robots => [1, 2],
                within_us => 1
            }},
            {starl_swarm_monitor, #{range_mm => none, speed => 100}}
        ]
    ].
