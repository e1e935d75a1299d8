%% @doc The processes of one simulation. Nothing is registered, so any number of simulations
%% live in one VM.
%% ```
%%   starl_sim_sup (one_for_all, no restarts: a broken simulator is an error, not a fault)
%%     robots: simple_one_for_one of starl_robot_sup (temporary)
%%     shards: simple_one_for_one of starl_sim_shard (temporary)
%%     run:    starl_sim_run
%% '''
%% Over several nodes, the robots and shards are on those ({@link starl_sim_site}), and
%% `nodes' ({@link starl_sim_nodes}) stands in their place.
-module(starl_sim_sup).
-behaviour(supervisor).

-export([start_link/1, start_pool/1, run/1, sites/1]).
-export([init/1]).

%% @doc Starts a simulation; `Plan' is the run's without the sites. With the key `nodes' it
%% goes over these.
-spec start_link(map()) -> {ok, pid()} | {error, starl_sim_nodes:reason()}.
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
    {ok, Robots} = supervisor:start_child(Sup, pool(robots)),
    {ok, Shards} = supervisor:start_child(Sup, pool(shards)),
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

stop(Sup) ->
    true = unlink(Sup),
    Ref = erlang:monitor(process, Sup),
    exit(Sup, shutdown),
    receive
        {'DOWN', Ref, process, Sup, _} -> ok
    end.

%% Ending the nodes takes as long as it takes; they bound it themselves.
child(Id, Module, Args, Restart) ->
    #{id => Id, start => {Module, start_link, Args}, restart => Restart, shutdown => 60000}.

%% @doc Starts a supervisor of robots or of shards alone, linked to the calling process.
-spec start_pool(robots | shards) -> supervisor:startlink_ret().
start_pool(Which) ->
    {_, _, Args} = maps:get(start, pool(Which)),
    apply(supervisor, start_link, Args).

%% @doc Where robots and shards are.
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

-spec init(top | {pool, module(), timeout(), worker | supervisor}) ->
    {ok, {supervisor:sup_flags(), [supervisor:child_spec()]}}.
init(top) ->
    {ok, {#{strategy => one_for_all, intensity => 0}, []}};
init({pool, Module, Shutdown, Type}) ->
    Child = #{
        id => Module,
        start => {Module, start_link, []},
        restart => temporary,
        shutdown => Shutdown,
        type => Type
    },
    {ok, {#{strategy => simple_one_for_one}, [Child]}}.

pool(robots) -> pool(robots, starl_robot_sup, infinity, supervisor);
pool(shards) -> pool(shards, starl_sim_shard, 5000, worker).

pool(Id, Module, Shutdown, Type) ->
    #{
        id => Id,
        type => supervisor,
        start => {supervisor, start_link, [?MODULE, {pool, Module, Shutdown, Type}]}
    }.
