-module(starl_run_manual_fault_tests).
-include_lib("eunit/include/eunit.hrl").

%% Each kind that a world plays is one of the simulator, and a cluster plays what one VM does, and more.
kinds_test() ->
    [All, Here, Nodes] = [
        [element(1, Spec) || Spec <- Specs]
     || Specs <- [
            starl_run_fault:kinds(),
            starl_run_manual_fault:kinds(one_vm),
            starl_run_manual_fault:kinds(nodes)
        ]
    ],
    ?assertEqual([], Here -- Nodes),
    ?assertEqual([pause, store_full], lists:sort(Nodes -- Here)),
    ?assertEqual([], Nodes -- All),
    ?assertEqual(26, length(Nodes)).

%% One line names the kind, where it is not possible, and what is.
refused_test_() ->
    [
        ?_assertEqual(Lines, [
            lists:flatten(Line)
         || Line <- starl_run_manual_fault:refused(World, [{a, 1, 2, Kind, 1, #{}}])
        ])
     || {World, Kind, Lines} <- [
            {one_vm, reboot, []},
            {nodes, pause, []},
            {one_vm, pause, ["fault a: pause needs a node for each robot: take ./starl cluster"]},
            {nodes, clock_step, [
                "fault a: clock_step cannot be played in real time: take the simulator, ./starl run "
                "without --live"
            ]}
        ]
    ].

%% A manual fault is one that a scenario may have.
fault_test() ->
    Faults = [
        starl_run_manual_fault:fault(Id, {1000, 9000}, Manual)
     || {Id, Manual} <- lists:zip([a, b, c], [
            {reboot, 2, #{}, 500} | starl_run_manual_fault:cut(1, 2, lasting)
        ])
    ],
    ?assertEqual([], starl_run_fault:check(Faults)),
    ?assertMatch([{a, 1000, 1500, _, _, _}, {b, 1000, 9000, loss, {1, 2}, _}, _], Faults).

robots_test() ->
    ?assertEqual([1, 2], starl_run_manual_fault:robots(hd(starl_run_manual_fault:cut(1, 2, 5)))),
    ?assertEqual([3], starl_run_manual_fault:robots({kill_machine, {3, sap}, #{}, 0})),
    ?assertEqual([], starl_run_manual_fault:robots({loss, all, #{part => 0.1}, lasting})).
