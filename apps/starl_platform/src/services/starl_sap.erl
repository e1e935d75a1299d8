%% @doc SAP, the reliable message service (the paper's send/receive with acknowledgement). It numbers
%% messages, sends them again until they are acknowledged, and reports their outcome. It delivers
%% the messages of others to the machine that listens to their type. {@link starl_sap_peers} keeps
%% which of them have been taken.
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
%% A message has a sequence number, which is never used twice in an incarnation. It also has a
%% number among the messages to its receiver, or among the broadcasts. The numbers under way to one
%% robot lie within a window. A robot whose window is used up gets no further messages, so a dead
%% robot holds up no other.
%%
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

%% The name of a message: its source, the source's incarnation, and its sequence number.
-type id() :: {starl:robot_id(), starl_packet:incarnation(), starl_packet:seq()}.

%% The answer to a caller: the message arrived everywhere, or where it was lost.
-type answer() :: ok | {error, lost | restarted | {lost, [starl:robot_id(), ...]}}.

%% Its trace. Ids are {source, incarnation, sequence number}, hashes `erlang:phash2(Body)'.
-type event() ::
    {started, starl_packet:incarnation()}
    | {sent, id(), To :: [starl:robot_id()], starl_packet:type(), hash()}
    %% beside `sent', when a caller waits for the outcome: at one robot, or at all
    | {called, id(), one | all}
    %% the caller's answer; without an id nothing was sent
    | {answered, id() | none, answer() | {error, overload}}
    %% not sent: too much is under way
    | {overload, starl_packet:type()}
    %% at the source, for each destination
    | {outcome, id(), At :: starl:robot_id(), acknowledged | lost | restarted}
    %% at the receiver
    | {delivered, id(), starl_packet:type(), hash()}
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

%% The last moment, by the robot's own clock, at which the message may leave, the first time or again.
-type latest() :: Us :: integer() | infinity.

%% A message under way: the robots that have not acknowledged, the caller, the number of tries.
-record(message, {
    number :: starl_packet:numbering(),
    type :: starl_packet:type(),
    body :: term(),
    waiting :: [starl:robot_id()],
    %% the receivers' incarnations when it was first sent: a later incarnation must not take a
    %% retransmission, since the earlier one may have delivered the message
    for :: #{starl:robot_id() => starl_packet:incarnation()},
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

%% What does not change.
-record(setup, {
    self :: starl:robot_id(),
    team :: starl_team:t(),
    incarnation :: starl_packet:incarnation(),
    %% the waiting times after each transmission, us
    delays :: [pos_integer()],
    window :: pos_integer(),
    most_unclaimed :: non_neg_integer(),
    life :: starl_robot_machines:life(),
    latest_life :: starl_packet:incarnation() | infinity
}).

-record(sap, {
    setup :: #setup{},
    %% the next message's sequence number, the next broadcast's number
    next = 1 :: starl_packet:seq(),
    cast = 1 :: starl_packet:seq(),
    links = #{} :: #{starl:robot_id() => #link{}},
    messages = #{} :: #{starl_packet:seq() => #message{}},
    peers = starl_sap_peers:new() :: starl_sap_peers:t(),
    nonce :: pos_integer(),
    listeners = #{} :: #{starl_packet:type() => starl_machine:name()},
    %% how many more messages the machine can keep
    rooms = #{} :: #{starl_machine:name() => non_neg_integer()},
    %% messages that have found no listener or no room yet, latest first
    unclaimed = [] :: [{starl:robot_id(), starl_packet:type(), Body :: term()}]
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
-spec datagram(
    Self :: starl:robot_id(), starl:robot_id() | all, starl_packet:type(), Body :: term()
) ->
    starl_machine:action().
datagram(Self, To, Type, Body) -> {transmit, To, starl_packet:shout(Self, Type, Body)}.

%% @doc The action by which a machine listens to messages of a type.
-spec listen(starl_packet:type(), starl_machine:name()) -> starl_machine:action().
listen(Type, Machine) -> {cast, sap, {listen, Type, Machine}}.

-spec init(starl_machine:config()) -> {ready, #sap{}, [starl_machine:action()]}.
init(#{robot := Self, participants := Team, incarnation := Incarnation} = Config) ->
    Setup = #setup{
        self = Self,
        team = Team,
        incarnation = Incarnation,
        delays = starl_sap_schedule:delays(Config),
        window = maps:get(window, Config, 4096),
        most_unclaimed = maps:get(unclaimed, Config, 256),
        life = maps:get(life, Config, {0, 1}),
        latest_life = maps:get(latest_life, Config, infinity)
    },
    Hello = [{transmit, all, starl_packet:hello(Self, Incarnation)} || Incarnation > 1],
    {ready, #sap{setup = Setup, nonce = nonce(Config)}, [{trace, {started, Incarnation}} | Hello]}.

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
handle_event({timeout, {retransmit, Seq}}, _, ready, Sap, _Meta) ->
    retransmit(Seq, Sap);
handle_event(info, {late, {retransmit, Seq}}, ready, Sap, _Meta) ->
    late(Seq, Sap);
handle_event(info, {late, shout}, ready, _Sap, _Meta) ->
    keep_state_and_data;
handle_event(cast, {broadcast, Type, Body}, ready, Sap, _Meta) ->
    broadcast(others(Sap), {Type, Body, infinity}, none, Sap);
handle_event({call, From}, {broadcast, Type, Body}, ready, Sap, _Meta) ->
    broadcast(others(Sap), {Type, Body, infinity}, From, Sap);
handle_event(cast, {shout, Type, Body}, ready, Sap, _Meta) ->
    {keep_state_and_data, [datagram(self_id(Sap), all, Type, Body)]};
handle_event(cast, {shout, Type, Body, Until}, ready, Sap, _Meta) ->
    Packet = datagram(self_id(Sap), all, Type, Body),
    {keep_state_and_data, [{until, Until, [Packet], shout}]};
handle_event(cast, {listen, Type, Machine}, ready, Sap, _Meta) ->
    listen(Type, Machine, Sap);
handle_event(cast, {listen, Type, Machine, Room}, ready, #sap{rooms = Rooms} = Sap, _Meta) ->
    listen(Type, Machine, Sap#sap{rooms = Rooms#{Machine => Room}});
handle_event(cast, {read, Machine, Count}, ready, Sap, _Meta) ->
    has_read(Machine, Count, Sap);
handle_event(info, {restarted, _}, ready, _Sap, _Meta) ->
    keep_state_and_data;
handle_event(_, _, _, _, _) ->
    unknown_event.

self_id(#sap{setup = #setup{self = Self}}) -> Self.

id(Seq, #sap{setup = #setup{self = Self, incarnation = Own}}) -> {Self, Own, Seq}.

%% -- sending --------------------------------------------------------------------------------

others(#sap{setup = #setup{self = Self, team = Team}}) -> starl_team:others(Self, Team).

%% Sends a message to another robot, unless its window is used up.
send_message(Self, {Type, Body, _Latest}, From, #sap{setup = #setup{self = Self}} = Sap) ->
    send_own(Type, Body, From, Sap);
send_message(To, {Type, _, _} = Content, From, #sap{links = Links, setup = Setup} = Sap) ->
    case maps:get(To, Links, #link{}) of
        #link{next = Number, ones = [Low | _]} when Number - Low >= Setup#setup.window ->
            {keep_state, Sap, overload(Type, From)};
        #link{next = Number, ones = Ones} = Link ->
            Message = message(Number, Content, [To], [To], From, Sap),
            Open = Link#link{next = Number + 1, ones = Ones ++ [Number]},
            {Actions, Sent} = transmit_first([To], Message, Links#{To => Open}, Sap),
            {keep_state, Sent, Actions}
    end.

%% A message to the robot itself does not leave it.
send_own(Type, Body, From, #sap{next = Seq} = Sap) ->
    {Self, _, _} = Id = id(Seq, Sap),
    case deliver(Self, Type, Body, Id, Sap#sap{next = Seq + 1}) of
        {Actions, Delivered} ->
            Sent = {trace, {sent, Id, [Self], Type, erlang:phash2(Body)}},
            Outcome = {trace, {outcome, Id, Self, acknowledged}},
            Before = [Sent | called(From, Id, one)],
            {keep_state, Delivered, Before ++ Actions ++ [Outcome | answer(From, Id, ok)]};
        _Full ->
            {keep_state, Sap, overload(Type, From)}
    end.

%% Sends a message to many robots, in one packet at first. It is lost at once at the robots whose
%% window is used up; if all windows are, it is not sent.
broadcast([], _Content, From, Sap) ->
    {keep_state, Sap, answer(From, none, ok)};
broadcast(Dests, {Type, _, _} = Content, From, #sap{cast = Number, next = Seq} = Sap) ->
    case lists:partition(fun(Dest) -> has_room(Dest, Sap) end, Dests) of
        {[], _} ->
            {keep_state, Sap, overload(Type, From)};
        {Ready, Full} ->
            Message = message({all, Number}, Content, Dests, Ready, From, Sap),
            Links = lists:foldl(fun(D, L) -> cast(Number, D, L) end, Sap#sap.links, Ready),
            {Actions, Sent} = transmit_first(
                Dests, Message#message{lost = Full}, Links, Sap#sap{cast = Number + 1}
            ),
            {keep_state, Sent, Actions ++ outcomes(Seq, Full, lost, Sap)}
    end.

has_room(Dest, #sap{cast = Number, links = Links, setup = #setup{window = Window}}) ->
    case Links of
        #{Dest := #link{casts = [Low | _]}} -> Number - Low < Window;
        #{} -> true
    end.

cast(Number, Dest, Links) ->
    #link{casts = Casts} = Link = maps:get(Dest, Links, #link{}),
    Links#{Dest => Link#link{casts = Casts ++ [Number]}}.

overload(Type, From) ->
    [{trace, {overload, Type}} | answer(From, none, {error, overload})].

message(Number, {Type, Body, Latest}, Dests, Waiting, From, #sap{peers = Peers}) ->
    #message{
        number = Number,
        type = Type,
        body = Body,
        waiting = Waiting,
        for = starl_sap_peers:later(Dests, Peers),
        latest = Latest,
        from = From
    }.

transmit_first(Dests, #message{} = Message, Links, #sap{next = Seq} = Sap) ->
    #message{type = Type, body = Body, from = From} = Message,
    {Actions, Sent} = transmit(Seq, Message, Sap#sap{next = Seq + 1, links = Links}),
    Id = id(Seq, Sap),
    Called = called(From, Id, how(Message)),
    {[{trace, {sent, Id, Dests, Type, erlang:phash2(Body)}} | Called ++ Actions], Sent}.

how(#message{number = {all, _}}) -> all;
how(#message{}) -> one.

%% -- messages under way ---------------------------------------------------------------------

transmit(Seq, #message{tries = Tries, waiting = Waiting} = Message, Sap) ->
    #sap{messages = Messages, setup = #setup{delays = Delays} = Setup} = Sap,
    #setup{self = Self, incarnation = Own} = Setup,
    #message{number = Number, type = Type, body = Body, for = For, latest = Latest} = Message,
    Packet = starl_packet:data({Self, Own, Seq, Number, maps:with(Waiting, For), Type, Body}),
    Actions = [
        {{timeout, {retransmit, Seq}}, lists:nth(Tries + 1, Delays), again}
        | leaves(Latest, Seq, [{transmit, Dest, Packet} || Dest <- to_whom(Message)])
    ],
    {Actions, Sap#sap{messages = Messages#{Seq => Message#message{tries = Tries + 1}}}}.

leaves(infinity, _Seq, Packets) -> Packets;
leaves(Latest, Seq, Packets) -> [{until, Latest, Packets, {retransmit, Seq}}].

to_whom(#message{number = {all, _}, tries = 0}) -> [all];
to_whom(#message{waiting = Waiting}) -> Waiting.

%% Sends a message again when its time has come, or reports it lost.
retransmit(Seq, #sap{messages = Messages, setup = #setup{delays = Delays}} = Sap) ->
    case Messages of
        #{Seq := #message{tries = Tries} = Message} when Tries < length(Delays) ->
            {Actions, Sent} = transmit(Seq, Message, Sap),
            {keep_state, Sent, Actions};
        #{Seq := Message} ->
            {Actions, Left} = lost(Seq, Message, Sap),
            {keep_state, Left, Actions};
        #{} ->
            keep_state_and_data
    end.

%% The latest moment of a message has passed: it is lost where it has not been acknowledged.
late(Seq, #sap{messages = Messages} = Sap) ->
    case Messages of
        #{Seq := Message} ->
            {Actions, Left} = lost(Seq, Message, Sap),
            {keep_state, Left, [{{timeout, {retransmit, Seq}}, cancel} | Actions]};
        #{} ->
            keep_state_and_data
    end.

lost(Seq, #message{waiting = Waiting, lost = Lost, number = Number} = Message, Sap) ->
    Links = lists:foldl(fun(D, L) -> close(Number, D, L) end, Sap#sap.links, Waiting),
    Done = Message#message{lost = Waiting ++ Lost},
    {Actions, Finished} = finish(Seq, Done, lost, Links, Sap),
    {outcomes(Seq, Waiting, lost, Sap) ++ Actions, Finished}.

%% -- outcomes -------------------------------------------------------------------------------

%% A robot acknowledges a message, or refuses it after a restart.
settle({By, Theirs}, Own, Seq, Outcome, #sap{setup = #setup{incarnation = Own}} = Sap) ->
    case Sap#sap.messages of
        #{Seq := #message{waiting = Waiting, for = For} = Message} ->
            Meant = maps:get(By, For, 1) =:= Theirs,
            case lists:member(By, Waiting) of
                true when Meant =:= (Outcome =:= acknowledged) ->
                    learned(By, Theirs, Outcome, settled(By, Seq, Message, Outcome, Sap), Sap);
                true ->
                    {keep_state_and_data, [dropped(Outcome, By)]};
                false ->
                    keep_state_and_data
            end;
        #{} ->
            keep_state_and_data
    end;
settle(_By, _Earlier, _Seq, _Outcome, _Sap) ->
    keep_state_and_data.

settled(By, Seq, #message{} = Message, Outcome, #sap{links = Before, messages = Messages} = Sap) ->
    #message{waiting = Waiting, lost = Lost, number = Number} = Message,
    Rest = Message#message{
        waiting = lists:delete(By, Waiting),
        lost = [By || Outcome =/= acknowledged] ++ Lost
    },
    Trace = {trace, {outcome, id(Seq, Sap), By, Outcome}},
    Links = close(Number, By, Before),
    case Rest of
        #message{waiting = []} ->
            {Actions, Finished} = finish(Seq, Rest, Outcome, Links, Sap),
            {[Trace, {{timeout, {retransmit, Seq}}, cancel} | Actions], Finished};
        #message{} ->
            {[Trace], Sap#sap{links = Links, messages = Messages#{Seq := Rest}}}
    end.

%% An acknowledgement comes from the incarnation that the message was meant for: nothing to learn.
%% A refusal may come from an earlier incarnation than the one known; by one far beyond it the message is
%% not settled: it is sent again until that robot has told its incarnation itself.
learned(_By, _Theirs, acknowledged, {Actions, Settled}, _Sap) ->
    {keep_state, Settled, Actions};
learned(By, Theirs, restarted, {Actions, Settled}, #sap{peers = Peers} = Sap) ->
    case starl_sap_peers:heard(By, Theirs, Peers) of
        {present, Heard} -> {keep_state, Settled#sap{peers = Heard}, Actions};
        {earlier, _} -> doubt(By, Settled, Actions);
        {far, _} -> doubt(By, Sap, [])
    end.

%% Removes the number from those under way to a robot.
close({all, Number}, Dest, Links) ->
    #{Dest := #link{casts = Casts} = Link} = Links,
    Links#{Dest := Link#link{casts = lists:delete(Number, Casts)}};
close(Number, Dest, Links) ->
    #{Dest := #link{ones = Ones} = Link} = Links,
    Links#{Dest := Link#link{ones = lists:delete(Number, Ones)}}.

finish(Seq, #message{from = From} = Message, Outcome, Links, #sap{messages = Messages} = Sap) ->
    Left = Sap#sap{links = Links, messages = maps:remove(Seq, Messages)},
    {answer(From, id(Seq, Sap), result(Message, Outcome)), Left}.

result(#message{lost = []}, _) -> ok;
result(#message{number = {all, _}, lost = Lost}, _) -> {error, {lost, lists:sort(Lost)}};
result(#message{}, Outcome) -> {error, Outcome}.

outcomes(Seq, Robots, Outcome, Sap) ->
    Id = id(Seq, Sap),
    [{trace, {outcome, Id, Robot, Outcome}} || Robot <- Robots].

%% A caller waits for the outcome: an answer is due.
called(none, _Id, _How) -> [];
called(_From, Id, How) -> [{trace, {called, Id, How}}].

%% Answers the caller, if there is one, and traces the answer, which the monitor judges.
answer(none, _Id, _) -> [];
answer(From, Id, Result) -> [{trace, {answered, Id, Result}}, {reply, From, Result}].

%% The lowest numbers that still wait for an acknowledgement of this robot.
lows(Robot, #sap{links = Links, cast = Cast}) ->
    #link{next = Next, ones = Ones, casts = Casts} = maps:get(Robot, Links, #link{}),
    {hd(Ones ++ [Next]), hd(Casts ++ [Cast])}.

%% -- receiving ------------------------------------------------------------------------------

receive_packet(malformed, _Packet, _Sap) ->
    unknown_event;
receive_packet(Source, Packet, #sap{setup = Setup, peers = Peers} = Sap) ->
    #setup{self = Self, team = Team} = Setup,
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
packet({starl, _, shout, Source, Type, Body}, Sap) ->
    {keep_state_and_data, [overhear(Source, Type, Body, Sap)]};
packet({starl, _, ask, By, Nonce, Lives}, Sap) ->
    case forgotten(Lives, Sap) of
        [] ->
            {keep_state_and_data, [own_answer(By, Nonce, Sap)]};
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

own_answer(To, Nonce, #sap{setup = #setup{self = Self, incarnation = Own}, peers = Peers} = Sap) ->
    Lives = starl_sap_peers:lives(To, Peers),
    {transmit, To, starl_packet:told(Self, Own, Nonce, lows(To, Sap), Lives)}.

%% Those lives of this robot that its store does not know of.
forgotten({Earlier, Latest}, #sap{setup = Setup}) ->
    #setup{incarnation = Own, life = {Before, First}, latest_life = Bound} = Setup,
    [
        N
     || N <- [Latest, Earlier],
        N > Own orelse (N > Before andalso N < First),
        N =< Bound
    ].

outlived(Lives, By, Sap) ->
    case forgotten(Lives, Sap) of
        [] -> [];
        [Latest | _] -> [{trace, {outlived, Latest, By}}, {outlived, Latest}]
    end.

%% Asks a robot for its incarnation, and for the lowest numbers that it still waits for.
ask(Robot, #sap{peers = Peers, nonce = Next} = Sap) ->
    {Nonce, Asked} = starl_sap_peers:ask(Robot, Next, Peers),
    Ask = starl_packet:ask(self_id(Sap), Nonce, starl_sap_peers:lives(Robot, Peers)),
    {{transmit, Robot, Ask}, Sap#sap{peers = Asked, nonce = Next + 1}}.

doubt(Robot, Sap, Actions) ->
    {Ask, Asked} = ask(Robot, Sap),
    {keep_state, Asked, [dropped(incarnation, Robot) | Actions] ++ [Ask]}.

receive_data({Source, Theirs, Seq, _Number, For, _Type, _Body} = Data, Sap) ->
    #sap{setup = #setup{self = Self, incarnation = Own}, peers = Peers} = Sap,
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
    #setup{self = Self, incarnation = Own, window = Window} = Sap#sap.setup,
    Ack = {transmit, Source, starl_packet:ack(Self, Own, Theirs, Seq)},
    case starl_sap_peers:take(Source, Number, Window, Heard) of
        {new, Taken} -> take_new(Data, Ack, Taken, Heard, Sap);
        seen -> {keep_state, Sap#sap{peers = Heard}, [Ack]};
        {wide, Taken} -> take_wide(Source, take_new(Data, Ack, Taken, Heard, Sap));
        far -> far(Source, Sap#sap{peers = Heard})
    end.

take_new({Source, Theirs, Seq, _Number, _For, Type, Body}, Ack, Taken, Heard, Sap) ->
    case deliver(Source, Type, Body, {Source, Theirs, Seq}, Sap#sap{peers = Taken}) of
        {Actions, Delivered} ->
            %% a robot that stalls in between has delivered what it acknowledges
            {keep_state, Delivered, Actions ++ [Ack]};
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

%% -- listeners ------------------------------------------------------------------------------

%% Registers a machine as the listener of a type, unless another one has it, and hands on the
%% messages that have waited. A listener that keeps messages until it reads them announces its room
%% for them. A listener that handles them at once has unlimited room.
listen(Type, Machine, #sap{listeners = Listeners} = Sap) ->
    case Listeners of
        #{Type := Holder} when Holder =/= Machine ->
            {keep_state, Sap, [{trace, {listener_refused, Type, Machine, Holder}}]};
        #{} ->
            hand_on(Sap#sap{listeners = Listeners#{Type => Machine}})
    end.

%% Adds the messages that a machine has read to its room. A machine without an announced room has
%% not yet heard of a restart of SAP; it counts them when it announces its room.
has_read(Machine, Count, #sap{rooms = Rooms} = Sap) ->
    case Rooms of
        #{Machine := Room} -> hand_on(Sap#sap{rooms = Rooms#{Machine := Room + Count}});
        #{} -> {keep_state, Sap, []}
    end.

%% Hands on the messages that have waited, oldest first, as far as there is room.
hand_on(#sap{unclaimed = Unclaimed} = Sap) ->
    {Messages, Left} = lists:foldl(
        fun hand_on/2, {[], Sap#sap{unclaimed = []}}, lists:reverse(Unclaimed)
    ),
    {keep_state, Left, lists:reverse(Messages)}.

hand_on({Source, Type, Body} = Message, {Messages, #sap{unclaimed = Unclaimed} = Sap}) ->
    case listener(Type, Sap) of
        {Machine, Next} -> {[message(Machine, Source, Type, Body) | Messages], Next};
        _ -> {Messages, Sap#sap{unclaimed = [Message | Unclaimed]}}
    end.

%% The listener of a type, with its room reduced by one; else nobody listens, or it has no room.
listener(Type, #sap{listeners = Listeners, rooms = Rooms} = Sap) ->
    case Listeners of
        #{Type := Machine} ->
            case Rooms of
                #{Machine := 0} -> full;
                #{Machine := Room} -> {Machine, Sap#sap{rooms = Rooms#{Machine := Room - 1}}};
                #{} -> {Machine, Sap}
            end;
        #{} ->
            nobody
    end.

%% Delivers a message to its listener, or keeps it for a later one. Without room for it, the message
%% is not taken.
deliver(Source, Type, Body, Id, #sap{unclaimed = Unclaimed, setup = Setup} = Sap) ->
    case listener(Type, Sap) of
        {Machine, Next} ->
            {[delivered(Id, Type, Body), message(Machine, Source, Type, Body)], Next};
        full ->
            full;
        nobody when length(Unclaimed) < Setup#setup.most_unclaimed ->
            Kept = [{Source, Type, Body} | Unclaimed],
            {[delivered(Id, Type, Body)], Sap#sap{unclaimed = Kept}};
        nobody ->
            unclaimed_full
    end.

delivered(Id, Type, Body) -> {trace, {delivered, Id, Type, erlang:phash2(Body)}}.

%% Passes a datagram on, if anybody listens. Datagrams are not counted as messages: an application
%% gets them under the plain name of their type.
overhear(Source, Type, Body, #sap{listeners = Listeners}) ->
    case Listeners of
        #{Type := Machine} -> message(Machine, Source, plain(Type), Body);
        #{} -> {trace, {unheard, Source, Type}}
    end.

plain({app, Type}) -> Type;
plain(Type) -> Type.

message(Machine, Source, Type, Body) -> {cast, Machine, {message, Source, Type, Body}}.

%% -- nonces --------------------------------------------------------------------------------

%% The first nonce, which only a robot that hears the questions can know. Each incarnation has
%% its own, even with the same random stream: an answer to an earlier incarnation does not count.
nonce(#{random := Random, incarnation := Incarnation}) ->
    {N, _} = rand:uniform_s(1 bsl 32, Random),
    1 + erlang:phash2({N, Incarnation}, 1 bsl 32).
