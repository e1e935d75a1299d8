%% @doc The places of all robots, as a shard knows them: the piece of motion of each robot when the
%% present window began, and a spatial index that finds the robots in range of a place.
%%
%% The index is a grid of cells, as wide as the range, that holds the robots' places at one moment.
%% It does not change when they move: a search covers the range plus the distance that any robot can
%% have moved since, and measures the robots that are neither surely in range nor surely out. A new
%% grid is made when robots may have moved too far, or when the questions asked of the old one would
%% have paid for a new one. An answer never depends on the grid's age.
%%
%% The data lie in a table, not in a term: robots of a shard ask it in the middle of their work, and
%% a robot that kept a term would keep all earlier data. Lengths are millimetres, times
%% microseconds.
-module(starl_sim_sight).

-export([new/2, moved/2, piece/2, pieces/1, within/3]).

-export_type([t/0]).

-type entry() :: {starl:robot_id(), X :: float(), Y :: float()}.
-type cell() :: {Column :: integer(), Row :: integer()}.

%% The rows of the table: pieces by robot, entries by cell, and two more. `fastest' is the
%% highest speed (mm/s) of any piece so far; `grid' holds the time of the grid and the number of
%% questions that it may still answer before a new grid is worth its cost.
-type row() ::
    {starl:robot_id(), starl_trajectory:piece()}
    | {cell(), [entry()]}
    | {fastest, float()}
    | {grid, MadeUs :: starl_sim_queue:time() | none, Left :: integer()}.

-record(sight, {table :: ets:table(), range :: float() | infinity}).

-opaque t() :: #sight{}.

%% A grid is too old when a robot can have moved by this fraction of the range.
-define(STALE, 0.5).
%% A grid of N robots has paid for itself after N / WORTH questions.
-define(WORTH, 4).
%% More than the rounding errors of a position, mm.
-define(HAIR_MM, 1.0e-3).

%% @doc The index of these robots, for questions about this range.
-spec new([{starl:robot_id(), starl_trajectory:piece()}], RangeMm :: float() | infinity) -> t().
new(Pieces, Range) ->
    Table = ets:new(starl_sim_sight, [set, private]),
    true = ets:insert(Table, [{fastest, 0.0}, {grid, none, 0}]),
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
    Slack = slack(Now, Sight),
    lists:sort(search(Point, Now, Slack, Sight)).

%% The distance that robots can have moved since the grid was made.
slack(Now, #sight{table = Table, range = Range} = Sight) ->
    [{grid, Made, Left}] = ets:lookup(Table, grid),
    Slack = come(Made, Now, ets:lookup_element(Table, fastest, 2)),
    case Slack =< 0.0 orelse (Left > 0 andalso Slack =< ?STALE * Range) of
        true ->
            true = ets:update_element(Table, grid, {3, Left - 1}),
            Slack;
        false ->
            ok = make_grid(Now, Sight),
            0.0
    end.

%% An atom is larger than any number.
come(none, _Now, _Fastest) -> infinity;
come(Made, Now, Fastest) -> Fastest * (Now - Made) / 1.0e6.

make_grid(Now, #sight{table = Table, range = Range} = Sight) ->
    Entries = [entered(Id, Piece, Now, Range) || {Id, Piece} <- pieces(Sight)],
    true = ets:match_delete(Table, {{'_', '_'}, '_'}),
    true = ets:insert(Table, cells(lists:keysort(1, Entries))),
    true = ets:insert(Table, {grid, Now, length(Entries) div ?WORTH}),
    ok.

entered(Id, Piece, Now, Range) ->
    {X, Y} = starl_trajectory:position(Now, Piece),
    {{floor(X / Range), floor(Y / Range)}, {Id, X, Y}}.

-spec cells([{cell(), entry()}]) -> [row()].
cells([]) -> [];
cells([{Cell, Entry} | Rest]) -> cells(Rest, Cell, [Entry]).

cells([{Cell, Entry} | Rest], Cell, Entries) -> cells(Rest, Cell, [Entry | Entries]);
cells(Rest, Cell, Entries) -> [{Cell, Entries} | cells(Rest)].

search({X, Y} = Point, Now, Slack, #sight{range = Range} = Sight) ->
    Reach = Range + Slack + ?HAIR_MM,
    Rows = lists:seq(floor((Y - Reach) / Range), floor((Y + Reach) / Range)),
    [
        Id
     || Column <- lists:seq(floor((X - Reach) / Range), floor((X + Reach) / Range)),
        Row <- Rows,
        {Id, X1, Y1} <- entries({Column, Row}, Sight),
        is_within((X1 - X) * (X1 - X) + (Y1 - Y) * (Y1 - Y), Slack, Id, Point, Now, Sight)
    ].

entries(Cell, #sight{table = Table}) ->
    case ets:lookup(Table, Cell) of
        [{_, Entries}] -> Entries;
        [] -> []
    end.

%% Decides by the squared distance in the grid; measures where that is not enough.
is_within(Square, Slack, Id, Point, Now, #sight{range = Range} = Sight) ->
    Out = Range + Slack + ?HAIR_MM,
    In = Range - Slack - ?HAIR_MM,
    if
        Square > Out * Out -> false;
        In > 0, Square < In * In -> true;
        true -> measured(Id, Point, Now, Sight)
    end.

measured(Id, Point, Now, #sight{range = Range} = Sight) ->
    {ok, Piece} = piece(Id, Sight),
    starl_geometry:distance(Point, starl_trajectory:position(Now, Piece)) =< Range.
