%% @doc Where all robots are, as a shard knows it: the piece of motion that each was in when the
%% present window began, and a spatial index over them for those in range of a place.
%%
%% The index is a grid of cells, as wide as the range, that holds where the robots were at one
%% moment. It is not touched when they move: it is searched within the range and how far any can
%% have come since, and who is neither surely in nor surely out is measured. A new grid is made
%% when robots have come too far, or when so many questions were asked of the old one that the
%% new one pays for itself. An answer never depends on the grid's age.
%%
%% A table and not a term: robots of a shard ask it in the middle of their work, and who kept a
%% term would keep all that was ever known. Lengths are millimetres, times microseconds.
-module(starl_sim_sight).

-export([new/2, moved/2, piece/2, within/3]).

-export_type([t/0]).

-type entry() :: {starl:robot_id(), X :: float(), Y :: float()}.
-type cell() :: {Column :: integer(), Row :: integer()}.

%% The rows of the table: pieces by robot, entries by cell, and two more. `fastest' is the
%% highest speed (mm/s) of any piece so far; `grid' says when the grid was made and how many
%% questions it may answer yet before another is worth while.
-type row() ::
    {starl:robot_id(), starl_trajectory:piece()}
    | {cell(), [entry()]}
    | {fastest, float()}
    | {grid, MadeUs :: starl_sim_queue:time() | none, Left :: integer()}.

-record(sight, {table :: ets:table(), range :: float() | infinity}).

-opaque t() :: #sight{}.

%% A grid is too old when a robot can have come so many parts of the range.
-define(STALE, 0.5).
%% A grid of N robots has paid for itself after N / WORTH questions.
-define(WORTH, 4).
%% More than the rounding errors of a position, mm.
-define(HAIR_MM, 1.0e-3).

%% @doc These robots are all there are. Questions will be about this range.
-spec new([{starl:robot_id(), starl_trajectory:piece()}], RangeMm :: float() | infinity) -> t().
new(Pieces, Range) ->
    Table = ets:new(starl_sim_sight, [set, private]),
    true = ets:insert(Table, [{fastest, 0.0}, {grid, none, 0}]),
    Sight = #sight{table = Table, range = Range},
    ok = moved(Pieces, Sight),
    Sight.

%% @doc These robots go on in these pieces, from where they were.
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

%% @doc The robots that at this time are within the range of a point, ascending. The times of
%% questions never decrease.
-spec within(starl_geometry:point(), starl_sim_queue:time(), t()) -> [starl:robot_id()].
within(Point, Now, #sight{range = Range} = Sight) when is_float(Range) ->
    Slack = slack(Now, Sight),
    lists:sort(search(Point, Now, Slack, Sight)).

%% How far robots can have come since the grid was made.
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

%% An atom is more than any number.
come(none, _Now, _Fastest) -> infinity;
come(Made, Now, Fastest) -> Fastest * (Now - Made) / 1.0e6.

make_grid(Now, #sight{table = Table, range = Range}) ->
    Pieces = ets:select(Table, [{{'$1', '$2'}, [{is_integer, '$1'}], ['$_']}]),
    Entries = [entered(Id, Piece, Now, Range) || {Id, Piece} <- Pieces],
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

%% From the square of the distance in the grid; who may be either is measured.
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
