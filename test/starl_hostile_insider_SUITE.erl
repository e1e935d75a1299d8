%% A robot with the fleet's key sends everything that machines accept at its extremes; when it stops, each
%% block works again, also after restarts and with a new key.
%%
%% Holds: An insider that sends every block its extremes stops none for longer than it sends, nor
%% across restarts or a new key
%% Red: 4ca8e259, run: 6 of 15 cases
-module(starl_hostile_insider_SUITE).
-include_lib("stdlib/include/assert.hrl").

-export([all/0, init_per_testcase/2, end_per_testcase/2]).
-export([sap/1, election/1, bully/1, mutex/1, barrier/1, geocast/1, registers/1, counter/1, dpp/1]).
-export([each_block_is_attacked/1, each_clause_is_understood/1, extremes_are_found/1]).
-export([a_machine_that_does_not_say_what_it_takes_is_named/1]).
-export([a_quiet_insider_is_borne/1, a_crash_is_found/1, a_cluster_goes_on/1]).
%% called in the conductor
-export([attack/1]).

-define(SEED, 1).

all() ->
    [
        each_block_is_attacked,
        each_clause_is_understood,
        a_machine_that_does_not_say_what_it_takes_is_named,
        extremes_are_found,
        a_quiet_insider_is_borne,
        a_crash_is_found,
        sap,
        election,
        bully,
        mutex,
        barrier,
        geocast,
        registers,
        counter,
        dpp,
        a_cluster_goes_on
    ].

sap(_) -> borne(sap).
election(_) -> borne(election).
bully(_) -> borne(bully).
mutex(_) -> borne(mutex).
barrier(_) -> borne(barrier).
geocast(_) -> borne(geocast).
registers(_) -> borne(registers).
counter(_) -> borne(counter).
dpp(_) -> borne(dpp).

borne(Block) ->
    ct:pal("seed ~b", [?SEED]),
    Rows = [attacked(Block, Options) || Options <- starl_dev_insider:runs(options())],
    ct:pal("~ts~ts", [starl_dev_insider:header(), [starl_dev_insider:format(R) || R <- Rows]]),
    [?assert(starl_dev_insider:is_borne(Row), Row) || Row <- Rows].

attacked(Block, Options) ->
    starl_platform_ct:quietly(fun() -> starl_dev_insider:run(Block, Options) end).

options() -> #{robots => 4, seed => ?SEED}.

%% A block that is added is attacked, too: it has a test here.
each_block_is_attacked(_) ->
    Tested = [Case || Case <- all(), lists:member(Case, starl_dev_insider:blocks())],
    ?assertEqual(lists:sort(starl_dev_insider:blocks()), lists:sort(Tested)).

each_clause_is_understood(_) ->
    [
        ?assertMatch({Block, [_ | _], []}, {Block, Kinds, Unsolved})
     || Block <- starl_dev_insider:blocks() -- [sap],
        {Kinds, Unsolved} <- [starl_dev_insider:understood(Block)]
    ].

%% A machine that takes any body is no block's of ours.
a_machine_that_does_not_say_what_it_takes_is_named(_) ->
    ?assertEqual(
        {[], [{starl_hostile_planted, 1}]},
        starl_dev_insider_kinds:of_machine(starl_hostile_planted)
    ).

%% The largest numbers, names and lists that a machine takes are among the messages.
extremes_are_found(_) ->
    {Kinds, []} = starl_dev_insider_kinds:of_machine(starl_hostile_insider_machine),
    ?assertEqual(
        [{a, {tuple, [{is, tagged}, {shape, any}, {shape, count}]}}, {b, {shape, {list, natural}}}],
        Kinds
    ),
    Messages = starl_dev_insider_extremes:messages(Kinds, #{
        accepts => fun starl_hostile_insider_machine:accepts/2,
        insider => 4,
        victim => 1,
        examples => [{a, {tagged, name, 7}}],
        seed => ?SEED
    }),
    Most = lists:max([N || {a, {tagged, _, N}} <- Messages]),
    ?assert(starl_shape:is(count, Most)),
    ?assertNot(starl_shape:is(count, Most + 1)),
    ?assert(lists:member({a, {tagged, name, Most}}, Messages)),
    ?assert(lists:member({a, {tagged, name, 7 + (1 bsl 20)}}, Messages)),
    ?assert(
        lists:max([byte_size(Name) || {a, {tagged, Name, _}} <- Messages, is_binary(Name)]) >= 50000
    ),
    ?assert(lists:max([length(List) || {b, List} <- Messages]) > 5000),
    [?assertEqual(ok, starl_payload:check(message, Body)) || {_, Body} <- Messages].

%% What fails is not the team itself.
a_quiet_insider_is_borne(_) ->
    [
        ?assert(starl_dev_insider:is_borne(Row), Row)
     || Block <- [barrier, counter], Row <- [attacked(Block, (options())#{only => []})]
    ].

%% A machine that crashes at a large number is found.
a_crash_is_found(_) ->
    Row = attacked(starl_hostile_insider_block, options()),
    ?assertNot(starl_dev_insider:is_borne(Row)),
    ?assertMatch(#{crashes := [_ | _]}, Row).

%% -- a cluster, in a node of its own ----------------------------------------------------------

init_per_testcase(a_cluster_goes_on, Config) ->
    Own = [Dir || Dir <- code:get_path(), not lists:prefix(code:lib_dir(), Dir)],
    Paths = lists:append([["-pa", filename:absname(D)] || D <- Own, filelib:is_dir(D)]),
    {ok, Conductor, _} = peer:start(#{
        connection => standard_io,
        shutdown => close,
        wait_boot => 60000,
        args => [
            "-nocookie",
            "-kernel",
            "logger_level",
            "none",
            "-kernel",
            "prevent_overlapping_partitions",
            "false"
            | Paths
        ]
    }),
    [{conductor, Conductor} | Config];
init_per_testcase(_Case, Config) ->
    Config.

end_per_testcase(a_cluster_goes_on, Config) ->
    try
        peer:stop(proplists:get_value(conductor, Config))
    catch
        exit:_ -> ok
    end;
end_per_testcase(_Case, _Config) ->
    ok.

a_cluster_goes_on(Config) ->
    Dir = filename:join(proplists:get_value(priv_dir, Config), cluster),
    Row = peer:call(proplists:get_value(conductor, Config), ?MODULE, attack, [Dir], 300000),
    ct:pal("~ts", [starl_dev_insider_cluster:format(Row)]),
    ?assert(starl_dev_insider_cluster:is_borne(Row), Row).

attack(Dir) ->
    _ = process_flag(trap_exit, true),
    Options = (options())#{speed => 4, attack => true, messages => 40},
    starl_dev_insider_cluster:run([sap, barrier, counter], Options, Dir).
