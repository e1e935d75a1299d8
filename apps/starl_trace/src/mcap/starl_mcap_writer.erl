%% @doc Builds an MCAP file: chunks with their indexes, checksums, and the summary at the end. A
%% pure module: it gives bytes, which the caller writes in their order.
%%
%% Messages wait in an open chunk until {@link flush/1}. What was flushed before a crash can be
%% recovered ({@link starl_mcap_reader}). The first chunk holds all schemas and channels, the
%% summary repeats them. Memory grows by about 200 bytes a chunk, for the summary.
-module(starl_mcap_writer).

-export([new/2, message/4, sealed/2, known/2, missing/2, other/2, flush/1, waiting/1, finish/1]).

-export_type([t/0, channels/0]).

%% Schemas and channels, as they are written.
-type channels() :: [starl_mcap_record:t()].

-record(writer, {
    %% bytes given so far, and their checksum
    offset = 0 :: non_neg_integer(),
    crc = 0 :: non_neg_integer(),
    channels :: channels(),
    is_told = false :: boolean(),
    %% the open chunk: its records, the latest first, their size, its messages by channel
    records = [] :: [iodata()],
    size = 0 :: non_neg_integer(),
    index = #{} :: starl_mcap_chunk:index(),
    sequences = #{} :: #{starl_mcap_record:id() => non_neg_integer()},
    %% for the summary: encoded, the latest first
    chunks = [] :: [binary()],
    chunk_count = 0 :: non_neg_integer(),
    attachments = [] :: [binary()],
    metadata = [] :: [binary()],
    %% the times of the first and the last message
    start = none :: starl_mcap_record:time() | none,
    last = 0 :: starl_mcap_record:time(),
    counts = #{} :: #{starl_mcap_record:id() => pos_integer()}
}).

-opaque t() :: #writer{}.

%% @doc A file of these schemas and channels, and its first bytes.
-spec new(Library :: unicode:chardata(), channels()) -> {iodata(), t()}.
new(Library, Channels) ->
    Head = [starl_mcap_record:magic(), starl_mcap_record:encode({header, "", Library})],
    given(Head, #writer{channels = Channels}).

%% @doc Adds a message to the open chunk.
-spec message(starl_mcap_record:id(), starl_mcap_record:time(), iodata(), t()) -> t().
message(Channel, Time, Data, #writer{sequences = Sequences} = Writer0) ->
    Sequence = maps:get(Channel, Sequences, 0),
    Record = {message, Channel, Sequence band 16#ffffffff, Time, Time, Data},
    #writer{index = Index, size = Size} = Writer = opened(Writer0),
    Entries = maps:get(Channel, Index, []),
    added(starl_mcap_record:encode(Record), Writer#writer{
        index = Index#{Channel => [{Time, Size} | Entries]},
        sequences = Sequences#{Channel => Sequence + 1}
    }).

%% The first chunk begins with the schemas and channels.
opened(#writer{is_told = true} = Writer) ->
    Writer;
opened(#writer{channels = Channels} = Writer) ->
    Records = [starl_mcap_record:encode(Record) || Record <- Channels],
    added(Records, Writer#writer{is_told = true}).

added(Bytes, #writer{records = Records, size = Size} = Writer) ->
    Writer#writer{records = [Bytes | Records], size = Size + iolist_size(Bytes)}.

%% @doc The size of the open chunk, in bytes.
-spec waiting(t()) -> non_neg_integer().
waiting(#writer{size = Size}) -> Size.

%% @doc Closes the open chunk: the bytes to write.
-spec flush(t()) -> {iodata(), t()}.
flush(#writer{index = Index} = Writer) when map_size(Index) =:= 0 ->
    {[], Writer};
flush(#writer{records = Records, size = Size, index = Index} = Writer) ->
    Bytes = lists:reverse(Records),
    Chunk = {Size, erlang:crc32(Bytes), <<>>, Bytes, Index},
    sealed(Chunk, Writer#writer{records = [], size = 0, index = #{}}).

%% @doc Adds a whole chunk: the uncompressed size and checksum of its records, its compression, the
%% records, and its messages by channel. The open chunk must be empty.
-spec sealed({Size, Crc, Compression, Records, starl_mcap_chunk:index()}, t()) ->
    {iodata(), t()}
when
    Size :: non_neg_integer(),
    Crc :: non_neg_integer(),
    Compression :: binary(),
    Records :: iodata().
sealed({Size, Crc, Compression, Records, Index}, #writer{offset = Offset} = Writer) ->
    Times = [Time || Entries <- maps:values(Index), {Time, _} <- Entries],
    {Start, End} = {lists:min(Times), lists:max(Times)},
    Chunk = starl_mcap_record:encode({chunk, Start, End, Size, Crc, Compression, Records}),
    Length = iolist_size(Chunk),
    {Indexes, Offsets, IndexLength} = indexes(Index, Offset + Length),
    Compressed = iolist_size(Records),
    ChunkIndex = starl_mcap_record:encode(
        {chunk_index, Start, End, Offset, Length, Offsets, IndexLength, Compression, Compressed,
            Size}
    ),
    given([Chunk, Indexes], counted(Start, End, Index, kept(ChunkIndex, Writer))).

indexes(Index, From) ->
    lists:foldl(
        fun({Channel, Entries}, {Bytes, Offsets, Length}) ->
            Record = {message_index, Channel, lists:sort(Entries)},
            Encoded = starl_mcap_record:encode(Record),
            {[Bytes, Encoded], Offsets ++ [{Channel, From + Length}], Length + iolist_size(Encoded)}
        end,
        {[], [], 0},
        lists:sort(maps:to_list(Index))
    ).

kept(ChunkIndex, #writer{chunks = Chunks, chunk_count = N} = Writer) ->
    Writer#writer{chunks = [iolist_to_binary(ChunkIndex) | Chunks], chunk_count = N + 1}.

counted(Start, End, Index, #writer{start = First, last = Last, counts = Counts} = Writer) ->
    Count = fun(Channel, Entries, Sum) ->
        Sum#{Channel => length(Entries) + maps:get(Channel, Sum, 0)}
    end,
    Writer#writer{
        %% an atom is larger than any number
        start = min(First, Start),
        last = max(Last, End),
        counts = maps:fold(Count, Counts, Index)
    }.

%% @doc Takes schemas and channels of sealed chunks into the summary.
-spec known([starl_mcap_record:t()], t()) -> t().
known(Records, #writer{channels = Channels} = Writer) ->
    New = [R || R <- Records, is_channel(R), not lists:member(R, Channels)],
    Writer#writer{channels = Channels ++ lists:usort(New), is_told = true}.

%% @doc Those of these schemas and channels that the file has not.
-spec missing(channels(), t()) -> channels().
missing(Records, #writer{channels = Channels}) ->
    Numbers = [{element(1, R), element(2, R)} || R <- Channels],
    [R || R <- Records, not lists:member({element(1, R), element(2, R)}, Numbers)].

is_channel(Record) -> lists:member(element(1, Record), [schema, channel]).

%% @doc Adds a schema, a channel, metadata or an attachment, outside chunks. The open chunk must be
%% empty.
-spec other(starl_mcap_record:t(), t()) -> {iodata(), t()}.
other(Record, Writer) when element(1, Record) =:= schema; element(1, Record) =:= channel ->
    given(starl_mcap_record:encode(Record), known([Record], Writer));
other({metadata, Name, _} = Record, #writer{offset = Offset, metadata = Known} = Writer) ->
    Bytes = starl_mcap_record:encode(Record),
    Index = starl_mcap_record:encode({metadata_index, Offset, iolist_size(Bytes), Name}),
    given(Bytes, Writer#writer{metadata = [iolist_to_binary(Index) | Known]});
other({attachment, Log, Create, Name, Type, Data} = Record, #writer{offset = Offset} = Writer) ->
    Bytes = starl_mcap_record:encode(Record),
    Index = starl_mcap_record:encode(
        {attachment_index, Offset, iolist_size(Bytes), Log, Create, iolist_size(Data), Name, Type}
    ),
    Known = Writer#writer.attachments,
    given(Bytes, Writer#writer{attachments = [iolist_to_binary(Index) | Known]}).

given(Bytes, #writer{offset = Offset, crc = Crc} = Writer) ->
    {Bytes, Writer#writer{
        offset = Offset + iolist_size(Bytes), crc = erlang:crc32(Crc, Bytes)
    }}.

%% @doc The last bytes of the file.
-spec finish(t()) -> iolist().
finish(Writer0) ->
    {Chunk, Last} = flush(Writer0),
    #writer{crc = Crc} = Flushed = only_told(Last),
    {DataEnd, #writer{offset = Start} = Writer} =
        given(starl_mcap_record:encode({data_end, Crc}), Flushed),
    {Summary, Offsets} = summary(Start, Writer),
    OffsetStart = Start + iolist_size(Summary),
    Covered = [Summary, Offsets, <<2, 20:64/little, Start:64/little, OffsetStart:64/little>>],
    Footer = <<(erlang:crc32(Covered)):32/little>>,
    [Chunk, DataEnd, Covered, Footer, starl_mcap_record:magic()].

%% The summary repeats only what is in the file.
only_told(#writer{is_told = true} = Writer) -> Writer;
only_told(#writer{is_told = false} = Writer) -> Writer#writer{channels = []}.

%% Groups of records of one kind, and where each group lies.
summary(Start, #writer{channels = Channels} = Writer) ->
    Groups = [
        {3, [starl_mcap_record:encode(R) || R <- Channels, element(1, R) =:= schema]},
        {4, [starl_mcap_record:encode(R) || R <- Channels, element(1, R) =:= channel]},
        {11, [starl_mcap_record:encode(statistics_of(Writer))]},
        {8, lists:reverse(Writer#writer.chunks)},
        {10, lists:reverse(Writer#writer.attachments)},
        {13, lists:reverse(Writer#writer.metadata)}
    ],
    grouped([Group || {_, [_ | _]} = Group <- Groups], Start, [], []).

grouped([], _At, Summary, Offsets) ->
    {lists:reverse(Summary), lists:reverse(Offsets)};
grouped([{Opcode, Records} | Groups], At, Summary, Offsets) ->
    Length = iolist_size(Records),
    Offset = starl_mcap_record:encode({summary_offset, Opcode, At, Length}),
    grouped(Groups, At + Length, [Records | Summary], [Offset | Offsets]).

statistics_of(#writer{channels = Channels, counts = Counts, start = Start, last = Last} = Writer) ->
    {statistics, lists:sum(maps:values(Counts)), length([S || S <- Channels, is_schema(S)]),
        length([C || C <- Channels, not is_schema(C)]), length(Writer#writer.attachments),
        length(Writer#writer.metadata), Writer#writer.chunk_count, first(Start), Last,
        lists:sort(maps:to_list(Counts))}.

is_schema(Record) -> element(1, Record) =:= schema.

first(none) -> 0;
first(Start) -> Start.
