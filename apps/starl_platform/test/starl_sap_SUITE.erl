%% The contract of SAP (README): at most once per receiver, uncorrupted, to the right
%% type, reported lost after the limit, bounded memory; delivered or reported lost in bounded time.
%% Pure machines in a pure network; starl_sap_monitor is the judge.
-module(starl_sap_SUITE).
-include_lib("stdlib/include/assert.hrl").
-include_lib("proper/include/proper.hrl").

-export([all/0]).
-export([
    contract_under_faults/1,
    progress_when_healed/1,
    no_loss_all_acknowledged/1,
    duplicate_acknowledged_not_redelivered/1,
    outcome_when_the_ack_arrives/1,
    lost_after_the_limit/1,
    lost_may_have_been_delivered/1,
    back_off/1,
    sequence_numbers_restart_with_the_robot/1,
    receiver_restart_is_no_redelivery/1,
    restarted_receiver_is_reported/1,
    old_packets_of_an_earlier_incarnation/1,
    seen_set_is_bounded/1,
    window_is_an_overload/1,
    unclaimed_waits_for_its_listener/1,
    unclaimed_beyond_bounds_not_acknowledged/1,
    unclaimed_own_messages_are_bounded/1,
    loopback/1,
    broadcast_one_packet/1,
    broadcast_retransmits_to_those_missing/1,
    broadcast_alone/1,
    garbage_is_traced/1,
    dead_peer_stops_nobody/1,
    dead_peer_stops_no_broadcast/1,
    own_messages_take_no_window/1,
    full_inbox_pushes_back/1,
    full_inbox_in_the_end_lost/1,
    room_is_shared_by_types/1,
    room_after_restarts/1,
    own_message_to_a_full_inbox/1,
    second_listener_is_refused/1,
    far_number_is_asked_about/1,
    gap_is_asked_about/1,
    many_unheard_restarts/1,
    huge_incarnation_mutes_nobody/1,
    wrong_incarnation_is_put_right/1,
    untrue_answers_are_dropped/1,
    strangers_are_dropped/1,
    answers_are_traced/1,
    hostile_packets/1,
    hostile_packets_take_no_room/1
]).

-define(CONFIG, #{
    retransmit_ms => 50, backoff => 1.5, longest_ms => 200, limit => 4, window => 16, unclaimed => 4
}).

all() ->
    [
        contract_under_faults,
        progress_when_healed,
        no_loss_all_acknowledged,
        duplicate_acknowledged_not_redelivered,
        outcome_when_the_ack_arrives,
        lost_after_the_limit,
        lost_may_have_been_delivered,
        back_off,
        sequence_numbers_restart_with_the_robot,
        receiver_restart_is_no_redelivery,
        restarted_receiver_is_reported,
        old_packets_of_an_earlier_incarnation,
        seen_set_is_bounded,
        window_is_an_overload,
        unclaimed_waits_for_its_listener,
        unclaimed_beyond_bounds_not_acknowledged,
        unclaimed_own_messages_are_bounded,
        loopback,
        broadcast_one_packet,
        broadcast_retransmits_to_those_missing,
        broadcast_alone,
        garbage_is_traced,
        dead_peer_stops_nobody,
        dead_peer_stops_no_broadcast,
        own_messages_take_no_window,
        full_inbox_pushes_back,
        full_inbox_in_the_end_lost,
        room_is_shared_by_types,
        room_after_restarts,
        own_message_to_a_full_inbox,
        second_listener_is_refused,
        far_number_is_asked_about,
        gap_is_asked_about,
        many_unheard_restarts,
        huge_incarnation_mutes_nobody,
        wrong_incarnation_is_put_right,
        untrue_answers_are_dropped,
        strangers_are_dropped,
        answers_are_traced,
        hostile_packets,
        hostile_packets_take_no_room
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
    Typed = lists:all(
        fun
            ({_, Type, {Type, _}}) -> true;
            (_) -> false
        end,
        lists:append(Inboxes)
    ),
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
        Healed,
        [{R, T} || R <- lists:seq(1, N), T <- [a, b]]
    ),
    %% the first messages teach every SAP the incarnations of the others
    Warm = lists:foldl(
        fun(R, Net) ->
            starl_platform_net:at(Heal + 1000, {cast, R, {broadcast, a, {a, warm}}}, Net)
        end,
        Listening,
        lists:seq(1, N)
    ),
    {_, Full} = lists:foldl(
        fun(Op, {K, Net}) ->
            {K + 1, starl_platform_net:at(Heal + 2000000, call(Op, N, {last, K}), Net)}
        end,
        {1, Warm},
        Last
    ),
    Net = starl_platform_net:run(Full),
    Outcomes = [A || {_, _, {last, _}, A} <- starl_platform_net:replies(Net)],
    length(Outcomes) =:= length(Last) andalso
        lists:all(fun(A) -> A =:= ok end, Outcomes) andalso
        starl_platform_net:now(Net) =< Heal + 2000000 + bound().

%% op/1 for robots 1..N; a robot that is not in the net is folded into it.
%% (PropEr's range/2 keeps to small numbers, hence the lists.)
op(N) ->
    {
        oneof([0, 500, 5000, 20000, 60000, 150000]),
        frequency([
            {8, send(N)}, {3, {listen, range(1, N), type()}}, {2, {crash, range(1, N)}}
        ])
    }.

send(N) ->
    oneof([
        {send, range(1, N), range(1, N), type()},
        {post, range(1, N), range(1, N), type()},
        {broadcast, range(1, N), type()}
    ]).

type() -> oneof([a, b]).

faults() ->
    {oneof(lists:seq(1, 1000)), oneof([0, 10, 50]), oneof([0, 30]), oneof([1000, 30000, 400000])}.

load(N, Ops, Faults) ->
    Net0 = starl_platform_net:new(#{
        robots => lists:seq(1, N), config => ?CONFIG, fate => fate(Faults)
    }),
    {_, _, Net} = lists:foldl(
        fun({Delay, Op}, {T, K, Net}) ->
            {T + Delay, K + 1, starl_platform_net:at(T + Delay, planned(Op, N, K), Net)}
        end,
        {0, 1, Net0},
        Ops
    ),
    Net.

planned({listen, R, Type}, N, _) ->
    {cast, fold(R, N), {listen, Type, app}};
planned({crash, R}, N, _) ->
    {crash, fold(R, N)};
planned({post, From, To, Type}, N, K) ->
    {cast, fold(From, N), {send, fold(To, N), Type, {Type, K}}};
planned(Send, N, K) ->
    call(Send, N, K).

call({post, From, To, Type}, N, K) ->
    call({send, From, To, Type}, N, K);
call({send, From, To, Type}, N, K) ->
    {call, fold(From, N), {send, fold(To, N), Type, {Type, K}}, K};
call({broadcast, From, Type}, N, K) ->
    {call, fold(From, N), {broadcast, Type, {Type, K}}, K}.

fold(R, N) -> (R - 1) rem N + 1.

%% Stateless draws, so that shrinking one thing away leaves the others alone.
fate({Seed, Loss, Duplicate, MaxUs}) ->
    fun(_Packet, From, To, N) ->
        Draw = fun(What, Range) -> erlang:phash2({Seed, From, To, N, What}, Range) end,
        Copies =
            case Draw(duplicate, 100) < Duplicate of
                true -> [one, two];
                false -> [one]
            end,
        [1000 + Draw(Copy, MaxUs) || Draw(loss, 100) >= Loss, Copy <- Copies]
    end.

bound() -> starl_sap_schedule:bound_us(?CONFIG).

%% -- one by one -----------------------------------------------------------------------------

%% Progress: no loss and no crash, then all is delivered, in any order, and acknowledged.
no_loss_all_acknowledged(_) ->
    Net0 = net(2, fate({1, 0, 50, 40000})),
    Net1 = lists:foldl(
        fun(K, Net) ->
            starl_platform_net:at(K * 20000, {call, 1, {send, 2, a, {a, K}}, K}, Net)
        end,
        starl_platform_net:at(0, {cast, 2, {listen, a, app}}, Net0),
        lists:seq(1, 100)
    ),
    Net = starl_platform_net:run(Net1),
    ?assertEqual([], starl_platform_net:judge(Net, bound())),
    ?assertEqual(
        lists:seq(1, 100), lists:sort([K || {_, a, {a, K}} <- starl_platform_net:inbox(2, Net)])
    ),
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
    ?assertEqual(
        3, length([ack || {_, 2, 1, {starl, 1, ack, 2, 1, 1, 1}} <- starl_platform_net:air(Net)])
    ),
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
    ?assertEqual(
        [0, 50000, 125000, 237500, 406250 - 0],
        [T || {T, 1, 2, _} <- starl_platform_net:air(Net)]
    ).

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
    ?assertMatch(
        [{4000, 1, 1, {error, restarted}}, {_, 1, 2, ok}], starl_platform_net:replies(Net)
    ),
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
        {K * 100000, {cast, 1, {send, 1 + K rem 2 + 1, a, {a, K}}}}
     || K <- lists:seq(1, 3000)
    ],
    Net1 = lists:foldl(
        fun({T, Op}, Net) -> starl_platform_net:at(T, Op, Net) end,
        starl_platform_net:at(0, {cast, 2, {listen, a, app}}, Net0),
        Sends
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
    Net = plan(
        net(2),
        [{K * 20000, {call, 1, {send, 2, a, {a, K}}, K}} || K <- [1, 2, 3]] ++
            [{100000, {cast, 2, {listen, a, app}}}]
    ),
    ?assertEqual([{1, a, {a, K}} || K <- [1, 2, 3]], starl_platform_net:inbox(2, Net)),
    ?assertMatch([{_, _, _, ok}, {_, _, _, ok}, {_, _, _, ok}], starl_platform_net:replies(Net)).

%% Beyond the bounds they are not acknowledged; those of other types are not held up.
unclaimed_beyond_bounds_not_acknowledged(_) ->
    Net = plan(
        net(2),
        [{0, {cast, 2, {listen, b, app}}}] ++
            [{K * 1000, {call, 1, {send, 2, a, {a, K}}, K}} || K <- lists:seq(1, 6)] ++
            [{10000, {call, 1, {send, 2, b, {b, 7}}, 7}}]
    ),
    Answers = maps:from_list([{K, A} || {_, 1, K, A} <- starl_platform_net:replies(Net)]),
    ?assertEqual(
        [ok, ok, ok, ok, {error, lost}, {error, lost}, ok],
        [maps:get(K, Answers) || K <- lists:seq(1, 7)]
    ),
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
    Net = plan(net(2), [
        {0, {packet, 1, garbage}},
        {1, {packet, 1, {starl, 2, data, #{}}}},
        {2, {cast, 1, garbage}}
    ]),
    ?assertMatch([_, _, _], [
        E
     || {_, 1, sap, {unknown_event, _, _} = E} <- starl_platform_net:trace(Net)
    ]).

%% -- windows --------------------------------------------------------------------------------

%% A peer that is dead uses up its own window and nobody else's.
dead_peer_stops_nobody(_) ->
    Fate = fun
        (_, _, 3, _) -> [];
        (_, _, _, _) -> [1000]
    end,
    Net = plan(
        net(3, Fate),
        [{0, {cast, 2, {listen, a, app}}}] ++
            [{K, {call, 1, {send, 3, a, {a, K}}, K}} || K <- lists:seq(1, 20)] ++
            [{1000 * K, {call, 1, {send, 2, a, {a, K}}, K}} || K <- lists:seq(21, 60)]
    ),
    Answers = answers(1, Net),
    ?assertEqual([{error, lost}], lists:usort([maps:get(K, Answers) || K <- lists:seq(1, 16)])),
    ?assertEqual(
        [{error, overload}], lists:usort([maps:get(K, Answers) || K <- lists:seq(17, 20)])
    ),
    ?assertEqual([ok], lists:usort([maps:get(K, Answers) || K <- lists:seq(21, 60)])),
    ?assertEqual(40, length(starl_platform_net:inbox(2, Net))),
    ?assertEqual([], starl_platform_net:judge(Net, bound())).

%% Nor does it stop broadcasts: it is given up, the others get them all, each in one packet.
dead_peer_stops_no_broadcast(_) ->
    Fate = fun
        (_, _, 4, _) -> [];
        (_, _, _, _) -> [100]
    end,
    Net = plan(
        net(4, Fate),
        listening(3) ++
            [{1000 * K, {call, 1, {broadcast, a, {a, K}}, K}} || K <- lists:seq(1, 40)]
    ),
    ?assertEqual([{error, {lost, [4]}}], lists:usort(maps:values(answers(1, Net)))),
    [?assertEqual(40, length(starl_platform_net:inbox(R, Net))) || R <- [2, 3]],
    ?assertEqual(40, length([all || {_, 1, all, _} <- starl_platform_net:air(Net)])),
    %% the first 16 are sent to it again, the others are not
    Again = length([4 || {_, 1, 4, _} <- starl_platform_net:air(Net)]),
    ?assertEqual(16 * 4, Again),
    ?assertEqual([], starl_platform_net:judge(Net, bound())).

%% Messages to oneself need no packet and take nothing from the windows; their names are their own.
own_messages_take_no_window(_) ->
    Own = fun(From, To) ->
        [{K, {call, 1, {send, 1, a, {a, K}}, K}} || K <- lists:seq(From, To)]
    end,
    Dead = net(2, fun(_, _, _, _) -> [] end),
    Net = plan(
        Dead,
        [{0, {cast, 1, {listen, a, app}}}] ++ Own(1, 40) ++
            [{K, {call, 1, {send, 2, a, {a, K}}, K}} || K <- lists:seq(101, 117)] ++ Own(201, 240)
    ),
    Answers = answers(1, Net),
    ?assertEqual([ok], lists:usort([A || {K, A} <- maps:to_list(Answers), K < 100 orelse K > 200])),
    ?assertEqual(
        [{error, lost} || _ <- lists:seq(1, 16)] ++ [{error, overload}],
        [maps:get(K, Answers) || K <- lists:seq(101, 117)]
    ),
    ?assertEqual(80, length(starl_platform_net:inbox(1, Net))),
    Names = [Id || {_, 1, sap, {sent, Id, _, _, _}} <- starl_platform_net:trace(Net)],
    ?assertEqual([{1, 1, N} || N <- lists:seq(1, 96)], lists:sort(Names)),
    ?assertEqual([], starl_platform_net:judge(Net, bound())).

answers(Robot, Net) ->
    maps:from_list([{K, A} || {_, R, K, A} <- starl_platform_net:replies(Net), R =:= Robot]).

%% -- listeners with room --------------------------------------------------------------------

-define(A, {app, a}).

%% What a listener has no room for is not acknowledged; when it has read some it gets the next.
full_inbox_pushes_back(_) ->
    Net = plan(
        net(2),
        [{0, {cast, 2, {listen, ?A, app, 4}}}] ++
            [{K, {call, 1, {send, 2, ?A, {a, K}}, K}} || K <- lists:seq(1, 6)] ++
            [{30000, {fate, fun(_, _, _, _) -> [1000] end}}, {140000, {cast, 2, {read, app, 1}}}]
    ),
    ?assertEqual([{a, K} || K <- [1, 2, 3, 4, 5]], bodies(2, Net)),
    ?assertEqual([ok, ok, ok, ok, ok, {error, lost}], [A || {_, A} <- in_order(answers(1, Net))]),
    Full = [T || {T, 2, sap, {full, 1, ?A}} <- starl_platform_net:trace(Net)],
    ?assertMatch([_, _ | _], Full),
    ?assertEqual([], starl_platform_net:judge(Net, bound())).

%% As many as there is room for are acknowledged, and not one more.
full_inbox_in_the_end_lost(_) ->
    Net = plan(
        net(3),
        [{0, {cast, 2, {listen, ?A, app, 1000}}}] ++
            [
                {K * 50, {call, 1 + 2 * (K rem 2), {send, 2, ?A, {a, K}}, K}}
             || K <- lists:seq(1, 1001)
            ]
    ),
    Answers = [A || {_, _, _, A} <- starl_platform_net:replies(Net)],
    Ok = length([ok || ok <- Answers]),
    ?assertEqual(Ok, length(starl_platform_net:inbox(2, Net))),
    ?assertEqual(1001, length(Answers)),
    ?assert(Ok =< 1000),
    ?assertEqual([], starl_platform_net:judge(Net, bound())).

%% The room is the listener's, whatever types it listens to; what waited unclaimed counts.
room_is_shared_by_types(_) ->
    Types = [?A, {app, b}, {app, c}],
    Net = plan(
        net(2),
        [{K, {call, 1, {send, 2, lists:nth(K, Types), {a, K}}, K}} || K <- [1, 2, 3]] ++
            [{50000, {cast, 2, {listen, T, app, 2}}} || T <- [?A]] ++
            [{50000, {cast, 2, {listen, T, app}}} || T <- tl(Types)] ++
            [
                {60000, {call, 1, {send, 2, ?A, {a, 4}}, 4}},
                {90000, {cast, 2, {read, app, 1}}},
                {100000, {cast, 2, {read, app, 1}}}
            ]
    ),
    ?assertEqual([{a, K} || K <- [1, 2, 3, 4]], bodies(2, Net)),
    ?assertEqual([ok, ok, ok, ok], [A || {_, A} <- in_order(answers(1, Net))]),
    ?assertEqual([], starl_platform_net:judge(Net, bound())).

%% A new SAP knows no rooms until it is told; a listener that starts anew says its room anew.
room_after_restarts(_) ->
    Net = plan(net(2), [
        {0, {cast, 2, {listen, ?A, app, 1}}},
        {1, {call, 1, {send, 2, ?A, {a, 1}}, 1}},
        {20000, {crash, 2}},
        {20001, {cast, 2, {read, app, 1}}},
        {20002, {cast, 2, {listen, ?A, app, 1}}},
        {50000, {call, 1, {send, 2, ?A, {a, 2}}, 2}},
        {60000, {call, 1, {send, 2, ?A, {a, 3}}, 3}},
        {70000, {cast, 2, {listen, ?A, app, 1}}},
        {75000, {call, 1, {send, 2, ?A, {a, 4}}, 4}}
    ]),
    ?assertMatch([{a, 1}, {a, 2}, _], bodies(2, Net)),
    ?assertMatch([ok, ok, _, _], [A || {_, A} <- in_order(answers(1, Net))]),
    ?assertEqual(3, length([ok || {_, ok} <- in_order(answers(1, Net))])).

%% To oneself there is no packet that could come again: it is the overload that it is.
own_message_to_a_full_inbox(_) ->
    Net = plan(
        net(1),
        [{0, {cast, 1, {listen, ?A, app, 2}}}] ++
            [{K, {call, 1, {send, 1, ?A, {a, K}}, K}} || K <- [1, 2, 3]] ++
            [{10, {cast, 1, {read, app, 1}}}, {11, {call, 1, {send, 1, ?A, {a, 4}}, 4}}]
    ),
    ?assertEqual([ok, ok, {error, overload}, ok], [A || {_, A} <- in_order(answers(1, Net))]),
    ?assertEqual([{a, K} || K <- [1, 2, 4]], bodies(1, Net)),
    ?assertEqual([], starl_platform_net:judge(Net, bound())).

bodies(Robot, Net) -> [Body || {_, _, Body} <- starl_platform_net:inbox(Robot, Net)].

in_order(Answers) -> lists:sort(maps:to_list(Answers)).

%% A type has one listener, which may say so again; another one is refused, and whose it is is said.
second_listener_is_refused(_) ->
    Net = plan(net(2), [
        {0, {cast, 2, {listen, a, app}}},
        {1, {cast, 2, {listen, a, app}}},
        {2, {cast, 2, {listen, a, thief}}},
        {3, {call, 1, {send, 2, a, {a, 1}}, 1}}
    ]),
    ?assertEqual([{a, 1}], bodies(2, Net)),
    ?assertMatch(
        [
            #{
                what := two_listeners,
                robots := [2],
                details := #{type := a, listener := thief, held_by := app}
            }
        ],
        starl_platform_net:judge(Net, bound())
    ).

%% -- packets are not trusted ----------------------------------------------------------------

%% After a long silence a source's numbers lie far ahead; it is asked, and heard again.
far_number_is_asked_about(_) ->
    Deaf = net(2, fun
        (_, _, 2, _) -> [];
        (_, _, _, _) -> [1000]
    end),
    Net = plan(
        Deaf,
        [{0, {cast, 2, {listen, a, app}}}] ++
            [{K * 1000000, {call, 1, {send, 2, a, {a, K}}, K}} || K <- lists:seq(1, 40)] ++
            [
                {41000000, {fate, fun(_, _, _, _) -> [1000] end}},
                {42000000, {call, 1, {send, 2, a, {a, 41}}, 41}}
            ]
    ),
    ?assertEqual([{a, 41}], bodies(2, Net)),
    ?assertEqual(ok, maps:get(41, answers(1, Net))),
    ?assertMatch([_ | _], dropped(number, 2, Net)),
    ?assertEqual([], starl_platform_net:judge(Net, bound())).

%% A message lost leaves a gap; long before the window ends the source says what it waits for.
gap_is_asked_about(_) ->
    Fate = fun
        ({starl, 1, data, {_, _, 1, _, _, _, _}}, _, _, _) -> [];
        (_, _, _, _) -> [1000]
    end,
    Net = plan(
        net(2, Fate),
        [{0, {cast, 2, {listen, a, app}}}] ++
            [{K * 100000, {call, 1, {send, 2, a, {a, K}}, K}} || K <- lists:seq(1, 60)]
    ),
    ?assertEqual([{a, K} || K <- lists:seq(2, 60)], bodies(2, Net)),
    ?assertEqual([], dropped(number, 2, Net)),
    ?assertEqual(
        1, length([ask || {_, 2, 1, {starl, 1, ask, _, _, _}} <- starl_platform_net:air(Net)])
    ),
    ?assertEqual([], starl_platform_net:judge(Net, bound())).

%% A robot that has restarted very often unheard is asked before it is believed.
many_unheard_restarts(_) ->
    Deaf = net(2, fun(_, _, _, _) -> [] end),
    Net = plan(
        Deaf,
        [{0, {cast, 2, {listen, a, app}}}] ++
            [{K * 1000, {crash, 1}} || K <- lists:seq(1, 100)] ++
            [
                {200000, {fate, fun(_, _, _, _) -> [1000] end}},
                {210000, {call, 1, {send, 2, a, {a, 1}}, 1}},
                {220000, {cast, 1, {listen, a, app}}},
                {500000, {call, 2, {send, 1, a, {a, 2}}, 2}}
            ]
    ),
    ?assertEqual([{a, 1}], bodies(2, Net)),
    ?assertEqual([{a, 2}], bodies(1, Net)),
    ?assertEqual([], starl_platform_net:judge(Net, bound())).

%% Whoever claims to be a far later incarnation of a robot is not believed.
huge_incarnation_mutes_nobody(_) ->
    Huge = 1 bsl 50,
    Forged = [
        {starl, 1, hello, 1, Huge},
        {starl, 1, data, {1, Huge, 1, 1, #{}, a, x}},
        {starl, 1, data, {1, 1, 9, 1 bsl 57, #{}, a, x}},
        {starl, 1, data, {1, 1, 9, {all, 1 bsl 57}, #{}, a, x}},
        {starl, 1, told, 1, Huge, 1, {Huge, Huge}, {Huge, Huge}}
    ],
    Net = plan(
        net(2),
        [{0, {cast, 2, {listen, a, app}}}] ++
            [{10, {packet, 2, Packet}} || Packet <- Forged] ++
            [
                {50000, {call, 1, {send, 2, a, {a, 1}}, 1}},
                {60000, {call, 1, {broadcast, a, {a, 2}}, 2}}
            ]
    ),
    ?assertEqual([{a, 1}, {a, 2}], bodies(2, Net)),
    %% at once: nothing had to be sent again
    ?assertMatch([{60000, _, 1, ok}, {70000, _, 2, ok}], starl_platform_net:replies(Net)),
    ?assertEqual(2, length(dropped(incarnation, 2, Net))),
    ?assertEqual(2, length(dropped(number, 2, Net))),
    %% the forged one, and those of robot 1 to three questions too many
    ?assertEqual(4, length(dropped(answer, 2, Net))).

%% A forged incarnation that was believed is put right by the robot itself.
wrong_incarnation_is_put_right(_) ->
    Net = plan(net(2), [
        {0, {cast, 2, {listen, a, app}}},
        {0, {cast, 1, {listen, a, app}}},
        {10, {packet, 2, {starl, 1, hello, 1, 3}}},
        {1000, {call, 1, {send, 2, a, {a, 1}}, 1}},
        {300000, {packet, 2, {starl, 1, hello, 1, 5}}},
        {400000, {call, 2, {send, 1, a, {a, 2}}, 2}},
        {500000, {call, 2, {send, 1, a, {a, 3}}, 3}}
    ]),
    ?assertEqual([{a, 1}], bodies(2, Net)),
    ?assertEqual([{a, 3}], bodies(1, Net)),
    ?assertEqual(#{2 => {error, restarted}, 3 => ok}, answers(2, Net)).

%% What a robot says of a message must fit the incarnation that the message was meant for.
untrue_answers_are_dropped(_) ->
    Net = plan(net(2), [
        {0, {cast, 2, {listen, a, app}}},
        {1, {call, 1, {send, 2, a, {a, 1}}, 1}},
        {10, {packet, 1, {starl, 1, ack, 2, 2, 1, 1}}},
        {11, {packet, 1, {starl, 1, refusal, 2, 1, 1, 1}}}
    ]),
    ?assertMatch([{10001, 1, 1, ok}], starl_platform_net:replies(Net)),
    ?assertEqual(1, length(dropped(acknowledged, 1, Net))),
    ?assertEqual(1, length(dropped(restarted, 1, Net))),
    ?assertEqual([], starl_platform_net:judge(Net, bound())).

%% Who is not in the team is not heard, nor is a robot of one's own name.
strangers_are_dropped(_) ->
    Packets =
        [{starl, 1, data, {R, 1, 1, 1, #{}, a, x}} || R <- [2, 3, 1 bsl 40]] ++
            [{starl, 1, shout, 9, a, x}, {starl, 1, ask, 9, 1, {0, 0}}, {starl, 1, hello, 9, 2}],
    Net = plan(net(2), [{0, {cast, 2, {listen, a, app}}}] ++ [{1, {packet, 2, P}} || P <- Packets]),
    ?assertEqual([], bodies(2, Net)),
    ?assertEqual([], starl_platform_net:air(Net)),
    ?assertEqual(
        6, length([D || {_, 2, sap, {dropped, stranger, _} = D} <- starl_platform_net:trace(Net)])
    ).

dropped(Why, Robot, Net) ->
    [
        D
     || {_, R, sap, {dropped, W, _} = D} <- starl_platform_net:trace(Net), R =:= Robot, W =:= Why
    ].

%% What a caller is told is traced, with whose message it is.
answers_are_traced(_) ->
    Fate = fun
        (_, _, 3, _) -> [];
        (_, _, _, _) -> [1000]
    end,
    Net = plan(
        net(3, Fate),
        listening(3) ++
            [
                {1, {call, 1, {send, 2, a, {a, 1}}, 1}},
                {2, {call, 1, {broadcast, a, {a, 2}}, 2}},
                {3, {call, 1, {send, 1, a, {a, 3}}, 3}},
                {4, {cast, 1, {send, 2, a, {a, 4}}}}
            ]
    ),
    Traced = [{Id, Answer} || {_, 1, sap, {answered, Id, Answer}} <- starl_platform_net:trace(Net)],
    ?assertEqual(
        [{{1, 1, 1}, ok}, {{1, 1, 2}, {error, {lost, [3]}}}, {{1, 1, 3}, ok}],
        lists:sort(Traced)
    ),
    ?assertEqual([], starl_platform_net:judge(Net, bound())).

%% Any packet at all, true ones with a field changed among them: nothing crashes, each leaves a
%% trace or is answered, and afterwards honest messages get through both ways.
hostile_packets(_) ->
    Prop = ?FORALL(
        Packets,
        resize(25, list({range(1, 3), hostile()})),
        starl_platform_ct:safely(fun() -> survives(Packets) end)
    ),
    starl_platform_ct:property(Prop, 400).

survives(Packets) ->
    Hostile = [{1000 * K, {packet, R, P}} || {K, {R, P}} <- numbered(Packets)],
    Begin = 1000 * length(Packets) + 2000000,
    %% a forged message takes the place of a true one of the same number
    Honest = [
        {Begin + 50000 * K, {call, From, {send, To, a, {honest, K}}, K}}
     || {K, {From, To}} <- numbered([
            {F, T}
         || _ <- lists:seq(1, 40), F <- [1, 2, 3], T <- [1, 2, 3]
        ])
    ],
    Net = plan(net(3, fun(_, _, _, _) -> [1000] end), listening(3) ++ Hostile ++ Honest),
    Last = [Op || {T, Op} <- Honest, T > Begin + 50000 * 351],
    Got = fun(R) -> [B || {_, a, {honest, _} = B} <- starl_platform_net:inbox(R, Net)] end,
    lists:all(
        fun({call, From, {send, To, a, Body}, K}) ->
            {K, ok} =:= {K, maps:get(K, answers(From, Net))} andalso lists:member(Body, Got(To))
        end,
        Last
    ).

numbered(List) -> lists:zip(lists:seq(1, length(List)), List).

hostile() ->
    frequency([
        {1, resize(8, any())},
        {6, ?LET(True, true_packet(), mutated(True))},
        {2, true_packet()}
    ]).

true_packet() ->
    ?LET(
        {R, I, S, N},
        {range(1, 3), range(1, 3), range(1, 20), range(1, 20)},
        oneof([
            {starl, 1, data, {R, I, S, oneof([N, {all, N}]), oneof([#{}, #{R => I}]), a, forged}},
            {starl, 1, ack, R, I, I, S},
            {starl, 1, refusal, R, I, I, S},
            {starl, 1, hello, R, I},
            {starl, 1, shout, R, a, forged},
            {starl, 1, ask, R, N, {0, N}},
            {starl, 1, told, R, I, N, {N, N}, {0, I}}
        ])
    ).

%% One of its elements, at any depth, is something else.
mutated(Tuple) ->
    ?LET(
        {Place, Else},
        {range(3, tuple_size(Tuple)), odd()},
        case element(Place, Tuple) of
            Inner when is_tuple(Inner), tuple_size(Inner) > 3 ->
                ?LET(
                    P,
                    range(1, tuple_size(Inner)),
                    setelement(Place, Tuple, setelement(P, Inner, Else))
                );
            _ ->
                setelement(Place, Tuple, Else)
        end
    ).

odd() ->
    oneof([
        0,
        -1,
        1 bsl 57,
        1 bsl 60,
        1 bsl 200,
        1.5,
        17,
        18,
        {all, 1 bsl 60},
        {all, x},
        [],
        [1 | 2],
        #{},
        [1, 2],
        {a, b, c},
        atom,
        {app, a},
        {app, 1},
        #{1 => x},
        #{2 => 1 bsl 60},
        fun erlang:node/0,
        self()
    ]).

%% However many there are, they take no more room than a few.
hostile_packets_take_no_room(_) ->
    Sizes = [hostile_size(N) || N <- [300, 3000]],
    [Few, Many] = Sizes,
    ?assert(Many < Few + 500, Sizes).

hostile_size(Count) ->
    Draw = fun(K, What, List) -> lists:nth(1 + erlang:phash2({K, What}, length(List)), List) end,
    Odd = [1, 2, 3, 17, 1 bsl 40, 1 bsl 57, 1 bsl 60, -3, x, [1 | 2]],
    Packets = [
        Draw(K, kind, [
            {starl, 1, data, {
                Draw(K, r, [1, 3, 7, x]), 1, Draw(K, s, Odd), Draw(K, n, Odd), #{}, a, K
            }},
            {starl, 1, data,
                {1, 1, K, {all, Draw(K, n, Odd)}, Draw(K, f, [#{}, [], #{2 => x}]), b, K}},
            {starl, 1, hello, Draw(K, r, [1, 3, 7]), Draw(K, i, Odd)},
            {starl, 1, told, 1, Draw(K, i, Odd), K, {Draw(K, n, Odd), 1}, {0, 0}},
            {starl, 1, ack, 1, Draw(K, i, Odd), 1, K},
            {starl, 1, ask, 1, K, {0, Draw(K, l, Odd)}}
        ])
     || K <- lists:seq(1, Count)
    ],
    Net = plan(
        net(3),
        [{0, {cast, 2, {listen, a, app}}}] ++
            [{K, {packet, 2, P}} || {K, P} <- numbered(Packets)]
    ),
    starl_platform_net:size(2, Net).

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
