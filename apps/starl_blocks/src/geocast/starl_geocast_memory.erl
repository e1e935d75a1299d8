%% @doc Which geocasts a robot has delivered, for ever: by source, as ranges of their numbers. No
%% clock has a say in it, so nothing is delivered twice however long a message travels. Pure; a
%% part of {@link starl_geocast_store}.
%%
%% The memory is bounded: of each source at most so many ranges are kept, and where there are more
%% the two oldest become one. What lay between them counts as delivered, too: a message that its
%% source has followed up with that many others, which came here with gaps before it did.
-module(starl_geocast_memory).

-export([new/1, add/2, is_member/2]).

-export_type([t/0]).

-type id() :: starl_geocast_store:id().

%% A number of a source: its incarnation and the how many-eth.
-type place() :: {Incarnation :: pos_integer(), N :: pos_integer()}.

-record(memory, {
    ranges :: pos_integer(),
    %% closed ranges, newest first
    sources = #{} :: #{starl:robot_id() => [{Low :: place(), High :: place()}]}
}).

-opaque t() :: #memory{}.

%% @doc Nothing has been delivered; so many ranges are kept of a source.
-spec new(Ranges :: pos_integer()) -> t().
new(Ranges) -> #memory{ranges = Ranges}.

%% @doc This one is delivered.
-spec add(id(), t()) -> t().
add({Source, Incarnation, N}, #memory{ranges = Most, sources = Sources} = Memory) ->
    Ranges = insert({Incarnation, N}, maps:get(Source, Sources, [])),
    Memory#memory{sources = Sources#{Source => merged(length(Ranges) - Most, Ranges)}}.

%% @doc Has it been delivered?
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
