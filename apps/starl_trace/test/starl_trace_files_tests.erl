%% What is read from the file of a recording: its figures, the judgement, the history of calls, and what is said
%% of files that are no recordings.
-module(starl_trace_files_tests).
-include_lib("eunit/include/eunit.hrl").

in_file(Messages, Test) ->
    Unique = integer_to_list(erlang:unique_integer([positive])),
    File = filename:join("/tmp", "starl_files_" ++ os:getpid() ++ "_" ++ Unique ++ ".mcap"),
    ok = starl_trace_ct:recorded(File, Messages),
    try
        Test(File)
    after
        file:delete(File)
    end.

%% The same file without its last bytes.
cut(File, Left) ->
    {ok, Bytes} = file:read_file(File),
    ok = file:write_file(File, binary:part(Bytes, 0, Left)).

scenario(More) -> {scenario, 0, maps:merge(starl_trace_ct:facts(), More)}.

trace(At, Robot, Machine, Event) -> {trace, At, {Robot, Machine, Event}}.

said(At) -> trace(At, 1, note, {said, At}).

ended(At) ->
    Ending = #{ending => done, end_us => At, violations => [], digest => <<>>},
    {verdicts, At, {ended, Ending}}.

%% -- figures ------------------------------------------------------------------------------------

the_figures_of_a_file_test() ->
    Messages = [scenario(#{}), said(400000), said(2000000), said(4000000), ended(5000000)],
    in_file(Messages, fun(File) ->
        Size = filelib:file_size(File),
        {ok, #{topics := Topics} = Info} = starl_trace_info:file(File),
        ?assertEqual(
            #{
                file => File,
                bytes => Size,
                library => <<"starl">>,
                ended => closed,
                chunks => 4,
                compressions => [<<>>],
                from_us => 0,
                to_us => 5000000
            },
            maps:remove(topics, Info)
        ),
        ?assertEqual(lists:sort(Topics), Topics),
        ?assertEqual(12, length(Topics)),
        ?assertEqual(
            [
                {<<"/scenario">>, <<"starl.Scenario">>, 1},
                {<<"/scene">>, <<"foxglove.SceneUpdate">>, 1},
                {<<"/starl">>, <<"starl.Messages">>, 4},
                {<<"/trace">>, <<"starl.Trace">>, 3},
                {<<"/verdicts">>, <<"starl.Verdict">>, 1}
            ],
            [Topic || {_, _, N} = Topic <- Topics, N > 0]
        ),
        cut(File, Size - 10),
        ?assertMatch({ok, #{ended := closed, chunks := 4}}, starl_trace_info:file(File)),
        cut(File, Size div 2),
        ?assertMatch({ok, #{ended := cut_off, from_us := 0}}, starl_trace_info:file(File))
    end),
    ?assertMatch({error, {file, "/nowhere", enoent}}, starl_trace_info:file("/nowhere")).

%% What is damaged between chunks costs no message of a file with an index: here a record that claims to reach into
%% the next chunk.
damage_between_chunks_test() ->
    in_file([scenario(#{}), said(400000), said(2000000)], fun(File) ->
        {ok, Bytes} = file:read_file(File),
        {ok, Reader} = starl_mcap_reader:open(File),
        {[{_, _, First}, {_, _, Second}], closed} = starl_mcap_reader:chunks(Reader),
        {ok, _, Between} = starl_mcap_reader:next(First, Reader),
        ok = starl_mcap_reader:close(Reader),
        ?assert(Between < Second),
        <<Before:Between/binary, Opcode, _:8/binary, After/binary>> = Bytes,
        Into = Second - Between + 5,
        ok = file:write_file(File, <<Before/binary, Opcode, Into:64/little, After/binary>>),
        ?assertEqual(
            {ok, [2000000, 400000], closed}, starl_trace_reader:fold(fun says/2, [], File)
        )
    end).

%% A text of the recording's topic that is none of its terms is told with the file.
strange_texts_test() ->
    [
        in_file([], fun(File) ->
            #{channels := Channels, channel := Id} = starl_trace_writer:patch(),
            {Head, New} = starl_mcap_writer:new("x", Channels),
            {Bytes, Writer} = starl_mcap_writer:flush(starl_mcap_writer:message(Id, 5, Text, New)),
            ok = file:write_file(File, [Head, Bytes, starl_mcap_writer:finish(Writer)]),
            Error = {error, {terms, File, not_terms}},
            ?assertEqual(Error, starl_trace_reader:fold(fun says/2, [], File)),
            ?assertEqual(Error, starl_trace_merge:files([File], File ++ ".out"))
        end)
     || Text <- [
            <<"nonsense">>,
            iolist_to_binary(starl_trace_terms:encode(no_list)),
            iolist_to_binary(starl_trace_terms:encode([{no, message}]))
        ]
    ],
    ?assertMatch(
        {error, {file, "/nowhere", enoent}}, starl_trace_reader:fold(fun says/2, [], "/nowhere")
    ).

%% A damaged chunk is told with its place, and the others count.
a_damaged_chunk_is_told_test() ->
    in_file([scenario(#{}), said(400000), said(2000000)], fun(File) ->
        {ok, Bytes} = file:read_file(File),
        {ok, Reader} = starl_mcap_reader:open(File),
        {[_, {_, _, Place}], closed} = starl_mcap_reader:chunks(Reader),
        ok = starl_mcap_reader:close(Reader),
        At = Place + 60,
        <<Before:At/binary, Byte, After/binary>> = Bytes,
        ok = file:write_file(File, <<Before/binary, (Byte bxor 1), After/binary>>),
        ?assertMatch(
            {ok, #{ended := {damaged, Place}, chunks := 2}}, starl_trace_info:file(File)
        ),
        ?assertMatch({ok, _, {damaged, _}}, starl_trace_reader:fold(fun(_, N) -> N end, 0, File))
    end).

the_first_message_may_be_late_test() ->
    in_file([{scenario, 7000000, starl_trace_ct:facts()}, said(8000000)], fun(File) ->
        ?assertMatch({ok, #{from_us := 7000000, to_us := 8000000}}, starl_trace_info:file(File))
    end),
    in_file([], fun(File) ->
        ?assertMatch({ok, #{from_us := 0, to_us := 0, chunks := 0}}, starl_trace_info:file(File))
    end).

%% -- the file itself ----------------------------------------------------------------------------

%% Each ten seconds, at the beginning of a chunk, stands how the robots move, and which pens are down.
motions_are_repeated_each_ten_seconds_test() ->
    Piece = fun(At) -> {piece, At, 0.0, 0.0, 0.0, 1.0, 0.0} end,
    Motion = fun(At, Robot) -> trace(At, Robot, chassis, {motion, Piece(At)}) end,
    Messages =
        [scenario(#{}), Motion(0, 2), Motion(100000, 1), Motion(200000, 1), Motion(300000, 1)] ++
            [trace(400000, 2, chassis, {actuated, pen, down})] ++
            [said(N * 1000000) || N <- lists:seq(1, 31)],
    in_file(Messages, fun(File) ->
        {ok, Chunks} = starl_trace_chunks:open(File),
        Known = [{1, [Piece(300000), Piece(200000)], none}, {2, [Piece(0)], down}],
        ?assertEqual(
            [{10000000, Known}, {20000000, Known}, {30000000, Known}],
            [{At, Places} || [{places, At, Places} | _] <- chunks(Chunks)]
        ),
        %% a chunk each second in which something happens
        ?assertEqual(32, length(chunks(Chunks))),
        ok = starl_trace_chunks:close(Chunks)
    end).

%% What a recovered recording says of a hole is in the times of a run, us; the file's are ns.
a_hole_has_the_times_of_the_run_test() ->
    #{hole := Hole, channel := Id, channels := Channels} = starl_trace_writer:patch(),
    Said = fun(From, To) -> starl_trace_terms:decode(iolist_to_binary(Hole(From, To))) end,
    ?assertEqual({ok, [{gap, 5000000, {hole, 9000000}}]}, Said(5000000000, 9000000000)),
    ?assertEqual({ok, [{gap, 5, no_end}]}, Said(5000, the_end)),
    #{repeated := Repeated} = starl_trace_writer:patch(),
    ?assertEqual(none, Repeated({attachment, 0, 0, <<"other">>, <<"json">>, <<"{}">>})),
    ?assert(lists:keymember(Id, 2, [C || {channel, _, _, _, _, _} = C <- Channels])).

%% A recording of ours begins with its scenario; a file without is none, wherever it is opened.
without_a_scenario_it_is_none_test() ->
    in_file([said(400000), said(2000000)], fun(File) ->
        No = {error, {no_recording, File}},
        ?assertEqual(No, starl_trace_reader:start(File, 0)),
        ?assertEqual(No, starl_trace_reader:tail(File))
    end),
    ?assertMatch({error, {file, "/nowhere", enoent}}, starl_trace_reader:tail("/nowhere")).

%% From a time on, the robots are where the last account and the motions since say; an account of that very time
%% counts.
from_a_time_on_test() ->
    Piece = fun(At, X) -> {piece, At, X, 0.0, 0.0, 0.0, 0.0} end,
    Motion = fun(At, X) -> trace(At, 1, chassis, {motion, Piece(At, X)}) end,
    Messages =
        [scenario(#{}), Motion(100000, 7.0)] ++ [said(N * 1000000) || N <- lists:seq(1, 12)] ++
            [Motion(12500000, 9.0), said(13000000)],
    in_file(Messages, fun(File) ->
        [
            begin
                {ok, Cursor} = starl_trace_reader:start(File, From),
                {ok, [{scenario, _, _}, Place | Later], _} = starl_trace_reader:next(Cursor),
                ?assertMatch({poses, From, #{full := true, robots := [_]}}, Place),
                #{robots := [Robot]} = element(3, Place),
                ?assertEqual({From, X}, {From, element(1, element(2, Robot))}),
                ?assertEqual([], [At || {trace, At, _} <- Later, At < From])
            end
         || {From, X} <- [{5000000, 7.0}, {10000000, 7.0}, {12600000, 9.0}]
        ]
    end).

%% What a file lacks of a list of schemas and channels: each has its own numbers.
missing_channels_test() ->
    Schema = {schema, 1, "a", "jsonschema", <<>>},
    Channel = {channel, 1, 2, "/a", "json", []},
    {_, Writer} = starl_mcap_writer:new("x", [Schema]),
    ?assertEqual([Channel], starl_mcap_writer:missing([Schema, Channel], Writer)),
    ?assertEqual([], starl_mcap_writer:missing([{schema, 1, "b", "x", <<>>}], Writer)),
    ?assertEqual(
        [{channel, 2, 1, "/b", "json", []}],
        starl_mcap_writer:missing(
            [{channel, 2, 1, "/b", "json", []}], starl_mcap_writer:known([Channel], Writer)
        )
    ).

chunks(Chunks) ->
    case starl_trace_chunks:chunk(Chunks) of
        {ok, Messages, Next} -> [Messages | chunks(Next)];
        {ended, closed} -> []
    end.

%% Who begins a recording holds no file, but its recorder; who has read the end of one holds none.
files_are_held_by_their_recorder_only_test() ->
    in_file([], fun(File) ->
        {ok, Recorder} = starl_trace_recorder:start_link(File, simulation),
        ?assertEqual(1, held(File)),
        ok = starl_observer:tell(
            {begun, starl_trace_ct:facts()}, starl_trace_recorder:observer(Recorder)
        ),
        {ok, _} = starl_trace_recorder:close(Recorder),
        {ok, #{ended := closed}} = starl_trace_reader:tail(File),
        ?assertEqual(0, held(File))
    end).

%% How often this VM has a file open.
held(File) ->
    {ok, Names} = file:list_dir("/proc/self/fd"),
    length([N || N <- Names, file:read_link("/proc/self/fd/" ++ N) =:= {ok, File}]).

%% In a live run 200,000 events may wait for the recorder; what comes then is left out.
a_live_run_leaves_out_what_the_recorder_has_no_room_for_test() ->
    in_file([], fun(File) ->
        {ok, Recorder} = starl_trace_recorder:start_link(File, live),
        Observer = starl_trace_recorder:observer(Recorder),
        ok = sys:suspend(Recorder),
        Tell = fun(N) ->
            ok = Observer({judged, lists:duplicate(N, {0, 1, note, said}), []}),
            {messages, Waiting} = process_info(Recorder, messages),
            lists:sum([length(Events) || {starl_news, _, {judged, Events, _}} <- Waiting])
        end,
        ?assertEqual([200000, 200001, 200001], [Tell(N) || N <- [200000, 1, 1]]),
        true = unlink(Recorder),
        Monitor = erlang:monitor(process, Recorder),
        true = exit(Recorder, kill),
        receive
            {'DOWN', Monitor, process, _, _} -> ok
        end
    end).

%% The recording goes on in the next file; where that cannot be, it ends with a line.
a_next_file_that_cannot_be_test() ->
    in_file([], fun(File) ->
        Options = #{file_bytes => 1, next => fun() -> "/nowhere/next.mcap" end},
        {ok, Recorder} = starl_trace_recorder:start_link(File, simulation, Options),
        Observer = starl_trace_recorder:observer(Recorder),
        ok = starl_observer:tell({begun, starl_trace_ct:facts()}, Observer),
        ?assertEqual({error, {"/nowhere/next.mcap", enoent}}, starl_trace_recorder:close(Recorder)),
        ?assertMatch({ok, #{ended := closed}}, starl_trace_info:file(File))
    end).

%% A run that begins again is recorded from its beginning; a full file is closed, and the next one has the
%% scenario, too.
a_run_that_begins_again_test() ->
    in_file([], fun(File) ->
        {ok, Recorder} = starl_trace_recorder:start_link(File, simulation, #{}),
        Observer = starl_trace_recorder:observer(Recorder),
        Run = fun(Says) ->
            ok = starl_observer:tell({begun, starl_trace_ct:facts()}, Observer),
            ok = starl_observer:tell(
                {judged, [{At, 1, note, {said, At}} || At <- Says], []}, Observer
            )
        end,
        ok = Run([1000, 2000, 7000000]),
        ok = Run([3000]),
        {ok, #{bytes := Bytes, until_us := Until}} = starl_trace_recorder:close(Recorder),
        ?assertEqual({filelib:file_size(File), 3000}, {Bytes, Until}),
        {ok, Says, closed} = starl_trace_reader:fold(fun says/2, [], File),
        ?assertEqual([3000], Says)
    end).

files_follow_each_other_test() ->
    in_file([], fun(File) ->
        Names = [File ++ "." ++ integer_to_list(N) || N <- lists:seq(2, 50)],
        Left = counters:new(1, []),
        Next = fun() ->
            ok = counters:add(Left, 1, 1),
            lists:nth(counters:get(Left, 1), Names)
        end,
        Options = #{file_bytes => 60000, next => Next},
        {ok, Recorder} = starl_trace_recorder:start_link(File, simulation, Options),
        Observer = starl_trace_recorder:observer(Recorder),
        ok = starl_observer:tell({begun, starl_trace_ct:facts()}, Observer),
        Times = [N * 1000000 || N <- lists:seq(1, 60)],
        [
            ok = starl_observer:tell(
                {judged, [{At, 1, note, {said, At}}, {At, 1, note, incompressible(At)}], []},
                Observer
            )
         || At <- Times
        ],
        {ok, #{file := Last}} = starl_trace_recorder:close(Recorder),
        Files = [File | lists:sublist(Names, counters:get(Left, 1))],
        try
            ?assertEqual(Last, lists:last(Files)),
            ?assert(length(Files) > 2),
            [?assert(filelib:file_size(F) >= 60000) || F <- lists:droplast(Files)],
            [?assert(filelib:file_size(F) < 90000) || F <- Files],
            [
                begin
                    {ok, Cursor} = starl_trace_reader:start(F),
                    ?assertMatch({ok, [{scenario, _, _} | _], _}, starl_trace_reader:next(Cursor))
                end
             || F <- Files
            ],
            ?assertEqual(
                Times,
                lists:append([
                    lists:reverse(Says)
                 || F <- Files, {ok, Says, closed} <- [starl_trace_reader:fold(fun says/2, [], F)]
                ])
            )
        after
            [file:delete(F) || F <- Files]
        end
    end).

%% Bytes that no packing makes fewer, the same in each run.
incompressible(Seed) -> element(1, rand:bytes_s(3000, rand:seed_s(exsss, Seed))).

says({trace, _, {_, note, {said, At}}}, Says) -> [At | Says];
says(_, Says) -> Says.

%% A reserve that cannot be made is no reserve, and none of it is left.
a_reserve_that_cannot_be_test() ->
    in_file([], fun(File) ->
        Options = #{reserve => {"/nowhere/reserve", 10}},
        ?assertEqual(
            {error, {"/nowhere/reserve", enoent}},
            starl_trace_recorder:start_link(File, simulation, Options)
        )
    end).

%% A hole before the scenario is none of a recording.
a_hole_before_the_scenario_test() ->
    in_file([{gap, 0, 5}, said(400000)], fun(File) ->
        ?assertEqual({error, {no_scenario, File}}, starl_trace_judge:file(File))
    end).

problems_are_lines_test() ->
    [
        ?assertEqual(Line, lists:flatten(starl_mcap_reader:format_error(Reason)))
     || {Reason, Line} <- [
            {{file, "f", enoent}, "f: there is no such file"},
            {{file, "f", eisdir}, "f: this is a directory; name the recording in it, run.mcap"},
            {{file, "f", eacces}, "f: permission denied"},
            {{no_mcap, "f"}, "f: this is no recording (no MCAP file)"},
            {
                {damaged, "f", 9, {bad_record, 4}},
                "f: damaged at byte 9: a record of kind 4 has a wrong content"
            },
            {
                {damaged, "f", 9, cut_off},
                "f: damaged at byte 9: a record does not end within its chunk"
            },
            {
                {damaged, "f", 9, checksum},
                "f: damaged at byte 9: the checksum of a chunk is wrong; ./starl recover takes what is "
                "whole"
            },
            {
                {damaged, "f", 9, {size, 7}},
                "f: damaged at byte 9: a chunk has not the size that it says"
            }
        ]
    ],
    ?assertEqual(
        "f: it is packed with lz4, which cannot be read here",
        unicode:characters_to_list(
            starl_mcap_reader:format_error({damaged, "f", 9, {packed, <<"lz4">>, unknown}})
        )
    ).

%% -- the judgement ------------------------------------------------------------------------------

%% A file names modules that are to be called: only monitors, and only with data.
only_monitors_with_data_are_called_test() ->
    Judged = fun(Monitors) ->
        in_file([scenario(#{monitors => Monitors}), said(1)], fun(File) ->
            case starl_trace_judge:file(File) of
                {error, {Why, File, What}} -> {Why, What};
                {ok, #{violations := []}} -> judged
            end
        end)
    end,
    Sap = fun(Config) -> [{starl_sap_monitor, Config}] end,
    ?assertEqual(judged, Judged(Sap(#{bound_us => 1000}))),
    ?assertEqual({no_monitor, no_such_monitor}, Judged([{no_such_monitor, #{}}])),
    ?assertEqual({bad_monitor, lists}, Judged([{lists, #{}}])),
    ?assertEqual({bad_monitor, unknown}, Judged([{starl_sap_monitor, []}])),
    ?assertEqual({bad_monitor, unknown}, Judged([odd])),
    [
        ?assertEqual({Bad, {bad_monitor, starl_sap_monitor}}, {Bad, Judged(Sap(#{key => Bad}))})
     || No <- [fun lists:max/1, self(), make_ref(), hd(erlang:ports())],
        Bad <- [No, {No}, [a, No], [a | No], #{a => No}, #{No => a}]
    ].

%% Robots know nothing of the true motions; and of a team without all its robots nothing common is judged.
what_cannot_be_judged_is_named_test() ->
    Robots = [{R, {0.0, 0.0, 0.0}} || R <- [1, 2]],
    Sap = {starl_sap_monitor, #{bound_us => 1000}},
    All = [{starl_geocast_monitor, #{robots => [1, 2]}}, Sap, {starl_crash_monitor, #{}}],
    Left = fun(More) ->
        in_file([scenario(More#{robots => Robots, monitors => All}), said(1)], fun(File) ->
            {ok, #{not_judged := Left}} = starl_trace_judge:file(File),
            lists:sort(Left)
        end)
    end,
    ?assertEqual([], Left(#{})),
    ?assertEqual([{starl_geocast_monitor, motions}], Left(#{told_by => [1, 2]})),
    ?assertEqual([], Left(#{told_by => [1, 2], has_motions => true})),
    [
        ?assertEqual(
            [{starl_geocast_monitor, robots}, {starl_sap_monitor, robots}],
            Left(#{told_by => [2], has_motions => Has})
        )
     || Has <- [false, true]
    ].

%% What the run itself had found, until when, and how much is missing.
the_facts_of_a_judgement_test() ->
    Sap = #{monitors => [{starl_sap_monitor, #{bound_us => 1000}}]},
    Judged = fun(Messages) ->
        in_file([scenario(Sap) | Messages], fun(File) ->
            {ok, Judged} = starl_trace_judge:file(File),
            Judged
        end)
    end,
    ?assertMatch(
        #{found := [], until_us := 9, events := 2, missing := 0, unjudged := [], ended := closed},
        Judged([said(1), said(2), ended(9)])
    ),
    {verdicts, 9, {ended, Ending}} = ended(9),
    ?assertMatch(
        #{until_us := 5, events := 1},
        Judged([said(1), {verdicts, 9, {ended, Ending#{judged_us => 5}}}])
    ),
    ?assertMatch(#{found := unknown, until_us := 2}, Judged([said(1), said(2)])),
    ?assertMatch(
        #{missing := 7, events := 3, unjudged := [_ | _]},
        Judged([said(1), {gap, 1, 3}, said(2), {gap, 2, 4}, said(3), ended(9)])
    ),
    ?assertMatch(
        #{missing := 0, unjudged := [_ | _]}, Judged([said(1), {gap, 1, no_end}, ended(9)])
    ),
    in_file([said(1), ended(2)], fun(File) ->
        ?assertEqual({error, {no_scenario, File}}, starl_trace_judge:file(File)),
        ?assertEqual({error, {no_scenario, File}}, starl_trace_history:file(File, []))
    end).

%% -- the history --------------------------------------------------------------------------------

invoked(At, N) -> trace(At, 1, app, {history, {invoked, {1, N}, counter, value}}).

returned(At, N) -> trace(At, 1, app, {history, {returned, {1, N}, {ok, 0}}}).

%% Up to the first hole, by the models of the run's own contracts.
a_history_goes_to_the_first_hole_test() ->
    Config = #{robots => [1]},
    Counter = #{monitors => [{starl_counter_monitor, Config}]},
    Models = [starl_counter_history, starl_mutex_history],
    Read = fun(Messages) ->
        in_file([scenario(Counter) | Messages], fun(File) ->
            {ok, #{history := History, facts := #{app := nobody}} = Read} = starl_trace_history:file(
                File, Models
            ),
            ?assertEqual([{starl_counter_history, Config}], maps:get(models, Read)),
            {length(starl_history:calls(History)), maps:get(until_us, Read), maps:get(ends, Read)}
        end)
    end,
    Calls = [invoked(1, 1), returned(2, 1), invoked(2000003, 2), returned(2000004, 2)],
    ?assertEqual({2, 2000004, closed}, Read(Calls ++ [ended(3000000)])),
    [One, Two | Later] = Calls,
    ?assertEqual({1, 2, hole}, Read([One, Two, {gap, 3, 7} | Later])),
    ?assertEqual({0, 0, closed}, Read([])).

a_history_of_a_file_that_was_cut_off_test() ->
    in_file(
        [scenario(#{monitors => [{starl_counter_monitor, #{robots => [1]}}]})] ++
            [said(1000000 * N) || N <- lists:seq(1, 9)],
        fun(File) ->
            cut(File, filelib:file_size(File) div 2),
            ?assertMatch(
                {ok, #{ends := hole, until_us := Until}} when Until > 0,
                starl_trace_history:file(File, [starl_counter_history])
            ),
            cut(File, 100),
            ?assertEqual({error, {too_short, File}}, starl_trace_history:file(File, []))
        end
    ),
    ?assertMatch({error, {file, _, enoent}}, starl_trace_history:file("/nowhere", [])).
