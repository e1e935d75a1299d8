%% @doc The chassis with two wheels on one axle, such as the iRobot Create: it turns in place and
%% drives straight on, in legs ({@link starl_differential_course}, {@link
%% starl_differential_stroke}), or turns to a velocity while it drives ({@link cruise/4}).
-module(starl_chassis_differential).
-behaviour(starl_chassis).

-export([profile/1, check/1, duration_us/2, next/4, resume/3, last/1, undo/1, try_mm/1]).
-export([tracking_radius/1, ends_mm/1, cruise/4, rests_s/1, pace/1]).

-export_type([commands/0]).

%% The speeds of the left and the right wheel, mm/s, with a duration (us), one pair after the other.
-type commands() :: [{Left :: number(), Right :: number(), Us :: pos_integer()}].

%% The limits of a command: speed of a wheel (mm/s), duration (us).
-define(FASTEST, 1.0e6).
-define(LONGEST_US, (1 bsl 50)).
-define(IS_SPEED(V), is_number(V), V =< ?FASTEST, V >= -?FASTEST).
%% The limits of a try: longer than the chassis needs to notice a failure (15 ms), and slow (mm/s).
-define(TRY_US, 20000).
-define(TRY_SPEED, 100.0).

%% The time for a turn, if it is small (s); the smallest angle worth a turn (rad); a slower speed is
%% none (mm/s).
-define(TURN_S, 0.25).
-define(SMALLEST, 1.0e-3).
-define(SLOWEST, 1.0e-3).

-spec profile(map()) -> starl_differential_course:profile().
profile(Overrides) -> starl_differential_course:profile(Overrides).

-spec check(term()) -> ok | {error, string()}.
check([]) ->
    ok;
check([{Left, Right, Us} | Commands]) when
    ?IS_SPEED(Left), ?IS_SPEED(Right), is_integer(Us), Us > 0, Us =< ?LONGEST_US
->
    check(Commands);
check(_) ->
    {error, "[{Left, Right, Us}]: mm/s within 1.0e6, Us from 1"}.

-spec duration_us(commands(), starl_chassis:profile()) -> {Us, Us} when Us :: non_neg_integer().
duration_us(Commands, _Profile) ->
    Us = lists:sum([Us || {_, _, Us} <- Commands]),
    {Us, Us}.

-spec next(starl_chassis:way(), starl:pose(), starl_geometry:segment(), starl_chassis:profile()) ->
    arrived | starl_chassis:step().
next(to, Pose, Line, Profile) -> starl_differential_course:next(Pose, Line, Profile);
next(along, Pose, Line, Profile) -> starl_differential_stroke:along(Pose, Line, Profile);
next(face, Pose, Line, Profile) -> starl_differential_stroke:face(Pose, Line, Profile).

-spec resume(starl:pose(), starl_differential_course:leg(), starl_chassis:profile()) ->
    starl_chassis:step().
resume(Pose, Leg, Profile) -> starl_differential_course:turned(Pose, Leg, Profile).

-spec last(commands()) -> {Left :: number(), Right :: number()}.
last([]) ->
    {0.0, 0.0};
last(Commands) ->
    {Left, Right, _} = lists:last(Commands),
    {Left, Right}.

%% If the wheel still does not turn, the try brings the robot back to its place.
-spec undo(term()) -> {ok, commands()} | none | unknown.
undo({Left, Right}) when Left == 0, Right == 0 ->
    none;
undo({Left, Right}) when ?IS_SPEED(Left), ?IS_SPEED(Right) ->
    Part = min(1.0, ?TRY_SPEED / max(abs(Left), abs(Right))),
    {ok, [{-Part * Left, -Part * Right, ?TRY_US}]};
undo(_) ->
    unknown.

-spec try_mm(starl_chassis:profile()) -> float().
try_mm(_Profile) -> ?TRY_SPEED * ?TRY_US / 1.0e6.

%% It stands as soon as it is told to.
-spec rests_s(starl_chassis:profile()) -> float().
rests_s(_Profile) -> 0.0.

-spec tracking_radius(starl_chassis:profile()) -> float().
tracking_radius(Profile) -> starl_differential_course:tracking_radius(Profile).

-spec ends_mm(starl_chassis:profile()) -> float().
ends_mm(Profile) -> starl_differential_stroke:ends_mm(Profile).

-spec pace(starl_chassis:profile()) -> starl_chassis:pace().
pace(Profile) -> starl_differential_stroke:pace(Profile).

%% -- a velocity -------------------------------------------------------------------------------

%% Turns a velocity into commands of a robot with two wheels: an arc towards the direction of the
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

%% @doc The script for a velocity, within the limits of speed, and a time.
-spec cruise(starl_chassis:velocity(), starl:pose(), pos_integer(), starl_chassis:profile()) ->
    commands().
cruise({VX, VY}, {_, _, Heading}, Us, Profile) ->
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
