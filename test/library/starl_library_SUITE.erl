%% Other projects use StarL: as `./starl new' makes them, from a repository with the sources that are
%% tested here.
-module(starl_library_SUITE).
-include_lib("stdlib/include/assert.hrl").
-include_lib("common_test/include/ct.hrl").

-compile([export_all, nowarn_export_all]).

suite() -> [{timetrap, {minutes, 15}}].

all() ->
    [
        an_erlang_project_passes_its_tests,
        the_number_of_cases_is_a_flag,
        a_commit_of_its_own_is_found,
        as_a_dependency_it_only_computes,
        its_names_are_known_in_its_directory,
        its_shell_tells_of_modules,
        a_failing_property_leaves_a_scenario,
        a_block_passes_its_tests,
        a_chassis_passes_its_tests,
        an_application_of_your_own,
        an_elixir_project_passes_its_tests,
        one_kind_at_a_time,
        a_mistaken_team_is_one_line,
        python_reads_results
    ].

%% The repository that the projects depend on, and the project of the first cases.
init_per_suite(Config) ->
    Repository = filename:join(?config(priv_dir, Config), "repository"),
    [{repository, starl_first_hour_ct:repository(Repository)} | Config].

end_per_suite(Config) -> Config.

an_erlang_project_passes_its_tests(Config) ->
    Dir = project("patrol", app, Config),
    {Status, Text} = rebar("eunit", Dir),
    ?assertEqual(
        {0, match}, {Status, re:run(Text, "3 tests, 0 failures", [{capture, none}])}, Text
    ).

%% In the project's directory, its tests are meant.
%% Holds: `./starl test --cases N` in a project's directory runs its tests, with that number of
%% cases
%% Red: a project in the checkout taken for the checkout: its own tests began
the_number_of_cases_is_a_flag(Config) ->
    Dir = at("patrol", Config),
    Test = filename:join([Dir, "test", "counted_tests.erl"]),
    ok = file:write_file(
        Test,
        "-module(counted_tests).\n"
        "-export([three_test/0]).\n"
        "three_test() ->\n"
        "    Count = counters:new(1, []),\n"
        "    Each = fun(_) -> counters:add(Count, 1, 1) =:= ok end,\n"
        "    true = starl_property:quickcheck(proper:forall(proper_types:integer(), Each)),\n"
        "    3 = counters:get(Count, 1).\n"
    ),
    {Status, Text} = sh("$starl test --cases 3 counted_tests", Dir),
    ok = file:delete(Test),
    ?assertEqual(
        {0, match}, {Status, re:run(Text, "1 tests?, 0 failures", [{capture, none}])}, Text
    ),
    ?assertMatch({2, "starl: test: '--quick' is no flag" ++ _}, sh("$starl test --quick", Dir)).

%% A clone with a commit that its origin has not is itself what the project depends on.
a_commit_of_its_own_is_found(Config) ->
    Clone = at("clone", Config),
    Git = "git -c user.name=test -c user.email=test@localhost -C '" ++ Clone ++ "' ",
    Repository = ?config(repository, Config),
    Cloned = lists:append(["git clone -q '", Repository, "' '", Clone, "'"]),
    {0, _} = sh(Cloned, ?config(priv_dir, Config)),
    ?assertEqual(["file://", Repository], origin("theirs", Clone, Config)),
    {0, _} = sh(Git ++ "commit -q --allow-empty -m own", Clone),
    ?assertEqual(["file://", Clone], origin("ours", Clone, Config)).

%% What rebar3 and mix run in the VM that builds a project: nothing is printed and nothing changed there, and
%% a warning of a newer compiler does not stop the project's build.
%% Holds: As a dependency StarL's build prints nothing, changes nothing in the VM that builds, and
%% stops at no warning
%% Red: the script of the checkout in its place, run: the code path and ERL_LIBS change
as_a_dependency_it_only_computes(Config) ->
    Script = filename:join(at("clone", Config), "rebar.config.script"),
    {ok, Terms} = file:consult(filename:rootname(Script)),
    State = fun() -> {code:get_path(), lists:sort(os:env()), file:get_cwd()} end,
    Before = State(),
    ok = ct:capture_start(),
    {ok, Computed} = file:script(Script, [{'SCRIPT', Script}, {'CONFIG', Terms}]),
    ok = ct:capture_stop(),
    ?assertEqual([], ct:capture_get()),
    ?assertEqual(Before, State()),
    ?assertEqual([debug_info], proplists:get_value(erl_opts, Computed)),
    ?assertEqual([deps, erl_opts, minimum_otp_vsn], lists:sort(proplists:get_keys(Computed))).

%% Where a project that is made by this clone finds StarL.
origin(Name, Clone, Config) ->
    {ok, Cwd} = file:get_cwd(),
    ok = file:set_cwd(?config(priv_dir, Config)),
    {ok, _} = starl_dev_new:make(Name, app, Clone),
    ok = file:set_cwd(Cwd),
    {ok, Terms} = file:consult(filename:join(at(Name, Config), "rebar.config")),
    [{starl, {git, Url, _}}] = proplists:get_value(deps, Terms),
    {Scheme, Path} = lists:split(length("file://"), Url),
    [Scheme, Path].

its_names_are_known_in_its_directory(Config) ->
    Dir = at("patrol", Config),
    [
        ?assertMatch({Args, {0, _}}, {Args, sh("$starl" ++ Args, Dir)})
     || Args <- [" run patrol --robots 2", " run patrol.term", " run .", " sweep patrol --seeds 2"]
    ].

%% Of StarL's and of its own.
its_shell_tells_of_modules(Config) ->
    Dir = at("patrol", Config),
    ?assertMatch({0, _}, sh("$starl doc", Dir)),
    {0, Told} = sh(
        "erl -noinput -pa _build/default/lib/*/ebin _build/default/lib/*/apps/*/ebin"
        " -eval 'c:h(starl), c:h(starl_mutex, acquire), c:ht(starl, pose), c:h(patrol), halt(0).'",
        Dir
    ),
    [
        ?assertNotEqual(nomatch, string:find(Told, Part), Told)
     || Part <- [
            "The API that an application sees",
            "Acquires a token or a list of tokens",
            "radians counter-clockwise",
            "-spec acquire("
        ]
    ].

%% A send that must succeed: no monitor of its own is needed to find it, and at most three faults.
a_failing_property_leaves_a_scenario(Config) ->
    Dir = at("patrol", Config),
    Source = filename:join([Dir, "src", "patrol.erl"]),
    {ok, Sound} = file:read_file(Source),
    Broken = re:replace(
        Sound,
        "case starl:send.*?    end;",
        "ok = starl:send(Robot, next(Robot), round, #{}),\n    {continue, hear};",
        [dotall]
    ),
    ok = file:write_file(Source, re:replace(Broken, "\\[{patrol_monitor, #{}}\\]", "[]")),
    {1, Text} = sh("STARL_SEED=4 rebar3 eunit --module=patrol_tests", Dir),
    ok = file:write_file(Source, Sound),
    ?assertMatch({match, _}, re:run(Text, "seed 4;")),
    {match, Left} = re:run(Text, "replay: starl run (\\S+)  \\(digest ([0-9a-f]+)\\)", [
        global, {capture, all_but_first, list}
    ]),
    %% What PropEr and the shrinker have left in the end.
    [File, Digest] = lists:last(Left),
    {ok, [Scenario]} = file:consult(filename:join(Dir, File)),
    ?assert(length(maps:get(faults, Scenario, [])) =< 3, Scenario),
    ok = file:write_file(Source, Broken),
    {_, Run} = sh("$starl run " ++ File, Dir),
    ok = file:write_file(Source, Sound),
    ?assertMatch({match, _}, re:run(Run, "digest " ++ Digest)).

a_block_passes_its_tests(Config) ->
    Dir = project("relay", block, Config),
    %% what is built already
    {0, _} = sh(
        "mkdir _build && cp -R ../patrol/_build/default _build", Dir
    ),
    {Status, Text} = rebar("eunit", Dir),
    ?assertEqual(
        {0, match}, {Status, re:run(Text, "2 tests, 0 failures", [{capture, none}])}, Text
    ),
    [
        ?assertMatch({Args, {0, _}}, {Args, sh("$starl" ++ Args, Dir)})
     || Args <- [" run relay_app", " soak src/relay.erl --seeds 2", " check src/relay.erl"]
    ].

%% Its contract is tested by a chassis that drives, also by the command line; one that turns as it
%% drives ahead does not pass.
%% Holds: What `starl new --chassis` makes keeps the contract of a chassis, and its test notices a
%% chassis that does not
%% Red: without `starl_live` among its dependencies; a chassis that is told another speed (in the
%% test); kinds that are not compared
a_chassis_passes_its_tests(Config) ->
    Dir = project("rover", chassis, Config),
    %% what is built already
    {0, _} = sh("mkdir _build && cp -R ../patrol/_build/default _build", Dir),
    {Status, Text} = rebar("eunit", Dir),
    ?assertEqual(
        {0, match}, {Status, re:run(Text, "2 tests, 0 failures", [{capture, none}])}, Text
    ),
    [
        ?assertMatch({Args, {0, _}}, {Args, sh("$starl" ++ Args, Dir)})
     || Args <- [
            " chassis check src/rover.erl", " run rover.term", " run rover.term --robots 1 --live"
        ]
    ],
    {0, _} = sh("sed -i 's/\\[Left, Right, Us/[2 * Left, Right, Us/' src/rover.erl", Dir),
    {Failed, Told} = rebar("eunit", Dir),
    ?assertEqual(
        {1, match}, {Failed, re:run(Told, "leg_way,", [{capture, none}])}, Told
    ).

%% The page of the tutorial that makes a project.
an_application_of_your_own(Config) ->
    Made = [
        "sed -i 's|git, \".*|git, \"file://",
        ?config(repository, Config),
        "\", {branch, \"main\"}}}]}.|' charge/rebar.config\n",
        %% what is built already
        "mkdir charge/_build && cp -R '",
        at("patrol/_build/default", Config),
        "' charge/_build"
    ],
    Options = #{env => [{"ERL_LIBS", false}], also => #{"starl new" => lists:append(Made)}},
    ?assertEqual(
        10,
        starl_tutorial_page:follow(
            "doc/tutorial/application.md", at("application", Config), Options
        )
    ).

one_kind_at_a_time(Config) ->
    {2, Text} = sh("$starl new both --block --chassis", ?config(priv_dir, Config)),
    ?assertNotEqual(
        nomatch, string:find(Text, "new: --block --chassis: a project begins with one of them")
    ).

an_elixir_project_passes_its_tests(Config) ->
    case os:find_executable("mix") of
        false ->
            {skip, "no Elixir"};
        _ ->
            Dir = project("ronde", elixir, Config),
            {0, _} = sh("mix deps.get >deps.log 2>&1", Dir),
            {Status, Text} = sh("mix test 2>&1", Dir),
            ?assertEqual(
                {0, match}, {Status, re:run(Text, "2 tests, 0 failures", [{capture, none}])}, Text
            ),
            %% A new project begins without a warning of the compiler.
            ?assertEqual(nomatch, re:run(Text, "warning", [{capture, none}]), Text)
    end.

a_mistaken_team_is_one_line(_Config) ->
    Wrong = fun(Team) ->
        try starl_property:scenario(Team#{app => starl_exercise}) of
            _ -> none
        catch
            error:{starl_property, Line} -> Line
        end
    end,
    Lines = [
        Wrong(Team)
     || Team <- [
            #{robots => 0},
            #{robots => {5, 2}},
            #{lose => 0.5},
            #{loss => 7},
            #{random_faults => [netwrok]},
            #{vary => [lots]},
            #{vary => [faults]},
            #{app => no_such_app_at_all, robots => 2}
        ]
    ],
    [
        ?assertMatch({L, match}, {L, re:run(L, "^[^\n]{10,200}$", [{capture, none}])})
     || L <- lists:droplast(Lines)
    ].

%% The package in python/, on results of its own making and on ours.
python_reads_results(Config) ->
    case os:find_executable("python3") of
        false ->
            {skip, "no Python"};
        _ ->
            Dir = at("results", Config),
            {0, _} = sh("$starl run painting --robots 2 --record --out run --quiet", Dir),
            {0, _} = sh("$starl sweep painting --robots 1,2 --seeds 1 --out sweep", Dir),
            Python = filename:join(starl_first_hour_ct:root(), "python"),
            {Status, Text} = starl_first_hour_ct:sh(
                "python3 -B -m unittest discover -s '" ++ Python ++ "/tests'",
                Dir,
                [{"STARL_RESULTS", Dir}, {"PYTHONPATH", filename:join(Python, "src")}]
            ),
            ?assertEqual(
                {0, match},
                {Status, re:run(Text, "Ran 10 tests.*OK$", [dotall, {capture, none}])},
                Text
            )
    end.

%% -- projects -------------------------------------------------------------------------------

project(Name, Kind, Config) ->
    {ok, Cwd} = file:get_cwd(),
    ok = file:set_cwd(?config(priv_dir, Config)),
    Made = starl_dev_new:make(Name, Kind, ?config(repository, Config)),
    ok = file:set_cwd(Cwd),
    {ok, [_ | _]} = Made,
    Dir = at(Name, Config),
    %% The repository here has no libraries of its own beside it.
    Proper = code:lib_dir(proper),
    Kind =:= elixir orelse
        sh("mkdir -p _checkouts && cp -RL '" ++ Proper ++ "' _checkouts/proper", Dir),
    Dir.

at(Name, Config) -> filename:join(?config(priv_dir, Config), Name).

rebar(Args, Dir) -> sh("rebar3 " ++ Args, Dir).

%% Without what this VM's environment says of libraries: the project has its own.
sh(Command, Dir) ->
    starl_first_hour_ct:sh(Command, Dir, [{"ERL_LIBS", false}, {"REBAR_COLOR", "none"}]).
