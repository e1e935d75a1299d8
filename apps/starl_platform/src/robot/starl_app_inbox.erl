%% @doc Keeps the messages that wait for a sequential application to read them, and the types that
%% it listens to. A pure part of {@link starl_app_proc}.
%%
%% SAP never hands over more messages than there is room for. It gets the room with the first type
%% that the application listens to, and later the number of messages read. Other senders, such as
%% geocast, are not held back: a message without room is dropped.
-module(starl_app_inbox).

-export([new/0, listen/2, subscribed/2, restarted/2, sensed/4]).
-export([put/2, take/3, read/3, step/1, taken_back/1]).

-export_type([t/0, message/0]).

-type message() :: {From :: starl:robot_id(), starl_packet:type(), Body :: term()}.

-define(LIMIT, 1000).
%% Messages read are reported to SAP in batches of this size, or one by one when room is scarce.
-define(READ_AT_ONCE, 100).

-record(inbox, {
    %% in their order
    waiting = [] :: [message()],
    %% subscriptions, repeated to a machine that has restarted
    listening = [] :: [{starl_machine:name(), Request :: term()}],
    %% whether SAP knows the room; the number of messages read of which SAP does not know
    room_known = false :: boolean(),
    unreported = 0 :: non_neg_integer(),
    %% while a step may be taken back: the messages that it has read, newest first; those of a step
    %% that was taken back
    read = [] :: [message()],
    again = [] :: [message()]
}).

-opaque t() :: #inbox{}.

%% @doc No message yet.
-spec new() -> t().
new() -> #inbox{}.

%% @doc The application listens to a type of message of SAP. Returns the request to SAP, with the
%% room if SAP does not know it yet.
-spec listen(starl_packet:type(), t()) -> {Request :: tuple(), t()}.
listen(Type, #inbox{room_known = true} = Inbox) ->
    {{listen, Type, app}, Inbox};
listen(Type, #inbox{waiting = Waiting} = Inbox) ->
    Room = max(0, ?LIMIT - length(Waiting)),
    {{listen, Type, app, Room}, Inbox#inbox{room_known = true, unreported = 0}}.

%% @doc The subscriptions among these actions have been made.
-spec subscribed([starl_machine:action()], t()) -> t().
subscribed(Actions, #inbox{listening = Before} = Inbox) ->
    case lists:foldl(fun listening/2, Before, Actions) of
        Before -> Inbox;
        Listening -> Inbox#inbox{listening = Listening}
    end.

listening({cast, sap, {listen, Type, app, _Room}}, Known) ->
    lists:umerge([{sap, {listen, Type, app}}], Known);
listening({cast, Machine, {listen, _, _} = Request}, Known) ->
    lists:umerge([{Machine, Request}], Known);
listening({cast, Machine, {subscribe, _, _} = Request}, Known) ->
    lists:umerge([{Machine, Request}], Known);
listening(_, Known) ->
    Known.

%% @doc A machine has restarted, and has lost its listeners: the subscriptions to it. SAP knows of no room,
%% either.
-spec restarted(starl_machine:name(), t()) -> {[Request :: term()], t()}.
restarted(Machine, #inbox{listening = Listening, room_known = Known} = Inbox) ->
    Requests = [Request || {M, Request} <- Listening, M =:= Machine],
    {Requests, Inbox#inbox{room_known = Known andalso Machine =/= sap}}.

%% @doc What has come to this robot's application: what the body feels is a message of the robot itself, if the
%% application listens to it.
-spec sensed(Type, Content :: term(), starl:robot_id(), t()) -> {Type, Content :: term()} when
    Type :: starl_machine:event_type().
sensed(info, {sensed, Sense} = Sensed, Id, #inbox{listening = Listening}) ->
    case lists:member({sap, {listen, {app, sense}, app}}, Listening) of
        true -> {cast, {message, Id, sense, Sense}};
        false -> {info, Sensed}
    end;
sensed(Type, Content, _Id, _Inbox) ->
    {Type, Content}.

%% @doc A message has come that the application does not wait for.
-spec put(message(), t()) -> {ok, t()} | full.
put({_From, {app, _}, _Body} = Message, Inbox) ->
    {ok, behind(Message, Inbox)};
put(Message, #inbox{waiting = Waiting} = Inbox) ->
    case length(Waiting) < ?LIMIT of
        true -> {ok, behind(Message, Inbox)};
        false -> full
    end.

behind(Message, #inbox{waiting = Waiting} = Inbox) -> Inbox#inbox{waiting = Waiting ++ [Message]}.

%% @doc Reads the first message of these types, first those that a step has read that was taken back.
-spec take([starl_packet:type()], MayCrash :: boolean(), t()) ->
    {message(), [starl_machine:action()], t()} | none.
take(Types, MayCrash, #inbox{waiting = Waiting, again = Again} = Inbox) ->
    case {first(Types, Again), first(Types, Waiting)} of
        {{Message, Left}, _} ->
            {Message, [], noted(Message, MayCrash, Inbox#inbox{again = Left})};
        {none, {Message, Left}} ->
            {Actions, Next} = read(Message, MayCrash, Inbox#inbox{waiting = Left}),
            {Message, Actions, Next};
        {none, none} ->
            none
    end.

first(_Types, []) ->
    none;
first(Types, Messages) ->
    case lists:splitwith(fun({_, Type, _}) -> not lists:member(Type, Types) end, Messages) of
        {Before, [Message | After]} -> {Message, Before ++ After};
        {_, []} -> none
    end.

%% @doc The application reads a message: one of SAP is traced, for the monitor, and its room given back.
-spec read(message(), MayCrash :: boolean(), t()) -> {[starl_machine:action()], t()}.
read({From, {app, _} = Type, Body} = Message, MayCrash, Inbox) ->
    #inbox{waiting = Waiting, unreported = Unreported} = Inbox,
    Reported = to_report(Unreported + 1, ?LIMIT - length(Waiting)),
    Credit = [{cast, sap, {read, app, Reported}} || Reported > 0],
    {
        [{trace, {read, From, Type, erlang:phash2(Body)}} | Credit],
        noted(Message, MayCrash, Inbox#inbox{unreported = Unreported + 1 - Reported})
    };
read(Message, MayCrash, Inbox) ->
    {[], noted(Message, MayCrash, Inbox)}.

to_report(Unreported, Free) when Unreported >= ?READ_AT_ONCE; Free - Unreported < ?READ_AT_ONCE ->
    Unreported;
to_report(_Unreported, _Free) ->
    0.

noted(Message, true, #inbox{read = Read} = Inbox) -> Inbox#inbox{read = [Message | Read]};
noted(_Message, false, Inbox) -> Inbox.

%% @doc A step begins that may be taken back.
-spec step(t()) -> t().
step(Inbox) -> Inbox#inbox{read = []}.

%% @doc The step was taken back: what it has read will be read again.
-spec taken_back(t()) -> t().
taken_back(#inbox{read = Read, again = Again} = Inbox) ->
    Inbox#inbox{read = [], again = lists:reverse(Read, Again)}.
