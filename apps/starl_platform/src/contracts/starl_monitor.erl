%% @doc Contracts as monitors over trace events, and the runner that feeds them.
%% ```
%%   -module(counting_monitor).
%%   -behaviour(starl_monitor).
%%   -export([init/1, interests/0, step/2, finish/2]).
%%
%%   init(_Config) -> 0.
%%   interests() -> [counter].
%%
%%   step({T, Robot, counter, {counted, 10}}, Seen) ->
%%       Broken = #{contract => counting, what => ten, at_us => T, robots => [Robot], details => #{}},
%%       {violation, Broken, Seen};
%%   step(_Event, Seen) -> {ok, Seen + 1}.
%%   finish(_EndUs, Seen) -> {ok, #{seen => Seen}}.
%% '''
%%
%% A monitor is a pure callback module that reads the events of a run one by one and says when
%% its contract is broken. The same monitor judges simulation runs, property
%% tests, explored interleavings and recordings of real robots.
%%
%% Events reach a monitor in the order of their time (never decreasing); for a monitor, time passes
%% only with the events that it wants and at the finish. A violation does not end the
%% monitoring: a caller may stop at the first one or go on and collect them all.
%%
%% The runner dispatches by the name of the machine. First it checks every event against the
%% vocabulary of its machine ({@link starl_event}): an event that is not in it is the violation
%% `unknown_event', reported once for each machine and event name. So no monitor has to look for
%% unknown events, and none swallows them.
%%
%% A monitor is code, and may have mistakes. A runner made by {@link new/1} trusts its monitors, as
%% tests do: a mistake crashes the caller. One made by {@link guarded/1} judges a run: a monitor that
%% crashes or gives no answer is put aside, what it has found until then is kept, and
%% {@link close/2} says what it has not judged.
-module(starl_monitor).

-export([
    new/1,
    guarded/1,
    step/2,
    broken/2,
    blinded/2,
    unjudged/1,
    clauses_not_judged/1,
    finish/2,
    close/2
]).
-export([known/1, informed/2, healed_us/2, core_healed_us/2]).
-export([name/1]).
-export_type([t/0, trace_event/0, violation/0, state/0, results/0, known/0, ends/0, fault_class/0]).

%% A trace event: time (us), robot, machine, and what the machine did.
-type trace_event() ::
    {TimeUs :: integer(), Robot :: starl:robot_id(), Machine :: atom(), Event :: term()}.
%% A broken contract: what happened, when (us), and which robots take part.
-type violation() :: #{
    contract := atom(),
    what := atom(),
    at_us := integer(),
    robots := [starl:robot_id()],
    details := map()
}.
%% The state of a monitor, private to its module.
-type state() :: term().
%% Figures that a monitor measured, for the report.
-type results() :: #{atom() => term()}.
%% The facts of a run beside its events. Of real robots nothing is known.
-type known() :: #{
    %% the windows in which faults break assumptions
    broken := [starl_assumption:window()],
    %% those of all faults that may cost a team time
    faults := [starl_assumption:window()],
    %% those that may cost a robot's drive time (`fault') or lead it off its line (`position')
    bodies := [starl_assumption:window()],
    %% those that keep a robot from knowing its place
    places => [starl_assumption:window()],
    %% those in which robots get positions that are farther off than usual
    positions := [starl_assumption:window()],
    %% where known, the windows in which senses answer what is not so, and what stands in the way for a time ({@link
    %% starl_obstacles:of_fault/3})
    senses => [starl_assumption:window()],
    obstacles => [{FromUs :: integer(), ToUs :: integer(), Kind :: atom(), Params :: map()}],
    %% the part of the packets that is lost, with what mild faults of the radio take, which are no excuse
    loss := number(),
    %% the longest delay of a packet, with what these faults add
    delay_us := non_neg_integer(),
    %% the configuration of SAP
    sap := map(),
    %% when all faults are over, and those of each class, for {@link healed_us/2}
    healed_us := integer() | never,
    ends => ends(),
    %% the robots beside the core of the team, for which some faults never end, and these times for the core
    core := #{rest := [starl:robot_id()], healed_us := integer() | never, ends => ends()},
    %% how far a robot's clock may be off at the beginning, and how fast it may drift, without any fault
    clocks := #{offset_us := non_neg_integer(), drift_ppm := number()},
    %% the time by which every bound is longer on a computer that has other work, too
    slack_us := non_neg_integer()
}.

%% A class of faults, such as `network', `clock', `process', `store', `location', `actuation', `serial', `sense', `floor'.
-type fault_class() :: atom().
%% When the last fault of each class is over; a class without a fault is missing.
-type ends() :: #{fault_class() => integer() | never}.

-callback init(Config :: map()) -> state().
-callback step(trace_event(), state()) -> {ok, state()} | {violation, violation(), state()}.
-callback finish(EndTimeUs :: integer(), state()) ->
    {ok | {violation, [violation(), ...]}, results()}.
%% The machines whose events the monitor wants; without this callback, all.
-callback interests() -> [Machine :: atom()] | all.
%% The same, for a monitor whose configuration decides.
-callback interests(state()) -> [Machine :: atom()] | all.
%% The configuration with the facts of the run that the monitor needs: excuses and bounds.
%% Without this callback a monitor gets none.
-callback context(known(), Config :: map()) -> Config :: map().
%% An assumption was broken in this window of the run, of which no event has been judged yet: for
%% faults that are known only when they happen. It prolongs bounds as in {@link context/2}.
-callback broken(starl_assumption:window(), state()) -> state().
%% The machines whose contract the monitor stands for, with all events that these machines trace of
%% their own, the events that it does not judge included; without this callback, none.
-callback vocabulary() -> starl_event:vocabulary().
%% What its results count as `sometimes', a map of names and numbers, beside the events of its
%% vocabulary: situations, and excuses that it has used; each of these and of the events
%% (`{Machine, Tag}') that is `seldom'. A soak of many runs owes the others.
-callback sometimes() -> [{Name :: atom() | {atom(), atom()}, owed | seldom}].
%% The part of the state that decides on later violations while no time passes: two states that are
%% equal in it judge alike. For the exhaustive checker; figures and times are left out.
-callback timeless(state()) -> term().
-optional_callbacks([
    interests/0, interests/1, context/2, broken/2, vocabulary/0, sometimes/0, timeless/1
]).

-record(runner, {
    monitors :: [monitor()],
    known :: starl_event:known(),
    %% Violations not returned yet, latest first, and room for further ones.
    violations = [] :: [violation()],
    room :: non_neg_integer(),
    %% what monitors that were put aside have not judged, latest first; `trusted': none is put aside
    unjudged = trusted :: trusted | [starl_unjudged:t()],
    %% what monitors that judge no further had measured until then
    measured = #{} :: #{module() => results()},
    %% the time of the last event
    seen = 0 :: integer()
}).

%% The machines that a monitor wants are the keys of a map, which a guard tests without a call.
-type monitor() :: {module(), Interests :: #{Machine :: atom() => []} | all, state()}.

%% Monitors that run together over one trace.
-opaque t() :: #runner{}.

%% Violations kept by the runner; a broken contract tends to break again and again.
-define(KEPT, 1000).

%% @doc A runner over the given monitors, each module at most once. A mistake in one crashes the
%% caller.
-spec new([{module(), Config :: map()}]) -> t().
new(Monitors) ->
    Modules = once(Monitors),
    #runner{
        monitors = [started(M, M:init(Config)) || {M, Config} <- Monitors],
        known = known(Modules),
        room = ?KEPT
    }.

%% @doc The same for the run of a user: a monitor that makes a mistake is excluded.
-spec guarded([{module(), Config :: map()}]) -> t().
guarded(Monitors) ->
    _ = once(Monitors),
    Empty = #runner{monitors = [], known = known([]), room = ?KEPT, unjudged = []},
    Runner = lists:foldl(fun set_out/2, Empty, Monitors),
    Runner#runner{
        monitors = lists:reverse(Runner#runner.monitors),
        known = known([Module || {Module, _, _} <- Runner#runner.monitors])
    }.

set_out({Module, Config}, #runner{monitors = Monitors} = Runner) ->
    case starl_monitor_check:start(Module, Config) of
        {ok, Interests, State} ->
            Runner#runner{monitors = [{Module, wanted(Interests), State} | Monitors]};
        {error, Line} ->
            aside(Module, 0, Line, Runner)
    end.

once(Monitors) ->
    Modules = [Module || {Module, _Config} <- Monitors],
    length(lists:usort(Modules)) =:= length(Modules) orelse error(badarg, [Monitors]),
    Modules.

%% @doc The events that the trace may hold when these monitors judge it.
-spec known([module()]) -> starl_event:known().
known(Modules) ->
    starl_event:known([starl_callback:call(Module, vocabulary, [], #{}) || Module <- Modules]).

%% @doc The monitors, each with the facts of the run that it needs.
-spec informed([{module(), Config :: map()}], known()) -> [{module(), Config :: map()}].
informed(Monitors, Known) ->
    [
        {Module, starl_callback:call(Module, context, [Known, Config], Config)}
     || {Module, Config} <- Monitors
    ].

%% @doc The time at which all faults of these classes are over. A contract names the classes that
%% can hold up its progress. For instance, a slow wheel holds up no message.
-spec healed_us([fault_class()], known()) -> integer() | never.
healed_us(Classes, Known) -> latest(Classes, Known).

%% @doc The same for the core of the team.
-spec core_healed_us([fault_class()], known()) -> integer() | never.
core_healed_us(Classes, #{core := Core}) -> latest(Classes, Core).

%% An atom, `never', is greater than every number.
latest(Classes, #{ends := Ends}) -> lists:max([0 | maps:values(maps:with(Classes, Ends))]);
latest(_Classes, #{healed_us := Healed}) -> Healed.

%% @doc A monitor's name, as in reports: `mutex' of the module `starl_mutex_monitor'.
-spec name(module()) -> string().
name(Module) ->
    Name = string:replace(atom_to_list(Module), "_monitor", "", trailing),
    case lists:flatten(Name) of
        "starl_" ++ Short -> Short;
        Other -> Other
    end.

%% @doc Feeds one event or several. All monitors judge all of them, also after a violation; the
%% first violation of this call is returned.
-spec step(trace_event() | [trace_event()], t()) -> {ok, t()} | {violation, violation(), t()}.
step([], Runner) ->
    {ok, Runner};
step(Events, #runner{monitors = Monitors, known = Known0} = Runner) when is_list(Events) ->
    {Unknown, Known} = unknown(Events, 1, Known0, []),
    {Fed, Found, Next} = feed_each(Monitors, Events, [], Unknown, Runner#runner{known = Known}),
    Seen = element(1, lists:last(Events)),
    answer(in_order(Found), Next#runner{monitors = Fed, seen = Seen});
step(Event, Runner) ->
    step([Event], Runner).

feed_each([], _Events, Fed, Found, Runner) ->
    {lists:reverse(Fed), Found, Runner};
feed_each([Monitor | Monitors], Events, Fed, Found, #runner{unjudged = trusted} = Runner) ->
    {Next, More} = feed_all(Events, Monitor, Found),
    feed_each(Monitors, Events, [Next | Fed], More, Runner);
feed_each([{Module, _, _} = Monitor | Monitors], Events, Fed, Found, Runner) ->
    case fed(Events, Monitor, Found) of
        {{mistake, AtUs, Line}, More} ->
            feed_each(Monitors, Events, Fed, More, aside(Module, AtUs, Line, Runner));
        {Next, More} ->
            feed_each(Monitors, Events, [Next | Fed], More, Runner)
    end.

aside(Module, AtUs, Line, #runner{unjudged = Unjudged} = Runner) ->
    Runner#runner{unjudged = [starl_unjudged:mistake(name(Module), AtUs, Line) | Unjudged]}.

%% @doc Declares an assumption broken in this window. No event of the window has been judged yet.
-spec broken(starl_assumption:window(), t()) -> t().
broken(Window, #runner{monitors = Monitors} = Runner) ->
    Tell = fun(Monitor, Told) -> tell_broken(Window, Monitor, Told) end,
    Told = #runner{monitors = All} = lists:foldl(Tell, Runner#runner{monitors = []}, Monitors),
    Told#runner{monitors = lists:reverse(All)}.

tell_broken(Window, {Module, Interests, State} = Monitor, #runner{monitors = Told} = Runner) ->
    case
        starl_callback:exported(Module, broken, 2) andalso
            call(Module, broken, [Window, State], Runner)
    of
        false -> Runner#runner{monitors = [Monitor | Told]};
        {ok, Next} -> Runner#runner{monitors = [{Module, Interests, Next} | Told]};
        {error, Line} -> aside(Module, Runner#runner.seen, Line, Runner)
    end.

%% @doc What is not judged so far.
-spec unjudged(t()) -> [starl_unjudged:t()].
unjudged(#runner{unjudged = trusted}) -> [];
unjudged(#runner{unjudged = Unjudged}) -> lists:reverse(Unjudged).

%% @doc The clauses that the monitors of a run have not judged, a line each, from the monitors'
%% results.
-spec clauses_not_judged(#{module() => results()}) -> [unicode:chardata()].
clauses_not_judged(Results) ->
    [
        starl_unjudged:format_clause(name(Module), Clause)
     || {Module, #{unjudged := Clauses}} <- lists:sort(maps:to_list(Results)), Clause <- Clauses
    ].

%% @doc Declares that events are missing from now on. A monitor that judges more than single crashes
%% of machines stops judging, because it might report violations that did not happen. Its
%% measurements so far are kept, because reports need the figures.
-spec blinded(starl_unjudged:why(), t()) -> t().
blinded(Why, #runner{monitors = Monitors, seen = Seen, unjudged = Before} = Runner) when
    is_list(Before)
->
    IsBlind = fun({_, Interests, _}) -> Interests =/= #{supervisor => []} end,
    {Blind, Left} = lists:partition(IsBlind, Monitors),
    Parts = [starl_unjudged:since(Seen, [name(M) || {M, _, _} <- Blind], Why) || Blind =/= []],
    Measured = results([{Module, ended(Seen, Monitor, Runner)} || {Module, _, _} = Monitor <- Blind]),
    Runner#runner{
        monitors = Left,
        unjudged = Parts ++ Before,
        measured = maps:merge(Runner#runner.measured, Measured)
    }.

results(Ends) -> maps:from_list([{Module, Results} || {Module, {ok, {_, Results}}} <- Ends]).

call(Module, Callback, Args, #runner{unjudged = trusted}) -> {ok, apply(Module, Callback, Args)};
call(Module, Callback, Args, _Guarded) -> starl_monitor_check:call(Module, Callback, Args).

%% @doc Ends the run at `EndTimeUs'. Returns the violations that `step/2' has not returned, in
%% the order found, and what each monitor measured. The runner keeps at most 1000 violations. It is an
%% error if a monitor was put aside.
-spec finish(EndTimeUs :: integer(), t()) -> {[violation()], #{module() => results()}}.
finish(EndTimeUs, Runner) ->
    case close(EndTimeUs, Runner) of
        {Violations, Results, []} -> {Violations, Results};
        {_, _, [First | _]} -> error({unjudged, First})
    end.

%% @doc The same, but also returns what excluded monitors have not judged, earliest first. A monitor
%% that made a mistake has no results; a blinded monitor has its results up to then.
-spec close(EndTimeUs :: integer(), t()) ->
    {[violation()], #{module() => results()}, [starl_unjudged:t()]}.
close(EndTimeUs, #runner{monitors = Monitors, violations = Kept, room = Room} = Runner) ->
    Ends = [{Module, ended(EndTimeUs, Monitor, Runner)} || {Module, _, _} = Monitor <- Monitors],
    Late = lists:append([Found || {_Module, {ok, {{violation, Found}, _Results}}} <- Ends]),
    Mistakes = [{Module, Line} || {Module, {error, Line}} <- Ends],
    {
        lists:reverse(Kept, lists:sublist(Late, Room)),
        maps:merge(Runner#runner.measured, results(Ends)),
        unjudged(Mistakes, EndTimeUs, Runner)
    }.

%% A trusted monitor has to answer, too.
ended(EndTimeUs, {Module, _, State}, #runner{unjudged = Unjudged}) ->
    case starl_monitor_check:call(Module, finish, [EndTimeUs, State]) of
        {error, Line} when Unjudged =:= trusted -> error({mistake, Line});
        Answer -> Answer
    end.

unjudged([], _EndTimeUs, #runner{unjudged = trusted}) ->
    [];
unjudged(Mistakes, EndTimeUs, Runner) ->
    Aside = fun({Module, Line}, Next) -> aside(Module, EndTimeUs, Line, Next) end,
    #runner{unjudged = Unjudged} = lists:foldl(Aside, Runner, Mistakes),
    lists:reverse(Unjudged).

started(Module, State) -> {Module, wanted(interests_of(Module, State)), State}.

wanted(all) -> all;
wanted(Machines) -> maps:from_keys(Machines, []).

interests_of(Module, State) ->
    case starl_callback:exported(Module, interests, 1) of
        true -> Module:interests(State);
        false -> starl_callback:call(Module, interests, [], all)
    end.

%% The events that are in no vocabulary, and the vocabularies once these have been reported.
unknown([], _Place, Known, Found) ->
    {Found, Known};
unknown([{_, _, Machine, Event} = Traced | Events], Place, Known, Found) ->
    case starl_event:is_known(Machine, Event, Known) of
        true ->
            unknown(Events, Place + 1, Known, Found);
        false ->
            More = [{Place, starl_event:violation(Traced)} | Found],
            unknown(Events, Place + 1, starl_event:tell(Machine, Event, Known), More)
    end.

%% A monitor reads all its events in one loop, which keeps its state local.
feed_all(Events, {Module, Interests, State} = Monitor, Found0) ->
    case starts(Events, 1, Interests) of
        none ->
            {Monitor, Found0};
        {Wanted, Place} ->
            %% the function is looked up once
            {Next, Found} = feed(Wanted, Place, fun Module:step/2, Interests, State, Found0),
            {{Module, Interests, Next}, Found}
    end.

%% From the first event on that the monitor wants: most windows have none.
starts([], _Place, _Interests) ->
    none;
starts([{_, _, Machine, _} | _] = Events, Place, Interests) when
    is_map_key(Machine, Interests); Interests =:= all
->
    {Events, Place};
starts([_ | Events], Place, Interests) ->
    starts(Events, Place + 1, Interests).

feed([], _Place, _Step, _Interests, State, Found) ->
    {State, Found};
feed([{_, _, Machine, _} = Event | Events], Place, Step, Interests, State, Found) when
    is_map_key(Machine, Interests); Interests =:= all
->
    case Step(Event, State) of
        {ok, Next} ->
            feed(Events, Place + 1, Step, Interests, Next, Found);
        {violation, Violation, Next} ->
            feed(Events, Place + 1, Step, Interests, Next, [{Place, Violation} | Found])
    end;
feed([_ | Events], Place, Step, Interests, State, Found) ->
    feed(Events, Place + 1, Step, Interests, State, Found).

%% A monitor that may have mistakes. A batch in which it makes one is read again, up to the mistake:
%% what it finds before that is kept.
fed(Events, Monitor, Found) ->
    try feed_all(Events, Monitor, []) of
        {Next, []} ->
            {Next, Found};
        {Next, More} ->
            case lists:all(fun({_, V}) -> starl_monitor_check:is_violation(V) end, More) of
                true -> {Next, More ++ Found};
                false -> fed_until(Events, 1, Monitor, Found)
            end
    catch
        _:_ -> fed_until(Events, 1, Monitor, Found)
    end.

fed_until([Event | Events], Place, {Module, Interests, State} = Monitor, Found) ->
    {At, _, Machine, _} = Event,
    IsWanted = Interests =:= all orelse is_map_key(Machine, Interests),
    case IsWanted andalso starl_monitor_check:call(Module, step, [Event, State]) of
        false ->
            fed_until(Events, Place + 1, Monitor, Found);
        {ok, {ok, Next}} ->
            fed_until(Events, Place + 1, {Module, Interests, Next}, Found);
        {ok, {violation, Violation, Next}} ->
            More = [{Place, Violation} | Found],
            fed_until(Events, Place + 1, {Module, Interests, Next}, More);
        {error, Line} ->
            {{mistake, At, Line}, Found}
    end;
%% A mistake that does not come again is none of the monitor's state.
fed_until([], _Place, Monitor, Found) ->
    {Monitor, Found}.

%% Ordered by event; for one event the unknown event comes first, then the order of the monitors.
in_order(Found) -> [Violation || {_Place, Violation} <- lists:keysort(1, lists:reverse(Found))].

answer([], Runner) ->
    {ok, Runner};
answer([First | More], #runner{violations = Violations, room = Room} = Runner) when Room > 0 ->
    Kept = lists:sublist(More, Room - 1),
    {violation, First, Runner#runner{
        violations = lists:reverse(Kept, Violations), room = Room - 1 - length(Kept)
    }};
answer([First | _], Runner) ->
    {violation, First, Runner}.
