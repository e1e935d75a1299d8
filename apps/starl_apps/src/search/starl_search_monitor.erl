%% @doc The contract of the search. Until the ball is found every room that can be reached is
%% searched: a robot that says `complete' is right, each line was driven by some robot. Who says
%% that it has found the ball could see it: it is there, in the camera's range and not behind a
%% wall. And then all that live are done within a bound, counted from the heal if that comes later.
%%
%% Events of machine `chassis': `motion'; of machine `app': {@link starl_search:event()}, `done'; of
%% machine `robot': `died'; of machine `supervisor': `given_up'.
-module(starl_search_monitor).
-behaviour(starl_monitor).

-export([init/1, context/2, broken/2, step/2, finish/2, interests/0, vocabulary/0]).

-record(state, {
    walls :: starl_walls:t(),
    ball :: starl_geometry:point() | none,
    range :: float(),
    within :: integer(),
    healed = 0 :: integer() | never,
    %% the robots that are not done
    left :: [starl:robot_id()],
    %% the points of the lines that nobody has come by yet
    points :: #{pos_integer() => starl_geometry:point()},
    total :: non_neg_integer(),
    grid :: starl_grid:t(pos_integer()),
    %% the room of each point, and how many points of each room are left
    rooms :: #{pos_integer() => atom()},
    open :: #{atom() => pos_integer()},
    %% how many rooms were searched when, the latest first
    searched = [{0, 0}] :: [{AtUs :: integer(), non_neg_integer()}, ...],
    pieces = #{} :: #{starl:robot_id() => {FromUs :: integer(), starl_trajectory:piece()}},
    found = none :: integer() | none,
    done = none :: integer() | none,
    late = false :: boolean()
}).

%% The distance of the points of a line, and how far from one a robot has come by it (mm).
-define(STEP_MM, 200.0).
-define(BY_MM, 60.0).
-define(CHORD_MM, 1.0).
%% A camera's range has a margin for the motion within a window (mm).
-define(MARGIN_MM, 50.0).

-spec init(#{
    floor := starl_floor:t(),
    lines := [starl_geometry:segment()],
    ball := starl_geometry:point() | none,
    range_mm := float(),
    robots := [starl:robot_id()],
    within_us := integer(),
    healed_us => integer() | never
}) -> #state{}.
init(#{floor := Floor, lines := Lines, ball := Ball, robots := Robots} = Config) ->
    Points = lists:enumerate([P || Line <- Lines, P <- points(Line)]),
    Rooms = [{N, room(P, Floor)} || {N, P} <- Points],
    Enter = fun({N, P}, Grid) -> starl_grid:add(N, {P, P}, Grid) end,
    #state{
        walls = starl_walls:new(Floor),
        ball = Ball,
        range = maps:get(range_mm, Config),
        within = maps:get(within_us, Config),
        healed = maps:get(healed_us, Config, 0),
        left = Robots,
        points = maps:from_list(Points),
        total = length(Points),
        rooms = maps:from_list(Rooms),
        open = lists:foldl(fun({_, Room}, Open) -> more(Room, Open) end, #{}, Rooms),
        grid = lists:foldl(Enter, starl_grid:new(500.0), Points)
    }.

points({A, B} = Line) ->
    N = max(1, ceil(starl_geometry:length(Line) / ?STEP_MM)),
    [starl_geometry:interpolate(A, B, I / N) || I <- lists:seq(0, N)].

room(P, Floor) ->
    case starl_floor:room_at(P, Floor) of
        {ok, Room} -> Room;
        _None -> floor
    end.

more(Room, Open) -> maps:update_with(Room, fun(N) -> N + 1 end, 1, Open).

%% @doc When all faults are over.
-spec context(starl_monitor:known(), map()) -> map().
context(#{healed_us := Healed}, Config) -> Config#{healed_us => Healed}.

%% @doc In real time a fault is known when it happens.
-spec broken(starl_assumption:window(), #state{}) -> #state{}.
broken({_, _, To, _}, #state{healed = Healed} = State) -> State#state{healed = max(Healed, To)}.

-spec interests() -> [atom()].
interests() -> [chassis, app, robot, supervisor].

%% @doc {@link starl_search:event()}.
-spec vocabulary() -> starl_event:vocabulary().
vocabulary() -> #{app => [{found, 1}]}.

-spec step(starl_monitor:trace_event(), #state{}) ->
    {ok, #state{}} | {violation, starl_monitor:violation(), #state{}}.
step({T, _, _, _} = Event, State) ->
    case late(T, State) of
        {violation, _, _} = Violation -> Violation;
        ok -> judge(Event, State)
    end.

judge({T, Robot, chassis, {motion, Piece}}, State) ->
    #state{pieces = Pieces} = Driven = driven(Robot, T, State),
    From = max(T, starl_trajectory:start_us(Piece)),
    {ok, Driven#state{pieces = Pieces#{Robot => {From, Piece}}}};
judge({T, Robot, app, {found, At}}, #state{found = Found} = State) ->
    Next = State#state{found = first(Found, T)},
    case sees(T, Robot, State) of
        true -> {ok, Next};
        false -> {violation, violation(not_there, T, [Robot], #{at => At}), Next}
    end;
judge({T, Robot, app, {done, complete}}, State) ->
    #state{points = Points} = All = all_driven(T, State),
    Next = is_done(T, Robot, All),
    case maps:values(Points) of
        [] -> {ok, Next};
        [P | _] -> {violation, violation(not_searched, T, [Robot], #{at => P}), Next}
    end;
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
    case T > Due of
        true ->
            Details = #{found_us => Found, due_us => Due},
            {violation, violation(not_done, Due, Left, Details), State#state{late = true}};
        false ->
            ok
    end;
late(_T, _State) ->
    ok.

%% Does the robot see the ball, walls considered?
sees(_T, _Robot, #state{ball = none}) ->
    false;
sees(T, Robot, #state{ball = Ball, range = Range, pieces = Pieces, walls = Walls}) ->
    #{Robot := {_, Piece}} = Pieces,
    At = starl_trajectory:position(T, Piece),
    starl_geometry:distance(At, Ball) =< Range + ?MARGIN_MM andalso
        starl_sight:is_clear(At, Ball, [], Walls).

%% Removes the points that a robot has come by since it was last judged.
driven(Robot, T, #state{pieces = Pieces} = State) ->
    case Pieces of
        #{Robot := {From, Piece}} when From =< T ->
            Next = come_by(starl_trajectory:polyline(Piece, From, T, ?CHORD_MM), State#state{
                pieces = Pieces#{Robot := {T, Piece}}
            }),
            searched(T, map_size(State#state.open) - map_size(Next#state.open), Next);
        #{} ->
            State
    end.

searched(_T, 0, State) ->
    State;
searched(T, More, #state{searched = [{_, Before} | _] = Searched} = State) ->
    State#state{searched = [{T, Before + More} | Searched]}.

come_by([A | Points], State) -> come_by(A, Points, State).

come_by(A, [], State) ->
    passed({A, A}, State);
come_by(A, [B], State) ->
    passed({A, B}, State);
come_by(A, [B | Points], State) ->
    come_by(B, Points, passed({A, B}, State)).

passed(Way, #state{points = Points, grid = Grid, rooms = Rooms, open = Open} = State) ->
    By = [
        N
     || N <- starl_grid:near(Way, ?BY_MM, Grid),
        #{N := P} <- [Points],
        starl_geometry:point_segment(P, Way) =< ?BY_MM
    ],
    Fewer = lists:foldl(fun(N, Acc) -> fewer(maps:get(N, Rooms), Acc) end, Open, By),
    State#state{points = maps:without(By, Points), open = Fewer}.

fewer(Room, Open) ->
    case Open of
        #{Room := 1} -> maps:remove(Room, Open);
        #{Room := N} -> Open#{Room := N - 1}
    end.

all_driven(T, #state{pieces = Pieces} = State) ->
    lists:foldl(fun(Robot, S) -> driven(Robot, T, S) end, State, lists:sort(maps:keys(Pieces))).

violation(What, T, Robots, Details) ->
    #{contract => search, what => What, at_us => T, robots => Robots, details => Details}.

%% @doc Results: the part of the lines that was driven, the points that nobody came by, when the ball was found first, and when the
%% last robot was done; and over time how many rooms were searched.
-spec finish(integer(), #state{}) ->
    {ok | {violation, [starl_monitor:violation(), ...]}, starl_monitor:results()}.
finish(EndUs, State) ->
    #state{points = Points, total = Total, found = Found, done = Done, searched = Searched} =
        all_driven(EndUs, State),
    Results = #{
        searched => (Total - map_size(Points)) / max(1, Total),
        left => [P || {_, P} <- lists:sort(maps:to_list(Points))],
        found_us => Found,
        done_us => Done,
        measured => [{T, rooms_searched, N} || {T, N} <- steps(EndUs, Searched)]
    },
    case late(EndUs, State) of
        ok -> {ok, Results};
        {violation, Violation, _} -> {{violation, [Violation]}, Results}
    end.

%% Each number until the next one, so that a plot has steps.
steps(EndUs, [{_, Last} | _] = Searched) -> steps(lists:reverse(Searched)) ++ [{EndUs, Last}].

steps([{T, N}, {Next, More} | Searched]) -> [{T, N}, {Next, N} | steps([{Next, More} | Searched])];
steps(Last) -> Last.
