%% @doc A spatial index: stores keys with a place on the floor and finds them by their place.
%%
%% The plane is cut into square cells; a key is listed in every cell that its segment passes
%% through or its box covers. A query answers with candidates, every key whose shape is within the
%% radius and perhaps some that are a little farther away; the caller measures. A cell size of
%% about the usual query radius is a good choice. Lengths are millimetres.
-module(starl_grid).

-export([new/1, add/3, remove/3, near/3]).
-export_type([t/1, shape/0]).

-type shape() :: starl_geometry:segment() | starl_geometry:box().
-type cell() :: integer().
%% Column and row in one number, which is found faster than a pair. If two cells ever have the same
%% number, both hold more candidates, and answers stay correct.

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

%% @doc Enters a key. A key may be entered with several shapes.
-spec add(Key, shape(), t(Key)) -> t(Key).
add(Key, Shape, #grid{size = Size, cells = Cells} = Grid) ->
    Enter = fun(Cell, Acc) ->
        case Acc of
            #{Cell := Keys} -> Acc#{Cell := [Key | Keys]};
            #{} -> Acc#{Cell => [Key]}
        end
    end,
    Grid#grid{cells = lists:foldl(Enter, Cells, covered(Shape, 0.0, Size))}.

%% @doc Removes a key that was entered with this shape. Unknown keys change nothing.
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

%%% Internals

%% The cells within Radius of the shape, and some more at its corners.
covered({{_, _}, {_, _}} = Segment, Radius, Size) ->
    {X0, Y0, X1, Y1} = starl_geometry:box(Segment),
    First = index(X0 - Radius, Size),
    case index(X1 + Radius, Size) of
        First -> rows(First, index(Y0 - Radius, Size), index(Y1 + Radius, Size), []);
        Last -> columns(First, Last, {X0, X1}, Segment, Radius, Size)
    end;
covered({X0, Y0, X1, Y1}, Radius, Size) ->
    Low = index(Y0 - Radius, Size),
    High = index(Y1 + Radius, Size),
    block(index(X0 - Radius, Size), index(X1 + Radius, Size), Low, High).

block(I, Last, _Low, _High) when I > Last -> [];
block(I, Last, Low, High) -> rows(I, Low, High, block(I + 1, Last, Low, High)).

rows(I, Low, High, Cells) -> numbers(I bsl 32 + Low, I bsl 32 + High, Cells).

numbers(N, High, Cells) when N > High -> Cells;
numbers(N, High, Cells) -> [N | numbers(N + 1, High, Cells)].

columns(I, Last, _Span, _Segment, _Radius, _Size) when I > Last ->
    [];
columns(I, Last, Span, Segment, Radius, Size) ->
    {Low, High} = column(I, Span, Segment, Radius, Size),
    rows(I, Low, High, columns(I + 1, Last, Span, Segment, Radius, Size)).

%% Only the part of the segment that is within Radius of the column reaches cells of it.
column(I, Span, {{AX, AY}, {BX, BY}}, Radius, Size) when AX /= BX ->
    Slope = fun(X) -> AY + (BY - AY) * ((X - AX) / (BX - AX)) end,
    Y0 = Slope(clamp(I * Size - Radius, Span)),
    Y1 = Slope(clamp((I + 1) * Size + Radius, Span)),
    %% A hair more than the radius: the clipped ends carry rounding errors.
    rows_near(Y0, Y1, Radius + 1.0e-6, Size);
column(_I, _Span, {{_, AY}, {_, BY}}, Radius, Size) ->
    rows_near(AY, BY, Radius + 1.0e-6, Size).

rows_near(Y0, Y1, Slack, Size) when Y0 =< Y1 ->
    {index(Y0 - Slack, Size), index(Y1 + Slack, Size)};
rows_near(Y0, Y1, Slack, Size) ->
    {index(Y1 - Slack, Size), index(Y0 + Slack, Size)}.

clamp(X, {X0, _X1}) when X < X0 -> X0;
clamp(X, {_X0, X1}) when X > X1 -> X1;
clamp(X, _Span) -> X.

index(X, Size) -> floor(X / Size).
