-module(starl_planar_tests).
-include_lib("eunit/include/eunit.hrl").

graph(Segments) -> starl_planar:planarise(Segments, #{}).

counts(Segments) ->
    #{vertices := V, edges := E} = graph(Segments),
    {length(V), length(E)}.

empty_test() -> ?assertEqual({0, 0}, counts([])).

zero_length_dropped_test() ->
    #{edges := E} = graph([{{1.0, 1.0}, {1.0, 1.0}}]),
    ?assertEqual([], E).

%% A line whose ends are one point stays where nothing else is painted: a dot.
a_tiny_line_alone_stays_test() ->
    Tiny = fun(Mm) -> {{1.0, 1.0}, {1.0 + Mm, 1.0}} end,
    Kept = fun(Lines) ->
        #{vertices := V, edges := E} = graph(Lines),
        [{lists:nth(A, V), lists:nth(B, V)} || {A, B} <- E]
    end,
    [?assertEqual([Tiny(Mm)], Kept([Tiny(Mm)])) || Mm <- [0.001, 0.01, 0.05, 0.06]],
    ?assertEqual([Tiny(0.02)], Kept([Tiny(0.02), Tiny(0.02), Tiny(0.01)])),
    ?assertEqual([Tiny(0.02)], Kept([{{1.0, 1.0}, {1.0, 1.0}}, Tiny(0.02)])),
    %% at the end of another line it is that line's
    Long = {{1.0, 1.0}, {9.0, 1.0}},
    ?assertEqual([Long], Kept([Tiny(0.02), Long])),
    ?assertEqual([Long], Kept([Long, Tiny(0.02)])).

cross_becomes_vertex_test() ->
    ?assertEqual({5, 4}, counts([{{0.0, 0.0}, {10.0, 10.0}}, {{0.0, 10.0}, {10.0, 0.0}}])).

touch_becomes_vertex_test() ->
    ?assertEqual({4, 3}, counts([{{0.0, 0.0}, {10.0, 0.0}}, {{5.0, 0.01}, {5.0, 10.0}}])).

overlap_is_merged_test() ->
    ?assertEqual({4, 3}, counts([{{0.0, 0.0}, {10.0, 0.0}}, {{5.0, 0.0}, {15.0, 0.0}}])),
    ?assertEqual({4, 3}, counts([{{0.0, 0.0}, {10.0, 0.0}}, {{7.0, 0.0}, {3.0, 0.0}}])).

duplicates_merged_test() ->
    ?assertEqual({2, 1}, counts([{{0.0, 0.0}, {10.0, 0.0}}, {{10.0, 0.0}, {0.0, 0.01}}])).

%% Ends that are no farther apart than the tolerance are one vertex, also if that is millimetres.
tolerance_test() ->
    Corner = [{{0.0, 0.0}, {100.0, 0.0}}, {{101.5, 0.0}, {101.5, 100.0}}],
    Counts = fun(Mm) ->
        #{vertices := V, edges := E} = starl_planar:planarise(Corner, #{tolerance => Mm}),
        {length(V), length(E)}
    end,
    ?assertEqual([{4, 2}, {3, 2}, {3, 2}], [Counts(Mm) || Mm <- [1.0, 1.5, 2.0]]).

%% An end that is as far from a line as the tolerance is on the line, which goes on from there.
as_far_as_the_tolerance_test() ->
    End = {7.0, 0.5},
    Lines = [{{0.0, 0.0}, {10.0, 0.0}}, {{3.0, -0.25}, End}],
    #{vertices := V, edges := E} = starl_planar:planarise(Lines, #{tolerance => 0.5}),
    At = fun(N) -> lists:nth(N, V) end,
    From = [At(A) || {A, B} <- E, At(B) == End] ++ [At(B) || {A, B} <- E, At(A) == End],
    ?assertMatch([{X, _}, {10.0, _}] when X < 7.0, lists:sort(From)).

star_shares_one_vertex_test() ->
    Star = [
        {{1000 * math:cos(A), 1000 * math:sin(A)}, {-1000 * math:cos(A), -1000 * math:sin(A)}}
     || K <- lists:seq(0, 19), A <- [K * math:pi() / 20]
    ],
    ?assertEqual({41, 40}, counts(Star)).

long_edges_divided_test() ->
    #{vertices := V, edges := E} =
        starl_planar:planarise([{{0.0, 0.0}, {1000.0, 0.0}}], #{max_length => 300.0}),
    ?assertEqual(4, length(E)),
    [
        ?assert(abs(starl_geometry:distance(lists:nth(A, V), lists:nth(B, V)) - 250.0) < 1.0e-6)
     || {A, B} <- E
    ].

%% No two edges meet anywhere but in shared vertices, and no ink is lost or invented.
planar_random_test_() ->
    [
        {lists:concat([Kind, " seed ", Seed]), fun() -> planar(Kind, Seed) end}
     || Kind <- [lines, lattice, near_parallel], Seed <- lists:seq(1, 15)
    ].

planar(Kind, Seed) ->
    Segments = random_segments(Kind, 40, rand:seed_s(exsss, Seed)),
    #{vertices := V, edges := E} = Graph = graph(Segments),
    ?assertEqual(Graph, graph(Segments)),
    Points = list_to_tuple(V),
    Lines = [{A, B, {element(A, Points), element(B, Points)}} || {A, B} <- E],
    [
        ?assertEqual({none, {A, B}, {C, D}}, {meet(L, M), {A, B}, {C, D}})
     || {A, B, _} = L <- Lines, {C, D, _} = M <- Lines, {A, B} < {C, D}
    ],
    [?assert(covered(P, [S || {_, _, S} <- Lines])) || S0 <- Segments, P <- samples(S0)],
    [?assert(covered(P, Segments)) || {_, _, S} <- Lines, P <- samples(S)].

meet({A, B, S}, {C, D, T}) ->
    Shared = lists:member(A, [C, D]) orelse lists:member(B, [C, D]),
    case starl_geometry:intersection(S, T) of
        {proper, P} when not Shared -> {proper, P};
        {overlap, {P, Q}} -> {overlap, {P, Q}};
        _ -> none
    end.

samples({P, Q}) -> [starl_geometry:interpolate(P, Q, K / 8) || K <- lists:seq(0, 8)].

covered(P, Segments) ->
    lists:any(fun(S) -> starl_geometry:point_segment(P, S) < 0.3 end, Segments).

random_segments(_Kind, 0, _Rand) ->
    [];
random_segments(Kind, N, Rand0) ->
    {A, Rand1} = point(Kind, Rand0),
    {B, Rand2} = point(Kind, Rand1),
    [{A, B} | random_segments(Kind, N - 1, Rand2)].

point(lines, Rand0) ->
    {X, Rand1} = rand:uniform_s(Rand0),
    {Y, Rand2} = rand:uniform_s(Rand1),
    {{1000.0 * X, 1000.0 * Y}, Rand2};
point(lattice, Rand0) ->
    {X, Rand1} = rand:uniform_s(6, Rand0),
    {Y, Rand2} = rand:uniform_s(6, Rand1),
    {{100.0 * X, 100.0 * Y}, Rand2};
point(near_parallel, Rand0) ->
    {X, Rand1} = rand:uniform_s(20, Rand0),
    {Y, Rand2} = rand:uniform_s(Rand1),
    {{50.0 * X, 3.0 * Y}, Rand2}.

%% The work grows about as the lines and their crossings do: twice the lines over twice the floor
%% are little more than twice the work, and nothing like four times.
fast_test_() ->
    {timeout, 60, fun() ->
        Work = fun(Lines) ->
            {Work, #{edges := E}} = starl_platform_ct:work(fun() -> graph(Lines) end),
            {Work, length(E)}
        end,
        Lines = short_lines(1000, rand:seed_s(exsss, 7)),
        Beside = [{{X + 20000.0, Y}, {Z + 20000.0, W}} || {{X, Y}, {Z, W}} <- Lines],
        {Once, Edges} = Work(Lines),
        ?assert(Edges > 2000),
        {Twice, Both} = Work(Lines ++ Beside),
        ?assertEqual(2 * Edges, Both),
        ?assert(Twice < 2.7 * Once, {Once, Twice})
    end}.

%% Two thousand long lines cross half a million times. Who allows for twenty thousand hears so after
%% a small part of that.
refused_while_counting_test_() ->
    {timeout, 60, fun() ->
        {Lines, _} = lists:mapfoldl(fun line/2, rand:seed_s(exsss, 7), lists:seq(1, 2000)),
        Limited = fun(Most) -> starl_planar:planarise(Lines, #{most => Most}) end,
        {Few, too_many} = starl_platform_ct:work(fun() -> Limited(2000) end),
        {Many, too_many} = starl_platform_ct:work(fun() -> Limited(20000) end),
        ?assert(Many < 12 * Few, {Few, Many})
    end}.

line(_, Rand0) ->
    {P, Rand1} = point(lines, Rand0),
    {Q, Rand} = point(lines, Rand1),
    {{P, Q}, Rand}.

%% A drawing within the limit comes out as without one; the limit counts places where lines cross,
%% not the ends of lines.
limit_test() ->
    Crossing =
        [{{0.0, 10.0 * I}, {100.0, 10.0 * I}} || I <- lists:seq(1, 5)] ++
            [{{10.0 * I, 0.0}, {10.0 * I, 100.0}} || I <- lists:seq(1, 5)],
    Limited = fun(Most) -> starl_planar:planarise(Crossing, #{most => Most}) end,
    ?assertEqual(graph(Crossing), Limited(25)),
    ?assertEqual(too_many, Limited(24)).

short_lines(0, _) ->
    [];
short_lines(N, Rand0) ->
    {{X, Y}, Rand1} = point(lines, Rand0),
    {A, Rand2} = rand:uniform_s(Rand1),
    Angle = A * 6.283,
    P = {X * 10, Y * 10},
    Q = {X * 10 + 580 * math:cos(Angle), Y * 10 + 580 * math:sin(Angle)},
    [{P, Q} | short_lines(N - 1, Rand2)].
