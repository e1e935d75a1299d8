%% The first hour at the terminal: mistakes in faults, results where one is, runs that are repeated
%% after their files were moved, full disks, completion.
-module(starl_first_hour_terminal_SUITE).
-include_lib("stdlib/include/assert.hrl").

-export([suite/0, all/0, init_per_suite/1, end_per_suite/1]).
-export([mistakes_in_faults_are_told_with_their_place/1]).
-export([results_go_to_out_of_the_working_directory/1]).
-export([an_earlier_result_is_not_overwritten_without_a_word/1]).
-export([a_run_is_repeated_after_its_files_were_moved/1]).
-export([a_full_disk_is_told/1, a_closed_pipe_is_quiet/1]).
-export([bash_completes_from_the_tables/1, the_manual_page_has_all_commands/1]).
-export([every_command_explains_itself/1]).

-import(starl_first_hour_ct, [sh/2, contains/2, write/2]).

suite() -> [{timetrap, {minutes, 5}}].

all() ->
    [
        mistakes_in_faults_are_told_with_their_place,
        results_go_to_out_of_the_working_directory,
        an_earlier_result_is_not_overwritten_without_a_word,
        a_run_is_repeated_after_its_files_were_moved,
        a_full_disk_is_told,
        a_closed_pipe_is_quiet,
        bash_completes_from_the_tables,
        the_manual_page_has_all_commands,
        every_command_explains_itself
    ].

init_per_suite(Config) -> Config.

end_per_suite(_Config) -> ok.

dir(Name, Config) -> filename:join([proplists:get_value(priv_dir, Config), Name]).

%% The other mistakes are in starl_lab_run_tests; these two only show when the scene is made.
mistakes_in_faults_are_told_with_their_place(Config) ->
    Dir = dir("faults", Config),
    write(
        filename:join(Dir, "s/f.term"),
        "#{app => exercise, robots => 2, faults => [{a, 0, 9, isolate, 7, #{}}]}."
    ),
    ?assertEqual(
        {2, "starl: run: s/f.term: faults: fault a: there is no robot 7\n"},
        sh("$starl run s/f.term", Dir)
    ),
    {2, Text} = sh("$starl run exercise --faults '[{a,0,9,kill_machine,{1,sab},#{}}]'", Dir),
    contains("starl: run: --faults: fault a: a robot has no machine sab; it has sap, ", Text).

results_go_to_out_of_the_working_directory(Config) ->
    Dir = dir("out", Config),
    ok = filelib:ensure_path(filename:join(Dir, "deep")),
    {0, Text} = sh("ln -s \"$starl\" st; cd deep; ../st run exercise --work 1 --quiet", Dir),
    ?assertEqual("result: out/exercise-1\n", Text),
    ?assert(filelib:is_regular(filename:join(Dir, "deep/out/exercise-1/run.term"))),
    %% A printed command names the script as it was called.
    {2, Told} = sh("./st run", Dir),
    contains("as in ./st run painting", Told),
    %% A help text by its short name, if that is long.
    {0, Help} = sh("\"$(pwd)/st\" run --help", Dir),
    contains("Usage: st run TARGET", Help),
    {0, Apps} = sh("./st apps", Dir),
    contains("  painting   A team paints a picture together.\n", Apps),
    contains("examples/line_up.erl", Apps).

an_earlier_result_is_not_overwritten_without_a_word(Config) ->
    Dir = dir("overwrite", Config),
    Run = "$starl run exercise --work 1 --quiet --out x",
    {0, _} = sh(Run, Dir),
    ?assertEqual(
        {2, "starl: run: --out: x holds an earlier run; --overwrite replaces it\n"}, sh(Run, Dir)
    ),
    write(filename:join(Dir, "x/run.log"), "of the earlier run"),
    ?assertEqual({0, "result: x\n"}, sh(Run ++ " --overwrite", Dir)),
    ?assertNot(filelib:is_file(filename:join(Dir, "x/run.log"))).

%% An application of two files and a header, whose scenario names it and a picture relative to
%% itself, runs; then all is moved away, and the run's directory, too.
a_run_is_repeated_after_its_files_were_moved(Config) ->
    Dir = dir("moved", Config),
    [
        write(filename:join([Dir, "mine", Name]), Text)
     || {Name, Text} <- [
            {"moved_app.erl",
                "-module(moved_app).\n-include(\"inc/moved.hrl\").\n-export([init/2, step/2, options/0]).\n"
                "options() -> [{map, file, \"none\", \"a file\"}].\n"
                "init(_, #{map := File}) -> {ok, Text} = file:read_file(File), Text.\n"
                "step(_, Text) -> {done, moved_help:part(Text, ?PART)}.\n"},
            {"inc/moved.hrl", "-define(PART, 3).\n"},
            {"moved_help.erl",
                "-module(moved_help).\n-export([part/2]).\n"
                "part(Text, N) -> binary:part(Text, 0, N).\n"},
            {"floor.map", "abcdef"},
            {"s.term", "#{app => \"moved_app.erl\", map => \"floor.map\", robots => 2}."}
        ]
    ],
    {0, "result: out/moved_app-1\n"} = sh("$starl run mine/s.term --quiet", Dir),
    {0, _} = sh("mv mine gone; echo x > floor.map; mv out/moved_app-1 there", Dir),
    {0, Text} = sh("$starl replay there", Dir),
    contains("same digest", Text),
    {0, _} = sh("cd gone; $starl run ../there/scenario.term --quiet", Dir).

%% A full device, files that may not grow, and a program for PNG that finds no room.
a_full_disk_is_told(Config) ->
    Dir = dir("full", Config),
    ?assertEqual(
        {1, "starl: the output is lost: no space left on device\n"},
        sh("$starl apps > /dev/full", Dir)
    ),
    ?assertEqual(
        {1,
            "result: nothing\nstarl: the results could not be written: report.txt: file too large\n"},
        sh("ulimit -f 0; echo result: nothing; $starl run exercise --work 1 --quiet --out x", Dir)
    ),
    ?assertEqual({ok, []}, file:list_dir(Dir)),
    Fake = filename:join(Dir, "bin/rsvg-convert"),
    write(Fake, "#!/bin/sh\necho 'No space left on device' >&2\nexit 1\n"),
    ok = file:change_mode(Fake, 8#755),
    Run = "PATH=$PWD/bin:$PATH $starl run painting --picture lines --quiet --out x",
    ?assertEqual(
        {1, "result: x\nstarl: no PNG was made: rsvg-convert: No space left on device\n"},
        sh(Run, Dir)
    ),
    ?assert(filelib:is_regular(filename:join(Dir, "x/painting.svg"))).

a_closed_pipe_is_quiet(Config) ->
    {0, Text} = sh("$starl faults | head -n 1", dir("pipe", Config)),
    ?assertMatch(["network" ++ _, ""], string:split(Text, "\n", all)).

%% What bash asks the function for: the words up to the cursor, the last one incomplete.
-define(COMPLETED, [
    {"./starl ru", "run"},
    {"./starl run paint", "painting painting_lossy"},
    {"starl run painting --pict", "--picture"},
    {"starl run painting --picture h", "hatch house"},
    {"starl run painting --picture = h", "hatch house"},
    {"starl run --seed 5 painting --safety", "--safety-distance"},
    {"starl run exercise --safety", ""},
    {"starl run exercise --block ele", "election"},
    {"starl run painting --quiet --mode in", "inline"},
    {"starl run exercise --random-faults [network,kill_m", "[network,kill_machine"},
    {"starl run my.erl --loss", "--loss"},
    {"starl soak mu", "mutex"},
    {"starl check mutex --faults cr", "crash:1"},
    {"starl help so", "soak"},
    {"starl completion z", "zsh"},
    {"starl run ./line", "./lines.svg"},
    {"starl run painting --picture ./line", "./lines.svg"}
]).

bash_completes_from_the_tables(Config) ->
    Dir = dir("completion", Config),
    write(filename:join(Dir, "lines.svg"), ""),
    Script =
        "source <($starl completion bash)\n"
        "t() { COMP_WORDS=(\"$@\"); COMP_CWORD=$(($# - 1)); COMPREPLY=(); _starl;"
        " echo \"${COMPREPLY[*]}\"; }\n",
    Calls = [["t ", Line, "\n"] || {Line, _} <- ?COMPLETED],
    write(filename:join(Dir, "try"), [Script, Calls, "complete -p starl\n"]),
    {0, Text} = sh("bash try", Dir),
    Lines = string:split(string:trim(Text, trailing, "\n"), "\n", all),
    Wanted = [Line || {_, Line} <- ?COMPLETED],
    ?assertEqual(Wanted ++ ["complete -o filenames -F _starl starl"], Lines).

the_manual_page_has_all_commands(Config) ->
    Dir = dir("man", Config),
    {0, Page} = sh("$starl man", Dir),
    contains(".TH STARL 1\n", Page),
    {0, Names} = sh("$starl help --names", Dir),
    [contains("\n.SS " ++ Name, Page) || Name <- string:lexemes(Names, "\n")],
    contains("\n.B \\-\\-random\\-faults TERM\n", Page),
    %% groff warns of what it does not understand, and of a path that does not fit: StarL may lie
    %% in a directory with a name of any length.
    ?assertEqual(
        {0, ""},
        sh(
            "command -v groff >/dev/null || exit 0; $starl man > page; path=x; slash='/\\\\:';"
            " while [ ${#path} -lt 200 ]; do"
            "  sed \"s|[^ ]*examples/|$path/examples/|g\" page | groff -ww -man -Tutf8 >/dev/null;"
            "  case $path in *xxxxx) path=$path${slash}x;; *) path=${path}x;; esac; done",
            Dir
        )
    ).

%% Also those that the script runs itself.
every_command_explains_itself(Config) ->
    Dir = dir("help", Config),
    Loop =
        "for c in setup shell test run; do $starl help $c > one; $starl $c --help > two;"
        " $starl $c -h > three; cmp one two; cmp two three; head -n 1 one; done",
    {0, Text} = sh(Loop, Dir),
    [contains("starl " ++ Name, Text) || Name <- ["setup [F", "shell [A", "test [M", "run T"]],
    nomatch = string:find(Text, "differ"),
    Version = "for v in version -V --version; do $starl $v; done",
    {0, Versions} = sh(Version, Dir),
    ?assertMatch(["starl " ++ _], lists:usort(string:lexemes(Versions, "\n"))).
