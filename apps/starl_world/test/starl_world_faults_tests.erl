-module(starl_world_faults_tests).
-include_lib("eunit/include/eunit.hrl").

-define(F, starl_world_faults).

faults() -> ?F:new([1, 2, 3, 4]).

%% A fault that lasts is reported without its end, and ends at its time or with a heal.
a_fault_with_an_end_test() ->
    Given = {a, 1000, 4000, location_frozen, 2, #{}},
    {Told, Effects, Lasts} = ?F:inject(Given, 1003, faults()),
    ?assertEqual([{began, {a, 1003, forever, location_frozen, 2, #{}}}], Told),
    ?assertEqual([{due, 4000, a}], Effects),
    {[{ended, Ended}], [], Over} = ?F:end_fault(a, 4001, Lasts),
    ?assertEqual({a, 1003, 4001, location_frozen, 2, #{}}, Ended),
    ?assertEqual({[], [], Over}, ?F:end_fault(a, 5000, Over)).

%% A manual fault gets a name; both halves of a cut end with a heal.
both_halves_of_a_cut_are_healed_test() ->
    Cut = manual(starl_run_manual_fault:cut(1, 2, lasting), faults()),
    ?assertMatch(#{cut := [2]}, ?F:link_conditions(1, 1, Cut)),
    ?assertMatch(#{cut := [1]}, ?F:link_conditions(2, 1, Cut)),
    ?assertMatch(#{cut := []}, ?F:link_conditions(3, 1, Cut)),
    Names = ?F:healable(all, Cut),
    ?assertEqual([manual_1, manual_2], Names),
    ?assertEqual([manual_1], ?F:healable({fault, manual_1}, Cut)),
    {[{ended, _}], [{notify, [2]}], Half} = ?F:end_fault(manual_1, 9000, Cut),
    ?assertMatch({#{cut := [2]}, #{cut := []}}, {
        ?F:link_conditions(1, 1, Half), ?F:link_conditions(2, 1, Half)
    }).

%% What faults of the network do to what a robot hears is what they do in the simulator.
links_are_disturbed_as_in_the_simulator_test_() ->
    [
        ?_assertEqual({Cut, Disturbed}, heard_by_two(Kind, Target, P))
     || {Kind, Target, P, Cut, Disturbed} <- [
            {partition, [1, 2], #{}, [3, 4], []},
            {one_way_partition, [1], #{}, [1], []},
            {isolate, 3, #{}, [3], []},
            {ring, all, #{}, [4], []},
            {loss, 1, #{part => 0.5}, [], [{1, [{lost, 0.5}]}]},
            {delay, {1, 2}, #{extra_ms => 100}, [], [{1, [{late, 1, {50, 50}}]}]},
            {babble, 4, #{copies => 3}, [], [{4, [{again, 1, 2}]}]}
        ]
    ].

heard_by_two(Kind, Target, Params) ->
    {_, [{notify, Told} | _], Lasts} = ?F:inject({a, 0, 9, Kind, Target, Params}, 0, faults()),
    ?assertEqual(Told, [R || R <- [1, 2, 3, 4], ?F:link_conditions(R, 2, Lasts) =/= clear()]),
    #{cut := Cut, disturbed := Disturbed} = ?F:link_conditions(2, 2, Lasts),
    {Cut, lists:sort(maps:to_list(Disturbed))}.

clear() -> #{cut => [], disturbed => #{}}.

%% A robot that reboots is down until the end of its fault, which ends when it is up.
a_robot_that_reboots_is_down_until_its_time_test() ->
    {_, Effects, Down} = ?F:inject({a, 1000, 3000, reboot, 2, #{}}, 1000, faults()),
    ?assertEqual([{kill, 2}, {due, 3000, a}], Effects),
    ?assert(?F:is_down(2, 2999, Down)),
    ?assertNot(?F:is_down(1, 2999, Down)),
    ?assertNot(?F:is_down(2, 3000, Down)),
    {[], [{start, 2}], Due} = ?F:end_fault(a, 3000, Down),
    ?assertMatch({[{ended, {a, 1000, 3100, reboot, 2, _}}], _}, ?F:up(2, 3100, Due)),
    %% a heal brings no robot back before its time
    ?assertEqual([], ?F:healable(all, Down)).

%% A manual kill is a reboot that ends as soon as it can; a robot that is dead never starts.
a_robot_that_is_dead_never_starts_test() ->
    {Fault, Named} = ?F:named({reboot, 3, #{}, 0}, 5000, 4, faults()),
    {[{began, {manual_1, 5000, forever, reboot, 3, #{}}}], [{kill, 3}], Down} =
        ?F:inject(Fault, 5000, Named),
    ?assertNot(?F:is_down(3, 5000, Down)),
    {[{began, {d, 6, 6, kill_robot, 3, _}}], [{kill, 3}, {dead, 3}], Dead} =
        ?F:inject({d, 5, 5, kill_robot, 3, #{}}, 6, Down),
    ?assert(?F:is_down(3, 1000000, Dead)).

%% A store is lost, or set back, once: when its robot starts. One that was lost before that stays lost.
a_store_is_lost_or_set_back_once_test() ->
    Struck = manual([{store_set_back, 1, #{}, 0}, {store_lost, 2, #{}, 0}], faults()),
    Both = manual([{store_set_back, 2, #{}, 0}], Struck),
    {set_back, Left} = ?F:take_store(1, Both),
    ?assertMatch({kept, _}, ?F:take_store(1, Left)),
    ?assertMatch({lost, _}, ?F:take_store(2, Both)).

%% A manual one undoes the whole last boot, one of a schedule the time between its two restarts.
a_store_that_is_set_back_undoes_the_last_boot_test() ->
    {[], Up} = ?F:up(1, 700, faults()),
    {Fault, Named} = ?F:named({store_set_back, 1, #{}, 0}, 5000, 1, Up),
    {[{began, Began}], [{kill, 1}], Back} = ?F:inject(Fault, 5000, Named),
    ?assertMatch({manual_1, 700, forever, store_set_back, 1, #{}}, Began),
    ?assertMatch({[{ended, {manual_1, 700, 5200, _, _, _}}], _}, ?F:up(1, 5200, Back)),
    Given = {a, 1000, 3000, store_set_back, 1, #{}},
    {_, [{kill, 1}, {due, 3000, a}], First} = ?F:inject(Given, 1000, Up),
    {kept, First} = ?F:take_store(1, First),
    {[], Second} = ?F:up(1, 1100, First),
    {[], [{kill, 1}], Third} = ?F:end_fault(a, 3000, Second),
    {set_back, Fourth} = ?F:take_store(1, Third),
    ?assertMatch({[{ended, {a, 1000, 3100, _, _, _}}], _}, ?F:up(1, 3100, Fourth)).

%% Each sense has its fault, of which the latest holds.
%% Holds: Faults of senses end with a heal, and in chaos after five seconds
%% Red: a heal that keeps them; an end at the beginning
the_latest_fault_of_a_sense_holds_test() ->
    Held = manual(
        [
            {sense_gone, 2, #{sense => camera}, lasting},
            {sense_frozen, 2, #{sense => camera}, lasting},
            {sense_noisy, all, #{sense => bump, times => 7}, lasting}
        ],
        faults()
    ),
    ?assertEqual(#{camera => frozen, bump => {noisy, 7}}, ?F:senses(2, Held)),
    ?assertEqual(#{bump => {noisy, 7}}, ?F:senses(1, Held)),
    ?assertEqual([manual_1, manual_2], ?F:healable({sense, 2, camera}, Held)).

%% A disk that two faults fill has room when both are over.
a_disk_has_room_when_all_its_faults_are_over_test() ->
    Full = manual([{store_full, 2, #{}, lasting}, {store_full, 2, #{}, lasting}], faults()),
    {_, [], Half} = ?F:end_fault(manual_1, 9, Full),
    ?assert(?F:is_full(2, Half)),
    ?assertMatch({_, [{clear, 2}], _}, ?F:end_fault(manual_2, 9, Half)).

%% A manual pause is timed by the computer, a scheduled one by the run; the world reports both.
a_manual_pause_is_timed_by_the_computer_test() ->
    {Fault, Named} = ?F:named({pause, 2, #{at_work => true}, 1500}, 1000, 4, faults()),
    ?assertEqual({manual_1, 1000, 7000, pause, 2, #{at_work => true}}, Fault),
    ?assertMatch({[], [{halt, 2, 6000, at_work, manual_1}], _}, ?F:inject(Fault, 1000, Named)),
    ?assertMatch(
        {[], [{halt, 2, 500, now, a}], _}, ?F:inject({a, 0, 500, pause, 2, #{}}, 3, faults())
    ).

manual(Manual, Faults) ->
    lists:foldl(
        fun(One, Before) ->
            {Fault, Named} = ?F:named(One, 1000, 1, Before),
            {_, _, Next} = ?F:inject(Fault, 1000, Named),
            Next
        end,
        Faults,
        Manual
    ).

%% Robots elect within half a second: a fault of the time 0 must not begin after that.
what_robots_hear_from_the_start_is_so_before_they_begin_test() ->
    Cut = {cut, 0, 9000, loss, {1, 2}, #{part => 1.0}},
    Deaf = {deaf, 0, 9000, sense_gone, 1, #{sense => bump}},
    Later = {later, 1, 9000, loss, {1, 2}, #{part => 1.0}},
    Down = {down, 0, 9000, reboot, 1, #{}},
    ?assertEqual(
        {[Cut, Deaf], [Later, Down]}, starl_world_faults:from_the_start([Cut, Later, Down, Deaf])
    ).
