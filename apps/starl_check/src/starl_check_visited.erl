%% @doc The set of states that a search has met, in little memory. Each state is identified by a
%% hash of 128 bits and has a number, from 0 on, in the order of meeting. With a hundred million
%% states the probability that two of them share a hash is below 1 in 10^22.
%%
%% The hashes lie in open-addressed tables (linear probing) of 64-bit words outside the heap, with
%% three words per place and at least three of ten places free: 24 to 69 bytes per state. One more
%% word per state holds the path by which it was met.
-module(starl_check_visited).

-export([new/0, meet/2, count/1, way/2, put_way/3, most_steps/0]).

-export_type([t/0, state_number/0, way/0]).

-type state_number() :: non_neg_integer().

%% The previous state, the number of its run, and the number of steps from the start.
-type way() :: {From :: state_number(), Run :: 0..65535, Steps :: 0..4095}.

%% The first bits of a hash select the table, so that tables grow one at a time.
-define(TABLE_BITS, 6).
-define(FIRST_SIZE, 256).
-define(WORDS, 3).
%% Ways are kept in pieces of this size.
-define(PIECE, 65536).

-record(table, {size = ?FIRST_SIZE :: pos_integer(), words :: atomics:atomics_ref()}).

-record(visited, {
    tables :: tuple(),
    count = 0 :: non_neg_integer(),
    ways = #{} :: #{non_neg_integer() => atomics:atomics_ref()}
}).

-opaque t() :: #visited{}.

%% @doc The empty set.
-spec new() -> t().
new() -> #visited{tables = list_to_tuple([table(?FIRST_SIZE) || _ <- lists:seq(1, tables())])}.

tables() -> 1 bsl ?TABLE_BITS.

%% The last word is the number of places in use.
table(Size) -> #table{size = Size, words = atomics:new(?WORDS * Size + 1, [{signed, false}])}.

%% @doc Looks up a state by its hash; a new state gets the next number.
-spec meet(<<_:128>>, t()) -> {new | known, state_number(), t()}.
meet(<<A:64, B:64>> = Hash, #visited{tables = Tables, count = Count} = Visited) ->
    <<Which:?TABLE_BITS, _/bitstring>> = Hash,
    Table = element(Which + 1, Tables),
    case put_hash(A, B, Count, Table) of
        {known, Number} -> {known, Number, Visited};
        new -> {new, Count, roomy(Which + 1, Table, Visited#visited{count = Count + 1})}
    end.

%% The number is stored plus one, because 0 marks a free place.
put_hash(A, B, Number, #table{size = Size, words = Words} = Table) ->
    Place = place(B rem Size, A, B, Table),
    case atomics:get(Words, Place + 2) of
        0 ->
            ok = atomics:put(Words, Place, A),
            ok = atomics:put(Words, Place + 1, B),
            ok = atomics:put(Words, Place + 2, Number + 1),
            new;
        Known ->
            {known, Known - 1}
    end.

%% The place of a hash, or the free place for it.
place(Index, A, B, #table{size = Size, words = Words} = Table) ->
    Place = ?WORDS * Index + 1,
    case atomics:get(Words, Place + 2) of
        0 ->
            Place;
        _ ->
            case atomics:get(Words, Place) =:= A andalso atomics:get(Words, Place + 1) =:= B of
                true -> Place;
                false -> place((Index + 1) rem Size, A, B, Table)
            end
    end.

%% Doubles a table that is seven tenths full.
roomy(Which, #table{size = Size, words = Words} = Table, #visited{tables = Tables} = Visited) ->
    Full = ?WORDS * Size + 1,
    case atomics:add_get(Words, Full, 1) of
        Taken when 10 * Taken > 7 * Size ->
            Larger = table(2 * Size),
            ok = atomics:put(Larger#table.words, 2 * ?WORDS * Size + 1, Taken),
            ok = copy(0, Table, Larger),
            Visited#visited{tables = setelement(Which, Tables, Larger)};
        _ ->
            Visited
    end.

copy(Size, #table{size = Size}, _Larger) ->
    ok;
copy(Index, #table{words = Words} = Table, Larger) ->
    Place = ?WORDS * Index + 1,
    case atomics:get(Words, Place + 2) of
        0 ->
            ok;
        Kept ->
            new = put_hash(
                atomics:get(Words, Place), atomics:get(Words, Place + 1), Kept - 1, Larger
            )
    end,
    copy(Index + 1, Table, Larger).

%% @doc The number of states.
-spec count(t()) -> non_neg_integer().
count(#visited{count = Count}) -> Count.

%% @doc The largest number of steps that a way can represent.
-spec most_steps() -> pos_integer().
most_steps() -> 4095.

%% @doc The way by which a state was met.
-spec way(state_number(), t()) -> way().
way(Number, #visited{ways = Ways}) ->
    Word = atomics:get(maps:get(Number div ?PIECE, Ways), Number rem ?PIECE + 1),
    <<From:36, Run:16, Steps:12>> = <<Word:64>>,
    {From, Run, Steps}.

%% @doc Sets the way by which a state was met.
-spec put_way(state_number(), way(), t()) -> t().
put_way(Number, {From, Run, Steps} = Way, #visited{ways = Ways} = Visited) when
    From < 1 bsl 36, Run < 1 bsl 16, Steps < 1 bsl 12
->
    case Ways of
        #{Number div ?PIECE := Piece} ->
            <<Word:64>> = <<From:36, Run:16, Steps:12>>,
            ok = atomics:put(Piece, Number rem ?PIECE + 1, Word),
            Visited;
        #{} ->
            Piece = atomics:new(?PIECE, [{signed, false}]),
            put_way(Number, Way, Visited#visited{ways = Ways#{Number div ?PIECE => Piece}})
    end.
