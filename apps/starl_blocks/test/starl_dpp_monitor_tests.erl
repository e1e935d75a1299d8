%% The contract of distributed path planning: disjoint tubes at every change (Lemma 7) and
%% separation at every instant, with traces that keep them and traces that break them.
-module(starl_dpp_monitor_tests).
-include_lib("eunit/include/eunit.hrl").

-define(S, 1_000_000).
-define(TUBE, 100.0).
-define(R_S, 300.0).

judge(Events) -> judge(Events, 0).

judge(Events, End) ->
    {Found, _Results} = run(Events, End),
    [{What, Robots} || #{contract := dpp, what := What, robots := Robots} <- Found].

run(Events, End) ->
    M0 = starl_monitor:new([{starl_dpp_monitor, #{tube_radius => ?TUBE, r_s => ?R_S}}]),
    {Met, M} = lists:foldl(fun step/2, {[], M0}, Events),
    {Late, #{starl_dpp_monitor := Results}} = starl_monitor:finish(End, M),
    {Met ++ Late, Results}.

%% The same for robots that hold nothing: what they drive over is another clause.
separated(Events, End) ->
    {Found, Results} = run(Events, End),
    {[V || #{what := What} = V <- Found, What =/= moves_without_reservation], Results}.

too_close(Events, End) ->
    {Found, _} = separated(Events, End),
    [{What, Robots} || #{what := What, robots := Robots} <- Found].

step(Event, {Found, M0}) ->
    case starl_monitor:step(Event, M0) of
        {ok, M} -> {Found, M};
        {violation, Violation, M} -> {Found ++ [Violation], M}
    end.

assigned(T, Robot, Segments) -> assigned(T, 9, Robot, Segments).
assigned(T, By, Robot, Segments) ->
    {T, By, dpp_coordinator, {assigned, Robot, {Robot, T}, Segments}}.
reserved(T, Robot, Segments) -> {T, 9, dpp_coordinator, {reserved, Robot, Segments}}.
level(Y) -> [{{0.0, Y}, {500.0, Y}}, {{500.0, Y}, {1000.0, Y}}].
motion(T, Robot, Piece) -> {T, Robot, chassis, {motion, Piece}}.
stand(X, Y) -> starl_trajectory:standing(0, {X, Y}, 0.0).
drive(T, X, Y, Heading) -> starl_trajectory:piece(T, {X, Y}, Heading, 100.0, 0.0).

%%% Reservations

disjoint_tubes_test() ->
    ?assertEqual(
        [],
        judge([
            assigned(1, 1, level(0.0)),
            assigned(2, 2, level(200.0)),
            assigned(3, 3, level(-300.0))
        ])
    ).

tubes_at_the_limit_test() ->
    Pair = fun(Y) -> judge([assigned(1, 1, level(0.0)), assigned(2, 2, level(Y))]) end,
    ?assertEqual([], Pair(200.0)),
    ?assertEqual([], Pair(200.0 - 0.5e-6)),
    ?assertEqual([{tubes_overlap, [1, 2]}], Pair(200.0 - 1.0e-5)).

crossing_tubes_test() ->
    Across = [{{250.0, -900.0}, {250.0, 900.0}}],
    ?assertEqual(
        [{tubes_overlap, [1, 2]}],
        judge([assigned(1, 2, level(0.0)), assigned(2, 1, Across)])
    ).

standing_robot_has_a_tube_test() ->
    Stand = [{{250.0, 150.0}, {250.0, 150.0}}],
    ?assertEqual(
        [{tubes_overlap, [1, 2]}],
        judge([reserved(1, 2, Stand), assigned(2, 1, level(0.0))])
    ).

only_the_last_edge_overlaps_test() ->
    Far = [{{0.0, 900.0}, {900.0, 900.0}}, {{900.0, 900.0}, {900.0, 199.0}}],
    ?assertEqual(
        [{tubes_overlap, [1, 3]}],
        judge([
            assigned(1, 1, level(0.0)), assigned(2, 2, level(-5000.0)), assigned(3, 3, Far)
        ])
    ).

own_former_tube_does_not_count_test() ->
    ?assertEqual([], judge([assigned(1, 1, level(0.0)), assigned(2, 1, level(1.0))])).

shrunk_reservation_frees_space_test() ->
    Shrunk = [{{0.0, 0.0}, {200.0, 0.0}}],
    Across = [{{500.0, -900.0}, {500.0, 900.0}}],
    ?assertEqual(
        [],
        judge([
            assigned(1, 1, level(0.0)),
            reserved(2, 1, Shrunk),
            assigned(3, 2, Across)
        ])
    ),
    ?assertEqual(
        [],
        judge([
            assigned(1, 1, level(0.0)),
            reserved(2, 1, []),
            assigned(3, 2, level(0.0))
        ])
    ).

%% What is left of a reservation that overlaps another overlaps it still, and is told again.
overlapping_rest_test() ->
    [First, Last] = level(0.0),
    Across = fun(X) -> [{{X, -900.0}, {X, 900.0}}] end,
    ?assertEqual(
        [{tubes_overlap, [1, 2]}, {tubes_overlap, [1, 2]}],
        judge([
            assigned(1, 1, Across(900.0)), assigned(2, 2, [First, Last]), reserved(3, 2, [Last])
        ])
    ).

%% Only the end of a reservation is a part of it.
other_reservation_test() ->
    Away = [{{0.0, 900.0}, {500.0, 900.0}}],
    ?assertEqual(
        [{tubes_overlap, [1, 2]}],
        judge([
            assigned(1, 1, level(0.0)),
            assigned(2, 2, Away ++ level(300.0)),
            reserved(3, 2, Away ++ level(100.0))
        ])
    ).

reservation_that_grows_back_test() ->
    %% A late Clear that frees space which the robot is back in.
    ?assertEqual(
        [{tubes_overlap, [1, 2]}],
        judge([
            assigned(1, 1, level(0.0)),
            reserved(2, 1, []),
            assigned(3, 2, level(0.0)),
            reserved(4, 1, level(0.0))
        ])
    ).

new_coordinator_starts_empty_test() ->
    Change = fun(Term) ->
        judge([
            {0, 9, dpp_coordinator, {coordinator, 1}},
            assigned(1, 1, level(0.0)),
            {2, 8, dpp_coordinator, {coordinator, Term}},
            assigned(3, 8, 2, level(0.0))
        ])
    end,
    ?assertEqual([], Change(2)),
    ?assertEqual([{two_coordinators, [8, 9]}, {tubes_overlap, [1, 2]}], Change(1)).

%% One whose term is over assigns no more, even if the tubes are disjoint.
two_coordinators_test() ->
    Begin = [{0, 9, dpp_coordinator, {coordinator, 1}}, assigned(1, 1, level(0.0))],
    Next = [{2, 8, dpp_coordinator, {coordinator, 2}}, reserved(2, 1, level(0.0))],
    ?assertEqual([], judge(Begin ++ [assigned(3, 9, 2, level(900.0))] ++ Next)),
    ?assertEqual(
        [{two_coordinators, [8, 9]}],
        judge(Begin ++ Next ++ [assigned(3, 9, 2, level(900.0))])
    ),
    {[], Results} = run(Begin ++ Next ++ [{4, 8, dpp_coordinator, {coordinator, 3}}], 9),
    ?assertMatch(#{coordinators := [9, 8]}, Results).

%% So does one whose successor has the votes, though that has assigned nothing yet; and what an
%% earlier term won means nothing any more.
two_leaders_test() ->
    Leads = fun(T, Robot, Term) -> {T, Robot, dpp_coordinator, {leads, Term}} end,
    Begin = [Leads(0, 9, {1, 9, 1}), {0, 9, dpp_coordinator, {coordinator, {1, 9, 1}}}],
    Assigned = assigned(3, 9, 2, level(900.0)),
    ?assertEqual([], judge(Begin ++ [Assigned])),
    ?assertEqual([{two_coordinators, [8, 9]}], judge(Begin ++ [Leads(2, 8, {2, 8, 1}), Assigned])),
    ?assertEqual([], judge(Begin ++ [Assigned, Leads(4, 8, {2, 8, 1})])),
    ?assertEqual([], judge(Begin ++ [Leads(2, 8, {0, 8, 1}), Assigned])),
    ?assertEqual([], judge(Begin ++ [Leads(2, 9, {2, 9, 2}), Assigned])).

%% A robot whose store was set back has forgotten its vote: it may lead in a lower term, but not before
%% the later one has ended, nor for another reason.
%% Holds: A term that nobody remembers may be followed by a lower one, when it has ended
%% Red: d863b95, run: `two coordinators`
forgotten_term_test() ->
    Says = fun(T, Robot, Event) -> {T, Robot, dpp_coordinator, Event} end,
    Led = [Says(0, 9, {leads, {2, 9, 1}}), Says(0, 9, {coordinator, {2, 9, 1}})],
    Ended = [Says(2, 9, {stepped_down, {2, 9, 1}})],
    Back = [{3, 8, robot, store_set_back}],
    Leads = [
        Says(4, 8, {leads, {1, 8, 7}}),
        Says(4, 8, {coordinator, {1, 8, 7}}),
        assigned(5, 8, 1, level(0.0))
    ],
    ?assertEqual([], judge(Led ++ Ended ++ Back ++ Leads)),
    ?assertEqual([], judge(Led ++ [Says(2, 9, crashed)] ++ Back ++ Leads)),
    Dies = fun(Robot) -> [{2, Robot, robot, {died, killed}}] end,
    ?assertEqual([], judge(Led ++ Dies(9) ++ Back ++ Leads)),
    ?assertEqual([{two_coordinators, [8, 9]}], judge(Led ++ Dies(7) ++ Back ++ Leads)),
    [
        ?assertEqual([{two_coordinators, [8, 9]}], judge(Events))
     || Events <- [
            Led ++ Back ++ Leads,
            Led ++ Ended ++ Leads,
            Back ++ Led ++ Ended ++ Leads,
            Led ++ Ended ++ Back ++ Leads ++ [assigned(6, 9, 2, level(900.0))]
        ]
    ].

%% One whose clock has stood still for more than a jump within a lease may not know, and is not heeded:
%% what it reserves is nobody's, what it opens hides nothing. A lease is 10 s here, a jump 2 s.
deluded_leader_test() ->
    Coordinates = fun(T, Robot, Event) -> {T * ?S, Robot, dpp_coordinator, Event} end,
    Begin = [
        Coordinates(0, 9, {leads, {1, 9, 1}}),
        Coordinates(0, 9, {coordinator, {1, 9, 1}}),
        Coordinates(20, 8, {leads, {2, 8, 1}}),
        Coordinates(20, 8, {coordinator, {2, 8, 1}}),
        Coordinates(20, 8, {reserved, 1, level(0.0)})
    ],
    Two = [
        Coordinates(21, 9, {reserved, 2, level(100.0)}),
        Coordinates(21, 9, {assigned, 2, {2, 1}, level(100.0)})
    ],
    Judge = fun(Events, Broken) ->
        Config = #{tube_radius => ?TUBE, r_s => ?R_S, robots => [7, 8, 9], broken => Broken},
        M0 = starl_monitor:new([{starl_dpp_monitor, Config}]),
        {Found, _} = lists:foldl(fun step/2, {[], M0}, Events),
        [What || #{what := What} <- Found]
    end,
    Stood = fun(Robot, From, To) -> [{Robot, From, To, {clock, From - To}}] end,
    ?assertEqual([tubes_overlap, two_coordinators], Judge(Begin ++ Two, [])),
    ?assertEqual([], Judge(Begin ++ Two, Stood(9, 18 * ?S, 20 * ?S + 1))),
    ?assertEqual(
        [tubes_overlap, two_coordinators],
        Judge(Begin ++ Two, Stood(9, 18 * ?S, 20 * ?S - 20001))
    ),
    %% long ago, by its clock, or after that, or of another robot's clock
    ?assertEqual([], Judge(Begin ++ Two, Stood(9, ?S, 11 * ?S))),
    ?assertEqual([tubes_overlap, two_coordinators], Judge(Begin ++ Two, Stood(9, 0, 10 * ?S))),
    ?assertEqual([tubes_overlap, two_coordinators], Judge(Begin ++ Two, Stood(8, 0, 20 * ?S))),
    %% a voter's clock that has gained as much
    Gained = fun(Robot, Ms) -> [{Robot, 15 * ?S, 15 * ?S, {clock, 1000 * Ms}}] end,
    ?assertEqual([], Judge(Begin ++ Two, Gained(7, 2001))),
    ?assertEqual([tubes_overlap, two_coordinators], Judge(Begin ++ Two, Gained(7, 1900))),
    ?assertEqual([tubes_overlap, two_coordinators], Judge(Begin ++ Two, Gained(9, 2001))),
    %% whoever drives by it is judged by what the one that leads has reserved
    Off = [{22 * ?S, 1, chassis, {motion, drive(22 * ?S, 0.0, 300.0, 0.0)}}],
    By = [Coordinates(21, 9, {assigned, 1, {1, 1}, level(300.0)})],
    ?assertEqual([moves_without_lease], Judge(Begin ++ By ++ Off, Stood(9, 15 * ?S, 20 * ?S))),
    %% it may come to lead again
    Again = [Coordinates(23, 9, {leads, {3, 9, 1}}), Coordinates(23, 9, {coordinator, {3, 9, 1}})],
    Then = [
        Coordinates(23, 9, {assigned, 1, {1, 1}, level(300.0)}),
        Coordinates(24, 8, {assigned, 1, {1, 1}, level(300.0)})
    ],
    ?assertEqual(
        [two_coordinators],
        Judge(Begin ++ Two ++ Again ++ Then, Stood(9, 15 * ?S, 20 * ?S))
    ).

%% Just the time by which clocks may be set explains nothing; a microsecond more does.
deluded_by_more_than_a_jump_test() ->
    Says = fun(T, Robot, Event) -> {T * ?S, Robot, dpp_coordinator, Event} end,
    Events = [
        Says(0, 9, {leads, {1, 9, 1}}),
        Says(0, 9, {coordinator, {1, 9, 1}}),
        Says(20, 8, {leads, {2, 8, 1}}),
        Says(20, 8, {coordinator, {2, 8, 1}}),
        Says(21, 9, {assigned, 2, {2, 1}, level(100.0)})
    ],
    Judge = fun(Windows) ->
        M0 = starl_monitor:new([
            {starl_dpp_monitor, #{
                tube_radius => ?TUBE,
                r_s => ?R_S,
                robots => [7, 8, 9],
                drift_ppm => 0,
                broken => Windows
            }}
        ]),
        {Found, _} = lists:foldl(fun step/2, {[], M0}, Events),
        [What || #{what := What} <- Found]
    end,
    Back = fun(Us) -> {9, 18 * ?S, 18 * ?S + Us, {clock, -Us}} end,
    Forward = fun(Us) -> {7, 18 * ?S, 18 * ?S, {clock, Us}} end,
    [
        ?assertEqual({Jumps, Found}, {Jumps, Judge(Jumps)})
     || {Found, Jumps} <- [
            {[two_coordinators], [Back(2 * ?S)]},
            {[], [Back(2 * ?S + 1)]},
            %% two clocks, each set within its bound
            {[two_coordinators], [Back(2 * ?S), Forward(2 * ?S)]},
            {[], [Back(2 * ?S), Forward(2 * ?S + 1)]}
        ]
    ].

%% What is not given is as the machines have it by default: leases of ten seconds, clocks that drift
%% by a hundredth and are set by two seconds at most, no robots, a second judged at once.
defaults_test() ->
    Given = #{tube_radius => 100.0, r_s => 300.0},
    All = Given#{
        lease_us => 10 * ?S,
        jump_us => 2 * ?S,
        drift_ppm => 10000,
        slice_us => ?S,
        robots => [],
        broken => [],
        tracking_mm => #{}
    },
    ?assertEqual(starl_dpp_monitor:init(All), starl_dpp_monitor:init(Given)),
    [
        ?assertNotEqual(
            starl_dpp_monitor:init(All), starl_dpp_monitor:init(All#{Key => Other})
        )
     || {Key, Other} <- [
            {lease_us, 10 * ?S + 1}, {jump_us, 2 * ?S + 1}, {drift_ppm, 10001}, {robots, [1]}
        ]
    ].

%% Without time two runs are alike if the same robot has led last and the same is reserved.
timeless_test() ->
    Timeless = fun(Events) ->
        Step = fun(Event, S0) ->
            {ok, S} = starl_dpp_monitor:step(Event, S0),
            S
        end,
        M0 = starl_dpp_monitor:init(#{tube_radius => ?TUBE, r_s => ?R_S}),
        starl_dpp_monitor:timeless(lists:foldl(Step, M0, Events))
    end,
    Begins = fun(Robot, Term) -> {0, Robot, dpp_coordinator, {coordinator, Term}} end,
    ?assertEqual(Timeless([Begins(9, 2)]), Timeless([Begins(8, 1), Begins(9, 2)])),
    ?assertNotEqual(Timeless([Begins(9, 2)]), Timeless([Begins(8, 2)])),
    ?assertNotEqual(Timeless([Begins(9, 2)]), Timeless([Begins(9, 1)])),
    ?assertNotEqual(Timeless([]), Timeless([reserved(0, 1, level(0.0))])).

%%% Lease: r(v) is 50 mm here, and 1 mm is the error of the positions

lease_test() ->
    R = {starl_dpp_monitor, #{tube_radius => 200.0, r_s => 300.0}},
    Judge = fun(Y, Held) ->
        M0 = starl_monitor:new([R]),
        {Found, _} = lists:foldl(fun step/2, {[], M0}, [
            reserved(1, 1, Held), motion(2, 1, drive(2, 100.0, Y, 0.0))
        ]),
        [What || #{what := What} <- Found]
    end,
    ?assertEqual([], Judge(50.9, level(0.0))),
    ?assertEqual([], Judge(51.0, level(0.0))),
    ?assertEqual([moves_without_lease], Judge(51.1, level(0.0))),
    %% its space has been given free but for the place where it was seen
    ?assertEqual([moves_without_lease], Judge(0.0, [{{0.0, 0.0}, {0.0, 0.0}}])).

%% A robot that stands needs no lease.
standing_without_lease_test() ->
    ?assertEqual([], judge([reserved(1, 1, level(0.0)), motion(2, 1, stand(5000.0, 0.0))])).

%% One that moves has a reservation, somewhere.
moving_without_reservation_test() ->
    Moves = motion(2, 1, drive(2, 100.0, 0.0, 0.0)),
    ?assertEqual([{moves_without_reservation, [1]}], judge([Moves])),
    ?assertEqual([{moves_without_reservation, [1]}], judge([reserved(1, 2, level(0.0)), Moves])),
    ?assertEqual(
        [{moves_without_reservation, [1]}],
        judge([reserved(1, 1, level(0.0)), {2, 8, dpp_coordinator, {coordinator, 2}}, Moves])
    ),
    ?assertEqual([], judge([motion(0, 1, stand(0.0, 0.0))])).

new_coordinator_must_learn_first_test() ->
    ?assertEqual(
        [{tubes_overlap, [1, 2]}],
        judge([
            assigned(1, 1, level(0.0)),
            {2, 8, dpp_coordinator, {coordinator, 2}},
            assigned(3, 8, 2, level(0.0)),
            reserved(4, 1, level(0.0))
        ])
    ).

dead_robots_keep_their_tube_test() ->
    ?assertEqual(
        [{tubes_overlap, [1, 2]}],
        judge([
            assigned(1, 1, level(0.0)), {2, 1, robot, {died, killed}}, assigned(3, 2, level(0.0))
        ])
    ).

%% A robot of which more is known than what its tube has room for is held to that.
own_tracking_radius_test() ->
    Judge = fun(Y, Own) ->
        M0 = starl_monitor:new([
            {starl_dpp_monitor, #{tube_radius => 200.0, r_s => 300.0, tracking_mm => Own}}
        ]),
        {Found, _} = lists:foldl(fun step/2, {[], M0}, [
            reserved(1, 1, level(0.0)), motion(2, 1, drive(2, 100.0, Y, 0.0))
        ]),
        [What || #{what := What} <- Found]
    end,
    ?assertEqual([[], []], [Judge(45.0, #{}), Judge(45.0, #{2 => 20.0})]),
    ?assertEqual([], Judge(20.9, #{1 => 20.0})),
    ?assertEqual([moves_without_lease], Judge(21.1, #{1 => 20.0})).

%% Every overlap at one change is reported.
all_overlaps_are_reported_test() ->
    Across = [{{250.0, -900.0}, {250.0, 900.0}}],
    ?assertEqual(
        [{tubes_overlap, [1, 3]}, {tubes_overlap, [2, 3]}],
        judge([
            assigned(1, 1, level(0.0)), assigned(2, 2, level(400.0)), assigned(3, 3, Across)
        ])
    ).

%% How near they are, and how near they may be.
overlap_in_full_test() ->
    {[#{at_us := 2, details := Details}], _} =
        run([assigned(1, 1, level(0.0)), assigned(2, 2, level(150.0))], 9),
    #{distance_mm := Distance, limit_mm := Limit} = Details,
    ?assert(abs(Distance - 150.0) < 1.0e-9),
    ?assert(abs(Limit - 2 * ?TUBE) < 1.0e-9).

%% Also of many robots in their order.
overlaps_of_many_test() ->
    Robots = lists:seq(1, 40),
    Stand = [reserved(1, R, [{{400.0 * R, 0.0}, {400.0 * R, 0.0}}]) || R <- Robots],
    Across = assigned(2, 41, [{{0.0, 0.0}, {20000.0, 0.0}}]),
    ?assertEqual([{tubes_overlap, [R, 41]} || R <- Robots], judge(Stand ++ [Across])).

%% Reservations that are apart may lie in one box.
beside_a_slope_test() ->
    Slope = [{{0.0, 0.0}, {5000.0, 5000.0}}],
    Stand = fun(X) -> reserved(2, 2, [{{X, 0.0}, {X, 0.0}}]) end,
    ?assertEqual([], judge([assigned(1, 1, Slope), Stand(300.0)])),
    ?assertEqual([{tubes_overlap, [1, 2]}], judge([assigned(1, 1, Slope), Stand(280.0)])).

%%% Separation

apart_at_the_limit_test() ->
    Two = [motion(0, 1, stand(0.0, 0.0)), motion(0, 2, stand(300.0, 0.0))],
    {[], Results} = run(Two, 9 * ?S),
    ?assertMatch(#{min_separation_mm := 300.0, at_us := 0, robots := [1, 2]}, Results).

too_close_test() ->
    Two = [motion(0, 1, stand(0.0, 0.0)), motion(0, 2, stand(299.999, 0.0))],
    ?assertEqual([{too_close, [1, 2]}], judge(Two, 9 * ?S)).

%% Two robots cross the same point a little after one another, between any ticks.
too_close_while_passing_test() ->
    Two = [
        motion(0, 1, drive(0, 0.0, 0.0, 0.0)),
        motion(0, 2, drive(0, 1000.0, 250.0, math:pi()))
    ],
    {[#{what := too_close, at_us := At, details := #{distance_mm := D}}], _} =
        separated(Two, 20 * ?S),
    ?assertEqual(5 * ?S, At),
    ?assert(abs(D - 250.0) < 1.0e-6).

%% A run is told as soon as the slice is over, by whatever event comes next, of any robot.
too_close_is_told_during_the_run_test() ->
    Passing = [
        motion(0, 1, drive(0, 0.0, 0.0, 0.0)),
        motion(0, 2, drive(0, 1000.0, 250.0, math:pi()))
    ],
    M0 = starl_monitor:new([{starl_dpp_monitor, #{tube_radius => ?TUBE, r_s => ?R_S}}]),
    Step = fun(T, M) -> step({T, 9, dpp_coordinator, {silent, 9}}, {[], M}) end,
    {_, M1} = lists:foldl(fun step/2, {[], M0}, Passing),
    {[], M2} = Step(4 * ?S, M1),
    {[#{what := too_close, robots := [1, 2], at_us := At}], M3} = Step(7 * ?S, M2),
    ?assert(At =< 5 * ?S),
    ?assertMatch({[], _}, Step(8 * ?S, M3)),
    ?assertMatch({[], _}, starl_monitor:finish(20 * ?S, M3)).

passing_at_a_distance_test() ->
    Two = [
        motion(0, 1, drive(0, 0.0, 0.0, 0.0)),
        motion(0, 2, drive(0, 1000.0, 300.0, math:pi()))
    ],
    ?assertEqual([], too_close(Two, 20 * ?S)).

dead_robot_stays_test() ->
    Start = [motion(0, 1, drive(0, 0.0, 0.0, 0.0)), motion(0, 2, stand(1000.0, 0.0))],
    ?assertEqual([{too_close, [1, 2]}], too_close(Start, 8 * ?S)),
    ?assertEqual([], too_close(Start ++ [{5 * ?S, 1, robot, {died, killed}}], 80 * ?S)).

stopping_in_time_test() ->
    Start = [motion(0, 1, drive(0, 0.0, 0.0, 0.0)), motion(0, 2, stand(1000.0, 0.0))],
    Stop = motion(7 * ?S, 1, starl_trajectory:standing(7 * ?S, {700.0, 0.0}, 0.0)),
    {[], #{min_separation_mm := Least}} = separated(Start ++ [Stop], 60 * ?S),
    ?assert(abs(Least - 300.0) < 1.0e-6).

single_robot_test() ->
    {[], Results} = run([motion(0, 1, stand(0.0, 0.0))], ?S),
    ?assertMatch(#{min_separation_mm := infinity}, Results).

counts_test() ->
    {[], Results} = run(
        [
            assigned(1, 1, level(0.0)),
            assigned(2, 2, level(900.0)),
            reserved(3, 2, level(900.0)),
            {4, 9, dpp_coordinator, {deadlock_resolved, [1, 2]}}
        ],
        ?S
    ),
    ?assertMatch(#{assignments := 2, deadlocks_resolved := 1}, Results).

%% What was given up last, with the silent robots in the way of it, and the edges that none is in the way of. A line
%% that two are in the way of counts once. Once something is assigned, nothing is given up.
what_is_left_names_the_robots_in_the_way_test() ->
    By = fun(T, Event) -> {T, 9, dpp_coordinator, Event} end,
    [A, B] = level(0.0),
    GivenUp = [
        {1, 1, robot, {died, killed}},
        By(2, {silent, 1}),
        By(3, {silent, 2}),
        By(9, {in_the_way, 1, [A, B]}),
        By(9, {in_the_way, 2, [B]}),
        By(9, {unreachable, [4, 5, 6]})
    ],
    Left = fun(Events) -> element(2, run(Events, ?S)) end,
    Both = #{edges => 3, in_the_way => [{1, 2, 2}, {2, 3, 1}], cut_off => 1},
    ?assertMatch(#{left := Both}, Left(GivenUp)),
    ?assertMatch(#{left := none}, Left([])),
    ?assertMatch(#{left := none}, Left(GivenUp ++ [assigned(10, 3, level(900.0))])),
    ?assertMatch(
        #{left := #{edges := 1, in_the_way := [{2, 3, 1}], cut_off := 0}},
        Left(GivenUp ++ [By(11, {in_the_way, 2, [B]}), By(11, {unreachable, [5]})])
    ),
    %% a recording may begin after the robot fell silent
    ?assertMatch(
        #{left := #{in_the_way := [{1, 9, 2}]}},
        Left([By(9, {in_the_way, 1, [A, B]}), By(9, {unreachable, [4, 5]})])
    ).

%% What the two machines may trace, and with how much.
vocabulary_test() ->
    #{dpp := Participant, dpp_coordinator := Coordinator} = starl_dpp_monitor:vocabulary(),
    ?assertEqual(
        [{answered, 1}, {asks, 0}, {blocked, 1}, {doubted, 2}, {stale_answer, 3}, {void, 1}],
        lists:sort(Participant)
    ),
    ?assertEqual(
        [
            {assigned, 3},
            {claims, 1},
            {closed, 1},
            {coordinator, 1},
            {deadlock_resolved, 1},
            {doubted, 2},
            {in_the_way, 2},
            {leads, 1},
            {malformed, 2},
            {reopened, 0},
            {reserved, 2},
            {silent, 1},
            {stepped_down, 1},
            {unreachable, 1}
        ],
        lists:sort(Coordinator)
    ).

%% Of two ways the least distance is told, and of a robot that is on none of its lines the least
%% way to one, with whose it is.
details_test() ->
    {[Overlap], _} = run(
        [assigned(1, 1, level(0.0)), assigned(2, 2, level(50.0) ++ level(90.0))], 2
    ),
    #{details := #{distance_mm := Distance, limit_mm := Limit}} = Overlap,
    ?assertEqual({50.0, 200.0}, {Distance, Limit}),
    {[Off], _} = run(
        [assigned(1, 1, level(0.0) ++ level(400.0)), motion(2, 1, drive(2, 100.0, 100.0, 0.0))], 2
    ),
    ?assertMatch(
        #{what := moves_without_lease, robots := [1], details := #{off_mm := 100.0}}, Off
    ).

%% What has once overlapped is looked at again though it is a part of what was held; what has not is
%% apart like the whole.
overlaps_stay_test() ->
    Two = [assigned(1, 1, level(0.0)), assigned(2, 2, level(50.0))],
    Rest = [lists:last(level(50.0))],
    ?assertMatch([{tubes_overlap, _}, {tubes_overlap, _}], judge(Two ++ [reserved(3, 2, Rest)])),
    %% also when others have been found apart meanwhile
    Third = [assigned(3, 3, level(900.0)), reserved(4, 2, Rest)],
    ?assertMatch([{tubes_overlap, _}, {tubes_overlap, _}], judge(Two ++ Third)),
    Apart = [assigned(1, 1, level(0.0)), assigned(2, 2, level(900.0))],
    ?assertEqual([], judge(Apart ++ [reserved(3, 2, [lists:last(level(900.0))])])).

%% Of two violations at one event the second is told with the next one; what is none of its business
%% is none of that, and nothing found is nothing told.
one_at_a_time_test() ->
    M0 = starl_dpp_monitor:init(#{tube_radius => ?TUBE, r_s => ?R_S}),
    Step = fun(Event, M) -> starl_dpp_monitor:step(Event, M) end,
    {ok, M1} = Step(assigned(1, 1, level(0.0)), M0),
    {ok, M2} = Step(assigned(2, 2, level(300.0)), M1),
    {violation, #{robots := [1, 3]}, M3} = Step(assigned(3, 3, level(150.0)), M2),
    {violation, #{robots := [2, 3]}, M4} = Step({4, 1, location, {seen, 1}}, M3),
    {ok, M5} = Step({5, 1, location, {seen, 2}}, M4),
    ?assertMatch({ok, _}, starl_dpp_monitor:finish(9, M5)),
    ?assertMatch({{violation, [#{robots := [2, 3]}]}, _}, starl_dpp_monitor:finish(9, M3)).

%% Of one path a robot draws no more than the horizon and the line on which it ends (ComputePath's bound).
no_path_is_longer_than_the_horizon_test() ->
    Line = fun(N) -> {{500.0 * N, 0.0}, {500.0 * (N + 1), 0.0}} end,
    Draws = fun(Lines) -> [{T, 1, app, {stroke, Line(N)}} || {T, N} <- lists:enumerate(Lines)] end,
    Path = {0, 1, dpp, {answered, assign}},
    Beyond = fun(Events) ->
        M0 = starl_monitor:new([
            {starl_dpp_monitor, #{tube_radius => ?TUBE, r_s => ?R_S, path_mm => 1500.0}}
        ]),
        {Met, _} = lists:foldl(fun step/2, {[], M0}, Events),
        [{What, T} || #{what := What, at_us := T} <- Met]
    end,
    ?assertEqual([], Beyond([Path | Draws([1, 2, 3])])),
    ?assertEqual([{beyond_horizon, 4}], Beyond([Path | Draws([1, 2, 3, 4])])),
    %% the same line again, by an application that begins anew, is the same ink
    ?assertEqual([], Beyond([Path | Draws([1, 2, 3, 1, 2, 3])])),
    ?assertEqual(
        [],
        Beyond(
            [Path] ++ Draws([1, 2, 3]) ++
                [{4, 1, dpp, {answered, assign}}, {5, 1, app, {stroke, Line(4)}}]
        )
    ),
    ?assertEqual(
        [{beyond_horizon, 5}],
        Beyond(
            [Path] ++ Draws([1, 2, 3]) ++
                [{4, 2, dpp, {answered, assign}}, {5, 1, app, {stroke, Line(4)}}]
        )
    ).
