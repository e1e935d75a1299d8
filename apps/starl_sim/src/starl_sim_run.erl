%% @doc One simulation: it owns the virtual time, has the shards run window after window, and
%% holds the run against its monitors.
%%
%% A window is as long as the shortest message delay, so no packet sent in it arrives in it, and
%% the shards need not wait for each other inside a window (conservative lookahead). Windows
%% without any event are skipped.
%% ```
%%   idle --- run(Until) ---> running --- Until, all done, violation or stop ---> idle
%% '''
-module(starl_sim_run).
-behaviour(gen_server).

-export([start_link/1, run/2, stop/1, status/1, inspect/2, finish/1]).
-export([init/1, handle_call/3, handle_cast/2, handle_info/2]).

-export_type([plan/0, status/0, outcome/0, ending/0]).

%% What is to be simulated: see {@link starl_sim:start/1}.
-type plan() :: #{
    robots := [starl_sim_shard:robot_spec()],
    world := starl_sim_platform:world(),
    window_us := pos_integer(),
    shards := pos_integer(),
    faults := [starl_sim_queue:event()],
    monitors := [{module(), map()}],
    robots_sup := pid(),
    shard_sup := pid()
}.

%% Why a run ended: all applications finished, its time was up, a contract was violated, it was
%% stopped from outside, or nothing can happen any more.
-type ending() :: done | time | violation | stopped | quiet.

-type status() :: #{
    now_us := starl_sim_queue:time(),
    running := non_neg_integer(),
    ending := ending() | none
}.

%% Everything known at the end.
-type outcome() :: #{
    ending := ending() | none,
    end_us := starl_sim_queue:time(),
    violations := [starl_monitor:violation()],
    monitors := #{module() => map()},
    robots := [{starl:robot_id(), starl_sim_robot:summary()}],
    digest := binary(),
    events := non_neg_integer(),
    packets := non_neg_integer()
}.

-record(run, {
    window_us :: pos_integer(),
    shards :: [pid()],
    owner :: #{starl:robot_id() => pid()},
    monitors :: starl_monitor:t(),
    violations = [] :: [starl_monitor:violation()],
    %% the last window's, not judged yet
    trace = [] :: [starl_monitor:trace_event()],
    %% packets to be handed to their shard with the next window
    mail = #{} :: #{pid() => [starl_sim_queue:event()]},
    now = 0 :: starl_sim_queue:time(),
    next = 0 :: starl_sim_queue:time() | infinity,
    until = 0 :: starl_sim_queue:time(),
    caller = none :: gen_server:from() | none,
    outcomes = [] :: [{pid(), starl_sim_shard:outcome()}],
    running :: non_neg_integer(),
    ending = none :: ending() | none,
    stop = false :: boolean()
}).

%% @doc Starts the simulation at virtual time 0.
-spec start_link(plan()) -> gen_server:start_ret().
start_link(Plan) -> gen_server:start_link(?MODULE, Plan, [{timeout, infinity}]).

%% @doc Runs until a virtual time, or an earlier end.
-spec run(pid(), Until :: starl_sim_queue:time()) -> status().
run(Run, Until) -> gen_server:call(Run, {run, Until}, infinity).

%% @doc Ends the run after the present window.
-spec stop(pid()) -> ok.
stop(Run) -> gen_server:cast(Run, stop).

%% @doc How far it is; answers also while it runs.
-spec status(pid()) -> status().
status(Run) -> gen_server:call(Run, status, infinity).

%% @doc The machines of one robot.
-spec inspect(pid(), starl:robot_id()) -> #{starl_machine:name() => term()} | unknown.
inspect(Run, Robot) -> gen_server:call(Run, {inspect, Robot}, infinity).

%% @doc Closes the monitors and tells everything known; the run can go on no further.
-spec finish(pid()) -> outcome().
finish(Run) -> gen_server:call(Run, finish, infinity).

-spec init(plan()) -> {ok, #run{}}.
init(#{window_us := WindowUs, robots := Robots, monitors := Monitors} = Plan) ->
    Shards = start_shards(Plan),
    Loads = deal(Shards, Plan),
    _ = [ok = starl_sim_shard:launch(Shard, Load) || {Shard, Load} <- Loads],
    {ok, #run{
        window_us = WindowUs,
        shards = Shards,
        owner = maps:from_list([
            {Id, Shard}
         || {Shard, {Specs, _}} <- Loads, #{tree := #{id := Id}} <- Specs
        ]),
        monitors = starl_monitor:new(Monitors),
        running = length(Robots)
    }}.

-spec handle_call(term(), gen_server:from(), #run{}) ->
    {reply, term(), #run{}} | {noreply, #run{}}.
handle_call({run, Until}, From, #run{caller = none, ending = none} = Run) ->
    %% whole windows only, so that where a run pauses does not change it
    Whole = (Until + Run#run.window_us - 1) div Run#run.window_us * Run#run.window_us,
    {noreply, proceed(Run#run{until = Whole, caller = From})};
handle_call({run, _Until}, _From, Run) ->
    {reply, status_of(Run), Run};
handle_call(status, _From, Run) ->
    {reply, status_of(Run), Run};
handle_call({inspect, Id}, _From, #run{owner = Owner} = Run) ->
    case Owner of
        #{Id := Shard} -> {reply, starl_sim_shard:inspect(Shard, {robot, Id}), Run};
        #{} -> {reply, unknown, Run}
    end;
handle_call(finish, _From, Run) ->
    {reply, conclude(Run), Run}.

-spec handle_cast(stop, #run{}) -> {noreply, #run{}}.
handle_cast(stop, #run{caller = none} = Run) -> {noreply, Run#run{ending = stopped}};
handle_cast(stop, Run) -> {noreply, Run#run{stop = true}}.

-spec handle_info(term(), #run{}) -> {noreply, #run{}} | {stop, term(), #run{}}.
handle_info({'DOWN', _, process, Shard, Reason}, #run{shards = Shards} = Run) ->
    case lists:member(Shard, Shards) of
        true -> {stop, {shard_failed, Reason}, Run};
        false -> {noreply, Run}
    end;
handle_info({window_done, Shard, Outcome}, #run{outcomes = Outcomes, shards = Shards} = Run) ->
    Got = [{Shard, Outcome} | Outcomes],
    case length(Got) =:= length(Shards) of
        true -> {noreply, proceed(close_window(Got, Run#run{outcomes = []}))};
        false -> {noreply, Run#run{outcomes = Got}}
    end.

%% -- windows --------------------------------------------------------------------------------

%% Starts the next window, or answers the caller. The monitors judge a window while the shards
%% run the next one, so a violation ends the run one window after it was committed.
proceed(#run{next = Next, until = Until, window_us = Width} = Run) ->
    case ending(Run) of
        none when Next < Until ->
            From = Next - Next rem Width,
            To = From + Width,
            judge(start_window(From, To, Run#run{now = To}));
        none ->
            conclude_turn(judge(Run#run{now = Until}));
        _ ->
            conclude_turn(judge(Run))
    end.

conclude_turn(Run) -> rest(Run#run{ending = ending(Run)}).

judge(#run{trace = Trace, monitors = Monitors, violations = Violations} = Run) ->
    case starl_monitor:step(Trace, Monitors) of
        {ok, Next} ->
            Run#run{monitors = Next, trace = []};
        {violation, Violation, Next} ->
            Run#run{monitors = Next, trace = [], violations = Violations ++ [Violation]}
    end.

ending(#run{violations = [_ | _]}) -> violation;
ending(#run{stop = true}) -> stopped;
ending(#run{running = 0}) -> done;
ending(#run{next = infinity}) -> quiet;
ending(#run{}) -> none.

rest(#run{caller = From} = Run) ->
    gen_server:reply(From, status_of(Run)),
    Run#run{caller = none}.

start_window(From, To, #run{shards = Shards, mail = Mail} = Run) ->
    _ = [starl_sim_shard:window(S, From, To, maps:get(S, Mail, [])) || S <- Shards],
    Run#run{mail = #{}}.

close_window(Outcomes, Run) ->
    Trace = merge([T || {_, #{trace := T}} <- Outcomes]),
    Packets = lists:append([P || {_, #{packets := P}} <- Outcomes]),
    Times = [T || {_, #{next := T}} <- Outcomes] ++ [element(2, P) || P <- Packets],
    Run#run{
        trace = Trace,
        mail = maps:groups_from_list(
            fun(P) -> maps:get(element(1, P), Run#run.owner) end, Packets
        ),
        %% integers sort before the atom infinity
        next = lists:min(Times),
        running = lists:sum([N || {_, #{running := N}} <- Outcomes])
    }.

%% The shards' traces in the order of time, then robot.
merge([Trace]) -> Trace;
merge(Traces) -> lists:foldl(fun(A, B) -> lists:merge(fun earlier/2, A, B) end, [], Traces).

earlier({T1, R1, _, _}, {T2, R2, _, _}) -> {T1, R1} =< {T2, R2}.

%% -- start and end --------------------------------------------------------------------------

start_shards(#{shards := N, shard_sup := Sup} = Plan) ->
    Config = (maps:with([world, window_us, robots_sup], Plan))#{run => self()},
    [
        begin
            {ok, Shard} = supervisor:start_child(Sup, [Config]),
            _ = erlang:monitor(process, Shard),
            Shard
        end
     || _ <- lists:seq(1, N)
    ].

%% Robots and faults go to the shards in turn.
deal(Shards, #{robots := Robots, faults := Faults}) ->
    N = length(Shards),
    [
        {Shard, {
            [R || {I, R} <- numbered(Robots), I rem N =:= K],
            [F || F <- Faults, (owner_index(element(1, F), Robots)) rem N =:= K]
        }}
     || {K, Shard} <- numbered(Shards)
    ].

numbered(List) -> lists:zip(lists:seq(0, length(List) - 1), List).

owner_index(Id, Robots) ->
    length(lists:takewhile(fun(#{tree := #{id := I}}) -> I =/= Id end, Robots)).

status_of(#run{now = Now, running = Running, ending = Ending}) ->
    #{now_us => Now, running => Running, ending => Ending}.

conclude(#run{monitors = Monitors, violations = Violations, now = Now, shards = Shards} = Run) ->
    {Late, Results} = starl_monitor:finish(Now, Monitors),
    Robots = lists:keysort(
        1, lists:append([starl_sim_shard:inspect(S, {summary, Now}) || S <- Shards])
    ),
    Chains = [{Id, Chain} || {Id, #{chain := Chain}} <- Robots],
    #{
        ending => Run#run.ending,
        end_us => Now,
        violations => Violations ++ Late,
        monitors => Results,
        robots => Robots,
        digest => binary:part(crypto:hash(sha256, chain_bytes(Chains)), 0, 16),
        events => lists:sum([N || {_, #{events := N}} <- Robots]),
        packets => lists:sum([N || {_, #{packets := N}} <- Robots])
    }.

chain_bytes(Chains) -> [<<Id:32, Chain:32>> || {Id, Chain} <- Chains].
