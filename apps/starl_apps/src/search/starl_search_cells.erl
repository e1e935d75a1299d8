%% @doc The floor to search: a grid of cells, each with a place where a ball can lie. It covers all
%% free floor on which a ball has room, whether robots can get there or not. If a plan names rooms,
%% floor that is in none of them and closed off from all of them counts as outside of the building.
%% Lengths are millimetres.
-module(starl_search_cells).

-export([new/2, place/3, has/2, draw/3, middle/1, cell/2, beside/1, m2/1]).

-export_type([t/0, cell/0]).

%% Row and column in one number.
-type cell() :: non_neg_integer().

-type t() :: #{cell() => starl_geometry:point()}.

-define(PITCH_MM, 100.0).
%% Rows of the grid are so far apart in the numbers of cells.
-define(ROW, 65536).
%% The places that are drawn before the floor counts as full.
-define(DRAWS, 100000).

%% @doc The floor for a ball of this radius.
-spec new(starl_floor:t(), BallMm :: float()) -> t().
new(#{size := {W, H}, rooms := Rooms} = Floor, Ball) ->
    Walls = starl_walls:new(Floor),
    Free = maps:from_list([
        {Cell, At}
     || J <- lists:seq(0, trunc(H / ?PITCH_MM)),
        I <- lists:seq(0, trunc(W / ?PITCH_MM)),
        Cell <- [cell(I, J)],
        {ok, At} <- [place(Cell, Ball, Walls)]
    ]),
    case map_size(Rooms) of
        0 -> Free;
        _ -> maps:with(inside(lists:sort(maps:keys(Free)), Free, Floor), Free)
    end.

%% @doc Where a ball can lie in a cell: in the middle, or beside the nearest wall.
-spec place(cell(), BallMm :: float(), starl_walls:t()) -> {ok, starl_geometry:point()} | none.
place(Cell, Ball, Walls) ->
    P = middle(Cell),
    Near = Ball - ?PITCH_MM * math:sqrt(0.5),
    case not starl_walls:is_solid(P, Walls) andalso starl_walls:clearance({P, P}, Ball, Walls) of
        false -> none;
        Mm when Mm >= Ball -> {ok, P};
        Mm when Mm < Near -> none;
        Mm -> beside_wall(away(P, Mm, Ball, Walls), Ball, Walls)
    end.

beside_wall(P, Ball, Walls) ->
    case starl_walls:is_free({P, P}, Ball - 1.0, Walls) of
        true -> {ok, P};
        false -> none
    end.

away(P, Mm, Ball, Walls) ->
    {_, At} = lists:min([
        {starl_geometry:distance(P, Q), Q}
     || {_, Side} <- starl_walls:near({P, P}, Ball, Walls),
        Q <- [starl_geometry:closest_point(P, Side)]
    ]),
    starl_geometry:interpolate(At, P, Ball / Mm).

%% The connected parts that have a part of a room.
inside([], _Left, _Floor) ->
    [];
inside([Cell | Cells], Left, Floor) when is_map_key(Cell, Left) ->
    Part = spread([Cell], maps:remove(Cell, Left), [Cell]),
    IsRoom = fun(C) -> starl_floor:room_at(maps:get(C, Left), Floor) =/= none end,
    [C || lists:any(IsRoom, Part), C <- Part] ++ inside(Cells, maps:without(Part, Left), Floor);
inside([_ | Cells], Left, Floor) ->
    inside(Cells, Left, Floor).

spread([], _Left, Part) ->
    Part;
spread([Cell | Cells], Left, Part) ->
    New = [Next || Next <- beside(Cell), is_map_key(Next, Left)],
    spread(New ++ Cells, maps:without(New, Left), New ++ Part).

%% @doc Does this place belong to the floor?
-spec has(starl_geometry:point(), t()) -> boolean().
has({X, Y}, Cells) ->
    Cell = cell(floor(X / ?PITCH_MM), floor(Y / ?PITCH_MM)),
    lists:any(fun(C) -> is_map_key(C, Cells) end, [Cell | beside(Cell)]).

%% @doc A place for a ball, anywhere on the floor, drawn from a seed.
-spec draw(Seed :: term(), BallMm :: float(), starl_floor:t()) ->
    {ok, starl_geometry:point()} | none.
draw(Seed, Ball, Floor) ->
    Cells = new(Floor, Ball),
    case map_size(Cells) of
        0 -> none;
        _ -> draw(?DRAWS, Seed, Ball, Floor, starl_walls:new(Floor), Cells)
    end.

draw(0, _Seed, _Ball, _Floor, _Walls, _Cells) ->
    none;
draw(N, Seed, Ball, #{size := {W, H}} = Floor, Walls, Cells) ->
    P = {W * part({Seed, x, N}), H * part({Seed, y, N})},
    case starl_walls:is_free({P, P}, Ball, Walls) andalso has(P, Cells) of
        true -> {ok, P};
        false -> draw(N - 1, Seed, Ball, Floor, Walls, Cells)
    end.

part(Key) -> erlang:phash2(Key, 1 bsl 24) / (1 bsl 24).

%% @doc The middle of a cell.
-spec middle(cell()) -> starl_geometry:point().
middle(Cell) -> {(Cell rem ?ROW + 0.5) * ?PITCH_MM, (Cell div ?ROW + 0.5) * ?PITCH_MM}.

%% @doc The cell in a column and a row.
-spec cell(Column :: non_neg_integer(), Row :: non_neg_integer()) -> cell().
cell(I, J) when is_integer(I), is_integer(J) -> J * ?ROW + I.

%% @doc The cells that touch a cell.
-spec beside(cell()) -> [integer()].
beside(Cell) -> [Cell + 1, Cell + ?ROW, Cell - 1, Cell - ?ROW].

%% @doc The area of so many cells, m2.
-spec m2(non_neg_integer()) -> float().
m2(Cells) -> Cells * ?PITCH_MM * ?PITCH_MM / 1.0e6.
