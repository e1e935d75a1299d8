%% @doc Feeds the windows of a run to its monitors. Each shard reports a window in
%% its own time; the window is judged when all shards have reported it and all earlier ones are
%% judged.
-module(starl_sim_judge).

-export([new/1, new/2, told/5, judged/1, seen/1, is_sound/1, missing/2, close/2]).

-export_type([t/0]).

-record(judge, {
    monitors :: starl_monitor:t(),
    observer = none :: starl_observer:t(),
    violations = [] :: [starl_monitor:violation()],
    %% traces of windows that some shard has not reported yet; the number of windows judged
    traces = #{} :: #{pos_integer() => [{Shard :: pid(), [starl_monitor:trace_event()]}]},
    judged = 0 :: non_neg_integer(),
    %% the time of the last event judged
    seen = 0 :: starl_sim_queue:time()
}).

-opaque t() :: #judge{}.

%% @doc Nothing is judged yet by these monitors.
-spec new([{module(), map()}]) -> t().
new(Monitors) -> new(Monitors, none).

%% @doc The same with an observer, which gets what is judged.
-spec new([{module(), map()}], starl_observer:t()) -> t().
new(Monitors, Observer) ->
    #judge{monitors = starl_monitor:guarded(Monitors), observer = Observer}.

%% @doc One of `Shards' shards reports its N-th window, ordered by time, then robot. Tells
%% whether a contract is violated in the windows that can be judged now.
-spec told(Shard :: pid(), N :: pos_integer(), [starl_monitor:trace_event()], Shards, t()) ->
    {ok | violation, t()}
when
    Shards :: pos_integer().
told(Shard, N, Trace, Shards, #judge{traces = Traces, violations = Before} = Judge) ->
    Told = maps:get(N, Traces, []),
    Next = judge(Shards, Judge#judge{traces = Traces#{N => [{Shard, Trace} | Told]}}),
    case Next#judge.violations of
        Before -> {ok, Next};
        _ -> {violation, Next}
    end.

judge(Shards, #judge{traces = Traces, judged = Judged} = Judge) ->
    N = Judged + 1,
    case Traces of
        #{N := Told} when length(Told) =:= Shards ->
            Trace = merge([T || {_, T} <- Told]),
            Taken = Judge#judge{traces = maps:remove(N, Traces), judged = N},
            judge(Shards, watch(Trace, Taken));
        #{} ->
            Judge
    end.

%% The shards' traces merged by time, then robot. A robot belongs to one shard, so two events
%% of one robot and time are never compared.
merge([Trace]) -> Trace;
merge(Traces) -> lists:merge(Traces).

watch([], Judge) ->
    Judge;
watch(Trace, #judge{observer = none} = Judge) ->
    {_, Next} = watched(Trace, Judge),
    Next;
watch(Trace, #judge{observer = Observer} = Judge) ->
    {Violations, Next} = watched([E || E <- Trace, starl_observer:is_judged(E)], Judge),
    ok = starl_observer:tell({judged, Trace, Violations}, Observer),
    Next.

watched(Trace, #judge{monitors = Monitors, violations = Violations} = Judge) ->
    Seen = Judge#judge{seen = last(Trace, Judge)},
    case starl_monitor:step(Trace, Monitors) of
        {ok, Next} ->
            {[], Seen#judge{monitors = Next}};
        {violation, Violation, Next} ->
            {[Violation], Seen#judge{monitors = Next, violations = Violations ++ [Violation]}}
    end.

last([], #judge{seen = Seen}) -> Seen;
last([_ | _] = Trace, _Judge) -> element(1, lists:last(Trace)).

%% @doc The number of windows judged.
-spec judged(t()) -> non_neg_integer().
judged(#judge{judged = Judged}) -> Judged.

%% @doc The time of the last event judged.
-spec seen(t()) -> starl_sim_queue:time().
seen(#judge{seen = Seen}) -> Seen.

%% @doc Checks that no contract has been violated so far.
-spec is_sound(t()) -> boolean().
is_sound(#judge{violations = Violations}) -> Violations =:= [].

%% @doc Those of the shards that have not reported the next window yet.
-spec missing([pid()], t()) -> [pid()].
missing(Shards, #judge{judged = Judged, traces = Traces}) ->
    Shards -- [Shard || {Shard, _} <- maps:get(Judged + 1, Traces, [])].

%% @doc Closes the monitors at a time: all violations, each monitor's results, and what monitors with
%% mistakes have not judged.
-spec close(starl_sim_queue:time(), t()) ->
    {[starl_monitor:violation()], #{module() => map()}, [starl_unjudged:t()]}.
close(Now, #judge{monitors = Monitors, violations = Violations}) ->
    {Late, Results, Unjudged} = starl_monitor:close(Now, Monitors),
    {Violations ++ Late, Results, Unjudged}.
