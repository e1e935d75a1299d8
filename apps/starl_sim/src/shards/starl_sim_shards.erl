%% @doc The shards of a run: starts them, sends them commands and queries them. When a node is lost,
%% its shards and their data on robots are lost, too; the other shards still answer.
-module(starl_sim_shards).

-export([start/1, count/1, team/1, is_one/2, missing/2]).
-export([run/3, approve/2, reload/2, halt/1, ask/3, summaries/2, lose/2, give_up/1]).

-export_type([t/0]).

-record(shards, {
    pids :: [pid()],
    owners :: #{starl:robot_id() => pid()},
    %% the longest time to wait for an answer
    patience_ms = infinity :: timeout()
}).

-opaque t() :: #shards{}.

%% The time that a shard which waited for a lost node has to answer about its robots.
-define(LAST_WORDS_MS, 5000).

%% @doc Starts the shards of a plan on its sites, monitored by the calling process, and the robots
%% on them. Exits as a failed call does if a node is lost meanwhile.
-spec start(starl_sim_plan:t()) -> t().
start(#{robots := Robots} = Plan) ->
    Pids = start_all(Plan),
    Owners = owners(Pids, Robots),
    Load = fun(Shard) -> load(Shard, Pids, Owners, Plan) end,
    _ = [ok = starl_sim_shard:launch(Shard, Load(Shard)) || Shard <- Pids],
    #shards{pids = Pids, owners = Owners}.

start_all(#{shards := N, sites := Sites, robots := Robots} = Plan) ->
    Common = maps:with([world, window_us, patience_ms], Plan),
    Config = Common#{run => self(), robots => length(Robots) div N + 1},
    [start_one(Site, Config) || Site <- in_turn(Sites, N)].

start_one(#{shard_sup := Sup, robots_sup := Robots}, Config) ->
    {ok, Shard} = supervisor:start_child(Sup, [Config#{robots_sup => Robots}]),
    _ = erlang:monitor(process, Shard),
    Shard.

%% @doc The number of shards, without the lost ones.
-spec count(t()) -> non_neg_integer().
count(#shards{pids = Pids}) -> length(Pids).

%% @doc The number of robots, those of lost shards included.
-spec team(t()) -> pos_integer().
team(#shards{owners = Owners}) -> map_size(Owners).

%% @doc Is this process one of them?
-spec is_one(pid(), t()) -> boolean().
is_one(Pid, #shards{pids = Pids}) -> lists:member(Pid, Pids).

%% @doc The shards that have not reported the next window yet.
-spec missing(starl_sim_judge:t(), t()) -> [pid()].
missing(Judge, #shards{pids = Pids}) -> starl_sim_judge:missing(Pids, Judge).

%% @doc Lets all shards run ({@link starl_sim_shard:run/3}).
-spec run(Until :: starl_sim_queue:time(), starl_sim_lockstep:stop(), t()) -> ok.
run(Until, Stop, #shards{pids = Pids}) ->
    lists:foreach(fun(Shard) -> ok = starl_sim_shard:run(Shard, Until, Stop) end, Pids).

%% @doc Tells all that the first N windows are judged.
-spec approve(N :: pos_integer(), t()) -> ok.
approve(N, #shards{pids = Pids}) ->
    lists:foreach(fun(Shard) -> ok = starl_sim_shard:approve(Shard, N) end, Pids).

%% @doc The robots get new code.
-spec reload(starl_run_reloads:t(), t()) -> ok.
reload(Reload, #shards{pids = Pids}) ->
    lists:foreach(fun(Shard) -> ok = starl_sim_shard:reload(Shard, Reload) end, Pids).

%% @doc Lets all shards rest as far ahead as they may go.
-spec halt(t()) -> ok.
halt(#shards{pids = Pids}) -> lists:foreach(fun starl_sim_shard:halt/1, Pids).

%% @doc Asks the shard of a robot about it.
-spec ask(robot | timers | count | events, starl:robot_id(), t()) -> starl_sim_shard:answer().
ask(What, Id, #shards{owners = Owners} = Shards) ->
    case Owners of
        #{Id := Shard} -> asked(Shard, {What, Id}, unknown, Shards);
        #{} -> unknown
    end.

%% @doc The summaries of all robots at a time, ascending.
-spec summaries(starl_sim_queue:time(), t()) -> [{starl:robot_id(), starl_sim_summary:t()}].
summaries(Now, #shards{pids = Pids} = Shards) ->
    Told = [asked(Shard, {summary, Now}, [], Shards) || Shard <- Pids],
    lists:keysort(1, lists:append(Told)).

%% @doc A node is lost: its shards answer no more; each of the others has some time for its answer.
-spec lose(node(), t()) -> t().
lose(Node, #shards{pids = Pids} = Shards) ->
    Left = [Shard || Shard <- Pids, node(Shard) =/= Node],
    Shards#shards{pids = Left, patience_ms = ?LAST_WORDS_MS}.

%% @doc A robot does not end its step: the shards rest, and each has some time for its answer.
-spec give_up(t()) -> t().
give_up(#shards{pids = Pids} = Shards) ->
    ok = lists:foreach(fun starl_sim_shard:abandon/1, Pids),
    Shards#shards{patience_ms = ?LAST_WORDS_MS}.

asked(Shard, Question, Without, #shards{pids = Pids, patience_ms = Ms}) ->
    try lists:member(Shard, Pids) andalso starl_sim_shard:inspect(Shard, Question, Ms) of
        false -> Without;
        Answer -> Answer
    catch
        exit:{_, {gen_server, call, _}} when node(Shard) =/= node() -> Without;
        exit:{timeout, {gen_server, call, _}} -> Without
    end.

%% -- robots and shards ---------------------------------------------------------------------

%% Shards go to the sites in turn, robots to the shards. The assignment does not change a run's result.

%% The first `N' items of a list that repeats without end.
-spec in_turn([Item, ...], N :: non_neg_integer()) -> [Item].
in_turn(Items, N) ->
    Turns = lists:append(lists:duplicate(N div length(Items) + 1, Items)),
    lists:sublist(Turns, N).

%% The shard of each robot.
-spec owners([pid(), ...], [{starl:robot_id(), starl:pose()}]) -> #{starl:robot_id() => pid()}.
owners(Shards, Robots) ->
    Ids = [Id || {Id, _} <- Robots],
    maps:from_list(lists:zip(Ids, in_turn(Shards, length(Ids)))).

%% The initial load of one shard.
-spec load(pid(), [pid()], #{starl:robot_id() => pid()}, starl_sim_plan:t()) ->
    starl_sim_shard:load().
load(Shard, Shards, Owners, #{robots := Robots, crew := Crew, faults := Faults}) ->
    #{
        robots => [R || {Id, _} = R <- Robots, maps:get(Id, Owners) =:= Shard],
        crew => Crew,
        faults => [F || F <- Faults, maps:get(element(1, F), Owners) =:= Shard],
        peers => lists:delete(Shard, Shards),
        owners => Owners,
        sight => [{Id, standing(Pose)} || {Id, Pose} <- Robots],
        running => length(Robots)
    }.

standing({X, Y, Heading}) -> starl_trajectory:standing(0, {X, Y}, Heading).
