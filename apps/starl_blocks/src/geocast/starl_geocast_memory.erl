%% @doc The permanent memory of delivered geocasts. It keeps ranges of message numbers for each
%% source. It does not depend on clocks, so no message is delivered twice, for any delay. Pure; a
%% part of {@link starl_geocast_flood}.
%%
%% The memory is bounded: it keeps a fixed number of ranges per source, and merges the two oldest if
%% there are more. The messages between these two then count as delivered, too. That affects only a
%% message that very many later ones of its source have overtaken, and only if these were delivered
%% here with gaps.
-module(starl_geocast_memory).

-export([new/1, add/2, is_member/2]).

-export_type([t/0]).

-type id() :: starl_geocast:id().

%% A number of a source: its incarnation and a sequence number.
-type place() :: {Incarnation :: pos_integer(), N :: pos_integer()}.

-record(memory, {
    ranges :: pos_integer(),
    %% closed ranges, newest first
    sources = #{} :: #{starl:robot_id() => [{Low :: place(), High :: place()}]}
}).

-opaque t() :: #memory{}.

%% @doc An empty memory that keeps this number of ranges per source.
-spec new(Ranges :: pos_integer()) -> t().
new(Ranges) -> #memory{ranges = Ranges}.

%% @doc Enters a delivered message.
-spec add(id(), t()) -> t().
add({Source, Incarnation, N}, #memory{ranges = Most, sources = Sources} = Memory) ->
    Ranges = insert({Incarnation, N}, maps:get(Source, Sources, [])),
    Memory#memory{sources = Sources#{Source => merged(length(Ranges) - Most, Ranges)}}.

%% @doc Has the message been delivered?
-spec is_member(id(), t()) -> boolean().
is_member({Source, Incarnation, N}, #memory{sources = Sources}) ->
    Number = {Incarnation, N},
    lists:any(
        fun({Low, High}) -> Low =< Number andalso Number =< High end, maps:get(Source, Sources, [])
    ).

insert(Number, [{_, High} = Newest | Rest]) when Number > High ->
    join({Number, Number}, [Newest | Rest]);
insert(Number, [{Low, _} | _] = Ranges) when Number >= Low ->
    Ranges;
insert(Number, [Newer | Rest]) ->
    [Next | Older] = insert(Number, Rest),
    join(Newer, [Next | Older]);
insert(Number, []) ->
    [{Number, Number}].

%% Numbers that follow each other make one range.
join({{Incarnation, Low}, High}, [{From, {Incarnation, To}} | Rest]) when To + 1 =:= Low ->
    [{From, High} | Rest];
join(Range, Ranges) ->
    [Range | Ranges].

merged(More, Ranges) when More =< 0 ->
    Ranges;
merged(_More, Ranges) ->
    {Newer, [{_, High}, {Low, _}]} = lists:split(length(Ranges) - 2, Ranges),
    Newer ++ [{Low, High}].
