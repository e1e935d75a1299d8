%% Robots of the simulator that drive with velocities: they stop by themselves, whatever happens.
-module(starl_sim_velocity_tests).
-include_lib("eunit/include/eunit.hrl").

-define(SEEDS, 40).

quiet() ->
    #{level := Level} = logger:get_primary_config(),
    ok = logger:set_primary_config(level, none),
    Level.

all_test_() ->
    {setup, fun quiet/0, fun(Level) -> logger:set_primary_config(level, Level) end, [
        {timeout, 60, fun stops_after_a_crash/0},
        {timeout, 60, fun stops_while_the_program_waits/0},
        {timeout, 120, fun keeps_the_contract_under_faults/0},
        fun neighbours/0
    ]}.

%% The program crashes again and again; after each start it drives for its 0.7 s.
stops_after_a_crash() ->
    #{robots := Robots, violations := [], monitors := Monitors} = run(crash, #{time => 3}),
    #{starl_motion_monitor := #{velocities := N}} = Monitors,
    ?assert(N >= 1),
    [?assertMatch({Id, {_, _, _}}, {Id, Pose}) || {Id, #{pose := Pose}} <- Robots].

%% It drives 0.7 s at 300 mm/s and stands, though nobody tells it to.
stops_while_the_program_waits() ->
    [
        begin
            #{robots := [{1, #{pose := {X, Y, _}}}], violations := []} = run(
                hang, #{robots => 1, time => 10, chassis => Chassis}
            ),
            Mm = starl_geometry:distance({X, Y}, {1000.0, 1000.0}),
            ?assert(Mm > 180.0 andalso Mm < 220.0)
        end
     || Chassis <- [differential, holonomic]
    ].

keeps_the_contract_under_faults() ->
    [
        begin
            Given = #{
                seed => Seed,
                chassis => mixed,
                random_faults => [all],
                heal => 10,
                time => 30,
                command_latency => {0, 50 * (Seed rem 3)}
            },
            #{violations := Violations, monitors := Monitors} = run(wander, Given),
            ?assertEqual({Seed, []}, {Seed, Violations}),
            #{starl_motion_monitor := #{velocities := N}} = Monitors,
            ?assert(N > 10)
        end
     || Seed <- lists:seq(1, ?SEEDS)
    ].

%% Robots stand two metres apart, three in a row.
neighbours() ->
    #{robots := [{1, #{result := {done, {All, Near}}}} | _]} = run(
        near, #{robots => 3, world => {6000, 6000}}
    ),
    ?assertEqual([2, 3], [Robot || #{robot := Robot} <- All]),
    [#{robot := 2, offset := {DX, DY}, distance := Mm, pose := {X, _, _}}] = Near,
    ?assert(abs(DX - 2000.0) < 5 andalso abs(DY) < 5 andalso abs(Mm - 2000.0) < 5),
    ?assert(abs(X - 3000.0) < 5).

run(How, Given) ->
    Scenario = maps:merge(#{app => starl_sim_velocity_app, how => How, robots => 3}, Given),
    {ok, Sim} = starl_sim:start(Scenario),
    _ = starl_sim:run(Sim),
    {Outcome, _} = starl_sim:finish(Sim),
    Outcome.
