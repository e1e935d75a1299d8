%% The nodes of tests: a conductor, a peer held by its standard input and output, in which all of
%% it happens, and two workers besides; all of them end with whoever started them.
-module(starl_nodes_ct).

-export([start_conductor/1, stop_conductor/1, start_workers/1, stop_workers/1]).
-export([in_conductor/4, worker_nodes/1, os_pid/2, refused/2, ring/1, options/1, kill/1]).
-export([sites/2, sites_left/1]).
%% called in the conductor and on workers
-export([workers/0, bare_node/0, why_refused/2, sites/1, left/0, shards/0]).

-define(TIMEOUT_MS, 2000).

%% For init_per_suite/1 and end_per_suite/1.
start_conductor(Config) ->
    Own = [Dir || Dir <- code:get_path(), not lists:prefix(code:lib_dir(), Dir)],
    Paths = lists:append([["-pa", filename:absname(Dir)] || Dir <- Own, filelib:is_dir(Dir)]),
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
    [{conductor, Conductor} | Config].

stop_conductor(Config) ->
    peer:stop(proplists:get_value(conductor, Config)).

%% For init_per_testcase/2 and end_per_testcase/2: each test has workers of its own, for
%% most of them are not well afterwards.
start_workers(Config) ->
    {Holder, Workers} = in_conductor(?MODULE, workers, [], Config),
    [{holder, Holder}, {workers, Workers} | Config].

stop_workers(Config) ->
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

in_conductor(Module, Function, Args, Config) ->
    peer:call(proplists:get_value(conductor, Config), Module, Function, Args, 60000).

worker_nodes(Config) -> [Node || {Node, _} <- proplists:get_value(workers, Config)].

os_pid(Node, Config) ->
    {_, OsPid} = lists:keyfind(Node, 1, proplists:get_value(workers, Config)),
    OsPid.

%% Why a run over these nodes does not start.
refused(Nodes, Config) -> in_conductor(?MODULE, why_refused, [ring(1), Nodes], Config).

%% What is left of a simulation on these nodes, or on the workers, when it had time to end.
sites(Nodes, Config) -> in_conductor(?MODULE, sites, [Nodes], Config).

sites_left(Config) -> sites(worker_nodes(Config), Config).

ring(Messages) ->
    #{
        app => starl_ring_shuttle,
        robots => 9,
        messages => Messages,
        seed => 11,
        loss => 0.2,
        duplicate => 0.1,
        delay => {10, 20},
        time => 100000,
        clock_drift => 100,
        faults => [
            {a, 1000, 1000, kill_machine, {2, sap}, #{}},
            {b, 1500, 1500, kill_machine, {9, app}, #{}},
            {c, 2000, 2000, kill_robot, 4, #{}},
            {d, 1000, 3000, burst_loss, all, #{part => 0.3, burst_ms => 100}}
        ]
    }.

options(Nodes) -> #{nodes => Nodes, node_timeout_ms => ?TIMEOUT_MS}.

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

why_refused(Scenario, Nodes) ->
    {error, Reason} = starl_sim:start(Scenario, options(Nodes)),
    true = is_list(lists:flatten(starl_sim:format_error(Reason))),
    Reason.

%% Waits for the sites of these nodes to end; gives what is left there of a simulation.
sites(Nodes) -> lists:append([erpc:call(Node, ?MODULE, left, [], 20000) || Node <- Nodes]).

left() ->
    Refs = [erlang:monitor(process, Pid) || {Pid, starl_sim_site} <- simulation()],
    _ = [
        receive
            {'DOWN', Ref, process, _, _} -> ok
        after 10000 -> late
        end
     || Ref <- Refs
    ],
    simulation().

shards() -> [Pid || {Pid, starl_sim_shard} <- simulation()].

simulation() ->
    [
        {Pid, Module}
     || Pid <- processes(),
        {Module, init, _} <- [proc_lib:translate_initial_call(Pid)],
        lists:member(Module, [starl_sim_site, starl_sim_shard, starl_machine_proc, starl_app_proc])
    ].
