%% ./starl shrink as its user meets it, with planted violations: the file that it writes is small
%% and replays the same violation.
-module(starl_lab_shrink_SUITE).
-include_lib("stdlib/include/assert.hrl").

-export([suite/0, all/0]).
-export([
    three_faults_of_forty/1,
    random_loss_becomes_lost_packets/1,
    drawn_faults_are_explicit/1,
    recorded_run/1,
    interrupted/1,
    seconds_are_up/1,
    self_contained/1,
    nothing_to_shrink/1,
    bad_input/1,
    help/1
]).

-import(starl_cli_vm, [says/3, contains/2, start/1, rest/2, until/3, interrupt/1]).

suite() -> [{timetrap, {minutes, 2}}].

all() ->
    [
        three_faults_of_forty,
        random_loss_becomes_lost_packets,
        drawn_faults_are_explicit,
        recorded_run,
        interrupted,
        seconds_are_up,
        self_contained,
        nothing_to_shrink,
        bad_input,
        help
    ].

%% Three particular crashes among forty faults break the contract.
three_faults_of_forty(Config) ->
    File = scenario(Config, "three_crashes", #{
        robots => 10, seed => 7, loss => 0.1, time => 60, faults => forty()
    }),
    Small = shrunk(Config, File),
    #{faults := Faults, robots := Robots} = Small,
    ?assert(length(Faults) =< 5, Faults),
    Left = [{Kind, Target} || {_, _, _, Kind, Target, _} <- Faults],
    ?assertEqual([{kill_machine, {R, sap}} || R <- [2, 5, 8]], Left),
    ?assertEqual(8, Robots).

%% Three packets in a row must be lost, or their acknowledgements.
random_loss_becomes_lost_packets(Config) ->
    File = scenario(Config, "three_losses", #{robots => 6, seed => 7, loss => 0.2, time => 30}),
    #{faults := Drops, robots := 3} = Small = shrunk(Config, File),
    ?assertNot(is_map_key(loss, Small)),
    ?assert(length(Drops) >= 3 andalso length(Drops) =< 8, Drops),
    ?assertEqual([drop], lists:usort([Kind || {_, _, _, Kind, _, _} <- Drops])).

%% What was drawn from the seed stands in the file.
drawn_faults_are_explicit(Config) ->
    Seed = drawn_seed(1),
    File = scenario(Config, "three_crashes", #{
        robots => 8,
        seed => Seed,
        time => 60,
        random_faults => [kill_machine, reboot, loss],
        heal => 30,
        faults => lists:keydelete(kill_8, 1, three())
    }),
    #{faults := Faults} = Small = shrunk(Config, File),
    ?assertNot(is_map_key(random_faults, Small)),
    ?assertEqual(3, length(Faults)).

%% The directory of a run will do; a digest that does not come out again is told.
recorded_run(Config) ->
    File = scenario(Config, "three_crashes", #{
        robots => 9, seed => 7, time => 60, faults => three()
    }),
    Dir = filename:join(proplists:get_value(priv_dir, Config), "recorded"),
    Text = says(3, "planted broken at ", ["run", File, "--out", Dir]),
    contains("smaller: ./starl shrink ", Text),
    #{robots := 8} = shrunk(Config, Dir),
    Record = filename:join(Dir, "run.term"),
    {ok, Before} = file:read_file(Record),
    [Head, Digest] = string:split(Before, "digest => \""),
    <<First, Rest/binary>> = Digest,
    Other =
        case First of
            $0 -> $1;
            _ -> $0
        end,
    ok = file:write_file(Record, [Head, "digest => \"", Other, Rest]),
    says(2, "the run is not reproducible", ["shrink", Dir]).

%% A seed whose drawn faults crash SAP of robot 8.
drawn_seed(Seed) ->
    Drawn = starl_run_fault_draw:draw(#{
        seed => Seed,
        robots => 8,
        machines => [sap, location, motion, app],
        until_ms => 30000,
        kinds => [kill_machine, reboot, loss]
    }),
    case
        [
            F
         || {_, _, _, Kind, Target, _} = F <- Drawn,
            {Kind, Target} =:= {reboot, 8} orelse
                {Kind, Target} =:= {kill_machine, {8, sap}}
        ]
    of
        [] -> drawn_seed(Seed + 1);
        [_ | _] -> Seed
    end.

%% Ctrl-C: the smallest so far is in the file, and replays.
interrupted(Config) ->
    File = scenario(Config, "three_crashes", #{
        robots => 60, seed => 7, time => 60, loss => 0.1, faults => forty()
    }),
    Out = filename:join(proplists:get_value(priv_dir, Config), "interrupted.term"),
    Port = start(["shrink", File, "--out", Out]),
    Begun = until("reproduced", Port, ""),
    interrupt(Port),
    {130, Text} = rest(Port, Begun),
    contains("the smallest so far", Text),
    replays(Out).

seconds_are_up(Config) ->
    File = scenario(Config, "three_crashes", #{
        robots => 10, seed => 7, time => 60, faults => forty()
    }),
    Out = filename:join(proplists:get_value(priv_dir, Config), "late.term"),
    says(4, "shrunk to 40 faults of 40", ["shrink", File, "--out", Out, "--seconds", "0.001"]),
    replays(Out).

%% The result replays after it was moved and the application was deleted; it is not replaced unless
%% that is asked for.
self_contained(Config) ->
    File = scenario(Config, "three_crashes", #{
        robots => 9, seed => 7, time => 60, faults => three()
    }),
    [Before, Later] = [
        filename:join(proplists:get_value(priv_dir, Config), Name)
     || Name <- ["made", "moved"]
    ],
    Args = ["shrink", File, "--out", filename:join(Before, "x.term"), "--seconds", "0.001"],
    says(4, "shrunk to ", Args),
    says(2, "x.term is there already; --overwrite replaces it", Args),
    says(4, "shrunk to ", Args ++ ["--overwrite"]),
    ok = file:delete(filename:rootname(File) ++ ".erl"),
    ok = file:rename(Before, Later),
    replays(filename:join(Later, "x.term")).

nothing_to_shrink(Config) ->
    File = scenario(Config, "three_crashes", #{robots => 3, time => 5}),
    says(2, "violates no contract, so there is nothing to shrink", ["shrink", File]).

bad_input(Config) ->
    Dir = proplists:get_value(priv_dir, Config),
    says(2, "starl: shrink: name a run first", ["shrink"]),
    says(2, "seed 12 of what?", ["shrink", "12", "--robots", "3"]),
    says(
        2,
        "nothing to shrink",
        ["shrink", "12", "--robots", "3", "--app", "exercise", "--time", "1"]
    ),
    says(2, "no such file", ["shrink", filename:join(Dir, "none.term")]),
    says(2, "is a directory", ["shrink", "exercise", "--out", Dir]),
    says(2, "ends in .term", ["shrink", "exercise", "--out", filename:join(Dir, "x.erl")]),
    says(2, "unknown flag --sede", ["shrink", "exercise", "--sede", "3"]),
    says(2, "--loss: ", ["shrink", "exercise", "--loss", "2"]).

help(_) ->
    says(0, "Usage: ./starl shrink RUN", ["shrink", "--help"]),
    says(0, "--block", ["shrink", "exercise", "--help"]).

%% -- helpers --------------------------------------------------------------------------------

three() ->
    [
        {list_to_atom(lists:concat([kill_, R])), At, At, kill_machine, {R, sap}, #{}}
     || {R, At} <- [{2, 4100}, {5, 9300}, {8, 15700}]
    ].

%% Thirty-seven faults of all classes, none of which restarts SAP, among the three.
forty() ->
    Kinds = [network, clock, kill_machine, pause, slow, location, actuation],
    Drawn = [
        setelement(1, Fault, list_to_atom(lists:concat([element(1, Fault), "_of_", Seed])))
     || Seed <- [1, 2, 3, 4, 5, 6],
        Fault <- starl_run_fault_draw:draw(#{
            seed => Seed,
            robots => 10,
            machines => [location, motion, app],
            until_ms => 40000,
            kinds => Kinds
        })
    ],
    Others = lists:sublist(Drawn, 37),
    37 = length(Others),
    lists:keysort(2, three() ++ Others).

scenario(Config, App, Scenario) ->
    [Data, Priv] = [proplists:get_value(Key, Config) || Key <- [data_dir, priv_dir]],
    %% a source of this name among the tests would be taken for one of them
    Source = filename:join(Priv, App ++ ".erl"),
    {ok, _} = file:copy(filename:join(Data, App ++ ".erl.in"), Source),
    File = filename:join(Priv, App ++ ".term"),
    ok = file:write_file(File, io_lib:format("~0p.~n", [Scenario#{app => Source}])),
    File.

%% The scenario that is left.
shrunk(Config, File) ->
    Out = filename:join(proplists:get_value(priv_dir, Config), "small.term"),
    Text = says(0, "shrunk to ", ["shrink", File, "--out", Out, "--overwrite"]),
    contains("planted broken at ", Text),
    contains("replay: ./starl run ", Text),
    replays(Out),
    {ok, [Small]} = file:consult(Out),
    Small.

replays(File) ->
    Out = filename:rootname(File) ++ "-replayed",
    _ = file:del_dir_r(Out),
    says(3, "planted broken at ", ["run", File, "--out", Out]).
