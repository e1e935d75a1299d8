%% Runs of the program of real robots (`program => live') are runs of the simulator: the commands on runs work on
%% them, as their user meets them, with a planted violation.
-module(starl_lab_live_program_SUITE).
-include_lib("stdlib/include/assert.hrl").

-export([suite/0, all/0]).
-export([a_run_is_replayed/1, a_run_is_shrunk/1, when_names_what_decides/1]).
-export([every_way_has_the_same_digest/1, a_fault_that_is_not_carried_out_is_refused/1]).

-import(starl_cli_vm, [says/3, contains/2]).

suite() -> [{timetrap, {minutes, 4}}].

all() ->
    [
        a_run_is_replayed,
        a_run_is_shrunk,
        when_names_what_decides,
        every_way_has_the_same_digest,
        a_fault_that_is_not_carried_out_is_refused
    ].

a_run_is_replayed(Config) ->
    Out = out(Config, "run"),
    contains("both crashed", says(3, "digest ", ["run", scenario(Config), "--out", Out])),
    says(0, "same digest", ["replay", Out]),
    %% the machines of a robot at a time
    contains(
        "location (starl_location)",
        says(0, "robot 2", ["replay", Out, "--until", "0.5", "--inspect", "2"])
    ).

%% The cut goes, and the robots that crash stay.
a_run_is_shrunk(Config) ->
    Small = out(Config, "small.term"),
    Told = says(0, "shrunk to 2 faults of 3", ["shrink", scenario(Config), "--out", Small]),
    contains("2 robots of 4", Told),
    {ok, [Scenario]} = file:consult(Small),
    ?assertMatch(#{program := live, robots := 2}, Scenario),
    contains("both crashed", says(3, "digest ", ["run", Small, "--out", out(Config, "again")])).

when_names_what_decides(Config) ->
    Few = ["--draws", "6", "--points", "4"],
    Told = says(0, "continuations", ["when", scenario(Config), "--out", out(Config, "when") | Few]),
    contains("1.570000 s  a fault begins: {second,", Told).

%% Any number of shards and schedulers.
every_way_has_the_same_digest(Config) ->
    contains("no digest differs", says(0, "no digest differs", ["diverge", scenario(Config)])).

a_fault_that_is_not_carried_out_is_refused(Config) ->
    Steps = "[{step,0,0,clock_step,1,#{ms=>100}}]",
    Args = ["run", scenario(Config), "--out", out(Config, "none"), "--faults", Steps],
    says(2, "fault step: robots that run the program of real ones have no faults", Args).

%% -- helpers --------------------------------------------------------------------------------

scenario(Config) ->
    [Data, Priv] = [proplists:get_value(Key, Config) || Key <- [data_dir, priv_dir]],
    %% a source of this name among the tests would be taken for one of them
    Source = filename:join(Priv, "two_ends.erl"),
    {ok, _} = file:copy(filename:join(Data, "two_ends.erl.in"), Source),
    File = filename:join(Priv, "two_ends.term"),
    Faults = [
        {first, 900, 900, kill_machine, {1, app}, #{}},
        {second, 1570, 1570, kill_machine, {2, app}, #{}},
        {cut, 500, 800, isolate, 3, #{}}
    ],
    Scenario = #{
        app => Source, robots => 4, seed => 7, time => 3, program => live, faults => Faults
    },
    ok = file:write_file(File, io_lib:format("~0p.~n", [Scenario])),
    File.

out(Config, Name) -> filename:join(proplists:get_value(priv_dir, Config), Name).
