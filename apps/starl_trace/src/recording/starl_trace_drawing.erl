%% @doc Converts what applications draw ({@link starl_drawing}) into `foxglove.SceneUpdate'. Each
%% drawing becomes an entity. Viewers replace it by the next entity of the same name, and remove it
%% at the end of its lifetime. A pure module; lengths become metres.
-module(starl_trace_drawing).

-export([update/3]).

-define(POINT_MM, 60.0).
-define(LINE_MM, 25.0).
-define(LETTER_MM, 250.0).
-define(ABOVE_MM, 5.0).

%% @doc The change of the scene by a drawing of a robot.
-spec update(AtUs :: integer(), starl:robot_id(), starl_drawing:t()) -> starl_json:value().
update(At, Robot, #{key := Key, points := []}) ->
    Deletion =
        {[{timestamp, starl_trace_scene:timestamp(At)}, {type, 0}, {id, name(Robot, Key)}]},
    {[{deletions, [Deletion]}, {entities, []}]};
update(At, Robot, #{key := Key, life_us := Life} = Drawing) ->
    Colour = fun(Alpha) -> starl_trace_scene:colour(Robot, colour(Drawing), Alpha) end,
    Entity = starl_trace_scene:entity(
        At, <<"floor">>, name(Robot, Key), life(Life), shapes(Drawing, Colour)
    ),
    {[{deletions, []}, {entities, [Entity]}]}.

name(Robot, {Name, N}) -> text("drawing ~b ~ts ~b", [Robot, Name, N]);
name(Robot, Name) -> text("drawing ~b ~ts", [Robot, Name]).

text(Format, Values) -> unicode:characters_to_binary(io_lib:format(Format, Values)).

life(infinity) -> 0;
life(Us) -> Us.

colour(#{colour := own}) ->
    own;
colour(#{colour := Name}) ->
    {Name, [$# | Hex]} = lists:keyfind(Name, 1, starl_drawing:colours()),
    <<R, G, B>> = <<(list_to_integer(Hex, 16)):24>>,
    {R / 255, G / 255, B / 255}.

shapes(#{kind := points, points := Points}, Colour) ->
    Size = {[{x, m(?POINT_MM)}, {y, m(?POINT_MM)}, {z, m(?POINT_MM)}]},
    [{spheres, [{[{pose, pose(P)}, {size, Size}, {color, Colour(1.0)}]} || P <- Points]}];
shapes(#{kind := line, points := Points}, Colour) ->
    [{lines, [line(0, Points, Colour)]}];
shapes(#{kind := area, points := Points}, Colour) ->
    [{lines, [line(1, Points, Colour)]}, {triangles, filled(Points, Colour)}];
shapes(#{kind := text, points := [At], text := Text}, Colour) ->
    [
        {texts, [
            {[
                {pose, pose(At)},
                {billboard, true},
                {font_size, m(?LETTER_MM)},
                {scale_invariant, false},
                {color, Colour(1.0)},
                {text, Text}
            ]}
        ]}
    ].

line(Type, Points, Colour) ->
    {[
        {type, Type},
        {pose, pose({0, 0})},
        {thickness, m(?LINE_MM)},
        {scale_invariant, false},
        {points, [point(P) || P <- Points]},
        {color, Colour(1.0)},
        {colors, []},
        {indices, []}
    ]}.

%% A convex area is filled, as a fan of triangles; of another one only the outline is shown.
filled([First | Others] = Points, Colour) ->
    case is_convex(Points) of
        true ->
            Fan = lists:append([
                [point(First), point(A), point(B)]
             || {A, B} <- pairs(Others)
            ]),
            [
                {[
                    {pose, pose({0, 0})},
                    {points, Fan},
                    {color, Colour(0.25)},
                    {colors, []},
                    {indices, []}
                ]}
            ];
        false ->
            []
    end.

pairs([A, B | Points]) -> [{A, B} | pairs([B | Points])];
pairs(_) -> [].

is_convex([A, B | _] = Points) ->
    Turns = [turn(Corner) || Corner <- corners(Points ++ [A, B])],
    lists:all(fun(T) -> T >= 0 end, Turns) orelse lists:all(fun(T) -> T =< 0 end, Turns);
is_convex(_) ->
    false.

corners([A, B, C | Points]) -> [{A, B, C} | corners([B, C | Points])];
corners(_) -> [].

turn({{X0, Y0}, {X1, Y1}, {X2, Y2}}) -> (X1 - X0) * (Y2 - Y1) - (Y1 - Y0) * (X2 - X1).

pose(P) ->
    {[
        {position, point(P)},
        {orientation, {[{x, 0}, {y, 0}, {z, 0}, {w, 1}]}}
    ]}.

point({X, Y}) -> {[{x, m(X)}, {y, m(Y)}, {z, m(?ABOVE_MM)}]}.

m(Mm) -> {Mm / 1000, 3}.
