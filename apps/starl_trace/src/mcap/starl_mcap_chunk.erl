%% @doc The inside of a chunk of an MCAP file: checks it and gives its schemas, channels and
%% messages. A pure module.
-module(starl_mcap_chunk).

-export([records/1, contents/1, index/1, compressions/0]).

-export_type([reason/0, record/0]).

-type record() :: starl_mcap_record:t().

-type reason() ::
    {bad_record, starl_mcap_record:opcode()}
    | cut_off
    | checksum
    | {size, Said :: non_neg_integer()}
    | {compression, binary()}.

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
    case unpack(Compression, iolist_to_binary(Records)) of
        {ok, Bytes} when byte_size(Bytes) =/= Size -> {error, {size, Size}};
        {ok, Bytes} when Crc =:= 0 -> {ok, Bytes};
        {ok, Bytes} -> checked(erlang:crc32(Bytes) =:= Crc, Bytes);
        {error, _} = Error -> Error
    end.

checked(true, Bytes) -> {ok, Bytes};
checked(false, _Bytes) -> {error, checksum}.

%% @doc The compressions that can be read here: none, and zstd from OTP 28 on.
-spec compressions() -> [binary()].
compressions() -> [<<>>] ++ [<<"zstd">> || has_zstd()].

unpack(<<>>, Bytes) ->
    {ok, Bytes};
unpack(<<"zstd">>, Bytes) ->
    case has_zstd() of
        true -> unzstd(Bytes);
        false -> {error, {compression, <<"zstd">>}}
    end;
unpack(Compression, _Bytes) ->
    {error, {compression, Compression}}.

has_zstd() -> code:ensure_loaded(zstd) =:= {module, zstd}.

%% The module exists from OTP 28 on.
unzstd(Bytes) ->
    Module = binary_to_existing_atom(<<"zstd">>),
    try
        {ok, iolist_to_binary(Module:decompress(Bytes))}
    catch
        error:_ -> {error, checksum}
    end.

%% @doc The messages of a chunk by channel: their times and their places among the records.
-spec index(binary()) ->
    {ok, #{starl_mcap_record:id() => [{starl_mcap_record:time(), non_neg_integer()}]}}
    | {error, reason()}.
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
