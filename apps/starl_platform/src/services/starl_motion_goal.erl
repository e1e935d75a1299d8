%% @doc A goal of motion: a point to drive to, a line to drive along, or the beginning of a line. It
%% also counts how often in a row the drive has not obeyed on the way there, and how long the robot
%% has waited. Pure; a part of {@link starl_motion}.
-module(starl_motion_goal).

-export([none/0, new/2, said/1, is_line/1, heads_to/1, begins/2, next/4]).
-export([stalled/1, moves/1, is_blocked/1, waited/1, waited/2, keeps/4]).

-export_type([t/0]).

-record(goal, {
    %% to the goal, or along a given line, or to the beginning of one
    way = to :: starl_chassis:way(),
    start = unknown :: starl_geometry:point() | unknown,
    point = {0.0, 0.0} :: starl_geometry:point(),
    %% is the line to it known?
    known = false :: boolean(),
    stalls = 0 :: non_neg_integer(),
    waited = 0 :: non_neg_integer()
}).

-opaque t() :: #goal{}.

%% Something is in the way of a robot that has come up against it so often, and back each time.
-define(STALLS, 3).

%% @doc What a robot has before its first goal.
-spec none() -> t().
none() -> #goal{}.

%% @doc A drive begins; where, may be unknown yet.
-spec new(starl_chassis:way(), {starl_geometry:point() | unknown, starl_geometry:point()}) -> t().
new(Way, {Start, Point}) -> #goal{way = Way, start = Start, point = Point}.

%% @doc The kind of drive and the point to drive to.
-spec said(t()) -> {goal, starl_chassis:way(), starl_geometry:point()}.
said(#goal{way = Way} = Goal) -> {goal, Way, heads_to(Goal)}.

%% @doc Is a line given?
-spec is_line(t()) -> boolean().
is_line(#goal{way = Way}) -> Way =/= to.

%% @doc The point that it is to drive to.
-spec heads_to(t()) -> starl_geometry:point().
heads_to(#goal{way = face, start = {_, _} = Start}) -> Start;
heads_to(#goal{point = Point}) -> Point.

%% @doc The robot knows where it stands, and so its line, which is returned once.
-spec begins(starl:pose(), t()) -> {[{line, starl_geometry:segment()}], t()}.
begins(_Pose, #goal{known = true} = Goal) ->
    {[], Goal};
begins({X, Y, _}, #goal{start = unknown} = Goal) ->
    known(Goal#goal{start = {X, Y}});
begins(_Pose, Goal) ->
    known(Goal).

known(#goal{start = Start, point = Point} = Goal) ->
    {[{line, {Start, Point}}], Goal#goal{known = true}}.

%% @doc The chassis' next step from here, once the line is known.
-spec next(starl:pose(), module(), starl_chassis:profile(), t()) -> starl_chassis:step().
next(Pose, Chassis, Profile, #goal{way = Way, start = Start, point = Point}) ->
    Chassis:next(Way, Pose, {Start, Point}, Profile).

%% @doc Once more its drive has not obeyed.
-spec stalled(t()) -> t().
stalled(#goal{stalls = N} = Goal) -> Goal#goal{stalls = N + 1}.

%% @doc Its drive has obeyed.
-spec moves(t()) -> t().
moves(Goal) -> Goal#goal{stalls = 0}.

%% @doc Does an obstacle block its line?
-spec is_blocked(t()) -> boolean().
is_blocked(#goal{way = Way, stalls = Stalls}) -> Way =/= to andalso Stalls >= ?STALLS.

%% @doc The time that it has waited, in microseconds.
-spec waited(t()) -> non_neg_integer().
waited(#goal{waited = Waited}) -> Waited.

%% @doc It waits for that time.
-spec waited(Us :: pos_integer(), t()) -> t().
waited(Us, #goal{waited = Waited} = Goal) -> Goal#goal{waited = Waited + Us}.

%% @doc Is a robot that was seen here sure to stay on its line in a try in any direction? Its place was seen with an
%% error.
-spec keeps(starl_geometry:point() | unknown, module(), starl_chassis:profile(), t()) -> boolean().
keeps(_Place, _Chassis, _Profile, #goal{start = unknown}) ->
    true;
keeps(unknown, _Chassis, _Profile, _Goal) ->
    false;
keeps(Place, Chassis, #{position_error_mm := Error} = Profile, #goal{start = Start, point = Point}) ->
    Off = starl_geometry:point_segment(Place, {Start, Point}),
    Off + Error + Chassis:try_mm(Profile) =< Chassis:tracking_radius(Profile).
