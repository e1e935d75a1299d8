%% The command line as its user meets it: a VM of its own, its exit status and what it prints.
-module(starl_cli_tests).
-include_lib("eunit/include/eunit.hrl").

-export([breaker/0, endless/0]).

-import(starl_cli_vm, [says/3, contains/2, start/1, rest/2, until/3, in_directory/1]).

-define(PATIENCE_S, 60).

commands_test_() ->
    patient([
        {"nothing", fun() -> says(0, "Usage:", []) end},
        {"--help", fun() -> says(0, "Usage:", ["--help"]) end},
        {"--version", fun() -> says(0, ", code ", ["--version"]) end},
        {"apps", fun() -> says(0, "painting", ["apps"]) end},
        {"unknown command", fun() -> says(2, "starl: unknown command rnu (did you", ["rnu"]) end},
        {"bad value", fun() ->
            says(2, "starl: run: --loss: ", ["run", "painting", "--loss", "2"])
        end},
        {"no picture", fun() -> says(2, "starl: ", ["run", "painting", "--picture", "no.svg"]) end},
        {"bad table", fun() -> says(2, "starl: table: ", ["table", "--seeds", "0"]) end},
        {"bad bench", fun() -> says(2, "starl: bench: ", ["bench", "ring", "--reps", "x"]) end},
        {"no such picture", fun() ->
            says(2, "starl: bench: cannot read ", ["bench", "painting", "--pictures", "nope"])
        end},
        {"no such bench", fun() -> says(2, "did you mean swarm?", ["bench", "swrm"]) end},
        {"help of one bench", fun() ->
            Text = says(0, "events: timers", ["bench", "events", "--help"]),
            ?assertEqual(nomatch, string:find(Text, "dpp: "))
        end}
    ]).

%% A limit of a group is none of its tests'.
patient(Tests) -> [{Title, {timeout, ?PATIENCE_S, Test}} || {Title, Test} <- Tests].

%% A run writes all its files, and its scenario replays it to the same digest.
run_and_replay_test_() ->
    {timeout, ?PATIENCE_S, fun() ->
        in_directory(fun(Dir) ->
            One = filename:join(Dir, "one"),
            Two = filename:join(Dir, "two"),
            says(0, "complete, 100 %", ["run", "painting", "--seed", "3", "--out", One]),
            Missing = [
                Name
             || Name <- ["report.txt", "report.json", "scenario.term", "painting.svg"],
                not filelib:is_regular(filename:join(One, Name))
            ],
            ?assertEqual([], Missing),
            Replay = ["run", filename:join(One, "scenario.term"), "--out", Two, "--quiet"],
            says(0, "result: ", Replay),
            ?assertEqual(digest(One), digest(Two))
        end)
    end}.

%% What --print-scenario prints is a scenario file that runs to the same digest; nothing is run.
printed_scenario_test_() ->
    {timeout, ?PATIENCE_S, fun() ->
        in_directory(fun(Dir) ->
            [One, Two, File] = [filename:join(Dir, Name) || Name <- ["one", "two", "a.term"]],
            Args = [
                "run",
                "painting",
                "--picture",
                "lines",
                "--robots",
                "6",
                "--seed",
                "3",
                "--loss",
                "0.1",
                "--delay",
                "5..50",
                "--out",
                One
            ],
            Text = says(0, "app => painting", Args ++ ["--print-scenario"]),
            ?assertEqual({ok, []}, file:list_dir(Dir)),
            ok = file:write_file(File, Text),
            says(0, "result: ", Args ++ ["--quiet"]),
            says(0, "result: ", ["run", File, "--quiet", "--out", Two]),
            ?assertEqual(digest(One), digest(Two)),
            ?assertEqual(Text, says(0, "", ["run", File, "--print-scenario"]))
        end)
    end}.

not_complete_test_() ->
    {timeout, ?PATIENCE_S, fun() ->
        in_directory(fun(Dir) ->
            Args = ["run", "painting", "--time", "20", "--quiet", "--out", filename:join(Dir, "x")],
            says(4, "NOT COMPLETE", Args)
        end)
    end}.

%% An application that breaks the contract it is held to.
violation_test_() ->
    {timeout, ?PATIENCE_S, fun() ->
        in_directory(fun(Dir) ->
            File = filename:join(Dir, "starl_cli_breaker.erl"),
            ok = file:write_file(File, breaker()),
            Out = filename:join(Dir, "out"),
            Text = says(3, "sanity broken at ", ["run", File, "--robots", "2", "--out", Out]),
            contains("A CONTRACT IS VIOLATED", Text),
            contains("replay: ./starl run " ++ File ++ " --robots 2 --seed 1", Text),
            ?assert(filelib:is_regular(filename:join(Out, "report.json")))
        end)
    end}.

%% The first Ctrl-C, as the script sends it on, and the signals of service managers and of a terminal that is
%% closed: results so far, and 130.
interrupt_test_() ->
    {timeout, 4 * ?PATIENCE_S, [
        fun() -> interrupted(By) end
     || By <- [["USR1"], ["TERM"], ["HUP", "USR1"]]
    ]}.

interrupted(Signals) ->
    in_directory(fun(Dir) ->
        File = filename:join(Dir, "starl_cli_endless.erl"),
        ok = file:write_file(File, endless()),
        Out = filename:join(Dir, "out"),
        Port = start(["run", File, "--time", "1000000", "--out", Out]),
        Begun = until("ready", Port, ""),
        [ok = starl_cli_vm:signal(Signal, Port) || Signal <- Signals],
        {Status, Text} = rest(Port, Begun),
        ?assertEqual({130, Text}, {Status, Text}),
        contains("interrupted", Text),
        ?assert(filelib:is_regular(filename:join(Out, "report.json")))
    end).

breaker() ->
    "-module(starl_cli_breaker).\n"
    "-export([scene/1, init/1, init/2, step/2, finish/2]).\n"
    "scene(_) -> {ok, #{app => {sequential, ?MODULE, none}, monitors => [{?MODULE, #{}}]}}.\n"
    "init(#{}) -> none.\n"
    "init(_, none) -> 0.\n"
    "step(_, N) when is_integer(N) -> {done, N};\n"
    "step({T, R, _, _}, none) ->\n"
    "    {violation, #{contract => sanity, what => lost, at_us => T, robots => [R],\n"
    "        details => #{}}, none}.\n"
    "finish(_, none) -> {ok, #{}}.\n".

endless() ->
    "-module(starl_cli_endless).\n"
    "-export([init/2, step/2]).\n"
    "init(_, _) -> 0.\n"
    "step(R, N) -> N =:= 1000 andalso io:put_chars(\"ready\\n\"),\n"
    "    starl:sleep(R, 10), {continue, N + 1}.\n".

digest(Dir) ->
    {ok, Json} = file:read_file(filename:join(Dir, "report.json")),
    {match, [Digest]} = re:run(Json, "\"digest\": \"([0-9a-f]+)\"", [{capture, [1], list}]),
    Digest.
