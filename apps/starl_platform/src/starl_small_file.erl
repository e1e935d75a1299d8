%% @doc Reads a whole file whose name may come from anybody. A pipe or a device, which may never end, is none, and
%% no more is read than the reader can use.
-module(starl_small_file).

-include_lib("kernel/include/file.hrl").

-export([read/2, beginning/2]).

%% @doc The bytes of a file. `efbig': there are more; `einval': it is neither a file nor a directory.
-spec read(file:name_all(), Most :: non_neg_integer()) ->
    {ok, binary()} | {error, file:posix() | badarg | terminated | system_limit}.
read(File, Most) ->
    case size_of(File) of
        {ok, Size} when Size > Most -> {error, efbig};
        {ok, _} -> whole(first(File, Most + 1), Most);
        {error, _} = Error -> Error
    end.

%% It may grow meanwhile.
whole({ok, Bytes}, Most) when byte_size(Bytes) > Most -> {error, efbig};
whole(Read, _Most) -> Read.

%% @doc The first bytes of a file, at most so many.
-spec beginning(file:name_all(), Most :: non_neg_integer()) ->
    {ok, binary()} | {error, file:posix() | badarg | terminated | system_limit}.
beginning(File, Most) ->
    case size_of(File) of
        {ok, _} -> first(File, Most);
        {error, _} = Error -> Error
    end.

size_of(File) ->
    case file:read_file_info(File) of
        {ok, #file_info{type = regular, size = Size}} -> {ok, Size};
        {ok, #file_info{type = directory}} -> {error, eisdir};
        {ok, _} -> {error, einval};
        {error, _} = Error -> Error
    end.

first(File, Most) ->
    case file:open(File, [read, raw, binary]) of
        {ok, Device} ->
            Read = file:read(Device, Most),
            _ = file:close(Device),
            none_left(Read);
        {error, _} = Error ->
            Error
    end.

none_left(eof) -> {ok, <<>>};
none_left(Read) -> Read.
