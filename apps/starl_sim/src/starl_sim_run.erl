%% @doc One simulation: it starts the shards, has them run until a virtual time, and holds what
%% they tell of each window against the monitors. The shards run on meanwhile
%% ({@link starl_sim_shard}); a violation ends the run a fixed number of windows later.
%% ```
%%   resting --- run(Until) ---> running --- Until, all done, violation or stop ---> resting
%% '''
%% A run that pauses between a violation and the end that follows from it goes on to that end: the
%% digest does not depend on pauses.
-module(starl_sim_run).
-behaviour(gen_server).

-export([start_link/1, run/2, run_to/2, stop/1, status/1, inspect/2, robots/1, events/2, finish/1]).
-export([init/1, handle_call/3, handle_cast/2, handle_info/2]).

-export_type([plan/0, status/0, outcome/0, ending/0, missed/0, progress/0]).

%% What is to be simulated: see {@link starl_sim:start/1}.
-type plan() :: #{
    robots := [{starl:robot_id(), starl:pose()}],
    crew := starl_sim_shard:crew(),
    world := starl_sim_platform:world(),
    window_us := pos_integer(),
    shards := pos_integer(),
    faults := [starl_sim_queue:event()],
    limit_us := starl_sim_queue:time(),
    monitors := [{module(), map()}],
    sites := [starl_sim_site:t(), ...]
}.

%% Why a run ended: all applications finished, its time was up, a contract was violated, it was
%% stopped from outside, nothing can happen any more, or a node is lost.
-type ending() :: done | time | violation | stopped | quiet | lost.

%% How far a run is: windows judged, shards that rest, and the shards that it waits for.
-type progress() :: {Judged :: non_neg_integer(), Resting :: non_neg_integer(), Late :: [pid()]}.

-type status() :: #{
    now_us := starl_sim_queue:time(),
    running := non_neg_integer(),
    ending := ending() | none
}.

%% Why a run cannot stop at an event: there is no such robot, it has had more events already, or
%% the run ended before, or it lost a node.
-type missed() ::
    {no_robot, starl:robot_id()}
    | {past, starl:robot_id(), Events :: non_neg_integer()}
    | {ended, starl:robot_id(), Events :: non_neg_integer()}
    | {lost, starl_sim_nodes:loss()}.

%% Everything known at the end. Where nodes were lost, their robots are missing in it, and the
%% digest is empty.
-type outcome() :: #{
    ending := ending() | none,
    end_us := starl_sim_queue:time(),
    violations := [starl_monitor:violation()],
    monitors := #{module() => map()},
    robots := [{starl:robot_id(), starl_sim_robot:summary()}],
    digest := binary(),
    events := non_neg_integer(),
    packets := non_neg_integer(),
    lost := [starl_sim_nodes:loss()]
}.

-record(run, {
    limit_us :: starl_sim_queue:time(),
    window_us :: pos_integer(),
    shards :: [pid()],
    owners :: #{starl:robot_id() => pid()},
    monitors :: starl_monitor:t(),
    violations = [] :: [starl_monitor:violation()],
    %% traces of windows that not all shards have told of yet; how many windows were judged, and
    %% how many of them the shards know to be
    traces = #{} :: #{pos_integer() => [{Shard :: pid(), [starl_monitor:trace_event()]}]},
    judged = 0 :: non_neg_integer(),
    approved = 0 :: non_neg_integer(),
    now = 0 :: starl_sim_queue:time(),
    caller = none :: gen_server:from() | none,
    %% the event to stop at
    goal = none :: starl_sim_shard:stop(),
    resting = 0 :: non_neg_integer(),
    running :: non_neg_integer(),
    ending = none :: ending() | none,
    stop = false :: boolean(),
    %% the time of the last event judged; the nodes that were lost
    seen = 0 :: starl_sim_queue:time(),
    lost = [] :: [starl_sim_nodes:loss()]
}).

%% The shards are told after so many judged windows.
-define(APPROVE_EVERY, 4).
%% What a shard that waited for a lost node may take to tell of its robots.
-define(LAST_WORDS_MS, 5000).
%% Traces come and go fast.
-define(HEAP_WORDS, 100000).

%% @doc Starts the simulation at virtual time 0.
-spec start_link(plan()) -> gen_server:start_ret().
start_link(Plan) ->
    Heap = {spawn_opt, [{min_heap_size, ?HEAP_WORDS}]},
    gen_server:start_link(?MODULE, Plan, [{timeout, infinity}, Heap]).

%% @doc Runs until a virtual time, or an earlier end.
-spec run(pid(), Until :: starl_sim_queue:time()) -> status().
run(Run, Until) -> gen_server:call(Run, {run, Until}, infinity).

%% @doc Runs until just after the N-th event of a robot: it does no more, the others finish the
%% window. An end that comes before that is an error.
-spec run_to(pid(), {starl:robot_id(), N :: pos_integer()}) ->
    {ok, status()} | {error, missed() | running}.
run_to(Run, Event) -> gen_server:call(Run, {run_to, Event}, infinity).

%% @doc Ends the run, a fixed number of windows ahead of what is judged.
-spec stop(pid()) -> ok.
stop(Run) -> gen_server:cast(Run, stop).

%% @doc How far it is; answers also while it runs.
-spec status(pid()) -> status().
status(Run) -> gen_server:call(Run, status, infinity).

%% @doc The machines of one robot, while the run rests.
-spec inspect(pid(), starl:robot_id()) ->
    #{starl_machine:name() => starl_sim_machines:seen()} | unknown | {error, running}.
inspect(Run, Robot) -> gen_server:call(Run, {inspect, Robot}, infinity).

%% @doc What is known of all robots, while the run rests.
-spec robots(pid()) -> [{starl:robot_id(), starl_sim_robot:summary()}] | {error, running}.
robots(Run) -> gen_server:call(Run, robots, infinity).

%% @doc The events of a robot that were recorded so far, while the run rests.
-spec events(pid(), starl:robot_id()) ->
    [starl_sim_ledger:event()] | unknown | {error, running}.
events(Run, Robot) -> gen_server:call(Run, {events, Robot}, infinity).

%% @doc Closes the monitors and tells everything known; the run can go on no further.
-spec finish(pid()) -> outcome().
finish(Run) -> gen_server:call(Run, finish, infinity).

-spec init(plan()) -> {ok, #run{}} | {stop, {shutdown, {lost, node()}}}.
init(Plan) ->
    try
        {ok, set_out(Plan)}
    catch
        exit:{_, {_, call, [To | _]}} when node(To) =/= node() ->
            {stop, {shutdown, {lost, node(To)}}}
    end.

set_out(#{window_us := WindowUs, robots := Robots, monitors := Monitors} = Plan) ->
    #{limit_us := LimitUs} = Plan,
    Shards = start_shards(Plan),
    Owners = starl_sim_deal:owners(Shards, Robots),
    Load = fun(Shard) -> starl_sim_deal:load(Shard, Shards, Owners, Plan) end,
    _ = [ok = starl_sim_shard:launch(Shard, Load(Shard)) || Shard <- Shards],
    #run{
        limit_us = LimitUs,
        window_us = WindowUs,
        shards = Shards,
        owners = Owners,
        monitors = starl_monitor:new(Monitors),
        running = length(Robots)
    }.

-spec handle_call(term(), gen_server:from(), #run{}) ->
    {reply, term(), #run{}} | {noreply, #run{}}.
handle_call({run, Until}, From, #run{caller = none, ending = none} = Run) ->
    {noreply, go(Until, none, From, Run)};
handle_call({run, _Until}, _From, Run) ->
    {reply, status_of(Run), Run};
handle_call(status, _From, Run) ->
    {reply, status_of(Run), Run};
handle_call(_Question, _From, #run{caller = Caller} = Run) when Caller =/= none ->
    {reply, {error, running}, Run};
handle_call({run_to, _Goal}, _From, #run{lost = [Loss | _]} = Run) ->
    {reply, {error, {lost, Loss}}, Run};
handle_call({run_to, {Id, N} = Goal}, From, #run{limit_us = Limit, ending = Ending} = Run) ->
    case ask(count, Id, Run) of
        unknown -> {reply, {error, {no_robot, Id}}, Run};
        N -> {reply, {ok, status_of(Run)}, Run};
        Count when Count > N -> {reply, {error, {past, Id, Count}}, Run};
        _ when Ending =:= none -> {noreply, go(Limit, Goal, From, Run)};
        Count -> {reply, {error, {ended, Id, Count}}, Run}
    end;
handle_call({inspect, Id}, _From, Run) ->
    {reply, ask(robot, Id, Run), Run};
handle_call({events, Id}, _From, Run) ->
    {reply, ask(events, Id, Run), Run};
handle_call(robots, _From, Run) ->
    {reply, summaries(Run), Run};
handle_call(finish, _From, Run) ->
    {reply, conclude(Run), Run}.

-spec handle_cast(stop, #run{}) -> {noreply, #run{}}.
handle_cast(stop, #run{caller = none, ending = none} = Run) ->
    {noreply, Run#run{ending = stopped}};
handle_cast(stop, #run{caller = none} = Run) ->
    {noreply, Run};
handle_cast(stop, Run) ->
    {noreply, halt_shards(Run#run{stop = true})}.

-spec handle_info(term(), #run{}) -> {noreply, #run{}} | {stop, term(), #run{}}.
handle_info({progress, From}, Run) ->
    From ! {progress, progress(Run)},
    {noreply, Run};
handle_info({lost, Loss}, Run) ->
    {noreply, lose(Loss, Run)};
handle_info(_LastWords, #run{lost = [_ | _]} = Run) ->
    {noreply, Run};
handle_info({window_done, Shard, N, Trace}, #run{traces = Traces} = Run) ->
    Told = maps:get(N, Traces, []),
    {noreply, approve(judge(Run#run{traces = Traces#{N => [{Shard, Trace} | Told]}}))};
handle_info({resting, _Shard, Now, Reason, Running}, #run{resting = Resting} = Run) ->
    %% where a window is not over, only some of the shards know whose application has ended in it
    Most = max(Running, Run#run.running),
    Next = Run#run{resting = Resting + 1, now = Now, running = Most},
    case Resting + 1 =:= length(Run#run.shards) of
        true -> {noreply, rest(Reason, Next)};
        false -> {noreply, Next}
    end;
handle_info({'DOWN', _, process, Shard, Reason}, Run) when
    node(Shard) =/= node(), Reason =:= noconnection orelse Reason =:= killed;
    node(Shard) =/= node(), Reason =:= shutdown
->
    %% its node goes down or its site ends: who watches them tells why
    {noreply, Run};
handle_info({'DOWN', _, process, Shard, Reason}, #run{shards = Shards} = Run) ->
    case lists:member(Shard, Shards) of
        true -> {stop, {shard_failed, Reason}, Run};
        false -> {noreply, Run}
    end.

%% Whole windows only, so that where a run pauses does not change it.
go(Until, Goal, From, #run{window_us = Width, limit_us = Limit, shards = Shards} = Run) ->
    Whole = (min(Until, Limit) + Width - 1) div Width * Width,
    _ = [ok = starl_sim_shard:run(Shard, Whole, Goal) || Shard <- Shards],
    Run#run{caller = From, goal = Goal, resting = 0, running = 0}.

ask(What, Id, #run{owners = Owners} = Run) ->
    case Owners of
        #{Id := Shard} -> asked(Shard, {What, Id}, unknown, Run);
        #{} -> unknown
    end.

%% -- judging --------------------------------------------------------------------------------

%% Windows are judged in their order, when all shards have told of them.
judge(#run{traces = Traces, judged = Judged, shards = Shards} = Run) ->
    N = Judged + 1,
    case Traces of
        #{N := Told} when length(Told) =:= length(Shards) ->
            Rest = maps:remove(N, Traces),
            Trace = merge([T || {_, T} <- Told]),
            judge(judge(Trace, Run#run{traces = Rest, judged = N, seen = last(Trace, Run)}));
        #{} ->
            Run
    end.

last([], #run{seen = Seen}) -> Seen;
last([_ | _] = Trace, _Run) -> element(1, lists:last(Trace)).

judge(Trace, #run{monitors = Monitors, violations = Violations} = Run) ->
    case starl_monitor:step(Trace, Monitors) of
        {ok, Next} ->
            Run#run{monitors = Next};
        {violation, Violation, Next} ->
            halt_shards(Run#run{monitors = Next, violations = Violations ++ [Violation]})
    end.

%% After a violation no further window is approved.
approve(#run{judged = Judged, approved = Approved, violations = [], stop = false} = Run) when
    Judged - Approved >= ?APPROVE_EVERY
->
    _ = [ok = starl_sim_shard:approve(Shard, Judged) || Shard <- Run#run.shards],
    Run#run{approved = Judged};
approve(Run) ->
    Run.

halt_shards(#run{shards = Shards} = Run) ->
    _ = [ok = starl_sim_shard:halt(Shard) || Shard <- Shards],
    Run.

%% The shards' traces in the order of time, then robot. A robot belongs to one shard, so events
%% of one robot and time are never compared.
merge([Trace]) -> Trace;
merge(Traces) -> lists:merge(Traces).

rest(Reason, #run{caller = From, goal = Goal} = Run) ->
    Rested = Run#run{caller = none, goal = none, ending = ending(Reason, Run)},
    gen_server:reply(From, reply(Goal, Reason, Rested)),
    Rested.

ending(until, #run{now = Now, limit_us = Limit} = Run) when Now >= Limit -> judged(time, Run);
ending(Pause, #run{stop = Stop}) when Pause =:= until; Pause =:= held ->
    case Stop of
        true -> stopped;
        false -> none
    end;
ending(Reason, Run) ->
    judged(Reason, Run).

judged(_Reason, #run{violations = [_ | _]}) -> violation;
judged(_Reason, #run{stop = true}) -> stopped;
judged(Reason, #run{}) -> Reason.

reply(none, _Reason, Run) -> status_of(Run);
reply(_Goal, lost, #run{lost = [Loss | _]}) -> {error, {lost, Loss}};
reply(_Goal, held, Run) -> {ok, status_of(Run)};
reply({Id, _N}, _Reason, Run) -> {error, {ended, Id, ask(count, Id, Run)}}.

%% -- lost nodes -----------------------------------------------------------------------------

%% Whoever has not told of the next window is waited for; when all rest, nobody is.
progress(#run{caller = none, judged = Judged, resting = Resting}) ->
    {Judged, Resting, []};
progress(#run{judged = Judged, resting = Resting, traces = Traces, shards = Shards}) ->
    Told = [Shard || {Shard, _} <- maps:get(Judged + 1, Traces, [])],
    {Judged, Resting, Shards -- Told}.

%% The windows that all shards have told of stand; the others come to no end any more.
lose(#{node := Node} = Loss, #run{shards = Shards, caller = Caller, seen = Seen} = Run) ->
    Ended = Run#run{
        shards = [Shard || Shard <- Shards, node(Shard) =/= Node],
        now = Seen,
        caller = none,
        goal = none,
        ending = lost,
        lost = Run#run.lost ++ [Loss#{at_us := Seen}]
    },
    _ = Caller =/= none andalso gen_server:reply(Caller, reply(Run#run.goal, lost, Ended)),
    Ended.

%% A shard whose node is lost has no answer; of the others each has some time for it.
asked(Shard, Question, Without, #run{lost = Lost, shards = Shards}) ->
    Ms =
        case Lost of
            [] -> infinity;
            [_ | _] -> ?LAST_WORDS_MS
        end,
    try lists:member(Shard, Shards) andalso starl_sim_shard:inspect(Shard, Question, Ms) of
        false -> Without;
        Answer -> Answer
    catch
        exit:{_, {gen_server, call, _}} when node(Shard) =/= node() -> Without
    end.

%% -- start and end --------------------------------------------------------------------------

start_shards(#{shards := N, sites := Sites} = Plan) ->
    Robots = length(maps:get(robots, Plan)) div N + 1,
    Common = maps:with([world, window_us], Plan),
    Config = Common#{run => self(), robots => Robots},
    [start_shard(Site, Config) || Site <- starl_sim_deal:in_turn(Sites, N)].

start_shard(#{shard_sup := Sup, robots_sup := Robots}, Config) ->
    {ok, Shard} = supervisor:start_child(Sup, [Config#{robots_sup => Robots}]),
    _ = erlang:monitor(process, Shard),
    Shard.

status_of(#run{now = Now, running = Running, ending = Ending}) ->
    #{now_us => Now, running => Running, ending => Ending}.

conclude(Run) ->
    Robots = summaries(Run),
    case length(Robots) =:= map_size(Run#run.owners) orelse Run#run.lost of
        [] -> conclude(await_loss(Run));
        _ -> conclude(Robots, Run)
    end.

%% A node was lost this very moment: who watches it is about to tell.
await_loss(Run) ->
    receive
        {lost, Loss} -> lose(Loss, Run)
    after ?LAST_WORDS_MS -> exit({shard_failed, no_answer})
    end.

conclude(Robots, #run{monitors = Monitors, violations = Violations, now = Now} = Run) ->
    {Late, Results} = starl_monitor:finish(Now, Monitors),
    #{
        ending => Run#run.ending,
        end_us => Now,
        violations => Violations ++ Late,
        monitors => Results,
        robots => Robots,
        digest => digest(Robots, Run),
        events => lists:sum([N || {_, #{events := N}} <- Robots]),
        packets => lists:sum([N || {_, #{packets := N}} <- Robots]),
        lost => Run#run.lost
    }.

summaries(#run{now = Now, shards = Shards} = Run) ->
    Told = [asked(Shard, {summary, Now}, [], Run) || Shard <- Shards],
    lists:keysort(1, lists:append(Told)).

%% Only the digest of all robots can be compared with that of another run.
digest(Robots, #run{owners = Owners}) when length(Robots) < map_size(Owners) ->
    <<>>;
digest(Robots, _Run) ->
    Bytes = [<<Id:32, Chain:32>> || {Id, #{chain := Chain}} <- Robots],
    binary:part(crypto:hash(sha256, Bytes), 0, 16).
