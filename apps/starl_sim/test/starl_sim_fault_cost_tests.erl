%% What faults cost: the time in which a run converges, what monitors are told, and when they are over.
-module(starl_sim_fault_cost_tests).
-include_lib("eunit/include/eunit.hrl").

%% A run has to converge so long after its last fault, and after what that makes late; all the others do not
%% add up.
%% Holds: A run converges so long after its last fault, however many there were before
%% Red: d018c00, run: 28.4 s for 15 s
the_last_fault_counts_test() ->
    Deadline = fun(Faults) ->
        {ok, Scenario} = starl_run_scenario:check(
            #{faults => Faults, heal => 5, converge => 10, time => 1000}, []
        ),
        Context = starl_run_plan:context(?MODULE, Scenario),
        Scene = #{app => {sequential, ?MODULE, none}},
        #{monitors := Monitors, limit_us := Limit} = starl_run_plan:make(
            Scenario, Scene, Context, {[], []}, #{}
        ),
        {_, #{deadline_us := Us}} = lists:keyfind(starl_run_progress_monitor, 1, Monitors),
        ?assertEqual(Us, Limit),
        Us
    end,
    Pause = fun(Id, From, To) -> {Id, From, To, pause, 1, #{}} end,
    ?assertEqual(15000000, Deadline([])),
    ?assertEqual(15000000, Deadline([Pause(a, 0, 4000), Pause(b, 500, 4900), Pause(c, 0, 5000)])),
    ?assertEqual(19000000, Deadline([Pause(a, 0, 4000), Pause(b, 500, 9000)])),
    ?assertEqual(17500000, Deadline([{s, 1000, 7000, clock_step, 1, #{ms => -500}}])).

%% A majority that heals is held to its time though the others are cut off until the end.
a_quiet_core_converges_test() ->
    Mute = fun(Group) -> {mute, 5000, 1000000, one_way_partition, Group, #{}} end,
    Judged = fun(Robots, Faults) ->
        {ok, Scenario} = starl_run_scenario:check(
            #{robots => Robots, faults => Faults, heal => 5, converge => 10, time => 1000}, []
        ),
        Context = starl_run_plan:context(?MODULE, Scenario),
        Scene = #{
            app => {sequential, ?MODULE, none}, monitors => [{starl_sim_told_monitor, #{}}]
        },
        #{monitors := Monitors} = starl_run_plan:make(Scenario, Scene, Context, {[], []}, #{}),
        {_, #{robots := Core, deadline_us := Us}} =
            lists:keyfind(starl_run_progress_monitor, 1, Monitors),
        {_, #{core := Told}} = lists:keyfind(starl_sim_told_monitor, 1, Monitors),
        {Core, Us, maps:with([rest, healed_us], Told)}
    end,
    Pause = {p, 1000, 4000, pause, 1, #{}},
    Core = #{rest => [3], healed_us => 4000000},
    ?assertEqual({[1, 2], 15000000, Core}, Judged(3, [Pause, Mute([3])])),
    %% it hears nothing
    ?assertEqual({[1, 2], 15000000, Core}, Judged(3, [Pause, Mute([1, 2])])),
    Slow = {slow, 5000, 1000000, slow, 3, #{lag_ms => 200}},
    ?assertEqual({[1, 2], 15000000, Core}, Judged(3, [Pause, Slow])),
    %% half of a team is no core
    NoCore = #{rest => [], healed_us => 1000000000},
    ?assertEqual({[1, 2], 1010000000, NoCore}, Judged(2, [Pause, Mute([2])])).

%% What the monitors of a run are told: a bound that no fault widens, when all faults are over, and how long a
%% packet takes then.
monitors_are_told_test() ->
    Faults = [fault(slow, #{lag_ms => 40}), {dead, 9000, 9500, kill_robot, 1, #{}}],
    Told = fun(Changes) ->
        {ok, Scenario} = starl_run_scenario:check(maps:merge(#{faults => Faults}, Changes), []),
        Context = starl_run_plan:context(?MODULE, Scenario),
        Scene = #{
            app => {sequential, ?MODULE, none},
            monitors => [
                {starl_sim_told_monitor, #{bound_us => 5}},
                {starl_sim_order_monitor, #{}}
            ]
        },
        #{monitors := Monitors} = starl_run_plan:make(Scenario, Scene, Context, {[], []}, #{}),
        {_, Config} = lists:keyfind(starl_sim_told_monitor, 1, Monitors),
        Order = starl_sim_order_monitor,
        ?assertEqual({Order, #{}}, lists:keyfind(Order, 1, Monitors)),
        maps:with([bound_us, healed_us, delay_us], Config)
    end,
    All = #{bound_us => 5, healed_us => 9000000, delay_us => 20000},
    ?assertEqual(All, Told(#{})),
    ?assertEqual(All, Told(#{loss => 0.1})),
    ?assertEqual(All#{healed_us := never}, Told(#{range => 5000})),
    ?assertEqual(All#{delay_us := 1500}, Told(#{delay => {1, 1.5}})).

%% A fault of a moment is over at its beginning, every other one at its end.
healed_test() ->
    ?assertEqual(0, starl_run_fault:healed_us([])),
    ?assertEqual(5000000, starl_run_fault:healed_us([fault(pause, #{})])),
    %% what was sent before that comes later
    Late = {late, 2000, 5000, delay, all, #{extra_ms => 700}},
    ?assertEqual(5700000, starl_run_fault:healed_us([Late, fault(pause, #{})])),
    [
        ?assertEqual({Kind, 2000000}, {Kind, starl_run_fault:healed_us([fault(Kind, Params)])})
     || {Kind, Params} <- [{kill_machine, #{}}, {kill_robot, #{}}, {clock_step, #{ms => 1}}]
    ].

%% Groups of all sizes are drawn, one robot alone among them, and never the whole team; faults
%% last as long as is asked for, and no longer.
drawn_test() ->
    Drawn = fun(Seed, Robots, More) ->
        starl_run_fault_draw:draw(
            maps:merge(More, #{
                seed => Seed, robots => Robots, machines => [sap], until_ms => 30000, kinds => [all]
            })
        )
    end,
    Groups = [
        length(G)
     || S <- lists:seq(1, 200), {_, _, _, _, G, _} <- Drawn(S, 6, #{}), is_list(G)
    ],
    ?assertEqual([1, 2, 3, 4, 5], lists:usort(Groups)),
    Spans = fun(More) ->
        Faults = lists:append([Drawn(S, 3, More) || S <- lists:seq(1, 200)]),
        lists:max([To - From || {_, From, To, _, _, _} <- Faults])
    end,
    ?assert(Spans(#{}) =< 10001),
    ?assert(Spans(#{longest_ms => 30000}) > 20000),
    [
        ?assertEqual([], [R || F <- Drawn(S, 1, #{}), R <- starl_run_fault:targets(F), R > 1])
     || S <- lists:seq(1, 200)
    ].

fault(Kind, Params) ->
    Target =
        case Kind of
            kill_machine -> {1, sap};
            loss -> all;
            _ -> 1
        end,
    Fault = {Kind, 2000, 5000, Kind, Target, Params},
    ?assertEqual([], starl_run_fault:check([Fault])),
    Fault.
