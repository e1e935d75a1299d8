%% @doc The records of an MCAP file (version 0): encodes and decodes them. A pure module.
%%
%% A file is `Magic Header ... DataEnd [summary] Footer Magic'. Each record is an opcode, a length
%% of 8 bytes and its content; all integers are little-endian, times are nanoseconds. See
%% https://mcap.dev/spec.
-module(starl_mcap_record).

-export([magic/0, encode/1, decode/1, decode_all/1, opcode/1, content/2]).

-export_type([t/0, opcode/0, time/0, id/0, map_of_text/0]).

%% Nanoseconds.
-type time() :: 0..16#ffffffffffffffff.
-type id() :: 0..16#ffff.
-type opcode() :: 0..255.
-type offset() :: non_neg_integer().
-type map_of_text() :: [{unicode:chardata(), unicode:chardata()}].

-type t() ::
    {header, Profile :: unicode:chardata(), Library :: unicode:chardata()}
    | {footer, SummaryStart :: offset(), SummaryOffsetStart :: offset(),
        SummaryCrc :: 0..4294967295}
    | {schema, id(), Name :: unicode:chardata(), Encoding :: unicode:chardata(), Data :: iodata()}
    | {channel, id(), Schema :: id(), Topic :: unicode:chardata(),
        MessageEncoding :: unicode:chardata(), map_of_text()}
    | {message, Channel :: id(), Sequence :: non_neg_integer(), Log :: time(), Publish :: time(),
        Data :: iodata()}
    | {chunk, Start :: time(), End :: time(), Size :: offset(), Crc :: 0..4294967295,
        Compression :: unicode:chardata(), Records :: iodata()}
    | {message_index, Channel :: id(), [{time(), offset()}]}
    | {chunk_index, Start :: time(), End :: time(), Offset :: offset(), Length :: offset(),
        Indexes :: [{id(), offset()}], IndexLength :: offset(), Compression :: unicode:chardata(),
        Compressed :: offset(), Uncompressed :: offset()}
    | {attachment, Log :: time(), Create :: time(), Name :: unicode:chardata(),
        MediaType :: unicode:chardata(), Data :: iodata()}
    | {attachment_index, Offset :: offset(), Length :: offset(), Log :: time(), Create :: time(),
        Size :: offset(), Name :: unicode:chardata(), MediaType :: unicode:chardata()}
    | {statistics, Messages :: offset(), Schemas :: id(), Channels :: offset(),
        Attachments :: offset(), Metadata :: offset(), Chunks :: offset(), Start :: time(),
        End :: time(), Counts :: [{id(), offset()}]}
    | {metadata, Name :: unicode:chardata(), map_of_text()}
    | {metadata_index, Offset :: offset(), Length :: offset(), Name :: unicode:chardata()}
    | {summary_offset, opcode(), Start :: offset(), Length :: offset()}
    | {data_end, Crc :: 0..4294967295}
    %% of a later version, or private
    | {unknown, opcode(), binary()}.

-define(MAGIC, <<16#89, "MCAP0\r\n">>).

%% @doc The bytes at the beginning and the end of a file.
-spec magic() -> binary().
magic() -> ?MAGIC.

%% @doc The bytes of a record.
-spec encode(t()) -> iolist().
encode(Record) ->
    Content = put_content(Record),
    [<<(opcode(Record)):8, (iolist_size(Content)):64/little>>, Content].

%% @doc The first record of these bytes, and the bytes after it; `more': the record is cut off.
-spec decode(binary()) -> {ok, t(), Rest :: binary()} | more | {error, {bad_record, opcode()}}.
decode(<<Opcode:8, Size:64/little, Content:Size/binary, Rest/binary>>) ->
    case content(Opcode, Content) of
        {ok, Record} -> {ok, Record, Rest};
        {error, _} = Error -> Error
    end;
decode(_CutOff) ->
    more.

%% @doc All records of these bytes.
-spec decode_all(binary()) -> {ok, [t()]} | {error, cut_off | {bad_record, opcode()}}.
decode_all(Bytes) -> decode_all(Bytes, []).

decode_all(<<>>, Records) ->
    {ok, lists:reverse(Records)};
decode_all(Bytes, Records) ->
    case decode(Bytes) of
        {ok, Record, Rest} -> decode_all(Rest, [Record | Records]);
        more -> {error, cut_off};
        {error, _} = Error -> Error
    end.

%% @doc The record of this opcode and content. Bytes after the known fields are ignored.
-spec content(opcode(), binary()) -> {ok, t()} | {error, {bad_record, opcode()}}.
content(Opcode, Content) ->
    try
        {ok, get_content(Opcode, Content)}
    catch
        throw:short -> {error, {bad_record, Opcode}};
        error:{badmatch, _} -> {error, {bad_record, Opcode}}
    end.

%% @doc The opcode of a record.
-spec opcode(t()) -> opcode().
opcode({header, _, _}) -> 1;
opcode({footer, _, _, _}) -> 2;
opcode({schema, _, _, _, _}) -> 3;
opcode({channel, _, _, _, _, _}) -> 4;
opcode({message, _, _, _, _, _}) -> 5;
opcode({chunk, _, _, _, _, _, _}) -> 6;
opcode({message_index, _, _}) -> 7;
opcode({chunk_index, _, _, _, _, _, _, _, _, _}) -> 8;
opcode({attachment, _, _, _, _, _}) -> 9;
opcode({attachment_index, _, _, _, _, _, _, _}) -> 10;
opcode({statistics, _, _, _, _, _, _, _, _, _}) -> 11;
opcode({metadata, _, _}) -> 12;
opcode({metadata_index, _, _, _}) -> 13;
opcode({summary_offset, _, _, _}) -> 14;
opcode({data_end, _}) -> 15;
opcode({unknown, Opcode, _}) -> Opcode.

%% -- to bytes -------------------------------------------------------------------------------

put_content({header, Profile, Library}) ->
    [text(Profile), text(Library)];
put_content({footer, Start, OffsetStart, Crc}) ->
    <<Start:64/little, OffsetStart:64/little, Crc:32/little>>;
put_content({schema, Id, Name, Encoding, Data}) ->
    [<<Id:16/little>>, text(Name), text(Encoding), bytes32(Data)];
put_content({channel, Id, Schema, Topic, Encoding, Metadata}) ->
    [<<Id:16/little, Schema:16/little>>, text(Topic), text(Encoding), texts(Metadata)];
put_content({message, Channel, Sequence, Log, Publish, Data}) ->
    [<<Channel:16/little, Sequence:32/little, Log:64/little, Publish:64/little>>, Data];
put_content({chunk, Start, End, Size, Crc, Compression, Records}) ->
    [
        <<Start:64/little, End:64/little, Size:64/little, Crc:32/little>>,
        text(Compression),
        bytes64(Records)
    ];
put_content({message_index, Channel, Entries}) ->
    Listed = [<<Time:64/little, Offset:64/little>> || {Time, Offset} <- Entries],
    [<<Channel:16/little>>, bytes32(Listed)];
put_content({chunk_index, Start, End, At, Length, Indexes, IndexLength, Compression, Size, Full}) ->
    [
        <<Start:64/little, End:64/little, At:64/little, Length:64/little>>,
        counts(Indexes),
        <<IndexLength:64/little>>,
        text(Compression),
        <<Size:64/little, Full:64/little>>
    ];
put_content({attachment, Log, Create, Name, MediaType, Data}) ->
    Content = [
        <<Log:64/little, Create:64/little>>, text(Name), text(MediaType), bytes64(Data)
    ],
    [Content, <<(erlang:crc32(Content)):32/little>>];
put_content({attachment_index, At, Length, Log, Create, Size, Name, MediaType}) ->
    [
        <<At:64/little, Length:64/little, Log:64/little, Create:64/little, Size:64/little>>,
        text(Name),
        text(MediaType)
    ];
put_content({statistics, Messages, Schemas, Channels, Attached, Metadata, Chunks, T0, T1, Per}) ->
    [
        <<Messages:64/little, Schemas:16/little, Channels:32/little, Attached:32/little>>,
        <<Metadata:32/little, Chunks:32/little, T0:64/little, T1:64/little>>,
        counts(Per)
    ];
put_content({metadata, Name, Texts}) ->
    [text(Name), texts(Texts)];
put_content({metadata_index, At, Length, Name}) ->
    [<<At:64/little, Length:64/little>>, text(Name)];
put_content({summary_offset, Opcode, Start, Length}) ->
    <<Opcode:8, Start:64/little, Length:64/little>>;
put_content({data_end, Crc}) ->
    <<Crc:32/little>>;
put_content({unknown, _, Content}) ->
    Content.

text(Text) -> bytes32(unicode:characters_to_binary(Text)).

bytes32(Data) -> [<<(iolist_size(Data)):32/little>>, Data].

bytes64(Data) -> [<<(iolist_size(Data)):64/little>>, Data].

texts(Pairs) -> bytes32([[text(Key), text(Value)] || {Key, Value} <- Pairs]).

counts(Pairs) -> bytes32([<<Id:16/little, N:64/little>> || {Id, N} <- Pairs]).

%% -- from bytes -----------------------------------------------------------------------------

get_content(1, Bytes) ->
    {[Profile, Library], _} = take([text, text], Bytes),
    {header, Profile, Library};
get_content(2, Bytes) ->
    {[Start, OffsetStart, Crc], _} = take([64, 64, 32], Bytes),
    {footer, Start, OffsetStart, Crc};
get_content(3, Bytes) ->
    {[Id, Name, Encoding, Data], _} = take([16, text, text, text], Bytes),
    {schema, Id, Name, Encoding, Data};
get_content(4, Bytes) ->
    {[Id, Schema, Topic, Encoding, Texts], _} = take([16, 16, text, text, text], Bytes),
    {channel, Id, Schema, Topic, Encoding, get_texts(Texts)};
get_content(5, Bytes) ->
    {[Channel, Sequence, Log, Publish], Data} = take([16, 32, 64, 64], Bytes),
    {message, Channel, Sequence, Log, Publish, Data};
get_content(6, Bytes) ->
    {[Start, End, Size, Crc, Compression, Records], _} =
        take([64, 64, 64, 32, text, bytes], Bytes),
    {chunk, Start, End, Size, Crc, Compression, Records};
get_content(7, Bytes) ->
    {[Channel, Entries], _} = take([16, text], Bytes),
    {message_index, Channel, get_entries(Entries)};
get_content(8, Bytes) ->
    {[Start, End, At, Length, Indexes, IndexLength, Compression, Size, Full], _} =
        take([64, 64, 64, 64, text, 64, text, 64, 64], Bytes),
    {chunk_index, Start, End, At, Length, get_counts(Indexes), IndexLength, Compression, Size,
        Full};
get_content(9, Bytes) ->
    {[Log, Create, Name, MediaType, Data, Crc], _} = take([64, 64, text, text, bytes, 32], Bytes),
    Covered = binary:part(Bytes, 0, 32 + byte_size(Name) + byte_size(MediaType) + byte_size(Data)),
    _ = Crc =:= 0 orelse Crc =:= erlang:crc32(Covered) orelse throw(short),
    {attachment, Log, Create, Name, MediaType, Data};
get_content(10, Bytes) ->
    {[At, Length, Log, Create, Size, Name, MediaType], _} =
        take([64, 64, 64, 64, 64, text, text], Bytes),
    {attachment_index, At, Length, Log, Create, Size, Name, MediaType};
get_content(11, Bytes) ->
    {[Messages, Schemas, Channels, Attachments, Metadata, Chunks, T0, T1, Per], _} =
        take([64, 16, 32, 32, 32, 32, 64, 64, text], Bytes),
    {statistics, Messages, Schemas, Channels, Attachments, Metadata, Chunks, T0, T1,
        get_counts(Per)};
get_content(12, Bytes) ->
    {[Name, Texts], _} = take([text, text], Bytes),
    {metadata, Name, get_texts(Texts)};
get_content(13, Bytes) ->
    {[At, Length, Name], _} = take([64, 64, text], Bytes),
    {metadata_index, At, Length, Name};
get_content(14, Bytes) ->
    {[Opcode, Start, Length], _} = take([8, 64, 64], Bytes),
    {summary_offset, Opcode, Start, Length};
get_content(15, Bytes) ->
    {[Crc], _} = take([32], Bytes),
    {data_end, Crc};
get_content(Opcode, Bytes) ->
    {unknown, Opcode, Bytes}.

%% Reads fields: numbers of so many bits, texts, bytes with a longer length.
take([], Rest) ->
    {[], Rest};
take([Field | Fields], Bytes) ->
    {Value, Left} = take_one(Field, Bytes),
    {Values, Rest} = take(Fields, Left),
    {[Value | Values], Rest}.

take_one(text, <<Size:32/little, Text:Size/binary, Rest/binary>>) ->
    {Text, Rest};
take_one(bytes, <<Size:64/little, Bytes:Size/binary, Rest/binary>>) ->
    {Bytes, Rest};
take_one(Bits, Bytes) when is_integer(Bits) ->
    case Bytes of
        <<Number:Bits/little, Rest/binary>> -> {Number, Rest};
        _ -> throw(short)
    end;
take_one(_Field, _Bytes) ->
    throw(short).

get_texts(<<>>) ->
    [];
get_texts(Bytes) ->
    {[Key, Value], Rest} = take([text, text], Bytes),
    [{Key, Value} | get_texts(Rest)].

get_counts(<<>>) -> [];
get_counts(<<Id:16/little, N:64/little, Rest/binary>>) -> [{Id, N} | get_counts(Rest)];
get_counts(_) -> throw(short).

get_entries(<<>>) -> [];
get_entries(<<Time:64/little, At:64/little, Rest/binary>>) -> [{Time, At} | get_entries(Rest)];
get_entries(_) -> throw(short).
