%% The contract of a simulation over several Erlang nodes (README): the digest of a run
%% in one VM, whatever the nodes; and nodes that cannot be used are a clear error. This VM is no
%% node: it all happens in a conductor (starl_nodes_ct). Lost nodes: starl_nodes_lost_SUITE.
-module(starl_nodes_SUITE).
-include_lib("stdlib/include/assert.hrl").
-import(starl_nodes_ct, [
    ring/1, worker_nodes/1, refused/2, sites/2, sites_left/1
]).

-export([
    suite/0, all/0, init_per_suite/1, end_per_suite/1, init_per_testcase/2, end_per_testcase/2
]).
-export([
    same_digest_painting/1,
    same_digest_ring/1,
    same_digest_own_peers/1,
    paused_and_stepped/1,
    looked_at/1,
    other_code/1,
    no_code/1,
    bad_nodes/1
]).
%% called in the conductor
-export([digest/2, stepped/2, look/1]).

suite() -> [{timetrap, {minutes, 2}}].

all() ->
    [
        same_digest_painting,
        same_digest_ring,
        same_digest_own_peers,
        paused_and_stepped,
        looked_at,
        other_code,
        no_code,
        bad_nodes
    ].

init_per_suite(Config) -> starl_nodes_ct:start_conductor(Config).

end_per_suite(Config) -> starl_nodes_ct:stop_conductor(Config).

init_per_testcase(_Test, Config) -> starl_nodes_ct:start_workers(Config).

end_per_testcase(_Test, Config) -> starl_nodes_ct:stop_workers(Config).

%% -- the same digest ------------------------------------------------------------------------

same_digest_painting(Config) ->
    Kill = fun(Id, T, Robot, Machine) -> {Id, T, T, kill_machine, {Robot, Machine}, #{}} end,
    same_digest(Config, #{
        app => starl_painting,
        robots => 5,
        picture => "house",
        seed => 11,
        loss => 0.2,
        duplicate => 0.1,
        delay => {5, 50},
        time => 30,
        faults => [
            Kill(a, 8000, 1, sap),
            Kill(b, 12000, 2, motion),
            Kill(c, 12000, 3, dpp),
            Kill(d, 20000, 4, app),
            {e, 24000, 24000, kill_robot, 2, #{}},
            {f, 10000, 20000, location_noise, 3, #{mm => 10}}
        ]
    }).

same_digest_ring(Config) -> same_digest(Config, ring(100)).

%% One VM; one node; two nodes with a shard each, and with two; processes and inline.
same_digest(Config, Scenario) ->
    [A, B] = worker_nodes(Config),
    {_, Events, _} = One = in_conductor(digest, [Scenario#{shards => 1}, #{}], Config),
    ?assert(Events > 1000),
    Cases = [
        {Mode, Shards, Nodes}
     || Mode <- [process, inline], {Shards, Nodes} <- [{1, [A]}, {2, [A, B]}, {4, [A, B]}]
    ],
    [
        ?assertEqual(
            {Case, One},
            {Case,
                in_conductor(
                    digest,
                    [
                        Scenario#{mode => Mode, shards => Shards}, #{nodes => Nodes}
                    ],
                    Config
                )}
        )
     || {Mode, Shards, Nodes} = Case <- Cases
    ].

%% Peers that the simulation starts itself; the shards are dealt by its own rule.
same_digest_own_peers(Config) ->
    One = in_conductor(digest, [ring(40), #{}], Config),
    ?assertEqual(One, in_conductor(digest, [ring(40), #{nodes => 2}], Config)),
    ?assertEqual([], sites_left(Config)).

%% Some shards are told to go on before others, and their mail arrives there first.
paused_and_stepped(Config) ->
    Scenario = (ring(100))#{shards => 4},
    One = in_conductor(digest, [Scenario, #{}], Config),
    Options = #{nodes => worker_nodes(Config)},
    ?assertEqual(One, in_conductor(stepped, [Scenario, Options], Config)).

%% Robots are where they should be, and can be looked at from the conductor.
looked_at(Config) ->
    [A, B] = worker_nodes(Config),
    {Nodes, Sap} = in_conductor(look, [[A, B]], Config),
    ?assertEqual(lists:sort([A, A, B, B]), lists:sort(Nodes)),
    ?assertMatch(#{module := starl_sap}, Sap),
    ?assertEqual([], sites_left(Config)).

%% -- before the start -----------------------------------------------------------------------

other_code(Config) ->
    [A, B] = worker_nodes(Config),
    Form = [
        {attribute, 1, module, starl_geometry},
        {attribute, 1, export, [{other, 0}]},
        {function, 1, other, 0, [{clause, 1, [], [], [{atom, 1, other}]}]}
    ],
    {ok, starl_geometry, Beam} = compile:forms(Form),
    Load = [B, code, load_binary, [starl_geometry, "", Beam]],
    {module, _} = starl_nodes_ct:in_conductor(erpc, call, Load, Config),
    {nodes, Reason} = refused([A, B], Config),
    ?assertMatch({other_code, B, [starl_geometry], _, _}, Reason),
    Line = lists:flatten(starl_sim_nodes:format_error(Reason)),
    ?assertNotEqual(nomatch, string:find(Line, "starl_geometry")),
    ?assertEqual([], sites([A], Config)).

no_code(Config) ->
    {Holder, Node} = starl_nodes_ct:in_conductor(starl_nodes_ct, bare_node, [], Config),
    Refused = refused([Node], Config),
    true = peer:call(proplists:get_value(conductor, Config), erlang, exit, [Holder, shutdown]),
    ?assertEqual({nodes, {no_code, Node}}, Refused).

bad_nodes(Config) ->
    [A, _] = worker_nodes(Config),
    [
        ?assertEqual({Bad, {nodes, {bad_nodes, Bad}}}, {Bad, refused(Bad, Config)})
     || Bad <- [0, -1, [], ["a@b"], two, 1.5]
    ],
    ?assertEqual({nodes, {twice, A}}, refused([A, A], Config)),
    Nobody = 'nobody@127.0.0.1',
    ?assertEqual({nodes, {unreachable, Nobody}}, refused([A, Nobody], Config)),
    ?assertEqual([], sites_left(Config)),
    %% a VM that is no node has no others
    ?assertEqual(
        {error, {nodes, not_distributed}}, starl_sim:start(ring(1), #{nodes => ['a@127.0.0.1']})
    ).

%% -- helpers --------------------------------------------------------------------------------

in_conductor(Function, Args, Config) ->
    starl_nodes_ct:in_conductor(?MODULE, Function, Args, Config).

%% -- in the conductor -----------------------------------------------------------------------

digest(Scenario, Options) ->
    {ok, Sim} = starl_sim:start(Scenario, Options),
    starl_sim:run(Sim),
    told(starl_sim:finish(Sim)).

told({#{digest := Digest, events := Events, violations := [], lost := [], robots := Robots}, _}) ->
    {Digest, Events, [{Id, Pose, Result} || {Id, #{pose := Pose, result := Result}} <- Robots]}.

stepped(Scenario, Options) ->
    {ok, Sim} = starl_sim:start(Scenario, Options),
    _ = [starl_sim:step(Sim, 0.05) || _ <- lists:seq(1, 100)],
    starl_sim:run(Sim),
    told(starl_sim:finish(Sim)).

look(Nodes) ->
    Scenario = (ring(100))#{robots => 4, mode => process, shards => 2, faults => []},
    {ok, Sim} = starl_sim:start(Scenario, #{nodes => Nodes}),
    _ = starl_sim:step(Sim, 1.0),
    Pids = starl_sim:robot_pids(Sim, all),
    #{sap := Sap} = starl_sim:inspect(Sim, 2),
    ok = starl_sim:close(Sim),
    {[node(Pid) || Pid <- Pids], Sap}.
