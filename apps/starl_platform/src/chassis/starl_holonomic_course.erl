%% @doc The course of a robot that drives in any direction without a turn ({@link
%% starl_chassis_holonomic}): what it does next, given where it is, and how far off a line that may
%% take it.
%%
%% Every step is one straight leg from standing to standing: towards the point of the line one leg
%% ahead, so a leg's sideways error does not grow into the next one. A robot that is seen to be
%% farther off the line than g goes straight back to it first. At the ends of a given line what is
%% missing is driven slowly, straight to the right place, until the robot is <em>seen</em> to be
%% within w = max(1 mm, s) of the right place along the line: so it is within w + s ({@link
%% ends_mm/1}). It aims a quarter of w outside of the line's ends, as two wheels do ({@link
%% starl_differential_stroke}).
%%
%% <b>The bounds.</b> Over a leg of length L the direction errs by at most ε, the distance by at most
%% δ·L; positions are known to within s. A leg to the goal is no longer than L = speed · `leg_s', so it
%% ends within g = L·(ε + δ) + 2s + 0.5 mm of the goal, as it is seen. Legs that do not lead to the
%% goal may be longer, up to 2L, as long as their error L'·(1 + δ)·ε + 2s is no more than g.
%%
%% A leg along the line begins at most g off it as it is seen, and so g + s. It aims at the line and
%% ends at most L'·(1 + δ)·ε + s off it; between the two it is no farther off than at both ends, since the
%% path is straight: a robot that brakes before its time does so along its path, and needs no more
%% room than is left of it. Slip makes it shorter, and no more.
%%
%% <b>A drive that fails</b> along one of the robot's axes leaves the other one. The chassis finds
%% out within t = 15 ms. Until then the velocity has changed by at most A·t (A the limit of
%% acceleration), which takes the robot A·t²/2 off its path. It brakes from a speed of at most V along
%% its present direction, whose part across the path is at most A·t: over V/A seconds, with an even
%% loss of speed, t·V/2. A try, the other way round, is driven with 10 mm/s for 20 ms: 0.2 mm, twice
%% if the second one has to undo the first. Together b = A·t²/2 + t·V/2 + 0.4 mm.
%% A leg straight back to the line adds nothing to that: whichever axis fails, what is left of its
%% velocity does not point away from the line.
%%
%% So it is never farther from the line than r(v) = g + s + b ({@link tracking_radius/1}).
-module(starl_holonomic_course).

-export([profile/1, tracking_radius/1, ends_mm/1, next/4]).

-export_type([profile/0]).

%% `speed' (mm/s) and `acceleration' (mm/s²) are the limits, `leg_s' gives the length of the last leg
%% in times of full speed, `goal_mm' is how near a goal is near enough; the bounds of the errors are
%% as in {@link starl_chassis:profile()}.
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

%% How much longer than the last a leg may be.
-define(LONGER, 2.0).
%% The last leg of a given line is hardly longer, mm; what is missing at an end is driven no faster,
%% mm/s.
-define(LAST_MM, 40.0).
-define(SLOW, 100.0).
%% How long the chassis takes to find out that its drive does not obey; two tries, mm.
-define(STALL_S, 0.015).
-define(TRIES_MM, 0.4).

%% @doc A whole profile: the defaults, overridden by the given keys. 2 m/s² is a fifth of the
%% acceleration of a fall: a quadrotor leans by 11 degrees.
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

%% @doc r(v): how far from the straight line the robot may be while it drives, in millimetres.
-spec tracking_radius(profile()) -> float().
tracking_radius(#{goal_mm := Goal, position_error_mm := Position} = Profile) ->
    Goal + Position + stall_mm(Profile).

stall_mm(#{speed := Speed, acceleration := Acceleration}) ->
    Acceleration * ?STALL_S * ?STALL_S / 2 + ?STALL_S * Speed / 2 + ?TRIES_MM.

%% @doc How far along a line its beginning and its end may be from where a robot began and ended it.
-spec ends_mm(profile()) -> float().
ends_mm(#{position_error_mm := Position} = Profile) -> float(window(Profile) + Position).

window(#{position_error_mm := Position}) -> max(1.0, Position).

length_mm(#{speed := Speed, leg_s := LegS}) -> Speed * LegS.

longest_mm(#{goal_mm := Goal, position_error_mm := Position} = Profile) ->
    #{heading_error := Error, distance_error := Part} = Profile,
    Last = length_mm(Profile),
    Most = (Goal - 2 * Position) / max(Error * (1 + Part), 1.0e-9),
    max(Last, min(?LONGER * Last, Most)).

%% @doc What a robot does next that stands at a pose and is on its way.
-spec next(starl_chassis:way(), starl:pose(), starl_geometry:segment(), profile()) ->
    arrived | {drive, starl_chassis_holonomic:commands()}.
next(Way, Pose, {Start, Goal} = Line, Profile) ->
    case {Way, starl_geometry:distance(Start, Goal) < 1.0e-6} of
        {face, true} -> arrived;
        {face, false} -> face(Pose, Line, Profile);
        {along, false} -> along(Pose, Line, Profile);
        {_, _} -> to(Pose, Line, Profile)
    end.

to({X, Y, _} = Pose, {_, Goal} = Line, #{goal_mm := Enough} = Profile) ->
    case starl_geometry:distance({X, Y}, Goal) =< Enough of
        true -> arrived;
        false -> follow(Pose, ahead(Pose, Line, last(Profile), Goal, Profile), Line, Profile)
    end.

%% The last leg is no longer than it may be.
last(Profile) -> {length_mm(Profile), 0.9 * length_mm(Profile)}.

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
            Last = min(?LAST_MM, length_mm(Profile)),
            follow(Pose, ahead(Pose, Line, {1.5 * Last, Last}, End, Profile), Line, Profile)
    end.

face({X, Y, _} = Pose, {Start, Goal} = Line, #{goal_mm := Enough} = Profile) ->
    Window = window(Profile),
    {Along, _} = frame({X, Y}, Line),
    case starl_geometry:distance({X, Y}, Start) of
        Distance when Distance =< Enough, Along >= -Window, Along =< Window / 2 -> arrived;
        Distance when Distance =< Enough -> nudge(beyond(Window / 4, {Goal, Start}), Pose, Profile);
        _ -> leg(Pose, Start, Profile)
    end.

%% -- where to -------------------------------------------------------------------------------

%% How far along the line from its beginning, and how far past its end.
frame({X, Y}, {{AX, AY} = A, {BX, BY} = B}) ->
    Length = starl_geometry:distance(A, B),
    Along = ((X - AX) * (BX - AX) + (Y - AY) * (BY - AY)) / Length,
    {Along, Along - Length}.

beyond(Mm, {{AX, AY} = A, {BX, BY} = B}) ->
    Part = Mm / starl_geometry:distance(A, B),
    {BX + Part * (BX - AX), BY + Part * (BY - AY)}.

%% The point of the line one leg ahead, or its end, where that is near. What is left for the last leg
%% is about `Rest'.
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

%% First back to the line.
follow({X, Y, _} = Pose, Aim, Line, #{goal_mm := Most} = Profile) ->
    On = starl_geometry:closest_point({X, Y}, Line),
    case starl_geometry:distance({X, Y}, On) > Most of
        true -> leg(Pose, On, Profile);
        false -> leg(Pose, Aim, Profile)
    end.

%% One that finds itself far off, as by another one's position, does not go all the way without a
%% look.
leg({X, Y, _} = Pose, Aim, Profile) ->
    Mm = starl_geometry:distance({X, Y}, Aim),
    Length =
        case Mm > 1.1 * longest_mm(Profile) of
            true -> length_mm(Profile);
            false -> Mm
        end,
    #{speed := Speed} = Profile,
    straight(Pose, starl_geometry:heading({X, Y}, Aim), Length, Speed, Profile).

%% Some millimetres to the very place, slowly.
nudge({_, _} = Place, {X, Y, _} = Pose, #{speed := Speed} = Profile) ->
    Mm = starl_geometry:distance({X, Y}, Place),
    straight(Pose, starl_geometry:heading({X, Y}, Place), Mm, min(Speed, ?SLOW), Profile).

%% So fast that it is not too fast if it errs, and has come to that speed before it has to brake.
straight({_, _, Heading}, Direction, Mm, Fastest, Profile) ->
    #{acceleration := Acceleration, distance_error := Error} = Profile,
    Speed = min(Fastest / (1 + Error), math:sqrt(Mm * Acceleration)),
    Angle = Direction - Heading,
    Us = max(1, round(Mm / max(Speed, 1.0e-3) * 1.0e6)),
    {drive, [{Speed * math:cos(Angle), Speed * math:sin(Angle), Us}]}.
