%% Histories of whole runs: they find planted bugs with all monitors off, accuse no sound block, and change
%% nothing.
-module(starl_histories_SUITE).
-include_lib("stdlib/include/assert.hrl").

-export([suite/0, all/0, init_per_suite/1, end_per_suite/1]).
-export([planted_bugs_are_found_by_histories_alone/1, sound_blocks_are_not_accused/1]).
-export([a_run_with_histories_is_the_same_run/1, a_machine_that_tells_nothing_is_found/1]).

%% Each is found within ten.
-define(SEEDS, 20).
-define(BUGS, [
    mutex_impatient_home,
    mutex_forgetful_home,
    mutex_trusting,
    mutex_overstaying,
    mutex_untimely,
    registers_last_heard,
    election_incomplete,
    election_late,
    counter_adds,
    counter_replaces,
    counter_zero
]).

suite() -> [{timetrap, {minutes, 5}}].

all() ->
    [
        planted_bugs_are_found_by_histories_alone,
        sound_blocks_are_not_accused,
        a_run_with_histories_is_the_same_run,
        a_machine_that_tells_nothing_is_found
    ].

init_per_suite(Config) -> starl_platform_ct:without_log(Config).

end_per_suite(Config) -> starl_platform_ct:with_log(Config).

%% Holds: A machine that is wrong is found by what its callers see, with all monitors off; one that
%% tells nothing of itself, too
%% Red: 073438b3: the monitors do not see the mute one
planted_bugs_are_found_by_histories_alone(_) ->
    Found = [{Bug, starl_dev_planted_seed:caught({Bug, ?SEEDS, histories})} || Bug <- ?BUGS],
    ct:pal("~p", [Found]),
    ?assertEqual([], [Bug || {Bug, Other} <- Found, element(1, Other) =/= caught]),
    ?assertEqual(
        [history], lists:usort([Contract || {_, {caught, _, #{contract := Contract}, _}} <- Found])
    ).

%% Holds: Histories accuse no sound block
%% Red: `starl_block_histories_tests` has the cases, each red without its part
sound_blocks_are_not_accused(_) ->
    Seed = starl_platform_ct:seed() rem 1000000,
    [
        ?assertEqual({Block, N, [], 0}, judged(Block, N))
     || Block <- [mutex, registers, election, bully, counter], N <- lists:seq(Seed, Seed + 5)
    ].

judged(Block, Seed) ->
    Scenario = starl_lab_soak:scenario(Block, none, Seed),
    {ok, #{violations := Found, monitors := Results}} = run(Scenario, alone),
    #{starl_history_monitor := #{objects := Objects, undecided := Undecided}} = Results,
    ?assert(Objects > 0),
    {Block, Seed, Found, Undecided}.

run(Scenario, How) ->
    Options = #{histories => {How, starl_block_catalogue:histories()}},
    starl_sim_trial:run(Scenario, fun(_Sim) -> ok end, [], Options).

%% Under all faults: a robot that stands still in mid-step stands still at the same action.
%% Holds: A run with histories is the same run
%% Red: without the exemption in `starl_robot:size_of/1`, run (the second)
a_run_with_histories_is_the_same_run(_) ->
    [
        begin
            Scenario = starl_lab_soak:scenario(Block, none, Seed),
            {ok, #{digest := Digest, violations := []}} = starl_sim_trial:run(Scenario),
            {ok, #{digest := Kept}} = run(Scenario, kept),
            ?assertEqual({Block, Seed, Digest}, {Block, Seed, Kept})
        end
     || Block <- [mutex, registers, election], Seed <- [1, 2, 3, 4]
    ].

%% What a machine does not tell no monitor sees.
a_machine_that_tells_nothing_is_found(_) ->
    Scenario = (starl_planted:scenario(mutex_overstaying, 2))#{app := starl_mute_planted},
    {ok, #{violations := []}} = run(Scenario, kept),
    {ok, #{violations := [#{contract := history} | _]}} = run(Scenario, judged).
