%% @doc Computes the starting places of a team's robots on a floor plan: outside of its walls, and
%% not on each other. People put real robots down as they like: {@link stands/3} checks one robot.
-module(starl_floor_placement).

-export([places/5, row/2, check/3, stands/3]).

-export_type([how/0, rule/0, problem/0]).

%% In rows; in one row; on a circle; anywhere, drawn from the seed.
-type how() :: grid | line | circle | random.

-type poses() :: #{starl:robot_id() => starl:pose()}.

%% How robots are to be put down: the radius of each body, the least distance of two robots if they need
%% more than not to touch, by how much a place may be told wrong (mm), and the walls, where there are some.
-type rule() :: #{
    radii := #{starl:robot_id() => float()},
    apart_mm := number(),
    error_mm := number(),
    walls => starl_walls:t()
}.

%% Where a robot must not stand.
-type problem() :: off_floor | in_wall | {beside, starl:robot_id()}.

%% Between two bodies, and between a body and a wall (mm).
-define(GAP_MM, 20.0).
%% The spacing of rows that a team takes if there is room, and its steps down.
-define(SPACING_MM, 2000.0).
-define(NARROWER, 0.85).
-define(TRIES, 10000).

%% @doc The start poses of these robots, whose bodies have this radius; one line if there is no
%% room.
-spec places(
    how(), [starl:robot_id(), ...], RadiusMm :: float(), Seed :: integer(), starl_walls:t()
) ->
    {ok, poses()} | {error, unicode:chardata()}.
places(How, Ids, R, Seed, Walls) ->
    case found(How, length(Ids), R, Seed, Walls) of
        {ok, Poses} -> {ok, maps:from_list(lists:zip(Ids, Poses))};
        none -> {error, no_room(How, length(Ids), Walls)}
    end.

%% @doc Where the robot of this number stands in rows two metres apart, on an empty floor of this width (mm).
-spec row(starl:robot_id(), WidthMm :: number()) -> starl:pose().
row(Id, Width) ->
    PerRow = max(1, trunc(Width / ?SPACING_MM)),
    Place = fun(N) -> ?SPACING_MM / 2 + ?SPACING_MM * N end,
    {Place((Id - 1) rem PerRow), Place((Id - 1) div PerRow), 0.0}.

no_room(How, N, Walls) ->
    #{size := {W, H}} = starl_walls:floor(Walls),
    io_lib:format(
        "there is no room for ~b robots (~ts) on a floor of ~.1f m by ~.1f m: use fewer robots, another "
        "--start, or a larger floor",
        [N, How, W / 1000, H / 1000]
    ).

found(random, N, R, Seed, Walls) ->
    drawn(N, R, ?TRIES, rand:seed_s(exsss, erlang:phash2({Seed, start})), Walls, []);
found(How, N, R, _Seed, Walls) ->
    spaced(How, N, R, ?SPACING_MM, Walls).

spaced(_How, _N, R, Spacing, _Walls) when Spacing < 2 * R + ?GAP_MM -> none;
spaced(How, N, R, Spacing, Walls) ->
    case laid(How, N, R, Spacing, Walls) of
        {ok, _} = Ok -> Ok;
        none -> spaced(How, N, R, Spacing * ?NARROWER, Walls)
    end.

laid(grid, N, R, Spacing, Walls) ->
    #{size := {W, H}} = starl_walls:floor(Walls),
    enough(N, [
        {X, Y, 0.0}
     || Y <- steps(H, R, Spacing), X <- steps(W, R, Spacing), is_free({X, Y}, R, Walls)
    ]);
laid(line, N, R, Spacing, Walls) ->
    #{size := {W, H}} = starl_walls:floor(Walls),
    Rows = lists:sort([{abs(Y - H / 2), Y} || Y <- steps(H, R, 2 * R)]),
    first([
        fun() ->
            enough(N, [{X, Y, 0.0} || X <- steps(W, R, Spacing), is_free({X, Y}, R, Walls)])
        end
     || {_, Y} <- Rows
    ]);
laid(circle, N, R, Spacing, Walls) ->
    #{size := {W, H}} = starl_walls:floor(Walls),
    Radius = max(Spacing / 2, N * Spacing / (2 * math:pi())),
    All = [
        {W / 2 + Radius * math:cos(A), H / 2 + Radius * math:sin(A), A + math:pi()}
     || I <- lists:seq(0, N - 1), A <- [2 * math:pi() * I / N]
    ],
    enough(N, [Pose || {X, Y, _} = Pose <- All, is_free({X, Y}, R, Walls)]).

first([]) ->
    none;
first([Row | Rows]) ->
    case Row() of
        none -> first(Rows);
        Ok -> Ok
    end.

enough(N, Poses) when length(Poses) >= N -> {ok, lists:sublist(Poses, N)};
enough(_N, _Poses) -> none.

%% Evenly, with the same margin at both ends.
steps(Length, R, Spacing) ->
    Usable = Length - 2 * (R + ?GAP_MM),
    case Usable < 0 of
        true ->
            [];
        false ->
            Count = trunc(Usable / Spacing),
            First = (Length - Count * Spacing) / 2,
            [First + I * Spacing || I <- lists:seq(0, Count)]
    end.

is_free(Point, R, Walls) -> starl_walls:is_free({Point, Point}, R + ?GAP_MM, Walls).

drawn(0, _R, _Tries, _Random, _Walls, Poses) ->
    {ok, lists:reverse(Poses)};
drawn(_N, _R, 0, _Random, _Walls, _Poses) ->
    none;
drawn(N, R, Tries, Random0, Walls, Poses) ->
    #{size := {W, H}} = starl_walls:floor(Walls),
    {U, Random1} = rand:uniform_s(Random0),
    {V, Random2} = rand:uniform_s(Random1),
    {A, Random} = rand:uniform_s(Random2),
    Point = {U * W, V * H},
    IsBeside = fun({X, Y, _}) -> starl_geometry:distance(Point, {X, Y}) >= 2 * R + ?GAP_MM end,
    case is_free(Point, R, Walls) andalso lists:all(IsBeside, Poses) of
        true ->
            Pose = {U * W, V * H, 2 * math:pi() * A},
            drawn(N - 1, R, ?TRIES, Random, Walls, [Pose | Poses]);
        false ->
            drawn(N, R, Tries - 1, Random, Walls, Poses)
    end.

%% @doc Do these robots, each with the radius of its body, stand on the floor, out of its walls, and
%% not on each other? Otherwise one line that names the first that does not.
-spec check(
    [{starl:robot_id(), starl:pose()}], fun((starl:robot_id()) -> float()), starl_walls:t()
) ->
    ok | {error, unicode:chardata()}.
check(Robots, Radius, Walls) ->
    Problems = [
        {Id, {X, Y}, words(Problem)}
     || {Id, {X, Y, _}} <- Robots,
        Problem <- [on_floor({X, Y}, Radius(Id), Walls)],
        Problem =/= ok
    ],
    case Problems ++ pairs(Robots, Radius) of
        [] ->
            ok;
        [{Id, {X, Y}, Where} | _] ->
            {error,
                io_lib:format("robot ~b would start ~ts, at (~b, ~b) mm", [
                    Id, Where, round(X), round(Y)
                ])}
    end.

on_floor({X, Y} = Point, R, Walls) ->
    #{size := {W, H}} = starl_walls:floor(Walls),
    IsOff = X < 0 orelse Y < 0 orelse X > W orelse Y > H,
    case IsOff orelse starl_walls:is_free({Point, Point}, R, Walls) of
        true when IsOff -> off_floor;
        true -> ok;
        false -> in_wall
    end.

words(off_floor) -> "off the floor";
words(in_wall) -> "in a wall".

pairs([], _Radius) ->
    [];
pairs([{Id, {X, Y, _}} | Others], Radius) ->
    [
        {Id, {X, Y}, io_lib:format("on robot ~b", [Other])}
     || {Other, {OX, OY, _}} <- Others,
        starl_geometry:distance({X, Y}, {OX, OY}) < Radius(Id) + Radius(Other)
    ] ++ pairs(Others, Radius).

%% @doc Does this robot stand well among those whose places are known? Otherwise what is wrong, and one line that says
%% what to do.
-spec stands(starl:robot_id(), poses(), rule()) -> ok | {error, problem(), unicode:chardata()}.
stands(Id, Poses, #{radii := Radii} = Rule) ->
    #{Id := {X, Y, _}} = Poses,
    case {walled(Id, {X, Y}, Rule), nearest(Id, {X, Y}, Poses, Rule)} of
        {ok, none} ->
            ok;
        {ok, {Mm, Other, Least}} ->
            Line =
                "robot ~b stands ~b mm from robot ~b, at (~b, ~b) mm, and does not drive: put them down "
                "at least ~b mm apart",
            Values = [Id, round(Mm), Other, round(X), round(Y), ceil(Least)],
            {error, {beside, Other}, io_lib:format(Line, Values)};
        {Problem, _} ->
            Line =
                "robot ~b stands ~ts, at (~b, ~b) mm, and does not drive: put it down on the floor, at "
                "least ~b mm from every wall",
            Values = [Id, words(Problem), round(X), round(Y), ceil(maps:get(Id, Radii))],
            {error, Problem, io_lib:format(Line, Values)}
    end.

walled(Id, Point, #{walls := Walls, radii := Radii, error_mm := Error}) ->
    on_floor(Point, max(0.0, maps:get(Id, Radii) - Error), Walls);
walled(_Id, _Point, _Rule) ->
    ok.

%% The nearest of those that are too near, how far away it is, and how far it must be.
nearest(Id, Point, Poses, #{radii := Radii, apart_mm := Apart, error_mm := Error}) ->
    Near = [
        {Mm, Other, Least}
     || {Other, {X, Y, _}} <- maps:to_list(maps:remove(Id, Poses)),
        Mm <- [starl_geometry:distance(Point, {X, Y})],
        Least <- [max(Apart, maps:get(Id, Radii) + maps:get(Other, Radii))],
        Mm + 2 * Error < Least
    ],
    lists:min([none || Near =:= []] ++ Near).
