%% @doc To whom the messages that come go: the machine that listens to their type, or, within
%% bounds, whoever will listen to it later. Pure; a part of {@link starl_sap}.
%%
%% A type has one listener. A listener that keeps messages until it reads them says how many it has
%% room for; one that handles them at once has room for all.
-module(starl_sap_inbox).

-export([new/1, listen/3, room/3, read/3, deliver/5, overhear/4]).

-export_type([t/0]).

-record(inbox, {
    limit :: non_neg_integer(),
    listeners = #{} :: #{starl_packet:type() => starl_machine:name()},
    %% how many messages more the machine can keep
    rooms = #{} :: #{starl_machine:name() => non_neg_integer()},
    %% messages that could not be handed on yet, latest first
    unclaimed = [] :: [{starl:robot_id(), starl_packet:type(), Body :: term()}]
}).

-opaque t() :: #inbox{}.

%% @doc Nobody listens; so many messages may wait for a listener.
-spec new(non_neg_integer()) -> t().
new(Limit) -> #inbox{limit = Limit}.

%% @doc A machine listens to a type, unless another one does, and gets what has waited for it.
-spec listen(starl_packet:type(), starl_machine:name(), t()) ->
    {[starl_machine:action()], t()} | {held_by, starl_machine:name()}.
listen(Type, Machine, #inbox{listeners = Listeners} = Inbox) ->
    case Listeners of
        #{Type := Holder} when Holder =/= Machine -> {held_by, Holder};
        #{} -> hand_on(Inbox#inbox{listeners = Listeners#{Type => Machine}})
    end.

%% @doc A machine has room for so many messages, whatever it had before.
-spec room(starl_machine:name(), non_neg_integer(), t()) -> t().
room(Machine, Room, #inbox{rooms = Rooms} = Inbox) ->
    Inbox#inbox{rooms = Rooms#{Machine => Room}}.

%% @doc A machine has read so many messages. One that has not said what room it has, as it has not
%% heard yet that SAP has restarted, will count them when it does.
-spec read(starl_machine:name(), non_neg_integer(), t()) -> {[starl_machine:action()], t()}.
read(Machine, Count, #inbox{rooms = Rooms} = Inbox) ->
    case Rooms of
        #{Machine := Room} -> hand_on(Inbox#inbox{rooms = Rooms#{Machine := Room + Count}});
        #{} -> {[], Inbox}
    end.

%% What has waited goes on, the oldest first, as far as there is room.
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

%% The machine that listens, and what has become of its room; nobody listens, or it has none.
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

%% @doc Delivers a message: to its listener, or to whoever will listen. If neither has room for it,
%% it is not taken.
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

%% @doc Passes a datagram on, if anybody listens. It is none of the messages that are counted: an
%% application gets it by its plain name.
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
