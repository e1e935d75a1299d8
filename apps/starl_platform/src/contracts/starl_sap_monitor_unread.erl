%% @doc The messages that a robot's SAP has delivered to its application and the application has not
%% read yet. Pure; a part of {@link starl_sap_monitor}.
%%
%% An application reads the messages of a type in the order in which they were delivered. After a
%% crash of the application or of SAP, the messages delivered before may be gone or not.
-module(starl_sap_monitor_unread).

-export([new/0, delivered/4, read/4, crashed/1, count/1]).

-export_type([t/0]).

-type message() :: {Type :: term(), Source :: starl_monitor:robot_id(), Hash :: integer()}.

-record(unread, {
    %% the number of messages that are there for certain, and those of each type, in their order
    count = 0 :: non_neg_integer(),
    certain = #{} :: #{Type :: term() => queue:queue(message())},
    perhaps = [] :: [message()]
}).

-opaque t() :: #unread{}.

%% @doc Nothing has been delivered.
-spec new() -> t().
new() -> #unread{}.

%% @doc A message is delivered.
-spec delivered(Type :: term(), starl_monitor:robot_id(), Hash :: integer(), t()) -> t().
delivered(Type, Source, Hash, #unread{count = Count, certain = Certain} = Unread) ->
    Queue = maps:get(Type, Certain, queue:new()),
    Longer = queue:in({Type, Source, Hash}, Queue),
    Unread#unread{count = Count + 1, certain = Certain#{Type => Longer}}.

%% @doc Reads a message: the next one of its type, another one, or one that was never delivered.
-spec read(Type :: term(), starl_monitor:robot_id(), Hash :: integer(), t()) ->
    {ok, t()} | skipped | not_delivered.
read(Type, Source, Hash, #unread{count = Count, certain = Certain} = Unread) ->
    Message = {Type, Source, Hash},
    case queue:out(maps:get(Type, Certain, queue:new())) of
        {{value, Message}, Rest} ->
            {ok, Unread#unread{count = Count - 1, certain = Certain#{Type := Rest}}};
        {Next, _} ->
            read_earlier(Message, Next, Unread)
    end.

read_earlier(Message, Next, #unread{perhaps = Perhaps} = Unread) ->
    case lists:member(Message, Perhaps) of
        true -> {ok, Unread#unread{perhaps = lists:delete(Message, Perhaps)}};
        false when Next =:= empty -> not_delivered;
        false -> skipped
    end.

%% @doc SAP or the application has crashed.
-spec crashed(t()) -> t().
crashed(#unread{certain = Certain, perhaps = Perhaps}) ->
    Delivered = lists:append([queue:to_list(Queue) || Queue <- maps:values(Certain)]),
    #unread{perhaps = Delivered ++ Perhaps}.

%% @doc The number of messages that are there for certain.
-spec count(t()) -> non_neg_integer().
count(#unread{count = Count}) -> Count.
