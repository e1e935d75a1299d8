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
%% Answers: a caller is told the outcome of its message at all destinations, also within
%% `bound_us': `ok' if all have acknowledged, else the destinations at which it was lost.
%%
%% The application: it reads the messages of each type in the order in which they were delivered,
%% leaves none out, and never has more unread messages than it has room for. A type has one
%% listener.
%%
%% Events: of machine `sap', {@link starl_sap:event()} (a recording may give an outcome as `{lost,
%% Reason}', too); of machine `app', `read' and `crashed'; of machine `robot', `died' and `down'
%% (until it starts anew).
%%
%% Memory: one entry per outstanding message. An undelivered message whose outcomes are
%% all known stays outstanding for another `late_us'; then only its sequence number is kept, in
%% interval sets per (receiver, source, incarnation), and a later delivery is accepted
%% without a check of its content. Delivered messages leave nothing but an interval of sent
%% sequence numbers per incarnation; a second delivery of one of those counts as a duplicate, even
%% if the receiver was no addressee.
-module(starl_sap_monitor).
-behaviour(starl_monitor).

-export([
    init/1,
    context/2,
    broken/2,
    step/2,
    finish/2,
    interests/0,
    vocabulary/0,
    sometimes/0,
    timeless/1
]).

-record(state, {
    bound_us :: pos_integer(),
    steps :: pos_integer(),
    assumption :: starl_assumption:t(),
    late_us :: non_neg_integer(),
    %% The next time at which the head of an alarm queue is due.
    due = infinity :: integer() | infinity,
    sources = starl_sap_monitor_sources:new() :: starl_sap_monitor_sources:t(),
    %% The incarnation that each source has announced.
    running = #{} :: #{starl_monitor:robot_id() => term()},
    %% The numbers of messages that were lost, not delivered, and then forgotten.
    forgotten = #{} :: #{
        {Receiver :: starl_monitor:robot_id(), starl_monitor:robot_id(), Incarnation :: term()} =>
            starl_sap_numbers:t()
    },
    overdue = starl_sap_monitor_alarms:new() :: starl_sap_monitor_alarms:t(),
    %% messages past the bound whose sources have an excuse: until when, and the bound's end; ordered
    excused = [] :: [{UntilUs :: integer(), DueUs :: integer(), starl_sap_monitor_sources:id()}],
    stale = starl_sap_monitor_alarms:new() :: starl_sap_monitor_alarms:t(),
    unread = #{} :: #{starl_monitor:robot_id() => starl_sap_monitor_unread:t()},
    room :: non_neg_integer(),
    is_alone :: boolean(),
    counts = {0, 0, 0, 0} :: {integer(), integer(), integer(), integer()}
}).

-define(LATE_US, 60_000_000).
%% One step for each of the 16 transmissions, and one for the report.
-define(STEPS, 17).
%% Clocks are within 1 % of real time.
-define(DRIFT_PPM, 10_000).
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
init(#{bound_us := Bound} = Config) ->
    #state{
        bound_us = Bound,
        steps = maps:get(steps, Config, ?STEPS),
        assumption = starl_assumption:new(maps:get(broken, Config, []), ?DRIFT_PPM),
        late_us = maps:get(late_us, Config, ?LATE_US),
        room = maps:get(room, Config, ?ROOM),
        is_alone = length(maps:get(robots, Config, [])) < 2
    }.

%% @doc The configuration with the windows of broken assumptions; the bound is longer on a computer
%% that has other work, too.
-spec context(starl_monitor:known(), map()) -> map().
context(#{broken := Broken, slack_us := Slack}, #{bound_us := Bound} = Config) ->
    maps:merge(#{broken => Broken}, Config#{bound_us := Bound + Slack}).

%% @doc The window excuses what it meets.
-spec broken(starl_assumption:window(), #state{}) -> #state{}.
broken(Window, #state{assumption = Assumption} = State) ->
    State#state{assumption = starl_assumption:broken(Window, Assumption)}.

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
timeless(#state{sources = Sources, running = Running} = State) ->
    {Sources, Running, State#state.forgotten, State#state.unread}.

%% @doc Messages that nobody has room for, or listens to, are seldom where applications read.
-spec sometimes() -> [{{atom(), atom()}, seldom}].
sometimes() ->
    [{{sap, Tag}, seldom} || Tag <- [overload, full, unclaimed_full, unheard, listener_refused]].

%% @doc Judges one event.
-spec step(starl_monitor:trace_event(), #state{}) ->
    {ok, #state{}} | {violation, starl_monitor:violation(), #state{}}.
step({T, _, _, _} = Event, #state{due = Due} = State) when T =< Due ->
    %% Integers sort before the atom infinity.
    judge(Event, State);
step({T, _, _, _} = Event, State) ->
    case pass(T, State) of
        {[], Current} -> judge(Event, Current);
        {[First | _], Current} -> first(First, judge(Event, Current))
    end.

%% @doc Judges the time until `EndTimeUs'. Results: messages `sent' (per destination),
%% `delivered', `acknowledged' and reported `lost', and those `outstanding'.
-spec finish(integer(), #state{}) ->
    {ok | {violation, [starl_monitor:violation(), ...]}, starl_monitor:results()}.
finish(EndTimeUs, State) ->
    {Overdue, #state{sources = Sources, counts = Counts}} = pass(EndTimeUs, State),
    {Sent, Delivered, Acknowledged, Lost} = Counts,
    Results = #{
        sent => Sent,
        delivered => Delivered,
        acknowledged => Acknowledged,
        lost => Lost,
        outstanding => starl_sap_monitor_sources:outstanding(Sources)
    },
    {verdict(Overdue), Results}.

verdict([]) -> ok;
verdict(Violations) -> {violation, Violations}.

%% One event gives one violation: an overdue message comes first.
first(Violation, {ok, State}) -> {violation, Violation, State};
first(Violation, {violation, _Second, State}) -> {violation, Violation, State}.

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
        true -> outcome(T, Id, Dest, kind(Outcome), failed(Id, Dest, Outcome, State));
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
    Started = State#state{running = Running#{Robot => Incarnation}},
    {ok, abandon(T, Robot, Incarnation, unsure(Robot, Started))};
judge({T, Robot, app, {read, Source, Type, Hash}}, State) ->
    read(T, Robot, Source, Type, Hash, State);
judge({_T, Robot, app, crashed}, State) ->
    {ok, unsure(Robot, State)};
judge({T, Robot, robot, {died, _Reason}}, State) ->
    {ok, abandon(T, Robot, none, State)};
judge({T, Robot, robot, down}, State) ->
    {ok, abandon(T, Robot, none, unsure(Robot, State))};
judge({_T, _Robot, _Machine, _Other}, State) ->
    {ok, State}.

kind(acknowledged) -> acknowledged;
kind(lost) -> lost;
kind(restarted) -> lost;
kind({lost, _Reason}) -> lost.

sent(T, {Source, _, _} = Id, Dests, Type, Hash, #state{sources = Sources} = State) ->
    case starl_sap_monitor_sources:add(Id, message(T, Dests, Type, Hash), Sources) of
        {ok, Known} -> {ok, open(T, Id, Dests, Known, State)};
        used -> broken(message_id_used_twice, T, [Source], #{message => Id}, State)
    end.

message(_T, [], _Type, _Hash) -> none;
message(T, Dests, Type, Hash) -> starl_sap_monitor_message:new(Type, Hash, T, Dests).

open(_T, _Id, [], Sources, State) ->
    State#state{sources = Sources};
open(T, Id, Dests, Sources, #state{overdue = Overdue, bound_us = Bound} = State) ->
    Due = T + Bound,
    State#state{
        sources = Sources,
        overdue = starl_sap_monitor_alarms:push(Due, Id, Sources, Overdue),
        due = min(Due, State#state.due),
        counts = count(1, length(Dests), State)
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
delivered_late(T, Robot, {Source, Incarnation, Seq} = Id, State) ->
    #state{sources = Sources, forgotten = Forgotten} = State,
    Key = {Robot, Source, Incarnation},
    case starl_sap_numbers:remove(Seq, maps:get(Key, Forgotten, starl_sap_numbers:new())) of
        absent ->
            Was = starl_sap_monitor_sources:was_sent(Id, Sources),
            broken(unexpected(Was), T, [Robot], #{message => Id, closed => Was}, State);
        Left ->
            {ok, counted(2, State#state{forgotten = put_left(Key, Left, Forgotten)})}
    end.

put_left(Key, Left, Forgotten) ->
    case starl_sap_numbers:is_empty(Left) of
        true -> maps:remove(Key, Forgotten);
        false -> Forgotten#{Key := Left}
    end.

unexpected(true) -> duplicate_delivery;
unexpected(false) -> delivered_but_not_sent.

outcome(T, {Source, _, _} = Id, Dest, Kind, #state{sources = Sources} = State) ->
    case starl_sap_monitor_sources:find(Id, Sources) of
        none ->
            stray(closed(Id, State), T, Id, [Source, Dest], State);
        Message ->
            outcome(
                T, Id, Message, starl_sap_monitor_message:progress(Dest, Message), Dest, Kind, State
            )
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
    case starl_sap_monitor_sources:find(Id, Sources) of
        none ->
            State;
        Message ->
            Failed = starl_sap_monitor_message:failed(Dest, why(Outcome), Message),
            State#state{sources = starl_sap_monitor_sources:put(Id, Failed, Sources)}
    end.

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
    #{contract => sap, what => What, at_us => T, robots => Robots, details => Details}.

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
handed_on(T, Robot, {Source, _, _}, {app, _} = Type, Hash, {ok, State}) ->
    Unread = starl_sap_monitor_unread:delivered(Type, Source, Hash, unread(Robot, State)),
    Handed = put_unread(Robot, Unread, State),
    case starl_sap_monitor_unread:count(Unread) > State#state.room of
        true -> broken(more_than_it_can_keep, T, [Robot], #{type => Type}, Handed);
        false -> {ok, Handed}
    end;
handed_on(_T, _Robot, _Id, _Type, _Hash, Judged) ->
    Judged.

read(T, Robot, Source, Type, Hash, State) ->
    Details = #{type => Type, source => Source},
    case starl_sap_monitor_unread:read(Type, Source, Hash, unread(Robot, State)) of
        {ok, Left} -> {ok, put_unread(Robot, Left, State)};
        skipped -> broken(acknowledged_but_not_readable, T, [Robot], Details, State);
        not_delivered -> broken(read_but_not_delivered, T, [Robot], Details, State)
    end.

unsure(Robot, #state{unread = All} = State) ->
    case All of
        #{Robot := Unread} -> put_unread(Robot, starl_sap_monitor_unread:crashed(Unread), State);
        #{} -> State
    end.

unread(Robot, #state{unread = Unread}) -> maps:get(Robot, Unread, starl_sap_monitor_unread:new()).

put_unread(Robot, Left, #state{unread = Unread} = State) ->
    State#state{unread = Unread#{Robot => Left}}.

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
            remember(T, Id, State#state{
                sources = starl_sap_monitor_sources:put(Id, Message, Sources)
            })
    end.

remember(T, Id, #state{late_us = Late, sources = Sources} = State) ->
    Due = T + Late,
    State#state{
        stale = starl_sap_monitor_alarms:push(Due, Id, Sources, State#state.stale),
        due = min(Due, State#state.due)
    }.

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

%% Raises every alarm that is due before `T' (an alarm due exactly at `T' is still in time).
pass(T, State) ->
    {Overdue, Current} = pass_overdue(T, State, []),
    Forgetful = pass_stale(T, Current),
    #state{overdue = Outcomes, excused = Excused, stale = Stale} = Forgetful,
    Due = lists:min([
        first_until(Excused)
        | [starl_sap_monitor_alarms:due(Alarms) || Alarms <- [Outcomes, Stale]]
    ]),
    {Overdue, Forgetful#state{due = Due}}.

first_until([{Until, _, _} | _]) -> Until;
first_until([]) -> infinity.

%% An excuse is looked at again when it ends: a further window may have come to light meanwhile.
pass_overdue(T, #state{overdue = Overdue, excused = Excused} = State, Found) ->
    case {Excused, starl_sap_monitor_alarms:pop(T, Overdue)} of
        {[{Until, Due, Id} | Left], _} when Until < T ->
            pass_alarm(T, Due, Id, State#state{excused = Left}, Found);
        {_, {{Due, Id}, Queue}} ->
            pass_alarm(T, Due, Id, State#state{overdue = Queue}, Found);
        {_, {none, Queue}} ->
            {lists:sort(fun earlier/2, Found), State#state{overdue = Queue}}
    end.

earlier(#{at_us := A}, #{at_us := B}) -> A =< B.

pass_alarm(T, Due, {Source, _, _} = Id, #state{sources = Sources} = State, Found) ->
    #state{bound_us = Bound, steps = Steps, assumption = Assumption} = State,
    case late(Due, Id, Sources) of
        [] ->
            pass_overdue(T, State, Found);
        [Late] ->
            case starl_assumption:delayed_us(Source, Due - Bound, Due, Steps, Assumption) of
                Until when Until < T ->
                    pass_overdue(T, State, [Late#{at_us := Until} | Found]);
                Until ->
                    More = lists:merge([{Until, Due, Id}], State#state.excused),
                    pass_overdue(T, State#state{excused = More}, Found)
            end
    end.

late(Due, {Source, _, _} = Id, Sources) ->
    case starl_sap_monitor_sources:find(Id, Sources) of
        none ->
            [];
        Message ->
            Dests = starl_sap_monitor_message:open(Message),
            overdue(Due, Source, Dests, #{message => Id}, starl_sap_monitor_message:due(Message))
    end.

overdue(Due, Source, [_ | _] = Dests, What, _Answer) ->
    [violation(outcome_overdue, Due, [Source | Dests], What)];
overdue(Due, Source, [], What, {answer, _}) ->
    [violation(answer_overdue, Due, [Source], What)];
overdue(_Due, _Source, [], _What, not_called) ->
    [].

pass_stale(T, #state{stale = Stale} = State) ->
    case starl_sap_monitor_alarms:pop(T, Stale) of
        {none, Queue} -> State#state{stale = Queue};
        {{_Due, Id}, Queue} -> pass_stale(T, forget(Id, State#state{stale = Queue}))
    end.

forget(Id, #state{sources = Sources, forgotten = Forgotten} = State) ->
    case starl_sap_monitor_sources:find(Id, Sources) of
        none ->
            State;
        Message ->
            Lost = starl_sap_monitor_message:lost(Message),
            State#state{
                sources = starl_sap_monitor_sources:close(Id, Sources),
                forgotten = lists:foldl(fun(To, Acc) -> keep(Id, To, Acc) end, Forgotten, Lost)
            }
    end.

keep({Source, Incarnation, Seq}, Dest, Forgotten) ->
    Key = {Dest, Source, Incarnation},
    case starl_sap_numbers:add(Seq, maps:get(Key, Forgotten, starl_sap_numbers:new())) of
        member -> Forgotten;
        More -> Forgotten#{Key => More}
    end.
