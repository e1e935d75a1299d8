%% What a crash leaves of a robot, with machines that have no processes: who is started and told,
%% what becomes of motion and timers, and which faults strike a robot that is down or dead.
-module(starl_sim_crash_tests).
-include_lib("eunit/include/eunit.hrl").

-define(NAMES, [sap, motion, block, app]).

%% All machines start in their order: the platform's first, the application last.
boots_test() -> ?assertEqual([{Name, boot, none} || Name <- ?NAMES], left(robot())).

%% The machine starts again, then the others are told, not itself; its timers are forgotten, the
%% others' are not, and the robot drives on.
machine_crashed_test() ->
    Robot = crashed(motion, killed, driving()),
    ?assertEqual(
        [{motion, boot, none} | [{To, info, {restarted, motion}} || To <- [sap, block, app]]],
        left(Robot)
    ),
    ?assertEqual([{100, 1, motion, crashed}], traced(Robot)),
    ?assertEqual({stale, ok}, {timer(motion, 0, Robot), timer(app, 1, Robot)}),
    ?assertNot(is_still(Robot)),
    ?assertEqual(
        {up, 2, 1}, {starl_robot:condition(Robot), starts(motion, Robot), starts(app, Robot)}
    ).

%% Who has yet to start is not told that another one has.
not_told_before_the_start_test() ->
    {_, Begun} = starl_robot:next(robot()),
    ?assertEqual(
        [{sap, boot, none} | [{Name, boot, none} || Name <- [motion, block, app]]],
        left(crashed(sap, killed, Begun))
    ).

%% What crashed by itself is told with its cause, what was killed is not.
cause_is_told_test() ->
    Reason =
        {oops, [{m, f, [1, 2], [{file, "/a/m.erl"}, {line, 7}]}, {starl_machine, step, 4, []}]},
    ?assertEqual(
        [
            {100, 1, block, crashed},
            {100, 1, supervisor, {crashed, block, {"oops", [{m, f, 2, "m.erl", 7}]}}}
        ],
        traced(crashed(block, Reason, driving()))
    ).

%% An application that crashes too often is given up: its robot stops, its services and blocks are
%% told and go on, and the application has ended.
app_given_up_test() ->
    Robot = crashed(app, killed, crash_often(1000, app, driving())),
    ?assertEqual(
        [{motion, cast, stop} | [{To, info, {given_up, app}} || To <- [sap, motion, block]]],
        left(Robot)
    ),
    ?assertEqual({up, [sap, motion, block]}, {starl_robot:condition(Robot), names(Robot)}),
    ?assertMatch({100, 1, supervisor, {given_up, app}}, lists:last(traced(Robot))),
    ?assertEqual(given_up, starl_sim_platform:result(starl_robot:world(Robot))),
    ?assertMatch({_, _, [ended]}, starl_sim_platform:yield(starl_robot:world(Robot))).

%% Likewise a block, but the robot drives on: its application knows what to do about it.
block_given_up_test() ->
    Robot = crashed(block, killed, crash_often(1000, block, driving())),
    ?assertEqual([{To, info, {given_up, block}} || To <- [sap, motion, app]], left(Robot)),
    ?assertEqual([sap, motion, app], names(Robot)),
    ?assertEqual(running, starl_sim_platform:result(starl_robot:world(Robot))).

%% Each block and the application have restarts of their own, the services have theirs together:
%% without them the robot has died.
services_given_up_test() ->
    Robot = crash_often(1, motion, crash_often(999, sap, crash_often(1000, app, driving()))),
    ?assertEqual(gave_up, crashed(sap, killed, Robot)).

crash_often(0, _Name, Robot) ->
    Robot;
crash_often(N, Name, Robot) ->
    crash_often(N - 1, Name, quiet(crashed(Name, killed, Robot))).

%% A robot that dies stands where it is, its application has ended, and no machine is left.
dies_test_() ->
    [
        {atom_to_list(Reason), fun() ->
            Robot = starl_robot:die(Reason, driving()),
            ?assertEqual({dead, [], []}, {starl_robot:condition(Robot), names(Robot), left(Robot)}),
            ?assertMatch(
                [{100, 1, chassis, {motion, _}}, {100, 1, robot, {died, Reason}}],
                traced(Robot)
            ),
            ?assertMatch(
                {_, _, [ended, moved]}, starl_sim_platform:yield(starl_robot:world(Robot))
            ),
            ?assert(is_still(Robot))
        end}
     || Reason <- [killed, gave_up]
    ].

%% A robot that goes down stops, and all its machines are lost with their timers; it comes up anew
%% with the next incarnation of each.
down_and_up_test() ->
    Down = starl_robot:go_down(driving()),
    ?assert(is_still(Down)),
    ?assertEqual({down, [], []}, {starl_robot:condition(Down), names(Down), left(Down)}),
    ?assertEqual([stale, stale], [timer(motion, 0, Down), timer(app, 1, Down)]),
    ?assertMatch(
        [
            {100, 1, chassis, {motion, _}},
            {100, 1, robot, down}
            | [
                {100, 1, _, crashed},
                {100, 1, _, crashed},
                {100, 1, _, crashed},
                {100, 1, _, crashed}
            ]
        ],
        traced(Down)
    ),
    ?assertEqual(?NAMES, [Name || {_, _, Name, crashed} <- traced(Down)]),
    Up = starl_robot:come_up(starl_robot_machines:up(first, starl_robot:machines(Down)), Down),
    ?assertEqual([{Name, boot, none} || Name <- ?NAMES], left(Up)),
    ?assertEqual({100, 1, robot, up}, lists:last(traced(Up))),
    ?assertEqual(
        {up, [2, 2, 2, 2]}, {starl_robot:condition(Up), [starts(Name, Up) || Name <- ?NAMES]}
    ).

%% A dead robot is not killed again and does not come up, one that is down can be killed and does
%% not go down again, and one that is up need not come up.
strikes_that_change_nothing_test() ->
    Up = site(),
    Down = struck(go_down, Up),
    Dead = struck(kill_robot, Up),
    [
        ?assertEqual({Fault, []}, {Fault, facts(struck(Fault, Site))})
     || {Fault, Site} <- [
            {come_up, Up},
            {go_down, Down},
            {kill_robot, Dead},
            {go_down, Dead},
            {come_up, Dead}
        ]
    ],
    ?assertEqual([{died, killed}], facts(struck(kill_robot, Down))).

%% -- helpers --------------------------------------------------------------------------------

machines() ->
    starl_robot_machines:new(
        maps:from_list([{Name, {starl_sim_crash_machine, #{}}} || Name <- ?NAMES])
    ).

robot() -> starl_robot:new(1, starl_sim_platform, body(), machines()).

%% What it still has to do.
left(Robot) ->
    case starl_robot:next(Robot) of
        {Event, Rest} -> [Event | left(Rest)];
        none -> []
    end.

quiet(Robot) ->
    case starl_robot:next(Robot) of
        {_, Rest} -> quiet(Rest);
        none -> Robot
    end.

names(Robot) -> starl_robot_machines:names(starl_robot:machines(Robot)).

starts(Name, Robot) -> starl_robot_machines:incarnation(Name, starl_robot:machines(Robot)).

%% As the simulator sees to a crash.
crashed(Name, Reason, Robot) ->
    Bare = starl_robot:lost(Name, Reason, Robot),
    {Tree, _} = starl_robot_tree:launch(1, none, #{}),
    case starl_robot_tree:restart(Name, starl_robot:machines(Bare), Tree) of
        {ok, #{back := Back, given_up := GivenUp, lost := []}, Machines} ->
            starl_robot:back(Back, GivenUp, starl_robot:machines(Machines, Bare));
        gave_up ->
            gave_up
    end.

body() ->
    World = #{
        seed => 1,
        team => starl_team:new([1]),
        clock => {0, 0},
        loss => 0.0,
        duplicate => 0.0,
        delay_us => {1000, 2000},
        range_mm => infinity,
        profiles => [starl_chassis:profile(starl_chassis_differential, #{})],
        network => [],
        clocks => [],
        location => [],
        actuation => [],
        store => [],
        sight => starl_sim_sight:new([], infinity)
    },
    starl_sim_platform:new(1, {0.0, 0.0, 0.0}, World).

%% It drives, 100 us after the beginning of a window; timer 0 is of motion, timer 1 of app.
driving() ->
    {0, Waiting} = starl_sim_platform:plan(
        motion, t, 500, x, starl_sim_platform:open(0, {0, 1000}, body())
    ),
    {1, Both} = starl_sim_platform:plan(app, t, 500, x, Waiting),
    Script = {starl_chassis_differential, [{100.0, 100.0, 1000000}]},
    {[], Body} = starl_sim_platform:perform({drive, Script, m}, motion, Both),
    starl_robot:restore(#{
        id => 1,
        driver => starl_sim_platform,
        condition => up,
        machines => machines(),
        timers => starl_robot_timers:from_list([{motion, t, 0}, {app, t, 1}]),
        %% a new window: what has come out so far is gone
        world => starl_sim_platform:open(100, {100, 1100}, Body)
    }).

traced(Robot) ->
    {_, Traces, _} = starl_sim_platform:yield(starl_robot:world(Robot)),
    lists:reverse(Traces).

is_still(Robot) ->
    starl_trajectory:is_still(starl_sim_platform:piece(starl_robot:world(Robot))).

%% Is the timer of this number still waited for?
timer(Machine, Seq, Robot) ->
    case starl_robot:expire(Machine, t, Seq, Robot) of
        {ok, {timeout, t}, _} -> ok;
        stale -> stale
    end.

%% A robot of a shard, which has booted.
site() ->
    {Tree, _} = starl_robot_tree:launch(1, none, #{}),
    struck(wake, starl_sim_robot:new(1, body(), machines(), Tree)).

struck(Fault, Site) ->
    {idle, Struck} = starl_sim_robot:open([{1, 0, 0, 0, 0, Fault}], {0, 1000}, Site),
    Struck.

%% What was traced of the robot itself in the last window.
facts(Site) ->
    {_, Traces, _} = starl_sim_robot:yield(Site),
    lists:reverse([Event || {_, 1, robot, Event} <- Traces]).
