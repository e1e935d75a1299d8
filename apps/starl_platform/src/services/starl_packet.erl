%% @doc The packets of SAP: the one place that makes and reads them.
%%
%% A data packet carries its source's incarnation and sequence number, the lowest sequence
%% number that its source still waits for (the receiver may forget all below it), and for each
%% receiver the incarnation that it is meant for. Incarnation 1 is the default and not written.
-module(starl_packet).

-export([data/1, ack/4, refusal/4, hello/2, shout/3]).

-export_type([t/0, data/0, incarnation/0, seq/0]).

-define(VERSION, 1).

%% Counts the starts of a robot's SAP.
-type incarnation() :: pos_integer().

%% Counts the messages of one incarnation.
-type seq() :: pos_integer().

%% A tuple, not a map: a message is copied and hashed at every hop.
-type data() :: {
    Source :: starl:robot_id(),
    incarnation(),
    seq(),
    Low :: seq(),
    %% the receivers' incarnations where they are not 1
    For :: #{starl:robot_id() => incarnation()},
    Type :: atom(),
    Body :: term()
}.

%% A packet on the air.
-type t() ::
    {starl, Version :: 1, data, data()}
    %% By has the message {Incarnation, Seq} of the receiver of this packet
    | {starl, 1, ack, By :: starl:robot_id(), incarnation(), incarnation(), seq()}
    %% By is a new incarnation and does not take the message
    | {starl, 1, refusal, By :: starl:robot_id(), incarnation(), incarnation(), seq()}
    %% a robot's SAP has started anew
    | {starl, 1, hello, starl:robot_id(), incarnation()}
    %% for all in range; nobody acknowledges it
    | {starl, 1, shout, Source :: starl:robot_id(), Type :: atom(), Body :: term()}.

%% @doc A message.
-spec data(data()) -> t().
data(Data) -> {starl, ?VERSION, data, Data}.

%% @doc `By', in its incarnation `Own', has the message `Seq' of its source's `Incarnation'.
-spec ack(By :: starl:robot_id(), Own :: incarnation(), incarnation(), seq()) -> t().
ack(By, Own, Incarnation, Seq) -> {starl, ?VERSION, ack, By, Own, Incarnation, Seq}.

%% @doc `By' did not take the message: it was meant for an earlier incarnation of `By'.
-spec refusal(By :: starl:robot_id(), Own :: incarnation(), incarnation(), seq()) -> t().
refusal(By, Own, Incarnation, Seq) -> {starl, ?VERSION, refusal, By, Own, Incarnation, Seq}.

%% @doc The robot's SAP has started with this incarnation.
-spec hello(starl:robot_id(), incarnation()) -> t().
hello(Robot, Incarnation) -> {starl, ?VERSION, hello, Robot, Incarnation}.

%% @doc A message of `Source' for all in range, without acknowledgement.
-spec shout(Source :: starl:robot_id(), Type :: atom(), Body :: term()) -> t().
shout(Source, Type, Body) -> {starl, ?VERSION, shout, Source, Type, Body}.
