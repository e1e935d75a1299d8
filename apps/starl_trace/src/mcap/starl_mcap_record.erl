%% @doc The records of an MCAP file (version 0): encodes and decodes them. A pure module.
%%
%% A file is `Magic Header ... DataEnd [summary] Footer Magic'. Each record is an opcode, a length
%% of 8 bytes and its content; all integers are little-endian, times are nanoseconds. See
%% https://mcap.dev/spec.
-module(starl_mcap_record).

-export([magic/0, encode/1, decode/1, decode_all/1, content/2]).

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

%% A second of a thousand robots has some hundred thousand records. More of them, which may be empty and take little room
%% in a packed chunk, are not read at once.
-define(MOST_RECORDS, 1000000).

%% @doc The bytes at the beginning and the end of a file.
-spec magic() -> binary().
magic() -> ?MAGIC.

%% @doc The bytes of a record.
-spec encode(t()) -> iolist().
encode({unknown, Opcode, Content}) ->
    framed(Opcode, Content);
encode(Record) ->
    [Name | Values] = tuple_to_list(Record),
    Opcode = opcode(Name),
    {Name, Fields} = layout(Opcode),
    framed(Opcode, put_all(Fields, Values, [])).

framed(Opcode, Content) -> [<<Opcode:8, (iolist_size(Content)):64/little>>, Content].

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
-spec decode_all(binary()) ->
    {ok, [t()]} | {error, cut_off | {bad_record, opcode()} | {too_many, pos_integer()}}.
decode_all(Bytes) -> decode_all(Bytes, ?MOST_RECORDS, []).

decode_all(<<>>, _Room, Records) ->
    {ok, lists:reverse(Records)};
decode_all(_Bytes, 0, _Records) ->
    {error, {too_many, ?MOST_RECORDS}};
decode_all(Bytes, Room, Records) ->
    case decode(Bytes) of
        {ok, Record, Rest} -> decode_all(Rest, Room - 1, [Record | Records]);
        more -> {error, cut_off};
        {error, _} = Error -> Error
    end.

%% @doc The record of this opcode and content. Bytes after the known fields are ignored.
-spec content(opcode(), binary()) -> {ok, t()} | {error, {bad_record, opcode()}}.
content(Opcode, Content) ->
    case layout(Opcode) of
        unknown -> {ok, {unknown, Opcode, Content}};
        {Name, Fields} -> content(Opcode, Name, Fields, Content)
    end.

content(Opcode, Name, Fields, Content) ->
    try
        {ok, list_to_tuple([Name | take_all(Fields, Content, Content)])}
    catch
        throw:{?MODULE, short} -> {error, {bad_record, Opcode}}
    end.

%% -- the layout of the records --------------------------------------------------------------

%% The fields of each record, in the order of its tuple: numbers of so many bits; text; bytes with a
%% length of 32 or 64 bits; maps of texts, of counts by channel, of times and offsets; the rest. `crc':
%% the checksum of what stands before it, which the tuple does not have.
layout(1) -> {header, [text, text]};
layout(2) -> {footer, [64, 64, 32]};
layout(3) -> {schema, [16, text, text, bytes32]};
layout(4) -> {channel, [16, 16, text, text, texts]};
layout(5) -> {message, [16, 32, 64, 64, rest]};
layout(6) -> {chunk, [64, 64, 64, 32, text, bytes64]};
layout(7) -> {message_index, [16, times]};
layout(8) -> {chunk_index, [64, 64, 64, 64, counts, 64, text, 64, 64]};
layout(9) -> {attachment, [64, 64, text, text, bytes64, crc]};
layout(10) -> {attachment_index, [64, 64, 64, 64, 64, text, text]};
layout(11) -> {statistics, [64, 16, 32, 32, 32, 32, 64, 64, counts]};
layout(12) -> {metadata, [text, texts]};
layout(13) -> {metadata_index, [64, 64, text]};
layout(14) -> {summary_offset, [8, 64, 64]};
layout(15) -> {data_end, [32]};
layout(_) -> unknown.

opcode(header) -> 1;
opcode(footer) -> 2;
opcode(schema) -> 3;
opcode(channel) -> 4;
opcode(message) -> 5;
opcode(chunk) -> 6;
opcode(message_index) -> 7;
opcode(chunk_index) -> 8;
opcode(attachment) -> 9;
opcode(attachment_index) -> 10;
opcode(statistics) -> 11;
opcode(metadata) -> 12;
opcode(metadata_index) -> 13;
opcode(summary_offset) -> 14;
opcode(data_end) -> 15.

%% -- to bytes -------------------------------------------------------------------------------

put_all([], [], Done) ->
    lists:reverse(Done);
put_all([crc], [], Done) ->
    lists:reverse(Done, [<<(erlang:crc32(lists:reverse(Done))):32/little>>]);
put_all([Field | Fields], [Value | Values], Done) ->
    put_all(Fields, Values, [put_one(Field, Value) | Done]).

put_one(Bits, Number) when is_integer(Bits) -> <<Number:Bits/little>>;
put_one(rest, Data) ->
    Data;
put_one(text, Text) ->
    put_one(bytes32, unicode:characters_to_binary(Text));
put_one(bytes32, Data) ->
    [<<(iolist_size(Data)):32/little>>, Data];
put_one(bytes64, Data) ->
    [<<(iolist_size(Data)):64/little>>, Data];
put_one(Map, Pairs) ->
    {First, Second} = pair(Map),
    put_one(bytes32, [[put_one(First, A), put_one(Second, B)] || {A, B} <- Pairs]).

pair(texts) -> {text, text};
pair(counts) -> {16, 64};
pair(times) -> {64, 64}.

%% -- from bytes -----------------------------------------------------------------------------

take_all([], _Bytes, _Whole) ->
    [];
take_all([rest], Bytes, _Whole) ->
    [Bytes];
take_all([crc], Bytes, Whole) ->
    {Crc, _} = take_one(32, Bytes),
    Covered = binary:part(Whole, 0, byte_size(Whole) - byte_size(Bytes)),
    _ = Crc =:= 0 orelse Crc =:= erlang:crc32(Covered) orelse throw({?MODULE, short}),
    [];
take_all([Field | Fields], Bytes, Whole) ->
    {Value, Rest} = take_one(Field, Bytes),
    [Value | take_all(Fields, Rest, Whole)].

take_one(Bits, Bytes) when is_integer(Bits) ->
    case Bytes of
        <<Number:Bits/little, Rest/binary>> -> {Number, Rest};
        _ -> throw({?MODULE, short})
    end;
take_one(bytes64, <<Size:64/little, Data:Size/binary, Rest/binary>>) ->
    {Data, Rest};
take_one(Field, <<Size:32/little, Data:Size/binary, Rest/binary>>) when Field =/= bytes64 ->
    {within(Field, Data), Rest};
take_one(_Field, _Bytes) ->
    throw({?MODULE, short}).

within(Data, Bytes) when Data =:= text; Data =:= bytes32 -> Bytes;
within(Map, Bytes) -> pairs(pair(Map), Bytes).

pairs(_Pair, <<>>) ->
    [];
pairs({First, Second} = Pair, Bytes) ->
    {A, Rest} = take_one(First, Bytes),
    {B, Left} = take_one(Second, Rest),
    [{A, B} | pairs(Pair, Left)].
