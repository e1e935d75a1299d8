%% @doc Judges a live run: sorts the facts of all robots by time and feeds them to the monitors. A
%% pure module.
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
%% heard again, at the latest the horizon after it may go on.
%% ```
%%     hold --> held -- halted --> stands -- released --> awaited -- heard, or the horizon --> over
%% '''
-module(starl_world_judge).

-export([
    new/2, new/3,
    horizon_us/0,
    back_us/0,
    told/2,
    undone/3,
    up/3,
    down/2,
    complete/4,
    heard/2,
    faults/2,
    clock/3,
    hold/3,
    halted/3,
    released/3,
    resumed/3,
    standing/1,
    is_awaited/2,
    look/3,
    judge/2,
    judge/3,
    accuse/1,
    violations/1,
    late/1,
    late_computers/1,
    stood_still/3,
    unjudged/1,
    close/2
]).

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
    judged = [] :: [piece()],
    %% the time of the last event of which the observer was told
    told_us = 0 :: integer(),
    %% the robots that are up, with the times up to which all their facts have come
    complete = #{} :: #{starl:robot_id() => integer()},
    %% when the judge has looked last, and how long he was kept from it
    looked_us = 0 :: integer(),
    behind_us = 0 :: non_neg_integer(),
    late = 0 :: non_neg_integer(),
    %% how often the robots' computers were late, and by how much at most
    computers = #{} :: #{starl:robot_id() => {pos_integer(), Us :: pos_integer()}},
    %% the robots for which the judge waits; the halts that are over, from when to when
    held = #{} :: #{starl:robot_id() => hold()},
    halts = [] :: [{integer(), integer()}],
    lasting = starl_assumption_open_faults:new() :: starl_assumption_open_faults:t(),
    ways = starl_packet_fates:new() :: starl_packet_fates:t(),
    violations = [] :: [starl_monitor:violation()],
    %% what the observer is to be told of the latest violation
    untold = none :: {[starl_monitor:trace_event()], starl_monitor:violation()} | none
}).

-opaque t() :: #judge{}.

%% Since when the judge waits for a robot, since when it stands, and when it was released.
-type hold() :: {
    integer(), StandsUs :: integer() | none, ReleasedUs :: integer() | none
}.

%% An event with its number of arrival, and whether the observer was told of it.
-type entry() :: {
    AtUs :: integer(), non_neg_integer(), starl_monitor:trace_event(), IsTold :: boolean()
}.

%% A step of the monitors: from when on, their states and the violations before it, and the events; or a
%% broken assumption of which they were told.
-type piece() ::
    {judged, SeenUs :: integer(), starl_monitor:t(), [starl_monitor:violation()], [entry()]}
    | {broken, starl_assumption:window()}.

%% The time that the judge of a run waits for facts, by the clock of the computer.
-define(HORIZON_US, 1500000).
%% How far the monitors can go back, and how old a fact may be for that when it comes.
-define(KEPT_US, 60000000).
-define(BACK_US, 30000000).

%% Packets that came so long before they were sent, on average, and facts from so far ahead: clocks are
%% apart.
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
            Left
    end.

%% Are these all of the events?
without(Events, #judge{pending = Pending} = Judge) ->
    {Undone, Left} = lists:partition(fun({_, _, E, _}) -> lists:member(E, Events) end, Pending),
    Next = Judge#judge{pending = Left},
    case length(Undone) >= length(Events) of
        true -> {ok, Next};
        false -> {error, Next}
    end.

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

%% @doc Facts have arrived, in the order of their time for each robot. That a computer was late is known before
%% what it explains is judged.
-spec told([starl_monitor:trace_event()], t()) -> t().
told(Events, Judge) ->
    lists:foldl(
        fun arrived/2,
        lists:foldl(fun computer_late/2, Judge, starl_assumption:late(Events)),
        Events
    ).

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
-spec heard([starl_monitor:trace_event()], t()) -> t().
heard(_Events, #judge{observer = none} = Judge) ->
    Judge;
heard(Events, #judge{ways = Ways} = Judge) ->
    Judge#judge{ways = lists:foldl(fun starl_packet_fates:report/2, Ways, Events)}.

%% @doc Handles manual faults that have begun or ended: while they last, they excuse what they
%% explain.
-spec faults([{began | ended, starl_assumption_open_faults:fault()}], t()) -> t().
faults(Told, #judge{lasting = Lasting} = Judge) ->
    Judge#judge{lasting = lists:foldl(fun starl_assumption_open_faults:report/2, Lasting, Told)}.

%% @doc Records how far the clock of a robot's computer is ahead of the judge's, or behind.
-spec clock(starl:robot_id(), AheadUs :: integer(), t()) -> t().
clock(Robot, Ahead, Judge) when abs(Ahead) >= ?APART_US ->
    blinded({clocks, Robot, Robot, Ahead}, Judge);
clock(_Robot, _Ahead, Judge) ->
    Judge.

%% @doc A robot is about to be halted: nothing is judged from now on.
-spec hold(starl:robot_id(), NowUs :: integer(), t()) -> t().
hold(Robot, Now, Judge) ->
    #judge{held = Held} = Before = resumed(Robot, Now, Judge),
    Before#judge{held = Held#{Robot => {Now, none, none}}}.

%% @doc Handles that a robot for which the judge waits stands still.
-spec halted(starl:robot_id(), NowUs :: integer(), t()) -> t().
halted(Robot, Now, #judge{held = Held} = Judge) ->
    Stands = fun({Since, _, none}) -> {Since, Now, none} end,
    Judge#judge{held = maps:update_with(Robot, Stands, Held)}.

%% @doc A robot that stands still may go on.
-spec released(starl:robot_id(), NowUs :: integer(), t()) -> t().
released(Robot, Now, #judge{held = Held} = Judge) ->
    case Held of
        #{Robot := {_, none, _}} ->
            resumed(Robot, Now, Judge);
        #{Robot := {Since, Stands, none}} ->
            Judge#judge{held = Held#{Robot := {Since, Stands, Now}}};
        #{} ->
            Judge
    end.

%% @doc The judge need not wait for a robot any more: it has been heard after its release, or has ended.
-spec resumed(starl:robot_id(), NowUs :: integer(), t()) -> t().
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

%% @doc Looks at the events that are old enough by now, as in each of these periods. A computer that
%% stood still goes on with all processes at once: what others have told comes a moment after the judge
%% could look. A violation counts when it is {@link accuse/1. said}; until then the judge before the look may look anew,
%% with facts that he has missed.
-spec look(NowUs :: integer(), PeriodUs :: pos_integer(), t()) -> {ok | violation, t()}.
look(Now, Period, #judge{looked_us = Looked, behind_us = Before} = Judge) ->
    Passed = Now - Looked,
    Behind = max(0, max(Passed - 2 * Period, Before - Passed)),
    judge(Now, Behind, Judge#judge{looked_us = Now, behind_us = Behind}).

%% @doc Judges the events that are old enough by now.
-spec judge(NowUs :: integer(), t()) -> {ok | violation, t()}.
judge(Now, Judge) -> judge(Now, 0, Judge).

%% @doc The same, of a judge who was kept from his work for so long and may not have all facts that have
%% come meanwhile: he waits longer for them.
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
apart(Now, #judge{pending = Pending, ways = Ways} = Judge) ->
    Early = [{clocks, A, B, Us} || {{A, B}, Us} <- starl_packet_fates:early(Ways), Us >= ?APART_US],
    Ahead = [{clocks, R, R, T - Now} || {T, _, {_, R, _, _}, _} <- Pending, T >= Now + ?AHEAD_US],
    case Early ++ Ahead of
        [] -> Judge;
        [Why | _] -> blinded(Why, Judge)
    end.

blinded(Why, #judge{monitors = Monitors} = Judge) ->
    Next = starl_monitor:blinded(Why, Monitors),
    _ = starl_monitor:unjudged(Next) =/= starl_monitor:unjudged(Monitors) andalso gap(Why, Judge),
    Judge#judge{monitors = Next, judged = []}.

%% What the observer is told from now on is not in order with what he was told before.
gap(Why, #judge{observer = Observer, seen = Seen}) ->
    starl_observer:tell({unjudged, Seen, Why}, Observer).

%% @doc What was heard now had happened at another time, longer ago than the judge waits.
-spec stood_still(ThenUs :: integer(), NowUs :: integer(), t()) -> t().
stood_still(Then, Now, Judge) -> blinded({stood_still, Then, Now}, Judge).

%% @doc What is not judged any more.
-spec unjudged(t()) -> [starl_unjudged:t()].
unjudged(#judge{monitors = Monitors}) -> starl_monitor:unjudged(Monitors).

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

after_(Seen, {At, N, Event, IsTold}) ->
    Then = max(Seen, At),
    {Then, N, setelement(1, Event, Then), IsTold}.

%% The monitors have judged nothing after this time: what they had, is to be judged again. If they cannot go back so
%% far, they are blind.
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

%% What was known of broken assumptions, is known before.
again({judged, Seen, Monitors, Violations, Entries}, Later, #judge{pending = Pending} = Judge) ->
    Others = [E || {judged, _, _, _, Es} <- Later, E <- Es],
    Windows = [Window || {broken, Window} <- lists:reverse(Later)],
    Before = Judge#judge{
        monitors = Monitors,
        violations = Violations,
        untold = none,
        seen = Seen,
        pending = Entries ++ Others ++ Pending
    },
    lists:foldl(fun broken/2, Before, Windows).

judged(Time, Entries, Young, Judge) ->
    {Packets, Ways} = starl_packet_fates:due(Time, Judge#judge.ways),
    watch(Entries, Packets, Judge#judge{pending = Young, ways = Ways}).

watch([], Packets, Judge) ->
    ok = tell(Packets, [], Judge),
    {ok, Judge};
watch(Entries, Packets, #judge{monitors = Monitors, violations = Violations} = Judge) ->
    Trace = [Event || {_, _, Event, _} <- Entries],
    {Told, Known} = untold(Entries, Packets, kept(Entries, Judge)),
    Seen = Known#judge{seen = element(1, lists:last(Trace))},
    case starl_monitor:step([E || E <- Trace, starl_observer:is_judged(E)], Monitors) of
        {ok, Next} ->
            ok = tell(Told, [], Judge),
            {ok, Seen#judge{monitors = Next}};
        {violation, Violation, Next} ->
            Found = Violations ++ [Violation],
            {violation, Seen#judge{
                monitors = Next, violations = Found, untold = {Told, Violation}
            }}
    end.

%% What the observer has not been told, not before what he has been told.
untold(Entries, Packets, #judge{told_us = Before} = Judge) ->
    New = [setelement(1, Event, max(Before, At)) || {At, _, Event, false} <- Entries],
    Last = lists:max([Before | [element(1, Event) || Event <- New]]),
    {lists:keymerge(1, New, Packets), Judge#judge{told_us = Last}}.

%% The monitors can go back to before these events, for a while.
kept(Entries, #judge{judged = Judged, seen = Seen} = Judge) ->
    #judge{monitors = Monitors, violations = Violations} = Judge,
    IsRecent = fun
        ({judged, Then, _, _, _}) -> Then >= Seen - ?KEPT_US;
        ({broken, _}) -> true
    end,
    Told = [setelement(4, Entry, true) || Entry <- Entries],
    Piece = {judged, Seen, Monitors, Violations, Told},
    Judge#judge{judged = [Piece | lists:takewhile(IsRecent, Judged)]}.

%% @doc Reports the latest violation to the observer.
-spec accuse(t()) -> t().
accuse(#judge{untold = none} = Judge) ->
    Judge;
accuse(#judge{untold = {Told, Violation}} = Judge) ->
    ok = tell(Told, [Violation], Judge),
    Judge#judge{untold = none}.

tell([], [], _Judge) ->
    ok;
tell(Told, Found, #judge{observer = Observer}) ->
    starl_observer:tell({judged, Told, Found}, Observer).

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

%% @doc Judges everything that has arrived, and closes the monitors: all violations, and each
%% monitor's results, and what is not judged.
-spec close(NowUs :: integer(), t()) ->
    {[starl_monitor:violation()], #{module() => map()}, [starl_unjudged:t()]}.
close(Now, #judge{held = Held} = Open) ->
    Over = fun(Robot, Judge) -> resumed(Robot, Now, Judge) end,
    Judge = lists:foldl(Over, lasting(Now, Open), lists:sort(maps:keys(Held))),
    {_, Judged} = upto(infinity, Now, Judge),
    #judge{monitors = Monitors, violations = Violations, seen = Seen} = accuse(Judged),
    {Late, Results, Unjudged} = starl_monitor:close(max(Now, Seen), Monitors),
    {Violations ++ Late, Results, Unjudged}.
