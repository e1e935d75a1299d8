%% @doc A spatial index: keys with a place on the floor, found again by where they are.
%%
%% The plane is cut into square cells; a key is listed in every cell that its segment passes
%% through or its box covers. A query answers with candidates, every key whose shape is within the
%% radius and perhaps some that are a little farther away; the caller measures. A cell size of
%% about the usual query radius is a good choice. Lengths are millimetres.
-module(starl_grid).

-export([new/1, add/3, remove/3, near/3, cells/2]).
-export_type([t/1, shape/0, cell/0]).

-type shape() :: starl_geometry:segment() | starl_geometry:box().
-type cell() :: {Column :: integer(), Row :: integer()}.

-record(grid, {
    size :: float(),
    cells = #{} :: #{cell() => [dynamic_key()]}
}).
-type dynamic_key() :: any().
-opaque t(Key) :: #grid{cells :: #{cell() => [Key]}}.
%% The index of keys of one type.

%% @doc An empty index with cells of the given width.
-spec new(CellMm :: float()) -> t(any()).
new(CellMm) when CellMm > 0 -> #grid{size = float(CellMm)}.

%% @doc Enter a key. A key may be entered with several shapes.
-spec add(Key, shape(), t(Key)) -> t(Key).
add(Key, Shape, #grid{size = Size, cells = Cells} = Grid) ->
    Enter = fun(Cell, Acc) ->
        case Acc of
            #{Cell := Keys} -> Acc#{Cell := [Key | Keys]};
            #{} -> Acc#{Cell => [Key]}
        end
    end,
    Grid#grid{cells = lists:foldl(Enter, Cells, covered(Shape, 0.0, Size))}.

%% @doc Take out a key that was entered with this shape. Unknown keys change nothing.
-spec remove(Key, shape(), t(Key)) -> t(Key).
remove(Key, Shape, #grid{size = Size, cells = Cells} = Grid) ->
    Leave = fun(Cell, Acc) ->
        case lists:delete(Key, maps:get(Cell, Acc, [])) of
            [] -> maps:remove(Cell, Acc);
            Keys -> Acc#{Cell => Keys}
        end
    end,
    Grid#grid{cells = lists:foldl(Leave, Cells, covered(Shape, 0.0, Size))}.

%% @doc The keys that may be within `RadiusMm' of the shape, sorted, each once. Complete: a key
%% that is within the radius is always among them.
-spec near(shape(), RadiusMm :: float(), t(Key)) -> [Key].
near(Shape, RadiusMm, #grid{size = Size, cells = Cells}) ->
    Collect = fun(Cell, Acc) ->
        case Cells of
            #{Cell := Keys} -> Keys ++ Acc;
            #{} -> Acc
        end
    end,
    lists:usort(lists:foldl(Collect, [], covered(Shape, RadiusMm, Size))).

%% @doc The cells that a shape lies in, for users that keep their own table of cells.
-spec cells(shape(), t(any())) -> [cell()].
cells(Shape, #grid{size = Size}) -> covered(Shape, 0.0, Size).

%%% Internals

%% The cells within Radius of the shape, and some more at its corners.
covered({{_, _}, {_, _}} = Segment, Radius, Size) ->
    {X0, _, X1, _} = Box = starl_geometry:box(Segment),
    Columns = lists:seq(index(X0 - Radius, Size), index(X1 + Radius, Size)),
    case Columns of
        [_] -> block(starl_geometry:grow(Box, Radius), Size);
        _ -> lists:append([column(I, Segment, Radius, Size) || I <- Columns])
    end;
covered({_, _, _, _} = Box, Radius, Size) ->
    block(starl_geometry:grow(Box, Radius), Size).

block({X0, Y0, X1, Y1}, Size) ->
    Rows = lists:seq(index(Y0, Size), index(Y1, Size)),
    [{I, J} || I <- lists:seq(index(X0, Size), index(X1, Size)), J <- Rows].

%% Only the part of the segment that is within Radius of the column reaches cells of it.
column(I, {{AX, AY}, {BX, BY}}, Radius, Size) ->
    From = I * Size - Radius,
    To = (I + 1) * Size + Radius,
    Y0 = at(clamp(From, AX, BX), AX, AY, BX, BY),
    Y1 = at(clamp(To, AX, BX), AX, AY, BX, BY),
    {Low, High} = range(AX == BX, {Y0, Y1}, {AY, BY}),
    %% A hair more than the radius: the clipped ends carry rounding errors.
    Slack = Radius + 1.0e-6,
    [{I, J} || J <- lists:seq(index(Low - Slack, Size), index(High + Slack, Size))].

range(true, _Clipped, {AY, BY}) -> {min(AY, BY), max(AY, BY)};
range(false, {Y0, Y1}, _Ends) -> {min(Y0, Y1), max(Y0, Y1)}.

clamp(X, AX, BX) -> max(min(X, max(AX, BX)), min(AX, BX)).

at(_X, AX, AY, BX, _BY) when AX == BX -> AY;
at(X, AX, AY, BX, BY) -> AY + (BY - AY) * ((X - AX) / (BX - AX)).

index(X, Size) -> floor(X / Size).
