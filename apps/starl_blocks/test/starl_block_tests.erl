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
     || {_, Block} <- starl_block_catalogue:known(),
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
            ?assertEqual(Name, starl_block_catalogue:name(Block)),
            ?assertEqual({ok, Block}, starl_block_catalogue:find(Name))
        end}
     || {Name, Block} <- starl_block_catalogue:known()
    ].

%% Flags that two exercises share are the same.
shared_flags_test() ->
    Flags = [
        Flag
     || Name <- starl_block_catalogue:able(exercise),
        {ok, Block} <- [starl_block_catalogue:find(Name)],
        Flag <- starl_block_exercise:flags(Block:exercise())
    ],
    ?assertEqual(length(lists:ukeysort(1, Flags)), length(lists:usort(Flags))).

%% Nothing but an application's `.app' file lists its blocks; one that is left out would be there for nobody.
%% Holds: Every building block, command and application that is there is offered
%% Red: with a block left out of its `.app` file, run
every_block_is_listed_test() ->
    Blocks = [
        Module
     || App <- [starl_platform, starl_blocks],
        Dir <- [filename:dirname(code:where_is_file(atom_to_list(App) ++ ".app"))],
        Beam <- filelib:wildcard("*.beam", Dir),
        Module <- [list_to_atom(filename:rootname(Beam))],
        {module, _} <- [code:ensure_loaded(Module)],
        starl_block:is_block(Module)
    ],
    ?assertNotEqual([], Blocks),
    ?assertEqual([], Blocks -- [Block || {_, Block} <- starl_block_catalogue:known()]).

%% A capability is the callback: it is not spelt a second time.
capabilities_follow_from_the_callbacks_test_() ->
    [
        {atom_to_list(Capability), fun() ->
            Able = starl_block_catalogue:able(Capability),
            ?assertNotEqual([], Able),
            ?assertEqual(
                [
                    Name
                 || {Name, Block} <- starl_block_catalogue:known(),
                    erlang:function_exported(Block, Callback, 0)
                ],
                Able
            )
        end}
     || {Capability, Callback} <- [
            {exercise, exercise}, {bench, benchmark}, {check, models}, {history, history}
        ]
    ].

names_of_models_are_told_apart_test() ->
    Names = [Name || {Name, _, _} <- starl_block_catalogue:models()],
    ?assertEqual(lists:usort(Names), lists:sort(Names)).

a_module_that_is_no_block_is_not_found_test() ->
    ?assertEqual(error, starl_block_catalogue:find(lists)).

a_block_is_found_by_its_module_test() ->
    ?assertEqual({ok, starl_bully}, starl_block_catalogue:find(starl_bully)).
