%% @doc The stage of a run on this computer: its clock, its world and its transport, and what each robot
%% starts with there.
-module(starl_world_stage).

-export([open/3, robot/2, robot_on_node/3]).

-export_type([t/0]).

%% `transport': the line of each robot.
-type t() :: #{
    plan := starl_run_plan:t(),
    clock := starl_live_clock:t(),
    world := pid(),
    transport := fun((starl:robot_id()) -> starl_live_link:line()),
    options := #{dir := file:filename(), atom() => term()}
}.

%% @doc Starts the clock and the world of a run; the world is linked to the calling process. `Nodes': the
%% robots' nodes, if they have some.
-spec open(starl_run_plan:t(), {starl_world_transport:name(), Nodes}, Options) -> t() when
    Nodes :: #{starl:robot_id() => node()},
    Options :: #{dir := file:filename(), atom() => term()}.
open(#{robots := Poses, world := Sim} = Plan, {Name, Nodes}, Options) ->
    Speed = maps:get(speed, Options, 1),
    Clock = starl_live_clock:new(erlang:system_time(microsecond), Speed),
    Known = maps:with([rate_hz, whole_mm, arena, observe, facts], Options),
    {ok, World} = starl_world:start_link(Known#{plan => Plan, clock => Clock}),
    Radio = (maps:with([air], Options))#{sim => Sim, speed => Speed},
    Transport = starl_world_transport:new(Name, [Id || {Id, _} <- Poses], Radio),
    #{
        plan => Plan,
        clock => Clock,
        world => World,
        transport => fun(Id) -> starl_world_transport:line(Id, Nodes, Transport) end,
        options => Options
    }.

%% @doc What a robot starts with. It has never run: its store is commissioned. Where that fails, the
%% robot says so when it opens its store.
-spec robot(starl:robot_id(), t()) -> starl_live_robot:spec().
robot(Id, #{plan := Plan, clock := Clock, world := World, transport := Line, options := Options}) ->
    #{tree := Tree, world := #{profiles := Profiles, seed := Seed}} = Plan,
    #{dir := Dir} = Options,
    Own = filename:join(Dir, "robot-" ++ integer_to_list(Id)),
    _ = starl_live_store:commission(Own),
    #{
        robot => Id,
        tree => Tree,
        team_seed => Seed,
        profile => starl_chassis:of_robot(Id, Profiles),
        clock => Clock,
        dir => Own,
        transport => Line(Id),
        positioning => {starl_world_sight, (maps:with([placing], Plan))#{world => World}},
        chassis => starl_world_chassis:line(Id, World, Options),
        sink => World,
        packets => maps:get(packets, Options, false),
        snapshots_us => maps:get(snapshots_us, Options, none)
    }.

%% @doc What a robot on a node of its own starts with: its facts are recorded there, too. This process is
%% told about reloads.
-spec robot_on_node(starl:robot_id(), Reporter :: pid(), t()) -> starl_live_robot:spec().
robot_on_node(Id, Reporter, #{clock := Clock, options := Options} = Stage) ->
    Metrics = maps:get(metrics, Options, none),
    Own = #{reporter => Reporter, record => true, metrics => Metrics},
    maps:merge(robot(Id, Stage), maps:merge(Own, recorder(Clock, Options))).

recorder(Clock, #{recorder := {Module, Own}, facts := Facts}) ->
    #{recorder => {Module, Own#{facts => starl_live_clock:live_facts(Facts, Clock)}}};
recorder(_Clock, #{}) ->
    #{}.
