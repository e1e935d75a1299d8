%% Each kind of fault does to the network, the processes, the clocks, the positions and the wheels
%% what it says, the same with processes and inline. Faults as data: starl_sim_fault_SUITE.
-module(starl_sim_fault_effects_SUITE).
-include_lib("stdlib/include/assert.hrl").
-import(starl_sim_ct, [run/1]).

-export([suite/0, all/0, init_per_suite/1, end_per_suite/1]).
-export([
    partition_cuts_both_ways/1,
    one_way_partition_cuts_one_way/1,
    isolated_and_ring/1,
    drop_takes_that_packet/1,
    corrupt_packets_are_traced/1,
    range_fault_shortens_the_radio/1,
    pause_holds_everything_up/1,
    slow_robot_is_late/1,
    reboot_forgets/1,
    reboot_of_the_app/1,
    frozen_clock_stands_still/1,
    stepped_clock/1,
    location_faults/1,
    wheel_faults/1,
    lost_command/1,
    actuator_faults/1
]).

-define(APP, starl_sim_script_app).

suite() -> [{timetrap, {minutes, 2}}].

all() ->
    [
        partition_cuts_both_ways,
        one_way_partition_cuts_one_way,
        isolated_and_ring,
        drop_takes_that_packet,
        corrupt_packets_are_traced,
        range_fault_shortens_the_radio,
        pause_holds_everything_up,
        slow_robot_is_late,
        reboot_forgets,
        reboot_of_the_app,
        frozen_clock_stands_still,
        stepped_clock,
        location_faults,
        wheel_faults,
        lost_command,
        actuator_faults
    ].

init_per_suite(Config) -> starl_platform_ct:without_log(Config).

end_per_suite(Config) -> starl_platform_ct:with_log(Config).

%% -- network --------------------------------------------------------------------------------

partition_cuts_both_ways(_) ->
    ?assertEqual([{1, 2}, {2, 1}], arrivals({cut, 0, 9000, partition, [1, 2], #{}})).

one_way_partition_cuts_one_way(_) ->
    ?assertEqual(
        [{1, 2}, {2, 1}, {3, 1}, {3, 2}, {3, 4}, {4, 1}, {4, 2}, {4, 3}] -- [{3, 4}, {4, 3}],
        arrivals({cut, 0, 9000, one_way_partition, [1, 2], #{}}) -- [{3, 4}, {4, 3}]
    ).

isolated_and_ring(_) ->
    ?assertEqual([], [
        L
     || {A, B} = L <- arrivals({cut, 0, 9000, isolate, 2, #{}}), A =:= 2 orelse B =:= 2
    ]),
    ?assertEqual(
        [{1, 2}, {1, 4}, {2, 1}, {2, 3}, {3, 2}, {3, 4}, {4, 1}, {4, 3}],
        arrivals({cut, 0, 9000, ring, all, #{}})
    ).

%% Robots stand two metres apart, in one row.
range_fault_shortens_the_radio(_) ->
    ?assertEqual(
        [{1, 2}, {2, 1}, {2, 3}, {3, 2}, {3, 4}, {4, 3}],
        arrivals({short, 0, 9000, range, all, #{range_mm => 2500}})
    ).

%% Who hears whom of four robots that shout once each: {From, To}.
arrivals(Fault) ->
    {_, Results} = play(
        4,
        fun(R) ->
            ok = starl:listen(R, hey),
            ok = starl:sleep(R, 1000),
            ok = shout(hey, starl:id(R)),
            Me = starl:id(R),
            [{From, Me} || From <- heard(R, [])]
        end,
        #{faults => [Fault]}
    ),
    %% partition [1, 2] also lets 3 and 4 hear each other
    All = lists:usort(lists:append([L || {done, L} <- Results])),
    case Fault of
        {_, _, _, partition, [1, 2], _} -> All -- [{3, 4}, {4, 3}];
        _ -> All
    end.

heard(R, Known) ->
    case starl:await(R, hey, 2000) of
        {ok, From, From} -> heard(R, [From | Known]);
        timeout -> Known
    end.

drop_takes_that_packet(_) ->
    Script = fun(R) ->
        case starl:id(R) of
            1 ->
                [shout(n, K) || K <- lists:seq(1, 5)];
            2 ->
                ok = starl:listen(R, n),
                lists:sort(numbers(R))
        end
    end,
    {_, [_, {done, Numbers}]} =
        play(2, Script, #{faults => [{d, 0, 9000, drop, {1, 2}, #{packet => 3}}]}),
    %% the first packet is SAP's own
    ?assertEqual(4, length(Numbers)).

numbers(R) ->
    case starl:await(R, n, 500) of
        {ok, _, K} -> [K | numbers(R)];
        timeout -> []
    end.

%% Garbage packets are never fatal, never silent, and the message gets through.
corrupt_packets_are_traced(_) ->
    {#{monitors := Monitors}, Results} = play(
        2,
        fun(R) ->
            ok = starl:listen(R, n),
            case starl:id(R) of
                1 -> starl:send(R, 2, n, hello);
                2 -> starl:await(R, n, 20000)
            end
        end,
        #{faults => [{c, 0, 3000, corrupt, all, #{part => 1.0}}]}
    ),
    ?assertEqual([{done, ok}, {done, {ok, 1, hello}}], Results),
    #{starl_sim_order_monitor := #{trace := Trace}} = Monitors,
    Garbage = [G || {_, _, sap, {unknown_event, packet, G}} <- Trace],
    ?assert(length(Garbage) > 0),
    ?assert(lists:all(fun is_binary/1, Garbage)).

%% -- processes ------------------------------------------------------------------------------

pause_holds_everything_up(_) ->
    {#{end_us := End}, [{done, Slept}, _]} = play(
        2,
        fun(R) ->
            Before = starl:now(R),
            ok = starl:sleep(R, 1000),
            starl:now(R) - Before
        end,
        #{faults => [{p, 500, 4000, pause, 1, #{}}], clock_offset => 0, clock_drift => 0}
    ),
    ?assertEqual(4000, Slept),
    ?assert(End >= 4000000).

slow_robot_is_late(_) ->
    {_, [{done, Slow}, {done, Quick}]} = play(
        2,
        fun(R) ->
            Before = starl:now(R),
            _ = [starl:sleep(R, 100) || _ <- lists:seq(1, 10)],
            starl:now(R) - Before
        end,
        #{faults => [{s, 0, 60000, slow, 1, #{lag_ms => 50}}], clock_drift => 0}
    ),
    ?assertEqual({1500, 1000}, {Slow, Quick}).

%% A rebooted robot knows nothing, has a new incarnation, and works on.
reboot_forgets(_) ->
    {#{violations := []}, [{done, First}, {done, Second}]} = play(
        2,
        fun(R) ->
            ok = starl:listen(R, n),
            case starl:id(R) of
                1 ->
                    ok = starl:sleep(R, 5000),
                    [starl:send(R, 2, n, K) || K <- [1, 2, 3]];
                2 ->
                    [starl:await(R, n, 20000) || _ <- [1, 2, 3]]
            end
        end,
        #{faults => [{r, 1000, 3000, reboot, 2, #{}}]}
    ),
    ?assertEqual([ok, ok, ok], First),
    ?assertEqual([{ok, 1, 1}, {ok, 1, 2}, {ok, 1, 3}], Second).

%% The application starts from the beginning; what comes meanwhile is lost.
reboot_of_the_app(_) ->
    {#{end_us := End, robots := Robots}, [{done, here}, _]} = play(
        2,
        fun(R) ->
            ok = starl:sleep(R, 2000),
            here
        end,
        #{faults => [{r, 1000, 7000, reboot, 1, #{}}]}
    ),
    ?assert(End >= 9000000),
    ?assertMatch([{1, #{result := {done, here}}}, {2, #{result := {done, here}}}], Robots).

%% -- clocks ---------------------------------------------------------------------------------

frozen_clock_stands_still(_) ->
    {_, [{done, A}, {done, B}]} = play(
        2,
        fun(R) ->
            Before = starl:now(R),
            ok = starl:sleep(R, 1000),
            starl:now(R) - Before
        end,
        #{faults => [{f, 500, 4000, clock_freeze, 1, #{}}], clock_drift => 0}
    ),
    %% by its own clock it was one second for both
    ?assertEqual({1000, 1000}, {A, B}),
    {#{end_us := End}, _} = play(
        2,
        fun(R) -> starl:sleep(R, 1000) end,
        #{faults => [{f, 500, 4000, clock_freeze, 1, #{}}], clock_drift => 0}
    ),
    ?assert(End >= 4500000 andalso End < 4600000, End).

stepped_clock(_) ->
    {_, [{done, A}, {done, B}]} = play(
        2,
        fun(R) ->
            _ = starl:position(R),
            First = starl:now(R),
            ok = starl:sleep(R, 2000),
            starl:now(R) - First
        end,
        #{faults => [{f, 500, 500, clock_step, 1, #{ms => -3000}}], clock_drift => 0}
    ),
    ?assertEqual({2000, 2000}, {A, B}).

%% -- location and actuation -----------------------------------------------------------------

location_faults(_) ->
    See = fun(Faults) ->
        {_, [{done, Seen}, _]} = play(
            2,
            fun(R) ->
                ok = starl:sleep(R, 1000),
                [point(starl:position(R)), point(starl:position(R, 2))]
            end,
            #{faults => Faults, position_error => 0.0}
        ),
        Seen
    end,
    Fault = fun(Kind, Target, Params) -> [{x, 500, 9000, Kind, Target, Params}] end,
    Honest = [{1000.0, 1000.0}, {3000.0, 1000.0}],
    ?assertEqual(Honest, See([])),
    ?assertEqual(lists:reverse(Honest), See(Fault(location_swap, {1, 2}, #{}))),
    ?assertEqual(Honest, See(Fault(location_bias, 2, #{mm => 500}))),
    [{X, Y}, _] = See(Fault(location_bias, 1, #{mm => 500})),
    ?assert(abs(500 - starl_geometry:distance({X, Y}, {1000.0, 1000.0})) < 0.001),
    [{X1, Y1}, {X2, Y2}] = See(Fault(location_noise, all, #{mm => 300})),
    ?assertNotEqual(Honest, [{X1, Y1}, {X2, Y2}]),
    ?assert(starl_geometry:distance({X1, Y1}, {1000.0, 1000.0}) =< 300.0).

point({ok, {X, Y, _}}) -> {X, Y};
point(Other) -> Other.

%% A robot with a bad wheel does not come where it wants to while it is bad, and does afterwards.
wheel_faults(_) ->
    [
        begin
            {_, [{done, Arrived}, _]} = play(
                2,
                fun(R) ->
                    Begin = starl:now(R),
                    ok = starl:go_to(R, {1000.0, 3000.0}),
                    {starl:now(R) - Begin, point(starl:position(R))}
                end,
                #{faults => [{w, 500, 9000, Kind, 1, Params}], clock_drift => 0}
            ),
            {Ms, {X, Y}} = Arrived,
            ?assert(Ms > 6000, {Kind, Ms}),
            ?assert(starl_geometry:distance({X, Y}, {1000.0, 3000.0}) < 50.0, {Kind, X, Y})
        end
     || {Kind, Params} <- [
            {wheel_stuck, #{wheel => left}}, {slip, #{factor => 0.01}}
        ]
    ].

lost_command(_) ->
    {#{violations := []}, [{done, ok}, _]} = play(
        2,
        fun(R) ->
            starl:go_to(R, {1000.0, 3000.0})
        end,
        #{faults => [{l, 0, 3000, command_lost, 1, #{part => 0.5}}]}
    ).

%% A pen that has not heard, does not move, or cannot be heard is told again, and moves when the
%% fault is over; who lowers it waits for that. What the trace tells is what the pen has done.
actuator_faults(_) ->
    Down = fun(Fault) ->
        {Outcome, [{done, Ms}, _]} = play(
            2,
            fun(R) ->
                ok = starl:sleep(R, 1000),
                Begin = starl:now(R),
                ok = starl_actuator:set(R, pen, down),
                starl:now(R) - Begin
            end,
            #{
                faults => Fault,
                clock_drift => 0,
                around => #{blocks => [starl_actuator]}
            }
        ),
        {Ms, [T || {T, 1, chassis, {actuated, pen, down}} <- starl_sim_ct:trace(Outcome)]}
    end,
    Fault = fun(Kind, Params) -> [{x, 500, 5000, Kind, 1, Params}] end,
    {0, [Told]} = Down([]),
    [
        begin
            {Ms, [T | _]} = Down(Fault(Kind, Params)),
            ?assert(Ms >= 3900 andalso Ms =< 4300, {Kind, Ms}),
            ?assert(T > Told + 3900000, {Kind, T})
        end
     || {Kind, Params} <- [
            {actuator_lost, #{part => 1.0}},
            {actuator_stuck, #{}},
            {serial_gone, #{}},
            {serial_garbage, #{part => 1.0}}
        ]
    ],
    %% the wheels' commands are others; one that is heard, but whose answer is late
    ?assertMatch({0, [Told]}, Down(Fault(command_lost, #{part => 1.0}))),
    {Late, [Told | _]} = Down(Fault(serial_split, #{lag_ms => 150})),
    ?assert(Late > 0 andalso Late =< 150, Late),
    %% a part of the commands
    {Some, [_]} = Down(Fault(actuator_lost, #{part => 0.5})),
    ?assert(Some < 3900, Some).

%% -- helpers --------------------------------------------------------------------------------

shout(Type, Body) -> starl_app_proc:perform([starl_sap:shout({app, Type}, Body)]).

%% Both modes come to the same: the outcome and the robots' results.
play(N, Script, More) ->
    Scenario = maps:merge(
        #{
            app => ?APP, robots => N, script => Script, time => 100, seed => 2
        },
        More
    ),
    [#{digest := Digest} = Outcome, #{digest := Digest}] =
        [run(Scenario#{mode => Mode}) || Mode <- [process, inline]],
    #{violations := Broken, robots := Robots} = Outcome,
    ?assertEqual([], Broken),
    {Outcome, [Result || {_, #{result := Result}} <- Robots]}.
