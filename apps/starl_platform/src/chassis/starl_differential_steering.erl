%% @doc Turns a velocity into commands of a robot with two wheels: an arc towards the direction of the
%% velocity, then straight on.
%%
%% The law. Let a be the angle from the robot's heading to the velocity. The robot turns by a at a/τ
%% (τ = 0.25 s), at most at the profile's turn rate ω, and drives meanwhile with the part of the speed
%% that points in the right direction, v·cos a; a robot that looks away, a ≥ 90°, turns in place. A
%% wheel that would be too fast slows the drive, not the turn. So a small correction is smooth, a
%% large one is quick, and the robot never drives against the velocity that it was given. When it
%% has turned, it drives straight on with the whole speed.
%%
%% Both are pieces of constant speed and turn rate: an arc and a line.
-module(starl_differential_steering).

-export([script/4]).

%% The time for a turn, if it is small (s); the smallest angle worth a turn (rad); a slower speed is
%% none (mm/s).
-define(TURN_S, 0.25).
-define(SMALLEST, 1.0e-3).
-define(SLOWEST, 1.0e-3).

%% @doc The script for a velocity, within the limits of speed, and a time.
-spec script(starl_chassis:velocity(), starl:pose(), pos_integer(), starl_chassis:profile()) ->
    starl_chassis_differential:commands().
script({VX, VY}, {_, _, Heading}, Us, Profile) ->
    case math:sqrt(VX * VX + VY * VY) of
        Speed when Speed < ?SLOWEST -> [{0.0, 0.0, Us}];
        Speed -> turned(starl_geometry:angle_diff(math:atan2(VY, VX), Heading), Speed, Us, Profile)
    end.

turned(Angle, Speed, Us, _Profile) when abs(Angle) < ?SMALLEST -> [{Speed, Speed, Us}];
turned(Angle, Speed, Us, #{turn_rate := Most} = Profile) ->
    Seconds = max(?TURN_S, abs(Angle) / Most),
    Turn = round(Seconds * 1.0e6),
    Arc = arc(Angle / Seconds, Speed * max(0.0, math:cos(Angle)), Profile),
    case Us - Turn of
        Left when Left > 0 -> [with(Arc, Turn), {Speed, Speed, Left}];
        _ -> [with(Arc, Us)]
    end.

with({Left, Right}, Us) -> {Left, Right, Us}.

%% The speeds of the wheels, the outer one no faster than the limit.
arc(Rate, Speed, #{axle_mm := Axle, speed := Most}) ->
    Aside = Rate * Axle / 2,
    Forward = max(0.0, min(Speed, Most - abs(Aside))),
    {Forward - Aside, Forward + Aside}.
