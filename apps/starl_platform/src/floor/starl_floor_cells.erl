%% @doc A floor plan of square cells: outlines of solid cells, rooms that are flooded from a cell,
%% doors.
%%
%% A cell is `{Column, Row}' from the lower left corner. All is computed in whole numbers and scaled
%% at the very end, so neighbours share their corners exactly. Two solid cells that touch in a
%% corner only are outlined separately: no body fits through there.
-module(starl_floor_cells).

-export([walls/2, outlines/1, room/3, door/3, centre/2]).

-export_type([cell/0, cells/0]).

-type cell() :: {Column :: integer(), Row :: integer()}.
-type cells() :: #{cell() => any()}.
-type corner() :: {X :: integer(), Y :: integer()}.

%% @doc The walls around these cells, each `ScaleMm' wide.
-spec walls(cells(), ScaleMm :: number()) -> [starl_floor:polygon()].
walls(Solid, Scale) ->
    [[scaled(Corner, Scale) || Corner <- Outline] || Outline <- outlines(Solid)].

scaled({X, Y}, Scale) -> {float(X * Scale), float(Y * Scale)}.

%% @doc The middle of a cell.
-spec centre(cell(), ScaleMm :: number()) -> starl_geometry:point().
centre({X, Y}, Scale) -> {(X + 0.5) * Scale, (Y + 0.5) * Scale}.

%% @doc The outlines of a set of cells, with the cells to the left: counter-clockwise around,
%% clockwise around holes. The signed areas sum to the number of cells.
-spec outlines(cells()) -> [[corner(), ...]].
outlines(Solid) ->
    Edges = [Edge || Cell <- lists:sort(maps:keys(Solid)), Edge <- edges(Cell, Solid)],
    Starts = maps:groups_from_list(fun({From, _}) -> From end, fun({_, To}) -> To end, Edges),
    chains([From || {From, _} <- Edges], Starts, []).

edges({X, Y}, Solid) ->
    [
        Edge
     || {Beside, Edge} <- [
            {{X, Y - 1}, {{X, Y}, {X + 1, Y}}},
            {{X + 1, Y}, {{X + 1, Y}, {X + 1, Y + 1}}},
            {{X, Y + 1}, {{X + 1, Y + 1}, {X, Y + 1}}},
            {{X - 1, Y}, {{X, Y + 1}, {X, Y}}}
        ],
        not is_map_key(Beside, Solid)
    ].

chains([], _Starts, Outlines) ->
    lists:reverse(Outlines);
chains([From | Froms], Starts, Outlines) ->
    case Starts of
        #{From := [To | _]} ->
            {Outline, Left} = chain(From, To, [From], taken(From, To, Starts), From),
            chains(Froms, Left, [straightened(Outline) | Outlines]);
        #{} ->
            chains(Froms, Starts, Outlines)
    end.

chain(_From, First, Corners, Starts, First) ->
    {lists:reverse(Corners), Starts};
chain(From, At, Corners, Starts, First) ->
    #{At := Tos} = Starts,
    To = leftmost(From, At, Tos),
    chain(At, To, [At | Corners], taken(At, To, Starts), First).

taken(From, To, Starts) ->
    case lists:delete(To, maps:get(From, Starts)) of
        [] -> maps:remove(From, Starts);
        Others -> Starts#{From := Others}
    end.

%% To the left it stays with the same cell.
leftmost(_From, _At, [To]) ->
    To;
leftmost({FX, FY}, {AX, AY}, Tos) ->
    {LX, LY} = {AX - (AY - FY), AY + (AX - FX)},
    hd([To || To <- Tos, To =:= {LX, LY}] ++ Tos).

%% Only the corners where it turns.
straightened([First | _] = Corners) -> turns(lists:last(Corners), Corners ++ [First]).

turns({AX, AY}, [{BX, BY} = B, {CX, CY} = C | Rest]) ->
    case (BX - AX) * (CY - BY) =:= (BY - AY) * (CX - BX) of
        true -> turns(B, [C | Rest]);
        false -> [B | turns(B, [C | Rest])]
    end;
turns(_, [_]) ->
    [].

%% The free cells that can be reached from a cell, over sides, where `IsFree' accepts them.
-spec flood(cell(), fun((cell()) -> boolean())) -> cells().
flood(Cell, IsFree) -> flood([Cell], IsFree, #{Cell => true}).

flood([], _IsFree, Seen) ->
    Seen;
flood([{X, Y} | Rest], IsFree, Seen) ->
    New = [
        Cell
     || Cell <- [{X + 1, Y}, {X - 1, Y}, {X, Y + 1}, {X, Y - 1}],
        not is_map_key(Cell, Seen),
        IsFree(Cell)
    ],
    flood(New ++ Rest, IsFree, maps:merge(Seen, maps:from_list([{Cell, true} || Cell <- New]))).

%% @doc The polygon of the room around a cell: its outer outline.
-spec room(cell(), fun((cell()) -> boolean()), ScaleMm :: number()) -> starl_floor:polygon().
room(Cell, IsFree, Scale) ->
    Outlines = walls(flood(Cell, IsFree), Scale),
    {_, Outer} = lists:max([{starl_floor:area(Outline), Outline} || Outline <- Outlines]),
    Outer.

%% @doc The line that closes a door of these cells, which lie in one row or column.
-spec door([cell(), ...], IsWall :: fun((cell()) -> boolean()), ScaleMm :: number()) ->
    starl_geometry:segment().
door([{X0, Y0} | _] = Cells, IsWall, Scale) ->
    {X1, Y1} = lists:last(Cells),
    case Y0 =:= Y1 andalso (X0 < X1 orelse (IsWall({X0 - 1, Y0}) andalso IsWall({X1 + 1, Y0}))) of
        true -> {scaled({X0, Y0 + 0.5}, Scale), scaled({X1 + 1, Y0 + 0.5}, Scale)};
        false -> {scaled({X0 + 0.5, Y0}, Scale), scaled({X0 + 0.5, Y1 + 1}, Scale)}
    end.
