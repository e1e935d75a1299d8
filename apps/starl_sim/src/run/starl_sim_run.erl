%% @doc Runs one simulation: starts the shards, lets them run until a virtual time, and feeds the
%% traces of their windows to the monitors. The shards run on meanwhile ({@link starl_sim_shard}); a
%% violation ends the run a fixed number of windows later.
%% ```
%%   resting --- run(Until) ---> running --- Until, all done, violation or stop ---> resting
%% '''
%% A run that pauses after a violation still goes on to the end that follows from the violation: the
%% digest does not depend on pauses.
-module(starl_sim_run).
-behaviour(gen_server).

-export([
    start_link/1,
    run/2,
    run_to/2,
    stop/1,
    status/1,
    inspect/2,
    robots/1,
    events/2,
    timers/2,
    violations/1,
    finish/1,
    reload/3,
    reloads/1
]).
-export([init/1, handle_call/3, handle_cast/2, handle_info/2]).

-export_type([status/0, outcome/0, ending/0, missed/0, progress/0]).

-type ending() :: starl_run:ending().

-type outcome() :: starl_run:outcome().

%% The progress of a run: windows judged, shards that rest, and the shards that it waits for.
-type progress() :: {Judged :: non_neg_integer(), Resting :: non_neg_integer(), Late :: [pid()]}.

-type status() :: #{
    now_us := starl_sim_queue:time(),
    running := non_neg_integer(),
    ending := ending() | none
}.

%% Why a run cannot stop at an event: there is no such robot, the robot has had more events already,
%% the run ended before, it lost a node, or a robot did not end its step.
-type missed() ::
    {no_robot, starl:robot_id()}
    | {past, starl:robot_id(), Events :: non_neg_integer()}
    | {ended, starl:robot_id(), Events :: non_neg_integer()}
    | {lost, starl_sim_nodes:loss()}
    | {hung, starl_sim_window:hang()}.

-record(run, {
    limit_us :: starl_sim_queue:time(),
    window_us :: pos_integer(),
    shards :: starl_sim_shards:t(),
    judge :: starl_sim_judge:t(),
    observer :: starl_observer:t(),
    %% the number of windows that the shards know to be judged
    approved = 0 :: non_neg_integer(),
    now = 0 :: starl_sim_queue:time(),
    caller = none :: gen_server:from() | none,
    %% the event to stop at
    goal = none :: starl_sim_lockstep:stop(),
    resting = 0 :: non_neg_integer(),
    running :: non_neg_integer(),
    ending = none :: ending() | none,
    stop = false :: boolean(),
    reload :: starl_sim_reload:t(),
    lost = [] :: [starl_sim_nodes:loss()],
    hung = none :: starl_sim_window:hang() | none
}).

%% The shards are told after this many newly judged windows.
-define(APPROVE_EVERY, 4).
%% The time within which the loss of a node is known after its shards have gone.
-define(LAST_WORDS_MS, 5000).
%% Traces are short-lived: a large heap saves collections.
-define(HEAP_WORDS, 100000).

%% @doc Starts the simulation at virtual time 0.
-spec start_link(starl_sim_plan:t()) -> gen_server:start_ret().
start_link(Plan) ->
    Heap = {spawn_opt, [{min_heap_size, ?HEAP_WORDS}]},
    gen_server:start_link(?MODULE, Plan, [{timeout, infinity}, Heap]).

%% @doc Runs until a virtual time, or to an earlier end.
-spec run(pid(), Until :: starl_sim_queue:time()) -> status().
run(Run, Until) -> gen_server:call(Run, {run, Until}, infinity).

%% @doc Runs until just after the N-th event of a robot: that robot halts there, the others finish
%% the window. It is an error if the run ends before.
-spec run_to(pid(), {starl:robot_id(), N :: pos_integer()}) ->
    {ok, status()} | {error, missed() | running}.
run_to(Run, Event) -> gen_server:call(Run, {run_to, Event}, infinity).

%% @doc Ends the run, a fixed number of windows ahead of the judged ones.
-spec stop(pid()) -> ok.
stop(Run) -> gen_server:cast(Run, stop).

%% @doc The status of the run; answers while it runs, too.
-spec status(pid()) -> status().
status(Run) -> gen_server:call(Run, status, infinity).

%% @doc The machines of one robot, while the run rests.
-spec inspect(pid(), starl:robot_id()) ->
    #{starl_machine:name() => starl_robot_tree:seen()} | unknown | {error, running}.
inspect(Run, Robot) -> gen_server:call(Run, {ask, robot, Robot}, infinity).

%% @doc The summaries of all robots, while the run rests.
-spec robots(pid()) -> [{starl:robot_id(), starl_sim_summary:t()}] | {error, running}.
robots(Run) -> gen_server:call(Run, robots, infinity).

%% @doc The recorded events of a robot so far, while the run rests.
-spec events(pid(), starl:robot_id()) ->
    [starl_sim_ledger:event()] | unknown | {error, running}.
events(Run, Robot) -> gen_server:call(Run, {ask, events, Robot}, infinity).

%% @doc The timers of a robot that run, by machine and name, while the run rests.
-spec timers(pid(), starl:robot_id()) ->
    [starl_sim_timers:timer()] | unknown | {error, running}.
timers(Run, Robot) -> gen_server:call(Run, {ask, timers, Robot}, infinity).

%% @doc All violations, with those that would be found if the run ended here, while it rests.
-spec violations(pid()) -> [starl_monitor:violation()] | {error, running}.
violations(Run) -> gen_server:call(Run, violations, infinity).

%% @doc All robots get new code now; may be asked while it runs.
-spec reload(pid(), [starl_version:source()], TrialMs :: non_neg_integer()) ->
    ok | {error, starl_reload:reason() | {node(), unreachable}}.
reload(Run, Sources, TrialMs) -> gen_server:call(Run, {reload, Sources, TrialMs}, infinity).

%% @doc What has become of the reloads so far.
-spec reloads(pid()) -> [starl_reload_monitor:reload()].
reloads(Run) -> gen_server:call(Run, reloads, infinity).

%% @doc Closes the monitors and returns the outcome; the run cannot go on afterwards.
-spec finish(pid()) -> outcome().
finish(Run) -> gen_server:call(Run, finish, infinity).

-spec init(starl_sim_plan:t()) -> {ok, #run{}} | {stop, {shutdown, {lost, node()}}}.
init(Plan) ->
    try
        {ok, set_out(Plan)}
    catch
        exit:{_, {_, call, [To | _]}} when node(To) =/= node() ->
            {stop, {shutdown, {lost, node(To)}}}
    end.

set_out(#{window_us := WindowUs, robots := Robots, limit_us := LimitUs} = Plan) ->
    #{monitors := Monitors} = Plan,
    Observer = maps:get(observe, Plan, none),
    #run{
        limit_us = LimitUs,
        window_us = WindowUs,
        shards = starl_sim_shards:start(Plan),
        judge = starl_sim_judge:new(Monitors, Observer),
        observer = Observer,
        running = length(Robots),
        reload = starl_sim_reload:new(Plan)
    }.

-spec handle_call(term(), gen_server:from(), #run{}) ->
    {reply, term(), #run{}} | {noreply, #run{}}.
handle_call({run, Until}, From, #run{caller = none, ending = none} = Run) ->
    {noreply, go(Until, none, From, Run)};
handle_call(Asked, _From, Run) when Asked =:= status; element(1, Asked) =:= run ->
    {reply, status_of(Run), Run};
handle_call({reload, Sources, TrialMs}, _From, #run{reload = Reload, now = Now} = Run) ->
    case starl_sim_reload:order(Sources, TrialMs, Now, Reload) of
        {ok, Ordered, Next} ->
            ok = starl_sim_shards:reload(Ordered, Run#run.shards),
            {reply, ok, Run#run{reload = Next}};
        {error, _} = Error ->
            {reply, Error, Run}
    end;
handle_call(reloads, _From, #run{reload = Reload} = Run) ->
    {reply, starl_sim_reload:reloads(Reload), Run};
handle_call(_Question, _From, #run{caller = Caller} = Run) when Caller =/= none ->
    {reply, {error, running}, Run};
handle_call({run_to, Goal}, From, Run) ->
    run_to(Goal, From, Run);
handle_call(Question, _From, Run) ->
    {reply, answer(Question, Run), Run}.

run_to(_Goal, _From, #run{lost = [Loss | _]} = Run) ->
    {reply, {error, {lost, Loss}}, Run};
run_to(_Goal, _From, #run{hung = {_, _} = Hang} = Run) ->
    {reply, {error, {hung, Hang}}, Run};
run_to({Id, N} = Goal, From, #run{limit_us = Limit, ending = Ending} = Run) ->
    case ask(count, Id, Run) of
        unknown -> {reply, {error, {no_robot, Id}}, Run};
        N -> {reply, {ok, status_of(Run)}, Run};
        Count when Count > N -> {reply, {error, {past, Id, Count}}, Run};
        _ when Ending =:= none -> {noreply, go(Limit, Goal, From, Run)};
        Count -> {reply, {error, {ended, Id, Count}}, Run}
    end.

answer({ask, What, Id}, Run) ->
    ask(What, Id, Run);
answer(violations, #run{judge = Judge, now = Now}) ->
    {Violations, _Results, _Unjudged} = starl_sim_judge:close(Now, Judge),
    Violations;
answer(robots, Run) ->
    summaries(Run);
answer(finish, Run) ->
    conclude(Run).

-spec handle_cast(stop, #run{}) -> {noreply, #run{}}.
handle_cast(stop, #run{caller = none, ending = none} = Run) ->
    {noreply, Run#run{ending = stopped}};
handle_cast(stop, #run{caller = none} = Run) ->
    {noreply, Run};
handle_cast(stop, #run{shards = Shards} = Run) ->
    ok = starl_sim_shards:halt(Shards),
    {noreply, Run#run{stop = true}}.

-spec handle_info(term(), #run{}) -> {noreply, #run{}} | {stop, term(), #run{}}.
handle_info({progress, From}, Run) ->
    From ! {progress, progress(Run)},
    {noreply, Run};
handle_info({lost, Loss}, Run) ->
    {noreply, lose(Loss, Run)};
handle_info(_LastWords, #run{lost = [_ | _]} = Run) ->
    {noreply, Run};
handle_info(_LastWords, #run{hung = {_, _}} = Run) ->
    {noreply, Run};
handle_info({hung, Since, Hang}, Run) ->
    {noreply, give_up(Since, Hang, Run)};
handle_info({window_done, Shard, N, Trace}, Run) ->
    {noreply, window_done(Shard, N, Trace, Run)};
handle_info({resting, _Shard, Now, Reason, Running}, Run) ->
    {noreply, resting(Now, Reason, Running, Run)};
handle_info({'DOWN', _, process, Shard, Reason}, Run) when
    node(Shard) =/= node(), Reason =:= noconnection orelse Reason =:= killed;
    node(Shard) =/= node(), Reason =:= shutdown
->
    %% its node goes down or its site ends: the process that watches nodes reports why
    {noreply, Run};
handle_info({'DOWN', _, process, Shard, Reason}, #run{shards = Shards} = Run) ->
    ended(starl_sim_shards:is_one(Shard, Shards), Reason, Run).

ended(true, Reason, Run) -> {stop, {shard_failed, Reason}, Run};
ended(false, _Reason, Run) -> {noreply, Run}.

window_done(Shard, N, Trace, #run{judge = Judge, shards = Shards, reload = Reload} = Run) ->
    Noted = Run#run{reload = starl_sim_reload:note(Trace, Reload)},
    case starl_sim_judge:told(Shard, N, Trace, starl_sim_shards:count(Shards), Judge) of
        {ok, Next} ->
            approve(Noted#run{judge = Next});
        {violation, Next} ->
            ok = starl_sim_shards:halt(Shards),
            Noted#run{judge = Next}
    end.

%% In an unfinished window, only some shards know which applications have ended.
resting(Now, Reason, Running, #run{resting = Resting} = Run) ->
    Next = Run#run{resting = Resting + 1, now = Now, running = max(Running, Run#run.running)},
    case Resting + 1 =:= starl_sim_shards:count(Run#run.shards) of
        true -> rest(Reason, Next);
        false -> Next
    end.

%% Rounded up to whole windows, so that the place of a pause does not change the run.
go(Until, Goal, From, #run{window_us = Width, limit_us = Limit, shards = Shards} = Run) ->
    Whole = (min(Until, Limit) + Width - 1) div Width * Width,
    ok = starl_sim_shards:run(Whole, Goal, Shards),
    Run#run{caller = From, goal = Goal, resting = 0, running = 0}.

ask(What, Id, #run{shards = Shards}) -> starl_sim_shards:ask(What, Id, Shards).

%% -- judging --------------------------------------------------------------------------------

%% After a violation no further window is approved.
approve(#run{judge = Judge, approved = Approved, stop = Stop} = Run) ->
    Judged = starl_sim_judge:judged(Judge),
    Due = Judged - Approved >= ?APPROVE_EVERY,
    case Due andalso not Stop andalso starl_sim_judge:is_sound(Judge) of
        true ->
            ok = starl_sim_shards:approve(Judged, Run#run.shards),
            Run#run{approved = Judged};
        false ->
            Run
    end.

rest(Reason, #run{caller = From, goal = Goal} = Run) ->
    Rested = Run#run{caller = none, goal = none, ending = ending(Reason, Run)},
    gen_server:reply(From, reply(Goal, Reason, Rested)),
    Rested.

ending(until, #run{now = Now, limit_us = Limit} = Run) when Now >= Limit -> judged(time, Run);
ending(Pause, #run{stop = true}) when Pause =:= until; Pause =:= held ->
    stopped;
ending(Pause, #run{stop = false}) when Pause =:= until; Pause =:= held ->
    none;
ending(Reason, Run) ->
    judged(Reason, Run).

judged(Reason, #run{stop = Stop, judge = Judge}) ->
    case starl_sim_judge:is_sound(Judge) of
        false -> violation;
        true when Stop -> stopped;
        true -> Reason
    end.

reply(none, _Reason, Run) -> status_of(Run);
reply(_Goal, lost, #run{lost = [Loss | _]}) -> {error, {lost, Loss}};
reply(_Goal, _Reason, #run{hung = {_, _} = Hang}) -> {error, {hung, Hang}};
reply(_Goal, held, Run) -> {ok, status_of(Run)};
reply({Id, _N}, _Reason, Run) -> {error, {ended, Id, ask(count, Id, Run)}}.

%% -- lost nodes -----------------------------------------------------------------------------

%% The shards that have not reported the next window are awaited; when all rest, none is.
progress(#run{caller = none, judge = Judge, resting = Resting}) ->
    {starl_sim_judge:judged(Judge), Resting, []};
progress(#run{judge = Judge, resting = Resting, shards = Shards}) ->
    {starl_sim_judge:judged(Judge), Resting, starl_sim_shards:missing(Judge, Shards)}.

%% The windows that all shards have reported count; the others are never finished.
lose(#{node := Node} = Loss, #run{shards = Shards, caller = Caller, judge = Judge} = Run) ->
    Seen = starl_sim_judge:seen(Judge),
    Ended = Run#run{
        shards = starl_sim_shards:lose(Node, Shards),
        now = Seen,
        caller = none,
        goal = none,
        ending = lost,
        lost = Run#run.lost ++ [Loss#{at_us := Seen}]
    },
    _ = Caller =/= none andalso gen_server:reply(Caller, reply(Run#run.goal, lost, Ended)),
    Ended.

%% Likewise if a robot does not end its step: all windows before this one are known.
give_up(Since, Hang, #run{shards = Shards, caller = From, goal = Goal, judge = Judge} = Run) ->
    Ended = Run#run{
        shards = starl_sim_shards:give_up(Shards),
        now = max(Since, starl_sim_judge:seen(Judge)),
        caller = none,
        goal = none,
        ending = judged(hung, Run),
        hung = Hang
    },
    gen_server:reply(From, reply(Goal, hung, Ended)),
    Ended.

%% -- the end --------------------------------------------------------------------------------

status_of(#run{now = Now, running = Running, ending = Ending}) ->
    #{now_us => Now, running => Running, ending => Ending}.

conclude(Run) ->
    Robots = summaries(Run),
    case length(Robots) =:= starl_sim_shards:team(Run#run.shards) orelse Run of
        #run{lost = [], hung = none} -> conclude(await_loss(Run));
        _ -> conclude(Robots, Run)
    end.

%% A node was lost this very moment: the process that watches nodes is about to report it.
await_loss(Run) ->
    receive
        {lost, Loss} -> lose(Loss, Run)
    after ?LAST_WORDS_MS -> exit({shard_failed, no_answer})
    end.

conclude(Robots, #run{shards = Shards, judge = Judge, hung = Hung} = Run) ->
    End0 = #{
        ending => Run#run.ending,
        end_us => Run#run.now,
        limit_us => Run#run.limit_us,
        robots => Robots,
        team => starl_sim_shards:team(Shards),
        lost => Run#run.lost
    },
    End = maps:merge(End0, maps:from_list([{hung, Hung} || Hung =/= none])),
    Outcome = starl_sim_outcome:new(End, Judge),
    Told = maps:with([ending, end_us, judged_us, violations, unjudged, digest], Outcome),
    ok = starl_observer:tell({ended, Told}, Run#run.observer),
    Outcome.

summaries(#run{now = Now, shards = Shards}) -> starl_sim_shards:summaries(Now, Shards).
