%% OptiTrack's NatNet: the bytes of each version, what is refused, and the source.
-module(starl_live_natnet_tests).
-include_lib("eunit/include/eunit.hrl").

%% -- bytes by hand --------------------------------------------------------------------------

%% Body 1 stands at (1.5, 0.25, -2.0) m, turned by 90 degrees about the vertical axis; body 2 is not
%% seen.
bodies() ->
    "01000000 0000C03F 0000803E 000000C0 00000000 F304353F 00000000 F304353F 0AD7233C 0100"
    "02000000 00000000 00000000 00000000 00000000 00000000 00000000 0000803F 00000000 0000".

%% Time code, its subframe, 1.5 s; exposed at 1,000, received at 2,000, sent at 3,000.
suffix() ->
    "00000000 00000000 000000000000F83F E803000000000000 D007000000000000 B80B000000000000".

%% A frame of version 3 or 4.0: number 7; a marker set "all" with one marker; one unlabelled marker;
%% the bodies; a skeleton of one bone; a labelled marker; a force plate with a channel of two values;
%% no device.
golden_3() ->
    packet(
        "0700 0000"
        "07000000"
        "01000000 616C6C00 01000000 0000803F 0000803F 0000803F"
        "01000000 0000803F 0000803F 0000803F"
        "02000000" ++ bodies() ++
            "01000000 09000000 01000000"
            "01000000 00000000 00000000 00000000 00000000 00000000 00000000 0000803F 00000000 0100"
            "01000000 01000000 0000803F 0000803F 0000803F 0AD7233C 0A00 00000000"
            "01000000 05000000 01000000 02000000 0000803F 0000803F"
            "00000000" ++ suffix() ++ "0000 00000000"
    ).

%% The same of version 4.1: each section tells its size, and there are assets before the labelled
%% markers.
golden_4_1() ->
    packet(
        "0700 0000"
        "07000000"
        "01000000 14000000 616C6C00 01000000 0000803F 0000803F 0000803F"
        "01000000 0C000000 0000803F 0000803F 0000803F"
        "02000000 4C000000" ++ bodies() ++
            "01000000 2E000000 09000000 01000000"
            "01000000 00000000 00000000 00000000 00000000 00000000 00000000 0000803F 00000000 0100"
            "01000000 03000000 AABBCC"
            "01000000 1A000000 01000000 0000803F 0000803F 0000803F 0AD7233C 0A00 00000000"
            "01000000 14000000 05000000 01000000 02000000 0000803F 0000803F"
            "00000000 00000000" ++ suffix() ++ "0000000000000000 0000 00000000"
    ).

%% The size of the content is filled in.
packet(Text) ->
    <<Kind:16, _:16, Content/binary>> = hex(Text),
    <<Kind:16, (byte_size(Content)):16/little, Content/binary>>.

golden_test() ->
    [
        begin
            {ok, {frame, Frame}} = starl_live_natnet_codec:decode(Packet, Version),
            #{number := 7, times := {1000, 3000}, bodies := [Body, unseen]} = Frame,
            {1, {1.5, 0.25, -2.0}, {quaternion, 0.0, S, 0.0, S}} = Body,
            ?assert(abs(S - math:sqrt(0.5)) < 1.0e-6)
        end
     || {Packet, Version} <- [
            {golden_3(), {3, 0}},
            {golden_3(), {3, 1}},
            {golden_3(), {4, 0}},
            {golden_4_1(), {4, 1}},
            {golden_4_1(), {4, 2}}
        ]
    ].

%% A version that is not known here is refused, whatever the bytes; so is a frame before the version is
%% known.
version_test() ->
    [
        ?assertEqual({error, version}, starl_live_natnet_codec:decode(golden_3(), Version))
     || Version <- [{2, 0}, {2, 10}, {5, 0}, {0, 0}, unknown]
    ].

%% The wrong version's bytes are no frame.
mistaken_version_test() ->
    ?assertEqual({error, truncated}, starl_live_natnet_codec:decode(golden_3(), {4, 1})),
    ?assertEqual({error, truncated}, starl_live_natnet_codec:decode(golden_4_1(), {3, 1})).

server_golden_test() ->
    Name = <<"Motive", 0:(250 * 8)>>,
    Content = <<Name/binary, (hex("02010000 03010000 D38C320000000000 E705 01 EFFF2A63"))/binary>>,
    Packet = <<1:16/little, (byte_size(Content)):16/little, Content/binary>>,
    ?assertEqual(
        {ok, {server, #{name => <<"Motive">>, version => {3, 1}, hz => 3312851}}},
        starl_live_natnet_codec:decode(Packet, unknown)
    ),
    %% before 3.0 it ended with the versions
    Old = binary:part(Content, 0, 264),
    ?assertMatch(
        {ok, {server, #{version := {3, 1}, hz := unknown}}},
        starl_live_natnet_codec:decode(<<1:16/little, 264:16/little, Old/binary>>, unknown)
    ),
    ?assertEqual(
        {error, truncated},
        starl_live_natnet_codec:decode(<<1:16/little, 10:16/little, 0:80>>, unknown)
    ).

requests_golden_test() ->
    Sender = <<"Ping", 0:(252 * 8), 0, 0, 0, 0, 4, 1, 0, 0>>,
    ?assertEqual(
        <<0, 0, 8, 1, Sender/binary, 0>>, starl_live_natnet_codec:connect(own)
    ),
    ?assertEqual(
        <<0, 0, 13, 1, Sender/binary, 0, 3, 1, 0, 0, 0>>, starl_live_natnet_codec:connect({3, 1})
    ),
    ?assertEqual(<<10, 0, 0, 0, 0>>, starl_live_natnet_codec:keep_alive()).

%% No prefix of a frame is a frame, nor is one whose counts were enlarged.
truncated_test() ->
    [
        [
            ?assertEqual(
                {error, truncated},
                starl_live_natnet_codec:decode(binary:part(Packet, 0, N), Version)
            )
         || N <- lists:seq(0, byte_size(Packet) - 1)
        ]
     || {Packet, Version} <- [{golden_3(), {3, 1}}, {golden_4_1(), {4, 1}}]
    ].

%% Cut off behind the bodies, with a size that fits: the bodies are read, the times are unknown.
without_times_test() ->
    <<_:4/binary, Content/binary>> = golden_3(),
    Bodies = binary:part(Content, 0, 4 + 24 + 16 + 4 + 76),
    Packet = <<7, 0, (byte_size(Bodies)):16/little, Bodies/binary>>,
    ?assertMatch(
        {ok, {frame, #{times := unknown, bodies := [{1, _, _}, unseen]}}},
        starl_live_natnet_codec:decode(Packet, {3, 1})
    ).

%% Sections say they have four thousand million items: nothing is made for them.
huge_counts_test() ->
    Huge = <<16#FFFFFFFF:32>>,
    [
        begin
            Content = <<7:32/little, 0:(Before * 32), Huge/binary, 0:(64 * 8)>>,
            Packet = <<7, 0, (byte_size(Content)):16/little, Content/binary>>,
            {Reductions, _} = reductions(fun() ->
                starl_live_natnet_codec:decode(Packet, Version)
            end),
            ?assert(Reductions < 10000, Reductions)
        end
     || Before <- lists:seq(0, 12), Version <- [{3, 0}, {4, 1}]
    ].

reductions(F) ->
    {reductions, R0} = process_info(self(), reductions),
    Value = F(),
    {reductions, R1} = process_info(self(), reductions),
    {R1 - R0, Value}.

%% Bodies that a later version made longer, by 4 bytes each, are read by the section's size.
longer_bodies_test() ->
    Golden = golden_4_1(),
    [Before, After] = binary:split(Golden, hex("4C000000")),
    <<One:38/binary, Two:38/binary, Rest/binary>> = After,
    <<_:4/binary, Content/binary>> =
        <<Before/binary, (hex("54000000"))/binary, Two/binary, 1, 2, 3, 4, One/binary, 5, 6, 7, 8,
            Rest/binary>>,
    Packet = <<7, 0, (byte_size(Content)):16/little, Content/binary>>,
    ?assertMatch(
        {ok, {frame, #{times := {1000, 3000}, bodies := [unseen, {1, _, _}]}}},
        starl_live_natnet_codec:decode(Packet, {4, 5})
    ).

%% -- the source -----------------------------------------------------------------------------

%% The version and the clock come from the server. The body stands at x 1,500 and, since Motive's third
%% axis points backwards, y 2,000, and looks along y. It was exposed 2,000 ticks of a microsecond
%% before it was sent.
pose_test() ->
    {[], [], A} = starl_live_natnet:packet(golden_3(), 10000, source(#{})),
    ?assertEqual(1, figure(version, A)),
    Server = starl_live_mocap_fake:server(<<"Motive">>, {3, 1}, 1000000),
    {[], [{info, Line}], B} = starl_live_natnet:packet(Server, 20000, A),
    ?assertEqual("positions come from Motive, NatNet 3.1", lists:flatten(Line)),
    {[], [], B} = starl_live_natnet:packet(Server, 30000, B),
    {[{1, {X, Y, Heading}, 48000}], [], C} = starl_live_natnet:packet(golden_3(), 50000, B),
    ?assertEqual({1500.0, 2000.0}, {X, Y}),
    ?assert(abs(Heading - math:pi() / 2) < 1.0e-6),
    ?assertEqual(1, figure(unseen, C)),
    %% Motive that is paused sends the same frame again
    ?assertMatch({[], [], _}, starl_live_natnet:packet(golden_3(), 60000, C)).

%% Of another major version, one line says what to do, once.
unknown_version_test() ->
    [
        begin
            Server = starl_live_mocap_fake:server(<<"Motive">>, Version, 1000000),
            {[], [{error, Line}], A} = starl_live_natnet:packet(Server, 1, source(#{})),
            ?assertEqual(Said ++ advice(), lists:flatten(Line)),
            {[], [], B} = starl_live_natnet:packet(Server, 2, A),
            {[], [], C} = starl_live_natnet:packet(golden_3(), 3, B),
            ?assertEqual(1, figure(version, C))
        end
     || {Version, Said} <- [
            {{2, 10}, "Motive speaks NatNet 2.10"}, {{5, 0}, "Motive speaks NatNet 5.0"}
        ]
    ].

advice() ->
    ": only versions 3 and 4 are read here. Have Motive stream version 4.1 or 3.1 (Settings, "
    "Streaming), or give version => {4, 1}".

%% A server that was started anew may speak another version.
another_version_test() ->
    {_, _, A} = starl_live_natnet:packet(
        starl_live_mocap_fake:server(<<"Motive">>, {3, 1}, 1000), 1, source(#{})
    ),
    {_, [{info, _}], B} = starl_live_natnet:packet(
        starl_live_mocap_fake:server(<<"Motive">>, {4, 1}, 1000), 2, A
    ),
    ?assertMatch({[{1, _, _}], [], _}, starl_live_natnet:packet(golden_4_1(), 3, B)).

%% A version that was given counts, also where the server cannot be asked or says otherwise.
given_version_test() ->
    Source = source(#{version => {3, 1}}),
    {[{1, _, 40000}], [], A} = starl_live_natnet:packet(golden_3(), 50000, Source),
    {[], [{info, _}], B} = starl_live_natnet:packet(
        starl_live_mocap_fake:server(<<"Motive">>, {4, 1}, 1000), 60000, A
    ),
    Again = starl_live_mocap_fake:frame({3, 1}, #{number => 8, bodies => [body(1, 0.0)]}),
    ?assertMatch({[{1, _, _}], [], _}, starl_live_natnet:packet(Again, 70000, B)).

%% Asked each second until it answers, then every fifth; by unicast, it is told each second that somebody
%% listens.
requests_test() ->
    Connect = starl_live_natnet_codec:connect(own),
    Alive = starl_live_natnet_codec:keep_alive(),
    {Early, A} = ticks(3, source(#{unicast => true})),
    ?assertEqual(lists:duplicate(3, [Connect, Alive]), Early),
    {_, _, B} = starl_live_natnet:packet(
        starl_live_mocap_fake:server(<<"Motive">>, {3, 1}, 1000), 1, A
    ),
    {Later, _} = ticks(7, B),
    ?assertEqual([2], [length(L) || L <- Later, length(L) > 1]),
    {Multicast, _} = ticks(2, source(#{})),
    ?assertEqual([[Connect], [Connect]], Multicast).

ticks(N, Source) ->
    lists:mapfoldl(fun(_, S) -> starl_live_natnet:requests(S) end, Source, lists:seq(1, N)).

%% Streaming IDs may be given other robots; others' bodies are nobody's.
bodies_test() ->
    Frame = #{number => 1, bodies => [body(1, 1.0), body(40, 2.0)]},
    Packet = starl_live_mocap_fake:frame({3, 1}, Frame),
    {[{2, {2000.0, _, _}, _}], [], S} = starl_live_natnet:packet(
        Packet, 10000, source(#{version => {3, 1}, bodies => #{40 => 2}})
    ),
    ?assertEqual(1, figure(other_bodies, S)).

%% Frames full of everything else, in every version.
clutter_test() ->
    [
        begin
            Frame = #{number => 1, clutter => 5, bodies => [body(1, 1.0)], times => {10, 20}},
            Packet = starl_live_mocap_fake:frame(Version, Frame),
            ?assertMatch(
                {ok, {frame, #{times := {10, 20}, bodies := [{1, _, _}]}}},
                starl_live_natnet_codec:decode(Packet, Version)
            )
        end
     || Version <- [{3, 0}, {3, 1}, {4, 0}, {4, 1}, {4, 2}]
    ].

%% Cameras that do not know when they were exposed: the latency that was given counts.
unknown_exposure_test() ->
    Server = starl_live_mocap_fake:server(<<"Motive">>, {3, 1}, 1000000),
    {_, _, A} = starl_live_natnet:packet(Server, 1, source(#{latency_us => 7000})),
    [
        begin
            Frame = #{number => 1, bodies => [body(1, 1.0)], times => Times},
            Packet = starl_live_mocap_fake:frame({3, 1}, Frame),
            ?assertMatch({[{1, _, 93000}], [], _}, starl_live_natnet:packet(Packet, 100000, A))
        end
     || Times <- [{0, 5000}, {0, 0}, {6000, 5000}, {1, 16#FFFFFFFFFFFFFFFF}]
    ].

%% A server without a clock, or whose clock does not go: each frame counts when it comes.
unknown_clock_test() ->
    [
        begin
            Server = starl_live_mocap_fake:server(<<"Motive">>, {3, 1}, Hz),
            {_, _, A} = starl_live_natnet:packet(Server, 1, source(#{})),
            Packet = fun(N) ->
                Frame = #{number => N, bodies => [body(1, 1.0)], times => Times},
                starl_live_mocap_fake:frame({3, 1}, Frame)
            end,
            {[{1, _, 90000}], [], B} = starl_live_natnet:packet(Packet(1), 100000, A),
            ?assertMatch({[{1, _, 190000}], [], _}, starl_live_natnet:packet(Packet(2), 200000, B))
        end
     || {Hz, Times} <- [{0, {10, 20}}, {1000000, {0, 0}}]
    ].

options_test() ->
    Line = fun(Config) ->
        {error, Text} = starl_live_natnet:open(Config),
        lists:flatten(Text)
    end,
    ?assertEqual(
        "NatNet needs server, the address of Motive's computer, or else version, like {3, 1}",
        Line(#{})
    ),
    ?assertMatch("a NatNet server that sends by unicast" ++ _, Line(#{unicast => true})),
    ?assertEqual(
        "version is that of NatNet, from {3, 0} to {4, 255}, not {2,10}",
        Line(#{version => {2, 10}})
    ),
    ?assertMatch("version is" ++ _, Line(#{version => "3.1", server => "127.0.0.1"})),
    ?assertEqual(
        "\"motive\" is no IPv4 address like \"192.168.1.20\"", Line(#{server => "motive"})
    ),
    ?assertEqual(
        "\"1.2.3.4\" is no multicast address (224.0.0.0 to 239.255.255.255)",
        Line(#{server => "127.0.0.1", group => "1.2.3.4"})
    ).

%% -- helpers --------------------------------------------------------------------------------

hex(Text) -> binary:decode_hex(<<<<C>> || <<C>> <= list_to_binary(Text), C =/= $\s>>).

body(Id, X) -> {Id, {X, 0.0, 0.0}, {quaternion, 0.0, 0.0, 0.0, 1.0}, true}.

source(Options) ->
    starl_live_natnet:new(
        maps:merge(
            #{
                robot => 1,
                participants => starl_team:new([1, 2, 3]),
                clock => starl_live_clock:new(0, 1)
            },
            Options
        )
    ).

figure(Figure, Source) -> maps:get(Figure, starl_live_natnet:figures_of(Source), 0).
