%% @doc Reads the records of an MCAP file one after the other, or finds the chunks of a time by the
%% index. A file that was cut off is read to its last whole record. If the file has an index, a
%% record that hides a chunk of the index counts as damaged. A length is refused if it is larger
%% than the rest of the file, or than a bound.
-module(starl_mcap_reader).

-export([open/1, close/1, first/1, next/2, is_chunk/2, following/2, has_index/1]).
-export([chunks/1, summary/1, size/1, format_error/1]).

-export_type([t/0, reason/0, position/0, next/0, chunk/0]).

-record(reader, {
    file :: file:filename_all(),
    device :: file:io_device(),
    size :: integer(),
    %% the chunks of the index
    places = gb_sets:new() :: gb_sets:set(position())
}).

-opaque t() :: #reader{}.

%% The place of a record in the file.
-type position() :: non_neg_integer().

-type reason() ::
    {file, file:filename_all(), file:posix() | badarg | system_limit | terminated}
    | {no_mcap, file:filename_all()}
    | {damaged, file:filename_all(), position(), starl_mcap_chunk:reason()}.

%% The next record and the position after it; the end of the file; the file is cut off here.
-type next() ::
    {ok, starl_mcap_record:t(), position()} | 'end' | {cut, position()} | {error, reason()}.

%% The times of the first and the last message of a chunk, and its place.
-type chunk() :: {starl_mcap_record:time(), starl_mcap_record:time(), position()}.

-define(MAGIC_SIZE, 8).
%% Opcode and length.
-define(HEAD_SIZE, 9).
%% A record or a summary that claims more is not read.
-define(MOST, 268435456).
%% The footer with its head, and the magic bytes.
-define(TAIL_SIZE, 37).

%% @doc Opens a file, if it begins as an MCAP file.
-spec open(file:filename_all()) -> {ok, t()} | {error, reason()}.
open(File) ->
    case file:open(File, [read, raw, binary]) of
        {ok, Device} -> opened(#reader{file = File, device = Device, size = size_of(File)});
        {error, Posix} -> {error, {file, File, Posix}}
    end.

size_of(File) -> filelib:file_size(File).

opened(#reader{device = Device, file = File} = Reader) ->
    Magic = starl_mcap_record:magic(),
    case file:pread(Device, 0, ?MAGIC_SIZE) of
        {ok, Magic} ->
            {Chunks, _Ended} = indexed(summary(Reader)),
            Places = gb_sets:from_list([At || {_, _, At} <- Chunks]),
            {ok, Reader#reader{places = Places}};
        {error, Posix} ->
            _ = file:close(Device),
            {error, {file, File, Posix}};
        _ ->
            _ = file:close(Device),
            {error, {no_mcap, File}}
    end.

%% @doc Closes the file.
-spec close(t()) -> ok.
close(#reader{device = Device}) ->
    _ = file:close(Device),
    ok.

%% @doc The size of the file in bytes.
-spec size(t()) -> non_neg_integer().
size(#reader{size = Size}) -> Size.

%% @doc The position of the first record.
-spec first(t()) -> position().
first(_Reader) -> ?MAGIC_SIZE.

%% @doc The record at a position, and the position of the next one.
-spec next(position(), t()) -> next().
next(Position, #reader{size = Size}) when Size - Position =:= ?MAGIC_SIZE -> 'end';
next(Position, #reader{size = Size}) when Size - Position < ?HEAD_SIZE -> {cut, Position};
next(Position, #reader{device = Device, size = Size} = Reader) ->
    case file:pread(Device, Position, ?HEAD_SIZE) of
        {ok, <<_:8, Length:64/little>>} when Position + ?HEAD_SIZE + Length > Size ->
            {cut, Position};
        {ok, <<_:8, Length:64/little>>} when Length > ?MOST ->
            {error, {damaged, Reader#reader.file, Position, {size, Length}}};
        {ok, <<Opcode:8, Length:64/little>>} ->
            in_place(content(Opcode, Length, Position, Reader), Position, Reader);
        {ok, _} ->
            {cut, Position};
        Other ->
            {error, failed(Other, Reader)}
    end.

%% What the index says of this place and of those that the record passes over.
in_place({ok, Record, After}, Position, #reader{file = File} = Reader) ->
    IsChunk = element(1, Record) =:= chunk,
    Hides = [
        Place
     || {ok, Place} <- [following(Position, Reader)], Place < After orelse is_end(Record)
    ],
    case is_chunk(Position, Reader) andalso not IsChunk orelse Hides =/= [] of
        true -> {error, {damaged, File, Position, {bad_record, 6}}};
        false -> {ok, Record, After}
    end;
in_place(Other, _Position, _Reader) ->
    Other.

is_end(Record) -> lists:member(element(1, Record), [data_end, footer]).

%% @doc Is there an index?
-spec has_index(t()) -> boolean().
has_index(#reader{places = Places}) -> not gb_sets:is_empty(Places).

%% @doc Does a chunk of the index begin here?
-spec is_chunk(position(), t()) -> boolean().
is_chunk(Position, #reader{places = Places}) -> gb_sets:is_member(Position, Places).

%% @doc The next chunk of the index after this place; `none': there is no index, or no further chunk.
-spec following(position(), t()) -> {ok, position()} | none.
following(Position, #reader{places = Places}) ->
    case gb_sets:next(gb_sets:iterator_from(Position + 1, Places)) of
        {Place, _} -> {ok, Place};
        none -> none
    end.

content(Opcode, Length, Position, #reader{device = Device} = Reader) ->
    case read(Device, Position + ?HEAD_SIZE, Length) of
        {ok, Content} when byte_size(Content) =:= Length ->
            decoded(starl_mcap_record:content(Opcode, Content), Length, Position, Reader);
        {ok, _} ->
            {cut, Position};
        Other ->
            {error, failed(Other, Reader)}
    end.

read(_Device, _Position, 0) -> {ok, <<>>};
read(Device, Position, Length) -> file:pread(Device, Position, Length).

decoded({ok, Record}, Length, Position, _Reader) ->
    {ok, Record, Position + ?HEAD_SIZE + Length};
decoded({error, Reason}, _Length, Position, #reader{file = File}) ->
    {error, {damaged, File, Position, Reason}}.

failed(eof, #reader{file = File}) -> {file, File, terminated};
failed({error, Posix}, #reader{file = File}) -> {file, File, Posix}.

%% @doc The records of the summary; `none': the file has no index, since it was not closed or is
%% damaged there.
-spec summary(t()) -> {ok, [starl_mcap_record:t()]} | none.
summary(#reader{size = Size}) when Size < ?MAGIC_SIZE + ?TAIL_SIZE ->
    none;
summary(#reader{device = Device, size = Size} = Reader) ->
    Magic = starl_mcap_record:magic(),
    case file:pread(Device, Size - ?TAIL_SIZE, ?TAIL_SIZE) of
        {ok, <<2, 20:64/little, Start:64/little, At:64/little, Crc:32/little, Magic/binary>>} when
            Start > 0, Start < Size - ?TAIL_SIZE
        ->
            summary(Start, At, Crc, Reader);
        _ ->
            none
    end.

summary(Start, _At, _Crc, #reader{size = Size}) when Size - ?TAIL_SIZE - Start > ?MOST ->
    none;
summary(Start, At, Crc, #reader{device = Device, size = Size}) ->
    Length = Size - ?TAIL_SIZE - Start,
    case file:pread(Device, Start, Length) of
        {ok, Bytes} when byte_size(Bytes) =:= Length ->
            Covered = [Bytes, <<2, 20:64/little, Start:64/little, At:64/little>>],
            case Crc =:= 0 orelse erlang:crc32(Covered) =:= Crc of
                true -> split(Bytes);
                false -> none
            end;
        _ ->
            none
    end.

split(Bytes) ->
    case starl_mcap_record:decode_all(Bytes) of
        {ok, Records} -> {ok, Records};
        {error, _} -> none
    end.

%% @doc All whole chunks in the order of the file, and how it ends. They come from the index, or in
%% a file without an index from the heads of its records. No chunk is opened.
-spec chunks(t()) -> {[chunk()], closed | cut_off | {damaged, position()}}.
chunks(Reader) ->
    case summary(Reader) of
        {ok, _} = Summary -> indexed(Summary);
        none -> skim(?MAGIC_SIZE, [], Reader)
    end.

indexed({ok, Records}) ->
    {[{Start, End, At} || {chunk_index, Start, End, At, _, _, _, _, _, _} <- Records], closed};
indexed(none) ->
    {[], cut_off}.

%% A chunk begins with its times.
skim(At, Chunks, #reader{size = Size, device = Device} = Reader) ->
    case file:pread(Device, At, ?HEAD_SIZE + 16) of
        {ok, <<Opcode, Length:64/little, _/binary>>} when
            Opcode =/= 15, At + ?HEAD_SIZE + Length > Size
        ->
            {lists:reverse(Chunks), cut_off};
        {ok, <<6, Length:64/little, Start:64/little, End:64/little>>} ->
            skim(At + ?HEAD_SIZE + Length, [{Start, End, At} | Chunks], Reader);
        {ok, <<15, 4:64/little, _/binary>>} ->
            {lists:reverse(Chunks), closed};
        {ok, <<0, _/binary>>} ->
            {lists:reverse(Chunks), {damaged, At}};
        {ok, <<_, Length:64/little, _/binary>>} ->
            skim(At + ?HEAD_SIZE + Length, Chunks, Reader);
        _ ->
            {lists:reverse(Chunks), cut_off}
    end.

%% @doc One line on a problem: what is wrong, where, and what to do.
-spec format_error(reason()) -> unicode:chardata().
format_error({file, File, enoent}) ->
    io_lib:format("~ts: there is no such file", [File]);
format_error({file, File, eisdir}) ->
    io_lib:format("~ts: this is a directory; name the recording in it, run.mcap", [File]);
format_error({file, File, Posix}) ->
    io_lib:format("~ts: ~ts", [File, file:format_error(Posix)]);
format_error({no_mcap, File}) ->
    io_lib:format("~ts: this is no recording (no MCAP file)", [File]);
format_error({damaged, File, _Position, {packed, Name, Reason}}) ->
    [File, ": ", packed(Name, Reason)];
format_error({damaged, File, Position, Reason}) ->
    io_lib:format("~ts: damaged at byte ~b: ~ts", [File, Position, damage(Reason)]).

damage({bad_record, Opcode}) -> io_lib:format("a record of kind ~b has a wrong content", [Opcode]);
damage(cut_off) -> "a record does not end within its chunk";
damage(checksum) -> "the checksum of a chunk is wrong; ./starl recover takes what is whole";
damage({size, _}) -> "a chunk has not the size that it says";
damage({too_many, Most}) -> io_lib:format("a chunk has more than ~b records", [Most]).

packed(Name, unknown) -> ["it is packed with ", Name, ", which cannot be read here"];
packed(_Zstd, Reason) -> starl_mcap_zstd:format_error(Reason).
