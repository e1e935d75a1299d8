%% @doc The messages that each source has sent, in each of its incarnations: the numbers of all of
%% them, and the outstanding ones in full. Pure; a part of {@link starl_sap_monitor}.
%%
%% The map is keyed by source first and by number within: an update of a small map costs a fraction
%% of an update of a large one.
-module(starl_sap_monitor_sources).

-export([new/0, add/3, find/2, put/3, close/2, was_sent/2, outstanding/1, outstanding/2]).

-export_type([t/0, id/0]).

-type id() :: {Source :: starl_monitor:robot_id(), Incarnation :: term(), Seq :: integer()}.

-type life() :: {
    Incarnation :: term(), Sent :: starl_sap_numbers:t(), #{Seq :: integer() => message()}
}.
-type message() :: starl_sap_monitor_message:t().

%% The lives of each source, latest first.
-opaque t() :: {Outstanding :: non_neg_integer(), #{starl_monitor:robot_id() => [life(), ...]}}.

%% @doc Nobody has sent anything.
-spec new() -> t().
new() -> {0, #{}}.

%% @doc Adds a message, unless its number was used before. `none': the message has no destination.
-spec add(id(), message() | none, t()) -> {ok, t()} | used.
add({Source, Incarnation, Seq}, Message, {N, Sources}) ->
    {_, Sent, Open} = life(Source, Incarnation, Sources),
    case starl_sap_numbers:add(Seq, Sent) of
        member ->
            used;
        Numbers when Message =:= none ->
            {ok, {N, live(Source, {Incarnation, Numbers, Open}, Sources)}};
        Numbers ->
            Life = {Incarnation, Numbers, Open#{Seq => Message}},
            {ok, {N + 1, live(Source, Life, Sources)}}
    end.

%% @doc An outstanding message.
-spec find(id(), t()) -> message() | none.
find({Source, Incarnation, Seq}, {_, Sources}) ->
    case life(Source, Incarnation, Sources) of
        {_, _, #{Seq := Message}} -> Message;
        {_, _, _} -> none
    end.

%% @doc Replaces an outstanding message by its next state.
-spec put(id(), message(), t()) -> t().
put({Source, Incarnation, Seq}, Message, {N, Sources}) ->
    {_, Sent, Open} = life(Source, Incarnation, Sources),
    {N, live(Source, {Incarnation, Sent, Open#{Seq := Message}}, Sources)}.

%% @doc Removes a message from the outstanding ones.
-spec close(id(), t()) -> t().
close({Source, Incarnation, Seq}, {N, Sources}) ->
    {_, Sent, #{Seq := _} = Open} = life(Source, Incarnation, Sources),
    {N - 1, live(Source, {Incarnation, Sent, maps:remove(Seq, Open)}, Sources)}.

%% @doc Was such a message ever sent?
-spec was_sent(id(), t()) -> boolean().
was_sent({Source, Incarnation, Seq}, {_, Sources}) ->
    {_, Sent, _} = life(Source, Incarnation, Sources),
    starl_sap_numbers:is_member(Seq, Sent).

%% @doc The number of outstanding messages.
-spec outstanding(t()) -> non_neg_integer().
outstanding({N, _}) -> N.

%% @doc A source's outstanding messages, sorted.
-spec outstanding(starl_monitor:robot_id(), t()) -> [id()].
outstanding(Source, {_, Sources}) ->
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
