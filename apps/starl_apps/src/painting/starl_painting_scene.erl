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
            "an SVG file, or one that ships: " ++ starl_painting_picture:names()},
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
            case starl_painting_picture:read(maps:get(area, Layout), Options) of
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
    Read = starl_painting_picture:read({Mm, Mm, W - Mm, H - Mm}, Options),
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
    #{robots := Ids, world := World, seed := Seed, options := Options} = Context,
    Lines = starl_picture:segments(Picture),
    Plan = (maps:get(plan, Parked))#{
        segments => Lines,
        world => floats(World),
        tube_radius => Radius,
        slack => Tracking,
        horizon => float(maps:get(horizon, Options)),
        choice => maps:get(choice, Options),
        seed => Seed
    },
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
