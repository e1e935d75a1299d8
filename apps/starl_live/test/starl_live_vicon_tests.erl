%% Vicon Tracker's UDP object stream: its bytes, and its source.
-module(starl_live_vicon_tests).
-include_lib("eunit/include/eunit.hrl").

%% By hand: frame 258, two objects of 72 bytes, filled up to 256.
golden() ->
    <<Objects:155/binary>> = hex(
        "02010000 02"
        "00 4800 637265617465 31 0000000000000000000000000000000000"
        "0000000000408F40 0000000000407FC0 0000000000406F40"
        "0000000000000000 0000000000000000 000000000000E03F"
        "00 4800 637265617465 32 0000000000000000000000000000000000"
        "000000000000F03F 0000000000000040 0000000000000000"
        "0000000000000000 0000000000000000 000000000000E0BF"
    ),
    <<Objects/binary, 0:(101 * 8)>>.

golden_test() ->
    ?assertEqual(256, byte_size(golden())),
    ?assertEqual(
        {ok, 258, [
            {<<"create1">>, {1000.0, -500.0, 250.0}, {euler, 0.0, 0.0, 0.5}},
            {<<"create2">>, {1.0, 2.0, 0.0}, {euler, 0.0, 0.0, -0.5}}
        ]},
        starl_live_vicon:decode(golden())
    ),
    {[{1, {1000.0, -500.0, A}, 40000}, {2, {1.0, 2.0, B}, 40000}], _} =
        starl_live_vicon:datagram(golden(), 50000, source(#{})),
    ?assert(abs(A - 0.5) < 1.0e-12),
    ?assert(abs(B + 0.5) < 1.0e-12).

%% The encoder of the tests writes the same bytes.
encoder_test() ->
    {ok, Frame, Objects} = starl_live_vicon:decode(golden()),
    ?assertEqual(golden(), starl_live_mocap_fake:vicon(Frame, Objects, 256)).

%% Zeros alone are no place; numbers that are none, and a robot that lies on its side, are refused; each
%% is counted, and the others are shown.
refused_test() ->
    NaN = <<0, 0, 0, 0, 0, 0, 16#F8, 16#7F>>,
    Objects = [
        {<<"create1">>, <<0:(48 * 8)>>},
        {<<"create1">>, <<NaN/binary, 0:(40 * 8)>>},
        {<<"create1">>, {1.0, 1.0, 1.0}, {euler, 1.5, 0.0, 0.0}},
        {<<"create1">>, {1.0e9, 1.0, 1.0}, {euler, 0.0, 0.0, 0.0}},
        {<<"ball">>, {1.0, 1.0, 1.0}, {euler, 0.0, 0.0, 0.0}},
        {<<"create2">>, {7.0, 8.0, 0.0}, {euler, 0.0, 0.0, 0.0}}
    ],
    {Shown, S} = starl_live_vicon:datagram(
        starl_live_mocap_fake:vicon(1, Objects, 512), 10000, source(#{})
    ),
    ?assertEqual([{2, {7.0, 8.0, 0.0}, 0}], Shown),
    ?assertEqual(
        #{absurd => 2, datagrams => 1, other_objects => 1, tilted => 1, unseen => 1}, figures(S)
    ).

%% A name of 24 bytes has no zero at its end.
long_name_test() ->
    Name = <<"abcdefghijklmnopqrstuvwx">>,
    Datagram = starl_live_mocap_fake:vicon(
        1, [{Name, {1.0, 2.0, 0.0}, {euler, 0.0, 0.0, 0.0}}], 80
    ),
    ?assertMatch(
        {[{3, _, _}], _},
        starl_live_vicon:datagram(Datagram, 10000, source(#{names => #{Name => 3}}))
    ).

%% An item of another kind is skipped by its size; an object that has become longer is read.
other_items_test() ->
    {ok, _, [First, _]} = starl_live_vicon:decode(golden()),
    <<_:5/binary, 0, 72, 0, Object:72/binary, _/binary>> = golden(),
    Items = <<7, 3, 0, "abc", 0, 80, 0, Object/binary, 1, 2, 3, 4, 5, 6, 7, 8>>,
    ?assertEqual({ok, 9, [First]}, starl_live_vicon:decode(<<9:32/little, 2, Items/binary>>)).

%% Objects of one frame that come in two datagrams are of one picture; the same frame again is none.
two_datagrams_test() ->
    Object = fun(Name) -> {Name, {1.0, 2.0, 0.0}, {euler, 0.0, 0.0, 0.0}} end,
    One = starl_live_mocap_fake:vicon(5, [Object(<<"create1">>)], 256),
    Two = starl_live_mocap_fake:vicon(5, [Object(<<"create2">>)], 256),
    {[{1, _, _}], A} = starl_live_vicon:datagram(One, 10000, source(#{})),
    {[{2, _, _}], B} = starl_live_vicon:datagram(Two, 10100, A),
    ?assertMatch({[], _}, starl_live_vicon:datagram(One, 90000, B)).

%% Where the frame rate is known, a datagram that was delayed is as old as its number tells.
rate_test() ->
    Object = {<<"create1">>, {1.0, 2.0, 0.0}, {euler, 0.0, 0.0, 0.0}},
    Datagram = fun(N) -> starl_live_mocap_fake:vicon(N, [Object], 256) end,
    Late = fun(Source) ->
        {_, A} = starl_live_vicon:datagram(Datagram(100), 1000000, Source),
        {[{1, _, Taken}], _} = starl_live_vicon:datagram(Datagram(101), 1060000, A),
        Taken
    end,
    ?assertEqual(1000000, Late(source(#{rate_hz => 100}))),
    ?assertEqual(1050000, Late(source(#{}))).

%% The front of robot 2 is to the left of its object's x axis.
turns_test() ->
    {[{1, {_, _, A}, _}, {2, {_, _, B}, _}], _} =
        starl_live_vicon:datagram(golden(), 50000, source(#{turns => #{2 => math:pi() / 2}})),
    ?assert(abs(A - 0.5) < 1.0e-12),
    ?assert(abs(B - (math:pi() / 2 - 0.5)) < 1.0e-12).

%% Of a datagram that was cut off, the whole objects are read.
truncated_test() ->
    ?assertEqual(error, starl_live_vicon:decode(<<1, 2, 3, 4>>)),
    ?assertMatch({ok, 258, [_]}, starl_live_vicon:decode(binary:part(golden(), 0, 154))),
    ?assertMatch({ok, _, []}, starl_live_vicon:decode(<<1:32, 255, 0, 16#FFFF:16>>)).

options_test() ->
    Line = fun(Config) ->
        {error, Text} = starl_live_vicon:open(Config),
        lists:flatten(Text)
    end,
    ?assertEqual(
        "Vicon shows objects by name: give names, as in #{<<\"create1\">> => 1}", Line(#{})
    ),
    ?assertEqual(
        "an object of Vicon has no name like create1", Line(#{names => #{create1 => 1}})
    ),
    ?assertMatch("axes" ++ _, Line(#{names => #{<<"a">> => 1}, axes => {1, 3, 2}})).

%% -- helpers --------------------------------------------------------------------------------

hex(Text) -> binary:decode_hex(<<<<C>> || <<C>> <= list_to_binary(Text), C =/= $\s>>).

source(Options) ->
    starl_live_vicon:new(
        maps:merge(
            #{
                robot => 1,
                participants => starl_team:new([1, 2, 3]),
                clock => starl_live_clock:new(0, 1),
                names => #{<<"create1">> => 1, <<"create2">> => 2}
            },
            Options
        )
    ).

figures(S) -> starl_live_vicon:figures({none, S}).
