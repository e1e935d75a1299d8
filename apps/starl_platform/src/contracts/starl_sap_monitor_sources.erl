%% @doc The messages that each source has sent, in each of its incarnations: the numbers of all of
%% them, and the outstanding ones in full. Pure; a part of {@link starl_sap_monitor}.
%%
%% An undelivered message whose outcomes are all known stays outstanding for another `late_us'; then only its
%% sequence number is kept, in interval sets per (receiver, source, incarnation), and a later delivery is accepted
%% without a check of its content. Delivered messages leave nothing but an interval of sent
%% sequence numbers per incarnation; a second delivery of one of those counts as a duplicate, even
%% if the receiver was no addressee.
%%
%% The map is keyed by source first and by number within: an update of a small map costs a fraction
%% of an update of a large one.
-module(starl_sap_monitor_sources).

-export([new/0, add/3, find/2, put/3, close/2, was_sent/2, outstanding/1, outstanding/2]).
-export([change/3, forget/2, delivered_late/3]).

-export_type([t/0, id/0]).

-type id() :: {Source :: starl_monitor:robot_id(), Incarnation :: term(), Seq :: integer()}.

-type life() :: {
    Incarnation :: term(), Sent :: starl_sap_numbers:t(), #{Seq :: integer() => message()}
}.
-type message() :: starl_sap_monitor_message:t().

%% The numbers of messages that were lost, not delivered, and then forgotten.
-type forgotten() :: #{
    {Receiver :: starl_monitor:robot_id(), starl_monitor:robot_id(), Incarnation :: term()} =>
        starl_sap_numbers:t()
}.

%% The lives of each source, latest first.
-opaque t() :: {
    Outstanding :: non_neg_integer(), #{starl_monitor:robot_id() => [life(), ...]}, forgotten()
}.

%% @doc Nobody has sent anything.
-spec new() -> t().
new() -> {0, #{}, #{}}.

%% @doc Adds a message, unless its number was used before. `none': the message has no destination.
-spec add(id(), message() | none, t()) -> {ok, t()} | used.
add({Source, Incarnation, Seq}, Message, {N, Sources, Forgotten}) ->
    {_, Sent, Open} = life(Source, Incarnation, Sources),
    case starl_sap_numbers:add(Seq, Sent) of
        member ->
            used;
        Numbers when Message =:= none ->
            {ok, {N, live(Source, {Incarnation, Numbers, Open}, Sources), Forgotten}};
        Numbers ->
            Life = {Incarnation, Numbers, Open#{Seq => Message}},
            {ok, {N + 1, live(Source, Life, Sources), Forgotten}}
    end.

%% @doc An outstanding message.
-spec find(id(), t()) -> message() | none.
find({Source, Incarnation, Seq}, {_, Sources, _}) ->
    case life(Source, Incarnation, Sources) of
        {_, _, #{Seq := Message}} -> Message;
        {_, _, _} -> none
    end.

%% @doc Replaces an outstanding message by its next state.
-spec put(id(), message(), t()) -> t().
put({Source, Incarnation, Seq}, Message, {N, Sources, Forgotten}) ->
    {_, Sent, Open} = life(Source, Incarnation, Sources),
    {N, live(Source, {Incarnation, Sent, Open#{Seq := Message}}, Sources), Forgotten}.

%% @doc Changes a message, if it is outstanding.
-spec change(id(), fun((message()) -> message()), t()) -> t().
change(Id, Change, Sources) ->
    case find(Id, Sources) of
        none -> Sources;
        Message -> put(Id, Change(Message), Sources)
    end.

%% @doc Removes a message from the outstanding ones.
-spec close(id(), t()) -> t().
close({Source, Incarnation, Seq}, {N, Sources, Forgotten}) ->
    {_, Sent, #{Seq := _} = Open} = life(Source, Incarnation, Sources),
    {N - 1, live(Source, {Incarnation, Sent, maps:remove(Seq, Open)}, Sources), Forgotten}.

%% @doc Forgets an outstanding message, but for its number for each destination at which it was lost.
-spec forget(id(), t()) -> t().
forget(Id, Sources) ->
    case find(Id, Sources) of
        none ->
            Sources;
        Message ->
            {N, Left, Forgotten} = close(Id, Sources),
            Lost = starl_sap_monitor_message:lost(Message),
            {N, Left, lists:foldl(fun(To, Acc) -> keep(Id, To, Acc) end, Forgotten, Lost)}
    end.

keep({Source, Incarnation, Seq}, Dest, Forgotten) ->
    Key = {Dest, Source, Incarnation},
    case starl_sap_numbers:add(Seq, maps:get(Key, Forgotten, starl_sap_numbers:new())) of
        member -> Forgotten;
        More -> Forgotten#{Key => More}
    end.

%% @doc A message that is not outstanding was delivered. Was it lost there, and forgotten?
-spec delivered_late(Receiver :: starl_monitor:robot_id(), id(), t()) -> t() | unexpected.
delivered_late(Robot, {Source, Incarnation, Seq}, {N, Sources, Forgotten}) ->
    Key = {Robot, Source, Incarnation},
    case starl_sap_numbers:remove(Seq, maps:get(Key, Forgotten, starl_sap_numbers:new())) of
        absent -> unexpected;
        Left -> {N, Sources, put_left(Key, Left, Forgotten)}
    end.

put_left(Key, Left, Forgotten) ->
    case starl_sap_numbers:is_empty(Left) of
        true -> maps:remove(Key, Forgotten);
        false -> Forgotten#{Key := Left}
    end.

%% @doc Was such a message ever sent?
-spec was_sent(id(), t()) -> boolean().
was_sent({Source, Incarnation, Seq}, {_, Sources, _}) ->
    {_, Sent, _} = life(Source, Incarnation, Sources),
    starl_sap_numbers:is_member(Seq, Sent).

%% @doc The number of outstanding messages.
-spec outstanding(t()) -> non_neg_integer().
outstanding({N, _, _}) -> N.

%% @doc A source's outstanding messages, sorted.
-spec outstanding(starl_monitor:robot_id(), t()) -> [id()].
outstanding(Source, {_, Sources, _}) ->
    Lives = maps:get(Source, Sources, []),
    lists:sort([{Source, Inc, Seq} || {Inc, _, Open} <- Lives, Seq <- maps:keys(Open)]).

life(Source, Incarnation, Sources) ->
    case Sources of
        #{Source := [{Incarnation, _, _} = Latest | _]} -> Latest;
        #{Source := Lives} -> among(lists:keyfind(Incarnation, 1, Lives), Incarnation);
        #{} -> among(false, Incarnation)
    end.

among(false, Incarnation) -> {Incarnation, starl_sap_numbers:new(), #{}};
among(Life, _Incarnation) -> Life.

live(Source, {Incarnation, _, _} = Life, Sources) ->
    case Sources of
        #{Source := [{Incarnation, _, _} | Earlier]} ->
            Sources#{Source := [Life | Earlier]};
        #{Source := Lives} ->
            case lists:keymember(Incarnation, 1, Lives) of
                true -> Sources#{Source := lists:keyreplace(Incarnation, 1, Lives, Life)};
                false -> Sources#{Source := [Life | Lives]}
            end;
        #{} ->
            Sources#{Source => [Life]}
    end.
