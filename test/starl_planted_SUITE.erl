%% The monitors find planted bugs, each within a few seeds, in runs that the sound block comes
%% through: a sample of what ./starl planted does with all of them.
-module(starl_planted_SUITE).
-include_lib("stdlib/include/assert.hrl").

-export([suite/0, all/0, init_per_suite/1, end_per_suite/1]).
-export([one_of_each_block_is_found/1, at_least_one_per_block/1, nothing_is_found_in_the_sound/1]).

%% One that is found soon, of each block.
-define(SAMPLE, [
    sap_forgets, sap_restarts, election_incomplete, bully_early, mutex_forgetful_home,
    barrier_recreated, geocast_clocks, registers_last_heard, dpp_fickle
]).
%% Many more than it takes, for a change elsewhere shifts the draws.
-define(SEEDS, 60).

suite() -> [{timetrap, {minutes, 3}}].

all() -> [one_of_each_block_is_found, at_least_one_per_block, nothing_is_found_in_the_sound].

init_per_suite(Config) -> starl_platform_ct:without_log(Config).

end_per_suite(Config) -> starl_platform_ct:with_log(Config).

one_of_each_block_is_found(_) ->
    [
        begin
            Found = starl_cli_planted:caught({Bug, ?SEEDS}),
            ct:pal("~p: ~p", [Bug, Found]),
            ?assertMatch({Bug, {caught, _, _, _}}, {Bug, Found}),
            {caught, _, #{contract := Contract}, _} = Found,
            ?assertEqual({Bug, contract(Bug)}, {Bug, Contract})
        end
     || Bug <- ?SAMPLE
    ].

%% The contract of the block that has the bug.
contract(Bug) ->
    {Bug, Block, _} = lists:keyfind(Bug, 1, starl_planted:bugs()),
    case Block of
        bully -> election;
        _ -> Block
    end.

at_least_one_per_block(_) ->
    Blocks = [Block || {_, Block, _} <- starl_planted:bugs()],
    ?assertEqual([], starl_exercise:blocks_known() -- Blocks),
    ?assert(lists:member(dpp, Blocks)).

%% Without a bug the same search ends without a find: it is not the search that is broken.
nothing_is_found_in_the_sound(_) ->
    [
        begin
            Scenario = starl_planted:sound(starl_planted:scenario(Bug, Seed)),
            {ok, #{violations := Violations}} = starl_sim_trial:run(Scenario),
            ?assertEqual({Bug, Seed, []}, {Bug, Seed, Violations})
        end
     || Bug <- [sap_forgets, election_incomplete, bully_early, mutex_forgetful_home],
        Seed <- lists:seq(1, 5)
    ].
