%% @doc The contract of contact: no body is ever in a wall, and no body passes through another. If
%% an application promises it, no body touches anything at all.
%%
%% The depth of a body in a wall is judged at every instant, along the chords of its path. Two
%% bodies may overlap by the distance that they drive while neither knows of the other's motion. A
%% body that stands where an obstacle appears gets no deeper into it, and may bump.
%%
%% Events: of machine `chassis', `motion' and `sensed'; of `robot', `died'.
-module(starl_contact_monitor).
-behaviour(starl_monitor).

-export([init/1, step/2, finish/2, interests/0]).

-record(state, {
    walls :: starl_walls:t(),
    obstacles :: starl_obstacles:t() | none,
    profiles :: starl_chassis:profiles(),
    never_bumps :: boolean(),
    separation :: starl_separation:t(),
    pieces = #{} :: #{starl:robot_id() => {FromUs :: integer(), starl_trajectory:piece()}},
    bumps = 0 :: non_neg_integer(),
    %% the least distance of a body's edge from a wall (mm)
    least = none :: float() | none,
    %% how deep a robot was when an obstacle appeared where it stands (mm)
    caught = #{} :: #{starl:robot_id() => float()}
}).

%% How deep a body may be in a wall, and the error of the chords (mm).
-define(DEEP_MM, 0.1).
-define(CHORD_MM, 0.01).
%% Beyond this no distance from a wall is measured (mm).
-define(MOST_MM, 1000.0).
%% A bump within this of an obstacle is one at it.
-define(AT_MM, 1.0).

%% @doc `unaware_us': the time in which no robot knows of another's new motion. Obstacles are nobody's
%% promise: a bump at one breaks none.
-spec init(#{
    walls := starl_walls:t(),
    profiles := starl_chassis:profiles(),
    unaware_us := non_neg_integer(),
    obstacles => starl_obstacles:t(),
    never_bumps => boolean()
}) -> #state{}.
init(#{walls := Walls, profiles := Profiles, unaware_us := Us} = Config) ->
    Sum = 2 * lists:min([starl_chassis:radius_mm(Profile) || Profile <- Profiles]),
    Fastest = lists:max([Speed || #{speed := Speed} <- Profiles]),
    #state{
        walls = Walls,
        obstacles = maps:get(obstacles, Config, none),
        profiles = Profiles,
        never_bumps = maps:get(never_bumps, Config, false),
        separation = starl_separation:new(Sum - ?DEEP_MM - 2 * Fastest * Us / 1.0e6)
    }.

%% @doc The motion and the touch of bodies, and the end of robots.
-spec interests() -> [atom()].
interests() -> [chassis, robot].

%% @doc Judges the time until an event.
-spec step(starl_monitor:trace_event(), #state{}) ->
    {ok, #state{}} | {violation, starl_monitor:violation(), #state{}}.
step({T, Robot, chassis, {motion, Piece}}, #state{separation = Before, pieces = Pieces} = State) ->
    {Deep, Driven} = driven(Robot, T, State),
    {Met, Advanced} = starl_separation:advance(T, Before),
    starl_violation:step(
        Deep ++ met(Met),
        Driven#state{
            separation = starl_separation:motion(Robot, Piece, Advanced),
            pieces = Pieces#{Robot => {max(T, starl_trajectory:start_us(Piece)), Piece}}
        }
    );
step({T, Robot, chassis, {sensed, {bump, Side}}}, #state{bumps = N, never_bumps = Never} = State) ->
    Broken = Never andalso not at_obstacle(T, Robot, State),
    starl_violation:step([violation(bump, T, [Robot], #{side => Side}) || Broken], State#state{
        bumps = N + 1
    });
step(_, State) ->
    {ok, State}.

met(Met) ->
    [violation(in_another, At, [A, B], #{distance_mm => Mm}) || {Mm, At, {A, B}} <- Met].

violation(What, At, Robots, Details) ->
    starl_violation:new(contact, What, At, Robots, Details).

at_obstacle(_T, _Robot, #state{obstacles = none}) ->
    false;
at_obstacle(T, Robot, #state{obstacles = Obstacles, pieces = Pieces} = State) ->
    #{Robot := {_, Piece}} = Pieces,
    Place = starl_trajectory:position(T, Piece),
    Near = radius(Robot, State) + ?AT_MM,
    lists:any(
        fun(Side) -> starl_geometry:point_segment(Place, Side) =< Near end,
        starl_obstacles:sides(T, Obstacles)
    ).

radius(Robot, #state{profiles = Profiles}) ->
    starl_chassis:radius_mm(starl_chassis:of_robot(Robot, Profiles)).

%% The way of a robot since it was last judged, piece by piece between changes of the obstacles.
driven(Robot, T, #state{pieces = Pieces} = State) ->
    case Pieces of
        #{Robot := {From, Piece}} when From =< T ->
            lists:foldl(
                fun(Stretch, {Found, S}) ->
                    {More, Next} = stretch(Stretch, Robot, Piece, S),
                    {Found ++ More, Next}
                end,
                {[], State},
                stretches(From, T, State)
            );
        #{} ->
            {[], State}
    end.

stretches(From, T, #state{obstacles = none, walls = Walls}) -> [{From, T, Walls}];
stretches(From, T, #state{obstacles = Obstacles}) -> starl_obstacles:stretches(From, T, Obstacles).

stretch({From, To, Walls}, Robot, Piece, State0) ->
    R = radius(Robot, State0),
    Room = room(starl_trajectory:polyline(Piece, From, To, ?CHORD_MM), R, Walls),
    #state{caught = Caught, least = Least} = State = caught(From, Robot, Piece, Walls, State0),
    Deep = [
        violation(in_a_wall, To, [Robot], #{deep_mm => -Room, since_us => From})
     || Room < -max(?DEEP_MM, maps:get(Robot, Caught, 0.0) + ?CHORD_MM)
    ],
    {Deep, State#state{least = min(Least, Room)}}.

%% A body in the way of an obstacle that appears is as deep in it as it stands there, until it is out.
caught(_T, _Robot, _Piece, _Walls, #state{obstacles = none} = State) ->
    State;
caught(T, Robot, Piece, Walls, #state{obstacles = Obstacles, caught = Caught} = State) ->
    Place = starl_trajectory:position(T, Piece),
    R = radius(Robot, State),
    Depth = fun(Side) -> R - starl_geometry:point_segment(Place, Side) end,
    New = lists:max([0.0 | [Depth(Side) || Side <- starl_obstacles:caught(T, Obstacles)]]),
    Deep = R - starl_walls:clearance({Place, Place}, R, Walls),
    case max(New, min(Deep, maps:get(Robot, Caught, 0.0))) of
        Mm when Mm > 0.0 -> State#state{caught = Caught#{Robot => Mm}};
        _Out -> State#state{caught = maps:remove(Robot, Caught)}
    end.

%% The distance of the body's edge from the nearest wall. A way that begins free gets into a solid only
%% across a wall, at no distance from it. Numbers are less than atoms.
room([First | _] = Points, R, Walls) ->
    case starl_walls:is_solid(First, Walls) of
        true -> -R;
        false -> least(Points, Walls) - R
    end.

least([Point], Walls) -> starl_walls:clearance({Point, Point}, ?MOST_MM, Walls);
least([A, B], Walls) -> starl_walls:clearance({A, B}, ?MOST_MM, Walls);
least([A, B | Points], Walls) -> min(least([A, B], Walls), least([B | Points], Walls)).

%% @doc Judges the time until the end. Results: the number of bumps, and the least distance of a
%% body's edge from a wall (mm; 0 or a little less where it touched one).
-spec finish(integer(), #state{}) ->
    {ok | {violation, [starl_monitor:violation(), ...]}, starl_monitor:results()}.
finish(EndUs, #state{pieces = Pieces, separation = Separation} = State) ->
    {Deep, #state{least = Least, bumps = Bumps}} = lists:foldl(
        fun(Robot, {Found, S}) ->
            {More, Next} = driven(Robot, EndUs, S),
            {Found ++ More, Next}
        end,
        {[], State},
        lists:sort(maps:keys(Pieces))
    ),
    {Met, Nearest} = starl_separation:finish(EndUs, Separation),
    Results = #{bumps => Bumps, least_room_mm => Least, least_distance_mm => nearest(Nearest)},
    starl_violation:finish(Deep ++ met(Met), Results).

nearest({Mm, _, _}) -> Mm;
nearest(none) -> none.
