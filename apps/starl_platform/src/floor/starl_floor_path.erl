%% @doc Finds a short path for a round body on a floor plan, around walls and through doors.
%%
%% The A* algorithm (Hart, Nilsson and Raphael, 1968) searches a grid of cells, each of which it
%% looks at only when it gets there. The path over the cells is then straightened: from each point
%% straight on to the farthest one that can be reached. Only the walls of the plan count. Doors are
%% open. Pure; equal floors give equal paths. Lengths are millimetres.
%%
%% A passage is found for sure if it is wider than `2 * Mm' by one and a half cells. A cell is 50 mm
%% wide, and wider on floors of more than 250 m2.
-module(starl_floor_path).

-export([find/3]).

-type cell() :: {Column :: integer(), Row :: integer()}.

-record(search, {
    walls :: starl_walls:t(),
    %% the distance from walls: of the path, and of the middles of its cells
    mm :: float(),
    cell_mm :: float(),
    pitch :: float(),
    to :: starl_geometry:point(),
    %% the cells from which a straight line leads to the goal
    goals :: #{cell() => true},
    %% the shortest path to each cell so far (mm); none is shorter to a cell in a wall
    reached = #{} :: #{cell() => float()},
    %% the cells whose shortest path is known, each with the one before
    before = #{} :: #{cell() => cell() | start}
}).

-define(PITCH_MM, 50.0).
-define(MOST_CELLS, 100000).
%% A body beside a wall keeps the room that it has, but for this (mm).
-define(SLACK_MM, 1.0).

%% @doc The points of a path on which a body's centre keeps `Mm' from all walls. The start is left
%% out; the last point is the goal. A body that stands nearer to a wall leaves it first.
%% `unreachable': no passage is wide enough, or the goal is too near to a wall.
-spec find({From, To}, Mm :: number(), starl_floor:t()) ->
    {ok, [starl_geometry:point(), ...]} | {error, unreachable}
when
    From :: starl_geometry:point(), To :: starl_geometry:point().
find({From, To} = Line, Mm, Floor) ->
    Walls = starl_walls:new(Floor),
    case {starl_walls:is_free(Line, Mm, Walls), starl_walls:is_free({To, To}, Mm, Walls)} of
        {true, _} -> {ok, [To]};
        {false, false} -> {error, unreachable};
        {false, true} -> around(From, search(To, float(Mm), Walls))
    end.

search(To, Mm, Walls) ->
    #{size := {W, H}} = starl_walls:floor(Walls),
    Pitch = max(?PITCH_MM, math:sqrt(W * H / ?MOST_CELLS)),
    Search = #search{
        walls = Walls,
        mm = Mm,
        %% a step to any of the eight neighbours stays free, too
        cell_mm = math:sqrt(Mm * Mm + Pitch * Pitch / 2),
        pitch = Pitch,
        to = To,
        goals = #{}
    },
    Search#search{goals = maps:from_keys(joined(To, Mm, Search), true)}.

around(From, #search{mm = Mm, walls = Walls} = Search) ->
    Room = min(Mm, starl_walls:clearance({From, From}, Mm, Walls) - ?SLACK_MM),
    Starts = joined(From, Room, Search),
    Open = gb_sets:from_list([
        open(distance(From, Cell, Search), Cell, start, Search)
     || Cell <- Starts
    ]),
    case expand(Open, Search) of
        {ok, Cells} ->
            Points = [From | [middle(Cell, Search) || Cell <- Cells]] ++ [Search#search.to],
            {ok, tl(straight(Points, Search))};
        none ->
            {error, unreachable}
    end.

%% The cells near a point to which a straight line leads that keeps this distance from walls.
joined({X, Y} = P, Room, #search{mm = Mm, pitch = Pitch, walls = Walls} = Search) ->
    {I, J} = {floor(X / Pitch), floor(Y / Pitch)},
    N = 2 + ceil((Mm - Room) / Pitch),
    [
        Cell
     || DI <- lists:seq(-N, N),
        DJ <- lists:seq(-N, N),
        Cell <- [{I + DI, J + DJ}],
        is_clear(Cell, Search),
        starl_walls:is_free({P, middle(Cell, Search)}, Room, Walls)
    ].

%% -- A* -------------------------------------------------------------------------------------

open(Mm, Cell, Before, #search{to = To} = Search) ->
    {Mm + distance(To, Cell, Search), Mm, Cell, Before}.

expand(Open, #search{before = Known, goals = Goals} = Search) ->
    case gb_sets:is_empty(Open) orelse gb_sets:take_smallest(Open) of
        true ->
            none;
        {{_, _, Cell, _}, Rest} when is_map_key(Cell, Known) ->
            expand(Rest, Search);
        {{_, _, Cell, Before}, _} when is_map_key(Cell, Goals) ->
            {ok, back(Cell, Known#{Cell => Before}, [])};
        {{_, Mm, Cell, Before}, Rest} ->
            step(Cell, Mm, Rest, Search#search{before = Known#{Cell => Before}})
    end.

step({I, J} = Cell, Mm, Open, #search{pitch = Pitch} = Search) ->
    {Next, Looked} = lists:foldl(
        fun({DI, DJ, Part}, {Set, S}) ->
            reach({I + DI, J + DJ}, Mm + Part * Pitch, Cell, Set, S)
        end,
        {Open, Search},
        neighbours()
    ),
    expand(Next, Looked).

neighbours() ->
    Root = math:sqrt(2),
    [{1, 0, 1.0}, {0, 1, 1.0}, {-1, 0, 1.0}, {0, -1, 1.0}] ++
        [{DI, DJ, Root} || DI <- [-1, 1], DJ <- [-1, 1]].

reach(Cell, Mm, Before, Open, #search{reached = Reached} = Search) ->
    Is =
        case Reached of
            #{Cell := Known} -> Mm < Known;
            #{} -> is_clear(Cell, Search)
        end,
    case Is of
        true ->
            Added = gb_sets:add_element(open(Mm, Cell, Before, Search), Open),
            {Added, Search#search{reached = Reached#{Cell => Mm}}};
        false when is_map_key(Cell, Reached) ->
            {Open, Search};
        false ->
            {Open, Search#search{reached = Reached#{Cell => 0.0}}}
    end.

is_clear(Cell, #search{cell_mm = Mm, walls = Walls} = Search) ->
    P = middle(Cell, Search),
    starl_walls:is_free({P, P}, Mm, Walls).

back(start, _Known, Cells) -> Cells;
back(Cell, Known, Cells) -> back(maps:get(Cell, Known), Known, [Cell | Cells]).

middle({I, J}, #search{pitch = Pitch}) -> {(I + 0.5) * Pitch, (J + 0.5) * Pitch}.

distance(P, Cell, Search) -> starl_geometry:distance(P, middle(Cell, Search)).

%% -- straight lines -------------------------------------------------------------------------

%% From each point to the farthest that a straight line reaches.
straight([P, Q | Points], Search) ->
    [Next | Rest] = farthest(P, tails([Q | Points], []), Search),
    [P | straight([Next | Rest], Search)];
straight([P], _Search) ->
    [P].

%% The shortest first.
tails([], Tails) -> Tails;
tails([_ | Rest] = Points, Tails) -> tails(Rest, [Points | Tails]).

farthest(_P, [Next], _Search) ->
    Next;
farthest(P, [[Q | _] = Tail | Tails], #search{mm = Mm, walls = Walls} = Search) ->
    case starl_walls:is_free({P, Q}, Mm, Walls) of
        true -> Tail;
        false -> farthest(P, Tails, Search)
    end.
