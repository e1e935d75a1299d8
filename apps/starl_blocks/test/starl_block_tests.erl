%% What every block declares, and what an application's list of blocks becomes.
-module(starl_block_tests).
-include_lib("eunit/include/eunit.hrl").

context(Robots) ->
    #{
        robots => Robots,
        world => {9000, 9000},
        seed => 1,
        sap => #{},
        options => #{},
        profiles => [starl_chassis:profile(starl_chassis_differential, #{})]
    }.

%% Machines and contracts stand in the order of the list; a machine that is no block's stays.
expanded_test() ->
    Own = {mine, starl_blocks_recorder, #{}},
    {ok, {Machines, Monitors}} = starl_block:expand(
        [starl_election, {starl_mutex, #{lease_ms => 700}}, Own], context([1, 2])
    ),
    ?assertMatch(
        [
            {election, starl_election_ballots, _},
            {mutex, starl_mutex_tokens, #{lease_ms := 700, retry_ms := 3000}},
            Own
        ],
        Machines
    ),
    ?assertMatch(
        [
            {starl_election_monitor, #{robots := [1, 2], bound_us := 601000000}},
            {starl_mutex_monitor, #{lease_us := 700000, drift_ppm := 10000, lag_us := 250000}}
        ],
        Monitors
    ).

nothing_test() -> ?assertEqual({ok, {[], []}}, starl_block:expand([], context([1]))).

%% The defaults of the table are those of the machines.
defaults_test_() ->
    [
        {atom_to_list(Machine), fun() ->
            ?assertEqual(begun(Machine, #{}), begun(Machine, Config))
        end}
     || {_, Block} <- starl_blocks:known(),
        Block =/= starl_dpp,
        {_, Machine, Config} <- Block:machines(defaults(Block))
    ].

begun(Machine, Config) ->
    Machine:init(Config#{
        robot => 1,
        participants => starl_team:new([1, 2]),
        incarnation => 1,
        now => 0,
        name => x,
        stored => none,
        random => rand:seed_s(exsss, 1),
        team_seed => 1
    }).

defaults(Block) -> maps:from_list([{Key, Default} || {Key, _, Default, _} <- Block:options()]).

%% Defaults are values of their types; every machine has a name of its own.
tables_test_() ->
    [
        {atom_to_list(Name), fun() ->
            ?assertEqual({ok, defaults(Block)}, starl_options:check(#{}, Block:options())),
            ?assertMatch({ok, _}, starl_options:check(defaults(Block), Block:options())),
            ?assertMatch({ok, _}, starl_block:expand([Block], context([1, 2, 3]))),
            ?assertEqual(Name, starl_blocks:name(Block)),
            ?assertEqual({ok, Block}, starl_blocks:find(Name))
        end}
     || {Name, Block} <- starl_blocks:known()
    ].

%% Flags that two exercises share are the same.
shared_flags_test() ->
    Flags = [
        Flag
     || Name <- starl_blocks:able(exercise),
        {ok, Block} <- [starl_blocks:find(Name)],
        Flag <- starl_block_exercise:flags(Block:exercise())
    ],
    ?assertEqual(length(lists:ukeysort(1, Flags)), length(lists:usort(Flags))).

able_test() ->
    ?assertEqual(
        [sap, motion, election, bully, mutex, barrier, geocast, registers, counter],
        starl_blocks:able(exercise)
    ),
    ?assertEqual([election, bully, mutex, barrier, geocast], starl_blocks:able(bench)),
    ?assertEqual(
        [sap, election, bully, mutex, barrier, geocast, registers, counter, terms],
        [Name || {Name, _, _} <- starl_blocks:models()]
    ),
    ?assertEqual(error, starl_blocks:find(lists)),
    ?assertEqual({ok, starl_bully}, starl_blocks:find(starl_bully)).
