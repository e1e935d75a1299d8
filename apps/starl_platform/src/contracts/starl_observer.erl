%% @doc The behaviour and messages of observers, such as a recording or a window onto the team. A
%% run reports to its observer: its facts at the beginning, all trace events in the order of the
%% monitors, violations, and its end.
%%
%% An observer is a function that the judge of the run calls, so it must only pass the news on. A
%% simulation waits for it, a live run does not. Mostly it passes them to a process ({@link feed/3}):
%% ```
%%   judge ----> observer ----{starl_news, Feed, News}----> process
%%      counts what waits  <-------done(News, Feed)--------'
%% '''
%%
%% A robot on a node of its own reports to an observer there what it knows itself. These are its
%% facts, its trace events, the packets that it sends and receives, its own poses as the positioning
%% system shows them, and its log. The observer of a robot comes with a process, a
%% <em>recorder</em>, which starts before the robot and outlives its restarts: a module with this
%% behaviour.
-module(starl_observer).

-export([tell/2, all/1, is_judged/1]).
-export([feed/3, done/2]).

-export_type([t/0, news/0, facts/0, ending/0, packet/0, fate/0, cause/0, packet_report/0]).
-export_type([recorder/0, feed/0, delivery/0]).

%% `none': nobody observes.
-type t() :: fun((news()) -> ok) | none.

%% `begun' comes first, `ended' last. `unjudged': from now on nothing is judged that builds on what was
%% before. `fault': one that is not of the schedule begins or ends, by hand.
%% Only a robot itself tells: `started', with the names of its machines; `seen', a pose of its own;
%% `logged', a line.
-type news() ::
    {begun, facts()}
    | {judged, [starl_monitor:trace_event()], [starl_monitor:violation()]}
    | {fault, AtUs :: integer(), {began | ended, Fault :: tuple()}}
    | {unjudged, AtUs :: integer(), starl_unjudged:why()}
    | {ended, ending()}
    | {started, AtUs :: integer(), starl:robot_id(), [starl_machine:name()]}
    | {seen, AtUs :: integer(), starl:robot_id(), starl:pose()}
    | {logged, AtUs :: integer(), starl:robot_id(), info | warning | error, unicode:chardata()}.

%% The facts of a run. `scenario' holds all values with the faults that were drawn; `monitors' are
%% those of its contracts, ready to judge; `epoch_us' is the system time of the run's time 0;
%% `begun_us' the time at which the telling begins, if that is not 0; `run' the number of a team's run.
%% `told_by': the robots that tell what they know themselves, in the place of the world, which knows
%% all; `has_motions': the world tells the true motions; `was_up': this robot was up when its
%% previous recording ended.
-type facts() :: #{
    kind := simulation | live,
    app := module(),
    scenario := map(),
    robots := [{starl:robot_id(), starl:pose()}],
    monitors := [{module(), map()}],
    machines := #{starl_machine:name() => module()},
    waypoints := #{atom() => starl_geometry:point()},
    %% of a run with a floor plan
    floor => starl_floor:t(),
    epoch_us => integer(),
    begun_us => integer(),
    run => non_neg_integer(),
    told_by => [starl:robot_id(), ...],
    has_motions => boolean(),
    was_up => boolean()
}.

%% The end of a run: all violations, in the order of its report, and what was not judged. Contracts are
%% judged until `judged_us', if that is later than the end: until then nothing would have happened.
-type ending() :: #{
    ending := atom(),
    end_us := integer(),
    judged_us => integer(),
    violations := [starl_monitor:violation()],
    unjudged => [starl_unjudged:t()],
    digest := binary()
}.

%% The event of machine `radio' that tells each packet of a run with the option `packets': its
%% receiver, a short form of it ({@link starl_packet:brief/1}), its bytes in the external term format,
%% and its fate. Monitors do not get it.
-type packet() ::
    {packet, To :: starl:robot_id(), starl_packet:brief(), Bytes :: pos_integer(), fate()}.

%% The copies of a packet that arrive, with their times (us), or why it is lost.
-type fate() :: {arrives, [{AtUs :: integer(), intact | corrupt}, ...]} | {lost, cause()}.

%% By chance; because the receiver is out of range; by the fault of this name. Live: the link is
%% cut; the packet could not be sent at all; the receiver's filter was full; nobody knows.
-type cause() :: chance | out_of_range | {fault, atom()} | cut | refused | full | unheard.

%% What one end of a live robot's radio knows of a packet: that it was sent, or what became of it at
%% its receiver. Both ends give a packet the same number, a hash of it. {@link starl_packet_fates}
%% puts the two together.
-type packet_report() ::
    {sent, To :: starl:robot_id(), starl_packet:brief(), Bytes :: pos_integer(), Hash :: integer()}
    | {came, From :: starl:robot_id(), starl_packet:brief(), Bytes :: pos_integer(),
        Hash :: integer(), fate()}.

%% What waits for a process that gets news.
-opaque feed() :: atomics:atomics_ref().

%% What such a process gets. `missed': reports with so many events were left out here.
-type delivery() :: news() | {missed, Events :: pos_integer()}.

%% The counters of a feed: events passed on, events done, events left out and not reported yet.
-define(PASSED, 1).
-define(DONE, 2).
-define(MISSED, 3).

%% The facts of the run, its end and the starts of robots are never left out.
-define(MAY_MISS(News),
    (element(1, News) =:= judged orelse element(1, News) =:= seen orelse
        element(1, News) =:= logged)
).

%% The module of a recorder and its configuration.
-type recorder() :: {module(), map()}.

%% Starts the recorder of a robot. `now' is its clock; `before': the last events of the robot before
%% this start, which its former recorder may have lost.
-callback start_link(#{
    robot := starl:robot_id(),
    now := fun(() -> AtUs :: integer()),
    before := [starl_monitor:trace_event()],
    atom() => term()
}) -> {ok, pid()} | {error, unicode:chardata()}.
%% The observer, whom several processes may tell.
-callback observer(pid()) -> t().

%% @doc Reports to an observer.
-spec tell(news(), t()) -> ok.
tell(_News, none) -> ok;
tell(News, Observer) -> Observer(News).

%% @doc One observer for several.
-spec all([t()]) -> t().
all(Observers) ->
    case [Observer || Observer <- Observers, Observer =/= none] of
        [] -> none;
        [Observer] -> Observer;
        Several -> fun(News) -> lists:foreach(fun(Each) -> ok = Each(News) end, Several) end
    end.

%% @doc Checks whether monitors get this trace event: whether it is not about a packet.
-spec is_judged(starl_monitor:trace_event()) -> boolean().
is_judged({_, _, radio, {packet, _, _, _, _}}) -> false;
is_judged(_) -> true.

%% @doc An observer that passes news on to a process, which receives `{starl_news, Feed, News}' and answers
%% each with {@link done/2}. At most `Most' events wait there. When so many do, a simulation (`wait')
%% waits. A live run (`leave_out') does not: it leaves reports out, and says how many events they
%% had. Several processes may report to one observer.
-spec feed(pid(), wait | leave_out, Most :: pos_integer()) -> fun((news()) -> ok).
feed(Pid, Policy, Most) ->
    Feed = atomics:new(3, []),
    fun(News) -> offer(News, {Pid, Policy, Most}, Feed) end.

offer(News, {Pid, Policy, Most}, Feed) ->
    Size = size_of(News),
    Waiting = atomics:get(Feed, ?PASSED) - atomics:get(Feed, ?DONE),
    case {Waiting > Most, Policy} of
        {true, leave_out} when ?MAY_MISS(News) ->
            atomics:add(Feed, ?MISSED, Size);
        {true, wait} ->
            ok = catch_up(Pid),
            pass(News, Size, Pid, Feed);
        _ ->
            ok = report_missed(Pid, atomics:exchange(Feed, ?MISSED, 0), Feed),
            pass(News, Size, Pid, Feed)
    end.

%% @doc The process has dealt with these news.
-spec done(delivery(), feed()) -> ok.
done(News, Feed) -> atomics:add(Feed, ?DONE, size_of(News)).

pass(News, Size, Pid, Feed) ->
    atomics:add(Feed, ?PASSED, Size),
    Pid ! {starl_news, Feed, News},
    ok.

report_missed(_Pid, 0, _Feed) ->
    ok;
report_missed(Pid, Missed, Feed) ->
    pass({missed, Missed}, 1, Pid, Feed).

size_of({judged, Trace, _}) -> length(Trace);
size_of(_) -> 1.

%% The process answers when it has dealt with everything before.
catch_up(Pid) ->
    try
        gen_server:call(Pid, caught_up, infinity)
    catch
        exit:_ -> ok
    end.
