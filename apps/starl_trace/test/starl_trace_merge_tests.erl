%% One recording of those of several robots: the order of its messages, and its end.
-module(starl_trace_merge_tests).
-include_lib("eunit/include/eunit.hrl").

%% Calls the test with the messages of the recording into which these are merged.
merged(Recordings, Test) ->
    Dir = filename:join("/tmp", "starl-merge-tests-" ++ os:getpid()),
    ok = filelib:ensure_path(Dir),
    try
        Files = [recorded(N, Messages, Dir) || {N, Messages} <- lists:enumerate(Recordings)],
        Out = filename:join(Dir, "merged.mcap"),
        {ok, _} = starl_trace_merge:files(Files, Out),
        {ok, Read, closed} = starl_trace_reader:fold(fun(M, Before) -> [M | Before] end, [], Out),
        Test(lists:reverse(Read))
    after
        file:del_dir_r(Dir)
    end.

recorded(N, Messages, Dir) ->
    File = filename:join(Dir, integer_to_list(N) ++ ".mcap"),
    ok = starl_trace_ct:recorded(File, Messages),
    File.

%% The recording of a robot with these events, which says how the run ended.
robot(Robot, Events, Ending) ->
    [{scenario, At, Facts} | Messages] = starl_trace_ct:told(Events),
    Robots = [{R, {0.0, 0.0, 0.0}} || R <- [1, 2, 3]],
    [{scenario, At, Facts#{told_by => [Robot], robots := Robots}}] ++
        [M || {Topic, _, _} = M <- Messages, Topic =/= verdicts] ++ [{verdicts, 1_000_000, Ending}].

ended(EndUs, Whats) ->
    {ended, #{
        ending => done, end_us => EndUs, violations => [broken(W) || W <- Whats], digest => <<>>
    }}.

broken(What) ->
    #{contract => sap, what => What, at_us => 5, robots => [1], details => #{}}.

%% All that robots tell comes by time: their events, and the packets, whose fates are known late, from what
%% both ends know of them.
%% Holds: Merge: not in the order of time; only the last end's violations
%% Red: d299859; told by f18af74
by_time_test() ->
    merged([starl_trace_ct:robots_own(R, 300) || R <- [1, 2]], fun(Messages) ->
        Times = [At || {_, At, _} <- Messages],
        ?assertEqual(lists:sort(Times), Times),
        Topics = [Topic || {Topic, _, _} <- Messages],
        ?assertEqual([], [packets, trace, poses, log] -- lists:usort(Topics)),
        ?assertEqual(600, length([E || {trace, _, {_, note, {said, _, _}} = E} <- Messages]))
    end).

%% What a robot says at one time stays in its own order.
own_order_test() ->
    Say = fun(R) -> [{1000 * At, R, note, {said, N}} || At <- [1, 2], N <- [1, 2]] end,
    Robots = [robot(R, Say(R), ended(3000, [])) || R <- [2, 1, 3]],
    merged(Robots, fun(Messages) ->
        Said = [{At, R, N} || {trace, At, {R, note, {said, N}}} <- Messages],
        ?assertEqual(lists:sort([At || {At, _, _} <- Said]), [At || {At, _, _} <- Said]),
        [
            ?assertEqual(
                [{1000 * At, N} || At <- [1, 2], N <- [1, 2]],
                [{At, N} || {At, Robot, N} <- Said, Robot =:= R]
            )
         || R <- [1, 2, 3]
        ]
    end).

%% The run has one end, the last that a file knows, with the violations of all of them.
one_end_with_all_violations_test() ->
    Ends = [ended(2000, [a, b]), ended(3000, [c]), ended(1000, [b, d])],
    Orders = [Ends, lists:reverse(Ends), [lists:nth(N, Ends) || N <- [2, 1, 3]]],
    [
        merged([robot(R, [], Ending) || {R, Ending} <- lists:enumerate(Order)], fun(Messages) ->
            [{At, #{end_us := End, violations := Violations}}] = [
                {At, E}
             || {verdicts, At, {ended, E}} <- Messages
            ],
            ?assertEqual(
                {3000, 3000, [a, b, c, d]}, {At, End, [W || #{what := W} <- Violations]}
            )
        end)
     || Order <- Orders
    ].

%% What is said of a merge: from when to when, which files were cut off, in the order in which they end, and
%% whose recordings are missing. The merged file has the facts of the run.
what_is_said_of_a_merge_test() ->
    Dir = filename:join("/tmp", "starl-merge-said-" ++ os:getpid()),
    ok = filelib:ensure_path(Dir),
    try
        Cut = fun(Robot, Begun, Until) ->
            Say = [{At, Robot, note, {said, At}} || At <- lists:seq(1000000, Until, 500000)],
            [{scenario, _, Facts} | Messages] = robot(Robot, Say, ended(9000, [])),
            File = filename:join(Dir, "robot-" ++ integer_to_list(Robot) ++ ".mcap"),
            {Head, Writer0} = starl_trace_writer:new(),
            Told = [M || {Topic, _, _} = M <- Messages, Topic =/= verdicts],
            {Bytes, _} = starl_trace_writer:messages(
                [{scenario, Begun, Facts#{begun_us => Begun, was_up => true}} | Told], Writer0
            ),
            ok = file:write_file(File, [Head, Bytes]),
            File
        end,
        Out = filename:join(Dir, "out.mcap"),
        [First, Second] = Files = [Cut(1, 500, 6000000), Cut(2, 400, 4000000)],
        {ok, Said} = starl_trace_merge:files(Files, Out),
        #{begun_us := Begun, until_us := Until, cut_off := CutOff, bytes := Bytes} = Said,
        ?assertEqual({400, [Second, First]}, {Begun, CutOff}),
        ?assert(Until >= 4000000),
        ?assertEqual(filelib:file_size(Out), Bytes),
        ?assertMatch(#{missing := [3], clocks := []}, Said),
        ?assert(maps:get(messages, Said) >= 11 + 7),
        {ok, [{scenario, 400, Facts} | _] = Read, _} = starl_trace_reader:fold(
            fun(M, All) -> All ++ [M] end, [], Out
        ),
        ?assertMatch(#{told_by := [1, 2], has_motions := false, begun_us := 400}, Facts),
        ?assertNot(is_map_key(was_up, Facts)),
        Says = [At || {trace, At, {_, note, _}} <- Read],
        ?assertEqual(lists:sort(Says), Says),
        Times = [At || {_, At, _} <- Read],
        ?assertEqual(Until, lists:max(Times))
    after
        file:del_dir_r(Dir)
    end.

%% A file that was cut off lacks nothing if the robot's next file begins with what was lost.
cut_off_and_continued_test() ->
    Dir = filename:join("/tmp", "starl-merge-continued-" ++ os:getpid()),
    ok = filelib:ensure_path(Dir),
    try
        Part = fun(Name, Facts1, Says, IsClosed) ->
            Say = [{At, 1, note, {said, At}} || At <- Says],
            [{scenario, _, Facts} | Messages] = robot(1, Say, ended(9000, [])),
            Begun = maps:get(begun_us, Facts1),
            {Head, Writer0} = starl_trace_writer:new(),
            Told = [M || {Topic, _, _} = M <- Messages, Topic =/= verdicts],
            {Bytes, Writer} = starl_trace_writer:messages(
                [{scenario, Begun, maps:merge(Facts, Facts1)} | Told], Writer0
            ),
            End = [starl_trace_writer:finish(Writer) || IsClosed],
            File = filename:join(Dir, Name),
            ok = file:write_file(File, [Head, Bytes, End]),
            File
        end,
        First = Part("robot-1.mcap", #{begun_us => 0}, [1000000, 2000000, 3000000], false),
        Next = fun(WasUp) ->
            More = #{begun_us => 3000000, was_up => WasUp},
            Part("robot-1.2.mcap", More, [4000000, 5000000], true)
        end,
        Out = filename:join(Dir, "out.mcap"),
        Gaps = fun(Files) ->
            {ok, #{cut_off := CutOff}} = starl_trace_merge:files(Files, Out),
            {ok, Read, closed} = starl_trace_reader:fold(fun(M, All) -> [M | All] end, [], Out),
            {CutOff, [Why || {gap, _, Why} <- Read]}
        end,
        ?assertEqual({[], []}, Gaps([First, Next(true)])),
        ?assertEqual({[First], [no_end]}, Gaps([First, Next(false)])),
        ?assertEqual({[First], [no_end]}, Gaps([First]))
    after
        file:del_dir_r(Dir)
    end.

%% Files that cannot be merged are named.
no_recordings_test() ->
    Dir = filename:join("/tmp", "starl-merge-none-" ++ os:getpid()),
    ok = filelib:ensure_path(Dir),
    try
        Merge = fun(File) -> starl_trace_merge:files([File], filename:join(Dir, "out.mcap")) end,
        None = filename:join(Dir, "none.mcap"),
        ok = starl_trace_ct:recorded(None, [{trace, 5, {1, note, {said, 1}}}]),
        ?assertEqual({error, {no_scenario, None}}, Merge(None)),
        {ok, <<Head:200/binary, _/binary>>} = file:read_file(None),
        Short = filename:join(Dir, "short.mcap"),
        ok = file:write_file(Short, Head),
        ?assertEqual({error, {too_short, Short}}, Merge(Short)),
        ?assertMatch({error, {file, "/nowhere", enoent}}, Merge("/nowhere"))
    after
        file:del_dir_r(Dir)
    end.

%% Recordings of other scenarios, applications, kinds or beginnings are of another run.
of_another_run_test() ->
    Dir = filename:join("/tmp", "starl-merge-other-" ++ os:getpid()),
    ok = filelib:ensure_path(Dir),
    try
        Told = fun(Name, Robot, More) ->
            [{scenario, At, Facts} | Messages] = robot(Robot, [], ended(2000, [])),
            File = filename:join(Dir, Name),
            ok = starl_trace_ct:recorded(File, [{scenario, At, maps:merge(Facts, More)} | Messages]),
            File
        end,
        First = Told("1.mcap", 1, #{}),
        [
            ?assertEqual(
                {error, {other_run, First, Other, Key}},
                starl_trace_merge:files([First, Other], filename:join(Dir, "out.mcap"))
            )
         || {Key, Value} <- [
                {app, other}, {scenario, #{seed => 2}}, {epoch_us, 5}, {run, 6}
            ],
            Other <- [Told("2.mcap", 2, #{Key => Value})]
        ]
    after
        file:del_dir_r(Dir)
    end.

%% Between two starts of a robot its clock was set back: its lives follow each other all the same, and none
%% is missing. Another robot tells meanwhile.
a_clock_that_was_set_back_test() ->
    Dir = filename:join("/tmp", "starl-merge-set-back-" ++ os:getpid()),
    ok = filelib:ensure_path(Dir),
    try
        Said = fun(At, Robot, N) -> {At, Robot, note, {said, N}} end,
        Told = fun(Name, Robot, Begun, Events) ->
            [{scenario, At, Facts} | Messages] = robot(Robot, Events, ended(9999, [])),
            File = filename:join(Dir, Name),
            ok = starl_trace_ct:recorded(File, [
                {scenario, At, Facts#{begun_us => Begun}} | Messages
            ]),
            File
        end,
        Files = [
            Told("robot-1.2.mcap", 1, 1000, [Said(1100, 1, 3), Said(6000, 1, 4)]),
            Told("robot-1.mcap", 1, 4000, [Said(4100, 1, 1), Said(5000, 1, 2)]),
            Told("robot-2.mcap", 2, 0, [Said(At, 2, At) || At <- lists:seq(500, 7000, 500)])
        ],
        Out = filename:join(Dir, "merged.mcap"),
        {ok, Merged} = starl_trace_merge:files(Files, Out),
        ?assertMatch(#{lacking := []}, Merged),
        {ok, Read, closed} = starl_trace_reader:fold(fun(M, Before) -> [M | Before] end, [], Out),
        All = [{At, R, N} || {trace, At, {R, note, {said, N}}} <- lists:reverse(Read)],
        ?assertEqual([1, 2, 3, 4], [N || {_, 1, N} <- All]),
        ?assertEqual(14, length([N || {_, 2, N} <- All])),
        ?assertEqual(lists:sort([At || {At, _, _} <- All]), [At || {At, _, _} <- All])
    after
        file:del_dir_r(Dir)
    end.

%% Without the world all is from the robots, but for their scenarios and figures; with it the motions, the ends
%% of robots, faults and verdicts are the world's, and the rest is theirs.
each_part_has_its_share_test() ->
    Chassis = {trace, 2, {1, chassis, stopped}},
    Down = {trace, 3, {1, robot, down}},
    Fell = {trace, 3, {1, sap, crashed}},
    Other = {trace, 4, {2, sap, crashed}},
    Up = {trace, 5, {1, robot, up}},
    Crashed = {trace, 6, {1, sap, crashed}},
    Poses = {poses, 7, #{full => true, robots => []}},
    Faults = {faults, 8, {began, {f1, 0}}},
    Verdict = {verdicts, 9, {violation, x}},
    Log = {log, 9, {info, 1, "a"}},
    Gap = {gap, 9, 3},
    All =
        [{scenario, 0, #{}}, {metrics, 1, #{}}, Chassis, Down, Fell, Other, Up, Crashed] ++
            [Poses, Faults, Verdict, Log, Gap],
    Share = fun(Kind, HasWorld) ->
        {Taken, _} = starl_trace_merge_selection:take(
            All, starl_trace_merge_selection:new(Kind, HasWorld)
        ),
        Taken
    end,
    ?assertEqual(lists:nthtail(2, All), Share(robot, false)),
    ?assertEqual([Chassis, Down, Fell, Poses, Faults, Verdict, Gap], Share(world, true)),
    ?assertEqual([Other, Up, Crashed, Log, Gap], Share(robot, true)).
