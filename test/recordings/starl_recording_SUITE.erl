%% Recordings of runs: a recording changes no run, its judgement is that of the run, it survives the
%% end of its process, and the readers of others take it.
%%
%% By hand, for more: STARL_RECORDED_SEEDS=200, STARL_RECORDED_KILLS=50, STARL_RECORDED_FLIPS=200.
-module(starl_recording_SUITE).
-include_lib("stdlib/include/assert.hrl").

-compile([export_all, nowarn_export_all]).

-define(PYTHON, "_build/python/bin/python").

suite() -> [{timetrap, {minutes, 30}}].

all() ->
    [
        a_recording_changes_no_run,
        the_judgement_is_that_of_the_run,
        packets_have_their_fates,
        damage_accuses_nobody,
        a_killed_run_loses_less_than_a_second,
        no_stranger_runs_code,
        the_command_line_records,
        pythons_reader_takes_it,
        gos_reader_takes_all_kinds
    ].

init_per_suite(Config) -> starl_platform_ct:without_log(Config).

end_per_suite(Config) -> starl_platform_ct:with_log(Config).

%% -- verdicts -------------------------------------------------------------------------------

a_recording_changes_no_run(Config) ->
    Scenario = #{
        app => exercise, seed => 3, robots => 4, random_faults => [all], heal => 20, time => 60
    },
    {ok, Sim} = starl_sim:start(Scenario),
    _ = starl_sim:run(Sim),
    {Plain, _} = starl_sim:finish(Sim),
    Recorded = recorded(Scenario, file(Config, "digest.mcap")),
    Keys = [digest, events, packets, end_us, violations],
    ?assertEqual(maps:with(Keys, Plain), maps:with(Keys, Recorded)).

%% Planted bugs, and the sound ones in the same runs, under the faults of soak.
the_judgement_is_that_of_the_run(Config) ->
    Bugs = [Bug || {Bug, _, _} <- starl_planted:bugs()],
    Each = max(1, number("STARL_RECORDED_SEEDS", 20) div 20),
    Broken = [
        starl_planted:scenario(Bug, Seed)
     || Bug <- lists:sublist(Bugs, 12), Seed <- seeds(Each)
    ],
    Sound = [starl_planted:sound(S) || S <- lists:sublist(Broken, 1, 4 * Each)],
    Soaked = [
        starl_lab_soak:scenario(Work, none, Seed)
     || Work <- [sap, mutex, dpp, geocast], Seed <- seeds(Each)
    ],
    All = Broken ++ Sound ++ Soaked,
    File = file(Config, "judged.mcap"),
    Found = [judged(Scenario, File) || Scenario <- All],
    ct:pal("~b runs, ~b with violations", [length(All), length([V || V <- Found, V > 0])]),
    ?assert(length([V || V <- Found, V > 0]) >= Each).

seeds(N) -> lists:seq(1, N).

judged(Scenario, File) ->
    #{violations := Violations, end_us := End} = recorded(Scenario, File),
    {ok, Judged} = starl_trace_judge:file(File),
    #{violations := Again, found := Found, until_us := Until, missing := 0, ended := closed} =
        Judged,
    ?assertEqual({Scenario, lists:sort(Violations)}, {Scenario, lists:sort(Again)}),
    ?assertEqual({Violations, End}, {Found, Until}),
    length(Violations).

%% Runs a scenario with a recorder; gives its outcome.
recorded(Scenario, File) ->
    {ok, Recorder} = starl_trace_recorder:start_link(File, simulation),
    {ok, Sim} = starl_sim:start(Scenario#{mode => inline, shards => 1}, #{
        observe => starl_trace_recorder:observer(Recorder), packets => true
    }),
    _ = starl_sim:run(Sim),
    {Outcome, _} = starl_sim:finish(Sim),
    {ok, _} = starl_trace_recorder:close(Recorder),
    Outcome.

%% Every packet of a run is told, and each loss has its cause.
packets_have_their_fates(Config) ->
    File = file(Config, "packets.mcap"),
    Faults = [{wall, 2000, 9000, partition, [1], #{}}],
    Scenario = #{
        app => exercise, seed => 2, robots => 3, loss => 0.2, faults => Faults, time => 15
    },
    {ok, Recorder} = starl_trace_recorder:start_link(File, simulation),
    {ok, Sim} = starl_sim:start(Scenario, #{
        observe => starl_trace_recorder:observer(Recorder),
        packets => true,
        watch => [{starl_run_loss_monitor, #{}}]
    }),
    _ = starl_sim:run(Sim),
    {#{monitors := #{starl_run_loss_monitor := #{lost := Lost}}}, _} = starl_sim:finish(Sim),
    {ok, _} = starl_trace_recorder:close(Recorder),
    {ok, Packets, closed} = starl_trace_reader:fold(
        fun
            ({packets, At, {From, To, _, _, Fate}}, Ps) -> [{At, From, To, Fate} | Ps];
            (_, Ps) -> Ps
        end,
        [],
        File
    ),
    Gone = [{At, From, To} || {At, From, To, {lost, _}} <- Packets],
    ?assertEqual(lists:sort([{At, From, To} || {At, From, To, _} <- Lost]), lists:sort(Gone)),
    Causes = lists:usort([Why || {_, _, _, {lost, Why}} <- Packets]),
    ?assertEqual([chance, {fault, wall}], Causes),
    [?assert(From =:= 1 orelse To =:= 1) || {_, From, To, {lost, {fault, wall}}} <- Packets],
    ?assert(
        lists:all(
            fun
                ({At, _, _, {arrives, [{Then, _} | _]}}) -> Then > At;
                (_) -> true
            end,
            Packets
        )
    ).

%% -- damaged files --------------------------------------------------------------------------

%% A wrong bit or an end that is missing accuses nobody: of a damaged file, and of what is recovered
%% from it, packed or not, no violation is judged that the run had not. What is not judged is said.
%% Holds: A recording with a wrong bit or without its end accuses nobody, as it is and recovered,
%% packed or not
%% Red: e9af1e0 with a recovery that leaves no holes, run: *delivered but not sent* at the second
%% flip
damage_accuses_nobody(Config) ->
    _ = rand:seed(exsss, starl_platform_ct:seed()),
    Whole = file(Config, "to-damage.mcap"),
    Packed = file(Config, "to-damage-packed.mcap"),
    #{violations := []} = recorded(
        #{app => exercise, block => sap, seed => 5, robots => 3, loss => 0.2, time => 20}, Whole
    ),
    {ok, #{not_packed := none}} = starl_mcap_recover:file(Whole, Packed, packed),
    Each = number("STARL_RECORDED_FLIPS", 20),
    Done = [
        damaged(How, File, Config)
     || File <- [Whole, Packed],
        How <- [flip || _ <- seeds(Each)] ++ [cut || _ <- seeds(max(5, Each div 4))]
    ],
    Counts = [{Key, length([x || K <- Done, K =:= Key])} || Key <- lists:usort(Done)],
    ct:pal("~p", [Counts]),
    ?assert(proplists:get_value({flip, part}, Counts, 0) > 0, Counts),
    ?assert(proplists:get_value({cut, part}, Counts, 0) > 0, Counts).

damaged(How, File, Config) ->
    [Damaged, Out] = [file(Config, Name) || Name <- ["wrong.mcap", "wrong-out.mcap"]],
    {ok, Bytes} = file:read_file(File),
    At = rand:uniform(byte_size(Bytes)) - 1,
    Bit = rand:uniform(8) - 1,
    ok = file:write_file(Damaged, damaged(How, At, Bit, Bytes)),
    _ = file:delete(Out),
    Patch = starl_trace_writer:patch(),
    Recovered = starl_mcap_recover:file(Damaged, Out, packed, Patch),
    Judged = [
        starl_trace_judge:file(Damaged) | [starl_trace_judge:file(Out) || {ok, _} <- [Recovered]]
    ],
    Place = {How, filename:basename(File), At, Bit},
    [?assertEqual({Place, []}, {Place, V}) || {ok, #{violations := V}} <- Judged],
    {How, known(lists:last(Judged), Place)}.

%% Is the whole run judged, a part of it, or is nothing known? All there was, or that there is more.
known({ok, #{unjudged := [], until_us := Until, ended := closed}}, Place) ->
    ?assertEqual({Place, 20000000}, {Place, Until}),
    whole;
known({ok, #{unjudged := [_ | _]}}, _Place) ->
    part;
known({error, _}, _Place) ->
    nothing.

damaged(cut, At, _Bit, Bytes) ->
    binary:part(Bytes, 0, At);
damaged(flip, At, Bit, Bytes) ->
    <<Before:At/binary, Byte, After/binary>> = Bytes,
    <<Before/binary, (Byte bxor (1 bsl Bit)), After/binary>>.

%% -- a killed process -----------------------------------------------------------------------

a_killed_run_loses_less_than_a_second(Config) ->
    _ = rand:seed(exsss, starl_platform_ct:seed()),
    [killed(Config, N) || N <- seeds(number("STARL_RECORDED_KILLS", 3))].

killed(Config, N) ->
    File = file(Config, "killed.mcap"),
    Out = file(Config, "rescued.mcap"),
    _ = file:delete(Out),
    Lines = 12 + rand:uniform(60),
    Reached = killed_after(Lines, File, N),
    {ok, #{was_closed := false}} = starl_mcap_recover:file(File, Out),
    {ok, #{violations := [], until_us := Until, ended := closed}} = starl_trace_judge:file(Out),
    ct:pal("killed at ~b us, judged until ~b us", [Reached, Until]),
    ?assert(Until >= Reached - 1000000, {Reached, Until}).

%% The time that the run has printed last when it is killed.
killed_after(Lines, File, Seed) ->
    Paths = lists:append([["-pa", Dir] || Dir <- code:get_path(), filelib:is_dir(Dir)]),
    Args =
        ["-noshell", "-noinput"] ++ Paths ++
            ["-s", "starl_recording_child", "main", "-extra", File, integer_to_list(Seed)],
    Port = open_port({spawn_executable, os:find_executable("erl")}, [
        {args, Args}, {line, 1000}, exit_status, binary
    ]),
    {os_pid, Pid} = erlang:port_info(Port, os_pid),
    Seen = lines(Lines, 0, Port),
    [] = os:cmd("kill -9 " ++ integer_to_list(Pid)),
    until_gone(Port, Seen).

lines(0, Reached, _Port) ->
    Reached;
lines(N, _Reached, Port) ->
    receive
        {Port, {data, {eol, Line}}} -> lines(N - 1, binary_to_integer(Line), Port)
    end.

until_gone(Port, Reached) ->
    receive
        {Port, {data, {eol, Line}}} -> until_gone(Port, max(Reached, binary_to_integer(Line)));
        {Port, {data, _}} -> until_gone(Port, Reached);
        {Port, {exit_status, _}} -> Reached
    end.

%% -- strangers ------------------------------------------------------------------------------

%% A recording may name any module as a monitor: only monitors are called, and with data only.
no_stranger_runs_code(Config) ->
    File = file(Config, "stranger.mcap"),
    Told = file(Config, "told"),
    [{scenario, 0, Facts} | Rest] = starl_trace_ct:told(starl_trace_ct:events(10, 1000)),
    [
        begin
            Strange = {scenario, 0, Facts#{monitors := [Monitor]}},
            ok = starl_trace_ct:recorded(File, [Strange | Rest]),
            ?assertMatch({error, {_, File, _}}, starl_trace_judge:file(File)),
            ?assertNot(filelib:is_file(Told))
        end
     || Monitor <- [
            {file, #{}},
            {no_such_monitor_anywhere, #{}},
            {starl_lab_first_crash, #{tell => fun os:cmd/1}},
            {starl_sap_monitor, #{robots => [self()]}},
            {starl_sap_monitor, not_a_map}
        ]
    ].

%% -- the command line and others' readers ---------------------------------------------------

the_command_line_records(Config) ->
    Dir = file(Config, "run"),
    {4, _} = sh(Config, "run painting --robots 2 --time 20 --record --quiet --out " ++ Dir),
    File = filename:join(Dir, "run.mcap"),
    ?assertEqual(
        [],
        filelib:wildcard(file(Config, "*.mcap.*")) ++ filelib:wildcard(file(Config, "run.*.mcap"))
    ),
    {0, Judged} = sh(Config, "judge " ++ Dir),
    ?assertNotEqual(nomatch, string:find(Judged, "no contract is broken")),
    {0, Info} = sh(Config, "info " ++ File),
    ?assertNotEqual(nomatch, string:find(Info, "foxglove.FrameTransforms")),
    ?assertEqual(starl_mcap_zstd:is_there(), string:find(Info, ", zstd") =/= nomatch),
    {2, Line} = sh(Config, "judge " ++ filename:join(Dir, "report.txt")),
    ?assertNotEqual(nomatch, string:find(Line, "this is no recording")),
    Cut = file(Config, "part.mcap"),
    {ok, Bytes} = file:read_file(File),
    ok = file:write_file(Cut, binary:part(Bytes, 0, byte_size(Bytes) - 2000)),
    {0, _} = sh(Config, "recover " ++ Cut),
    {2, There} = sh(Config, "recover " ++ Cut),
    ?assertNotEqual(nomatch, string:find(There, "is there already")),
    {0, _} = sh(Config, "judge " ++ file(Config, "part-recovered.mcap")).

sh(Config, Command) ->
    starl_first_hour_ct:sh("$starl " ++ Command, proplists:get_value(priv_dir, Config)).

output(Port, Out) ->
    receive
        {Port, {data, Data}} -> output(Port, [Out, Data]);
        {Port, {exit_status, Status}} -> {Status, unicode:characters_to_list(Out)}
    end.

%% The `mcap' package of the makers of the format checks all checksums, with the index and without;
%% every message is JSON.
pythons_reader_takes_it(Config) ->
    Python = filename:join(starl_first_hour_ct:root(), ?PYTHON),
    case filelib:is_file(Python) of
        true -> pythons_reader_takes_it(Python, Config);
        false -> {skip, "no " ?PYTHON " with the package mcap; .ci/run makes it"}
    end.

pythons_reader_takes_it(Python, Config) ->
    File = file(Config, "python.mcap"),
    #{end_us := End} = recorded(#{app => painting, robots => 3, time => 40}, File),
    Lines = counted(File),
    ?assertEqual("end " ++ integer_to_list(1000 * End), lists:last(Lines)),
    [
        begin
            {ok, #{not_packed := none}} = starl_mcap_recover:file(File, File, How),
            {0, Text} = program(Python, [data("read_all.py"), File], []),
            ?assertEqual(Lines, string:lexemes(Text, "\n"))
        end
     || How <- [as_is, packed]
    ].

%% Beside the source: the data_dir of a suite that runs with those of test/ is another one.
data(Name) ->
    Source = proplists:get_value(source, ?MODULE:module_info(compile)),
    filename:join(filename:rootname(Source) ++ "_data", Name).

program(Executable, Args, Options) ->
    Port = open_port({spawn_executable, Executable}, [
        {args, Args}, exit_status, stderr_to_stdout, binary | Options
    ]),
    output(Port, []).

%% The messages of each topic of a file, and the time of the last one, as other readers print them.
counted(File) ->
    {ok, #{topics := Topics}} = starl_trace_info:file(File),
    Lines = [
        lists:flatten(io_lib:format("~ts ~ts ~b", [Topic, Schema, N]))
     || {Topic, Schema, N} <- Topics, N > 0
    ],
    {ok, Reader} = starl_mcap_reader:open(File),
    {ok, Summary} = starl_mcap_reader:summary(Reader),
    ok = starl_mcap_reader:close(Reader),
    [End] = [T1 || {statistics, _, _, _, _, _, _, _, T1, _} <- Summary],
    lists:sort(Lines) ++ ["end " ++ integer_to_list(End)].

%% The Go library of the makers of the format takes files of all kinds, by index and without, with
%% all checksums; the messages are in the order of time.
gos_reader_takes_all_kinds(Config) ->
    Program = file(Config, "read_all"),
    case built(os:find_executable("go"), Program) of
        true -> gos_reader_takes_all_kinds(Program, Config);
        false -> {skip, "no go, or no way to github.com/foxglove/mcap/go/mcap"}
    end.

built(false, _Program) ->
    false;
built(Go, Program) ->
    Where = [{cd, data("read_all")}, {env, [{"GOFLAGS", "-mod=readonly"}, {"GOSUMDB", "off"}]}],
    case program(Go, ["mod", "download"], Where) of
        {0, _} ->
            {0, _} = program(Go, ["build", "-o", Program, "."], Where),
            true;
        _ ->
            false
    end.

gos_reader_takes_all_kinds(Program, Config) ->
    Files = [File || Kind <- kinds(), File <- [file(Config, Kind ++ ".mcap")], made(Kind, File)],
    {0, Text} = program(Program, Files, []),
    Expected = lists:append([[File | counted(File)] || File <- Files]),
    ?assertEqual(Expected, string:lexemes(Text, "\n")),
    %% and says when something is wrong
    [
        begin
            Bad = file(Config, "bad.mcap"),
            ok = file:write_file(Bad, spoilt(How, lists:last(Files))),
            ?assertMatch({How, {1, _}}, {How, program(Program, [Bad], [])})
        end
     || How <- [cut, chunk, summary]
    ].

kinds() -> ["simulated", "packed", "recovered", "empty", "one", "robots_own", "merged"].

made("simulated", File) ->
    _ = recorded(#{app => painting, robots => 3, time => 40}, File),
    true;
made("packed", File) ->
    {ok, #{not_packed := none}} =
        starl_mcap_recover:file(beside(File, "simulated"), File, packed),
    true;
made("recovered", File) ->
    {ok, Bytes} = file:read_file(beside(File, "simulated")),
    Cut = File ++ ".cut",
    ok = file:write_file(Cut, binary:part(Bytes, 0, byte_size(Bytes) div 2)),
    {ok, #{was_closed := false}} = starl_mcap_recover:file(Cut, File),
    true;
made("empty", File) ->
    {Head, Writer} = starl_trace_writer:new(),
    ok = file:write_file(File, [Head, starl_trace_writer:finish(Writer)]),
    true;
made("one", File) ->
    ok = starl_trace_ct:recorded(File, [hd(starl_trace_ct:told([]))]),
    true;
made("robots_own", File) ->
    ok = starl_trace_ct:recorded(File, starl_trace_ct:robots_own(1, 300)),
    ok = starl_trace_ct:recorded(File ++ ".other", starl_trace_ct:robots_own(2, 300)),
    true;
made("merged", File) ->
    Own = beside(File, "robots_own"),
    {ok, _} = starl_trace_merge:files([Own, Own ++ ".other"], File),
    true.

beside(File, Kind) -> filename:join(filename:dirname(File), Kind ++ ".mcap").

spoilt(How, File) ->
    {ok, Bytes} = file:read_file(File),
    Size = byte_size(Bytes),
    case How of
        cut -> binary:part(Bytes, 0, Size - 100);
        chunk -> flipped(5000, Bytes);
        summary -> flipped(Size - 300, Bytes)
    end.

flipped(At, Bytes) ->
    <<Before:At/binary, Byte, After/binary>> = Bytes,
    <<Before/binary, (Byte bxor 1), After/binary>>.

number(Name, Default) ->
    case os:getenv(Name) of
        false -> Default;
        Text -> list_to_integer(Text)
    end.

file(Config, Name) -> filename:join(proplists:get_value(priv_dir, Config), Name).
