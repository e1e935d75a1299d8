%% @doc The contract of the search. A robot that reports `complete' is right: until the ball is
%% found, all floor that a camera can come to see is seen. A robot that reports the ball could see
%% it: the ball is in the camera's view and not behind a wall. The reported place is right to within
%% the accuracy of cameras. After that, all living robots are done within a bound, counted from the
%% heal if that comes later.
%%
%% What is seen follows from the true poses of the robots when their cameras answered: points all
%% over the floor, where a ball has room, in the field and the range of a camera, without anything
%% in between. The monitor knows nothing of the plan of the search. It counts twice:
%%
%% <dl>
%% <dt>seen</dt><dd>by a camera without a fault, with nothing in the way: walls, obstacles, robots. The report
%% names what is left.</dd>
%% <dt>judged</dt><dd>what a robot cannot know is left out: obstacles that are not on its plan, a camera that
%% answers although it is frozen or wrong, the body of another robot. A robot that reports
%% `complete' before all of that is seen breaks the contract.</dd>
%% </dl>
%%
%% Events of machine `chassis': `motion'; of machine `location': `felt'; of machine `app':
%% {@link starl_search:event()}, `done'; of machine `robot': `died'; of machine `supervisor':
%% `given_up'.
-module(starl_search_monitor).
-behaviour(starl_monitor).

-export([init/1, context/2, broken/2, step/2, finish/2, interests/0, vocabulary/0]).

-type points() :: #{pos_integer() => starl_geometry:point()}.

-record(state, {
    walls :: starl_walls:t(),
    obstacles :: starl_obstacles:t(),
    ball :: starl_geometry:point() | none,
    ball_mm :: float(),
    range :: float(),
    field :: float(),
    wall_mm :: float(),
    profiles :: starl_chassis:profiles(),
    %% how far a ball is at most from where it is said to be: so much, and this part of its distance
    off :: {Mm :: float(), Part :: float()},
    within :: integer(),
    healed = 0 :: integer() | never,
    %% when cameras were not to be believed, and robots not where they took themselves to be
    senses :: [starl_assumption:window()],
    places :: [starl_assumption:window()],
    %% the robots that are not done
    left :: [starl:robot_id()],
    grid :: starl_grid:t(pos_integer()),
    total :: non_neg_integer(),
    %% the points that are not seen yet, and those of them that count for the contract
    unseen :: points(),
    judged :: points(),
    misplaced = false :: boolean(),
    %% is it known whether the rest can be seen at all?
    closed = false :: boolean(),
    %% how many points were seen when, the latest first
    seen = [{0, 0}] :: [{AtUs :: integer(), non_neg_integer()}, ...],
    pieces = #{} :: #{starl:robot_id() => starl_trajectory:piece()},
    starts = #{} :: #{starl:robot_id() => starl_geometry:point()},
    %% what each robot's camera looked at last: the same look shows nothing new
    looks = #{} :: #{starl:robot_id() => term()},
    found = none :: integer() | none,
    done = none :: integer() | none,
    late = false :: boolean()
}).

%% The distance of the points of the floor (mm).
-define(STEP_MM, 150.0).
%% A camera's range and field have a margin for the motion within a window (mm, rad).
-define(MARGIN_MM, 50.0).
-define(MARGIN_RAD, 0.1).
%% More than a body is wide (mm).
-define(BODY_MM, 5.0).
%% What can be seen is seen from one of places so far apart (mm), through gaps of twice this room, and from
%% nearer than the range by this.
-define(PLACES_MM, 200.0).
-define(ROOM_MM, 150.0).
-define(NEARER_MM, 300.0).
%% The looks before a ball is said to be found take so long.
-define(LOOKS_US, 2000000).

-spec init(#{
    floor := starl_floor:t(),
    ball := starl_geometry:point() | none,
    ball_mm := float(),
    range_mm := float(),
    field := float(),
    wall_mm := float(),
    profiles := starl_chassis:profiles(),
    off := {Mm :: float(), Part :: float()},
    robots := [starl:robot_id()],
    within_us := integer(),
    healed_us => integer() | never,
    senses => [starl_assumption:window()],
    places => [starl_assumption:window()],
    obstacles => [{FromUs :: integer(), ToUs :: integer(), Kind :: atom(), Params :: map()}]
}) -> #state{}.
init(#{floor := Floor, ball := Ball, ball_mm := BallMm, robots := Robots} = Config) ->
    Walls = starl_walls:new(Floor),
    Points = lists:enumerate([P || P <- [Ball], P =/= none] ++ points(Floor, BallMm, Walls)),
    Enter = fun({N, P}, Grid) -> starl_grid:add(N, {P, P}, Grid) end,
    #state{
        walls = Walls,
        obstacles = starl_obstacles:new(obstacles(Floor, Config), Walls),
        ball = Ball,
        ball_mm = BallMm,
        range = maps:get(range_mm, Config),
        field = maps:get(field, Config),
        wall_mm = maps:get(wall_mm, Config),
        profiles = maps:get(profiles, Config),
        off = maps:get(off, Config),
        within = maps:get(within_us, Config),
        healed = maps:get(healed_us, Config, 0),
        senses = maps:get(senses, Config, []),
        places = maps:get(places, Config, []),
        left = Robots,
        grid = lists:foldl(Enter, starl_grid:new(500.0), Points),
        total = length(Points),
        unseen = maps:from_list(Points),
        judged = maps:from_list(Points)
    }.

%% The free floor, where a ball has room, whoever may come there.
points(#{size := {W, H}} = Floor, Ball, Walls) ->
    Cells = starl_search_cells:new(Floor, Ball),
    [
        P
     || I <- lists:seq(0, trunc(W / ?STEP_MM)),
        J <- lists:seq(0, trunc(H / ?STEP_MM)),
        P <- [{(I + 0.5) * ?STEP_MM, (J + 0.5) * ?STEP_MM}],
        starl_walls:is_free({P, P}, Ball, Walls),
        starl_search_cells:has(P, Cells)
    ].

obstacles(Floor, Config) ->
    [
        {From, To, Sides}
     || {From, To, Kind, Params} <- maps:get(obstacles, Config, []),
        [_ | _] = Sides <- [starl_obstacles:of_fault(Kind, Params, Floor)]
    ].

%% @doc When all faults are over; when cameras and places are not to be believed; and what stands in the way.
-spec context(starl_monitor:known(), map()) -> map().
context(#{healed_us := Healed, broken := Broken, positions := Positions} = Known, Config) ->
    Config#{
        healed_us => Healed,
        senses => maps:get(senses, Known, []),
        places => Positions ++ [Window || {_, _, _, position} = Window <- Broken],
        obstacles => maps:get(obstacles, Known, [])
    }.

%% @doc In real time a fault is known when it happens.
-spec broken(starl_assumption:window(), #state{}) -> #state{}.
broken({_, _, To, What} = Window, #state{healed = Healed, places = Places} = State) ->
    State#state{
        healed = max(Healed, To), places = [Window || What =:= position] ++ Places
    }.

-spec interests() -> [atom()].
interests() -> [chassis, location, app, robot, supervisor].

%% @doc {@link starl_search:event()}.
-spec vocabulary() -> starl_event:vocabulary().
vocabulary() -> #{app => [{found, 1}]}.

-spec step(starl_monitor:trace_event(), #state{}) ->
    {ok, #state{}} | {violation, starl_monitor:violation(), #state{}}.
step({T, _, _, _} = Event, State) ->
    case late(T, State) of
        [] -> judge(Event, State);
        Late -> starl_violation:step(Late, State#state{late = true})
    end.

judge({T, Robot, chassis, {motion, Piece}}, #state{pieces = Pieces, starts = Starts} = State) ->
    At = starl_trajectory:position(T, Piece),
    {ok, State#state{
        pieces = Pieces#{Robot => Piece}, starts = maps:merge(#{Robot => At}, Starts)
    }};
judge({T, Robot, location, {felt, camera}}, State) ->
    {ok, looked(T, Robot, State)};
judge({T, Robot, app, {found, At}}, #state{found = Found} = State) ->
    Next = State#state{found = first(Found, T)},
    case found(T, Robot, At, State) of
        ok -> {ok, Next};
        {What, Details} -> {violation, violation(What, T, [Robot], Details#{at => At}), Next}
    end;
judge({T, Robot, app, {done, complete}}, State) ->
    complete(T, Robot, is_done(T, Robot, State));
judge({T, Robot, app, {done, _}}, State) ->
    {ok, is_done(T, Robot, State)};
judge({T, Robot, robot, {died, _}}, State) ->
    {ok, is_done(T, Robot, State)};
judge({T, Robot, supervisor, {given_up, app}}, State) ->
    {ok, is_done(T, Robot, State)};
judge(_Event, State) ->
    {ok, State}.

first(none, T) -> T;
first(Before, _T) -> Before.

is_done(T, Robot, #state{left = Left} = State) ->
    case lists:delete(Robot, Left) of
        [] when Left =/= [] -> State#state{left = [], done = T};
        Others -> State#state{left = Others}
    end.

%% Some are not done in time after the ball was found.
late(T, #state{found = Found, healed = Healed, within = Within, left = [_ | _] = Left} = State) when
    Found =/= none, Healed =/= never, not State#state.late
->
    Due = max(Found, Healed) + Within,
    [violation(not_done, Due, Left, #{found_us => Found, due_us => Due}) || T > Due];
late(_T, _State) ->
    [].

%% -- found ------------------------------------------------------------------------------------

%% Can the robot see the ball, and is it where the robot says?
found(_T, _Robot, _At, #state{ball = none}) ->
    {not_there, #{}};
found(T, Robot, At, #state{ball = Ball, pieces = Pieces, off = {Mm, Part}} = State) ->
    Pose = starl_trajectory:pose(T, maps:get(Robot, Pieces)),
    {X, Y, _} = Pose,
    Far = starl_geometry:distance({X, Y}, Ball),
    Off = starl_geometry:distance(At, Ball),
    case is_in_view(Ball, Pose, State) of
        false ->
            {not_there, #{}};
        true when Off =< Mm + Part * Far ->
            ok;
        true ->
            case is_doubtful(Robot, T, State) of
                true -> ok;
                false -> {misplaced, #{ball => Ball, off_mm => Off}}
            end
    end.

is_in_view(Ball, {X, Y, _} = Pose, #state{range = Range, field = Field, walls = Walls}) ->
    starl_geometry:distance({X, Y}, Ball) =< Range + ?MARGIN_MM andalso
        abs(starl_sense:bearing(Ball, Pose)) =< Field / 2 + ?MARGIN_RAD andalso
        starl_sight:is_clear({X, Y}, Ball, [], Walls).

is_doubtful(Robot, T, #state{senses = Senses, places = Places}) ->
    met(Robot, T - ?LOOKS_US, T, Senses ++ Places).

met(Robot, From, To, Windows) ->
    lists:any(
        fun({Whom, Begin, End, _}) ->
            (Whom =:= Robot orelse Whom =:= all) andalso Begin =< To andalso From =< End
        end,
        Windows
    ).

%% -- seen -------------------------------------------------------------------------------------

%% A camera has answered. The same look once more shows nothing new.
looked(T, Robot, #state{looks = Looks, pieces = Pieces, obstacles = Obstacles} = State) ->
    Sides = starl_obstacles:sides(T, Obstacles),
    Well = not met(Robot, T, T, State#state.senses),
    Look = {Pieces, Sides, Well},
    IsStill = starl_trajectory:is_still(maps:get(Robot, Pieces)),
    case Looks of
        #{Robot := Look} when IsStill -> State;
        #{} -> shown(T, Robot, Sides, Well, State#state{looks = Looks#{Robot => Look}})
    end.

shown(T, Robot, Sides, Well, #state{pieces = Pieces, walls = Walls, range = Range} = State) ->
    #{Robot := Piece} = Pieces,
    {X, Y, _} = Pose = starl_trajectory:pose(T, Piece),
    Box = starl_geometry:grow({X, Y, X, Y}, Range),
    Near = [Side || {_, Side} <- starl_walls:near(Box, 0.0, Walls)],
    In = [
        {N, P}
     || {N, P} <- in_range(Pose, Box, State), is_clear({{X, Y}, P}, Near)
    ],
    Bodies = bodies(T, Robot, {X, Y}, State),
    Seen = [
        N
     || Well, {N, P} <- In, is_clear({{X, Y}, P}, Sides), not is_hidden({{X, Y}, P}, Bodies)
    ],
    Misplaced = State#state.misplaced orelse met(Robot, T, T, State#state.places),
    counted(T, State#state{
        judged = maps:without([N || {N, _} <- In], State#state.judged),
        unseen = maps:without(Seen, State#state.unseen),
        misplaced = Misplaced
    }).

%% The points that are left in the field and the range of a camera.
in_range({X, Y, _} = Pose, Box, #state{range = Range, field = Field, grid = Grid} = State) ->
    #state{unseen = Unseen} = State,
    [
        {N, P}
     || N <- starl_grid:near(Box, 0.0, Grid),
        #{N := P} <- [Unseen],
        starl_geometry:distance2({X, Y}, P) =< Range * Range,
        abs(starl_sense:bearing(P, Pose)) =< Field / 2
    ].

is_clear(Sight, Sides) ->
    not lists:any(fun(Side) -> starl_geometry:closer(Sight, Side, 0.01) end, Sides).

bodies(T, Robot, From, #state{pieces = Pieces, profiles = Profiles, range = Range}) ->
    [
        {At, Radius + ?BODY_MM}
     || {Other, Piece} <- lists:sort(maps:to_list(Pieces)),
        Other =/= Robot,
        At <- [starl_trajectory:position(T, Piece)],
        Radius <- [starl_chassis:radius_mm(starl_chassis:of_robot(Other, Profiles))],
        starl_geometry:distance(From, At) =< Range + Radius
    ].

%% A body on the ball does not hide it.
is_hidden({_, P} = Sight, Bodies) ->
    lists:any(
        fun({At, Radius}) ->
            starl_geometry:point_segment(At, Sight) < Radius andalso
                starl_geometry:distance(At, P) > Radius - 2 * ?BODY_MM
        end,
        Bodies
    ).

counted(T, #state{unseen = Unseen, total = Total, seen = [{_, Before} | _] = Seen} = State) ->
    case Total - map_size(Unseen) of
        Before -> State;
        N -> State#state{seen = [{T, N} | Seen]}
    end.

%% -- complete ---------------------------------------------------------------------------------

%% All that a camera can come to see has to be seen. A robot that was told wrong places has looked elsewhere.
complete(T, Robot, #state{judged = Judged, misplaced = false, closed = false} = State) ->
    Next = State#state{closed = true},
    case map_size(Judged) > 0 andalso can_be_seen(Judged, State) of
        {ok, P} ->
            Details = #{at => P, points => map_size(Judged)},
            {violation, violation(not_seen, T, [Robot], Details), Next};
        _ ->
            {ok, Next}
    end;
complete(_T, _Robot, State) ->
    {ok, State}.

%% One of these points that is in sight of a place to which robots can come.
can_be_seen(Points, #state{grid = _} = State) ->
    Places = places(State),
    case lists:search(fun(P) -> is_in_sight(P, Places, State) end, in_order(Points)) of
        {value, P} -> {ok, P};
        false -> none
    end.

in_order(Points) -> [P || {_, P} <- lists:sort(maps:to_list(Points))].

is_in_sight({X, Y} = P, Places, #state{range = Range, ball_mm = Ball, walls = Walls}) ->
    Most = Range - ?NEARER_MM,
    Box = starl_geometry:grow({X, Y, X, Y}, max(0.0, Most)),
    lists:any(
        fun(Q) ->
            Mm = starl_geometry:distance(P, Q),
            Mm > Ball andalso Mm =< Most andalso
                starl_walls:is_free(
                    {Q, starl_geometry:interpolate(Q, P, 1.0 - Ball / Mm)}, ?ROOM_MM, Walls
                )
        end,
        starl_grid:near(Box, 0.0, Places)
    ).

%% Where robots can come to from where they began, with room to spare.
places(#state{starts = Starts, walls = Walls, wall_mm = Mm}) ->
    Room = Mm + ?PLACES_MM / 2,
    Begin = lists:usort([cell(P) || {_, P} <- lists:sort(maps:to_list(Starts))]),
    Roomy = [Near || Cell <- Begin, Near <- [Cell | beside(Cell)], is_roomy(Near, Room, Walls)],
    Cells = come(Roomy, maps:from_keys(Roomy, true), Room, Walls),
    lists:foldl(
        fun(Cell, Grid) -> starl_grid:add(middle(Cell), {middle(Cell), middle(Cell)}, Grid) end,
        starl_grid:new(500.0),
        lists:sort(maps:keys(Cells))
    ).

come([], Come, _Room, _Walls) ->
    Come;
come([Cell | Cells], Come, Room, Walls) ->
    New = [N || N <- beside(Cell), not is_map_key(N, Come), is_roomy(N, Room, Walls)],
    come(New ++ Cells, maps:merge(Come, maps:from_keys(New, true)), Room, Walls).

cell({X, Y}) -> {floor(X / ?PLACES_MM), floor(Y / ?PLACES_MM)}.

middle({I, J}) -> {(I + 0.5) * ?PLACES_MM, (J + 0.5) * ?PLACES_MM}.

beside({I, J}) -> [{I + 1, J}, {I, J + 1}, {I - 1, J}, {I, J - 1}].

is_roomy(Cell, Room, Walls) ->
    P = middle(Cell),
    starl_walls:is_free({P, P}, Room, Walls).

violation(What, T, Robots, Details) ->
    starl_violation:new(search, What, T, Robots, Details).

%% @doc Results: the floor and the part of it that no camera has seen, m2, with its points; when the ball was
%% found first, and when the last robot was done; over time how much floor was seen; and what was not judged.
-spec finish(integer(), #state{}) ->
    {ok | {violation, [starl_monitor:violation(), ...]}, starl_monitor:results()}.
finish(EndUs, State) ->
    #state{unseen = Unseen, total = Total, found = Found, done = Done, seen = Seen} = State,
    Results = #{
        floor_m2 => m2(Total),
        unseen_m2 => m2(map_size(Unseen)),
        left => in_order(Unseen),
        found_us => Found,
        done_us => Done,
        unjudged => unjudged(State),
        measured => [{T, floor_seen_m2, m2(N)} || {T, N} <- steps(EndUs, Seen)]
    },
    starl_violation:finish(late(EndUs, State), Results).

m2(Points) -> Points * ?STEP_MM * ?STEP_MM / 1.0e6.

unjudged(#state{misplaced = true, judged = Judged}) when map_size(Judged) > 0 ->
    ["not judged: search, all floor is seen: robots were told wrong places when they looked"];
unjudged(_State) ->
    [].

%% Each number until the next one, so that a plot has steps.
steps(EndUs, [{_, Last} | _] = Seen) -> steps(lists:reverse(Seen)) ++ [{EndUs, Last}].

steps([{T, N}, {Next, More} | Seen]) -> [{T, N}, {Next, N} | steps([{Next, More} | Seen])];
steps(Last) -> Last.
