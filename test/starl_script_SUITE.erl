%% `./starl' as a shell script calls it: what it reads, and which commands are its own.
-module(starl_script_SUITE).
-include_lib("stdlib/include/assert.hrl").

-export([suite/0, all/0]).
-export([standard_input_is_left_alone/1, a_closed_standard_input_is_none/1]).
-export([the_shell_reads_standard_input/1, commands_of_the_script_are_explained/1]).
-export([flags_of_the_script_are_refused/1, other_libraries_build_nothing/1]).
-export([a_run_keeps_its_code/1, code_in_the_working_directory_is_not_seen/1]).

suite() -> [{timetrap, {minutes, 5}}].

all() ->
    [
        standard_input_is_left_alone,
        a_closed_standard_input_is_none,
        the_shell_reads_standard_input,
        commands_of_the_script_are_explained,
        flags_of_the_script_are_refused,
        other_libraries_build_nothing,
        a_run_keeps_its_code,
        code_in_the_working_directory_is_not_seen
    ].

%% A list that a loop reads its turns from is not eaten by the first of them.
standard_input_is_left_alone(Config) ->
    Run = "run exercise --work 1 --quiet --out \"$out/$seed\" --seed \"$seed\"",
    Loop = "while read seed; do ./starl " ++ Run ++ " >/dev/null || echo bad; echo $seed; done",
    ?assertEqual({0, "3\n5\n8\n"}, sh("printf '3\\n5\\n8\\n' | " ++ Loop, Config)).

a_closed_standard_input_is_none(Config) ->
    {0, Text} = sh("./starl apps <&-", Config),
    ?assertNotEqual(nomatch, string:find(Text, "painting")).

the_shell_reads_standard_input(Config) ->
    {_, Text} = sh("echo 'starl_sim:module_info(module), 40 + 2.' | ./starl shell", Config),
    ?assertNotEqual({nomatch, Text}, {string:find(Text, "42"), Text}).

commands_of_the_script_are_explained(Config) ->
    [
        begin
            Usage = "Usage: ./starl " ++ Name,
            {0, Text} = sh("./starl " ++ Name ++ " --help", Config),
            ?assertEqual({Text, true}, {Text, lists:prefix(Usage, Text)})
        end
     || Name <- ["test", "shell", "setup"]
    ].

flags_of_the_script_are_refused(Config) ->
    [
        ?assertMatch({2, "starl: " ++ _}, sh("./starl " ++ Line, Config))
     || Line <- [
            "test --helpp",
            "setup --helpp",
            "setup now",
            "test no/such-name",
            "test --cases",
            "test --cases 0",
            "test --cases=x y"
        ]
    ].

%% Where a user has libraries of his own is no matter of the build.
%% Holds: Another `ERL_LIBS` builds nothing
%% Red: e9af1e0, run
other_libraries_build_nothing(Config) ->
    {0, _} = sh("./starl apps", Config),
    Stamps = "stat -c '%i %Y' _build/starl/ready _build/starl/built _build/default/lib/starl_cli",
    {0, Before} = sh(Stamps, Config),
    {0, _} = sh("ERL_LIBS=\"$out:${ERL_LIBS-}\" ./starl apps", Config),
    ?assertEqual({0, Before}, sh(Stamps, Config)).

%% The build goes while a cluster runs, as another Erlang, or new sources, would build anew: a node that
%% is killed comes up again, and the run ends with its results.
a_run_keeps_its_code(Config) ->
    Line =
        "copy=$out/copy; mkdir -p $copy/_build/starl; "
        "cp -a starl apps rebar.config* .deps $copy/ 2>/dev/null; "
        "cp -a _build/default $copy/_build/; "
        "cp -a _build/starl/ready _build/starl/built _build/starl/places $copy/_build/starl/; "
        "$copy/starl cluster exercise --robots 2 --quiet --out $out/kept >$out/kept.txt 2>&1 & "
        "script=$!; ask() { ./starl cluster \"$@\" --pid $(pgrep -P $script); }; n=0; "
        "until ask status 2>/dev/null | grep -q '2 at work' || [ $((n += 1)) -gt 100 ]; do :; done; "
        "rm -rf $copy/_build/default/lib/starl_*; ask kill 1; n=0; "
        "until ask status | grep 'robot 1 *up .* started 2 times' || [ $((n += 1)) -gt 30 ]; "
        "do :; done; ask stop; wait $script; echo \"status $?\"; cat $out/kept.txt",
    {0, Text} = sh(Line, Config),
    [
        ?assertNotEqual({Part, Text, nomatch}, {Part, Text, string:find(Text, Part)})
     || Part <- ["started 2 times", "the run ends", "status 130"]
    ].

%% Runs a line in the checkout, with the environment in which ./starl itself has built it.
%% A stranger's results hold modules of names that Erlang's libraries have, too.
%% Holds: Code in the working directory is not looked for
%% Red: 4ca8e259, by hand: `./c.beam` ran
code_in_the_working_directory_is_not_seen(Config) ->
    Line =
        "mkdir -p $out/results; root=$(pwd); cd $out/results; "
        "for m in c erl_eval erl_scan crypto re beam_lib io_lib_pretty zlib filelib; do "
        "printf -- '-module(%s).\n-on_load(go/0).\ngo() -> prim_file:write_file(<<\"%s\">>, <<>>).\n' "
        "$m \"$out/ran\" >$m.erl; erlc +no_auto_import $m.erl >/dev/null; rm $m.erl; done; "
        "ls *.beam | wc -l; $root/starl info .; $root/starl apps | grep -c painting; "
        "test -e $out/ran && echo it ran; cd $root",
    {_, Text} = sh(Line, Config),
    ?assertMatch({match, _}, re:run(Text, "^9\nstarl: info: [.] holds no recording.*\n[1-9]")),
    ?assertEqual({Text, nomatch}, {Text, string:find(Text, "it ran")}).

sh(Line, Config) ->
    Root = root(filename:dirname(code:which(?MODULE))),
    Port = open_port({spawn_executable, os:find_executable("sh")}, [
        {args, ["-c", Line]},
        {cd, Root},
        exit_status,
        stderr_to_stdout,
        hide,
        {env, [
            {"out", proplists:get_value(priv_dir, Config)},
            {"ERL_AFLAGS", false},
            {"ERL_LIBS", libraries(Root)},
            {"PATH", path()}
        ]}
    ]),
    rest(Port, "").

rest(Port, Text) ->
    receive
        {Port, {data, More}} -> rest(Port, Text ++ More);
        {Port, {exit_status, Status}} -> {Status, Text}
    end.

root(Dir) ->
    case filelib:is_regular(filename:join(Dir, "starl")) of
        true -> Dir;
        false when Dir =/= "/" -> root(filename:dirname(Dir))
    end.

%% An Erlang VM puts two folders of its own before the others.
path() ->
    Dirs = string:lexemes(os:getenv("PATH"), ":"),
    Own = [os:getenv("BINDIR", ""), filename:join(code:root_dir(), "bin")],
    lists:append(lists:join(":", Dirs -- Own)).

%% rebar3 adds the libraries in .deps, which ./starl adds by itself.
libraries(Root) ->
    Own = filename:join(Root, ".deps"),
    case [Dir || Dir <- string:lexemes(os:getenv("ERL_LIBS", ""), ":"), Dir =/= Own] of
        [] -> false;
        Dirs -> lists:append(lists:join(":", Dirs))
    end.
