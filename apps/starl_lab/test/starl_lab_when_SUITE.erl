%% ./starl when as its user meets it, with an application of a user's own and a planted violation.
-module(starl_lab_when_SUITE).
-include_lib("stdlib/include/assert.hrl").

-export([suite/0, all/0]).
-export([
    names_what_decides/1,
    same_branch_seed_same_curve/1,
    nothing_decides/1,
    interrupted/1,
    bad_input/1,
    help/1
]).
-export([
    a_run_is_continued_from_a_time/1,
    it_names_what_decides_before_a_time/1,
    a_run_that_cannot_be_repeated_is_refused/1,
    bad_times/1,
    the_example_of_the_page/1
]).

-import(starl_cli_vm, [says/3, contains/2, start/1, rest/2, until/3, interrupt/1]).

-define(FEW, ["--draws", "6", "--points", "4"]).

suite() -> [{timetrap, {minutes, 2}}].

all() ->
    [
        names_what_decides,
        same_branch_seed_same_curve,
        nothing_decides,
        interrupted,
        bad_input,
        help,
        a_run_is_continued_from_a_time,
        it_names_what_decides_before_a_time,
        a_run_that_cannot_be_repeated_is_refused,
        bad_times,
        the_example_of_the_page
    ].

%% -- when a violation became inevitable ------------------------------------------------------

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
    contains("events,time_s,draws,broken,", curve(Out)),
    ?assert(filelib:is_regular(filename:join(Out, "plot.gp"))).

%% The number of processes changes nothing, the branch seed does.
same_branch_seed_same_curve(Config) ->
    File = scenario(Config, crashes(900, 1570)),
    [One, Same, Other] = [
        begin
            Out = out(Config, Name),
            _ = says(0, "result: ", ["when", File, "--out", Out | ?FEW ++ Args]),
            curve(Out)
        end
     || {Name, Args} <- [
            {"one", ["--branch-seed", "3", "--jobs", "1"]},
            {"same", ["--branch-seed", "3", "--jobs", "3"]},
            {"other", ["--branch-seed", "4"]}
        ]
    ],
    ?assertEqual(One, Same),
    ?assertNotEqual(One, Other).

%% Both crashes are there from the beginning.
nothing_decides(Config) ->
    File = scenario(Config, crashes(0, 0)),
    Args = ["when", File, "--out", out(Config, "flat"), "--points", "2", "--draws", "2"],
    contains("the fraction rises nowhere", says(4, "planted broken at ", Args)).

interrupted(Config) ->
    File = scenario(Config, crashes(900, 1570)),
    Out = out(Config, "interrupted"),
    Port = start(["when", File, "--out", Out, "--draws", "10000"]),
    Begun = until("planted broken at ", Port, ""),
    interrupt(Port),
    {130, Text} = rest(Port, Begun),
    contains("interrupted", Text),
    contains("events,time_s,", curve(Out)).

bad_input(Config) ->
    says(2, "starl: when: name a run first", ["when"]),
    Sound = scenario(Config, []),
    says(2, "violates no contract, so there is nothing to ask; --at", ["when", Sound]),
    says(2, "--draws: ", ["when", Sound, "--draws", "none"]).

help(_) -> says(0, "Usage: ./starl when RUN", ["when", "--help"]).

%% -- what a run comes to from a time on ------------------------------------------------------

%% At the first point the second crash is still to be drawn, when and where; at the last one it has been
%% until 1.57 s. The recording of a run stands for the run.
a_run_is_continued_from_a_time(Config) ->
    Run = recorded(Config, "kept", ["--record"]),
    Args = ["--at", "1.56", "--since", "0.9", "--points", "2", "--draws", "6", "--beyond", "0.4"],
    Out = out(Config, "continued"),
    Recording = filename:join(Run, "run.mcap"),
    Text = says(3, "from 1.560 s on ", ["when", Recording, "--out", Out | Args]),
    contains("continuations that break a contract", Text),
    contains("events,time_s,draws,broken,", curve(Out)),
    Same = out(Config, "again"),
    _ = says(3, "result: ", ["when", Run, "--out", Same, "--jobs", "1" | Args]),
    ?assertEqual(curve(Out), curve(Same)),
    Other = ["when", Run, "--out", out(Config, "contract"), "--contract", "mutex"],
    contains("none of 6 continuations break mutex", says(0, "break another", Other ++ Args)).

%% Before the crash at 0.903 s it is still to be drawn whose machine crashes, and when; with it all is lost, long
%% before it shows. One point alone names nothing, and says so.
it_names_what_decides_before_a_time(Config) ->
    Fault = {first, 903, 903, kill_machine, {1, sap}, #{}},
    File = scenario(Config, late_judge, [Fault]),
    Args = ["--at", "1.5", "--points", "2", "--draws", "8", "--out", out(Config, "before")],
    Text = says(3, "0.903000 s  a fault begins: {first,", ["when", File | Args]),
    contains("40 of 40 continuations (0.91-1.00)", Text),
    Alone = ["when", File, "--at", "1.5", "--draws", "2", "--out", out(Config, "alone")],
    contains("one point names no event", says(3, "2 of 2", Alone)).

%% A run in real time has no draws that could be repeated; another program does not give the run again.
a_run_that_cannot_be_repeated_is_refused(Config) ->
    Run = recorded(Config, "refused", []),
    File = filename:join(Run, "run.term"),
    {ok, [#{digest := Digest} = Record]} = file:consult(File),
    [First | _] = Digest,
    Other = [hd([C || C <- "01", C =/= First]) | tl(Digest)],
    ok = write(File, Record#{digest := Other}),
    says(2, "the run is not reproducible", ["when", Run, "--at", "1"]),
    ok = write(File, Record#{digest := ""}),
    says(2, "the run passed in real time", ["when", Run, "--at", "1"]),
    ok = write(File, Record#{ending := stopped}),
    says(2, "the run was interrupted", ["when", Run, "--at", "1"]).

bad_times(Config) ->
    File = scenario(Config, crashes(900, 1570)),
    says(2, "--since 2: the points lie after it, up to --at 1", [
        "when", File, "--since", "2", "--at", "1"
    ]),
    says(2, "--since: only with --at", ["when", File, "--since", "1"]),
    says(2, "--contract: only with --at", ["when", File, "--contract", "mutex"]),
    says(2, "planted broken at 1.57", ["when", File, "--at", "1.6"]),
    Sound = scenario(Config, []),
    says(2, "the run ends at 2.905 s", ["when", Sound, "--at", "3.5"]),
    says(2, "its run.term, which is not there", ["when", out(Config, "none.mcap")]).

the_example_of_the_page(Config) ->
    {ok, Page} = file:read_file(filename:join(root(), "doc/when.md")),
    Lines = string:lexemes(unicode:characters_to_list(Page), "\n"),
    Priv = proplists:get_value(priv_dir, Config),
    Texts = [
        says(0, "result: ", [
            lists:flatten(string:replace(Word, "out/", Priv))
         || Word <- string:lexemes(Args, " ")
        ])
     || "    ./starl " ++ Args <- Lines, string:find(Args, "out/tokens") =/= nomatch
    ],
    ?assertEqual(2, length(Texts)),
    [
        contains(string:trim(Line), lists:last(Texts))
     || Line <- Lines, string:find(Line, "of 10 ") =/= nomatch
    ].

%% -- helpers --------------------------------------------------------------------------------

crashes(First, Second) ->
    [
        {first, First, First, kill_machine, {1, sap}, #{}},
        {second, Second, Second, kill_machine, {2, sap}, #{}}
    ].

scenario(Config, Faults) -> scenario(Config, two_crashes, Faults).

scenario(Config, App, Faults) ->
    [Data, Priv] = [proplists:get_value(Key, Config) || Key <- [data_dir, priv_dir]],
    %% a source of this name among the tests would be taken for one of them
    Source = filename:join(Priv, lists:concat([App, ".erl"])),
    {ok, _} = file:copy(filename:join(Data, lists:concat([App, ".erl.in"])), Source),
    File = filename:join(Priv, lists:concat([App, ".term"])),
    ok = write(File, #{app => Source, robots => 6, seed => 7, time => 3, faults => Faults}),
    File.

recorded(Config, Name, Flags) ->
    Run = out(Config, Name),
    File = scenario(Config, crashes(900, 1570)),
    _ = says(3, "planted broken at 1.57", ["run", File, "--out", Run | Flags]),
    Run.

write(File, Term) -> file:write_file(File, io_lib:format("~0p.~n", [Term])).

root() -> hd(string:split(code:which(?MODULE), "/_build/")).

out(Config, Name) -> filename:join(proplists:get_value(priv_dir, Config), Name).

curve(Out) ->
    {ok, Text} = file:read_file(filename:join(Out, "curve.csv")),
    unicode:characters_to_list(Text).
