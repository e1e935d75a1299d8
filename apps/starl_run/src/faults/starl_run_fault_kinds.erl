%% @doc The table of the kinds of faults: each with its class, its possible targets, its parameters, and
%% what it does. Kinds are drawn in this order.
-module(starl_run_fault_kinds).

-export([all/0]).

-export_type([kind/0, class/0, spec/0]).

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

%% @doc All of them.
-spec all() -> [spec()].
all() ->
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
        {loss, network, link, [part(0.05, 0.9)], "this part of the packets is lost"},
        {burst_loss, network, link, [part(0.1, 0.6), ms(burst_ms, 20, 500)],
            "all packets are lost, in bursts of burst_ms, for this part of the time"},
        {drop, network, link, [{packet, {integer, 1, 1000000000}, {1, 200}}],
            "the packet of this number on each of these links is lost"},
        {duplicate, network, link, [part(0.05, 0.6)], "this part of the packets arrives twice"},
        {reorder, network, link, [part(0.05, 0.6), ms(extra_ms, 10, 300)],
            "this part of the packets is up to extra_ms late"},
        {delay, network, link, [ms(extra_ms, 10, 4000)], "all packets are extra_ms late"},
        {corrupt, network, link, [part(0.05, 0.5)],
            "this part of the packets arrives cut off or with a flipped bit"},
        {babble, network, robot, [{copies, {integer, 2, 100}, {2, 6}}],
            "the robot sends each packet this many times"},
        {partition, network, group, [], "the group and the others hear nothing of each other"},
        {one_way_partition, network, group, [], "the others hear nothing of the group"},
        {isolate, network, robot, [], "the robot hears nothing and is not heard"},
        {ring, network, robots, [], "robots hear only their neighbours in the ring of the team"},
        {range, network, robots, [{range_mm, {number, 1, 10000000}, {1500, 8000}}],
            "the radio reaches no farther"}
    ].

of_clocks() ->
    [
        {clock_offset, clock, robot, [shift(2000)], "the clock is off, and comes right again"},
        {clock_drift, clock, robot, [{ppm, {number, -100000, 100000}, {-500, 500}}],
            "the clock drifts by this much more"},
        {clock_step, clock, robot, [shift(2000)], "the clock is set forward or back"},
        {clock_freeze, clock, robot, [], "the clock stands still, and goes on from there"}
    ].

of_processes() ->
    [
        {kill_machine, process, machine, [], "a machine crashes; it is restarted"},
        {kill_robot, process, robot, [], "the robot dies for good"},
        {reboot, process, robot, [], "the robot goes down and starts anew, with its store"},
        {pause, process, robot, [], "the robot's computer stands still; events wait"},
        {stand_still, process, machine, [{actions, {integer, 0, 1000}, {0, 6}}],
            "the robot's computer stands still in the machine's next step that has more actions, "
            "after so many of them; events wait"},
        {slow, process, robot, [ms(lag_ms, 5, 200)], "every event is handled lag_ms late"}
    ].

of_positions() ->
    [
        {location_dropout, location, robots, [], "the positioning system sees no robot for them"},
        {location_frozen, location, robots, [], "the positioning system shows old positions"},
        {location_noise, location, robots, [mm(1, 50)],
            "the positioning system errs by up to this much more"},
        {location_bias, location, robots, [mm(1, 50)],
            "the positioning system shifts all robots by this much"},
        {location_swap, location, two, [], "the positioning system swaps two robots"}
    ].

of_actuators() ->
    [
        {wheel_stuck, actuation, robot, [{wheel, {one_of, [left, right]}, {0, 1}}],
            "a wheel does not turn (holonomic: left, the drive forwards; right, sideways)"},
        {wheel_slow, actuation, robot,
            [{wheel, {one_of, [left, right]}, {0, 1}}, {factor, {number, 0, 1}, {0.3, 0.95}}],
            "a wheel turns slower than commanded (holonomic: likewise)"},
        {command_lost, actuation, robot, [part(0.05, 0.5)],
            "this part of the commands to the chassis is not heard"},
        {slip, actuation, robot, [{factor, {number, 0, 1}, {0.5, 0.98}}],
            "both wheels slip, or wind: the robot drives only this part of the way"},
        {actuator_lost, actuation, robot, [part(0.05, 0.9)],
            "this part of the commands to other actuators, such as the pen, is not heard"},
        {actuator_stuck, actuation, robot, [], "other actuators, such as the pen, do not move"}
    ].

of_serial_lines() ->
    [
        {serial_garbage, serial, robot, [part(0.05, 0.5)],
            "this part of the frames to and from the chassis is garbage and dropped"},
        {serial_split, serial, robot, [ms(lag_ms, 5, 200)],
            "the chassis' answers come in pieces, up to lag_ms late"},
        {serial_gone, serial, robot, [], "the chassis' port vanishes, and comes back"}
    ].

of_stores() ->
    [
        {store_full, store, robot, [], "nothing can be stored: a machine that tries crashes"},
        {store_damaged, store, robot, [], "machines that start find their stored terms damaged"},
        {store_lost, store, robot, [], "the robot goes down and starts anew, with an empty store"},
        {store_set_back, store, robot, [],
            "the robot reboots, and in the end once more, with its store as it was at first"}
    ].

of_senses() ->
    [
        {sense_gone, sense, robots, [sense()], "the sense does not answer"},
        {sense_frozen, sense, robots, [sense()], "the sense says what it said last"},
        {sense_noisy, sense, robots, [sense(), {times, {number, 1, 1000}, {2, 20}}],
            "the sense errs so many times as much"},
        {sense_wrong, sense, robots, [sense()], "the sense says anything"}
    ].

of_floor() ->
    [
        {closed, floor, floor, [{door, {integer, 1, 100000}, {1, 8}}],
            "the door of this number on the floor plan is closed"},
        {obstacle, floor, floor,
            [
                place(x), place(y), side(width), side(height)
            ],
            "a box stands on the floor, its lower left corner at x, y (mm)"}
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
