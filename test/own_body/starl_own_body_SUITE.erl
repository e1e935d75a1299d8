%% A chassis of the user's own, as a user starts it: the examples, and a program that is struck while its
%% robot works.
-module(starl_own_body_SUITE).
-include_lib("stdlib/include/assert.hrl").

-export([suite/0, all/0, init_per_testcase/2, end_per_testcase/2]).
-export([the_examples_keep_the_contract/1, a_bad_chassis_is_told/1, mistakes/1]).
-export([bodies_paint/1, on_nodes/1, in_virtual_time/1]).
-export([a_killed_body/1, a_hung_body/1, a_body_that_talks_nonsense/1, a_body_that_is_given_up/1]).

-define(LIVE, " --live --no-record --chassis ").

suite() -> [{timetrap, {minutes, 4}}].

all() ->
    [
        the_examples_keep_the_contract,
        a_bad_chassis_is_told,
        mistakes,
        bodies_paint,
        on_nodes,
        in_virtual_time,
        a_killed_body,
        a_hung_body,
        a_body_that_talks_nonsense,
        a_body_that_is_given_up
    ].

init_per_testcase(_Case, Config) ->
    case os:find_executable("python3") of
        false -> {skip, "needs python3"};
        _ -> Config
    end.

end_per_testcase(_Case, _Config) -> ok.

%% Also where the robot at the other end of its datagrams hears each of them late.
the_examples_keep_the_contract(Config) ->
    [
        begin
            {0, Text} = sh(["$starl chassis check ", Chassis], Config),
            ?assertEqual(nomatch, string:find(Text, "broken")),
            says("ok      leg ", Text)
        end
     || Chassis <- ["exec:./my_robot.py", "late/two_wheels.erl"]
    ].

%% One that drives on, answers at once, and does not end with its input.
%% Holds: `chassis check` finds a chassis that drives on, answers too early, or outlives its input
%% Red: the chassis of the test
a_bad_chassis_is_told(Config) ->
    {3, Text} = sh("$starl chassis check exec:./drives_on.py", Config),
    [
        says(["broken  ", Clause, " "], Text)
     || Clause <- ["leg", "leg_stands", "stops", "input"]
    ].

mistakes(Config) ->
    [
        begin
            {2, Text} = sh(Line, Config),
            says([Told, "\n"], Text)
        end
     || {Line, Told} <- [
            {
                "$starl run line_up.erl" ?LIVE "exec:./nobody",
                "/own/nobody: there is no such program"
            },
            {"$starl run line_up.erl --live --pace 2 --chassis exec:./my_robot.py",
                "run: chassis: an emulated Create, or a chassis of your own, runs in real time only: "
                "leave --pace and --speed of the cluster at 1"},
            {
                "$starl run line_up.erl" ?LIVE "no_chassis.erl",
                "run: --chassis: no_chassis.erl:1: actuate/4 is missing; a chassis exports "
                "actuate/4, close/1, drive/4, hear/2, open/1, stop/1"
            },
            {
                "$starl run line_up.erl" ?LIVE "wrong.erl",
                "run: --chassis: wrong.erl:2: syntax error before: '.'"
            },
            {
                "$starl run line_up.erl" ?LIVE "'{\"two_wheels.erl\", #{pott => 1}}'",
                "run: --chassis: two_wheels.erl:11: unknown key pott (did you mean port?)"
            },
            {"$starl chassis check my_robot.py",
                "starl: chassis: my_robot.py is no chassis of your own: FILE.erl, or exec:PROGRAM"}
        ]
    ].

%% -- runs -----------------------------------------------------------------------------------

bodies_paint(Config) ->
    {0, Text} = sh(
        "$starl run painting --picture mini.svg --robots 2" ?LIVE "exec:./my_robot.py", Config
    ),
    says("painting: complete, 100 % of the lines painted, 2 robots", Text).

on_nodes(Config) ->
    {0, Text} = sh("$starl cluster line_up.erl --robots 2 --chassis exec:./my_robot.py", Config),
    says("line_up: complete, 2 robots", Text),
    %% a node that is killed takes its program with it; the robot rejoins with another
    {0, Killed} = sh(
        %% the name of its socket must be short
        "export XDG_CACHE_HOME=$(mktemp -d); n=0\n"
        "$starl cluster painting --picture mini.svg --robots 2 --chassis exec:./my_robot.py &\n"
        "until [ $n -gt 50 ] || $starl cluster kill 1 2>&1 | grep -q done; do n=$((n+1)); done\n"
        "wait $!; status=$?; rm -r \"$XDG_CACHE_HOME\"; [ $n -le 50 ] && exit $status",
        Config
    ),
    says("painting: complete, 100 % of the lines painted, 2 robots", Killed).

%% There it has two wheels; the program does not even start.
in_virtual_time(Config) ->
    {0, Text} = sh("$starl run line_up.erl --robots 2 --chassis exec:./nobody", Config),
    says("line_up: complete, 2 robots", Text).

%% -- bodies that are struck -----------------------------------------------------------------

a_killed_body(Config) ->
    struck("killed", "(was killed by signal 9|has ended, or reads no more)", Config).

%% Holds: A body that hangs is not judged as a computer that stood still
%% Red: without `rest`, run: *not judged ... the computer stood still*
a_hung_body(Config) -> struck("hung", "has said nothing for 1000 ms: it hangs", Config).

a_body_that_talks_nonsense(Config) -> struck("nonsense", "says nonsense: no JSON: What[?]", Config).

%% One line tells, and the run goes on to its end.
struck(How, Line, Config) ->
    Run = ["STRUCK=", How, " $starl run line_up.erl --robots 2" ?LIVE "exec:./struck.py"],
    {0, Text} = sh(Run, Config),
    Told = re:run(Text, "robot 1: struck.py " ++ Line ++ "; the robot starts anew", [
        global, {capture, first}
    ]),
    ?assertMatch({{match, [[_]]}, _}, {Told, Text}),
    says("line_up: complete, 2 robots", Text).

%% A program that ends each time: the other robots go on, and the run ends with its report.
%% Holds: A robot whose body ends each time is given up, and the run ends with its report
%% Red: 073438b3, read: nothing is said, and the run waits for its time
a_body_that_is_given_up(Config) ->
    {Status, Text} = sh(
        "STRUCK=always $starl run line_up.erl --robots 2 --time 40" ?LIVE "exec:./struck.py",
        Config
    ),
    ?assertEqual({4, Text}, {Status, Text}),
    says("robot 1 has started anew too often, and is given up", Text).

%% -- helpers --------------------------------------------------------------------------------

%% In a directory with the examples and the programs of this suite.
sh(Line, Config) ->
    Dir = filename:join(proplists:get_value(priv_dir, Config), "own"),
    Examples = filename:join(starl_first_hour_ct:root(), "examples"),
    ok = filelib:ensure_path(Dir),
    [
        {ok, _} = file:copy(
            filename:join(Examples, File), filename:join(Dir, filename:basename(File))
        )
     || File <- [
            "line_up.erl",
            "own_body/my_robot.py",
            "own_body/two_wheels.erl",
            "own_body/two_wheels_robot.erl"
        ]
    ],
    [starl_first_hour_ct:write(filename:join(Dir, Name), Text) || {Name, Text} <- files()],
    ok = late(Dir),
    [
        ok = file:change_mode(filename:join(Dir, Name), 8#755)
     || Name <- ["my_robot.py", "struck.py", "drives_on.py"]
    ],
    starl_first_hour_ct:sh(lists:flatten(Line), Dir).

%% The example whose robot hears each datagram 80 ms late.
late(Dir) ->
    [Driver, Robot] = ["two_wheels.erl", "two_wheels_robot.erl"],
    ok = filelib:ensure_path(filename:join(Dir, "late")),
    {ok, _} = file:copy(filename:join(Dir, Driver), filename:join([Dir, "late", Driver])),
    {ok, Text} = file:read_file(filename:join(Dir, Robot)),
    [Before, After] = string:split(Text, "Now = now_us(),"),
    Heard = "Now = receive after 80 -> now_us() end,",
    file:write_file(filename:join([Dir, "late", Robot]), [Before, Heard, After]).

says(Part, Text) -> starl_first_hour_ct:contains(lists:flatten(Part), Text).

files() ->
    [
        {"mini.svg",
            "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 200 100\">"
            "<path fill=\"none\" stroke=\"#c00\" d=\"M20 20 L60 20\"/>"
            "<path fill=\"none\" stroke=\"#00c\" d=\"M120 80 L160 80\"/></svg>"},
        {"no_chassis.erl", "-module(no_chassis).\n-export([open/1]).\nopen(_) -> {ok, s}.\n"},
        {"wrong.erl", "-module(wrong).\nopen(_) -> {ok, s.\n"},
        {"struck.py", struck_program()},
        {"drives_on.py", drives_on()}
    ].

%% Robot 1's program is struck once, two seconds after it is told to drive; it is the one of the example.
struck_program() ->
    "#!/usr/bin/env python3\n"
    "import os, signal, sys, threading, time\n"
    "how, mark = os.environ['STRUCK'], 'struck-' + str(os.getppid())\n"
    "first = sys.stdin.buffer.raw.readline()\n"
    "def strike():\n"
    "    time.sleep(1)\n"
    "    if how == 'nonsense':\n"
    "        for n in range(50): os.write(1, b'What?\\n')\n"
    "        time.sleep(60)\n"
    "    os.kill(os.getpid(), signal.SIGSTOP if how == 'hung' else signal.SIGKILL)\n"
    "if b'\"robot\":1' in first and b'\"at\"' in first:\n"
    "    if how == 'always' or not os.path.exists(mark):\n"
    "        open(mark, 'w').close()\n"
    "        threading.Thread(target=strike, daemon=True).start()\n"
    "exec(open('my_robot.py').read())\n".

%% It says at once that it is done, and never stands.
drives_on() ->
    "#!/usr/bin/env python3\n"
    "import json, os, select, sys, time\n"
    "def say(**m):\n"
    "    try: os.write(1, json.dumps(m).encode() + b'\\n')\n"
    "    except OSError: pass\n"
    "say(op='hello', protocol=1, name='b', vmax=500, wmax=5)\n"
    "begun = time.time()\n"
    "while True:\n"
    "    ready, _, _ = select.select([0], [], [], 0.05)\n"
    "    say(op='pose', x=100 * (time.time() - begun), y=0, th=0)\n"
    "    line = sys.stdin.buffer.raw.readline() if ready else b''\n"
    "    if line:\n"
    "        m = json.loads(line)\n"
    "        if m['op'] == 'drive': say(op='ack', id=m['id']); say(op='done', id=m['id'])\n".
