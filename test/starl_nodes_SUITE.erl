%% The contract of a simulation over several Erlang nodes (DESIGN section 4): the digest of a run
%% in one VM, whatever the nodes; and a node that is gone, stopped or slow is a clear error in
%% bounded time, with nothing left over anywhere.
%%
%% This VM is no node. Everything happens in a conductor, a peer held by its standard input and
%% output, which has two workers besides; all of them end with whoever started them.
-module(starl_nodes_SUITE).
-include_lib("stdlib/include/assert.hrl").

-export([
    suite/0, all/0, init_per_suite/1, end_per_suite/1, init_per_testcase/2, end_per_testcase/2
]).
-export([
    same_digest_painting/1, same_digest_ring/1, same_digest_own_peers/1, paused_and_stepped/1,
    looked_at/1, killed/1, suspended_own_peer/1, killed_before_the_finish/1, suspended/1,
    suspended_before_the_start/1, suspended_in_the_launch/1, endless_loop/1, shard_crash/1,
    watch_gone/1, other_code/1, no_code/1, bad_nodes/1
]).
%% called in the conductor
-export([
    workers/0, digest/2, stepped/2, look/1, lost/4, lost_own_peer/3, late_loss/2, why_refused/2,
    launch/2, crash/2, orphaned/1, bare_node/0, sites/1, left/0, shards/0, exhausted/1
]).

-define(TIMEOUT_MS, 2000).
%% From a loss to the end of a run, with much else going on on the machine.
-define(BOUND_MS, 20000).

suite() -> [{timetrap, {minutes, 2}}].

all() ->
    [
        same_digest_painting, same_digest_ring, same_digest_own_peers, paused_and_stepped,
        looked_at, killed, suspended_own_peer, killed_before_the_finish, suspended,
        suspended_before_the_start, suspended_in_the_launch, endless_loop, shard_crash,
        watch_gone, other_code, no_code, bad_nodes
    ].

init_per_suite(Config) ->
    Own = [Dir || Dir <- code:get_path(), not lists:prefix(code:lib_dir(), Dir)],
    Paths = lists:append([["-pa", filename:absname(Dir)] || Dir <- Own, filelib:is_dir(Dir)]),
    {ok, Conductor, _} = peer:start(#{
        connection => standard_io, shutdown => close, wait_boot => 60000,
        args => ["-nocookie", "-kernel", "logger_level", "none" | Paths]
    }),
    [{conductor, Conductor} | Config].

end_per_suite(Config) ->
    peer:stop(proplists:get_value(conductor, Config)).

%% Each test has workers of its own: most of them are not well afterwards.
init_per_testcase(_Test, Config) ->
    {Holder, Workers} = in_conductor(workers, [], Config),
    [{holder, Holder}, {workers, Workers} | Config].

end_per_testcase(_Test, Config) ->
    Holder = proplists:get_value(holder, Config),
    Conductor = proplists:get_value(conductor, Config),
    true = peer:call(Conductor, erlang, exit, [Holder, shutdown]),
    lists:foreach(fun({_, OsPid}) -> kill(OsPid) end, proplists:get_value(workers, Config)).

%% A node of these tests, if it still is there; nobody else who has got its number since.
kill(OsPid) ->
    Is = "grep -qa nocookie /proc/" ++ OsPid ++ "/cmdline",
    %% it may end between the two
    _ = os:cmd("{ " ++ Is ++ " && kill -KILL " ++ OsPid ++ "; } 2>/dev/null"),
    ok.

%% -- the same digest ------------------------------------------------------------------------

same_digest_painting(Config) ->
    Kill = fun(Id, T, Robot, Machine) -> {Id, T, T, kill_machine, {Robot, Machine}, #{}} end,
    same_digest(Config, #{
        app => starl_painting, robots => 5, picture => "house", seed => 11, loss => 0.2,
        duplicate => 0.1, delay => {5, 50}, time => 30, faults => [
            Kill(a, 8000, 1, sap), Kill(b, 12000, 2, motion), Kill(c, 12000, 3, dpp),
            Kill(d, 20000, 4, app), {e, 24000, 24000, kill_robot, 2, #{}},
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
            {Case, in_conductor(digest, [
                Scenario#{mode => Mode, shards => Shards}, #{nodes => Nodes}
            ], Config)}
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
    ?assertEqual([A, A, B, B], lists:sort(Nodes)),
    ?assertMatch(#{module := starl_sap}, Sap),
    ?assertEqual([], sites_left(Config)).

%% -- lost nodes -----------------------------------------------------------------------------

killed(Config) ->
    [A, B] = worker_nodes(Config),
    Lost = in_conductor(lost, [[A, B], B, "KILL", os_pid(B, Config)], Config),
    is_loss(B, down, [1, 3, 5, 7, 9], Lost),
    ?assertEqual([], in_conductor(sites, [[A]], Config)).

%% A peer that is stopped would not hear that it is to end; the other one ends as well.
suspended_own_peer(Config) ->
    {Node, Lost, OsPids} = in_conductor(lost_own_peer, [2, "STOP", 1], Config),
    ?assertMatch({#{ending := lost}, _, [#{node := Node, why := silent}], _}, Lost),
    Alive = [Pid || Pid <- OsPids, is_alive(Pid)],
    lists:foreach(fun kill/1, Alive),
    ?assertEqual([], Alive).

%% What the run came to is known but for the robots of the node, and the digest.
killed_before_the_finish(Config) ->
    [A, B] = worker_nodes(Config),
    {Ending, Digest, Losses, Robots} = in_conductor(
        late_loss, [[A, B], os_pid(A, Config)], Config
    ),
    ?assertEqual({lost, <<>>, [2, 4, 6, 8]}, {Ending, Digest, Robots}),
    ?assertMatch([#{node := A, why := down}], Losses).

suspended(Config) ->
    [A, B] = worker_nodes(Config),
    Lost = in_conductor(lost, [[A, B], A, "STOP", os_pid(A, Config)], Config),
    is_loss(A, silent, [2, 4, 6, 8], Lost),
    ?assertEqual([], in_conductor(sites, [[B]], Config)),
    %% when it goes on, it learns that the run is over
    "" = os:cmd("kill -CONT " ++ os_pid(A, Config)),
    ?assertEqual([], in_conductor(sites, [[A]], Config)).

suspended_before_the_start(Config) ->
    [A, B] = worker_nodes(Config),
    "" = os:cmd("kill -STOP " ++ os_pid(B, Config)),
    ?assertEqual({nodes, {silent, B}}, refused([A, B], Config)),
    ?assertEqual([], in_conductor(sites, [[A]], Config)).

%% The run waits for the robots of a node, and has much to send to it.
suspended_in_the_launch(Config) ->
    [A, B] = worker_nodes(Config),
    Reason = in_conductor(launch, [[A, B], B], Config),
    ?assertMatch({nodes, {lost, #{node := B, why := silent, at_us := 0}}}, Reason),
    ?assertEqual([], in_conductor(sites, [[A]], Config)).

%% A node that is not dead but does not get on, either.
endless_loop(Config) ->
    [A, B] = worker_nodes(Config),
    {Status, Ms, Losses, Robots} = in_conductor(exhausted, [[A, B]], Config),
    ?assertMatch(#{ending := lost}, Status),
    ?assertMatch([#{node := B, why := slow}], Losses),
    ?assertEqual([1], Robots),
    ?assert(Ms < ?BOUND_MS),
    ?assertEqual([], sites_left(Config)).

%% A shard that breaks is an error of the simulator on any node, not the loss of one.
shard_crash(Config) ->
    [A, B] = worker_nodes(Config),
    ?assertMatch({shard_failed, _}, in_conductor(crash, [[A, B], B], Config)),
    ?assertEqual([], sites_left(Config)).

%% Who watches the nodes is gone without a word: that ends the run, and the nodes clear up by
%% themselves.
watch_gone(Config) ->
    Nodes = worker_nodes(Config),
    ?assertEqual(gone, in_conductor(orphaned, [Nodes], Config)),
    ?assertEqual([], sites_left(Config)).

is_loss(Node, Why, Robots, {Status, Ms, Losses, {Digest, Left, EndUs}}) ->
    #{ending := Ending, now_us := Now} = Status,
    ?assertEqual({lost, EndUs}, {Ending, Now}),
    [#{node := Node, why := Why, at_us := At} = Loss] = Losses,
    ?assert(At > 0),
    ?assertEqual({At, Robots, <<>>}, {EndUs, Left, Digest}),
    ?assert(Ms < ?BOUND_MS),
    Line = lists:flatten(starl_sim_nodes:format_loss(Loss)),
    [
        ?assertNotEqual(nomatch, string:find(Line, Part))
     || Part <- [atom_to_list(Node), float_to_list(At / 1.0e6, [{decimals, 3}]), "run again"]
    ].

%% -- before the start -----------------------------------------------------------------------

other_code(Config) ->
    [A, B] = worker_nodes(Config),
    Form = [
        {attribute, 1, module, starl_geometry}, {attribute, 1, export, [{other, 0}]},
        {function, 1, other, 0, [{clause, 1, [], [], [{atom, 1, other}]}]}
    ],
    {ok, starl_geometry, Beam} = compile:forms(Form),
    Load = [B, code, load_binary, [starl_geometry, "", Beam]],
    {module, _} = in_conductor(erpc, call, Load, Config),
    {nodes, Reason} = refused([A, B], Config),
    ?assertMatch({other_code, B, [starl_geometry], _, _}, Reason),
    Line = lists:flatten(starl_sim_nodes:format_error(Reason)),
    ?assertNotEqual(nomatch, string:find(Line, "starl_geometry")),
    ?assertEqual([], in_conductor(sites, [[A]], Config)).

no_code(Config) ->
    {Holder, Node} = in_conductor(bare_node, [], Config),
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

refused(Nodes, Config) -> in_conductor(why_refused, [ring(1), Nodes], Config).

%% -- helpers --------------------------------------------------------------------------------

ring(Messages) ->
    #{
        app => starl_ring_shuttle, robots => 9, messages => Messages, seed => 11, loss => 0.2,
        duplicate => 0.1, delay => {10, 20}, time => 100000, clock_drift => 100, faults => [
            {a, 1000, 1000, kill_machine, {2, sap}, #{}},
            {b, 1500, 1500, kill_machine, {9, app}, #{}},
            {c, 2000, 2000, kill_robot, 4, #{}},
            {d, 1000, 3000, burst_loss, all, #{part => 0.3, burst_ms => 100}}
        ]
    }.

in_conductor(Function, Args, Config) -> in_conductor(?MODULE, Function, Args, Config).

in_conductor(Module, Function, Args, Config) ->
    peer:call(proplists:get_value(conductor, Config), Module, Function, Args, 60000).

worker_nodes(Config) -> [Node || {Node, _} <- proplists:get_value(workers, Config)].

os_pid(Node, Config) ->
    {_, OsPid} = lists:keyfind(Node, 1, proplists:get_value(workers, Config)),
    OsPid.

sites_left(Config) -> in_conductor(sites, [worker_nodes(Config)], Config).

%% Given some time to end. A process that has ended and that nobody has waited for is not alive.
is_alive(OsPid) ->
    _ = os:cmd("timeout 10 tail -s 0.05 --pid=" ++ OsPid ++ " -f /dev/null"),
    case file:read_file(filename:join(["/proc", OsPid, "stat"])) of
        {ok, Stat} -> binary:match(Stat, <<") Z ">>) =:= nomatch;
        {error, _} -> false
    end.

%% -- in the conductor -----------------------------------------------------------------------

%% Two nodes, for as long as their holder lives.
workers() ->
    held(fun() ->
        {ok, Peers} = starl_sim_peers:start(2),
        [{Node, erpc:call(Node, os, getpid, [])} || P <- Peers, Node <- [starl_sim_peers:node(P)]]
    end).

%% A node that has nothing but OTP.
bare_node() ->
    held(fun() ->
        Args = ["-nocookie", "-kernel", "inet_dist_use_interface", "{127,0,0,1}"],
        {ok, Peer, _} = peer:start_link(#{
            connection => standard_io, shutdown => close, wait_boot => 60000, args => Args
        }),
        Node = list_to_atom(peer:random_name("bare") ++ "@127.0.0.1"),
        {ok, _} = peer:call(Peer, net_kernel, start, [[Node, longnames]]),
        true = peer:call(Peer, erlang, set_cookie, [Node, erlang:get_cookie()]),
        Node
    end).

held(Start) ->
    Self = self(),
    Holder = spawn(fun() ->
        _ = process_flag(trap_exit, true),
        Self ! {self(), Start()},
        hold()
    end),
    receive
        {Holder, What} -> {Holder, What}
    end.

%% A peer that was killed must not take the other along.
hold() ->
    receive
        {'EXIT', _, shutdown} -> exit(shutdown);
        _ -> hold()
    end.

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

%% A run in whose midst a signal is sent to a node.
lost(Nodes, _Node, Signal, OsPid) ->
    {ok, Sim} = starl_sim:start((ring(100000))#{shards => 2}, options(Nodes)),
    lost(Sim, Signal, OsPid).

lost_own_peer(N, Signal, Which) ->
    Before = nodes(),
    {ok, Sim} = starl_sim:start((ring(100000))#{shards => N}, options(N)),
    Nodes = lists:sort(nodes() -- Before),
    OsPids = [erpc:call(Node, os, getpid, []) || Node <- Nodes],
    try
        {lists:nth(Which, Nodes), lost(Sim, Signal, lists:nth(Which, OsPids)), OsPids}
    catch
        Class:Reason:Stack ->
            lists:foreach(fun kill/1, OsPids),
            erlang:raise(Class, Reason, Stack)
    end.

lost(Sim, Signal, OsPid) ->
    _ = starl_sim:run(Sim, 1.0),
    Run = spawn_running(Sim),
    "" = os:cmd("kill -" ++ Signal ++ " " ++ OsPid),
    Begin = erlang:monotonic_time(millisecond),
    Status = receive {Run, S} -> S end,
    {Outcome, _} = starl_sim:finish(Sim),
    Ms = erlang:monotonic_time(millisecond) - Begin,
    #{lost := Losses, digest := Digest, robots := Robots, end_us := End} = Outcome,
    {Status, Ms, Losses, {Digest, [Id || {Id, _} <- Robots], End}}.

%% Returns when the run is under way.
spawn_running(Sim) ->
    Self = self(),
    Pid = spawn_link(fun() -> Self ! {self(), starl_sim:run(Sim)} end),
    under_way(Sim, maps:get(now_us, starl_sim:status(Sim))),
    Pid.

%% An answer to this question means that the run is running.
under_way(Sim, Now) ->
    case starl_sim:inspect(Sim, 1) of
        {error, running} -> ok;
        #{} -> under_way(Sim, Now)
    end.

late_loss(Nodes, OsPid) ->
    {ok, Sim} = starl_sim:start((ring(100000))#{shards => 2, time => 2}, options(Nodes)),
    #{ending := time} = starl_sim:run(Sim),
    "" = os:cmd("kill -KILL " ++ OsPid),
    {Outcome, _} = starl_sim:finish(Sim),
    #{ending := Ending, digest := Digest, lost := Losses, robots := Robots} = Outcome,
    {Ending, Digest, Losses, [Id || {Id, _} <- Robots]}.

exhausted(Nodes) ->
    Scenario = #{app => starl_sim_script_app, robots => 2, shards => 2, script => fun spin/1},
    {ok, Sim} = starl_sim:start(Scenario, options(Nodes)),
    {Us, Status} = timer:tc(fun() -> starl_sim:run(Sim) end),
    {#{lost := Losses, robots := Robots}, _} = starl_sim:finish(Sim),
    {Status, Us div 1000, Losses, [Id || {Id, _} <- Robots]}.

spin(Robot) ->
    case starl:id(Robot) of
        1 -> starl:sleep(Robot, 60000);
        2 -> spin(Robot)
    end.

%% The node stops itself in the launch: its supervisors take part in that, and stand still from the
%% moment when they are there.
launch(Nodes, Node) ->
    ok = erpc:cast(Node, fun() ->
        _ = process_flag(priority, high),
        stop_in_the_launch()
    end),
    Scenario = (ring(1))#{robots => 200, mode => process, shards => 2},
    {error, Reason} = starl_sim:start(Scenario, options(Nodes)),
    Reason.

stop_in_the_launch() ->
    Supervisors = [
        Pid
     || Pid <- processes(),
        {supervisor, starl_sim_pool, _} <- [proc_lib:translate_initial_call(Pid)]
    ],
    case Supervisors of
        [_, _] ->
            _ = [true = erlang:suspend_process(Pid) || Pid <- Supervisors],
            os:cmd("kill -STOP " ++ os:getpid());
        _ ->
            receive
            after 1 -> stop_in_the_launch()
            end
    end.

crash(Nodes, Node) ->
    _ = process_flag(trap_exit, true),
    {ok, Sim} = starl_sim:start((ring(100000))#{shards => 2}, options(Nodes)),
    Shards = erpc:call(Node, ?MODULE, shards, []),
    _ = [exit(Shard, planted) || Shard <- Shards],
    try starl_sim:run(Sim) of
        Status -> Status
    catch
        exit:{Reason, {gen_server, call, _}} -> Reason
    end.

orphaned(Nodes) ->
    _ = process_flag(trap_exit, true),
    {ok, Sim} = starl_sim:start((ring(100000))#{shards => 2}, options(Nodes)),
    [Watch] = [
        Pid
     || Pid <- processes(), {starl_sim_nodes, _, _} <- [proc_lib:translate_initial_call(Pid)]
    ],
    exit(Watch, kill),
    try starl_sim:run(Sim) of
        Status -> Status
    catch
        exit:{_, {gen_server, call, _}} -> gone
    end.

why_refused(Scenario, Nodes) ->
    {error, Reason} = starl_sim:start(Scenario, options(Nodes)),
    true = is_list(lists:flatten(starl_sim:format_error(Reason))),
    Reason.

options(Nodes) -> #{nodes => Nodes, node_timeout_ms => ?TIMEOUT_MS}.

%% Waits for the sites of these nodes to end; gives what is left there of a simulation.
sites(Nodes) -> lists:append([erpc:call(Node, ?MODULE, left, [], 20000) || Node <- Nodes]).

left() ->
    Refs = [erlang:monitor(process, Pid) || {Pid, starl_sim_site} <- simulation()],
    _ = [receive {'DOWN', Ref, process, _, _} -> ok after 10000 -> late end || Ref <- Refs],
    simulation().

shards() -> [Pid || {Pid, starl_sim_shard} <- simulation()].

simulation() ->
    [
        {Pid, Module}
     || Pid <- processes(),
        {Module, init, _} <- [proc_lib:translate_initial_call(Pid)],
        lists:member(Module, [starl_sim_site, starl_sim_shard, starl_machine_proc, starl_app_proc])
    ].
