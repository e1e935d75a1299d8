%% @doc Records a live robot's trace events in a file, batch by batch. A batch is written before
%% anything that follows from it leaves the robot. So the record of a killed node shows what its
%% messages and its recording could no longer report. A power failure may cost the last seconds:
%% nothing is synced.
%%
%% Starts are ordered by their numbers: the clock may have been set back between two of them.
%%
%% Only the latest events are needed. A file that has grown to some size is renamed to
%% `FILE.before', in the place of the earlier file of that name.
-module(starl_live_record).

-export([open/1, file/1, write/2, read/2, batches/2, starts/1, is_record/1, last/1]).

-export_type([t/0, batch/0]).

%% A batch of facts, with its number and the time of the robot's clock at the last look at it before the
%% facts left: what has a latest moment was in time then. Each fact bears the time of its step, too.
-type batch() :: {pos_integer(), LookedUs :: integer(), [starl_monitor:trace_event()]}.

-record(record, {
    file :: file:filename(), device :: file:io_device(), size = 0 :: non_neg_integer()
}).

-opaque t() :: #record{}.

-define(PREFIX, "facts-").
-define(BEFORE, ".before").
%% Far more than a recording can be behind.
-define(MOST_BYTES, 16 * 1024 * 1024).

%% @doc Opens a new record in a directory: that of one more start.
-spec open(file:filename()) -> {ok, t()} | {error, unicode:chardata()}.
open(Dir) ->
    Number = lists:max([0 | [N || {N, _} <- numbered(Dir)]]) + 1,
    File = filename:join(Dir, ?PREFIX ++ integer_to_list(Number)),
    case file:open(File, [write, exclusive, raw, binary]) of
        {ok, Device} -> {ok, #record{file = File, device = Device}};
        {error, Posix} -> {error, [File, ": ", file:format_error(Posix)]}
    end.

%% The records in a directory, by the numbers of their starts.
numbered(Dir) ->
    Digits = length(?PREFIX),
    [
        {N, filename:join(Dir, Name)}
     || Name <- filelib:wildcard(?PREFIX ++ "*", Dir),
        {N, ""} <- [string:to_integer(lists:nthtail(Digits, Name))]
    ].

%% @doc The file of the record.
-spec file(t()) -> file:filename().
file(#record{file = File}) -> File.

%% @doc Writes a batch. A disk that is full costs the batches that do not fit, not the robot: what was
%% written of one is taken back, so that those after it can be read.
-spec write(batch(), t()) -> t().
write({_N, _Looked, []}, Record) ->
    Record;
write(Batch, Record) ->
    #record{device = Device, size = Size} = Turned = turned(Record),
    Bytes = term_to_binary(Batch),
    case file:write(Device, [<<(byte_size(Bytes)):32>>, Bytes]) of
        ok -> Turned#record{size = Size + 4 + byte_size(Bytes)};
        {error, _} -> taken_back(Turned)
    end.

taken_back(#record{device = Device, size = Size} = Record) ->
    _ = file:position(Device, Size),
    _ = file:truncate(Device),
    Record.

turned(#record{size = Size} = Record) when Size < ?MOST_BYTES -> Record;
turned(#record{file = File, device = Device} = Record) ->
    _ = file:rename(File, File ++ ?BEFORE),
    case file:open(File, [write, raw, binary]) of
        {ok, New} ->
            _ = file:close(Device),
            Record#record{device = New, size = 0};
        {error, _} ->
            Record#record{size = 0}
    end.

%% @doc The events of all batches after this one, as far as they were written.
-spec read(file:filename(), After :: non_neg_integer()) -> [starl_monitor:trace_event()].
read(File, After) -> lists:append([Events || {_, _, Events} <- batches(File, After)]).

%% @doc The batches after this one, as far as they were written.
-spec batches(file:filename(), After :: non_neg_integer()) -> [batch()].
batches(File, After) ->
    newer(lists:reverse(written(File ++ ?BEFORE) ++ written(File)), After, []).

%% From the last one on: there may be many.
newer([Bytes | Before], After, Newer) ->
    case binary_to_term(Bytes) of
        {N, _, _} = Batch when N > After -> newer(Before, After, [Batch | Newer]);
        _ -> Newer
    end;
newer([], _After, Newer) ->
    Newer.

written(File) ->
    case file:read_file(File) of
        {ok, Bytes} -> split(Bytes);
        {error, _} -> []
    end.

%% The last batch may be cut off.
split(<<Size:32, Bytes:Size/binary, Rest/binary>>) -> [Bytes | split(Rest)];
split(_) -> [].

%% @doc The records of all starts of a robot that are in its directory, in their order.
-spec starts(Dir :: file:filename()) -> [file:filename()].
starts(Dir) -> [File || {_N, File} <- lists:sort(numbered(Dir))].

%% @doc Is the file of this name a record? A robot's directory also holds its store.
-spec is_record(file:filename()) -> boolean().
is_record(Name) -> lists:prefix(?PREFIX, Name).

%% @doc The last events of the robot's last start, none if there was none. The records of earlier
%% starts are deleted.
-spec last(Dir :: file:filename()) -> [starl_monitor:trace_event()].
last(Dir) ->
    case lists:reverse(starts(Dir)) of
        [] ->
            [];
        [Last | Earlier] ->
            _ = [file:delete(File ++ Suffix) || File <- Earlier, Suffix <- ["", ?BEFORE]],
            read(Last, 0)
    end.
