%% @doc SAP, the reliable message service (the paper's send/receive with acknowledgement). Here
%% is what packets and requests mean; {@link starl_sap_out} keeps what is under way, {@link
%% starl_sap_peers} what has been taken, {@link starl_sap_inbox} who listens.
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
%% `{outcome, Id, Dest, acknowledged | lost | restarted}' with Id = {source, incarnation, seq};
%% a hash is `erlang:phash2(Body)'.
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

-record(sap, {
    self :: starl:robot_id(),
    team :: starl_team:t(),
    incarnation :: starl_packet:incarnation(),
    out :: starl_sap_out:t(),
    peers = starl_sap_peers:new() :: starl_sap_peers:t(),
    inbox :: starl_sap_inbox:t()
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
        out = starl_sap_out:new(Self, Incarnation, delays(Config), maps:get(window, Config, 4096)),
        inbox = starl_sap_inbox:new(maps:get(unclaimed, Config, 256))
    },
    Hello = [{transmit, all, starl_packet:hello(Self, Incarnation)} || Incarnation > 1],
    {ready, Sap, [{trace, {started, Incarnation}} | Hello]}.

-spec handle_event(starl_machine:event_type(), term(), ready, #sap{}, starl_machine:meta()) ->
    starl_machine:result().
handle_event(packet, {starl, 1, data, Data}, ready, Sap, _Meta) ->
    receive_data(Data, Sap);
handle_event(packet, {starl, 1, ack, By, Own, Incarnation, Seq}, ready, Sap, _Meta) ->
    settle(By, Own, Incarnation, Seq, acknowledged, Sap);
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
    settle(By, Own, Incarnation, Seq, restarted, Sap);
handle_event(packet, {starl, 1, hello, By, Own}, ready, Sap, _Meta) ->
    {keep_state, heard(By, Own, Sap)};
handle_event(cast, {shout, Type, Body}, ready, #sap{self = Self}, _Meta) ->
    {keep_state_and_data, [{transmit, all, starl_packet:shout(Self, Type, Body)}]};
handle_event(packet, {starl, 1, shout, Source, Type, Body}, ready, Sap, _Meta) ->
    {keep_state_and_data, [starl_sap_inbox:overhear(Source, Type, Body, Sap#sap.inbox)]};
handle_event(cast, {listen, Type, Machine}, ready, #sap{inbox = Inbox} = Sap, _Meta) ->
    {Messages, Next} = starl_sap_inbox:listen(Type, Machine, Inbox),
    {keep_state, Sap#sap{inbox = Next}, Messages};
handle_event(info, {restarted, _}, ready, _Sap, _Meta) ->
    keep_state_and_data;
handle_event(_, _, _, _, _) ->
    unknown_event.

%% -- sending --------------------------------------------------------------------------------

others(#sap{self = Self, team = Team}) -> starl_team:others(Self, Team).

send_message([], _Type, _Body, From, _Broadcast, Sap) ->
    {keep_state, Sap, starl_sap_out:answer(From, ok)};
send_message([Self], Type, Body, From, _Broadcast, #sap{self = Self, inbox = Inbox} = Sap) ->
    case starl_sap_inbox:has_room(Type, Inbox) of
        true -> send_own(Type, Body, From, Sap);
        false -> {keep_state, Sap, overload(Type, From)}
    end;
send_message(Dests, Type, Body, From, Broadcast, #sap{out = Out, peers = Peers} = Sap) ->
    case starl_sap_out:is_full(Out) of
        true ->
            {keep_state, Sap, overload(Type, From)};
        false ->
            For = starl_sap_peers:later(Dests, Peers),
            {Actions, Sent} = starl_sap_out:send({Dests, Type, Body}, {From, Broadcast}, For, Out),
            {keep_state, Sap#sap{out = Sent}, Actions}
    end.

overload(Type, From) ->
    [{trace, {overload, Type}} | starl_sap_out:answer(From, {error, overload})].

send_own(Type, Body, From, #sap{self = Self, out = Out, inbox = Inbox} = Sap) ->
    {Id, Before, After, Sent} = starl_sap_out:send_own(Type, Body, From, Out),
    {Actions, Delivered} = starl_sap_inbox:deliver(Self, Type, Body, Id, Inbox),
    {keep_state, Sap#sap{out = Sent, inbox = Delivered}, Before ++ Actions ++ After}.

retransmit(Seq, #sap{out = Out} = Sap) ->
    case starl_sap_out:retransmit(Seq, Out) of
        {Actions, Next} -> {keep_state, Sap#sap{out = Next}, Actions};
        none -> keep_state_and_data
    end.

settle(By, Own, Incarnation, Seq, Outcome, #sap{out = Out, peers = Peers} = Sap) ->
    Heard = starl_sap_peers:heard(By, Own, Peers),
    case starl_sap_out:settle(By, Incarnation, Seq, Outcome, Out) of
        {Actions, Next} -> {keep_state, Sap#sap{out = Next, peers = Heard}, Actions};
        none -> {keep_state, Sap#sap{peers = Heard}}
    end.

%% -- receiving ------------------------------------------------------------------------------

receive_data({Source, Theirs, Seq, _Low, For, _Type, _Body} = Data, Sap) ->
    #sap{self = Self, incarnation = Own, peers = Peers} = Sap,
    Meant = maps:get(Self, For, 1),
    case starl_sap_peers:incarnation(Source, Peers) of
        Later when Theirs < Later ->
            %% An earlier incarnation of the source; nobody waits for the outcome any more.
            keep_state_and_data;
        _ when Meant =/= Own ->
            Refusal = starl_packet:refusal(Self, Own, Theirs, Seq),
            {keep_state, heard(Source, Theirs, Sap), [{transmit, Source, Refusal}]};
        _ ->
            take(Data, starl_sap_peers:heard(Source, Theirs, Peers), Sap)
    end.

take({Source, Theirs, Seq, Low, _For, Type, _Body} = Data, Peers, Sap) ->
    #sap{self = Self, incarnation = Own, inbox = Inbox} = Sap,
    Ack = {transmit, Source, starl_packet:ack(Self, Own, Theirs, Seq)},
    case starl_sap_peers:take(Source, Low, Seq, Peers) of
        {seen, Known} ->
            {keep_state, Sap#sap{peers = Known}, [Ack]};
        {new, Taken} ->
            case starl_sap_inbox:has_room(Type, Inbox) of
                true -> take_new(Data, Ack, Taken, Sap);
                %% Not taken; it will come again.
                false -> {keep_state, Sap#sap{peers = Peers}, [full(Source, Type)]}
            end
    end.

take_new({Source, Theirs, Seq, _Low, _For, Type, Body}, Ack, Taken, #sap{inbox = Inbox} = Sap) ->
    Id = {Source, Theirs, Seq},
    {Actions, Delivered} = starl_sap_inbox:deliver(Source, Type, Body, Id, Inbox),
    {keep_state, Sap#sap{peers = Taken, inbox = Delivered}, [Ack | Actions]}.

full(Source, Type) -> {trace, {unclaimed_full, Source, Type}}.

heard(Robot, Incarnation, #sap{peers = Peers} = Sap) ->
    Sap#sap{peers = starl_sap_peers:heard(Robot, Incarnation, Peers)}.

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
