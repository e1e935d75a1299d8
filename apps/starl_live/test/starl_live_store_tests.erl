%% The store of a live robot, on a real file system.
-module(starl_live_store_tests).
-include_lib("eunit/include/eunit.hrl").

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
            {"names of any kind", fun names/1}
        ]
    ]}.

empty(Dir) ->
    ?assertEqual(none, starl_live_store:kept(sap, open(Dir))),
    ?assertEqual(#{}, starl_live_store:starts(open(Dir))).

latest(Dir) ->
    Store = open(Dir),
    [ok = starl_live_store:keep(Name, Term, Store) || {Name, Term} <- [{a, 1}, {b, 2}, {a, [3]}]],
    ?assertEqual({stored, [3]}, starl_live_store:kept(a, Store)),
    ?assertEqual({stored, 2}, starl_live_store:kept(b, Store)).

reopened(Dir) ->
    ok = starl_live_store:keep(barrier, #{round => 7}, open(Dir)),
    ?assertEqual({stored, #{round => 7}}, starl_live_store:kept(barrier, open(Dir))).

%% Every single byte that is wrong is noticed.
damaged(Dir) ->
    Store = open(Dir),
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
    Store = open(Dir),
    ok = starl_live_store:keep(a, old, Store),
    ok = file:write_file(filename:join(Dir, "a.kept.new"), <<"starl-1 half">>),
    ?assertEqual({stored, old}, starl_live_store:kept(a, open(Dir))),
    ok = starl_live_store:keep(a, new, Store),
    ?assertEqual({stored, new}, starl_live_store:kept(a, Store)).

full(Dir) ->
    Store = open(Dir),
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
    Store = open(Dir),
    ok = starl_live_store:started(#{sap => 3, app => 2}, Store),
    {ok, Old} = file:read_file(filename:join(Dir, "starts-a")),
    ok = starl_live_store:started(#{sap => 4, app => 2}, Store),
    ok = file:write_file(filename:join(Dir, "starts-a"), Old),
    ?assertEqual(#{sap => 4, app => 2}, starl_live_store:starts(Store)),
    ok = file:write_file(filename:join(Dir, "starts-a"), "rubbish"),
    ?assertEqual(#{sap => 4, app => 2}, starl_live_store:starts(Store)).

%% A number that no robot has reached, for every machine that has kept anything, and for SAP.
both_copies(Dir) ->
    Store = open(Dir),
    ok = starl_live_store:keep(barrier, 1, Store),
    [ok = file:write_file(filename:join(Dir, F), "rubbish") || F <- ["starts-a", "starts-b"]],
    logger:set_primary_config(level, none),
    Starts = starl_live_store:starts(Store),
    logger:set_primary_config(level, notice),
    ?assertEqual([barrier, sap], lists:sort(maps:keys(Starts))),
    ?assert(lists:all(fun(N) -> N > 1_700_000_000 end, maps:values(Starts))).

names(Dir) ->
    Store = open(Dir),
    Names = ['../up', 'a/b', 'Ä %', 'a.kept', ''],
    [ok = starl_live_store:keep(Name, Name, Store) || Name <- Names],
    [?assertEqual({stored, Name}, starl_live_store:kept(Name, Store)) || Name <- Names],
    ?assertEqual(length(Names), length(filelib:wildcard("*", Dir))).

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
