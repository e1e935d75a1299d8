%% @doc The lines along which a team searches the rooms of a floor: in each room parallel lines, as
%% far apart as a camera sees, where there is room for a robot. Lengths are millimetres.
-module(starl_search_lines).

-export([lines/2]).

-export_type([room/0]).

%% A room with its lines; none if it is too narrow.
-type room() :: {Name :: atom(), [starl_geometry:segment()]}.

%% The step in which a line is looked at, the shortest line, and the places where a line is looked
%% for in a room that has none yet.
-define(STEP_MM, 50.0).
-define(SHORTEST_MM, 200.0).
-define(TRIES, 24).

%% @doc The rooms of a floor, by name; a floor without any is one room, `floor'.
-spec lines(starl_floor:t(), #{spacing := number(), wall_mm := float()}) -> [room()].
lines(#{rooms := Rooms, size := {W, H}} = Floor, Config) ->
    Walls = starl_walls:new(Floor),
    All =
        case map_size(Rooms) of
            0 -> [{floor, starl_floor:box(0, 0, W, H)}];
            _ -> lists:sort(maps:to_list(Rooms))
        end,
    Is = fun(Name, P) ->
        map_size(Rooms) =:= 0 orelse starl_floor:room_at(P, Floor) =:= {ok, Name}
    end,
    [
        {Name, room(starl_geometry:box(Polygon), fun(P) -> Is(Name, P) end, Walls, Config)}
     || {Name, Polygon} <- All
    ].

%% Along the longer side, in the middle of strips of this width.
room({X0, Y0, X1, Y1} = Box, IsIn, Walls, #{spacing := Spacing, wall_mm := Mm}) ->
    N = max(1, ceil(min(X1 - X0, Y1 - Y0) / Spacing)),
    case strips(Box, N, IsIn, Mm, Walls) of
        [] ->
            Tried = strips(Box, ?TRIES, IsIn, Mm, Walls),
            Longest = lists:sort([{-starl_geometry:length(Line), Line} || Line <- Tried]),
            [Line || {_, Line} <- lists:sublist(Longest, 1)];
        Lines ->
            Lines
    end.

strips(Box, N, IsIn, Mm, Walls) ->
    [
        Line
     || K <- lists:seq(1, N),
        Line <- runs(strip(Box, (K - 0.5) / N), IsIn, Mm, Walls),
        starl_geometry:length(Line) >= ?SHORTEST_MM
    ].

strip({X0, Y0, X1, Y1}, Part) when X1 - X0 >= Y1 - Y0 ->
    Y = Y0 + Part * (Y1 - Y0),
    {{X0, Y}, {X1, Y}};
strip({X0, Y0, X1, Y1}, Part) ->
    X = X0 + Part * (X1 - X0),
    {{X, Y0}, {X, Y1}}.

%% The parts of a strip where a robot can drive.
runs({A, B} = Strip, IsIn, Mm, Walls) ->
    N = max(1, trunc(starl_geometry:length(Strip) / ?STEP_MM)),
    Points = [starl_geometry:interpolate(A, B, I / N) || I <- lists:seq(0, N)],
    joined([P || P <- Points, IsIn(P), starl_walls:is_free({P, P}, Mm, Walls)], Mm, Walls).

joined([], _Mm, _Walls) -> [];
joined([P | Points], Mm, Walls) -> joined(P, P, Points, Mm, Walls).

joined(From, Last, [P | Points], Mm, Walls) ->
    Next =
        starl_geometry:distance(Last, P) < 1.5 * ?STEP_MM andalso
            starl_walls:is_free({Last, P}, Mm, Walls),
    case Next of
        true -> joined(From, P, Points, Mm, Walls);
        false -> [{From, Last} | joined(P, P, Points, Mm, Walls)]
    end;
joined(From, Last, [], _Mm, _Walls) ->
    [{From, Last}].
