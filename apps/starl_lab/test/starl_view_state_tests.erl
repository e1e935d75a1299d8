-module(starl_view_state_tests).
-include_lib("eunit/include/eunit.hrl").

-define(S, 1000000).

state(Rows) -> lists:foldl(fun starl_view_state:add/2, starl_view_state:new(), Rows).

drives(T, X, V) -> [<<"m">>, T, 1, 0, T, X, 0.0, 0.0, V, 0.0].

%% Only what was driven with the pen down is ink, up to now.
ink_test() ->
    State = state([
        drives(0, 0.0, 100.0),
        [<<"a">>, 1 * ?S, 1, <<"pen">>, <<"down">>],
        drives(3 * ?S, 300.0, 50.0),
        [<<"a">>, 5 * ?S, 1, <<"pen">>, <<"up">>],
        drives(6 * ?S, 450.0, 100.0)
    ]),
    Ink = [Points || [<<"i">>, _, 1, Points] <- starl_view_state:rows(9 * ?S, State)],
    ?assertEqual([[100.0, 0.0, 300.0, 0.0], [300.0, 0.0, 400.0, 0.0]], lists:sort(Ink)).

growing_ink_test() ->
    State = state([drives(0, 0.0, 100.0), [<<"a">>, 0, 1, <<"pen">>, <<"down">>]]),
    ?assertMatch([[<<"i">>, _, 1, [_, _, 700.0, _]] | _], starl_view_state:rows(7 * ?S, State)).

%% Of each robot the last motion, pen and tubes; faults and ends in their order.
last_test() ->
    Fault = [<<"f">>, 5, manual_1, 1, 2, loss, <<"all">>, <<>>],
    Dead = [<<"x">>, 6, 1, robot, died],
    State = state([
        drives(1, 0.0, 1.0),
        [<<"r">>, 1, 1, [[1, 2, 3, 4]]],
        Fault,
        drives(2, 7.0, 1.0),
        [<<"r">>, 3, 1, []],
        Dead,
        [<<"p">>, 1, 1, 2, <<>>, 3, <<>>, 4]
    ]),
    ?assertEqual(
        [drives(2, 7.0, 1.0), [<<"r">>, 3, 1, []], Fault, Dead], starl_view_state:rows(9, State)
    ).

bounded_test() ->
    Rows = [[<<"x">>, T, 1, sap, crashed] || T <- lists:seq(1, 3000)],
    ?assertEqual(1000, length(starl_view_state:rows(9999, state(Rows)))).

%% Of very many values each second one is left out, the latest never; they come in their order.
measures_test() ->
    Value = fun(N) -> [<<"n">>, N, 1, <<"error_mm">>, N] end,
    Kept = fun(N) ->
        Rows = starl_view_state:rows(N, state([Value(K) || K <- lists:seq(1, N)])),
        [V || [<<"n">>, _, 1, <<"error_mm">>, V] <- Rows]
    end,
    ?assertEqual(lists:seq(1, 400), Kept(400)),
    [
        begin
            Values = Kept(N),
            ?assertEqual({N, true}, {lists:last(Values), length(Values) =< 400}),
            ?assertEqual(Values, lists:usort(Values))
        end
     || N <- [401, 402, 5000, 12345]
    ].
