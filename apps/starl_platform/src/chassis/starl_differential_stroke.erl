%% @doc The course of a robot with two wheels along a given line, from its beginning to its end, to a
%% few millimetres: what it does next, given where it is ({@link starl_differential_course}). So a pen
%% that is lowered at the beginning and raised at the end draws that line, however short it is.
%%
%% Near the end a leg is short, and what is still missing along the line is driven slowly, forwards
%% or backwards, without a turn. A robot has begun, or ended, when it is <em>seen</em> to be within
%% w = max(1 mm, s) of the right place along the line, s the error of positions: so it is within
%% w + s ({@link ends_mm/1}), whatever became of the command that brought it there.
%%
%% It aims a quarter of w outside of the line's ends, and takes less for too little than for too
%% much: seen from 1/2 w inside to w outside is near enough.
-module(starl_differential_stroke).

-export([ends_mm/1, along/3, face/3]).

-type step() :: starl_differential_course:step().

%% The last leg of a line is hardly longer, so that it ends near it, mm.
-define(LAST_MM, 40.0).
%% What is missing at an end is driven no faster, mm/s; without a turn if the robot looks along the
%% line, or back, to within so much, rad.
-define(SLOW, 100.0).
-define(STRAIGHT, 0.1).

%% @doc How far along a line its beginning and its end may be from where a robot began and ended
%% it, in millimetres.
-spec ends_mm(starl_differential_course:profile()) -> float().
ends_mm(#{position_error_mm := Position} = Profile) -> float(window(Profile) + Position).

window(#{position_error_mm := Position}) -> max(1.0, Position).

%% @doc What a robot does next that stands at a pose and is on its way along a line to its end.
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

%% @doc What a robot does next that stands at a pose near the beginning of a line and is to stand
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

%% How far along the line from its beginning, how far past its end, and how far to its left.
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

%% Some millimetres along the line, or back, the way that the robot looks; else it turns first.
nudge(Mm, {_, _, Heading}, {Start, Goal}, #{speed := Speed} = Profile) ->
    Straight = max(?STRAIGHT, 2 * starl_differential_course:look_from(Profile)),
    case starl_geometry:angle_diff(starl_geometry:heading(Start, Goal), Heading) of
        Angle when abs(Angle) =< Straight ->
            starl_differential_course:straight(Mm, min(Speed, ?SLOW));
        Angle when abs(Angle) >= 3.141592653589793 - Straight ->
            starl_differential_course:straight(-Mm, min(Speed, ?SLOW));
        Angle ->
            starl_differential_course:turn(Angle, Profile)
    end.

%% A line that is nearly done is driven to its end beside where it is, if that is near: to steer
%% back to it within a short way would take it to the end at a slant.
leg({Along, Past, Across}, Distance, {X, Y, _} = Pose, {Start, Goal} = Line, Profile) ->
    Left = window(Profile) / 4 - Past,
    Length = Along - Past,
    Last = last_mm(Profile),
    case Distance =< 1.5 * Last of
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
            far(Pose, Aim, Distance, Line, Profile)
    end.

%% From far off the line all that is left of it may be its end.
far({X, Y, _} = Pose, Aim, Distance, {_, Goal}, Profile) ->
    case starl_geometry:distance({X, Y}, Aim) > last_mm(Profile) / 2 of
        true -> starl_differential_course:towards(Pose, Aim, Distance, Profile);
        false -> starl_differential_course:towards(Pose, Goal, Distance, Profile)
    end.

last_mm(Profile) -> min(?LAST_MM, starl_differential_course:last_mm(Profile)).
