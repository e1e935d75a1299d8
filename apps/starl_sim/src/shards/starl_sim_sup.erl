%% @doc Supervises the processes of one simulation. Nothing is registered, so any number of
%% simulations live in one VM.
%% ```
%%   starl_sim_sup (one_for_all, no restarts: a broken simulator is an error, not a fault)
%%     robots: simple_one_for_one of starl_robot_sup (temporary)
%%     shards: simple_one_for_one of starl_sim_shard (temporary)
%%     run:    starl_sim_run
%% '''
%% In a run over several nodes, each node has its robots and shards ({@link starl_sim_site}), and
%% `nodes' ({@link starl_sim_nodes}) stands here in their place.
-module(starl_sim_sup).
-behaviour(supervisor).

-export([start_link/1, stop/1, run/1, sites/1]).
-export([init/1]).

%% @doc Starts a simulation from the plan of a run, which has no sites yet. With the key `nodes' it
%% runs over these nodes.
-spec start_link(starl_sim_plan:t()) -> {ok, pid()} | {error, starl_sim_nodes:reason()}.
start_link(Plan) ->
    {ok, Sup} = supervisor:start_link(?MODULE, top),
    case start_all(Sup, Plan) of
        ok ->
            {ok, Sup};
        {error, _} = Error ->
            ok = stop(Sup),
            Error
    end.

start_all(Sup, #{nodes := Options} = Plan) ->
    {ok, Nodes} = supervisor:start_child(Sup, child(nodes, starl_sim_nodes, [], permanent)),
    case starl_sim_nodes:open(Nodes, Options) of
        {ok, Sites} -> start_run(Sup, Nodes, Plan#{sites => Sites});
        {error, _} = Error -> Error
    end;
start_all(Sup, Plan) ->
    {ok, Robots} = supervisor:start_child(Sup, starl_sim_pool:child(robots)),
    {ok, Shards} = supervisor:start_child(Sup, starl_sim_pool:child(shards)),
    start_run(Sup, none, Plan#{sites => [starl_sim_site:local(Robots, Shards)]}).

start_run(Sup, Nodes, Plan) ->
    case supervisor:start_child(Sup, child(run, starl_sim_run, [Plan], temporary)) of
        {ok, Run} when is_pid(Nodes) ->
            starl_sim_nodes:watch(Nodes, Run);
        {ok, _} ->
            ok;
        {error, {{shutdown, {lost, Node}}, _}} ->
            {error, {lost, starl_sim_nodes:loss(Nodes, Node)}};
        {error, Reason} ->
            exit(Reason)
    end.

%% The end of the nodes has no time limit here; they limit it themselves.
child(Id, Module, Args, Restart) ->
    #{id => Id, start => {Module, start_link, Args}, restart => Restart, shutdown => 60000}.

%% @doc Ends a simulation of the calling process; all of it is gone afterwards.
-spec stop(pid()) -> ok.
stop(Sup) ->
    true = unlink(Sup),
    starl_sim_stop:shutdown(Sup, infinity).

%% @doc The sites of robots and shards.
-spec sites(pid()) -> [starl_sim_site:t()].
sites(Sup) ->
    Children = supervisor:which_children(Sup),
    case lists:keyfind(nodes, 1, Children) of
        {nodes, Nodes, _, _} when is_pid(Nodes) ->
            starl_sim_nodes:sites(Nodes);
        false ->
            {robots, Robots, _, _} = lists:keyfind(robots, 1, Children),
            {shards, Shards, _, _} = lists:keyfind(shards, 1, Children),
            [starl_sim_site:local(Robots, Shards)]
    end.

%% @doc The process of the run.
-spec run(pid()) -> pid().
run(Sup) ->
    {run, Pid, _, _} = lists:keyfind(run, 1, supervisor:which_children(Sup)),
    true = is_pid(Pid),
    Pid.

-spec init(top) -> {ok, {supervisor:sup_flags(), []}}.
init(top) -> {ok, {#{strategy => one_for_all, intensity => 0}, []}}.
