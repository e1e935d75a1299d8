%% @doc Starts a cluster: its nodes with all their code, the socket for commands, the world, and the
%% planned faults. The time of the run begins with the world. The robots are opened later.
-module(starl_cluster_start).

-export([start/3]).

-export_type([reason/0, started/0]).

%% Why there is no cluster: no nodes, no socket for commands; a robot that cannot be opened.
-type reason() ::
    {peers, starl_sim_peers:reason()}
    | {control, unicode:chardata()}
    | {robot, starl:robot_id(), unicode:chardata()}.

%% `control': the process of the socket for commands; `parts': the modules of a robot's machines.
-type started() :: #{
    nodes := starl_cluster_nodes:t(),
    calls := starl_cluster_calls:t(_),
    control := pid(),
    world := pid(),
    speed := number(),
    faults := starl_cluster_faults:t(),
    parts := #{starl_machine:name() => module()}
}.

%% The longest time to load the code.
-define(READY_MS, 60000).

%% @doc Starts all but the robots. The calling process holds the nodes, and is asked what other terminals want:
%% `{control, Words}'.
-spec start(starl_run_plan:t(), [starl_run_fault:t()], starl_cluster:options()) ->
    {ok, started()} | {error, reason()}.
start(#{robots := Poses} = Plan, Schedule, Options) ->
    Code = maps:get(code, Options, []),
    case starl_cluster_nodes:start([Id || {Id, _} <- Poses], Code) of
        {ok, Nodes} -> readied(Nodes, Code, {Plan, Schedule}, Options);
        {error, Reason} -> {error, {peers, Reason}}
    end.

readied(Nodes, Code, Plan, Options) ->
    Up = starl_cluster_nodes:up(Nodes),
    {Answers, Calls} = ready(Up, Code),
    case [{Id, Why} || {Id, _} <- Up, {error, Why} <- [starl_cluster_calls:result(Id, Answers)]] of
        [] ->
            controlled(Nodes, Calls, Plan, Options);
        [{Id, Why} | _] ->
            Known = starl_cluster_nodes:known_end(Id, Why, Nodes),
            not_started({robot, Id, Known}, Nodes, Calls)
    end.

ready(Up, Code) ->
    Self = self(),
    Joined = lists:foldl(
        fun({Id, _}, Calls) -> starl_cluster_calls:joined(Id, Calls) end,
        starl_cluster_calls:new(),
        Up
    ),
    Ready = fun(Id, Node) -> fun() -> starl_cluster_node:ready(Node, Id, Code, Self) end end,
    Wanted = [{Id, Ready(Id, Node)} || {Id, Node} <- Up],
    Asked = starl_cluster_calls:ask(ready, Wanted, ?READY_MS, Joined),
    {[{ready, Answers}], Calls} = starl_cluster_calls:await(Asked),
    {Answers, Calls}.

not_started(Reason, Nodes, Calls) ->
    ok = starl_cluster_calls:stop(Calls),
    ok = starl_cluster_nodes:stop(Nodes),
    {error, Reason}.

controlled(Nodes, Calls, Plan, Options) ->
    Self = self(),
    Handler = fun(Words) -> gen_server:call(Self, {control, Words}, infinity) end,
    case starl_cluster_control:start_link(Handler) of
        {ok, Control} ->
            Peopled = peopled(Plan, Nodes, Options),
            {ok, Peopled#{calls => Calls, control => Control}};
        {error, Why} ->
            not_started({control, Why}, Nodes, Calls)
    end.

%% The world, what its robots start with, and what will happen to them.
peopled({#{tree := Tree} = Plan, Schedule}, Nodes, #{transport := Transport} = Options) ->
    Ids = starl_cluster_nodes:ids(Nodes),
    Lines = {Transport, starl_cluster_nodes:names(Nodes)},
    #{world := World, clock := Clock} = Stage = starl_world_stage:open(Plan, Lines, Options),
    Specs = [{Id, starl_world_stage:robot_on_node(Id, self(), Stage)} || Id <- Ids],
    Speed = maps:get(speed, Options, 1),
    Faults = starl_cluster_faults:new(Ids, #{world => World, clock => Clock, speed => Speed}),
    Chaos = maps:get(chaos, Options, []),
    #{
        world => World,
        speed => Speed,
        nodes => starl_cluster_nodes:specified(Specs, Nodes),
        faults => starl_cluster_faults:planned(Schedule, Chaos, Nodes, Faults),
        parts => starl_robot_services:parts(Tree)
    }.
