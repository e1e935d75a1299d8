%% @doc A floor plan: the size of the floor, its walls, rooms, doors and named places.
%% ```
%%   {ok, Floor} = starl_floor_file:read("search"),
%%   #{size := {W, H}, places := #{'A' := Door}} = Floor.
%% '''
%% The floor is the box from the origin to its size; its border is a wall. Walls are the outlines of
%% what is solid, each a closed polygon with the solid on its left: counter-clockwise around a
%% block, clockwise around a hole in one. A polygon of two points is a wall without thickness. They
%% may overlap. A room is the polygon of its free floor. Lengths are millimetres.
-module(starl_floor).

-export([
    empty/1,
    new/1,
    is_floor/1,
    segments/1,
    box/4,
    is_solid/2,
    winding/2,
    crossing/2,
    blocks/1,
    room_at/2,
    area/1,
    middle/1,
    summary/1
]).

-export_type([t/0, polygon/0]).

%% `name' is its title. A door is the line that closes it.
-type t() :: #{
    name := binary(),
    size := {Width :: float(), Height :: float()},
    walls := [polygon()],
    rooms := #{atom() => polygon()},
    doors := [starl_geometry:segment()],
    places := #{atom() => starl_geometry:point()}
}.

-type polygon() :: [starl_geometry:point(), ...].

%% @doc A floor with nothing on it.
-spec empty({Width :: number(), Height :: number()}) -> t().
empty({W, H}) ->
    new(#{size => {W, H}}).

%% @doc A floor plan of its parts, those that are left out being empty; all numbers become floats.
-spec new(#{size := {number(), number()}, atom() => term()}) -> t().
new(#{size := {W, H}} = Parts) ->
    Polygons = fun(_Name, Polygon) -> floats(Polygon) end,
    #{
        name => maps:get(name, Parts, <<>>),
        size => {float(W), float(H)},
        walls => [floats(Polygon) || Polygon <- maps:get(walls, Parts, [])],
        rooms => maps:map(Polygons, maps:get(rooms, Parts, #{})),
        doors => [{float_point(A), float_point(B)} || {A, B} <- maps:get(doors, Parts, [])],
        places => maps:map(fun(_, P) -> float_point(P) end, maps:get(places, Parts, #{}))
    }.

floats(Points) -> [float_point(Point) || Point <- Points].

float_point({X, Y}) -> {float(X), float(Y)}.

%% @doc Is this term a floor plan?
-spec is_floor(term()) -> boolean().
is_floor(#{
    name := Name, size := {W, H}, walls := Walls, rooms := Rooms, doors := Doors, places := Places
}) ->
    is_binary(Name) andalso is_float(W) andalso is_float(H) andalso
        lists:all(fun is_polygon/1, Walls) andalso
        lists:all(fun is_polygon/1, maps:values(Rooms)) andalso
        lists:all(fun({A, B}) -> is_polygon([A, B]) end, Doors) andalso
        is_polygon([{0.0, 0.0} | maps:values(Places)]);
is_floor(_) ->
    false.

is_polygon([_ | _] = Points) -> lists:all(fun is_point/1, Points);
is_polygon(_) -> false.

is_point({X, Y}) -> is_float(X) andalso is_float(Y);
is_point(_) -> false.

%% @doc The polygon of a box.
-spec box(X0 :: number(), Y0 :: number(), X1 :: number(), Y1 :: number()) -> polygon().
box(X0, Y0, X1, Y1) ->
    floats([{X0, Y0}, {X1, Y0}, {X1, Y1}, {X0, Y1}]).

%% The border of the floor, seen from inside.
-spec border(t()) -> [starl_geometry:segment()].
border(#{size := {W, H}}) -> sides(lists:reverse(box(0, 0, W, H))).

%% @doc All walls as segments, the border first.
-spec segments(t()) -> [starl_geometry:segment()].
segments(#{walls := Walls} = Floor) ->
    border(Floor) ++ lists:append([sides(Wall) || Wall <- Walls]).

%% @doc The sides of the walls that are solid inside.
-spec blocks(t()) -> [starl_geometry:segment()].
blocks(#{walls := Walls}) -> lists:append([sides(Wall) || [_, _, _ | _] = Wall <- Walls]).

sides([A]) -> [{A, A}];
sides([A, B]) -> [{A, B}];
sides([First | Rest] = Polygon) -> lists:zip(Polygon, Rest ++ [First]).

%% @doc Is this point in a wall, or off the floor? The edges of a wall are not in it.
-spec is_solid(starl_geometry:point(), t()) -> boolean().
is_solid({X, Y}, #{size := {W, H}}) when X < 0; Y < 0; X > W; Y > H ->
    true;
is_solid(Point, #{walls := Walls}) ->
    lists:sum([winding(Point, Wall) || [_, _, _ | _] = Wall <- Walls]) > 0.

%% @doc The number of times that a polygon goes around a point, counter-clockwise.
-spec winding(starl_geometry:point(), polygon()) -> integer().
winding(Point, [First | _] = Polygon) -> winding(Point, Polygon, First, 0).

winding(Point, [A | [B | _] = Rest], First, N) ->
    winding(Point, Rest, First, N + crossing(Point, {A, B}));
winding(Point, [Last], First, N) ->
    N + crossing(Point, {Last, First}).

%% @doc The contribution of one side to the winding number: 1, -1 or 0. A side contributes only if
%% the point is at its height, to the left of an upward side or to the right of a downward side.
-spec crossing(starl_geometry:point(), starl_geometry:segment()) -> -1 | 0 | 1.
crossing({X, Y}, {{AX, AY}, {BX, BY}}) when AY =< Y, BY > Y ->
    case (BX - AX) * (Y - AY) - (X - AX) * (BY - AY) of
        Left when Left > 0 -> 1;
        _ -> 0
    end;
crossing({X, Y}, {{AX, AY}, {BX, BY}}) when BY =< Y, AY > Y ->
    case (BX - AX) * (Y - AY) - (X - AX) * (BY - AY) of
        Left when Left < 0 -> -1;
        _ -> 0
    end;
crossing(_Point, _Side) ->
    0.

%% @doc The room in which a point lies.
-spec room_at(starl_geometry:point(), t()) -> {ok, atom()} | none.
room_at(Point, #{rooms := Rooms}) ->
    case [Name || {Name, Of} <- lists:sort(maps:to_list(Rooms)), winding(Point, Of) =/= 0] of
        [Name | _] -> {ok, Name};
        [] -> none
    end.

%% @doc The area of a polygon (mm2): negative if it is clockwise.
-spec area(polygon()) -> float().
area(Polygon) ->
    lists:sum([AX * BY - BX * AY || {{AX, AY}, {BX, BY}} <- sides(Polygon)]) / 2.

%% @doc A point in the middle of the widest part of a polygon, for its name.
-spec middle(polygon()) -> starl_geometry:point().
middle(Points) ->
    {_, Low, _, High} = starl_geometry:box(Points),
    Heights = [Low + I * (High - Low) / 10 || I <- lists:seq(1, 9)],
    {_, X, Y} = lists:max([{0.0, 0.0, Low} | lists:append([widths(Y, Points) || Y <- Heights])]),
    {X, Y}.

%% The stretches of a room at a height, with their middles.
widths(Y, [First | Rest] = Points) ->
    Sides = lists:zip(Points, Rest ++ [First]),
    pairs(
        Y,
        lists:sort([
            AX + (Y - AY) * (BX - AX) / (BY - AY)
         || {{AX, AY}, {BX, BY}} <- Sides, (AY =< Y) =/= (BY =< Y)
        ])
    ).

pairs(Y, [From, To | Rest]) -> [{To - From, (From + To) / 2, Y} | pairs(Y, Rest)];
pairs(_Y, []) -> [].

%% @doc A floor plan in a few lines of text.
-spec summary(t()) -> [unicode:chardata()].
summary(#{name := Name, size := {W, H}, walls := Walls, doors := Doors} = Floor) ->
    #{rooms := Rooms, places := Places} = Floor,
    Sides = length(segments(Floor)) - 4,
    [[Name] || Name =/= <<>>] ++
        [
            io_lib:format("floor: ~s m x ~s m", [metres(W), metres(H)]),
            io_lib:format("walls: ~b, with ~b sides", [length(Walls), Sides])
        ] ++
        listed("rooms", [room(Room) || Room <- lists:sort(maps:to_list(Rooms))]) ++
        listed("doors", [door(N, Door) || {N, Door} <- lists:enumerate(Doors)]) ++
        listed("places", [place(Place) || Place <- lists:sort(maps:to_list(Places))]).

listed(_What, []) -> [];
listed(What, Texts) -> [io_lib:format("~ts: ~ts", [What, lists:join(", ", Texts)])].

room({Name, Polygon}) -> io_lib:format("~ts (~.1f m2)", [Name, abs(area(Polygon)) / 1.0e6]).

door(N, Door) -> io_lib:format("~b (~b mm)", [N, round(starl_geometry:length(Door))]).

place({Name, {X, Y}}) -> io_lib:format("~ts (~b, ~b)", [Name, round(X), round(Y)]).

metres(Mm) -> float_to_list(Mm / 1000, [{decimals, 2}, compact]).
