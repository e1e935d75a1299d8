-module(starl_grid_tests).
-include_lib("eunit/include/eunit.hrl").

empty_test() ->
    ?assertEqual([], starl_grid:near({{0.0, 0.0}, {9.0, 9.0}}, 5.0, starl_grid:new(2.0))).

each_key_once_and_sorted_test() ->
    Grid = lists:foldl(
        fun(K, G) -> starl_grid:add(K, {{0.0, 0.0}, {100.0, 100.0}}, G) end,
        starl_grid:new(7.0),
        [3, 1, 2]
    ),
    ?assertEqual([1, 2, 3], starl_grid:near({0.0, 0.0, 50.0, 50.0}, 1.0, Grid)).

far_keys_are_left_out_test() ->
    Grid = starl_grid:add(a, {{0.0, 0.0}, {10.0, 0.0}}, starl_grid:new(5.0)),
    ?assertEqual([], starl_grid:near({{100.0, 100.0}, {101.0, 100.0}}, 5.0, Grid)).

%% near/3 never misses a key within the radius, and remove/3 undoes add/3.
complete_random_test_() ->
    [{lists:concat(["seed ", Seed]), fun() -> complete(Seed) end} || Seed <- lists:seq(1, 30)].

complete(Seed) ->
    {Shapes, Rand1} = shapes(60, rand:seed_s(exsss, Seed)),
    {Queries, Rand2} = shapes(20, Rand1),
    {Cell, _} = rand:uniform_s(Rand2),
    Keyed = lists:zip(lists:seq(1, 60), Shapes),
    Empty = starl_grid:new(1.0 + 200.0 * Cell),
    Grid = lists:foldl(fun({K, S}, G) -> starl_grid:add(K, S, G) end, Empty, Keyed),
    [
        begin
            Near = starl_grid:near(Q, R, Grid),
            ?assertEqual(Near, lists:usort(Near)),
            ?assertEqual(
                [], [K || {K, S} <- Keyed, starl_geometry:segment_segment(S, Q) =< R] -- Near
            )
        end
     || Q <- Queries, R <- [0.0, 30.0, 300.0]
    ],
    {Out, In} = lists:split(30, Keyed),
    Half = lists:foldl(fun({K, S}, G) -> starl_grid:remove(K, S, G) end, Grid, Out),
    All = starl_grid:near({-2000.0, -2000.0, 2000.0, 2000.0}, 1.0, Half),
    ?assertEqual([K || {K, _} <- In], All),
    Rest = lists:foldl(fun({K, S}, G) -> starl_grid:remove(K, S, G) end, Half, In),
    ?assertEqual(Empty, Rest).

shapes(0, Rand) ->
    {[], Rand};
shapes(N, Rand0) ->
    {[A, B, C, D], Rand1} = lists:mapfoldl(fun(_, R) -> rand:uniform_s(R) end, Rand0, [1, 2, 3, 4]),
    %% Some are upright, level or points: the special cases of walking along columns.
    P = {1000.0 * (A - 0.5), 1000.0 * (B - 0.5)},
    Q =
        case N rem 4 of
            0 -> {element(1, P), 1000.0 * (D - 0.5)};
            1 -> {1000.0 * (C - 0.5), element(2, P)};
            2 -> P;
            3 -> {1000.0 * (C - 0.5), 1000.0 * (D - 0.5)}
        end,
    {Rest, Rand2} = shapes(N - 1, Rand1),
    {[{P, Q} | Rest], Rand2}.
