%% @doc Runs a scenario in real time as a cluster on this machine. Each robot has an Erlang node of
%% its own, which is an operating system process; the world ({@link starl_world}) runs in this VM.
%%
%% A node that ends is restarted with the same store, and its robot rejoins the team. All nodes end
%% with this process, however it ends: OTP's `peer' holds them by their standard input.
%% ```
%%     starl_cluster_server --- starl_world   this VM
%%        | peer   | peer   | peer
%%     robot 1   robot 2   robot 3            a VM each: starl_live_sup - starl_live_robot
%% '''
%% This module starts and asks the cluster; its process is {@link starl_cluster_server}.
-module(starl_cluster).
-behaviour(starl_run).

-export([
    world/0,
    start/2,
    await/1,
    until/2,
    status/1,
    place/2,
    reload/2, reload/3,
    act/2,
    halt_at_work/3,
    heal/2,
    stop/1,
    finish/1
]).
-export([scenario/1, most_halted_ms/0, format_error/1]).

-export_type([t/0, options/0, status/0, reason/0]).

-record(cluster, {
    server :: pid(),
    scenario :: starl_run_scenario:t(),
    scene :: starl_scene:t()
}).

%% A running cluster, linked to the process that started it.
-opaque t() :: #cluster{}.

%% `transport': how packets travel between the nodes. `speed': 2.0 is twice as fast as real time; `air': other air than
%% that of the scenario's radio; `chassis': what the robots have in place of a chassis of the world;
%% `watch': further monitors, which only look on. `dir': the
%% directory of the robots' stores. `epoch_us': the system time of the run's time 0, for robots that go on
%% from the stores of an earlier run; by default the present one. `code': modules that were compiled in memory. `metrics': robot N
%% serves its metrics at this port plus N. `chaos': what
%% happens to the nodes, at which times of the run. `packets': whether the observer is told of all
%% packets; `recorder': what each robot is recorded with on its own node. `log': gets each line of the
%% nodes' logs.
-type options() :: #{
    dir := file:filename(),
    epoch_us => integer(),
    transport := starl_world_stage:name(),
    speed => number(),
    air => starl_live_air:settings(),
    watch => [{module(), map()}],
    observe => starl_observer:t(),
    packets => boolean(),
    recorder => starl_observer:recorder(),
    rate_hz => number() | none,
    chassis => starl_world_chassis:lines(),
    whole_mm => boolean(),
    arena => starl_world_floor:arena(),
    metrics => inet:port_number() | none,
    chaos => [{AtUs :: integer(), starl_cluster_chaos:hand()}],
    code => starl_cluster_nodes:code(),
    log => fun((starl:robot_id(), logger:level(), binary()) -> term())
}.

-type status() :: #{
    now_us := integer(),
    leader := starl:robot_id() | none,
    running := non_neg_integer(),
    up := [starl:robot_id()],
    ending := starl_world:ending() | none,
    restarts := #{starl:robot_id() => non_neg_integer()},
    os_pids := #{starl:robot_id() => string()}
}.

-type reason() ::
    starl_run:reason() | starl_cluster_start:reason().

-define(CALL_MS, 60000).

%% @doc Starts the nodes and robots of a scenario.
-spec start(#{app := module(), atom() => term()}, options()) -> {ok, t()} | {error, reason()}.
start(Given, Options) ->
    case starl_world:plan(Given, Options#{world => nodes}) of
        {ok, {Scenario, Scene, Plan} = Planned, Schedule} ->
            Observed = starl_world:observed(Planned, Options),
            case starl_cluster_server:start_link(Plan, Schedule, Observed) of
                {ok, Server} ->
                    Full = Scenario#{faults := Schedule},
                    {ok, #cluster{server = Server, scenario = Full, scene = Scene}};
                {error, {shutdown, Reason}} ->
                    {error, Reason}
            end;
        {error, _} = Error ->
            Error
    end.

%% @doc Each robot has a node.
-spec world() -> nodes.
world() -> nodes.

%% @doc Waits for the end of the run.
-spec await(t()) -> starl_world:ending().
await(#cluster{server = Server}) ->
    starl_world:await(gen_server:call(Server, world, infinity)).

%% @doc Waits until this time of the run.
-spec until(t(), Us :: integer()) -> ok.
until(#cluster{server = Server}, Us) ->
    starl_world:until(gen_server:call(Server, world, infinity), Us).

%% @doc The present time, the robots at work, and their nodes.
-spec status(t()) -> status().
status(#cluster{server = Server}) -> gen_server:call(Server, status, ?CALL_MS).

%% @doc Reloads code on all nodes, with a trial time ({@link starl_cluster_reload}); answers when it
%% is over, or has failed.
-spec reload(t(), [starl_version:source()]) -> starl_cluster_reload:answer().
reload(Cluster, Sources) -> reload(Cluster, Sources, #{}).

%% @doc The same, with another trial time.
-spec reload(t(), [starl_version:source()], starl_cluster_reload:options()) ->
    starl_cluster_reload:answer().
reload(#cluster{server = Server}, Sources, Options) ->
    gen_server:call(Server, {reload, Sources, Options}, infinity).

%% @doc The node of a robot, and the parameters of its end of the transport: for tests that attack
%% it.
-spec place(t(), starl:robot_id()) ->
    {ok, #{node := node() | none, transport := starl_live_link:line()}}
    | {error, unicode:chardata()}.
place(#cluster{server = Server}, Robot) -> gen_server:call(Server, {place, Robot}, ?CALL_MS).

%% @doc Applies manual faults now. A reboot of no length kills the robot's node by SIGKILL; the node
%% is restarted. A store that is set back in no time gets the state that it had when the node was
%% last started. A pause halts the node at once, for a time by the computer's clock.
-spec act(t(), [starl_run_hand:t()]) -> ok | {error, unicode:chardata()}.
act(#cluster{server = Server}, Hands) -> gen_server:call(Server, {act, Hands}, ?CALL_MS).

%% @doc Halts the node of a robot in the middle of its work, as soon as it does something, for a
%% time by the computer's clock. Returns where it was found, when the node goes on.
-spec halt_at_work(t(), starl:robot_id(), Seconds :: number()) ->
    {ok, starl_cluster_halts:found()} | {error, unicode:chardata()}.
halt_at_work(#cluster{server = Server}, Robot, Seconds) ->
    gen_server:call(Server, {halted, Robot, Seconds}, infinity).

%% @doc Ends these faults. Pauses end only with `all'.
-spec heal(t(), starl_run_hand:heal()) -> ok.
heal(#cluster{server = Server}, What) -> gen_server:call(Server, {heal, What}, ?CALL_MS).

%% @doc Ends the run.
-spec stop(t()) -> ok.
stop(#cluster{server = Server}) -> starl_world:stop(gen_server:call(Server, world, infinity)).

%% @doc The longest time for which a node can be halted, by the computer's clock. It is less than
%% three quarters of the time (60 s) after which Erlang's distribution gives up a silent node.
-spec most_halted_ms() -> pos_integer().
most_halted_ms() -> starl_cluster_faults:most_halted_ms().

%% @doc The checked scenario, with all defaults.
-spec scenario(t()) -> starl_run_scenario:t().
scenario(#cluster{scenario = Scenario}) -> Scenario.

%% @doc Ends the nodes and the world; returns the outcome and the application's report.
-spec finish(t()) -> {starl_run:outcome(), starl_scene:report()}.
finish(#cluster{server = Server, scenario = #{app := App}, scene = Scene}) ->
    Outcome = starl_world:finish(gen_server:call(Server, world, infinity)),
    ok = gen_server:call(Server, close, infinity),
    ok = gen_server:stop(Server, normal, infinity),
    {Outcome, starl_scene:report(App, Scene, Outcome)}.

%% @doc One line on why a cluster could not be started.
-spec format_error(reason()) -> unicode:chardata().
format_error({control, Why}) -> ["the cluster's socket for commands: ", Why];
format_error({peers, Reason}) -> starl_sim_peers:format_error(Reason);
format_error({robot, Robot, Why}) -> io_lib:format("robot ~b does not start: ~ts", [Robot, Why]);
format_error(Reason) -> starl_run:format_error(Reason).
