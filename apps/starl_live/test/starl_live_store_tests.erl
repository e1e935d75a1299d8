%% The store of a live robot, on a real file system.
%%
%% Holds: A lost store is not taken for a first start
%% Red: 305a414, run (live): `message id used twice`, `reached out of order`
-module(starl_live_store_tests).
-include_lib("eunit/include/eunit.hrl").
-behaviour(starl_live_disk).

-export([ensure_path/1, list/2, is_file/1, read_file/1]).
-export([open/2, write/2, sync/1, close/1, rename/2, delete/1]).

store_test_() ->
    {foreach, fun dir/0, fun file:del_dir_r/1, [
        fun(Dir) -> {Name, fun() -> Test(Dir) end} end
     || {Name, Test} <- [
            {"nothing is kept at first", fun empty/1},
            {"the latest term of each machine", fun latest/1},
            {"a term outlives the process", fun reopened/1},
            {"a damaged term", fun damaged/1},
            {"what was being written when the power failed", fun half_written/1},
            {"a full or missing disk", fun full/1},
            {"numbers of starts, twice", fun starts/1},
            {"both copies unreadable", fun both_copies/1},
            {"a store that is commissioned is that of a first life, once", fun first_life/1},
            {"a robot without files has lost its store", fun lost/1},
            {"a store that was lost stays outdated, term by term", fun outdated_by_term/1},
            {"a store that is older than the robot's last life", fun set_back/1},
            {"a power cut while terms are removed", fun half_emptied/1},
            {"names of any kind", fun names/1},
            {"a commissioned directory with terms", fun not_new/1},
            {"a store that was lost is said, and why nothing is stored", fun said/1},
            {"a disk that takes no new file", fun no_new_file/1},
            {"a commission or a loss that cannot be written", fun no_mark/1},
            {"a mark that nobody can read", fun unreadable_mark/1},
            {"a mark that cannot be removed", fun fixed_mark/1},
            {"terms that cannot be removed", fun fixed_terms/1}
        ]
    ]}.

empty(Dir) ->
    ok = starl_live_store:commission(Dir),
    ?assertEqual(none, starl_live_store:kept(sap, open(Dir))),
    ?assertEqual(#{}, starl_live_store:starts(open(Dir))).

latest(Dir) ->
    Store = new(Dir),
    [ok = starl_live_store:keep(Name, Term, Store) || {Name, Term} <- [{a, 1}, {b, 2}, {a, [3]}]],
    ?assertEqual({stored, [3]}, starl_live_store:kept(a, Store)),
    ?assertEqual({stored, 2}, starl_live_store:kept(b, Store)).

reopened(Dir) ->
    ok = starl_live_store:keep(barrier, #{round => 7}, new(Dir)),
    ?assertEqual({stored, #{round => 7}}, starl_live_store:kept(barrier, open(Dir))).

%% Every single byte that is wrong is noticed.
damaged(Dir) ->
    Store = new(Dir),
    ok = starl_live_store:keep(a, {some, <<"term">>}, Store),
    [File] = filelib:wildcard("*.kept", Dir),
    {ok, Bytes} = file:read_file(filename:join(Dir, File)),
    lists:foreach(
        fun(N) ->
            <<Before:N/binary, Byte, After/binary>> = Bytes,
            Flipped = [Before, Byte bxor 16, After],
            ok = file:write_file(filename:join(Dir, File), Flipped),
            ?assertEqual({N, damaged}, {N, starl_live_store:kept(a, Store)})
        end,
        lists:seq(0, byte_size(Bytes) - 1)
    ),
    ok = file:write_file(filename:join(Dir, File), binary:part(Bytes, 0, 9)),
    ?assertEqual(damaged, starl_live_store:kept(a, Store)),
    ok = starl_live_store:keep(a, again, Store),
    ?assertEqual({stored, again}, starl_live_store:kept(a, Store)).

%% The new file has not got its name yet: the old term counts.
half_written(Dir) ->
    Store = new(Dir),
    ok = starl_live_store:keep(a, old, Store),
    ok = file:write_file(filename:join(Dir, "a.kept.new"), <<"starl-1 half">>),
    ?assertEqual({stored, old}, starl_live_store:kept(a, open(Dir))),
    ok = starl_live_store:keep(a, new, Store),
    ?assertEqual({stored, new}, starl_live_store:kept(a, Store)).

full(Dir) ->
    Store = new(Dir),
    ok = file:del_dir_r(Dir),
    logger:set_primary_config(level, none),
    ?assertEqual(full, starl_live_store:keep(a, 1, Store)),
    logger:set_primary_config(level, notice),
    ?assertMatch({error, _}, starl_live_store:started(#{a => 1}, Store)),
    ok = file:write_file(Dir, "a file"),
    {error, Line} = starl_live_store:open(Dir),
    ?assertNotEqual(nomatch, string:find(Line, Dir)),
    ok = file:delete(Dir),
    ok = file:make_dir(Dir).

%% One copy may be old or unreadable: the other one counts, and the larger number of both.
starts(Dir) ->
    Store = new(Dir),
    ok = starl_live_store:started(#{sap => 3, app => 2}, Store),
    {ok, Old} = file:read_file(filename:join(Dir, "starts-a")),
    ok = starl_live_store:started(#{sap => 4, app => 2}, Store),
    ok = file:write_file(filename:join(Dir, "starts-a"), Old),
    ?assertEqual(#{sap => 4, app => 2}, starl_live_store:starts(Store)),
    ok = file:write_file(filename:join(Dir, "starts-a"), "rubbish"),
    ?assertEqual(#{sap => 4, app => 2}, starl_live_store:starts(Store)).

%% The robot has run before, nobody knows how often; what its machines kept is good.
both_copies(Dir) ->
    ok = starl_live_store:commission(Dir),
    Store = open(Dir),
    ok = starl_live_store:keep(barrier, 1, Store),
    [ok = file:write_file(filename:join(Dir, F), "rubbish") || F <- ["starts-a", "starts-b"]],
    Later = open(Dir),
    ?assertEqual(later, starl_live_store:life(Later)),
    ?assertEqual(#{}, starl_live_store:starts(Later)),
    ?assertEqual({stored, 1}, starl_live_store:kept(barrier, Later)).

first_life(Dir) ->
    ok = starl_live_store:commission(Dir),
    Store = open(Dir),
    ?assertEqual(first, starl_live_store:life(Store)),
    ?assertEqual(none, starl_live_store:kept(barrier, Store)),
    ok = starl_live_store:started(#{sap => 1}, Store),
    ?assertEqual(later, starl_live_store:life(open(Dir))),
    ?assertEqual(none, starl_live_store:kept(barrier, open(Dir))),
    %% the mark does not come back with the loss of the numbers
    [ok = file:delete(filename:join(Dir, F)) || F <- ["starts-a", "starts-b"]],
    ?assertEqual(later, starl_live_store:life(quietly(fun() -> open(Dir) end))).

lost(Dir) ->
    Store = quietly(fun() -> open(Dir) end),
    ?assertEqual(later, starl_live_store:life(Store)),
    ?assertEqual(#{}, starl_live_store:starts(Store)),
    ?assertEqual([damaged, damaged], [starl_live_store:kept(N, Store) || N <- [barrier, app]]).

%% A machine that has not written yet finds its term damaged at its next start, too.
outdated_by_term(Dir) ->
    Store = quietly(fun() -> open(Dir) end),
    ok = starl_live_store:started(#{sap => 1 bsl 41}, Store),
    ok = starl_live_store:keep(barrier, new, Store),
    Later = open(Dir),
    ?assertEqual({stored, new}, starl_live_store:kept(barrier, Later)),
    ?assertEqual(damaged, starl_live_store:kept(app, Later)).

set_back(Dir) ->
    ok = starl_live_store:commission(Dir),
    Store = open(Dir),
    ok = starl_live_store:started(#{sap => 7}, Store),
    ok = starl_live_store:keep(barrier, old, Store),
    ok = starl_live_store:outdate(12, Store),
    Later = open(Dir),
    ?assertEqual(damaged, starl_live_store:kept(barrier, Later)),
    ?assertEqual(#{sap => 12}, starl_live_store:starts(Later)),
    ok = starl_live_store:keep(barrier, new, Later),
    ?assertEqual({stored, new}, starl_live_store:kept(barrier, open(Dir))),
    ?assertEqual(#{sap => 12}, starl_live_store:starts(open(Dir))).

%% The mark is written first and changes its name last: no term is believed meanwhile.
half_emptied(Dir) ->
    ok = starl_live_store:commission(Dir),
    Store = open(Dir),
    ok = starl_live_store:started(#{sap => 7}, Store),
    [ok = starl_live_store:keep(Name, old, Store) || Name <- [a, b]],
    ok = starl_live_store:outdate(12, Store),
    ok = file:delete(filename:join(Dir, "a.kept")),
    Later = open(Dir),
    ?assertEqual([damaged, damaged], [starl_live_store:kept(Name, Later) || Name <- [a, b]]).

%% On a disk that fails at one of them: what was begun of a term is deleted, and what was done is not undone.
each_operation_may_fail_test_() ->
    Write = [open, write, sync, close],
    All = Write ++ [rename, open_dir, sync_dir, close_dir],
    [
        ?_assertEqual({Fails, Kept, Operations}, keeps(Fails))
     || {Fails, Kept, Operations} <- [
            {none, ok, All},
            {open, full, [open]},
            {write, full, [open, write, delete]},
            {sync, full, [open, write, sync, delete]},
            {close, full, [open, write, sync, close, delete]},
            {rename, full, Write ++ [rename]},
            {open_dir, full, Write ++ [rename, open_dir]},
            {sync_dir, full, Write ++ [rename, open_dir, sync_dir]},
            {close_dir, full, All}
        ]
    ].

keeps(Fails) ->
    Store = quietly(fun() -> open({?MODULE, "dir"}) end),
    _ = operations(),
    _ = put(?MODULE, Fails),
    Kept = quietly(fun() -> starl_live_store:keep(a, term, Store) end),
    _ = erase(?MODULE),
    {Fails, Kept, operations()}.

operations() ->
    receive
        {?MODULE, Operation} -> [Operation | operations()]
    after 0 -> []
    end.

%% This module is a disk, too, with the file of a first life.
ensure_path("dir") -> ok.
list("dir", _Suffix) -> [].
is_file(Path) -> Path =:= "dir/commissioned".
read_file("dir/" ++ _) -> {error, enoent}.
open("dir", Modes) -> opened(does(open_dir, lists:member(directory, Modes)), dir);
open("dir/a.kept.new", Modes) -> opened(does(open, lists:member(write, Modes)), file).

opened(ok, Device) -> {ok, Device};
opened({error, _} = Error, _Device) -> Error.

does(Operation, true) ->
    self() ! {?MODULE, Operation},
    case get(?MODULE) of
        Operation -> {error, eio};
        _ -> ok
    end.

write(file, _Bytes) -> does(write, true).
sync(file) -> does(sync, true);
sync(dir) -> does(sync_dir, true).
close(file) -> does(close, true);
close(dir) -> does(close_dir, true).
rename("dir/a.kept.new", "dir/a.kept") -> does(rename, true).
delete("dir/a.kept.new") -> does(delete, true).

%% Of a robot that has never run there are none: these are of another life, and are not believed.
%% It is no first life: whoever has terms has run, and they may be anybody's.
not_new(Dir) ->
    ok = starl_live_store:keep(barrier, old, new(Dir)),
    [ok = file:delete(filename:join(Dir, F)) || F <- ["starts-a", "starts-b"]],
    ok = starl_live_store:commission(Dir),
    Store = quietly(fun() -> open(Dir) end),
    ?assertEqual(later, starl_live_store:life(Store)),
    ?assertEqual(damaged, starl_live_store:kept(barrier, Store)),
    ?assertEqual([], filelib:wildcard("*.kept", Dir)),
    ?assertEqual({later, damaged}, {
        starl_live_store:life(open(Dir)), starl_live_store:kept(barrier, open(Dir))
    }).

%% Each with the directory, or the machine and the reason.
said(Dir) ->
    [{error, Lost, _}] = starl_live_log_ct:reports(fun() -> open(Dir) end),
    ?assertEqual(#{what => store_lost, dir => Dir}, Lost),
    ?assertEqual([], starl_live_log_ct:reports(fun() -> open(Dir) end)),
    ok = file:make_dir(filename:join(Dir, "barrier.kept.new")),
    Store = open(Dir),
    [{error, Full, _} = Report] = starl_live_log_ct:reports(fun() ->
        starl_live_store:keep(barrier, 1, Store)
    end),
    ?assertEqual(#{what => store_failed, machine => barrier, why => eisdir}, Full),
    ?assertEqual(
        "what barrier wanted to store was not stored: illegal operation on a directory",
        starl_live_log_ct:words(Report)
    ).

%% The old term counts, and the old numbers; what was begun of the new one is no file of the store.
no_new_file(Dir) ->
    Store = new(Dir),
    ok = starl_live_store:keep(a, old, Store),
    [ok = file:make_dir(filename:join(Dir, F ++ ".new")) || F <- ["a.kept", "starts-b"]],
    ?assertEqual(full, quietly(fun() -> starl_live_store:keep(a, new, Store) end)),
    ?assertEqual({stored, old}, starl_live_store:kept(a, Store)),
    {error, Line} = starl_live_store:started(#{sap => 2}, Store),
    ?assertEqual(Dir ++ ": illegal operation on a directory", lists:flatten(Line)),
    %% a term that cannot have its name, since a directory has it
    ok = file:make_dir(filename:join(Dir, "b.kept")),
    ?assertEqual(full, quietly(fun() -> starl_live_store:keep(b, 1, Store) end)),
    ?assertEqual(damaged, starl_live_store:kept(b, Store)).

no_mark(Dir) ->
    Why = Dir ++ ": illegal operation on a directory",
    ok = file:make_dir(filename:join(Dir, "commissioned.new")),
    {error, Commission} = starl_live_store:commission(Dir),
    ?assertEqual(Why, lists:flatten(Commission)),
    ok = file:make_dir(filename:join(Dir, "outdating.new")),
    {error, Lost} = quietly(fun() -> starl_live_store:open(Dir) end),
    ?assertEqual(Why, lists:flatten(Lost)),
    {error, Outdated} = starl_live_store:outdate(7, run_in(Dir)),
    ?assertEqual(Why, lists:flatten(Outdated)),
    {error, Nowhere} = starl_live_store:commission(filename:join([Dir, "starts-a", "below"])),
    ?assertEqual(
        filename:join([Dir, "starts-a", "below"]) ++ ": not a directory",
        lists:flatten(Nowhere)
    ).

%% A store in this directory, whose mark of a first life cannot be written.
run_in(Dir) ->
    ok = file:del_dir(filename:join(Dir, "commissioned.new")),
    new(Dir).

%% The store is outdated all the same, and nobody knows by how much.
unreadable_mark(Dir) ->
    Store = new(Dir),
    ok = starl_live_store:started(#{sap => 7}, Store),
    ok = file:write_file(filename:join(Dir, "outdated"), "rubbish"),
    Later = open(Dir),
    ?assertEqual(later, starl_live_store:life(Later)),
    ?assertEqual(damaged, starl_live_store:kept(barrier, Later)),
    ?assertEqual(#{sap => 7}, starl_live_store:starts(Later)).

%% The robot must not come up as in its first life again.
fixed_mark(Dir) ->
    ok = starl_live_store:commission(Dir),
    Store = open(Dir),
    Mark = filename:join(Dir, "commissioned"),
    ok = file:delete(Mark),
    ok = file:make_dir(Mark),
    ?assertMatch({error, _}, starl_live_store:started(#{sap => 1}, Store)),
    ok = file:del_dir(Mark),
    ?assertEqual(ok, starl_live_store:started(#{sap => 1}, Store)).

%% The mark keeps its name as long as one of them is there.
fixed_terms(Dir) ->
    Store = new(Dir),
    ok = starl_live_store:outdate(7, Store),
    [ok = file:make_dir(filename:join(Dir, F)) || F <- ["a.kept", "c.kept"]],
    ok = file:write_file(filename:join(Dir, "b.kept"), "term"),
    {error, Line} = starl_live_store:open(Dir),
    ?assertNotEqual(nomatch, string:prefix(lists:flatten(Line), Dir ++ ": ")),
    ?assert(filelib:is_file(filename:join(Dir, "outdating"))),
    [ok = file:del_dir(filename:join(Dir, F)) || F <- ["a.kept", "c.kept"]],
    ?assertEqual(#{sap => 7}, starl_live_store:starts(open(Dir))),
    ?assertEqual([], filelib:wildcard("*.kept", Dir)).

quietly(Fun) ->
    #{level := Level} = logger:get_primary_config(),
    ok = logger:set_primary_config(level, none),
    Answer = Fun(),
    ok = logger:set_primary_config(level, Level),
    Answer.

names(Dir) ->
    Store = new(Dir),
    Names = ['../up', 'a/b', 'Ä %', 'a.kept', ''],
    [ok = starl_live_store:keep(Name, Name, Store) || Name <- Names],
    [?assertEqual({stored, Name}, starl_live_store:kept(Name, Store)) || Name <- Names],
    ?assertEqual(length(Names) + 2, length(filelib:wildcard("*", Dir))).

%% The store of a robot that has run once.
new(Dir) ->
    ok = starl_live_store:commission(Dir),
    run(open(Dir)).

run(Store) ->
    ok = starl_live_store:started(#{sap => 1}, Store),
    Store.

open(Dir) ->
    {ok, Store} = starl_live_store:open(Dir),
    Store.

dir() ->
    Unique = integer_to_list(erlang:unique_integer([positive])),
    Dir = filename:join(
        os:getenv("TMPDIR", "/tmp"), "starl-store-" ++ os:getpid() ++ "-" ++ Unique
    ),
    ok = filelib:ensure_path(Dir),
    Dir.
