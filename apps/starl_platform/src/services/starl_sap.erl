%% @doc SAP, the reliable message service (the paper's send/receive with acknowledgement). This
%% module interprets packets and requests. {@link starl_sap_out} keeps the messages under way,
%% {@link starl_sap_peers} the messages taken, {@link starl_sap_inbox} the listeners.
%%
%% Exchange rules:
%% ```
%%   source                                   receiver
%%     | data {incarnation, seq, number, for} ->|  new: delivered to the listener of its type
%%     |<----------- ack {incarnation, seq} ----|  seen before: acknowledged only
%%     | (again after a back-off, at most `limit' times, then reported lost)
%%     |<------- refusal {its incarnation} -----|  meant for an earlier incarnation of the receiver
%%     |<----------------- ask {nonce, lives} --|  a packet in the source's name is doubtful
%%     | told {incarnation, nonce, lows} ------>|  the source's own answer
%%     | ask {nonce', ..} --------------------->|  instead, if it does not know of one of these lives
%%     |<------ told {.., nonce', .., lives} ---|  it is true: the source's store is an old one
%% '''
%% At most once: the receiver remembers which numbers of a source's incarnation it has taken,
%% within a window ({@link starl_sap_peers}). A message that the receiver's previous incarnation
%% may have taken is refused by the next one and reported `restarted'. A message reported lost
%% may still have been delivered. A message whose type has no listener yet waits for one,
%% within bounds; beyond them, or when its listener has no room, it is not acknowledged, so the
%% source tries again.
%%
%% <em>A store that was lost or set back.</em> A receiver may know of a life of the source that the
%% source's store does not know. It says so in its question (`lives'). The source takes that for a
%% hint, and asks with a nonce of its own. Until it has the answer, it does not answer itself. So no
%% robot that knows of the forgotten life takes a message of the present life. If the hint is true,
%% the robot starts anew (`{outlived, ..}'). A life that by the robot's own clock is impossible
%% (`latest_life') is no hint: the number of the next life would leave none for those after it.
%%
%% Packets are not trusted. Only well-formed packets are accepted ({@link starl_packet:source/1}),
%% and strangers are ignored. Only a robot's own answer to a question can make others believe that
%% it is far ahead. A dropped packet leaves a trace event.
%%
%% Calls: `{send, To, Type, Body}' (answer {@link starl:outcome()}), and `{broadcast, Type, Body}'
%% (answer `ok', `{error, {lost, Robots}}' or `{error, overload}'). A broadcast puts one packet on
%% the air, then one to each robot that did not acknowledge. Casts: `{send, To, Type, Body}' and
%% `{broadcast, Type, Body}', without an answer, and `{listen, Type, Machine}'. A listener that can
%% keep `Room' more messages than it has now casts `{listen, Type, Machine, Room}', and `{read,
%% Machine, Count}' when it has read `Count' messages. A listener gets the cast `{message, From,
%% Type, Body}'. A type has one listener: a second one is refused, which the monitor judges as a
%% violation.
%%
%% A message or a datagram may have a deadline, by the robot's own clock (`{send, To, Type, Body,
%% UntilUs}', `{shout, Type, Body, UntilUs}'). A message that rests on a lease must not leave after
%% its end, neither the first time nor again. A message that would leave too late is lost, at each
%% robot that has not acknowledged it.
%%
%% Besides the reliable service there is a datagram: the cast `{shout, Type, Body}' puts one packet
%% on the air for all in range. It is neither acknowledged nor repeated, and may arrive twice. A
%% robot that does not listen to its type drops it. The contract of SAP does not cover it. The same
%% packet may be sent to one robot alone ({@link datagram/4}).
%%
%% Trace: {@link event()}.
-module(starl_sap).
-behaviour(starl_machine).

-export([send/4, send/5, post/3, shout/2, shout/3, datagram/4, listen/2]).
-export([init/1, handle_event/5]).

-export_type([config/0, event/0, answer/0]).

%% The answer to a caller: the message arrived everywhere, or where it was lost.
-type answer() :: ok | {error, lost | restarted | {lost, [starl:robot_id(), ...]}}.

%% Its trace. Ids are {source, incarnation, sequence number}, hashes `erlang:phash2(Body)'.
-type event() ::
    {started, starl_packet:incarnation()}
    | {sent, starl_sap_out:id(), To :: [starl:robot_id()], starl_packet:type(), hash()}
    %% beside `sent', when a caller waits for the outcome: at one robot, or at all
    | {called, starl_sap_out:id(), one | all}
    %% the caller's answer; without an id nothing was sent
    | {answered, starl_sap_out:id() | none, answer() | {error, overload}}
    %% not sent: too much is under way
    | {overload, starl_packet:type()}
    %% at the source, for each destination
    | {outcome, starl_sap_out:id(), At :: starl:robot_id(), acknowledged | lost | restarted}
    %% at the receiver
    | {delivered, starl_sap_out:id(), starl_packet:type(), hash()}
    %% not taken: its listener has no room, or too many messages wait for a listener
    | {full, From :: starl:robot_id(), starl_packet:type()}
    | {unclaimed_full, From :: starl:robot_id(), starl_packet:type()}
    %% a datagram that nobody listens to
    | {unheard, From :: starl:robot_id(), starl_packet:type()}
    %% a packet in that robot's name was dropped: it is a `stranger', or the `incarnation', the
    %% `number', the claim about a message (`acknowledged', `restarted') or the `answer' cannot be
    %% true
    | {dropped, stranger | incarnation | number | acknowledged | restarted | answer,
        starl:robot_id()}
    %% that robot knows a life of this one of which its store knows nothing
    | {outlived, starl_packet:incarnation(), By :: starl:robot_id()}
    %% the type has a listener already
    | {listener_refused, starl_packet:type(), starl_machine:name(), Holder :: starl_machine:name()}.

-type hash() :: non_neg_integer().

%% `retransmit_ms': the delay of the first retransmission; each further delay is `backoff' times as
%% long, at most `longest_ms'; `limit': the number of retransmissions; `window': the largest
%% distance of the numbers under way to one robot; `unclaimed': the number of messages that may wait
%% for a listener.
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
    inbox :: starl_sap_inbox:t(),
    window :: pos_integer(),
    nonce :: pos_integer(),
    life :: starl_robot_machines:life(),
    latest_life :: starl_packet:incarnation() | infinity
}).

%% @doc The action that sends a message; its outcome comes back as the event `{reply, Tag}'.
-spec send(starl:robot_id(), starl_packet:type(), Body :: term(), starl_machine:tag()) ->
    starl_machine:action().
send(To, Type, Body, Tag) -> {call, sap, {send, To, Type, Body}, Tag}.

%% @doc The same for a message that must not leave after this time of the robot's own clock.
-spec send(starl:robot_id(), starl_packet:type(), Body :: term(), starl_machine:tag(), UntilUs) ->
    {call, sap, Request :: tuple(), starl_machine:tag()}
when
    UntilUs :: integer().
send(To, Type, Body, Tag, Until) -> {call, sap, {send, To, Type, Body, Until}, Tag}.

%% @doc The action that sends a message whose outcome nobody waits for.
-spec post(starl:robot_id(), starl_packet:type(), Body :: term()) -> starl_machine:action().
post(To, Type, Body) -> {cast, sap, {send, To, Type, Body}}.

%% @doc The action that sends one unacknowledged packet to all in range.
-spec shout(starl_packet:type(), Body :: term()) -> starl_machine:action().
shout(Type, Body) -> {cast, sap, {shout, Type, Body}}.

%% @doc The same for a packet that must not leave after this time of the robot's own clock.
-spec shout(starl_packet:type(), Body :: term(), UntilUs :: integer()) -> starl_machine:action().
shout(Type, Body, Until) -> {cast, sap, {shout, Type, Body, Until}}.

%% @doc The action by which robot `Self' sends one unacknowledged packet to one robot.
-spec datagram(Self :: starl:robot_id(), starl:robot_id(), starl_packet:type(), Body :: term()) ->
    starl_machine:action().
datagram(Self, To, Type, Body) -> {transmit, To, starl_packet:shout(Self, Type, Body)}.

%% @doc The action by which a machine listens to messages of a type.
-spec listen(starl_packet:type(), starl_machine:name()) -> starl_machine:action().
listen(Type, Machine) -> {cast, sap, {listen, Type, Machine}}.

-spec init(starl_machine:config()) -> {ready, #sap{}, [starl_machine:action()]}.
init(#{robot := Self, participants := Team, incarnation := Incarnation} = Config) ->
    Window = maps:get(window, Config, 4096),
    Sap = #sap{
        life = maps:get(life, Config, {0, 1}),
        latest_life = maps:get(latest_life, Config, infinity),
        self = Self,
        team = Team,
        incarnation = Incarnation,
        window = Window,
        nonce = nonce(Config),
        out = starl_sap_out:new(Self, Incarnation, starl_sap_schedule:delays(Config), Window),
        inbox = starl_sap_inbox:new(maps:get(unclaimed, Config, 256))
    },
    Hello = [{transmit, all, starl_packet:hello(Self, Incarnation)} || Incarnation > 1],
    {ready, Sap, [{trace, {started, Incarnation}} | Hello]}.

-spec handle_event(starl_machine:event_type(), term(), ready, #sap{}, starl_machine:meta()) ->
    starl_machine:result().
handle_event(packet, Packet, ready, Sap, _Meta) ->
    receive_packet(starl_packet:source(Packet), Packet, Sap);
handle_event(cast, {send, To, Type, Body}, ready, Sap, _Meta) ->
    send_message(To, {Type, Body, infinity}, none, Sap);
handle_event({call, From}, {send, To, Type, Body}, ready, Sap, _Meta) ->
    send_message(To, {Type, Body, infinity}, From, Sap);
handle_event({call, From}, {send, To, Type, Body, Until}, ready, Sap, _Meta) ->
    send_message(To, {Type, Body, Until}, From, Sap);
handle_event({timeout, {retransmit, Seq}}, _, ready, #sap{out = Out} = Sap, _Meta) ->
    left(starl_sap_out:retransmit(Seq, Out), Sap);
handle_event(info, {late, {retransmit, Seq}}, ready, #sap{out = Out} = Sap, _Meta) ->
    left(starl_sap_out:late(Seq, Out), Sap);
handle_event(info, {late, shout}, ready, _Sap, _Meta) ->
    keep_state_and_data;
handle_event(cast, {broadcast, Type, Body}, ready, Sap, _Meta) ->
    broadcast(others(Sap), {Type, Body, infinity}, none, Sap);
handle_event({call, From}, {broadcast, Type, Body}, ready, Sap, _Meta) ->
    broadcast(others(Sap), {Type, Body, infinity}, From, Sap);
handle_event(cast, {shout, Type, Body}, ready, #sap{self = Self}, _Meta) ->
    {keep_state_and_data, [{transmit, all, starl_packet:shout(Self, Type, Body)}]};
handle_event(cast, {shout, Type, Body, Until}, ready, #sap{self = Self}, _Meta) ->
    Packet = {transmit, all, starl_packet:shout(Self, Type, Body)},
    {keep_state_and_data, [{until, Until, [Packet], shout}]};
handle_event(cast, {listen, Type, Machine}, ready, Sap, _Meta) ->
    listen(Type, Machine, Sap);
handle_event(cast, {listen, Type, Machine, Room}, ready, #sap{inbox = Inbox} = Sap, _Meta) ->
    listen(Type, Machine, Sap#sap{inbox = starl_sap_inbox:room(Machine, Room, Inbox)});
handle_event(cast, {read, Machine, Count}, ready, #sap{inbox = Inbox} = Sap, _Meta) ->
    {Messages, Next} = starl_sap_inbox:read(Machine, Count, Inbox),
    {keep_state, Sap#sap{inbox = Next}, Messages};
handle_event(info, {restarted, _}, ready, _Sap, _Meta) ->
    keep_state_and_data;
handle_event(_, _, _, _, _) ->
    unknown_event.

listen(Type, Machine, #sap{inbox = Inbox} = Sap) ->
    case starl_sap_inbox:listen(Type, Machine, Inbox) of
        {held_by, Holder} ->
            {keep_state, Sap, [{trace, {listener_refused, Type, Machine, Holder}}]};
        {Messages, Next} ->
            {keep_state, Sap#sap{inbox = Next}, Messages}
    end.

%% -- sending --------------------------------------------------------------------------------

others(#sap{self = Self, team = Team}) -> starl_team:others(Self, Team).

%% A message to the robot itself does not leave it.
send_message(Self, {Type, Body, _Latest}, From, #sap{self = Self} = Sap) ->
    send_own(Type, Body, From, Sap);
send_message(To, {Type, _, _} = Content, From, #sap{out = Out, peers = Peers} = Sap) ->
    For = starl_sap_peers:later([To], Peers),
    sent(starl_sap_out:send({To, Content}, From, For, Out), Type, From, Sap).

broadcast([], _Content, From, Sap) ->
    {keep_state, Sap, starl_sap_out:answer(From, none, ok)};
broadcast(Dests, {Type, _, _} = Content, From, #sap{out = Out, peers = Peers} = Sap) ->
    For = starl_sap_peers:later(Dests, Peers),
    sent(starl_sap_out:broadcast({Dests, Content}, From, For, Out), Type, From, Sap).

sent(full, Type, From, Sap) -> {keep_state, Sap, overload(Type, From)};
sent({Actions, Sent}, _Type, _From, Sap) -> {keep_state, Sap#sap{out = Sent}, Actions}.

overload(Type, From) ->
    [{trace, {overload, Type}} | starl_sap_out:answer(From, none, {error, overload})].

send_own(Type, Body, From, #sap{self = Self, out = Out, inbox = Inbox} = Sap) ->
    {Id, Before, After, Sent} = starl_sap_out:send_own(Type, Body, From, Out),
    case starl_sap_inbox:deliver(Self, Type, Body, Id, Inbox) of
        {Actions, Delivered} ->
            {keep_state, Sap#sap{out = Sent, inbox = Delivered}, Before ++ Actions ++ After};
        _Full ->
            {keep_state, Sap, overload(Type, From)}
    end.

left({Actions, Out}, Sap) -> {keep_state, Sap#sap{out = Out}, Actions};
left(none, _Sap) -> keep_state_and_data.

%% -- receiving ------------------------------------------------------------------------------

receive_packet(malformed, _Packet, _Sap) ->
    unknown_event;
receive_packet(Source, Packet, #sap{self = Self, team = Team, peers = Peers} = Sap) ->
    Known = starl_sap_peers:is_known(Source, Peers),
    case Known orelse (Source =/= Self andalso starl_team:has(Source, Team)) of
        true -> packet(Packet, Sap);
        false -> {keep_state_and_data, [dropped(stranger, Source)]}
    end.

dropped(Why, Source) -> {trace, {dropped, Why, Source}}.

packet({starl, _, data, Data}, Sap) ->
    receive_data(Data, Sap);
packet({starl, _, ack, By, Theirs, Own, Seq}, Sap) ->
    settle({By, Theirs}, Own, Seq, acknowledged, Sap);
packet({starl, _, refusal, By, Theirs, Own, Seq}, Sap) ->
    settle({By, Theirs}, Own, Seq, restarted, Sap);
packet({starl, _, hello, By, Theirs}, #sap{peers = Peers} = Sap) ->
    case starl_sap_peers:heard(By, Theirs, Peers) of
        {far, _} -> doubt(By, Sap, []);
        {_, Heard} -> {keep_state, Sap#sap{peers = Heard}}
    end;
packet({starl, _, shout, Source, Type, Body}, #sap{inbox = Inbox}) ->
    {keep_state_and_data, [starl_sap_inbox:overhear(Source, Type, Body, Inbox)]};
packet({starl, _, ask, By, Nonce, Lives}, Sap) ->
    case forgotten(Lives, Sap) of
        [] ->
            {keep_state_and_data, [tell(By, Nonce, Sap)]};
        [_ | _] ->
            {Ask, Asked} = ask(By, Sap),
            {keep_state, Asked, [Ask]}
    end;
packet({starl, _, told, By, Theirs, Nonce, Lows, Lives}, #sap{peers = Peers} = Sap) ->
    case starl_sap_peers:told(By, Theirs, Nonce, Lows, Peers) of
        {ok, Heard} -> {keep_state, Sap#sap{peers = Heard}, outlived(Lives, By, Sap)};
        {outlived, Heard} -> {keep_state, Sap#sap{peers = Heard}, [dropped(incarnation, By)]};
        not_asked -> {keep_state_and_data, [dropped(answer, By)]}
    end.

tell(To, Nonce, #sap{self = Self, incarnation = Own, out = Out, peers = Peers}) ->
    Lows = starl_sap_out:lows(To, Out),
    {transmit, To, starl_packet:told(Self, Own, Nonce, Lows, starl_sap_peers:lives(To, Peers))}.

%% Those lives of this robot that its store does not know of.
forgotten({Earlier, Latest}, #sap{incarnation = Own, life = {Before, First}} = Sap) ->
    [
        N
     || N <- [Latest, Earlier],
        N > Own orelse (N > Before andalso N < First),
        N =< Sap#sap.latest_life
    ].

outlived(Lives, By, Sap) ->
    case forgotten(Lives, Sap) of
        [] -> [];
        [Latest | _] -> [{trace, {outlived, Latest, By}}, {outlived, Latest}]
    end.

%% Asks a robot for its incarnation, and for the lowest numbers that it still waits for.
ask(Robot, #sap{self = Self, peers = Peers, nonce = Next} = Sap) ->
    {Nonce, Asked} = starl_sap_peers:ask(Robot, Next, Peers),
    Ask = starl_packet:ask(Self, Nonce, starl_sap_peers:lives(Robot, Peers)),
    {{transmit, Robot, Ask}, Sap#sap{peers = Asked, nonce = Next + 1}}.

doubt(Robot, Sap, Actions) ->
    {Ask, Asked} = ask(Robot, Sap),
    {keep_state, Asked, [dropped(incarnation, Robot) | Actions] ++ [Ask]}.

settle({By, Theirs} = Robot, Own, Seq, Outcome, #sap{out = Out} = Sap) ->
    case starl_sap_out:settle(Robot, Own, Seq, Outcome, Out) of
        {Actions, Next} -> settled(By, Theirs, Outcome, {Actions, Next}, Sap);
        none -> keep_state_and_data;
        untrue -> {keep_state_and_data, [dropped(Outcome, By)]}
    end.

%% An acknowledgement comes from the incarnation that the message was meant for: nothing to learn.
%% A refusal may come from an earlier incarnation than the one known; by one far beyond it the message is
%% not settled: it is sent again until that robot has told its incarnation itself.
settled(_By, _Theirs, acknowledged, {Actions, Out}, Sap) ->
    {keep_state, Sap#sap{out = Out}, Actions};
settled(By, Theirs, restarted, {Actions, Out}, #sap{peers = Peers} = Sap) ->
    case starl_sap_peers:heard(By, Theirs, Peers) of
        {present, Heard} -> {keep_state, Sap#sap{out = Out, peers = Heard}, Actions};
        {earlier, _} -> doubt(By, Sap#sap{out = Out}, Actions);
        {far, _} -> doubt(By, Sap, [])
    end.

receive_data({Source, Theirs, Seq, _Number, For, _Type, _Body} = Data, Sap) ->
    #sap{self = Self, incarnation = Own, peers = Peers} = Sap,
    Meant = maps:get(Self, For, 1),
    case starl_sap_peers:heard(Source, Theirs, Peers) of
        {present, Heard} when Meant =:= Own ->
            take(Data, Heard, Sap);
        {present, Heard} ->
            Refusal = starl_packet:refusal(Self, Own, Theirs, Seq),
            {keep_state, Sap#sap{peers = Heard}, [{transmit, Source, Refusal}]};
        {_, _} ->
            doubt(Source, Sap, [])
    end.

take({Source, Theirs, Seq, Number, _For, _Type, _Body} = Data, Heard, Sap) ->
    #sap{self = Self, incarnation = Own, window = Window} = Sap,
    Ack = {transmit, Source, starl_packet:ack(Self, Own, Theirs, Seq)},
    case starl_sap_peers:take(Source, Number, Window, Heard) of
        {new, Taken} -> take_new(Data, Ack, Taken, Heard, Sap);
        seen -> {keep_state, Sap#sap{peers = Heard}, [Ack]};
        {wide, Taken} -> take_wide(Source, take_new(Data, Ack, Taken, Heard, Sap));
        far -> far(Source, Sap#sap{peers = Heard})
    end.

take_new({Source, Theirs, Seq, _Number, _For, Type, Body}, Ack, Taken, Heard, Sap) ->
    case starl_sap_inbox:deliver(Source, Type, Body, {Source, Theirs, Seq}, Sap#sap.inbox) of
        {Actions, Delivered} ->
            %% a robot that stands still in between has delivered what it acknowledges
            {keep_state, Sap#sap{peers = Taken, inbox = Delivered}, Actions ++ [Ack]};
        %% Not taken; the source sends it again.
        Full ->
            {keep_state, Sap#sap{peers = Heard}, [{trace, {Full, Source, Type}}]}
    end.

take_wide(Source, {keep_state, Sap, Actions}) ->
    {Ask, Asked} = ask(Source, Sap),
    {keep_state, Asked, Actions ++ [Ask]}.

far(Source, Sap) ->
    {Ask, Asked} = ask(Source, Sap),
    {keep_state, Asked, [dropped(number, Source), Ask]}.

%% -- nonces --------------------------------------------------------------------------------

%% The first nonce, which only a robot that hears the questions can know. Each incarnation has
%% its own, even with the same random stream: an answer to an earlier incarnation does not count.
nonce(#{random := Random, incarnation := Incarnation}) ->
    {N, _} = rand:uniform_s(1 bsl 32, Random),
    1 + erlang:phash2({N, Incarnation}, 1 bsl 32).
