%% From the command line to a checked set-up: overrides, replay, and bad input in one go.
-module(starl_lab_run_tests).
-include_lib("eunit/include/eunit.hrl").

setup(Args) ->
    case starl_cli_dispatch:read(starl_lab_run:command(), Args) of
        {ok, Call} -> starl_lab_setup:check(Call);
        Other -> Other
    end.

scenario(Args) ->
    {ok, #{scenario := Scenario}} = setup(Args),
    Scenario.

lines(Args) ->
    {error, Lines} = setup(Args),
    [unicode:characters_to_list(Line) || Line <- Lines].

complains(Part, Args) ->
    Lines = lines(Args),
    ?assertMatch([_], Lines),
    ?assertNotEqual({nomatch, Lines}, {string:find(hd(Lines), Part), Lines}).

in_directory(Test) ->
    Dir = filename:join("/tmp", "starl-cli-tests-" ++ os:getpid()),
    _ = file:del_dir_r(Dir),
    ok = file:make_dir(Dir),
    try
        Test(fun(Name) -> filename:join(Dir, Name) end)
    after
        _ = file:change_mode(filename:join(Dir, "closed"), 8#755),
        ok = file:del_dir_r(Dir)
    end.

defaults_test() ->
    ?assertMatch(
        #{app := starl_painting, robots := 4, seed := 1, picture := "house"}, scenario(["painting"])
    ).

flags_override_a_scenario_file_test() ->
    in_directory(fun(Path) ->
        File = Path("a.term"),
        ok = file:write_file(File, "#{app => painting, robots => 3, seed => 9, loss => 0.1}."),
        ?assertMatch(#{robots := 3, seed := 9, loss := 0.1}, scenario([File])),
        ?assertMatch(#{robots := 3, seed := 5, loss := 0.1}, scenario([File, "--seed", "5"]))
    end).

the_target_may_stand_behind_flags_test() ->
    Scenario = scenario(["--seed", "5", "ring_shuttle"]),
    ?assertMatch(#{app := starl_ring_shuttle, seed := 5}, Scenario).

help_wins_test() ->
    ?assertEqual({help, none, none}, setup(["--help"])),
    ?assertMatch(
        {help, "painting", #{app := starl_painting}}, setup(["painting", "--robotz", "-h"])
    ),
    ?assertMatch({help, "painting", #{app := starl_painting}}, setup(["painting", "--help"])).

a_replay_is_the_same_scenario_test() ->
    {ok, #{scenario := Scenario, target := Target}} = setup([
        "painting",
        "--robots",
        "8",
        "--loss",
        "0.25",
        "--delay",
        "5..50",
        "--seed",
        "77",
        "--faults",
        "[{a,1,2,kill_robot,3,#{}}]"
    ]),
    Line = lists:flatten(starl_cli_target:replay(Target, Scenario)),
    Shell = os:cmd("for a in " ++ Line ++ "; do echo \"$a\"; done"),
    ["./starl", "run" | Args] = string:lexemes(Shell, "\n"),
    ?assertEqual(Scenario, scenario(Args)).

the_seed_is_always_replayed_test() ->
    {ok, #{scenario := Scenario, target := Target}} = setup(["painting"]),
    Line = lists:flatten(starl_cli_target:replay(Target, Scenario)),
    ?assertNotEqual(nomatch, string:find(Line, "--seed 1")).

bad_input_test_() ->
    [
        {Part, fun() -> complains(Part, Args) end}
     || {Part, Args} <- [
            {"name a target first, as in ./starl run painting", []},
            {"name a target first", ["--robots", "3"]},
            {"did you mean painting?", ["paintig"]},
            {"no application or scenario", ["xyz"]},
            {"--robots: a whole number", ["painting", "--robots", "0"]},
            {"--robots: a whole number", ["painting", "--robots", "x"]},
            {"--loss: a number from 0 to 1", ["painting", "--loss", "2"]},
            {"did you mean --robots?", ["painting", "--robot", "3"]},
            {"unexpected argument \"x\"", ["painting", "x"]},
            {"no such file", ["nowhere.term"]},
            {"no such file", ["nowhere.erl"]}
        ]
    ].

%% A mistake in a list of faults: its flag, the fault and the way out.
bad_faults_test_() ->
    [
        {Text, fun() ->
            ?assertEqual([Line], lines(["exercise", Flag, Text]))
        end}
     || {Flag, Text, Line} <- [
            {"--faults", "[{a,0,1",
                "--faults: a list of {Id, FromMs, ToMs, Kind, Target, Params} expected, "
                "not \"[{a,0,1\" (it ends too early)"},
            {"--faults", "[a b]",
                "--faults: a list of {Id, FromMs, ToMs, Kind, Target, Params} expected, "
                "not \"[a b]\" (character 4: syntax error before: b)"},
            {"--faults", "all",
                "--faults: a list of {Id, FromMs, ToMs, Kind, Target, Params} expected, not \"all\""},
            {"--faults", "[foo]",
                "--faults: fault 1 of the list: {Id, FromMs, ToMs, Kind, Target, #{}} expected, "
                "not foo"},
            {"--faults", "[{a,0,1,lss,all,#{}}]",
                "--faults: fault a: there is no kind lss (did you mean loss?)"},
            {"--faults", "[{a,0,1,xyzzyx,all,#{}}]",
                "--faults: fault a: there is no kind xyzzyx; ./starl faults lists the kinds"},
            {"--faults", "[{a,0,1,loss,all,#{part=>7}}]",
                "--faults: fault a, loss: part: a number from 0 to 1 expected, not 7"},
            {"--faults", "[{a,0,1,isolate,1,#{part=>1}}]",
                "--faults: fault a, isolate: unknown key part"},
            {"--faults", "[{a,0,1,loss,all,#{}}]",
                "--faults: fault a: loss needs the parameter part"},
            {"--faults", "[{a,0,1,partition,[1|2],#{}}]",
                "--faults: fault a: partition is for a list of robots, not [1|2]"},
            {"--faults", "[{a,2,1,isolate,1,#{}}]",
                "--faults: fault a: FromMs and ToMs are whole numbers from 0 on, in this order"},
            {"--random-faults", "[netwrk]",
                "--random-faults: there is no class or kind of faults netwrk (did you mean network?)"},
            {"--random-faults", "[all|1]",
                "--random-faults: there is no class or kind of faults 1; classes: all, network, "
                "clock, process, location, actuation, serial, store, sense, floor"},
            {"--random-faults", "all",
                "--random-faults: a list of classes and kinds of faults, as in "
                "[network, kill_machine], or [all] expected, not \"all\""}
        ]
    ].

bad_scenario_files_test_() ->
    [
        {Part, fun() ->
            in_directory(fun(Path) ->
                File = Path("s.term"),
                ok = file:write_file(File, Text),
                complains(Part, [File])
            end)
        end}
     || {Part, Text} <- [
            {"unknown key robotz", "#{app => painting, robotz => 3}."},
            {"loss: a number", "#{app => painting, loss => 2}."},
            {"app is missing", "#{robots => 3}."},
            {"no application", "#{app => lists}."},
            {"app is the name", "#{app => 7}."},
            {"s.term: faults: fault a: there is no kind los (",
                "#{app => exercise, faults => [{a,0,1,los,all,#{}}]}."},
            {"s.term: random_faults: there is no class",
                "#{app => exercise, random_faults => [netwrk]}."},
            {"s.term: faults: a list of", "#{app => exercise, faults => all}."},
            {"one map", "[1]."},
            {"s.term:1: ", "#{app => painting"}
        ]
    ].

two_problems_of_a_file_and_one_of_a_flag_test() ->
    in_directory(fun(Path) ->
        File = Path("s.term"),
        ok = file:write_file(File, "#{app => painting, robotz => 3, loss => 2}."),
        ?assertEqual(3, length(lines([File, "--seed", "x"])))
    end).

out_directory_test() ->
    in_directory(fun(Path) ->
        ok = file:write_file(Path("file"), ""),
        ok = file:make_dir(Path("closed")),
        ok = file:change_mode(Path("closed"), 8#555),
        complains("not a directory", ["painting", "--out", Path("file")]),
        complains("not a directory", ["painting", "--out", Path("file/below")]),
        complains("read-only", ["painting", "--out", Path("closed")]),
        complains("read-only", ["painting", "--out", Path("closed/new/deep")]),
        ?assertMatch({ok, _}, setup(["painting", "--out", Path("new/deep")])),
        {ok, Left} = file:list_dir(Path("")),
        ?assertEqual(["closed", "file"], lists:sort(Left))
    end).

%% All the files or none, and never over those of an earlier run.
results_are_whole_test() ->
    in_directory(fun(Path) ->
        Write = fun(Text) -> fun(Dir) -> file:write_file(filename:join(Dir, "a"), Text) end end,
        {ok, Plan} = starl_cli_out:plan(Path("x"), "painting"),
        ?assertEqual({error, "full"}, starl_cli_out:write(Plan, fun(_) -> {error, "full"} end)),
        ?assertEqual({ok, []}, file:list_dir(Path(""))),
        ?assertEqual({ok, Path("x")}, starl_cli_out:write(Plan, Write("1"))),
        {ok, Again} = starl_cli_out:plan(Path("x"), "painting"),
        ok = file:write_file(Path("x/mine"), ""),
        ?assertEqual({ok, Path("x")}, starl_cli_out:write(Again, Write("2"))),
        {ok, Names} = file:list_dir(Path("x")),
        ?assertEqual(["a", "mine"], lists:sort(Names)),
        ?assertEqual({ok, <<"2">>}, file:read_file(Path("x/a")))
    end).

%% Paths in a scenario file are relative to it; a name remains one.
paths_are_relative_to_the_scenario_file_test() ->
    in_directory(fun(Path) ->
        File = Path("a.term"),
        ok = file:write_file(File, "#{app => painting, picture => \"my.svg\"}."),
        ?assertMatch({File, #{picture := _}}, {File, scenario([File])}),
        ?assertEqual(Path("my.svg"), maps:get(picture, scenario([File]))),
        ok = file:write_file(File, "#{app => painting, picture => \"house\"}."),
        ?assertEqual("house", maps:get(picture, scenario([File]))),
        ok = file:write_file(Path("house"), ""),
        ?assertEqual(Path("house"), maps:get(picture, scenario([File]))),
        ok = file:write_file(File, "#{app => painting, picture => \"/my.svg\"}."),
        ?assertEqual("/my.svg", maps:get(picture, scenario([File])))
    end).

own_application_test() ->
    in_directory(fun(Path) ->
        File = Path("starl_cli_test_app.erl"),
        ok = file:write_file(
            File,
            "-module(starl_cli_test_app).\n-export([init/2, step/2]).\n"
            "init(_, _) -> 0.\nstep(_, N) -> {done, N}.\n"
        ),
        ?assertMatch(#{app := starl_cli_test_app}, scenario([File])),
        ok = file:write_file(File, "-module(starl_cli_test_app2).\nstep(_, N) -> {done, M}.\n"),
        complains(":2: variable 'M' is unbound", [File]),
        ok = file:write_file(File, "-module(lists).\n-export([step/2]).\nstep(_, N) -> N.\n"),
        complains("a module lists already", [File]),
        ok = file:write_file(File, "-module(starl_cli_test_app3).\n-export([f/0]).\nf() -> 1.\n"),
        complains("neither step/2 nor scene/1", [File])
    end).
