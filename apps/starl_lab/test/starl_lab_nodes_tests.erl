%% Runs over nodes from the command line: the flags, a node that waits, what a lost one looks like.
-module(starl_lab_nodes_tests).
-include_lib("eunit/include/eunit.hrl").

-import(starl_cli_vm, [says/3, contains/2, start/1, rest/2, until/3, interrupt/1, in_directory/1]).

-define(PATIENCE_S, 120).

plan_test() ->
    ?assertEqual({[], none}, starl_lab_nodes:plan(#{})),
    ?assertMatch({[], #{nodes := 2, timeout_ms := 30000}}, starl_lab_nodes:plan(#{nodes => "2"})),
    ?assertMatch(
        {[], #{nodes := ['a@h1', 'b@h2'], cookie := c, timeout_ms := 500}},
        starl_lab_nodes:plan(#{nodes => "a@h1,b@h2", cookie => "c", node_timeout => 0.5})
    ),
    ?assertMatch(
        {[], #{nodes := ['a@10.0.0.1'], name := 'me@10.0.0.2'}},
        starl_lab_nodes:plan(#{
            nodes => "a@10.0.0.1", cookie => "c", node_name => "me@10.0.0.2"
        })
    ).

%% Each is one line, which names the flag.
bad_flags_test() ->
    [
        ?assertMatch({Values, {[_], _}, 0}, {Values, Told, string:str(line(Told), Flag) - 1})
     || {Flag, Values} <- [
            {"--nodes", #{nodes => "0"}},
            {"--nodes", #{nodes => "65"}},
            {"--nodes", #{nodes => "two"}},
            {"--nodes", #{nodes => "2x"}},
            {"--nodes", #{nodes => "a@h,b", cookie => "c"}},
            {"--nodes", #{nodes => "a@h,", cookie => "c"}},
            {"--nodes", #{nodes => "a@@h", cookie => "c"}},
            {"--nodes", #{nodes => "a b@h", cookie => "c"}},
            {"--nodes", #{nodes => "a@h,b@h.c", cookie => "c"}},
            {"--node-name", #{nodes => "a@h", cookie => "c", node_name => "x"}},
            {"--cookie", #{nodes => "a@h"}},
            {"--cookie", #{nodes => "a@h", cookie => lists:duplicate(256, $c)}},
            {"--cookie", #{nodes => "2", cookie => "c"}},
            {"--node-timeout", #{node_timeout => 3}}
        ],
        Told <- [starl_lab_nodes:plan(Values)]
    ].

line({[Line | _], _}) -> lists:flatten(unicode:characters_to_list(Line)).

commands_test_() ->
    patient([
        {"bad nodes", fun() ->
            says(2, "starl: run: --nodes: ", ["run", "painting", "--nodes", "x"])
        end},
        {"nobody there", fun() ->
            Args = ["run", "painting", "--nodes", "nobody@127.0.0.1", "--cookie", "c"],
            says(2, "starl: run: node nobody@127.0.0.1 cannot be reached", Args)
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
            Node = start(["node", "--name", Name]),
            Text = until("--cookie ", Node, ""),
            [_, Rest] = string:split(Text, "--cookie "),
            Cookie = string:trim(Rest),
            Run = ["run", App, "--robots", "3", "--quiet", "--out"],
            says(0, "result: ", Run ++ [One]),
            says(0, "result: ", Run ++ [Two, "--nodes", Name, "--cookie", Cookie]),
            ?assertEqual(digest(One), digest(Two)),
            says(2, "cannot be reached", ["run", App, "--nodes", Name, "--cookie", "other"]),
            %% one line, without the reports of OTP
            Taken = says(2, "starl: node: this machine cannot be node", ["node", "--name", Name]),
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
            Node = start(["node", "--name", Name, "--cookie", "c"]),
            _ = until("--cookie ", Node, ""),
            Run = start([
                "run", App, "--time", "1000000", "--nodes", Name, "--cookie", "c", "--out", Out
            ]),
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
