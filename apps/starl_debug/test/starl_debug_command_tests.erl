%% What `debug', `judge --sigma' and `merge' say of recordings that are made here, bad ones among them.
%%
%% Holds: A team is not judged by some of its robots; a recording is merged once
%% Red: 961f67c9, run: exit 0; `function_clause`
-module(starl_debug_command_tests).

-include_lib("eunit/include/eunit.hrl").

-define(PATIENCE_S, 60).
-define(END, 6000000).
%% Two holders of a token: for 30 ms, and never by less than 20 ms.
-define(BOTH, [{1, 1000000, 3030000}, {2, 3000000, 5000000}]).
-define(APART, [{1, 1000000, 3000000}, {2, 3020000, 5000000}]).

-define(OWNERS, ["--predicate", "two_owners", "--sigma", "5ms", "--quiet"]).

%% -- recordings -------------------------------------------------------------------------------

%% Who held the token from when to when, by its own clock.
holds(Holds) ->
    lists:append([
        [
            event(A - 10000, 1, {granted, t, starl_mutex_home:hand_over(fence(R)), R}),
            event(A, R, {acquired, t, fence(R)}),
            event(B, R, {released, t, fence(R)})
        ]
     || {R, A, B} <- Holds
    ]).

%% Fences grow with the hand-overs of the token's home.
fence(Robot) -> 10000000 * Robot.

event(At, Robot, Event) -> {trace, At, {Robot, mutex, Event}}.

%% Something that does not matter here, so that a chunk is full and the recording goes on.
talk(Robots) -> [{log, At, {info, R, "on"}} || At <- lists:seq(0, ?END, 250000), R <- Robots].

%% A recording of the world.
world(Messages) -> recording(#{}, Messages ++ talk([1, 2])).

%% The recording of a robot itself, of a run that has robots 1 to 3.
own(Robot, Messages) ->
    recording(#{told_by => [Robot]}, Messages ++ talk([Robot])).

recording(More, Messages) ->
    Facts = #{
        kind => live,
        app => made,
        scenario => #{seed => 1},
        robots => [{R, {0.0, 0.0, 0.0}} || R <- [1, 2]],
        monitors => [{starl_mutex_monitor, #{robots => [1, 2]}}],
        machines => #{},
        waypoints => #{},
        run => 1
    },
    [{scenario, 0, maps:merge(Facts, More)} | lists:keysort(2, Messages)].

of_run(Run, [{scenario, At, Facts} | Messages]) -> [{scenario, At, Facts#{run := Run}} | Messages].

of_team(Robots, [{scenario, At, Facts} | Messages]) ->
    [{scenario, At, Facts#{robots := [{R, {0.0, 0.0, 0.0}} || R <- Robots]}} | Messages].

write(Dir, Name, Messages) ->
    {Head, Writer0} = starl_trace_writer:new(),
    {Bytes, Writer} = starl_trace_writer:messages(Messages, Writer0),
    File = filename:join(Dir, Name),
    ok = file:write_file(File, [Head, Bytes, starl_trace_writer:finish(Writer)]),
    File.

%% The first part of a file, as after a crash.
cut(Share, File) ->
    {ok, Bytes} = file:read_file(File),
    ok = file:write_file(File, binary:part(Bytes, 0, round(Share * byte_size(Bytes)))),
    File.

in_directory(Test) ->
    {timeout, ?PATIENCE_S, fun() ->
        Dir = filename:join("/tmp", "starl-debug-tests-" ++ os:getpid()),
        ok = filelib:ensure_path(Dir),
        try
            Test(Dir)
        after
            ok = file:del_dir_r(Dir)
        end
    end}.

says(Status, Parts, Args) ->
    {Got, Text} = starl_cli_said:said(Args),
    ?assertEqual({Status, Args, Text}, {Got, Args, Text}),
    [
        ?assertNotEqual({Part, nomatch, Text}, {Part, string:find(Text, Part), Text})
     || Part <- Parts
    ],
    Text.

one_line(Status, Part, Args) ->
    Text = says(Status, [Part], Args),
    ?assertEqual({Text, 1}, {Text, length(string:lexemes(Text, "\n"))}).

%% -- what is missing ----------------------------------------------------------------------------

a_whole_recording_is_never_test_() ->
    in_directory(fun(Dir) ->
        File = write(Dir, "a.mcap", world(holds(?APART))),
        says(0, ["NEVER true\n"], ["debug", File | ?OWNERS])
    end).

a_cut_recording_is_not_never_test_() ->
    in_directory(fun(Dir) ->
        File = cut(0.6, write(Dir, "a.mcap", world(holds(?APART)))),
        Text = says(5, ["cut off at ", "; after that not all is known"], ["debug", File | ?OWNERS]),
        ?assertEqual(nomatch, string:find(Text, "NEVER true\n")),
        %% before its end it is as good as any other
        says(0, ["NEVER true\n"], ["debug", File, "--until", "1" | ?OWNERS])
    end).

a_hole_is_not_never_test_() ->
    in_directory(fun(Dir) ->
        Hole = {gap, 3500000, {hole, 4000000}},
        File = write(Dir, "a.mcap", world([Hole | holds(?APART)])),
        Line = "a part is missing, from 3.500 s to 4.000 s",
        says(5, [Line, "NEVER true until 3.4"], ["debug", File | ?OWNERS]),
        says(0, [Line, "NEVER true\n"], ["debug", File, "--until", "3" | ?OWNERS]),
        Few = write(Dir, "b.mcap", world([{gap, 3500000, 12} | holds(?APART)])),
        says(5, ["12 events are missing after 3.500 s"], ["debug", Few | ?OWNERS])
    end).

%% The hole may have had the end of the first hold.
behind_a_hole_nothing_is_certain_test_() ->
    in_directory(fun(Dir) ->
        Hole = {gap, 2000000, {hole, 2500000}},
        says(3, [], ["debug", write(Dir, "a.mcap", world(holds(?BOTH))) | ?OWNERS]),
        says(6, ["POSSIBLY"], [
            "debug", write(Dir, "b.mcap", world([Hole | holds(?BOTH)])) | ?OWNERS
        ]),
        Later = {gap, 5500000, {hole, 5600000}},
        says(3, [], ["debug", write(Dir, "c.mcap", world([Later | holds(?BOTH)])) | ?OWNERS])
    end).

%% What is missing of a robot matters if the predicate speaks of it.
a_cut_recording_of_another_robot_test_() ->
    in_directory(fun(Dir) ->
        One = write(Dir, "robot-1.mcap", own(1, holds([hd(?APART)]))),
        Two = cut(0.5, write(Dir, "robot-2.mcap", own(2, []))),
        says(0, ["robot-2.mcap: cut off at"], [
            "debug", One, Two, "--quiet", "--predicate", "r1.mode = down"
        ]),
        says(5, ["robot-2.mcap: cut off at"], [
            "debug", One, Two, "--quiet", "--predicate", "r2.mode = down"
        ])
    end).

%% The next recording of a robot that was killed has the end of the one before.
what_the_next_recording_tells_is_not_missing_test_() ->
    in_directory(fun(Dir) ->
        First = cut(0.6, write(Dir, "robot-1.mcap", own(1, []))),
        Next = recording(#{told_by => [1], was_up => true, begun_us => 3000000}, [
            {log, At, {info, 1, "on"}}
         || At <- lists:seq(3000000, ?END, 250000)
        ]),
        Second = write(Dir, "robot-1.2.mcap", Next),
        Third = write(Dir, "robot-1.3.mcap", Next),
        Two = write(Dir, "robot-2.mcap", own(2, [])),
        says(0, ["NEVER true\n"], ["debug", First, Second, Two | ?OWNERS]),
        says(5, ["robot-1.2.mcap is missing"], ["debug", First, Third, Two | ?OWNERS]),
        says(5, ["robot-1.mcap is missing"], ["debug", Second, Two | ?OWNERS])
    end).

%% -- names --------------------------------------------------------------------------------------

%% What the recording cannot have is no NEVER.
misspelt_names_are_refused_test_() ->
    in_directory(fun(Dir) ->
        File = write(Dir, "a.mcap", world(holds(?BOTH))),
        Refused = fun(Column, Part, Text) ->
            Line = lists:concat(["--predicate, column ", Column, ": ", Part]),
            one_line(2, Line, ["debug", File, "--quiet", "--predicate", Text])
        end,
        Refused(10, "no machine is called mutx (did you mean mutex?)", "last(r1, mutx) = acquired"),
        Refused(
            19, "mutex traces no aquired (did you mean acquired?)", "last(r1, mutex) = aquired"
        ),
        Refused(31, "mutex traces no gone", "up(r1) and last(r2, mutex) != gone"),
        Refused(28, "mutex traces no gone", "exists r: last(r, mutex) = gone"),
        Refused(10, "no machine is called sap", "last(r1, sap) = sent"),
        Refused(4, "the team has no robot r9", "up(r9)"),
        Refused(14, "the team has no robot r3", "dist(r1.pos, r3.pos) < 1 m or up(r7)"),
        Refused(9, "no mode is called mooving (did you mean moving?)", "r1.mode = mooving"),
        Refused(1, "a robot has no mod (did you mean mode?)", "r1.mod = moving"),
        Refused(1, "no predicate is called two_owner (did you mean two_owners?)", "two_owner"),
        Refused(8, "no unit is called meter", "r1.x < 3 meter")
    end).

%% Tokens have any names; one that was never held may be misspelt.
names_that_never_occur_are_remarked_test_() ->
    in_directory(fun(Dir) ->
        File = write(Dir, "a.mcap", world([event(50, 1, {acquired, lock, 7}) | holds(?BOTH)])),
        Asked = fun(Text) -> ["debug", File, "--quiet", "--predicate", Text] end,
        says(
            0,
            ["no robot has held the token lok (did you mean lock?)", "NEVER"],
            Asked("owner(r1, lok)")
        ),
        says(0, ["no message to an area was sent", "NEVER"], Asked("late_geocast(5 s)")),
        says(0, ["3 different robots are asked for, there are 2"], Asked("exists a, b, c: up(a)")),
        says(0, ["none has the machine dpp_coordinator", "NEVER"], Asked("two_coordinators")),
        says(0, ["no election was decided"], Asked("two_leaders")),
        Known = says(3, [], Asked("exists a, token t: owner(a, t) and owner(a, lock)")),
        ?assertEqual(nomatch, string:find(Known, "no robot"))
    end).

%% A machine without a vocabulary may trace anything.
an_application_may_trace_anything_test_() ->
    in_directory(fun(Dir) ->
        Traced = [{trace, 1000, {1, app, {reached, 3}}}],
        File = write(Dir, "a.mcap", world(Traced)),
        Asked = fun(Text) -> ["debug", File, "--quiet", "--predicate", Text] end,
        says(3, ["CERTAINLY"], Asked("last(r1, app) = reached")),
        says(
            0,
            ["no event of app is called reachd (did you mean reached?)"],
            Asked("last(r1, app) = reachd")
        )
    end).

%% -- contracts and clocks -----------------------------------------------------------------------

judge_knows_how_far_clocks_differ_test_() ->
    in_directory(fun(Dir) ->
        Both = write(Dir, "both.mcap", world(holds(?BOTH))),
        Apart = write(Dir, "apart.mcap", world(holds(?APART))),
        says(0, ["mutex, two_holders: kept, for all"], ["judge", Apart, "--sigma", "15ms"]),
        says(6, ["mutex, two_holders: depends on the clocks\n"], [
            "judge", Apart, "--sigma", "50ms"
        ]),
        says(3, ["mutex, two_holders: broken, for all"], ["judge", Both, "--sigma", "5ms"]),
        says(6, ["by the times of the recording it is broken"], ["judge", Both, "--sigma", "50ms"])
    end).

%% Robot 2's clock is ahead; packets take 5 ms.
packets(AheadUs) ->
    {
        lists:append([
            [way(T, 1, {sent, 2, T}), way(T + 10000, 1, {came, 2, T})]
         || T <- lists:seq(100000, ?END, 500000)
        ]),
        lists:append([
            [way(T + 5000 + AheadUs, 2, {came, 1, T}), way(T + 5000 + AheadUs, 2, {sent, 1, T})]
         || T <- lists:seq(100000, ?END, 500000)
        ])
    }.

way(At, Robot, {sent, To, Hash}) ->
    {ways, At, {Robot, {sent, To, {data, app, 1}, 40, Hash}}};
way(At, Robot, {came, From, Hash}) ->
    {ways, At, {Robot, {came, From, {data, app, 1}, 40, Hash, {arrives, [{At, intact}]}}}}.

pair(Dir, Ahead) ->
    {Of1, Of2} = packets(Ahead),
    [write(Dir, "robot-1.mcap", own(1, Of1)), write(Dir, "robot-2.mcap", own(2, Of2))].

merge_says_how_far_packets_bound_the_clocks_test_() ->
    in_directory(fun(Dir) ->
        Out = filename:join(Dir, "merged.mcap"),
        Text = says(0, ["clocks: by the packets any two differ by 5."], [
            "merge" | pair(Dir, 0) ++ ["--out", Out]
        ]),
        ?assertNotEqual(nomatch, string:find(Text, "./starl judge " ++ Out ++ " --sigma 6ms"))
    end).

%% A pose that came late makes the place as uncertain as the robot is fast.
an_old_pose_makes_places_uncertain_test_() ->
    in_directory(fun(Dir) ->
        At = fun(R, X) ->
            Poses = [
                {poses, T, #{full => true, robots => [{R, {X, 0.0, 0.0}, none, unknown}]}}
             || T <- lists:seq(0, ?END, 50000)
            ],
            write(Dir, lists:concat(["robot-", R, ".mcap"]), own(R, Poses))
        end,
        Args = ["debug", At(1, 0.0), At(2, 500.0), "--predicate", "too_near(400 mm)"],
        Sharp = ["--sigma", "0", "--speed", "500", "--quiet", "--pose-age"],
        says(0, ["NEVER true\n"], Args ++ Sharp ++ ["0"]),
        says(6, ["POSSIBLY"], Args ++ Sharp ++ ["100"])
    end).

%% -- bad recordings -----------------------------------------------------------------------------

%% What is said of all robots is not known of those that are not there.
a_robot_without_a_recording_test_() ->
    in_directory(fun(Dir) ->
        [One, Two] = [
            write(Dir, lists:concat(["robot-", R, ".mcap"]), of_team([1, 2, 3], own(R, [])))
         || R <- [1, 2]
        ],
        says(5, ["no recording of r3\n", "NEVER true of the robots that are here"], [
            "debug", One, Two | ?OWNERS
        ]),
        says(0, ["no recording of r3\n"], [
            "debug", One, Two, "--quiet", "--predicate", "owner(r1, t)"
        ]),
        one_line(2, "the recording has no robot r3", [
            "debug", One, Two, "--predicate", "owner(r3, t)"
        ])
    end).

%% Nor is a contract over the team kept as far as anybody knows, if robots are missing.
a_team_is_not_judged_by_some_of_its_robots_test_() ->
    in_directory(fun(Dir) ->
        [One, Two] = [
            write(Dir, lists:concat(["robot-", R, ".mcap"]), of_team([1, 2, 3], own(R, [])))
         || R <- [1, 2]
        ],
        Alone = says(
            5,
            [
                "not judged: mutex: the recordings of robots 2, 3 are missing; merge them, too\n",
                "NOT JUDGED FOR THE TEAM; in what each robot shows alone no contract is broken\n"
            ],
            ["judge", One]
        ),
        ?assertEqual(nomatch, string:find(Alone, "\nno contract is broken")),
        Merged = filename:join(Dir, "merged.mcap"),
        says(0, ["the recording of robot 3 is missing"], ["merge", One, Two, "--out", Merged]),
        Line = "not judged: mutex: the recording of robot 3 is missing; merge it, too\n",
        says(5, [Line], ["judge", Merged]),
        ByClocks = says(5, [Line], ["judge", Merged, "--sigma", "5ms"]),
        ?assertEqual(nomatch, string:find(ByClocks, "kept"))
    end).

%% The same time told twice: a copy under another name.
overlapping_recordings_test_() ->
    in_directory(fun(Dir) ->
        One = write(Dir, "robot-1.mcap", own(1, holds([hd(?BOTH)]))),
        Same = write(Dir, "copy.mcap", own(1, holds([hd(?BOTH)]))),
        Two = write(Dir, "robot-2.mcap", own(2, [])),
        one_line(2, "both tell of r1 at the same time", ["debug", One, Same, Two | ?OWNERS]),
        one_line(2, "robot-1.mcap: given twice", ["debug", One, One, Two | ?OWNERS])
    end).

%% Merged they would accuse the robot of all that it did twice.
a_recording_is_merged_once_test_() ->
    in_directory(fun(Dir) ->
        {Of1, _} = packets(0),
        One = write(Dir, "robot-1.mcap", own(1, Of1 ++ holds([hd(?BOTH)]))),
        Two = write(Dir, "robot-2.mcap", own(2, [])),
        ok = filelib:ensure_path(filename:join(Dir, "copies")),
        Merge = fun(Files) -> ["merge" | Files] ++ ["--out", filename:join(Dir, "merged.mcap")] end,
        Duplicate = fun(File) -> lists:concat(["duplicate of robot 1: ", One, ", ", File, ";"]) end,
        one_line(2, Duplicate(One), Merge([One, One, Two])),
        [
            begin
                {ok, _} = file:copy(One, Copy),
                one_line(2, Duplicate(Copy), Merge([One, Two, Copy]))
            end
         || Name <- ["copy.mcap", "copies/robot-1.mcap", "robot-1.2.mcap"],
            Copy <- [filename:join(Dir, Name)]
        ],
        %% of a robot that had two recorders
        Other = [{log, At, {info, 1, "other"}} || At <- lists:seq(100, ?END div 2, 250000)],
        Beside = write(Dir, "beside.mcap", recording(#{told_by => [1], begun_us => 100}, Other)),
        one_line(2, Duplicate(Beside), Merge([One, Beside, Two])),
        %% and a merged one beside its parts
        Whole = filename:join(Dir, "whole.mcap"),
        says(0, [], ["merge", One, Two, "--out", Whole]),
        one_line(2, "duplicate of robot 1: ", Merge([Whole, One]))
    end).

a_recording_of_another_run_test_() ->
    in_directory(fun(Dir) ->
        One = write(Dir, "robot-1.mcap", own(1, [])),
        Two = write(Dir, "robot-2.mcap", of_run(2, own(2, []))),
        one_line(2, "robot-2.mcap: not of the run of", ["debug", One, Two | ?OWNERS]),
        Worlds = [write(Dir, Name, world([])) || Name <- ["a.mcap", "b.mcap"]],
        one_line(2, "the recording of a whole run", ["debug" | Worlds ++ ?OWNERS])
    end).

%% No clocks within that sigma explain the packets.
a_clock_beyond_sigma_test_() ->
    in_directory(fun(Dir) ->
        Files = pair(Dir, 100000),
        Args = ["debug" | Files] ++ ["--quiet", "--predicate", "two_owners", "--sigma"],
        one_line(2, "the clocks of r1 and r2 differ by 9", Args ++ ["50ms"]),
        says(0, ["NEVER true\n"], Args ++ ["110ms"]),
        says(0, ["NEVER true\n", "the clock of r2, less that of r1: 9"], Args ++ ["auto"])
    end).

what_is_no_recording_test_() ->
    in_directory(fun(Dir) ->
        File = filename:join(Dir, "a.mcap"),
        [
            begin
                ok = file:write_file(File, Bytes),
                one_line(2, "a.mcap", ["debug", File | ?OWNERS])
            end
         || Bytes <- [<<>>, <<"no recording">>, binary:copy(<<0>>, 1000)]
        ],
        cut(0.02, write(Dir, "a.mcap", world([]))),
        one_line(2, "a.mcap", ["debug", File | ?OWNERS]),
        one_line(2, "no such file", ["debug", filename:join(Dir, "b.mcap") | ?OWNERS])
    end).
