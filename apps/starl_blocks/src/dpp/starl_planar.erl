%% @doc Makes a planar graph of a drawing. Lines that cross, touch or overlap are cut so that they
%% meet in vertices only.
%%
%% Points closer than the tolerance become one vertex. Every crossing becomes a vertex, and so does
%% every end that lies on another line. So both ends of every collinear overlap become vertices.
%% Duplicate edges are merged, and edges of no length are dropped. A line so short that its ends
%% become one vertex stays only if no other edge begins there. Joining points moves lines by up to
%% the tolerance, which may create new touches, so the cutting is repeated until nothing changes.
%% Finally, long edges are divided into equal parts. Vertices and edges are numbered from 1 in the
%% order of the given lines, so the same drawing always gives the same numbers. Lengths are
%% millimetres.
-module(starl_planar).

-export([planarise/2]).
-export_type([graph/0, options/0, vertex/0]).

-type vertex() :: pos_integer().
-type options() :: #{
    tolerance => float(), max_length => float() | infinity, most => pos_integer() | infinity
}.
%% `tolerance' (0.05): points closer than this are the same. `max_length' (infinity): no edge is
%% longer than this. `most' (infinity): a drawing whose lines cross at more places than this, so
%% that it has more edges, is refused as soon as the count reaches that number.
-type graph() :: #{vertices := [starl_geometry:point()], edges := [{vertex(), vertex()}]}.
%% The n-th point is vertex n, the n-th pair is edge n.

-record(weld, {
    tolerance :: float(),
    count = 0 :: non_neg_integer(),
    %% no more vertices than this
    most = infinity :: pos_integer() | infinity,
    points = #{} :: #{vertex() => starl_geometry:point()},
    cells = #{} :: #{{integer(), integer()} => [vertex()]}
}).

-define(MAX_PASSES, 8).

%% @doc The planar graph of some lines.
-spec planarise([starl_geometry:segment()], options()) -> graph() | too_many.
planarise(Segments, Options) ->
    Weld0 = #weld{tolerance = maps:get(tolerance, Options, 0.05)},
    {Lines, Weld1} = lists:mapfoldl(fun weld_segment/2, Weld0, Segments),
    Most = most(maps:get(most, Options, infinity), Weld1),
    case cut_all(unique(Lines), Weld1#weld{most = Most}, ?MAX_PASSES) of
        too_many ->
            too_many;
        {Edges, Weld2} ->
            {All, Weld} = dots(lists:zip(Lines, Segments), Edges, Weld2),
            divide(All, Weld, maps:get(max_length, Options, infinity))
    end.

%% Each new vertex is where two lines cross, so two edges at least end there: there are at least as
%% many edges as new vertices.
most(infinity, _Weld) -> infinity;
most(Most, #weld{count = Drawn}) -> Drawn + Most.

%%% Joining points

weld_segment({P, Q}, Weld0) ->
    {A, Weld1} = weld(P, Weld0),
    {B, Weld2} = weld(Q, Weld1),
    {{A, B}, Weld2}.

weld({X, Y} = P, #weld{tolerance = Tol, cells = Cells} = Weld) ->
    I = floor(X / Tol),
    J = floor(Y / Tol),
    Near = [V || DI <- [-1, 0, 1], DJ <- [-1, 0, 1], V <- maps:get({I + DI, J + DJ}, Cells, [])],
    case nearest(P, Near, Weld) of
        {D, V} when D =< Tol -> {V, Weld};
        _ -> enter(P, {I, J}, Weld)
    end.

nearest(_P, [], _Weld) ->
    none;
nearest(P, Near, #weld{points = Points}) ->
    lists:min([{starl_geometry:distance(P, maps:get(V, Points)), V} || V <- Near]).

enter(P, Cell, #weld{count = N, points = Points, cells = Cells} = Weld) ->
    V = N + 1,
    Here = maps:get(Cell, Cells, []),
    {V, Weld#weld{count = V, points = Points#{V => P}, cells = Cells#{Cell => [V | Here]}}}.

%% Drops empty edges and all but the first of equal ones.
unique(Edges) ->
    {Unique, _} = lists:foldl(fun first_seen/2, {[], #{}}, Edges),
    lists:reverse(Unique).

first_seen({A, A}, Acc) ->
    Acc;
first_seen({A, B} = Edge, {Edges, Seen}) ->
    Key = {min(A, B), max(A, B)},
    case Seen of
        #{Key := _} -> {Edges, Seen};
        #{} -> {[Edge | Edges], Seen#{Key => true}}
    end.

%%% Cutting

cut_all(Edges, Weld, 0) ->
    {Edges, Weld};
cut_all(Edges, Weld0, Passes) ->
    case find_cuts(Edges, Weld0) of
        too_many -> too_many;
        {Cuts, Weld1} when map_size(Cuts) =:= 0 -> {Edges, Weld1};
        {Cuts, Weld1} -> cut_all(unique(apply_cuts(Edges, Cuts, Weld1)), Weld1, Passes - 1)
    end.

%% The vertices at which each edge, by its place in the list, must be cut.
find_cuts([], Weld) ->
    {#{}, Weld};
find_cuts(Edges, #weld{points = Points, tolerance = Tol} = Weld) ->
    Table = list_to_tuple([line(Edge, Points) || Edge <- Edges]),
    Numbers = lists:seq(1, tuple_size(Table)),
    Empty = starl_grid:new(cell_size(Table, Tol)),
    Enter = fun(N, Acc) -> starl_grid:add(N, segment(N, Table), Acc) end,
    Grid = lists:foldl(Enter, Empty, Numbers),
    find_cuts(1, Table, Grid, {#{}, Weld}).

find_cuts(_N, _Table, _Grid, {_, #weld{count = Count, most = Most}}) when Count > Most ->
    too_many;
find_cuts(N, Table, _Grid, Found) when N > tuple_size(Table) ->
    Found;
find_cuts(N, Table, Grid, {_, #weld{tolerance = Tol}} = Found) ->
    Near = starl_grid:near(segment(N, Table), Tol, Grid),
    Line = element(N, Table),
    Cut = fun(M, Acc) -> cut_pair({N, Line}, {M, element(M, Table)}, Acc) end,
    find_cuts(N + 1, Table, Grid, lists:foldl(Cut, Found, [M || M <- Near, M > N])).

line({A, B}, Points) -> {A, B, {maps:get(A, Points), maps:get(B, Points)}}.

segment(N, Table) -> element(3, element(N, Table)).

%% About the mean length, so that an edge lies in few cells and a cell holds few edges.
cell_size(Table, Tol) ->
    Lengths = [starl_geometry:length(S) || {_, _, S} <- tuple_to_list(Table)],
    max(10.0 * Tol, lists:sum(Lengths) / length(Lengths)).

cut_pair({N, {A, B, S}}, {M, {C, D, T}}, {_, #weld{tolerance = Tol}} = Acc0) ->
    case starl_geometry:closer(S, T, Tol) of
        false ->
            Acc0;
        true ->
            {P, Q} = S,
            {X, Y} = T,
            Ends = [
                {N, {A, B, S}, C, X},
                {N, {A, B, S}, D, Y},
                {M, {C, D, T}, A, P},
                {M, {C, D, T}, B, Q}
            ],
            Touch = fun({I, Line, V, Place}, Acc) -> touch(I, Line, V, Place, Acc) end,
            Acc1 = lists:foldl(Touch, Acc0, Ends),
            cross({N, {A, B, S}}, {M, {C, D, T}}, Acc1)
    end.

%% Vertex V lies on the line, and is not one of its ends.
touch(N, {A, B, S}, V, P, {Cuts, #weld{tolerance = Tol} = Weld}) ->
    case V =/= A andalso V =/= B andalso starl_geometry:point_segment(P, S) =< Tol of
        true -> {cut(N, V, Cuts), Weld};
        false -> {Cuts, Weld}
    end.

cross({N, {A, B, S}}, {M, {C, D, T}}, {Cuts, Weld0}) ->
    case
        A =/= C andalso A =/= D andalso B =/= C andalso B =/= D andalso
            starl_geometry:intersection(S, T)
    of
        {proper, P} ->
            {V, Weld1} = weld(P, Weld0),
            {cut_inside(M, V, {C, D}, cut_inside(N, V, {A, B}, Cuts)), Weld1};
        _ ->
            {Cuts, Weld0}
    end.

cut_inside(_N, V, {A, B}, Cuts) when V =:= A; V =:= B -> Cuts;
cut_inside(N, V, _Ends, Cuts) -> cut(N, V, Cuts).

cut(N, V, Cuts) -> Cuts#{N => [V | maps:get(N, Cuts, [])]}.

apply_cuts(Edges, Cuts, #weld{points = Points}) ->
    Numbered = lists:zip(lists:seq(1, length(Edges)), Edges),
    lists:append([pieces(Edge, maps:get(N, Cuts, []), Points) || {N, Edge} <- Numbered]).

pieces(Edge, [], _Points) ->
    [Edge];
pieces({A, B}, Vertices, Points) ->
    P = maps:get(A, Points),
    Q = maps:get(B, Points),
    Sorted = lists:usort([{along(P, Q, maps:get(V, Points)), V} || V <- Vertices]),
    chain([A | [V || {_, V} <- Sorted]] ++ [B]).

along({AX, AY}, {BX, BY}, {X, Y}) -> (X - AX) * (BX - AX) + (Y - AY) * (BY - AY).

chain([A, B | Rest]) -> [{A, B} | chain([B | Rest])];
chain([_]) -> [].

%%% Dots

%% The first line at each vertex that has no edge, though its ends are one vertex.
dots(Drawn, Edges, Weld) ->
    Used = maps:from_list([{V, true} || {A, B} <- Edges, V <- [A, B]]),
    {Dots, _, Last} = lists:foldl(fun dot/2, {[], Used, Weld}, Drawn),
    {Edges ++ lists:reverse(Dots), Last}.

dot({{V, V}, {P, Q}}, {Dots, Used, #weld{count = N, points = Points} = Weld}) when
    P =/= Q, not is_map_key(V, Used)
->
    Place = map_get(V, Points),
    {_, End} = max({starl_geometry:distance(Place, P), P}, {starl_geometry:distance(Place, Q), Q}),
    Next = Weld#weld{count = N + 1, points = Points#{N + 1 => End}},
    {[{V, N + 1} | Dots], Used#{V => true}, Next};
dot(_Line, Acc) ->
    Acc.

%%% Dividing

divide(Edges, #weld{points = Points, count = N}, MaxLength) ->
    Start = {[], [], N},
    Divide = fun(Edge, Acc) -> divide_edge(Edge, Points, MaxLength, Acc) end,
    {Pieces, Extra, _} = lists:foldl(Divide, Start, Edges),
    #{
        vertices => [maps:get(V, Points) || V <- lists:seq(1, N)] ++ lists:reverse(Extra),
        edges => lists:reverse(Pieces)
    }.

divide_edge({A, B}, Points, MaxLength, {Pieces, Extra, N}) ->
    P = maps:get(A, Points),
    Q = maps:get(B, Points),
    case parts(starl_geometry:distance(P, Q), MaxLength) of
        1 ->
            {[{A, B} | Pieces], Extra, N};
        K ->
            Inner = [starl_geometry:interpolate(P, Q, I / K) || I <- lists:seq(1, K - 1)],
            New = chain([A | lists:seq(N + 1, N + K - 1)] ++ [B]),
            {lists:reverse(New, Pieces), lists:reverse(Inner, Extra), N + K - 1}
    end.

parts(_Length, infinity) -> 1;
parts(Length, MaxLength) -> max(1, ceil(Length / MaxLength - 1.0e-9)).
