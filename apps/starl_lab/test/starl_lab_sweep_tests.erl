%% Sweeps: the grid, rows and their file, medians, the script for gnuplot; and a whole sweep that
%% is interrupted and goes on, in a VM of its own.
-module(starl_lab_sweep_tests).
-include_lib("eunit/include/eunit.hrl").

-import(starl_cli_vm, [says/3, contains/2, start/1, rest/2, until/3, in_directory/1]).

-define(PATIENCE_S, 60).

options() -> starl_run_scenario:options(starl_painting).

grid(InFile, Args) ->
    {ok, Flags} = parse(Args),
    starl_lab_sweep_grid:new(options(), InFile, Flags, Args).

parse(Args) -> starl_cli_flags:parse(Args, starl_lab_sweep_grid:flags(options())).

keys(Settings) -> [Key || {Key, _, _} <- Settings].

%% -- the grid -------------------------------------------------------------------------------

values_test_() ->
    [
        {Flag ++ " " ++ Text, fun() ->
            {ok, Flags} = parse([Flag, Text]),
            ?assertEqual([Values], maps:values(Flags))
        end}
     || {Flag, Text, Values} <- [
            {"--robots", "4", [4]},
            {"--robots", "1..4", [1, 2, 3, 4]},
            {"--robots", "2..9..3,16", [2, 5, 8, 16]},
            {"--loss", "0,0.2", [0, 0.2]},
            {"--loss", "0..0.3..0.1", [0, 0.1, 0.2, 0.3]},
            {"--delay", "5,5..50", [{5, 5}, {5, 50}]},
            {"--range", "none,5000", [none, 5000]},
            {"--range", "1000..3000..1000", [1000, 2000, 3000]},
            {"--picture", "lines,text", ["lines", "text"]},
            {"--faults", "[{a,1,2,kill_robot,3,#{}}]", [{a, 1, 2, kill_robot, 3, #{}}]},
            {"--seeds", "3", [1, 2, 3]},
            {"--seeds", "5..7", [5, 6, 7]},
            {"--seeds", "7,9", [7, 9]}
        ]
    ].

bad_values_test_() ->
    [
        {
            Flag ++ " " ++ Text,
            ?_assertMatch({error, [{bad_value, _, Text, _}]}, parse([Flag, Text]))
        }
     || {Flag, Text} <- [
            {"--robots", "4..2"},
            {"--robots", "0..3"},
            {"--robots", "1..4..0"},
            {"--robots", "1..x"},
            {"--robots", "1..2..3..4"},
            {"--robots", "1,,2"},
            {"--loss", "0..2"},
            {"--seeds", "0"},
            {"--seeds", "x"},
            {"--seeds", "1..1000000"},
            {"--picture", "a,"},
            {"--delay", "50..5"}
        ]
    ].

all_combinations_each_once_test() ->
    Grid = grid(#{}, ["--robots", "2,4,2", "--picture", "lines,text", "--loss", "0.1"]),
    ?assertEqual(
        [
            #{robots => N, loss => 0.1, picture => P}
         || N <- [2, 4], P <- ["lines", "text"]
        ],
        starl_lab_sweep_grid:points(Grid)
    ),
    ?assertEqual([1, 2, 3, 4, 5], starl_lab_sweep_grid:seeds(Grid)).

%% Swept settings in the order of the command line, columns in that of the tables.
order_test() ->
    Args = ["--picture=lines,text", "--loss", "0,0.1", "--robots", "1..3", "--time", "9"],
    Grid = grid(#{}, Args),
    ?assertEqual([picture, loss, robots], keys(starl_lab_sweep_grid:swept(Grid))),
    ?assertEqual([robots, loss, time, picture], keys(starl_lab_sweep_grid:settings(Grid))),
    ?assertEqual([time], keys(starl_lab_sweep_grid:fixed(Grid))).

flags_win_over_a_file_test() ->
    Grid = grid(#{robots => 3, loss => 0.5, seed => 9}, ["--loss", "0,0.1", "--seeds", "1"]),
    ?assertEqual(
        [#{robots => 3, loss => 0}, #{robots => 3, loss => 0.1}],
        starl_lab_sweep_grid:points(Grid)
    ).

%% -- rows -----------------------------------------------------------------------------------

%% A report with these changes to its figures and its violations.
report(Changes) ->
    starl_lab_report:make(#{
        name => "painting",
        scenario => #{robots => 2, seed => 7},
        ending => done,
        wall_s => 0.5,
        outcome => #{
            robots => [],
            end_us => round(1.0e6 * maps:get(virtual_s, Changes, 12.5)),
            violations => maps:get(violations, Changes, []),
            unjudged => maps:get(unjudged, Changes, []),
            digest => <<1, 2>>,
            events => 3,
            packets => 4,
            monitors => #{starl_sap_monitor => #{sent => 5}}
        },
        app => #{
            figures => [
                {ink_covered, maps:get(ink_covered, Changes, 1.0)},
                {min_separation_mm, null},
                {assignments_per_robot, 1.5}
            ],
            formats => formats(),
            complete => maps:get(ink_covered, Changes, 1.0) >= 1.0
        }
    }).

formats() -> #{assignments_per_robot => #{label => "paths of a robot", plotted => true}}.

violation() ->
    #{contract => sanity, what => lost, at_us => 1, robots => [1], details => #{}}.

columns() -> starl_lab_sweep_rows:columns(grid(#{}, ["--robots", "1..2"]), report(#{}), [mm]).

row(Key, Changes) ->
    starl_lab_sweep_rows:row(columns(), Key, {ok, report(Changes), #{mm => "0.1 1/1/1"}}).

header_test() ->
    Header = starl_lab_sweep_rows:header(columns()),
    ?assertEqual(["app", "robots", "seed", "status", "virtual_s"], lists:sublist(Header, 5)),
    %% the one figure that differs between equal runs
    ?assertNot(lists:member("wall_s", Header)),
    ?assertEqual(lists:sort(Header), lists:usort(Header)).

a_row_for_every_ending_test() ->
    Key = ["painting", "2", "7"],
    Failed = starl_lab_sweep_rows:row(columns(), Key, failed),
    Rows = [
        row(Key, #{}),
        row(Key, #{ink_covered => 0.5}),
        row(Key, #{violations => [violation()]}),
        Failed
    ],
    ?assertEqual(
        [complete, incomplete, violation, failed],
        [starl_lab_sweep_rows:status(columns(), Row) || Row <- Rows]
    ),
    Violations = [starl_lab_sweep_rows:figure(columns(), violations, Row) || Row <- Rows],
    ?assertEqual([{ok, 0}, {ok, 0}, {ok, 1}, none], Violations),
    ?assertEqual(
        [length(starl_lab_sweep_rows:header(columns()))],
        lists:usort(
            lists:map(
                fun erlang:length/1, Rows
            )
        )
    ).

%% Rows are read back; half a row that a stop has left goes away before the next is appended.
resume_test() ->
    in_directory(fun(Dir) ->
        File = filename:join(Dir, "new/runs.csv"),
        Rows = [row(["painting", "2", Seed], #{}) || Seed <- ["1", "2", "3"]],
        ok = write_rows(File, 0, lists:sublist(Rows, 2)),
        ok = file:write_file(File, <<"painting,2,3,compl">>, [append]),
        {ok, Known, Bytes} = starl_lab_sweep_rows:read(File, columns()),
        Before = [["painting", "2", "1"], ["painting", "2", "2"]],
        ?assertEqual(Before, lists:sort(maps:keys(Known))),
        ok = write_rows(File, Bytes, [lists:nth(3, Rows)]),
        {ok, All, _} = starl_lab_sweep_rows:read(File, columns()),
        ?assertEqual(Rows, [Row || {_, Row} <- lists:sort(maps:to_list(All))]),
        {ok, Text} = file:read_file(File),
        Keys = [lists:sublist(Row, 3) || Row <- Rows],
        ?assertEqual(
            Text,
            unicode:characters_to_binary(
                starl_lab_sweep_rows:ordered(columns(), Keys, All)
            )
        )
    end).

write_rows(File, Bytes, Rows) ->
    {ok, Device} = starl_lab_sweep_rows:open(File, columns(), Bytes),
    lists:foreach(fun(Row) -> ok = starl_lab_sweep_rows:append(Device, Row) end, Rows),
    starl_lab_sweep_rows:close(Device).

%% Rows of points that are not asked for now are kept, behind the others.
other_rows_are_kept_test() ->
    [A, B] = [row(["painting", N, "1"], #{}) || N <- ["2", "9"]],
    Rows = #{["painting", "9", "1"] => B, ["painting", "2", "1"] => A},
    {[_, First, Second], _} = starl_lab_csv:parse(
        unicode:characters_to_binary(
            starl_lab_sweep_rows:ordered(columns(), [["painting", "9", "1"]], Rows)
        )
    ),
    ?assertEqual([B, A], [First, Second]).

another_sweeps_file_test_() ->
    [
        {Part, fun() ->
            in_directory(fun(Dir) ->
                File = filename:join(Dir, "runs.csv"),
                ok = file:write_file(File, [lists:join(",", Header), "\n", Lines]),
                {error, Reason} = starl_lab_sweep_rows:read(File, columns()),
                contains(
                    Part, unicode:characters_to_list(starl_lab_sweep_rows:format_error(Reason))
                )
            end)
        end}
     || {Part, Header, Lines} <- [
            {"it lacks robots and it has loss", ["loss" | header() -- ["robots"]], ""},
            {"another order", lists:reverse(header()), ""},
            {"runs.csv:2: not as many cells", header(), "painting,2\n"}
        ]
    ].

header() -> starl_lab_sweep_rows:header(columns()).

%% -- medians --------------------------------------------------------------------------------

median_test_() ->
    [
        ?_assertEqual(Median, starl_lab_sweep_summary:median(Values))
     || {Median, Values} <- [{3, [3]}, {2, [9, 1, 2]}, {2.5, [9, 1, 2, 3]}, {1.5, [2, 1]}]
    ].

%% A run that broke off says nothing of the time that the work takes; one that is not complete
%% counts, or else all would look painted.
only_whole_runs_are_measured_test() ->
    Key = ["painting", "2", "1"],
    Rows = [
        row(Key, #{}),
        row(Key, #{ink_covered => 0.5}),
        row(Key, #{ink_covered => 0.75}),
        row(Key, #{ink_covered => 0.1, violations => [violation()]}),
        starl_lab_sweep_rows:row(columns(), Key, failed)
    ],
    Summary = starl_lab_sweep_summary:summarize(columns(), ["painting", "2"], Rows),
    ?assertMatch(#{runs := 5, complete := 1}, Summary),
    ?assertEqual({0.75, 0.5, 1.0}, starl_lab_sweep_summary:range(ink_covered, Summary)),
    ?assertEqual(none, starl_lab_sweep_summary:range(min_separation_mm, Summary)),
    Text = unicode:characters_to_binary(starl_lab_sweep_summary:csv(columns(), [Summary])),
    {[Header, Line], _} = starl_lab_csv:parse(Text),
    Cells = maps:from_list(lists:zip(Header, Line)),
    ?assertMatch(
        #{
            "robots" := "2",
            "runs" := "5",
            "complete" := "1",
            "ink_covered_median" := "0.75",
            "ink_covered_min" := "0.5",
            "ink_covered_max" := "1.0",
            "min_separation_mm_max" := ""
        },
        Cells
    ),
    ?assertNot(is_map_key("digest_median", Cells)).

%% -- the plot -------------------------------------------------------------------------------

plot(Args, Figures) -> plot(Args, Figures, 12.5).

%% The first point has runs of another length.
plot(Args, Figures, FirstS) ->
    Grid = grid(#{}, Args),
    Summary = fun(S) ->
        Rows = [row(["painting", "2", "1"], #{virtual_s => S})],
        starl_lab_sweep_summary:summarize(columns(), [], Rows)
    end,
    [First | Others] = starl_lab_sweep_grid:points(Grid),
    Points = [{First, Summary(FirstS)} | [{Point, Summary(12.5)} || Point <- Others]],
    {ok, X} = starl_lab_sweep_plot:axis(Grid),
    Names =
        case Figures of
            none -> none;
            _ -> [atom_to_list(Figure) || Figure <- Figures]
        end,
    Known = [virtual_s, events, assignments_per_robot, min_separation_mm],
    {ok, Chosen} = starl_lab_sweep_plot:chosen(Names, Known, formats()),
    starl_lab_sweep_plot:data("painting", Grid, X, Points, Chosen).

%% The first swept setting with numbers is the axis, the others make the curves.
curves_test() ->
    Args = ["--picture", "it's,b", "--loss", "0,0.2", "--robots", "2..4", "--speed", "250"],
    #{title := Title, x := X, panels := [Panel]} = plot(Args, [virtual_s]),
    ?assertEqual("painting: speed 250, median and range of 5 seeds", Title),
    ?assertEqual("part of the packets lost", X),
    ?assertMatch(#{y := "completion time, s"}, Panel),
    #{curves := Curves} = Panel,
    ?assertEqual(
        [
            "picture it's, robots 2",
            "picture b, robots 2",
            "picture it's, robots 3",
            "picture b, robots 3",
            "picture it's, robots 4",
            "picture b, robots 4"
        ],
        [Name || {Name, _} <- Curves]
    ),
    ?assertEqual(
        [[{0, 12.5, 12.5, 12.5}, {0.2, 12.5, 12.5, 12.5}]],
        lists:usort([Points || {_, Points} <- Curves])
    ).

script_test() ->
    Args = ["--robots", "2..4", "--picture", "it's,b"],
    Plot = plot(Args, [virtual_s, assignments_per_robot]),
    Script = unicode:characters_to_list(starl_lab_sweep_plot:script(Plot)),
    [
        contains(Part, Script)
     || Part <- [
            "$panel1_curve1 << EOD\n2 12.5 12.5 12.5\n3 12.5 12.5 12.5\n4 12.5 12.5 12.5\nEOD\n",
            "$panel2_curve2 << EOD\n2 1.5 1.5 1.5\n",
            "set multiplot layout 1,2 title 'painting: ",
            "set xlabel 'number of robots'",
            "set ylabel 'completion time, s'",
            "set ylabel 'paths of a robot'",
            "set xtics (2, 3, 4)",
            "title 'picture it''s'"
        ]
    ].

%% All runs last as long: unasked, a panel that says nothing else is left out beside others.
same_time_in_all_runs_is_not_plotted_test() ->
    Shown = fun(FirstS) ->
        #{panels := Panels} = plot(["--robots", "2..4"], none, FirstS),
        [Y || #{y := Y} <- Panels]
    end,
    ?assertEqual(["paths of a robot"], Shown(12.5)),
    %% a step of the application more or less
    ?assertEqual(["paths of a robot"], Shown(12.6)),
    ?assertEqual(["completion time, s", "paths of a robot"], Shown(13.0)).

%% gnuplot draws nothing at all where one curve has no point.
figures_that_no_run_has_are_left_out_test() ->
    #{panels := Panels} = plot(["--robots", "2..4"], [min_separation_mm, virtual_s]),
    ?assertMatch([#{y := "completion time, s"}], Panels),
    ?assertMatch(#{panels := []}, plot(["--robots", "2..4"], [min_separation_mm])).

no_numbers_no_axis_test() ->
    ?assertEqual(none, starl_lab_sweep_plot:axis(grid(#{}, ["--picture", "a,b", "--robots", "4"]))).

%% The application says what is plotted besides, and what it is called.
chosen_figures_test() ->
    Known = [virtual_s, events, assignments_per_robot],
    Time = {virtual_s, "completion time, s", varying},
    Paths = {assignments_per_robot, "paths of a robot", always},
    Chosen = fun(Names, Formats) -> starl_lab_sweep_plot:chosen(Names, Known, Formats) end,
    ?assertEqual({ok, [Time]}, Chosen(none, #{})),
    ?assertEqual({ok, [Time, Paths]}, Chosen(none, formats())),
    ?assertEqual({ok, [{events, "events", always}]}, Chosen(["events", "events"], formats())),
    ?assertEqual({unknown, ["evnts"]}, Chosen(["events", "evnts"], formats())).

%% -- a whole sweep --------------------------------------------------------------------------

bad_input_leaves_nothing_test_() ->
    {timeout, ?PATIENCE_S, fun() ->
        in_directory(fun(Dir) ->
            Out = filename:join(Dir, "x"),
            Args = fun(More) -> ["sweep", "painting", "--out", Out, "--seeds", "1" | More] end,
            says(2, "starl: sweep: --robots: ", Args(["--robots", "1..x"])),
            says(2, "no.svg", Args(["--picture", "house,no.svg"])),
            says(2, "did you mean virtual_s?", Args(["--plot", "virtual"])),
            says(2, "not for 2000: ", Args(["--robots", "2,2000"])),
            says(2, "it is for up to ", [
                "sweep", "ring_shuttle", "--robots", "2,100000", "--mode", "process"
            ]),
            says(2, "did you mean --seeds?", ["sweep", "painting", "--seed", "3"]),
            ?assertEqual({ok, []}, file:list_dir(Dir))
        end)
    end}.

%% Stopped in the middle of a run, and gone on with by the same command: the same rows in the same
%% order as without the stop.
interrupted_and_resumed_test_() ->
    {timeout, 2 * ?PATIENCE_S, fun() ->
        in_directory(fun(Dir) ->
            [File, Gate, One, Two] =
                [filename:join(Dir, N) || N <- ["starl_cli_gated.erl", "gate", "one", "two"]],
            ok = file:write_file(File, gated(Gate)),
            Args = ["sweep", File, "--robots", "2..3", "--seeds", "3", "--jobs", "1", "--out"],
            Port = start(Args ++ [One]),
            Begun = until("stuck", Port, ""),
            ok = starl_cli_vm:interrupt(Port),
            {Status, Text} = rest(Port, Begun),
            ?assertEqual({130, Text}, {Status, Text}),
            contains("interrupted; 2 of 6 runs are kept", Text),
            contains("go on with: ./starl sweep " ++ File ++ " --robots 2..3 --seeds 3", Text),
            ok = file:write_file(Gate, ""),
            Resumed = says(0, "6 runs: 6 complete", Args ++ [One]),
            %% 2 robots with the third seed, 3 with all: the others are not run again
            ?assertEqual(2 + 3 * 3, occurrences("stepped", Resumed)),
            Fresh = says(0, "6 runs: 6 complete", Args ++ [Two]),
            ?assertEqual(nomatch, string:find(Fresh, "gnuplot could not")),
            ?assertEqual(runs(Two), runs(One)),
            ?assertEqual(7, length(rows(One))),
            says(0, "6 runs: 6 complete", reordered(Args) ++ [One]),
            [_ | Rows] = rows(One),
            ?assertEqual(["3", "3", "3", "2", "2", "2"], [lists:nth(2, Row) || Row <- Rows])
        end)
    end}.

reordered(Args) ->
    lists:map(
        fun
            ("2..3") -> "3,2";
            (Arg) -> Arg
        end,
        Args
    ).

occurrences(Part, Text) -> length(string:split(Text, Part, all)) - 1.

runs(Dir) ->
    {ok, Text} = file:read_file(filename:join(Dir, "runs.csv")),
    Text.

rows(Dir) -> element(1, starl_lab_csv:parse(runs(Dir))).

%% The third seed is stuck until there is a file.
gated(Gate) ->
    "-module(starl_cli_gated).\n"
    "-export([scene/1, measures/0, init/2, step/2]).\n"
    "measures() -> [{seed, \"the seed\"}].\n"
    "scene(#{seed := Seed}) -> {ok, #{app => {sequential, ?MODULE, Seed}}}.\n"
    "init(R, Seed) ->\n"
    "    starl:measure(R, seed, Seed),\n"
    "    Open = Seed < 3 orelse filelib:is_file(\"" ++ Gate ++
        "\"),\n"
        "    Open orelse io:put_chars(\"stuck\\n\"),\n"
        "    Open.\n"
        "step(R, true) -> io:put_chars(\"stepped\\n\"), starl:sleep(R, 1000), {done, ok};\n"
        "step(R, false) -> starl:sleep(R, 1), {continue, false}.\n".

%% A run that breaks a contract is a row, is told with its replay, and makes the status 3, also
%% when the sweep is run again.
violation_test_() ->
    {timeout, ?PATIENCE_S, fun() ->
        in_directory(fun(Dir) ->
            [File, Out] = [filename:join(Dir, N) || N <- ["starl_cli_breaker.erl", "out"]],
            ok = file:write_file(File, starl_cli_tests:breaker()),
            Args = ["sweep", File, "--robots", "1..2", "--seeds", "4..4", "--out", Out],
            Text = says(3, "2 runs: 2 A CONTRACT WAS VIOLATED", Args),
            contains("replay: ./starl run " ++ File ++ " --robots 2 --seed 4", Text),
            ?assertEqual(Text, says(3, "", Args))
        end)
    end}.

%% Slices, of which one is killed in its second run and one made in another directory, become the study
%% that one sweep makes, byte by byte; what is missing is named.
slices_test_() ->
    {timeout, 3 * ?PATIENCE_S, fun() ->
        in_directory(fun(Dir) ->
            [File, Gate, One, Here, There] = [
                filename:join(Dir, N)
             || N <- ["starl_cli_gated.erl", "gate", "one", "here", "there"]
            ],
            ok = file:write_file(File, gated(Gate)),
            Args = ["sweep", File, "--robots", "2..5", "--seeds", "10"],
            First = Args ++ ["--slice", "1/4", "--jobs", "1", "--out", Here],
            Port = start(First),
            Begun = until("stuck", Port, ""),
            {os_pid, Pid} = erlang:port_info(Port, os_pid),
            "" = os:cmd("kill -KILL " ++ integer_to_list(Pid)),
            ?assertMatch({137, _}, rest(Port, Begun)),
            ok = file:write_file(Gate, ""),
            Lacking = says(4, "39 of 40 runs are missing", ["join", Here]),
            contains("slice 1/4 lacks 9 of 10; make them with: ", Lacking),
            contains("--seeds 10 --out " ++ Here ++ " --slice 1/4", Lacking),
            says(0, "slice 2/4: 10 runs: 10 complete", Args ++ ["--slice=2/4", "--out=" ++ Here]),
            says(0, "slice 3/4: ", Args ++ ["--slice", "3/4", "--out", There]),
            says(0, "slice 4/4: ", Args ++ ["--slice", "4/4", "--out", Here]),
            says(0, "slice 1/4: 10 runs: 10 complete", First),
            says(0, "40 runs: 40 complete", ["join", Here, There]),
            says(0, "40 runs: 40 complete", Args ++ ["--out", One]),
            [
                ?assertEqual(file:read_file(filename:join(One, Name)), {ok, Bytes})
             || Name <- ["runs.csv", "summary.csv", "curves.csv", "curves.svg"],
                {ok, Bytes} <- [file:read_file(filename:join(Here, Name))]
            ],
            ?assertEqual(41, length(rows(Here))),
            %% every robot has measured once, the seed, of ten runs
            {ok, Curves} = file:read_file(filename:join(Here, "curves.csv")),
            ?assertMatch(
                [[_, "2", "seed", "0.0", "10", "5.5", "1", "10"] | _],
                tl(element(1, starl_lab_csv:parse(Curves)))
            ),
            says(2, "--slice: 4/3: a slice is K/N", Args ++ ["--slice", "4/3"]),
            says(2, "no slice of a sweep is here", ["join", One]),
            Other = filename:join(Dir, "other"),
            More = ["--speed", "400", "--slice", "1/9", "--out", Other],
            says(0, "slice 1/9: 5 runs", Args ++ More),
            says(2, "this is of another sweep than ", ["join", Here, Other])
        end)
    end}.

%% Two programs of one version are not one study: a slice of other code is not gone on with, and the join
%% names it.
%% Holds: Runs of different code are not one study: a slice is not gone on with, `join` names it in
%% one line
%% Red: the code before: all slices are joined
other_code_test_() ->
    {timeout, ?PATIENCE_S, fun() ->
        in_directory(fun(Dir) ->
            [File, Here, There] = [filename:join(Dir, N) || N <- ["starl_cli_gated.erl", "a", "b"]],
            ok = file:write_file(File, gated(Dir)),
            Args = ["sweep", File, "--robots", "1", "--seeds", "3", "--slice"],
            says(0, "slice 1/3: 1 runs", Args ++ ["1/3", "--out", Here]),
            says(0, "slice 2/3: 1 runs", Args ++ ["2/3", "--out", Here]),
            ok = file:write_file(File, string:replace(gated(Dir), "1000", "1001")),
            Wrong = says(
                2, "slice-1-of-3.csv: its runs are of other code, ", Args ++ ["1/3", "--out", Here]
            ),
            contains("; name another directory with --out, or remove this file", Wrong),
            says(0, "slice 3/3: 1 runs", Args ++ ["3/3", "--out", There]),
            Named = says(2, "b/slice-3-of-3.csv is of other code, ", ["join", There, Here]),
            contains("; the other slices are of ", Named),
            ?assertEqual(1, occurrences("\n", Named)),
            %% the code that they have is the first one again
            ok = file:write_file(File, gated(Dir)),
            [ok = file:delete(F) || F <- filelib:wildcard(filename:join(There, "slice*"))],
            says(0, "slice 3/3: 1 runs", Args ++ ["3/3", "--out", There]),
            says(0, "3 runs: 3 complete", ["join", There, Here]),
            %% a study that is whole is gone on with by its own code alone
            ok = file:write_file(File, string:replace(gated(Dir), "1000", "1001")),
            says(
                2,
                "runs.csv: its runs are of other code, ",
                lists:droplast(Args) ++ ["--out", There]
            )
        end)
    end}.

%% Each run belongs to one slice.
parts_test() ->
    Runs = lists:seq(1, 10),
    [
        ?assertEqual(
            Runs,
            lists:sort(lists:append([starl_lab_slice:part({K, N}, Runs) || K <- lists:seq(1, N)]))
        )
     || N <- [1, 2, 3, 10, 13]
    ].

slice_texts_test() ->
    ?assertEqual({ok, whole}, starl_lab_slice:read(none)),
    ?assertEqual({ok, {3, 8}}, starl_lab_slice:read("3/8")),
    [
        ?assertMatch({error, _}, starl_lab_slice:read(T))
     || T <- ["", "3", "0/8", "9/8", "a/b", "1/2/3", "1/8x"]
    ].

%% -- jobs of Slurm --------------------------------------------------------------------------

%% The number of slices stands in the script; words are quoted as a shell takes them.
scripts_test() ->
    Study = #{
        words => ["painting", "--picture", "it's"],
        parts => 8,
        jobs => 2,
        starl => "/opt/star l/starl",
        cwd => "/home/lab"
    },
    [{"slice.sh", Slice}, {"join.sh", Join}] = [
        {Name, unicode:characters_to_list(Text)}
     || {Name, Text} <- starl_lab_slurm:scripts(Study, "out/study")
    ],
    ?assertEqual(
        "#!/bin/sh\n"
        "#SBATCH --job-name=study\n"
        "#SBATCH --chdir=/home/lab\n"
        "#SBATCH --output=out/study/slice-%a.log\n"
        "#SBATCH --array=1-8\n"
        "#SBATCH --cpus-per-task=2\n"
        "exec '/opt/star l/starl' sweep painting --picture 'it'\\''s' --out out/study --jobs 2 "
        "--slice \"$SLURM_ARRAY_TASK_ID/8\"\n",
        Slice
    ),
    contains(
        "#SBATCH --output=out/study/join.log\nexec '/opt/star l/starl' join out/study\n", Join
    ).

slurm_flags_test() ->
    Values = #{slurm => none, 'no-submit' => false, slice => none},
    ?assertEqual(none, starl_lab_slurm:wanted(Values)),
    ?assertEqual({4, write}, starl_lab_slurm:wanted(Values#{slurm := 4, 'no-submit' := true})),
    [
        ?assertMatch({error, _}, starl_lab_slurm:wanted(maps:merge(Values, Wrong)))
     || Wrong <- [#{'no-submit' => true}, #{slurm => 4, slice => "1/4"}]
    ].

%% The flags that change no run are no part of a study's name.
plain_test() ->
    ?assertEqual(
        ["painting", "--robots", "4"],
        starl_lab_sweep_study:plain(
            ["painting", "--slurm", "8", "--no-submit", "--robots", "4", "--out=x", "--jobs", "2"]
        )
    ).

scripts_without_slurm_test_() ->
    {timeout, ?PATIENCE_S, fun() ->
        in_directory(fun(Dir) ->
            Out = filename:join(Dir, "study"),
            Args = ["sweep", "painting", "--robots", "1..2", "--seeds", "1", "--out", Out],
            says(2, "--no-submit: it goes with --slurm N", Args ++ ["--no-submit"]),
            says(2, "--robots: ", Args ++ ["--robots=1..x", "--slurm", "2", "--no-submit"]),
            ?assertEqual({ok, []}, file:list_dir(Dir)),
            Told = says(0, "sbatch --parsable ", Args ++ ["--slurm", "2", "--no-submit"]),
            contains("sbatch --dependency=afterany:$job " ++ Out ++ "/join.sh", Told),
            {ok, Names} = file:list_dir(Out),
            ?assertEqual(["join.sh", "slice.sh"], lists:sort(Names)),
            says(0, "slice 1/2: ", Args ++ ["--slice", "1/2"]),
            says(4, "or submit them: sbatch --array=2 " ++ Out ++ "/slice.sh", ["join", Out])
        end)
    end}.
