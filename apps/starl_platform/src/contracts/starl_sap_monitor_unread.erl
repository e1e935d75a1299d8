%% @doc The messages that the robots' SAPs have delivered and that the applications have not read
%% yet. Pure; a part of {@link starl_sap_monitor}.
%%
%% An application reads the messages of a type in the order in which they were delivered. After a
%% crash of the application or of SAP, the messages delivered before may be gone or not.
-module(starl_sap_monitor_unread).

-export([new/0, delivered/5, read/5, crashed/2]).

-export_type([t/0]).

-type message() :: {Type :: term(), Source :: starl_monitor:robot_id(), Hash :: integer()}.

-record(unread, {
    %% the number of messages that are there for certain, and those of each type, in their order
    count = 0 :: non_neg_integer(),
    certain = #{} :: #{Type :: term() => queue:queue(message())},
    perhaps = [] :: [message()]
}).

-opaque t() :: #{Reader :: starl_monitor:robot_id() => #unread{}}.

%% @doc Nothing has been delivered.
-spec new() -> t().
new() -> #{}.

%% @doc A message is delivered to a robot; and the number of messages that are there for certain.
-spec delivered(starl_monitor:robot_id(), Type, Source, Hash :: integer(), t()) ->
    {pos_integer(), t()}
when
    Type :: term(), Source :: starl_monitor:robot_id().
delivered(Robot, Type, Source, Hash, All) ->
    #unread{count = Count, certain = Certain} = Unread = of_robot(Robot, All),
    Queue = maps:get(Type, Certain, queue:new()),
    Longer = queue:in({Type, Source, Hash}, Queue),
    {Count + 1, All#{
        Robot => Unread#unread{count = Count + 1, certain = Certain#{Type => Longer}}
    }}.

of_robot(Robot, All) -> maps:get(Robot, All, #unread{}).

%% @doc A robot reads a message: the next one of its type, another one, or one that was never delivered.
-spec read(starl_monitor:robot_id(), Type, Source, Hash :: integer(), t()) ->
    {ok, t()} | skipped | not_delivered
when
    Type :: term(), Source :: starl_monitor:robot_id().
read(Robot, Type, Source, Hash, All) ->
    #unread{count = Count, certain = Certain} = Unread = of_robot(Robot, All),
    Message = {Type, Source, Hash},
    case queue:out(maps:get(Type, Certain, queue:new())) of
        {{value, Message}, Rest} ->
            Left = Unread#unread{count = Count - 1, certain = Certain#{Type := Rest}},
            {ok, All#{Robot => Left}};
        {Next, _} ->
            read_earlier(Robot, Message, Next, Unread, All)
    end.

read_earlier(Robot, Message, Next, #unread{perhaps = Perhaps} = Unread, All) ->
    case lists:member(Message, Perhaps) of
        true -> {ok, All#{Robot => Unread#unread{perhaps = lists:delete(Message, Perhaps)}}};
        false when Next =:= empty -> not_delivered;
        false -> skipped
    end.

%% @doc SAP or the application of a robot has crashed.
-spec crashed(starl_monitor:robot_id(), t()) -> t().
crashed(Robot, All) ->
    case All of
        #{Robot := #unread{certain = Certain, perhaps = Perhaps}} ->
            Delivered = lists:append([queue:to_list(Queue) || Queue <- maps:values(Certain)]),
            All#{Robot := #unread{perhaps = Delivered ++ Perhaps}};
        #{} ->
            All
    end.
