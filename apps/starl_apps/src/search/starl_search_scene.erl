%% @doc Makes the scene of the search: the building with its viewpoints, the ball, the parked
%% robots, the blocks and the contracts. It also makes the texts before and after a run.
-module(starl_search_scene).

-export([options/0, scene/1, preview/1, report/2]).

%% The distance of the centres of two touching Creates (mm).
-define(CONTACT_MM, 330).
%% More than a robot needs beside a wall (mm).
-define(MARGIN_MM, 5.0).
-define(BALL_MM, 100).
-define(PATIENCE_MS, 30000).
%% Beside what registers take, until all are done (ms): a lease, a request, a leg.
-define(DONE_MS, 60000).
%% Half of the short line of a place to look from (mm), and the directions that it may have.
-define(HALF_MM, 30.0).
-define(DIRECTIONS, [{1.0, 0.0}, {0.0, 1.0}, {0.7, 0.7}, {0.7, -0.7}]).
%% A camera's errors are draws from normal distributions, cut at so many times their deviation.
-define(WORST, 4).
%% More than the robot's own place is off by (mm).
-define(PLACE_MM, 50.0).
%% A robot hides what is so much beside it, more than the distance that it keeps from walls (mm): half of a cell.
-define(HIDES_MM, 65.0).
%% So many rooms are named in a line.
-define(NAMED, 8).

-spec options() -> [starl_options:option()].
options() ->
    [
        {ball, {one_of, [place, random, nowhere]}, place,
            "where the ball is: at the place `object' of the floor plan, anywhere on the free floor, or nowhere"},
        {camera_range, {number, 500, 100000}, 3000, "how far a camera sees the ball, mm"},
        {camera_field, {number, 30, 360}, 360, "the angle of view of a camera, degrees"},
        {safety_distance, {number, ?CONTACT_MM, 5000}, 340,
            "the least distance of any two robots (r_s), mm"},
        {lease, {integer, 100, 1000000}, 10000,
            "the duration of a lease: of a vote, and of a robot's permission to drive, ms"},
        {jump, {integer, 0, 1000000}, 2000,
            "the most by which a clock may be set during a lease, ms; far less than half of a lease"}
    ].

%% @doc The scene on the floor plan of the run, by default that of Java StarL's search.
-spec scene(starl_scene:context()) -> {ok, starl_scene:t()} | {error, unicode:chardata()}.
scene(#{profiles := Profiles, options := #{camera_field := Field}} = Context) ->
    Turns = [Chassis || #{chassis := Chassis} <- Profiles, Chassis =/= starl_chassis_holonomic],
    case building(Context) of
        {ok, _} when Field < 360, length(Turns) < length(Profiles) ->
            {error,
                "--camera-field: a holonomic robot does not turn, so it does not see all around: "
                "leave --camera-field out, or use --chassis differential"};
        {ok, Floor} ->
            on_floor(Floor, Context);
        {error, _} = Error ->
            Error
    end.

building(#{floor := #{walls := [], rooms := Rooms}}) when map_size(Rooms) =:= 0 ->
    starl_floor_file:read("search", 1000);
building(#{floor := Floor}) ->
    {ok, Floor}.

on_floor(Floor, #{robots := Ids, profiles := Profiles, options := Options} = Context) ->
    #{safety_distance := Safety} = Options,
    Tracking = starl_chassis:widest(Profiles),
    Body = lists:max([starl_chassis:radius_mm(Profile) || Profile <- Profiles]),
    Wanted = #{
        robots => length(Ids),
        tube_radius => max(Safety / 2, Body) + Tracking,
        wall_mm => Body + Tracking + ?MARGIN_MM,
        near => starl_dpp_floor:near(Floor)
    },
    case {starl_dpp_floor:reach(Floor, Wanted), ball(Floor, Context)} of
        {{ok, Reach}, {ok, Ball}} ->
            Cover = cover(Floor, Reach, Wanted, Tracking, Options),
            laid(Floor, Reach, Cover, Ball, Wanted, Tracking, Context);
        {{error, Reason}, _} ->
            {error, starl_dpp_floor:format_error(Reason)};
        {_, {error, _} = Error} ->
            Error
    end.

%% -- the ball ---------------------------------------------------------------------------------

ball(_Floor, #{options := #{ball := nowhere}}) ->
    {ok, none};
ball(#{places := #{object := At}}, #{options := #{ball := place}}) ->
    {ok, At};
ball(_Floor, #{options := #{ball := place}}) ->
    {error, "the floor plan has no place object: give it one, or use --ball random"};
ball(Floor, #{seed := Seed}) ->
    case starl_search_cells:draw({Seed, ball}, float(?BALL_MM), Floor) of
        {ok, At} -> {ok, At};
        none -> {error, "a ball has no room on this floor: use another plan, or --ball nowhere"}
    end.

%% -- where to look from -----------------------------------------------------------------------

cover(Floor, Reach, #{wall_mm := Mm}, Tracking, #{camera_range := Range}) ->
    Walls = starl_walls:new(Floor),
    Line = fun(P) -> line(P, Mm, Walls) end,
    starl_search_cover:plan(Floor, #{
        range_mm => float(Range),
        ball_mm => float(?BALL_MM),
        slack_mm => Tracking,
        wall_mm => Mm,
        places => [P || P <- starl_dpp_floor:reachable(Reach), Line(P) =/= none],
        comes_to => fun(P) -> Line(P) =/= none andalso starl_dpp_floor:leads_to(P, Reach) end,
        line => Line
    }).

line({X, Y}, Mm, Walls) ->
    Lines = [
        {{X - ?HALF_MM * DX, Y - ?HALF_MM * DY}, {X + ?HALF_MM * DX, Y + ?HALF_MM * DY}}
     || {DX, DY} <- ?DIRECTIONS
    ],
    case [Line || Line <- Lines, starl_walls:is_free(Line, Mm, Walls)] of
        [Line | _] -> {ok, Line};
        [] -> none
    end.

laid(Floor, Reach, #{views := Views} = Cover, Ball, Wanted, Tracking, Context) ->
    Lines = [Line || #{line := Line} <- Views],
    case starl_dpp_floor:new(Floor, Wanted#{lines => Lines}, Reach) of
        {ok, Ways, #{reached := [_ | _] = Reached}} ->
            Come = [View || #{line := Line} = View <- Views, lists:member(Line, Reached)],
            {ok, built(Floor, Ways, Cover#{views := Come}, Ball, Wanted, Tracking, Context)};
        {ok, _, _} ->
            {error, "no room of this floor can be reached: use a larger scale, or another plan"};
        {error, Reason} ->
            {error, starl_dpp_floor:format_error(Reason)}
    end.

built(Floor, Ways, #{views := Views} = Cover, Ball, Wanted, Tracking, Context) ->
    #{robots := Ids, options := Options} = Context,
    Lines = [Line || #{line := Line} <- Views],
    Memo = (maps:with([unseen, cells], Cover))#{floor => Floor, lines => Lines},
    #{
        notes => closed(Memo),
        app => {sequential, starl_search, maps:merge(camera(Options), seeing(Views, Wanted))},
        never_crashes => true,
        never_bumps => true,
        floor => Floor,
        poses => maps:from_list(lists:zip(Ids, starl_dpp_floor:places(Ways))),
        apart_mm => maps:get(safety_distance, Options),
        things => things(Ball),
        senses => #{camera => camera(Options)},
        blocks => [
            {starl_election, #{patience_ms => ?PATIENCE_MS}},
            starl_registers,
            {starl_dpp, plan(Floor, Ways, Lines, Wanted, Tracking, Context)}
        ],
        monitors => [{starl_search_monitor, contract(Floor, Ball, Wanted, Context)}],
        memo => Memo
    }.

%% The bodies of robots hide what is behind them.
seeing(Views, #{wall_mm := Mm}) -> #{views => Views, hides_mm => Mm + ?HIDES_MM}.

plan(#{size := World}, Ways, Lines, #{tube_radius := Radius}, Tracking, Context) ->
    #{seed := Seed, options := Options} = Context,
    #{
        segments => Lines,
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

contract(Floor, Ball, #{wall_mm := Mm}, #{robots := Ids, profiles := Profiles, options := Options}) ->
    {ok, #{camera := Camera}} = starl_sense:profiles(#{camera => camera(Options)}),
    #{field := Field, most_mm := Range, noise := Noise, noise_part := Part} = Camera,
    #{
        floor => Floor,
        ball => Ball,
        ball_mm => float(?BALL_MM),
        range_mm => float(Range),
        field => Field,
        wall_mm => Mm,
        profiles => Profiles,
        off => {?PLACE_MM, ?WORST * (Noise + Part)},
        robots => Ids,
        within_us => 1000 * (?DONE_MS + starl_registers:within_ms(length(Ids)))
    }.

things(none) -> [];
things(Ball) -> [#{at => Ball, colour => orange, radius_mm => ?BALL_MM}].

camera(#{camera_range := Range, camera_field := Degrees}) ->
    #{field => Degrees * math:pi() / 180, most_mm => Range, ball_mm => ?BALL_MM}.

%% -- before and after a run -----------------------------------------------------------------

%% @doc The places to look from, and what cannot be seen from anywhere.
-spec preview(starl_scene:t()) -> starl_scene:preview().
preview(#{poses := Poses, memo := #{lines := Lines, floor := Floor, cells := Cells} = Memo}) ->
    Robots = [{Id, {X, Y}, Heading} || {Id, {X, Y, Heading}} <- lists:sort(maps:to_list(Poses))],
    #{
        lines => [
            rooms(starl_search_rooms:names(starl_search_rooms:new(Floor))),
            io_lib:format("~b m² of floor, seen from ~b place~ts", [
                round(starl_search_cells:m2(Cells)),
                length(Lines),
                [$s || length(Lines) =/= 1]
            ])
            | closed(Memo)
        ],
        write => fun(Dir) -> draw(Dir, Memo, Robots) end
    }.

%% The rooms of a large plan are too many for a line.
rooms(Names) when length(Names) > ?NAMED -> io_lib:format("~b rooms", [length(Names)]);
rooms(Names) ->
    io_lib:format("~b room~ts: ~ts", [
        length(Names), [$s || length(Names) =/= 1], lists:join(", ", Names)
    ]).

closed(#{unseen := []}) ->
    [];
closed(#{unseen := Unseen, cells := Cells, floor := Floor}) ->
    {M2, Of} = {starl_search_cells:m2(length(Unseen)), starl_search_cells:m2(Cells)},
    [["nobody can come to see ", part(M2, Of, Unseen, Floor)]].

%% @doc A part of the floor, and where it is: `23 of 170 m², in kitchen'.
part(M2, Of, Points, Floor) ->
    Names = starl_search_rooms:where(Points, starl_search_rooms:new(Floor)),
    {Some, Others} = lists:split(min(?NAMED, length(Names)), Names),
    io_lib:format("~ts of ~b m², in ~ts~ts", [
        area(M2), round(Of), lists:join(", ", Some), [" and others" || Others =/= []]
    ]).

area(M2) when M2 < 10 -> io_lib:format("~.1f", [max(0.1, M2)]);
area(M2) -> io_lib:format("~b", [round(M2)]).

%% @doc The report of a run: complete if the ball is found, or all of the floor was seen.
-spec report(starl_scene:t(), starl_scene:outcome()) -> starl_scene:report().
report(#{memo := #{floor := Floor}}, #{monitors := Monitors}) ->
    #{starl_search_monitor := #{floor_m2 := M2, unseen_m2 := Unseen, left := Left} = Results} =
        Monitors,
    #{found_us := Found, done_us := Done} = Results,
    Seen = (M2 - Unseen) / max(1.0e-9, M2),
    #{
        figures => [
            {floor_m2, M2},
            {seen, Seen},
            {found_s, seconds(Found)},
            {all_done_s, seconds(Done)}
        ],
        formats => #{
            floor_m2 => #{decimals => 1},
            seen => #{decimals => 4, rounded => down, label => "part of the floor seen"},
            found_s => #{
                decimals => 1, label => "time until the ball is found, s", plotted => true
            },
            all_done_s => #{decimals => 1}
        },
        complete => Found =/= none orelse Left =:= [],
        done => done(Found, Seen),
        summary =>
            [["not seen: ", part(Unseen, M2, Left, Floor)] || Found =:= none, Left =/= []] ++
            maps:get(unjudged, Results)
    }.

seconds(none) -> null;
seconds(Us) -> Us / 1.0e6.

done(none, Seen) -> io_lib:format("~b % of the floor seen", [floor(100 * Seen)]);
done(Us, _Seen) -> io_lib:format("ball found after ~.1f s", [Us / 1.0e6]).

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
