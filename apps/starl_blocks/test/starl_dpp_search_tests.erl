%% Path planning's search finds what a plain one finds: every vertex that can be reached over safe
%% edges is visited once, the cheapest first, at the cost of the cheapest way into it.
-module(starl_dpp_search_tests).
-include_lib("eunit/include/eunit.hrl").

-define(TURN_MM, 160.0).

agrees_with_a_plain_search_test_() ->
    [{timeout, 30, fun() -> agrees(Seed) end} || Seed <- lists:seq(1, 12)].

agrees(Seed) ->
    {Space, Starts} = drawn(rand:seed_s(exsss, Seed)),
    Visit = fun(V, Cost, Heading, Acc) -> {continue, infinity, [{V, Cost, Heading} | Acc]} end,
    {Labels, Visited} = starl_dpp_search:run(Starts, Space, Visit, []),
    Order = lists:reverse(Visited),
    ?assertEqual(plain(Starts, Space), Order, {seed, Seed}),
    [
        ?assertEqual(Cost, cost(starl_dpp_search:trail(V, Labels), Starts, Space), {seed, Seed, V})
     || {V, Cost, _} <- Order
    ].

%% It stops when the visitor says so, with the way to what it has found.
stops_test() ->
    {Space, Starts} = drawn(rand:seed_s(exsss, 1)),
    All = plain(Starts, Space),
    {V, Cost, _} = lists:nth(length(All) div 2, All),
    Visit = fun
        (W, _, _, N) when W =:= V -> {stop, N + 1};
        (_, _, _, N) -> {continue, infinity, N + 1}
    end,
    {Labels, Visited} = starl_dpp_search:run(Starts, Space, Visit, 0),
    ?assertEqual(length(All) div 2, Visited),
    ?assertEqual(Cost, cost(starl_dpp_search:trail(V, Labels), Starts, Space)).

%% What costs more than the visitor has use for is not visited, all else is.
within_test_() ->
    [fun() -> within(Seed) end || Seed <- lists:seq(1, 12)].

within(Seed) ->
    {Space, Starts} = drawn(rand:seed_s(exsss, Seed)),
    All = plain(Starts, Space),
    {_, Within, _} = lists:nth((length(All) + 1) div 2, All),
    Visit = fun(V, Cost, Heading, Acc) -> {continue, Within, [{V, Cost, Heading} | Acc]} end,
    {_, Visited} = starl_dpp_search:run(Starts, Space, Visit, []),
    Cheap = [Found || {_, Cost, _} = Found <- All, Cost =< Within],
    ?assertEqual(Cheap, [F || {_, C, _} = F <- lists:reverse(Visited), C =< Within], {seed, Seed}),
    ?assertEqual([], [F || {_, C, _} = F <- Visited, C > Within, not from_start(F, Starts)]).

from_start({V, Cost, _}, Starts) -> [] =/= [S || {C, W, _} = S <- Starts, W =:= V, C =:= Cost].

%% A turn goes the shorter way round, in either sense; the first one is free.
turn_test() ->
    Turn = fun(From, To) -> starl_dpp_search:turn(From, To, 100.0) end,
    ?assertEqual(+0.0, Turn(none, 3.0)),
    [
        ?assert(abs(100.0 * Radians - Turn(From, To)) < 1.0e-9, {From, To})
     || {From, To, Radians} <- [
            {0.0, 1.0, 1.0},
            {1.0, 0.0, 1.0},
            {-1.0, 1.0, 2.0},
            {1.0, 1.0, 0.0},
            {3.0, -3.0, 2 * math:pi() - 6.0},
            {-3.0, 3.0, 2 * math:pi() - 6.0},
            {-1.0, math:pi() - 1.0, math:pi()},
            {math:pi() - 1.0, -1.0, math:pi()}
        ]
    ].

%% Two ways that cost the same, around a square: its far corner is visited once.
two_ways_test() ->
    {X, Y} = {4000.0, 4000.0},
    Corners = [{X, Y}, {X + 100.0, Y}, {X + 100.0, Y + 100.0}, {X, Y + 100.0}],
    {ok, Plan0} = starl_dpp_plan:new(#{
        segments => lists:zip(Corners, tl(Corners) ++ [hd(Corners)]),
        world => {9000.0, 9000.0},
        tube_radius => 220.0,
        robots => [1]
    }),
    Plan = starl_dpp_plan:standing(1, {7000.0, 7000.0}, Plan0),
    Graph = starl_dpp_plan:graph(Plan),
    [First] = [V || V <- [1, 2, 3, 4], starl_dpp_graph:point(V, Graph) =:= {X, Y}],
    Space = starl_dpp_route:space([1], starl_dpp_plan:view(1, Plan)),
    Visit = fun(V, Cost, _, Acc) -> {continue, infinity, [{V, Cost} | Acc]} end,
    {_, Visited} = starl_dpp_search:run([{0.0, First, none}], Space, Visit, []),
    [Far] = [V || V <- [1, 2, 3, 4], starl_dpp_graph:point(V, Graph) =:= {X + 100.0, Y + 100.0}],
    ?assertMatch([{Far, Cost}] when Cost < 600.0, [
        F
     || {V, _} = F <- Visited, V =:= Far
    ]),
    ?assertEqual(length(Visited), length(lists:ukeysort(1, Visited))).

%% -- a plain search -------------------------------------------------------------------------

%% Of all that can be reached next, the cheapest is visited.
plain(Starts, Space) -> plain(lists:sort(Starts), #{}, Space).

plain([], _Seen, _Space) ->
    [];
plain([{_, V, _} | Open], Seen, Space) when is_map_key(V, Seen) ->
    plain(Open, Seen, Space);
plain([{Cost, V, In} | Open], Seen, #{graph := Graph} = Space) ->
    Next = [
        {Cost + Length + starl_dpp_search:turn(In, Out, ?TURN_MM), W, Out}
     || {E, W, Length, Out} <- starl_dpp_graph:adjacent(V, Graph), safe(E, Space)
    ],
    [{V, Cost, In} | plain(lists:merge(lists:sort(Next), Open), Seen#{V => true}, Space)].

safe(E, #{masks := Masks, own := Own}) -> starl_dpp_array:get(E, Masks) band (bnot Own) =:= 0.

cost([First | Rest], Starts, Space) ->
    {Cost, First, Heading} = lists:min([Start || {_, V, _} = Start <- Starts, V =:= First]),
    cost(First, Rest, Cost, Heading, Space).

cost(_V, [], Cost, _In, _Space) ->
    Cost;
cost(V, [W | Rest], Cost, In, #{graph := Graph} = Space) ->
    {Length, Out} = lists:min([
        {Length, Out}
     || {E, To, Length, Out} <- starl_dpp_graph:adjacent(V, Graph), To =:= W, safe(E, Space)
    ]),
    cost(W, Rest, Cost + Length + starl_dpp_search:turn(In, Out, ?TURN_MM), Out, Space).

%% A graph over random lines, every fifth edge blocked, by the searching robot itself or another,
%% and up to four starts, two of them at one vertex.
drawn(Rand0) ->
    {Numbers, Rand1} = draws(40, Rand0),
    {ok, Plan} = starl_dpp_plan:new(#{
        segments => lines(Numbers),
        world => {9000.0, 9000.0},
        tube_radius => 220.0,
        robots => [1, 2]
    }),
    Graph = starl_dpp_plan:graph(Plan),
    Edges = lists:seq(1, 3 * starl_dpp_graph:targets(Graph)),
    {Blocks, Rand2} = draws(length(Edges), Rand1),
    Block = fun({E, X}, Acc) -> starl_dpp_array:put(E, 1 + trunc(15 * X), Acc) end,
    Blocked = [Drawn || {_, X} = Drawn <- lists:zip(Edges, Blocks), X < 0.2],
    Nobody = starl_dpp_array:new(starl_dpp_graph:edges(Graph), 0),
    Masks = lists:foldl(Block, Nobody, Blocked),
    {[A, B, C, D], _} = draws(4, Rand2),
    Vertex = fun(X) -> 1 + trunc(X * starl_dpp_graph:targets(Graph) / 2) end,
    Starts = [{900.0 * B, Vertex(A), none}, {900.0 * C, Vertex(A), 1.0}, {400.0 * D, Vertex(C), D}],
    {#{graph => Graph, masks => Masks, own => 1, turn_mm => ?TURN_MM}, Starts}.

lines([A, B, C, D | Rest]) -> [{place(A, B), place(C, D)} | lines(Rest)];
lines([]) -> [].

place(X, Y) -> {1500.0 + 6000.0 * X, 1500.0 + 6000.0 * Y}.

draws(N, Rand) -> lists:mapfoldl(fun(_, R) -> rand:uniform_s(R) end, Rand, lists:seq(1, N)).
