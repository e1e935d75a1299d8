%% The positioning broadcast: its bytes, its seal, and its source.
-module(starl_live_broadcast_tests).
-include_lib("eunit/include/eunit.hrl").

%% a computer whose clock was an hour ahead when the VM started, and was set right
-export([system_time/2, time_of_day/2]).

-define(KEY, <<"01234567890123456789012345678901">>).

%% By hand: "SP", version 1, flags, run 7, picture 258, taken at 1,000,000 us, two robots.
golden_test() ->
    Poses = [{1, {100.0, -2.0, 1.5}}, {300, {0.0, 70000.0, -3.0}}],
    Rounded = hex(
        "5350 01 01 07000000 02010000 40420F0000000000 02"
        "0100 64000000 FEFFFFFF DC050000"
        "2C01 00000000 70110100 48F4FFFF"
    ),
    Options = #{run => 7, rounded => true},
    ?assertEqual([Rounded], starl_live_broadcast:encode(258, 1000000, Poses, Options)),
    ?assertEqual(
        {ok, #{number => 258, time_us => 1000000, rounded => true, poses => Poses}},
        starl_live_broadcast:decode(Rounded, #{run => 7})
    ),
    Fine = hex("5350 01 00 00000000 01000000 FFFFFFFFFFFFFFFF 01 0100 B0790100 00000000 15CD5B07"),
    ?assertEqual({error, absurd}, starl_live_broadcast:decode(Fine, #{})),
    Micro = hex("5350 01 00 00000000 01000000 FFFFFFFFFFFFFFFF 01 0100 C0960100 18FCFFFF 20A10700"),
    ?assertEqual(
        {ok, #{
            number => 1, time_us => -1, rounded => false, poses => [{1, {104.128, -1.0, 0.5}}]
        }},
        starl_live_broadcast:decode(Micro, #{})
    ),
    ?assertEqual(
        [Micro], starl_live_broadcast:encode(1, -1, [{1, {104.1281, -1.0, 0.5}}], #{})
    ).

%% Each has its reason.
refused_test() ->
    [Good] = starl_live_broadcast:encode(1, 2, [{1, {3.0, 4.0, 0.5}}], #{run => 7}),
    Decode = fun(D) -> element(2, starl_live_broadcast:decode(D, #{run => 7})) end,
    Cut = byte_size(Good) - 1,
    ?assertEqual(truncated, Decode(binary:part(Good, 0, Cut))),
    ?assertEqual(truncated, Decode(<<Good/binary, 0>>)),
    ?assertEqual(truncated, Decode(<<"SP", 1>>)),
    ?assertEqual(not_ours, Decode(<<>>)),
    ?assertEqual(not_ours, Decode(<<"XY", 1, 2, 3>>)),
    ?assertEqual(version, Decode(<<"SP", 2, (binary:part(Good, 3, Cut - 2))/binary>>)),
    ?assertEqual({error, other_run}, starl_live_broadcast:decode(Good, #{run => 8})),
    [Robot0] = [<<H/binary, 0:16, T/binary>> || <<H:21/binary, _:16, T/binary>> <- [Good]],
    ?assertEqual(absurd, Decode(Robot0)).

%% No bit of a sealed datagram can be changed, nor can it be cut, nor sealed with another key.
seal_test() ->
    Options = #{run => 7, seal_key => starl_live_broadcast:seal_key(?KEY)},
    [Sealed] = starl_live_broadcast:encode(1, 2, [{1, {3.0, 4.0, 0.5}}], Options),
    ?assertMatch({ok, _}, starl_live_broadcast:decode(Sealed, Options)),
    ?assertEqual({error, no_key}, starl_live_broadcast:decode(Sealed, #{run => 7})),
    [Open] = starl_live_broadcast:encode(1, 2, [{1, {3.0, 4.0, 0.5}}], #{run => 7}),
    ?assertEqual({error, unsealed}, starl_live_broadcast:decode(Open, Options)),
    Other = Options#{seal_key := starl_live_broadcast:seal_key(<<"another">>)},
    ?assertEqual({error, forged}, starl_live_broadcast:decode(Sealed, Other)),
    [
        ?assertMatch({error, _}, starl_live_broadcast:decode(flip(Bit, Sealed), Options))
     || Bit <- lists:seq(0, bit_size(Sealed) - 1)
    ],
    [
        ?assertMatch({error, _}, starl_live_broadcast:decode(binary:part(Sealed, 0, N), Options))
     || N <- lists:seq(0, byte_size(Sealed) - 1)
    ].

%% The same bytes everywhere, so that another program can be checked against them.
golden_seal_test() ->
    Options = #{run => 7, rounded => true, seal_key => starl_live_broadcast:seal_key(?KEY)},
    [Sealed] = starl_live_broadcast:encode(1, 1000000, [{1, {100.0, -2.0, 1.5}}], Options),
    Content = hex(
        "5350 01 03 07000000 01000000 40420F0000000000 01 0100 64000000 FEFFFFFF DC050000"
    ),
    Size = byte_size(Content),
    ?assertMatch(<<Content:Size/binary, _:16/binary>>, Sealed),
    Key = crypto:mac(hmac, sha256, ?KEY, "starl positioning 1"),
    <<Seal:16/binary, _/binary>> = crypto:mac(hmac, sha256, Key, Content),
    ?assertEqual(<<Content/binary, Seal/binary>>, Sealed).

%% More robots than fit: datagrams of at most 1,200 bytes with the same number; all are shown.
many_robots_test() ->
    Poses = [{R, {R * 1.0, 0.0, 0.0}} || R <- lists:seq(1, 500)],
    Datagrams = starl_live_broadcast:encode(9, 1000, Poses, #{}),
    ?assertEqual(7, length(Datagrams)),
    ?assert(lists:max([byte_size(D) || D <- Datagrams]) =< 1200),
    {Shown, _} = hear(
        [{5000, D} || D <- Datagrams],
        source(#{
            participants => starl_team:new(
                lists:seq(1, 500)
            )
        })
    ),
    ?assertEqual(Poses, [{R, P} || {R, P, 5000} <- Shown]).

%% Robots of others are not ours.
strangers_test() ->
    [Datagram] = starl_live_broadcast:encode(
        1, 1, [{2, {1.0, 1.0, 0.0}}, {9, {1.0, 1.0, 0.0}}], #{}
    ),
    ?assertMatch({[{2, _, _}], _}, hear([{10, Datagram}], source(#{}))).

%% The same datagram again, or an earlier one, shows nothing.
again_test() ->
    [A] = starl_live_broadcast:encode(1, 100, [{1, {1.0, 1.0, 0.0}}], #{}),
    [B] = starl_live_broadcast:encode(2, 200, [{1, {2.0, 1.0, 0.0}}], #{}),
    {[{1, {2.0, _, _}, _}], S} = hear([{1000, B}, {1100, A}, {1200, B}, {9000000, B}], source(#{})),
    ?assertEqual(1, figure(old, S)).

%% The clock of the run may pass faster than real time: what is 10 ms old is 40 ms old.
pace_test() ->
    Clock = starl_live_clock:new(1000000, 4),
    Source = source(#{clock => Clock, latency_us => 10000}),
    [A] = starl_live_broadcast:encode(1, 100, [{1, {1.0, 1.0, 0.0}}], #{}),
    {[{1, _, Taken}], _} = hear([{3000000, A}], Source),
    ?assertEqual(starl_live_clock:at_us(3000000, Clock) - 40000, Taken).

%% A sealed datagram that was recorded is refused: at once, since it is no newer; after a silence; and
%% by a robot that has just started, since its time is long ago.
replayed_test() ->
    Options = #{seal_key => starl_live_broadcast:seal_key(?KEY)},
    T = 1700000000000000,
    Sent = fun(N) ->
        hd(starl_live_broadcast:encode(N, T + N * 1000, [{1, {1.0 * N, 0.0, 0.0}}], Options))
    end,
    Source = source(#{key => ?KEY}),
    {Shown, S} = hear([{T + N * 1000, Sent(N)} || N <- lists:seq(1, 10)], Source),
    ?assertEqual(10, length(Shown)),
    {[], S1} = hear([{T + 2000000 + N * 1000, Sent(N)} || N <- lists:seq(1, 9)], S),
    ?assertEqual(9, figure(old, S1)),
    {[], S2} = hear([{T + 20000000, Sent(5)}], Source),
    ?assertEqual(1, figure(wrong_time, S2)).

-define(HOUR_US, 3600000000).

system_time(Unit, set_right) -> erlang:convert_time_unit(?HOUR_US, microsecond, Unit).
time_of_day(_Unit, set_right) -> 0.

%% The times of the poses are the VM's, as all of the robot's.
a_clock_that_was_set_right_sees_test() ->
    Options = #{seal_key => starl_live_broadcast:seal_key(?KEY)},
    T = 1700000000000000,
    [Sent] = starl_live_broadcast:encode(1, T, [{1, {1.0, 0.0, 0.0}}], Options),
    Clock = starl_live_clock:on({?MODULE, set_right}, starl_live_clock:new(0, 1)),
    {Shown, _} = hear([{T + ?HOUR_US, Sent}], source(#{key => ?KEY, clock => Clock})),
    ?assertEqual([{1, {1.0, 0.0, 0.0}, T + ?HOUR_US}], Shown).

%% The key stands in nothing that a log may show.
hidden_key_test() ->
    Hidden = source(#{key => fun() -> ?KEY end}),
    ?assertEqual(nomatch, binary:match(term_to_text(Hidden), term_to_text(?KEY))),
    Options = #{seal_key => starl_live_broadcast:seal_key(?KEY)},
    [Datagram] = starl_live_broadcast:encode(1, 1000, [{1, {1.0, 2.0, 0.0}}], Options),
    ?assertMatch({[{1, _, _}], _}, hear([{1000, Datagram}], Hidden)),
    #{seal_key := SealKey} = Options,
    ?assertEqual(nomatch, binary:match(term_to_text(Hidden), term_to_text(SealKey()))).

term_to_text(Term) -> unicode:characters_to_binary(io_lib:format("~w", [Term])).

options_test() ->
    Line = fun(Config) ->
        {error, Text} = starl_live_broadcast:open(Config),
        lists:flatten(Text)
    end,
    ?assertEqual("run must be a number from 0 to 4294967295, not -1", Line(#{run => -1})),
    ?assertEqual("key must be the fleet's key, a binary", Line(#{key => "secret"})).

%% -- helpers --------------------------------------------------------------------------------

hex(Text) -> binary:decode_hex(<<<<C>> || <<C>> <= list_to_binary(Text), C =/= $\s>>).

flip(Bit, Datagram) ->
    <<Before:Bit/bitstring, B:1, After/bitstring>> = Datagram,
    <<Before/bitstring, (1 - B):1, After/bitstring>>.

source(Options) ->
    starl_live_broadcast:new(
        maps:merge(
            #{
                robot => 1,
                participants => starl_team:new([1, 2, 3]),
                clock => starl_live_clock:new(0, 1)
            },
            Options
        )
    ).

hear(Datagrams, Source) ->
    lists:foldl(
        fun({Arrived, Datagram}, {Shown, S}) ->
            {More, Next} = starl_live_broadcast:datagram(Datagram, Arrived, S),
            {Shown ++ More, Next}
        end,
        {[], Source},
        Datagrams
    ).

figure(Figure, S) -> maps:get(Figure, starl_live_broadcast:figures({none, S}), 0).
