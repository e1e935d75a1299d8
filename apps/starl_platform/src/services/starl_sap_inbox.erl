%% @doc Delivers incoming messages to the machine that listens to their type. Messages without a
%% listener wait for one, within bounds. Pure; a part of {@link starl_sap}.
%%
%% A type has one listener. A listener that keeps messages until it reads them announces its room
%% for messages. A listener that handles them at once has unlimited room.
-module(starl_sap_inbox).

-export([new/1, listen/3, room/3, read/3, deliver/5, overhear/4]).

-export_type([t/0]).

-record(inbox, {
    limit :: non_neg_integer(),
    listeners = #{} :: #{starl_packet:type() => starl_machine:name()},
    %% how many more messages the machine can keep
    rooms = #{} :: #{starl_machine:name() => non_neg_integer()},
    %% messages that have found no listener or no room yet, latest first
    unclaimed = [] :: [{starl:robot_id(), starl_packet:type(), Body :: term()}]
}).

-opaque t() :: #inbox{}.

%% @doc An inbox without listeners, in which `Limit' messages may wait for one.
-spec new(non_neg_integer()) -> t().
new(Limit) -> #inbox{limit = Limit}.

%% @doc Registers a machine as the listener of a type, unless another one has it, and hands on the
%% messages that have waited.
-spec listen(starl_packet:type(), starl_machine:name(), t()) ->
    {[starl_machine:action()], t()} | {held_by, starl_machine:name()}.
listen(Type, Machine, #inbox{listeners = Listeners} = Inbox) ->
    case Listeners of
        #{Type := Holder} when Holder =/= Machine -> {held_by, Holder};
        #{} -> hand_on(Inbox#inbox{listeners = Listeners#{Type => Machine}})
    end.

%% @doc Sets a machine's room, in place of the room that it had before.
-spec room(starl_machine:name(), non_neg_integer(), t()) -> t().
room(Machine, Room, #inbox{rooms = Rooms} = Inbox) ->
    Inbox#inbox{rooms = Rooms#{Machine => Room}}.

%% @doc Adds the messages that a machine has read to its room. A machine without an announced room
%% has not yet heard of a restart of SAP; it counts them when it announces its room.
-spec read(starl_machine:name(), non_neg_integer(), t()) -> {[starl_machine:action()], t()}.
read(Machine, Count, #inbox{rooms = Rooms} = Inbox) ->
    case Rooms of
        #{Machine := Room} -> hand_on(Inbox#inbox{rooms = Rooms#{Machine := Room + Count}});
        #{} -> {[], Inbox}
    end.

%% Hands on the messages that have waited, oldest first, as far as there is room.
hand_on(#inbox{unclaimed = Unclaimed} = Inbox) ->
    {Messages, Handed} = lists:foldl(
        fun hand_on/2,
        {[], Inbox#inbox{unclaimed = []}},
        lists:reverse(Unclaimed)
    ),
    {lists:reverse(Messages), Handed}.

hand_on({Source, Type, Body} = Message, {Messages, #inbox{unclaimed = Unclaimed} = Inbox}) ->
    case machine(Type, Inbox) of
        {Machine, Taken} -> {[message(Machine, Source, Type, Body) | Messages], Taken};
        _ -> {Messages, Inbox#inbox{unclaimed = [Message | Unclaimed]}}
    end.

%% The listener of a type, with its room reduced by one; else nobody listens, or it has no room.
machine(Type, #inbox{listeners = Listeners, rooms = Rooms} = Inbox) ->
    case Listeners of
        #{Type := Machine} ->
            case Rooms of
                #{Machine := 0} -> full;
                #{Machine := Room} -> {Machine, Inbox#inbox{rooms = Rooms#{Machine := Room - 1}}};
                #{} -> {Machine, Inbox}
            end;
        #{} ->
            nobody
    end.

%% @doc Delivers a message to its listener, or keeps it for a later one. Without room for it, the
%% message is not taken.
-spec deliver(starl:robot_id(), starl_packet:type(), Body :: term(), starl_sap_out:id(), t()) ->
    {[starl_machine:action()], t()} | full | unclaimed_full.
deliver(Source, Type, Body, Id, #inbox{unclaimed = Unclaimed, limit = Limit} = Inbox) ->
    case machine(Type, Inbox) of
        {Machine, Taken} ->
            {[delivered(Id, Type, Body), message(Machine, Source, Type, Body)], Taken};
        full ->
            full;
        nobody when length(Unclaimed) < Limit ->
            Kept = [{Source, Type, Body} | Unclaimed],
            {[delivered(Id, Type, Body)], Inbox#inbox{unclaimed = Kept}};
        nobody ->
            unclaimed_full
    end.

delivered(Id, Type, Body) -> {trace, {delivered, Id, Type, erlang:phash2(Body)}}.

%% @doc Passes a datagram on, if anybody listens. Datagrams are not counted as messages: an
%% application gets them under the plain name of their type.
-spec overhear(starl:robot_id(), starl_packet:type(), Body :: term(), t()) ->
    starl_machine:action().
overhear(Source, Type, Body, #inbox{listeners = Listeners}) ->
    case Listeners of
        #{Type := Machine} -> message(Machine, Source, plain(Type), Body);
        #{} -> {trace, {unheard, Source, Type}}
    end.

plain({app, Type}) -> Type;
plain(Type) -> Type.

message(Machine, Source, Type, Body) -> {cast, Machine, {message, Source, Type, Body}}.
