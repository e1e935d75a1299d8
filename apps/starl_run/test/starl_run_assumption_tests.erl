%% Which faults break an assumption, of whom, when and by how much: held against what the
%% simulator's clocks, holds and positions make of the same faults.
-module(starl_run_assumption_tests).
-include_lib("eunit/include/eunit.hrl").

broken(Kind, Target, Params) -> broken(Kind, Target, Params, 5).

broken(Kind, Target, Params, To) ->
    Fault = {f, 2, To, Kind, Target, Params},
    ?assertEqual([], starl_run_fault:check([Fault])),
    starl_run_assumption:broken([Fault], true).

clocks_test() ->
    ?assertEqual([{3, 2000, 2000, {clock, -7000}}], broken(clock_step, 3, #{ms => -7})),
    ?assertEqual([{3, 2000, 2000, {clock, 7000}}], broken(clock_step, 3, #{ms => 7}, 2)),
    ?assertEqual([], broken(clock_step, 3, #{ms => 0})),
    ?assertEqual(
        [{3, 2000, 2000, {clock, 7000}}, {3, 5000, 5000, {clock, -7000}}],
        broken(clock_offset, 3, #{ms => 7})
    ),
    ?assertEqual([], broken(clock_offset, 3, #{ms => 7}, 2)),
    ?assertEqual([{3, 2000, 5000, {clock, -3000}}], broken(clock_freeze, 3, #{})).

%% Within 1 % a clock keeps what is assumed.
drift_test() ->
    ?assertEqual([], broken(clock_drift, 3, #{ppm => -10000})),
    ?assertEqual([], broken(clock_drift, 3, #{ppm => 10000})),
    ?assertEqual([{3, 2000, 5000, {clock, -30}}], broken(clock_drift, 3, #{ppm => -10001})),
    ?assertEqual([{3, 2000, 5000, {clock, 30}}], broken(clock_drift, 3, #{ppm => 10001})),
    ?assertEqual(
        [{3, 2000, 100002000, {clock, 2000000}}],
        broken(clock_drift, 3, #{ppm => 20000}, 100002)
    ),
    ?assertEqual([{3, 2000, 5000, {clock, -60}}], broken(clock_drift, 3, #{ppm => -20000})),
    ?assertEqual([{3, 2000, 5000, {clock, 60}}], broken(clock_drift, 3, #{ppm => 20000})).

%% A window's gain is by how much the simulated clock leaves a right one behind.
gain_test() ->
    [
        begin
            Fault = {f, 2, 5, Kind, 3, Params},
            Clock = starl_sim_clock:new(0, 0, [starl_run_fault:compile(Fault)]),
            Gained = fun(Until) ->
                Broken = starl_run_assumption:broken([Fault], true),
                lists:sum([Us || {3, _, To, {clock, Us}} <- Broken, To =< Until])
            end,
            [
                ?assertEqual({Kind, T + Gained(T)}, {Kind, starl_sim_clock:local(T, Clock)})
             || T <- [0, 1999, 5000, 9000]
            ]
        end
     || {Kind, Params} <- [
            {clock_step, #{ms => -4}},
            {clock_step, #{ms => 4}},
            {clock_freeze, #{}},
            {clock_offset, #{ms => 4}},
            {clock_drift, #{ppm => 20000}}
        ]
    ].

promptness_test() ->
    ?assertEqual([{3, 2000, 5000, pause}], broken(pause, 3, #{})),
    ?assertEqual([], broken(pause, 3, #{}, 2)),
    ?assertEqual([{3, 2000, 5000, {slow, 300000}}], broken(slow, 3, #{lag_ms => 300})).

positions_test() ->
    ?assertEqual([{all, 2000, 5000, position}], broken(location_frozen, all, #{})),
    ?assertEqual([{3, 2000, 5000, position}], broken(location_frozen, 3, #{})),
    %% but for a system that is not exact: that it stands still is found out
    ?assertEqual([], starl_run_assumption:broken([{f, 2, 5, location_frozen, all, #{}}], false)),
    ?assertEqual(
        [{3, 2000, 5000, position}, {1, 2000, 5000, position}],
        broken(location_swap, {3, 1}, #{})
    ).

%% What a contract about places has to know, and no other.
positions_are_farther_off_test() ->
    Positions = fun(Kind, Mm) ->
        starl_run_assumption:positions([{f, 2, 5, Kind, 3, #{mm => Mm}}])
    end,
    [
        begin
            ?assertEqual([{3, 2000, 5000, position}], Positions(Kind, 1)),
            ?assertEqual([], Positions(Kind, 0)),
            ?assertEqual([], broken(Kind, 3, #{mm => 50}))
        end
     || Kind <- [location_noise, location_bias]
    ].

%% Under all other kinds contracts hold, whatever the parameters that are drawn.
all_others_test() ->
    Faults = lists:append([
        starl_run_fault_draw:draw(#{
            seed => Seed, robots => 5, machines => [sap], until_ms => 10000, kinds => [all]
        })
     || Seed <- lists:seq(1, 50)
    ]),
    Breaking = [
        clock_offset, clock_step, clock_freeze, pause, stand_still, slow, location_swap
    ],
    [
        ?assertEqual(
            lists:sort(Kinds),
            lists:usort([
                Kind
             || {_, _, _, Kind, _, _} = F <- Faults,
                starl_run_assumption:broken([F], IsExact) =/= []
            ])
        )
     || {IsExact, Kinds} <- [{false, Breaking}, {true, [location_frozen | Breaking]}]
    ].

%% A monitor is told where it asks, and the simulator has the last word.
told_test() ->
    Told = told(#{position_error => 1.0}),
    ?assertMatch(
        #{broken := [{3, 2000, 5000, pause}]}, proplists:get_value(starl_sim_told_monitor, Told)
    ),
    ?assertEqual(#{}, proplists:get_value(starl_sim_order_monitor, Told)),
    Exact = [{3, 2000, 5000, pause}, {all, 2000, 5000, position}],
    ?assertMatch(
        #{broken := Exact},
        proplists:get_value(starl_sim_told_monitor, told(#{position_error => 0}))
    ).

told(Positions) ->
    Faults = [{f, 2, 5, pause, 3, #{}}, {g, 2, 5, location_frozen, all, #{}}],
    Given = Positions#{
        app => starl_sim_script_app, robots => 3, faults => Faults, random_faults => []
    },
    {ok, Scenario} = starl_run_scenario:check(Given, starl_app:options(starl_sim_script_app)),
    Context = starl_run_plan:context(starl_sim_script_app, Scenario),
    Scene = #{
        app => {sequential, starl_sim_script_app, #{}},
        monitors => [{starl_sim_told_monitor, #{}}, {starl_sim_order_monitor, #{}}]
    },
    #{monitors := Monitors} = starl_run_plan:make(Scenario, Scene, Context, {[], []}, #{}),
    Monitors.

%% One end of a link that is cut for good is beside the core, of several links as few robots as possible.
core_beside_links_test() ->
    Cut = fun(Id, Link) -> {Id, 0, 100000, loss, Link, #{part => 1.0}} end,
    Rest = fun(Faults, N) ->
        element(1, starl_run_assumption:core(Faults, lists:seq(1, N), 1000000))
    end,
    ?assertEqual([1], Rest([Cut(a, {1, 3})], 3)),
    ?assertEqual([2], Rest([Cut(a, {1, 2}), Cut(b, {2, 3})], 4)),
    ?assertEqual([1, 3], Rest([Cut(a, {1, 2}), Cut(b, {3, 4})], 5)),
    %% a robot that is cut off by another fault is beside it already
    ?assertEqual(
        [4], Rest([{deaf, 0, 100000, one_way_partition, [4], #{}}, Cut(a, {1, 4})], 4)
    ),
    %% no majority is left
    ?assertEqual([], Rest([Cut(a, {1, 2})], 2)).

%% -- what bounds allow for instead of an excuse ----------------------------------------------

radio(Faults, EndMs) ->
    ?assertEqual([], starl_run_fault:check(Faults)),
    starl_run_assumption:radio(Faults, 1000 * EndMs).

%% A little loss or delay is a part of the radio, however long it lasts; copies cost nothing.
little_is_no_excuse_test() ->
    Slow = {a, 0, 10, delay, {1, 2}, #{extra_ms => 5}},
    Late = {b, 0, 10, reorder, {1, 2}, #{part => 0.5, extra_ms => 1}},
    ?assertEqual({0.0, 6000, []}, radio([Slow, Late], 1000)),
    Twice = {c, 0, 10, duplicate, {1, 2}, #{part => 1.0}},
    Babbles = {d, 0, 10, babble, 1, #{copies => 5}},
    ?assertEqual({0.0, 0, []}, radio([Twice, Babbles], 1000)),
    Lossy = {e, 0, 10, loss, {1, 2}, #{part => 0.02}},
    Corrupt = {f, 0, 10, corrupt, {1, 2}, #{part => 0.01}},
    {Lost, 0, []} = radio([Lossy, Corrupt], 1000),
    ?assert(abs(Lost - (1 - 0.98 * 0.99)) < 1.0e-9).

%% More is one only where it lasts for half of the run at least; what takes everything is an excuse always.
much_is_an_excuse_while_short_test() ->
    Fault = fun(Kind, To, Params) -> {a, 0, To, Kind, {1, 2}, Params} end,
    IsExcuse = fun(Given) -> element(3, radio([Given], 1000)) =:= [Given] end,
    ?assert(IsExcuse(Fault(loss, 499, #{part => 0.03}))),
    ?assertNot(IsExcuse(Fault(loss, 500, #{part => 0.03}))),
    ?assertNot(IsExcuse(Fault(loss, 1000, #{part => 0.5}))),
    ?assert(IsExcuse(Fault(loss, 1000, #{part => 0.51}))),
    ?assert(IsExcuse(Fault(delay, 499, #{extra_ms => 6}))),
    ?assertNot(IsExcuse(Fault(delay, 500, #{extra_ms => 200}))),
    ?assert(IsExcuse(Fault(delay, 1000, #{extra_ms => 201}))),
    ?assert(IsExcuse({a, 0, 1000, isolate, 1, #{}})),
    ?assert(IsExcuse({a, 0, 1000, wheel_slow, 1, #{wheel => left, factor => 0.9}})).

%% A robot with a slow wheel knows its place, one without a positioning system or a chassis does not.
places_test() ->
    Places = fun(Kind, Target, Params) ->
        starl_run_assumption:places([{f, 2, 5, Kind, Target, Params}])
    end,
    ?assertEqual([{3, 2000, 5000, fault}], Places(serial_gone, 3, #{})),
    ?assertEqual([{all, 2000, 5000, fault}], Places(location_dropout, all, #{})),
    ?assertEqual([], Places(wheel_slow, 3, #{wheel => left, factor => 0.9})),
    ?assertEqual([], Places(pause, 3, #{})).

%% When the last fault of each class is over; a clock may drift by 1 %.
ends_test() ->
    Faults = [
        {a, 0, 10, pause, 1, #{}},
        {b, 0, 30, pause, 2, #{}},
        {c, 0, 50, wheel_slow, 2, #{wheel => left, factor => 0.9}},
        {d, 0, 90, clock_drift, 2, #{ppm => 10000}}
    ],
    ?assertEqual(#{process => 30000, actuation => 50000}, starl_run_assumption:ends(Faults)),
    ?assertEqual(#{}, starl_run_assumption:ends([])).
