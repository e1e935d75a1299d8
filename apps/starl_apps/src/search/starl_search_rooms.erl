%% @doc The rooms of a floor, for texts. If the floor plan names no rooms, they are the parts that
%% remain when narrow places, such as doors, are closed. Each narrow place belongs to the nearest
%% room. Lengths are millimetres.
-module(starl_search_rooms).

-export([new/1, names/1, where/2]).

-export_type([t/0]).

-type cell() :: {integer(), integer()}.
-type name() :: unicode:chardata().

%% The plan, if it has names; else the width of cells, and the number of the room of each.
-opaque t() :: {plan, starl_floor:t()} | {cells, float(), #{cell() => pos_integer()}}.

-define(PITCH_MM, 200.0).
-define(MOST_CELLS, 40000).
%% A floor as narrow as this is a door.
-define(DOOR_MM, 1200.0).

%% @doc Finds the rooms.
-spec new(starl_floor:t()) -> t().
new(#{rooms := Rooms} = Floor) when map_size(Rooms) > 0 -> {plan, Floor};
new(#{size := {W, H}, doors := Doors} = Floor) ->
    Pitch = max(?PITCH_MM, math:sqrt(W * H / ?MOST_CELLS)),
    Walls = starl_walls:add(Doors, starl_walls:new(Floor)),
    Free = [
        {Cell, Mm}
     || I <- lists:seq(0, trunc(W / Pitch) - 1),
        J <- lists:seq(0, trunc(H / Pitch) - 1),
        Cell <- [{I, J}],
        P <- [middle(Cell, Pitch)],
        not starl_walls:is_solid(P, Walls),
        Mm <- [starl_walls:clearance({P, P}, ?DOOR_MM, Walls)],
        Mm > Pitch / 2
    ],
    Wide = [Cell || {Cell, Mm} <- Free, Mm >= ?DOOR_MM / 2],
    All = maps:from_list([{Cell, 0} || {Cell, _} <- Free]),
    Cores = parts(Wide, maps:with(Wide, All), #{}, 1),
    {cells, Pitch, grown(lists:sort(maps:keys(Cores)), Cores, [Cell || {Cell, _} <- Free], All)}.

middle({I, J}, Pitch) -> {(I + 0.5) * Pitch, (J + 0.5) * Pitch}.

parts([], _Open, Rooms, _N) ->
    Rooms;
parts([Cell | Cells], Open, Rooms, N) when is_map_key(Cell, Open) ->
    Part = part([Cell], maps:remove(Cell, Open), [Cell]),
    parts(Cells, maps:without(Part, Open), maps:merge(Rooms, maps:from_keys(Part, N)), N + 1);
parts([_ | Cells], Open, Rooms, N) ->
    parts(Cells, Open, Rooms, N).

part([], _Open, Part) ->
    Part;
part([Cell | Cells], Open, Part) ->
    New = [Next || Next <- beside(Cell), is_map_key(Next, Open)],
    part(New ++ Cells, maps:without(New, Open), New ++ Part).

beside({I, J}) -> [{I + 1, J}, {I, J + 1}, {I - 1, J}, {I, J - 1}].

%% Each room takes the narrow places beside it, step by step; what none comes to is a room of its own.
grown([], Rooms, Free, All) ->
    Left = [Cell || Cell <- Free, not is_map_key(Cell, Rooms)],
    N = lists:max([0 | maps:values(Rooms)]) + 1,
    maps:merge(Rooms, parts(Left, maps:with(Left, All), #{}, N));
grown(Edge, Rooms, Free, All) ->
    {Next, Wider} = lists:foldl(fun(Cell, Acc) -> grow(Cell, All, Acc) end, {[], Rooms}, Edge),
    grown(lists:reverse(Next), Wider, Free, All).

grow(Cell, All, {Next, Rooms}) ->
    New = [C || C <- beside(Cell), is_map_key(C, All), not is_map_key(C, Rooms)],
    {New ++ Next, maps:merge(Rooms, maps:from_keys(New, maps:get(Cell, Rooms)))}.

%% @doc The names of all rooms.
-spec names(t()) -> [name()].
names({plan, #{rooms := Rooms}}) -> [atom_to_list(Name) || Name <- lists:sort(maps:keys(Rooms))];
names({cells, _, Rooms}) -> [number(N) || N <- lists:usort(maps:values(Rooms))].

number(N) -> io_lib:format("room ~b", [N]).

%% @doc The rooms in which these points lie, that with most of them first; of a room without a name and of what is
%% in none the place of one of the points, m.
-spec where([starl_geometry:point()], t()) -> [name()].
where(Points, Rooms) ->
    Of = maps:groups_from_list(fun(P) -> room(P, Rooms) end, Points),
    Most = lists:sort([
        {-length(Ps), Room, lists:nth((length(Ps) + 1) div 2, Ps)}
     || {Room, Ps} <- maps:to_list(Of)
    ]),
    [named(Room, P) || {_, Room, P} <- Most].

room(P, {plan, Floor}) ->
    case starl_floor:room_at(P, Floor) of
        {ok, Name} -> Name;
        none -> 0
    end;
room({X, Y}, {cells, Pitch, Rooms}) ->
    maps:get({floor(X / Pitch), floor(Y / Pitch)}, Rooms, 0).

named(0, P) -> ["the floor ", at(P)];
named(N, P) when is_integer(N) -> [number(N), $\s, at(P)];
named(Name, _P) -> atom_to_list(Name).

at({X, Y}) -> io_lib:format("at (~.1f, ~.1f)", [X / 1000, Y / 1000]).
