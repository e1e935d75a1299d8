%% @doc Reads the inside of a chunk of an MCAP file: checks it and returns its schemas, channels and
%% messages.
-module(starl_mcap_chunk).

-export([records/1, contents/1, index/1]).

-export_type([reason/0, record/0, index/0]).

-type record() :: starl_mcap_record:t().

-type reason() ::
    {bad_record, starl_mcap_record:opcode()}
    | cut_off
    | checksum
    | {size, Said :: non_neg_integer()}
    | {too_many, Records :: pos_integer()}
    | {packed, Compression :: binary(), unknown | starl_mcap_zstd:reason()}.

%% The messages of a chunk by channel: their times, and their places among the records.
-type index() :: #{starl_mcap_record:id() => [{starl_mcap_record:time(), non_neg_integer()}]}.

%% A chunk that claims more is not unpacked.
-define(MOST, 256 * 1024 * 1024).

%% @doc The records of a chunk, in their order.
-spec records(record()) -> {ok, [record()]} | {error, reason()}.
records(Chunk) ->
    case contents(Chunk) of
        {ok, Bytes} -> starl_mcap_record:decode_all(Bytes);
        {error, _} = Error -> Error
    end.

%% @doc The bytes of a chunk's records, unpacked and checked.
-spec contents(record()) -> {ok, binary()} | {error, reason()}.
contents({chunk, _, _, Size, _, _, _}) when Size > ?MOST ->
    {error, {size, Size}};
contents({chunk, _, _, Size, Crc, Compression, Records}) ->
    case unpack(Compression, iolist_to_binary(Records), Size) of
        {ok, Bytes} when byte_size(Bytes) =/= Size -> {error, {size, Size}};
        {ok, Bytes} when Crc =:= 0 -> {ok, Bytes};
        {ok, Bytes} -> checked(erlang:crc32(Bytes) =:= Crc, Bytes);
        {error, _} = Error -> Error
    end.

checked(true, Bytes) -> {ok, Bytes};
checked(false, _Bytes) -> {error, checksum}.

unpack(<<>>, Bytes, _Size) ->
    {ok, Bytes};
unpack(<<"zstd">>, Bytes, Size) ->
    case starl_mcap_zstd:decompress(Bytes, Size) of
        {ok, _} = Unpacked -> Unpacked;
        {error, damaged} -> {error, checksum};
        {error, Reason} -> {error, {packed, <<"zstd">>, Reason}}
    end;
unpack(Compression, _Bytes, _Size) ->
    {error, {packed, Compression, unknown}}.

%% @doc The messages of a chunk by channel: their times and their places among the records.
-spec index(binary()) -> {ok, index()} | {error, reason()}.
index(Bytes) -> index(Bytes, 0, #{}).

index(<<>>, _At, Index) ->
    {ok, Index};
index(Bytes, At, Index) ->
    case starl_mcap_record:decode(Bytes) of
        {ok, Record, Rest} ->
            index(Rest, At + byte_size(Bytes) - byte_size(Rest), entered(Record, At, Index));
        more ->
            {error, cut_off};
        {error, _} = Error ->
            Error
    end.

entered({message, Channel, _, Time, _, _}, At, Index) ->
    Index#{Channel => [{Time, At} | maps:get(Channel, Index, [])]};
entered(_Other, _At, Index) ->
    Index.
