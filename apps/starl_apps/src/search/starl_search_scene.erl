%% @doc The scene of the search: the building with its lines, the ball, the robots on their parking
%% spots, the blocks and the contracts; and what is told before and after a run.
-module(starl_search_scene).

-export([options/0, scene/1, preview/1, report/2]).
-export([lines/2]).

-export_type([room/0]).

%% The distance of the centres of two touching Creates (mm).
-define(CONTACT_MM, 330).
%% More than a robot needs beside a wall (mm).
-define(MARGIN_MM, 5.0).
-define(BALL_MM, 100).
-define(PATIENCE_MS, 30000).
%% Beside what registers take, until all are done (ms): a lease, a request, a leg.
-define(DONE_MS, 60000).

%% A room with its lines; none if it is too narrow.
-type room() :: {Name :: atom(), [starl_geometry:segment()]}.

%% The step in which a line is looked at, the shortest line, and the places where a line is looked
%% for in a room that has none yet.
-define(STEP_MM, 50.0).
-define(SHORTEST_MM, 200.0).
-define(TRIES, 24).

-spec options() -> [starl_options:option()].
options() ->
    [
        {ball, {one_of, [place, random, nowhere]}, place,
            "where the ball is: at the place `object' of the floor plan, anywhere in a room, or nowhere"},
        {spacing, {number, 200, 100000}, 3500,
            "the distance of the lines that are driven in a room, mm"},
        {camera_range, {number, 100, 100000}, 3000, "how far a camera sees the ball, mm"},
        {camera_field, {number, 1, 360}, 360, "the angle of view of a camera, degrees"},
        {safety_distance, {number, ?CONTACT_MM, 5000}, 340,
            "the least distance of any two robots (r_s), mm"},
        {lease, {integer, 100, 1000000}, 10000,
            "the duration of a lease: of a vote, and of a robot's permission to drive, ms"},
        {jump, {integer, 0, 1000000}, 2000,
            "the most by which a clock may be set during a lease, ms; far less than half of a lease"}
    ].

%% @doc The scene on the floor plan of the run, by default that of Java StarL's search.
-spec scene(starl_scene:context()) -> {ok, starl_scene:t()} | {error, unicode:chardata()}.
scene(Context) ->
    case building(Context) of
        {ok, Floor} -> on_floor(Floor, Context);
        {error, _} = Error -> Error
    end.

building(#{floor := #{walls := [], rooms := Rooms}}) when map_size(Rooms) =:= 0 ->
    starl_floor_file:read("search", 1000);
building(#{floor := Floor}) ->
    {ok, Floor}.

on_floor(Floor, #{robots := Ids, profiles := Profiles, options := Options} = Context) ->
    #{spacing := Spacing, safety_distance := Safety} = Options,
    Tracking = starl_chassis:widest(Profiles),
    Body = lists:max([starl_chassis:radius_mm(Profile) || Profile <- Profiles]),
    WallMm = Body + Tracking + ?MARGIN_MM,
    Radius = max(Safety / 2, Body) + Tracking,
    Rooms = lines(Floor, #{spacing => Spacing, wall_mm => WallMm}),
    Wanted = #{
        robots => length(Ids),
        tube_radius => Radius,
        wall_mm => WallMm,
        lines => [Line || {_, Lines} <- Rooms, Line <- Lines],
        near => starl_dpp_floor:near(Floor)
    },
    case {starl_dpp_floor:new(Floor, Wanted), ball(Floor, Rooms, Context)} of
        {{ok, Ways, #{reached := [_ | _] = Reached}}, {ok, Ball}} ->
            {ok, built(Floor, Ways, Reached, Rooms, Ball, Radius, Tracking, Context)};
        {{ok, _, _}, {ok, _}} ->
            {error, "no room of this floor can be reached: use a larger scale, or another plan"};
        {{error, Reason}, _} ->
            {error, starl_dpp_floor:format_error(Reason)};
        {_, {error, _} = Error} ->
            Error
    end.

ball(_Floor, _Rooms, #{options := #{ball := nowhere}}) ->
    {ok, none};
ball(#{places := #{object := At}}, _Rooms, #{options := #{ball := place}}) ->
    {ok, At};
ball(_Floor, _Rooms, #{options := #{ball := place}}) ->
    {error, "the floor plan has no place object: give it one, or use --ball random"};
ball(_Floor, Rooms, #{seed := Seed}) ->
    Lines = [Line || {_, Lines} <- Rooms, Line <- Lines],
    case Lines of
        [] ->
            {error, "no room of this floor is wide enough for a robot"};
        _ ->
            {A, B} = lists:nth(1 + erlang:phash2({Seed, room}, length(Lines)), Lines),
            {ok, starl_geometry:interpolate(A, B, erlang:phash2({Seed, part}, 1001) / 1000)}
    end.

built(Floor, Ways, Reached, Rooms, Ball, Radius, Tracking, Context) ->
    #{robots := Ids, options := Options} = Context,
    {Open, Closed} = lists:partition(
        fun({_, Lines}) -> lists:any(fun(Line) -> lists:member(Line, Reached) end, Lines) end, Rooms
    ),
    Unreached = [Name || {Name, _} <- Closed],
    Plan = plan(Floor, Ways, Reached, Radius, Tracking, Context),
    #{
        notes => closed(#{closed => Unreached}),
        app => {sequential, starl_search, Reached},
        never_crashes => true,
        never_bumps => true,
        floor => Floor,
        poses => maps:from_list(lists:zip(Ids, starl_dpp_floor:places(Ways))),
        apart_mm => maps:get(safety_distance, Options),
        things => things(Ball),
        senses => #{camera => camera(Options)},
        blocks => [
            {starl_election, #{patience_ms => ?PATIENCE_MS}}, starl_registers, {starl_dpp, Plan}
        ],
        monitors => [{starl_search_monitor, contract(Floor, Reached, Ball, Context)}],
        memo => #{
            floor => Floor,
            lines => Reached,
            open => [Name || {Name, _} <- Open],
            closed => Unreached
        }
    }.

plan(#{size := World}, Ways, Reached, Radius, Tracking, #{seed := Seed, options := Options}) ->
    #{
        segments => Reached,
        world => World,
        tube_radius => Radius,
        slack => Tracking,
        horizon => 6000.0,
        patience => infinity,
        ways => Ways,
        seed => Seed,
        lease_ms => maps:get(lease, Options),
        jump_ms => maps:get(jump, Options)
    }.

contract(Floor, Reached, Ball, #{robots := Ids, options := #{camera_range := Range}}) ->
    #{
        floor => Floor,
        lines => Reached,
        ball => Ball,
        range_mm => float(Range),
        robots => Ids,
        within_us => 1000 * (?DONE_MS + starl_registers:within_ms(length(Ids)))
    }.

things(none) -> [];
things(Ball) -> [#{at => Ball, colour => orange, radius_mm => ?BALL_MM}].

camera(#{camera_range := Range, camera_field := Degrees}) ->
    #{field => Degrees * math:pi() / 180, most_mm => Range, ball_mm => ?BALL_MM}.

%% -- before and after a run -----------------------------------------------------------------

%% @doc The rooms, and those that cannot be searched.
-spec preview(starl_scene:t()) -> starl_scene:preview().
preview(#{poses := Poses, memo := #{lines := Lines} = Memo}) ->
    Mm = lists:sum([starl_geometry:length(Line) || Line <- Lines]),
    Robots = [{Id, {X, Y}, Heading} || {Id, {X, Y, Heading}} <- lists:sort(maps:to_list(Poses))],
    #{
        lines => [rooms(Memo), io_lib:format("~.1f m to search", [Mm / 1000]) | closed(Memo)],
        write => fun(Dir) -> draw(Dir, Memo, Robots) end
    }.

rooms(#{open := Open}) ->
    io_lib:format("~b room~ts: ~ts", [length(Open), [$s || length(Open) =/= 1], names(Open)]).

closed(#{closed := []}) -> [];
closed(#{closed := Closed}) -> [["cannot be searched, too narrow or closed: ", names(Closed)]].

names(Names) -> lists:join(", ", [atom_to_list(Name) || Name <- Names]).

%% @doc The report of a run: complete if the ball is found, or every room that can be reached is
%% searched.
-spec report(starl_scene:t(), starl_scene:outcome()) -> starl_scene:report().
report(#{memo := Memo}, #{monitors := Monitors}) ->
    #{starl_search_monitor := #{searched := Searched, left := Left} = Results} = Monitors,
    #{found_us := Found, done_us := Done} = Results,
    #{
        figures => [
            {rooms, length(maps:get(open, Memo))},
            {searched, Searched},
            {found_s, seconds(Found)},
            {all_done_s, seconds(Done)}
        ],
        formats => #{
            searched => #{decimals => 4, rounded => down, label => "part of the lines driven"},
            found_s => #{
                decimals => 1, label => "time until the ball is found, s", plotted => true
            },
            all_done_s => #{decimals => 1}
        },
        complete => Found =/= none orelse Searched >= 1.0,
        done => done(Found, Searched),
        summary => [not_searched(Left, Memo) || Found =:= none, Left =/= []] ++ closed(Memo)
    }.

%% The rooms with points of lines that nobody has come by.
not_searched(Left, #{floor := Floor}) ->
    Rooms = lists:usort([Room || P <- Left, {ok, Room} <- [starl_floor:room_at(P, Floor)]]),
    case Rooms of
        [] -> "parts of the floor were not searched";
        _ -> ["not searched, or in part: ", names(Rooms)]
    end.

seconds(none) -> null;
seconds(Us) -> Us / 1.0e6.

done(none, Searched) ->
    io_lib:format("~b % of the rooms' lines searched", [floor(100 * Searched)]);
done(Us, _Searched) ->
    io_lib:format("ball found after ~.1f s", [Us / 1.0e6]).

draw(Dir, #{floor := #{size := Size} = Floor, lines := Lines}, Robots) ->
    Drawing = #{
        floor => Size,
        plan => Floor,
        target => Lines,
        ink => #{},
        robots => Robots,
        title => maps:get(name, Floor),
        preview => true
    },
    case starl_picture_draw:write(Dir, "search", Drawing) of
        {ok, Files} -> {ok, Files};
        {partly, Files, Reason} -> {partly, Files, starl_picture_draw:format_error(Reason)};
        {error, Reason} -> {error, starl_picture_draw:format_error(Reason)}
    end.

%% -- the lines --------------------------------------------------------------------------------

%% The lines along which a team searches the rooms of a floor: in each room parallel lines, as
%% far apart as a camera sees, where there is room for a robot. Lengths are millimetres.

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
