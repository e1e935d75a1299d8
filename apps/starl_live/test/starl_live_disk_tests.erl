%% The disk of a live robot: this computer's, or that of a module, which is this one.
-module(starl_live_disk_tests).
-include_lib("eunit/include/eunit.hrl").
-behaviour(starl_live_disk).

-export([ensure_path/1, list/2, is_file/1]).
-export([open/2, write/2, sync/1, close/1, rename/2, delete/1, read_file/1]).

%% -- a disk that answers with what it is asked -----------------------------------------------------------

ensure_path(Path) -> {ensure_path, Path}.
list(Path, Suffix) -> {list, Path, Suffix}.
is_file(Path) -> {is_file, Path}.
open("gone", _Modes) -> {error, enoent};
open(Path, Modes) -> {ok, {Path, Modes}}.
write(Device, Bytes) -> {write, Device, Bytes}.
sync(Device) -> {sync, Device}.
close(Device) -> {close, Device}.
rename(From, To) -> {rename, From, To}.
delete(Path) -> {delete, Path}.
read_file(Path) -> {read_file, Path}.

-define(DIR, {?MODULE, "a/b"}).

%% A place on a simulated disk stays there.
places_stay_on_their_disk_test_() ->
    [
        ?_assertEqual({?MODULE, "a/b/c"}, starl_live_disk:place(?DIR, "c")),
        ?_assertEqual({?MODULE, "a/b.new"}, starl_live_disk:suffixed(?DIR, ".new")),
        ?_assertEqual({?MODULE, "a"}, starl_live_disk:dirname(?DIR)),
        ?_assertEqual("a/b", starl_live_disk:name(?DIR)),
        ?_assertEqual("a/b/c", starl_live_disk:place("a/b", "c")),
        ?_assertEqual("a/b.new", starl_live_disk:suffixed("a/b", ".new")),
        ?_assertEqual("a", starl_live_disk:dirname("a/b")),
        ?_assertEqual("a/b", starl_live_disk:name("a/b"))
    ].

%% Its module is asked, with the path alone.
a_simulated_disk_is_asked_test_() ->
    {ok, Device} = starl_live_disk:open(?DIR, [write]),
    Open = {"a/b", [write]},
    [
        ?_assertEqual(Asked, Answer)
     || {Asked, Answer} <- [
            {{ensure_path, "a/b"}, starl_live_disk:ensure_path(?DIR)},
            {{list, "a/b", ".kept"}, starl_live_disk:list(?DIR, ".kept")},
            {{is_file, "a/b"}, starl_live_disk:is_file(?DIR)},
            {{error, enoent}, starl_live_disk:open({?MODULE, "gone"}, [write])},
            {{write, Open, "bytes"}, starl_live_disk:write(Device, "bytes")},
            {{sync, Open}, starl_live_disk:sync(Device)},
            {{close, Open}, starl_live_disk:close(Device)},
            {{rename, "a/b", "c"}, starl_live_disk:rename(?DIR, {?MODULE, "c"})},
            {{delete, "a/b"}, starl_live_disk:delete(?DIR)},
            {{read_file, "a/b"}, starl_live_disk:read_file(?DIR)}
        ]
    ].

%% This computer's disk, from the first directory to the last file.
this_computers_disk_test() ->
    Dir = filename:join(os:getenv("TMPDIR", "/tmp"), "starl-disk-" ++ os:getpid()),
    Deep = filename:join(Dir, "deep"),
    [New, File] = [starl_live_disk:place(Deep, Name) || Name <- ["b.kept.new", "b.kept"]],
    ?assertNot(starl_live_disk:is_file(Deep)),
    ok = starl_live_disk:ensure_path(Deep),
    ?assert(starl_live_disk:is_file(Deep)),
    {ok, Device} = starl_live_disk:open(New, [write, raw, binary]),
    ok = starl_live_disk:write(Device, ["by", <<"tes">>]),
    ok = starl_live_disk:sync(Device),
    ok = starl_live_disk:close(Device),
    ?assertMatch({error, _}, starl_live_disk:write(Device, "more")),
    ok = starl_live_disk:rename(New, File),
    ok = file:write_file(starl_live_disk:place(Deep, "a.kept"), ""),
    ?assertEqual(["a.kept", "b.kept"], starl_live_disk:list(Deep, ".kept")),
    ?assertEqual([], starl_live_disk:list(Deep, ".new")),
    ?assertEqual({ok, <<"bytes">>}, starl_live_disk:read_file(File)),
    ok = starl_live_disk:delete(File),
    ?assertEqual({error, enoent}, starl_live_disk:read_file(File)),
    ?assertEqual({error, enoent}, starl_live_disk:delete(File)),
    ?assertMatch({error, _}, starl_live_disk:sync(Device)),
    ok = file:del_dir_r(Dir).
