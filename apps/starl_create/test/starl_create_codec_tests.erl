%% The codec: the documents' own bytes, round trips of all commands and packets, and a stream among
%% garbage, split and merged in every way.
-module(starl_create_codec_tests).
%% in this order: both have a macro LET
-include_lib("proper/include/proper.hrl").
-include_lib("eunit/include/eunit.hrl").

%% -- the documents' own bytes ---------------------------------------------------------------

golden() ->
    [
        {1, [{drive, -200, 500}], "137 255 56 1 244"},
        {2, [{drive, -200, 500}], "137 255 56 1 244"},
        {2, [{drive, 300, straight}], "137 1 44 128 0"},
        {1, [{drive, 300, counterclockwise}], "137 1 44 0 1"},
        {1, [{drive, 300, clockwise}], "137 1 44 255 255"},
        {2, [{drive_direct, 100, -100}], "145 0 100 255 156"},
        {1, [{demo, -1}], "136 255"},
        {2, [max], "136"},
        {2, [{query, [29, 13]}], "149 2 29 13"},
        {1, [{song, 2, [{31, 64}, {60, 1}]}], "140 2 2 31 64 60 1"},
        {1, [{wait_event, -5}], "158 251"},
        {1, [{script, script([{drive, 300, straight}, {wait_distance, 400}, stand()])}],
            "152 13 137 1 44 128 0 156 1 144 137 0 0 0 0"},
        {1,
            [
                {script,
                    script([
                        {drive, 300, straight},
                        {wait_distance, 400},
                        {drive, 300, counterclockwise},
                        {wait_angle, 90},
                        play_script
                    ])}
            ],
            "152 17 137 1 44 128 0 156 1 144 137 1 44 0 1 157 0 90 153"},
        {1,
            [
                {script,
                    script([
                        {wait_event, 5},
                        {wait_event, -5},
                        {leds, 2, 0, 0},
                        {wait_event, 5},
                        {wait_event, -5},
                        {leds, 0, 0, 0},
                        play_script
                    ])}
            ],
            "152 17 158 5 158 251 139 2 0 0 158 5 158 251 139 0 0 0 153"}
    ].

stand() -> {drive, 0, 0}.

script(Commands) -> starl_create_command:encode_all(Commands, 1).

bytes(Text) -> list_to_binary([list_to_integer(Word) || Word <- string:lexemes(Text, " ")]).

golden_commands_test() ->
    lists:foreach(
        fun({Model, Commands, Text}) ->
            Bytes = bytes(Text),
            ?assertEqual(Bytes, starl_create_command:encode_all(Commands, Model)),
            ?assertEqual(Commands, all(Bytes, Model))
        end,
        golden()
    ).

all(Bytes, Model) ->
    case starl_create_command:decode(Bytes, Model) of
        {ok, Command, Rest} -> [Command | all(Rest, Model)];
        more -> [{left, Bytes} || Bytes =/= <<>>]
    end.

straight_has_two_codes_test() ->
    ?assertEqual([{drive, 300, straight}], all(<<137, 300:16, 16#7FFF:16>>, 1)).

groups_have_the_documents_sizes_test() ->
    Sizes =
        [{0, 26}, {1, 10}, {2, 6}, {3, 10}, {4, 14}, {5, 12}, {6, 52}, {100, 80}, {101, 28}] ++
            [{106, 12}, {107, 9}],
    [?assertEqual(Size, starl_create_packet:bytes(Id)) || {Id, Size} <- Sizes].

%% The documents' frames; their text says 549 where the bytes are 537.
golden_frames_test() ->
    Readings = #{cliff_front_left_signal => 537, virtual_wall => 0},
    frames("19 5 29 2 25 13 0 163", with_header, Readings),
    frames("19 5 29 2 25 13 0 182", without_header, Readings),
    Other = Readings#{cliff_front_left_signal => 549},
    frames("19 5 29 2 37 13 0 151", with_header, Other),
    frames("19 5 29 2 37 13 0 170", without_header, Other).

frames(Text, Checksum, Readings) ->
    Frame = bytes(Text),
    ?assertEqual(Frame, starl_create_stream:frame([29, 13], Readings, Checksum)),
    Stream = starl_create_stream:new([29, 13], 1),
    {Found, Decided} = starl_create_stream:parse(binary:copy(Frame, 4), Stream),
    ?assertEqual([{frame, Readings}, {frame, Readings}], Found),
    ?assertEqual(Checksum, starl_create_stream:checksum(Decided)).

a_create_2_takes_no_checksum_without_header_test() ->
    Frame = bytes("19 5 29 2 25 13 0 182"),
    Stream = starl_create_stream:new([29, 13], 2),
    {Found, _} = starl_create_stream:parse(binary:copy(Frame, 4), Stream),
    ?assertEqual([], [F || {frame, _} = F <- Found]).

%% -- mistakes -------------------------------------------------------------------------------

a_command_out_of_range_is_refused_and_ignored_test() ->
    ?assertError({no_command, _, 2}, starl_create_command:encode({drive, 501, straight}, 2)),
    ?assertMatch({invalid, _, <<7>>}, starl_create_command:decode(<<137, 501:16, 0:16, 7>>, 2)),
    ?assertMatch({unknown, 147, <<1>>}, starl_create_command:decode(<<147, 1>>, 2)),
    ?assertError({no_command, _, 2}, starl_create_command:encode({outputs, 1}, 2)).

half_a_command_waits_test() ->
    [
        ?assertEqual(more, starl_create_command:decode(binary:part(Bytes, 0, N), Model))
     || {Model, [_], Text} <- golden(),
        Bytes <- [bytes(Text)],
        N <- lists:seq(0, byte_size(Bytes) - 1)
    ].

%% -- round trips ----------------------------------------------------------------------------

commands_go_round_test_() ->
    {timeout, 60, fun() -> starl_platform_ct:property(prop_commands(), 1000) end}.

prop_commands() ->
    ?FORALL(
        {Model, Commands},
        ?LET(M, oneof([1, 2]), {M, list(command(M))}),
        starl_platform_ct:safely(fun() ->
            all(starl_create_command:encode_all(Commands, Model), Model) =:= Commands
        end)
    ).

command(Model) -> oneof(common() ++ own(Model)).

common() ->
    Names = [start, control, safe, full, spot, clean, dock],
    Names ++
        [
            {baud, range(0, 11)},
            {drive, range(-500, 500), radius()},
            {drive_direct, range(-500, 500), range(-500, 500)},
            {motors, byte()},
            {leds, byte(), byte(), byte()},
            {song, range(0, 15), ?LET(N, range(1, 16), vector(N, {byte(), byte()}))},
            {play, range(0, 15)},
            {sensors, byte()},
            {stream, list(byte())},
            {query, list(byte())},
            {stream_on, range(0, 1)}
        ].

own(1) ->
    [
        {demo, range(-1, 9)},
        {pwm_motors, range(0, 128), range(0, 128), range(0, 128)},
        {outputs, range(0, 7)},
        {send_ir, byte()},
        {script, ?LET(N, range(0, 100), binary(N))},
        play_script,
        show_script,
        {wait_time, byte()},
        {wait_distance, range(-32768, 32767)},
        {wait_angle, range(-32768, 32767)},
        {wait_event, range(-22, 22)}
    ];
own(2) ->
    [
        reset,
        power,
        max,
        stop,
        {pwm_motors, range(-127, 127), range(-127, 127), range(0, 127)},
        {drive_pwm, range(-255, 255), range(-255, 255)},
        {scheduling_leds, byte(), byte()},
        {digits_raw, byte(), byte(), byte(), byte()},
        {digits, range(32, 126), range(32, 126), range(32, 126), range(32, 126)},
        {buttons, byte()},
        {schedule, binary(15)},
        {day_time, range(0, 6), range(0, 23), range(0, 59)}
    ].

radius() ->
    oneof([straight, clockwise, counterclockwise, range(2, 2000), range(-2000, -2), 0]).

packets_go_round_test_() ->
    {timeout, 60, fun() -> starl_platform_ct:property(prop_packets(), 500) end}.

prop_packets() ->
    ?FORALL(
        {Ids, Values},
        {list(packet()), vector(52, integer())},
        starl_platform_ct:safely(fun() ->
            Given = readings(Values),
            Data = starl_create_packet:encode_all(Ids, Given),
            Asked = lists:usort(lists:append([starl_create_packet:members(Id) || Id <- Ids])),
            byte_size(Data) =:= starl_create_packet:byte_count(Ids) andalso
                starl_create_packet:decode_all(Ids, Data) =:=
                    maps:with([starl_create_packet:name(Id) || Id <- Asked], Given)
        end)
    ).

packet() -> oneof([range(7, 58), oneof([0, 1, 2, 3, 4, 5, 6, 100, 101, 106, 107])]).

%% Values that fit the packets: what is encoded and decoded once.
readings(Values) ->
    maps:from_list([
        {Name,
            maps:get(
                Name, starl_create_packet:decode(Id, starl_create_packet:encode(Id, #{Name => V}))
            )}
     || {Id, V} <- lists:zip(lists:seq(7, 58), Values), Name <- [starl_create_packet:name(Id)]
    ]).

%% -- the stream among garbage ---------------------------------------------------------------

-define(IDS, [7, 14, 43, 44, 35]).

sent(Model, N) ->
    Readings = #{
        bumps_drops => N rem 4, overcurrents => 0, left_encoder => 19, right_encoder => N, mode => 2
    },
    Checksum =
        case Model of
            1 -> without_header;
            2 -> with_header
        end,
    {{frame, Readings}, starl_create_stream:frame(?IDS, Readings, Checksum)}.

parsed(Pieces, Model) -> parsed_with(Pieces, starl_create_stream:new(?IDS, Model)).

parsed_with(Pieces, Stream) ->
    {Found, Last} = lists:mapfoldl(fun starl_create_stream:parse/2, Stream, Pieces),
    {lists:append(Found), Last}.

pieces(<<>>, _Sizes) ->
    [];
pieces(Bytes, [Size | Sizes]) when byte_size(Bytes) > Size ->
    <<Piece:Size/binary, Rest/binary>> = Bytes,
    [Piece | pieces(Rest, Sizes ++ [Size])];
pieces(Bytes, _Sizes) ->
    [Bytes].

every_split_of_three_frames_test() ->
    {Wanted, Frames} = lists:unzip([sent(2, N) || N <- [1, 2, 3]]),
    Bytes = iolist_to_binary(Frames),
    [
        ?assertEqual({Wanted, []}, lists:partition(fun({Kind, _}) -> Kind =:= frame end, Found))
     || A <- lists:seq(0, byte_size(Bytes)),
        B <- [0, 1, 7, byte_size(Bytes) - A],
        A + B =< byte_size(Bytes),
        <<P:A/binary, Q:B/binary, R/binary>> <- [Bytes],
        {Found, _} <- [parsed([P, Q, R], 2)]
    ].

%% What a Create 2 prints when it starts anew, at any place of the stream: at most two frames are lost, and
%% none is invented.
a_banner_at_every_byte_test() ->
    Banner = <<"bl-start\r\nSTR730\r\nr3_robot/tags/release-stm32-3.2.6\r\n">>,
    [
        begin
            {Wanted, Frames} = lists:unzip([sent(Model, N) || N <- lists:seq(1, 9)]),
            Bytes = iolist_to_binary(Frames),
            %% a Create 1 shows in three frames which checksum it has: the first two are not told
            Size = byte_size(hd(Frames)),
            [
                begin
                    <<P:At/binary, Q/binary>> = Bytes,
                    {Heard, _} = parsed([P, Banner, Q], Model),
                    Found = [Frame || {frame, _} = Frame <- Heard],
                    ?assertEqual({Model, At, []}, {Model, At, Found -- Wanted}),
                    ?assert(length(Found) >= 7 - maps:get(Model, #{1 => 2, 2 => 0})),
                    ?assertEqual(lists:last(Wanted), lists:last(Found))
                end
             || At <- lists:seq(3 * Size, byte_size(Bytes) - Size)
            ]
        end
     || Model <- [1, 2]
    ].

%% Of the frames after the garbage at most the first two are lost, and none is found that does not
%% stand in the bytes, whole and with its checksum: a frame that was cut off before its checksum is one, if the
%% next byte happens to be that.
garbage_hides_at_most_two_frames_test_() ->
    {timeout, 60, fun() -> starl_platform_ct:property(prop_garbage(), 1000) end}.

prop_garbage() ->
    ?FORALL(
        {Before, Garbage, Sizes},
        {range(0, 5), garbage(), non_empty(list(range(1, 40)))},
        starl_platform_ct:safely(fun() ->
            {Whole, First} = lists:unzip([sent(2, N) || N <- lists:seq(1, Before)]),
            {After, Second} = lists:unzip([sent(2, N) || N <- lists:seq(101, 106)]),
            Bytes = iolist_to_binary([First, Garbage, Second]),
            {Found, _} = parsed(pieces(Bytes, Sizes), 2),
            Got = [F || {frame, _} = F <- Found],
            lists:prefix(Whole, Got) andalso
                lists:suffix(lists:nthtail(2, After), Got) andalso
                lists:all(fun(Frame) -> stands_in(Frame, Bytes) end, Got)
        end)
    ).

stands_in({frame, Readings}, Bytes) ->
    binary:match(Bytes, starl_create_stream:frame(?IDS, Readings, with_header)) =/= nomatch.

%% This one has the checksum 19, which the next frame begins with.
a_frame_cut_before_its_checksum_test() ->
    {Cut, Frame} = sent(2, 39),
    ?assertEqual(19, binary:last(Frame)),
    {Whole, Next} = sent(2, 4),
    {Found, _} = parsed([binary:part(Frame, 0, byte_size(Frame) - 1), Next, Next], 2),
    ?assertEqual([Cut, Whole], [F || {frame, _} = F <- Found]).

garbage() ->
    oneof([
        binary(),
        <<"bl-start\r\n2012-07-25-1458-L\r\nRDK version r3_robot/tags/release-3.2.6\r\n">>,
        %% beginnings of frames, cut off
        ?LET(
            {N, M},
            {range(0, 200), range(0, 15)},
            binary:part(element(2, sent(2, N)), 0, min(M, 14))
        ),
        ?LET(L, list(oneof([19, 12, 7, 43, byte()])), list_to_binary(L))
    ]).

%% A million bytes: no crash, no invented frame, memory bounded.
a_million_bytes_of_garbage_test_() ->
    {timeout, 60, fun() ->
        Seed = starl_platform_ct:seed(),
        State = rand:seed(exsss, Seed),
        {Garbage, _} = lists:mapfoldl(
            fun(_, S) -> rand:bytes_s(1000, S) end, State, lists:seq(1, 1000)
        ),
        {Found, Last} = parsed(Garbage, 2),
        ?assertEqual([], [F || {frame, _} = F <- Found]),
        {_, Frame} = sent(2, 7),
        {Again, _} = parsed_with([Frame, Frame, Frame], Last),
        ?assert(length([F || {frame, _} = F <- Again]) >= 1),
        ?assert(erts_debug:flat_size(Last) < 200)
    end}.
