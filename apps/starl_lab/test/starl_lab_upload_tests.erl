%% --upload of a run: its recording is in the storage at its end, and a storage that is not reached changes
%% nothing of the run.
-module(starl_lab_upload_tests).

-include_lib("eunit/include/eunit.hrl").

-define(PATIENCE_S, 120).
-define(RUN, ["run", "formation", "--seed", "1", "--time", "5", "--quiet", "--out"]).

all_test_() ->
    case starl_storage_rclone:find() of
        {ok, _} ->
            [
                {Name, {timeout, ?PATIENCE_S, fun() -> in_directory(Test) end}}
             || {Name, Test} <- [
                    {"a run leaves its recording", fun a_run_leaves_its_recording/1},
                    {"unreached", fun unreached/1}
                ]
            ];
        {error, Reason} ->
            io:format(user, "upload: skipped, ~ts~n", [starl_storage:format_error(Reason)]),
            []
    end.

%% A directory is a storage, too.
a_run_leaves_its_recording(Dir) ->
    Store = filename:join(Dir, "store"),
    Out = filename:join(Dir, "run"),
    {_, Said} = starl_cli_said:said(?RUN ++ [Out, "--upload", Store]),
    ?assertNotEqual({nomatch, Said}, {string:find(Said, "run.mcap: is in " ++ Store), Said}),
    {ok, [#{name := "run.mcap"} = Entry]} = starl_storage:list(Store),
    Copy = filename:join(Dir, "copy.mcap"),
    {ok, fetched} = starl_storage:download(Entry, Store, Copy, #{}),
    ?assertEqual(file:read_file(filename:join(Out, "run.mcap")), file:read_file(Copy)).

%% Holds: A storage that is not reached costs the run nothing, and a line says how to go on
%% Red: without the end of `tell/2`, run
unreached(Dir) ->
    Alone = filename:join(Dir, "alone"),
    {Status, _} = starl_cli_said:said(?RUN ++ [Alone, "--record"]),
    Out = filename:join(Dir, "run"),
    {Same, Said} = starl_cli_said:said(?RUN ++ [Out, "--upload", "starlnowhere:a"]),
    ?assertEqual({Status, Said}, {Same, Said}),
    Again = "; ./starl upload " ++ filename:join(Out, "run.mcap") ++ " starlnowhere:a\n",
    ?assertNotEqual({nomatch, Said}, {string:find(Said, Again), Said}),
    ?assertEqual(digest(Alone), digest(Out)).

digest(Dir) ->
    {ok, Text} = file:read_file(filename:join(Dir, "report.json")),
    {match, [Digest]} = re:run(Text, "\"digest\": \"([0-9a-f]+)\"", [{capture, [1], list}]),
    Digest.

without_rclone_test() ->
    Path = os:getenv("PATH"),
    try
        true = os:putenv("PATH", "/nowhere"),
        {Status, Said} = starl_cli_said:said(?RUN ++ ["/tmp/none", "--upload", "lab:a"]),
        ?assertEqual({2, 1}, {Status, length(string:lexemes(Said, "\n"))}),
        ?assertNotEqual({nomatch, Said}, {string:find(Said, "apt install rclone"), Said})
    after
        true = os:putenv("PATH", Path)
    end.

in_directory(Test) ->
    Dir = filename:join("/tmp", "starl-upload-tests-" ++ os:getpid()),
    ok = filelib:ensure_path(Dir),
    try
        Test(Dir)
    after
        ok = file:del_dir_r(Dir)
    end.
