%% @doc The part of a simulation on one node: a supervisor of robots and one of shards. On a node
%% other than the run's, a process holds them; it ends with them when the run's side has
%% ended or is out of reach, so nothing is left over there.
%% ```
%%   starl_sim_nodes                       site
%%      | ping, K -------------------------->|   does it answer, and in time?
%%      |<------------------------ pong, K --|
%%      | abandon, Node -------------------->|   another node is lost: its waiters stop waiting
%%      | close (or gone) ------------------>|   ends with all its shards and robots
%% '''
-module(starl_sim_site).
-behaviour(gen_server).

-export([open/3, local/2, ping/2, abandon/2, close/1]).
-export([serve/1]).
-export([init/1, handle_call/3, handle_cast/2, handle_info/2, terminate/2]).

-export_type([t/0]).

%% `server' is the process that holds both supervisors.
-type t() :: #{
    node := node(), server := pid() | none, robots_sup := pid(), shard_sup := pid()
}.

-record(site, {
    owner :: pid(),
    robots_sup :: pid(),
    shard_sup :: pid()
}).

-define(STOP_MS, 10000).

%% @doc Opens a site on a node, for as long as its owner lives and can be reached. Fails as
%% `erpc:call/5' does.
-spec open(node(), Owner :: pid(), Ms :: timeout()) -> t().
open(Node, Owner, Ms) -> erpc:call(Node, ?MODULE, serve, [Owner], Ms).

%% @doc The site of two supervisors that belong to another process.
-spec local(RobotsSup :: pid(), ShardSup :: pid()) -> t().
local(Robots, Shards) ->
    #{node => node(), server => none, robots_sup => Robots, shard_sup => Shards}.

%% @doc Sends a ping; the site answers with `{pong, Site, K}'. Never blocks, even on a full buffer.
-spec ping(t(), K :: integer()) -> ok.
ping(#{server := Server}, K) ->
    _ = erlang:send(Server, {ping, self(), K}, [nosuspend, noconnect]),
    ok.

%% @doc Tells the site that another node is lost to the run.
-spec abandon(t(), node()) -> ok.
abandon(#{server := Server}, Node) ->
    _ = erlang:send(Server, {abandon, Node}, [nosuspend, noconnect]),
    ok.

%% @doc Ends the site; it is gone when its process is.
-spec close(t()) -> ok.
close(#{server := Server}) ->
    _ = erlang:send(Server, close, [nosuspend, noconnect]),
    ok.

%% @private Called on the site's node.
-spec serve(Owner :: pid()) -> t().
serve(Owner) ->
    {ok, Server} = gen_server:start(?MODULE, Owner, []),
    gen_server:call(Server, site).

-spec init(pid()) -> {ok, #site{}}.
init(Owner) ->
    _ = process_flag(trap_exit, true),
    _ = erlang:monitor(process, Owner),
    {ok, Robots} = starl_sim_pool:start_link(robots),
    {ok, Shards} = starl_sim_pool:start_link(shards),
    {ok, #site{owner = Owner, robots_sup = Robots, shard_sup = Shards}}.

-spec handle_call(site, gen_server:from(), #site{}) -> {reply, t(), #site{}}.
handle_call(site, _From, #site{robots_sup = Robots, shard_sup = Shards} = Site) ->
    {reply, (local(Robots, Shards))#{server => self()}, Site}.

-spec handle_cast(term(), #site{}) -> {noreply, #site{}}.
handle_cast(_, Site) -> {noreply, Site}.

-spec handle_info(term(), #site{}) -> {noreply, #site{}} | {stop, term(), #site{}}.
handle_info({ping, From, K}, Site) ->
    _ = erlang:send(From, {pong, self(), K}, [nosuspend, noconnect]),
    {noreply, Site};
handle_info({abandon, Node}, #site{shard_sup = Shards} = Site) ->
    %% processes that are held up in sending to that node go on
    _ = Node =/= node() andalso erlang:disconnect_node(Node),
    _ = [ok = starl_sim_shard:abandon(Pid) || {_, Pid, _, _} <- supervisor:which_children(Shards)],
    {noreply, Site};
handle_info(close, Site) ->
    {stop, normal, Site};
handle_info({'DOWN', _, process, Owner, _}, #site{owner = Owner} = Site) ->
    {stop, normal, Site};
handle_info({'EXIT', _Pool, Reason}, Site) ->
    {stop, {shutdown, Reason}, Site}.

%% The shards end first: they would take the end of their robots for crashes.
-spec terminate(term(), #site{}) -> ok.
terminate(_Reason, #site{robots_sup = Robots, shard_sup = Shards}) ->
    lists:foreach(fun(Pool) -> starl_sim_stop:shutdown(Pool, ?STOP_MS) end, [Shards, Robots]).
