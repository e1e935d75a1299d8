%% @doc Recovers an MCAP file that was cut off or damaged. It keeps all chunks that are whole and
%% have right checksums, and writes a new index and summary. It works on any MCAP file, ours or
%% another. Chunks stay as they are, or are joined and packed ({@link starl_mcap_pack}). If the file
%% has an index, the index leads from a damaged part to the next chunk.
%%
%% The new file can itself record what was lost: a <em>patch</em> writes that.
-module(starl_mcap_recover).

-export([file/2, file/3, file/4, pack/2, not_packed/1, format_error/1]).

-export_type([recovered/0, reason/0, patch/0]).

%% What a kind of file says of what it has lost: the channels to say it on, if its own are lost; the
%% messages in the place of a hole between two times (`the_end': nothing comes after it); and the
%% messages that are in an attachment, too, which are taken from there if they are lost.
-type patch() :: #{
    channels := starl_mcap_writer:channels(),
    channel := starl_mcap_record:id(),
    hole := fun((From :: time(), To :: time() | the_end) -> iodata()),
    repeated := fun((starl_mcap_record:t()) -> {ok, iodata()} | none)
}.

-type time() :: starl_mcap_record:time().

%% The figures: whole chunks and their messages, damaged chunks, whether the file had been closed,
%% the bytes at its end that could not be read, and why chunks could not be packed.
-type recovered() :: #{
    chunks := non_neg_integer(),
    messages := non_neg_integer(),
    damaged := non_neg_integer(),
    was_closed := boolean(),
    lost_bytes := non_neg_integer(),
    not_packed := none | starl_mcap_zstd:reason()
}.

-type reason() ::
    starl_mcap_reader:reason()
    | starl_mcap_part:reason()
    | {nothing, file:filename_all()}.

-record(recovery, {
    file :: file:filename_all(),
    part :: starl_mcap_part:t(),
    reader :: starl_mcap_reader:t(),
    writer :: starl_mcap_writer:t(),
    pack :: starl_mcap_pack:t(),
    chunks = 0 :: non_neg_integer(),
    messages = 0 :: non_neg_integer(),
    damaged = 0 :: non_neg_integer(),
    patch = none :: patch() | none,
    %% is something lost since the last message, and when was that
    is_open = false :: boolean(),
    last = 0 :: time()
}).

%% @doc Recovers a file into another one, with the same chunks.
-spec file(file:filename_all(), Out :: file:filename_all()) ->
    {ok, recovered()} | {error, reason()}.
file(File, Out) -> file(File, Out, as_is).

%% @doc Recovers a file into another one, which is complete when it appears; that may be its own.
-spec file(file:filename_all(), Out :: file:filename_all(), packed | as_is) ->
    {ok, recovered()} | {error, reason()}.
file(File, Out, How) -> file(File, Out, How, none).

%% @doc The same with a patch.
-spec file(file:filename_all(), Out :: file:filename_all(), packed | as_is, patch() | none) ->
    {ok, recovered()} | {error, reason()}.
file(File, Out, How, Patch) ->
    case starl_mcap_reader:open(File) of
        {ok, Reader} ->
            Pack = starl_mcap_pack:new(How),
            Answer = starl_mcap_part:make(Out, fun(Part) ->
                try_all(Reader, #recovery{
                    file = File,
                    part = Part,
                    reader = Reader,
                    writer = element(2, starl_mcap_writer:new("", [])),
                    pack = Pack,
                    patch = Patch
                })
            end),
            ok = starl_mcap_reader:close(Reader),
            Answer;
        {error, _} = Error ->
            Error
    end.

%% @doc Packs the chunks of a file, if Zstandard is at hand. Else it stays as it is, and the text says why.
-spec pack(file:filename_all(), patch() | none) -> ok | {error, unicode:chardata()}.
pack(File, Patch) ->
    case file(File, File, packed, Patch) of
        {ok, Recovered} -> not_packed(Recovered);
        %% nothing was recorded
        {error, {nothing, _}} -> ok;
        {error, Reason} -> {error, format_error(Reason)}
    end.

%% @doc Says why chunks could not be packed, if that is so.
-spec not_packed(recovered()) -> ok | {error, unicode:chardata()}.
not_packed(#{not_packed := none}) -> ok;
not_packed(#{not_packed := Why}) -> {error, starl_mcap_zstd:format_error(Why)}.

try_all(Reader, Recovery0) ->
    First = starl_mcap_reader:first(Reader),
    {Library, Second} =
        case starl_mcap_reader:next(First, Reader) of
            {ok, {header, _, <<_, _/binary>> = Known}, After} -> {Known, After};
            {ok, {header, _, <<>>}, After} -> {<<"starl">>, After};
            _ -> {<<"starl">>, First}
        end,
    {Head, Writer} = starl_mcap_writer:new(Library, []),
    Recovery = put_bytes({Head, Writer}, Recovery0),
    try
        all(Second, Recovery)
    catch
        throw:{?MODULE, Reason} -> {error, Reason}
    end.

all(Position, #recovery{reader = Reader} = Recovery) ->
    case starl_mcap_reader:next(Position, Reader) of
        {ok, {data_end, _}, _} -> done(true, Position, Recovery);
        {ok, {footer, _, _, _}, _} -> done(true, Position, Recovery);
        {ok, Record, After} -> all(After, record(Record, Recovery));
        {error, {file, _, _}} = Error -> Error;
        _Damaged -> passed(Position, Recovery)
    end.

%% On to the next chunk of the index. What is damaged between chunks holds no message of ours.
passed(Position, #recovery{reader = Reader} = Recovery) ->
    IsChunk = starl_mcap_reader:is_chunk(Position, Reader),
    case starl_mcap_reader:following(Position, Reader) of
        {ok, Place} when IsChunk -> all(Place, damaged(Recovery));
        {ok, Place} -> all(Place, Recovery);
        none when IsChunk -> done(true, Position, damaged(Recovery));
        none -> unindexed(starl_mcap_reader:has_index(Reader), Position, Recovery)
    end.

unindexed(true, Position, Recovery) -> done(true, Position, Recovery);
unindexed(false, Position, Recovery) -> done(false, Position, open(Recovery)).

%% Something is lost here.
open(Recovery) -> Recovery#recovery{is_open = true}.

done(_WasClosed, _Position, #recovery{messages = 0, file = File}) ->
    {error, {nothing, File}};
done(WasClosed, Position, #recovery{reader = Reader} = Recovery) ->
    #recovery{writer = Writer, pack = Pack} = Whole = put_waiting(closed(the_end, Recovery)),
    _ = put_bytes({starl_mcap_writer:finish(Writer), Writer}, Whole),
    {ok, #{
        chunks => Recovery#recovery.chunks,
        messages => Recovery#recovery.messages,
        damaged => Recovery#recovery.damaged,
        was_closed => WasClosed,
        lost_bytes => lost(WasClosed, starl_mcap_reader:size(Reader) - Position),
        not_packed => starl_mcap_pack:failure(Pack)
    }}.

lost(true, _Bytes) -> 0;
lost(false, Bytes) -> Bytes.

record({chunk, _, _, _, _, _, _} = Chunk, Recovery) ->
    chunk(whole(Chunk), Chunk, Recovery);
record(Record, Recovery) when
    element(1, Record) =:= schema;
    element(1, Record) =:= channel;
    element(1, Record) =:= metadata;
    element(1, Record) =:= attachment
->
    #recovery{writer = Writer} = Empty = put_waiting(repeated(Record, Recovery)),
    put_bytes(starl_mcap_writer:other(Record, Writer), Empty);
record({message, Channel, _, Time, _, Data}, #recovery{messages = N} = Recovery) ->
    %% outside a chunk: it gets one
    #recovery{writer = Writer} = Empty = put_waiting(Recovery),
    Put = starl_mcap_writer:message(Channel, Time, Data, Writer),
    put_bytes(starl_mcap_writer:flush(Put), Empty#recovery{messages = N + 1, last = Time});
record(_Other, Recovery) ->
    Recovery.

chunk({ok, Records, Index}, _Chunk, Recovery) when map_size(Index) =:= 0 ->
    lists:foldl(fun record/2, Recovery, channels(Records));
chunk({ok, Records, Index}, {chunk, _, _, Size, Crc, Compression, Packed}, Recovery) ->
    #recovery{pack = Pack} = Known = taken(Records, Index, Recovery),
    put_chunks(starl_mcap_pack:add({Size, Crc, Compression, Packed, Index}, Pack), Known);
chunk({error, {packed, _, Why} = Reason}, _Chunk, #recovery{chunks = N, file = File}) when
    Why =/= unknown; N =:= 0
->
    throw({?MODULE, {damaged, File, 0, Reason}});
chunk({error, _}, _Chunk, Recovery) ->
    damaged(Recovery).

%% The messages and channels of a whole chunk.
taken(Records, Index, Recovery) ->
    Times = [Time || Entries <- maps:values(Index), {Time, _} <- Entries],
    Closed = closed(lists:min(Times), Recovery),
    Last = Closed#recovery{last = lists:max(Times)},
    #recovery{writer = Writer} = Counted = counted(Index, Last),
    Counted#recovery{writer = starl_mcap_writer:known(Records, Writer)}.

whole(Chunk) ->
    case starl_mcap_chunk:contents(Chunk) of
        {ok, Bytes} -> whole(starl_mcap_record:decode_all(Bytes), Bytes);
        {error, _} = Error -> Error
    end.

whole({ok, Records}, Bytes) ->
    {ok, Index} = starl_mcap_chunk:index(Bytes),
    {ok, Records, Index};
whole({error, _} = Error, _Bytes) ->
    Error.

%% The channels of a damaged chunk are in the summary, if there is one.
damaged(#recovery{damaged = 0, reader = Reader} = Recovery) ->
    Damaged = (open(Recovery))#recovery{damaged = 1},
    case starl_mcap_reader:summary(Reader) of
        {ok, Summary} -> lists:foldl(fun record/2, Damaged, channels(Summary));
        none -> Damaged
    end;
damaged(#recovery{damaged = N} = Recovery) ->
    (open(Recovery))#recovery{damaged = N + 1}.

%% The hole before this time, or before the end, is said.
closed(To, #recovery{is_open = true, patch = #{hole := Hole} = Patch, last = From} = Recovery) when
    Recovery#recovery.messages > 0
->
    said(From, Hole(From, To), Patch, Recovery#recovery{is_open = false});
closed(_To, Recovery) ->
    Recovery.

%% What the first chunk has lost.
repeated(Record, #recovery{messages = 0, patch = #{repeated := Repeated} = Patch} = Recovery) ->
    case Repeated(Record) of
        {ok, Data} ->
            Said = said(0, Data, Patch, with_channels(Patch, Recovery)),
            Said#recovery{messages = 1};
        none ->
            Recovery
    end;
repeated(_Record, Recovery) ->
    Recovery.

with_channels(#{channels := Channels}, #recovery{writer = Writer} = Recovery) ->
    Missing = starl_mcap_writer:missing(Channels, Writer),
    Put = fun(Record, #recovery{writer = W} = R) ->
        put_bytes(starl_mcap_writer:other(Record, W), R)
    end,
    lists:foldl(Put, Recovery, Missing).

said(Time, Data, #{channel := Channel}, Recovery) ->
    #recovery{writer = Writer} = Empty = put_waiting(Recovery),
    Put = starl_mcap_writer:message(Channel, Time, Data, Writer),
    put_bytes(starl_mcap_writer:flush(Put), Empty).

channels(Records) ->
    [R || R <- Records, element(1, R) =:= schema orelse element(1, R) =:= channel].

put_waiting(#recovery{pack = Pack} = Recovery) ->
    put_chunks(starl_mcap_pack:finish(Pack), Recovery).

put_chunks({Chunks, Pack}, Recovery) ->
    Put = fun(Chunk, #recovery{writer = Writer} = R) ->
        put_bytes(starl_mcap_writer:sealed(Chunk, Writer), R)
    end,
    lists:foldl(Put, Recovery#recovery{pack = Pack}, Chunks).

counted(Index, #recovery{chunks = Chunks, messages = Messages} = Recovery) ->
    Recovery#recovery{
        chunks = Chunks + 1,
        messages = Messages + lists:sum([length(E) || E <- maps:values(Index)])
    }.

put_bytes({Bytes, Writer}, #recovery{part = Part} = Recovery) ->
    Recovery#recovery{writer = Writer, part = starl_mcap_part:write(Bytes, Part)}.

%% @doc One line on a problem: what is wrong, where, and what to do.
-spec format_error(reason()) -> unicode:chardata().
format_error({write, _, _} = Reason) ->
    starl_mcap_part:format_error(Reason);
format_error({nothing, File}) ->
    io_lib:format("~ts: there is no whole chunk in it: nothing can be recovered", [File]);
format_error(Reason) ->
    starl_mcap_reader:format_error(Reason).
