%% The page doc/rules.md: its two files, as they stand there, and its commands; and what a mistake is told.
%%
%% Holds: A rule of one's own is a file; a run keeps a copy; a mistake is one line
%% Red: not seen red
-module(starl_rules_SUITE).
-include_lib("stdlib/include/assert.hrl").

-export([suite/0, all/0, init_per_suite/1, end_per_suite/1]).
-export([
    examples_are_those_of_the_page/1, commands_run/1, a_run_is_repeated/1, beside_an_application/1
]).
-export([mistakes_are_one_line/1]).

-import(starl_first_hour_ct, [sh/2, write/2, root/0]).

suite() -> [{timetrap, {minutes, 3}}].

all() ->
    [
        examples_are_those_of_the_page,
        commands_run,
        a_run_is_repeated,
        beside_an_application,
        mistakes_are_one_line
    ].

init_per_suite(Config) ->
    Dir = filename:join(proplists:get_value(priv_dir, Config), "rules"),
    _ = [write(filename:join(Dir, Name), Text) || {Name, Text} <- files()],
    [{dir, Dir} | Config].

end_per_suite(_Config) -> ok.

examples_are_those_of_the_page(_Config) ->
    ?assertEqual(["strips.erl", "polite.erl"], [Name || {Name, _} <- files()]),
    [?assertEqual(text("examples/own_rule/" ++ Name), Text) || {Name, Text} <- files()].

commands_run(Config) ->
    {match, Lines} = re:run(page(), "^    \\./starl(.*)$", [
        multiline, global, {capture, [1], list}
    ]),
    ?assertEqual(3, length(Lines)),
    [{0, _} = started(Words, Config) || [Words] <- Lines].

%% The files have gone: the run has copies of its own. Each rule makes another run of it.
a_run_is_repeated(Config) ->
    Dir = proplists:get_value(dir, Config),
    Own = filename:join(Dir, "own"),
    Run = " run painting --robots 2 --no-record --quiet ",
    {0, _} = started(Run ++ "--choice strips.erl --controller polite.erl --out own/run", Config),
    {0, _} = started(Run ++ "--out own/usual", Config),
    ?assertNotEqual(digest(Own ++ "/run"), digest(Own ++ "/usual")),
    ok = file:rename(filename:join(Dir, "strips.erl"), filename:join(Dir, "strips.was")),
    {0, Text} = started(" replay own/run", Config),
    ok = file:rename(filename:join(Dir, "strips.was"), filename:join(Dir, "strips.erl")),
    says("same digest " ++ digest(Own ++ "/run"), Text).

digest(Run) ->
    {ok, [#{digest := Digest}]} = file:consult(filename:join(Run, "run.term")),
    unicode:characters_to_list(Digest).

%% An application names the module; the file lies beside it.
beside_an_application(Config) ->
    Dir = proplists:get_value(dir, Config),
    write(filename:join(Dir, "lines.erl"), [
        "-module(lines).\n-behaviour(starl_app).\n-export([blocks/0, init/2, step/2]).\n"
        "blocks() -> [{starl_dpp, #{segments => [{{3000.0, 3000.0}, {5000.0, 3000.0}}],\n"
        "                           slack => 11.0, choice => strips}}].\n"
        "init(Robot, _) -> starl_dpp:join(Robot, 1).\n"
        "step(Robot, State) ->\n"
        "    case starl_dpp:request_path(Robot) of\n"
        "        {ok, Path} ->\n"
        "            _ = [starl_dpp:drive(Robot, Path, N) || {N, _, _} <- starl_dpp:lines(Path)],\n"
        "            {continue, State};\n"
        "        Over -> {done, Over}\n"
        "    end.\n"
    ]),
    {0, Text} = started(" run lines.erl --robots 2 --no-record", Config),
    says("complete", Text),
    {0, _} = sh("sed -i 's/=> strips/=> strip/' lines.erl", Dir),
    {2, Told} = started(" run lines.erl --robots 2 --no-record", Config),
    says(
        "choice: ink, nearest, or a module of yours (behaviour starl_dpp_rule) expected, not strip",
        Told
    ).

mistakes_are_one_line(Config) ->
    Dir = proplists:get_value(dir, Config),
    write(filename:join(Dir, "bad.erl"), "-module(bad).\n-export([f/0]).\nf() -> ok.\n"),
    write(filename:join(Dir, "worse.erl"), "-module(worse).\n-export([f/0]).\nf() -> .\n"),
    write(filename:join(Dir, "wrong.term"), "#{app => painting, controller => \"warry\"}.\n"),
    [
        begin
            {2, Text} = started(" run " ++ Words, Config),
            ?assertEqual("starl: run: " ++ Told ++ "\n", Text)
        end
     || {Words, Told} <- [
            {"painting --choice neerest",
                "choice: there is no rule neerest (did you mean nearest?)"},
            {"painting --choice nobody.erl", "nobody.erl: there is no such file"},
            {"painting --choice bad.erl",
                "choice: bad.erl is no rule: it exports no score/2 (starl_dpp_rule)"},
            {"painting --choice worse.erl", "worse.erl:3: syntax error before: '.'"},
            {"painting --controller warry",
                "--controller: there is no controller warry (did you mean wary?)"},
            {"wrong.term",
                "wrong.term: controller: there is no controller warry (did you mean wary?)"},
            {"painting --controller bad.erl",
                "--controller: bad.erl is no controller: it exports no sees_mm/1 (starl_controller)"}
        ]
    ].

started(Words, Config) -> sh("\"$starl\"" ++ Words, proplists:get_value(dir, Config)).

says(Part, Text) -> ?assertNotEqual(nomatch, string:find(Text, Part), Text).

page() -> text("doc/rules.md").

text(File) ->
    {ok, Text} = file:read_file(filename:join(root(), File)),
    unicode:characters_to_list(Text).

%% A block of code, with the name of its file before it.
files() ->
    {match, Blocks} = re:run(page(), "^`([a-z_/]+\\.erl)`:\n\n```erlang\n(.*?)```", [
        unicode, multiline, dotall, global, {capture, [1, 2], list}
    ]),
    [{Name, Text} || [Name, Text] <- Blocks].
