%% The README's example in real time, and on nodes of its own, as a user starts them.
-module(starl_first_hour_live_SUITE).
-include_lib("stdlib/include/assert.hrl").

-export([suite/0, all/0]).
-export([in_one_vm/1, on_nodes/1, commands_without_a_cluster/1, mistakes/1, one_schedule/1]).

suite() -> [{timetrap, {minutes, 5}}].

all() -> [in_one_vm, on_nodes, commands_without_a_cluster, mistakes, one_schedule].

%% It ends as in the simulator, with the same files.
in_one_vm(Config) ->
    {0, Text} = sh("$starl run line_up.erl --live --pace 10 --robots 3", Config),
    says("line_up: complete, 3 robots", Text),
    wrote(["report.json", "report.txt", "results.term", "trajectories.csv", "ways.svg"], Config).

on_nodes(Config) ->
    lists:foreach(
        fun(Transport) ->
            Line = "$starl cluster line_up.erl --speed 10 --robots 2 --loss 0.1",
            {0, Text} = sh([Line, " --transport ", Transport], Config),
            says("line_up: complete, 2 robots", Text)
        end,
        ["dist", "udp"]
    ).

commands_without_a_cluster(Config) ->
    {2, Text} = sh("XDG_CACHE_HOME=\"$PWD\" $starl cluster status", Config),
    says("no cluster runs; start one first", Text).

mistakes(Config) ->
    {2, Drawn} = sh("$starl run painting --live --random-faults '[all]'", Config),
    says("--random-faults: drawn faults need the simulator", Drawn),
    {2, Faults} = sh(
        "$starl run painting --live --faults '[{a,1,2,clock_step,1,#{ms=>3}},{b,1,2,pause,1,#{}}]'",
        Config
    ),
    says("--faults: fault a: clock_step cannot be played in real time: take the simulator", Faults),
    says("--faults: fault b: pause needs a node for each robot: take ", Faults),
    {2, Transport} = sh("$starl cluster painting --transport pigeon", Config),
    says("--transport", Transport),
    {2, Unknown} = sh("$starl cluster paintin", Config),
    says("did you mean painting", Unknown).

%% One file of faults in the simulator, in one VM and on nodes: each run ends with a verdict, which that
%% on its recording is, too; recordings tell of the same faults, none before its time. What was played is
%% a file again.
%% Holds: One file of faults is played in the simulator, in one VM and on nodes; recordings tell
%% the same faults, and each is judged as its run was
%% Red: 133c6985, by its code: `--faults` with `--live` was refused
one_schedule(Config) ->
    Schedule = [
        {slow, 500, 2500, delay, 1, #{extra_ms => 50}},
        {apart, 1000, 3000, partition, [1], #{}},
        {blind, 1000, 3000, location_frozen, 2, #{}},
        {crash, 2000, 2000, kill_machine, {2, sap}, #{}},
        {away, 4000, 5000, reboot, 3, #{}}
    ],
    {0, _} = sh("rm -rf one && mkdir one", Config),
    Dir = filename:join(proplists:get_value(priv_dir, Config), "live"),
    Text = io_lib:format("~0tp.~n", [Schedule]),
    ok = file:write_file(filename:join([Dir, "one", "faults.term"]), Text),
    App = " exercise --block counter --robots 3 --work 8 --faults one/",
    Told = [
        begin
            Out = filename:join("one", World),
            {0, _} = sh(["$starl ", Command, App, "faults.term --quiet --out ", Out], Config),
            {0, Verdict} = sh(["$starl judge ", Out], Config),
            says("no contract is broken", Verdict),
            faults(filename:join([Dir, Out, "run.mcap"]))
        end
     || {World, Command} <- [
            {"simulated", "run --record"},
            {"live", "run --live --pace 10"},
            {"nodes", "cluster --speed 5"}
        ]
    ],
    [Simulated, Live, Nodes] = Told,
    Planned = lists:sort(
        [{Id, began, From} || {Id, From, _, _, _, _} <- Schedule] ++
            [{Id, ended, To} || {Id, From, To, _, _, _} <- Schedule, To > From]
    ),
    ?assertEqual(Planned, Simulated),
    [
        begin
            ?assertEqual([{Id, Is} || {Id, Is, _} <- Planned], [{Id, Is} || {Id, Is, _} <- Played]),
            Times = lists:zip(Planned, Played),
            ?assertEqual([], [Both || {{_, _, Ms}, {_, _, At}} = Both <- Times, At < Ms])
        end
     || Played <- [Live, Nodes]
    ],
    {0, _} = sh(["$starl run", App, "nodes/faults.term --quiet"], Config).

%% The faults of a recording: which, its beginning or its end, and when, ms.
faults(File) ->
    {ok, Told, _} = starl_trace_reader:fold(
        fun
            ({faults, At, {Is, Fault}}, Told) -> [{element(1, Fault), Is, At div 1000} | Told];
            (_, Told) -> Told
        end,
        [],
        File
    ),
    lists:sort([Each || {Id, Is, _} = Each <- Told, not (Id =:= crash andalso Is =:= ended)]).

%% -- helpers --------------------------------------------------------------------------------

%% In a directory of the test's own, with the example beside it.
sh(Line, Config) ->
    Dir = filename:join(proplists:get_value(priv_dir, Config), "live"),
    Example = filename:join([starl_first_hour_ct:root(), "examples", "line_up.erl"]),
    ok = filelib:ensure_path(Dir),
    {ok, _} = file:copy(Example, filename:join(Dir, "line_up.erl")),
    starl_first_hour_ct:sh(lists:flatten(Line), Dir).

says(Part, Text) -> ?assertNotEqual({Part, nomatch, Text}, {Part, string:find(Text, Part), Text}).

wrote(Names, Config) ->
    {0, Listed} = sh("ls out/*", Config),
    [says(Name, Listed) || Name <- Names].
