%% @doc Distributed path planning (DPP): the interface.
%%
%% The team shares a set of target edges, the lines of a picture. A robot asks the coordinator
%% for a path ({@link request_path/1}), drives it waypoint by waypoint and says what it has
%% passed ({@link passed/3}). Guarantee (the paper's Lemma 7): the tubes around all paths that
%% are held at one time are pairwise disjoint, so robots that keep within r(v) of their paths are
%% never nearer to each other than the safety distance.
%% ```
%%   {ok, Path} = starl_dpp:request_path(Robot),
%%   [begin
%%        starl:actuate(Robot, pen, Pen), ok = starl:go_to(Robot, Point),
%%        starl_dpp:passed(Robot, Path, N)
%%    end || {N, Point, Pen} <- starl_dpp:waypoints(Path)]
%% '''
-module(starl_dpp).

-export([blocks/1, join/2, coordinator/1, request_path/1, waypoints/1, passed/3]).

-export_type([config/0, path/0, request_id/0]).

%% What a team must agree on: see {@link starl_dpp_plan:config()}; without the robots. `speed'
%% in mm/s tells how long a robot may be on its way before it counts as silent.
-type config() :: #{
    segments := [starl_geometry:segment()],
    world := {number(), number()},
    tube_radius := float(),
    speed := float(),
    atom() => term()
}.

%% Ascending per robot, also over a crash.
-type request_id() :: {Incarnation :: pos_integer(), N :: non_neg_integer()}.

%% A path that the robot holds.
-opaque path() :: {request_id(), starl_dpp_plan:path()}.

%% @doc The machines that a robot needs for DPP.
-spec blocks(config()) -> [starl_robot_sup:machine()].
blocks(Config) ->
    Slack = maps:get(slack, Config, 0.0),
    [
        {dpp, starl_dpp_participant, #{slack => Slack}},
        {dpp_coordinator, starl_dpp_coordinator, Config}
    ].

%% @doc Names the coordinator, usually the elected leader.
-spec join(starl:robot(), Coordinator :: starl:robot_id()) -> ok | {error, restarted}.
join(Robot, Coordinator) ->
    case starl:call(Robot, dpp, {join, Coordinator}, infinity) of
        {ok, ok} -> ok;
        {error, restarted} -> {error, restarted}
    end.

%% @doc The coordinator that the robot knows.
-spec coordinator(starl:robot()) ->
    {ok, starl:robot_id()} | {error, no_coordinator | restarted}.
coordinator(Robot) ->
    case starl:call(Robot, dpp, coordinator, infinity) of
        {ok, none} -> {error, no_coordinator};
        {ok, Coordinator} -> {ok, Coordinator};
        {error, restarted} -> {error, restarted}
    end.

%% @doc Gives back the path that the robot holds, certifies that the robot stands still (it is
%% stopped if it does not), and waits for a new path. `complete': every target edge is painted.
%% `incomplete': what is left is closed by robots that no longer answer. `no_answer': the
%% coordinator has not been reached for long.
-spec request_path(starl:robot()) ->
    {ok, path()} | complete | incomplete | {error, restarted | no_coordinator | no_answer}.
request_path(Robot) ->
    case starl:call(Robot, dpp, request, infinity) of
        {ok, Answer} -> Answer;
        {error, restarted} -> {error, restarted}
    end.

%% @doc The path's waypoints in order, numbered from 1, each with the pen's state on the way to
%% it.
-spec waypoints(path()) -> [{pos_integer(), starl_geometry:point(), up | down}].
waypoints({_Id, Waypoints}) ->
    [
        {N, Point, pen(Pen)}
     || {N, {Point, Pen}} <- lists:zip(lists:seq(1, length(Waypoints)), Waypoints)
    ].

%% @doc Clear: the robot has reached waypoint N of the path and will not go back behind it.
-spec passed(starl:robot(), path(), N :: pos_integer()) -> ok.
passed(_Robot, {Id, Waypoints}, N) ->
    starl_app_proc:perform([{cast, dpp, {passed, Id, N, lists:nth(N, Waypoints)}}]).

pen(up) -> up;
pen({down, _Edge}) -> down.
