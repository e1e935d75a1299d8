%% @doc Reads the messages of a recording in the order of its file: chunk by chunk, or those of one
%% chunk at a given place.
-module(starl_trace_chunks).

-export([open/1, close/1, next/1, chunk/1, at/2, place/1, list/1, opened/1, file/1, format_error/1]).

-export_type([t/0, reason/0, ended/0, next/0]).

-record(raw, {
    file :: file:filename_all(),
    reader :: starl_mcap_reader:t(),
    position :: starl_mcap_reader:position(),
    %% channels of the recording's own messages
    channels = [] :: [starl_mcap_record:id()],
    %% what was read of a chunk and is not yet given
    texts = [] :: [binary()],
    opened = 0 :: non_neg_integer()
}).

-opaque t() :: #raw{}.

%% How the file ends: it was closed; it is cut off; from this byte on it is damaged.
-type ended() :: closed | cut_off | {damaged, starl_mcap_reader:position()}.

-type reason() ::
    starl_mcap_reader:reason()
    | {no_recording, file:filename_all()}
    | {terms, file:filename_all(), starl_trace_terms:reason()}.

-type next() :: {ok, [starl_trace_message:t()], t()} | {ended, ended()} | {error, reason()}.

%% @doc Opens a recording at its beginning.
-spec open(file:filename_all()) -> {ok, t()} | {error, reason()}.
open(File) ->
    case starl_mcap_reader:open(File) of
        {ok, Reader} ->
            First = starl_mcap_reader:first(Reader),
            {ok, #raw{file = File, reader = Reader, position = First}};
        {error, _} = Error ->
            Error
    end.

%% @doc Closes it.
-spec close(t()) -> ok.
close(#raw{reader = Reader}) -> starl_mcap_reader:close(Reader).

%% @doc Its file.
-spec file(t()) -> file:filename_all().
file(#raw{file = File}) -> File.

%% @doc The number of chunks that were opened so far.
-spec opened(t()) -> non_neg_integer().
opened(#raw{opened = Opened}) -> Opened.

%% @doc All whole chunks, and how the file ends, without opening any. They come from the index of
%% the file, or without an index from the heads of its records.
-spec list(t()) -> {[starl_mcap_reader:chunk()], ended()}.
list(#raw{reader = Reader}) -> starl_mcap_reader:chunks(Reader).

%% @doc The place at which it is read next.
-spec place(t()) -> starl_mcap_reader:position().
place(#raw{position = Position}) -> Position.

%% @doc The same file at the place of a chunk.
-spec at(starl_mcap_reader:position(), t()) -> t().
at(Position, Raw) -> Raw#raw{position = Position, texts = []}.

%% @doc The next messages, as they stand in the file: those of about a second.
-spec next(t()) -> next().
next(Raw) ->
    case filled(Raw) of
        {ok, #raw{texts = [Text | Texts]} = Full} ->
            some(decoded([Text], [], Full#raw{texts = Texts}));
        Other ->
            Other
    end.

some({ok, [], Raw}) -> next(Raw);
some(Answer) -> Answer.

%% @doc All messages of the next chunk: one that was packed holds more than a second.
-spec chunk(t()) -> next().
chunk(Raw) ->
    case filled(Raw) of
        {ok, #raw{texts = Texts} = Full} -> decoded(Texts, [], Full#raw{texts = []});
        Other -> Other
    end.

%% Reads on until there is something to decode.
filled(#raw{texts = [_ | _]} = Raw) ->
    {ok, Raw};
filled(#raw{reader = Reader, position = Position} = Raw) ->
    case starl_mcap_reader:next(Position, Reader) of
        {ok, {chunk, _, _, _, _, _, _} = Chunk, After} ->
            unpacked(starl_mcap_chunk:records(Chunk), Raw#raw{
                position = After, opened = Raw#raw.opened + 1
            });
        {ok, {data_end, _}, _} ->
            ended(closed, Raw);
        {ok, {footer, _, _, _}, _} ->
            ended(closed, Raw);
        {ok, Record, After} ->
            texts([Record], Raw#raw{position = After});
        'end' ->
            ended(cut_off, Raw);
        {cut, _} ->
            ended(cut_off, Raw);
        {error, {damaged, _, At, _}} ->
            passed(At, Raw);
        {error, _} = Error ->
            Error
    end.

%% What is damaged between chunks costs nothing, if the index tells where the next one is.
passed(At, #raw{reader = Reader} = Raw) ->
    case
        not starl_mcap_reader:is_chunk(At, Reader) andalso starl_mcap_reader:following(At, Reader)
    of
        {ok, Place} -> filled(Raw#raw{position = Place});
        _ -> ended({damaged, At}, Raw)
    end.

unpacked({ok, Records}, Raw) ->
    texts(Records, Raw);
unpacked({error, {packed, _, unknown}}, #raw{opened = Opened, position = Position} = Raw) when
    Opened > 1
->
    ended({damaged, Position}, Raw);
unpacked({error, {packed, _, _} = Reason}, #raw{file = File, position = Position}) ->
    {error, {damaged, File, Position, Reason}};
unpacked({error, _}, #raw{position = Position} = Raw) ->
    ended({damaged, Position}, Raw).

%% A file without one message is no recording of ours, unless it was cut off before the first.
ended(closed, #raw{file = File, channels = []}) ->
    {error, {no_recording, File}};
ended(Ended, _Raw) ->
    {ended, Ended}.

texts(Records, #raw{channels = Known} = Raw) ->
    New = [Id || {channel, Id, _, <<"/starl">>, <<"json">>, _} <- Records],
    Channels = lists:usort(New ++ Known),
    Texts = [
        Data
     || {message, Channel, _, _, _, Data} <- Records, lists:member(Channel, Channels)
    ],
    filled(Raw#raw{channels = Channels, texts = Texts}).

decoded([], Parts, Raw) ->
    {ok, lists:append(lists:reverse(Parts)), Raw};
decoded([Text | Texts], Parts, #raw{file = File} = Raw) ->
    case starl_trace_terms:decode(Text) of
        {ok, Messages} ->
            case
                is_list(Messages) andalso lists:all(fun starl_trace_message:is_message/1, Messages)
            of
                true -> decoded(Texts, [Messages | Parts], Raw);
                false -> {error, {terms, File, not_terms}}
            end;
        {error, Reason} ->
            {error, {terms, File, Reason}}
    end.

%% @doc One line on a problem: what is wrong, where, and what to do.
-spec format_error(reason() | {too_short, file:filename_all()}) -> unicode:chardata().
format_error({too_short, File}) ->
    io_lib:format("~ts: it is cut off or damaged before its first message", [File]);
format_error({no_recording, File}) ->
    io_lib:format("~ts: an MCAP file, but not one of StarL: it has no topic /starl", [File]);
format_error({terms, File, not_terms}) ->
    io_lib:format("~ts: its topic /starl holds what no run of StarL records", [File]);
format_error({terms, File, too_large}) ->
    io_lib:format("~ts: a message of its topic /starl is too large", [File]);
format_error({terms, File, too_many_atoms}) ->
    io_lib:format("~ts: it names more than this VM takes from recordings", [File]);
format_error(Reason) ->
    starl_mcap_reader:format_error(Reason).
