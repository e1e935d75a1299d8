%% Messages under way: their names and numbers, what is sent when, and what becomes known of them.
-module(starl_sap_out_tests).
-include_lib("eunit/include/eunit.hrl").

-define(DELAYS, [100, 150, 225]).
-define(WINDOW, 3).

new() -> starl_sap_out:new(1, 5, ?DELAYS, ?WINDOW).

id(Seq) -> {1, 5, Seq}.

send(To, From, Out) -> starl_sap_out:send({To, {t, hi, infinity}}, From, #{}, Out).

broadcast(Dests, From, Out) -> starl_sap_out:broadcast({Dests, {t, hi, infinity}}, From, #{}, Out).

settle(By, Seq, Outcome, Out) -> settle({By, 1}, 5, Seq, Outcome, Out).

settle(By, Own, Seq, Outcome, Out) -> starl_sap_out:settle(By, Own, Seq, Outcome, Out).

sent(Seq, Dests) -> {trace, {sent, id(Seq), Dests, t, erlang:phash2(hi)}}.

timer(Seq, Us) -> {{timeout, {retransmit, Seq}}, Us, again}.

cancelled(Seq) -> {{timeout, {retransmit, Seq}}, cancel}.

data(Seq, Number) -> data(Seq, Number, #{}).

data(Seq, Number, For) -> starl_packet:data({1, 5, Seq, Number, For, t, hi}).

outcome(Seq, By, Outcome) -> {trace, {outcome, id(Seq), By, Outcome}}.

answered(Seq, Answer) -> [{trace, {answered, id(Seq), Answer}}, {reply, me, Answer}].

%% The state after these steps; what they do is not looked at.
all(Steps) -> all(Steps, new()).

all(Steps, Out) -> lists:foldl(fun(Step, O) -> element(2, Step(O)) end, Out, Steps).

sends(To) -> fun(O) -> send(To, none, O) end.

broadcasts(Dests) -> fun(O) -> broadcast(Dests, none, O) end.

acked(By, Seq) -> fun(O) -> settle(By, Seq, acknowledged, O) end.

again(Seq) -> fun(O) -> starl_sap_out:retransmit(Seq, O) end.

%% -- sending ---------------------------------------------------------------------------------

send_test() ->
    {Actions, Out} = send(2, none, new()),
    ?assertEqual([sent(1, [2]), timer(1, 100), {transmit, 2, data(1, 1)}], Actions),
    {Next, _} = send(2, me, Out),
    Called = {trace, {called, id(2), one}},
    ?assertEqual([sent(2, [2]), Called, timer(2, 100), {transmit, 2, data(2, 2)}], Next).

%% Names count in an incarnation, numbers to a robot or among the broadcasts.
names_and_numbers_test() ->
    {Actions, Out} = send(3, none, all([sends(2), broadcasts([2, 3])])),
    ?assertEqual([sent(3, [3]), timer(3, 100), {transmit, 3, data(3, 1)}], Actions),
    {All, _} = broadcast([2, 3], me, Out),
    Called = {trace, {called, id(4), all}},
    Sent = {transmit, all, data(4, {all, 2})},
    ?assertEqual([sent(4, [2, 3]), Called, timer(4, 100), Sent], All).

%% The packet says which incarnation it is meant for, of those that it still goes to.
meant_for_test() ->
    For = #{2 => 7, 3 => 8},
    {Actions, Out} = starl_sap_out:broadcast({[2, 3], {t, hi, infinity}}, none, For, new()),
    ?assertEqual({transmit, all, data(1, {all, 1}, For)}, lists:last(Actions)),
    {_, Left} = settle({2, 7}, 5, 1, acknowledged, Out),
    {Again, _} = starl_sap_out:retransmit(1, Left),
    ?assertEqual([timer(1, 150), {transmit, 3, data(1, {all, 1}, #{3 => 8})}], Again).

%% A message to oneself has a name and no packet.
send_own_test() ->
    {Id, Before, After, Out} = starl_sap_out:send_own(t, hi, me, new()),
    ?assertEqual(id(1), Id),
    ?assertEqual([sent(1, [1]), {trace, {called, id(1), one}}], Before),
    ?assertEqual([outcome(1, 1, acknowledged) | answered(1, ok)], After),
    {Other, _, [_], _} = starl_sap_out:send_own(t, hi, none, Out),
    ?assertEqual(id(2), Other).

%% -- retransmission --------------------------------------------------------------------------

%% Again after each of the waiting times, as the same message; after the last it is lost.
retransmit_test() ->
    {_, First} = send(2, me, new()),
    {Second, Out2} = starl_sap_out:retransmit(1, First),
    ?assertEqual([timer(1, 150), {transmit, 2, data(1, 1)}], Second),
    {Third, Out3} = starl_sap_out:retransmit(1, Out2),
    ?assertEqual([timer(1, 225), {transmit, 2, data(1, 1)}], Third),
    {Lost, Out4} = starl_sap_out:retransmit(1, Out3),
    ?assertEqual([outcome(1, 2, lost) | answered(1, {error, lost})], Lost),
    ?assertEqual(none, starl_sap_out:retransmit(1, Out4)),
    ?assertEqual({2, 1}, starl_sap_out:lows(2, Out4)),
    ?assertEqual(sent(2, [2]), hd(element(1, send(2, none, Out4)))).

%% A broadcast goes again to each robot that has not acknowledged; lost it is at those alone.
retransmit_broadcast_test() ->
    {_, First} = broadcast([2, 3, 4], me, new()),
    {[Trace], Out} = settle(3, 1, acknowledged, First),
    ?assertEqual(outcome(1, 3, acknowledged), Trace),
    {Again, Out2} = starl_sap_out:retransmit(1, Out),
    Packet = data(1, {all, 1}),
    ?assertEqual([timer(1, 150), {transmit, 2, Packet}, {transmit, 4, Packet}], Again),
    {Lost, Out3} = starl_sap_out:retransmit(1, all([again(1)], Out2)),
    Outcomes = [outcome(1, 2, lost), outcome(1, 4, lost)],
    ?assertEqual(Outcomes ++ answered(1, {error, {lost, [2, 4]}}), Lost),
    ?assertEqual([{1, 2}, {1, 2}, {1, 2}], [starl_sap_out:lows(R, Out3) || R <- [2, 3, 4]]).

unknown_message_test() ->
    ?assertEqual(none, starl_sap_out:retransmit(1, new())),
    ?assertEqual(none, starl_sap_out:retransmit(2, all([sends(2)]))).

%% -- outcomes --------------------------------------------------------------------------------

acknowledged_test() ->
    {_, Out} = send(2, me, new()),
    {Actions, Done} = settle(2, 1, acknowledged, Out),
    ?assertEqual([outcome(1, 2, acknowledged), cancelled(1) | answered(1, ok)], Actions),
    ?assertEqual(none, settle(2, 1, acknowledged, Done)),
    ?assertEqual(none, starl_sap_out:retransmit(1, Done)).

%% A refusal comes from another incarnation than the one that the message was meant for.
refused_test() ->
    {_, Out} = send(2, me, new()),
    {Actions, _} = settle({2, 2}, 5, 1, restarted, Out),
    Answer = answered(1, {error, restarted}),
    ?assertEqual([outcome(1, 2, restarted), cancelled(1) | Answer], Actions),
    ?assertEqual(untrue, settle({2, 1}, 5, 1, restarted, Out)),
    ?assertEqual(untrue, settle({2, 2}, 5, 1, acknowledged, Out)).

%% Which it was meant for is what was known when it was first sent.
outcome_of_the_meant_test() ->
    {_, Out} = starl_sap_out:send({2, {t, hi, infinity}}, none, #{2 => 3}, new()),
    ?assertEqual(untrue, settle({2, 1}, 5, 1, acknowledged, Out)),
    ?assertEqual(untrue, settle({2, 3}, 5, 1, restarted, Out)),
    ?assertMatch({[_, _], _}, settle({2, 3}, 5, 1, acknowledged, Out)),
    ?assertMatch({[_, _], _}, settle({2, 1}, 5, 1, restarted, Out)).

%% What is said of no message, of another robot's or of an earlier incarnation's is nothing.
nothing_waited_for_test() ->
    Out = all([sends(2)]),
    ?assertEqual(none, settle(2, 2, acknowledged, Out)),
    ?assertEqual(none, settle(3, 1, acknowledged, Out)),
    [?assertEqual(none, settle({2, 1}, Own, 1, acknowledged, Out)) || Own <- [4, 6]].

%% All robots have to say so; the answer comes with the last, and names those that have not.
broadcast_outcome_test() ->
    {_, Out} = broadcast([4, 3, 2], me, new()),
    {[Acked], One} = settle(3, 1, acknowledged, Out),
    ?assertEqual(outcome(1, 3, acknowledged), Acked),
    {[Refused], Two} = settle({4, 2}, 5, 1, restarted, One),
    ?assertEqual(outcome(1, 4, restarted), Refused),
    ?assertEqual(none, settle(3, 1, acknowledged, Two)),
    {Last, _} = settle({2, 2}, 5, 1, restarted, Two),
    Answer = answered(1, {error, {lost, [2, 4]}}),
    ?assertEqual([outcome(1, 2, restarted), cancelled(1) | Answer], Last),
    {Good, _} = settle(2, 1, acknowledged, Two),
    ?assertEqual(answered(1, {error, {lost, [4]}}), lists:nthtail(2, Good)),
    {_, All} = settle(4, 1, acknowledged, One),
    {Ok, _} = settle(2, 1, acknowledged, All),
    ?assertEqual(answered(1, ok), lists:nthtail(2, Ok)).

%% -- the window ------------------------------------------------------------------------------

%% The numbers under way to a robot lie within the window; that to another is another one.
window_test() ->
    Full = all([sends(2), sends(2), sends(2)]),
    ?assertEqual(full, send(2, none, Full)),
    ?assertMatch({_, _}, send(3, none, Full)),
    ?assertEqual(full, send(2, none, all([acked(2, 2)], Full))),
    ?assertEqual(full, send(2, none, all([acked(2, 3)], Full))),
    {_, More} = send(2, none, all([acked(2, 1)], Full)),
    ?assertEqual(full, send(2, none, More)).

%% What was lost is not under way any more.
window_after_loss_test() ->
    Full = all([sends(2), sends(2), sends(2)]),
    ?assertMatch({_, _}, send(2, none, all([again(1), again(1), again(1)], Full))).

%% At a robot whose window is used up a broadcast is lost at once; it goes to the others.
window_of_broadcasts_test() ->
    Full = all([broadcasts([2]), broadcasts([2]), broadcasts([2])]),
    ?assertEqual(full, broadcast([2], me, Full)),
    {Actions, Out} = broadcast([2, 3], me, Full),
    [Sent, Called, Timer, Packet | Traces] = Actions,
    ?assertEqual([sent(4, [2, 3]), {trace, {called, id(4), all}}], [Sent, Called]),
    ?assertEqual([timer(4, 100), {transmit, all, data(4, {all, 4})}], [Timer, Packet]),
    ?assertEqual([outcome(4, 2, lost)], Traces),
    {[_, _ | Answer], _} = settle(3, 4, acknowledged, Out),
    ?assertEqual(answered(4, {error, {lost, [2]}}), Answer),
    ?assertEqual(none, settle(2, 4, acknowledged, Out)).

%% Broadcasts use up no window of messages to one robot, nor these one of broadcasts.
windows_apart_test() ->
    Casts = all([broadcasts([2]), broadcasts([2]), broadcasts([2])]),
    ?assertMatch({_, _}, send(2, none, Casts)),
    Ones = all([sends(2), sends(2), sends(2)]),
    ?assertMatch({_, _}, broadcast([2], none, Ones)).

%% The lowest numbers that are still waited for; where there are none, the next to come.
lows_test() ->
    ?assertEqual({1, 1}, starl_sap_out:lows(2, new())),
    Out = all([sends(2), sends(2), broadcasts([2, 3]), broadcasts([3])]),
    ?assertEqual({1, 1}, starl_sap_out:lows(2, Out)),
    ?assertEqual({1, 1}, starl_sap_out:lows(3, Out)),
    ?assertEqual({2, 1}, starl_sap_out:lows(2, all([acked(2, 1)], Out))),
    ?assertEqual({1, 1}, starl_sap_out:lows(2, all([acked(2, 2)], Out))),
    ?assertEqual({3, 1}, starl_sap_out:lows(2, all([acked(2, 1), acked(2, 2)], Out))),
    ?assertEqual({1, 3}, starl_sap_out:lows(2, all([acked(2, 3)], Out))),
    ?assertEqual({1, 2}, starl_sap_out:lows(3, all([acked(3, 3)], Out))).
