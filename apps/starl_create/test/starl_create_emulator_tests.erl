%% The emulated Create by its bytes: modes, safety, timings, scripts of the Create 1, sleep.
-module(starl_create_emulator_tests).
-include_lib("eunit/include/eunit.hrl").

-define(TICK, 15000).

new(Model) -> new(Model, #{}).

new(Model, Quirks) -> starl_create_emulator:new(#{model => Model, quirks => Quirks}).

%% A robot after these commands, and what has left it.
does(Commands, {Now, Model, Create}) ->
    Bytes = starl_create_command:encode_all(Commands, Model),
    {Outs, Next} = starl_create_emulator:hear(Now, Bytes, Create),
    {Outs, {Now, Model, Next}}.

passes(Us, {Now, Model, Create}) ->
    {Outs, Next} = starl_create_emulator:advance(Now + Us, Create),
    {Outs, {Now + Us, Model, Next}}.

mode({_, _, Create}) -> starl_create_emulator:mode(Create).
wheels({_, _, Create}) -> starl_create_emulator:wheels(Create).

bytes(Outs) -> <<<<B/binary>> || {_, {bytes, B}} <- Outs>>.

start(Model) -> {0, Model, new(Model)}.

in(Mode, Model) ->
    {_, Robot} = does([start, Mode], start(Model)),
    Robot.

%% -- modes ----------------------------------------------------------------------------------

modes_follow_the_document_test() ->
    Steps = [
        {off, [safe], off},
        {off, [full], off},
        {off, [{sensors, 35}], off},
        {off, [start], passive},
        {off, [start, safe], safe},
        {off, [start, control], safe},
        {off, [start, full], full},
        {off, [start, full, safe], safe},
        {off, [start, full, start], passive},
        {off, [start, full, spot], passive},
        {off, [start, full, clean], passive},
        {off, [start, full, dock], passive}
    ],
    [
        begin
            {_, Robot} = does(Commands, start(Model)),
            ?assertEqual({Commands, Mode}, {Commands, mode(Robot)})
        end
     || Model <- [1, 2], {off, Commands, Mode} <- Steps
    ],
    {_, Stopped} = does([start, full, stop], start(2)),
    ?assertEqual(off, mode(Stopped)).

passive_robots_do_not_drive_test() ->
    {_, Robot} = does([start, {drive_direct, 100, 100}], start(1)),
    ?assertEqual({0.0, 0.0}, wheels(Robot)).

a_robot_that_turns_passive_stops_test() ->
    {_, Going} = does([{drive_direct, 200, 100}], in(full, 2)),
    ?assertEqual({100.0, 200.0}, wheels(Going)),
    {Outs, Robot} = does([start], Going),
    ?assertEqual({0.0, 0.0}, wheels(Robot)),
    ?assertEqual([{0, {mode, passive}}, {0, {wheels, {0.0, 0.0}}}], Outs).

%% A command without its last bytes waits, and takes what comes next.
half_a_command_eats_the_next_test() ->
    {_, Model, Create} = in(full, 1),
    {[], Waiting} = starl_create_emulator:hear(0, <<137, 0>>, Create),
    {_, Robot} = starl_create_emulator:hear(1000000, <<132, 128, 0, 145, 0, 50, 0, 60>>, Waiting),
    ?assertEqual({60.0, 50.0}, wheels({0, Model, Robot})).

circles_test() ->
    [
        begin
            {_, Robot} = does([{drive, V, Radius}], in(full, 1)),
            ?assertEqual(Speeds, wheels(Robot))
        end
     || {V, Radius, Speeds} <- [
            {200, straight, {200.0, 200.0}},
            {200, clockwise, {200.0, -200.0}},
            {200, counterclockwise, {-200.0, 200.0}},
            {100, 129, {0.0, 200.0}},
            {-100, -129, {-200.0, 0.0}},
            {500, 129, {0.0, 500.0}}
        ]
    ].

%% -- safety ---------------------------------------------------------------------------------

safety_test() ->
    Cliff = {readings, #{cliff_left => 1}},
    Drop = {readings, #{bumps_drops => 4}},
    Forward = {drive_direct, 200, 200},
    Back = {drive_direct, -200, -200},
    ?assertEqual({passive, {0.0, 0.0}}, feels(Cliff, Forward, safe)),
    ?assertEqual({safe, {-200.0, -200.0}}, feels(Cliff, Back, safe)),
    ?assertEqual({passive, {0.0, 0.0}}, feels(Cliff, {drive, -200, 50}, safe)),
    ?assertEqual({passive, {0.0, 0.0}}, feels(Drop, Back, safe)),
    ?assertEqual({passive, {0.0, 0.0}}, feels({charger, true}, Back, safe)),
    ?assertEqual({full, {200.0, 200.0}}, feels(Cliff, Forward, full)),
    ?assertEqual({full, {200.0, 200.0}}, feels(Drop, Forward, full)).

feels(Sense, Command, Mode) ->
    {_, {Now, Model, Create}} = does([Command], in(Mode, 1)),
    {_, Felt} = starl_create_emulator:feel(Now, Sense, Create),
    {mode({Now, Model, Felt}), wheels({Now, Model, Felt})}.

%% -- sensors --------------------------------------------------------------------------------

answers_have_no_frame_test() ->
    {Outs, _} = does([{query, [35, 17, 26]}], in(safe, 1)),
    ?assertEqual(<<2, 255, 2700:16>>, bytes(Outs)),
    {Outs2, _} = does([{sensors, 17}], in(safe, 2)),
    ?assertEqual(<<0>>, bytes(Outs2)),
    {Group, _} = does([{sensors, 6}], in(safe, 1)),
    ?assertEqual(52, byte_size(bytes(Group))),
    {None, _} = does([{sensors, 43}], in(safe, 1)),
    ?assertEqual(<<>>, bytes(None)).

%% A frame each 15 ms, which takes its time on the line.
the_stream_comes_each_15_ms_test() ->
    {_, Streaming} = does([{stream, [35, 7]}], in(safe, 1)),
    {Outs, Paused0} = passes(10 * ?TICK, Streaming),
    Us = 7 * 10000000 div 57600,
    ?assertEqual([N * ?TICK + Us || N <- lists:seq(1, 10)], [At || {At, {bytes, _}} <- Outs]),
    {_, Paused} = does([{stream_on, 0}], Paused0),
    {[], Still} = passes(10 * ?TICK, Paused),
    {_, Again} = does([{stream_on, 1}], Still),
    {[_, _], _} = passes(2 * ?TICK, Again).

%% More than the line carries in 15 ms.
too_long_frames_are_lost_test() ->
    {_, Streaming} = does([{stream, [6, 6]}], in(safe, 1)),
    {Outs, _} = passes(100 * ?TICK, Streaming),
    ?assert(length(Outs) > 50),
    ?assert(length(Outs) < 90).

distance_and_angle_begin_anew_with_each_reading_test() ->
    [
        begin
            {_, Robot} = does([full, {drive_direct, 115, 115}], {0, 1, started(Fraction)}),
            {_, Later} = passes(100000, Robot),
            {First, Read} = does([{sensors, 19}], Later),
            {_, Latest} = passes(100000, Read),
            {Second, _} = does([{sensors, 19}], Latest),
            ?assertEqual({<<11:16>>, <<Next:16>>}, {bytes(First), bytes(Second)})
        end
     || {Fraction, Next} <- [{lost, 11}, {kept, 12}]
    ].

started(Fraction) ->
    {_, {_, _, Create}} = does([start], {0, 1, new(1, #{fraction => Fraction})}),
    Create.

encoders_wrap_backwards_test() ->
    {_, Robot} = does([{drive_direct, -100, 100}], in(full, 2)),
    {_, Later} = passes(1000000, Robot),
    {Outs, _} = does([{query, [43, 44]}], Later),
    ?assertEqual(<<224:16, (65536 - 225):16>>, bytes(Outs)).

%% -- scripts of the Create 1 ----------------------------------------------------------------

%% 40 cm, from the document: it stops at its next look after 400 mm.
a_script_drives_400_mm_test() ->
    Golden = <<152, 13, 137, 1, 44, 128, 0, 156, 1, 144, 137, 0, 0, 0, 0, 153>>,
    {_, Model, Create} = in(full, 1),
    {Outs, Playing} = starl_create_emulator:hear(0, Golden, Create),
    {More, _} = passes(3000000, {0, Model, Playing}),
    [{0, {wheels, {300.0, 300.0}}}, {Stops, {wheels, {0.0, 0.0}}}] = Outs ++ More,
    ?assert(Stops >= 1333334 andalso Stops =< 1333334 + ?TICK).

%% While it waits it reads nothing, but its safety goes on.
a_waiting_robot_reads_nothing_test() ->
    {_, Waiting} = does([{drive_direct, 50, 50}, {wait_time, 10}], in(safe, 1)),
    {[], Deaf} = does([{drive_direct, 0, 0}], Waiting),
    ?assertEqual({50.0, 50.0}, wheels(Deaf)),
    {_, Later} = passes(1100000, Deaf),
    ?assertEqual({0.0, 0.0}, wheels(Later)),
    {Now, Model, Create} = Deaf,
    {_, Dropped} = starl_create_emulator:feel(Now, {readings, #{bumps_drops => 8}}, Create),
    ?assertEqual(passive, mode({Now, Model, Dropped})).

waits_for_events_test() ->
    {_, {Now, Model, Create}} = does(
        [{drive_direct, 50, 50}, {wait_event, 5}, {drive_direct, 0, 0}], in(full, 1)
    ),
    {_, Going} = passes(10000000, {Now, Model, Create}),
    ?assertEqual({50.0, 50.0}, wheels(Going)),
    {At, _, Moving} = Going,
    {_, Bumped} = starl_create_emulator:feel(At, {readings, #{bumps_drops => 1}}, Moving),
    {_, Robot} = passes(?TICK, {At, Model, Bumped}),
    ?assertEqual({0.0, 0.0}, wheels(Robot)).

%% A script that plays itself without a wait does not hang the emulator.
an_endless_script_takes_time_test() ->
    {_, Robot} = does([{script, <<153>>}, play_script], in(full, 1)),
    {_, Later} = passes(1000000, Robot),
    ?assertEqual(full, mode(Later)).

%% -- sleep, power, line ---------------------------------------------------------------------

a_create_2_sleeps_after_five_minutes_test() ->
    {_, Awake} = passes(299000000, in(start, 2)),
    {_, Heard} = does([safe], Awake),
    ?assertEqual(safe, mode(Heard)),
    {_, Slept} = passes(301000000, in(start, 2)),
    {_, Deaf} = does([safe], Slept),
    ?assertEqual(off, mode(Deaf)),
    {Now, Model, Create} = Deaf,
    {_, Low} = starl_create_emulator:line(Now, {brc, low}, Create),
    {Banner, High} = starl_create_emulator:line(Now + 100000, {brc, high}, Low),
    ?assertNotEqual(nomatch, binary:match(bytes(Banner), <<"r3_robot/tags/release">>)),
    {_, Woken} = does([start, safe], {Now + 200000, Model, High}),
    ?assertEqual(safe, mode(Woken)).

another_baud_rate_is_not_understood_test() ->
    {_, Create} = starl_create_emulator:line(0, {baud, 19200}, new(2)),
    {_, Deaf} = does([start], {0, 2, Create}),
    ?assertEqual(off, mode(Deaf)),
    {_, Right} = starl_create_emulator:line(0, {baud, 115200}, Create),
    {_, Heard} = does([start, {baud, 7}], {0, 2, Right}),
    {_, {_, _, Changed}} = passes(200000, Heard),
    ?assertEqual(19200, starl_create_emulator:baud(Changed)).

three_pulses_at_power_on_mean_19200_baud_test() ->
    Pulse = fun(N, Create0) ->
        {_, Low} = starl_create_emulator:line(N * 300000, {brc, low}, Create0),
        {_, High} = starl_create_emulator:line(N * 300000 + 100000, {brc, high}, Low),
        High
    end,
    ?assertEqual(19200, starl_create_emulator:baud(lists:foldl(Pulse, new(2), [1, 2, 3]))),
    ?assertEqual(115200, starl_create_emulator:baud(lists:foldl(Pulse, new(2), [1, 2]))).

%% Commands cut in two anywhere do what they do in one piece, one by one.
commands_cut_at_every_byte_test() ->
    Some = [safe, {drive, -200, 500}, {leds, 8, 0, 128}, {song, 0, [{60, 4}]}, {sensors, 7}, full],
    More = [{drive_direct, 100, -100}, {stream, [7, 19]}, {query, [7, 8]}, {stream_on, 0}, start],
    [
        begin
            Bytes = starl_create_command:encode_all([start | Some ++ More], Model),
            Whole = heard([Bytes], Model),
            ?assert(length([Out || {_, Out} <- Whole, element(1, Out) =:= wheels]) > 0),
            [
                ?assertEqual({Model, N, Whole}, {Model, N, heard([First, Rest], Model)})
             || N <- lists:seq(1, byte_size(Bytes) - 1),
                <<First:N/binary, Rest/binary>> <- [Bytes]
            ]
        end
     || Model <- [1, 2]
    ].

%% The last speeds and all that is no speed: between two pieces the wheels may turn for a moment.
heard(Pieces, Model) ->
    {Outs, Create} = lists:foldl(
        fun(Piece, {Before, Robot}) ->
            {New, Next} = starl_create_emulator:hear(1000, Piece, Robot),
            {Before ++ New, Next}
        end,
        {[], new(Model)},
        Pieces
    ),
    Others = [{At, Out} || {At, Out} <- Outs, element(1, Out) =/= wheels],
    Others ++ [{starl_create_emulator:heard(Create), {wheels, last_of(Outs)}}].

last_of(Outs) -> lists:last([{0.0, 0.0} | [Speeds || {_, {wheels, Speeds}} <- Outs]]).

%% A million bytes in any pieces: it neither crashes nor grows.
a_million_bytes_of_garbage_test_() ->
    {timeout, 60, fun() ->
        Random = rand:seed_s(exsss, starl_platform_ct:seed()),
        [garbage(Model, Random) || Model <- [1, 2]]
    end}.

garbage(Model, Random0) ->
    {Last, _} = lists:foldl(
        fun(N, {Create, Random}) ->
            {Bytes, Next} = rand:bytes_s(500, Random),
            {_, Heard} = starl_create_emulator:hear(N * 1000, Bytes, Create),
            {Heard, Next}
        end,
        {new(Model), Random0},
        lists:seq(1, 1000)
    ),
    ?assert(erts_debug:flat_size(Last) < 3000).

%% -- quirks ---------------------------------------------------------------------------------

quirks_test() ->
    ?assertEqual([unheard_of], starl_create_quirks:check(#{unheard_of => 1, asleep => true})),
    {_, Stepped} = does(
        [start, full, {drive_direct, 100, 100}], {0, 2, new(2, #{speed_step => 28.5})}
    ),
    ?assertEqual({114.0, 114.0}, wheels(Stepped)),
    {Outs, _} = does([start, {sensors, 35}], {0, 2, new(2, #{mode_offset => 1})}),
    ?assertEqual(<<2>>, bytes(Outs)),
    {Silent, _} = does([start, {sensors, 35}], {0, 2, new(2, #{wedged => true})}),
    ?assertEqual(<<>>, bytes(Silent)),
    {_, Docked} = does([start, safe], {0, 2, new(2, #{docked => true})}),
    ?assertEqual(passive, mode(Docked)).

%% After a change of its baud rate it hears nothing for 100 ms.
a_new_baud_rate_takes_its_time_test() ->
    {_, Slow} = starl_create_emulator:hear(0, <<128, 129, 7>>, new(2, #{})),
    {_, Deaf} = starl_create_emulator:hear(99000, <<131>>, Slow),
    ?assertEqual(passive, starl_create_emulator:mode(Deaf)),
    {_, Safe} = starl_create_emulator:hear(100000, <<131>>, Deaf),
    ?assertEqual(safe, starl_create_emulator:mode(Safe)).
