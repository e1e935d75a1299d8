%% @doc The floor of a run: its plan, from the scenario or from the application's scene, and the
%% starting places of the robots.
-module(starl_run_floor).

-export([read/1, given/2, stand/3, placing/1, faults/2, obstacles/2, given_obstacles/1]).

-export_type([problem_of_fault/0]).

%% The longest file of places.
-define(MOST_BYTES, 10000000).

%% The sizes of floors that a scenario may have (mm).
-define(LEAST_MM, 1000).
-define(MOST_MM, 1000000).
-define(USUAL, {12000, 12000}).

-type problem() :: {error, unicode:chardata()}.

%% A fault that is not possible on this floor.
-type problem_of_fault() ::
    {fault_floor, Id :: atom()}
    | {fault_door, Id :: atom(), Door :: pos_integer(), Doors :: non_neg_integer()}.

%% @doc The floor plan that a scenario names.
-spec read(starl_run_scenario:t()) -> {ok, starl_floor:t() | none} | problem().
read(#{floor := none}) ->
    {ok, none};
read(#{floor := Name, floor_scale := Scale}) ->
    case starl_floor_file:read(Name, Scale) of
        {ok, #{size := {W, H}}} when W < ?LEAST_MM; H < ?LEAST_MM; W > ?MOST_MM; H > ?MOST_MM ->
            {error,
                io_lib:format("~ts: a floor is 1 m to 1 km wide and high, not ~.3f m by ~.3f m", [
                    Name, W / 1000, H / 1000
                ])};
        Read ->
            Read
    end.

%% @doc The scenario on this floor: the plan's size is the size of the floor.
-spec given(starl_floor:t() | none, starl_run_scenario:t()) -> starl_run_scenario:t().
given(none, Scenario) -> Scenario;
given(#{size := Size}, Scenario) -> Scenario#{world := Size}.

%% @doc The scene with the start poses of all robots that it does not place itself. On a floor plan
%% all must have room.
-spec stand(starl_run_scenario:t(), starl_scene:t(), starl_scene:context()) ->
    {ok, starl_scene:t()} | problem().
stand(#{start := none}, Scene, _Context) when
    not is_map_key(floor, Scene), is_map_key(poses, Scene)
->
    {ok, Scene};
stand(#{start := none} = Scenario, Scene, Context) when not is_map_key(floor, Scene) ->
    case has_rows(Scenario, Context) orelse places("grid", Scenario, Scene, Context) of
        {ok, Poses} -> {ok, Scene#{poses => Poses}};
        _RowsOrNoRoom -> {ok, Scene}
    end;
stand(#{start := none}, #{poses := Poses} = Scene, #{robots := Ids} = Context) ->
    case [Id || Id <- Ids, not is_map_key(Id, Poses)] of
        [] ->
            checked(Poses, Scene, Context);
        [Id | _] ->
            {error, io_lib:format("the scene has a floor and poses, but none of robot ~b", [Id])}
    end;
stand(#{start := Start}, #{poses := _}, _Context) when Start =/= none ->
    {error, "this application places its robots itself: leave --start out"};
stand(#{start := Start} = Scenario, Scene, Context) ->
    case places(Start, Scenario, Scene, Context) of
        {ok, Poses} -> checked(Poses, Scene#{poses => Poses}, Context);
        {error, _} = Error -> Error
    end.

%% Have all robots room in rows two metres apart? On a floor of the usual size they stand so in any case, as they
%% always did.
has_rows(#{world := World}, _Context) when World == ?USUAL ->
    true;
has_rows(#{world := {Width, Height}}, #{robots := Ids}) ->
    {_, Y, _} = starl_floor_placement:row(lists:max(Ids), Width),
    Width >= ?LEAST_MM andalso Y < Height.

checked(Poses, Scene, #{profiles := Profiles} = Context) ->
    Radius = fun(Id) -> starl_chassis:radius_mm(starl_chassis:of_robot(Id, Profiles)) end,
    case
        starl_floor_placement:check(lists:sort(maps:to_list(Poses)), Radius, walls(Scene, Context))
    of
        ok -> {ok, Scene};
        {error, _} = Error -> Error
    end.

%% @doc How the robots of a planned run are to be put down, where people do that. A floor of the usual size need
%% not be the one that they have.
-spec placing(starl_run:planned()) -> starl_floor_placement:rule().
placing({Scenario, Scene, #{robots := Robots, world := #{profiles := Profiles}}}) ->
    Radius = fun(Id) -> starl_chassis:radius_mm(starl_chassis:of_robot(Id, Profiles)) end,
    Rule = #{
        radii => maps:from_list([{Id, Radius(Id)} || {Id, _} <- Robots]),
        apart_mm => maps:get(apart_mm, Scene, 0),
        error_mm => lists:max([Mm || #{position_error_mm := Mm} <- Profiles])
    },
    case {Scene, Scenario} of
        {#{floor := _}, _} -> Rule#{walls => walls(Scene, Scenario)};
        {_, #{world := World}} when World == ?USUAL -> Rule;
        _ -> Rule#{walls => walls(Scene, Scenario)}
    end.

walls(#{floor := Floor}, _Context) -> starl_walls:new(Floor);
walls(_Scene, #{world := World}) -> starl_walls:new(starl_floor:empty(World)).

places(none, Scenario, Scene, Context) ->
    places("grid", Scenario, Scene, Context);
places(How, #{seed := Seed}, Scene, #{robots := Ids, profiles := Profiles} = Context) ->
    Radius = lists:max([starl_chassis:radius_mm(Profile) || Profile <- Profiles]),
    case lists:keyfind(How, 1, words()) of
        {_, Word} -> starl_floor_placement:places(Word, Ids, Radius, Seed, walls(Scene, Context));
        false -> listed(How, starl_small_file:read(How, ?MOST_BYTES), Ids, Scene)
    end.

words() -> [{atom_to_list(Word), Word} || Word <- [grid, line, circle, random]].

%% A line for each robot: its place (mm) and heading (degrees), or the name of a place of the plan.
listed(File, {error, Posix}, _Ids, _Scene) ->
    Words = lists:join(", ", [Word || {Word, _} <- words()]),
    {error, [File, ": ", file:format_error(Posix), "; --start takes ", Words, ", or a file"]};
listed(File, {ok, Bytes}, Ids, Scene) ->
    Lines = [
        {N, string:lexemes(hd(string:split(Line, "%")), " \t\r,")}
     || {N, Line} <- lists:enumerate(1, string:split(binary_to_list(Bytes), "\n", all))
    ],
    Poses = [{N, pose(Words, places_of(Scene))} || {N, [_ | _] = Words} <- Lines],
    case [N || {N, bad} <- Poses] of
        [N | _] ->
            {error,
                io_lib:format(
                    "~ts:~b: X Y and the heading in degrees expected, or the name of a place", [
                        File, N
                    ]
                )};
        [] when length(Poses) < length(Ids) ->
            {error,
                io_lib:format("~ts: ~b places for ~b robots", [File, length(Poses), length(Ids)])};
        [] ->
            {_, Given} = lists:unzip(lists:sublist(Poses, length(Ids))),
            {ok, maps:from_list(lists:zip(Ids, Given))}
    end.

places_of(#{floor := #{places := Places}}) ->
    maps:from_list([{atom_to_list(Name), Place} || {Name, Place} <- maps:to_list(Places)]);
places_of(_Scene) ->
    #{}.

pose([Name], Places) when is_map_key(Name, Places) ->
    {X, Y} = maps:get(Name, Places),
    {X, Y, 0.0};
pose(Words, _Places) ->
    case [number(Word) || Word <- Words] of
        [X, Y] when is_float(X), is_float(Y) -> {X, Y, 0.0};
        [X, Y, D] when is_float(X), is_float(Y), is_float(D) -> {X, Y, D * math:pi() / 180};
        _ -> bad
    end.

number(Word) ->
    case {string:to_float(Word), string:to_integer(Word)} of
        {{F, []}, _} -> F;
        {_, {I, []}} when is_integer(I) -> float(I);
        _ -> bad
    end.

%% @doc What is wrong with the faults of a floor: it has no plan, or not this door.
-spec faults([starl_run_fault:t()], starl_scene:t()) -> [problem_of_fault()].
faults(Faults, Scene) ->
    [
        Problem
     || {Id, _, _, Kind, _, Params} = Fault <- Faults,
        starl_run_fault:class(Fault) =:= floor,
        Problem <- problem(Id, Kind, Params, maps:get(floor, Scene, none))
    ].

problem(Id, _Kind, _Params, none) ->
    [{fault_floor, Id}];
problem(Id, closed, #{door := Door}, Floor) ->
    case starl_obstacles:door(Door, Floor) of
        {ok, _} -> [];
        {error, Doors} -> [{fault_door, Id, Door, Doors}]
    end;
problem(_Id, _Kind, _Params, _Floor) ->
    [].

%% @doc The obstacles that faults put on a floor, if there are any, as a part of a map.
-spec obstacles([starl_run_fault:t()], starl_floor:t()) -> #{obstacles => starl_obstacles:t()}.
obstacles(Faults, Floor) ->
    case given_obstacles(Faults) of
        [] ->
            #{};
        Given ->
            Known = [
                {From, To, starl_obstacles:of_fault(Kind, Params, Floor)}
             || {From, To, Kind, Params} <- Given
            ],
            #{obstacles => starl_obstacles:new(Known, starl_walls:new(Floor))}
    end.

%% @doc What faults put on whatever floor, and from when to when (us).
-spec given_obstacles([starl_run_fault:t()]) ->
    [{FromUs :: integer(), ToUs :: integer(), Kind :: atom(), Params :: map()}].
given_obstacles(Faults) ->
    [
        {From, To, Kind, Params}
     || Fault <- Faults,
        starl_run_fault:class(Fault) =:= floor,
        {_, From, To, Kind, _, Params} <- [starl_run_fault:compile(Fault)]
    ].
