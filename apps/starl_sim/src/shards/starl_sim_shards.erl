%% @doc The shards of a run, as it starts, tells and asks them. Where a node is lost, so are its
%% shards and what they know of their robots; the others go on answering.
-module(starl_sim_shards).

-export([start/1, count/1, team/1, is_one/2, missing/2]).
-export([run/3, approve/2, halt/1, ask/3, summaries/2, lose/2]).

-export_type([t/0]).

-record(shards, {
    pids :: [pid()],
    owners :: #{starl:robot_id() => pid()},
    %% how long one may take for an answer
    patience_ms = infinity :: timeout()
}).

-opaque t() :: #shards{}.

%% What a shard that waited for a lost node may take to tell of its robots.
-define(LAST_WORDS_MS, 5000).

%% @doc Starts the shards of a plan on its sites, monitored by the calling process, and the robots
%% on them. Exits as a call does where a node is lost meanwhile.
-spec start(starl_sim_plan:t()) -> t().
start(#{robots := Robots} = Plan) ->
    Pids = start_all(Plan),
    Owners = starl_sim_deal:owners(Pids, Robots),
    Load = fun(Shard) -> starl_sim_deal:load(Shard, Pids, Owners, Plan) end,
    _ = [ok = starl_sim_shard:launch(Shard, Load(Shard)) || Shard <- Pids],
    #shards{pids = Pids, owners = Owners}.

start_all(#{shards := N, sites := Sites, robots := Robots} = Plan) ->
    Common = maps:with([world, window_us], Plan),
    Config = Common#{run => self(), robots => length(Robots) div N + 1},
    [start_one(Site, Config) || Site <- starl_sim_deal:in_turn(Sites, N)].

start_one(#{shard_sup := Sup, robots_sup := Robots}, Config) ->
    {ok, Shard} = supervisor:start_child(Sup, [Config#{robots_sup => Robots}]),
    _ = erlang:monitor(process, Shard),
    Shard.

%% @doc How many there are, the lost ones apart.
-spec count(t()) -> non_neg_integer().
count(#shards{pids = Pids}) -> length(Pids).

%% @doc How many robots they have, or had.
-spec team(t()) -> pos_integer().
team(#shards{owners = Owners}) -> map_size(Owners).

%% @doc Is this process one of them?
-spec is_one(pid(), t()) -> boolean().
is_one(Pid, #shards{pids = Pids}) -> lists:member(Pid, Pids).

%% @doc Those that have not told of the next window yet.
-spec missing(starl_sim_judge:t(), t()) -> [pid()].
missing(Judge, #shards{pids = Pids}) -> starl_sim_judge:missing(Pids, Judge).

%% @doc Has all run ({@link starl_sim_shard:run/3}).
-spec run(Until :: starl_sim_queue:time(), starl_sim_lockstep:stop(), t()) -> ok.
run(Until, Stop, #shards{pids = Pids}) ->
    lists:foreach(fun(Shard) -> ok = starl_sim_shard:run(Shard, Until, Stop) end, Pids).

%% @doc Tells all that the first N windows are judged.
-spec approve(N :: pos_integer(), t()) -> ok.
approve(N, #shards{pids = Pids}) ->
    lists:foreach(fun(Shard) -> ok = starl_sim_shard:approve(Shard, N) end, Pids).

%% @doc Has all rest as far ahead as they may go.
-spec halt(t()) -> ok.
halt(#shards{pids = Pids}) -> lists:foreach(fun starl_sim_shard:halt/1, Pids).

%% @doc What its shard knows of one robot.
-spec ask(robot | count | events, starl:robot_id(), t()) -> starl_sim_shard:answer().
ask(What, Id, #shards{owners = Owners} = Shards) ->
    case Owners of
        #{Id := Shard} -> asked(Shard, {What, Id}, unknown, Shards);
        #{} -> unknown
    end.

%% @doc What is known of all robots at a time, ascending.
-spec summaries(starl_sim_queue:time(), t()) -> [{starl:robot_id(), starl_sim_robot:summary()}].
summaries(Now, #shards{pids = Pids} = Shards) ->
    Told = [asked(Shard, {summary, Now}, [], Shards) || Shard <- Pids],
    lists:keysort(1, lists:append(Told)).

%% @doc A node is lost: its shards have no answer any more; of the others each has some time for it.
-spec lose(node(), t()) -> t().
lose(Node, #shards{pids = Pids} = Shards) ->
    Left = [Shard || Shard <- Pids, node(Shard) =/= Node],
    Shards#shards{pids = Left, patience_ms = ?LAST_WORDS_MS}.

asked(Shard, Question, Without, #shards{pids = Pids, patience_ms = Ms}) ->
    try lists:member(Shard, Pids) andalso starl_sim_shard:inspect(Shard, Question, Ms) of
        false -> Without;
        Answer -> Answer
    catch
        exit:{_, {gen_server, call, _}} when node(Shard) =/= node() -> Without
    end.
