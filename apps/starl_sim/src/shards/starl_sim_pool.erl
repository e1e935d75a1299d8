%% @doc The supervisors of a simulation's robots and of its shards, on any node.
-module(starl_sim_pool).
-behaviour(supervisor).

-export([start_link/1, child/1]).
-export([init/1]).

-export_type([which/0]).

-type which() :: robots | shards.

%% @doc Starts an empty supervisor, linked to the calling process.
-spec start_link(which()) -> supervisor:startlink_ret().
start_link(Which) -> supervisor:start_link(?MODULE, Which).

%% @doc The child specification of such a supervisor.
-spec child(which()) -> supervisor:child_spec().
child(Which) -> #{id => Which, type => supervisor, start => {?MODULE, start_link, [Which]}}.

-spec init(which()) -> {ok, {supervisor:sup_flags(), [supervisor:child_spec()]}}.
init(robots) ->
    %% its reports are those of a robot that has ended
    logger:set_process_metadata(#{robot => all}),
    {ok, {#{strategy => simple_one_for_one}, [robot()]}};
init(shards) ->
    {ok, {#{strategy => simple_one_for_one}, [shard()]}}.

robot() ->
    (temporary(starl_robot_sup))#{shutdown => infinity, type => supervisor}.

shard() ->
    (temporary(starl_sim_shard))#{shutdown => 5000}.

temporary(Module) -> #{id => Module, start => {Module, start_link, []}, restart => temporary}.
