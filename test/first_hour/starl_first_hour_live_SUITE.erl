%% The README's example in real time, and on nodes of its own, as a user starts them.
-module(starl_first_hour_live_SUITE).
-include_lib("stdlib/include/assert.hrl").

-export([suite/0, all/0]).
-export([in_one_vm/1, on_nodes/1, commands_without_a_cluster/1, mistakes/1]).

suite() -> [{timetrap, {minutes, 5}}].

all() -> [in_one_vm, on_nodes, commands_without_a_cluster, mistakes].

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
    {2, Faults} = sh("$starl run painting --live --random-faults '[all]'", Config),
    says("faults: a schedule of faults needs the simulator", Faults),
    {2, Transport} = sh("$starl cluster painting --transport pigeon", Config),
    says("--transport", Transport),
    {2, Unknown} = sh("$starl cluster paintin", Config),
    says("did you mean painting", Unknown).

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
