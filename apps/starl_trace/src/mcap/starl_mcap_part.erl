%% @doc A file that appears only when it is complete. Until then it is `FILE.part', and it is
%% deleted if something fails.
-module(starl_mcap_part).
-include_lib("kernel/include/file.hrl").

-export([make/2, write/2, written/1, format_error/1]).

-export_type([t/0, reason/0]).

-record(part, {
    out :: file:filename_all(), device :: file:io_device(), written = 0 :: non_neg_integer()
}).

-opaque t() :: #part{}.

-type reason() ::
    {write, file:filename_all(), not_a_file | file:posix() | badarg | terminated | system_limit}.

%% @doc Makes a file by a function that writes it. Only a file is replaced: no device, no directory.
-spec make(file:filename_all(), fun((t()) -> {ok, Answer} | {error, Reason})) ->
    {ok, Answer} | {error, Reason | reason()}.
make(Out, Fill) ->
    case file:read_file_info(Out) of
        {ok, #file_info{type = Type}} when Type =/= regular ->
            {error, {write, Out, not_a_file}};
        _ ->
            made(Out, Fill)
    end.

made(Out, Fill) ->
    Part = unicode:characters_to_list([Out, ".part"]),
    %% what an earlier one has left goes; a link there, of whoever has made the directory, is not followed
    _ = file:delete(Part),
    case file:open(Part, [write, exclusive, raw, binary]) of
        {ok, Device} -> placed(filled(Fill, #part{out = Out, device = Device}), Part, Out);
        {error, Posix} -> {error, {write, Out, Posix}}
    end.

filled(Fill, #part{device = Device} = Part) ->
    try
        Fill(Part)
    catch
        throw:{?MODULE, Reason} -> {error, Reason}
    after
        file:close(Device)
    end.

placed({ok, _} = Answer, Part, Out) ->
    case file:rename(Part, Out) of
        ok -> Answer;
        {error, Posix} -> {error, {write, Out, Posix}}
    end;
placed({error, _} = Error, Part, _Out) ->
    _ = file:delete(Part),
    Error.

%% @doc Adds bytes; if that fails, the whole file does.
-spec write(iodata(), t()) -> t().
write(Bytes, #part{out = Out, device = Device, written = Written} = Part) ->
    case file:write(Device, Bytes) of
        ok -> Part#part{written = Written + iolist_size(Bytes)};
        {error, Posix} -> throw({?MODULE, {write, Out, Posix}})
    end.

%% @doc The bytes that were written.
-spec written(t()) -> non_neg_integer().
written(#part{written = Written}) -> Written.

%% @doc One line on a file that could not be written.
-spec format_error(reason()) -> unicode:chardata().
format_error({write, Out, not_a_file}) ->
    io_lib:format("~ts: this is no file that can be replaced", [Out]);
format_error({write, Out, Posix}) ->
    io_lib:format("~ts: ~ts", [Out, file:format_error(Posix)]).
