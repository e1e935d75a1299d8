%% @doc The table of all kinds of faults. Each entry has the kind's class, targets, parameters, the
%% worlds that play it, the conditions that it breaks, and its effect. Kinds are drawn in this
%% order.
-module(starl_run_fault_kinds).

-export([all/0, played/1, broken/1]).

-export_type([kind/0, class/0, spec/0, played/0]).

-type class() ::
    network | clock | process | location | actuation | serial | store | sense | floor.

-type kind() ::
    loss
    | burst_loss
    | drop
    | duplicate
    | reorder
    | delay
    | corrupt
    | babble
    | partition
    | one_way_partition
    | isolate
    | ring
    | range
    | clock_offset
    | clock_drift
    | clock_step
    | clock_freeze
    | kill_machine
    | kill_robot
    | reboot
    | pause
    | stand_still
    | slow
    | location_dropout
    | location_frozen
    | location_noise
    | location_bias
    | location_swap
    | wheel_stuck
    | wheel_slow
    | command_lost
    | slip
    | actuator_lost
    | actuator_stuck
    | serial_garbage
    | serial_split
    | serial_gone
    | store_full
    | store_damaged
    | store_lost
    | store_set_back
    | sense_gone
    | sense_frozen
    | sense_noisy
    | sense_wrong
    | closed
    | obstacle.

%% A kind: its class; its target, `robots' (all or one robot), `robot', `machine' (`{Robot,
%% Machine}'), `link' (all, the source Robot, or {Source, Destination}), a `group' of robots, or
%% `two' robots, the `floor' (all); and its parameters, each with a range for random faults.
-type spec() :: {
    kind(),
    class(),
    robots | robot | machine | link | group | two | floor,
    [{Key :: atom(), starl_options:type(), Drawn :: {number(), number()}}],
    Doc :: string()
}.

%% Where a kind can be played: in the simulator alone, on a node for each robot as well, or in real time
%% wherever the robots are.
-type played() :: simulated | nodes | live.

%% @doc All of them.
-spec all() -> [spec()].
all() -> [{Kind, Class, Shape, Params, Doc} || {Kind, Class, Shape, Params, _, _, Doc} <- table()].

%% @doc Where a kind can be played.
-spec played(kind()) -> played().
played(Kind) ->
    {_, _, _, _, Played, _, _} = lists:keyfind(Kind, 1, table()),
    Played.

%% @doc The conditions that a kind may break, whatever its parameters ({@link starl_run_condition}).
-spec broken(kind()) -> [starl_guarantee:condition()].
broken(Kind) ->
    {_, _, _, _, _, Broken, _} = lists:keyfind(Kind, 1, table()),
    Broken.

table() ->
    lists:append([
        of_network(),
        of_clocks(),
        of_processes(),
        of_positions(),
        of_actuators(),
        of_serial_lines(),
        of_stores(),
        of_senses(),
        of_floor()
    ]).

of_network() ->
    [
        {loss, network, link, [part(0.05, 0.9)], live, [no_loss],
            "this part of the packets is lost"},
        {burst_loss, network, link, [part(0.1, 0.6), ms(burst_ms, 20, 500)], simulated, [no_loss],
            "all packets are lost, in bursts of burst_ms, for this part of the time"},
        {drop, network, link, [{packet, {integer, 1, 1000000000}, {1, 200}}], simulated, [no_loss],
            "the packet of this number on each of these links is lost"},
        {duplicate, network, link, [part(0.05, 0.6)], live, [],
            "this part of the packets arrives twice"},
        {reorder, network, link, [part(0.05, 0.6), ms(extra_ms, 10, 300)], live, [quick],
            "this part of the packets is up to extra_ms late"},
        {delay, network, link, [ms(extra_ms, 10, 4000)], live, [quick],
            "all packets are extra_ms late"},
        {corrupt, network, link, [part(0.05, 0.5)], simulated, [no_loss],
            "this part of the packets arrives cut off or with a flipped bit"},
        {babble, network, robot, [{copies, {integer, 2, 100}, {2, 6}}], live, [],
            "the robot sends each packet this many times"},
        {partition, network, group, [], live, [delivery, no_loss],
            "the group and the others hear nothing of each other"},
        {one_way_partition, network, group, [], live, [delivery, no_loss],
            "the others hear nothing of the group"},
        {isolate, network, robot, [], live, [delivery, no_loss],
            "the robot hears nothing and is not heard"},
        {ring, network, robots, [], live, [delivery, no_loss],
            "robots hear only their neighbours in the ring of the team"},
        {range, network, robots, [{range_mm, {number, 1, 10000000}, {1500, 8000}}], simulated,
            [delivery, no_loss], "the radio reaches no farther"}
    ].

of_clocks() ->
    [
        {clock_offset, clock, robot, [shift(2000)], simulated,
            [clock_set, clock_jump, clock_forward, clock_near, quick],
            "the clock is off, and comes right again"},
        {clock_drift, clock, robot, [{ppm, {number, -100000, 100000}, {-500, 500}}], simulated,
            [clock_rate, clock_near], "the clock drifts by this much more"},
        {clock_step, clock, robot, [shift(2000)], simulated,
            [clock_set, clock_jump, clock_forward, clock_near, quick],
            "the clock is set forward or back"},
        {clock_freeze, clock, robot, [], simulated, [clock_rate, clock_near, quick],
            "the clock stands still, and goes on from there"}
    ].

of_processes() ->
    [
        {kill_machine, process, machine, [], live, [no_restart],
            "a machine crashes; it is restarted"},
        {kill_robot, process, robot, [], live, [alive, no_loss], "the robot dies for good"},
        {reboot, process, robot, [], live, [no_restart, no_loss],
            "the robot goes down and starts anew, with its store"},
        {pause, process, robot, [], nodes, [prompt, quick],
            "the robot's computer stands still; events wait"},
        {stand_still, process, machine, [{actions, {integer, 0, 1000}, {0, 6}}], simulated,
            [prompt, quick],
            "the robot's computer stands still in the machine's next step that has more actions, "
            "after so many of them; events wait"},
        {slow, process, robot, [ms(lag_ms, 5, 200)], simulated, [prompt, quick],
            "every event is handled lag_ms late"}
    ].

of_positions() ->
    [
        {location_dropout, location, robots, [], live, [],
            "the positioning system sees no robot for them"},
        {location_frozen, location, robots, [], live, [positions],
            "the positioning system shows old positions"},
        {location_noise, location, robots, [mm(1, 50)], live, [positions],
            "the positioning system errs by up to this much more"},
        {location_bias, location, robots, [mm(1, 50)], live, [positions],
            "the positioning system shifts all robots by this much"},
        {location_swap, location, two, [], live, [positions],
            "the positioning system swaps two robots"}
    ].

of_actuators() ->
    [
        {wheel_stuck, actuation, robot, [{wheel, {one_of, [left, right]}, {0, 1}}], simulated,
            [devices],
            "a wheel does not turn (holonomic: left, the drive forwards; right, sideways)"},
        {wheel_slow, actuation, robot,
            [{wheel, {one_of, [left, right]}, {0, 1}}, {factor, {number, 0, 1}, {0.3, 0.95}}],
            simulated, [devices], "a wheel turns slower than commanded (holonomic: likewise)"},
        {command_lost, actuation, robot, [part(0.05, 0.5)], simulated, [devices],
            "this part of the commands to the chassis is not heard"},
        {slip, actuation, robot, [{factor, {number, 0, 1}, {0.5, 0.98}}], simulated, [grip],
            "both wheels slip, or wind: the robot drives only this part of the way"},
        {actuator_lost, actuation, robot, [part(0.05, 0.9)], simulated, [devices],
            "this part of the commands to other actuators, such as the pen, is not heard"},
        {actuator_stuck, actuation, robot, [], simulated, [devices],
            "other actuators, such as the pen, do not move"}
    ].

of_serial_lines() ->
    [
        {serial_garbage, serial, robot, [part(0.05, 0.5)], simulated, [devices],
            "this part of the frames to and from the chassis is garbage and dropped"},
        {serial_split, serial, robot, [ms(lag_ms, 5, 200)], simulated, [devices],
            "the chassis' answers come in pieces, up to lag_ms late"},
        {serial_gone, serial, robot, [], live, [devices],
            "the chassis' port vanishes, and comes back"}
    ].

of_stores() ->
    [
        {store_full, store, robot, [], nodes, [store, no_restart],
            "nothing can be stored: a machine that tries crashes"},
        {store_damaged, store, robot, [], simulated, [store],
            "machines that start find their stored terms damaged"},
        {store_lost, store, robot, [], live, [store, no_restart, no_loss],
            "the robot goes down and starts anew, with an empty store"},
        {store_set_back, store, robot, [], live, [store, no_restart, no_loss],
            "the robot reboots, and in the end once more, with its store as it was at first"}
    ].

of_senses() ->
    [
        {sense_gone, sense, robots, [sense()], live, [senses], "the sense does not answer"},
        {sense_frozen, sense, robots, [sense()], live, [senses],
            "the sense says what it said last"},
        {sense_noisy, sense, robots, [sense(), {times, {number, 1, 1000}, {2, 20}}], live, [senses],
            "the sense errs so many times as much"},
        {sense_wrong, sense, robots, [sense()], live, [senses], "the sense says anything"}
    ].

of_floor() ->
    [
        {closed, floor, floor, [{door, {integer, 1, 100000}, {1, 8}}], simulated, [ways],
            "the door of this number on the floor plan is closed"},
        {obstacle, floor, floor,
            [
                place(x), place(y), side(width), side(height)
            ],
            simulated, [ways], "a box stands on the floor, its lower left corner at x, y (mm)"}
    ].

place(Key) -> {Key, {number, 0, 1000000}, {0, 10000}}.

side(Key) -> {Key, {number, 1, 1000000}, {100, 800}}.

sense() ->
    Senses = [all | [Kind || {Kind, _} <- starl_sense:kinds()]],
    {sense, {one_of, Senses}, {1, length(Senses)}}.

part(Low, High) -> {part, {number, 0, 1}, {Low, High}}.

ms(Key, Low, High) -> {Key, {integer, 1, 3600000}, {Low, High}}.

mm(Low, High) -> {mm, {number, 0, 100000}, {Low, High}}.

shift(Ms) -> {ms, {integer, -3600000, 3600000}, {-Ms, Ms}}.
