%% The digest chain: what it tells apart, and which events its ledger is shown.
-module(starl_sim_chain_tests).
-include_lib("eunit/include/eunit.hrl").

%% Equal events come to equal chains; the order, the time, the machine and the content all count.
tells_events_apart_test() ->
    A = {1, sap, info, x},
    B = {2, app, cast, y},
    ?assertEqual(value([A, B]), value([A, B])),
    Others = [
        [],
        [A],
        [B],
        [B, A],
        [A, B, B],
        [A, {3, app, cast, y}],
        [A, {2, sap, cast, y}],
        [A, {2, app, info, y}],
        [A, {2, app, cast, z}]
    ],
    Values = [value(Events) || Events <- [[A, B] | Others]],
    ?assertEqual(length(Values), length(lists:usort(Values))).

%% Events are counted, and those of the range recorded, each with the chain as far as itself.
records_the_range_test() ->
    Chain = chain([{N, sap, info, N} || N <- lists:seq(1, 10)], {3, 4}),
    ?assertEqual(10, starl_sim_chain:events(Chain)),
    ?assertEqual(
        [
            #{
                n => N,
                at_us => N,
                machine => sap,
                type => info,
                content => N,
                chain => value([{K, sap, info, K} || K <- lists:seq(1, N)])
            }
         || N <- [3, 4]
        ],
        starl_sim_ledger:events(starl_sim_chain:ledger(Chain))
    ).

%% Every 1,000th event is a checkpoint.
checkpoints_test() ->
    Events = [{N, sap, info, N} || N <- lists:seq(1, 2500)],
    Chain = chain(Events, none),
    ?assertEqual(
        [{N, N, value(lists:sublist(Events, N))} || N <- [1000, 2000]],
        starl_sim_ledger:checkpoints(starl_sim_chain:ledger(Chain))
    ).

value(Events) -> starl_sim_chain:value(chain(Events, none)).

chain(Events, Range) ->
    lists:foldl(
        fun({Now, Machine, Type, Content}, Chain) ->
            starl_sim_chain:add(Now, Machine, Type, Content, Chain)
        end,
        starl_sim_chain:new(Range),
        Events
    ).
