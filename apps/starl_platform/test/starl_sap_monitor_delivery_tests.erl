%% Delivered, where packets get through: how many messages in a row chance may lose, and what else explains a loss.
%%
%% Holds: Chance alone does not lose message after message
%% Red: 961f67c9: no clause
-module(starl_sap_monitor_delivery_tests).
-include_lib("eunit/include/eunit.hrl").

-define(S, 1000000).
-define(WHOLE, (20 * ?S)).

%% A radio that loses this part, a SAP with seven transmissions.
delivery(Loss) -> delivery(Loss, []).

delivery(Loss, Faults) ->
    Unanswered = 1 - (1 - Loss) * (1 - Loss),
    starl_sap_monitor_delivery:new(#{
        unlucky => math:pow(Unanswered, 7), whole_us => ?WHOLE, faults => Faults
    }).

lost(N, D) -> lost(N, 1, 2, D).

%% The N-th message, sent at N minutes, is lost after all its transmissions.
lost(N, Source, Dest, D) ->
    SentUs = 60 * N * ?S,
    starl_sap_monitor_delivery:lost(SentUs + ?WHOLE, SentUs, Source, Dest, D).

%% The number of messages lost in a row that breaks the contract.
row(D) -> row(1, D).

row(N, _D) when N > 100 -> never;
row(N, D) ->
    case lost(N, D) of
        {in_vain, _} -> N;
        {ok, Next} -> row(N + 1, Next)
    end.

%% The N-th message arrives.
arrives(N, Source, Dest, D) ->
    starl_sap_monitor_delivery:acknowledged(60 * N * ?S, Source, Dest, D).

%% 0, 0.36^7, 0.51^7 and 0.84^7 to the power of the length of the row.
rows_test() ->
    ?assertEqual(1, row(delivery(0))),
    ?assertEqual(3, row(delivery(0.2))),
    ?assertEqual(5, row(delivery(0.3))),
    ?assertEqual(17, row(delivery(0.6))).

%% Until a message between the two was acknowledged, and again when one of them has begun anew, the receiver asks first:
%% more messages may be lost.
the_receiver_asks_first_test() ->
    D = starl_sap_monitor_delivery:new(#{
        unlucky => 1.0e-5, first => 1.0e-3, whole_us => ?WHOLE, faults => []
    }),
    ?assertEqual(3, row(D)),
    Known = arrives(0, 1, 2, D),
    ?assertEqual(2, row(Known)),
    ?assertEqual(2, row(starl_sap_monitor_delivery:begins(0, 3, Known))),
    [?assertEqual(3, row(starl_sap_monitor_delivery:begins(0, R, Known))) || R <- [1, 2]],
    ?assertEqual(3, row(arrives(0, 2, 1, D))).

%% A message that arrives begins a new row, between these two robots; each row is reported once.
a_row_ends_test() ->
    D0 = lists:foldl(fun(N, D) -> element(2, lost(N, D)) end, delivery(0.3), [1, 2, 3, 4]),
    ?assertMatch({in_vain, _}, lost(5, D0)),
    ?assertMatch({ok, _}, lost(6, arrives(5, 1, 2, D0))),
    Other = arrives(5, 1, 3, D0),
    ?assertMatch({in_vain, _}, lost(5, Other)),
    ?assertMatch({ok, _}, lost(5, 2, 1, D0)),
    {in_vain, D1} = lost(5, D0),
    ?assertMatch({ok, _}, lost(6, D1)).

%% Many messages are under way at once, and those without luck are reported last: they are no series, since others
%% between them have arrived. One that was sent before all of them ends no series.
messages_under_way_at_once_test() ->
    D = lists:foldl(fun(N, Acc) -> arrives(N, 1, 2, Acc) end, delivery(0.3), [2, 4, 6, 8, 10]),
    Apart = lists:foldl(
        fun(N, Acc) ->
            {ok, Next} = lost(N, Acc),
            Next
        end,
        D,
        [1, 3, 5, 7, 9]
    ),
    ?assertMatch({ok, _}, lost(11, Apart)),
    In = lists:foldl(
        fun(N, Acc) ->
            {ok, Next} = lost(N, Acc),
            Next
        end,
        D,
        [11, 12, 13, 14]
    ),
    ?assertMatch({in_vain, _}, lost(15, arrives(1, 1, 2, In))).

%% What has not been sent as often as can be tells nothing.
given_up_early_test() ->
    D = delivery(0),
    ?assertMatch({ok, _}, starl_sap_monitor_delivery:lost(?WHOLE - 1, 0, 1, 2, D)),
    ?assertMatch({in_vain, _}, starl_sap_monitor_delivery:lost(?WHOLE, 0, 1, 2, D)).

%% A robot that is down, or began not long ago, and a receiver without room explain a loss.
explained_test() ->
    Is = fun(D) -> element(1, lost(1, D)) end,
    D = delivery(0),
    ?assertEqual(ok, Is(starl_sap_monitor_delivery:goes(2, D))),
    ?assertEqual(ok, Is(starl_sap_monitor_delivery:goes(1, D))),
    ?assertEqual(in_vain, Is(starl_sap_monitor_delivery:goes(3, D))),
    Began = fun(S, Robot) -> starl_sap_monitor_delivery:begins(S * ?S, Robot, D) end,
    ?assertEqual(ok, Is(Began(70, 2))),
    ?assertEqual(ok, Is(Began(56, 1))),
    ?assertEqual(in_vain, Is(Began(54, 2))),
    ?assertEqual(in_vain, Is(Began(70, 3))),
    Full = fun(S, Dest, Source) -> starl_sap_monitor_delivery:refuses(S * ?S, Dest, Source, D) end,
    ?assertEqual(ok, Is(Full(61, 2, 1))),
    ?assertEqual(in_vain, Is(Full(59, 2, 1))),
    ?assertEqual(in_vain, Is(Full(61, 2, 3))).

%% A fault at one of the two robots does, one at a third robot does not; nor does one that is over.
faults_test() ->
    Is = fun(Faults) -> element(1, lost(1, delivery(0, Faults))) end,
    Window = fun(Robot, From, To) -> {Robot, From * ?S, To * ?S, fault} end,
    ?assertEqual(ok, Is([Window(1, 65, 66)])),
    ?assertEqual(ok, Is([Window(2, 65, 66)])),
    ?assertEqual(ok, Is([Window(all, 65, 66)])),
    ?assertEqual(in_vain, Is([Window(3, 65, 66)])),
    ?assertEqual(in_vain, Is([Window(2, 10, 54)])),
    ?assertEqual(in_vain, Is([Window(2, 81, 90)])),
    Later = starl_sap_monitor_delivery:broken(Window(2, 65, 66), delivery(0)),
    ?assertMatch({ok, _}, lost(1, Later)).

%% Where nothing can be said the reason is given.
unjudged_test() ->
    Off = starl_sap_monitor_delivery:new(#{unlucky => {off, [{"clause", "why"}]}}),
    ?assertMatch({ok, _}, lost(1, Off)),
    ?assertEqual([{"clause", "why"}], starl_sap_monitor_delivery:unjudged(?S, Off)),
    ?assertEqual([], starl_sap_monitor_delivery:unjudged(?S, delivery(0.3))),
    Always = delivery(0.3, [{all, 0, 900 * ?S, fault}]),
    ?assertMatch([{"delivered" ++ _, _}], starl_sap_monitor_delivery:unjudged(800 * ?S, Always)).

%% What the monitor of a run is told: all transmissions, there and back; nothing of real networks, or of those with
%% walls and limited range.
context_test() ->
    Known = #{
        broken => [],
        faults => [],
        slack_us => 0,
        loss => 0.3,
        sap => #{limit => 6},
        ends => #{},
        healed_us => 0
    },
    Told = fun(More) -> starl_sap_monitor:context(maps:merge(Known, More), #{bound_us => 1}) end,
    #{unlucky := Unlucky} = Told(#{}),
    ?assert(abs(Unlucky - math:pow(0.51, 7)) < 1.0e-9),
    ?assertMatch(#{unlucky := {off, [_]}}, Told(#{slack_us => 1})),
    ?assertMatch(#{unlucky := {off, [_]}}, Told(#{ends => #{network => never}})).
