%% @doc To whom the messages that come go: the machine that listens to their type, or, within
%% bounds, whoever will listen to it later. Pure; a part of {@link starl_sap}.
-module(starl_sap_inbox).

-export([new/1, listen/3, has_room/2, deliver/5, overhear/4]).

-export_type([t/0]).

-record(inbox, {
    limit :: non_neg_integer(),
    listeners = #{} :: #{atom() => starl_machine:name()},
    %% messages without a listener, latest first
    unclaimed = [] :: [{starl:robot_id(), Type :: atom(), Body :: term()}]
}).

-opaque t() :: #inbox{}.

%% @doc Nobody listens; so many messages may wait for a listener.
-spec new(non_neg_integer()) -> t().
new(Limit) -> #inbox{limit = Limit}.

%% @doc A machine listens to a type, and gets what has waited for it.
-spec listen(Type :: atom(), starl_machine:name(), t()) -> {[starl_machine:action()], t()}.
listen(Type, Machine, #inbox{listeners = Listeners, unclaimed = Unclaimed} = Inbox) ->
    {Mine, Rest} = lists:partition(fun({_, T, _}) -> T =:= Type end, Unclaimed),
    Messages = [message(Machine, Source, Type, Body) || {Source, _, Body} <- lists:reverse(Mine)],
    {Messages, Inbox#inbox{listeners = Listeners#{Type => Machine}, unclaimed = Rest}}.

%% @doc Is there a listener, or room to wait for one?
-spec has_room(Type :: atom(), t()) -> boolean().
has_room(Type, #inbox{listeners = Listeners, unclaimed = Unclaimed, limit = Limit}) ->
    is_map_key(Type, Listeners) orelse length(Unclaimed) < Limit.

%% @doc Delivers a message for which there is room.
-spec deliver(starl:robot_id(), Type :: atom(), Body :: term(), starl_sap_out:id(), t()) ->
    {[starl_machine:action()], t()}.
deliver(Source, Type, Body, Id, #inbox{listeners = Listeners, unclaimed = Unclaimed} = Inbox) ->
    Trace = {trace, {delivered, Id, Type, erlang:phash2(Body)}},
    case Listeners of
        #{Type := Machine} -> {[Trace, message(Machine, Source, Type, Body)], Inbox};
        #{} -> {[Trace], Inbox#inbox{unclaimed = [{Source, Type, Body} | Unclaimed]}}
    end.

%% @doc Passes a datagram on, if anybody listens.
-spec overhear(starl:robot_id(), Type :: atom(), Body :: term(), t()) -> starl_machine:action().
overhear(Source, Type, Body, #inbox{listeners = Listeners}) ->
    case Listeners of
        #{Type := Machine} -> message(Machine, Source, Type, Body);
        #{} -> {trace, {unheard, Source, Type}}
    end.

message(Machine, Source, Type, Body) -> {cast, Machine, {message, Source, Type, Body}}.
