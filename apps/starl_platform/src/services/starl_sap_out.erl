%% @doc The messages of a robot that are under way: numbered, sent again until they are
%% acknowledged, at last reported. Pure; a part of {@link starl_sap}.
%%
%% Numbers go up and are never used twice in an incarnation; every packet carries the lowest that
%% is still under way, so that receivers may forget those below it.
-module(starl_sap_out).

-export([new/4, is_full/1, send/4, send_own/4, retransmit/2, settle/5, answer/2]).

-export_type([t/0, id/0, origin/0]).

-type id() :: {starl:robot_id(), starl_packet:incarnation(), starl_packet:seq()}.

%% Who waits for the outcome, and is it a broadcast, which goes out as one packet at first?
-type origin() :: {starl_machine:from() | none, IsBroadcast :: boolean()}.

%% A message under way: who has not acknowledged, who asked, how often it was sent.
-record(message, {
    type :: atom(),
    body :: term(),
    waiting :: [starl:robot_id()],
    %% the receivers' incarnations when it was first sent: a retransmission must not be taken by a
    %% later one, for the earlier may have delivered it
    for :: #{starl:robot_id() => starl_packet:incarnation()},
    lost = [] :: [starl:robot_id()],
    from :: starl_machine:from() | none,
    broadcast :: boolean(),
    tries = 0 :: non_neg_integer()
}).

-record(out, {
    self :: starl:robot_id(),
    incarnation :: starl_packet:incarnation(),
    delays :: [pos_integer()],
    window :: pos_integer(),
    next = 1 :: starl_packet:seq(),
    low = 1 :: starl_packet:seq(),
    messages = #{} :: #{starl_packet:seq() => #message{}}
}).

-opaque t() :: #out{}.

%% @doc Nothing is under way. The waiting times after each transmission are in microseconds;
%% `Window': how far numbers under way may lie apart.
-spec new(
    starl:robot_id(), starl_packet:incarnation(), DelaysUs :: [pos_integer()],
    Window :: pos_integer()
) -> t().
new(Self, Incarnation, Delays, Window) ->
    #out{self = Self, incarnation = Incarnation, delays = Delays, window = Window}.

%% @doc Is there no number for one more?
-spec is_full(t()) -> boolean().
is_full(#out{next = Next, low = Low, window = Window}) -> Next - Low >= Window.

%% @doc Sends a message to others. `For': the incarnations of those that have restarted.
-spec send(
    {[starl:robot_id(), ...], Type :: atom(), Body :: term()}, origin(),
    For :: #{starl:robot_id() => starl_packet:incarnation()}, t()
) -> {[starl_machine:action()], t()}.
send({Dests, Type, Body}, {From, Broadcast}, For, #out{next = Seq} = Out) ->
    Message = #message{
        type = Type, body = Body, waiting = Dests, from = From, broadcast = Broadcast, for = For
    },
    {Actions, Sent} = transmit(Seq, Message, Seq + 1, Out),
    {[{trace, {sent, id(Seq, Out), Dests, Type, erlang:phash2(Body)}} | Actions], Sent}.

%% @doc Sends a message to oneself, which needs no packet; its number is used up at once. What is
%% to be told before its delivery, and after it.
-spec send_own(Type :: atom(), Body :: term(), starl_machine:from() | none, t()) ->
    {id(), Before :: [starl_machine:action()], After :: [starl_machine:action()], t()}.
send_own(Type, Body, From, #out{self = Self, next = Seq} = Out) ->
    Id = id(Seq, Out),
    Before = [{trace, {sent, Id, [Self], Type, erlang:phash2(Body)}}],
    After = [{trace, {outcome, Id, Self, acknowledged}} | answer(From, ok)],
    {Id, Before, After, advance_low(Out#out{next = Seq + 1})}.

transmit(Seq, #message{tries = Tries, waiting = Waiting} = Message, Next, Out) ->
    #out{self = Self, incarnation = Incarnation, low = Low, messages = Messages} = Out,
    #message{type = Type, body = Body, for = For} = Message,
    Meant = maps:with(Waiting, For),
    Packet = starl_packet:data({Self, Incarnation, Seq, Low, Meant, Type, Body}),
    Actions = [
        {{timeout, {retransmit, Seq}}, lists:nth(Tries + 1, Out#out.delays), again}
        | [{transmit, Dest, Packet} || Dest <- on_air(Message)]
    ],
    Tried = Messages#{Seq => Message#message{tries = Tries + 1}},
    {Actions, Out#out{next = Next, messages = Tried}}.

on_air(#message{broadcast = true, tries = 0}) -> [all];
on_air(#message{waiting = Waiting}) -> Waiting.

%% @doc It is time to send a message again, or to report it lost.
-spec retransmit(starl_packet:seq(), t()) -> {[starl_machine:action()], t()} | none.
retransmit(Seq, #out{messages = Messages, delays = Delays, next = Next} = Out) ->
    case Messages of
        #{Seq := #message{tries = Tries} = Message} when Tries < length(Delays) ->
            transmit(Seq, Message, Next, Out);
        #{Seq := #message{waiting = Waiting, lost = Lost} = Message} ->
            Traces = [{trace, {outcome, id(Seq, Out), Dest, lost}} || Dest <- Waiting],
            Done = Message#message{waiting = [], lost = Waiting ++ Lost},
            {Actions, Finished} = finish(Seq, Done, lost, Out),
            {Traces ++ Actions, Finished};
        #{} ->
            none
    end.

%% @doc The outcome of one message at one receiver is known.
-spec settle(
    By :: starl:robot_id(), starl_packet:incarnation(), starl_packet:seq(),
    acknowledged | restarted, t()
) -> {[starl_machine:action()], t()} | none.
settle(By, Incarnation, Seq, Outcome, #out{incarnation = Incarnation, messages = Sent} = Out) ->
    case Sent of
        #{Seq := #message{waiting = Waiting} = Message} ->
            case lists:member(By, Waiting) of
                true -> settled(By, Seq, Message, Outcome, Out);
                false -> none
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

finish(Seq, #message{from = From} = Message, Outcome, #out{messages = Messages} = Out) ->
    Left = Out#out{messages = maps:remove(Seq, Messages)},
    {answer(From, result(Message, Outcome)), advance_low(Left)}.

result(#message{lost = []}, _) -> ok;
result(#message{broadcast = true, lost = Lost}, _) -> {error, {lost, lists:sort(Lost)}};
result(#message{}, Outcome) -> {error, Outcome}.

%% @doc Tells the outcome to whoever waits for it.
-spec answer(starl_machine:from() | none, Outcome :: term()) -> [starl_machine:action()].
answer(none, _) -> [];
answer(From, Result) -> [{reply, From, Result}].

advance_low(#out{low = Low, next = Next, messages = Messages} = Out) ->
    case lowest(Low, Next, Messages) of
        Low -> Out;
        Higher -> Out#out{low = Higher}
    end.

lowest(Low, Next, Messages) when Low < Next, not is_map_key(Low, Messages) ->
    lowest(Low + 1, Next, Messages);
lowest(Low, _Next, _Messages) ->
    Low.

id(Seq, #out{self = Self, incarnation = Incarnation}) -> {Self, Incarnation, Seq}.
