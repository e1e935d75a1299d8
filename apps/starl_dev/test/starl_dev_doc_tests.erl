%% What EDoc is given of a module, and that what is wrong with a page is told.
-module(starl_dev_doc_tests).
-include_lib("eunit/include/eunit.hrl").

turned(Text) -> starl_dev_doc_pages:for_edoc(string:split(Text, "\n", all)).

%% A comment goes behind the type that it stands before, over all its lines; others stay.
a_comment_goes_behind_its_type_test() ->
    ?assertEqual(
        ["-type a() :: b.", "%% A.", "", "%% F.", "f() -> 1.", ""],
        turned("%% A.\n-type a() :: b.\n\n%% F.\nf() -> 1.\n")
    ),
    ?assertEqual(
        ["-opaque a() :: #{", "    %% b.", "    b := \". %\"", "}.", "%% A.", "%% Two.", ""],
        turned("%% A.\n%% Two.\n-opaque a() :: #{\n    %% b.\n    b := \". %\"\n}.\n")
    ),
    ?assertEqual(
        ["-type a() :: b.", "%% A.", "-type c() :: d.", "%% C."],
        turned("%% A.\n-type a() :: b.\n%% C.\n-type c() :: d.")
    ),
    ?assertEqual(
        ["-callback a() -> b.", "%% A."],
        turned("%% A.\n-callback a() -> b.")
    ),
    Alone = "%% Nobody's.\n\n-type a() :: b.\n-export_type([a/0]).",
    ?assertEqual(string:split(Alone, "\n", all), turned(Alone)),
    ?assertEqual(["-type a() ::", "%% A."], turned("%% A.\n-type a() ::")).

pages_without_a_problem_are_made_test_() ->
    {setup, fun directory/0, fun(Dir) -> ok = file:del_dir_r(Dir) end, fun(Dir) ->
        Make = fun(Text) -> made(Text, Dir) end,
        [
            ?_assertEqual({ok, 1}, Make("%% @doc M.\n-module(m).\n-behaviour(gen_server).\n")),
            ?_assertMatch({error, [_ | _]}, Make("%% @doc M, 0 < 1.\n-module(m).\n")),
            ?_assertMatch({error, [_ | _]}, Make("%% @doc M {@link\n-module(m).\n")),
            ?_assertEqual(
                {error, ["m: a link leads nowhere: #f-1"]},
                Make("%% @doc M {@link f/1}.\n-module(m).\n")
            )
        ]
    end}.

%% One folder of chunks for each build.
each_build_has_its_chunks_test() ->
    Dir = directory(),
    File = filename:join(Dir, "m.erl"),
    Builds = [filename:join(Dir, Build) || Build <- ["default", "dev"]],
    ok = file:write_file(
        File, "%% @doc Of M.\n-module(m).\n-export_type([t/0]).\n\n%% Of T.\n-type t() :: a.\n"
    ),
    ?assertEqual(1, starl_dev_doc:make_chunks([File], Builds)),
    [One, Same] = [file:read_file(filename:join(Build, "doc/chunks/m.chunk")) || Build <- Builds],
    ?assertEqual(One, Same),
    {ok, Chunk} = One,
    {docs_v1, _, erlang, _, #{<<"en">> := OfM}, _, Entries} = binary_to_term(Chunk),
    ?assertMatch([_ | _], OfM),
    ?assertMatch([{{type, t, 0}, _, _, #{<<"en">> := [_ | _]}, _}], Entries),
    ok = file:del_dir_r(Dir).

directory() ->
    Dir = filename:join("_build", "doc_test_" ++ os:getpid()),
    ok = filelib:ensure_dir(filename:join(Dir, "any")),
    Dir.

made(Text, Dir) ->
    File = filename:join(Dir, "m.erl"),
    Overview = filename:join(Dir, "overview.edoc"),
    ok = file:write_file(File, Text),
    ok = file:write_file(Overview, "@title T\n"),
    case starl_dev_doc_pages:make([File], Overview, filename:join(Dir, "pages")) of
        {error, Problems} -> {error, [lists:flatten(Problem) || Problem <- Problems]};
        Ok -> Ok
    end.
