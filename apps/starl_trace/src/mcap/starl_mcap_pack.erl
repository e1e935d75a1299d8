%% @doc Joins chunks into larger ones and packs these with Zstandard, where that is available. A
%% recording has a chunk for each second. That is too little to pack well, and too many chunks to
%% start a program for each. If the program fails, this and all later chunks stay as they are.
-module(starl_mcap_pack).

-export([new/1, add/2, finish/1, failure/1]).

-export_type([t/0, chunk/0]).

%% A chunk as the writer takes it: see {@link starl_mcap_writer:sealed/2}.
-type chunk() ::
    {
        Size :: non_neg_integer(),
        Crc :: non_neg_integer(),
        Compression :: binary(),
        Records :: binary(),
        starl_mcap_chunk:index()
    }.

-record(pack, {
    %% is anything packed at all?
    state :: packs | as_is | {failed, starl_mcap_zstd:reason()},
    %% the chunks that wait to be joined, the latest first, and their size
    waiting = [] :: [chunk()],
    size = 0 :: non_neg_integer()
}).

-opaque t() :: #pack{}.

%% A bad byte costs no more. Chunks of 1 MiB would be smaller by less than a hundredth.
-define(JOINED_BYTES, 131072).

%% @doc Nothing waits. `as_is': chunks are neither joined nor packed.
-spec new(packed | as_is) -> t().
new(as_is) ->
    #pack{state = as_is};
new(packed) ->
    case starl_mcap_zstd:is_there() of
        true -> #pack{state = packs};
        false -> #pack{state = as_is}
    end.

%% @doc Adds a chunk: those that can be written now. A chunk that is packed already stays as it is.
-spec add(chunk(), t()) -> {[chunk()], t()}.
add({Size, _, <<>>, _, _} = Chunk, #pack{state = packs, waiting = Waiting, size = Sum} = Pack) ->
    Next = Pack#pack{waiting = [Chunk | Waiting], size = Sum + Size},
    case Sum + Size >= ?JOINED_BYTES of
        true -> finish(Next);
        false -> {[], Next}
    end;
add(Chunk, Pack) ->
    {Chunks, Next} = finish(Pack),
    {Chunks ++ [Chunk], Next}.

%% @doc The chunks that wait.
-spec finish(t()) -> {[chunk()], t()}.
finish(#pack{waiting = []} = Pack) ->
    {[], Pack};
finish(#pack{waiting = Waiting} = Pack) ->
    Chunks = lists:reverse(Waiting),
    Bytes = iolist_to_binary([Records || {_, _, _, Records, _} <- Chunks]),
    Empty = Pack#pack{waiting = [], size = 0},
    case starl_mcap_zstd:compress(Bytes) of
        {ok, Packed} when byte_size(Packed) < byte_size(Bytes) ->
            {[joined(Chunks, Bytes, Packed)], Empty};
        {ok, _Larger} ->
            {Chunks, Empty};
        {error, Reason} ->
            {Chunks, Empty#pack{state = {failed, Reason}}}
    end.

joined(Chunks, Bytes, Packed) ->
    {_, Index} = lists:foldl(fun join/2, {0, #{}}, Chunks),
    {byte_size(Bytes), erlang:crc32(Bytes), <<"zstd">>, Packed, Index}.

%% The messages of a chunk lie behind those of the chunks before it.
join({Size, _, _, _, Index}, {Before, Joined}) ->
    Moved = fun(Channel, Entries, All) ->
        Later = [{Time, Before + At} || {Time, At} <- Entries],
        All#{Channel => Later ++ maps:get(Channel, All, [])}
    end,
    {Before + Size, maps:fold(Moved, Joined, Index)}.

%% @doc Why chunks were not packed.
-spec failure(t()) -> none | starl_mcap_zstd:reason().
failure(#pack{state = {failed, Reason}}) -> Reason;
failure(_Pack) -> none.
