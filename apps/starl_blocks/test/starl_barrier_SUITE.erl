%% The contract of the barrier (README) in the simulator, under faults; the judge is
%% starl_barrier_monitor. And the planted bugs that it must find.
-module(starl_barrier_SUITE).
-include_lib("stdlib/include/assert.hrl").
-include_lib("proper/include/proper.hrl").

-export([all/0]).
-export([
    contract_under_faults/1, progress_under_loss/1, restarted_machine_syncs_again/1,
    failed_round_outlives_a_crash/1, a_crash_costs_no_retry/1, nobody_to_ask/1,
    crash_of_both_machines/1, reboots/1, two_reboots_at_once/1, memory_is_bounded/1,
    planted_bugs_are_caught/1
]).

all() ->
    [
        contract_under_faults, progress_under_loss, restarted_machine_syncs_again,
        failed_round_outlives_a_crash, a_crash_costs_no_retry, nobody_to_ask,
        crash_of_both_machines, reboots, two_reboots_at_once, memory_is_bounded,
        planted_bugs_are_caught
    ].

%% Safety, all of it: nobody passes before all have reached, everybody passes each round that it
%% reaches once and in their order, whatever crashes.
contract_under_faults(_) ->
    Prop = ?FORALL(
        Storm,
        starl_blocks_storm:storm([barrier, barrier, barrier_log]),
        starl_platform_ct:safely(fun() ->
            Outcome = starl_blocks_storm:run(starl_barrier_app, Storm, #{}),
            starl_blocks_storm:broken(barrier, Outcome) =:= []
        end)
    ),
    starl_platform_ct:property(Prop, 100).

%% Progress: messages get through, so all pass, within 10 s of each other.
progress_under_loss(_) ->
    Judge = #{bound_us => 10000000, delta_us => 10000000},
    [
        begin
            {Seed, Loss, Dup, Delay, Drift, _} = starl_blocks_storm:drawn(N, barrier),
            Storm = {Seed, Loss, Dup, Delay, Drift, []},
            clean(N, Storm, #{judge => Judge, patience => 60000})
        end
     || N <- lists:seq(1, 20)
    ].

%% A robot whose barrier machine crashed, waiting or not, goes on with the same round.
restarted_machine_syncs_again(_) ->
    [
        clean(Seed, {Seed, 0.1, 0.1, {5, 20}, 10000, [{At, 1 + Seed rem 4, barrier}]}, #{})
     || Seed <- lists:seq(1, 10), At <- [7, 16, 31]
    ].

%% A robot is alone for ten seconds: its calls fail. Its machine crashes between two of them, and
%% the next call is still for the round that it has reached.
failed_round_outlives_a_crash(_) ->
    [
        ?assertMatch({At, #{failed := F}} when F > 0, {At, kept(Faults, #{patience => 1000})})
     || At <- lists:seq(9000, 11000, 100),
        Faults <- [[{alone, 2000, 11500, isolate, 1, #{}}, crash(1, At, barrier)]]
    ].

%% What the others had told a machine that crashed between two rounds it asks for when it next
%% waits for them, not only when it asks again anyway, 3 s later.
a_crash_costs_no_retry(_) ->
    [
        begin
            #{longest_delta_us := Longest} = kept([crash(1, Ms, barrier)], #{names => [odd, even]}),
            ?assert(Longest < 1000000, {Ms, Longest})
        end
     || Ms <- lists:seq(500, 4000, 100)
    ].

%% A robot that is the whole team knows from its log how far it was.
nobody_to_ask(_) ->
    [kept([crash(1, At, barrier)], #{robots => 1, rounds => 20}) || At <- [1500, 3000, 4510]].

%% The log and the machine may crash one after the other, as close as can be, in any order.
crash_of_both_machines(_) ->
    [
        kept([crash(1, 5000, First), crash(1, 5000 + Gap, Second)], #{patience => 500})
     || {First, Second} <- [{barrier, barrier_log}, {barrier_log, barrier}],
        Gap <- [1, 7, 300, 3500]
    ].

crash(Robot, At, Machine) ->
    Name = starl_platform_ct:fault_id(lists:concat([Machine, "_"]), At),
    {Name, At, At, kill_machine, {Robot, Machine}, #{}}.

%% A robot that comes up anew goes on with a round that it has not passed, and waits for all.
reboots(_) ->
    [kept([{reboot, At, At + Down, reboot, 2, #{}}], #{robots => 3})
     || At <- [1500, 3000, 4510], Down <- [1, 400, 4000]].

%% Found at random and shrunk: while robot 3 is down and has not reached the round, robot 2 reboots
%% and counts that round as passed. What robot 2 says then must not make robot 3 believe that it
%% had reached it.
two_reboots_at_once(_) ->
    [kept([{a, At, At + 8000, reboot, 3, #{}}, {b, At + After, At + After + 2000, reboot, 2, #{}}],
          #{robots => 4, pause => 300})
     || At <- lists:seq(2000, 2900, 100), After <- [400, 700]].

%% The contract is kept under these faults, and the monitor's results. Who reboots begins its work
%% anew, so not all are done in the end; each reboot may cost it one round.
kept(Faults, Options) ->
    {ok, Sim} = starl_sim:start(maps:merge(#{
        app => starl_barrier_app, robots => 4, seed => 7, time => 60, mode => inline,
        names => [gate, gate], faults => Faults
    }, Options)),
    _ = starl_sim:run(Sim),
    {#{monitors := #{starl_barrier_monitor := Results}} = Outcome, _} = starl_sim:finish(Sim),
    ?assertEqual({Faults, []}, {Faults, starl_blocks_storm:broken(barrier, Outcome)}),
    ?assert(maps:get(rounds, Results) >= 20 - length(Faults), {Faults, Results}),
    Results.

clean(N, Storm, Options) ->
    Outcome = starl_blocks_storm:run(starl_barrier_app, Storm, Options),
    ?assertEqual({N, []}, {N, starl_blocks_storm:broken(barrier, Outcome)}),
    ?assertMatch({N, #{ending := done}}, {N, Outcome}).

%% A name costs the same after 10 rounds and after 200.
memory_is_bounded(_) ->
    [Few, Many] = [size_after(Rounds) || Rounds <- [10, 200]],
    ?assertEqual(Few, Many).

size_after(Rounds) ->
    {ok, Sim} = starl_sim:start(#{
        app => starl_barrier_app, robots => 4, rounds => Rounds, pause => 20, time => 600
    }),
    _ = starl_sim:run(Sim),
    #{barrier := #{data := Data}} = starl_sim:inspect(Sim, 1),
    ok = starl_sim:close(Sim),
    erts_debug:flat_size(Data).

%% Each planted bug is found within 100 seeds.
planted_bugs_are_caught(_) ->
    [
        begin
            Options = #{machine => starl_barrier_planted, config => #{variant => Variant}},
            Found = starl_blocks_storm:caught(barrier, starl_barrier_app, barrier, {Options, 100}),
            ct:pal("~p: ~p", [Variant, Found]),
            ?assertMatch({Variant, {caught, _, _}}, {Variant, Found})
        end
     || Variant <- [forgetful, recreated, alone]
    ].
