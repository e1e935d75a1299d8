%% @doc Builds and checks the packets of SAP. No other module does.
%%
%% A data packet carries its source's incarnation and the message's sequence number within it. It
%% carries the message's number among the messages to its receiver, or among the broadcasts. For
%% each receiver it carries the incarnation that it is meant for. Incarnation 1 is the default and
%% not written.
%%
%% Anybody with a radio can put anything on the air. {@link source/1} accepts only packets of
%% exactly these shapes, with any values; {@link starl_sap} judges the values.
-module(starl_packet).

-export([data/1, ack/4, refusal/4, hello/2, shout/3, ask/3, told/5]).
-export([source/1, brief/1]).

-export_type([t/0, brief/0, data/0, incarnation/0, seq/0, numbering/0, type/0, lows/0, lives/0]).

-define(VERSION, 1).

%% The largest number that any robot counts to: numbers stay small integers.
-define(MOST, 16#7FFFFFFFFFFFFFF).

-define(IS_COUNT(N), (is_integer(N) andalso N > 0 andalso N =< ?MOST)).
-define(IS_NATURAL(N), (is_integer(N) andalso N >= 0 andalso N =< ?MOST)).
-define(IS_TYPE(T),
    (is_atom(T) orelse
        (tuple_size(T) =:= 2 andalso element(1, T) =:= app andalso is_atom(element(2, T))))
).

%% Counts the starts of a robot's SAP.
-type incarnation() :: pos_integer().

%% Counts the messages of one incarnation.
-type seq() :: pos_integer().

%% Counts the messages to one receiver, or the broadcasts: a message lost on the way to one robot
%% leaves no gap for another.
-type numbering() :: seq() | {all, seq()}.

%% The type of a machine's message, or of an application's; the two have separate name spaces.
-type type() :: atom() | {app, atom()}.

%% The lowest numbers that a source still waits for at a robot: of messages to it, of broadcasts.
-type lows() :: {seq(), seq()}.

%% The last two incarnations of a robot that another one knows from answers of the robot itself; 0:
%% none.
-type lives() :: {non_neg_integer(), non_neg_integer()}.

%% A tuple, not a map: a message is copied and hashed at every hop.
-type data() :: {
    Source :: starl:robot_id(),
    incarnation(),
    seq(),
    numbering(),
    %% the receivers' incarnations where they are not 1
    For :: #{starl:robot_id() => incarnation()},
    type(),
    Body :: term()
}.

%% A packet on the air.
-type t() ::
    {starl, Version :: 1, data, data()}
    %% By has the message {Incarnation, Seq} of the receiver of this packet
    | {starl, 1, ack, By :: starl:robot_id(), incarnation(), incarnation(), seq()}
    %% By is a later incarnation and does not take the message
    | {starl, 1, refusal, By :: starl:robot_id(), incarnation(), incarnation(), seq()}
    %% a robot's SAP has started anew
    | {starl, 1, hello, starl:robot_id(), incarnation()}
    %% By doubts a packet that came in the name of the receiver of this one, whose lives it knows
    | {starl, 1, ask, By :: starl:robot_id(), Nonce :: pos_integer(), lives()}
    %% the answer to `ask', from the robot itself, with the lives that it knows of the asking one
    | {starl, 1, told, starl:robot_id(), incarnation(), Nonce :: pos_integer(), lows(), lives()}
    %% a datagram for all in range; nobody acknowledges it
    | {starl, 1, shout, Source :: starl:robot_id(), type(), Body :: term()}.

%% A packet in short, for recordings: its kind, the type of a message, the number of the message that
%% it carries or answers. The same number on a link again is a retransmission.
-type brief() ::
    {data, type(), seq()}
    | {ack | refusal, seq()}
    | {shout, type()}
    | hello
    | ask
    | told
    | malformed.

%% @doc A data packet.
-spec data(data()) -> t().
data(Data) -> {starl, ?VERSION, data, Data}.

%% @doc `By', in its incarnation `Own', has the message `Seq' of its source's `Incarnation'.
-spec ack(By :: starl:robot_id(), Own :: incarnation(), incarnation(), seq()) -> t().
ack(By, Own, Incarnation, Seq) -> {starl, ?VERSION, ack, By, Own, Incarnation, Seq}.

%% @doc `By' does not take the message: it was meant for an earlier incarnation of `By'.
-spec refusal(By :: starl:robot_id(), Own :: incarnation(), incarnation(), seq()) -> t().
refusal(By, Own, Incarnation, Seq) -> {starl, ?VERSION, refusal, By, Own, Incarnation, Seq}.

%% @doc The robot's SAP has started with this incarnation.
-spec hello(starl:robot_id(), incarnation()) -> t().
hello(Robot, Incarnation) -> {starl, ?VERSION, hello, Robot, Incarnation}.

%% @doc A message of `Source' for all in range, without acknowledgement.
-spec shout(Source :: starl:robot_id(), type(), Body :: term()) -> t().
shout(Source, Type, Body) -> {starl, ?VERSION, shout, Source, Type, Body}.

%% @doc `By' asks a robot for its incarnation, and names the lives of it that it knows.
-spec ask(By :: starl:robot_id(), Nonce :: pos_integer(), lives()) -> t().
ask(By, Nonce, Lives) -> {starl, ?VERSION, ask, By, Nonce, Lives}.

%% @doc The answer: the incarnation, the lowest numbers still waited for at the asking robot, and the
%% lives of that robot that are known here.
-spec told(starl:robot_id(), incarnation(), Nonce :: pos_integer(), lows(), lives()) -> t().
told(Robot, Incarnation, Nonce, Lows, Lives) ->
    {starl, ?VERSION, told, Robot, Incarnation, Nonce, Lows, Lives}.

%% @doc The robot in whose name a packet comes; `malformed': the term is no packet.
-spec source(term()) -> starl:robot_id() | malformed.
source({starl, ?VERSION, data, {Source, Incarnation, Seq, Number, For, Type, _Body}}) when
    ?IS_COUNT(Source), ?IS_COUNT(Incarnation), ?IS_COUNT(Seq), is_map(For), ?IS_TYPE(Type)
->
    numbered(Number, Source);
source({starl, ?VERSION, ack, By, Own, Incarnation, Seq}) when
    ?IS_COUNT(By), ?IS_COUNT(Own), ?IS_COUNT(Incarnation), ?IS_COUNT(Seq)
->
    By;
source({starl, ?VERSION, refusal, By, Own, Incarnation, Seq}) when
    ?IS_COUNT(By), ?IS_COUNT(Own), ?IS_COUNT(Incarnation), ?IS_COUNT(Seq)
->
    By;
source({starl, ?VERSION, hello, By, Own}) when ?IS_COUNT(By), ?IS_COUNT(Own) -> By;
source({starl, ?VERSION, shout, Source, Type, _Body}) when ?IS_COUNT(Source), ?IS_TYPE(Type) ->
    Source;
source({starl, ?VERSION, ask, By, Nonce, Lives}) when ?IS_COUNT(By), ?IS_COUNT(Nonce) ->
    lived(Lives, By);
source({starl, ?VERSION, told, By, Own, Nonce, {Low, Casts}, Lives}) when
    ?IS_COUNT(By), ?IS_COUNT(Own), ?IS_COUNT(Nonce), ?IS_COUNT(Low), ?IS_COUNT(Casts)
->
    lived(Lives, By);
source(_Other) ->
    malformed.

numbered(Number, Source) when ?IS_COUNT(Number) -> Source;
numbered({all, Number}, Source) when ?IS_COUNT(Number) -> Source;
numbered(_Other, _Source) -> malformed.

lived({Earlier, Latest}, Source) when ?IS_NATURAL(Earlier), ?IS_NATURAL(Latest) -> Source;
lived(_Other, _Source) -> malformed.

%% @doc A packet in short.
-spec brief(term()) -> brief().
brief(Packet) ->
    case source(Packet) of
        malformed -> malformed;
        _ -> shortened(Packet)
    end.

shortened({starl, _, data, {_, _, Seq, _, _, Type, _}}) -> {data, Type, Seq};
shortened({starl, _, shout, _, Type, _}) -> {shout, Type};
shortened({starl, _, ack, _, _, _, Seq}) -> {ack, Seq};
shortened({starl, _, refusal, _, _, _, Seq}) -> {refusal, Seq};
shortened(Other) -> element(3, Other).
