%% ./starl onward as its user meets it, on the recording of a run with an application of a user's own.
-module(starl_lab_onward_SUITE).
-include_lib("stdlib/include/assert.hrl").

-export([suite/0, all/0]).
-export([
    a_recording_goes_on/1, it_names_what_decides/1, without_snapshots_it_is_repeated/1, bad_input/1
]).
-export([the_example_of_the_page/1, live_robots_that_move_go_on/1]).

-import(starl_cli_vm, [says/3, contains/2, start/1, rest/2]).

suite() -> [{timetrap, {minutes, 2}}].

all() ->
    [
        a_recording_goes_on,
        it_names_what_decides,
        without_snapshots_it_is_repeated,
        bad_input,
        the_example_of_the_page,
        live_robots_that_move_go_on
    ].

%% At the first moment the second crash is still to be drawn, when and where; at the last one it has been.
a_recording_goes_on(Config) ->
    Run = recorded(Config, "kept", ["--snapshots", "0.5"]),
    Args = ["--at", "1.56", "--since", "0.9", "--moments", "2", "--runs", "6", "--beyond", "0.4"],
    Out = out(Config, "onward"),
    Text = says(3, "from 1.560 s on ", ["onward", Run, "--out", Out | Args]),
    contains("taken up at 1.000 s", Text),
    contains("time_s,futures,broken,", curve(Out)),
    Same = out(Config, "same"),
    _ = says(3, "result: ", ["onward", Run, "--out", Same, "--jobs", "1" | Args]),
    ?assertEqual(curve(Out), curve(Same)),
    Other = ["onward", Run, "--out", out(Config, "other"), "--contract", "mutex"],
    contains("none of 6 futures break mutex", says(0, "break another", Other ++ Args)).

%% Before the crash at 0.9 s it is still to be drawn whose machine crashes, and when; with it all is lost, long before
%% it shows. One moment alone names nothing, and says so.
it_names_what_decides(Config) ->
    Fault = {first, 903, 903, kill_machine, {1, sap}, #{}},
    Run = recorded(Config, "late", late_judge, "planted broken at 2.5", [Fault], [
        "--snapshots", "0.4"
    ]),
    Args = ["--at", "1.5", "--moments", "2", "--runs", "8", "--out", out(Config, "named")],
    Text = says(3, "it became likely from 0.900000 s to 0.905000 s", ["onward", Run | Args]),
    contains("0.903000 s  robot 1, sap: crashed", Text),
    contains("just after it 40 of 40 futures", Text),
    Alone = ["onward", Run, "--at", "1.5", "--runs", "2", "--out", out(Config, "alone")],
    contains("one moment names no event", says(3, "2 of 2", Alone)).

without_snapshots_it_is_repeated(Config) ->
    Run = recorded(Config, "bare", ["--record"]),
    Out = out(Config, "repeated"),
    Text = says(3, "the recording has no snapshots", ["onward", Run, "--out", Out, "--at", "1.2"]),
    contains("of 20 futures break a contract", Text).

bad_input(Config) ->
    Run = recorded(Config, "bad", ["--snapshots", "1"]),
    says(2, "the recording ends at ", ["onward", Run, "--at", "2.5"]),
    says(2, "--since 2: the moments lie after it, up to --at 1", [
        "onward", Run, "--since", "2", "--at", "1"
    ]),
    says(2, "--since 99: the recording ends at ", ["onward", Run, "--since", "99"]),
    says(2, "planted broken at 1.57", ["onward", Run, "--at", "1.6"]),
    says(2, "holds no recording", ["onward", proplists:get_value(priv_dir, Config)]),
    says(2, "--runs: ", ["onward", Run, "--runs", "0"]).

the_example_of_the_page(Config) ->
    {ok, Page} = file:read_file(filename:join(root(), "doc/onward.md")),
    Lines = string:lexemes(unicode:characters_to_list(Page), "\n"),
    Priv = proplists:get_value(priv_dir, Config),
    Texts = [
        says(0, "result: ", [
            lists:flatten(string:replace(Word, "out/", Priv))
         || Word <- string:lexemes(Args, " ")
        ])
     || "    ./starl " ++ Args <- lists:sublist([L || "    ./starl " ++ _ = L <- Lines], 2)
    ],
    ?assertEqual(2, length(Texts)),
    contains("from 17.000 s on none of 10 futures break a contract (0.00-0.28)", lists:last(Texts)),
    contains("5.667      0 of 10    0.00-0.28", lists:last(Texts)).

%% Each robot of a live run does again what it was recorded doing, and drives on from where it was. On a busy
%% computer something may be late, or a step be under way; then it starts anew, but it never goes another way.
live_robots_that_move_go_on(Config) ->
    Run = live(Config),
    File = filename:join(Run, "run.mcap"),
    Moments = [4000000, 5500000, 7000000],
    Taken = lists:append([taken_up(File, At) || At <- Moments]),
    ?assertEqual([], [Why || {_, Why} <- Taken, is_another_way(Why)]),
    Followed = [Id || {Id, none} <- Taken],
    ?assertNotEqual([], Followed),
    Args = ["--at", "7", "--runs", "2", "--moments", "2", "--since", "4", "--beyond", "3"],
    {_, Text} = rest(start(["onward", Run, "--out", out(Config, "on") | Args]), ""),
    contains("from 7.000 s on ", Text),
    %% before its first snapshot there is nothing to follow
    Early = [
        "onward", Run, "--at", "0.5", "--runs", "2", "--beyond", "3", "--out", out(Config, "early")
    ],
    {_, Anew} = rest(start(Early), ""),
    contains("robot 1 starts anew at the last moment", Anew),
    contains("from 0.500 s on ", Anew).

taken_up(File, At) ->
    {ok, #{live := #{robots := Robots, facts := Facts} = Live}} = starl_lab_onward_live:read(
        File, At
    ),
    {ok, Point, Anew} = starl_sim_onward:live(Live, At, #{slack_us => starl_world:slack_us()}),
    Until = (At + 3000000) / 1.0e6,
    Settings = #{
        loss => same, until_s => Until, until_ms => 1, slack_us => starl_world:slack_us()
    },
    Later = starl_sim_onward:facts(Point, Settings, none),
    [
        begin
            %% it drives on
            ?assertNotEqual([], [At0 || {At0, R, chassis, {motion, _}} <- Later, R =:= Id]),
            ?assertNotEqual([], [At0 || {At0, R, chassis, {motion, _}} <- Facts, R =:= Id]),
            {Id, proplists:get_value(Id, Anew, none)}
        end
     || Id <- maps:keys(Robots)
    ].

is_another_way({parted, _, _}) -> true;
is_another_way({failed, _}) -> true;
is_another_way(Why) -> lists:member(Why, [another_way, other_code, no_data]).

live(Config) ->
    Run = out(Config, "live"),
    Args = ["--live", "--robots", "2", "--time", "8", "--snapshots", "1", "--out", Run],
    {Status, Text} = rest(start(["run", "painting" | Args]), ""),
    contains("result: ", Text),
    %% the time is up; or a busy computer stood still, too
    ?assert(lists:member(Status, [4, 5]), {Status, Text}),
    Run.

%% -- helpers --------------------------------------------------------------------------------

recorded(Config, Name, Flags) ->
    Crashes = [
        {first, 900, 900, kill_machine, {1, sap}, #{}},
        {second, 1570, 1570, kill_machine, {2, sap}, #{}}
    ],
    recorded(Config, Name, two_crashes, "planted broken at 1.57", Crashes, Flags).

recorded(Config, Name, App, Broken, Faults, Flags) ->
    [Data, Priv] = [proplists:get_value(Key, Config) || Key <- [data_dir, priv_dir]],
    Beside = filename:dirname(string:trim(Data, trailing, "/")),
    Dir = filename:join(Priv, Name ++ "-source"),
    ok = filelib:ensure_path(Dir),
    %% a source of this name among the tests would be taken for one of them
    Source = atom_to_list(App) ++ ".erl",
    [Of] = filelib:wildcard(filename:join([Beside, "starl_lab_*_SUITE_data", Source ++ ".in"])),
    {ok, _} = file:copy(Of, filename:join(Dir, Source)),
    File = filename:join(Dir, atom_to_list(App) ++ ".term"),
    Scenario = #{app => Source, robots => 6, seed => 7, time => 3, faults => Faults},
    ok = file:write_file(File, io_lib:format("~0p.~n", [Scenario])),
    Run = out(Config, Name),
    _ = says(3, Broken, ["run", File, "--out", Run | Flags]),
    Run.

root() -> hd(string:split(code:which(?MODULE), "/_build/")).

out(Config, Name) -> filename:join(proplists:get_value(priv_dir, Config), Name).

curve(Out) ->
    {ok, Text} = file:read_file(filename:join(Out, "curve.csv")),
    unicode:characters_to_list(Text).
