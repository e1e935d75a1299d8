%% The floor plans on which the search is accepted (`config/scenarios/plans'), as they were made, in the
%% manner of the MovingAI benchmarks: a maze (maze-128-128-10) and rooms with doors (room-64-64-16,
%% wider). `write/0' writes them anew.
-module(starl_search_plans).

-export([maze/0, rooms/0, file/1, write/0]).

-define(CELLS, 128).

%% Corridors ten cells wide: from each place there is one way to each other one.
maze() ->
    {Tree, _} = tree(10, rand:seed_s(exsss, 1)),
    map(10, Tree, []).

%% Rooms of 15 x 15 cells, doors of four: all can be reached, many by several ways.
rooms() ->
    {Tree, Random} = tree(15, rand:seed_s(exsss, 2)),
    {Doors, _} = lists:mapfoldl(fun door/2, Random, edges(15)),
    map(15, [], [Door || {Edge, Door, Part} <- Doors, lists:member(Edge, Tree) orelse Part < 0.3]).

door(Edge, Random0) ->
    {Offset, Random1} = rand:uniform_s(15 - 4 - 2, Random0),
    {Part, Random} = rand:uniform_s(Random1),
    {{Edge, {Edge, Offset + 1, 4}, Part}, Random}.

file(Plan) ->
    Root = hd(string:split(code:which(?MODULE), "/_build/")),
    filename:join([Root, "config", "scenarios", "plans", atom_to_list(Plan) ++ ".map"]).

write() -> [ok = file:write_file(file(Plan), ?MODULE:Plan()) || Plan <- [maze, rooms]].

%% -- a lattice of squares, walls one cell thick between them ------------------------------------

count(Wide) -> (?CELLS - 1) div (Wide + 1).

squares(Wide) -> [{I, J} || I <- lists:seq(0, count(Wide) - 1), J <- lists:seq(0, count(Wide) - 1)].

edges(Wide) ->
    [
        {{I, J}, {I + A, J + B}}
     || {I, J} <- squares(Wide),
        {A, B} <- [{1, 0}, {0, 1}],
        I + A < count(Wide),
        J + B < count(Wide)
    ].

%% A way through all squares, depth first.
tree(Wide, Random) -> tree([{0, 0}], #{{0, 0} => true}, [], count(Wide), Random).

tree([], _Seen, Tree, _N, Random) ->
    {Tree, Random};
tree([{I, J} = At | Back], Seen, Tree, N, Random0) ->
    case
        [
            To
         || {X, Y} = To <- [{I + 1, J}, {I - 1, J}, {I, J + 1}, {I, J - 1}],
            min(X, Y) >= 0,
            max(X, Y) < N,
            not is_map_key(To, Seen)
        ]
    of
        [] ->
            tree(Back, Seen, Tree, N, Random0);
        New ->
            {K, Random} = rand:uniform_s(length(New), Random0),
            To = lists:nth(K, New),
            Edge = {min(At, To), max(At, To)},
            tree([To, At | Back], Seen#{To => true}, [Edge | Tree], N, Random)
    end.

map(Wide, Open, Doors) ->
    All = [{Edge, 0, Wide} || Edge <- Open] ++ Doors,
    Free = maps:from_list([
        {Cell, true}
     || Cell <-
            [C || Square <- squares(Wide), C <- inside(Square, Wide)] ++
                [C || Door <- All, C <- gap(Door, Wide)]
    ]),
    Cells = lists:seq(0, ?CELLS - 1),
    Rows = [[[char(is_map_key({X, Y}, Free)) || X <- Cells], $\n] || Y <- Cells],
    Size = integer_to_list(?CELLS),
    iolist_to_binary(["type octile\nheight ", Size, "\nwidth ", Size, "\nmap\n", Rows]).

char(true) -> $.;
char(false) -> $@.

inside({I, J}, Wide) ->
    [
        {1 + I * (Wide + 1) + X, 1 + J * (Wide + 1) + Y}
     || X <- lists:seq(0, Wide - 1), Y <- lists:seq(0, Wide - 1)
    ].

gap({{{I, J}, {K, L}}, From, Width}, Wide) ->
    {X, Y} = {1 + I * (Wide + 1), 1 + J * (Wide + 1)},
    [
        case K > I of
            true -> {X + Wide, Y + D};
            false when L > J -> {X + D, Y + Wide}
        end
     || D <- lists:seq(From, From + Width - 1)
    ].
