-module(starl_live_record_tests).
-include_lib("eunit/include/eunit.hrl").

%% The batches after the last one that has come; a batch that was cut off is left out.
record_test() ->
    Dir = filename:join(os:getenv("TMPDIR", "/tmp"), "starl-record-" ++ os:getpid()),
    ok = filelib:ensure_path(Dir),
    {ok, Record} = starl_live_record:open(Dir),
    Events = [[{N, 1, sap, {fact, N}}] || N <- lists:seq(1, 5)],
    _ = lists:foldl(
        fun({N, Some}, R) -> starl_live_record:write({N, 10 * N, Some}, R) end,
        Record,
        lists:zip([1, 2, 3, 4, 5], Events)
    ),
    File = starl_live_record:file(Record),
    ?assertEqual(lists:append(Events), starl_live_record:read(File, 0)),
    ?assertEqual([{5, 1, sap, {fact, 5}}], starl_live_record:read(File, 4)),
    ?assertEqual([{5, 50, [{5, 1, sap, {fact, 5}}]}], starl_live_record:batches(File, 4)),
    ?assertEqual([], starl_live_record:read(File, 5)),
    {ok, Bytes} = file:read_file(File),
    ok = file:write_file(File, binary:part(Bytes, 0, byte_size(Bytes) - 1)),
    ?assertEqual([{4, 1, sap, {fact, 4}}], starl_live_record:read(File, 3)),
    ok = file:write_file(File, ""),
    ?assertEqual([], starl_live_record:read(File, 0)),
    ok = file:del_dir_r(Dir),
    ?assertEqual([], starl_live_record:read(File, 0)),
    ?assertMatch({error, _}, starl_live_record:open(Dir)).

%% Of a long start the latest facts are kept; the facts of the last start are wanted.
bounded_test() ->
    Dir = filename:join(os:getenv("TMPDIR", "/tmp"), "starl-bounded-" ++ os:getpid()),
    ok = filelib:ensure_path(Dir),
    Large = binary:copy(<<"facts">>, 1000000),
    ?assertEqual([], starl_live_record:last(Dir)),
    Wrote = fun(N, {R, _}) ->
        {starl_live_record:write({N, N, [{N, 1, app, Large}]}, R), N}
    end,
    Files = [
        begin
            {ok, Record} = starl_live_record:open(Dir),
            {_, 12} = lists:foldl(Wrote, {Record, 0}, lists:seq(1, 12)),
            starl_live_record:file(Record)
        end
     || _ <- [first, second, third]
    ],
    Kept = [N || {N, 1, app, _} <- starl_live_record:last(Dir)],
    ?assertEqual(lists:seq(hd(Kept), 12), Kept),
    ?assert(length(Kept) >= 4 andalso length(Kept) < 12),
    ?assertEqual([false, false, true], [filelib:is_file(File) || File <- Files]),
    ?assertEqual(2, length(filelib:wildcard("*", Dir))),
    ok = file:del_dir_r(Dir).

%% The names of records were times once, and the clock has been set back since.
starts_are_ordered_by_number_test() ->
    Dir = filename:join(os:getenv("TMPDIR", "/tmp"), "starl-starts-" ++ os:getpid()),
    ok = filelib:ensure_path(Dir),
    Later = erlang:system_time(microsecond) + 3_600_000_000,
    [
        ok = file:write_file(filename:join(Dir, "facts-" ++ integer_to_list(N)), "")
     || N <- [9, 10, Later]
    ],
    {ok, Record} = starl_live_record:open(Dir),
    _ = starl_live_record:write({1, 1, [{1, 1, app, last}]}, Record),
    Names = ["facts-" ++ integer_to_list(N) || N <- [9, 10, Later, Later + 1]],
    ?assertEqual(Names, [filename:basename(File) || File <- starl_live_record:starts(Dir)]),
    ?assertEqual([{1, 1, app, last}], starl_live_record:last(Dir)),
    ?assertEqual([starl_live_record:file(Record)], starl_live_record:starts(Dir)),
    ok = file:del_dir_r(Dir).

%% A batch that a full disk has cut off is taken back: one after it that finds room is read. No file of the
%% program may have more than 512 bytes; two batches of 150 fit.
full_disk_test_() ->
    {timeout, 60, fun() ->
        Dir = filename:join(os:getenv("TMPDIR", "/tmp"), "starl-full-" ++ os:getpid()),
        ok = filelib:ensure_path(Dir),
        Eval =
            "{ok, New} = starl_live_record:open(\"" ++ Dir ++
                "\"),"
                "Write = fun({N, Size}, Record) -> starl_live_record:write("
                "{N, N, [{N, 1, app, binary:copy(<<0>>, Size)}]}, Record) end,"
                "lists:foldl(Write, New, [{1, 150}, {2, 150}, {3, 150}, {4, 10}]), halt().",
        Erl =
            "exec erl -noinput -pa " ++ filename:dirname(code:which(starl_live_record)) ++
                " -eval '" ++ Eval ++ "'",
        ?assertEqual("", os:cmd("trap '' XFSZ; ulimit -f 1; " ++ Erl)),
        ?assertEqual([1, 2, 4], [N || {N, 1, app, _} <- starl_live_record:last(Dir)]),
        ok = file:del_dir_r(Dir)
    end}.
