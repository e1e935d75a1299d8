%% @doc The floor of the world: round robots that touch each other or a wall. A pure module.
%%
%% A robot has a bumper around its front half. What touches it there, within 15 degrees of the
%% middle, presses both switches, and else the left or the right one, whoever has moved; what
%% touches it behind presses none. A robot that drives against what it touches stands until it gets
%% another command or the way is free. Robots are not pushed away.
%% ```
%%                front                  bits: 2 left, 1 right (packet 7)
%%            2    3    1
%%          2             1
%%          - - - - - - - -
%%                0
%% '''
%% The floor is checked every 15 ms, so robots may overlap by the distance that they drive in that
%% time, less than 10 mm. A bumper gives as much.
-module(starl_world_floor).

-export([new/1, commanded/2, look/3, period_us/0]).

-export_type([t/0, arena/0, body/0, touch/0]).

%% Walls around the rectangle from (0, 0) to this corner, mm.
-type arena() :: none | {WidthMm :: number(), HeightMm :: number()}.

%% A robot now: its pose, and how it moves.
-type body() :: {starl:robot_id(), starl:pose(), starl_trajectory:velocity()}.

%% What a robot feels: the bits of its bumper; is it in the way of something, and stands?
-type touch() :: {Bits :: 0..3, IsBlocked :: boolean()}.

-record(floor, {
    arena :: arena(),
    radius_mm :: number(),
    %% what is not {0, none}: the bits, and the velocity that a robot would have
    touched = #{} :: #{starl:robot_id() => {0..3 | unknown, none | starl_trajectory:velocity()}}
}).

-opaque t() :: #floor{}.

%% As in the painting, where two robots touch at 330 mm.
-define(RADIUS_MM, 165).
-define(PERIOD_US, 15000).
-define(MIDDLE, 0.2617993877991494).
-define(SIDE, 1.5707963267948966).
%% The cosine of a direction that is no longer towards something.
-define(ALONG, 1.0e-3).

%% @doc A floor on which nobody touches anything.
-spec new(#{arena => arena(), radius_mm => number()}) -> t().
new(Options) ->
    #floor{
        arena = maps:get(arena, Options, none),
        radius_mm = maps:get(radius_mm, Options, ?RADIUS_MM)
    }.

%% @doc The time between two looks.
-spec period_us() -> pos_integer().
period_us() -> ?PERIOD_US.

%% @doc Handles a new command to drive: the robot moves, and is notified again of what it feels, if
%% it feels anything.
-spec commanded(starl:robot_id(), t()) -> t().
commanded(Id, #floor{touched = Touched} = Floor) ->
    case Touched of
        #{Id := {0, none}} -> Floor;
        #{Id := _} -> Floor#floor{touched = Touched#{Id := {unknown, none}}};
        #{} -> Floor
    end.

%% @doc What these robots feel now, of all bodies there are: only what has changed.
-spec look([starl:robot_id()], [body()], t()) -> {[{starl:robot_id(), touch()}], t()}.
look(Ids, Bodies, Floor) ->
    Feeling = [Body || {Id, _, _} = Body <- Bodies, lists:member(Id, Ids)],
    {Changes, Next} = lists:mapfoldl(fun(One, F) -> feel(One, Bodies, F) end, Floor, Feeling),
    {lists:append(Changes), Next}.

feel({Id, {X, Y, Heading}, Moves}, Bodies, #floor{touched = Touched} = Floor) ->
    Before = maps:get(Id, Touched, {0, none}),
    Points = touching(Id, {X, Y}, Bodies, Floor),
    Now = {bits(Heading, Points), blocked(wants(Before, Moves), Points)},
    Changes = [{Id, touch(Now)} || touch(Now) =/= touch(Before)],
    {Changes, Floor#floor{touched = Touched#{Id => Now}}}.

touch({Bits, Wants}) -> {Bits, Wants =/= none}.

wants({_Bits, none}, Moves) -> Moves;
wants({_Bits, Wants}, _Stands) -> Wants.

%% The directions, as unit vectors, of what a robot touches.
touching(Id, Here, Bodies, #floor{arena = Arena, radius_mm = Radius}) ->
    [
        Towards
     || {Other, {X, Y, _}, _} <- Bodies, Other =/= Id, Towards <- disc(Here, {X, Y}, Radius)
    ] ++
        walls(Here, Arena, Radius).

disc({X, Y}, {OX, OY}, Radius) ->
    DX = OX - X,
    DY = OY - Y,
    case math:sqrt(DX * DX + DY * DY) of
        Distance when Distance > 2 * Radius -> [];
        Distance when Distance == 0 -> [];
        Distance -> [{DX / Distance, DY / Distance}]
    end.

walls(_Here, none, _Radius) ->
    [];
walls({X, Y}, {Width, Height}, Radius) ->
    Sides = [
        {X, {-1.0, 0.0}}, {Y, {0.0, -1.0}}, {Width - X, {1.0, 0.0}}, {Height - Y, {0.0, 1.0}}
    ],
    [Towards || {Distance, Towards} <- Sides, Distance =< Radius].

blocked({VX, VY} = Velocity, Points) ->
    Least = ?ALONG * math:sqrt(VX * VX + VY * VY),
    case Least > 0 andalso lists:any(fun({DX, DY}) -> VX * DX + VY * DY > Least end, Points) of
        true -> Velocity;
        false -> none
    end.

bits(Heading, Points) ->
    lists:foldl(fun(Point, Bits) -> bit(Heading, Point) bor Bits end, 0, Points).

bit(Heading, {DX, DY}) ->
    Ahead = DX * math:cos(Heading) + DY * math:sin(Heading),
    ToLeft = DY * math:cos(Heading) - DX * math:sin(Heading),
    zone(math:atan2(ToLeft, Ahead)).

zone(Angle) when abs(Angle) =< ?MIDDLE -> 3;
zone(Angle) when abs(Angle) > ?SIDE -> 0;
zone(Angle) when Angle > 0 -> 2;
zone(_Angle) -> 1.
