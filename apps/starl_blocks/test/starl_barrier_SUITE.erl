%% The contract of the barrier (DESIGN section 3) in the simulator, under faults; the judge is
%% starl_barrier_monitor. And the planted bugs that it must find.
-module(starl_barrier_SUITE).
-include_lib("stdlib/include/assert.hrl").
-include_lib("proper/include/proper.hrl").

-export([all/0]).
-export([
    contract_under_faults/1, progress_under_loss/1, restarted_machine_syncs_again/1,
    memory_is_bounded/1, planted_bugs_are_caught/1
]).

all() ->
    [
        contract_under_faults, progress_under_loss, restarted_machine_syncs_again,
        memory_is_bounded, planted_bugs_are_caught
    ].

%% Safety: nobody passes before all have reached, under every fault.
contract_under_faults(_) ->
    Prop = ?FORALL(
        Storm,
        starl_blocks_storm:storm(barrier),
        starl_platform_ct:safely(fun() ->
            Outcome = starl_blocks_storm:run(starl_barrier_app, Storm, #{}),
            Bad = starl_blocks_storm:broken(barrier, Outcome),
            [V || #{what := passed_early} = V <- Bad] =:= []
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
