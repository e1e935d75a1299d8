%% @doc The interface of distributed path planning (DPP): robots paint a picture together and keep
%% their distance.
%%
%% The team shares a set of target edges, the lines of a picture. A robot asks the coordinator for a
%% path ({@link request_path/1}) and drives it line by line ({@link drive/3}). Guarantee (the
%% paper's Lemma 7): the tubes around all paths that are held at one time are pairwise disjoint. So
%% robots that keep within r(v) of their paths are never nearer to each other than the safety
%% distance.
%% ```
%%   {ok, Path} = starl_dpp:request_path(Robot),
%%   [begin
%%        ok = starl_dpp:face(Robot, Path, N), starl:actuate(Robot, pen, Pen),
%%        ok = starl_dpp:drive(Robot, Path, N)
%%    end || {N, _Line, Pen} <- starl_dpp:lines(Path)]
%% '''
-module(starl_dpp).
-behaviour(starl_block).

-export([
    options/0,
    check/1,
    machines/1,
    monitors/2,
    guarantees/0,
    propositions/0,
    contract/0,
    models/0
]).
-export([join/2, coordinator/1, request_path/1, request_path/2, wait_path/2]).
-export([lines/1, face/3, turn/4, drive/3]).
-export([model/1]).

-export_type([config/0, path/0, request_id/0, term_id/0, place/0]).

%% The block's options, on which a team must agree: {@link starl_dpp_settings:t()}, without the
%% robots, and {@link starl_dpp_lease:config()}.
-type config() :: #{
    segments := [starl_geometry:segment()],
    world := {number(), number()},
    tube_radius := float(),
    atom() => term()
}.

%% Ascending per robot, also over a crash. The series is the robot's incarnation, or higher if the
%% coordinator has heard of a higher number.
-type request_id() :: {Series :: pos_integer(), N :: non_neg_integer()}.

%% A term has at most one coordinator: the robot that claimed it, in that life of its coordinator
%% machine. So no term is ever claimed twice, even by a robot that has forgotten everything.
-type term_id() ::
    {N :: non_neg_integer(), starl:robot_id() | 0, Incarnation :: non_neg_integer()}.

%% The place of a robot: it stands, or has passed N waypoints of its path and still has the rest.
-type place() ::
    {standing, starl_geometry:point()}
    | {moving, N :: non_neg_integer(), From :: starl_geometry:point(), [starl_dpp_plan:waypoint()]}.

%% A path that the robot holds, and where it begins.
-opaque path() :: {request_id(), starl_geometry:point(), starl_dpp_plan:path()}.

-define(LEASE_US, 4000000).
%% The number of ticks in about a second.
-define(TICKS, 10000).
%% µs that a clock gains in a tick; the ratio of the slowest to the fastest is the default bound
%% on drift, 10000 ppm.
-define(SLOW, 99).
-define(FAST, 101).

%% @doc Sets the first coordinator, usually the elected leader. A robot that already knows a
%% coordinator keeps it. When a coordinator dies, its successor finds the robots by itself.
-spec join(starl:robot(), Coordinator :: starl:robot_id()) -> ok | {error, restarted}.
join(Robot, Coordinator) ->
    lists:member(Coordinator, starl:participants(Robot)) orelse
        starl_caller:mistake({?MODULE, join, 2}, 'Coordinator', Coordinator, "a robot of the team"),
    case starl:call(Robot, dpp, {join, Coordinator}, infinity) of
        {ok, ok} -> ok;
        {error, restarted} -> {error, restarted}
    end.

%% @doc Returns the coordinator that the robot knows.
-spec coordinator(starl:robot()) ->
    {ok, starl:robot_id()} | {error, no_coordinator | restarted}.
coordinator(Robot) ->
    case starl:call(Robot, dpp, coordinator, infinity) of
        {ok, none} -> {error, no_coordinator};
        {ok, Coordinator} -> {ok, Coordinator};
        {error, restarted} -> {error, restarted}
    end.

%% @doc Hands the robot's path back to the coordinator, and waits for a new path. It stops the robot
%% and certifies that the robot is at rest. `complete': every target edge is painted. `incomplete':
%% robots that no longer answer close the remaining edges. `no_answer': no coordinator has shown for
%% two minutes that it hears the robot.
-spec request_path(starl:robot()) ->
    {ok, path()} | complete | incomplete | {error, restarted | no_coordinator | no_answer}.
request_path(Robot) ->
    case starl:call(Robot, dpp, request, infinity) of
        {ok, Answer} -> Answer;
        {error, restarted} -> {error, restarted}
    end.

%% @doc Requests a path and waits for at most `Ms' milliseconds. After `timeout' the request still
%% waits for its answer: see {@link wait_path/2}.
-spec request_path(starl:robot(), Ms :: pos_integer()) ->
    {ok, path()}
    | complete
    | incomplete
    | {error, timeout | restarted | no_coordinator | no_answer}.
request_path(Robot, Ms) -> answered(starl:call(Robot, dpp, request, Ms)).

%% @doc Continues to wait for the answer to the last request, for at most `Ms' milliseconds. If
%% there is no such request, it requests a path.
-spec wait_path(starl:robot(), Ms :: pos_integer()) ->
    {ok, path()}
    | complete
    | incomplete
    | {error, timeout | restarted | no_coordinator | no_answer}.
wait_path(Robot, Ms) -> answered(starl:call(Robot, dpp, wait, Ms)).

answered({ok, Answer}) -> Answer;
answered({error, Why}) -> {error, Why}.

%% @doc The lines of the path in order, numbered from 1: each leads to a waypoint, with the pen in
%% this state.
-spec lines(path()) -> [{pos_integer(), starl_geometry:segment(), up | down}].
lines({_Id, From, Waypoints}) when is_list(Waypoints) ->
    Points = [Point || {Point, _} <- Waypoints],
    [
        {N, {A, B}, pen(Pen)}
     || {N, A, {B, Pen}} <- lists:zip3(
            lists:seq(1, length(Points)), [From | lists:droplast(Points)], Waypoints
        )
    ];
lines(Other) ->
    not_a_path({?MODULE, lines, 1}, Other).

%% @doc Turns the robot to face along line N of the path, and drives the last millimetres to the
%% line's beginning. The robot must already be near that point. `void' as for {@link drive/3}.
-spec face(starl:robot(), path(), N :: pos_integer()) -> ok | {error, void | restarted}.
face(Robot, Path, N) -> move(Robot, face, Path, N).

%% @doc Turns the robot to a heading (rad) at the beginning of line N of the path. The robot must
%% already be near that point. `void' as for {@link drive/3}. A chassis that drives in all
%% directions does not turn.
-spec turn(starl:robot(), path(), N :: pos_integer(), Heading :: float()) ->
    ok | {error, void | restarted}.
turn(Robot, Path, N, Heading) when is_float(Heading) -> move(Robot, {face, Heading}, Path, N).

%% @doc Drives straight along line N of the path to its end, and frees the space behind the robot.
%% `void': the robot's lease to drive has ended, or the robot was stopped; the application requests
%% a new path.
-spec drive(starl:robot(), path(), N :: pos_integer()) -> ok | {error, void | restarted}.
drive(Robot, Path, N) -> move(Robot, drive, Path, N).

move(Robot, What, {Id, _From, Waypoints}, N) when is_list(Waypoints) ->
    is_integer(N) andalso N >= 1 andalso N =< length(Waypoints) orelse
        starl_caller:mistake(function(What), 'N', N, "the number of a line of the path"),
    case starl:call(Robot, dpp, {What, Id, N}, infinity) of
        {ok, Answer} -> Answer;
        {error, restarted} -> {error, restarted}
    end;
move(_Robot, What, Other, _N) ->
    not_a_path(function(What), Other).

function({face, _Heading}) -> {?MODULE, turn, 4};
function(What) -> {?MODULE, What, 3}.

-spec not_a_path(mfa(), term()) -> no_return().
not_a_path(Function, Path) ->
    starl_caller:mistake(Function, 'Path', Path, "a path that request_path/1 gave").

pen(up) -> up;
pen({down, _Edge}) -> down.

%% -- the block ------------------------------------------------------------------------------

-spec options() -> [starl_options:option()].
options() -> starl_dpp_settings:options() ++ starl_dpp_lease:options().

-spec check(starl_block:options()) -> ok | {error, unicode:chardata()}.
check(Options) -> starl_dpp_lease:check(Options).

-spec machines(starl_block:options()) -> [starl_robot_sup:machine()].
machines(Options) ->
    [
        {dpp, starl_dpp_participant, maps:with([slack, lease_ms, drift_ppm, jump_ms], Options)},
        {dpp_coordinator, starl_dpp_coordinator, Options}
    ].

%% `r_s': the least distance of two robots that keep within the slack of their paths. `path_mm': a path goes on
%% while its lines are shorter than the horizon.
-spec monitors(starl_block:options(), starl_block:context()) -> [{module(), map()}].
monitors(#{tube_radius := Radius, slack := Slack} = Options, Context) ->
    #{robots := Robots, profiles := Profiles} = Context,
    #{lease_ms := Lease, jump_ms := Jump, drift_ppm := Ppm} = Options,
    #{horizon := Horizon, edge_length := Edge} = Options,
    [
        {starl_dpp_monitor, #{
            tube_radius => Radius,
            tracking_mm => tracking(Robots, Profiles),
            r_s => 2 * (Radius - Slack),
            path_mm => Horizon + Edge,
            robots => Robots,
            lease_us => 1000 * Lease,
            jump_us => 1000 * Jump,
            drift_ppm => Ppm
        }}
    ].

%% r(v) of each robot, where robots drive on different chassis.
tracking(_Robots, [_AllTheSame]) ->
    #{};
tracking(Robots, Profiles) ->
    maps:from_list([
        {Robot, starl_chassis:tracking_radius(starl_chassis:of_robot(Robot, Profiles))}
     || Robot <- Robots
    ]).

-spec guarantees() -> [starl_guarantee:t()].
guarantees() ->
    [
        {tubes, safety, "the tubes that robots hold are pairwise disjoint", [
            clock_rate, clock_jump
        ]},
        {distance, safety,
            "any two robots are at least r_s apart at *every* instant, checked in continuous time",
            [
                clock_rate, clock_jump, positions, {motion, line}, {motion, stops}
            ]},
        {path, safety,
            "a path's lines are no longer than the horizon and the line on which it ends", []},
        {leader, safety, "two coordinators never assign at one time", [clock_rate, clock_jump]},
        {assigned, progress, "a free line that can be reached safely is assigned", [
            {sap, delivered}, {motion, arrives}
        ]},
        {resolved, progress, "deadlocks are resolved", [{sap, delivered}, {motion, arrives}]},
        {replaced, progress, "when the coordinator's robot dies another takes over", [
            {sap, delivered}
        ]}
    ].

-spec propositions() -> [starl_guarantee:proposition()].
propositions() ->
    [
        {"Lemma 7", tubes, [tubes_overlap]},
        {"ComputePath(c)", path, [beyond_horizon]},
        {"Path planning, progress", assigned, [unanswered]}
    ].

-spec contract() -> string().
contract() -> "the tubes that robots hold are disjoint, and robots keep their distance".

-spec models() -> [starl_block:model_entry()].
models() ->
    Doc = "path planning: votes, leases and terms of coordinators, with drifting clocks",
    [{terms, Doc, fun model/1}].

%% -- the model --------------------------------------------------------------------------------

%% The model of path planning for the exhaustive checker: the votes, leases and terms of its
%% coordinators, which keep two of them from assigning at one time. A service that may act at any
%% moment stands for the planner (starl_dpp_model_service).
%%
%% The last robot is named as the first coordinator, and after a restart the first one: by its
%% place in the team and by its number a robot comes before another or after it, so no two are
%% alike. The lease is as short as the beats allow, so that its end is near.

%% @doc The model for a team.
-spec model(starl_block:team()) -> starl_block:model().
model(#{robots := Ids, terms := Terms}) ->
    Lease = #{lease_ms => ?LEASE_US div 1000, jump_ms => 0},
    #{
        blocks => [
            {dpp, starl_dpp_participant, Lease},
            {dpp_coordinator, starl_dpp_coordinator, Lease#{serve => starl_dpp_model_service}}
        ],
        stands => [motion, location],
        script => fun(_) -> [{start, dpp, {join, lists:last(Ids)}, {join, hd(Ids)}}] end,
        crash => [dpp, dpp_coordinator],
        monitor => {starl_dpp_model_monitor, #{tube_radius => 200.0, r_s => 330.0}},
        timed => [beat, recover, claim, missing, again, look, leave],
        steps => [serve],
        beyond => fun(Event) -> claims_more(Event, Terms) end,
        bounds => lists:concat(["up to term ", Terms]),
        rates => rates(length(Ids)),
        grain => 1,
        horizon_us => ?LEASE_US + 1,
        past_us => ?LEASE_US + 1,
        fixed => lists:seq(1, length(Ids))
    }.

%% The clock of the first coordinator is slow, so that its votes last longest, and those of the
%% robots that give them are fast; a tick is about a second.
rates(N) -> setelement(N, erlang:make_tuple(N, ?TICKS * ?FAST), ?TICKS * ?SLOW).

%% A robot that is alone claims in vain for ever.
claims_more({_, _, dpp_coordinator, {claims, {N, _, _}}}, Terms) -> N > Terms;
claims_more(_Event, _Terms) -> false.
