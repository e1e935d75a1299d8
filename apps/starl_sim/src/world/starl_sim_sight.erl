%% @doc The positions of all robots, as a shard knows them. It holds the motion segment of each
%% robot at the beginning of the present window. Spatial indices find the robots in range of a
%% place, or near it.
%%
%% An index is a grid of cells that holds the robots' places at one moment. A cell is as wide as the
%% range, or one metre for searches near a place. The grid does not change when robots move: a
%% search covers the range plus the distance that any robot can have moved since, and measures the
%% robots that are neither surely in range nor surely out. A new grid is made when robots may have
%% moved too far, or when the searches in the old grid would have paid for a new one. An answer
%% never depends on the grid's age.
%%
%% The data lie in a table, not in a term, because robots of a shard read them in the middle of
%% their work, and a robot that kept a term would keep all earlier data. Lengths are in millimetres,
%% times in microseconds.
-module(starl_sim_sight).

-export([new/2, moved/2, piece/2, pieces/1, within/3, near/4]).

-export_type([t/0]).

-type entry() :: {starl:robot_id(), X :: float(), Y :: float()}.
-type grid() :: range | near.
-type cell() :: {grid(), Column :: integer(), Row :: integer()}.

%% The rows of the table: pieces by robot, entries by cell, and some more. `fastest' is the
%% highest speed (mm/s) of any piece so far; `grid' holds the time of a grid and the number of
%% questions that it may still answer before a new grid is worth its cost.
-type row() ::
    {starl:robot_id(), starl_trajectory:piece()}
    | {cell(), [entry()]}
    | {fastest, float()}
    | {{grid, grid()}, MadeUs :: starl_sim_queue:time() | none, Left :: integer()}.

-record(sight, {table :: ets:table(), range :: float() | infinity}).

-opaque t() :: #sight{}.

%% A grid is too old when a robot can have moved by this fraction of the range.
-define(STALE, 0.5).
-define(NEAR_CELL_MM, 1000.0).
%% A grid of N robots has paid for itself after N / WORTH questions.
-define(WORTH, 4).
%% More than the rounding errors of a position, mm.
-define(HAIR_MM, 1.0e-3).

%% @doc The index of these robots, for questions about this range.
-spec new([{starl:robot_id(), starl_trajectory:piece()}], RangeMm :: float() | infinity) -> t().
new(Pieces, Range) ->
    Table = ets:new(starl_sim_sight, [set, private]),
    true = ets:insert(Table, [{fastest, 0.0}, {{grid, range}, none, 0}, {{grid, near}, none, 0}]),
    Sight = #sight{table = Table, range = Range},
    ok = moved(Pieces, Sight),
    Sight.

%% @doc Sets new pieces of motion of these robots, which go on from their places.
-spec moved([{starl:robot_id(), starl_trajectory:piece()}], t()) -> ok.
moved([], _Sight) ->
    ok;
moved(Pieces, #sight{table = Table}) ->
    Fastest = lists:max([
        ets:lookup_element(Table, fastest, 2) | [starl_trajectory:fastest(P) || {_, P} <- Pieces]
    ]),
    true = ets:insert(Table, [{fastest, Fastest} | Pieces]),
    ok.

%% @doc The piece that a robot is in.
-spec piece(starl:robot_id(), t()) -> {ok, starl_trajectory:piece()} | unknown.
piece(Robot, #sight{table = Table}) ->
    case ets:lookup(Table, Robot) of
        [{_, Piece}] -> {ok, Piece};
        [] -> unknown
    end.

%% @doc The pieces of all robots, in no order.
-spec pieces(t()) -> [{starl:robot_id(), starl_trajectory:piece()}].
pieces(#sight{table = Table}) ->
    ets:select(Table, [{{'$1', '$2'}, [{is_integer, '$1'}], ['$_']}]).

%% @doc The robots within the range of a point at a time, ascending. The times of
%% successive questions never decrease.
-spec within(starl_geometry:point(), starl_sim_queue:time(), t()) -> [starl:robot_id()].
within(Point, Now, #sight{range = Range} = Sight) when is_float(Range) ->
    asked({range, Range}, Range, Point, Now, Sight).

%% @doc The robots within this distance of a point at a time, ascending; likewise.
-spec near(starl_geometry:point(), Mm :: float(), starl_sim_queue:time(), t()) ->
    [starl:robot_id()].
near(Point, Mm, Now, Sight) -> asked({near, ?NEAR_CELL_MM}, Mm, Point, Now, Sight).

asked(Grid, Range, Point, Now, Sight) ->
    Slack = slack(Grid, Now, Sight),
    lists:sort(search(Grid, Range, Point, Now, Slack, Sight)).

%% The distance that robots can have moved since the grid was made.
slack({Name, Cell} = Grid, Now, #sight{table = Table} = Sight) ->
    [{_, Made, Left}] = ets:lookup(Table, {grid, Name}),
    Slack = come(Made, Now, ets:lookup_element(Table, fastest, 2)),
    case Slack =< 0.0 orelse (Left > 0 andalso Slack =< ?STALE * Cell) of
        true ->
            true = ets:update_element(Table, {grid, Name}, {3, Left - 1}),
            Slack;
        false ->
            ok = make_grid(Grid, Now, Sight),
            0.0
    end.

%% An atom is larger than any number.
come(none, _Now, _Fastest) -> infinity;
come(Made, Now, Fastest) -> Fastest * (Now - Made) / 1.0e6.

make_grid({Name, _} = Grid, Now, #sight{table = Table} = Sight) ->
    Entries = [entered(Id, Piece, Now, Grid) || {Id, Piece} <- pieces(Sight)],
    true = ets:match_delete(Table, {{Name, '_', '_'}, '_'}),
    true = ets:insert(Table, cells(lists:keysort(1, Entries))),
    true = ets:insert(Table, {{grid, Name}, Now, length(Entries) div ?WORTH}),
    ok.

entered(Id, Piece, Now, {Name, Cell}) ->
    {X, Y} = starl_trajectory:position(Now, Piece),
    {{Name, floor(X / Cell), floor(Y / Cell)}, {Id, X, Y}}.

-spec cells([{cell(), entry()}]) -> [row()].
cells([]) -> [];
cells([{Cell, Entry} | Rest]) -> cells(Rest, Cell, [Entry]).

cells([{Cell, Entry} | Rest], Cell, Entries) -> cells(Rest, Cell, [Entry | Entries]);
cells(Rest, Cell, Entries) -> [{Cell, Entries} | cells(Rest)].

search({Name, Cell}, Range, {X, Y} = Point, Now, Slack, Sight) ->
    Reach = Range + Slack + ?HAIR_MM,
    Rows = lists:seq(floor((Y - Reach) / Cell), floor((Y + Reach) / Cell)),
    [
        Id
     || Column <- lists:seq(floor((X - Reach) / Cell), floor((X + Reach) / Cell)),
        Row <- Rows,
        {Id, X1, Y1} <- entries({Name, Column, Row}, Sight),
        is_within((X1 - X) * (X1 - X) + (Y1 - Y) * (Y1 - Y), Slack, Id, {Point, Range}, Now, Sight)
    ].

entries(Cell, #sight{table = Table}) ->
    case ets:lookup(Table, Cell) of
        [{_, Entries}] -> Entries;
        [] -> []
    end.

%% Decides by the squared distance in the grid; measures where that is not enough.
is_within(Square, Slack, Id, {Point, Range}, Now, Sight) ->
    Out = Range + Slack + ?HAIR_MM,
    In = Range - Slack - ?HAIR_MM,
    if
        Square > Out * Out -> false;
        In > 0, Square < In * In -> true;
        true -> measured(Id, Point, Range, Now, Sight)
    end.

measured(Id, Point, Range, Now, Sight) ->
    {ok, Piece} = piece(Id, Sight),
    starl_geometry:distance(Point, starl_trajectory:position(Now, Piece)) =< Range.
