%% Motion from samples: pieces that begin and end where a body was seen.
-module(starl_world_sampled_motion_tests).
-include_lib("eunit/include/eunit.hrl").

-define(STEP_US, 40000).

%% A body that stands adds nothing.
standing_test() ->
    Pieces = starl_world_sampled_motion:new(0, {1.0, 2.0, 0.5}),
    {same, Next} = starl_world_sampled_motion:add(?STEP_US, {1.0, 2.0, 0.5}, Pieces),
    ?assertEqual(?STEP_US, starl_world_sampled_motion:reported_us(Next)).

%% Even motion is one piece, however often it is told; each change is another one. Ahead, back, arcs, a turn in
%% place, and where headings are counted anew.
even_motion_is_one_piece_test_() ->
    [
        ?_assertEqual([Piece], told(Piece, 10))
     || {V, W, Heading} <- [
            {200.0, 0.0, 0.3},
            {-150.0, 0.0, 3.0},
            {200.0, 1.5, -3.1},
            {-90.0, 0.7, 0.0},
            {0.0, 2.0, 3.14}
        ],
        Piece <- [starl_trajectory:piece(0, {5.0, -7.0}, Heading, V, W)]
    ].

%% The pieces, rounded as the one that they are of.
told(Truth, N) ->
    Times = [?STEP_US * I || I <- lists:seq(1, N)],
    {Told, _} = lists:mapfoldl(
        fun(T, Pieces) ->
            {X, Y, Heading} = starl_trajectory:pose(T, Truth),
            starl_world_sampled_motion:add(T, {X, Y, starl_geometry:normalise(Heading)}, Pieces)
        end,
        starl_world_sampled_motion:new(0, starl_trajectory:pose(0, Truth)),
        Times
    ),
    [rounded(Truth, Piece) || Piece <- Told, Piece =/= same].

rounded(Truth, Piece) ->
    [piece, T | Of] = tuple_to_list(Truth),
    [piece, T | Is] = tuple_to_list(Piece),
    ?assert(lists:all(fun({A, B}) -> abs(A - B) < 1.0e-6 end, lists:zip(Of, Is))),
    Truth.

%% A body that slipped aside moves along its chord: each piece ends where it was seen.
aside_test() ->
    {Piece, _} = starl_world_sampled_motion:add(
        1000000, {3.0, 4.0, 0.0}, starl_world_sampled_motion:new(0, {0.0, 0.0, 0.0})
    ),
    {X, Y, _} = starl_trajectory:pose(1000000, Piece),
    Half = starl_trajectory:position(500000, Piece),
    ?assert(abs(X - 3.0) + abs(Y - 4.0) < 1.0e-9),
    ?assertEqual({0.0, 0.0}, Half).

%% It is not known since when it moves: for half a second at most.
a_body_that_stood_long_test() ->
    Pieces = starl_world_sampled_motion:new(0, {0.0, 0.0, 0.0}),
    {Piece, _} = starl_world_sampled_motion:add(10000000, {10.0, 0.0, 0.0}, Pieces),
    ?assertEqual({piece, 9500000, 0.0, 0.0, 0.0, 20.0, 0.0}, Piece).

%% As far as is known a silent body stands where it was last, and moves on from there.
silence_test() ->
    {_, Moving} = starl_world_sampled_motion:add(
        ?STEP_US, {4.0, 0.0, 0.0}, starl_world_sampled_motion:new(0, {0.0, 0.0, 0.0})
    ),
    {Standing, Rests} = starl_world_sampled_motion:rest(Moving),
    ?assertEqual({piece, ?STEP_US, 4.0, 0.0, 0.0, 0.0, 0.0}, Standing),
    ?assertMatch({same, _}, starl_world_sampled_motion:rest(Rests)),
    {Piece, _} = starl_world_sampled_motion:add(3 * ?STEP_US, {12.0, 0.0, 0.0}, Rests),
    ?assertEqual({4.0, 0.0}, starl_trajectory:position(?STEP_US, Piece)),
    {12.0, 0.0} = starl_trajectory:position(3 * ?STEP_US, Piece).

%% What comes twice, or out of its order, changes nothing.
out_of_order_test() ->
    {_, Pieces} = starl_world_sampled_motion:add(
        ?STEP_US, {4.0, 0.0, 0.0}, starl_world_sampled_motion:new(0, {0.0, 0.0, 0.0})
    ),
    ?assertEqual({same, Pieces}, starl_world_sampled_motion:add(?STEP_US, {5.0, 0.0, 0.0}, Pieces)),
    ?assertEqual({same, Pieces}, starl_world_sampled_motion:add(0, {5.0, 0.0, 0.0}, Pieces)).
