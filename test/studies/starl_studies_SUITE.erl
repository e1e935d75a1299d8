%% The page on studies: its Kubernetes manifest is what the published schema says, and means what the
%% page says.
-module(starl_studies_SUITE).
-include_lib("stdlib/include/assert.hrl").
-include_lib("common_test/include/ct.hrl").

-compile([export_all, nowarn_export_all]).

-define(VERSIONS, ["1.28", "1.33"]).

suite() -> [{timetrap, {minutes, 5}}].

all() -> [manifest_has_as_many_slices_as_pods, manifest_is_of_the_published_schema].

%% What no schema can say.
manifest_has_as_many_slices_as_pods(_Config) ->
    Manifest = manifest(),
    {match, [Pods]} = re:run(Manifest, "completions: (\\d+)\n", [{capture, all_but_first, list}]),
    [
        starl_first_hour_ct:contains(Part, Manifest)
     || Part <- [
            "completionMode: Indexed\n",
            "restartPolicy: Never\n",
            "--slice $((JOB_COMPLETION_INDEX + 1))/" ++ Pods ++ " "
        ]
    ].

%% By the Python package kubernetes-validate, strictly: a misspelt field is none.
manifest_is_of_the_published_schema(Config) ->
    case validator() of
        false ->
            {skip, "no kubernetes-validate (pip install kubernetes-validate)"};
        Program ->
            Dir = ?config(priv_dir, Config),
            Valid = fun(Name, Text, Version) ->
                File = filename:join(Dir, Name),
                ok = file:write_file(File, Text),
                starl_first_hour_ct:sh(
                    Program ++ " --strict -k " ++ Version ++ " '" ++ File ++ "'", Dir
                )
            end,
            [?assertMatch({V, {0, _}}, {V, Valid("job.yaml", manifest(), V)}) || V <- ?VERSIONS],
            Misspelt = string:replace(manifest(), "completionMode", "completionMod"),
            ?assertMatch({1, _}, Valid("misspelt.yaml", Misspelt, hd(?VERSIONS)))
    end.

manifest() ->
    {ok, Page} = file:read_file(filename:join([root(), "doc", "studies.md"])),
    {match, [Text]} = re:run(Page, "```yaml\n(.*?)```", [
        dotall, {capture, all_but_first, list}
    ]),
    Text.

%% In PATH, or in the checkout's own environment of Python.
validator() ->
    Own = filename:join([root(), "_build", "python", "bin"]),
    os:find_executable("kubernetes-validate", os:getenv("PATH") ++ ":" ++ Own).

root() -> starl_first_hour_ct:root().
