%% Runs over nodes from the command line: the flags, a node that waits, what a lost one looks like.
%%
%% Holds: The secret of nodes is on no command line
%% Red: 961f67c9: `--cookie`
-module(starl_lab_nodes_tests).
-include_lib("eunit/include/eunit.hrl").

-import(starl_cli_vm, [says/3, contains/2, start/1, rest/2, until/3, interrupt/1, in_directory/1]).

-define(PATIENCE_S, 120).

plan_test() ->
    with_cookie("c\n", 8#600, fun plan/1).

plan(File) ->
    ?assertEqual({[], none}, starl_lab_nodes:plan(#{})),
    ?assertMatch({[], #{nodes := 2, timeout_ms := 30000}}, starl_lab_nodes:plan(#{nodes => "2"})),
    ?assertMatch(
        {[], #{nodes := ['a@h1', 'b@h2'], cookie := c, timeout_ms := 500}},
        starl_lab_nodes:plan(#{nodes => "a@h1,b@h2", cookie_file => File, node_timeout => 0.5})
    ),
    ?assertMatch(
        {[], #{nodes := ['a@10.0.0.1'], name := 'me@10.0.0.2'}},
        starl_lab_nodes:plan(#{
            nodes => "a@10.0.0.1", cookie_file => File, node_name => "me@10.0.0.2"
        })
    ).

%% Each is one line, which names the flag.
bad_flags_test() ->
    with_cookie("c", 8#600, fun bad_flags/1).

bad_flags(File) ->
    [
        ?assertMatch({Values, {[_], _}, 0}, {Values, Told, string:str(line(Told), Flag) - 1})
     || {Flag, Values} <- [
            {"--nodes", #{nodes => "0"}},
            {"--nodes", #{nodes => "65"}},
            {"--nodes", #{nodes => "two"}},
            {"--nodes", #{nodes => "2x"}},
            {"--nodes", #{nodes => "a@h,b", cookie_file => File}},
            {"--nodes", #{nodes => "a@h,", cookie_file => File}},
            {"--nodes", #{nodes => "a@@h", cookie_file => File}},
            {"--nodes", #{nodes => "a b@h", cookie_file => File}},
            {"--nodes", #{nodes => "a@h,b@h.c", cookie_file => File}},
            {"--node-name", #{nodes => "a@h", cookie_file => File, node_name => "x"}},
            {"--nodes", #{nodes => "a@h", cookie_file => File ++ ".none"}},
            {"--cookie-file", #{nodes => "2", cookie_file => File}},
            {"--node-timeout", #{node_timeout => 3}}
        ],
        Told <- [starl_lab_nodes:plan(Values)]
    ].

%% The secret of the nodes is one that others cannot read, and that is whole.
a_secret_is_a_secret_test() ->
    Bad = fun(Text, Mode, Why) ->
        with_cookie(Text, Mode, fun(File) ->
            {error, Line} = starl_lab_cookie:read(File),
            ?assertNotEqual(nomatch, string:find(lists:flatten(Line), Why))
        end)
    end,
    Bad("c", 8#644, "chmod 600"),
    Bad("c", 8#660, "chmod 600"),
    Bad("", 8#600, "letters and digits"),
    Bad("a b", 8#600, "letters and digits"),
    Bad(lists:duplicate(256, $c), 8#600, "letters and digits").

%% A node makes one that nobody can guess, and takes it again.
a_secret_is_made_once_test() ->
    with_cookie("", 8#600, fun(File) ->
        Own = File ++ ".own",
        {ok, Cookie} = starl_lab_cookie:made(Own),
        ?assertEqual(32, length(atom_to_list(Cookie))),
        ?assertEqual({ok, Cookie}, starl_lab_cookie:made(Own)),
        ?assertEqual({ok, Cookie}, starl_lab_cookie:read(Own))
    end).

with_cookie(Text, Mode, Test) ->
    in_directory(fun(Dir) ->
        File = filename:join(Dir, "cookie"),
        ok = file:write_file(File, Text),
        ok = file:change_mode(File, Mode),
        Test(File)
    end).

line({[Line | _], _}) -> lists:flatten(unicode:characters_to_list(Line)).

commands_test_() ->
    patient([
        {"bad nodes", fun() ->
            says(2, "starl: run: --nodes: ", ["run", "painting", "--nodes", "x"])
        end},
        {"nobody there", fun() ->
            with_cookie("c", 8#600, fun(File) ->
                Args = ["run", "painting", "--nodes", "nobody@127.0.0.1", "--cookie-file", File],
                says(2, "starl: run: node nobody@127.0.0.1 cannot be reached", Args)
            end)
        end},
        {"help", fun() -> says(0, "Usage: ./starl node", ["node", "--help"]) end},
        {"bad name", fun() -> says(2, "starl: node: \"a@b@c\"", ["node", "--name", "a@b@c"]) end}
    ]).

%% A limit of a group is none of its tests'.
patient(Tests) -> [{Title, {timeout, ?PATIENCE_S, Test}} || {Title, Test} <- Tests].

%% A node waits, an application of the user's own runs there, and comes to the digest of one VM;
%% with another cookie nothing does. Ctrl-C ends the node.
a_node_that_waits_test_() ->
    {timeout, ?PATIENCE_S, fun() ->
        in_directory(fun(Dir) ->
            [App, One, Two] = [filename:join(Dir, Name) || Name <- ["mine.erl", "one", "two"]],
            ok = file:write_file(App, source()),
            Name = "waits_" ++ os:getpid() ++ "@127.0.0.1",
            Secret = filename:join(Dir, "cookie"),
            Node = start(["node", "--name", Name, "--cookie-file", Secret]),
            Said = until("--nodes ", Node, ""),
            {ok, Cookie} = file:read_file(Secret),
            ?assertEqual(nomatch, string:find(Said, string:trim(binary_to_list(Cookie)))),
            Other = filename:join(Dir, "other"),
            ok = file:write_file(Other, "other"),
            ok = file:change_mode(Other, 8#600),
            Run = ["run", App, "--robots", "3", "--quiet", "--out"],
            says(0, "result: ", Run ++ [One]),
            says(0, "result: ", Run ++ [Two, "--nodes", Name, "--cookie-file", Secret]),
            ?assertEqual(digest(One), digest(Two)),
            says(2, "cannot be reached", ["run", App, "--nodes", Name, "--cookie-file", Other]),
            %% one line, without the reports of OTP
            Taken = says(2, "starl: node: this machine cannot be node", [
                "node", "--name", Name, "--cookie-file", Secret
            ]),
            ?assertMatch([_], string:lexemes(Taken, "\n")),
            interrupt(Node),
            ?assertMatch({130, _}, rest(Node, ""))
        end)
    end}.

source() ->
    "-module(mine).\n-behaviour(starl_app).\n-export([init/2, step/2]).\n"
    "init(_Robot, _Options) -> 0.\n"
    "step(_Robot, 20) -> {done, 20};\n"
    "step(Robot, N) -> ok = starl:go_to(Robot, {1000.0 * starl:id(Robot), 1000.0 + 50.0 * N}),\n"
    "    {continue, N + 1}.\n".

digest(Dir) ->
    {ok, Json} = file:read_file(filename:join(Dir, "report.json")),
    {match, [Digest]} = re:run(Json, "\"digest\": *\"([0-9a-f]{32})\"", [{capture, [1], list}]),
    Digest.

%% A node is killed: exit status 4, one line that says which, the results so far.
a_node_that_is_lost_test_() ->
    {timeout, ?PATIENCE_S, fun() ->
        in_directory(fun(Dir) ->
            [App, Out] = [filename:join(Dir, File) || File <- ["endless.erl", "out"]],
            ok = file:write_file(App, endless()),
            Name = "lost_" ++ os:getpid() ++ "@127.0.0.1",
            Secret = filename:join(Dir, "cookie"),
            Node = start(["node", "--name", Name, "--cookie-file", Secret]),
            _ = until("--nodes ", Node, ""),
            Nodes = ["--nodes", Name, "--cookie-file", Secret],
            Run = start(["run", App, "--time", "1000000", "--out", Out | Nodes]),
            Begun = until("under way", Run, ""),
            {os_pid, OsPid} = erlang:port_info(Node, os_pid),
            "" = os:cmd("kill -KILL " ++ integer_to_list(OsPid)),
            {137, _} = rest(Node, ""),
            {Status, Text} = rest(Run, Begun),
            ?assertEqual({4, Text}, {Status, Text}),
            contains("endless: NOT COMPLETE (a node was lost)", Text),
            contains("starl: node " ++ Name ++ " is gone; virtual time ", Text),
            {ok, Report} = file:read_file(filename:join(Out, "report.txt")),
            contains("lost", unicode:characters_to_list(Report))
        end)
    end}.

endless() ->
    "-module(endless).\n-behaviour(starl_app).\n-export([init/2, step/2]).\n"
    "init(_Robot, _Options) -> 0.\n"
    "step(Robot, N) ->\n"
    "    N =:= 10 andalso io:format(\"under way~n\"),\n"
    "    ok = starl:sleep(Robot, 1000),\n"
    "    {continue, N + 1}.\n".
