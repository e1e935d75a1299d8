%% The building blocks in larger teams, and under all random faults: small versions
%% of what config/scenarios and `./starl soak' do.
-module(starl_exercise_SUITE).
-include_lib("stdlib/include/assert.hrl").

-export([suite/0, all/0, init_per_suite/1, end_per_suite/1]).
-export([
    scenarios_are_sound/1,
    team_elects_under_loss/1,
    team_passes_barrier_under_loss/1,
    contended_tokens_are_granted/1,
    types_do_not_meet/1,
    turns_bound_the_work/1,
    short_messages_are_not_owed/1,
    damaged_stores_are_ahead/1,
    random_faults/1
]).

%% Runs of each block.
-define(SEEDS, 15).

suite() -> [{timetrap, {minutes, 2}}].

all() ->
    [
        scenarios_are_sound,
        team_elects_under_loss,
        team_passes_barrier_under_loss,
        contended_tokens_are_granted,
        types_do_not_meet,
        turns_bound_the_work,
        short_messages_are_not_owed,
        damaged_stores_are_ahead,
        random_faults
    ].

init_per_suite(Config) -> starl_platform_ct:without_log(Config).

end_per_suite(Config) -> starl_platform_ct:with_log(Config).

%% An application may call its messages what a block calls its own: neither gets the other's.
types_do_not_meet(_) ->
    Script = fun(R) ->
        [ok = starl:listen(R, Type) || Type <- [ballot, leader]],
        ok = starl:broadcast(R, ballot, {mine, starl:id(R)}),
        {ok, _} = starl_election:elect(R, first, 20000),
        lists:sort([
            begin
                {ok, F, {mine, F}} = starl:await(R, ballot),
                F
            end
         || _ <- [1, 2]
        ])
    end,
    {ok, Sim} = starl_sim:start(#{
        app => starl_sim_script_app,
        script => Script,
        robots => 3,
        seed => 5,
        time => 60,
        around => #{blocks => [starl_election]}
    }),
    _ = starl_sim:run(Sim),
    {#{robots := Robots, violations := Broken}, _} = starl_sim:finish(Sim),
    ?assertEqual([{done, [1, 2, 3] -- [R]} || R <- [1, 2, 3]], [D || {_, #{result := D}} <- Robots]),
    ?assertEqual([], Broken).

%% The scenario files of this suite's subjects are read and accepted.
scenarios_are_sound(_) ->
    Dir = filename:join([root(), "config", "scenarios"]),
    [
        begin
            {ok, Given} = starl_run_scenario:read(filename:join(Dir, File)),
            Options = starl_app:options(starl_exercise),
            ?assertMatch({File, {ok, #{}}}, {File, starl_run_scenario:check(Given, Options)})
        end
     || File <- ["election_200.term", "barrier_200.term", "tokens_50.term"]
    ].

%% Where the checkout is: above the build that this module was compiled into.
root() -> hd(string:split(code:which(?MODULE), "/_build/")).

%% A fifth of the packets is lost: the ballots of all get through all the same, and all agree.
team_elects_under_loss(_) ->
    #{elections := E, elected := N, failed := F, finished := Done} = figures(#{
        block => election, robots => 40, loss => 0.2, turns => 2, pause => 50, patience => 60000
    }),
    ?assertEqual({2, 80, 0, 40}, {E, N, F, Done}).

%% Likewise, nobody fails to pass.
team_passes_barrier_under_loss(_) ->
    #{rounds := Rounds, passed := Passed, failed := F} = figures(#{
        block => barrier, robots => 40, loss => 0.2, turns => 3, pause => 50, patience => 60000
    }),
    ?assertEqual({3, 120, 0}, {Rounds, Passed, F}).

%% Twelve robots, twelve tokens, mostly two at once: every request is granted, and no wait is out
%% of all proportion.
contended_tokens_are_granted(_) ->
    #{failed := F, acquired := N, lease_lost := L} =
        Told = figures(#{
            block => mutex,
            robots => 12,
            tokens => 12,
            hold => 1000,
            pause => 500,
            patience => 60000,
            work => 120
        }),
    ?assertEqual({0, 0}, {F, L}),
    ?assert(N > 500, Told),
    #{longest_wait_us := Longest, mean_wait_us := Mean, unfairness := Unfairness} = Told,
    ?assert(Longest < 30000000, Told),
    ?assert(abs(Unfairness - Longest / Mean) < 0.01, Told).

turns_bound_the_work(_) ->
    ?assertMatch(
        #{turns := 12, finished := 4, sent := 12},
        figures(#{block => geocast, robots => 4, turns => 3, lifetime => 500})
    ),
    #{turns := Turns} = figures(#{block => registers, robots => 4, work => 5}),
    ?assert(Turns > 40).

%% Of messages that live for 200 ms no delivery is promised where offer, question and answer may
%% take 300; and none at a robot whose clock was set back after its restart, until that has caught
%% up.
short_messages_are_not_owed(_) ->
    Exercise = #{app => starl_exercise, block => geocast, mode => inline},
    [
        begin
            {#{violations := Violations}, _} = run(maps:merge(Exercise, Scenario)),
            ?assertEqual([], Violations)
        end
     || Scenario <- [
            #{
                robots => 8,
                seed => 63631,
                delay => {2, 100},
                work => 12,
                time => 45,
                faults => [{kill_machine_1, 4599, 5099, kill_machine, {1, geocast}, #{}}]
            },
            #{
                robots => 4,
                seed => 50007,
                delay => {20, 20},
                final => 2,
                time => 26,
                clock_offset => 0,
                clock_drift => 0,
                heading_error => 0.0,
                faults => [
                    {clock_freeze_1, 18351, 25000, clock_freeze, 2, #{}},
                    {clock_freeze_2, 13678, 25000, clock_freeze, 4, #{}},
                    {clock_offset_2, 20951, 25000, clock_offset, 2, #{ms => 1423}},
                    {location_noise_3, 2253, 20203, location_noise, all, #{mm => 12.188}},
                    {reboot_3, 13586, 22918, reboot, 2, #{}}
                ]
            }
        ]
    ].

figures(Scenario) ->
    Defaults = #{app => starl_exercise, mode => inline, world => {30000, 30000}, time => 300},
    {#{violations := Violations}, #{figures := Figures}} = run(maps:merge(Defaults, Scenario)),
    ?assertEqual([], Violations),
    maps:from_list(Figures).

%% What a register is written after its store was damaged is ahead of all clocks: one that stood still
%% for 15 s takes it 15 s later.
damaged_stores_are_ahead(_) ->
    {#{violations := Violations}, _} = run(#{
        app => starl_exercise,
        block => registers,
        sync => 200,
        final => 2,
        mode => inline,
        robots => 2,
        seed => 820164,
        delay => {20, 20},
        clock_offset => 0,
        clock_drift => 0,
        time => 60,
        heal => 25,
        faults => [
            {clock_freeze_1, 10359, 25000, clock_freeze, 2, #{}},
            {store_damaged_1, 8414, 25000, store_damaged, 1, #{}},
            {store_full_1, 7896, 22266, store_full, 1, #{}}
        ]
    }),
    ?assertEqual([], Violations).

%% Every block keeps its contract under all faults, and all robots are done after the heal.
random_faults(_) ->
    First = starl_platform_ct:seed() band 16#7fffffff,
    ct:pal("seeds from ~b on", [First]),
    [
        begin
            {#{violations := Violations}, _} = run(#{
                app => starl_exercise,
                block => Block,
                robots => 8,
                seed => Seed,
                mode => inline,
                random_faults => [all],
                heal => 20,
                converge => 40,
                time => 60,
                work => 20
            }),
            ?assertEqual({Block, Seed, []}, {Block, Seed, Violations})
        end
     || Block <- starl_block_catalogue:able(exercise), Seed <- lists:seq(First, First + ?SEEDS - 1)
    ].

run(Scenario) ->
    {ok, Sim} = starl_sim:start(Scenario),
    _ = starl_sim:run(Sim),
    starl_sim:finish(Sim).
