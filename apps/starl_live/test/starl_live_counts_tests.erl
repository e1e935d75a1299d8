-module(starl_live_counts_tests).
-include_lib("eunit/include/eunit.hrl").

-define(DATA(Seq), {starl, 1, data, {1, 1, Seq, Seq, #{}, note, hello}}).

%% A message that is acknowledged after 30 ms, at the second try.
latency_test() ->
    Lines = lines([
        {0, sap, {sent, {1, 1, 7}, [2], note, 0}},
        ?DATA(7),
        ?DATA(7),
        {30000, sap, {outcome, {1, 1, 7}, 2, acknowledged}}
    ]),
    ?assertEqual("1", maps:get("starl_messages_sent_total", Lines)),
    ?assertEqual("1", maps:get("starl_retransmissions_total", Lines)),
    ?assertEqual("2", maps:get("starl_packets_sent_total{kind=\"data\"}", Lines)),
    ?assertEqual("1", maps:get("starl_messages_ended_total{outcome=\"acknowledged\"}", Lines)),
    ?assertEqual("0", maps:get("starl_message_seconds_bucket{le=\"0.02\"}", Lines)),
    ?assertEqual("1", maps:get("starl_message_seconds_bucket{le=\"0.05\"}", Lines)),
    ?assertEqual("1", maps:get("starl_message_seconds_bucket{le=\"+Inf\"}", Lines)),
    ?assertEqual("0.03", maps:get("starl_message_seconds_sum", Lines)).

%% A lost message has no latency; one of an earlier life of SAP has no outcome.
lost_test() ->
    Lines = lines([
        {0, sap, {sent, {1, 1, 7}, [2, 3], note, 0}},
        {5000000, sap, {outcome, {1, 1, 7}, 2, lost}},
        {0, sap, {sent, {1, 1, 8}, [2], note, 0}},
        {9, sap, crashed},
        {9, sap, {started, 2}},
        {9, sap, {outcome, {1, 1, 8}, 2, acknowledged}}
    ]),
    ?assertEqual("3", maps:get("starl_messages_sent_total", Lines)),
    ?assertEqual("1", maps:get("starl_messages_ended_total{outcome=\"lost\"}", Lines)),
    ?assertEqual("0", maps:get("starl_message_seconds_count", Lines)),
    ?assertEqual("1", maps:get("starl_restarts_total{machine=\"sap\"}", Lines)).

others_test() ->
    Lines = lines([
        {0, sap, {delivered, {2, 1, 1}, note, 0}},
        {0, sap, {overload, note}},
        {0, sap, {dropped, stranger, 9}},
        {0, motion, {anything, 'else'}},
        {starl, 1, ack, 1, 1, 1, 4}
    ]),
    ?assertEqual("1", maps:get("starl_messages_delivered_total", Lines)),
    ?assertEqual("1", maps:get("starl_messages_refused_total", Lines)),
    ?assertEqual("1", maps:get("starl_packets_dropped_total{reason=\"stranger\"}", Lines)),
    ?assertEqual("1", maps:get("starl_packets_sent_total{kind=\"ack\"}", Lines)),
    ?assertEqual("0", maps:get("starl_retransmissions_total", Lines, "0")).

%% Who is heard, and the longest round trip of those; a battery that tells.
gauges_test() ->
    Peer = #{robot => 2, is_silent => false, heard_ms => 3, round_trip_us => 2000},
    Peers = [Peer, Peer#{robot := 3, is_silent := true, round_trip_us := 9000}],
    ?assertEqual(
        [{peers, [], 2}, {peers_heard, [], 1}, {round_trip_seconds, [], 0.002}],
        starl_live_counts:peers(Peers)
    ),
    ?assertEqual([], starl_live_counts:peers([])),
    ?assertEqual([{battery_percent, [], 71}], starl_live_counts:chassis(#{charge => 71})),
    ?assertEqual([], starl_live_counts:chassis(#{charge => none})).

%% What is left of the leases that a robot holds: of tokens, until it has released or lost them, and of
%% the right to send what only a leader sends.
leases_test() ->
    Beat = {starl, 1, shout, 1, dpp_beat, any},
    Events = [
        {0, mutex, {leased, door, 3, 4000000}},
        {0, mutex, {leased, key, 1, 9000000}},
        {500000, mutex, {released, key, 1}},
        {1000000, mutex, {leased, door, 3, 5000000}},
        {1000000, mutex, {leased, gate, 2, 500000}}
    ],
    Held = lists:foldl(fun counted/2, starl_live_counts:new(), Events),
    Counts = starl_live_counts:sent_until(3000000, Beat, Held),
    ?assertEqual(
        [{lease_seconds, [{token, door}], 4.0}, {lease_seconds, [{type, dpp_beat}], 1.0}],
        starl_live_counts:leases(2000000, Counts)
    ),
    Lost = counted({2000000, mutex, {lease_lost, door, 3}}, Counts),
    ?assertEqual(
        [{lease_seconds, [{type, dpp_beat}], 1.0}], starl_live_counts:leases(2000000, Lost)
    ),
    ?assertEqual([], starl_live_counts:leases(3000000, Lost)).

%% Each family has its type, once, before its lines.
format_test() ->
    Gauges = [{queue, [{of_what, b}], 2}, {queue, [{of_what, a}], 1}],
    Text = text(Gauges, starl_live_counts:new()),
    Want = "# TYPE starl_queue gauge\nstarl_queue{of_what=\"a\"} 1\nstarl_queue{of_what=\"b\"} 2\n",
    ?assert(lists:prefix(Want, Text)).

%% A token may be any term.
quotes_test() ->
    Text = text([{lease_seconds, [{token, <<"door">>}], 1.0}], starl_live_counts:new()),
    Want = "starl_lease_seconds{token=\"<<\\\"door\\\">>\"} 1.0\n",
    ?assertNotEqual(nomatch, string:find(Text, Want)).

lines(What) ->
    Counts = lists:foldl(fun counted/2, starl_live_counts:new(), What),
    maps:from_list([
        list_to_tuple(string:split(Line, " ", trailing))
     || [C | _] = Line <- string:split(text([], Counts), "\n", all), C =/= $#
    ]).

counted({starl, 1, _, _} = Packet, Counts) -> starl_live_counts:transmits(2, Packet, Counts);
counted({starl, 1, ack, _, _, _, _} = Ack, Counts) -> starl_live_counts:transmits(2, Ack, Counts);
counted({Us, Machine, Event}, Counts) -> starl_live_counts:traced({Us, 1, Machine, Event}, Counts).

text(Gauges, Counts) ->
    lists:flatten(io_lib:format("~ts", [starl_live_counts:text(Gauges, Counts)])).
