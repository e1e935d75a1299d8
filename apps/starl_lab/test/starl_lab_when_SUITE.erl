%% ./starl when as its user meets it, with a planted violation.
-module(starl_lab_when_SUITE).
-include_lib("stdlib/include/assert.hrl").

-export([suite/0, all/0]).
-export([
    names_what_decides/1,
    same_salt_same_curve/1,
    nothing_decides/1,
    interrupted/1,
    bad_input/1,
    help/1
]).

-import(starl_cli_vm, [says/3, contains/2, start/1, rest/2, until/3, interrupt/1]).

-define(FEW, ["--futures", "6", "--moments", "4"]).

suite() -> [{timetrap, {minutes, 2}}].

all() ->
    [
        names_what_decides,
        same_salt_same_curve,
        nothing_decides,
        interrupted,
        bad_input,
        help
    ].

%% After the first crash the second one is still to be drawn, when and where; with it all is lost.
names_what_decides(Config) ->
    File = scenario(Config, crashes(900, 1570)),
    Out = out(Config, "named"),
    Text = says(0, "planted broken at 1.57", ["when", File, "--out", Out | ?FEW]),
    contains("1.570000 s  a fault begins: {second,", Text),
    contains("and then:", Text),
    contains("robot 2, event ", Text),
    contains("sap boots", Text),
    {ok, Told} = file:read_file(filename:join(Out, "when.txt")),
    contains(unicode:characters_to_list(Told), Text),
    contains("events,time_s,futures,broken,", curve(Out)),
    ?assert(filelib:is_regular(filename:join(Out, "plot.gp"))).

%% The number of processes changes nothing, the salt does.
same_salt_same_curve(Config) ->
    File = scenario(Config, crashes(900, 1570)),
    [One, Same, Other] = [
        begin
            Out = out(Config, Name),
            _ = says(0, "result: ", ["when", File, "--out", Out | ?FEW ++ Args]),
            curve(Out)
        end
     || {Name, Args} <- [
            {"one", ["--salt", "3", "--jobs", "1"]},
            {"same", ["--salt", "3", "--jobs", "3"]},
            {"other", ["--salt", "4"]}
        ]
    ],
    ?assertEqual(One, Same),
    ?assertNotEqual(One, Other).

%% Both crashes are there from the beginning.
nothing_decides(Config) ->
    File = scenario(Config, crashes(0, 0)),
    Args = ["when", File, "--out", out(Config, "flat"), "--moments", "2", "--futures", "2"],
    contains("the share rises nowhere", says(4, "planted broken at ", Args)).

interrupted(Config) ->
    File = scenario(Config, crashes(900, 1570)),
    Out = out(Config, "interrupted"),
    Port = start(["when", File, "--out", Out, "--futures", "10000"]),
    Begun = until("planted broken at ", Port, ""),
    interrupt(Port),
    {130, Text} = rest(Port, Begun),
    contains("interrupted", Text),
    contains("events,time_s,", curve(Out)).

bad_input(Config) ->
    says(2, "starl: when: name a run first", ["when"]),
    Sound = scenario(Config, []),
    says(2, "violates no contract, so there is nothing to ask", ["when", Sound]),
    says(2, "--futures: ", ["when", Sound, "--futures", "none"]).

help(_) -> says(0, "Usage: ./starl when RUN", ["when", "--help"]).

%% -- helpers --------------------------------------------------------------------------------

crashes(First, Second) ->
    [
        {first, First, First, kill_machine, {1, sap}, #{}},
        {second, Second, Second, kill_machine, {2, sap}, #{}}
    ].

scenario(Config, Faults) ->
    [Data, Priv] = [proplists:get_value(Key, Config) || Key <- [data_dir, priv_dir]],
    %% a source of this name among the tests would be taken for one of them
    Source = filename:join(Priv, "two_crashes.erl"),
    {ok, _} = file:copy(filename:join(Data, "two_crashes.erl.in"), Source),
    File = filename:join(Priv, "two_crashes.term"),
    Scenario = #{app => Source, robots => 6, seed => 7, time => 3, faults => Faults},
    ok = file:write_file(File, io_lib:format("~0p.~n", [Scenario])),
    File.

out(Config, Name) -> filename:join(proplists:get_value(priv_dir, Config), Name).

curve(Out) ->
    {ok, Text} = file:read_file(filename:join(Out, "curve.csv")),
    unicode:characters_to_list(Text).
