%% @doc SAP, the reliable message service (the paper's send/receive with acknowledgement).
%%
%% Exchange rules:
%% ```
%%   source                                   receiver
%%     | data {incarnation, seq, low, for} ---->|  new: delivered to the listener of its type
%%     |<----------- ack {incarnation, seq} ----|  seen before: acknowledged only
%%     | (again after a back-off, at most `limit' times, then reported lost)
%%     |<------- refusal {its incarnation} -----|  meant for an earlier incarnation of the receiver
%% '''
%% At most once: the receiver remembers which sequence numbers of a source's incarnation it has
%% taken, down to the source's own `low' mark, so the memory is bounded by the messages that are
%% under way. A message that the receiver's previous incarnation may have taken is refused by
%% the next one and reported lost. A lost report does not say that the message was not
%% delivered. A message whose type has no listener yet waits for one, within bounds; beyond them
%% it is not acknowledged.
%%
%% Calls: `{send, To, Type, Body}' (answer {@link starl:outcome()}), `{broadcast, Type, Body}'
%% (answer `ok', `{error, {lost, Robots}}' or `{error, overload}'): one packet on the air, then
%% again to each that did not acknowledge. Casts: `{send, To, Type, Body}',
%% `{broadcast, Type, Body}' without an answer, `{listen, Type, Machine}'. A listener gets the
%% cast `{message, From, Type, Body}'.
%%
%% Beside the reliable service there is a datagram: the cast `{shout, Type, Body}' puts one packet
%% on the air for all in range. It is not acknowledged or repeated, may arrive twice, and is
%% dropped where nobody listens to its type; the contract of SAP does not cover it. The same
%% packet may be sent to one robot alone ({@link datagram/4}).
%%
%% Trace: `{started, Incarnation}', `{sent, Id, Dests, Type, Hash}', `{delivered, Id, Type, Hash}',
%% `{outcome, Id, Dest, acknowledged | lost | restarted}' with Id = {source, incarnation, seq}.
-module(starl_sap).
-behaviour(starl_machine).

-export([send/4, post/3, shout/2, datagram/4, listen/2, bound_us/1]).
-export([init/1, handle_event/5]).

-export_type([config/0]).

%% `retransmit_ms': the first retransmission's delay; each further one waits `backoff' times
%% longer, at most `longest_ms'; `limit': how many retransmissions; `window': how far sequence
%% numbers under way may lie apart; `unclaimed': how many messages may wait for a listener.
-type config() :: #{
    retransmit_ms => pos_integer(),
    backoff => float(),
    longest_ms => pos_integer(),
    limit => non_neg_integer(),
    window => pos_integer(),
    unclaimed => non_neg_integer()
}.

-type id() :: {starl:robot_id(), starl_packet:incarnation(), starl_packet:seq()}.

%% A message under way: who has not acknowledged, who asked, how often it was sent.
-record(out, {
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

%% What is known of a source of messages: its incarnation, the lowest sequence number that may
%% still come, and those taken from there on, ascending.
-record(peer, {
    incarnation = 1 :: starl_packet:incarnation(),
    low = 1 :: starl_packet:seq(),
    seen = [] :: [starl_packet:seq()]
}).

-record(sap, {
    self :: starl:robot_id(),
    team :: starl_team:t(),
    incarnation :: starl_packet:incarnation(),
    delays :: [pos_integer()],
    window :: pos_integer(),
    unclaimed_limit :: non_neg_integer(),
    next = 1 :: starl_packet:seq(),
    low = 1 :: starl_packet:seq(),
    out = #{} :: #{starl_packet:seq() => #out{}},
    peers = #{} :: #{starl:robot_id() => #peer{}},
    listeners = #{} :: #{atom() => starl_machine:name()},
    unclaimed = [] :: [{starl:robot_id(), atom(), term(), id()}]
}).

%% @doc The action that sends a message; its outcome comes back as the event `{reply, Tag}'.
-spec send(starl:robot_id(), Type :: atom(), Body :: term(), starl_machine:tag()) ->
    starl_machine:action().
send(To, Type, Body, Tag) -> {call, sap, {send, To, Type, Body}, Tag}.

%% @doc The action that sends a message whose outcome nobody waits for.
-spec post(starl:robot_id(), Type :: atom(), Body :: term()) -> starl_machine:action().
post(To, Type, Body) -> {cast, sap, {send, To, Type, Body}}.

%% @doc The action that sends one unacknowledged packet to all in range.
-spec shout(Type :: atom(), Body :: term()) -> starl_machine:action().
shout(Type, Body) -> {cast, sap, {shout, Type, Body}}.

%% @doc The action by which robot `Self' sends one unacknowledged packet to one robot.
-spec datagram(Self :: starl:robot_id(), starl:robot_id(), Type :: atom(), Body :: term()) ->
    starl_machine:action().
datagram(Self, To, Type, Body) -> {transmit, To, starl_packet:shout(Self, Type, Body)}.

%% @doc The action by which a machine listens to messages of a type.
-spec listen(Type :: atom(), starl_machine:name()) -> starl_machine:action().
listen(Type, Machine) -> {cast, sap, {listen, Type, Machine}}.

%% @doc The longest time from sending a message to the report of its outcome, in microseconds
%% of the source's clock.
-spec bound_us(config()) -> integer().
bound_us(Config) -> round(lists:sum(delays(Config))).

-spec init(starl_machine:config()) -> {ready, #sap{}, [starl_machine:action()]}.
init(#{robot := Self, participants := Team, incarnation := Incarnation} = Config) ->
    Sap = #sap{
        self = Self,
        team = Team,
        incarnation = Incarnation,
        delays = delays(Config),
        window = maps:get(window, Config, 4096),
        unclaimed_limit = maps:get(unclaimed, Config, 256)
    },
    Hello = [{transmit, all, starl_packet:hello(Self, Incarnation)} || Incarnation > 1],
    {ready, Sap, [{trace, {started, Incarnation}} | Hello]}.

-spec handle_event(starl_machine:event_type(), term(), ready, #sap{}, starl_machine:meta()) ->
    starl_machine:result().
handle_event(packet, {starl, 1, data, Data}, ready, Sap, _Meta) ->
    receive_data(Data, Sap);
handle_event(packet, {starl, 1, ack, By, Own, Incarnation, Seq}, ready, Sap, _Meta) ->
    Known = heard(By, Own, Sap),
    settle(By, Incarnation, Seq, acknowledged, Known);
handle_event(cast, {send, To, Type, Body}, ready, Sap, _Meta) ->
    send_message([To], Type, Body, none, false, Sap);
handle_event({call, From}, {send, To, Type, Body}, ready, Sap, _Meta) ->
    send_message([To], Type, Body, From, false, Sap);
handle_event({timeout, {retransmit, Seq}}, _, ready, Sap, _Meta) ->
    retransmit(Seq, Sap);
handle_event(cast, {broadcast, Type, Body}, ready, Sap, _Meta) ->
    send_message(others(Sap), Type, Body, none, true, Sap);
handle_event({call, From}, {broadcast, Type, Body}, ready, Sap, _Meta) ->
    send_message(others(Sap), Type, Body, From, true, Sap);
handle_event(packet, {starl, 1, refusal, By, Own, Incarnation, Seq}, ready, Sap, _Meta) ->
    settle(By, Incarnation, Seq, restarted, heard(By, Own, Sap));
handle_event(packet, {starl, 1, hello, By, Own}, ready, Sap, _Meta) ->
    {keep_state, heard(By, Own, Sap)};
handle_event(cast, {shout, Type, Body}, ready, #sap{self = Self}, _Meta) ->
    {keep_state_and_data, [{transmit, all, starl_packet:shout(Self, Type, Body)}]};
handle_event(packet, {starl, 1, shout, Source, Type, Body}, ready, Sap, _Meta) ->
    overhear(Source, Type, Body, Sap);
handle_event(cast, {listen, Type, Machine}, ready, Sap, _Meta) ->
    listener(Type, Machine, Sap);
handle_event(info, {restarted, _}, ready, _Sap, _Meta) ->
    keep_state_and_data;
handle_event(_, _, _, _, _) ->
    unknown_event.

%% -- sending --------------------------------------------------------------------------------

others(#sap{self = Self, team = Team}) -> starl_team:others(Self, Team).

send_message([], _Type, _Body, From, _Broadcast, Sap) ->
    {keep_state, Sap, answer(From, ok)};
send_message([Self], Type, Body, From, _Broadcast, #sap{self = Self} = Sap) ->
    case has_room(Type, Sap) of
        true -> send_own(Type, Body, From, Sap);
        false -> {keep_state, Sap, [{trace, {overload, Type}} | answer(From, {error, overload})]}
    end;
send_message(_Dests, Type, _Body, From, _Broadcast, #sap{next = Next} = Sap) when
    Next - Sap#sap.low >= Sap#sap.window
->
    {keep_state, Sap, [{trace, {overload, Type}} | answer(From, {error, overload})]};
send_message(Dests, Type, Body, From, Broadcast, #sap{next = Seq} = Sap) ->
    Out = #out{
        type = Type, body = Body, waiting = Dests, from = From, broadcast = Broadcast,
        for = incarnations(Dests, Sap#sap.peers)
    },
    Id = {Sap#sap.self, Sap#sap.incarnation, Seq},
    {Actions, Sent} = transmit(Seq, Out, Sap#sap{next = Seq + 1}),
    {keep_state, Sent, [{trace, {sent, Id, Dests, Type, hash(Body)}} | Actions]}.

send_own(Type, Body, From, #sap{self = Self} = Sap) ->
    Id = {Self, Sap#sap.incarnation, Sap#sap.next},
    {Delivered, Actions} = deliver(Self, Type, Body, Id, skip_own(Sap)),
    Sent = [
        {trace, {sent, Id, [Self], Type, hash(Body)}},
        {trace, {outcome, Id, Self, acknowledged}}
    ],
    {keep_state, Delivered, order_loopback(Sent, Actions, answer(From, ok))}.

%% A message to oneself needs no packet; its number is used up at once.
skip_own(#sap{next = Next} = Sap) -> advance_low(Sap#sap{next = Next + 1}).

order_loopback([Sent, Outcome], Delivery, Answer) -> [Sent | Delivery] ++ [Outcome | Answer].

transmit(Seq, #out{tries = Tries, waiting = Waiting} = Out, #sap{out = Outs} = Sap) ->
    #sap{self = Self, incarnation = Incarnation, low = Low} = Sap,
    #out{type = Type, body = Body} = Out,
    For = maps:with(Waiting, Out#out.for),
    Packet = starl_packet:data({Self, Incarnation, Seq, Low, For, Type, Body}),
    Actions = [
        {{timeout, {retransmit, Seq}}, lists:nth(Tries + 1, Sap#sap.delays), again}
        | [{transmit, Dest, Packet} || Dest <- on_air(Out)]
    ],
    {Actions, Sap#sap{out = Outs#{Seq => Out#out{tries = Tries + 1}}}}.

on_air(#out{broadcast = true, tries = 0}) -> [all];
on_air(#out{waiting = Waiting}) -> Waiting.

incarnations([Dest], Peers) ->
    case Peers of
        #{Dest := #peer{incarnation = Incarnation}} when Incarnation > 1 -> #{Dest => Incarnation};
        #{} -> #{}
    end;
incarnations(Dests, Peers) ->
    maps:from_list([
        {Dest, Incarnation}
     || Dest <- Dests,
        #peer{incarnation = Incarnation} <- [maps:get(Dest, Peers, #peer{})],
        Incarnation > 1
    ]).

retransmit(Seq, #sap{out = Outs, delays = Delays} = Sap) ->
    case Outs of
        #{Seq := #out{tries = Tries} = Out} when Tries < length(Delays) ->
            {Actions, Sent} = transmit(Seq, Out, Sap),
            {keep_state, Sent, Actions};
        #{Seq := #out{waiting = Waiting, lost = Lost} = Out} ->
            Id = {Sap#sap.self, Sap#sap.incarnation, Seq},
            Traces = [{trace, {outcome, Id, Dest, lost}} || Dest <- Waiting],
            Done = Out#out{waiting = [], lost = Waiting ++ Lost},
            {Finished, Actions} = finish(Seq, Done, lost, Sap),
            {keep_state, Finished, Traces ++ Actions};
        #{} ->
            keep_state_and_data
    end.

%% The outcome of one message at one receiver is known.
settle(By, Incarnation, Seq, Outcome, #sap{incarnation = Incarnation, out = Outs} = Sap) ->
    case Outs of
        #{Seq := #out{waiting = Waiting, lost = Lost} = Out} ->
            case lists:member(By, Waiting) of
                true ->
                    Rest = Out#out{
                        waiting = lists:delete(By, Waiting),
                        lost = [By || Outcome =/= acknowledged] ++ Lost
                    },
                    Id = {Sap#sap.self, Incarnation, Seq},
                    settled(Seq, Rest, Outcome, {trace, {outcome, Id, By, Outcome}}, Sap);
                false ->
                    {keep_state, Sap}
            end;
        #{} ->
            {keep_state, Sap}
    end;
settle(_By, _Earlier, _Seq, _Outcome, Sap) ->
    {keep_state, Sap}.

settled(Seq, #out{waiting = []} = Out, Outcome, Trace, Sap) ->
    {Finished, Actions} = finish(Seq, Out, Outcome, Sap),
    {keep_state, Finished, [Trace, {{timeout, {retransmit, Seq}}, cancel} | Actions]};
settled(Seq, Out, _Outcome, Trace, #sap{out = Outs} = Sap) ->
    {keep_state, Sap#sap{out = Outs#{Seq := Out}}, [Trace]}.

finish(Seq, #out{from = From} = Out, Outcome, #sap{out = Outs} = Sap) ->
    {advance_low(Sap#sap{out = maps:remove(Seq, Outs)}), answer(From, result(Out, Outcome))}.

result(#out{lost = []}, _) -> ok;
result(#out{broadcast = true, lost = Lost}, _) -> {error, {lost, lists:sort(Lost)}};
result(#out{}, Outcome) -> {error, Outcome}.

answer(none, _) -> [];
answer(From, Result) -> [{reply, From, Result}].

advance_low(#sap{low = Low, next = Next, out = Outs} = Sap) when Low < Next ->
    case Outs of
        #{Low := _} -> Sap;
        #{} -> advance_low(Sap#sap{low = Low + 1})
    end;
advance_low(Sap) ->
    Sap.

%% -- receiving ------------------------------------------------------------------------------

receive_data({Source, Theirs, Seq, _Low, For, _Type, _Body} = Data, Sap) ->
    #sap{self = Self, incarnation = Own} = Sap,
    Meant = maps:get(Self, For, 1),
    #peer{incarnation = Known} = maps:get(Source, Sap#sap.peers, #peer{}),
    if
        Theirs < Known ->
            %% An earlier incarnation of the source; nobody waits for the outcome any more.
            keep_state_and_data;
        Meant =/= Own ->
            Refusal = starl_packet:refusal(Self, Own, Theirs, Seq),
            {keep_state, heard(Source, Theirs, Sap), [{transmit, Source, Refusal}]};
        true ->
            take(Data, heard(Source, Theirs, Sap))
    end.

take({Source, Theirs, Seq, Low, _For, _Type, _Body} = Data, Sap) ->
    #sap{self = Self, incarnation = Own, peers = Peers} = Sap,
    Peer0 = maps:get(Source, Peers, #peer{}),
    Peer = forget_below(Low, Peer0),
    Ack = {transmit, Source, starl_packet:ack(Self, Own, Theirs, Seq)},
    case Seq < Peer#peer.low orelse lists:member(Seq, Peer#peer.seen) of
        true ->
            {keep_state, Sap#sap{peers = Peers#{Source => Peer}}, [Ack]};
        false ->
            Taken = Peer#peer{seen = lists:merge([Seq], Peer#peer.seen)},
            take_new(Data, Ack, Sap, Sap#sap{peers = Peers#{Source => Taken}})
    end.

take_new({Source, Theirs, Seq, _Low, _For, Type, Body}, Ack, Before, Sap) ->
    case has_room(Type, Sap) of
        false ->
            {keep_state, Before, [{trace, {unclaimed_full, Source, Type}}]};
        true ->
            {Delivered, Actions} = deliver(Source, Type, Body, {Source, Theirs, Seq}, Sap),
            {keep_state, Delivered, [Ack | Actions]}
    end.

%% The source waits for nothing below Low any more.
forget_below(Low, #peer{low = Known} = Peer) when Low =< Known -> Peer;
forget_below(Low, #peer{seen = Seen} = Peer) ->
    Peer#peer{low = Low, seen = lists:dropwhile(fun(Seq) -> Seq < Low end, Seen)}.

%% Is there a listener, or room to wait for one?
has_room(Type, #sap{listeners = Listeners, unclaimed = Unclaimed, unclaimed_limit = Limit}) ->
    is_map_key(Type, Listeners) orelse length(Unclaimed) < Limit.

deliver(Source, Type, Body, Id, #sap{listeners = Listeners} = Sap) ->
    case Listeners of
        #{Type := Machine} ->
            {Sap, [
                {trace, {delivered, Id, Type, hash(Body)}},
                {cast, Machine, {message, Source, Type, Body}}
            ]};
        #{} ->
            {Sap#sap{unclaimed = [{Source, Type, Body, Id} | Sap#sap.unclaimed]}, [
                {trace, {delivered, Id, Type, hash(Body)}}
            ]}
    end.

overhear(Source, Type, Body, #sap{listeners = Listeners}) ->
    case Listeners of
        #{Type := Machine} ->
            {keep_state_and_data, [{cast, Machine, {message, Source, Type, Body}}]};
        #{} ->
            {keep_state_and_data, [{trace, {unheard, Source, Type}}]}
    end.

listener(Type, Machine, #sap{listeners = Listeners, unclaimed = Unclaimed} = Sap) ->
    {Mine, Rest} = lists:partition(fun({_, T, _, _}) -> T =:= Type end, Unclaimed),
    Messages = [
        {cast, Machine, {message, Source, Type, Body}}
     || {Source, _, Body, _} <- lists:reverse(Mine)
    ],
    {keep_state, Sap#sap{listeners = Listeners#{Type => Machine}, unclaimed = Rest}, Messages}.

%% Learns a peer's incarnation from any of its packets.
heard(Robot, Incarnation, #sap{peers = Peers} = Sap) ->
    case maps:get(Robot, Peers, #peer{}) of
        #peer{incarnation = Known} when Incarnation > Known ->
            Sap#sap{peers = Peers#{Robot => #peer{incarnation = Incarnation}}};
        #peer{} ->
            Sap
    end.

%% -- configuration --------------------------------------------------------------------------

%% The waiting times after each transmission, in microseconds.
delays(Config) ->
    First = maps:get(retransmit_ms, Config, 250) * 1000,
    Longest = maps:get(longest_ms, Config, 2000) * 1000,
    Backoff = maps:get(backoff, Config, 1.5),
    delays(First, Backoff, max(First, Longest), maps:get(limit, Config, 15) + 1).

-spec delays(pos_integer(), float(), pos_integer(), non_neg_integer()) -> [pos_integer()].
delays(_Us, _Backoff, _Longest, 0) -> [];
delays(Us, Backoff, Longest, N) ->
    [Us | delays(min(round(Us * Backoff), Longest), Backoff, Longest, N - 1)].

hash(Body) -> erlang:phash2(Body).
