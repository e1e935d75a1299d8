%% `./starl replay' as its user meets it: a recorded run comes to the same digest again, a run stops
%% exactly where it is told to, and the printed commands work.
-module(starl_lab_replay_tests).
-include_lib("eunit/include/eunit.hrl").

-import(starl_cli_vm, [says/3, contains/2, start/1, rest/2, until/3, printed/2, in_directory/1]).

-define(PATIENCE_S, 60).

%% -- the same again -------------------------------------------------------------------------

%% Drawn faults stand in the record, and what comes back is compared in truth.
replay_test_() ->
    {timeout, ?PATIENCE_S, fun() ->
        in_directory(fun(Dir) ->
            Out = filename:join(Dir, "out"),
            says(0, "result: ", [
                "run",
                "exercise",
                "--work",
                "3",
                "--random-faults",
                "[all]",
                "--heal",
                "3",
                "--seed",
                "4",
                "--robots",
                "5",
                "--out",
                Out
            ]),
            {ok, #{digest := Digest, scenario := Scenario} = Record} = starl_cli_record:read(Out),
            ?assertMatch(#{faults := [_, _, _ | _], random_faults := []}, Scenario),
            says(0, "same digest " ++ Digest, ["replay", Out]),
            Inline = ["--mode", "inline", "--shards", "2"],
            says(0, "same digest " ++ Digest, ["replay", filename:join(Out, "run.term") | Inline]),
            ok = starl_cli_record:write(Out, Record#{digest := "00"}),
            Text = says(3, "NOT THE SAME: digest " ++ Digest ++ ", recorded was 00", ["replay", Out]),
            contains("./starl diverge " ++ filename:join(Out, "run.term"), Text)
        end)
    end}.

%% A result that is not the robot's own may differ with equal events; so it does here, in each VM.
results_test_() ->
    {timeout, ?PATIENCE_S, fun() ->
        in_directory(fun(Dir) ->
            File = filename:join(Dir, "starl_cli_outsider.erl"),
            ok = file:write_file(
                File,
                "-module(starl_cli_outsider).\n-export([init/2, step/2]).\n"
                "init(R, _) -> starl:id(R).\n"
                "step(_R, 1) -> {done, fine};\n"
                "step(_R, 2) -> {done, application:get_env(kernel, outside)}.\n"
            ),
            Out = filename:join(Dir, "out"),
            Warned = says(0, "result: ", ["run", File, "--robots", "2", "--out", Out]),
            contains("starl_cli_outsider.erl:5: application:get_env/2 reads", Warned),
            says(0, "same digest", ["replay", Out]),
            {ok, #{results := [One, {2, Hash}]} = Record} = starl_cli_record:read(Out),
            ok = starl_cli_record:write(Out, Record#{results := [One, {2, Hash + 1}]}),
            Text = says(3, "other results have robot 2\n", ["replay", Out]),
            contains("./starl diverge", Text)
        end)
    end}.

%% The sources of reloads are named relative to the scenario file, wherever the run is started. The run keeps them, with
%% their own headers, so it comes again when they are gone; and a source that was changed is no longer the same code.
%% Holds: A run keeps the sources of its reloads; a record without a digest is read
%% Red: 961f67c9
reloads_test_() ->
    {timeout, ?PATIENCE_S, fun() ->
        in_directory(fun(Dir) ->
            Write = fun(Name, Text) ->
                File = filename:join(Dir, Name),
                ok = filelib:ensure_dir(File),
                ok = file:write_file(File, Text),
                File
            end,
            Source = fun(Version) ->
                [
                    "-module(starl_cli_reloaded).\n-export([init/2, step/2]).\n",
                    "init(_, _) -> 0.\n",
                    "step(R, N) when N < 9 -> ok = starl:sleep(R, 500), ",
                    ["{continue, N + ", Version, "};\n"],
                    "step(_, N) -> {done, N}.\n"
                ]
            end,
            First = Write("starl_cli_reloaded.erl", Source("1")),
            Header = Write("two/include/step.hrl", "-define(STEP, 2).\n"),
            Second = Write("two/src/starl_cli_reloaded.erl", [
                "-include(\"../include/step.hrl\").\n", Source("?STEP")
            ]),
            Scenario = Write("reload.term", [
                "#{app => \"starl_cli_reloaded.erl\", robots => 1, time => 30,\n"
                "  reloads => [{1200, all, \"two/src/starl_cli_reloaded.erl\"}]}.\n"
            ]),
            Out = filename:join(Dir, "out"),
            says(0, "result: ", ["run", Scenario, "--out", Out]),
            [ok = file:delete(File) || File <- [First, Header, Second, Scenario]],
            says(0, "same digest", ["replay", Out]),
            {ok, #{scenario := #{reloads := [{1200, all, Kept}]}}} = starl_cli_record:read(Out),
            ?assertEqual("inputs/reload-1/src/starl_cli_reloaded.erl", Kept),
            %% the sources of the beginning are others
            {ok, [AtFirst]} = starl_cli_inputs:sources_beside(filename:join(Out, "run.term")),
            ?assertEqual("starl_cli_reloaded.erl", filename:basename(AtFirst)),
            ok = starl_cli_made_here:forget(),
            Changed = Write("out/inputs/reload-1/include/step.hrl", "-define(STEP, 3).\n"),
            says(2, "was changed; read it, then say --trust to run it", ["replay", Out]),
            Text = says(3, "NOT THE SAME", ["replay", Out, "--trust"]),
            contains("The recorded run was of other code", Text),
            ok = file:write_file(Changed, "-define(STEP, 2). %% the same, in other words\n"),
            says(0, "same digest", ["replay", Out, "--trust"])
        end)
    end}.

%% What a run in real time has recorded is no record to compare with.
without_a_digest_test_() ->
    {timeout, ?PATIENCE_S, fun() ->
        in_directory(fun(Dir) ->
            Out = filename:join(Dir, "out"),
            says(0, "result: ", ["run", "exercise", "--work", "1", "--robots", "2", "--out", Out]),
            {ok, Record} = starl_cli_record:read(Out),
            ok = starl_cli_record:write(Out, Record#{digest := ""}),
            says(0, "passed in real time: not compared", ["replay", Out]),
            ok = starl_cli_record:write(Out, Record#{digest := "", ending := hung}),
            says(3, "in the recorded run a step did not end", ["replay", Out])
        end)
    end}.

%% An interrupted run comes back as far as it came.
interrupted_test_() ->
    {timeout, ?PATIENCE_S, fun() ->
        in_directory(fun(Dir) ->
            File = filename:join(Dir, "starl_cli_endless.erl"),
            ok = file:write_file(File, starl_cli_tests:endless()),
            Out = filename:join(Dir, "out"),
            Port = start(["run", File, "--time", "1000000", "--out", Out]),
            Begun = until("ready", Port, ""),
            ok = starl_cli_vm:interrupt(Port),
            {130, _} = rest(Port, Begun),
            ?assertMatch({ok, #{ending := stopped}}, starl_cli_record:read(Out)),
            says(0, "same digest", ["replay", Out])
        end)
    end}.

%% What is printed at a violated contract: both commands are taken as a shell would.
printed_commands_test_() ->
    {timeout, ?PATIENCE_S, fun() ->
        in_directory(fun(Dir0) ->
            Dir = filename:join(Dir0, "it's"),
            ok = file:make_dir(Dir),
            File = filename:join(Dir, "starl_cli_breaker.erl"),
            ok = file:write_file(File, starl_cli_tests:breaker()),
            Out = filename:join(Dir, "out"),
            Text = says(3, "sanity broken", [
                "run",
                File,
                "--faults",
                "[{a,1000,9000,kill_machine,{2,sap},#{}}]",
                "--delay",
                "5..50",
                "--out",
                Out
            ]),
            Again = says(3, "sanity broken", printed("replay: ", Text)),
            ?assertEqual(digest(Text), digest(Again)),
            Seen = says(0, "\nrobot 1\n", printed("look: ", Text)),
            contains("sap ready", Seen),
            says(0, "same digest", ["replay", Out])
        end)
    end}.

digest(Text) ->
    {match, [Digest]} = re:run(Text, "digest ([0-9a-f]+)", [{capture, [1], list}]),
    Digest.

%% -- a look inside --------------------------------------------------------------------------

%% Just after the 37th event of robot 2, whatever the others do; shown as it was asked for.
until_event_test_() ->
    {timeout, ?PATIENCE_S, fun() ->
        Args = ["replay", "3", "--app", "exercise", "--work", "5", "--robots", "3"],
        Text = says(
            0, "just after event 37 of robot 2 at ", Args ++ ["--until", "2:37", "--inspect", "2"]
        ),
        {match, [Events]} = re:run(Text, "^ +2 +[0-9.]+ +([0-9]+) ", [
            multiline, {capture, [1], list}
        ]),
        ?assertEqual("37", Events),
        contains("in starl_exercise:step/2, line", Text),
        contains("\nrobot 2\n", Text),
        contains("#sap{", Text),
        nomatch = string:find(Text, "\nrobot 1\n"),
        Wide = [Line || Line <- string:lexemes(Text, "\n"), string:length(Line) > 100],
        ?assertEqual([], Wide)
    end}.

until_time_test_() ->
    {timeout, ?PATIENCE_S, fun() ->
        Args = ["replay", "exercise", "--seed", "3", "--work", "2"],
        says(0, "exercise at 1.500000 s", Args ++ ["--until", "1.5"]),
        contains("#location{", says(0, "exercise at its end (done)", Args ++ ["--inspect", "1"]))
    end}.

setup(Args) ->
    case starl_cli_dispatch:read(starl_lab_replay:command(), Args) of
        {ok, Call} -> starl_lab_replay:setup(Call);
        Other -> Other
    end.

%% SEED --app TARGET is TARGET --seed SEED.
seed_test() ->
    {ok, #{run := #{scenario := One}}} = setup(["7", "--loss", "0.1", "--app", "exercise"]),
    {ok, #{run := #{scenario := Two}}} = setup(["exercise", "--loss", "0.1", "--seed", "7"]),
    ?assertMatch(#{seed := 7, loss := 0.1}, One),
    ?assertEqual(One, Two).

bad_input_test_() ->
    [
        {Part, fun() ->
            {error, Lines} = setup(Args),
            Text = unicode:characters_to_list(lists:join("\n", Lines)),
            ?assertNotEqual({nomatch, Text}, {string:find(Text, Part), Text})
        end}
     || {Part, Args} <- [
            {"name a run first", []},
            {"name a run first", ["--until", "3"]},
            {"no application or scenario", ["nowhere"]},
            {"no run is recorded here", ["/"]},
            {"no such file", ["nowhere/run.term"]},
            {"seed 7 of what", ["7"]},
            {"ROBOT:N expected", ["exercise", "--until", "2:"]},
            {"ROBOT:N expected", ["exercise", "--until", "0:3"]},
            {"ROBOT:N expected", ["exercise", "--until", "-1"]},
            {"--until: there is no robot 9, only 1 to 4", ["exercise", "--until", "9:1"]},
            {"--inspect: there is no robot 5", ["exercise", "--until", "1", "--inspect", "2,5"]},
            {"unknown flag --looss", ["exercise", "--looss", "1"]}
        ]
    ].

beyond_the_end_test_() ->
    {timeout, ?PATIENCE_S, fun() ->
        says(
            2,
            "--until: robot 2 has no more than ",
            ["replay", "exercise", "--work", "1", "--until", "2:100000"]
        )
    end}.

%% A record says what has run; other values are not for it.
a_record_is_run_as_it_was_test() ->
    in_directory(fun(Dir) ->
        Scenario = (starl_cli_flags:defaults(starl_run_scenario:options(starl_exercise)))#{
            app => starl_exercise
        },
        ok = starl_cli_record:write(
            Dir,
            starl_cli_record:make(
                exercise,
                Scenario,
                {done, #{
                    digest => <<1>>, end_us => 1, events => 1, violations => [], robots => []
                }},
                "0123456789ab"
            )
        ),
        ?assertMatch({ok, #{record := #{}, run := #{scenario := Scenario}}}, setup([Dir])),
        ?assertMatch({error, [_]}, setup([Dir, "--loss", "0.3"])),
        {ok, Call} = starl_cli_dispatch:read(starl_lab_run:command(), [Dir]),
        ?assertMatch({ok, #{scenario := Scenario}}, starl_lab_setup:check(Call))
    end).
