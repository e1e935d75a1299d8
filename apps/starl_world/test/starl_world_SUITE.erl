%% Robots in real time in one VM: the same machines and monitors as in the simulator. All waiting is
%% for events.
-module(starl_world_SUITE).
-include_lib("stdlib/include/assert.hrl").

-export([all/0, suite/0, init_per_testcase/2, end_per_testcase/2]).
-export([
    message/1,
    long_computation/1,
    machine_killed/1,
    link_killed/1,
    killed_again_and_again/1,
    all_reboot/1,
    alone/1,
    lossy/1,
    picture/1,
    slow_line_and_rare_pictures/1,
    frozen_positions/1,
    badly_placed/1,
    links_cut/1,
    scheduled/1,
    refused/1,
    stopped/1,
    store_gone/1
]).

-define(PACE, 10).

%% A run that does not end fails.
suite() -> [{timetrap, {minutes, 3}}].

all() ->
    [
        message,
        long_computation,
        machine_killed,
        link_killed,
        killed_again_and_again,
        all_reboot,
        alone,
        lossy,
        picture,
        slow_line_and_rare_pictures,
        frozen_positions,
        badly_placed,
        links_cut,
        scheduled,
        refused,
        stopped,
        store_gone
    ].

%% The run is linked to the test's own process and may end for the test's reasons only.
init_per_testcase(Case, Config) ->
    Dir = filename:join(proplists:get_value(priv_dir, Config), Case),
    _ = file:del_dir_r(Dir),
    [{dir, Dir} | Config].

end_per_testcase(_Case, _Config) -> ok.

%% -- messages -------------------------------------------------------------------------------

message(Config) ->
    Run = play(#{1 => {tell, 2, hello, self()}, 2 => wait}, Config),
    Outcome = sound(done, Run),
    ?assertEqual([{done, ok}, {done, {1, hello}}], results(Outcome)).

%% An application that computes does not keep its robot from acknowledging.
long_computation(Config) ->
    Run = play(#{1 => {tell, 2, hello, self()}, 2 => {compute, self()}}, Config),
    App =
        receive
            {computing, Pid} -> Pid
        end,
    receive
        {told, Told} -> ?assertEqual(ok, Told)
    end,
    App ! go,
    ?assertEqual([{done, ok}, {done, computed}], results(sound(done, Run))).

lossy(Config) ->
    Run = play(numbers(50), #{loss => 0.2, duplicate => 0.1}, Config),
    ?assertEqual([{done, 50}, {done, 50}], results(sound(done, Run))).

alone(Config) ->
    Run = play(#{1 => {compute, self()}}, #{robots => 1}, Config),
    receive
        {computing, Pid} -> Pid ! go
    end,
    ?assertEqual([{done, computed}], results(sound(done, Run))).

%% -- crashes --------------------------------------------------------------------------------

%% SAP crashes in the middle: the machines come back, and no contract is broken.
machine_killed(Config) ->
    Run = play(numbers(60), Config),
    heard(20),
    Machines = starl_live_link:inspect(starl_world_run:link(Run, 2)),
    ?assertMatch(#{sap := #{module := starl_sap}}, Machines),
    exit(process(sap, 2, Run), kill),
    ?assertEqual([{done, 60}, {done, 60}], results(sound(done, Run))).

%% A robot whose link ends starts anew with its store, as after a reboot; the other does not mute it.
link_killed(Config) ->
    Run = play(numbers(60), Config),
    heard(20),
    exit(starl_world_run:link(Run, 2), kill),
    Outcome = sound(done, Run),
    ?assertEqual([{done, 60}, {done, 60}], results(Outcome)),
    %% the machines of the second life count from one number, far from that of the first
    #{sap := N, app := N} = starts(2, Config),
    ?assert(N > 1 bsl 50),
    ?assertMatch(#{sap := 1, app := 1}, starts(1, Config)).

%% A robot dies fifty times while all send to all: no message is acknowledged and not delivered, and
%% afterwards everybody is acknowledged by everybody.
killed_again_and_again(Config) ->
    Enough = atomics:new(1, []),
    Play = maps:from_list([{Robot, {talk, self(), Enough}} || Robot <- [1, 2, 3]]),
    Run = play(Play, #{robots => 3, loss => 0.1}, Config),
    Random = rand:seed_s(exsss, starl_platform_ct:seed()),
    _ = lists:foldl(fun killed/2, {Run, Random}, lists:seq(1, 50)),
    ok = atomics:put(Enough, 1, 1),
    #{monitors := Monitors} = Outcome = sound(done, Run),
    %% a computer that has stood still has no verdict on what was later
    ct:log("~p", [maps:get(starl_sap_monitor, Monitors, not_judged)]),
    ?assertEqual([{done, ok}, {done, ok}, {done, ok}], results(Outcome)),
    ?assertMatch(#{sap := 1}, starts(1, Config)),
    ?assert(maps:get(sap, starts(2, Config)) > 1 bsl 50).

%% After some of its words, or in the middle of its start.
killed(_N, {Run, Random0}) ->
    {Words, Random} = rand:uniform_s(4, Random0),
    ok = spoken(Words - 1),
    ok = starl_world_run:inject(Run, [{reboot, 2, #{}, 0}]),
    {Run, Random}.

spoken(0) ->
    ok;
spoken(Words) ->
    receive
        {talked, 2} -> spoken(Words - 1)
    end.

all_reboot(Config) ->
    Run = play(numbers(60), Config),
    heard(20),
    [exit(starl_world_run:link(Run, Robot), kill) || Robot <- [1, 2]],
    _ = sound(done, Run),
    ?assert(maps:get(sap, starts(1, Config)) > 1 bsl 50).

%% A robot that cannot store the numbers of its starts does not run on as if it had never run.
store_gone(Config) ->
    _ = process_flag(trap_exit, true),
    Run = play(numbers(60), Config),
    heard(20),
    Store = filename:join([proplists:get_value(dir, Config), "run", "robot-2"]),
    ok = file:del_dir_r(Store),
    ok = file:write_file(Store, "no directory"),
    Ref = erlang:monitor(process, starl_world_run:link(Run, 2)),
    exit(process(sap, 2, Run), kill),
    receive
        {'DOWN', Ref, _, _, Reason} -> ?assertEqual({shutdown, gave_up}, Reason)
    end,
    starl_world_run:stop(Run),
    Outcome = sound(stopped, Run),
    ?assertEqual([running, running], results(Outcome)).

%% -- the world ------------------------------------------------------------------------------

%% The world knows which robot has led last.
picture(Config) ->
    Run = paint(#{}, #{}, Config),
    ?assertEqual(done, starl_world_run:await(Run)),
    #{leader := Leader} = starl_world_run:status(Run),
    #{monitors := #{starl_dpp_monitor := #{coordinators := Coordinators}}} = complete(Run),
    ?assertEqual(Leader, lists:last(Coordinators)).

%% Commands take up to 50 ms, and positions come at 13 Hz, in whole millimetres.
slow_line_and_rare_pictures(Config) ->
    Run = paint(#{command_latency => {0, 50}}, #{rate_hz => 13, whole_mm => true}, Config),
    complete(Run).

%% A robot that is shown the same picture again and again finds that out and waits.
frozen_positions(Config) ->
    Run = paint(#{}, #{}, Config),
    ok = starl_world_run:inject(Run, [{location_frozen, 1, #{}, lasting}]),
    ok = starl_world_run:until(Run, 8_000_000),
    ok = starl_world_run:heal(Run, all),
    complete(Run).

%% Two robots that stand nearer to each other than their scene wants are named, and do not drive; the third one does.
%% Their bodies are far from touching.
%% Holds: Live robots that stand nearer to each other than their scene wants are named, and do not
%% drive; others do
%% Red: d7c73771, run: both drive
badly_placed(Config) ->
    Places = #{1 => {1000.0, 1000.0}, 2 => {1000.0, 1400.0}, 3 => {4000.0, 1000.0}},
    Own = #{test => self(), places => Places, apart => 600},
    Scenario = Own#{app => starl_world_placed_app, robots => 3},
    _ = starl_live_log_ct:lines(fun() ->
        Run = start(Scenario, #{}, Config),
        receive
            {logged, <<"robot 1 stands ", _/binary>>} -> ok;
            {arrived, 1} -> ct:fail(it_drives)
        end,
        receive
            {logged, <<"robot 2 stands ", _/binary>>} -> ok;
            {arrived, 2} -> ct:fail(it_drives)
        end,
        receive
            {arrived, 3} -> ok
        end,
        ok = starl_world_run:stop(Run),
        #{robots := Robots} = Outcome = sound(stopped, Run),
        ?assertEqual([running, running, {done, arrived}], results(Outcome)),
        [{X1, Y1}, {X2, Y2}, _] = [{X, Y} || {_, #{pose := {X, Y, _}}} <- Robots],
        ?assertEqual([maps:get(1, Places), maps:get(2, Places)], [{X1, Y1}, {X2, Y2}])
    end),
    ok.

%% A cut stays for a robot that starts anew, by a fault or by its supervisor, until it is healed.
%% Holds: What hands did to a run in real time is a schedule of the simulator
%% Red: 133c6985: an outcome without faults
links_cut(Config) ->
    Run = play(numbers(60), Config),
    heard(20),
    ?assertMatch(
        {error, _}, starl_world_run:inject(Run, starl_run_manual_fault:cut(1, 3, lasting))
    ),
    ok = starl_world_run:inject(Run, starl_run_manual_fault:cut(1, 2, lasting)),
    deaf(2, none, 300, Run),
    Before = starl_world_run:link(Run, 2),
    ok = starl_world_run:inject(Run, [{reboot, 2, #{}, 0}]),
    deaf(2, Before, 300, Run),
    Killed = starl_world_run:link(Run, 2),
    exit(Killed, kill),
    deaf(2, Killed, 300, Run),
    ok = starl_world_run:heal(Run, all),
    #{faults := Faults} = Outcome = sound(done, Run),
    ?assertEqual([{done, 60}, {done, 60}], results(Outcome)),
    %% what was done is a schedule of the simulator
    ?assertEqual([], starl_run_fault:check(Faults)),
    ?assertEqual(
        [{manual_1, loss, {1, 2}}, {manual_2, loss, {2, 1}}, {manual_3, reboot, 2}],
        lists:sort([{Id, Kind, Target} || {Id, _, _, Kind, Target, _} <- Faults])
    ),
    #{sap := N, app := N} = starts(2, Config),
    ?assert(N > 1 bsl 50).

%% The robot, whose link is another one by now, has lost what it was sent: soon, as the other one sends
%% it again and again.
deaf(Robot, Before, Looks, Run) ->
    ?assert(Looks > 0),
    #{running := 2, ending := none, now_us := Now} = starl_world_run:status(Run),
    case lost(starl_world_run:link(Run, Robot), Before) of
        0 ->
            ok = starl_world_run:until(Run, Now + 100_000),
            deaf(Robot, Before, Looks - 1, Run);
        _ ->
            ok
    end.

lost(Link, Before) when Link =:= Before; Link =:= none ->
    0;
lost(Link, _Before) ->
    try starl_live_transport:figures(starl_live_link:port(Link, transport)) of
        Figures -> maps:get(air_lost, Figures, 0)
    catch
        %% it has just been killed
        exit:_ -> 0
    end.

%% Scheduled faults are reported by their names and at their times, as manual ones are; one that begins
%% after the end of the run is not.
scheduled(Config) ->
    Self = self(),
    Schedule = [
        {cut, 200, 1500, partition, [1], #{}},
        {down, 400, 900, reboot, 2, #{}},
        {lost, 2000, 2300, store_lost, 2, #{}},
        {late, 9_000_000, 9_000_001, isolate, 2, #{}}
    ],
    Told = fun
        ({fault, _, What}) ->
            Self ! What,
            ok;
        (_) ->
            ok
    end,
    Play = #{1 => {numbers, 2, 1, 1000, Self}, 2 => {count, 1, 1000, Self}},
    Scenario = #{app => starl_world_app, robots => 2, play => Play, faults => Schedule},
    Run = start(Scenario, #{observe => Told}, Config),
    [
        receive
            {Is, {Id, At, _, _, _, _}} when Is =:= began -> ?assert(At >= From);
            {Is, {Id, _, At, _, _, _}} when Is =:= ended -> ?assert(At >= To)
        end
     || Is <- [began, ended], {Id, From, To, _, _, _} <- lists:droplast(Schedule)
    ],
    ok = starl_world_run:stop(Run),
    #{faults := Faults} = sound(stopped, Run),
    ?assertEqual([cut, down, lost], lists:sort([element(1, Fault) || Fault <- Faults])).

%% Nothing runs with a fault that this world cannot play.
refused(Config) ->
    Dir = proplists:get_value(dir, Config),
    Scenario = #{
        app => starl_world_app, robots => 2, play => #{}, faults => [{a, 1, 2, pause, 1, #{}}]
    },
    {error, Why} = starl_world_run:start(Scenario, #{dir => Dir}),
    ?assertEqual(
        "fault a: pause needs a node for each robot: take ./starl cluster",
        lists:flatten(starl_sim:format_error(Why))
    ).

stopped(Config) ->
    Run = play(#{1 => wait, 2 => wait}, Config),
    ok = starl_world_run:stop(Run),
    Outcome = sound(stopped, Run),
    ?assertEqual([running, running], results(Outcome)).

%% -- helpers --------------------------------------------------------------------------------

play(Play, Config) -> play(Play, #{}, Config).

play(Play, Given, Config) ->
    Scenario = maps:merge(#{app => starl_world_app, robots => 2, play => Play}, Given),
    start(Scenario, #{}, Config).

%% Robot 1 sends the numbers up to N to robot 2, which tells the test.
numbers(N) -> #{1 => {numbers, 2, 1, N, self()}, 2 => {count, 1, N, self()}}.

paint(Given, Options, Config) ->
    File = filename:join(proplists:get_value(priv_dir, Config), "two.svg"),
    ok = file:write_file(File, [
        "<svg xmlns='http://www.w3.org/2000/svg' viewBox='0 0 100 100'>",
        "<path stroke='red' d='M 10 10 L 60 10'/><path stroke='red' d='M 10 80 L 60 80'/></svg>"
    ]),
    Scenario = #{app => starl_painting, robots => 2, picture => File},
    start(maps:merge(Scenario, Given), Options, Config).

start(Scenario, Options, Config) ->
    Dir = filename:join(proplists:get_value(dir, Config), "run"),
    All = Options#{dir => Dir, speed => ?PACE},
    {ok, Run} = starl_world_run:start(Scenario, All),
    Run.

complete(Run) ->
    ?assertEqual(done, starl_world_run:await(Run)),
    {Outcome, Report} = starl_world_run:finish(Run),
    ?assertEqual([], violations(Outcome)),
    ?assertMatch(#{complete := true}, Report),
    Outcome.

sound(Ending, Run) ->
    ?assertEqual(Ending, starl_world_run:await(Run)),
    {Outcome, _Report} = starl_world_run:finish(Run),
    ?assertEqual([], violations(Outcome)),
    Outcome.

violations(#{violations := Violations}) ->
    [lists:flatten(starl_violation:format(V)) || V <- Violations].

results(#{robots := Robots}) -> [Result || {_, #{result := Result}} <- Robots].

heard(N) ->
    receive
        {heard, 1, N} -> ok
    end.

process(Name, Robot, Run) ->
    {links, Linked} = process_info(starl_world_run:link(Run, Robot), links),
    [Sup | _] = [Pid || Pid <- Linked, is_supervisor(Pid)],
    {machines, Machines, _, _} = lists:keyfind(machines, 1, supervisor:which_children(Sup)),
    Parts = [Part || {_, Part} <- starl_robot_sup:parts(Machines)],
    [Found] = [Pid || Part <- Parts, {N, Pid, _, _} <- supervisor:which_children(Part), N =:= Name],
    Found.

is_supervisor(Pid) when is_pid(Pid) ->
    case proc_lib:translate_initial_call(Pid) of
        {supervisor, starl_live_robot, 1} -> true;
        _ -> false
    end;
is_supervisor(_) ->
    false.

starts(Robot, Config) ->
    Name = "robot-" ++ integer_to_list(Robot),
    Dir = filename:join([proplists:get_value(dir, Config), "run", Name]),
    {ok, Store} = starl_live_store:open(Dir),
    starl_live_store:starts(Store).
