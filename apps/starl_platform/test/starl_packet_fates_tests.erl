%% Packets of live runs: what the two ends of a radio tell, put together.
-module(starl_packet_fates_tests).
-include_lib("eunit/include/eunit.hrl").

-define(BRIEF, {data, ping, 7}).
-define(ARRIVES, {arrives, [{130, intact}]}).

sent(At, From, To, Hash) -> {At, From, radio, {sent, To, ?BRIEF, 40, Hash}}.

came(At, From, To, Hash, Fate) -> {At, To, radio, {came, From, ?BRIEF, 40, Hash, Fate}}.

packet(At, From, To, Fate) -> {At, From, radio, {packet, To, ?BRIEF, 40, Fate}}.

told(Events) -> lists:foldl(fun starl_packet_fates:report/2, starl_packet_fates:new(), Events).

due(Until, Events) -> element(1, starl_packet_fates:due(Until, told(Events))).

%% In whatever order the two tell.
fates_are_known_in_whatever_order_they_are_told_test() ->
    Sent = [sent(100, 1, 2, a), sent(100, 1, 3, a), sent(105, 2, 1, b)],
    Came = [came(110, 1, 2, a, ?ARRIVES), came(109, 1, 3, a, {lost, cut})],
    Expected = [
        packet(100, 1, 2, ?ARRIVES),
        packet(100, 1, 3, {lost, cut}),
        packet(105, 2, 1, {lost, unheard})
    ],
    ?assertEqual(Expected, due(200, Sent ++ Came)),
    ?assertEqual(Expected, due(200, Came ++ Sent)).

%% Nothing is told before its time, and nothing twice.
nothing_is_told_before_its_time_nor_twice_test() ->
    Ways = told([sent(100, 1, 2, a), sent(200, 1, 2, b), came(210, 1, 2, b, ?ARRIVES)]),
    {First, Left} = starl_packet_fates:due(150, Ways),
    ?assertEqual([packet(100, 1, 2, {lost, unheard})], First),
    {Second, None} = starl_packet_fates:due(250, Left),
    ?assertEqual([packet(200, 1, 2, ?ARRIVES)], Second),
    ?assertMatch({[], _}, starl_packet_fates:due(infinity, None)).

%% The same content again: the first packet was lost, the second came, and a copy of it.
same_content_again_is_told_apart_test() ->
    Events = [
        sent(100, 1, 2, a),
        sent(500200, 1, 2, a),
        sent(550200, 1, 2, a),
        came(560000, 1, 2, a, ?ARRIVES),
        came(570000, 1, 2, a, {lost, chance}),
        came(570001, 1, 2, a, {lost, cut})
    ],
    ?assertEqual(
        [
            packet(100, 1, 2, {lost, unheard}),
            packet(500200, 1, 2, ?ARRIVES),
            packet(550200, 1, 2, {lost, chance}),
            packet(570001, 1, 2, {lost, cut})
        ],
        due(infinity, Events)
    ).

%% Its sender was killed before it could tell; a packet that could not be sent.
packet_of_a_killed_sender_counts_as_sent_test() ->
    Refused = packet(90, 2, 1, {lost, refused}),
    ?assertEqual(
        [Refused, packet(110, 1, 2, ?ARRIVES)],
        due(infinity, [came(110, 1, 2, a, ?ARRIVES), Refused])
    ).

%% The clock of robot 2 is behind: what it gets came before it was sent.
receiver_with_a_clock_behind_is_understood_test() ->
    Events = [
        Event
     || N <- [1, 2, 3],
        Event <- [
            sent(1000 * N, 1, 2, N),
            came(1000 * N - 30, 1, 2, N, ?ARRIVES),
            sent(1000 * N, 2, 1, N),
            came(1000 * N + 40, 2, 1, N, ?ARRIVES)
        ]
    ],
    {Packets, Ways} = starl_packet_fates:due(infinity, told(Events)),
    ?assertEqual([?ARRIVES], lists:usort([Fate || {_, _, _, {packet, _, _, _, Fate}} <- Packets])),
    ?assertEqual([{{1, 2}, 30}], starl_packet_fates:early(Ways)).
