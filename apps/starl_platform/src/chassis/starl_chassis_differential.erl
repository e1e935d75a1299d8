%% @doc The chassis with two wheels on one axle, such as the iRobot Create. It turns in place and
%% drives straight on, in legs. It follows a given line from its exact beginning to its exact end. It
%% can also turn towards a velocity while it drives ({@link cruise/4}).
%%
%% Assumption II.1 of the paper: while the robot drives from its place to its goal, it stays within
%% r(v) of the straight line. It aims at the point of the line one leg ahead, so a leg's sideways
%% error does not grow into the next one. A small turn and the drive after it are one command. After
%% a larger turn the robot checks its pose before it drives, so slipping wheels or lost commands
%% cannot send it off in a wrong direction.
%%
%% Legs far from the goal are longer than the last ones, as long as the bound stays the same.
%%
%% The bounds. In a leg of length L the heading errs by at most ε' and the distance by at most δ·L;
%% positions are known to within s. ε' is the sum of three parts: ε (unknown), the angle that is not
%% worth a turn (`turn_from'), and the part that slipping wheels take off a turn without a check
%% (half of `look_from'). So the robot ends a line within g = L·(ε + turn_from + δ) + 2s + 0.5 mm of
%% the goal, as it sees it. If the next line is given with its beginning, the robot begins it at
%% most g off. It may be another 3 mm off if a wheel gets stuck during a turn, until the chassis
%% stops it. A leg that begins d off the line and aims at it ends at most s + L·ε' off, and between
%% the two the distance is no greater than at both ends. So the robot is never farther from the line
%% than s + max(g + 3 mm, L·ε') ({@link tracking_radius/1}). For most profiles g is the larger, so
%% legs that do not lead to the goal may be longer than L: up to (g + 3 mm) / ε', and at most twice
%% as long.
-module(starl_chassis_differential).
-behaviour(starl_chassis).

-export([simulation/0, profile/1, check/1, duration_us/2, next/4, resume/3, last/1, undo/1]).
-export([try_mm/1, tracking_radius/1, ends_mm/1, cruise/4, rests_s/1, pace/1]).

-export_type([commands/0, profile/0, leg/0]).

%% The speeds of the left and the right wheel, mm/s, with a duration (us), one pair after the other.
-type commands() :: [{Left :: number(), Right :: number(), Us :: pos_integer()}].

%% The profile. `speed' and `near_speed' (within `near_mm' of the goal) in mm/s, `turn_rate' and
%% `near_turn_rate' in rad/s, `leg_s' the time between two looks at the position near the goal,
%% `goal_mm' the distance at which the goal is reached, `axle_mm' the distance of the wheels.
%% `turn_from' is the least angle worth a turn, `look_from' (but never less than the heading's
%% error) the least turn worth a look, rad. The bounds of the errors: `heading_error' in rad and
%% `distance_error' as a fraction per leg, `position_error_mm' of the positioning system.
-type profile() :: #{
    speed := float(),
    near_speed := float(),
    near_mm := float(),
    turn_rate := float(),
    near_turn_rate := float(),
    leg_s := float(),
    goal_mm := float(),
    axle_mm := float(),
    turn_from := float(),
    look_from := float(),
    heading_error := float(),
    distance_error := float(),
    position_error_mm := float(),
    chassis => module()
}.

%% A straight drive: its direction, its length (mm), and its speeds (mm/s, rad/s).
-opaque leg() :: {
    Heading :: float(), LengthMm :: float(), Speed :: float(), TurnRate :: float()
}.

%% The next step: a turn to a leg, and then a look; or a small turn, if any, and a drive.
-type step() ::
    {{look, leg()}, commands()}
    | {drive, commands()}.

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

%% The part of a turn that slipping wheels may take off.
-define(SLIP, 0.5).
%% The longest leg, as a multiple of the last one.
-define(LONGER, 2.0).
%% The time in which the chassis notices that a wheel is stuck.
-define(STALL_S, 0.015).

%% The length of the last leg of a line, about, so that it ends near the end, mm, and its most as a
%% multiple of that: no longer than the last leg of any drive, on which the bound rests.
-define(LAST_MM, 40.0).
-define(LAST_MOST, 1.5).
%% The speed limit of the rest at an end, mm/s; the largest angle between the robot's direction and
%% the line, or its reverse, for a drive without a turn, rad.
-define(SLOW, 100.0).
-define(STRAIGHT, 0.1).
%% The path of a robot that is a little off its line is longer than along the line by this at most.
-define(FAR_OFF, 1.1).

-spec simulation() -> module().
simulation() -> starl_sim_differential.

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

%% -- the profile and its bounds ----------------------------------------------------------------

%% @doc A whole profile: the iRobot Create's defaults, overridden by the given keys.
%% The Create's limits: 500 mm/s, axle 258 mm (Open Interface document, 2006).
-spec profile(map()) -> profile().
profile(Overrides) ->
    Default = #{
        speed => 500.0,
        near_speed => 500.0,
        near_mm => 0.0,
        turn_rate => 3.0,
        near_turn_rate => 3.0,
        leg_s => 0.29,
        axle_mm => 258.0,
        turn_from => 0.001,
        look_from => 0.02,
        heading_error => 0.02,
        distance_error => 0.01,
        position_error_mm => 1.0
    },
    Given = maps:merge(Default, Overrides),
    maps:merge(#{goal_mm => end_error(Given)}, Given).

%% @doc r(v): the largest distance of the robot from its straight line while it drives, mm.
-spec tracking_radius(profile()) -> float().
tracking_radius(#{goal_mm := Goal} = Profile) ->
    #{position_error_mm := Position} = Profile,
    Position + max(Goal + stall_mm(Profile), length_mm(Profile) * aside(Profile)).

%% ε': the sideways error at the end of a leg, for each millimetre of it.
aside(#{heading_error := Error, turn_from := TurnFrom} = Profile) ->
    Error + TurnFrom + ?SLIP * look_from(Profile).

%% The longest leg that does not lead to the goal, as a multiple of the last one.
longer(Profile) -> min(?LONGER, most_mm(Profile) / length_mm(Profile)).

%% The longest leg that the bound allows, wherever it leads.
most_mm(#{goal_mm := Goal} = Profile) ->
    max(length_mm(Profile), (Goal + stall_mm(Profile)) / aside(Profile)).

%% The centre of a robot that turns about one wheel moves half as far as the other wheel.
stall_mm(#{turn_rate := Rate, axle_mm := Axle}) -> ?STALL_S * Rate * Axle / 2 / 2.

%% The longest leg that does not lead to the goal, mm.
longest_mm(Profile) -> longer(Profile) * length_mm(Profile).

%% The least distance that a leg gains towards the goal unless it ends there, mm: the shortest leg less its
%% errors. None, if a last leg may miss the goal.
advance_mm(#{goal_mm := Goal, near_speed := Near, speed := Speed, leg_s := LegS} = Profile) ->
    #{distance_error := Part, position_error_mm := Position} = Profile,
    case Goal < end_error(Profile) of
        true -> 0.0;
        false -> min(Near, Speed) * LegS * (1 - Part - aside(Profile)) - 2 * Position
    end.

%% The least turn worth a look, rad. A smaller turn than the heading's error cannot be seen.
look_from(#{look_from := LookFrom, heading_error := Error}) -> max(LookFrom, Error).

%% The largest distance from the goal at the end of the last leg.
end_error(#{heading_error := Heading, distance_error := Part, turn_from := TurnFrom} = Profile) ->
    #{position_error_mm := Position} = Profile,
    length_mm(Profile) * (Heading + TurnFrom + Part) + 2 * Position + 0.5.

%% The longest leg that may lead to the goal, mm.
length_mm(#{speed := Speed, leg_s := LegS}) -> Speed * LegS.

%% @doc Its pace ({@link starl_chassis:pace()}). Before a leg it turns to the point of the line that is a
%% leg ahead, from at most r(v) off the line, where it looked along the line but for errors of its
%% heading. A correction is as long as a goal is missed by at most.
-spec pace(profile()) -> starl_chassis:pace().
pace(#{heading_error := Error, goal_mm := Goal, position_error_mm := Position} = Profile) ->
    #{speed := Far, near_speed := Near, turn_rate := Fast, near_turn_rate := NearRate} = Profile,
    Speed = min(Far, Near),
    Rate = min(Fast, NearRate),
    Slant = 2 * tracking_radius(Profile) / end_leg_mm(Profile) + 2 * Error,
    Leg = ?FAR_OFF * longest_mm(Profile) / Speed + Slant / Rate,
    Again = (Goal + 2 * Position) / min(Speed, ?SLOW) + straight_rad(Profile) / Rate,
    #{
        advance_mm => advance_mm(Profile),
        leg_us => ceil(1.0e6 * Leg),
        turn_us => ceil(1.0e6 * math:pi() / Rate),
        again_us => ceil(1.0e6 * Again)
    }.

%% -- a drive to a goal ------------------------------------------------------------------------

-spec next(starl_chassis:mode(), starl:pose(), starl_geometry:segment(), starl_chassis:profile()) ->
    arrived | starl_chassis:step().
next(to, Pose, Line, Profile) -> to(Pose, Line, Profile);
next(along, Pose, Line, Profile) -> along(Pose, Line, Profile);
next(face, Pose, Line, Profile) -> face(Pose, Line, Profile).

%% The next step of a robot that stands at a pose on its way along a line.
-spec to(starl:pose(), starl_geometry:segment(), profile()) -> arrived | step().
to({X, Y, _} = Pose, {_, Goal} = Line, #{goal_mm := Enough} = Profile) ->
    Here = {X, Y},
    case starl_geometry:distance(Here, Goal) of
        Distance when Distance =< Enough -> arrived;
        Distance -> resume(Pose, next_leg(Here, Distance, Line, Profile), Profile)
    end.

%% Towards the point of the line one leg ahead.
next_leg(Here, Distance, Line, Profile) ->
    {Speed, _} = speeds(Distance, Profile),
    Aim = aim(Here, Distance, Speed, Line, Profile),
    leg_to(Here, Aim, starl_geometry:distance(Here, Aim), Distance, Profile).

%% A robot that finds itself far off its line, as by the position of another robot, looks again
%% before it has driven all of it back. One that is a little off has a little farther to go than
%% along the line.
leg_to(Here, Aim, Mm, Distance, Profile) ->
    {Speed, TurnRate} = speeds(Distance, Profile),
    Last = Speed * maps:get(leg_s, Profile),
    Length =
        case Mm > 1.1 * longer(Profile) * Last of
            true -> Last;
            false -> min(Mm, most_mm(Profile))
        end,
    {starl_geometry:heading(Here, Aim), Length, Speed, TurnRate}.

%% Drives towards a point, and up to it if that is no longer than a leg; `Distance' is left to the goal.
towards({X, Y, _} = Pose, Aim, Distance, Profile) ->
    towards(Pose, Aim, starl_geometry:distance({X, Y}, Aim), Distance, Profile).

%% The same, for the given length.
towards({X, Y, _} = Pose, Aim, Mm, Distance, Profile) ->
    resume(Pose, leg_to({X, Y}, Aim, Mm, Distance, Profile), Profile).

%% The robot has turned to a leg, or has planned one. It drives if it now has the direction. It keeps to the leg: where legs are short, a new plan from its place might
%% have another direction each time.
-spec resume(starl:pose(), leg(), profile()) -> step().
resume({_, _, Heading}, {Wanted, Length, Speed, TurnRate} = Leg, Profile) ->
    #{turn_from := TurnFrom} = Profile,
    Drive = {Speed, Speed, takes_us(Length, Speed)},
    LookFrom = look_from(Profile),
    case starl_geometry:angle_diff(Wanted, Heading) of
        Angle when abs(Angle) =< TurnFrom -> {drive, [Drive]};
        Angle when abs(Angle) =< LookFrom -> {drive, [turning(Angle, TurnRate, Profile), Drive]};
        Angle -> {{look, Leg}, [turning(Angle, TurnRate, Profile)]}
    end.

%% Turns in place, left or right (rad).
turn(Angle, #{turn_rate := TurnRate} = Profile) -> {drive, [turning(Angle, TurnRate, Profile)]}.

%% Drives straight on, or back, for this length (mm) and at this speed (mm/s).
straight(Mm, Speed) ->
    V = sign(Mm) * Speed,
    {drive, [{V, V, takes_us(abs(Mm), Speed)}]}.

turning(Angle, TurnRate, #{axle_mm := Axle}) ->
    Wheel = sign(Angle) * TurnRate * Axle / 2,
    {-Wheel, Wheel, takes_us(abs(Angle), TurnRate)}.

speeds(Distance, #{near_mm := Near} = Profile) when Distance =< Near ->
    #{near_speed := Speed, near_turn_rate := TurnRate} = Profile,
    {Speed, TurnRate};
speeds(_Distance, #{speed := Speed, turn_rate := TurnRate}) ->
    {Speed, TurnRate}.

%% The point of the line from start to goal that lies one leg ahead of the robot; a leg ends where
%% the speed changes near the goal. The rest is no longer than a last leg may be.
aim(Here, Distance, Speed, {Start, Goal}, #{leg_s := LegS, near_mm := Near} = Profile) ->
    ToChange =
        case Distance > Near of
            true -> max(Distance - Near, 1.0);
            false -> Distance
        end,
    Length = starl_geometry:distance(Start, Goal),
    Along = starl_geometry:distance(Start, starl_geometry:closest_point(Here, {Start, Goal})),
    Last = Speed * LegS,
    Ahead = Along + min(ToChange, max(Last, min(longer(Profile) * Last, ToChange - 0.9 * Last))),
    case Ahead >= Length of
        true -> Goal;
        false -> starl_geometry:interpolate(Start, Goal, Ahead / Length)
    end.

takes_us(Amount, Rate) -> max(1, round(Amount / Rate * 1000000)).

sign(X) when X < 0 -> -1.0;
sign(_) -> 1.0.

%% -- along a line -----------------------------------------------------------------------------

%% A drive along a given line is exact at both ends to a few millimetres. So a pen that is lowered at
%% the beginning and raised at the end draws that line, even a very short one.
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
-spec ends_mm(profile()) -> float().
ends_mm(#{position_error_mm := Position} = Profile) -> float(window(Profile) + Position).

window(#{position_error_mm := Position}) -> max(1.0, Position).

%% The next step of a robot that stands at a pose on its way along a line to its end.
-spec along(starl:pose(), starl_geometry:segment(), profile()) ->
    arrived | step().
along({X, Y, _} = Pose, {_, Goal} = Line, #{goal_mm := Enough} = Profile) ->
    Window = window(Profile),
    Distance = starl_geometry:distance({X, Y}, Goal),
    case frame({X, Y}, Line) of
        no_direction ->
            to(Pose, Line, Profile);
        {_, Past, _} when Distance =< Enough, Past >= -Window / 2, Past =< Window ->
            arrived;
        {_, Past, _} when Distance =< Enough ->
            nudge(Window / 4 - Past, Pose, Line, Profile);
        Frame ->
            leg_along(Frame, Distance, Pose, Line, Profile)
    end.

%% The next step of a robot that stands at a pose near the beginning of a line and has to stand
%% at the beginning, looking along it.
-spec face(starl:pose(), starl_geometry:segment(), profile()) ->
    arrived | step().
face({X, Y, Heading} = Pose, {Start, Goal} = Line, #{goal_mm := Enough} = Profile) ->
    Window = window(Profile),
    case {starl_geometry:distance({X, Y}, Start), frame({X, Y}, Line)} of
        {_, no_direction} ->
            arrived;
        {Distance, _} when Distance > 2 * Enough ->
            towards(Pose, Start, Distance, Profile);
        {_, {Along, _, _}} ->
            Angle = starl_geometry:angle_diff(starl_geometry:heading(Start, Goal), Heading),
            case abs(Angle) =< look_from(Profile) of
                false -> turn(Angle, Profile);
                true when Along >= -Window, Along =< Window / 2 -> arrived;
                true -> nudge(-Window / 4 - Along, Pose, Line, Profile)
            end
    end.

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
    Straight = straight_rad(Profile),
    case starl_geometry:angle_diff(starl_geometry:heading(Start, Goal), Heading) of
        Angle when abs(Angle) =< Straight ->
            straight(Mm, min(Speed, ?SLOW));
        Angle when abs(Angle) >= 3.141592653589793 - Straight ->
            straight(-Mm, min(Speed, ?SLOW));
        Angle ->
            turn(Angle, Profile)
    end.

%% A robot near the end of a line, and near the line, drives parallel to it: steering
%% back to the line within a short way would end at a slant.
leg_along({Along, Past, Across}, Distance, {X, Y, _} = Pose, {Start, Goal}, Profile) ->
    Left = window(Profile) / 4 - Past,
    Length = Along - Past,
    Last = end_leg_mm(Profile),
    case Distance =< ?LAST_MOST * Last of
        true when Left > 0.0, abs(Across) < Last / 2 ->
            Ahead = max(Left, Last),
            Aim = starl_geometry:interpolate(Start, Goal, (Along + Ahead) / Length),
            Slant = starl_geometry:distance({X, Y}, Aim) / Ahead,
            towards(Pose, Aim, Left * Slant, Distance, Profile);
        true ->
            towards(Pose, Goal, Distance, Profile);
        false ->
            On = max(0.0, min(Length, Along)),
            Longest = longest_mm(Profile),
            Ahead = min(Longest, max(Length - On - Last, 0.0)),
            Aim = starl_geometry:interpolate(Start, Goal, (On + Ahead) / Length),
            %% as far away as half a last leg at least, as the goal is farther away than one and a half
            towards(Pose, Aim, Distance, Profile)
    end.

end_leg_mm(Profile) -> min(?LAST_MM, length_mm(Profile) / ?LAST_MOST).

straight_rad(Profile) -> max(?STRAIGHT, 2 * look_from(Profile)).

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
        Speed -> steered(starl_geometry:angle_diff(math:atan2(VY, VX), Heading), Speed, Us, Profile)
    end.

steered(Angle, Speed, Us, _Profile) when abs(Angle) < ?SMALLEST -> [{Speed, Speed, Us}];
steered(Angle, Speed, Us, #{turn_rate := Most} = Profile) ->
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
