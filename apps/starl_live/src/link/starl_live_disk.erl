%% @doc The disk of a live robot: the functions of `file' and `filelib' that its store needs. It is
%% this computer's disk or a simulated disk. A place `{Module, Path}' is on a simulated disk, whose
%% module has this behaviour; any other place is a name for `file'.
%% ```
%%     {ok, Store} = starl_live_store:open("robot-1"),                        this computer
%%     {ok, Store} = starl_live_store:open({my_disk, "robot-1"})              another one
%% '''
-module(starl_live_disk).

-export([place/2, suffixed/2, dirname/1, name/1, ensure_path/1, list/2, is_file/1]).
-export([open/2, write/2, sync/1, close/1, rename/2, delete/1, read_file/1]).

-export_type([place/0, device/0]).

-type place() :: file:filename_all() | {module(), file:filename_all()}.

%% An open file or directory.
-type device() :: file:io_device() | {module(), Device :: term()}.

-type posix() :: file:posix() | badarg | terminated | system_limit.

%% These do what the functions of `file' and `filelib' of the same name do; `list': the files of a
%% directory whose names end so, ascending. An open file that was written is empty at first, if `write'
%% is among the modes; a directory is opened with `directory'.
-callback ensure_path(Path :: string()) -> ok | {error, posix()}.
-callback list(Path :: string(), Suffix :: string()) -> [Name :: string()].
-callback is_file(Path :: string()) -> boolean().
-callback open(Path :: string(), [term()]) -> {ok, Device :: term()} | {error, posix()}.
-callback write(Device :: term(), iodata()) -> ok | {error, posix()}.
-callback sync(Device :: term()) -> ok | {error, posix()}.
-callback close(Device :: term()) -> ok | {error, posix()}.
-callback rename(From :: string(), To :: string()) -> ok | {error, posix()}.
-callback delete(Path :: string()) -> ok | {error, posix()}.
-callback read_file(Path :: string()) -> {ok, binary()} | {error, posix()}.

%% @doc A file in a directory.
-spec place(place(), Name :: string()) -> place().
place({Module, Dir}, Name) -> {Module, filename:join(Dir, Name)};
place(Dir, Name) -> filename:join(Dir, Name).

%% @doc The place beside this one whose name is longer by a suffix.
-spec suffixed(place(), Suffix :: string()) -> place().
suffixed({Module, Path}, Suffix) -> {Module, Path ++ Suffix};
suffixed(Path, Suffix) -> Path ++ Suffix.

%% @doc The directory of a file.
-spec dirname(place()) -> place().
dirname({Module, Path}) -> {Module, filename:dirname(Path)};
dirname(Path) -> filename:dirname(Path).

%% @doc The path of a place, for a line of text.
-spec name(place()) -> file:filename_all().
name({_Module, Path}) -> Path;
name(Path) -> Path.

%% @doc Makes a directory and those above it, where they are missing.
-spec ensure_path(place()) -> ok | {error, posix()}.
ensure_path({Module, Path}) -> Module:ensure_path(Path);
ensure_path(Path) -> filelib:ensure_path(Path).

%% @doc The names of a directory's files that end so, ascending.
-spec list(place(), Suffix :: string()) -> [string()].
list({Module, Path}, Suffix) -> Module:list(Path, Suffix);
list(Path, Suffix) -> filelib:wildcard("*" ++ Suffix, Path).

%% @doc Is there such a file?
-spec is_file(place()) -> boolean().
is_file({Module, Path}) -> Module:is_file(Path);
is_file(Path) -> filelib:is_file(Path).

%% @doc As `file:open/2'.
-spec open(place(), [file:mode() | directory]) -> {ok, device()} | {error, posix()}.
open({Module, Path}, Modes) ->
    case Module:open(Path, Modes) of
        {ok, Device} -> {ok, {Module, Device}};
        {error, _} = Error -> Error
    end;
open(Path, Modes) ->
    file:open(Path, Modes).

%% @doc As `file:write/2'.
-spec write(device(), iodata()) -> ok | {error, posix()}.
write({Module, Device}, Bytes) -> Module:write(Device, Bytes);
write(Device, Bytes) -> file:write(Device, Bytes).

%% @doc As `file:sync/1'.
-spec sync(device()) -> ok | {error, posix()}.
sync({Module, Device}) -> Module:sync(Device);
sync(Device) -> file:sync(Device).

%% @doc As `file:close/1'.
-spec close(device()) -> ok | {error, posix()}.
close({Module, Device}) -> Module:close(Device);
close(Device) -> file:close(Device).

%% @doc As `file:rename/2'; both are on the same disk.
-spec rename(place(), place()) -> ok | {error, posix()}.
rename({Module, From}, {Module, To}) -> Module:rename(From, To);
rename(From, To) -> file:rename(From, To).

%% @doc As `file:delete/1'.
-spec delete(place()) -> ok | {error, posix()}.
delete({Module, Path}) -> Module:delete(Path);
delete(Path) -> file:delete(Path).

%% @doc As `file:read_file/1'.
-spec read_file(place()) -> {ok, binary()} | {error, posix()}.
read_file({Module, Path}) -> Module:read_file(Path);
read_file(Path) -> file:read_file(Path).
