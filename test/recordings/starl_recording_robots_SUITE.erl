%% Robots on nodes of their own record what they know themselves. Their recordings, merged, are
%% judged as the run was, also when nodes were killed and when contracts are broken. The cluster runs
%% in a node of its own, since it makes its VM a distributed node.
-module(starl_recording_robots_SUITE).
-include_lib("stdlib/include/assert.hrl").

-define(ON_THE_WAY_US, 2000000).

-compile([export_all, nowarn_export_all]).

-define(SPEED, 10).

suite() -> [{timetrap, {minutes, 5}}].

all() ->
    [
        merged_recordings_are_judged_as_the_run,
        broken_contracts_are_found,
        full_files_are_followed_by_others,
        the_oldest_files_make_room,
        packets_have_their_fates
    ].

init_per_suite(Config) ->
    Own = [Dir || Dir <- code:get_path(), not lists:prefix(code:lib_dir(), Dir)],
    Paths = lists:append([["-pa", filename:absname(D)] || D <- Own, filelib:is_dir(D)]),
    {ok, Conductor, _} = peer:start(#{
        connection => standard_io,
        shutdown => close,
        wait_boot => 60000,
        args => [
            "-nocookie",
            "-kernel",
            "logger_level",
            "none",
            "-kernel",
            "prevent_overlapping_partitions",
            "false"
            | Paths
        ]
    }),
    Dir = filename:join(proplists:get_value(priv_dir, Config), "painting"),
    %% three painters; the node of one is killed, the link of the others is cut while they elect: only
    %% then is it sure that each has something to say to the other
    Cut = [
        {cut_1, 0, 14000, loss, {1, 3}, #{part => 1.0}},
        {cut_3, 0, 14000, loss, {3, 1}, #{part => 1.0}}
    ],
    Painted = peer:call(
        Conductor,
        ?MODULE,
        play,
        [
            #{app => painting, robots => 3, loss => 0.2, faults => Cut},
            [
                {up, 3},
                led,
                {at, 14},
                {for, 3},
                {kill, 2},
                {again, 2},
                {for, 3},
                stop
            ],
            Dir
        ],
        infinity
    ),
    [{conductor, Conductor}, {dir, Dir}, {painted, Painted} | Config].

end_per_suite(Config) -> peer:stop(proplists:get_value(conductor, Config)).

%% -- in the conductor -----------------------------------------------------------------------

%% Runs a scenario on nodes, recorded by the world and by its robots; gives its outcome.
play(Scenario, Script, Dir) -> play(Scenario, Script, none, Dir).

play(Scenario, Script, Most, Dir) ->
    _ = process_flag(trap_exit, true),
    ok = filelib:ensure_path(Dir),
    {ok, Recorder} = starl_trace_recorder:start_link(filename:join(Dir, "run.mcap"), live),
    {ok, Cluster} = starl_world_run:start(Scenario, #{
        dir => filename:join(Dir, "stores"),
        transport => dist,
        speed => ?SPEED,
        packets => true,
        observe => starl_trace_recorder:observer(Recorder),
        recorder => {starl_trace_robot, #{dir => filename:join(Dir, "robots"), most_bytes => Most}}
    }),
    lists:foreach(fun(Step) -> acted(Step, Cluster) end, Script),
    _ = starl_world_run:await(Cluster),
    {Outcome, _} = starl_world_run:finish(Cluster),
    {ok, _} = starl_trace_recorder:close(Recorder),
    maps:with([violations, end_us], Outcome).

acted({at, Second}, Cluster) ->
    ok = starl_world_run:until(Cluster, 1000000 * Second);
acted({for, Seconds}, Cluster) ->
    #{now_us := Now} = starl_world_run:status(Cluster),
    ok = starl_world_run:until(Cluster, Now + 1000000 * Seconds);
acted({again, Robot}, Cluster) ->
    case starl_world_run:status(Cluster) of
        #{restarts := #{Robot := N}, up := Up} when N > 0 ->
            lists:member(Robot, Up) orelse acted_later({again, Robot}, Cluster);
        _ ->
            acted_later({again, Robot}, Cluster)
    end;
acted({up, N} = Step, Cluster) ->
    #{up := Up} = starl_world_run:status(Cluster),
    length(Up) =:= N orelse acted_later(Step, Cluster);
acted(led, Cluster) ->
    %% on a busy computer nodes take their time
    case starl_world_run:status(Cluster) of
        #{leader := none} -> acted_later(led, Cluster);
        #{leader := _} -> ok
    end;
acted({there, File} = Step, Cluster) ->
    #{ending := Ending} = starl_world_run:status(Cluster),
    Ending =/= none orelse filelib:wildcard(File) =/= [] orelse acted_later(Step, Cluster);
acted({kill, Robot}, Cluster) ->
    ok = starl_world_run:inject(Cluster, [{reboot, Robot, #{}, 0}]);
acted(stop, Cluster) ->
    ok = starl_world_run:stop(Cluster).

acted_later(Step, Cluster) ->
    ok = acted({for, 1}, Cluster),
    acted(Step, Cluster).

%% -- tests ----------------------------------------------------------------------------------

%% Every file is whole, and together they have everything; also where the node is killed.
full_files_are_followed_by_others(Config) ->
    {Dir, Outcome, Files} = rotated(400000, Config),
    ct:log("~p", [
        [{filename:basename(F), filelib:file_size(F), maps:get(ended, info(F))} || F <- Files]
    ]),
    Ended = [maps:get(ended, info(File)) || File <- Files],
    ?assertMatch([cut_off], Ended -- [closed || _ <- Files]),
    %% one more than the killed node makes; how many depends on what the robots did
    ?assert(length(Files) >= 4),
    _ = judged_as(Outcome, [filename:join(Dir, "run.mcap") | Files], Dir),
    ?assertEqual({[], []}, differences(Outcome, Dir)).

%% However long the run, there are no more bytes than were asked for, but for the file that grows.
the_oldest_files_make_room(Config) ->
    Most = 130000,
    {_, _, Files} = rotated(Most, Config),
    ct:log("~p", [
        [{filename:basename(F), filelib:file_size(F), maps:get(ended, info(F))} || F <- Files]
    ]),
    [
        begin
            Own = [File || File <- Files, lists:prefix(Prefix, filename:basename(File))],
            ?assertNot(lists:member(Prefix ++ ".mcap", [filename:basename(File) || File <- Own])),
            ?assert(lists:sum([filelib:file_size(File) || File <- Own]) < 2 * Most)
        end
     || Prefix <- ["robot-1", "robot-2"]
    ].

rotated(Most, Config) ->
    Dir = filename:join(proplists:get_value(priv_dir, Config), integer_to_list(Most)),
    %% a slow computer has robots do less in that time, or more, and the oldest files make room
    Second = {there, filename:join([Dir, "robots", "robot-1.*.mcap"])},
    Outcome = peer:call(
        proplists:get_value(conductor, Config),
        ?MODULE,
        play,
        [
            #{app => painting, robots => 2, loss => 0.2},
            [{at, 24}, {kill, 2}, {again, 2}, {for, 1}, Second, stop],
            Most,
            Dir
        ],
        infinity
    ),
    {Dir, Outcome, robots_files(Dir)}.

merged_recordings_are_judged_as_the_run(Config) ->
    Dir = proplists:get_value(dir, Config),
    #{end_us := End} = Outcome = proplists:get_value(painted, Config),
    Files = robots_files(Dir),
    %% a killed node goes on in a new file
    ?assertEqual(
        ["robot-1.mcap", "robot-2.2.mcap", "robot-2.mcap", "robot-3.mcap"],
        [filename:basename(File) || File <- Files]
    ),
    ?assertEqual(
        [closed, closed, cut_off, closed], [maps:get(ended, info(File)) || File <- Files]
    ),
    Without = judged_as(Outcome, Files, Dir),
    ?assertEqual(
        [starl_dpp_monitor, starl_motion_monitor, starl_painting_monitor],
        lists:sort([Module || {Module, motions} <- maps:get(not_judged, Without)])
    ),
    With = judged_as(Outcome, [filename:join(Dir, "run.mcap") | Files], Dir),
    ?assertMatch(#{not_judged := [], until_us := End}, With),
    %% nothing that the killed node has done is lost
    ?assertEqual({[], []}, differences(Outcome, Dir)),
    %% one robot alone is not judged by what the others did
    {ok, #{not_judged := Alone}} = starl_trace_judge:file(hd(Files)),
    ?assertNot(lists:keymember(starl_crash_monitor, 1, Alone)),
    ?assertMatch({_, robots}, lists:keyfind(starl_sap_monitor, 1, Alone)).

%% Merges and judges; the verdicts are those of the run, but for the contracts that are not judged.
judged_as(#{violations := Violations, end_us := End}, Files, Dir) ->
    Merged = filename:join(Dir, "merged.mcap"),
    {ok, #{cut_off := [], missing := [], clocks := []}} = starl_trace_merge:files(Files, Merged),
    {ok, #{violations := Again, not_judged := Not, missing := 0, ended := closed} = Judged} =
        starl_trace_judge:file(Merged),
    Names = [list_to_atom(starl_monitor:name(Module)) || {Module, _} <- Not],
    Wanted = [V || #{contract := Contract} = V <- Violations, not lists:member(Contract, Names)],
    ?assertEqual({[], []}, {
        shapes(early(Wanted, End)) -- shapes(Again), shapes(early(Again, End)) -- shapes(Wanted)
    }),
    Judged.

%% Robots go on for a moment after the end of the run, and what they have told last is still on its way
%% then.
early(Violations, End) -> [V || #{at_us := At} = V <- Violations, At < End - ?ON_THE_WAY_US].

shapes(Violations) ->
    lists:sort([{C, W, R} || #{contract := C, what := W, robots := R} <- Violations]).

robots_files(Dir) -> lists:sort(filelib:wildcard(filename:join([Dir, "robots", "*.mcap"]))).

info(File) ->
    {ok, Info} = starl_trace_info:file(File),
    Info.

%% What the run knows and the robots do not, and the other way round.
differences(#{end_us := End}, Dir) ->
    {Merged, Told} = events(filename:join(Dir, "merged.mcap"), End),
    {Whole, Known} = events(filename:join(Dir, "run.mcap"), End),
    {Known -- Merged, Told -- Whole}.

%% All events but the times, which files of robots may have a little later; and those that are not near
%% the end.
events(File, End) ->
    {ok, Events, closed} = starl_trace_reader:fold(
        fun
            ({trace, At, Event}, Events) -> [{At, Event} | Events];
            (_, Events) -> Events
        end,
        [],
        File
    ),
    {
        lists:sort([Event || {_, Event} <- Events]),
        lists:sort([Event || {At, Event} <- Events, At < End - ?ON_THE_WAY_US])
    }.

%% SAP says that it has been acknowledged what nobody acknowledged.
broken_contracts_are_found(Config) ->
    Dir = filename:join(proplists:get_value(priv_dir, Config), "planted"),
    Planted = starl_planted:scenario(sap_claims, 1),
    Scenario = (maps:without([random_faults, heal, converge], Planted))#{
        robots := 3, loss => 0.6, time := 60
    },
    Conductor = proplists:get_value(conductor, Config),
    Outcome = peer:call(Conductor, ?MODULE, play, [Scenario, [], Dir], infinity),
    ?assertMatch(#{violations := [#{contract := sap} | _]}, Outcome),
    #{violations := Found} = judged_as(Outcome, robots_files(Dir), Dir),
    ?assertMatch([#{contract := sap} | _], Found).

%% The world's recording and the merged one tell the fate of each packet, as its receiver knows it.
%% Holds: What robots hear and sense by a fault from the time 0 on is so when they begin; one that
%% begins while a node is being started holds there, too
%% Red: 84534397, run: a cut made before the nodes were up cut nothing; 8d7d311c, 5 of 12 runs: a
%% cut from the time 0 on began when the election was over
packets_have_their_fates(Config) ->
    Dir = proplists:get_value(dir, Config),
    #{end_us := End} = proplists:get_value(painted, Config),
    Merged = filename:join(Dir, "packets.mcap"),
    {ok, _} = starl_trace_merge:files(robots_files(Dir), Merged),
    %% only of the killed robot's packets something may be lost
    Came = [C || {_, {From, To, _, _, _}} = C <- came(robots_files(Dir)), From + To =:= 4],
    Early = [Packet || {At, Packet} <- Came, At < End - 2000000],
    [_ | _] = [Packet || {_, _, _, _, {lost, cut}} = Packet <- Early],
    [
        begin
            Told = [P || {From, To, _, _, Fate} = P <- packets(File), is_known(From + To, Fate)],
            ?assertEqual({[], []}, {Early -- Told, Told -- [Packet || {_, Packet} <- Came]})
        end
     || File <- [Merged, filename:join(Dir, "run.mcap")]
    ],
    All = packets(filename:join(Dir, "run.mcap")),
    Losses = [{lists:sort([From, To]), Why} || {From, To, _, _, {lost, Why}} <- All],
    ?assertEqual([chance, cut, unheard], lists:usort([Why || {_, Why} <- Losses])),
    ?assertEqual([[1, 3]], lists:usort([Pair || {Pair, cut} <- Losses])),
    Lost = length([Pair || {Pair, chance} <- Losses]) / length(All),
    ?assert(Lost > 0.05 andalso Lost < 0.3, Lost).

is_known(Sum, Fate) -> Sum =:= 4 andalso Fate =/= {lost, unheard}.

%% What the receivers know, with the time at which they knew it.
came(Files) ->
    lists:append([
        folded(
            fun
                ({ways, At, {To, {came, From, Brief, Bytes, _, Fate}}}, Packets) ->
                    [{At, {From, To, Brief, Bytes, Fate}} | Packets];
                (_, Packets) ->
                    Packets
            end,
            File
        )
     || File <- Files
    ]).

packets(File) ->
    folded(
        fun
            ({packets, _, Packet}, Packets) -> [Packet | Packets];
            (_, Packets) -> Packets
        end,
        File
    ).

folded(Fun, File) ->
    {ok, Found, _} = starl_trace_reader:fold(Fun, [], File),
    Found.
