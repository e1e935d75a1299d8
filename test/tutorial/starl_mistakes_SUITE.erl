%% Mistakes of a beginner, in a project as `./starl new' makes it: each ends in one line that says
%% what, where, and what to do.
%%
%% Holds: A beginner's mistakes, a misspelt callback, a version that does not fit, an application
%% that is not in the path and a dozen more, are one line each, with what to do
%% Red: applications whose versions are not compared: the run starts; the former words for what is
%% not in the path
-module(starl_mistakes_SUITE).
-include_lib("stdlib/include/assert.hrl").

-export([suite/0, all/0, init_per_suite/1, end_per_suite/1]).
-export([each_mistake_is_one_line/1, in_a_shell_too/1, properties_too/1]).

suite() -> [{timetrap, {minutes, 10}}].

all() -> [each_mistake_is_one_line, in_a_shell_too, properties_too].

init_per_suite(Config) ->
    Dir = proplists:get_value(priv_dir, Config),
    {0, _} = starl_first_hour_ct:sh("$starl new patrol", Dir),
    [{dir, filename:join(Dir, "patrol")} | Config].

end_per_suite(_Config) -> ok.

%% What is done, the command, its exit status, and the line. A change is of a file, from, to.
mistakes() ->
    App = "src/patrol.erl",
    Monitor = "src/patrol_monitor.erl",
    [
        {"a callback is misspelt", [{App, "step/2]", "stepp/2]"}, {App, "\nstep(", "\nstepp("}],
            "run patrol", 2,
            "patrol.erl:4: step/2 is missing; an application exports init/2 and step/2"},
        {"init/2 is not exported", [{App, "init/2, ", ""}], "run patrol", 2,
            "patrol.erl:13: init/2 is not exported; write -export([init/2, step/2])"},
        {"a block is misspelt",
            [
                {App, "options/0,", "blocks/0, options/0,"},
                {App, "\nmonitors(", "\nblocks() -> [starl_mutx].\n\nmonitors("}
            ],
            "run patrol", 2,
            "patrol.erl:11: blocks/0: starl_mutx is no building block: there is no such module"
            " (did you mean starl_mutex?)"},
        {"a block is not listed",
            [{App, "starl:trace(Robot, told)", "starl_mutex:acquire(Robot, door)"}],
            "run patrol --time 30", 4,
            "patrol:step/2: this robot has no machine mutex; list its block: blocks() ->"
            " [starl_mutex]"},
        {"step/2 returns something else", [{App, "{continue, hear}", "{contine, hear}"}],
            "run patrol --time 30", 4,
            "step/2 returned {contine,hear}; it returns {continue, State} or {done, Result}"},
        {"a function that does not exist", [{App, "starl:go_to(", "starl:goto("}],
            "run patrol --time 30", 4, "there is no function starl:goto/2"},
        {"a monitor without step/2", [{Monitor, "step/2, ", ""}, {Monitor, "\nstep(", "\nstp("}],
            "run patrol", 2,
            "patrol_monitor.erl:3: step/2 is missing; a monitor exports init/1, step/2 and"
            " finish/2"},
        {"a module that is no application", [], "run src/patrol_monitor.erl", 2,
            "patrol_monitor.erl:3: init/2 is missing; an application exports init/2 and step/2"},
        {"a name that nothing has", [], "run petrol", 2,
            "there is no application or scenario petrol"},
        {"a flag that is misspelt", [], "run patrol --sdie 300", 2,
            "unknown flag --sdie (did you mean --side?)"},
        {"a value out of its range", [], "run patrol --side 30000", 2,
            "--side: a whole number from 100 to 1500 expected, not \"30000\""},
        {"a key of a scenario that is misspelt", [{"patrol.term", "robots", "robts"}],
            "run patrol.term", 2, "robts"}
    ].

each_mistake_is_one_line(Config) ->
    Dir = proplists:get_value(dir, Config),
    [made(Mistake, Dir) || Mistake <- mistakes()].

%% The files are as before, afterwards. The warnings of the compiler come before the line.
made({What, Changes, Command, Status, Line}, Dir) ->
    Before = [
        {File, element(2, {ok, _} = file:read_file(File))}
     || {Name, _, _} <- Changes, File <- [filename:join(Dir, Name)]
    ],
    [change(filename:join(Dir, Name), From, To) || {Name, From, To} <- Changes],
    {Ended, Text} = starl_first_hour_ct:sh("$starl " ++ Command, Dir),
    [ok = file:write_file(File, Sound) || {File, Sound} <- lists:reverse(Before)],
    Lines = [L || L <- string:lexemes(Text, "\n"), lists:prefix("starl: ", L)],
    ?assertMatch({What, Status, [_]}, {What, Ended, Lines}, Text),
    ?assertNotEqual({What, nomatch}, {What, string:find(Lines, Line)}, Text).

change(File, From, To) ->
    {ok, Text} = file:read_file(File),
    ?assertNotEqual({File, From, nomatch}, {File, From, string:find(Text, From)}),
    ok = file:write_file(File, string:replace(Text, From, To, all)).

%% What is in the path, the scenario that is started, and the line.
in_a_shell() ->
    All = [starl_platform, starl_blocks, starl_run, starl_sim],
    [
        {"a version that does not fit", [old, own | All], "#{app => mine}",
            "applications of StarL of unlike versions: starl_platform is 0.1.0, starl_run is 0.1.0,"
            " starl_sim is 0.1.0, starl_blocks is 0.0.9; a project takes all of them from one commit"},
        {"an application that is not in the path", All, "#{app => mine}",
            "there is no application mine; is it compiled, and in the path?"},
        {"an application of StarL that is not in the path", All, "#{app => painting}",
            "there is no application painting; is it compiled, and in the path?"},
        {"a block whose application is not in the path", [own | All -- [starl_blocks]],
            "#{app => mine}",
            "mine.erl:3: blocks/0: starl_mutex is no building block: there is no such module; is it compiled,"
            " and in the path?"},
        {"no mistake", [own | All], "#{app => mine, robots => 1}", "none"}
    ].

in_a_shell_too(Config) ->
    Dir = filename:join(proplists:get_value(priv_dir, Config), "shell"),
    starl_first_hour_ct:write(
        filename:join([Dir, "own", "mine.erl"]),
        "-module(mine).\n-export([blocks/0, init/2, step/2]).\n"
        "blocks() -> [starl_mutex].\ninit(_, _) -> 0.\nstep(_, N) -> {done, N}.\n"
    ),
    {ok, mine} = compile:file(filename:join([Dir, "own", "mine"]), [{outdir, ebin(own, Dir)}]),
    {ok, [{application, starl_blocks, Keys}]} = file:consult(
        filename:join(ebin(starl_blocks, Dir), "starl_blocks.app")
    ),
    Old = {application, starl_blocks, lists:keystore(vsn, 1, Keys, {vsn, "0.0.9"})},
    starl_first_hour_ct:write(
        filename:join([Dir, "old", "starl_blocks.app"]), io_lib:format("~tp.~n", [Old])
    ),
    [started(Mistake, Dir) || Mistake <- in_a_shell()].

started({What, Apps, Scenario, Line}, Dir) ->
    {0, Text} = starl_first_hour_ct:sh(
        lists:flatten([
            "erl -noinput",
            [[" -pa '", ebin(App, Dir), "'"] || App <- lists:reverse(Apps)],
            " -eval 'io:put_chars(case starl_sim:start(",
            Scenario,
            ") of {error, Why} -> starl_sim:format_error(Why); {ok, _} -> \"none\" end), halt().'"
        ]),
        Dir
    ),
    ?assertEqual({What, Line}, {What, Text}).

ebin(old, Dir) -> filename:join(Dir, "old");
ebin(own, Dir) -> filename:join(Dir, "own");
ebin(App, _Dir) -> filename:join(code:lib_dir(App), "ebin").

%% What would pass, or end in a page of PropEr's terms.
properties_too(_Config) ->
    Generator = starl_property:scenario(#{app => starl_exercise, robots => 2}),
    Scenario = #{app => starl_exercise, robots => 2, seed => 1},
    [
        ?assertError({starl_property, Line}, Mistake(), Line)
     || {Line, Mistake} <- [
            {"a property expected, not true; it begins with ?FORALL", fun() ->
                starl_property:quickcheck(true)
            end},
            {
                "holds: a scenario expected; write ?FORALL(Scenario, starl_property:scenario(...),"
                " starl_property:holds(Scenario))",
                fun() -> starl_property:holds(Generator) end
            },
            {"holds: the key app is missing, the application's module", fun() ->
                starl_property:holds(#{robots => 2})
            end},
            {"holds/2: there is no key compleet; there are crashes, complete, outcome, dir",
                fun() ->
                    starl_property:holds(Scenario, #{compleet => true})
                end},
            {"scenario/1: the key app is missing, the application's module", fun() ->
                starl_property:scenario(#{robots => 2})
            end},
            {"quickcheck/2: there is no key 'case'; there are cases, seed", fun() ->
                starl_property:quickcheck(Generator, #{'case' => 3})
            end},
            {"quickcheck/2: cases: a whole number expected, not many", fun() ->
                starl_property:quickcheck(Generator, #{cases => many})
            end}
        ]
    ].
