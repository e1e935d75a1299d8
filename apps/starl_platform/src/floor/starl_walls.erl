%% @doc The walls of a floor plan in a spatial grid: finds the walls near a place, and how much room
%% there is. Lengths are millimetres.
-module(starl_walls).

-export([new/1, add/2, floor/1, side/2, near/3, clearance/3, is_solid/2, is_free/3, crossed/2]).

-export_type([t/0]).

%% The width of the grid's cells.
-define(CELL_MM, 500.0).

-record(walls, {
    floor :: starl_floor:t(),
    sides :: tuple(),
    %% how much of a wall each of the plan's sides is to a radio
    weights = {} :: tuple(),
    %% by height, in bands as high as a cell: the sides of blocks
    bands = #{} :: #{integer() => [starl_geometry:segment()]},
    grid :: starl_grid:t(pos_integer())
}).

-opaque t() :: #walls{}.

%% @doc The walls of a floor, its border included, numbered in the order of {@link
%% starl_floor:segments/1}.
-spec new(starl_floor:t()) -> t().
new(Floor) ->
    Empty = #walls{floor = Floor, sides = {}, grid = starl_grid:new(?CELL_MM)},
    Walls = add(starl_floor:segments(Floor), Empty),
    Walls#walls{weights = weights(Floor), bands = bands(starl_floor:blocks(Floor))}.

bands(Sides) ->
    maps:groups_from_list(fun({Band, _}) -> Band end, fun({_, Side}) -> Side end, [
        {Band, Side}
     || {{_, AY}, {_, BY}} = Side <- Sides,
        AY =/= BY,
        Band <- lists:seq(band_of(min(AY, BY)), band_of(max(AY, BY)))
    ]).

band_of(Y) -> erlang:floor(Y / ?CELL_MM).

%% The border is in nobody's way.
weights(#{walls := Polygons}) ->
    Border = [0.0, 0.0, 0.0, 0.0],
    list_to_tuple(lists:append([Border | [weights_of(Polygon) || Polygon <- Polygons]])).

weights_of([_]) -> [0.0];
weights_of([_, _]) -> [1.0];
weights_of(Polygon) -> [0.5 || _ <- Polygon].

%% @doc More walls, numbered on.
-spec add([starl_geometry:segment()], t()) -> t().
add([], Walls) ->
    Walls;
add(More, #walls{sides = Sides, grid = Grid} = Walls) ->
    Enter = fun(Side, {N, Acc}) -> {N + 1, starl_grid:add(N, Side, Acc)} end,
    {_, Entered} = lists:foldl(Enter, {tuple_size(Sides) + 1, Grid}, More),
    Walls#walls{sides = list_to_tuple(tuple_to_list(Sides) ++ More), grid = Entered}.

%% @doc The floor whose walls these are.
-spec floor(t()) -> starl_floor:t().
floor(#walls{floor = Floor}) -> Floor.

%% @doc The wall of a number.
-spec side(pos_integer(), t()) -> starl_geometry:segment().
side(N, #walls{sides = Sides}) -> element(N, Sides).

%% @doc The walls that may be within `Mm' of a segment or a box, each with its number.
-spec near(starl_grid:shape(), Mm :: float(), t()) -> [starl_contact:wall()].
near(Shape, Mm, #walls{sides = Sides, grid = Grid}) ->
    [{N, element(N, Sides)} || N <- starl_grid:near(Shape, Mm, Grid)].

%% @doc The distance of a segment from the nearest wall, `Most' if it is farther.
-spec clearance(starl_geometry:segment(), Most :: float(), t()) -> float().
clearance(Segment, Most, Walls) ->
    lists:min([
        Most
        | [starl_geometry:segment_segment(Segment, Wall) || {_, Wall} <- near(Segment, Most, Walls)]
    ]).

%% @doc The number of walls that a straight way goes through. A block has two sides in the way, each of
%% which counts for half a wall; a line counts whole, and so does one without a plan's number: an obstacle.
-spec crossed(starl_geometry:segment(), t()) -> number().
crossed(Way, #walls{weights = Weights} = Walls) ->
    lists:sum([0.0 | [weight(N, Weights) || {N, Side} <- near(Way, 0.0, Walls), crosses(Way, Side)]]).

weight(N, Weights) when N =< tuple_size(Weights) -> element(N, Weights);
weight(_N, _Weights) -> 1.0.

%% Half-open, so that a way through a corner crosses one of its two sides.
crosses({P, Q}, {A, B}) ->
    is_left(P, Q, A) =/= is_left(P, Q, B) andalso is_left(A, B, P) =/= is_left(A, B, Q).

is_left({PX, PY}, {QX, QY}, {X, Y}) -> (QX - PX) * (Y - PY) - (X - PX) * (QY - PY) > 0.

%% @doc Is this point in a wall, or off the floor? As {@link starl_floor:is_solid/2}, and faster.
-spec is_solid(starl_geometry:point(), t()) -> boolean().
is_solid({X, Y}, #walls{floor = #{size := {W, H}}}) when X < 0; Y < 0; X > W; Y > H ->
    true;
is_solid({_, Y} = Point, #walls{bands = Bands}) ->
    Sides = maps:get(band_of(Y), Bands, []),
    lists:foldl(fun(Side, N) -> N + starl_floor:crossing(Point, Side) end, 0, Sides) > 0.

%% @doc Is there room for a disc of this radius all along a segment?
-spec is_free(starl_geometry:segment(), Radius :: float(), t()) -> boolean().
is_free({A, _} = Segment, R, Walls) ->
    not is_solid(A, Walls) andalso clearance(Segment, R, Walls) >= R.
