%% The program bin/robot of a release, with a program in the place of Erlang.
-module(starl_fleet_robot_tests).
-include_lib("eunit/include/eunit.hrl").

robot_test_() ->
    {foreach, fun place/0, fun gone/1, [
        fun(Place) -> {Name, {timeout, 60, fun() -> Test(Place) end}} end
     || {Name, Test} <- [
            {"a robot that was stopped says so", fun stopped/1},
            {"a node whose shell was killed is stopped, too", fun orphan_stopped/1},
            {"a node that does not listen is stopped, too", fun deaf_stopped/1},
            {"a node that does not end is not called stopped", fun still_runs/1},
            {"nobody else's process is stopped", fun others_live/1},
            {"a store that cannot be written is one line", fun unwritable/1},
            {"a store that is read-only is one line", fun read_only/1},
            {"back to the release before, and forward again", fun rolled_back/1},
            {"new code that has failed is left, by a restart where the node does not know it",
                fun reload_undone/1},
            {"a node that a signal ends", fun signalled/1},
            {"a log that has grown", fun rotated/1},
            {"a clock that is set soon is waited for", fun set_clock/1},
            {"a clock that nobody sets is not", fun unset_clock/1}
        ]
    ]}.

stopped(Place) ->
    ?assertEqual({3, "no answer\n"}, robot("one", "status", Place)),
    ?assertEqual({0, ""}, robot("one", "stop", Place)),
    ?assertEqual({0, "stopped\n"}, robot("one", "status", Place)),
    ?assertEqual({0, ""}, robot("one", "start", Place)),
    ?assertEqual({3, "no answer\n"}, robot("one", "status", Place)).

%% The shell that watches the node is killed: by hand, for lack of memory, at a logout.
orphan_stopped(#{dir := Dir} = Place) ->
    Pid = node(node_is("sleep 600 & wait", Dir), Place),
    ok = killed("KILL", text(state("daemon", Place))),
    ok = file:delete(state("daemon", Place)),
    ?assert(runs(Pid)),
    ?assertEqual({0, ""}, robot("one", "stop", Place)),
    ?assertNot(runs(Pid)),
    ?assertEqual({0, "stopped\n"}, robot("one", "status", Place)).

deaf_stopped(#{dir := Dir} = Place) ->
    Pid = node(node_is("trap '' TERM; while :; do sleep 1; done", Dir), Place),
    ?assertEqual({0, ""}, robot("one", "stop", Place)),
    ?assertNot(runs(Pid)).

%% The process is there, whatever is sent to it: this number is above all that Linux gives.
still_runs(#{dir := Dir, base := Base} = Place) ->
    Proc = filename:join(Dir, "proc"),
    Line = filename:join(Proc, "4194305/cmdline"),
    ok = filelib:ensure_dir(Line),
    ok = file:write_file(Line, ["erl", 0, "-config", 0, Base, "/releases/one/sys", 0]),
    Look = fun(Words) -> run("env STARL_PROC=" ++ Proc ++ " " ++ line("one", Words, Place)) end,
    ?assertEqual(
        {1, "robot 2 still runs: its node cannot be ended (process 4194305)\n"}, Look("stop")
    ),
    ?assertEqual({3, "no answer\n"}, Look("status")).

%% A process that only names this robot in a file of its own, and the node of another robot.
others_live(#{dir := Dir, base := Base} = Place) ->
    Others = [
        "tail -f /dev/null " ++ Base ++ "/releases/one/vm.args",
        "sh " ++ node_is("sleep 600 & wait", Dir) ++ " -config " ++ Base ++ "1/releases/one/sys"
    ],
    lists:foreach(
        fun(Line) ->
            {0, Pid} = run("{ " ++ Line ++ " >/dev/null 2>&1 & echo $!; }"),
            ?assertEqual({0, ""}, robot("one", "stop", Place)),
            ?assert(runs(string:trim(Pid)), Line),
            ok = killed("KILL", Pid)
        end,
        Others
    ).

%% The node does this, and writes down who it is.
node_is(Script, Dir) ->
    Node = "echo $$ >" ++ filename:join(Dir, "node") ++ "\n" ++ Script ++ "\n",
    ok = erlang_is(
        "case $* in *starl_fleet_ask*) echo no answer; exit 3 ;; esac\n" ++ Node, Dir
    ),
    filename:join(Dir, "bin/erl").

%% The started node of the release.
node(_Program, #{dir := Dir} = Place) ->
    {0, ""} = robot("one", "start", Place),
    {0, Pid} = run(
        "while [ ! -s " ++ Dir ++ "/node ]; do sleep 0.05; done; cat " ++ Dir ++ "/node"
    ),
    string:trim(Pid).

killed(Signal, Pid) ->
    _ = run("kill -" ++ Signal ++ " " ++ string:trim(Pid)),
    ok.

%% A process that has ended, and for which nobody has waited yet, has no command line.
runs(Pid) -> element(1, run("grep -qsa . /proc/" ++ Pid ++ "/cmdline")) =:= 0.

unwritable(Place) ->
    ok = filelib:ensure_path(state("writable/full", Place)),
    {1, Said} = robot("one", "run", Place),
    ?assertEqual("the store of robot 2 cannot be written: Is a directory\n", Said).

%% Only who may mount can make a directory read-only for root.
read_only(Place) ->
    State = state("", Place),
    Mount = "mount --bind " ++ State ++ " " ++ State ++ " && mount -o remount,bind,ro " ++ State,
    case run("unshare -m sh -c '" ++ Mount ++ "'") of
        {0, _} ->
            Line = Mount ++ " && exec " ++ line("one", "run", Place),
            ?assertEqual(
                {1, "the store of robot 2 is read-only\n"}, run("unshare -m sh -c '" ++ Line ++ "'")
            );
        _ ->
            ok
    end.

rolled_back(Place) ->
    {0, _} = robot("two", "switch", Place),
    ?assertEqual({0, "one\n"}, robot("two", "rollback", Place)),
    ?assertEqual({"one", "two"}, {link("current", Place), link("previous", Place)}),
    ?assertEqual({0, "two\n"}, robot("one", "rollback", Place)),
    ?assertEqual({"two", "one"}, {link("current", Place), link("previous", Place)}),
    %% a release that has failed is no release before
    {0, "one\n"} = robot("two", "undo", Place),
    ?assertEqual({"one", none}, {link("current", Place), link("previous", Place)}),
    ?assertEqual(
        {1, "there is no release before this one\n"}, robot("one", "rollback", Place)
    ).

%% The node knows of the reload, or has started anew since: then it starts with the release before.
reload_undone(#{dir := Dir} = Place) ->
    Asked = filename:join(Dir, "asked"),
    Answer = fun(Status) ->
        erlang_is(
            "case $* in *starl_fleet_ask*) echo \"$*\" | sed s/.*-extra// >>" ++ Asked ++ "; exit " ++
                Status ++
                " ;; esac\necho started >>" ++ Asked ++ "; exec sleep 600\n",
            Dir
        )
    end,
    ok = Answer("0"),
    ?assertEqual({0, ""}, robot("two", "reload switch 5000", Place)),
    ?assertEqual({"two", "one"}, {link("current", Place), link("previous", Place)}),
    ?assertEqual({0, "one\n"}, robot("two", "reload back 1", Place)),
    ?assertEqual({"one", none}, {link("current", Place), link("previous", Place)}),
    Releases = filename:join(maps:get(base, Place), "releases"),
    ?assertEqual(
        " reload switch " ++ Releases ++ "/two 5000\n reload back " ++ Releases ++ "/one 1\n",
        text(Asked)
    ),
    ?assertEqual({0, ""}, robot("two", "reload back 1", Place)),
    {0, ""} = robot("two", "reload switch 5000", Place),
    ok = Answer("1"),
    ?assertEqual({0, "one\n"}, robot("two", "reload back 1", Place)),
    ?assertEqual({"one", none}, {link("current", Place), link("previous", Place)}),
    ?assert(filelib:is_regular(state("daemon", Place))).

text(File) ->
    {ok, Text} = file:read_file(File),
    binary_to_list(Text).

%% The node kills itself when it starts.
signalled(#{dir := Dir} = Place) ->
    ok = erlang_is("kill -KILL $$\n", Dir),
    Port = open_port({spawn_executable, "/bin/sh"}, [
        {args, ["-c", "exec " ++ line("one", "daemon", Place)]}, {line, 200}, stderr_to_stdout
    ]),
    {os_pid, Pid} = erlang:port_info(Port, os_pid),
    ?assertEqual(
        "robot 2: its node was ended by signal KILL; was there no memory left?", said(Port)
    ),
    _ = os:cmd("kill -TERM " ++ integer_to_list(Pid)).

said(Port) ->
    receive
        {Port, {data, {eol, "robot 2: " ++ _ = Line}}} -> Line;
        {Port, {data, _}} -> said(Port)
    end.

rotated(Place) ->
    Small = binary:copy(<<"a line\n">>, 1000),
    ok = file:write_file(state("log", Place), Small),
    {0, ""} = robot("one", "rotate", Place),
    ?assertEqual({ok, Small}, file:read_file(state("log", Place))),
    Large = binary:copy(<<"a line\n">>, 600_000),
    ok = file:write_file(state("log", Place), Large),
    {0, ""} = robot("one", "rotate", Place),
    ?assertEqual({ok, <<>>}, file:read_file(state("log", Place))),
    ?assertEqual({ok, Large}, file:read_file(state("log.1", Place))).

%% Just switched on: the third answer is yes.
set_clock(#{dir := Dir} = Place) ->
    Asked = filename:join(Dir, "asked"),
    ok = program(
        "timedatectl",
        "echo >>" ++ Asked ++ "\n[ $(wc -l <" ++ Asked ++ ") -lt 3 ] && echo no || echo yes\n",
        Dir
    ),
    ok = program("sleep", "", Dir),
    ?assertEqual({0, ""}, clock("20.42 31.00\n", Place)),
    ?assertEqual({ok, <<"\n\n\n">>}, file:read_file(Asked)).

unset_clock(#{dir := Dir} = Place) ->
    ok = program("timedatectl", "echo no\n", Dir),
    Line = "robot 2: the network has not set this computer's clock; starting all the same\n",
    ?assertEqual({0, Line}, clock("120.00 31.00\n", Place)).

clock(Uptime, #{dir := Dir} = Place) ->
    File = filename:join(Dir, "uptime"),
    ok = file:write_file(File, Uptime),
    run("env STARL_UPTIME=" ++ File ++ " " ++ line("one", "clock", Place)).

%% -- a place --------------------------------------------------------------------------------

%% Robot 2 of the fleet lab, with two releases. Erlang is a program that gives no answers.
place() ->
    Dir = "/tmp/starl-robot-" ++ os:getpid() ++ integer_to_list(erlang:unique_integer([positive])),
    Base = filename:join(Dir, "lab/robot-2"),
    Place = #{dir => Dir, base => Base},
    lists:foreach(fun(Name) -> released(Name, Base) end, ["one", "two"]),
    ok = filelib:ensure_path(state("", Place)),
    ok = file:write_file(filename:join(Base, "service"), "plain\n"),
    ok = file:make_symlink("releases/one", filename:join(Base, "current")),
    ok = erlang_is(
        "case $* in *starl_fleet_ask*) echo no answer; exit 3 ;; esac\nexec sleep 600\n", Dir
    ),
    Place.

released(Name, Base) ->
    Program = filename:join([Base, "releases", Name, "bin/robot"]),
    ok = filelib:ensure_dir(Program),
    {ok, _} = file:copy(filename:join(code:priv_dir(starl_fleet), "robot"), Program),
    ok = file:change_mode(Program, 8#755),
    ok = file:write_file(filename:join([Base, "releases", Name, "vm.args"]), "").

erlang_is(Script, Dir) -> program("erl", Script, Dir).

program(Name, Script, Dir) ->
    File = filename:join([Dir, "bin", Name]),
    ok = filelib:ensure_dir(File),
    ok = file:write_file(File, ["#!/bin/sh\n", Script]),
    file:change_mode(File, 8#755).

gone(#{dir := Dir} = Place) ->
    _ = robot("one", "stop", Place),
    ok = file:del_dir_r(Dir).

state(Name, #{base := Base}) -> filename:join([Base, "state", Name]).

link(Name, #{base := Base}) ->
    case file:read_link(filename:join(Base, Name)) of
        {ok, Release} -> filename:basename(Release);
        {error, enoent} -> none
    end.

robot(Release, Words, Place) -> run(line(Release, Words, Place)).

line(Release, Words, #{dir := Dir, base := Base}) ->
    "env PATH=" ++ Dir ++ "/bin:$PATH " ++ Base ++ "/releases/" ++ Release ++ "/bin/robot " ++
        Words.

run(Line) ->
    Said = os:cmd("{ " ++ Line ++ "; } 2>&1; echo \" $?\""),
    [Text, Status] = string:split(Said, " ", trailing),
    {list_to_integer(string:trim(Status)), Text}.
