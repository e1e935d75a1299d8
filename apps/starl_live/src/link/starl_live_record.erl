%% @doc The record of a live robot's facts in a file, batch by batch. A batch is written before
%% anything that follows from it leaves the robot, so the record of a node that was killed tells
%% what its messages did not tell any more. A power failure may cost the last seconds: nothing is
%% synced.
-module(starl_live_record).

-export([open/1, file/1, write/3, read/2]).

-export_type([t/0]).

-record(record, {file :: file:filename(), device :: file:io_device()}).

-opaque t() :: #record{}.

%% @doc Opens a new record in a directory.
-spec open(file:filename()) -> {ok, t()} | {error, unicode:chardata()}.
open(Dir) ->
    Name = "facts-" ++ integer_to_list(erlang:system_time(microsecond)),
    File = filename:join(Dir, Name),
    case file:open(File, [write, exclusive, raw, binary]) of
        {ok, Device} -> {ok, #record{file = File, device = Device}};
        {error, Posix} -> {error, [File, ": ", file:format_error(Posix)]}
    end.

%% @doc The file of the record.
-spec file(t()) -> file:filename().
file(#record{file = File}) -> File.

%% @doc Writes a batch. A disk that is full costs the record, not the robot.
-spec write(Batch :: pos_integer(), [starl_monitor:trace_event()], t()) -> ok.
write(Batch, Events, #record{device = Device}) ->
    Bytes = term_to_binary({Batch, Events}),
    _ = file:write(Device, [<<(byte_size(Bytes)):32>>, Bytes]),
    ok.

%% @doc The events of all batches after this one, as far as they were written.
-spec read(file:filename(), After :: non_neg_integer()) -> [starl_monitor:trace_event()].
read(File, After) ->
    case file:read_file(File) of
        {ok, Bytes} -> lists:append([Events || {N, Events} <- batches(Bytes), N > After]);
        {error, _} -> []
    end.

%% The last batch may be cut off.
batches(<<Size:32, Bytes:Size/binary, Rest/binary>>) -> [binary_to_term(Bytes) | batches(Rest)];
batches(_) -> [].
