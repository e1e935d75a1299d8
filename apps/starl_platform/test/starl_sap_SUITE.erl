%% The contract of SAP (README): at most once per receiver, uncorrupted, to the right
%% type, reported lost after the limit, bounded memory; delivered or reported lost in bounded time.
%% Pure machines in a pure network; starl_sap_monitor is the judge.
-module(starl_sap_SUITE).
-include_lib("stdlib/include/assert.hrl").
-include_lib("proper/include/proper.hrl").

-export([all/0]).
-export([
    contract_under_faults/1, progress_when_healed/1, no_loss_all_acknowledged/1,
    duplicate_acknowledged_not_redelivered/1, outcome_when_the_ack_arrives/1,
    lost_after_the_limit/1, lost_may_have_been_delivered/1, back_off/1,
    sequence_numbers_restart_with_the_robot/1, receiver_restart_is_no_redelivery/1,
    restarted_receiver_is_reported/1, old_packets_of_an_earlier_incarnation/1,
    seen_set_is_bounded/1, window_is_an_overload/1, unclaimed_waits_for_its_listener/1,
    unclaimed_beyond_bounds_not_acknowledged/1, unclaimed_own_messages_are_bounded/1,
    loopback/1, broadcast_one_packet/1, broadcast_retransmits_to_those_missing/1,
    broadcast_alone/1, garbage_is_traced/1
]).

-define(CONFIG, #{
    retransmit_ms => 50, backoff => 1.5, longest_ms => 200, limit => 4, window => 16, unclaimed => 4
}).

all() ->
    [
        contract_under_faults, progress_when_healed, no_loss_all_acknowledged,
        duplicate_acknowledged_not_redelivered, outcome_when_the_ack_arrives,
        lost_after_the_limit, lost_may_have_been_delivered, back_off,
        sequence_numbers_restart_with_the_robot, receiver_restart_is_no_redelivery,
        restarted_receiver_is_reported, old_packets_of_an_earlier_incarnation,
        seen_set_is_bounded, window_is_an_overload, unclaimed_waits_for_its_listener,
        unclaimed_beyond_bounds_not_acknowledged, unclaimed_own_messages_are_bounded,
        loopback, broadcast_one_packet, broadcast_retransmits_to_those_missing,
        broadcast_alone, garbage_is_traced
    ].

%% -- properties -----------------------------------------------------------------------------

%% Safety, under loss, duplication, reordering, delay and crashes at any moment.
contract_under_faults(_) ->
    Prop = ?FORALL(
        {N, Ops, Faults},
        {range(2, 4), resize(60, list(op(4))), faults()},
        starl_platform_ct:safely(fun() -> keeps_contract(N, Ops, Faults) end)
    ),
    starl_platform_ct:property(Prop, 300).

keeps_contract(N, Ops, Faults) ->
    Net = starl_platform_net:run(load(N, Ops, Faults)),
    Violations = starl_platform_net:judge(Net, bound()),
    Inboxes = [starl_platform_net:inbox(R, Net) || R <- lists:seq(1, N)],
    %% bodies are unique, so no listener may see one twice, crashes of the SAPs or not
    Once = lists:all(fun(Inbox) -> length(Inbox) =:= length(lists:usort(Inbox)) end, Inboxes),
    Typed = lists:all(fun({_, Type, {Type, _}}) -> true; (_) -> false end, lists:append(Inboxes)),
    Violations =:= [] andalso Once andalso Typed orelse
        begin
            ct:log("~p~nonce ~p typed ~p", [Violations, Once, Typed]),
            false
        end.

%% Progress: from the last crash on, with the network healed, every message gets its outcome.
progress_when_healed(_) ->
    Prop = ?FORALL(
        {N, Ops, Faults, Last},
        {range(2, 4), resize(40, list(op(4))), faults(), non_empty(resize(10, list(send(4))))},
        starl_platform_ct:safely(fun() -> progresses(N, Ops, Faults, Last) end)
    ),
    starl_platform_ct:property(Prop, 200).

progresses(N, Ops, Faults, Last) ->
    Stormy = load(N, Ops, Faults),
    Heal = 100000000,
    Healed = starl_platform_net:at(Heal, {fate, fun(_, _, _, _) -> [3000] end}, Stormy),
    Listening = lists:foldl(
        fun({R, T}, Net) -> starl_platform_net:at(Heal, {cast, R, {listen, T, app}}, Net) end,
        Healed, [{R, T} || R <- lists:seq(1, N), T <- [a, b]]
    ),
    %% the first messages teach every SAP the incarnations of the others
    Warm = lists:foldl(
        fun(R, Net) -> starl_platform_net:at(Heal + 1000, {cast, R, {broadcast, a, {a, warm}}}, Net) end,
        Listening, lists:seq(1, N)
    ),
    {_, Full} = lists:foldl(
        fun(Op, {K, Net}) ->
            {K + 1, starl_platform_net:at(Heal + 2000000, call(Op, N, {last, K}), Net)}
        end,
        {1, Warm}, Last
    ),
    Net = starl_platform_net:run(Full),
    Outcomes = [A || {_, _, {last, _}, A} <- starl_platform_net:replies(Net)],
    length(Outcomes) =:= length(Last)
        andalso lists:all(fun(A) -> A =:= ok end, Outcomes)
        andalso starl_platform_net:now(Net) =< Heal + 2000000 + bound().

%% op/1 for robots 1..N; a robot that is not in the net is folded into it.
%% (PropEr's range/2 keeps to small numbers, hence the lists.)
op(N) -> {oneof([0, 500, 5000, 20000, 60000, 150000]), frequency([
    {8, send(N)}, {3, {listen, range(1, N), type()}}, {2, {crash, range(1, N)}}])}.

send(N) -> oneof([{send, range(1, N), range(1, N), type()}, {post, range(1, N), range(1, N), type()},
                  {broadcast, range(1, N), type()}]).

type() -> oneof([a, b]).

faults() -> {oneof(lists:seq(1, 1000)), oneof([0, 10, 50]), oneof([0, 30]), oneof([1000, 30000, 400000])}.

load(N, Ops, Faults) ->
    Net0 = starl_platform_net:new(#{
        robots => lists:seq(1, N), config => ?CONFIG, fate => fate(Faults)
    }),
    {_, _, Net} = lists:foldl(
        fun({Delay, Op}, {T, K, Net}) ->
            {T + Delay, K + 1, starl_platform_net:at(T + Delay, planned(Op, N, K), Net)}
        end,
        {0, 1, Net0}, Ops
    ),
    Net.

planned({listen, R, Type}, N, _) -> {cast, fold(R, N), {listen, Type, app}};
planned({crash, R}, N, _) -> {crash, fold(R, N)};
planned({post, From, To, Type}, N, K) ->
    {cast, fold(From, N), {send, fold(To, N), Type, {Type, K}}};
planned(Send, N, K) -> call(Send, N, K).

call({post, From, To, Type}, N, K) -> call({send, From, To, Type}, N, K);
call({send, From, To, Type}, N, K) ->
    {call, fold(From, N), {send, fold(To, N), Type, {Type, K}}, K};
call({broadcast, From, Type}, N, K) ->
    {call, fold(From, N), {broadcast, Type, {Type, K}}, K}.

fold(R, N) -> (R - 1) rem N + 1.

%% Stateless draws, so that shrinking one thing away leaves the others alone.
fate({Seed, Loss, Duplicate, MaxUs}) ->
    fun(_Packet, From, To, N) ->
        Draw = fun(What, Range) -> erlang:phash2({Seed, From, To, N, What}, Range) end,
        Copies = case Draw(duplicate, 100) < Duplicate of true -> [one, two]; false -> [one] end,
        [1000 + Draw(Copy, MaxUs) || Draw(loss, 100) >= Loss, Copy <- Copies]
    end.

bound() -> starl_sap:bound_us(?CONFIG).

%% -- one by one -----------------------------------------------------------------------------

%% Progress: no loss and no crash, then all is delivered, in any order, and acknowledged.
no_loss_all_acknowledged(_) ->
    Net0 = net(2, fate({1, 0, 50, 40000})),
    Net1 = lists:foldl(
        fun(K, Net) -> starl_platform_net:at(K * 20000, {call, 1, {send, 2, a, {a, K}}, K}, Net) end,
        starl_platform_net:at(0, {cast, 2, {listen, a, app}}, Net0), lists:seq(1, 100)
    ),
    Net = starl_platform_net:run(Net1),
    ?assertEqual([], starl_platform_net:judge(Net, bound())),
    ?assertEqual(lists:seq(1, 100), lists:sort([K || {_, a, {a, K}} <- starl_platform_net:inbox(2, Net)])),
    ?assertEqual(
        [{K, ok} || K <- lists:seq(1, 100)],
        lists:sort([{K, A} || {_, 1, K, A} <- starl_platform_net:replies(Net)])
    ).

%% Every copy of a message is acknowledged, one is delivered.
duplicate_acknowledged_not_redelivered(_) ->
    Fate = fun
        ({starl, 1, data, _}, _, _, _) -> [1000, 2000, 9000];
        (_, _, _, _) -> [1000]
    end,
    Net = send_one(Fate),
    ?assertEqual([{1, a, {a, 1}}], starl_platform_net:inbox(2, Net)),
    ?assertEqual(3, length([ack || {_, 2, 1, {starl, 1, ack, 2, 1, 1, 1}} <- starl_platform_net:air(Net)])),
    ?assertEqual([], starl_platform_net:judge(Net, bound())).

%% The outcome is reported when the acknowledgement arrives, not at the next timer.
outcome_when_the_ack_arrives(_) ->
    Net = send_one(fun(_, _, _, _) -> [7000] end),
    ?assertMatch([{14000, 1, 1, ok}], starl_platform_net:replies(Net)).

%% After the last retransmission the message is reported lost, at the bound and not later.
lost_after_the_limit(_) ->
    Net = send_one(fun(_, _, _, _) -> [] end),
    ?assertEqual([{bound(), 1, 1, {error, lost}}], starl_platform_net:replies(Net)),
    ?assertEqual(5, length([data || {_, 1, 2, _} <- starl_platform_net:air(Net)])),
    ?assertEqual([], starl_platform_net:inbox(2, Net)).

%% A lost report does not say that the message was not delivered.
lost_may_have_been_delivered(_) ->
    Fate = fun
        ({starl, 1, ack, _, _, _, _}, _, _, _) -> [];
        (_, _, _, _) -> [1000]
    end,
    Net = send_one(Fate),
    ?assertMatch([{_, 1, 1, {error, lost}}], starl_platform_net:replies(Net)),
    ?assertEqual([{1, a, {a, 1}}], starl_platform_net:inbox(2, Net)),
    ?assertEqual([], starl_platform_net:judge(Net, bound())).

%% Retransmissions back off up to the longest delay.
back_off(_) ->
    Net = send_one(fun(_, _, _, _) -> [] end),
    ?assertEqual([0, 50000, 125000, 237500, 406250 - 0],
                 [T || {T, 1, 2, _} <- starl_platform_net:air(Net)]).

%% Pitfall: sequence numbers that restart with the robot. The first message of the second
%% incarnation is another one than the first message of the first.
sequence_numbers_restart_with_the_robot(_) ->
    Net = plan(net(2), [
        {0, {cast, 2, {listen, a, app}}},
        {1000, {call, 1, {send, 2, a, {a, 1}}, 1}},
        {100000, {crash, 1}},
        {200000, {call, 1, {send, 2, a, {a, 2}}, 2}}
    ]),
    ?assertEqual([{1, a, {a, 1}}, {1, a, {a, 2}}], starl_platform_net:inbox(2, Net)),
    ?assertMatch([{_, 1, 1, ok}, {_, 1, 2, ok}], starl_platform_net:replies(Net)).

%% Pitfall: the receiver forgets what it took. A copy that is under way while the receiver
%% restarts is not delivered again, and the sender hears of it.
receiver_restart_is_no_redelivery(_) ->
    Fate = fun
        ({starl, 1, data, _}, _, _, _) -> [1000, 300000];
        ({starl, 1, ack, _, _, _, _}, _, _, 1) -> [];
        (_, _, _, _) -> [1000]
    end,
    Net = plan(net(2, Fate), [
        {0, {cast, 2, {listen, a, app}}},
        {1000, {call, 1, {send, 2, a, {a, 1}}, 1}},
        {30000, {crash, 2}},
        {30000, {cast, 2, {listen, a, app}}}
    ]),
    ?assertEqual([{1, a, {a, 1}}], starl_platform_net:inbox(2, Net)),
    ?assertMatch([{_, 1, 1, {error, restarted}}], starl_platform_net:replies(Net)),
    ?assertEqual([], starl_platform_net:judge(Net, bound())).

%% A message for an earlier incarnation of the receiver is refused; the next one gets through.
restarted_receiver_is_reported(_) ->
    Deaf = fun
        ({starl, 1, hello, _, _}, _, _, _) -> [];
        (_, _, _, _) -> [1000]
    end,
    Net = plan(net(2, Deaf), [
        {0, {crash, 2}},
        {1000, {cast, 2, {listen, a, app}}},
        {2000, {call, 1, {send, 2, a, {a, 1}}, 1}},
        {50000, {call, 1, {send, 2, a, {a, 2}}, 2}}
    ]),
    ?assertMatch([{4000, 1, 1, {error, restarted}}, {_, 1, 2, ok}], starl_platform_net:replies(Net)),
    ?assertEqual([{1, a, {a, 2}}], starl_platform_net:inbox(2, Net)).

%% Packets of a source's earlier incarnation are not taken once a later one has been heard.
old_packets_of_an_earlier_incarnation(_) ->
    Slow = fun
        ({starl, 1, data, {_, _, _, _, _, _, {a, 1}}}, _, _, _) -> [500000];
        (_, _, _, _) -> [1000]
    end,
    Net = plan(net(2, Slow), [
        {0, {cast, 2, {listen, a, app}}},
        {1000, {call, 1, {send, 2, a, {a, 1}}, 1}},
        {20000, {crash, 1}},
        {40000, {call, 1, {send, 2, a, {a, 2}}, 2}}
    ]),
    ?assertEqual([{1, a, {a, 2}}], starl_platform_net:inbox(2, Net)).

%% Pitfall: an unbounded set of what was seen. Neither side keeps more after 3000 messages than
%% after 100, with loss and duplicates and an addressee that is gone.
seen_set_is_bounded(_) ->
    Net0 = net(3, fun
        (_, _, 3, _) -> [];
        (P, F, T, N) -> (fate({7, 10, 30, 40000}))(P, F, T, N)
    end),
    Sends = [
        {K * 100000, {cast, 1, {send, 1 + K rem 2 + 1, a, {a, K}}}} || K <- lists:seq(1, 3000)
    ],
    Net1 = lists:foldl(
        fun({T, Op}, Net) -> starl_platform_net:at(T, Op, Net) end,
        starl_platform_net:at(0, {cast, 2, {listen, a, app}}, Net0), Sends
    ),
    Early = starl_platform_net:run(10000000, Net1),
    Late = starl_platform_net:run(300000000, Early),
    [
        ?assert(starl_platform_net:size(R, Late) < 2 * starl_platform_net:size(R, Early) + 200)
     || R <- [1, 2]
    ],
    Quiet = starl_platform_net:run(Late),
    ?assert(starl_platform_net:size(1, Quiet) < starl_platform_net:size(1, net(3)) + 100).

%% Sequence numbers under way lie at most a window apart; beyond it a message is not sent.
window_is_an_overload(_) ->
    Dead = net(2, fun(_, _, _, _) -> [] end),
    Net = plan(Dead, [{K, {call, 1, {send, 2, a, {a, K}}, K}} || K <- lists:seq(1, 20)]),
    Answers = lists:sort([{K, A} || {_, 1, K, A} <- starl_platform_net:replies(Net)]),
    ?assertEqual(
        [{K, {error, lost}} || K <- lists:seq(1, 16)] ++
            [{K, {error, overload}} || K <- lists:seq(17, 20)],
        Answers
    ),
    ?assertEqual([], starl_platform_net:judge(Net, bound())).

%% Messages without a listener wait for one, and come in their order.
unclaimed_waits_for_its_listener(_) ->
    Net = plan(net(2), [{K * 20000, {call, 1, {send, 2, a, {a, K}}, K}} || K <- [1, 2, 3]] ++
        [{100000, {cast, 2, {listen, a, app}}}]),
    ?assertEqual([{1, a, {a, K}} || K <- [1, 2, 3]], starl_platform_net:inbox(2, Net)),
    ?assertMatch([{_, _, _, ok}, {_, _, _, ok}, {_, _, _, ok}], starl_platform_net:replies(Net)).

%% Beyond the bounds they are not acknowledged; those of other types are not held up.
unclaimed_beyond_bounds_not_acknowledged(_) ->
    Net = plan(net(2), [{0, {cast, 2, {listen, b, app}}}] ++
        [{K * 1000, {call, 1, {send, 2, a, {a, K}}, K}} || K <- lists:seq(1, 6)] ++
        [{10000, {call, 1, {send, 2, b, {b, 7}}, 7}}]),
    Answers = maps:from_list([{K, A} || {_, 1, K, A} <- starl_platform_net:replies(Net)]),
    ?assertEqual([ok, ok, ok, ok, {error, lost}, {error, lost}, ok],
                 [maps:get(K, Answers) || K <- lists:seq(1, 7)]),
    ?assertEqual([], starl_platform_net:judge(Net, bound())).

%% The bounds hold for a robot's messages to itself as well.
unclaimed_own_messages_are_bounded(_) ->
    Few = plan(net(2), [{K, {cast, 1, {send, 1, a, {a, K}}}} || K <- lists:seq(1, 10)]),
    Many = plan(net(2), [{K, {cast, 1, {send, 1, a, {a, K}}}} || K <- lists:seq(1, 1000)]),
    ?assertEqual(starl_platform_net:size(1, Few), starl_platform_net:size(1, Many)).

%% A message to oneself is delivered and acknowledged without a packet.
loopback(_) ->
    Net = plan(net(2, fun(_, _, _, _) -> [] end), [
        {0, {cast, 1, {listen, a, app}}}, {1000, {call, 1, {send, 1, a, {a, 1}}, 1}}
    ]),
    ?assertEqual([{1, a, {a, 1}}], starl_platform_net:inbox(1, Net)),
    ?assertEqual([{1000, 1, 1, ok}], starl_platform_net:replies(Net)),
    ?assertEqual([], starl_platform_net:air(Net)),
    ?assertEqual([], starl_platform_net:judge(Net, bound())).

%% A broadcast is one packet on the air for all.
broadcast_one_packet(_) ->
    Net = plan(net(4), listening(4) ++ [{1000, {call, 1, {broadcast, a, {a, 1}}, 1}}]),
    ?assertMatch([all], [D || {_, 1, D, {starl, 1, data, _}} <- starl_platform_net:air(Net)]),
    ?assertMatch([{11000, 1, 1, ok}], starl_platform_net:replies(Net)),
    [?assertEqual([{1, a, {a, 1}}], starl_platform_net:inbox(R, Net)) || R <- [2, 3, 4]].

%% Then it goes again only to those that did not acknowledge; and the outcome names the lost.
broadcast_retransmits_to_those_missing(_) ->
    Fate = fun
        (_, 1, 3, 1) -> [];
        (_, 1, 4, _) -> [];
        (_, _, _, _) -> [5000]
    end,
    Net = plan(net(4, Fate), listening(4) ++ [{1000, {call, 1, {broadcast, a, {a, 1}}, 1}}]),
    Dests = [D || {_, 1, D, {starl, 1, data, _}} <- starl_platform_net:air(Net)],
    ?assertEqual([all, 3, 4, 4, 4, 4], [hd(Dests) | lists:sort(tl(Dests))]),
    ?assertMatch([{_, 1, 1, {error, {lost, [4]}}}], starl_platform_net:replies(Net)),
    [?assertEqual([{1, a, {a, 1}}], starl_platform_net:inbox(R, Net)) || R <- [2, 3]],
    ?assertEqual([], starl_platform_net:judge(Net, bound())).

broadcast_alone(_) ->
    Net = plan(net(1), [{0, {call, 1, {broadcast, a, {a, 1}}, 1}}]),
    ?assertEqual([{0, 1, 1, ok}], starl_platform_net:replies(Net)).

%% An unknown event is never fatal and never silent.
garbage_is_traced(_) ->
    Net = plan(net(2), [{0, {packet, 1, garbage}}, {1, {packet, 1, {starl, 2, data, #{}}}},
                        {2, {cast, 1, garbage}}]),
    ?assertMatch([_, _, _], [E || {_, 1, sap, {unknown_event, _, _} = E} <- starl_platform_net:trace(Net)]).

%% -- helpers --------------------------------------------------------------------------------

net(N) -> net(N, fun(_, _, _, _) -> [5000] end).

net(N, Fate) ->
    starl_platform_net:new(#{robots => lists:seq(1, N), config => ?CONFIG, fate => Fate}).

plan(Net, Ops) ->
    starl_platform_net:run(
        lists:foldl(fun({T, Op}, N) -> starl_platform_net:at(T, Op, N) end, Net, Ops)
    ).

listening(N) -> [{0, {cast, R, {listen, a, app}}} || R <- lists:seq(1, N)].

send_one(Fate) ->
    plan(net(2, Fate), [{0, {cast, 2, {listen, a, app}}}, {0, {call, 1, {send, 2, a, {a, 1}}, 1}}]).
