%% The simulated body that drives in any direction: its limits of speed and acceleration hold at every
%% instant, whatever goes wrong; driven by motion it stays within r(v) of its lines under every fault
%% that motion bears, with profiles at random, and comes where it was going.
-module(starl_sim_holonomic_SUITE).
-include_lib("stdlib/include/assert.hrl").
-include_lib("proper/include/proper.hrl").

-export([suite/0, all/0, init_per_suite/1, end_per_suite/1]).
-export([
    stays_near_its_lines/1,
    goes_on_past_a_corner/1,
    each_kind_of_fault_bites/1,
    stuck_drive_moves_it_no_further/1,
    stops_within_its_brake/1,
    stalls_and_says_so_when_it_stands/1,
    never_faster_than_its_limit/1,
    pause_ends_at_the_leg/1,
    dies_braking/1,
    another_chassis_script/1,
    mixed_team_is_the_same_in_every_mode/1
]).

%% Faults are over after so long, s; the run ends so much later, s.
-define(HEAL_S, 40).
-define(TIME_S, 300).
-define(KINDS, [
    clock_offset,
    clock_drift,
    clock_step,
    clock_freeze,
    kill_machine,
    reboot,
    pause,
    slow,
    location_dropout,
    location_frozen,
    wheel_stuck,
    wheel_slow,
    command_lost,
    slip,
    serial_garbage,
    serial_split,
    serial_gone
]).

suite() -> [{timetrap, {minutes, 5}}].

all() ->
    [
        stays_near_its_lines,
        goes_on_past_a_corner,
        each_kind_of_fault_bites,
        stuck_drive_moves_it_no_further,
        stops_within_its_brake,
        stalls_and_says_so_when_it_stands,
        never_faster_than_its_limit,
        pause_ends_at_the_leg,
        dies_braking,
        another_chassis_script,
        mixed_team_is_the_same_in_every_mode
    ].

init_per_suite(Config) -> starl_platform_ct:without_log(Config).

end_per_suite(Config) -> starl_platform_ct:with_log(Config).

%% Any of the kinds together, drawn from the seed; any limits and errors.
stays_near_its_lines(_) ->
    Prop = ?FORALL(
        {Seed, Kinds, Profile},
        {choose(1, 1000000), list(oneof(?KINDS)), profile()},
        starl_platform_ct:safely(fun() -> near_and_there(Seed, lists:usort(Kinds), Profile) end)
    ),
    starl_platform_ct:property(Prop, 150).

%% A reboot 39 mm past a corner: the application once took the line before it for its own.
goes_on_past_a_corner(_) ->
    Profile = #{
        speed => 500,
        acceleration => 300,
        heading_error => 0.0,
        distance_error => 0.0,
        position_error => 0.5
    },
    ?assert(near_and_there(42, [reboot], Profile)).

near_and_there(Seed, Kinds, Profile) ->
    Drawn = #{seed => Seed, random_faults => Kinds, heal => ?HEAL_S},
    #{ending := Ended} = Outcome = drive(maps:merge(Profile, Drawn)),
    Pieces = pieces(Outcome),
    Off = off(Pieces),
    Near = Off =< radius(Profile),
    Limits = limits(Pieces, Profile),
    (Near andalso Ended =:= done andalso Limits =:= []) orelse
        begin
            ct:log("~p ~p ~p: off ~p of ~p, ~p, ~p", [
                Seed, Kinds, Profile, Off, radius(Profile), Ended, Limits
            ]),
            false
        end.

%% Where a piece is too fast, changes its velocity too fast, or does not go on where and as the one
%% before ends.
limits(Pieces, #{speed := Speed, acceleration := Acceleration}) ->
    [{fast, P} || {P, _, _} <- Pieces, starl_trajectory:fastest(P) > Speed + 1.0e-6] ++
        [
            {hard, P}
         || {{ramp, _, _, _, _, {VX0, VY0}, {VX1, VY1}, Us} = P, _, _} <- Pieces,
            starl_geometry:distance({VX0, VY0}, {VX1, VY1}) > Acceleration * Us / 1.0e6 + 1.0e-6
        ] ++
        [
            {jump, P, Q}
         || {{P, _, To}, {Q, _, _}} <- lists:zip(lists:droplast(Pieces), tl(Pieces)),
            starl_geometry:distance(
                starl_trajectory:velocity(To, P), starl_trajectory:velocity(To, Q)
            ) >
                1.0e-6 orelse
                starl_geometry:distance(
                    starl_trajectory:position(To, P), starl_trajectory:position(To, Q)
                ) >
                    1.0e-6
        ].

%% The same drive under each kind alone comes out otherwise than without. (A clock that is only off
%% changes nothing in a drive.)
each_kind_of_fault_bites(_) ->
    Seeds = lists:seq(1, 20),
    Sound = maps:from_list([{Seed, lasted(drive(#{seed => Seed}))} || Seed <- Seeds]),
    Bites = fun(Kind) ->
        lists:any(
            fun(Seed) ->
                Faulty = drive(#{random_faults => [Kind], heal => ?HEAL_S, seed => Seed}),
                lasted(Faulty) =/= maps:get(Seed, Sound)
            end,
            Seeds
        )
    end,
    Clocks = [clock_offset, clock_step, clock_drift, clock_freeze],
    ?assertEqual([], [Kind || Kind <- ?KINDS -- Clocks, not Bites(Kind)]).

lasted(#{end_us := Us}) -> Us.

%% It is tried again and again, and is no farther off for it.
stuck_drive_moves_it_no_further(_) ->
    Fault = {s, 3000, 30000, wheel_stuck, 1, #{wheel => left}},
    Pieces = [
        P
     || {P, From, To} <- pieces(drive(#{faults => [Fault]})), From > 4000000, To < 30000000
    ],
    ?assert(length(Pieces) > 20, length(Pieces)),
    Places = [starl_trajectory:position(starl_trajectory:start_us(P), P) || P <- Pieces],
    Far = lists:max([starl_geometry:distance(A, B) || A <- Places, B <- Places]),
    ?assert(Far < 1.0, Far).

%% Told to stop at full speed it stands after V²/2A, and says so then.
stops_within_its_brake(_) ->
    Brake = starl_trajectory:ramp(0, {0.0, 0.0}, 0.0, {500.0, 0.0}, {0.0, 0.0}, 250000),
    ?assertEqual(250000, starl_sim_holonomic:stops_us(0, Brake)),
    ?assertEqual(0, starl_sim_holonomic:stops_us(300000, Brake)),
    {moved, Plans, Going} = tell([{400.0, 0.0, 1000000}], a, 0, vehicle([])),
    ?assertEqual([{1000000, {go_on, 1}}], Plans),
    ?assertEqual({40.0, 0.0}, starl_trajectory:position(200000, starl_sim_vehicle:piece(Going))),
    {moved, Said, Stopping} = tell([], b, 500000, Going),
    ?assertEqual([{200000, {says, 2, motion, {driven, b, 500000}}}], Said),
    {X, _} = starl_trajectory:position(10000000, starl_sim_vehicle:piece(Stopping)),
    ?assert(abs(X - 200.0) < 1.0e-6, X),
    %% left to itself it ends v·t from where it stood, and says so when it stands
    {moved, Words, Braking} = starl_sim_vehicle:beat({go_on, 1}, 1000000, Going),
    ?assertEqual([{200000, {says, 1, motion, {driven, a, 0}}}], Words),
    {End, _} = starl_trajectory:position(1200000, starl_sim_vehicle:piece(Braking)),
    ?assert(abs(End - 400.0) < 1.0e-6, End).

%% A drive that sticks brakes, and is found out 15 ms later: by then it has lost 30 of 400 mm/s. It says
%% so when it stands: who looked where it is before would see it on its way.
stalls_and_says_so_when_it_stands(_) ->
    Stuck = {s, 500000, 9000000, wheel_stuck, 1, #{wheel => left}},
    {moved, _, Going} = tell([{400.0, 0.0, 1000000}], a, 0, vehicle([Stuck])),
    {moved, [{15000, {watch, 1, 500000} = Watch}], Stalling} =
        starl_sim_vehicle:turn_wheels(500000, Going),
    {same, Said, Stopping} = starl_sim_vehicle:beat(Watch, 515000, Stalling),
    ?assertEqual([{185000, {says, 2, motion, {stalled, a, {400.0, 0.0}}}}], Said),
    ?assertEqual(700000, starl_trajectory:rests_from(starl_sim_vehicle:piece(Stopping))).

%% Whatever it is told, and however its errors fall.
never_faster_than_its_limit(_) ->
    Fastest = fun(Told, N) ->
        Vehicle = vehicle([], #{distance_error => 0.1}, N),
        {moved, _, Going} = tell([{Told, Told, 1000000}], a, 0, Vehicle),
        starl_trajectory:fastest(starl_sim_vehicle:piece(Going))
    end,
    [
        ?assert(Fastest(Told, N) =< 500.0 + 1.0e-9)
     || Told <- [353.0, 400.0, 9000.0], N <- lists:seq(1, 20)
    ],
    ?assert(lists:max([Fastest(340.0, N) || N <- lists:seq(1, 20)]) > 481.0).

%% The computer stands still in the midst of a leg: the body does not drive on.
pause_ends_at_the_leg(_) ->
    Pieces = pieces(drive(#{faults => [{p, 3000, 20000, pause, 1, #{}}]})),
    ?assert(driven(4200000, 20000000, Pieces) < 0.001),
    ?assert(driven(2500000, 4200000, Pieces) > 10.0).

%% A robot that dies on its way comes to rest by itself, and no monitor takes it for standing before.
dies_braking(_) ->
    Outcome = drive(#{faults => [{k, 3300, 3300, kill_robot, 1, #{}}]}),
    {Last, From, _} = lists:last(pieces(Outcome)),
    ?assertEqual(3300000, From),
    ?assertEqual([], limits(pieces(Outcome), #{speed => 500.0, acceleration => 2000.0})),
    ?assert(is_integer(starl_trajectory:rests_from(Last))),
    ?assert(starl_trajectory:moved(From, From + 5000000, Last) > 1.0).

%% A script of two wheels is not carried out, but traced; nothing answers.
another_chassis_script(_) ->
    Wheels = {starl_chassis_differential, [{100.0, 100.0, 1000000}]},
    ?assertEqual(
        not_understood, starl_sim_vehicle:drive(Wheels, {motion, m}, 0, vehicle([]))
    ).

mixed_team_is_the_same_in_every_mode(_) ->
    Run = fun(Mode, Shards) ->
        {ok, Sim} = starl_sim:start(#{
            app => starl_painting,
            robots => 4,
            seed => 3,
            picture => "house",
            loss => 0.2,
            chassis => mixed,
            mode => Mode,
            shards => Shards,
            time => 40
        }),
        _ = starl_sim:run(Sim),
        {#{digest := Digest, violations := []}, _} = starl_sim:finish(Sim),
        Digest
    end,
    One = Run(process, 1),
    ?assertEqual([One, One], [Run(inline, 1), Run(process, 3)]).

%% -- helpers --------------------------------------------------------------------------------

profile() ->
    ?LET(
        {Speed, Acceleration, Heading, Part, Position},
        {
            oneof([100, 300, 500]),
            oneof([300, 1000, 2000, 5000]),
            oneof([0.0, 0.02, 0.05]),
            oneof([0.0, 0.01, 0.05]),
            oneof([0.5, 1.0, 3.0])
        },
        #{
            speed => Speed,
            acceleration => Acceleration,
            heading_error => Heading,
            distance_error => Part,
            position_error => Position
        }
    ).

radius(Profile) ->
    [Whole] = starl_chassis_choice:profiles(
        holonomic,
        maps:from_list([
            {
                case Key of
                    position_error -> position_error_mm;
                    _ -> Key
                end,
                float(Value)
            }
         || {Key, Value} <- maps:to_list(Profile)
        ])
    ),
    starl_chassis:tracking_radius(Whole).

lines() ->
    Points = [
        {1000.0, 1000.0},
        {4000.0, 1000.0},
        {4000.0, 3000.0},
        {2000.0, 1500.0},
        {2300.0, 3500.0}
    ],
    lists:zip(lists:droplast(Points), tl(Points)).

%% One robot drives along the lines, each as often as it takes.
drive(More) ->
    starl_sim_ct:run(
        maps:merge(
            #{
                app => starl_sim_script_app,
                robots => 1,
                seed => 1,
                time => ?TIME_S,
                mode => inline,
                chassis => holonomic,
                script => fun follow/1
            },
            More
        )
    ).

%% An application that starts anew goes on from the line that the robot is on: the nearest one. (From
%% any other near a corner it would first cut across the corner, which no bound promises against.)
follow(Robot) ->
    case starl:position(Robot) of
        {ok, {X, Y, _}} ->
            Off = fun(Line) -> starl_geometry:point_segment({X, Y}, Line) end,
            Nearest = lists:min([Off(Line) || Line <- lines()]),
            Passed = fun(Line) -> Off(Line) > Nearest end,
            [ok = along(Line, Robot) || Line <- lists:dropwhile(Passed, lines())];
        {error, _} ->
            ok = starl:sleep(Robot, 500),
            follow(Robot)
    end.

along(Line, Robot) ->
    case starl:call(Robot, motion, {go_along, Line}, infinity) of
        {ok, ok} -> ok;
        _ -> along(Line, Robot)
    end.

off(Pieces) ->
    lists:max([
        lists:min([starl_geometry:point_segment(Point, Line) || Line <- lines()])
     || {Piece, From, To} <- Pieces,
        Point <- starl_trajectory:polyline(Piece, From, To, 0.01)
    ]).

driven(From, To, Pieces) ->
    lists:sum([
        starl_trajectory:moved(max(From, Begin), min(To, End), Piece)
     || {Piece, Begin, End} <- Pieces, Begin < To, End > From
    ]).

pieces(#{monitors := #{starl_sim_order_monitor := #{trace := Trace}}, end_us := End}) ->
    Pieces = [Piece || {_, 1, chassis, {motion, Piece}} <- Trace],
    Starts = [starl_trajectory:start_us(Piece) || Piece <- Pieces],
    lists:zip3(Pieces, Starts, tl(Starts) ++ [End]).

vehicle(Faults) -> vehicle(Faults, #{}, 1).

vehicle(Faults, Errors, Seed) ->
    Exact = #{heading_error => 0.0, distance_error => 0.0, position_error_mm => 0.0},
    Profiles = starl_chassis_choice:profiles(holonomic, maps:merge(Exact, Errors)),
    starl_sim_vehicle:new(1, {0.0, 0.0, 0.0}, #{
        seed => Seed,
        team => starl_team:new([1]),
        clock => {0, 0},
        loss => 0.0,
        duplicate => 0.0,
        delay_us => {1000, 2000},
        range_mm => infinity,
        profiles => Profiles,
        network => [],
        clocks => [],
        location => [],
        actuation => Faults,
        store => [],
        sight => starl_sim_sight:new([], infinity)
    }).

tell(Commands, Mark, Now, Vehicle) ->
    starl_sim_vehicle:drive({starl_chassis_holonomic, Commands}, {motion, Mark}, Now, Vehicle).
