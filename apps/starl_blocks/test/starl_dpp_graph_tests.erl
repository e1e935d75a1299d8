%% The graph that is planned on: what it refuses.
-module(starl_dpp_graph_tests).
-include_lib("eunit/include/eunit.hrl").

-define(MOST, 40000).

new(Segments) -> new(Segments, 1.0e6).

new(Segments, EdgeLength) ->
    starl_dpp_graph:new(#{
        segments => Segments,
        world => {12000.0, 12000.0},
        robots => [1],
        tube_radius => 215.0,
        edge_length => EdgeLength,
        seed => 1
    }).

%% Of lines that cross at more places than there may be edges no edge is counted.
too_many_crossings_test_() ->
    [
        {timeout, 60,
            ?_assertEqual({error, {too_many_edges, more, ?MOST}}, new(crossing(118, 339)))},
        {timeout, 60,
            ?_assertMatch(
                {error, {too_many_edges, N, ?MOST}} when N > ?MOST, new(crossing(200, 200))
            )}
    ].

%% So many lines up and across.
crossing(Up, Across) ->
    At = fun(I, N) -> 2000.0 + 7000.0 * I / (N + 1) end,
    [{{At(I, Up), 2000.0}, {At(I, Up), 9000.0}} || I <- lists:seq(1, Up)] ++
        [{{2000.0, At(I, Across)}, {9000.0, At(I, Across)}} || I <- lists:seq(1, Across)].

too_many_pieces_test_() ->
    Line = {{2000.0, 2000.0}, {2000.0, 2000.0 + 0.1 * (?MOST + 1)}},
    {timeout, 60, ?_assertEqual({error, {too_many_edges, ?MOST + 1, ?MOST}}, new([Line], 0.1))}.
