%% The contract of a simulation over several Erlang nodes (README) when one is lost: a
%% node that is gone, stopped or slow is a clear error in bounded time, with nothing left over
%% anywhere. This VM is no node: it all happens in a conductor (starl_nodes_ct).
-module(starl_nodes_lost_SUITE).
-include_lib("stdlib/include/assert.hrl").
-import(starl_nodes_ct, [
    ring/1, options/1, worker_nodes/1, os_pid/2, refused/2, sites/2, sites_left/1
]).

-export([
    suite/0, all/0, init_per_suite/1, end_per_suite/1, init_per_testcase/2, end_per_testcase/2
]).
-export([
    killed/1,
    suspended_own_peer/1,
    killed_before_the_finish/1,
    suspended/1,
    suspended_before_the_start/1,
    suspended_in_the_launch/1,
    endless_loop/1,
    shard_crash/1,
    watch_gone/1,
    others_stay/1
]).
%% called in the conductor
-export([
    lost/4, lost_own_peer/3, late_loss/2, launch/2, crash/2, orphaned/1, exhausted/1, apart/2
]).
%% called on a worker
-export([part_from/1]).

suite() -> [{timetrap, {minutes, 2}}].

all() ->
    [
        killed,
        suspended_own_peer,
        killed_before_the_finish,
        suspended,
        suspended_before_the_start,
        suspended_in_the_launch,
        endless_loop,
        shard_crash,
        watch_gone,
        others_stay
    ].

init_per_suite(Config) -> starl_nodes_ct:start_conductor(Config).

end_per_suite(Config) -> starl_nodes_ct:stop_conductor(Config).

init_per_testcase(_Test, Config) -> starl_nodes_ct:start_workers(Config).

end_per_testcase(_Test, Config) -> starl_nodes_ct:stop_workers(Config).

%% -- lost nodes -----------------------------------------------------------------------------

killed(Config) ->
    [A, B] = worker_nodes(Config),
    Lost = in_conductor(lost, [[A, B], B, "KILL", os_pid(B, Config)], Config),
    is_loss(B, down, [1, 3, 5, 7, 9], Lost),
    ?assertEqual([], sites([A], Config)).

%% A peer that is stopped would not hear that it is to end; the other one ends as well.
suspended_own_peer(Config) ->
    {Node, Lost, OsPids} = in_conductor(lost_own_peer, [2, "STOP", 1], Config),
    ?assertMatch({#{ending := lost}, [#{node := Node, why := silent}], _}, Lost),
    Alive = [Pid || Pid <- OsPids, is_alive(Pid)],
    lists:foreach(fun starl_nodes_ct:kill/1, Alive),
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
    ?assertEqual([], sites([B], Config)),
    %% when it goes on, it learns that the run is over
    "" = os:cmd("kill -CONT " ++ os_pid(A, Config)),
    ?assertEqual([], sites([A], Config)).

suspended_before_the_start(Config) ->
    [A, B] = worker_nodes(Config),
    "" = os:cmd("kill -STOP " ++ os_pid(B, Config)),
    ?assertEqual({nodes, {silent, B}}, refused([A, B], Config)),
    ?assertEqual([], sites([A], Config)).

%% The run waits for the robots of a node, and has much to send to it.
suspended_in_the_launch(Config) ->
    [A, B] = worker_nodes(Config),
    Reason = in_conductor(launch, [[A, B], B], Config),
    case Reason of
        {nodes, {lost, Loss}} -> ?assertMatch(#{node := B, why := silent, at_us := 0}, Loss);
        %% On a loaded machine it is the loading of the code that the node does not answer.
        {nodes, {silent, Node}} -> ?assertEqual(B, Node)
    end,
    ?assertEqual([], sites([A], Config)).

%% A node that is not dead but does not get on, either.
endless_loop(Config) ->
    [A, B] = worker_nodes(Config),
    Loss = looping(B, 5, [A, B], Config),
    ?assertMatch(#{work := [{2, app, [_ | _]}]}, Loss),
    ?assertNotEqual(nomatch, string:find(starl_sim_nodes:format_loss(Loss), ": robot 2 at ")).

%% What is at work is named if its node answers in 0.2 s: on a loaded machine not in each run.
looping(Node, Runs, Nodes, Config) ->
    {Status, Losses, Robots} = in_conductor(exhausted, [Nodes], Config),
    ?assertMatch(#{ending := lost}, Status),
    ?assertMatch([#{node := Node, why := slow}], Losses),
    ?assertEqual([1], Robots),
    ?assertEqual([], sites_left(Config)),
    case Losses of
        [Loss] when is_map_key(work, Loss); Runs =:= 1 -> Loss;
        [_] -> looping(Node, Runs - 1, Nodes, Config)
    end.

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

%% Two nodes lose sight of each other: the third keeps both, whatever OTP's global thinks of that.
others_stay(Config) ->
    [A, B] = worker_nodes(Config),
    ?assertEqual(lists:sort([A, B]), in_conductor(apart, [A, B], Config)).

is_loss(Node, Why, Robots, {Status, Losses, {Digest, Left, EndUs}}) ->
    #{ending := Ending, now_us := Now} = Status,
    ?assertEqual({lost, EndUs}, {Ending, Now}),
    [#{node := Node, why := Why, at_us := At} = Loss] = Losses,
    ?assert(At > 0),
    ?assertEqual({At, Robots, <<>>}, {EndUs, Left, Digest}),
    Line = lists:flatten(starl_sim_nodes:format_loss(Loss)),
    [
        ?assertNotEqual(nomatch, string:find(Line, Part))
     || Part <- [atom_to_list(Node), float_to_list(At / 1.0e6, [{decimals, 3}]), "run again"]
    ].

%% -- helpers --------------------------------------------------------------------------------

in_conductor(Function, Args, Config) ->
    starl_nodes_ct:in_conductor(?MODULE, Function, Args, Config).

%% Given some time to end. A process that has ended and that nobody has waited for is not alive.
is_alive(OsPid) ->
    _ = os:cmd("timeout 10 tail -s 0.05 --pid=" ++ OsPid ++ " -f /dev/null"),
    case file:read_file(filename:join(["/proc", OsPid, "stat"])) of
        {ok, Stat} -> binary:match(Stat, <<") Z ">>) =:= nomatch;
        {error, _} -> false
    end.

%% -- in the conductor -----------------------------------------------------------------------

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
            lists:foreach(fun starl_nodes_ct:kill/1, OsPids),
            erlang:raise(Class, Reason, Stack)
    end.

lost(Sim, Signal, OsPid) ->
    _ = starl_sim:run(Sim, 1.0),
    Run = spawn_running(Sim),
    "" = os:cmd("kill -" ++ Signal ++ " " ++ OsPid),
    Status =
        receive
            {Run, S} -> S
        end,
    {Outcome, _} = starl_sim:finish(Sim),
    #{lost := Losses, digest := Digest, robots := Robots, end_us := End} = Outcome,
    {Status, Losses, {Digest, [Id || {Id, _} <- Robots], End}}.

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
    Status = starl_sim:run(Sim),
    {#{lost := Losses, robots := Robots}, _} = starl_sim:finish(Sim),
    {Status, Losses, [Id || {Id, _} <- Robots]}.

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
    Shards = erpc:call(Node, starl_nodes_ct, shards, []),
    _ = [exit(Shard, planted) || Shard <- Shards],
    try starl_sim:run(Sim) of
        Status -> Status
    catch
        exit:{Reason, {gen_server, call, _}} -> Reason
    end.

apart(A, B) ->
    [] = [A, B] -- nodes(),
    ok = erpc:call(A, ?MODULE, part_from, [B]),
    %% whom the two tell of it, has heard it
    _ = sys:get_state(global_name_server),
    lists:sort([Node || Node <- nodes(), lists:member(Node, [A, B])]).

part_from(Node) ->
    true = net_kernel:connect_node(Node),
    ok = net_kernel:monitor_nodes(true),
    true = erlang:disconnect_node(Node),
    receive
        {nodedown, Node} -> ok
    end,
    _ = sys:get_state(global_name_server),
    ok.

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
