%% @doc Keeps the messages of a robot that are under way. It numbers them, retransmits them until
%% they are acknowledged, and reports their outcome. Pure; a part of {@link starl_sap}.
%%
%% A message has a sequence number, which is never used twice in an incarnation. It also has a
%% number among the messages to its receiver, or among the broadcasts. The numbers under way to one
%% robot lie within a window. A robot whose window is used up gets no further messages, so a dead
%% robot holds up no other.
-module(starl_sap_out).

-export([new/4, send/4, broadcast/4, send_own/4, retransmit/2, late/2, settle/5, lows/2, answer/3]).

-export_type([t/0, id/0, content/0, latest/0]).

-type id() :: {starl:robot_id(), starl_packet:incarnation(), starl_packet:seq()}.

-type content() :: {starl_packet:type(), Body :: term(), latest()}.

%% The last moment, by the robot's own clock, at which the message may leave, the first time or again.
-type latest() :: Us :: integer() | infinity.

-type incarnations() :: #{starl:robot_id() => starl_packet:incarnation()}.

%% A message under way: the robots that have not acknowledged, the caller, the number of tries.
-record(message, {
    number :: starl_packet:numbering(),
    type :: starl_packet:type(),
    body :: term(),
    waiting :: [starl:robot_id()],
    %% the receivers' incarnations when it was first sent: a later incarnation must not take a
    %% retransmission, since the earlier one may have delivered the message
    for :: incarnations(),
    lost = [] :: [starl:robot_id()],
    latest :: latest(),
    from :: starl_machine:from() | none,
    tries = 0 :: non_neg_integer()
}).

%% The numbers under way to one robot, ascending.
-record(link, {
    next = 1 :: starl_packet:seq(),
    ones = [] :: [starl_packet:seq()],
    casts = [] :: [starl_packet:seq()]
}).

-record(out, {
    self :: starl:robot_id(),
    incarnation :: starl_packet:incarnation(),
    delays :: [pos_integer()],
    window :: pos_integer(),
    %% the next message's sequence number, the next broadcast's number
    next = 1 :: starl_packet:seq(),
    cast = 1 :: starl_packet:seq(),
    links = #{} :: #{starl:robot_id() => #link{}},
    messages = #{} :: #{starl_packet:seq() => #message{}}
}).

-opaque t() :: #out{}.

%% @doc No messages are under way. `Delays': the waiting times after each transmission, in
%% microseconds; `Window': the largest distance of the numbers under way to one robot.
-spec new(
    starl:robot_id(),
    starl_packet:incarnation(),
    DelaysUs :: [pos_integer()],
    Window :: pos_integer()
) -> t().
new(Self, Incarnation, Delays, Window) ->
    #out{self = Self, incarnation = Incarnation, delays = Delays, window = Window}.

%% @doc Sends a message to another robot, unless its window is used up. `For': its incarnation, if
%% it has restarted.
-spec send(
    {starl:robot_id(), content()}, starl_machine:from() | none, For :: incarnations(), t()
) -> {[starl_machine:action()], t()} | full.
send({Dest, Content}, From, For, #out{links = Links, window = Window} = Out) ->
    case maps:get(Dest, Links, #link{}) of
        #link{next = Number, ones = [Low | _]} when Number - Low >= Window ->
            full;
        #link{next = Number, ones = Ones} = Link ->
            Open = Link#link{next = Number + 1, ones = Ones ++ [Number]},
            Message = message(Number, Content, [Dest], From, For),
            send(Message, [Dest], Out#out{links = Links#{Dest => Open}})
    end.

%% @doc Sends a message to many robots, in one packet at first. It is lost at once at the robots
%% whose window is used up; if all windows are, it is not sent.
-spec broadcast(
    {[starl:robot_id(), ...], content()}, starl_machine:from() | none, For :: incarnations(), t()
) -> {[starl_machine:action()], t()} | full.
broadcast({Dests, Content}, From, For, #out{cast = Number} = Out) ->
    case lists:partition(fun(Dest) -> has_room(Dest, Out) end, Dests) of
        {[], _} ->
            full;
        {Ready, Full} ->
            Links = lists:foldl(fun(D, L) -> cast(Number, D, L) end, Out#out.links, Ready),
            Message = message({all, Number}, Content, Ready, From, For),
            Traces = [{trace, {outcome, id(Out#out.next, Out), Dest, lost}} || Dest <- Full],
            {Actions, Sent} = send(
                Message#message{lost = Full}, Dests, Out#out{cast = Number + 1, links = Links}
            ),
            {Actions ++ Traces, Sent}
    end.

has_room(Dest, #out{cast = Number, links = Links, window = Window}) ->
    case Links of
        #{Dest := #link{casts = [Low | _]}} -> Number - Low < Window;
        #{} -> true
    end.

cast(Number, Dest, Links) ->
    #link{casts = Casts} = Link = maps:get(Dest, Links, #link{}),
    Links#{Dest => Link#link{casts = Casts ++ [Number]}}.

message(Number, {Type, Body, Latest}, Waiting, From, For) ->
    #message{
        number = Number,
        type = Type,
        body = Body,
        waiting = Waiting,
        latest = Latest,
        from = From,
        for = For
    }.

send(#message{type = Type, body = Body, from = From} = Message, Dests, #out{next = Seq} = Out) ->
    {Actions, Sent} = transmit(Seq, Message, Seq + 1, Out),
    Id = id(Seq, Out),
    Called = called(From, Id, how(Message)),
    {[{trace, {sent, Id, Dests, Type, erlang:phash2(Body)}} | Called ++ Actions], Sent}.

how(#message{number = {all, _}}) -> all;
how(#message{}) -> one.

%% @doc Sends a message to the robot itself, without a packet and without a number. Returns the
%% actions before its delivery, and those after it.
-spec send_own(starl_packet:type(), Body :: term(), starl_machine:from() | none, t()) ->
    {id(), Before :: [starl_machine:action()], After :: [starl_machine:action()], t()}.
send_own(Type, Body, From, #out{self = Self, next = Seq} = Out) ->
    Id = id(Seq, Out),
    Sent = {trace, {sent, Id, [Self], Type, erlang:phash2(Body)}},
    After = [{trace, {outcome, Id, Self, acknowledged}} | answer(From, Id, ok)],
    {Id, [Sent | called(From, Id, one)], After, Out#out{next = Seq + 1}}.

transmit(Seq, #message{tries = Tries, waiting = Waiting} = Message, Next, Out) ->
    #out{self = Self, incarnation = Incarnation, messages = Messages} = Out,
    #message{number = Number, type = Type, body = Body, for = For, latest = Latest} = Message,
    Meant = maps:with(Waiting, For),
    Packet = starl_packet:data({Self, Incarnation, Seq, Number, Meant, Type, Body}),
    Actions = [
        {{timeout, {retransmit, Seq}}, lists:nth(Tries + 1, Out#out.delays), again}
        | leaves(Latest, Seq, [{transmit, Dest, Packet} || Dest <- on_air(Message)])
    ],
    Tried = Messages#{Seq => Message#message{tries = Tries + 1}},
    {Actions, Out#out{next = Next, messages = Tried}}.

leaves(infinity, _Seq, Packets) -> Packets;
leaves(Latest, Seq, Packets) -> [{until, Latest, Packets, {retransmit, Seq}}].

on_air(#message{number = {all, _}, tries = 0}) -> [all];
on_air(#message{waiting = Waiting}) -> Waiting.

%% @doc Sends a message again when its time has come, or reports it lost.
-spec retransmit(starl_packet:seq(), t()) -> {[starl_machine:action()], t()} | none.
retransmit(Seq, #out{messages = Messages, delays = Delays, next = Next} = Out) ->
    case Messages of
        #{Seq := #message{tries = Tries} = Message} when Tries < length(Delays) ->
            transmit(Seq, Message, Next, Out);
        #{Seq := Message} ->
            lost(Seq, Message, Out);
        #{} ->
            none
    end.

%% @doc The latest moment of a message has passed: it is lost where it has not been acknowledged.
-spec late(starl_packet:seq(), t()) -> {[starl_machine:action()], t()} | none.
late(Seq, #out{messages = Messages} = Out) ->
    case Messages of
        #{Seq := Message} ->
            {Actions, Left} = lost(Seq, Message, Out),
            {[{{timeout, {retransmit, Seq}}, cancel} | Actions], Left};
        #{} ->
            none
    end.

lost(Seq, #message{waiting = Waiting, lost = Lost} = Message, Out) ->
    Traces = [{trace, {outcome, id(Seq, Out), Dest, lost}} || Dest <- Waiting],
    Done = Message#message{lost = Waiting ++ Lost},
    {Actions, Finished} = finish(Seq, Done, lost, closed(Waiting, Message, Out)),
    {Traces ++ Actions, Finished}.

%% @doc A robot, in its given incarnation, acknowledges a message, or refuses it after a restart.
%% `none': nobody waits for this; `untrue': the incarnation does not fit.
-spec settle(
    {By :: starl:robot_id(), starl_packet:incarnation()},
    starl_packet:incarnation(),
    starl_packet:seq(),
    acknowledged | restarted,
    t()
) -> {[starl_machine:action()], t()} | none | untrue.
settle({By, Theirs}, Own, Seq, Outcome, #out{incarnation = Own, messages = Sent} = Out) ->
    case Sent of
        #{Seq := #message{waiting = Waiting, for = For} = Message} ->
            Meant = maps:get(By, For, 1) =:= Theirs,
            case lists:member(By, Waiting) of
                true when Meant =:= (Outcome =:= acknowledged) ->
                    settled(By, Seq, Message, Outcome, closed(By, Message, Out));
                true ->
                    untrue;
                false ->
                    none
            end;
        #{} ->
            none
    end;
settle(_By, _Earlier, _Seq, _Outcome, _Out) ->
    none.

settled(By, Seq, #message{waiting = Waiting, lost = Lost} = Message, Outcome, Out) ->
    Trace = {trace, {outcome, id(Seq, Out), By, Outcome}},
    Rest = Message#message{
        waiting = lists:delete(By, Waiting),
        lost = [By || Outcome =/= acknowledged] ++ Lost
    },
    case Rest of
        #message{waiting = []} ->
            {Actions, Finished} = finish(Seq, Rest, Outcome, Out),
            {[Trace, {{timeout, {retransmit, Seq}}, cancel} | Actions], Finished};
        #message{} ->
            {[Trace], Out#out{messages = (Out#out.messages)#{Seq := Rest}}}
    end.

%% Removes the number from those under way to one robot, or to several.
closed([], _Message, Out) ->
    Out;
closed([Dest | Dests], Message, Out) ->
    closed(Dests, Message, closed(Dest, Message, Out));
closed(Dest, #message{number = Number}, #out{links = Links} = Out) ->
    Out#out{links = close(Number, Dest, Links)}.

close({all, Number}, Dest, Links) ->
    #{Dest := #link{casts = Casts} = Link} = Links,
    Links#{Dest := Link#link{casts = lists:delete(Number, Casts)}};
close(Number, Dest, Links) ->
    #{Dest := #link{ones = Ones} = Link} = Links,
    Links#{Dest := Link#link{ones = lists:delete(Number, Ones)}}.

finish(Seq, #message{from = From} = Message, Outcome, #out{messages = Messages} = Out) ->
    Left = Out#out{messages = maps:remove(Seq, Messages)},
    {answer(From, id(Seq, Out), result(Message, Outcome)), Left}.

result(#message{lost = []}, _) -> ok;
result(#message{number = {all, _}, lost = Lost}, _) -> {error, {lost, lists:sort(Lost)}};
result(#message{}, Outcome) -> {error, Outcome}.

%% @doc The lowest numbers that still wait for an acknowledgement of this robot.
-spec lows(starl:robot_id(), t()) -> starl_packet:lows().
lows(Robot, #out{links = Links, cast = Cast}) ->
    #link{next = Next, ones = Ones, casts = Casts} = maps:get(Robot, Links, #link{}),
    {hd(Ones ++ [Next]), hd(Casts ++ [Cast])}.

%% A caller waits for the outcome: an answer is due.
called(none, _Id, _How) -> [];
called(_From, Id, How) -> [{trace, {called, Id, How}}].

%% @doc Answers the caller, if there is one, and traces the answer, which the monitor judges.
-spec answer(starl_machine:from() | none, id() | none, Outcome :: term()) ->
    [starl_machine:action()].
answer(none, _Id, _) -> [];
answer(From, Id, Result) -> [{trace, {answered, Id, Result}}, {reply, From, Result}].

id(Seq, #out{self = Self, incarnation = Incarnation}) -> {Self, Incarnation, Seq}.
