%% The contract of the SAP, clause by clause: traces that keep it and traces that break it.
-module(starl_sap_monitor_tests).
-include_lib("eunit/include/eunit.hrl").

-define(BOUND, 1000).
-define(LATE, 5000).

%% What a trace of {Time, Robot, Event} is found guilty of. `{died}' is an event of the robot.
judge(Events) -> judge(Events, 0).

judge(Events, End) ->
    {What, _Results} = run(Events, End),
    What.

run(Events, End) ->
    Config = #{bound_us => ?BOUND, late_us => ?LATE},
    M0 = starl_monitor:new([{starl_sap_monitor, Config}]),
    {Met, M} = lists:foldl(fun step/2, {[], M0}, [trace(Event) || Event <- Events]),
    {Late, #{starl_sap_monitor := Results}} = starl_monitor:finish(End, M),
    {[What || #{contract := sap, what := What} <- Met ++ Late], Results}.

step(Event, {Found, M0}) ->
    case starl_monitor:step(Event, M0) of
        {ok, M} -> {Found, M};
        {violation, Violation, M} -> {Found ++ [Violation], M}
    end.

trace({T, Robot, died}) -> {T, Robot, robot, {died, killed}};
trace({T, Robot, Event}) -> {T, Robot, sap, Event}.

id(Seq) -> id(1, Seq).
id(Incarnation, Seq) -> {1, Incarnation, Seq}.

sent(T, Id) -> sent(T, Id, [2]).
sent(T, Id, Dests) -> {T, 1, {sent, Id, Dests, greeting, 99}}.
got(T, Robot, Id) -> {T, Robot, {delivered, Id, greeting, 99}}.
ack(T, Id) -> ack(T, Id, 2).
ack(T, Id, Dest) -> {T, 1, {outcome, Id, Dest, acknowledged}}.
lost(T, Id) -> {T, 1, {outcome, Id, 2, lost}}.
started(T, Incarnation) -> {T, 1, {started, Incarnation}}.

good_messages_test() ->
    ?assertEqual(
        [],
        judge(
            [
                started(0, 1),
                sent(1, id(1)),
                got(5, 2, id(1)),
                ack(9, id(1)),
                sent(10, id(2), [2, 3]),
                got(15, 3, id(2)),
                ack(16, id(2), 3),
                got(17, 2, id(2)),
                ack(20, id(2)),
                sent(30, id(3)),
                {31, 1, {outcome, id(3), 2, {lost, refused}}},
                sent(40, id(4)),
                {41, 1, {outcome, id(4), 2, restarted}},
                {42, 1, {overload, greeting}}
            ],
            10_000
        )
    ).

results_test() ->
    {[], Results} = run(
        [
            sent(1, id(1), [2, 3]),
            got(2, 2, id(1)),
            ack(3, id(1)),
            {4, 1, {outcome, id(1), 3, lost}}
        ],
        10
    ),
    ?assertEqual(
        #{sent => 2, delivered => 1, acknowledged => 1, lost => 1, outstanding => 1},
        Results
    ).

%% A message to nobody is sent, and nothing is to come of it; its name is used.
message_to_nobody_test() ->
    Nobody = [sent(1, id(1), [])],
    {[], Results} = run(Nobody ++ [started(2, 2), {3, 1, died}], 9000),
    ?assertEqual(
        #{sent => 0, delivered => 0, acknowledged => 0, lost => 0, outstanding => 0}, Results
    ),
    ?assertEqual([message_id_used_twice], judge(Nobody ++ Nobody)).

%% The end is a violation where something is overdue, and only there.
verdict_test() ->
    Verdict = fun(End) ->
        State = starl_sap_monitor:init(#{bound_us => ?BOUND}),
        {ok, Sent} = starl_sap_monitor:step(trace(sent(1, id(1))), State),
        element(1, starl_sap_monitor:finish(End, Sent))
    end,
    ?assertEqual(ok, Verdict(1 + ?BOUND)),
    ?assertMatch({violation, [#{what := outcome_overdue}]}, Verdict(2 + ?BOUND)).

%%% A lost report may still have been delivered, before or after it

lost_but_delivered_before_test() ->
    ?assertEqual([], judge([sent(1, id(1)), got(2, 2, id(1)), lost(3, id(1))], 9000)).

lost_but_delivered_later_test() ->
    ?assertEqual([], judge([sent(1, id(1)), lost(3, id(1)), got(4, 2, id(1))], 9000)).

lost_but_delivered_when_forgotten_test() ->
    Trace = [sent(1, id(1)), lost(3, id(1)), sent(9000, id(2)), got(9001, 2, id(1))],
    ?assertEqual([], judge(Trace)),
    ?assertEqual([duplicate_delivery], judge(Trace ++ [got(9002, 2, id(1))])),
    ?assertEqual([duplicate_delivery], judge(Trace ++ [got(9002, 3, id(1))])).

%% Of several that are forgotten each may come once.
several_are_forgotten_test() ->
    Lost = lists:append([[sent(N, id(N)), lost(N, id(N))] || N <- [1, 2, 3]]),
    Trace = Lost ++ [started(9000, 1), got(9001, 2, id(2))],
    ?assertEqual([], judge(Trace ++ [got(9002, 2, id(1)), got(9003, 2, id(3))])),
    ?assertEqual([duplicate_delivery], judge(Trace ++ [got(9002, 2, id(2))])),
    Apart = lists:append([[sent(N, id(N)), lost(N, id(N))] || N <- [1, 3, 5]]),
    [
        ?assertEqual([], judge(Apart ++ [started(9000, 1) | [got(9001, 2, id(N)) || N <- Order]]))
     || Order <- [[1, 3, 5], [5, 3, 1], [3, 1, 5], [3, 5, 1]]
    ].

%% Also where that is shorter than the time in which an outcome is due.
forgotten_before_the_bound_test() ->
    Config = #{bound_us => 1000, late_us => 10},
    Judge = fun(T) ->
        M0 = starl_monitor:new([{starl_sap_monitor, Config}]),
        Trace = [sent(1, id(1)), lost(3, id(1)), {T, 2, {delivered, id(1), greeting, 98}}],
        {Met, _} = lists:foldl(fun step/2, {[], M0}, [trace(Event) || Event <- Trace]),
        [What || #{what := What} <- Met]
    end,
    ?assertEqual([corrupted], Judge(13)),
    ?assertEqual([], Judge(14)).

lost_content_is_remembered_for_a_while_test() ->
    ?assertEqual(
        [corrupted],
        judge([
            sent(1, id(1)), lost(3, id(1)), {3 + ?LATE, 2, {delivered, id(1), greeting, 98}}
        ])
    ).

%%% At most once per receiver

delivered_twice_test() ->
    ?assertEqual([duplicate_delivery], judge([sent(1, id(1)), got(2, 2, id(1)), got(3, 2, id(1))])).

delivered_again_after_acknowledgement_test() ->
    ?assertEqual(
        [duplicate_delivery],
        judge([sent(1, id(1)), got(2, 2, id(1)), ack(3, id(1)), got(4, 2, id(1))])
    ).

delivered_again_by_a_restarted_receiver_test() ->
    ?assertEqual(
        [duplicate_delivery],
        judge([
            sent(1, id(1)), got(2, 2, id(1)), {3, 2, {started, 2}}, got(4, 2, id(1))
        ])
    ).

delivered_again_after_lost_test() ->
    ?assertEqual(
        [duplicate_delivery],
        judge([sent(1, id(1)), lost(2, id(1)), got(3, 2, id(1)), got(4, 2, id(1))])
    ).

same_number_of_two_incarnations_is_two_messages_test() ->
    ?assertEqual(
        [],
        judge([
            started(0, 1),
            sent(1, id(1, 1)),
            got(2, 2, id(1, 1)),
            ack(3, id(1, 1)),
            started(4, 2),
            sent(5, id(2, 1)),
            got(6, 2, id(2, 1)),
            ack(7, id(2, 1))
        ])
    ).

%% What an earlier incarnation has sent is known beside what the later one sends.
earlier_incarnation_test() ->
    Lives = [
        started(0, 1),
        sent(1, id(1, 1)),
        sent(2, id(1, 2)),
        started(3, 2),
        sent(4, id(2, 1)),
        got(5, 2, id(1, 1)),
        got(6, 2, id(2, 1)),
        ack(7, id(2, 1))
    ],
    {[], Results} = run(Lives ++ [got(8, 2, id(1, 2))], 9000),
    ?assertMatch(#{sent := 3, delivered := 3, outstanding := 0}, Results),
    ?assertEqual([], judge(Lives, 9000)),
    ?assertEqual([duplicate_delivery], judge(Lives ++ [got(8, 2, id(1, 1))])),
    ?assertEqual([delivered_but_not_sent], judge(Lives ++ [got(8, 2, id(1, 3))])),
    ?assertEqual([message_id_used_twice], judge(Lives ++ [sent(8, id(1, 2))])),
    ?assertEqual([message_id_used_twice], judge(Lives ++ [sent(8, id(1, 4)), sent(9, id(1, 1))])).

%% What was lost, forgotten and delivered at last leaves no more behind than what was delivered.
nothing_is_left_of_what_is_forgotten_test() ->
    Config = #{bound_us => ?BOUND, late_us => ?LATE},
    Timeless = fun(Events) ->
        Step = fun(Event, S0) ->
            {ok, S} = starl_sap_monitor:step(trace(Event), S0),
            S
        end,
        starl_sap_monitor:timeless(
            lists:foldl(Step, starl_sap_monitor:init(Config), Events)
        )
    end,
    Lost = [sent(1, id(1)), lost(2, id(1))],
    Forgotten = Lost ++ [started(9000, 1)],
    ?assertNotEqual(Timeless(Lost ++ [got(3, 2, id(1)), started(9000, 1)]), Timeless(Forgotten)),
    ?assertEqual(
        Timeless(Lost ++ [got(3, 2, id(1)), started(9000, 1)]),
        Timeless(Forgotten ++ [got(9001, 2, id(1))])
    ).

numbers_that_restart_with_the_robot_test() ->
    ?assertEqual(
        [message_id_used_twice],
        judge([
            started(0, 1), sent(1, id(1)), got(2, 2, id(1)), ack(3, id(1)), sent(5, id(1))
        ])
    ).

%%% Only if sent, to an addressee, unchanged

delivered_but_not_sent_test() ->
    ?assertEqual([delivered_but_not_sent], judge([sent(1, id(1)), got(2, 2, id(7))])).

delivered_before_sent_test() ->
    ?assertEqual([delivered_but_not_sent], judge([got(1, 2, id(1)), sent(2, id(1))], 10)).

delivered_to_stranger_test() ->
    ?assertEqual([delivered_to_stranger], judge([sent(1, id(1)), got(2, 3, id(1))])).

corrupted_test() ->
    ?assertEqual(
        [corrupted],
        judge([sent(1, id(1)), {2, 2, {delivered, id(1), greeting, 98}}])
    ).

wrong_type_test() ->
    ?assertEqual(
        [wrong_type],
        judge([sent(1, id(1)), {2, 2, {delivered, id(1), other, 99}}])
    ).

sent_under_a_foreign_name_test() ->
    ?assertEqual([foreign_source], judge([{1, 3, {sent, id(1), [2], greeting, 99}}])).

%%% Outcomes

acknowledged_but_not_delivered_test() ->
    ?assertEqual([acknowledged_but_not_delivered], judge([sent(1, id(1)), ack(2, id(1))])),
    ?assertEqual(
        [acknowledged_but_not_delivered],
        judge([sent(1, id(1), [2, 3]), got(2, 3, id(1)), ack(3, id(1), 2)])
    ).

outcome_twice_test() ->
    Delivered = [sent(1, id(1)), got(2, 2, id(1))],
    ?assertEqual([outcome_reported_twice], judge(Delivered ++ [ack(3, id(1)), ack(4, id(1))])),
    ?assertEqual([outcome_reported_twice], judge(Delivered ++ [ack(3, id(1)), lost(4, id(1))])),
    ?assertEqual(
        [outcome_reported_twice],
        judge([sent(1, id(1)), lost(3, id(1)), lost(4, id(1))])
    ),
    ?assertEqual(
        [outcome_reported_twice],
        judge([sent(1, id(1)), lost(3, id(1)), got(4, 2, id(1)), ack(5, id(1))])
    ).

outcome_of_nothing_test() ->
    ?assertEqual([outcome_but_not_sent], judge([lost(1, id(1))])),
    ?assertEqual([outcome_for_stranger], judge([sent(1, id(1)), ack(2, id(1), 3)])).

%% To whom nothing was sent nothing can be acknowledged, nor lost; and a robot tells of its own
%% messages alone.
outcome_of_strangers_test() ->
    Sent = [sent(1, id(1), [2, 4])],
    Lost = {2, 1, {outcome, id(1), 3, lost}},
    ?assertEqual([outcome_for_stranger], judge(Sent ++ [Lost])),
    ?assertEqual([outcome_for_stranger], judge(Sent ++ [got(2, 2, id(1)), ack(3, id(1), 3)])),
    ?assertEqual([foreign_source], judge(Sent ++ [{2, 2, {outcome, id(1), 2, lost}}])),
    ?assertEqual([foreign_source], judge([{1, 2, {sent, id(1), [1], greeting, 99}}])),
    %% nothing has become of the message by that
    {[outcome_for_stranger, outcome_overdue], Results} = run(Sent ++ [Lost], 9000),
    ?assertMatch(#{sent := 2, lost := 0, acknowledged := 0, outstanding := 1}, Results).

outcome_at_the_bound_test() ->
    ?assertEqual([], judge([sent(1, id(1)), lost(1 + ?BOUND, id(1))], 9000)),
    ?assertEqual([], judge([sent(1, id(1))], 1 + ?BOUND)).

outcome_after_the_bound_test() ->
    ?assertEqual([outcome_overdue], judge([sent(1, id(1))], 2 + ?BOUND)),
    ?assertEqual([outcome_overdue], judge([sent(1, id(1)), lost(2 + ?BOUND, id(1))], 9000)).

outcome_of_one_destination_missing_test() ->
    ?assertEqual(
        [outcome_overdue],
        judge([sent(1, id(1), [2, 3]), got(2, 2, id(1)), ack(3, id(1))], 9000)
    ).

delivered_is_no_outcome_test() ->
    ?assertEqual([outcome_overdue], judge([sent(1, id(1)), got(2, 2, id(1))], 9000)).

restart_drops_open_outcomes_test() ->
    ?assertEqual(
        [],
        judge(
            [
                started(0, 1),
                sent(1, id(1)),
                sent(1, id(2)),
                got(2, 2, id(1)),
                started(3, 2),
                got(4, 2, id(2)),
                lost(5, id(1))
            ],
            90_000
        )
    ).

restart_keeps_deliveries_at_most_once_test() ->
    ?assertEqual(
        [duplicate_delivery],
        judge([
            started(0, 1), sent(1, id(1)), got(2, 2, id(1)), started(3, 2), got(4, 2, id(1))
        ])
    ).

restart_of_another_robot_drops_nothing_test() ->
    ?assertEqual([outcome_overdue], judge([sent(1, id(1)), {2, 2, {started, 2}}], 9000)).

death_drops_open_outcomes_test() ->
    ?assertEqual([], judge([sent(1, id(1)), {2, 1, died}, got(3, 2, id(1))], 9000)),
    ?assertEqual([outcome_overdue], judge([sent(1, id(1)), {2, 2, died}], 9000)).

%%% Answers: a caller is told what has become of its message, when all of it is known

called(T, Id, How) -> {T, 1, {called, Id, How}}.
told(T, Id, Answer) -> {T, 1, {answered, Id, Answer}}.

true_answers_test() ->
    ?assertEqual(
        [],
        judge(
            [
                sent(1, id(1)),
                called(1, id(1), one),
                got(2, 2, id(1)),
                ack(3, id(1)),
                told(3, id(1), ok)
            ],
            9000
        )
    ),
    ?assertEqual(
        [],
        judge(
            [
                sent(1, id(1)),
                called(1, id(1), one),
                lost(3, id(1)),
                told(3, id(1), {error, lost}),
                got(4, 2, id(1))
            ],
            9000
        )
    ),
    ?assertEqual([], judge(refused() ++ [told(5, id(1), {error, {lost, [3, 4]}})], 9000)),
    ?assertEqual([], judge([{1, 1, {overload, a}}, told(1, none, {error, overload})], 9000)).

%% Robot 2 has it, 3 refuses it, at 4 it is lost.
refused() ->
    [
        sent(1, id(1), [2, 3, 4]),
        called(1, id(1), all),
        got(2, 2, id(1)),
        ack(3, id(1)),
        {4, 1, {outcome, id(1), 3, restarted}},
        {5, 1, {outcome, id(1), 4, lost}}
    ].

untrue_answers_test_() ->
    Said = fun(Answer) -> judge(refused() ++ [told(5, id(1), Answer)], 9000) end,
    [
        ?_assertEqual([answer_untrue], Said(Answer))
     || Answer <- [
            ok,
            {error, {lost, [4]}},
            {error, {lost, [3]}},
            {error, {lost, [2, 3, 4]}},
            {error, lost},
            {error, restarted},
            {error, overload}
        ]
    ].

one_answer_for_one_test() ->
    Refused = [sent(1, id(1)), called(1, id(1), one), {3, 1, {outcome, id(1), 2, restarted}}],
    ?assertEqual([], judge(Refused ++ [told(3, id(1), {error, restarted})], 9000)),
    ?assertEqual([answer_untrue], judge(Refused ++ [told(3, id(1), {error, lost})], 9000)),
    ?assertEqual([answer_untrue], judge(Refused ++ [told(3, id(1), ok)], 9000)).

answer_before_all_is_known_test() ->
    ?assertEqual(
        [answered_too_early, outcome_overdue],
        judge(
            [
                sent(1, id(1), [2, 3]),
                called(1, id(1), all),
                got(2, 2, id(1)),
                ack(3, id(1)),
                told(3, id(1), ok)
            ],
            9000
        )
    ).

answer_missing_test() ->
    Done = [sent(1, id(1)), called(1, id(1), one), got(2, 2, id(1)), ack(3, id(1))],
    ?assertEqual([answer_overdue], judge(Done, 9000)),
    ?assertEqual([], judge(Done, 900)),
    ?assertEqual([], judge(Done ++ [started(4, 2)], 9000)).

answer_to_nobody_test() ->
    Posted = [started(0, 1), sent(1, id(1)), got(2, 2, id(1)), ack(3, id(1))],
    ?assertEqual([answered_nobody], judge(Posted ++ [told(3, id(1), ok)], 9000)),
    ?assertEqual([answered_nobody], judge([sent(1, id(1)), told(1, id(1), ok)], 2)),
    Twice = [
        sent(1, id(1)),
        called(1, id(1), one),
        got(2, 2, id(1)),
        ack(3, id(1)),
        told(3, id(1), ok),
        told(4, id(1), ok)
    ],
    ?assertEqual([answered_nobody], judge(Twice, 9000)).

%% `ok' without a message is for a robot that is alone.
answer_without_a_message_test() ->
    Alone = starl_sap_monitor:init(#{bound_us => ?BOUND, robots => [1]}),
    Team = starl_sap_monitor:init(#{bound_us => ?BOUND, robots => [1, 2]}),
    Event = trace(told(1, none, ok)),
    ?assertMatch({ok, _}, starl_sap_monitor:step(Event, Alone)),
    ?assertMatch({violation, #{what := answer_untrue}, _}, starl_sap_monitor:step(Event, Team)).

%%% The application reads what was delivered to it

app_got(T, Id, Hash) -> {T, 2, {delivered, Id, {app, a}, Hash}}.
app_sent(T, Id, Hash) -> {T, 1, {sent, Id, [2], {app, a}, Hash}}.
read(T, Hash) -> {T, 2, app, {read, 1, {app, a}, Hash}}.

read_in_order_test() ->
    ?assertEqual([], judge_reads([1, 2, 3], [1, 2, 3])),
    ?assertEqual([], judge_reads([1, 2, 3], [1])),
    ?assertEqual([acknowledged_but_not_readable], judge_reads([1, 2, 3], [2])),
    ?assertEqual([acknowledged_but_not_readable], judge_reads([1, 2, 3], [1, 3])),
    ?assertEqual([read_but_not_delivered], judge_reads([1], [1, 1])),
    ?assertEqual([read_but_not_delivered], judge_reads([], [1])).

%% A crash of SAP or of the application may cost what was not read, nothing that comes later.
read_after_a_crash_test() ->
    [
        begin
            ?assertEqual([], judge_reads([1, 2, Crash, 3], [3])),
            ?assertEqual([], judge_reads([1, 2, Crash, 3], [2, 3])),
            ?assertEqual([acknowledged_but_not_readable], judge_reads([1, Crash, 2, 3], [3]))
        end
     || Crash <- [sap, app]
    ].

more_than_there_is_room_for_test() ->
    ?assertEqual([], judge_reads(lists:seq(1, 5), [])),
    ?assertEqual([more_than_it_can_keep], judge_reads(lists:seq(1, 6), [])).

%% What is read makes room.
read_makes_room_test() ->
    Got = fun(N) -> [trace(E) || E <- [app_sent(N, id(N), N), app_got(N, id(N), N)]] end,
    Five = lists:append([Got(N) || N <- lists:seq(1, 5)]),
    Read = Five ++ [read(5, 1), read(5, 2)],
    Judge = fun(Events) ->
        M0 = starl_monitor:new([{starl_sap_monitor, #{bound_us => 1000000, room => 5}}]),
        {Met, _} = lists:foldl(fun step/2, {[], M0}, Events),
        [{What, At} || #{what := What, at_us := At} <- Met]
    end,
    ?assertEqual([], Judge(Read ++ Got(6) ++ Got(7))),
    ?assertEqual([{more_than_it_can_keep, 8}], Judge(Read ++ Got(6) ++ Got(7) ++ Got(8))).

judge_reads(Delivered, Read) ->
    Reads = [read(10000, Hash) || Hash <- Read],
    M0 = starl_monitor:new([{starl_sap_monitor, #{bound_us => 1000000, room => 5}}]),
    Feed =
        lists:append([
            delivery(N, What)
         || {N, What} <- lists:zip(
                lists:seq(1, length(Delivered)), Delivered
            )
        ]) ++ Reads,
    {Met, _} = lists:foldl(fun step/2, {[], M0}, Feed),
    [What || #{what := What} <- Met].

delivery(N, sap) ->
    [trace({10 * N, 2, {started, 2}})];
delivery(N, app) ->
    [{10 * N, 2, app, crashed}];
delivery(N, Hash) ->
    [trace(E) || E <- [app_sent(10 * N, id(N), Hash), app_got(10 * N, id(N), Hash)]].

%%% A type has one listener

second_listener_test() ->
    ?assertEqual([two_listeners], judge([{1, 2, {listener_refused, ballot, app, election}}])).

%%% What is told of a violation: when, between whom, and about what

%% The violations of a trace, in full but for the contract.
told_of(Events) -> told_of(Events, 0).

told_of(Events, End) ->
    M0 = starl_monitor:new([{starl_sap_monitor, #{bound_us => ?BOUND, late_us => ?LATE}}]),
    {Met, M} = lists:foldl(fun step/2, {[], M0}, [trace(Event) || Event <- Events]),
    {Late, _} = starl_monitor:finish(End, M),
    [
        {What, At, Robots, Details}
     || #{contract := sap, what := What, at_us := At, robots := Robots, details := Details} <-
            Met ++ Late
    ].

told_of_messages_test() ->
    Of1 = #{message => id(1)},
    Foreign = [{foreign_source, 7, [3, 1], Of1}],
    ?assertEqual(Foreign, told_of([{7, 3, {sent, id(1), [2], greeting, 99}}])),
    ?assertEqual(Foreign, told_of([sent(1, id(1)), {7, 3, {outcome, id(1), 2, lost}}])),
    ?assertEqual([{message_id_used_twice, 7, [1], Of1}], told_of([sent(1, id(1)), sent(7, id(1))])),
    Got = fun(Robot, Type, Hash) ->
        told_of([sent(1, id(1)), {7, Robot, {delivered, id(1), Type, Hash}}])
    end,
    ?assertEqual([{corrupted, 7, [2], Of1}], Got(2, greeting, 98)),
    Types = #{message => id(1), sent => greeting, delivered => other},
    ?assertEqual([{wrong_type, 7, [2], Types}], Got(2, other, 99)),
    ?assertEqual([{delivered_to_stranger, 7, [3], Of1}], Got(3, greeting, 99)),
    Done = [sent(1, id(1)), got(2, 2, id(1))],
    ?assertEqual([{duplicate_delivery, 7, [2], Of1}], told_of(Done ++ [got(7, 2, id(1))])),
    Late = told_of(Done ++ [ack(3, id(1)), got(7, 2, id(1))]),
    ?assertEqual([{duplicate_delivery, 7, [2], #{message => id(1), closed => true}}], Late),
    Never = [{delivered_but_not_sent, 7, [2], #{message => id(1), closed => false}}],
    ?assertEqual(Never, told_of([got(7, 2, id(1))])).

told_of_outcomes_test() ->
    Of1 = #{message => id(1)},
    Done = [sent(1, id(1)), got(2, 2, id(1))],
    ?assertEqual(
        [{acknowledged_but_not_delivered, 7, [1, 2], Of1}], told_of([sent(1, id(1)), ack(7, id(1))])
    ),
    ?assertEqual([{outcome_for_stranger, 7, [1, 3], Of1}], told_of(Done ++ [ack(7, id(1), 3)])),
    Twice = [{outcome_reported_twice, 7, [1, 2], Of1}],
    ?assertEqual(Twice, told_of(Done ++ [ack(3, id(1)), ack(7, id(1))])),
    ?assertEqual(Twice, told_of([sent(1, id(1)), lost(3, id(1)), lost(7, id(1))])),
    ?assertEqual([{outcome_but_not_sent, 7, [1, 2], Of1}], told_of([lost(7, id(1))])),
    ?assertEqual(
        [{outcome_overdue, 1 + ?BOUND, [1, 2, 3], Of1}], told_of([sent(1, id(1), [2, 3])], 9000)
    ),
    %% it is told of those whose outcome is open, at the next event
    One = [sent(1, id(1), [2, 3]), got(2, 2, id(1)), ack(3, id(1)), started(9000, 1)],
    ?assertEqual([{outcome_overdue, 1 + ?BOUND, [1, 3], Of1}], told_of(One)).

told_of_answers_test() ->
    Answer = #{message => id(1), answer => ok},
    Lost = [sent(1, id(1)), called(1, id(1), one), lost(3, id(1))],
    Untrue = [{answer_untrue, 7, [1], Answer#{true => {error, lost}}}],
    ?assertEqual(Untrue, told_of(Lost ++ [told(7, id(1), ok)])),
    Early = [sent(1, id(1)), called(1, id(1), one), told(7, id(1), ok)],
    ?assertEqual([{answered_too_early, 7, [1], Answer}], told_of(Early)),
    Nobody = [sent(1, id(1)), told(7, id(1), ok)],
    ?assertEqual([{answered_nobody, 7, [1], Answer}], told_of(Nobody)),
    Of1 = #{message => id(1)},
    ?assertEqual([{answered_nobody, 7, [1], Of1}], told_of([told(7, id(1), ok)])),
    ?assertEqual([{called_but_not_sent, 7, [1], Of1}], told_of([called(7, id(1), one)])),
    ?assertEqual(
        [{called_but_not_sent, 7, [2], Of1}],
        told_of([sent(1, id(1)), {7, 2, {called, id(1), one}}])
    ),
    ?assertEqual([{answer_untrue, 7, [1], #{answer => lost}}], told_of([told(7, none, lost)])),
    ?assertEqual([{answer_overdue, 1 + ?BOUND, [1], Of1}], told_of(Lost, 9000)).

told_of_applications_test() ->
    Of = #{type => {app, a}, source => 1},
    ?assertEqual([{read_but_not_delivered, 7, [2], Of}], told_of_read([read(7, 5)])),
    Two = [trace(E) || N <- [1, 2], E <- [app_sent(N, id(N), N), app_got(N, id(N), N)]],
    ?assertEqual(
        [{acknowledged_but_not_readable, 7, [2], Of}], told_of_read(Two ++ [read(7, 2)])
    ),
    ?assertEqual(
        [{two_listeners, 7, [2], #{type => ballot, listener => app, held_by => election}}],
        told_of([{7, 2, {listener_refused, ballot, app, election}}])
    ).

told_of_read(Events) ->
    M0 = starl_monitor:new([{starl_sap_monitor, #{bound_us => ?BOUND}}]),
    {Met, _} = lists:foldl(fun step/2, {[], M0}, Events),
    [{W, T, R, D} || #{what := W, at_us := T, robots := R, details := D} <- Met].

%% Each message that is overdue is told of, in the order of time.
several_are_overdue_test() ->
    Overdue = [{outcome_overdue, N + ?BOUND, [1, 2], #{message => id(N)}} || N <- [1, 2, 3]],
    ?assertEqual(Overdue, told_of([sent(N, id(N)) || N <- [1, 2, 3]], 9000)).

%% What was overdue comes before what an event breaks: one violation an event.
overdue_comes_first_test() ->
    Overdue = [{outcome_overdue, 1 + ?BOUND, [1, 2], #{message => id(1)}}],
    ?assertEqual(Overdue, told_of([sent(1, id(1)), got(9000, 2, id(7))])).

%% A message that was lost, forgotten and delivered after all is delivered, not sent, once more.
results_of_late_deliveries_test() ->
    {[], Results} = run([sent(1, id(1)), lost(3, id(1)), started(9000, 1), got(9001, 2, id(1))], 0),
    ?assertEqual(
        #{sent => 1, delivered => 1, acknowledged => 0, lost => 1, outstanding => 0}, Results
    ),
    {[], Before} = run([sent(1, id(1)), lost(3, id(1)), got(4, 2, id(1))], 0),
    ?assertEqual(Results, Before).

results_of_outcomes_test() ->
    Sent = [sent(1, id(1), [2, 3]), got(2, 2, id(1)), got(2, 3, id(1))],
    Count = fun(Events) ->
        {[], #{acknowledged := Acknowledged, lost := Lost}} = run(Sent ++ Events, 0),
        {Acknowledged, Lost}
    end,
    ?assertEqual({2, 0}, Count([ack(3, id(1)), ack(4, id(1), 3)])),
    ?assertEqual({1, 1}, Count([lost(3, id(1)), ack(4, id(1), 3)])),
    ?assertEqual({0, 1}, Count([{3, 1, {outcome, id(1), 2, restarted}}])),
    ?assertEqual({0, 0}, Count([])).

%% A start gives up what earlier incarnations have sent, not what the one that starts has.
start_keeps_its_own_test() ->
    ?assertEqual([outcome_overdue], judge([sent(1, id(1)), started(2, 1)], 9000)),
    Both = [sent(1, id(1, 1)), sent(1, id(2, 1)), started(2, 2)],
    ?assertEqual(
        [{outcome_overdue, 1 + ?BOUND, [1, 2], #{message => id(2, 1)}}],
        told_of(Both, 9000)
    ).

%% A robot that goes down may lose what its application has not read, and reports nothing more.
down_test() ->
    Down = {3, 1, robot, down},
    Feed = fun(Events) ->
        M0 = starl_monitor:new([{starl_sap_monitor, #{bound_us => ?BOUND}}]),
        {Met, M} = lists:foldl(fun step/2, {[], M0}, Events),
        {Late, _} = starl_monitor:finish(9000, M),
        [What || #{what := What} <- Met ++ Late]
    end,
    ?assertEqual([], Feed([trace(sent(1, id(1))), Down])),
    ?assertEqual([outcome_overdue], Feed([trace(sent(1, id(1))), setelement(2, Down, 2)])),
    Read = fun(Robot) ->
        Two = [trace(E) || N <- [1, 2], E <- [app_sent(N, id(N), N), app_got(N, id(N), N)]],
        Feed(Two ++ [Down, setelement(2, Down, Robot), read(4, 2)])
    end,
    ?assertEqual([], Read(2)),
    ?assertEqual([acknowledged_but_not_readable], Read(3)).

%% The application's room is 1000 messages, and SAP keeps 256 for it, unless it says otherwise.
usual_room_test() ->
    Traffic = fun(N) ->
        [trace(E) || I <- lists:seq(1, N), E <- [app_sent(I, id(I), I), app_got(I, id(I), I)]]
    end,
    Broken = fun(N) ->
        M0 = starl_monitor:new([{starl_sap_monitor, #{bound_us => 1_000_000}}]),
        case starl_monitor:step(Traffic(N), M0) of
            {ok, _} -> none;
            {violation, #{what := What, robots := [2], details := Details}, _} -> {What, Details}
        end
    end,
    ?assertEqual(none, Broken(1256)),
    ?assertEqual({more_than_it_can_keep, #{type => {app, a}}}, Broken(1257)).

%% The content of a lost message is remembered for a minute, unless it says otherwise.
usual_memory_test() ->
    Broken = fun(Us) ->
        M0 = starl_monitor:new([{starl_sap_monitor, #{bound_us => ?BOUND}}]),
        Feed = [sent(1, id(1)), lost(2, id(1)), {Us, 2, {delivered, id(1), greeting, 98}}],
        {Met, _} = lists:foldl(fun step/2, {[], M0}, [trace(Event) || Event <- Feed]),
        [What || #{what := What} <- Met]
    end,
    ?assertEqual([corrupted], Broken(2 + 60_000_000)),
    ?assertEqual([], Broken(3 + 60_000_000)).

%% Each type of an application is read in its own order.
order_is_of_a_type_test() ->
    Of = fun(N, Type) ->
        [
            {N, 1, sap, {sent, id(N), [2], {app, Type}, N}},
            {N, 2, sap, {delivered, id(N), {app, Type}, N}}
        ]
    end,
    Read = fun(N, Type) -> {100, 2, app, {read, 1, {app, Type}, N}} end,
    Three = Of(1, a) ++ Of(2, b) ++ Of(3, b),
    ?assertEqual([], told_of_read(Three ++ [Read(2, b), Read(3, b), Read(1, a)])),
    ?assertMatch(
        [{acknowledged_but_not_readable, 100, [2], #{type := {app, b}, source := 1}}],
        told_of_read(Three ++ [Read(3, b)])
    ).

%%% Memory: bounded by what is outstanding, however many messages were sent

memory_is_bounded_test_() ->
    {timeout, 60, fun() ->
        Small = flat_size(traffic(2_000)),
        Large = flat_size(traffic(40_000)),
        ?assert(Large < 2 * Small + 1000, {words, Small, Large})
    end}.

flat_size(Events) ->
    M0 = starl_monitor:new([{starl_sap_monitor, #{bound_us => 1_000_000_000, late_us => 10}}]),
    {ok, M} = starl_monitor:step(Events, M0),
    erts_debug:flat_size(M).

%% Unicast to ten receivers in turn, every tenth message reported lost and delivered later.
traffic(N) ->
    lists:append([exchange(10 * I, id(I), 2 + I rem 10, I rem 10) || I <- lists:seq(1, N)]).

exchange(T, Id, Dest, 0) ->
    [
        trace(E)
     || E <- [
            sent(T, Id, [Dest]),
            {T + 1, 1, {outcome, Id, Dest, lost}},
            got(T + 2, Dest, Id)
        ]
    ];
exchange(T, Id, Dest, _) ->
    [trace(E) || E <- [sent(T, Id, [Dest]), got(T + 1, Dest, Id), ack(T + 2, Id, Dest)]].

%%% A correct sender over a faulty network, with one planted fault, from a seed

random_exchanges_test() ->
    [
        ?assertEqual([], judge(lists:append(Exchanges), 1_000_000), {seed, Seed})
     || Seed <- lists:seq(1, 50), Exchanges <- [exchanges(Seed)]
    ].

planted_duplicates_are_found_test() ->
    [
        begin
            Exchanges = exchanges(Seed),
            Delivered = [Event || {_, _, {delivered, _, _, _}} = Event <- lists:append(Exchanges)],
            {_, Robot, Event} = lists:nth(1 + Seed rem length(Delivered), Delivered),
            Again = lists:append(Exchanges) ++ [{900_000, Robot, Event}],
            ?assertEqual([duplicate_delivery], judge(Again, 1_000_000), {seed, Seed})
        end
     || Seed <- lists:seq(1, 50)
    ].

exchanges(Seed) ->
    {Exchanges, _} = lists:mapfoldl(
        fun random_exchange/2,
        rand:seed_s(exsss, Seed),
        lists:seq(1, 60)
    ),
    Exchanges.

random_exchange(Seq, S0) ->
    {Kind, S1} = rand:uniform_s(4, S0),
    {Dest, S2} = rand:uniform_s(5, S1),
    T = Seq * 100,
    Id = id(Seq),
    Robot = Dest + 1,
    {[sent(T, Id, [Robot]) | rest(Kind, T, Id, Robot)], S2}.

rest(1, T, Id, Robot) -> [{T + 1, 1, {outcome, Id, Robot, lost}}];
rest(2, T, Id, Robot) -> [{T + 1, 1, {outcome, Id, Robot, lost}}, got(T + 2, Robot, Id)];
rest(3, T, Id, Robot) -> [got(T + 1, Robot, Id), {T + 2, 1, {outcome, Id, Robot, lost}}];
rest(4, T, Id, Robot) -> [got(T + 1, Robot, Id), ack(T + 2, Id, Robot)].

%% What the machine may trace, and with how much.
vocabulary_test() ->
    #{sap := Events} = starl_sap_monitor:vocabulary(),
    ?assertEqual(
        [
            {answered, 2},
            {called, 2},
            {delivered, 3},
            {dropped, 2},
            {full, 2},
            {listener_refused, 3},
            {outcome, 3},
            {outlived, 2},
            {overload, 1},
            {sent, 4},
            {started, 1},
            {unclaimed_full, 2},
            {unheard, 2}
        ],
        lists:sort(Events)
    ).

%% An outcome is late by what its source explains while the message is under way: not by another
%% robot's pause, nor by a pause before or after.
excused_by_its_own_robot_and_time_test() ->
    Judge = fun(Windows, Ends) ->
        Given = #{bound_us => ?BOUND, broken => Windows},
        {ok, Sent} = starl_monitor:step(
            [trace(sent(10, id(1)))], starl_monitor:new([{starl_sap_monitor, Given}])
        ),
        {Found, _} = starl_monitor:finish(Ends, Sent),
        [{What, At} || #{what := What, at_us := At} <- Found]
    end,
    Late = fun(At) -> [{outcome_overdue, At}] end,
    ?assertEqual(Late(1010), Judge([], 1011)),
    ?assertEqual([], Judge([{1, 500, 700, pause}], 1210)),
    ?assertEqual(Late(1210), Judge([{1, 500, 700, pause}], 1211)),
    [
        ?assertEqual({W, Late(1010)}, {W, Judge([W], 1011)})
     || W <- [{2, 500, 700, pause}, {1, 0, 9, pause}, {1, 1011, 9000, pause}]
    ].

%% One that has an excuse lets others through, and is looked at again in its turn.
excuses_end_in_their_order_test() ->
    Given = #{bound_us => ?BOUND, broken => [{1, 500, 700, pause}]},
    Sent = [
        {0, 1, sap, {sent, id(1), [2], greeting, 99}},
        {1, 2, sap, {sent, {2, 1, 1}, [1], greeting, 99}},
        {800, 1, sap, {sent, id(2), [2], greeting, 99}}
    ],
    {ok, M} = starl_monitor:step(Sent, starl_monitor:new([{starl_sap_monitor, Given}])),
    {Found, _} = starl_monitor:finish(2000, M),
    ?assertEqual([{1001, [2, 1]}, {1200, [1, 2]}, {1800, [1, 2]}], [
        {At, Robots}
     || #{at_us := At, robots := Robots} <- Found
    ]).

%% A message that was overdue and is given up then is forgotten like others.
what_was_overdue_is_forgotten_test() ->
    Config = #{bound_us => 1000, late_us => 10},
    Judge = fun(T) ->
        M0 = starl_monitor:new([{starl_sap_monitor, Config}]),
        Trace = [sent(1, id(1)), started(1100, 2), {T, 2, {delivered, id(1), greeting, 98}}],
        {Met, _} = lists:foldl(fun step/2, {[], M0}, [trace(Event) || Event <- Trace]),
        [What || #{what := What} <- Met]
    end,
    ?assertEqual([outcome_overdue, corrupted], Judge(1110)),
    ?assertEqual([outcome_overdue], Judge(1111)).
