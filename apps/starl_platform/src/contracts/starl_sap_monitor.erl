%% @doc The contract of the SAP, the reliable message service, as a monitor.
%%
%% Safety: a message is delivered at most once per receiver, over all restarts; only if it was
%% sent, to an addressee, with the type and content with which it was sent. A message is reported
%% acknowledged only if it was delivered to that destination. Each destination gets one outcome,
%% within `bound_us' of sending. A message reported lost may still have been delivered, or be
%% delivered later. When the sender's SAP restarts or its robot dies, the open outcomes are
%% not expected any more; deliveries of those messages are still judged. The source alone keeps
%% time: an outcome may take longer by what the source's own clock, pauses and slowness explain while
%% the message is under way ({@link starl_assumption:delayed_us/5}), and by nothing else.
%%
%% Delivered, where packets get through: see {@link starl_sap_monitor_delivery}.
%%
%% Answers: a caller gets the outcome of its message at all destinations, also within `bound_us':
%% `ok' if all have acknowledged, else the destinations at which it was lost.
%%
%% The application: it reads the messages of each type in the order in which they were delivered,
%% leaves none out, and never has more unread messages than it has room for. A type has one
%% listener.
%%
%% Events: of machine `sap', {@link starl_sap:event()} (a recording may give an outcome as `{lost,
%% Reason}', too); of machine `app', `read' and `crashed'; of machine `robot', `died' and `down'
%% (until it restarts). What is kept of messages: {@link starl_sap_monitor_sources}.
-module(starl_sap_monitor).
-behaviour(starl_monitor).

-export([init/1, context/2, broken/2, step/2, finish/2]).
-export([interests/0, vocabulary/0, sometimes/0, timeless/1]).

-record(state, {
    deadlines :: starl_sap_monitor_deadlines:t(),
    delivery :: starl_sap_monitor_delivery:t(),
    sources = starl_sap_monitor_sources:new() :: starl_sap_monitor_sources:t(),
    %% The incarnation that each source has announced.
    running = #{} :: #{starl_monitor:robot_id() => term()},
    unread = starl_sap_monitor_unread:new() :: starl_sap_monitor_unread:t(),
    room :: non_neg_integer(),
    is_alone :: boolean(),
    counts = {0, 0, 0, 0} :: {integer(), integer(), integer(), integer()}
}).

%% The largest number of unread messages that an application and its SAP keep.
-define(ROOM, 1256).

%% @doc `bound_us': the longest time from sending to the last outcome; `steps' (default 17): the most
%% events that the source handles for it; `broken': the windows of broken assumptions; `late_us' (default one
%% minute): the time for which the content of a lost message is remembered; `robots': the team;
%% `room': the largest number of unread messages of an application.
-spec init(#{
    bound_us := pos_integer(),
    steps => pos_integer(),
    broken => [starl_assumption:window()],
    late_us => non_neg_integer(),
    robots => [starl_monitor:robot_id()],
    room => non_neg_integer()
}) -> #state{}.
init(Config) ->
    #state{
        deadlines = starl_sap_monitor_deadlines:new(Config),
        delivery = starl_sap_monitor_delivery:new(Config),
        room = maps:get(room, Config, ?ROOM),
        is_alone = length(maps:get(robots, Config, [])) < 2
    }.

%% @doc The configuration with the windows of broken assumptions and of faults, and with the luck of messages; the
%% bound is longer on a computer that has other work, too.
-spec context(starl_monitor:known(), map()) -> map().
context(#{broken := Broken, slack_us := Slack} = Known, #{bound_us := Bound} = Config) ->
    maps:merge(
        maps:merge(#{broken => Broken}, luck(Known)), Config#{bound_us := Bound + Slack}
    ).

%% The network of a run in real time may lose anything. Of the time of all transmissions a clock that is 1 % fast
%% leaves a little less.
luck(#{slack_us := Slack}) when Slack > 0 ->
    off("a network in real time may lose any packet");
luck(#{loss := Loss, sap := Sap, faults := Faults} = Known) ->
    case starl_monitor:healed_us([network], Known) of
        never ->
            off("range, walls or shadows may take any packet");
        _Us ->
            Tries = starl_sap_schedule:tries(Sap),
            Unanswered = 1 - math:pow(1 - Loss, 2),
            Unasked = 1 - math:pow(1 - Loss, 3),
            #{
                unlucky => math:pow(Unanswered, Tries),
                first => unlucky_first(Unasked, Unanswered, Tries),
                whole_us => starl_sap_schedule:bound_us(Sap) * 98 div 100,
                faults => Faults
            }
    end;
luck(_Known) ->
    #{}.

%% The first transmissions ask in vain, and then, or at the end, the others are not acknowledged.
unlucky_first(Unasked, Unanswered, Tries) ->
    lists:sum([
        math:pow(Unasked, Tries)
        | [
            math:pow(Unasked, N - 1) * (1 - Unasked) * math:pow(Unanswered, Tries - N)
         || N <- lists:seq(1, Tries)
        ]
    ]).

off(Why) -> #{unlucky => {off, [{"delivered, where packets get through", Why}]}}.

%% @doc The window excuses what it meets.
-spec broken(starl_assumption:window(), #state{}) -> #state{}.
broken(Window, #state{deadlines = Deadlines, delivery = Delivery} = State) ->
    State#state{
        deadlines = starl_sap_monitor_deadlines:broken(Window, Deadlines),
        delivery = starl_sap_monitor_delivery:broken(Window, Delivery)
    }.

%% @doc The events of the SAP, of the application, and of the end of robots.
-spec interests() -> [atom()].
interests() -> [sap, robot, app].

%% @doc {@link starl_sap:event()}.
-spec vocabulary() -> starl_event:vocabulary().
vocabulary() ->
    #{
        sap => [
            {started, 1},
            {sent, 4},
            {called, 2},
            {answered, 2},
            {overload, 1},
            {outcome, 3},
            {delivered, 3},
            {full, 2},
            {unclaimed_full, 2},
            {unheard, 2},
            {dropped, 2},
            {outlived, 2},
            {listener_refused, 3}
        ]
    }.

%% @doc The outstanding messages, and the numbers of all others.
-spec timeless(#state{}) -> term().
timeless(#state{sources = Sources, running = Running, unread = Unread}) ->
    {Sources, Running, Unread}.

%% @doc Messages that nobody has room for, or listens to, are seldom where applications read.
-spec sometimes() -> [{{atom(), atom()}, seldom}].
sometimes() ->
    [{{sap, Tag}, seldom} || Tag <- [overload, full, unclaimed_full, unheard, listener_refused]].

%% @doc Judges one event.
-spec step(starl_monitor:trace_event(), #state{}) ->
    {ok, #state{}} | {violation, starl_monitor:violation(), #state{}}.
step({T, _, _, _} = Event, #state{deadlines = Deadlines} = State) ->
    %% Integers sort before the atom infinity.
    case T =< starl_sap_monitor_deadlines:due(Deadlines) of
        true -> judge(Event, State);
        false -> judge_late(Event, State)
    end.

judge_late({T, _, _, _} = Event, State) ->
    {Overdue, Current} = pass(T, State),
    starl_violation:first(Overdue, judge(Event, Current)).

%% @doc Judges the time until `EndTimeUs'. Results: messages `sent' (per destination),
%% `delivered', `acknowledged' and reported `lost', and those `outstanding'.
-spec finish(integer(), #state{}) ->
    {ok | {violation, [starl_monitor:violation(), ...]}, starl_monitor:results()}.
finish(EndTimeUs, State) ->
    {Overdue, #state{sources = Sources, counts = Counts}} = pass(EndTimeUs, State),
    {Sent, Delivered, Acknowledged, Lost} = Counts,
    Off = starl_sap_monitor_delivery:unjudged(EndTimeUs, State#state.delivery),
    Results = starl_unjudged:with(Off, #{
        sent => Sent,
        delivered => Delivered,
        acknowledged => Acknowledged,
        lost => Lost,
        outstanding => starl_sap_monitor_sources:outstanding(Sources)
    }),
    starl_violation:finish(Overdue, Results).

%%% Events

judge({T, Robot, sap, {sent, {Source, _, _} = Id, Dests, Type, Hash}}, State) ->
    case Source =:= Robot of
        true -> sent(T, Id, Dests, Type, Hash, State);
        false -> broken(foreign_source, T, [Robot, Source], #{message => Id}, State)
    end;
judge({T, Robot, sap, {delivered, Id, Type, Hash}}, State) ->
    case starl_sap_monitor_sources:find(Id, State#state.sources) of
        none ->
            handed_on(T, Robot, Id, Type, Hash, delivered_late(T, Robot, Id, State));
        Message ->
            Judged = delivered(T, Robot, Id, Type, Hash, Message, State),
            handed_on(T, Robot, Id, Type, Hash, Judged)
    end;
judge({T, Robot, sap, {outcome, {Source, _, _} = Id, Dest, Outcome}}, State) ->
    case Source =:= Robot of
        true -> in_vain(T, Id, Dest, Outcome, State);
        false -> broken(foreign_source, T, [Robot, Source], #{message => Id}, State)
    end;
judge({T, Robot, sap, {called, Id, How}}, State) ->
    called(T, Robot, Id, How, State);
judge({T, Robot, sap, {answered, Id, Answer}}, State) ->
    answered(T, Robot, Id, Answer, State);
judge({T, Robot, sap, {listener_refused, Type, Machine, Holder}}, State) ->
    Details = #{type => Type, listener => Machine, held_by => Holder},
    broken(two_listeners, T, [Robot], Details, State);
judge({T, Robot, sap, {started, Incarnation}}, #state{running = Running} = State) ->
    Started = State#state{
        running = Running#{Robot => Incarnation},
        delivery = starl_sap_monitor_delivery:begins(T, Robot, State#state.delivery)
    },
    {ok, abandon(T, Robot, Incarnation, unsure(Robot, Started))};
judge({T, Robot, app, {read, Source, Type, Hash}}, State) ->
    read(T, Robot, Source, Type, Hash, State);
judge({_T, Robot, app, crashed}, State) ->
    {ok, unsure(Robot, State)};
judge({T, Robot, sap, {Refuses, Source, _Type}}, #state{delivery = Delivery} = State) when
    Refuses =:= full; Refuses =:= unclaimed_full
->
    {ok, State#state{delivery = starl_sap_monitor_delivery:refuses(T, Robot, Source, Delivery)}};
judge({T, Robot, robot, {died, _Reason}}, State) ->
    {ok, abandon(T, Robot, none, gone(Robot, State))};
judge({T, Robot, robot, down}, State) ->
    {ok, abandon(T, Robot, none, unsure(Robot, gone(Robot, State)))};
judge({_T, _Robot, _Machine, _Other}, State) ->
    {ok, State}.

gone(Robot, #state{delivery = Delivery} = State) ->
    State#state{delivery = starl_sap_monitor_delivery:goes(Robot, Delivery)}.

%% The outcome itself is judged first: what is broken there is told before.
in_vain(T, {Source, _, _} = Id, Dest, Outcome, State) ->
    {Luck, Delivery} = luck(T, Id, Dest, Outcome, State),
    Next = State#state{delivery = Delivery},
    case outcome(T, Id, Dest, kind(Outcome), failed(Id, Dest, Outcome, Next)) of
        {ok, Judged} when Luck =:= in_vain ->
            broken(lost_in_vain, T, [Source, Dest], #{message => Id}, Judged);
        Judged ->
            Judged
    end.

luck(_T, {Source, _, _}, Dest, acknowledged, #state{delivery = Delivery}) ->
    {ok, starl_sap_monitor_delivery:acknowledged(Source, Dest, Delivery)};
luck(T, {Source, _, _} = Id, Dest, lost, #state{delivery = Delivery, sources = Sources}) ->
    case starl_sap_monitor_sources:find(Id, Sources) of
        none ->
            {ok, Delivery};
        Message ->
            SentUs = starl_sap_monitor_message:sent_us(Message),
            starl_sap_monitor_delivery:lost(T, SentUs, Source, Dest, Delivery)
    end;
luck(_T, _Id, _Dest, _Other, #state{delivery = Delivery}) ->
    {ok, Delivery}.

kind(acknowledged) -> acknowledged;
kind(lost) -> lost;
kind(restarted) -> lost;
kind({lost, _Reason}) -> lost.

sent(T, {Source, _, _} = Id, Dests, Type, Hash, #state{sources = Sources} = State) ->
    Message = starl_sap_monitor_message:new(Type, Hash, T, Dests),
    case starl_sap_monitor_sources:add(Id, Message, Sources) of
        {ok, Known} -> {ok, open(T, Id, Dests, Known, State)};
        used -> broken(message_id_used_twice, T, [Source], #{message => Id}, State)
    end.

open(_T, _Id, [], Sources, State) ->
    State#state{sources = Sources};
open(T, Id, Dests, Sources, #state{deadlines = Before} = State) ->
    Deadlines = starl_sap_monitor_deadlines:sent(T, Id, Sources, Before),
    State#state{
        sources = Sources, deadlines = Deadlines, counts = count(1, length(Dests), State)
    }.

delivered(T, Robot, Id, Type, Hash, Message, State) ->
    case starl_sap_monitor_message:compare(Type, Hash, Message) of
        ok ->
            delivered(T, Robot, Id, Message, State);
        corrupted ->
            broken(corrupted, T, [Robot], #{message => Id}, State);
        {wrong_type, Sent} ->
            Details = #{message => Id, sent => Sent, delivered => Type},
            broken(wrong_type, T, [Robot], Details, State)
    end.

delivered(T, Robot, Id, Message, State) ->
    case starl_sap_monitor_message:progress(Robot, Message) of
        waiting -> {ok, progress(T, Id, Message, Robot, delivered, counted(2, State))};
        lost -> {ok, progress(T, Id, Message, Robot, done, counted(2, State))};
        stranger -> broken(delivered_to_stranger, T, [Robot], #{message => Id}, State);
        _Twice -> broken(duplicate_delivery, T, [Robot], #{message => Id}, State)
    end.

%% The message is not outstanding: it was never sent, is closed, or was lost long ago.
delivered_late(T, Robot, Id, #state{sources = Sources} = State) ->
    case starl_sap_monitor_sources:delivered_late(Robot, Id, Sources) of
        unexpected ->
            Was = starl_sap_monitor_sources:was_sent(Id, Sources),
            broken(unexpected(Was), T, [Robot], #{message => Id, closed => Was}, State);
        Left ->
            {ok, counted(2, State#state{sources = Left})}
    end.

unexpected(true) -> duplicate_delivery;
unexpected(false) -> delivered_but_not_sent.

outcome(T, {Source, _, _} = Id, Dest, Kind, #state{sources = Sources} = State) ->
    case starl_sap_monitor_sources:find(Id, Sources) of
        none ->
            stray(closed(Id, State), T, Id, [Source, Dest], State);
        Message ->
            Progress = starl_sap_monitor_message:progress(Dest, Message),
            outcome(T, Id, Message, Progress, Dest, Kind, State)
    end.

outcome(T, Id, Message, delivered, Dest, Kind, State) ->
    {ok, progress(T, Id, Message, Dest, done, counted(column(Kind), State))};
outcome(T, Id, Message, waiting, Dest, lost, State) ->
    {ok, progress(T, Id, Message, Dest, lost, counted(4, State))};
outcome(T, {Source, _, _} = Id, Message, waiting, Dest, acknowledged, State) ->
    Reported = progress(T, Id, Message, Dest, lost, State),
    broken(acknowledged_but_not_delivered, T, [Source, Dest], #{message => Id}, Reported);
outcome(T, {Source, _, _} = Id, _Message, stranger, Dest, _Kind, State) ->
    stray(outcome_for_stranger, T, Id, [Source, Dest], State);
outcome(T, {Source, _, _} = Id, _Message, _Known, Dest, _Kind, State) ->
    stray(outcome_reported_twice, T, Id, [Source, Dest], State).

%% Only failures that a caller must learn of are noted.
failed(_Id, _Dest, acknowledged, State) ->
    State;
failed(Id, Dest, Outcome, #state{sources = Sources} = State) ->
    Fails = fun(Message) -> starl_sap_monitor_message:failed(Dest, why(Outcome), Message) end,
    State#state{sources = starl_sap_monitor_sources:change(Id, Fails, Sources)}.

why(restarted) -> restarted;
why(_Lost) -> lost.

closed(Id, #state{sources = Sources}) ->
    case starl_sap_monitor_sources:was_sent(Id, Sources) of
        true -> outcome_reported_twice;
        false -> outcome_but_not_sent
    end.

%% Outcomes that an earlier incarnation left behind are not judged.
stray(What, T, {Source, Incarnation, _} = Id, Robots, #state{running = Running} = State) ->
    case Running of
        #{Source := Incarnation} -> broken(What, T, Robots, #{message => Id}, State);
        #{Source := _Later} -> {ok, State};
        #{} -> broken(What, T, Robots, #{message => Id}, State)
    end.

broken(What, T, Robots, Details, State) ->
    {violation, violation(What, T, Robots, Details), State}.

violation(What, T, Robots, Details) ->
    starl_violation:new(sap, What, T, Robots, Details).

column(acknowledged) -> 3;
column(lost) -> 4.

counted(Column, State) ->
    State#state{counts = count(Column, 1, State)}.

count(Column, N, #state{counts = Counts}) ->
    setelement(Column, Counts, element(Column, Counts) + N).

%%% Answers

called(T, Robot, {Source, _, _} = Id, How, #state{sources = Sources} = State) ->
    case starl_sap_monitor_sources:find(Id, Sources) of
        Message when Message =/= none, Source =:= Robot ->
            Called = starl_sap_monitor_message:called(How, Message),
            {ok, State#state{sources = starl_sap_monitor_sources:put(Id, Called, Sources)}};
        _ ->
            stray(called_but_not_sent, T, Id, [Robot], State)
    end.

%% Nothing was sent: too much is under way, or the team has no other robot.
answered(_T, _Robot, none, {error, overload}, State) ->
    {ok, State};
answered(_T, _Robot, none, ok, #state{is_alone = true} = State) ->
    {ok, State};
answered(T, Robot, none, Answer, State) ->
    broken(answer_untrue, T, [Robot], #{answer => Answer}, State);
answered(T, Robot, Id, Answer, #state{sources = Sources} = State) ->
    case starl_sap_monitor_sources:find(Id, Sources) of
        none -> stray(answered_nobody, T, Id, [Robot], State);
        Message -> answered(T, Robot, Id, Answer, Message, State)
    end.

answered(T, Robot, Id, Answer, Message, State) ->
    Told = settle(T, Id, starl_sap_monitor_message:answered(Message), State),
    Details = #{message => Id, answer => Answer},
    case starl_sap_monitor_message:due(Message) of
        {answer, Answer} -> {ok, Told};
        {answer, True} -> broken(answer_untrue, T, [Robot], Details#{true => True}, Told);
        too_early -> broken(answered_too_early, T, [Robot], Details, Told);
        not_called -> broken(answered_nobody, T, [Robot], Details, State)
    end.

%%% The application

%% The application must read what is delivered to it. A machine need not.
handed_on(T, Robot, {Source, _, _}, {app, _} = Type, Hash, {ok, #state{unread = All} = State}) ->
    {Count, Unread} = starl_sap_monitor_unread:delivered(Robot, Type, Source, Hash, All),
    Handed = State#state{unread = Unread},
    case Count > State#state.room of
        true -> broken(more_than_it_can_keep, T, [Robot], #{type => Type}, Handed);
        false -> {ok, Handed}
    end;
handed_on(_T, _Robot, _Id, _Type, _Hash, Judged) ->
    Judged.

read(T, Robot, Source, Type, Hash, #state{unread = Unread} = State) ->
    Details = #{type => Type, source => Source},
    case starl_sap_monitor_unread:read(Robot, Type, Source, Hash, Unread) of
        {ok, Left} -> {ok, State#state{unread = Left}};
        skipped -> broken(acknowledged_but_not_readable, T, [Robot], Details, State);
        not_delivered -> broken(read_but_not_delivered, T, [Robot], Details, State)
    end.

unsure(Robot, #state{unread = Unread} = State) ->
    State#state{unread = starl_sap_monitor_unread:crashed(Robot, Unread)}.

%%% Messages

progress(T, Id, Message, Dest, Progress, State) ->
    settle(T, Id, starl_sap_monitor_message:put_progress(Dest, Progress, Message), State).

%% Keeps a message until nothing more can happen to it.
settle(T, Id, Message, #state{sources = Sources} = State) ->
    case starl_sap_monitor_message:phase(Message) of
        done ->
            State#state{sources = starl_sap_monitor_sources:close(Id, Sources)};
        open ->
            State#state{sources = starl_sap_monitor_sources:put(Id, Message, Sources)};
        lost ->
            Known = starl_sap_monitor_sources:put(Id, Message, Sources),
            Deadlines = starl_sap_monitor_deadlines:lost(T, Id, Known, State#state.deadlines),
            State#state{sources = Known, deadlines = Deadlines}
    end.

%% The robot's SAP is gone: outcomes that it has not reported stay open for ever.
abandon(T, Robot, Incarnation, #state{sources = Sources} = State) ->
    Gone = [
        Id
     || {_, Inc, _} = Id <- starl_sap_monitor_sources:outstanding(Robot, Sources),
        Inc =/= Incarnation
    ],
    lists:foldl(fun(Id, S) -> give_up(T, Id, S) end, State, Gone).

give_up(T, Id, #state{sources = Sources} = State) ->
    Message = starl_sap_monitor_sources:find(Id, Sources),
    case starl_sap_monitor_message:phase(Message) of
        lost -> State;
        _Open -> settle(T, Id, starl_sap_monitor_message:give_up(Message), State)
    end.

%%% Time

pass(T, #state{sources = Sources, deadlines = Before} = State) ->
    {Overdue, Stale, Deadlines} = starl_sap_monitor_deadlines:pass(T, Sources, Before),
    Left = lists:foldl(fun starl_sap_monitor_sources:forget/2, Sources, Stale),
    {
        [violation(What, At, Robots, Details) || {What, At, Robots, Details} <- Overdue],
        State#state{sources = Left, deadlines = Deadlines}
    }.
