%% @doc The live judge of a run: sorts the facts of all robots by time and feeds them to the monitors.
%% It reports to the observer, logs the parts of the run that it no longer judges, and makes the
%% outcome. It has no process: {@link starl_world} owns it.
%%
%% Facts arrive late and out of order. An event is judged when it is older than the horizon, and
%% when every robot that is up has sent all its facts up to then ({@link complete/4}). The judge
%% waits for a robot that stands still, whatever halted it. A robot whose node is halted for too
%% long is killed, and then counts as down.
%%
%% A fact may still come after its time was judged, for instance from hardware. Then the monitors go
%% back to their states before it, and judge the facts since then anew, in order. They can go back a
%% minute at most; after an older fact nothing more is judged. Judging also stops when the clocks of
%% two robots' computers are apart. The computers report this when they are asked. Packets that came
%% before they were sent show it, too, as do facts of future times. Packets are not judged; an
%% observer gets each packet when its sender and its receiver have had time to report it.
%%
%% A halted robot reports nothing. Its facts come afterwards, also those of the last moment before
%% the halt. So facts that were not old enough when the halt began are not judged until the horizon
%% after its end. By then its monitors have been notified of the halt
%% ({@link starl_monitor:broken/2}), so it excuses what a scheduled pause excuses. On a busy
%% computer, a node that may go on has to wait for its processor. So the halt ends when the robot is
%% heard again, at the latest the horizon after it may go on. The observer gets the halt as a fault,
%% a pause, from when the robot stands.
%% ```
%%     halt --> held -- halted --> stands -- released --> awaited -- heard, or the horizon --> over
%% '''
-module(starl_world_judge).

-export([new/2, new/3, horizon_us/0, back_us/0]).
-export([facts/2, radio/2, undone/3, too_late/3, clock/3, up/3, down/2, complete/4]).
-export([fault/3, halt/4, halted/3, released/3, heard/3, standing/1, is_awaited/2]).
-export([look/3, judge/2, judge/3, accept/3, accuse/2, close/2, outcome/4]).
-export([leader/1, violations/1, unjudged/1, late/1, late_computers/1]).

-export_type([t/0]).

-record(judge, {
    monitors :: starl_monitor:t(),
    observer = none :: starl_observer:t(),
    horizon_us :: non_neg_integer(),
    %% events that are to be judged
    pending = [] :: [entry()],
    n = 0 :: non_neg_integer(),
    seen = 0 :: integer(),
    %% what was judged in the last minute, latest first
    judged = [] :: [step()],
    %% the time of the last event that was reported to the observer
    reported_us = 0 :: integer(),
    %% the robots that are up, with the times up to which all their facts have come
    complete = #{} :: #{starl:robot_id() => integer()},
    %% when the judge has looked last, and how long it was kept from it
    looked_us = 0 :: integer(),
    behind_us = 0 :: non_neg_integer(),
    late = 0 :: non_neg_integer(),
    %% how often the robots' computers were late, and by how much at most
    computers = #{} :: #{starl:robot_id() => {pos_integer(), Us :: pos_integer()}},
    %% the robots for which the judge waits; the halts that are over, from when to when
    held = #{} :: #{starl:robot_id() => hold()},
    halts = [] :: [{integer(), integer()}],
    lasting = starl_assumption_open_faults:new() :: starl_assumption_open_faults:t(),
    %% all faults, latest first; the fault of each pause, and since when the robot stands
    faults = [] :: [starl_world_faults:fault()],
    pauses = #{} :: #{starl:robot_id() => {Fault :: atom(), SinceMs :: integer() | none}},
    packets = starl_packet_fates:new() :: starl_packet_fates:t(),
    leader = none :: starl:robot_id() | none,
    violations = [] :: [starl_monitor:violation()],
    %% the report to the observer on the latest violation
    unreported = none :: {[starl_monitor:trace_event()], starl_monitor:violation()} | none
}).

-opaque t() :: #judge{}.

%% Since when the judge waits for a robot, since when it stands, and when it was released.
-type hold() :: {
    integer(), StandsUs :: integer() | none, ReleasedUs :: integer() | none
}.

%% An event with its number of arrival. Was it reported to the observer?
-type entry() :: {
    AtUs :: integer(), non_neg_integer(), starl_monitor:trace_event(), IsReported :: boolean()
}.

%% A step of the monitors, with their states and the violations before it, and its events; or a broken
%% assumption.
-type step() ::
    {judged, SeenUs :: integer(), starl_monitor:t(), [starl_monitor:violation()], [entry()]}
    | {broken, starl_assumption:window()}.

%% The time that the judge of a run waits for facts, by the clock of the computer.
-define(HORIZON_US, 1500000).
%% How far the monitors can go back, and how old a fact may be for that when it comes.
-define(KEPT_US, 60000000).
-define(BACK_US, 30000000).

%% Clocks are apart if packets come so long before they were sent, on average, or facts from so far ahead.
-define(APART_US, 5000).
-define(AHEAD_US, 500000).

%% @doc A judge with these monitors that waits this long for facts.
-spec new([{module(), map()}], HorizonUs :: non_neg_integer()) -> t().
new(Monitors, Horizon) -> new(Monitors, Horizon, none).

%% @doc The same with an observer, which gets what is judged.
-spec new([{module(), map()}], HorizonUs :: non_neg_integer(), starl_observer:t()) -> t().
new(Monitors, Horizon, Observer) ->
    #judge{
        monitors = starl_monitor:guarded(Monitors), horizon_us = Horizon, observer = Observer
    }.

%% @doc The time that the judge of a run waits for facts.
-spec horizon_us() -> pos_integer().
horizon_us() -> ?HORIZON_US.

%% @doc The age up to which a fact can be judged at its time.
-spec back_us() -> pos_integer().
back_us() -> ?BACK_US.

%% -- facts ----------------------------------------------------------------------------------

%% @doc Handles facts, which are in the order of their time for each robot. If a computer was late,
%% that is known before the facts that it explains are judged.
-spec facts([starl_monitor:trace_event()], t()) -> t().
facts(Events, #judge{leader = Leader} = Judge) ->
    lists:foldl(
        fun arrived/2,
        lists:foldl(
            fun computer_late/2,
            Judge#judge{leader = lists:foldl(fun leads/2, Leader, Events)},
            starl_assumption:late(Events)
        ),
        Events
    ).

leads({_Us, Robot, _Machine, {leads, _Term}}, _Leader) -> Robot;
leads(_Event, Leader) -> Leader.

computer_late({Robot, From, To, _} = Window, #judge{computers = Before} = Judge) ->
    Us = To - From,
    More = fun({N, Longest}) -> {N + 1, max(Us, Longest)} end,
    broken(Window, Judge#judge{computers = maps:update_with(Robot, More, {1, Us}, Before)}).

broken(Window, #judge{monitors = Monitors, judged = Judged} = Judge) ->
    Judge#judge{
        monitors = starl_monitor:broken(Window, Monitors), judged = [{broken, Window} | Judged]
    }.

arrived(Event, #judge{pending = Pending, n = N} = Judge) ->
    Judge#judge{pending = [{element(1, Event), N, Event, false} | Pending], n = N + 1}.

%% @doc Handles the reports of a robot's radio on packets.
-spec radio([starl_monitor:trace_event()], t()) -> t().
radio(_Events, #judge{observer = none} = Judge) ->
    Judge;
radio(Events, #judge{packets = Packets} = Judge) ->
    Judge#judge{packets = lists:foldl(fun starl_packet_fates:report/2, Packets, Events)}.

%% @doc Withdraws reported facts. If they are judged already, all later facts are judged anew.
-spec undone([starl_monitor:trace_event(), ...], NowUs :: integer(), t()) -> t().
undone([First | _] = Events, Now, Judge) ->
    case without(Events, Judge) of
        {ok, Next} ->
            Next;
        {error, Next} ->
            Then = element(1, First),
            {_, Back} = back(Then - 1, {stood_still, Then, Now}, Next),
            {_, Left} = without(Events, Back),
            logged(Left, Judge)
    end.

%% Are these all of the events?
without(Events, #judge{pending = Pending} = Judge) ->
    {Undone, Left} = lists:partition(fun({_, _, E, _}) -> lists:member(E, Events) end, Pending),
    Next = Judge#judge{pending = Left},
    case length(Undone) >= length(Events) of
        true -> {ok, Next};
        false -> {error, Next}
    end.

%% @doc Handles a report of hardware on an earlier time. One that is too late cannot be judged at its
%% time.
-spec too_late(ThenUs :: integer(), NowUs :: integer(), t()) -> t().
too_late(Then, Now, Judge) when Then < Now - ?BACK_US ->
    logged(blinded({stood_still, Then, Now}, Judge), Judge);
too_late(_Then, _Now, Judge) ->
    Judge.

%% @doc Records how far the clock of a robot's computer is ahead of the judge's, or behind.
-spec clock(starl:robot_id(), AheadUs :: integer(), t()) -> t().
clock(Robot, Ahead, Judge) when abs(Ahead) >= ?APART_US ->
    logged(blinded({clocks, Robot, Robot, Ahead}, Judge), Judge);
clock(_Robot, _Ahead, Judge) ->
    Judge.

%% @doc A robot is up from now on: its facts are waited for.
-spec up(starl:robot_id(), NowUs :: integer(), t()) -> t().
up(Robot, Now, #judge{complete = Complete} = Judge) ->
    Judge#judge{complete = Complete#{Robot => Now}}.

%% @doc A robot is down: all its facts have come.
-spec down(starl:robot_id(), t()) -> t().
down(Robot, #judge{complete = Complete} = Judge) ->
    Judge#judge{complete = maps:remove(Robot, Complete)}.

%% @doc Handles the answer of a robot that is up: all its facts up to the question have come. If the
%% answer took longer than the judge waits for facts, the robot stood still. Then the judge waits as
%% after a halt, because what explains the silence may come a moment later.
-spec complete(starl:robot_id(), ThenUs :: integer(), NowUs :: integer(), t()) -> t().
complete(Robot, Then, Now, #judge{complete = Complete, horizon_us = Horizon} = Judge) ->
    case Complete of
        #{Robot := Before} when Now - Then > Horizon ->
            #judge{halts = Halts} = Judge,
            Judge#judge{
                complete = Complete#{Robot := Then},
                halts = [{Before, Now} | lists:delete({Before, Now}, Halts)]
            };
        #{Robot := _} ->
            Judge#judge{complete = Complete#{Robot := Then}};
        #{} ->
            Judge
    end.

%% -- faults and halts -----------------------------------------------------------------------

%% @doc Handles the beginning or the end of a scheduled or manual fault. While it lasts, it excuses
%% what it explains. The observer gets scheduled and manual faults alike.
-spec fault(starl_world_faults:report(), NowUs :: integer(), t()) -> t().
fault({Is, Fault}, Now, #judge{lasting = Lasting, observer = Observer, faults = Faults} = Judge) ->
    Own = setelement(6, Fault, maps:remove(in_time, element(6, Fault))),
    ok = starl_observer:tell({fault, Now, {Is, Own}}, Observer),
    Judge#judge{
        lasting = starl_assumption_open_faults:report({Is, Own}, Lasting),
        faults = [Own | lists:keydelete(element(1, Own), 1, Faults)]
    }.

%% @doc A robot is about to be halted, by the fault of this name: nothing is judged from now on.
-spec halt(starl:robot_id(), Fault :: atom(), NowUs :: integer(), t()) -> t().
halt(Robot, Fault, Now, Judge) ->
    #judge{held = Held} = Before = resumed(Robot, Now, Judge),
    Waits =
        #judge{pauses = Pauses} = pauses(
            Now, Before#judge{held = Held#{Robot => {Now, none, none}}}
        ),
    Waits#judge{pauses = Pauses#{Robot => {Fault, none}}}.

%% @doc Handles that a robot for which the judge waits stands still.
-spec halted(starl:robot_id(), NowUs :: integer(), t()) -> t().
halted(Robot, Now, #judge{held = Held} = Judge) ->
    Stands = fun({Since, _, none}) -> {Since, Now, none} end,
    pauses(Now, Judge#judge{held = maps:update_with(Robot, Stands, Held)}).

%% @doc A robot that stands still may go on.
-spec released(starl:robot_id(), NowUs :: integer(), t()) -> t().
released(Robot, Now, #judge{held = Held} = Judge) ->
    case Held of
        #{Robot := {_, none, _}} ->
            pauses(Now, resumed(Robot, Now, Judge));
        #{Robot := {Since, Stands, none}} ->
            Judge#judge{held = Held#{Robot := {Since, Stands, Now}}};
        #{} ->
            Judge
    end.

%% @doc A robot is heard. If it was released, it goes on: the judge need not wait any more.
-spec heard(starl:robot_id(), NowUs :: integer(), t()) -> t().
heard(Robot, Now, Judge) ->
    case is_awaited(Robot, Judge) of
        true -> pauses(Now, resumed(Robot, Now, Judge));
        false -> Judge
    end.

%% @doc The robots that stand still.
-spec standing(t()) -> [starl:robot_id()].
standing(#judge{held = Held}) ->
    lists:sort([Robot || {Robot, {_, Stands, _}} <- maps:to_list(Held), Stands =/= none]).

%% @doc Has this robot been released, and not been heard yet?
-spec is_awaited(starl:robot_id(), t()) -> boolean().
is_awaited(Robot, #judge{held = Held}) ->
    case Held of
        #{Robot := {_, _, Released}} -> Released =/= none;
        #{} -> false
    end.

resumed(Robot, Now, #judge{held = Held, halts = Halts} = Judge) ->
    case maps:take(Robot, Held) of
        {{Since, Stands, _}, Left} ->
            excused(Robot, Stands, Now, Judge#judge{held = Left, halts = [{Since, Now} | Halts]});
        error ->
            Judge
    end.

excused(_Robot, none, _Now, Judge) ->
    Judge;
excused(Robot, From, To, Judge) ->
    broken({Robot, From, To, pause}, Judge).

%% A pause begins when a robot stands, and ends when it stands no more.
pauses(Now, #judge{pauses = Pauses} = Judge) ->
    Standing = standing(Judge),
    lists:foldl(
        fun({Robot, Pause}, J) -> pause(Robot, Pause, lists:member(Robot, Standing), Now, J) end,
        Judge,
        lists:sort(maps:to_list(Pauses))
    ).

pause(Robot, {Fault, none}, true, Now, #judge{pauses = Pauses} = Judge) ->
    Begun = Judge#judge{pauses = Pauses#{Robot := {Fault, Now div 1000}}},
    fault({began, {Fault, Now div 1000, forever, pause, Robot, #{}}}, Now, Begun);
pause(Robot, {Fault, Since}, false, Now, #judge{pauses = Pauses} = Judge) when is_integer(Since) ->
    Over = Judge#judge{pauses = maps:remove(Robot, Pauses)},
    fault({ended, {Fault, Since, Now div 1000, pause, Robot, #{}}}, Now, Over);
pause(_Robot, _Pause, _Stands, _Now, Judge) ->
    Judge.

%% -- verdicts -------------------------------------------------------------------------------

%% @doc Judges the events that are old enough by now, once in each period. A computer that stood
%% still goes on with all processes at once, and the facts of others come a moment after the judge
%% looks. So the judge that this returns counts when it is accepted ({@link accept/3}), or its
%% violation is reported ({@link accuse/2}). Until then the judge before may look again, with facts
%% that it has missed.
-spec look(NowUs :: integer(), PeriodUs :: pos_integer(), t()) -> {ok | violation, t()}.
look(Now, Period, #judge{looked_us = Looked, behind_us = Before} = Judge) ->
    Passed = Now - Looked,
    Behind = max(0, max(Passed - 2 * Period, Before - Passed)),
    judge(Now, Behind, Judge#judge{looked_us = Now, behind_us = Behind}).

%% @doc Judges the events that are old enough by now.
-spec judge(NowUs :: integer(), t()) -> {ok | violation, t()}.
judge(Now, Judge) -> judge(Now, 0, Judge).

%% @doc The same for a judge that was kept from its work for this time: it waits longer for facts,
%% because it may not have all that have come meanwhile.
-spec judge(NowUs :: integer(), BehindUs :: non_neg_integer(), t()) -> {ok | violation, t()}.
judge(Now, Behind, Begun) ->
    #judge{horizon_us = Least} = Open = lasting(Now, Begun),
    Horizon = Least + Behind,
    #judge{held = Held, halts = Halts, complete = Complete} = Judge = unheard(Now - Least, Open),
    Recent = [Halt || {_, To} = Halt <- Halts, To > Now - Horizon],
    Since = [element(1, Halt) || Halt <- maps:values(Held) ++ Recent],
    Time = lists:min([lists:min([Now | Since]) - Horizon | maps:values(Complete)]),
    upto(Time, Now, apart(Now, Judge#judge{halts = Recent})).

%% What is judged now may rest on faults that still last.
lasting(Now, #judge{lasting = Before} = Judge) ->
    {Windows, Lasting} = starl_assumption_open_faults:windows(Now, Before),
    lists:foldl(fun broken/2, Judge#judge{lasting = Lasting}, Windows).

%% The robots that were released by this time are not waited for any longer.
unheard(Time, #judge{horizon_us = Horizon, held = Held} = Judge) ->
    Over = [
        {Id, At}
     || {Id, {_, _, At}} <- lists:sort(maps:to_list(Held)), is_integer(At), At =< Time
    ],
    lists:foldl(fun({Id, At}, J) -> resumed(Id, At + Horizon, J) end, Judge, Over).

%% Clocks that run apart.
apart(Now, #judge{pending = Pending, packets = Packets} = Judge) ->
    Early = [
        {clocks, A, B, Us}
     || {{A, B}, Us} <- starl_packet_fates:early(Packets), Us >= ?APART_US
    ],
    Ahead = [{clocks, R, R, T - Now} || {T, _, {_, R, _, _}, _} <- Pending, T >= Now + ?AHEAD_US],
    case Early ++ Ahead of
        [] -> Judge;
        [Why | _] -> blinded(Why, Judge)
    end.

%% @doc Accepts what a judge has found without a violation, in place of the judge before its look.
-spec accept(t(), NowUs :: integer(), Before :: t()) -> t().
accept(Judge, Now, Before) -> pauses(Now, logged(Judge, Before)).

%% @doc Accepts a judge that has found a violation, and reports it to the observer.
-spec accuse(t(), Before :: t()) -> t().
accuse(Judge, Before) -> logged(report_violation(Judge), Before).

%% The parts that are no longer judged are logged.
logged(Judge, Before) ->
    _ = [
        logger:warning(#{what => not_judged, why => unicode:characters_to_binary(Line)})
     || Part <- unjudged(Judge) -- unjudged(Before), Line <- [starl_unjudged:format(Part)]
    ],
    Judge.

report_violation(#judge{unreported = none} = Judge) ->
    Judge;
report_violation(#judge{unreported = {Events, Violation}} = Judge) ->
    ok = report(Events, [Violation], Judge),
    Judge#judge{unreported = none}.

%% @doc Judges everything that has arrived, and closes the monitors: all violations, and each
%% monitor's results, and what is not judged.
-spec close(NowUs :: integer(), t()) ->
    {[starl_monitor:violation()], #{module() => map()}, [starl_unjudged:t()]}.
close(Now, #judge{held = Held} = Open) ->
    Over = fun(Robot, Judge) -> resumed(Robot, Now, Judge) end,
    Judge = lists:foldl(Over, lasting(Now, Open), lists:sort(maps:keys(Held))),
    {_, Judged} = upto(infinity, Now, Judge),
    #judge{monitors = Monitors, violations = Violations, seen = Seen} = report_violation(Judged),
    {Late, Results, Unjudged} = starl_monitor:close(max(Now, Seen), Monitors),
    {Violations ++ Late, Results, Unjudged}.

%% @doc The outcome of a run that ends now, as of a simulation; `Robots': what is known of each robot. It
%% closes the monitors and notifies the observer.
-spec outcome(starl_world:ending() | none, NowUs :: integer(), Robots, t()) ->
    starl_run:outcome()
when
    Robots :: [{starl:robot_id(), map()}].
outcome(Ending, Now, Robots, #judge{observer = Observer, faults = Faults} = Judge) ->
    {Violations, Results, Unjudged} = close(Now, Judge),
    Verdict = #{
        ending => Ending,
        end_us => Now,
        violations => Violations,
        unjudged => Unjudged,
        digest => <<>>
    },
    ok = starl_observer:tell({ended, Verdict}, Observer),
    Verdict#{
        judged_us => Now,
        monitors => Results,
        robots => Robots,
        events => lists:sum([E || {_, #{events := E}} <- Robots]),
        packets => lists:sum([P || {_, #{packets := P}} <- Robots]),
        lost => [],
        late_computers => late_computers(Judge),
        faults => lists:keysort(2, [ended_by(Now div 1000, Fault) || Fault <- Faults])
    }.

%% A fault that has not ended ends with the run.
ended_by(Now, {Id, From, forever, Kind, Target, Params}) -> {Id, From, Now, Kind, Target, Params};
ended_by(_Now, Fault) -> Fault.

%% @doc The robot that leads, by the latest report.
-spec leader(t()) -> starl:robot_id() | none.
leader(#judge{leader = Leader}) -> Leader.

%% @doc The violations so far.
-spec violations(t()) -> [starl_monitor:violation()].
violations(#judge{violations = Violations}) -> Violations.

%% @doc The number of events that came after their time had been judged.
-spec late(t()) -> non_neg_integer().
late(#judge{late = Late}) -> Late.

%% @doc The robots whose computers were late, by their own reports: how often, and by how much at
%% most.
-spec late_computers(t()) -> [{starl:robot_id(), pos_integer(), Us :: pos_integer()}].
late_computers(#judge{computers = Computers}) ->
    [{Robot, N, Us} || {Robot, {N, Us}} <- lists:sort(maps:to_list(Computers))].

%% @doc The parts that are not judged.
-spec unjudged(t()) -> [starl_unjudged:t()].
unjudged(#judge{monitors = Monitors}) -> starl_monitor:unjudged(Monitors).

%% -- steps of the monitors ------------------------------------------------------------------

%% Facts that come after their time has been judged take the monitors back.
upto(Time, Now, #judge{pending = Pending, seen = Seen, late = Before} = Judge) ->
    {Old, Young} = lists:partition(fun({At, _, _, _}) -> At =< Time end, Pending),
    case lists:sort(Old) of
        [{First, _, _, _} | _] = Sorted when First < Seen ->
            Late = length(lists:takewhile(fun({At, _, _, _}) -> At < Seen end, Sorted)),
            Known = Judge#judge{late = Before + Late},
            case back(First, {stood_still, First, Now}, Known) of
                {back, Again} -> upto(Time, Now, Again);
                {blind, Blind} -> judged(Time, [after_(Seen, E) || E <- Sorted], Young, Blind)
            end;
        Sorted ->
            judged(Time, Sorted, Young, Judge)
    end.

after_(Seen, {At, N, Event, IsReported}) ->
    Then = max(Seen, At),
    {Then, N, setelement(1, Event, Then), IsReported}.

%% Takes the monitors back to this time; later events are pending again. If they cannot go back so far,
%% they are blind.
back(Time, Why, #judge{judged = Judged} = Judge) ->
    IsLater = fun
        ({judged, Seen, _, _, _}) -> Seen > Time;
        ({broken, _}) -> true
    end,
    case lists:splitwith(IsLater, Judged) of
        {Later, [First | Earlier]} ->
            ok = gap(Why, Judge),
            {back, again(First, Later, Judge#judge{judged = Earlier})};
        {_, []} ->
            {blind, blinded(Why, Judge)}
    end.

%% Broken assumptions that are known by now hold from the start.
again({judged, Seen, Monitors, Violations, Entries}, Later, #judge{pending = Pending} = Judge) ->
    Others = [E || {judged, _, _, _, Es} <- Later, E <- Es],
    Windows = [Window || {broken, Window} <- lists:reverse(Later)],
    Before = Judge#judge{
        monitors = Monitors,
        violations = Violations,
        unreported = none,
        seen = Seen,
        pending = Entries ++ Others ++ Pending
    },
    lists:foldl(fun broken/2, Before, Windows).

judged(Time, Entries, Young, Judge) ->
    {Due, Packets} = starl_packet_fates:due(Time, Judge#judge.packets),
    watch(Entries, Due, Judge#judge{pending = Young, packets = Packets}).

watch([], Packets, Judge) ->
    ok = report(Packets, [], Judge),
    {ok, Judge};
watch(Entries, Packets, #judge{monitors = Monitors, violations = Violations} = Judge) ->
    Trace = [Event || {_, _, Event, _} <- Entries],
    {Reported, Known} = to_report(Entries, Packets, kept(Entries, Judge)),
    Seen = Known#judge{seen = element(1, lists:last(Trace))},
    case starl_monitor:step([E || E <- Trace, starl_observer:is_judged(E)], Monitors) of
        {ok, Next} ->
            ok = report(Reported, [], Judge),
            {ok, Seen#judge{monitors = Next}};
        {violation, Violation, Next} ->
            Found = Violations ++ [Violation],
            {violation, Seen#judge{
                monitors = Next, violations = Found, unreported = {Reported, Violation}
            }}
    end.

%% The events that were not reported yet, at times not before those of earlier reports.
to_report(Entries, Packets, #judge{reported_us = Before} = Judge) ->
    New = [setelement(1, Event, max(Before, At)) || {At, _, Event, false} <- Entries],
    Last = lists:max([Before | [element(1, Event) || Event <- New]]),
    {lists:keymerge(1, New, Packets), Judge#judge{reported_us = Last}}.

%% The monitors can go back to before these events, for a while.
kept(Entries, #judge{judged = Judged, seen = Seen} = Judge) ->
    #judge{monitors = Monitors, violations = Violations} = Judge,
    IsRecent = fun
        ({judged, Then, _, _, _}) -> Then >= Seen - ?KEPT_US;
        ({broken, _}) -> true
    end,
    Reported = [setelement(4, Entry, true) || Entry <- Entries],
    Step = {judged, Seen, Monitors, Violations, Reported},
    Judge#judge{judged = [Step | lists:takewhile(IsRecent, Judged)]}.

report([], [], _Judge) ->
    ok;
report(Events, Found, #judge{observer = Observer}) ->
    starl_observer:tell({judged, Events, Found}, Observer).

blinded(Why, #judge{monitors = Monitors} = Judge) ->
    Next = starl_monitor:blinded(Why, Monitors),
    _ = starl_monitor:unjudged(Next) =/= starl_monitor:unjudged(Monitors) andalso gap(Why, Judge),
    Judge#judge{monitors = Next, judged = []}.

%% Later reports to the observer are not in order with the earlier ones.
gap(Why, #judge{observer = Observer, seen = Seen}) ->
    starl_observer:tell({unjudged, Seen, Why}, Observer).
