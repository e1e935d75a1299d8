%% What a simulated robot drives on: commands, faults of actuation, and what it sees.
-module(starl_sim_vehicle_tests).
-include_lib("eunit/include/eunit.hrl").

-define(T, 1000000).

%% Both wheels at 100 mm/s: 100 mm a second straight ahead.
straight_test() ->
    {moved, Driving} = drive({100.0, 100.0}, 0, vehicle([])),
    ?assertEqual({100.0, 0.0}, place(?T, Driving)).

%% The Create's wheels turn at most at 500 mm/s.
limit_test() ->
    {moved, Driving} = drive({900.0, 900.0}, 0, vehicle([])),
    ?assertEqual({500.0, 0.0}, place(?T, Driving)).

%% A robot that stands and is told to stand goes on in the same piece; one that turns in place
%% does not stand.
same_test() ->
    {same, Standing} = drive({0.0, 0.0}, ?T, vehicle([])),
    ?assertEqual(starl_sim_vehicle:piece(vehicle([])), starl_sim_vehicle:piece(Standing)),
    {moved, Turning} = drive({-100.0, 100.0}, 0, vehicle([])),
    {moved, Stopped} = stop(?T, Turning),
    ?assertEqual(
        starl_trajectory:pose(?T, starl_sim_vehicle:piece(Turning)),
        starl_trajectory:pose(9 * ?T, starl_sim_vehicle:piece(Stopped))
    ).

%% -- scripts --------------------------------------------------------------------------------

%% One after the other, each for its time, then it stands and says so.
script_test() ->
    Script = [{-50.0, 50.0, 2 * ?T}, {100.0, 100.0, 3 * ?T}],
    {Pieces, Said} = obey([{0, Script, first}], []),
    ?assertMatch([{0, _}, {2000000, _}, {5000000, _}], Pieces),
    [{_, Turn}, {_, Drive}, {_, Stand}] = Pieces,
    ?assert(starl_trajectory:is_still(Turn)),
    ?assert(near(300.0, starl_trajectory:moved(2 * ?T, 5 * ?T, Drive))),
    ?assertEqual(starl_trajectory:pose(5 * ?T, Drive), starl_trajectory:pose(9 * ?T, Stand)),
    ?assertEqual([{5 * ?T, motion, {driven, first, 0}}], Said).

%% Another script takes the place of one that runs, of which nothing is said any more; one without
%% anything to do stops at once.
another_script_test() ->
    Long = [{100.0, 100.0, 5 * ?T}],
    {Pieces, Said} = obey([{0, Long, a}, {?T, Long, b}, {3 * ?T, [], c}], []),
    ?assertEqual([0, ?T, 3 * ?T], [T || {T, _} <- Pieces]),
    ?assertEqual([{3 * ?T, motion, {driven, c, 3 * ?T}}], Said),
    {_, Stand} = lists:last(Pieces),
    ?assertEqual({300.0, 0.0}, starl_trajectory:position(20 * ?T, Stand)).

%% A line that takes its time: the commands arrive within its bounds, in their order, and the answer
%% tells when.
latency_test() ->
    Long = [{100.0, 100.0, ?T}],
    Slow = slow_line({20000, 50000}),
    {Pieces, [{Said, motion, {driven, b, Heard}}]} = obey(
        [{0, Long, a}, {1000, Long, b}], [], Slow
    ),
    [First, Second | _] = [At || {At, _} <- Pieces],
    ?assert(First >= 20000 andalso First =< 50000),
    ?assert(Second >= First andalso Second =< 51000),
    ?assertEqual({Second, Second + ?T}, {Heard, Said}).

%% After a stop no command that was still under way is heard.
latency_stop_test() ->
    {same, [{_, Beat}], Sent} =
        starl_sim_vehicle:drive(
            wheels([{100.0, 100.0, ?T}]), {motion, a}, 0, slow_line({20000, 50000})
        ),
    {same, Stopped} = stop(10000, Sent),
    ?assertMatch({same, [], _}, starl_sim_vehicle:beat(Beat, 50000, Stopped)),
    ?assertMatch({moved, _, _}, starl_sim_vehicle:beat(Beat, 50000, Sent)).

slow_line(Us) -> starl_sim_vehicle:new(1, {0.0, 0.0, 0.0}, (world([]))#{latency_us => Us}).

%% A wheel that does not turn as told: within 15 ms both stand, and the machine is told the speeds.
stalled_test_() ->
    Long = [{100.0, 100.0, 5 * ?T}],
    [
        ?_assertMatch(
            {[{0, _}, {?T, _}, {1015000, _}], [{1015000, motion, {stalled, a, {100.0, 100.0}}}]},
            obey([{0, Long, a}], [stuck(Kind, Params)])
        )
     || {Kind, Params} <- [
            {wheel_stuck, #{wheel => left}}, {wheel_slow, #{wheel => right, factor => 0.9}}
        ]
    ].

%% A wheel that is off for a moment only, or hardly, or slips, or that is to stand, is no stall.
not_stalled_test_() ->
    Long = [{100.0, 100.0, 3 * ?T}],
    Said = fun(Fault, Script) -> element(2, obey([{0, Script, a}], [Fault])) end,
    Short = {a, ?T, ?T + 14000, wheel_stuck, 1, #{wheel => left}},
    [
        ?_assertEqual([{3 * ?T, motion, {driven, a, 0}}], Said(Fault, Script))
     || {Fault, Script} <- [
            {Short, Long},
            {stuck(wheel_slow, #{wheel => left, factor => 0.99}), Long},
            {stuck(slip, #{factor => 0.5}), Long},
            {stuck(wheel_stuck, #{wheel => left}), [{0.0, 100.0, 3 * ?T}]}
        ]
    ].

%% Turns of less than 15 ms each do not hide a stuck wheel.
short_turns_test() ->
    Script = lists:duplicate(20, {100.0, 100.0, 10000}),
    Stuck = {a, 0, 9 * ?T, wheel_stuck, 1, #{wheel => left}},
    ?assertMatch({_, [{15000, motion, {stalled, a, _}}]}, obey([{0, Script, a}], [Stuck])).

%% The error of a command is drawn once, whatever begins and ends while it is carried out.
one_error_a_command_test() ->
    Slips = [
        {list_to_atom([S]), N * ?T, (N + 1) * ?T, slip, 1, #{factor => 0.9}}
     || {S, N} <- [{$a, 1}, {$b, 3}]
    ],
    World = (world(Slips))#{profiles := [(profile())#{heading_error := 0.1}]},
    Vehicle = starl_sim_vehicle:new(1, {0.0, 0.0, 0.0}, World),
    {Pieces, _} = obey([{0, [{100.0, 100.0, 5 * ?T}], a}], Slips, Vehicle),
    Headings = [element(3, starl_trajectory:pose(T, Piece)) || {T, Piece} <- Pieces],
    ?assertEqual(6, length(Pieces)),
    ?assertMatch([Heading] when Heading /= 0.0, lists:usort(Headings)).

%% A port that is gone carries neither commands nor words; what the wheels were told they do.
port_gone_test() ->
    Long = [{100.0, 100.0, 3 * ?T}],
    Gone = {a, ?T, 4 * ?T, serial_gone, 1, #{}},
    {Pieces, Said} = obey([{0, Long, a}, {2 * ?T, [], b}, {5 * ?T, Long, c}], [Gone]),
    ?assertEqual([0, 3 * ?T, 5 * ?T, 8 * ?T], lists:usort([T || {T, _} <- Pieces]) -- [?T, 4 * ?T]),
    ?assertEqual([{8 * ?T, motion, {driven, c, 5 * ?T}}], Said).

%% Garbage swallows commands and words; split frames are late by no more than their lag.
garbled_and_split_test() ->
    Script = [{100.0, 100.0, 100000}],
    Commands = [{N * ?T, Script, N} || N <- lists:seq(0, 19)],
    Said = fun(Fault) -> element(2, obey(Commands, [Fault])) end,
    Garbage = {a, 0, 20 * ?T, serial_garbage, 1, #{part => 0.3}},
    Heard = length(Said(Garbage)),
    %% both ways have to get through: half of them
    ?assert(Heard > 4 andalso Heard < 16, Heard),
    Split = {a, 0, 20 * ?T, serial_split, 1, #{lag_ms => 50}},
    Lags = [T - N * ?T - 100000 || {T, motion, {driven, N, _}} <- Said(Split)],
    ?assertEqual({20, true, true}, {length(Lags), lists:min(Lags) >= 0, lists:max(Lags) =< 50000}),
    ?assert(length(lists:usort(Lags)) > 15).

stuck(Kind, Params) -> {a, ?T, 9 * ?T, Kind, 1, Params}.

%% Plays scripts, given as {When, Script, Mark}, for twenty seconds under these faults: the pieces
%% of motion, and what the chassis has said.
obey(Commands, Faults) -> obey(Commands, Faults, vehicle(Faults)).

obey(Commands, Faults, Vehicle) ->
    Told = [{At, 2, {tell, Script, Mark}} || {At, Script, Mark} <- Commands],
    Turns = [{At, 0, turn_wheels} || {_, From, To, _, _, _} <- Faults, At <- [From, To], At > 0],
    play(lists:sort(Told ++ Turns), Vehicle, [], []).

play([{At, _, What} | Rest], Vehicle, Pieces, Said) when At =< 20 * ?T ->
    case done(What, At, Vehicle) of
        {said, Word} ->
            play(Rest, Vehicle, Pieces, [Word | Said]);
        {Change, Plans, Next} ->
            New = [{At + Us, class(Plan), Plan} || {Us, Plan} <- Plans],
            Moved = [{At, starl_sim_vehicle:piece(Next)} || Change =:= moved],
            play(lists:sort(New ++ Rest), Next, Moved ++ Pieces, Said)
    end;
play(_, _Vehicle, Pieces, Said) ->
    {lists:reverse(Pieces), lists:reverse(Said)}.

done(turn_wheels, At, Vehicle) ->
    starl_sim_vehicle:turn_wheels(At, Vehicle);
done({tell, Script, Mark}, At, Vehicle) ->
    case starl_sim_vehicle:drive(wheels(Script), {motion, Mark}, At, Vehicle) of
        {lost, Deaf} -> {same, [], Deaf};
        Change -> Change
    end;
done({says, Run, Name, Word}, At, Vehicle) ->
    case starl_sim_vehicle:says(Run, Vehicle) of
        true -> {said, {At, Name, Word}};
        false -> {same, [], Vehicle}
    end;
done(Beat, At, Vehicle) ->
    starl_sim_vehicle:beat(Beat, At, Vehicle).

class({says, _, _, _}) -> 1;
class(_) -> 0.

%% A slow wheel makes an arc towards its side, a stuck one a turn about it, slip less of both.
faulty_wheels_test_() ->
    Turns = fun(Kind, Params) ->
        Vehicle = vehicle([fault(Kind, Params)]),
        {moved, Driving} = drive({100.0, 100.0}, 0, Vehicle),
        {_, _, Heading} = starl_trajectory:pose(?T, starl_sim_vehicle:piece(Driving)),
        Heading
    end,
    %% heading after a second: the difference of the wheels over the axle
    Axle = maps:get(axle_mm, profile()),
    [
        ?_assert(near(50.0 / Axle, Turns(wheel_slow, #{wheel => left, factor => 0.5}))),
        ?_assert(near(-50.0 / Axle, Turns(wheel_slow, #{wheel => right, factor => 0.5}))),
        ?_assert(near(100.0 / Axle, Turns(wheel_stuck, #{wheel => left}))),
        ?_assert(near(-100.0 / Axle, Turns(wheel_stuck, #{wheel => right}))),
        ?_assert(near(0.0, Turns(slip, #{factor => 0.5})))
    ].

%% A fault that ends: the wheels turn as they were told before.
healed_test() ->
    Vehicle = vehicle([fault(wheel_stuck, #{wheel => left})]),
    {moved, Arc} = drive({100.0, 100.0}, 0, Vehicle),
    {moved, Straight} = turn_wheels(10 * ?T, Arc),
    {X0, Y0} = place(10 * ?T, Straight),
    {X1, Y1} = place(11 * ?T, Straight),
    ?assert(near(100.0, math:sqrt((X1 - X0) * (X1 - X0) + (Y1 - Y0) * (Y1 - Y0)))).

%% A lost command leaves the robot in its piece; stopping is no command and cannot be lost.
lost_command_test() ->
    {moved, Driving} = drive({100.0, 100.0}, 20 * ?T, vehicle([lossy(0, 10)])),
    Lossy = vehicle([lossy(0, 10)]),
    {same, Kept} = drive({100.0, 100.0}, ?T, Lossy),
    ?assertEqual(starl_sim_vehicle:piece(Lossy), starl_sim_vehicle:piece(Kept)),
    {moved, Stopped} = stop(21 * ?T, Driving),
    ?assertEqual({100.0, 0.0}, place(30 * ?T, Stopped)).

%% A vehicle is where it was put.
place_and_heading_test() ->
    Vehicle = starl_sim_vehicle:new(1, {100.0, 200.0, 0.5}, world([])),
    ?assertEqual({100.0, 200.0, 0.5}, starl_trajectory:pose(?T, starl_sim_vehicle:piece(Vehicle))).

%% The faster wheel is on the outside of the turn.
left_and_right_test() ->
    {moved, Left} = drive({50.0, 100.0}, 0, vehicle([])),
    {_, _, Heading} = starl_trajectory:pose(?T, starl_sim_vehicle:piece(Left)),
    ?assert(near(50.0 / maps:get(axle_mm, profile()), Heading)).

%% A fault that begins while the robot drives changes how its wheels turn; one of another robot,
%% or of another time, does not.
fault_begins_test() ->
    Stuck = fun(Robot) -> {a, 2 * ?T, 9 * ?T, wheel_stuck, Robot, #{wheel => left}} end,
    Heading = fun(Faults, At) ->
        {moved, Driving} = drive({100.0, 100.0}, 0, vehicle(Faults)),
        {_, Turned} = turn_wheels(At, Driving),
        element(3, starl_trajectory:pose(At + ?T, starl_sim_vehicle:piece(Turned)))
    end,
    ?assert(Heading([Stuck(1)], 2 * ?T) > 0.1),
    [?assert(near(0.0, Heading(F, At))) || {F, At} <- [{[Stuck(2)], 2 * ?T}, {[Stuck(1)], ?T}]].

%% A command that is lost has not been heard, one to stop is not forgotten: nothing changes when a
%% fault ends.
what_was_told_last_counts_test() ->
    {same, Deaf} = drive({100.0, 100.0}, ?T, vehicle([lossy(0, 10)])),
    ?assertMatch({same, _}, turn_wheels(10 * ?T, Deaf)),
    {moved, Driving} = drive({100.0, 100.0}, 0, vehicle([])),
    {moved, Stopped} = stop(?T, Driving),
    ?assertMatch({same, _}, turn_wheels(10 * ?T, Stopped)).

%% Each command has a chance of its own to be lost, whether or not its motion errs, and each
%% motion an error of its own.
draws_are_independent_test_() ->
    Lossy = [{a, 0, 100 * ?T, command_lost, 1, #{part => 0.5}}],
    Straight = fun(Speed) -> {Speed, Speed} end,
    Turning = fun(Speed) -> {-Speed, Speed} end,
    Some = fun(Wheels) ->
        Heard = length(pieces(Wheels, Lossy)),
        ?_assertEqual({Heard, true}, {Heard, Heard > 15 andalso Heard < 45})
    end,
    Differ = fun(Faults) ->
        Turns = turns(0.0, pieces(Straight, Faults)),
        ?_assertEqual(length(Turns), length(lists:usort(Turns)))
    end,
    [Some(Straight), Some(Turning), Differ([]), Differ(Lossy)].

%% The pieces of motion that sixty commands lead to, of which some are lost.
pieces(Wheels, Faults) ->
    World = (world(Faults))#{profiles := [(profile())#{heading_error := 0.1}]},
    Step = fun(S, {Pieces, Vehicle}) ->
        case drive(Wheels(100.0 + S), S * ?T, Vehicle) of
            {moved, Next} -> {[starl_sim_vehicle:piece(Next) | Pieces], Next};
            {same, Next} -> {Pieces, Next}
        end
    end,
    Begin = {[], starl_sim_vehicle:new(1, {0.0, 0.0, 0.0}, World)},
    {Pieces, _} = lists:foldl(Step, Begin, lists:seq(1, 60)),
    lists:reverse(Pieces).

%% How the heading changes from one straight piece to the next, in urad.
turns(_Before, []) ->
    [];
turns(Before, [Piece | Pieces]) ->
    {_, _, Heading} = starl_trajectory:pose(element(2, Piece), Piece),
    [round(1.0e6 * (Heading - Before)) | turns(Heading, Pieces)].

%% The own pose is that of now, another's that of the window's beginning; strangers are not seen.
sense_test() ->
    {moved, Driving} = drive({100.0, 100.0}, 0, vehicle([])),
    {Poses, _} = starl_sim_vehicle:sense([1, 2, 3], {2 * ?T, ?T}, Driving),
    ?assertEqual([{1, {200.0, 0.0, 0.0}}, {2, {10.0, 0.0, 0.0}}], Poses).

%% Two robots at one place are seen at two.
errors_of_each_robot_test() ->
    World = (world([]))#{profiles := [(profile())#{position_error_mm := 5.0}]},
    Vehicle = starl_sim_vehicle:new(1, {0.0, 0.0, 0.0}, World),
    {[{1, {X1, Y1, _}}, {2, {X2, Y2, _}}], _} = starl_sim_vehicle:sense([1, 2], {0, 0}, Vehicle),
    ?assertNotEqual({X1, Y1}, {X2, Y2}).

%% Where sight freezes, what was seen last is seen on, and what was not seen is not; the fault
%% holds in its time only.
frozen_sight_test() ->
    Faults = [{a, 2 * ?T, 4 * ?T, location_frozen, 1, #{}}],
    Vehicle0 = starl_sim_vehicle:new(1, {0.0, 0.0, 0.0}, (world([]))#{location := Faults}),
    Look = fun(Robots, Second, Vehicle) ->
        starl_sim_vehicle:sense(Robots, {Second * ?T, Second * ?T}, Vehicle)
    end,
    {Before, Vehicle1} = Look([2], 1, Vehicle0),
    {Frozen, Vehicle2} = Look([1, 2], 3, Vehicle1),
    {After, _} = Look([2], 5, Vehicle2),
    At = fun(X) -> [{2, {X, 0.0, 0.0}}] end,
    ?assertEqual({At(10.0), At(10.0), At(50.0)}, {Before, Frozen, After}).

%% Noise is another at each look.
noise_test() ->
    Noisy = (world([]))#{location := [{a, 0, ?T, location_noise, all, #{mm => 300}}]},
    Vehicle = starl_sim_vehicle:new(1, {0.0, 0.0, 0.0}, Noisy),
    {First, Next} = starl_sim_vehicle:sense([1], {0, 0}, Vehicle),
    {Second, _} = starl_sim_vehicle:sense([1], {0, 0}, Next),
    ?assertNotEqual(First, Second).

%% Two looks at one robot err independently, within the bound.
error_test() ->
    World = (world([]))#{profiles := [(profile())#{position_error_mm := 5.0}]},
    Vehicle = starl_sim_vehicle:new(1, {0.0, 0.0, 0.0}, World),
    {[{1, {X1, Y1, _}}], Next} = starl_sim_vehicle:sense([1], {0, 0}, Vehicle),
    {[{1, {X2, Y2, _}}], _} = starl_sim_vehicle:sense([1], {0, 0}, Next),
    ?assertNotEqual({X1, Y1}, {X2, Y2}),
    [?assert(math:sqrt(X * X + Y * Y) =< 5.0) || {X, Y} <- [{X1, Y1}, {X2, Y2}]].

%% -- helpers --------------------------------------------------------------------------------

%% The wheels turn so for a long time.
drive({Left, Right}, Now, Vehicle) ->
    case starl_sim_vehicle:drive(wheels([{Left, Right, 1000 * ?T}]), {motion, m}, Now, Vehicle) of
        {lost, Deaf} -> {same, Deaf};
        {Change, _, Driving} -> {Change, Driving}
    end.

wheels(Script) -> {starl_chassis_differential, Script}.

turn_wheels(Now, Vehicle) ->
    {Change, _, Turned} = starl_sim_vehicle:turn_wheels(Now, Vehicle),
    {Change, Turned}.

stop(Now, Vehicle) ->
    {Change, [], Stopped} = starl_sim_vehicle:stop(Now, Vehicle),
    {Change, Stopped}.

vehicle(Faults) -> starl_sim_vehicle:new(1, {0.0, 0.0, 0.0}, world(Faults)).

%% Robot 2 drives with 10 mm/s along x, from where robot 1 begins.
world(Faults) ->
    Other = starl_trajectory:piece(0, {0.0, 0.0}, 0.0, 10.0, 0.0),
    #{
        seed => 1,
        team => starl_team:new([1, 2]),
        clock => {0, 0},
        loss => 0.0,
        duplicate => 0.0,
        delay_us => {1000, 2000},
        range_mm => infinity,
        profiles => [profile()],
        network => [],
        clocks => [],
        location => [],
        actuation => Faults,
        sight => starl_sim_sight:new([{2, Other}], infinity)
    }.

profile() ->
    starl_chassis:profile(starl_chassis_differential, #{
        heading_error => 0.0, distance_error => 0.0, position_error_mm => 0.0
    }).

fault(Kind, Params) -> {a, 0, 10 * ?T, Kind, 1, Params}.

lossy(FromS, ToS) -> {a, FromS * ?T, ToS * ?T, command_lost, 1, #{part => 1.0}}.

place(Time, Vehicle) -> starl_trajectory:position(Time, starl_sim_vehicle:piece(Vehicle)).

near(Want, Got) -> abs(Want - Got) < 1.0e-6.
