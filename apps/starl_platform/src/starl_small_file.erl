%% @doc Reads a whole file whose name may come from anybody. A pipe or a device, which may never end, is none, and
%% no more is read than the reader can use.
-module(starl_small_file).

-include_lib("kernel/include/file.hrl").

-export([read/2, beginning/2]).

%% @doc The bytes of a file. `efbig': there are more; `einval': it is neither a file nor a directory.
-spec read(file:name_all(), Most :: non_neg_integer()) ->
    {ok, binary()} | {error, file:posix() | badarg | terminated | system_limit}.
read(File, Most) ->
    case file:read_file_info(File) of
        {ok, #file_info{type = regular, size = Size}} when Size > Most -> {error, efbig};
        {ok, #file_info{type = regular}} -> opened(file:open(File, [read, raw, binary]), Most);
        {ok, #file_info{type = directory}} -> {error, eisdir};
        {ok, _} -> {error, einval};
        {error, _} = Error -> Error
    end.

%% @doc The first bytes of a file, at most so many.
-spec beginning(file:name_all(), Most :: non_neg_integer()) ->
    {ok, binary()} | {error, file:posix() | badarg | terminated | system_limit}.
beginning(File, Most) ->
    case file:read_file_info(File) of
        {ok, #file_info{type = regular}} -> begun(file:open(File, [read, raw, binary]), Most);
        {ok, #file_info{type = directory}} -> {error, eisdir};
        {ok, _} -> {error, einval};
        {error, _} = Error -> Error
    end.

begun({ok, Device}, Most) ->
    Read = file:read(Device, Most),
    _ = file:close(Device),
    case Read of
        eof -> {ok, <<>>};
        Other -> Other
    end;
begun({error, _} = Error, _Most) ->
    Error.

%% It may grow meanwhile.
opened({ok, Device}, Most) ->
    Read = file:read(Device, Most + 1),
    _ = file:close(Device),
    case Read of
        {ok, Bytes} when byte_size(Bytes) > Most -> {error, efbig};
        {ok, Bytes} -> {ok, Bytes};
        eof -> {ok, <<>>};
        {error, _} = Error -> Error
    end;
opened({error, _} = Error, _Most) ->
    Error.
