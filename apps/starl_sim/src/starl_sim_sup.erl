%% @doc The processes of one simulation. Nothing is registered, so any number of simulations
%% live in one VM.
%% ```
%%   starl_sim_sup (one_for_all, no restarts: a broken simulator is an error, not a fault)
%%     robots: simple_one_for_one of starl_robot_sup (temporary)
%%     shards: simple_one_for_one of starl_sim_shard (temporary)
%%     run:    starl_sim_run
%% '''
-module(starl_sim_sup).
-behaviour(supervisor).

-export([start_link/1, run/1]).
-export([init/1]).

%% @doc Starts a simulation; `Plan' is the run's without the two supervisors.
-spec start_link(map()) -> {ok, pid()} | {error, term()}.
start_link(Plan) ->
    {ok, Sup} = supervisor:start_link(?MODULE, top),
    {ok, Robots} = supervisor:start_child(Sup, pool(robots, starl_robot_sup, infinity, supervisor)),
    {ok, Shards} = supervisor:start_child(Sup, pool(shards, starl_sim_shard, 5000, worker)),
    Full = Plan#{robots_sup => Robots, shard_sup => Shards},
    Run = #{id => run, start => {starl_sim_run, start_link, [Full]}, restart => temporary},
    case supervisor:start_child(Sup, Run) of
        {ok, _} -> {ok, Sup};
        {error, _} = Error -> Error
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

pool(Id, Module, Shutdown, Type) ->
    #{
        id => Id,
        type => supervisor,
        start => {supervisor, start_link, [?MODULE, {pool, Module, Shutdown, Type}]}
    }.
