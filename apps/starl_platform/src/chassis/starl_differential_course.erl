%% @doc Plans how a robot with two wheels drives along a straight line. It computes the next step
%% from the present pose, and a bound on the distance from the line.
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
-module(starl_differential_course).

-export([profile/1, tracking_radius/1, next/3, turned/3]).
-export([towards/4, towards/5, turn/2, straight/2, look_from/1, longest_mm/1, last_mm/1]).
-export([advance_mm/1]).

-export_type([profile/0, leg/0, step/0]).

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
    {{look, leg()}, starl_chassis_differential:commands()}
    | {drive, starl_chassis_differential:commands()}.

%% The part of a turn that slipping wheels may take off.
-define(SLIP, 0.5).
%% The longest leg, as a multiple of the last one.
-define(LONGER, 2.0).
%% The time in which the chassis notices that a wheel is stuck.
-define(STALL_S, 0.015).

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

%% @doc The next step of a robot that stands at a pose on its way along a line.
-spec next(starl:pose(), starl_geometry:segment(), profile()) -> arrived | step().
next({X, Y, _} = Pose, {_, Goal} = Line, #{goal_mm := Enough} = Profile) ->
    Here = {X, Y},
    case starl_geometry:distance(Here, Goal) of
        Distance when Distance =< Enough -> arrived;
        Distance -> turned(Pose, leg(Here, Distance, Line, Profile), Profile)
    end.

%% Towards the point of the line one leg ahead.
leg(Here, Distance, Line, Profile) ->
    {Speed, _} = speeds(Distance, Profile),
    Aim = aim(Here, Distance, Speed, Line, Profile),
    leg_to(Here, Aim, starl_geometry:distance(Here, Aim), Distance, Profile).

%% A robot that finds itself far off its line, as by the position of another robot, looks again
%% before it has driven the whole way back. One that is a little off has a little farther to go than
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

%% @doc Drives towards a point, all the way if that is no longer than a leg; `ToGoalMm' is left to
%% the goal.
-spec towards(starl:pose(), starl_geometry:point(), ToGoalMm :: float(), profile()) -> step().
towards({X, Y, _} = Pose, Aim, Distance, Profile) ->
    towards(Pose, Aim, starl_geometry:distance({X, Y}, Aim), Distance, Profile).

%% @doc The same, for the given length.
-spec towards(starl:pose(), starl_geometry:point(), Mm, ToGoalMm, profile()) -> step() when
    Mm :: float(), ToGoalMm :: float().
towards({X, Y, _} = Pose, Aim, Mm, Distance, Profile) ->
    turned(Pose, leg_to({X, Y}, Aim, Mm, Distance, Profile), Profile).

%% @doc Turns in place, left or right (rad).
-spec turn(float(), profile()) -> step().
turn(Angle, #{turn_rate := TurnRate} = Profile) -> {drive, [turn(Angle, TurnRate, Profile)]}.

%% @doc Drives straight on, or back, for this length (mm) and at this speed (mm/s).
-spec straight(float(), Speed :: float()) -> step().
straight(Mm, Speed) ->
    V = sign(Mm) * Speed,
    {drive, [{V, V, duration_us(abs(Mm), Speed)}]}.

%% @doc The longest leg that does not lead to the goal, mm.
-spec longest_mm(profile()) -> float().
longest_mm(Profile) -> longer(Profile) * length_mm(Profile).

%% @doc The longest leg that may lead to the goal, mm.
-spec last_mm(profile()) -> float().
last_mm(Profile) -> float(length_mm(Profile)).

%% @doc The least way that a leg makes towards the goal unless it ends there, mm: the shortest leg less its
%% errors. None, if a last leg may miss the goal.
-spec advance_mm(profile()) -> float().
advance_mm(#{goal_mm := Goal, near_speed := Near, speed := Speed, leg_s := LegS} = Profile) ->
    #{distance_error := Part, position_error_mm := Position} = Profile,
    case Goal < end_error(Profile) of
        true -> 0.0;
        false -> min(Near, Speed) * LegS * (1 - Part - aside(Profile)) - 2 * Position
    end.

%% @doc The next step of a robot that stands at a pose and has turned to a leg: it drives if it now
%% has the direction. It keeps to the leg: where legs are short, a new plan from its place might
%% have another direction each time.
-spec turned(starl:pose(), leg(), profile()) -> step().
turned({_, _, Heading}, {Wanted, Length, Speed, TurnRate} = Leg, Profile) ->
    #{turn_from := TurnFrom} = Profile,
    Drive = {Speed, Speed, duration_us(Length, Speed)},
    LookFrom = look_from(Profile),
    case starl_geometry:angle_diff(Wanted, Heading) of
        Angle when abs(Angle) =< TurnFrom -> {drive, [Drive]};
        Angle when abs(Angle) =< LookFrom -> {drive, [turn(Angle, TurnRate, Profile), Drive]};
        Angle -> {{look, Leg}, [turn(Angle, TurnRate, Profile)]}
    end.

%% @doc The least turn worth a look, rad. A smaller turn than the heading's error cannot be seen.
-spec look_from(profile()) -> float().
look_from(#{look_from := LookFrom, heading_error := Error}) -> max(LookFrom, Error).

turn(Angle, TurnRate, #{axle_mm := Axle}) ->
    Wheel = sign(Angle) * TurnRate * Axle / 2,
    {-Wheel, Wheel, duration_us(abs(Angle), TurnRate)}.

speeds(Distance, #{near_mm := Near} = Profile) when Distance =< Near ->
    #{near_speed := Speed, near_turn_rate := TurnRate} = Profile,
    {Speed, TurnRate};
speeds(_Distance, #{speed := Speed, turn_rate := TurnRate}) ->
    {Speed, TurnRate}.

%% The point of the line from start to goal that lies one leg ahead of the robot; a leg ends where
%% the speed changes near the goal. The rest of the way is no longer than a last leg may be.
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

%% The largest distance from the goal at the end of the last leg.
end_error(#{heading_error := Heading, distance_error := Part, turn_from := TurnFrom} = Profile) ->
    #{position_error_mm := Position} = Profile,
    length_mm(Profile) * (Heading + TurnFrom + Part) + 2 * Position + 0.5.

length_mm(#{speed := Speed, leg_s := LegS}) -> Speed * LegS.

duration_us(Amount, Rate) -> max(1, round(Amount / Rate * 1000000)).

sign(X) when X < 0 -> -1.0;
sign(_) -> 1.0.
