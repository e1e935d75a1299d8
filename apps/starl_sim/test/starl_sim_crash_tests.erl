%% What a crash leaves of a robot, with machines that have no processes: who is started and told,
%% what becomes of motion and timers, and which faults strike a robot that is down or dead.
-module(starl_sim_crash_tests).
-include_lib("eunit/include/eunit.hrl").

-define(NAMES, [sap, motion, block, app]).

%% All machines start in their order: the platform's first, the application last.
boots_test() ->
    ?assertEqual([{Name, boot, none} || Name <- ?NAMES], starl_sim_crash:boots(machines())).

%% The machine starts again, then the others are told, not itself; its timers are forgotten, the
%% others' are not, and the robot drives on.
machine_crashed_test() ->
    {Aftermath, Body, Machines} = starl_sim_crash:crashed(motion, killed, driving(), machines()),
    ?assertEqual(
        {first, [{motion, boot, none} | [{To, info, {restarted, motion}} || To <- [sap, block, app]]]},
        Aftermath
    ),
    ?assertEqual([{100, 1, motion, crashed}], traced(Body)),
    ?assertEqual({stale, ok}, {timer(motion, 0, Body), timer(app, 1, Body)}),
    ?assertNot(is_still(Body)),
    ?assertEqual(
        {up, 2, 1},
        {starl_sim_machines:condition(Machines), starl_sim_machines:incarnation(motion, Machines),
         starl_sim_machines:incarnation(app, Machines)}
    ).

%% What crashed by itself is told with its cause, what was killed is not.
cause_is_told_test() ->
    Reason = {oops, [{m, f, [1, 2], [{file, "/a/m.erl"}, {line, 7}]}, {starl_machine, step, 4, []}]},
    {_, Body, _} = starl_sim_crash:crashed(block, Reason, driving(), machines()),
    ?assertEqual(
        [{100, 1, block, crashed},
         {100, 1, supervisor, {crashed, block, {"oops", [{m, f, 2, "m.erl", 7}]}}}],
        traced(Body)
    ).

%% An application that crashes too often is given up: its robot stops, its services and blocks are
%% told and go on, and the application has ended.
app_given_up_test() ->
    {Body, Machines} = crash_often(1000, app, driving(), machines()),
    {{first, Told}, Left, Back} = starl_sim_crash:crashed(app, killed, Body, Machines),
    ?assertEqual(
        [{motion, cast, stop} | [{To, info, {given_up, app}} || To <- [sap, motion, block]]], Told
    ),
    ?assertEqual({up, [sap, motion, block]}, {starl_sim_machines:condition(Back),
                                              starl_sim_machines:names(Back)}),
    ?assertMatch({100, 1, supervisor, {given_up, app}}, lists:last(traced(Left))),
    ?assertEqual(given_up, starl_sim_platform:result(Left)),
    ?assertMatch({_, _, [ended]}, starl_sim_platform:yield(Left)).

%% Likewise a block, but the robot drives on: its application knows what to do about it.
block_given_up_test() ->
    {Body, Machines} = crash_often(1000, block, driving(), machines()),
    {{first, Told}, Left, Back} = starl_sim_crash:crashed(block, killed, Body, Machines),
    ?assertEqual([{To, info, {given_up, block}} || To <- [sap, motion, app]], Told),
    ?assertEqual([sap, motion, app], starl_sim_machines:names(Back)),
    ?assertEqual(running, starl_sim_platform:result(Left)).

%% Each block and the application have restarts of their own, the services have theirs together:
%% without them the robot has died.
services_given_up_test() ->
    {Body0, Machines0} = crash_often(1000, app, driving(), machines()),
    {Body1, Machines1} = crash_often(999, sap, Body0, Machines0),
    {Body, Machines} = crash_often(1, motion, Body1, Machines1),
    {nothing, Dead, Gone} = starl_sim_crash:crashed(sap, killed, Body, Machines),
    ?assertEqual(dead, starl_sim_machines:condition(Gone)),
    ?assertMatch({100, 1, robot, {died, gave_up}}, lists:last(traced(Dead))).

crash_often(0, _Name, Body, Machines) ->
    {Body, Machines};
crash_often(N, Name, Body, Machines) ->
    {{first, [{Name, boot, none} | _]}, Bare, Back} =
        starl_sim_crash:crashed(Name, killed, Body, Machines),
    crash_often(N - 1, Name, Bare, Back).

%% A robot that dies stands where it is, its application has ended, and no machine is left.
dies_test_() ->
    Ways = [
        {killed, fun(Body) -> starl_sim_crash:strike(kill_robot, Body, machines()) end},
        {gave_up, fun(Body) -> starl_sim_crash:die(gave_up, Body, machines()) end}
    ],
    [
        {atom_to_list(Reason), fun() ->
            {nothing, Body, Machines} = Die(driving()),
            ?assertEqual({dead, []}, {starl_sim_machines:condition(Machines),
                                      starl_sim_machines:names(Machines)}),
            ?assertMatch([{100, 1, chassis, {motion, _}}, {100, 1, robot, {died, Reason}}],
                         traced(Body)),
            ?assertMatch({_, _, [ended, moved]}, starl_sim_platform:yield(Body)),
            ?assert(is_still(Body))
        end}
     || {Reason, Die} <- Ways
    ].

%% A robot that goes down stops, and all its machines are lost with their timers; it comes up anew
%% with the next incarnation of each.
down_and_up_test() ->
    {faults_only, Down, Gone} = starl_sim_crash:strike(go_down, driving(), machines()),
    ?assert(is_still(Down)),
    ?assertEqual({down, []}, {starl_sim_machines:condition(Gone), starl_sim_machines:names(Gone)}),
    ?assertEqual([stale, stale], [timer(motion, 0, Down), timer(app, 1, Down)]),
    ?assertMatch(
        [{100, 1, chassis, {motion, _}}, {100, 1, robot, down}
            | [{100, 1, _, crashed}, {100, 1, _, crashed}, {100, 1, _, crashed},
               {100, 1, _, crashed}]],
        traced(Down)
    ),
    ?assertEqual(?NAMES, [Name || {_, _, Name, crashed} <- traced(Down)]),
    {{anew, Boots}, Up, Back} = starl_sim_crash:strike(come_up, Down, Gone),
    ?assertEqual([{Name, boot, none} || Name <- ?NAMES], Boots),
    ?assertEqual({100, 1, robot, up}, lists:last(traced(Up))),
    ?assertEqual(
        {up, [2, 2, 2, 2]},
        {starl_sim_machines:condition(Back),
         [starl_sim_machines:incarnation(Name, Back) || Name <- ?NAMES]}
    ).

%% A dead robot is not killed again and does not come up, one that is down can be killed and does
%% not go down again, and one that is up need not come up.
strikes_that_change_nothing_test() ->
    Body = driving(),
    {_, _, Down} = starl_sim_crash:strike(go_down, Body, machines()),
    {_, _, Dead} = starl_sim_crash:strike(kill_robot, Body, machines()),
    [
        ?assertEqual({Fault, {go_on, Body, M}}, {Fault, starl_sim_crash:strike(Fault, Body, M)})
     || {Fault, M} <- [
            {come_up, machines()}, {go_down, Down},
            {kill_robot, Dead}, {go_down, Dead}, {come_up, Dead}
        ]
    ],
    ?assertMatch({nothing, _, _}, starl_sim_crash:strike(kill_robot, Body, Down)).

%% -- helpers --------------------------------------------------------------------------------

machines() ->
    Inline = maps:from_list([{Name, {starl_sim_crash_machine, #{}}} || Name <- ?NAMES]),
    starl_sim_machines:new(1, none, Inline).

%% It drives, 100 us after the beginning of a window; timer 0 is of motion, timer 1 of app.
driving() ->
    World = #{
        seed => 1, team => starl_team:new([1]), clock => {0, 0}, loss => 0.0, duplicate => 0.0,
        delay_us => {1000, 2000}, range_mm => infinity, profile => starl_motion_course:profile(#{}),
        network => [], clocks => [], location => [], actuation => [], store => [],
        sight => starl_sim_sight:new([], infinity)
    },
    New = starl_sim_platform:new(1, {0.0, 0.0, 0.0}, World),
    {[], Waiting} = starl_sim_platform:perform(
        [{{timeout, t}, 500, x}], motion, starl_sim_platform:open(0, {0, 1000}, New)
    ),
    {[], Both} = starl_sim_platform:perform([{{timeout, t}, 500, x}], app, Waiting),
    Script = [{100.0, 100.0, 1000000}],
    {[], Body} = starl_sim_platform:perform([{drive, Script, m}], motion, Both),
    %% a new window: what has come out so far is gone
    starl_sim_platform:open(100, {100, 1100}, Body).

traced(Body) ->
    {_, Traces, _} = starl_sim_platform:yield(Body),
    lists:reverse(Traces).

is_still(Body) -> starl_trajectory:is_still(starl_sim_platform:piece(Body)).

%% Is the timer of this number still waited for?
timer(Machine, Seq, Body) ->
    case starl_sim_platform:fire(600, Machine, t, x, Seq, Body) of
        {ok, {timeout, t}, _} -> ok;
        stale -> stale
    end.
