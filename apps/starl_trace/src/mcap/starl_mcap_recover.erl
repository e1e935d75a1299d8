%% @doc Makes a whole MCAP file of one that was cut off or damaged: all chunks that are whole and
%% whose checksums are right, with a new index and summary. Chunks stay packed as they are. Works on
%% any MCAP file, of ours or another.
-module(starl_mcap_recover).

-export([file/2, format_error/1]).

-export_type([recovered/0, reason/0]).

%% The figures: whole chunks and their messages, damaged chunks, whether the file had been closed,
%% and the bytes at its end that could not be read.
-type recovered() :: #{
    chunks := non_neg_integer(),
    messages := non_neg_integer(),
    damaged := non_neg_integer(),
    was_closed := boolean(),
    lost_bytes := non_neg_integer()
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
    chunks = 0 :: non_neg_integer(),
    messages = 0 :: non_neg_integer(),
    damaged = 0 :: non_neg_integer()
}).

%% @doc Recovers a file into another one, which is complete when it appears.
-spec file(file:filename_all(), Out :: file:filename_all()) ->
    {ok, recovered()} | {error, reason()}.
file(File, Out) ->
    case starl_mcap_reader:open(File) of
        {ok, Reader} ->
            Answer = starl_mcap_part:make(Out, fun(Part) -> try_all(File, Reader, Part) end),
            ok = starl_mcap_reader:close(Reader),
            Answer;
        {error, _} = Error ->
            Error
    end.

try_all(File, Reader, Part) ->
    First = starl_mcap_reader:first(Reader),
    {Library, Second} =
        case starl_mcap_reader:next(First, Reader) of
            {ok, {header, _, Known}, After} -> {Known, After};
            _ -> {<<>>, First}
        end,
    {Head, Writer} = starl_mcap_writer:new(Library, []),
    Recovery = #recovery{file = File, part = Part, reader = Reader, writer = Writer},
    try
        all(Second, put_bytes({Head, Writer}, Recovery))
    catch
        throw:{?MODULE, Reason} -> {error, Reason}
    end.

all(Position, #recovery{reader = Reader} = Recovery) ->
    case starl_mcap_reader:next(Position, Reader) of
        {ok, {data_end, _}, _} -> done(true, Position, Recovery);
        {ok, {footer, _, _, _}, _} -> done(true, Position, Recovery);
        {ok, Record, After} -> all(After, record(Record, Recovery));
        {error, {damaged, _, At, _}} -> done(false, At, Recovery);
        {error, _} = Error -> Error;
        _Cut -> done(false, Position, Recovery)
    end.

done(_WasClosed, _Position, #recovery{messages = 0, file = File}) ->
    {error, {nothing, File}};
done(WasClosed, Position, #recovery{writer = Writer, reader = Reader} = Recovery) ->
    _ = put_bytes({starl_mcap_writer:finish(Writer), Writer}, Recovery),
    {ok, #{
        chunks => Recovery#recovery.chunks,
        messages => Recovery#recovery.messages,
        damaged => Recovery#recovery.damaged,
        was_closed => WasClosed,
        lost_bytes => lost(WasClosed, starl_mcap_reader:size(Reader) - Position)
    }}.

lost(true, _Bytes) -> 0;
lost(false, Bytes) -> Bytes.

record({chunk, _, _, Size, Crc, Compression, Packed} = Chunk, Recovery) ->
    case whole(Chunk) of
        {ok, Records, Index} ->
            #recovery{writer = Writer} = Recovery,
            Known = starl_mcap_writer:known(Records, Writer),
            Counted = counted(Index, Recovery),
            sealed({Size, Crc, Compression, Packed, Index}, Known, Counted);
        {error, {compression, _} = Reason} ->
            throw({?MODULE, {damaged, Recovery#recovery.file, 0, Reason}});
        {error, _} ->
            Recovery#recovery{damaged = Recovery#recovery.damaged + 1}
    end;
record(Record, #recovery{writer = Writer} = Recovery) when
    element(1, Record) =:= schema;
    element(1, Record) =:= channel;
    element(1, Record) =:= metadata;
    element(1, Record) =:= attachment
->
    put_bytes(starl_mcap_writer:other(Record, Writer), Recovery);
record({message, Channel, _, Time, _, Data}, #recovery{writer = Writer, messages = N} = Recovery) ->
    %% outside a chunk: it gets one
    Put = starl_mcap_writer:message(Channel, Time, Data, Writer),
    put_bytes(starl_mcap_writer:flush(Put), Recovery#recovery{messages = N + 1});
record(_Other, Recovery) ->
    Recovery.

whole(Chunk) ->
    case {starl_mcap_chunk:records(Chunk), starl_mcap_chunk:contents(Chunk)} of
        {{ok, Records}, {ok, Bytes}} ->
            {ok, Index} = starl_mcap_chunk:index(Bytes),
            {ok, Records, Index};
        {{error, _} = Error, _} ->
            Error
    end.

%% A chunk without messages holds only schemas and channels.
sealed({_, _, _, _, Index}, Writer, Recovery) when map_size(Index) =:= 0 ->
    Recovery#recovery{writer = Writer};
sealed(Chunk, Writer, Recovery) ->
    put_bytes(starl_mcap_writer:sealed(Chunk, Writer), Recovery).

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
