%% @doc The chassis with two wheels on one axle, such as the iRobot Create. It turns in place and
%% drives straight on, in legs ({@link starl_differential_course}). It follows a given line from its
%% exact beginning to its exact end. It can also turn towards a velocity while it drives
%% ({@link cruise/4}).
-module(starl_chassis_differential).
-behaviour(starl_chassis).

-export([simulation/0, profile/1, check/1, duration_us/2, next/4, resume/3, last/1, undo/1]).
-export([try_mm/1, tracking_radius/1, ends_mm/1, cruise/4, rests_s/1, pace/1]).

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

-type step() :: starl_differential_course:step().

%% The length of the last leg of a line, about, so that it ends near the end, mm, and its most as a
%% multiple of that: no longer than the last leg of any drive, on which the bound rests.
-define(LAST_MM, 40.0).
-define(LAST_MOST, 1.5).
%% The speed limit of the rest at an end, mm/s; the largest angle between the robot's direction and
%% the line, or its reverse, for a drive without a turn, rad.
-define(SLOW, 100.0).
-define(STRAIGHT, 0.1).
%% The way of a robot that is a little off its line is longer than along the line by this at most.
-define(FAR_OFF, 1.1).

-spec simulation() -> module().
simulation() -> starl_sim_differential.

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
next(along, Pose, Line, Profile) -> along(Pose, Line, Profile);
next(face, Pose, Line, Profile) -> face(Pose, Line, Profile).

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

%% -- along a line -----------------------------------------------------------------------------

%% Plans the course of a robot with two wheels along a given line, exact at both ends to a few
%% millimetres: its next step from its present pose (starl_differential_course). So a pen
%% that is lowered at the beginning and raised at the end draws that line, even a very short one.
%%
%% Near the end a leg is short, and the rest along the line is driven slowly, forwards or backwards,
%% without a turn. A robot has begun, or ended, a line when it is seen within w = max(1 mm,
%% s) of the right place along the line, s being the error of positions: so it is within w + s
%% (ends_mm/1), even if the last command failed.
%%
%% It aims a quarter of w outside of the line's ends, since a line drawn too short is worse than one
%% drawn too long: a place from 1/2 w inside to w outside is accepted.

%% @doc The largest distance along a line between its ends and the places where a robot began and
%% ended it, in millimetres.
-spec ends_mm(starl_differential_course:profile()) -> float().
ends_mm(#{position_error_mm := Position} = Profile) -> float(window(Profile) + Position).

window(#{position_error_mm := Position}) -> max(1.0, Position).

%% @doc Its pace ({@link starl_chassis:pace()}). Before a leg it turns to the point of the line that is a
%% leg ahead, from at most r(v) off the line, where it looked along the line but for errors of its
%% heading. A correction is as long as a goal is missed by at most.
-spec pace(starl_differential_course:profile()) -> starl_chassis:pace().
pace(#{heading_error := Error, goal_mm := Goal, position_error_mm := Position} = Profile) ->
    #{speed := Far, near_speed := Near, turn_rate := Fast, near_turn_rate := NearRate} = Profile,
    Speed = min(Far, Near),
    Rate = min(Fast, NearRate),
    Slant = 2 * starl_differential_course:tracking_radius(Profile) / last_mm(Profile) + 2 * Error,
    Leg = ?FAR_OFF * starl_differential_course:longest_mm(Profile) / Speed + Slant / Rate,
    Again = (Goal + 2 * Position) / min(Speed, ?SLOW) + straight(Profile) / Rate,
    #{
        advance_mm => starl_differential_course:advance_mm(Profile),
        leg_us => ceil(1.0e6 * Leg),
        turn_us => ceil(1.0e6 * math:pi() / Rate),
        again_us => ceil(1.0e6 * Again)
    }.

%% The next step of a robot that stands at a pose on its way along a line to its end.
-spec along(starl:pose(), starl_geometry:segment(), starl_differential_course:profile()) ->
    arrived | step().
along({X, Y, _} = Pose, {_, Goal} = Line, #{goal_mm := Enough} = Profile) ->
    Window = window(Profile),
    Distance = starl_geometry:distance({X, Y}, Goal),
    case frame({X, Y}, Line) of
        no_direction ->
            starl_differential_course:next(Pose, Line, Profile);
        {_, Past, _} when Distance =< Enough, Past >= -Window / 2, Past =< Window ->
            arrived;
        {_, Past, _} when Distance =< Enough ->
            nudge(Window / 4 - Past, Pose, Line, Profile);
        Frame ->
            leg(Frame, Distance, Pose, Line, Profile)
    end.

%% The next step of a robot that stands at a pose near the beginning of a line and has to stand
%% at the beginning, looking along it.
-spec face(starl:pose(), starl_geometry:segment(), starl_differential_course:profile()) ->
    arrived | step().
face({X, Y, Heading} = Pose, {Start, Goal} = Line, #{goal_mm := Enough} = Profile) ->
    Window = window(Profile),
    case {starl_geometry:distance({X, Y}, Start), frame({X, Y}, Line)} of
        {_, no_direction} ->
            arrived;
        {Distance, _} when Distance > 2 * Enough ->
            starl_differential_course:towards(Pose, Start, Distance, Profile);
        {_, {Along, _, _}} ->
            Angle = starl_geometry:angle_diff(starl_geometry:heading(Start, Goal), Heading),
            case abs(Angle) =< starl_differential_course:look_from(Profile) of
                false -> starl_differential_course:turn(Angle, Profile);
                true when Along >= -Window, Along =< Window / 2 -> arrived;
                true -> nudge(-Window / 4 - Along, Pose, Line, Profile)
            end
    end.

%% -- internals ------------------------------------------------------------------------------

%% The place along the line from its beginning, past its end, and to its left.
frame({X, Y}, {{AX, AY} = A, B}) ->
    case starl_geometry:distance(A, B) of
        Length when Length < 1.0e-6 ->
            no_direction;
        Length ->
            {UX, UY} = unit(A, B, Length),
            Along = (X - AX) * UX + (Y - AY) * UY,
            {Along, Along - Length, (Y - AY) * UX - (X - AX) * UY}
    end.

unit({AX, AY}, {BX, BY}, Length) -> {(BX - AX) / Length, (BY - AY) / Length}.

%% Drives this far along the line, or back, without a turn if the robot looks that way; else it
%% turns.
nudge(Mm, {_, _, Heading}, {Start, Goal}, #{speed := Speed} = Profile) ->
    Straight = straight(Profile),
    case starl_geometry:angle_diff(starl_geometry:heading(Start, Goal), Heading) of
        Angle when abs(Angle) =< Straight ->
            starl_differential_course:straight(Mm, min(Speed, ?SLOW));
        Angle when abs(Angle) >= 3.141592653589793 - Straight ->
            starl_differential_course:straight(-Mm, min(Speed, ?SLOW));
        Angle ->
            starl_differential_course:turn(Angle, Profile)
    end.

%% A robot near the end of a line, and near the line, drives parallel to it: steering
%% back to the line within a short way would end at a slant.
leg({Along, Past, Across}, Distance, {X, Y, _} = Pose, {Start, Goal}, Profile) ->
    Left = window(Profile) / 4 - Past,
    Length = Along - Past,
    Last = last_mm(Profile),
    case Distance =< ?LAST_MOST * Last of
        true when Left > 0.0, abs(Across) < Last / 2 ->
            Ahead = max(Left, Last),
            Aim = starl_geometry:interpolate(Start, Goal, (Along + Ahead) / Length),
            Slant = starl_geometry:distance({X, Y}, Aim) / Ahead,
            starl_differential_course:towards(Pose, Aim, Left * Slant, Distance, Profile);
        true ->
            starl_differential_course:towards(Pose, Goal, Distance, Profile);
        false ->
            On = max(0.0, min(Length, Along)),
            Longest = starl_differential_course:longest_mm(Profile),
            Ahead = min(Longest, max(Length - On - Last, 0.0)),
            Aim = starl_geometry:interpolate(Start, Goal, (On + Ahead) / Length),
            %% as far away as half a last leg at least, as the goal is farther away than one and a half
            starl_differential_course:towards(Pose, Aim, Distance, Profile)
    end.

last_mm(Profile) -> min(?LAST_MM, starl_differential_course:last_mm(Profile) / ?LAST_MOST).

straight(Profile) -> max(?STRAIGHT, 2 * starl_differential_course:look_from(Profile)).
