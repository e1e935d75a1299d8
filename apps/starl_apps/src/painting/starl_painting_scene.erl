%% @doc Makes the scene of the painting application: the picture on the floor, the robots on their
%% parking spots, the blocks and the contracts.
-module(starl_painting_scene).

-export([options/0, scene/1]).

%% The distance of the centres of two touching Creates (radius 165 mm).
-define(CONTACT_MM, 330).
%% More than a robot needs beside a wall (mm).
-define(MARGIN_MM, 5.0).
%% That of elect/2.
-define(PATIENCE_MS, 30000).

%% @doc The options of painting.
-spec options() -> [starl_options:option()].
options() ->
    [
        {picture, file, "house",
            "an SVG file, one that ships: " ++ names() ++
                ", or short_lines:N, a random one of short lines"},
        {tolerance, {number, 0.1, 1000}, 2,
            "the largest distance of the lines from the picture's curves, mm"},
        {segments, {integer, 1, 100000}, 5000, "the most line segments that a picture may have"},
        {safety_distance, {number, ?CONTACT_MM, 5000}, 400,
            "the least distance of any two robots (r_s), mm"},
        {horizon, {number, 100, 100000}, 3000,
            "length of the lines that a robot gets at a time, mm"},
        {choice, file, "ink",
            "the rule that chooses what a robot paints next: ink, nearest, or a file of yours, FILE.erl"},
        {lease, {integer, 100, 1000000}, 10000,
            "the duration of a lease: of a vote, and of a robot's permission to drive, ms"},
        {jump, {integer, 0, 1000000}, 2000,
            "the most by which a clock may be set during a lease, ms; far less than half of a lease"}
    ].

%% @doc Puts the picture on the floor. r_s is the least distance of two robots, r(v) the largest
%% distance of a robot from its path, R = r_s/2 + r(v) the radius of the tubes. All tubes have the
%% largest radius that any robot of the team needs.
-spec scene(starl_scene:context()) -> {ok, starl_scene:t()} | {error, unicode:chardata()}.
scene(#{options := #{choice := Text} = Options} = Context) ->
    case starl_dpp_rule:named(Text) of
        {ok, Rule} -> on_the_floor(Context#{options := Options#{choice := Rule}});
        {error, _} = Error -> Error
    end.

on_the_floor(#{floor := #{walls := [_ | _]} = Floor} = Context) ->
    among_walls(Floor, Context);
on_the_floor(#{robots := Ids, world := World, profiles := Profiles, options := Options} = Context) ->
    Tracking = starl_chassis:widest(Profiles),
    Radius = maps:get(safety_distance, Options) / 2 + Tracking,
    case starl_roadmap:layout(floats(World), length(Ids), Radius) of
        {ok, Layout} ->
            case read_picture(maps:get(area, Layout), Options) of
                {ok, Picture} -> place(Picture, parked(Layout, World), Radius, Tracking, Context);
                {error, _} = Error -> Error
            end;
        {error, Reason} ->
            {error, starl_roadmap:format_error(Reason)}
    end.

%% The picture fills the floor; robots paint what they can reach of it.
among_walls(
    #{size := {W, H} = Size} = Floor, #{profiles := Profiles, options := Options} = Context
) ->
    Tracking = starl_chassis:widest(Profiles),
    Body = lists:max([starl_chassis:radius_mm(Profile) || Profile <- Profiles]),
    Mm = Body + Tracking + ?MARGIN_MM,
    Radius = max(maps:get(safety_distance, Options) / 2, Body) + Tracking,
    Config = #{
        robots => length(maps:get(robots, Context)),
        tube_radius => Radius,
        wall_mm => Mm,
        lines => [],
        near => starl_dpp_floor:near(Floor)
    },
    Read = read_picture({Mm, Mm, W - Mm, H - Mm}, Options),
    case fitted(Read, Floor, Config) of
        {ok, Ways, Reached, Lost} ->
            Parked = among(Ways, Floor, Lost, Context),
            place(Reached, Parked, Radius, Tracking, Context#{world := Size});
        {error, _} = Error ->
            Error
    end.

fitted({ok, Picture}, Floor, Config) -> starl_painting_walls:fit(Picture, Floor, Config);
fitted({error, _} = Error, _Floor, _Config) -> Error.

among(Ways, Floor, Lost, #{robots := Ids}) ->
    #{
        poses => maps:from_list(lists:zip(Ids, starl_dpp_floor:places(Ways))),
        plan => #{ways => Ways, patience => infinity},
        scene => #{floor => Floor, notes => starl_painting_walls:left_out(Lost)},
        memo => #{lost => Lost, floor => Floor}
    }.

%% What is particular to the floor: where robots stand, what path planning, the scene, and the report
%% know of it.
parked(#{spots := Spots}, World) ->
    #{
        poses => maps:map(fun(_, Spot) -> facing(Spot, World) end, Spots),
        plan => #{},
        scene => #{},
        memo => #{lost => none, floor => none}
    }.

place(Picture, #{poses := Poses} = Parked, Radius, Tracking, Context) ->
    #{robots := Ids, options := Options} = Context,
    Plan = plan(Picture, Parked, Radius, Tracking, Context),
    Leases = #{lease_ms => maps:get(lease, Options), jump_ms => maps:get(jump, Options)},
    case starl_dpp_plan:new(Plan#{robots => Ids}) of
        {ok, Empty} ->
            {ok, (maps:get(scene, Parked))#{
                app => {sequential, starl_painting, none},
                never_crashes => true,
                never_bumps => true,
                blocks => [
                    {starl_election, #{patience_ms => ?PATIENCE_MS}},
                    starl_actuator,
                    {starl_dpp, maps:merge(Plan, Leases)}
                ],
                poses => Poses,
                apart_mm => maps:get(safety_distance, Options),
                monitors => monitors(Picture, Tracking, Context),
                memo => maps:merge(maps:get(memo, Parked), memo(Picture, Empty, Context))
            }};
        {error, Reason} ->
            {error, starl_dpp_plan:format_error(Reason)}
    end.

plan(Picture, Parked, Radius, Tracking, #{world := World, seed := Seed, options := Options}) ->
    (maps:get(plan, Parked))#{
        segments => starl_picture:segments(Picture),
        world => floats(World),
        tube_radius => Radius,
        slack => Tracking,
        horizon => float(maps:get(horizon, Options)),
        choice => maps:get(choice, Options),
        seed => Seed
    }.

%% What the report needs of the scene.
memo(Picture, Empty, #{robots := Ids, world := World, profiles := Profiles, options := Options}) ->
    #{
        picture => Picture,
        world => World,
        robots => length(Ids),
        speed => lists:max([Speed || #{speed := Speed} <- Profiles]),
        edges => maps:get(total, starl_dpp_plan:counts(Empty)),
        lines_mm => lines_mm(Empty),
        safety_distance => maps:get(safety_distance, Options)
    }.

%% Overlapping lines are painted once.
lines_mm(Plan) ->
    #{total := Total} = starl_dpp_plan:counts(Plan),
    lists:sum([starl_geometry:length(starl_dpp_plan:target(E, Plan)) || E <- lists:seq(1, Total)]).

monitors(Picture, Tracking, #{robots := Ids, profiles := Profiles}) ->
    Own = tracking(Ids, Profiles),
    [
        {starl_painting_monitor, #{
            lines => starl_picture:segments(Picture),
            ink_radius_mm => Tracking,
            tracking_mm => Own,
            tolerance_mm => starl_picture:tolerance(Picture),
            ends_mm => lists:max([starl_chassis:ends_mm(Profile) || Profile <- Profiles]),
            complete => false
        }}
    ].

%% The tracking radius of each robot; empty if all robots have the same profile.
tracking(_Ids, [_AllTheSame]) ->
    #{};
tracking(Ids, Profiles) ->
    maps:from_list([
        {Id, starl_chassis:tracking_radius(starl_chassis:of_robot(Id, Profiles))}
     || Id <- Ids
    ]).

%% The heading towards the middle of the floor.
facing({X, Y}, {Width, Height}) ->
    {X, Y, starl_geometry:heading({X, Y}, {Width / 2, Height / 2})}.

floats({Width, Height}) -> {float(Width), float(Height)}.

%% -- the picture ------------------------------------------------------------------------------

%% Reads the picture, to fill the area, with the tolerance and the limit of the options.
-spec read_picture(Area, #{atom() => term()}) ->
    {ok, starl_picture:t()} | {error, unicode:chardata()}
when
    Area :: {number(), number(), number(), number()}.
read_picture(Area, #{picture := Name, tolerance := Tolerance, segments := Max}) ->
    Options = #{area => Area, tolerance_mm => float(Tolerance), max_segments => Max},
    case picture(Name, Options) of
        {ok, _} = Ok -> Ok;
        {error, Reason} -> {error, [starl_picture:format_error(Reason), remedy(Reason, Name)]}
    end.

picture(Name, Options) ->
    case starl_picture_sample:named(Name) of
        {ok, N} -> starl_picture:parse(starl_picture_sample:svg(N), Options);
        error -> starl_picture:read(picture_file(Name), Options)
    end.

%% The pictures that ship: name and title.
-spec shipped() -> [{Name :: string(), Title :: string()}].
shipped() ->
    Files = filelib:wildcard(filename:join(pictures(), "*.svg")),
    [{filename:basename(File, ".svg"), title(File)} || File <- lists:sort(Files)].

%% The names of the pictures that ship, each with its title unless that is the name.
-spec names() -> string().
names() -> lists:append(lists:join(", ", [described(Each) || Each <- shipped()])).

%% A shipped picture is named without its folder and ending. A file of that name has priority; a
%% directory of that name, such as the results of an earlier run, does not hide the picture.
picture_file(Name) ->
    Shipped = filename:join(pictures(), Name ++ ".svg"),
    IsShipped =
        is_word(Name) andalso filelib:is_regular(Shipped) andalso not filelib:is_regular(Name),
    case IsShipped of
        true -> Shipped;
        false -> Name
    end.

is_word(Name) -> filename:extension(Name) =:= "" andalso filename:basename(Name) =:= Name.

pictures() -> filename:join(code:priv_dir(starl_apps), "pictures").

title(File) ->
    {ok, Bytes} = file:read_file(File),
    {match, [Title]} = re:run(Bytes, "<title>([^<]*)</title>", [{capture, [1], list}]),
    Title.

described({Name, Title}) ->
    case string:lowercase(Title) of
        Name -> Name;
        _ -> Name ++ " (" ++ Title ++ ")"
    end.

%% A word without a file may be meant for a picture that ships.
remedy({cannot_read, _, missing}, Name) ->
    Shipped = [Each || {Each, _} <- shipped()],
    Near = [Word || is_word(Name), Word <- starl_similar:words(Name, Shipped)],
    starl_similar:meant(Near, ["; give an SVG file, or one of ", lists:join(", ", Shipped)]);
remedy(_Reason, _Name) ->
    [].
