%% The contract of the barrier (README) in the simulator, under faults; the judge is
%% starl_barrier_monitor. And the planted bugs that it must find.
-module(starl_barrier_SUITE).
-include_lib("stdlib/include/assert.hrl").
-include_lib("proper/include/proper.hrl").

-export([all/0]).
-export([
    contract_under_faults/1,
    progress_under_loss/1,
    restarted_machine_syncs_again/1,
    failed_round_outlives_a_crash/1,
    a_crash_costs_no_retry/1,
    nobody_to_ask/1,
    reboots/1,
    reboots_of_all/1,
    overlapping_reboots/1,
    full_store/1,
    damaged_store/1,
    damaged_stores_of_all/1,
    damaged_one_after_another/1,
    damaged_for_a_while/1,
    damaged_while_another_reboots/1,
    memory_is_bounded/1,
    planted_bugs_are_caught/1
]).

all() ->
    [
        contract_under_faults,
        progress_under_loss,
        restarted_machine_syncs_again,
        failed_round_outlives_a_crash,
        a_crash_costs_no_retry,
        nobody_to_ask,
        reboots,
        reboots_of_all,
        overlapping_reboots,
        full_store,
        damaged_store,
        damaged_stores_of_all,
        damaged_one_after_another,
        damaged_for_a_while,
        damaged_while_another_reboots,
        memory_is_bounded,
        planted_bugs_are_caught
    ].

%% Safety, all of it: nobody passes before all have reached, everybody passes each round that it
%% reaches once and in their order, whatever crashes and reboots.
contract_under_faults(_) ->
    Prop = ?FORALL(
        Storm,
        starl_blocks_storm:storm([barrier, barrier, reboot, reboot, store_full, damaged]),
        starl_platform_ct:safely(fun() ->
            Outcome = starl_blocks_storm:run(starl_barrier_app, Storm, #{}),
            starl_blocks_storm:broken(barrier, Outcome) =:= []
        end)
    ),
    starl_platform_ct:property(Prop, 200).

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

%% A robot that is the whole team knows from its store how far it was.
nobody_to_ask(_) ->
    [
        kept(Faults, #{robots => 1, rounds => 20})
     || At <- [1500, 3000, 4510],
        Faults <- [[crash(1, At, barrier)], [reboot(a, At, At + 700, 1)]]
    ].

%% A robot that comes up anew goes on with a round that it has not passed, and waits for all: none
%% is skipped, and no robot is left behind.
reboots(_) ->
    [
        kept([reboot(a, At, At + Down, 2)], #{robots => Robots})
     || Robots <- [2, 3], At <- [1500, 3000, 4510], Down <- [1, 400, 4000]
    ].

%% All are down at once, and nobody remembers anything but what is stored.
reboots_of_all(_) ->
    [
        kept([reboot(Robot, At, At + 300, Robot) || Robot <- lists:seq(1, Robots)], #{
            robots => Robots
        })
     || Robots <- [1, 2, 3, 5], At <- lists:seq(1500, 3000, 100)
    ].

%% Found at random and shrunk, each with some other times. Robot 2 reboots while robot 3, which has
%% not reached the round, is down. Robot 1 passes a round, robots 2 and 3 forget that it had reached
%% it, and it reboots. Robot 3 reboots, is cut off, and reboots again.
overlapping_reboots(_) ->
    [
        kept(Faults, #{robots => Robots, pause => Pause})
     || Shift <- lists:seq(0, 900, 100),
        {Robots, Pause, Faults} <- [
            {4, 300, [reboot(a, 2000 + Shift, 10000 + Shift, 3), reboot(b, 2400 + Shift, 4400, 2)]},
            {3, 1, all_forget(1, 20 + Shift)},
            {3, 300, [
                reboot(a, 1469 + Shift, 7278, 3),
                reboot(b, 9164 + Shift, 13220, 3),
                {c, 7626, 9304 + Shift, partition, [3], #{}}
            ]}
        ]
    ].

%% What a robot has reached all others forget, before it reboots.
all_forget(Robot, At) ->
    [
        reboot(a, At, 2908, 2),
        crash(3, 2824, barrier),
        {b, 2600, 9460, isolate, Robot, #{}},
        reboot(c, 6258, 12742, Robot)
    ].

%% A store that takes no more stops who would promise on the strength of it, and no longer than it
%% is full; a robot that reboots meanwhile has lost nothing.
full_store(_) ->
    [
        kept([{full, At, At + 2500, store_full, 1, #{}} | Faults], #{robots => Robots})
     || Robots <- [1, 2, 3],
        At <- [700, 1500, 3000],
        Faults <- [[], [reboot(a, At + 1000, At + 1200, 1)], [reboot(a, At + 2490, At + 2600, 1)]]
    ].

%% Robot 1 cannot read what it has stored: the others tell it. It may count the round that it had
%% reached for passed; it begins none anew, unless the others have forgotten that it had reached it.
damaged_store(_) ->
    _ = [
        kept([damaged(At, 1), reboot(a, At, At + Down, 1)], #{robots => Robots, pause => 300})
     || Robots <- [2, 3, 5], At <- lists:seq(1500, 3000, 100), Down <- [1, 900]
    ],
    [
        kept([{d, 6000, 13000, store_damaged, 1, #{}} | all_forget(1, At)], #{
            robots => 3, pause => 1
        })
     || At <- lists:seq(20, 920, 100)
    ].

%% Nobody has anything left: rounds begin again with the first. Still nobody passes one before all
%% have reached it.
damaged_stores_of_all(_) ->
    [
        kept(
            lists:append([
                [damaged(At, R), reboot(R, At, At + 300 * R, R)]
             || R <- lists:seq(1, Robots)
            ]),
            #{robots => Robots}
        )
     || Robots <- [1, 2, 3], At <- [1500, 3000, 4510]
    ].

%% Found at random and shrunk. While robot 1 is down, robot 2 loses what it has stored, and goes on by
%% what its application knows. Then robot 1 has lost its own, too: robot 2 tells it how far all were.
damaged_one_after_another(_) ->
    [
        kept(
            [
                damaged(At - 300, 2),
                crash(2, At, barrier),
                damaged(At + 2000, 1),
                reboot(1, At - 700, At + 2500, 1)
            ],
            #{robots => Robots, pause => 20, rounds => 60, names => [gate, gate]}
        )
     || Robots <- [2, 3], At <- lists:seq(1500, 2500, 100)
    ].

%% Found at random and shrunk. The store of robot 1 is full when it is to store that it has passed a
%% round, and damaged; the others tell it that it has. Then it reads again what it took before.
damaged_for_a_while(_) ->
    [
        kept(
            [
                {full, At, At + 3000, store_full, 1, #{}},
                {damaged, At, At + 2000, store_damaged, 1, #{}},
                {slow, At + 2500, Again + 500, delay, all, #{extra_ms => 3000}},
                reboot(a, Again, Again + 300, 1)
            ],
            #{robots => Robots, pause => 20, rounds => 60, names => [gate, gate]}
        )
     || Robots <- [2, 3], At <- lists:seq(1000, 1300, 10), Again <- [At + 3400, At + 3700]
    ].

%% A damaged robot asks one that has just come up itself and may know less than it did: the round that it
%% had reached counts as passed, and its machine crashes before it goes on.
damaged_while_another_reboots(_) ->
    Storm = {1, 0.0, 0.0, {5, 20}, 50, [{87, 3, barrier}, {7, 3, damaged}, {5, 1, reboot}]},
    Outcome = starl_blocks_storm:run(starl_barrier_app, Storm, #{}),
    ?assertEqual([], starl_blocks_storm:broken(barrier, Outcome)).

crash(Robot, At, Machine) ->
    Name = starl_platform_ct:fault_id(lists:concat([Machine, "_"]), At),
    {Name, At, At, kill_machine, {Robot, Machine}, #{}}.

reboot(Name, Down, Up, Robot) ->
    {starl_platform_ct:fault_id("reboot_", Name), Down, Up, reboot, Robot, #{}}.

damaged(At, Robot) ->
    {starl_platform_ct:fault_id("damaged_", Robot), At, At + 1000, store_damaged, Robot, #{}}.

%% The contract is kept under these faults, all robots get through all rounds, and the monitor's
%% results.
kept(Faults, Options) ->
    {ok, Sim} = starl_sim:start(
        maps:merge(
            #{
                app => starl_barrier_app,
                robots => 4,
                seed => 7,
                time => 90,
                mode => inline,
                names => [gate, gate],
                faults => Faults
            },
            Options
        )
    ),
    _ = starl_sim:run(Sim),
    {#{monitors := #{starl_barrier_monitor := Results}} = Outcome, _} = starl_sim:finish(Sim),
    ?assertEqual({Faults, []}, {Faults, starl_blocks_storm:broken(barrier, Outcome)}),
    ?assertMatch({Faults, #{ending := done}}, {Faults, Outcome}),
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
            Found = starl_blocks_storm:caught(barrier, starl_barrier_app, Kinds, {Options, 100}),
            ct:pal("~p: ~p", [Variant, Found]),
            ?assertMatch({Variant, {caught, _, _}}, {Variant, Found})
        end
     || {Variant, Kinds} <- [
            {forgetful, barrier},
            {recreated, barrier},
            {alone, barrier},
            {hasty, reboot},
            {careless, damaged}
        ]
    ].
