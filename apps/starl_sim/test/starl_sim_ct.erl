%% Runs of applications that are functions (starl_sim_script_app), and what came of them.
-module(starl_sim_ct).
-include_lib("stdlib/include/assert.hrl").

-export([
    start/3,
    run/1,
    play/3,
    played/3,
    end_of/1,
    well_ended/1,
    trace/1,
    crashing/1,
    point/1,
    pid_of/3,
    kill/2,
    robot_of/1,
    no_jump/1
]).

-define(APP, starl_sim_script_app).
%% No run waits for ever, however busy the machine.
-define(WALL_MS, 50000).

start(N, Script, Scenario) ->
    starl_sim:start(
        maps:merge(#{app => ?APP, robots => N, script => Script, time => 3600}, Scenario)
    ).

%% Runs a scenario to its end: the outcome and how it ended.
run(Scenario) ->
    {ok, Sim} = starl_sim:start(Scenario),
    #{ending := Ending} = starl_sim:run(Sim),
    {Outcome, _} = starl_sim:finish(Sim),
    Outcome#{ending => Ending}.

%% Plays to the end: the outcome, the robots' results, the trace. No contract may be broken.
play(N, Script, Scenario) ->
    {Outcome, _, _} = Played = played(N, Script, Scenario),
    ?assertEqual([], maps:get(violations, Outcome)),
    Played.

%% The same where contracts may be broken.
played(N, Script, Scenario) ->
    Outcome = starl_platform_ct:within(?WALL_MS, fun() ->
        {ok, Sim} = start(N, Script, Scenario),
        starl_sim:run(Sim),
        {O, _} = starl_sim:finish(Sim),
        O
    end),
    {Outcome, [Result || {_, #{result := Result}} <- maps:get(robots, Outcome)], trace(Outcome)}.

end_of(Sim) ->
    starl_sim:run(Sim),
    {Outcome, _} = starl_sim:finish(Sim),
    Outcome.

well_ended(#{ending := Ending, violations := Violations}) ->
    ?assertEqual({done, []}, {Ending, Violations}).

trace(#{monitors := #{starl_sim_order_monitor := #{trace := Trace}}}) -> Trace.

crashing(Scenario) ->
    Blocks = [{crash, starl_sim_crash_machine, #{}}, {other, starl_sim_crash_machine, #{}}],
    Scenario#{around => #{blocks => Blocks}}.

point({X, Y, _}) -> {X, Y}.

%% The process of a machine, by the robot's tree.
pid_of(Sim, Robot, Name) ->
    [Pid] = [
        Child
     || Sup <- starl_sim:robot_pids(Sim, all),
        robot_of(Sup) =:= Robot,
        {_, Part} <- starl_robot_sup:parts(Sup),
        {Id, Child, _, _} <- supervisor:which_children(Part),
        Id =:= Name
    ],
    Pid.

%% Kills something of robot 1. Returns when its shard has had the news, too: it is also the
%% shard of robot 3 (of four robots on two shards), which has nothing to do with it.
kill(Pid, Sim) ->
    Ref = monitor(process, Pid),
    true = exit(Pid, kill),
    receive
        {'DOWN', Ref, process, Pid, _} -> ok
    end,
    #{sap := _} = starl_sim:inspect(Sim, 3),
    ok.

robot_of(Sup) ->
    #{services := Services} = maps:from_list(starl_robot_sup:parts(Sup)),
    {ok, #{start := {_, _, [#{robot := Robot}]}}} = supervisor:get_childspec(Services, sap),
    Robot.

%% Each piece of motion begins where the one before it has led to.
no_jump(Trace) ->
    Pieces = [{R, P} || {_, R, chassis, {motion, P}} <- Trace],
    [
        follows([P || {R, P} <- Pieces, R =:= Robot])
     || Robot <- lists:usort([R || {R, _} <- Pieces])
    ].

follows([Piece, Next | Rest]) ->
    T = element(2, Next),
    ?assert(T >= element(2, Piece)),
    Distance = starl_geometry:distance(
        starl_trajectory:position(T, Piece),
        starl_trajectory:position(T, Next)
    ),
    ?assert(Distance < 1.0e-6),
    follows([Next | Rest]);
follows([_]) ->
    ok.
