%% @doc The bearing sensor finds the robots in sight. A reading lists them, nearest first: `#{robot,
%% bearing, mm}', to their middles. Walls and other robots hide a robot.
-module(starl_sense_bearing).
-behaviour(starl_sense).

-export([profile/0, errors/0, read/2, blurred/3, guess/2, is_reading/2]).

%% `most_mm': how far it sees, all around. `noise' (rad) and the part `noise_part' of the distance
%% are standard deviations; `missed': the part of the robots that it overlooks.
-spec profile() -> starl_sense:profile().
profile() -> #{most_mm => 3000, noise => 0.02, noise_part => 0.03, missed => 0.02}.

-spec errors() -> [atom()].
errors() -> [noise, noise_part, missed].

-spec read(starl_sense:view(), starl_sense:profile()) -> [map()].
read(#{pose := {X, Y, _} = Pose, walls := Walls, bodies := Bodies, draw := Draw}, Profile) ->
    #{most_mm := Most, missed := Missed} = Profile,
    Discs = [{At, R} || {_, At, R} <- Bodies],
    Seen = [
        {Mm, Robot, At}
     || {Robot, At, _} <- Bodies,
        Mm <- [starl_geometry:distance({X, Y}, At)],
        Mm =< Most,
        Draw({missed, Robot}) >= Missed,
        starl_sight:is_clear({X, Y}, At, Discs, Walls)
    ],
    [
        one(Robot, Mm, starl_sense:bearing(At, Pose), Draw, Profile)
     || {Mm, Robot, At} <- lists:sort(Seen)
    ].

one(Robot, Mm, Bearing, Draw, #{noise := Noise, noise_part := Part, most_mm := Most}) ->
    Off = Noise * starl_sense:normal({bearing, Robot}, Draw),
    Far = Mm * (1.0 + Part * starl_sense:normal({far, Robot}, Draw)),
    #{
        robot => Robot,
        bearing => starl_geometry:normalise(Bearing + Off),
        mm => max(0.0, min(float(Most), Far))
    }.

%% @doc Robots that are missed, or seen elsewhere.
-spec blurred([map()], starl_sense:draw(), starl_sense:profile()) -> [map()].
blurred(Seen, Draw, #{missed := Missed} = Profile) ->
    [
        one(Robot, Mm, Bearing, Draw, Profile)
     || #{robot := Robot, mm := Mm, bearing := Bearing} <- Seen, Draw({missed, Robot}) >= Missed
    ].

-spec guess(starl_sense:draw(), starl_sense:profile()) -> [map()].
guess(Draw, #{most_mm := Most}) ->
    [#{robot => 1, bearing => math:pi() * (2 * Draw(angle) - 1), mm => Most * Draw(far)}].

-spec is_reading(term(), starl_sense:profile()) -> boolean().
is_reading(Seen, #{most_mm := Most}) when is_list(Seen) ->
    lists:all(
        fun(#{robot := _, bearing := B, mm := Mm}) ->
            abs(B) =< math:pi() + 1.0e-9 andalso Mm >= 0 andalso Mm =< Most
        end,
        Seen
    );
is_reading(_Other, _Profile) ->
    false.
