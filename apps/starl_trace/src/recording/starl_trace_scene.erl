%% @doc Draws the scene of a recording for viewers of `foxglove.SceneUpdate': the bodies of the
%% robots, and the ink of their pens. A pure module; lengths become metres.
-module(starl_trace_scene).

-export([new/0, bodies/2, plan/2, event/2, transforms/2, timestamp/1, entity/5, colour/3]).

-export_type([t/0]).

-define(BODY_MM, 330.0).
-define(TALL_MM, 100.0).
-define(INK_MM, 20.0).
-define(WALL_MM, 30.0).
%% The line stays this close to the way of the pen.
-define(TOLERANCE_MM, 5.0).
-define(APART_MM, 75.0).
%% A longer line is shown in parts.
-define(MOST_POINTS, 100).
-define(COLOURS, {
    {0.90, 0.29, 0.24},
    {0.20, 0.60, 0.86},
    {0.18, 0.80, 0.44},
    {0.95, 0.61, 0.07},
    {0.61, 0.35, 0.71},
    {0.10, 0.74, 0.61},
    {0.91, 0.12, 0.39},
    {0.55, 0.43, 0.39}
}).

-record(scene, {
    pieces = #{} :: #{starl:robot_id() => starl_trajectory:piece()},
    %% the points of each line in work, the latest first
    ink = #{} :: #{starl:robot_id() => [starl_geometry:point(), ...]},
    count = 0 :: non_neg_integer()
}).

-opaque t() :: #scene{}.

%% @doc A floor without ink.
-spec new() -> t().
new() -> #scene{}.

%% @doc The bodies of these robots, each in the frame of its robot.
-spec bodies(AtUs :: integer(), [starl:robot_id()]) -> starl_json:value().
bodies(At, Robots) -> update([body(At, Robot) || Robot <- Robots]).

%% @doc The walls and doors of a floor plan, and the names of its rooms, in the frame of the floor.
-spec plan(AtUs :: integer(), starl_floor:t()) -> starl_json:value().
plan(At, #{doors := Doors, rooms := Rooms} = Floor) ->
    Walls = wire(starl_floor:segments(Floor), {[{r, 0.5}, {g, 0.5}, {b, 0.5}, {a, 1}]}),
    Doorways = wire(Doors, {[{r, 0.75}, {g, 0.55}, {b, 0.25}, {a, 1}]}),
    Names = [
        name(Name, starl_floor:middle(Room))
     || {Name, Room} <- lists:sort(maps:to_list(Rooms))
    ],
    update([
        entity(At, <<"floor">>, <<"floor plan">>, 0, [
            {lines, [Walls | [Doorways || Doors =/= []]]}, {texts, Names}
        ])
    ]).

%% A list of lines, each from one point to the next.
wire(Segments, Colour) ->
    {[
        {type, 2},
        {pose, pose({0.0, 0.0, 0.0}, 0.0)},
        {thickness, m(?WALL_MM)},
        {scale_invariant, false},
        {points, [
            {[{x, m(X)}, {y, m(Y)}, {z, 0}]}
         || {A, B} <- Segments, {X, Y} <- [A, B]
        ]},
        {color, Colour},
        {colors, []},
        {indices, []}
    ]}.

name(Name, {X, Y}) ->
    {[
        {pose, pose({X, Y, 0.0}, 0.0)},
        {billboard, true},
        {font_size, 0.3},
        {scale_invariant, false},
        {color, {[{r, 0.5}, {g, 0.5}, {b, 0.5}, {a, 1}]}},
        {text, atom_to_binary(Name)}
    ]}.

%% @doc Takes a trace event into account: the new ink, if any, in the frame of the floor.
-spec event(starl_monitor:trace_event(), t()) -> {[starl_json:value()], t()}.
event({At, Robot, chassis, {motion, Piece}}, #scene{pieces = Pieces} = Scene) ->
    {Shown, Driven} = drawn(At, Robot, Scene),
    {Shown, Driven#scene{pieces = Pieces#{Robot => Piece}}};
event({At, Robot, chassis, {actuated, pen, down}}, #scene{pieces = Pieces, ink = Ink} = Scene) ->
    case Pieces of
        #{Robot := Piece} ->
            Begun = [starl_trajectory:position(At, Piece)],
            {[], Scene#scene{
                ink = Ink#{Robot => Begun}, pieces = Pieces#{Robot => from(At, Piece)}
            }};
        #{} ->
            {[], Scene}
    end;
event({At, Robot, chassis, {actuated, pen, up}}, Scene) ->
    {Earlier, #scene{ink = Ink} = Last} = drawn(At, Robot, Scene),
    {Shown, Next} = line(At, Robot, maps:get(Robot, Ink, []), Last),
    {Earlier ++ Shown, Next#scene{ink = maps:remove(Robot, Next#scene.ink)}};
event(_Event, Scene) ->
    {[], Scene}.

%% The ink of the piece that ends now.
drawn(At, Robot, #scene{pieces = Pieces, ink = Ink} = Scene) ->
    case {Ink, Pieces} of
        {#{Robot := Points}, #{Robot := Piece}} ->
            Way = starl_trajectory:polyline(Piece, begun(Piece, At), At, ?TOLERANCE_MM),
            longer(At, Robot, lists:foldl(fun further/2, Points, tl(Way)), Scene);
        _ ->
            {[], Scene}
    end.

%% Points that are close together show nothing more.
further(Point, [_Last, Before | Points] = All) ->
    case starl_geometry:distance(Point, Before) < ?APART_MM of
        true -> [Point, Before | Points];
        false -> [Point | All]
    end;
further(Point, Points) ->
    [Point | Points].

begun(Piece, At) -> min(At, starl_trajectory:start_us(Piece)).

%% A pen that goes down in the middle of an arc or a line.
from(At, {piece, _, _, _, _, V, W} = Piece) ->
    {X, Y, Heading} = starl_trajectory:pose(At, Piece),
    {piece, At, X, Y, Heading, V, W};
from(_At, Ramp) ->
    Ramp.

longer(At, Robot, Points, Scene) when length(Points) >= ?MOST_POINTS ->
    line(At, Robot, Points, Scene);
longer(_At, Robot, Points, #scene{ink = Ink} = Scene) ->
    {[], Scene#scene{ink = Ink#{Robot => Points}}}.

line(At, Robot, [Last, _ | _] = Points, #scene{ink = Ink, count = N} = Scene) ->
    {[update([ink(At, Robot, N, Points)])], Scene#scene{
        ink = Ink#{Robot => [Last]}, count = N + 1
    }};
line(_At, _Robot, _Points, Scene) ->
    {[], Scene}.

%% -- JSON -----------------------------------------------------------------------------------

update(Entities) -> {[{deletions, []}, {entities, Entities}]}.

body(At, Robot) ->
    entity(At, frame(Robot), frame(Robot), true, 0, [
        {arrows, [nose(Robot)]}, {cylinders, [cylinder(Robot)]}, {texts, [number(Robot)]}
    ]).

cylinder(Robot) ->
    {[
        {pose, pose({0.0, 0.0, 0.0}, ?TALL_MM / 2)},
        {size, {[{x, m(?BODY_MM)}, {y, m(?BODY_MM)}, {z, m(?TALL_MM)}]}},
        {bottom_scale, 1},
        {top_scale, 1},
        {color, colour(Robot, 0.8)}
    ]}.

nose(Robot) ->
    {[
        {pose, pose({0.0, 0.0, 0.0}, ?TALL_MM)},
        {shaft_length, 0.15},
        {shaft_diameter, 0.03},
        {head_length, 0.06},
        {head_diameter, 0.07},
        {color, colour(Robot, 1.0)}
    ]}.

number(Robot) ->
    {[
        {pose, pose({0.0, 0.0, 0.0}, 3 * ?TALL_MM)},
        {billboard, true},
        {font_size, 0.2},
        {scale_invariant, false},
        {color, {[{r, 1}, {g, 1}, {b, 1}, {a, 1}]}},
        {text, integer_to_binary(Robot)}
    ]}.

ink(At, Robot, N, Points) ->
    Line =
        {[
            {type, 0},
            {pose, pose({0.0, 0.0, 0.0}, 0.0)},
            {thickness, m(?INK_MM)},
            {scale_invariant, false},
            {points, [
                {[{x, m(X)}, {y, m(Y)}, {z, 0}]}
             || {X, Y} <- lists:reverse(Points)
            ]},
            {color, colour(Robot, 1.0)},
            {colors, []},
            {indices, []}
        ]},
    Id = <<"ink ", (integer_to_binary(N))/binary>>,
    entity(At, <<"floor">>, Id, 0, [{lines, [Line]}]).

%% @doc An entity that stands on the floor, with its shapes by their kinds; 0: it stays.
-spec entity(AtUs :: integer(), Frame :: binary(), Id :: binary(), LifeUs, Shapes) ->
    {[{atom(), starl_json:value()}]}
when
    LifeUs :: non_neg_integer(), Shapes :: [{atom(), [starl_json:value()]}].
entity(At, Frame, Id, LifeUs, Shapes) -> entity(At, Frame, Id, false, LifeUs, Shapes).

entity(At, Frame, Id, IsLocked, LifeUs, Shapes) ->
    Kinds = [arrows, cubes, spheres, cylinders, lines, triangles, texts, models],
    {
        [
            {timestamp, timestamp(At)},
            {frame_id, Frame},
            {id, Id},
            {lifetime, timestamp(LifeUs)},
            {frame_locked, IsLocked},
            {metadata, []}
        ] ++ [{Kind, proplists:get_value(Kind, Shapes, [])} || Kind <- Kinds]
    }.

%% @doc The frames of these robots, which stand on the floor.
-spec transforms(AtUs :: integer(), [{starl:robot_id(), starl:pose()}]) ->
    starl_json:value().
transforms(At, Poses) ->
    {[{transforms, [transform(At, Robot, Pose) || {Robot, Pose} <- Poses]}]}.

%% As text, since there are so many.
transform(At, Robot, {X, Y, Heading}) ->
    Us = max(0, At),
    {json, [
        [<<"{\"timestamp\":{\"sec\":">>, integer_to_binary(Us div 1000000), <<",\"nsec\":">>],
        [integer_to_binary(Us rem 1000000 * 1000), <<"},\"parent_frame_id\":\"floor\",">>],
        [<<"\"child_frame_id\":\"">>, frame(Robot), <<"\",\"translation\":{\"x\":">>],
        [decimal(X / 1000, 3), <<",\"y\":">>, decimal(Y / 1000, 3), <<",\"z\":0},">>],
        [<<"\"rotation\":{\"x\":0,\"y\":0,\"z\":">>, decimal(math:sin(Heading / 2), 5)],
        [<<",\"w\":">>, decimal(math:cos(Heading / 2), 5), <<"}}">>]
    ]}.

decimal(Number, Decimals) -> float_to_binary(Number, [{decimals, Decimals}, compact]).

frame(Robot) -> <<"robot ", (integer_to_binary(Robot))/binary>>.

pose({X, Y, Heading}, Z) ->
    {[
        {position, {[{x, m(X)}, {y, m(Y)}, {z, m(Z)}]}},
        {orientation, rotation(Heading)}
    ]}.

rotation(Heading) ->
    {[
        {x, 0},
        {y, 0},
        {z, {math:sin(Heading / 2), 5}},
        {w, {math:cos(Heading / 2), 5}}
    ]}.

m(Mm) -> {Mm / 1000, 3}.

colour(Robot, Alpha) -> colour(Robot, own, Alpha).

%% @doc The colour of a robot, or another, each part from 0 to 1.
-spec colour(starl:robot_id(), own | {R, G, B}, Alpha :: float()) ->
    {[{atom(), starl_json:value()}]}
when
    R :: float(), G :: float(), B :: float().
colour(Robot, own, Alpha) ->
    colour(Robot, element((Robot - 1) rem tuple_size(?COLOURS) + 1, ?COLOURS), Alpha);
colour(_Robot, {R, G, B}, Alpha) ->
    {[{r, R}, {g, G}, {b, B}, {a, Alpha}]}.

%% @doc A time as viewers expect it.
-spec timestamp(AtUs :: integer()) -> starl_json:value().
timestamp(At) ->
    Us = max(0, At),
    {[{sec, Us div 1000000}, {nsec, Us rem 1000000 * 1000}]}.
