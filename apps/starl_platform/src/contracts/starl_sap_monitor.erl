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
%% (until it restarts).
%%
%% What is kept of a message:
%% ```
%%   sent --> open: type, content hash, progress at each destination
%%             |
%%             | all outcomes known and answered
%%             v
%%    all delivered?  -- yes -->  its number, in an interval of sent numbers
%%             | no
%%             v
%%    lost: the same for another `late_us', then its number, for each destination without it
%% '''
%% A later delivery of a forgotten message is accepted without a check of its content. A second delivery
%% of a delivered one counts as a duplicate, even if the receiver was no addressee.
-module(starl_sap_monitor).
-behaviour(starl_monitor).

-export([init/1, context/2, broken/2, step/2, finish/2]).
-export([interests/0, vocabulary/0, sometimes/0, timeless/1]).

-type id() :: {Source :: starl:robot_id(), Incarnation :: term(), Seq :: integer()}.

%% What is known about one destination: nothing, delivered, outcome known, or both.
-type progress() :: waiting | delivered | lost | done.

%% An open call of a message to one robot or to all, with the destinations at which it was lost, and why.
-type call() :: none | {one | all, [{starl:robot_id(), lost | restarted}]}.

%% An outstanding message. `next': when its outcomes are due, by a source without an excuse; reported as
%% overdue; when its content is forgotten.
-record(message, {
    type :: term(),
    hash :: integer(),
    sent_us :: integer(),
    dests :: [{starl:robot_id(), progress()}],
    call = none :: call(),
    next :: {due, integer()} | overdue | {forget, integer()}
}).

%% The numbers that a source has sent in one incarnation, and its outstanding messages. An update of a small
%% map costs a fraction of an update of a large one.
-type life() :: {
    Incarnation :: term(), Sent :: starl_sap_numbers:t(), #{Seq :: integer() => #message{}}
}.

%% The messages that a robot's SAP has delivered and its application has not read: the number of those that
%% are there for certain, and those of each type, in their order. After a crash of the application or of SAP,
%% the messages delivered before may be gone or not.
-record(unread, {
    count = 0 :: non_neg_integer(),
    certain = #{} :: #{Type :: term() => queue:queue(unread())},
    perhaps = [] :: [unread()]
}).

-type unread() :: {Type :: term(), Source :: starl:robot_id(), Hash :: integer()}.

%% What a run does not change; apart, since the state is copied at each event.
-record(limits, {
    bound_us :: pos_integer(),
    steps :: pos_integer(),
    late_us :: non_neg_integer(),
    room :: non_neg_integer(),
    is_alone :: boolean()
}).

-record(state, {
    limits :: #limits{},
    assumption :: starl_assumption:t(),
    delivery :: starl_sap_monitor_delivery:t(),
    %% the lives of each source, latest first
    sources = #{} :: #{starl:robot_id() => [life(), ...]},
    %% the numbers of messages that were lost, not delivered, and then forgotten
    forgotten = #{} :: #{
        {Receiver :: starl:robot_id(), Source :: starl:robot_id(), Incarnation :: term()} =>
            starl_sap_numbers:t()
    },
    %% no message is due, or forgotten, before this
    next_us = infinity :: integer() | infinity,
    %% The incarnation that each source has announced.
    running = #{} :: #{starl:robot_id() => term()},
    unread = #{} :: #{Reader :: starl:robot_id() => #unread{}},
    counts = {0, 0, 0, 0} :: {integer(), integer(), integer(), integer()}
}).

%% One step for each of the 16 transmissions, and one for the report.
-define(STEPS, 17).
-define(LATE_US, 60_000_000).
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
    robots => [starl:robot_id()],
    room => non_neg_integer()
}) -> #state{}.
init(#{bound_us := Bound} = Config) ->
    #state{
        limits = #limits{
            bound_us = Bound,
            steps = maps:get(steps, Config, ?STEPS),
            late_us = maps:get(late_us, Config, ?LATE_US),
            room = maps:get(room, Config, ?ROOM),
            is_alone = length(maps:get(robots, Config, [])) < 2
        },
        assumption = starl_assumption:new(maps:get(broken, Config, []), ?DRIFT_PPM),
        delivery = starl_sap_monitor_delivery:new(Config)
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
broken(Window, #state{assumption = Assumption, delivery = Delivery} = State) ->
    State#state{
        assumption = starl_assumption:broken(Window, Assumption),
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
timeless(#state{sources = Sources, forgotten = Forgotten, running = Running, unread = Unread}) ->
    {Sources, Forgotten, Running, Unread}.

%% @doc Messages that nobody has room for, or listens to, are seldom where applications read.
-spec sometimes() -> [{{atom(), atom()}, seldom}].
sometimes() ->
    [{{sap, Tag}, seldom} || Tag <- [overload, full, unclaimed_full, unheard, listener_refused]].

%% @doc Judges one event.
-spec step(starl_monitor:trace_event(), #state{}) ->
    {ok, #state{}} | {violation, starl_monitor:violation(), #state{}}.
step({T, _, _, _} = Event, #state{next_us = Next} = State) when T =< Next ->
    %% integers sort before the atom infinity
    judge(Event, State);
step({T, _, _, _} = Event, State) ->
    {Overdue, Current} = look_at_all(T, State),
    starl_violation:first(Overdue, judge(Event, Current)).

%% @doc Judges the time until `EndTimeUs'. Results: messages `sent' (per destination),
%% `delivered', `acknowledged' and reported `lost', and those `outstanding'.
-spec finish(integer(), #state{}) ->
    {ok | {violation, [starl_monitor:violation(), ...]}, starl_monitor:results()}.
finish(EndTimeUs, State) ->
    {Overdue, #state{sources = Sources, counts = Counts}} = look_at_all(EndTimeUs, State),
    Open = [map_size(Open) || Lives <- maps:values(Sources), {_, _, Open} <- Lives],
    {Sent, Delivered, Acknowledged, Lost} = Counts,
    Off = starl_sap_monitor_delivery:unjudged(EndTimeUs, State#state.delivery),
    Results = starl_unjudged:with(Off, #{
        sent => Sent,
        delivered => Delivered,
        acknowledged => Acknowledged,
        lost => Lost,
        outstanding => lists:sum(Open)
    }),
    starl_violation:finish(Overdue, Results).

%%% Events

judge({T, Robot, sap, {sent, {Source, _, _} = Id, Dests, Type, Hash}}, State) ->
    case Source =:= Robot of
        true -> sent(T, Id, Dests, Type, Hash, State);
        false -> broken(foreign_source, T, [Robot, Source], #{message => Id}, State)
    end;
judge({T, Robot, sap, {delivered, Id, Type, Hash}}, State) ->
    case find(Id, State) of
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

%% The outcome itself is judged first: what is broken there is reported before.
in_vain(T, {Source, _, _} = Id, Dest, Outcome, State) ->
    {Luck, Next} = luck(T, Id, Dest, Outcome, State),
    case outcome(T, Id, Dest, kind(Outcome), failed(Id, Dest, Outcome, Next)) of
        {ok, Judged} when Luck =:= in_vain ->
            broken(lost_in_vain, T, [Source, Dest], #{message => Id}, Judged);
        Judged ->
            Judged
    end.

luck(T, {Source, _, _} = Id, Dest, Outcome, #state{delivery = Delivery} = State) when
    Outcome =:= acknowledged; Outcome =:= lost
->
    case {find(Id, State), Outcome} of
        {none, _} ->
            {ok, State};
        {#message{sent_us = Us}, acknowledged} ->
            Known = starl_sap_monitor_delivery:acknowledged(Us, Source, Dest, Delivery),
            {ok, State#state{delivery = Known}};
        {#message{sent_us = Us}, lost} ->
            {Luck, Next} = starl_sap_monitor_delivery:lost(T, Us, Source, Dest, Delivery),
            {Luck, State#state{delivery = Next}}
    end;
luck(_T, _Id, _Dest, _Other, State) ->
    {ok, State}.

kind(acknowledged) -> acknowledged;
kind(lost) -> lost;
kind(restarted) -> lost;
kind({lost, _Reason}) -> lost.

sent(T, {Source, Incarnation, Seq} = Id, Dests, Type, Hash, #state{sources = Sources} = State) ->
    {_, Sent, Open} = life(Source, Incarnation, Sources),
    case starl_sap_numbers:add(Seq, Sent) of
        member ->
            broken(message_id_used_twice, T, [Source], #{message => Id}, State);
        Numbers when Dests =:= [] ->
            {ok, put_life(Source, {Incarnation, Numbers, Open}, State)};
        Numbers ->
            #state{limits = #limits{bound_us = Bound}, next_us = Next} = State,
            Message = #message{
                type = Type,
                hash = Hash,
                sent_us = T,
                dests = [{Dest, waiting} || Dest <- Dests],
                next = {due, T + Bound}
            },
            Life = {Incarnation, Numbers, Open#{Seq => Message}},
            {ok,
                put_life(Source, Life, State#state{
                    next_us = min(T + Bound, Next), counts = count(1, length(Dests), State)
                })}
    end.

delivered(T, Robot, Id, Type, Hash, #message{type = Type, hash = Hash} = Message, State) ->
    case progress(Robot, Message) of
        waiting -> {ok, progressed(T, Id, Message, Robot, delivered, counted(2, State))};
        lost -> {ok, progressed(T, Id, Message, Robot, done, counted(2, State))};
        stranger -> broken(delivered_to_stranger, T, [Robot], #{message => Id}, State);
        _Twice -> broken(duplicate_delivery, T, [Robot], #{message => Id}, State)
    end;
delivered(T, Robot, Id, Type, _Hash, #message{type = Type}, State) ->
    broken(corrupted, T, [Robot], #{message => Id}, State);
delivered(T, Robot, Id, Type, _Hash, #message{type = Sent}, State) ->
    Details = #{message => Id, sent => Sent, delivered => Type},
    broken(wrong_type, T, [Robot], Details, State).

%% The message is not outstanding: it was never sent, is closed, or was lost long ago.
delivered_late(T, Robot, {Source, Incarnation, Seq} = Id, #state{forgotten = Forgotten} = State) ->
    Key = {Robot, Source, Incarnation},
    case starl_sap_numbers:remove(Seq, maps:get(Key, Forgotten, starl_sap_numbers:new())) of
        absent ->
            Was = was_sent(Id, State),
            broken(unexpected(Was), T, [Robot], #{message => Id, closed => Was}, State);
        Left ->
            {ok, counted(2, State#state{forgotten = left(Key, Left, Forgotten)})}
    end.

left(Key, Left, Forgotten) ->
    case starl_sap_numbers:is_empty(Left) of
        true -> maps:remove(Key, Forgotten);
        false -> Forgotten#{Key := Left}
    end.

unexpected(true) -> duplicate_delivery;
unexpected(false) -> delivered_but_not_sent.

outcome(T, {Source, _, _} = Id, Dest, Kind, State) ->
    case find(Id, State) of
        none -> stray(closed(Id, State), T, Id, [Source, Dest], State);
        Message -> outcome(T, Id, Message, progress(Dest, Message), Dest, Kind, State)
    end.

outcome(T, Id, Message, delivered, Dest, Kind, State) ->
    {ok, progressed(T, Id, Message, Dest, done, counted(column(Kind), State))};
outcome(T, Id, Message, waiting, Dest, lost, State) ->
    {ok, progressed(T, Id, Message, Dest, lost, counted(4, State))};
outcome(T, {Source, _, _} = Id, Message, waiting, Dest, acknowledged, State) ->
    Reported = progressed(T, Id, Message, Dest, lost, State),
    broken(acknowledged_but_not_delivered, T, [Source, Dest], #{message => Id}, Reported);
outcome(T, {Source, _, _} = Id, _Message, stranger, Dest, _Kind, State) ->
    stray(outcome_for_stranger, T, Id, [Source, Dest], State);
outcome(T, {Source, _, _} = Id, _Message, _Known, Dest, _Kind, State) ->
    stray(outcome_reported_twice, T, Id, [Source, Dest], State).

%% Only failures that a caller must learn of are noted.
failed(_Id, _Dest, acknowledged, State) ->
    State;
failed(Id, Dest, Outcome, State) ->
    case find(Id, State) of
        #message{call = {How, Failed}} = Message ->
            put_message(Id, Message#message{call = {How, [{Dest, why(Outcome)} | Failed]}}, State);
        _NotCalled ->
            State
    end.

why(restarted) -> restarted;
why(_Lost) -> lost.

closed(Id, State) ->
    case was_sent(Id, State) of
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

called(T, Robot, {Source, _, _} = Id, How, State) ->
    case find(Id, State) of
        #message{call = none} = Message when Source =:= Robot ->
            {ok, put_message(Id, Message#message{call = {How, []}}, State)};
        _ ->
            stray(called_but_not_sent, T, Id, [Robot], State)
    end.

%% Nothing was sent: too much is under way, or the team has no other robot.
answered(_T, _Robot, none, {error, overload}, State) ->
    {ok, State};
answered(_T, _Robot, none, ok, #state{limits = #limits{is_alone = true}} = State) ->
    {ok, State};
answered(T, Robot, none, Answer, State) ->
    broken(answer_untrue, T, [Robot], #{answer => Answer}, State);
answered(T, Robot, Id, Answer, State) ->
    case find(Id, State) of
        none -> stray(answered_nobody, T, Id, [Robot], State);
        Message -> answered(T, Robot, Id, Answer, Message, State)
    end.

answered(T, Robot, Id, Answer, Message, State) ->
    Settled = settle(T, Id, Message#message{call = none}, State),
    Details = #{message => Id, answer => Answer},
    case due_answer(Message) of
        {answer, Answer} -> {ok, Settled};
        {answer, True} -> broken(answer_untrue, T, [Robot], Details#{true => True}, Settled);
        too_early -> broken(answered_too_early, T, [Robot], Details, Settled);
        not_called -> broken(answered_nobody, T, [Robot], Details, State)
    end.

%% The answer that the caller must get, unless nobody has called or an outcome is still open.
due_answer(#message{call = none}) ->
    not_called;
due_answer(#message{call = {How, Failed}} = Message) ->
    case open(Message) of
        [] -> {answer, answer(How, lists:sort(Failed))};
        _ -> too_early
    end.

-spec answer(one | all, [{starl:robot_id(), lost | restarted}]) -> starl_sap:answer().
answer(_How, []) -> ok;
answer(one, [{_, Why}]) -> {error, Why};
answer(_All, Failed) -> {error, {lost, [Dest || {Dest, _} <- Failed]}}.

%%% The application

%% The application must read what is delivered to it. A machine need not.
handed_on(T, Robot, {Source, _, _}, {app, _} = Type, Hash, {ok, #state{unread = All} = State}) ->
    #unread{count = Count, certain = Certain} = Unread = maps:get(Robot, All, #unread{}),
    Queue = queue:in({Type, Source, Hash}, maps:get(Type, Certain, queue:new())),
    Longer = Unread#unread{count = Count + 1, certain = Certain#{Type => Queue}},
    Handed = State#state{unread = All#{Robot => Longer}},
    case Count + 1 > State#state.limits#limits.room of
        true -> broken(more_than_it_can_keep, T, [Robot], #{type => Type}, Handed);
        false -> {ok, Handed}
    end;
handed_on(_T, _Robot, _Id, _Type, _Hash, Judged) ->
    Judged.

%% The next message of its type, one from before a crash, another one, or one that was never delivered.
read(T, Robot, Source, Type, Hash, #state{unread = All} = State) ->
    #unread{count = Count, certain = Certain, perhaps = Perhaps} =
        Unread = maps:get(Robot, All, #unread{}),
    Message = {Type, Source, Hash},
    Details = #{type => Type, source => Source},
    case queue:out(maps:get(Type, Certain, queue:new())) of
        {{value, Message}, Rest} ->
            Left = Unread#unread{count = Count - 1, certain = Certain#{Type := Rest}},
            {ok, State#state{unread = All#{Robot => Left}}};
        {Next, _} ->
            case lists:member(Message, Perhaps) of
                true ->
                    Left = Unread#unread{perhaps = lists:delete(Message, Perhaps)},
                    {ok, State#state{unread = All#{Robot => Left}}};
                false ->
                    broken(unreadable(Next), T, [Robot], Details, State)
            end
    end.

unreadable(empty) -> read_but_not_delivered;
unreadable(_Next) -> acknowledged_but_not_readable.

unsure(Robot, #state{unread = All} = State) ->
    case All of
        #{Robot := #unread{certain = Certain, perhaps = Perhaps}} ->
            Delivered = lists:append([queue:to_list(Queue) || Queue <- maps:values(Certain)]),
            State#state{unread = All#{Robot := #unread{perhaps = Delivered ++ Perhaps}}};
        #{} ->
            State
    end.

%%% Messages

progressed(T, Id, #message{dests = Dests} = Message, Dest, Progress, State) ->
    Known = lists:keyreplace(Dest, 1, Dests, {Dest, Progress}),
    settle(T, Id, Message#message{dests = Known}, State).

%% Keeps a message until nothing more can happen to it.
settle(T, Id, Message, #state{limits = #limits{late_us = Late}, next_us = Next} = State) ->
    case {phase(Message), Message#message.next} of
        {done, _} ->
            close(Id, State);
        {lost, {forget, _}} ->
            put_message(Id, Message, State);
        {lost, _} ->
            Lost = Message#message{next = {forget, T + Late}},
            put_message(Id, Lost, State#state{next_us = min(T + Late, Next)});
        {open, _} ->
            put_message(Id, Message, State)
    end.

%% `open': an outcome or the answer is still to come; `lost': only a lost message may still be
%% delivered; `done': nothing more can come.
phase(#message{dests = Dests, call = none}) -> phase(Dests, done);
phase(_Called) -> open.

phase([], Phase) -> Phase;
phase([{_, done} | Dests], Phase) -> phase(Dests, Phase);
phase([{_, lost} | Dests], _Phase) -> phase(Dests, lost);
phase([_Open | _Dests], _Phase) -> open.

%% The progress at a robot; `stranger': the robot is none of the destinations.
progress(Robot, #message{dests = Dests}) ->
    case lists:keyfind(Robot, 1, Dests) of
        {_, Progress} -> Progress;
        false -> stranger
    end.

%% The destinations whose outcome is open.
open(#message{dests = Dests}) -> [Dest || {Dest, P} <- Dests, P =:= waiting orelse P =:= delivered].

%% The robot's SAP is gone: outcomes that it has not reported stay open for ever.
abandon(T, Robot, Incarnation, #state{sources = Sources} = State) ->
    Gone = [
        {{Robot, Inc, Seq}, Message}
     || {Inc, _, Open} <- maps:get(Robot, Sources, []),
        Inc =/= Incarnation,
        {Seq, Message} <- maps:to_list(Open),
        phase(Message) =:= open
    ],
    GiveUp = fun({Id, #message{dests = Dests} = Message}, S) ->
        Given = [{Dest, given_up(Progress)} || {Dest, Progress} <- Dests],
        settle(T, Id, Message#message{dests = Given, call = none}, S)
    end,
    lists:foldl(GiveUp, State, Gone).

given_up(waiting) -> lost;
given_up(delivered) -> done;
given_up(Known) -> Known.

-spec find(id(), #state{}) -> #message{} | none.
find({Source, Incarnation, Seq}, #state{sources = Sources}) ->
    case life(Source, Incarnation, Sources) of
        {_, _, #{Seq := Message}} -> Message;
        {_, _, _} -> none
    end.

put_message({Source, Incarnation, Seq}, Message, #state{sources = Sources} = State) ->
    {_, Sent, Open} = life(Source, Incarnation, Sources),
    put_life(Source, {Incarnation, Sent, Open#{Seq := Message}}, State).

close({Source, Incarnation, Seq}, #state{sources = Sources} = State) ->
    {_, Sent, #{Seq := _} = Open} = life(Source, Incarnation, Sources),
    put_life(Source, {Incarnation, Sent, maps:remove(Seq, Open)}, State).

was_sent({Source, Incarnation, Seq}, #state{sources = Sources}) ->
    {_, Sent, _} = life(Source, Incarnation, Sources),
    starl_sap_numbers:is_member(Seq, Sent).

life(Source, Incarnation, Sources) ->
    case Sources of
        #{Source := [{Incarnation, _, _} = Latest | _]} -> Latest;
        #{Source := Lives} -> among(lists:keyfind(Incarnation, 1, Lives), Incarnation);
        #{} -> among(false, Incarnation)
    end.

among(false, Incarnation) -> {Incarnation, starl_sap_numbers:new(), #{}};
among(Life, _Incarnation) -> Life.

put_life(Source, {Incarnation, _, _} = Life, #state{sources = Sources} = State) ->
    Lives =
        case Sources of
            #{Source := [{Incarnation, _, _} | Earlier]} -> [Life | Earlier];
            #{Source := Known} -> put_among(lists:keymember(Incarnation, 1, Known), Life, Known);
            #{} -> [Life]
        end,
    State#state{sources = Sources#{Source => Lives}}.

put_among(true, {Incarnation, _, _} = Life, Lives) ->
    lists:keyreplace(Incarnation, 1, Lives, Life);
put_among(false, Life, Lives) ->
    [Life | Lives].

%%% Time

%% What is overdue before `T'; what is due exactly then is in time. All outstanding messages are looked at,
%% but seldom: most are closed long before they are due. Their contents are forgotten in batches.
look_at_all(T, #state{sources = Sources} = State) ->
    Outstanding = [
        {{Source, Inc, Seq}, Message}
     || {Source, Lives} <- maps:to_list(Sources),
        {Inc, _, Open} <- Lives,
        {Seq, Message} <- maps:to_list(Open)
    ],
    Look = fun({Id, Message}, Acc) -> look(T, Id, Message, Acc) end,
    {Overdue, Passed} = lists:foldl(Look, {[], State#state{next_us = infinity}}, Outstanding),
    {
        [
            violation(What, At, Robots, #{message => Id})
         || {At, Id, What, Robots} <- lists:sort(fun earlier/2, Overdue)
        ],
        Passed
    }.

%% Of those that are due at the same time the latest message comes first.
earlier({A, Id, _, _}, {B, Other, _, _}) -> {A, Other} =< {B, Id}.

look(T, Id, #message{next = {forget, At}} = Message, {Overdue, State}) when At < T ->
    {Overdue, forget(Id, Message, State)};
look(T, _Id, #message{next = {forget, At}}, {Overdue, #state{limits = Limits} = State}) ->
    {Overdue, sooner(max(At, T + Limits#limits.late_us div 60), State)};
look(T, {Source, _, _} = Id, #message{next = {due, Due}} = Message, {Overdue, State}) when
    Due < T
->
    #state{limits = #limits{steps = Steps}, assumption = Assumption} = State,
    SentUs = Message#message.sent_us,
    case starl_assumption:delayed_us(Source, SentUs, Due, Steps, Assumption) of
        Latest when Latest < T ->
            Reported = put_message(Id, Message#message{next = overdue}, State),
            {[missing(Latest, Id, open(Message)) | Overdue], Reported};
        Latest ->
            {Overdue, sooner(Latest, State)}
    end;
look(_T, _Id, #message{next = {due, Due}}, {Overdue, State}) ->
    {Overdue, sooner(Due, State)};
look(_T, _Id, #message{next = overdue}, Acc) ->
    Acc.

sooner(At, #state{next_us = Next} = State) -> State#state{next_us = min(At, Next)}.

missing(At, {Source, _, _} = Id, []) -> {At, Id, answer_overdue, [Source]};
missing(At, {Source, _, _} = Id, Dests) -> {At, Id, outcome_overdue, [Source | Dests]}.

%% Keeps only its number, for each destination at which it was lost.
forget({Source, Incarnation, Seq} = Id, #message{dests = Dests}, State) ->
    Keep = fun(Dest, Forgotten) ->
        Key = {Dest, Source, Incarnation},
        case starl_sap_numbers:add(Seq, maps:get(Key, Forgotten, starl_sap_numbers:new())) of
            member -> Forgotten;
            More -> Forgotten#{Key => More}
        end
    end,
    Lost = [Dest || {Dest, lost} <- Dests],
    (close(Id, State))#state{forgotten = lists:foldl(Keep, State#state.forgotten, Lost)}.
