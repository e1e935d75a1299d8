%% @doc The chassis that drives in any direction without turning. It models the paper's quadrotor at
%% a constant height, as a point mass with limited speed and acceleration.
%%
%% A command is a velocity in the robot's own frame with a duration, `{Forward, Left, Us}', mm/s.
%% The chassis approaches the velocity at its limit of acceleration, from its present velocity, and
%% keeps it for the rest of the time. After the last command it brakes at that limit and stops. So a
%% robot at rest that gets one velocity v for a time t ends v·t from its place, if t is no shorter
%% than the approach to v. The distance that it lacks at the beginning it covers while it brakes.
-module(starl_chassis_holonomic).
-behaviour(starl_chassis).

-export([simulation/0, profile/1, check/1, duration_us/2, next/4, last/1, undo/1, try_mm/1]).
-export([tracking_radius/1, ends_mm/1, cruise/4, rests_s/1, pace/1]).

-export_type([commands/0, profile/0]).

-type commands() :: [{Forward :: number(), Left :: number(), Us :: pos_integer()}].

%% The limits of a command: speed (mm/s), duration (us).
-define(FASTEST, 1.0e6).
-define(LONGEST_US, (1 bsl 50)).
-define(IS_SPEED(V), is_number(V), V =< ?FASTEST, V >= -?FASTEST).
%% The limits of a try: longer than the chassis needs to notice a failure (15 ms), and slow (mm/s).
-define(TRY_US, 20000).
-define(TRY_SPEED, 10.0).

%% `speed' (mm/s) and `acceleration' (mm/s²) are the limits, `leg_s' is the length of the last leg
%% as a time at full speed, `goal_mm' the distance at which a goal is reached; the bounds of the
%% errors are as in {@link starl_chassis:profile()}.
-type profile() :: #{
    speed := float(),
    acceleration := float(),
    leg_s := float(),
    goal_mm := float(),
    heading_error := float(),
    distance_error := float(),
    position_error_mm := float(),
    chassis => module()
}.

%% The longest leg, as a multiple of the last one.
-define(LONGER, 2.0).
%% The length of the last leg of a given line, about, mm, and its most as a multiple of that, which
%% is no longer than L; the speed limit of the rest at an end, mm/s.
-define(LAST_MM, 40.0).
-define(LAST_MOST, 1.5).
-define(SLOW, 100.0).
%% The time in which the chassis notices that its drive does not obey; the length of two tries, mm.
-define(STALL_S, 0.015).
-define(TRIES_MM, 0.4).
%% The path of a robot that is a little off its line is longer than along the line by this at most.
-define(FAR_OFF, 1.1).

-spec simulation() -> module().
simulation() -> starl_sim_holonomic.

-spec check(term()) -> ok | {error, string()}.
check([]) ->
    ok;
check([{Forward, Left, Us} | Commands]) when
    ?IS_SPEED(Forward), ?IS_SPEED(Left), is_integer(Us), Us > 0, Us =< ?LONGEST_US
->
    check(Commands);
check(_) ->
    {error, "[{Forward, Left, Us}]: mm/s within 1.0e6, Us from 1"}.

%% It brakes at the end, from a speed that slip may have lowered, or its error raised.
-spec duration_us(commands(), starl_chassis:profile()) -> {Least, Most} when
    Least :: non_neg_integer(), Most :: non_neg_integer().
duration_us(Commands, #{acceleration := Acceleration, speed := Speed}) ->
    Us = lists:sum([Us || {_, _, Us} <- Commands]),
    {Us, Us + ceil(Speed / Acceleration * 1.0e6)}.

-spec last(commands()) -> {Forward :: number(), Left :: number()}.
last([]) ->
    {0.0, 0.0};
last(Commands) ->
    {Forward, Left, _} = lists:last(Commands),
    {Forward, Left}.

-spec undo(term()) -> {ok, commands()} | none | unknown.
undo({Forward, Left}) when Forward == 0, Left == 0 ->
    none;
undo({Forward, Left}) when ?IS_SPEED(Forward), ?IS_SPEED(Left) ->
    Part = min(1.0, ?TRY_SPEED / math:sqrt(Forward * Forward + Left * Left)),
    {ok, [{-Part * Forward, -Part * Left, ?TRY_US}]};
undo(_) ->
    unknown.

-spec try_mm(starl_chassis:profile()) -> float().
try_mm(_Profile) -> ?TRY_SPEED * ?TRY_US / 1.0e6.

%% It approaches the velocity at its limit of acceleration; the speed leaves room for its error.
-spec cruise(starl_chassis:velocity(), starl:pose(), pos_integer(), starl_chassis:profile()) ->
    commands().
cruise({VX, VY}, {_, _, Heading}, Us, #{distance_error := Error}) ->
    {Cos, Sin} = {math:cos(Heading), math:sin(Heading)},
    Part = 1.0 / (1.0 + Error),
    [{Part * (VX * Cos + VY * Sin), Part * (VY * Cos - VX * Sin), Us}].

-spec rests_s(starl_chassis:profile()) -> float().
rests_s(#{speed := Speed, acceleration := Acceleration}) -> Speed / Acceleration.

%% -- the course -------------------------------------------------------------------------------

%% The robot's next step from its present pose, and a bound on its distance from the line.
%%
%% Every step is one straight leg from standing to standing: towards the point of the line one leg
%% ahead, so a leg's sideways error does not grow into the next one. A robot that is seen
%% farther off the line than g first goes straight back to it. At the ends of a given line the
%% rest is driven slowly, straight to the right place, until the robot is seen within w = max(1 mm, s) of
%% the right place along the line: so it is within w + s (ends_mm/1). It aims a quarter of w outside of the
%% line's ends, as two wheels do (starl_chassis_differential).
%%
%% The bounds. Over a leg of length L the direction errs by at most ε, the distance by at
%% most δ·L; positions are known to within s. A leg to the goal is no longer than L = speed ·
%% `leg_s', so it ends within g = L·(ε + δ) + 2s + 0.5 mm of the goal, as it is seen; a quarter of w
%% beyond it is no more than the 0.5 mm, or half of s. A leg that does not lead to the goal may be
%% longer, L' of up to 2L, as long as its error L'·(1 + δ)·ε + 2s is at most g.
%%
%% A leg along the line begins at most g off it as it is seen, and so at most g + s. It aims at the
%% line and ends at most L'·(1 + δ)·ε + s off it; between the two the distance is no greater than at
%% both ends, since the path is straight: a robot that brakes early does so along its path, within
%% the rest of it. Slip only makes the path shorter.
%%
%% A drive that fails along one of the robot's axes leaves the other one. The chassis notices
%% within t = 15 ms. Until then the velocity has changed by at most A·t (A the limit of
%% acceleration), which takes the robot A·t²/2 off its path. It brakes from a speed of at most V
%% along its present direction, whose part across the path is at most A·t: over V/A seconds, with an
%% even loss of speed, t·V/2. A try, in reverse, is driven with 10 mm/s for 20 ms: 0.2 mm, twice if
%% a second try has to undo the first. Together b = A·t²/2 + t·V/2 + 0.4 mm. A leg straight back to
%% the line adds nothing to b: whichever axis fails, the rest of the velocity does not point away
%% from the line.
%%
%% So the robot is never farther from the line than r(v) = g + s + b (tracking_radius/1).

%% @doc A whole profile: the defaults, overridden by the given keys. 2 m/s² is a fifth of the
%% acceleration of gravity: a quadrotor leans by 11 degrees.
-spec profile(map()) -> profile().
profile(Overrides) ->
    Default = #{
        speed => 500.0,
        acceleration => 2000.0,
        leg_s => 0.29,
        heading_error => 0.02,
        distance_error => 0.01,
        position_error_mm => 1.0
    },
    Given = maps:merge(Default, Overrides),
    maps:merge(#{goal_mm => end_error(Given)}, Given).

end_error(#{heading_error := Heading, distance_error := Part, position_error_mm := S} = Profile) ->
    length_mm(Profile) * (Heading + Part) + 2 * S + 0.5.

%% @doc r(v): the largest distance of the robot from its straight line while it drives, mm.
-spec tracking_radius(profile()) -> float().
tracking_radius(#{goal_mm := Goal, position_error_mm := Position} = Profile) ->
    Goal + Position + stall_mm(Profile).

stall_mm(#{speed := Speed, acceleration := Acceleration}) ->
    Acceleration * ?STALL_S * ?STALL_S / 2 + ?STALL_S * Speed / 2 + ?TRIES_MM.

%% @doc The largest distance along a line between its ends and the places where a robot began and
%% ended it.
-spec ends_mm(profile()) -> float().
ends_mm(#{position_error_mm := Position} = Profile) -> float(window(Profile) + Position).

window(#{position_error_mm := Position}) -> max(1.0, Position).

%% @doc Its pace ({@link starl_chassis:pace()}): a leg has its longest length, and begins and ends
%% standing; a correction is as long as a goal is missed by at most. A last leg may miss a nearer goal.
-spec pace(profile()) -> starl_chassis:pace().
pace(#{speed := Speed, goal_mm := Goal, position_error_mm := Position} = Profile) ->
    #{heading_error := Error, distance_error := Part} = Profile,
    Advance = length_mm(Profile) * (1 - Error - Part) - 2 * Position,
    #{
        advance_mm =>
            case Goal < end_error(Profile) of
                true -> 0.0;
                false -> Advance
            end,
        leg_us => leg_us(?FAR_OFF * longest_mm(Profile), Speed, Profile),
        turn_us => 0,
        again_us => leg_us(Goal + 2 * Position, min(Speed, ?SLOW), Profile)
    }.

%% The longest time of a leg of this length: it is driven at its speed, less the error. One that is so short
%% that the robot brakes as soon as it is fast enough takes less: twice the square root of Mm / Acceleration.
leg_us(Mm, Fastest, #{acceleration := Acceleration, distance_error := Part}) ->
    Speed = Fastest / (1 + Part),
    ceil(1.0e6 * (Mm / Speed + Speed / Acceleration)).

length_mm(#{speed := Speed, leg_s := LegS}) -> Speed * LegS.

longest_mm(Profile) -> min(?LONGER * length_mm(Profile), most_mm(Profile)).

%% The longest leg that the bound allows, wherever it leads.
most_mm(#{goal_mm := Goal, position_error_mm := Position} = Profile) ->
    #{heading_error := Error, distance_error := Part} = Profile,
    max(length_mm(Profile), (Goal - 2 * Position) / max(Error * (1 + Part), 1.0e-9)).

%% @doc The next step of a robot that stands at a pose on its way.
-spec next(starl_chassis:mode(), starl:pose(), starl_geometry:segment(), profile()) ->
    arrived | {drive, commands()}.
next(Mode, Pose, {Start, Goal} = Line, Profile) ->
    case {Mode, starl_geometry:distance(Start, Goal) < 1.0e-6} of
        {face, true} -> arrived;
        {face, false} -> face(Pose, Line, Profile);
        {along, false} -> along(Pose, Line, Profile);
        {_, _} -> to(Pose, Line, Profile)
    end.

to({X, Y, _} = Pose, {_, Goal} = Line, #{goal_mm := Enough} = Profile) ->
    case starl_geometry:distance({X, Y}, Goal) =< Enough of
        true -> arrived;
        false -> follow(Pose, ahead(Pose, Line, last_leg(Profile), Goal, Profile), Line, Profile)
    end.

%% The last leg of a drive to a point, and a little less for the rest before it.
last_leg(Profile) -> {length_mm(Profile), 0.9 * length_mm(Profile)}.

along({X, Y, _} = Pose, {_, Goal} = Line, #{goal_mm := Enough} = Profile) ->
    Window = window(Profile),
    {_, Past} = frame({X, Y}, Line),
    case starl_geometry:distance({X, Y}, Goal) of
        Distance when Distance =< Enough, Past >= -Window / 2, Past =< Window ->
            arrived;
        Distance when Distance =< Enough ->
            nudge(beyond(Window / 4, Line), Pose, Profile);
        _ ->
            End = beyond(Window / 4, Line),
            Last = min(?LAST_MM, length_mm(Profile) / ?LAST_MOST),
            Aim = ahead(Pose, Line, {?LAST_MOST * Last, Last}, End, Profile),
            follow(Pose, Aim, Line, Profile)
    end.

face({X, Y, _} = Pose, {Start, Goal} = Line, #{goal_mm := Enough} = Profile) ->
    Window = window(Profile),
    {Along, _} = frame({X, Y}, Line),
    case starl_geometry:distance({X, Y}, Start) of
        Distance when Distance =< Enough, Along >= -Window, Along =< Window / 2 -> arrived;
        Distance when Distance =< Enough -> nudge(beyond(Window / 4, {Goal, Start}), Pose, Profile);
        _ -> leg(Pose, Start, Profile)
    end.

%% -- the target of a leg --------------------------------------------------------------------

%% The place along the line from its beginning, and past its end.
frame({X, Y}, {{AX, AY} = A, {BX, BY} = B}) ->
    Length = starl_geometry:distance(A, B),
    Along = ((X - AX) * (BX - AX) + (Y - AY) * (BY - AY)) / Length,
    {Along, Along - Length}.

beyond(Mm, {{AX, AY} = A, {BX, BY} = B}) ->
    Part = Mm / starl_geometry:distance(A, B),
    {BX + Part * (BX - AX), BY + Part * (BY - AY)}.

%% The point of the line one leg ahead, or its end, if that is near. About `Rest' is left for the
%% last leg.
ahead({X, Y, _}, {Start, Goal} = Line, {Near, Rest}, End, Profile) ->
    Length = starl_geometry:distance(Start, Goal),
    On = starl_geometry:distance(Start, starl_geometry:closest_point({X, Y}, Line)),
    case Length - On of
        Left when Left =< Near ->
            End;
        Left ->
            Mm = min(longest_mm(Profile), Left - Rest),
            starl_geometry:interpolate(Start, Goal, (On + Mm) / Length)
    end.

%% A robot far off the line goes back to it first.
follow({X, Y, _} = Pose, Aim, Line, #{goal_mm := Most} = Profile) ->
    On = starl_geometry:closest_point({X, Y}, Line),
    case starl_geometry:distance({X, Y}, On) > Most of
        true -> leg(Pose, On, Profile);
        false -> leg(Pose, Aim, Profile)
    end.

%% A robot that finds itself far off, as by the position of another robot, looks again before it has
%% driven the whole way. One that is a little off its line has a little farther to go than along it.
leg({X, Y, _} = Pose, Aim, Profile) ->
    Mm = starl_geometry:distance({X, Y}, Aim),
    Length =
        case Mm > 1.1 * longest_mm(Profile) of
            true -> length_mm(Profile);
            false -> min(Mm, most_mm(Profile))
        end,
    #{speed := Speed} = Profile,
    straight(Pose, starl_geometry:heading({X, Y}, Aim), Length, Speed, Profile).

%% Drives slowly to the exact place.
nudge({_, _} = Place, {X, Y, _} = Pose, #{speed := Speed} = Profile) ->
    Mm = starl_geometry:distance({X, Y}, Place),
    straight(Pose, starl_geometry:heading({X, Y}, Place), Mm, min(Speed, ?SLOW), Profile).

%% The speed leaves room for its error, and is reached before the robot has to brake.
straight({_, _, Heading}, Direction, Mm, Fastest, Profile) ->
    #{acceleration := Acceleration, distance_error := Error} = Profile,
    Speed = min(Fastest / (1 + Error), math:sqrt(Mm * Acceleration)),
    Angle = Direction - Heading,
    Us = max(1, round(Mm / max(Speed, 1.0e-3) * 1.0e6)),
    {drive, [{Speed * math:cos(Angle), Speed * math:sin(Angle), Us}]}.
