%% An application that goes wrong: whoever makes a mistake is told where, at once and in one line.
%% Each case runs the command line as a user would.
-module(starl_first_hour_app_SUITE).
-include_lib("stdlib/include/assert.hrl").

-export([suite/0, all/0, init_per_testcase/2, end_per_testcase/2]).
-export([own_applications_are_listed/1]).
-export([mistakes_are_told_before_the_run/1, first_crash_is_told_once/1, log_has_each_cause_once/1]).
-export([crashes_now_and_then_go_on/1, a_killed_robot_is_one_line/1, waiting_robots_are_told/1]).
-export([an_endless_loop_is_told_and_interrupted/1, a_loop_without_a_process_is_told/1]).
-export([a_mistake_at_the_prompt_ends_nothing/1]).

suite() -> [{timetrap, {minutes, 2}}].

all() ->
    [
        own_applications_are_listed,
        mistakes_are_told_before_the_run,
        first_crash_is_told_once,
        log_has_each_cause_once,
        crashes_now_and_then_go_on,
        a_killed_robot_is_one_line,
        waiting_robots_are_told,
        an_endless_loop_is_told_and_interrupted,
        a_loop_without_a_process_is_told,
        a_mistake_at_the_prompt_ends_nothing
    ].

init_per_testcase(Case, Config) ->
    Dir = filename:join(proplists:get_value(priv_dir, Config), atom_to_list(Case)),
    ok = filelib:ensure_path(Dir),
    {ok, Before} = file:get_cwd(),
    ok = file:set_cwd(Dir),
    [{before, Before} | Config].

end_per_testcase(_Case, Config) -> file:set_cwd(proplists:get_value(before, Config)).

%% What a user runs is listed first, by the word that runs it.
own_applications_are_listed(_) ->
    Lines = ["%% Waits.\n", "-module(idle).\n", "-behaviour(starl_app).\n"],
    Files = ["idle.erl", "src/idle.erl", "team/idle.erl"],
    [ok = filelib:ensure_dir(File) || File <- Files],
    [ok = file:write_file(File, Lines) || File <- Files],
    ok = file:write_file("other.erl", "-module(other).\n"),
    Listed = lists:sublist(starl_cli_target:purposes(), 3),
    ?assertEqual(["idle.erl", "idle", "team"], [Word || {Word, _} <- Listed]),
    ?assertEqual(
        ["Waits."], lists:usort([unicode:characters_to_list(Told) || {_, Told} <- Listed])
    ).

%% The line on each, and the whole output and the exit status of one.
mistakes_are_told_before_the_run(_) ->
    Bad = ["-module(my_app).\n" | declares("blocks/0", "blocks() -> [election].\n")],
    ?assertEqual({2, "starl: run: " ++ refused(Bad) ++ "\n"}, run(Bad, [])),
    [
        ?assertEqual("my_app.erl:" ++ Told, refused(["-module(my_app).\n" | Lines]))
     || {Lines, Told} <- [
            {
                ["-export([init/2, step/2]).\n", "init(_, _) -> s.\n", "step(_, S) -> {done, S.\n"],
                "4: syntax error before: '.'"
            },
            {
                ["-behaviour(starl_app).\n", "-export([init/2]).\n", "init(_, _) -> s.\n"],
                "2: step/2 is missing; an application exports init/2 and step/2"
            },
            {
                ["-behaviour(starl_app).\n", "-export([step/2]).\n", "step(_, S) -> {done, S}.\n"],
                "2: init/2 is missing; an application exports init/2 and step/2"
            },
            {
                declares("blocks/0", "blocks() -> [election].\n"),
                "3: blocks/0: election is no building block: there is no such module "
                "(did you mean starl_election?)"
            },
            {
                declares("blocks/0", "blocks() -> [starl_electon:block()].\n"),
                "3: blocks/0: there is no module starl_electon (did you mean starl_election?)"
            },
            {
                declares("blocks/0", "blocks() -> starl_election.\n"),
                "3: blocks/0: a list of building blocks expected, not starl_election"
            },
            {
                declares("options/0", "options() -> [{places, 5, \"number\"}].\n"),
                "3: options/0: an option is {Key, Type, Default, \"Doc\"}, not "
                "{places,5,\"number\"}"
            },
            {
                declares("options/0", "options() -> [{robots, {integer, 1, 9}, 5, \"\"}].\n"),
                "3: options/0: the key robots is taken already"
            },
            {
                declares("scene/1", "scene(_) -> #{app => {sequential, ?MODULE, none}}.\n"),
                "3: scene/1: {ok, #{app => ...}} or {error, \"Why\"} expected, not "
                "#{app => {sequential,my_app,none}}"
            },
            {
                declares("scene/1", scene(", waypoint => #{}")),
                "3: scene/1: the scene has no key waypoint (did you mean waypoints?)"
            },
            {
                declares("scene/1", scene(", profile => #{sped => 3}")),
                "3: scene/1: the profile has no key sped (did you mean speed?)"
            },
            {
                declares("scene/1", scene(", waypoints => #{home => 1000}")),
                "3: scene/1: waypoints: #{Name => {X, Y}} expected, not #{home => 1000}"
            }
        ]
    ].

refused(Lines) ->
    ok = file:write_file("my_app.erl", Lines),
    Line =
        case starl_cli_source:load("my_app.erl") of
            {error, [Only]} ->
                Only;
            {ok, #{app := App}} ->
                {error, Reason} = starl_sim:start(#{app => App}),
                starl_sim:format_error(Reason)
        end,
    unicode:characters_to_list(Line).

declares(Function, Text) ->
    ["-export([init/2, step/2, ", Function, "]).\n", Text, "init(_, _) -> s.\n", done()].

done() -> "step(_, S) -> {done, S}.\n".

scene(More) -> ["scene(_) -> {ok, #{app => {sequential, ?MODULE, none}", More, "}}.\n"].

%% The line on the first crash comes first; the summary counts the others. Twenty equal crashes end
%% the application of a robot, and with the last one the run.
first_crash_is_told_once(_) ->
    [
        begin
            {4, Text} = run(app(Init, Step), ["--robots", "3", "--out", "o"]),
            [First, Head, Crashes | _] = string:split(Text, "\n", all),
            ?assertEqual("starl: my_app.erl:" ++ Told, First),
            contains("NOT COMPLETE (the application crashed for ever on robots 1-3)", Head),
            ?assertEqual(
                "  the application crashed " ++ Times ++ " times, each time as told above", Crashes
            ),
            ?assertEqual(1, length(string:split(Text, Told, all)) - 1),
            {ok, Json} = file:read_file("o/report.json"),
            contains("\"application_crashes\": " ++ Times, binary_to_list(Json)),
            ok = file:del_dir_r("o")
        end
     || {Times, Init, Step, Told} <- [
            {"60", "s", "{next, s}",
                "4: my_app:step/2: step/2 returned {next,s}; it returns {continue, State} or "
                "{done, Result} (robot 1, 0.000000 s)"},
            {"60", "maps:get(place, binary_to_term(term_to_binary(#{})))", "{done, s}",
                "3: my_app:init/2: the map has no key place (robot 1, 0.000000 s)"},
            {"60", "s", "{done, starl:goto(R, {1.0, 2.0})}",
                "4: my_app:step/2: there is no function starl:goto/2 (did you mean go_to?) "
                "(robot 1, 0.000000 s)"},
            {"60", "s", "{done, starl_election:elect(R, first)}",
                "4: my_app:step/2: this robot has no machine election; list its block: "
                "blocks() -> [starl_election] (robot 1, 0.000000 s)"},
            {"9", "s", "starl:id(R) > 0 andalso {continue, s}",
                "4: my_app:step/2: step/2 lets no time pass: 100000 actions and steps in one "
                "moment; starl:sleep(Robot, Ms) lets it pass (robot 1, 0.000000 s)"}
        ]
    ].

app(Init, Step) ->
    [
        "-module(my_app).\n-export([init/2, step/2]).\n",
        ["init(_R, _) -> ", Init, ".\n"],
        ["step(R, _S) -> _ = starl:id(R), ", Step, ".\n"]
    ].

%% Time passes between these crashes; the log counts them, whichever robot they are of.
log_has_each_cause_once(_) ->
    {4, _} = run(
        app("s", "ok = starl:sleep(R, 100), {done, maps:get(starl:id(R) rem 2, #{})}"),
        ["--robots", "4", "--out", "o"]
    ),
    {ok, Log} = file:read_file("o/run.log"),
    Lines = string:lexemes(binary_to_list(Log), "\n"),
    ?assertEqual(2, length([L || L <- Lines, string:find(L, "has no key") =/= nomatch])),
    ?assertEqual(2, length([L || L <- Lines, string:find(L, "(40 times in all)") =/= nomatch])),
    ?assertEqual(3, length(Lines)).

%% An application that comes further in some of its lives is restarted as often as before.
crashes_now_and_then_go_on(_) ->
    Step =
        "ok = starl:sleep(R, 100), Now = starl:now(R), "
        "case erlang:phash2(Now div 100, 3) of 0 -> error(now_and_then); "
        "_ when Now > 20000 -> {done, s}; _ -> {continue, s} end",
    {0, Text} = run(app("s", Step), ["--clock-offset", "0", "--out", "o"]),
    contains("my_app: complete", Text),
    contains("the application crashed ", Text).

%% Not one for each process of the robot.
a_killed_robot_is_one_line(_) ->
    Faults = "[{a,1000,1000,kill_robot,1,#{}}]",
    {4, _} = run(app("s", "ok = starl:sleep(R, 5000), {done, s}"), [
        "--faults", Faults, "--out", "o"
    ]),
    {ok, Log} = file:read_file("o/run.log"),
    ?assertEqual(<<"robot 1, 1.000000 s: killed: by a fault\n">>, Log).

%% Call and line, and the robots together that wait in one place.
waiting_robots_are_told(_) ->
    Step =
        "case starl:id(R) of 1 -> {starl:sleep(R, 90000)}; 2 -> {done, ok};\n"
        "_ -> {done, starl:await(R, place)} end",
    {4, Text} = run(app("s", Step), ["--robots", "5", "--time", "60", "--out", "o"]),
    contains("\n  waits: robot 1: starl:sleep, my_app.erl:4\n", Text),
    contains("\n  waits: robots 3-5: starl:await(place), my_app.erl:5\n", Text),
    {ok, Json} = file:read_file("o/report.json"),
    contains("\"robots 3-5: starl:await(place), my_app.erl:5\"", binary_to_list(Json)).

%% Told without being asked, and ended by Ctrl-C, whatever the robots do.
an_endless_loop_is_told_and_interrupted(_) ->
    Step = "ok = starl:sleep(R, 100), starl:id(R) =:= 2 andalso forever(R), {done, s}",
    Text = interrupted([app("s", Step), "forever(R) ->\n    forever(R).\n"], ["--shards", "2"]),
    contains("my_app.erl:5: robot 2 at work for ", Text),
    contains("Calls: my_app:forever/1 (my_app.erl:5)", Text),
    contains("interrupted; no results: robot 2 did not end its step at my_app.erl:5", Text).

%% A machine without a process holds up its shard.
a_loop_without_a_process_is_told(_) ->
    Machine = [
        "-module(my_app).\n-export([scene/1, init/1, handle_event/5]).\n",
        "scene(_) -> {ok, #{app => {machine, ?MODULE, #{}}}}.\n",
        "init(_) -> {s, 0, [{{timeout, t}, 100000, go}]}.\n",
        "handle_event(_, _, _, N, _) ->\n    handle_event(a, b, c, N + 1, e).\n"
    ],
    Text = interrupted(Machine, ["--mode", "inline", "--shards", "2", "--robots", "1"]),
    contains("my_app.erl:6: a machine of a robot at work for ", Text),
    contains("interrupted; no results: a machine of a robot did not end its step", Text).

interrupted(Lines, Args) ->
    ok = file:write_file("my_app.erl", Lines),
    Port = starl_cli_vm:start(["run", "my_app.erl", "--out", "o" | Args]),
    Text = starl_cli_vm:until("endless loop?", Port, ""),
    ok = starl_cli_vm:interrupt(Port),
    {130, Whole} = starl_cli_vm:rest(Port, Text),
    Whole.

a_mistake_at_the_prompt_ends_nothing(_) ->
    Input = [
        "{ok, Sim} = starl_sim:start(painting), started.\n",
        "1 = 2.\n",
        "maps:get(now_us, starl_sim:run(Sim, 6)).\n",
        "starl_sim:start(#{robots => 3}).\n"
    ],
    ok = file:write_file("input", Input),
    Starl = filename:join(starl_first_hour_ct:root(), "starl"),
    {ok, Here} = file:get_cwd(),
    {0, Text} = starl_first_hour_ct:sh("\"" ++ Starl ++ "\" shell <input", Here),
    contains("no match of right hand side value 2", Text),
    contains("6000000", Text),
    contains("{error,{no_app,\"#{app => painting, robots => 3}\"}}", Text).

run(Lines, Args) ->
    ok = file:write_file("my_app.erl", Lines),
    starl_cli_vm:rest(starl_cli_vm:start(["run", "my_app.erl" | Args]), "").

contains(Part, Text) ->
    ?assertNotEqual({Part, nomatch, Text}, {Part, string:find(Text, Part), Text}).
