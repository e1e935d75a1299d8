%% @doc A simulated world in real time: the bodies of live robots, their positioning system, and the
%% judge of the run. Robots are on this Erlang node or on others; the world knows where they really
%% are, gathers what they trace, and runs the monitors meanwhile.
%% ```
%%   a robot's chassis -- drive, actuate, stop --> world -- driven, stalled, actuated --> chassis
%%   a robot's positioning -- look ------------->  world -- seen -----------------------> positioning
%%   a robot's link -- started, traced, ended -->  world: facts in the order of time --> monitors
%%   a robot's radio -- sent, came ------------->  world: packets and their fates --> observer
%%   hardware of a robot <-- touched ------------  world: it touches another robot, or a wall
%% '''
%% A robot whose process or node ends goes down: its chassis stops, and the monitors are told. This
%% module starts and asks the world; its process is {@link starl_world_server}.
-module(starl_world).

-export([
    plan/2,
    slack_us/0,
    observed/2,
    live/2,
    start_link/1,
    embody/2,
    inhabit/2,
    track/2,
    await/1,
    status/1,
    until/2,
    freeze/2,
    cable/3,
    freeze_too/2,
    senses/2,
    fill/2,
    cut/2,
    struck/3,
    clock/3,
    halt/2,
    halted/2,
    resumed/2,
    stop/1,
    finish/1
]).

-export_type([config/0, status/0, ending/0, cable/0]).

%% The cable between a robot's computer and its hardware: pulled at once, or before the hardware could
%% drive on without it; put back.
-type cable() :: pulled | pulled_in_time | back.

%% The world of a run: the plan of its simulation ({@link starl_sim_plan:t()}), its clock, and the
%% positioning system: its rate (`none': it shows a picture whenever it is asked) and whether it
%% rounds to whole millimetres; walls. An observer of the run comes with the facts that he is told
%% first.
-type config() :: #{
    plan := starl_sim_plan:t(),
    clock := starl_live_clock:t(),
    arena => starl_world_floor:arena(),
    rate_hz => number() | none,
    whole_mm => boolean(),
    observe => starl_observer:t(),
    facts => starl_observer:facts()
}.

-type ending() :: done | time | violation | stopped.

%% `leader': the robot that has said last that it leads, in a block with a leader (path planning).
-type status() :: #{
    now_us := integer(),
    leader := starl:robot_id() | none,
    running := non_neg_integer(),
    up := [starl:robot_id()],
    ending := ending() | none
}.

%% The real time by which every bound on a duration is longer.
-define(SLACK_US, 3000000).

%% @doc Plans the run of a scenario that passes `speed' times as fast as real time; `watch': further
%% monitors, which only look on. This computer has other work, too, so every bound on a duration is
%% longer by some real time.
-spec plan(#{app := module(), atom() => term()}, #{
    speed => number(), watch => [{module(), map()}], atom() => term()
}) ->
    {ok, starl_sim:planned()} | {error, starl_sim:reason()}.
plan(Given, Options) ->
    Slack = round(?SLACK_US * maps:get(speed, Options, 1)),
    Watch = maps:with([watch], Options),
    case starl_sim:plan(Given#{mode => process}, Watch#{slack_us => Slack}) of
        {ok, {_Scenario, #{floor := _}, _Plan}} ->
            {error, {scene, "in real time there are no floor plans yet: run it in virtual time"}};
        Planned ->
            Planned
    end.

%% @doc The time by which contracts allow everything with a bound to be late, in a run as fast as real time.
-spec slack_us() -> pos_integer().
slack_us() -> ?SLACK_US.

%% @doc The options of a run with what its observer and the recorders of its robots are told first.
-spec observed(starl_sim:planned(), Options) -> Options when Options :: map().
observed(Planned, Options) when is_map_key(observe, Options); is_map_key(recorder, Options) ->
    Options#{facts => starl_sim_plan:facts(Planned, maps:get(watch, Options, []))};
observed(_Planned, Options) ->
    Options.

%% @doc These facts in a run of this clock.
-spec live(starl_observer:facts(), starl_live_clock:t()) -> starl_observer:facts().
live(Facts, Clock) -> Facts#{kind := live, epoch_us => starl_live_clock:epoch_us(Clock)}.

%% @doc Starts the world of a run.
-spec start_link(config()) -> gen_server:start_ret().
start_link(#{facts := Facts, clock := Clock} = Config) ->
    starl_world_server:start_link(Config#{facts := live(Facts, Clock)});
start_link(Config) ->
    starl_world_server:start_link(Config).

%% @doc The calling process is the chassis of this robot from now on.
-spec embody(pid(), starl:robot_id()) -> ok | {error, unicode:chardata()}.
embody(World, Robot) -> gen_server:call(World, {embody, Robot}).

%% @doc The calling process is the hardware of this robot from now on: it drives the body, which goes
%% on when the robot's link ends. Asked `{starl_settle, World, N}' it tells all that it has done until
%% then, and afterwards `{starl_settled, Robot, N}' ({@link starl_world_looks}).
-spec inhabit(pid(), starl:robot_id()) -> ok | {error, unicode:chardata()}.
inhabit(World, Robot) -> gen_server:call(World, {inhabit, Robot}).

%% @doc The calling process is the chassis of this robot from now on, and tells where its body is, which the world
%% does not move: `{starl_body, Robot, self(), {told, AtUs, {moves, Piece}}}'. It is asked for that as
%% hardware is ({@link inhabit/2}). Gives the place of the body until then; if the process ends, the body
%% stands where it was last.
-spec track(pid(), starl:robot_id()) -> {ok, starl:pose()} | {error, unicode:chardata()}.
track(World, Robot) -> gen_server:call(World, {track, Robot}).

%% @doc Waits for the end of the run.
-spec await(pid()) -> ending().
await(World) -> gen_server:call(World, await, infinity).

%% @doc The present time and the robots at work.
-spec status(pid()) -> status().
status(World) -> gen_server:call(World, status).

%% @doc Waits until this time of the run.
-spec until(pid(), Us :: integer()) -> ok.
until(World, Us) -> gen_server:call(World, {until, Us}, infinity).

%% @doc From now on these robots, and no others, are shown what they were shown last, again and again.
-spec freeze(pid(), [starl:robot_id()]) -> ok.
freeze(World, Robots) -> gen_server:call(World, {freeze, Robots}).

%% @doc Pulls the cable of a robot's hardware, or puts it back.
-spec cable(pid(), starl:robot_id(), cable()) -> ok | {error, unicode:chardata()}.
cable(World, Robot, Cable) -> gen_server:call(World, {cable, Robot, Cable}).

%% @doc From now on this robot, too, is shown what it was shown last.
-spec freeze_too(pid(), starl:robot_id()) -> ok.
freeze_too(World, Robot) -> gen_server:call(World, {freeze_too, Robot}).

%% @doc From now on these senses of robots have these faults, and no others: the world only tells its
%% observer.
-spec senses(pid(), [{starl:robot_id(), starl_sense:kind() | all, starl_live_sense_fault:fault()}]) ->
    ok.
senses(World, Faults) -> gen_server:call(World, {senses, Faults}).

%% @doc From now on these links, and no others, are cut: the world only tells its observer.
-spec cut(pid(), [{starl:robot_id(), starl:robot_id()}]) -> ok.
cut(World, Links) -> gen_server:call(World, {cut, Links}).

%% @doc From now on the disks of these robots, and no others, are full: the world only tells its observer.
-spec fill(pid(), [starl:robot_id()]) -> ok.
fill(World, Robots) -> gen_server:call(World, {fill, Robots}).

%% @doc Something has been done to a robot by hand at once, a fault of this kind: the world only tells its
%% observer.
-spec struck(pid(), kill_robot | store_lost | store_set_back, starl:robot_id()) -> ok.
struck(World, Kind, Robot) -> gen_server:call(World, {struck, Kind, Robot}).

%% @doc The clock of a robot's node is ahead of this VM's, or behind: if by much, nothing is judged from now on.
-spec clock(pid(), starl:robot_id(), AheadUs :: integer()) -> ok.
clock(World, Robot, AheadUs) -> gen_server:call(World, {clock, Robot, AheadUs}, infinity).

%% @doc The node of a robot is about to be halted: nothing is judged from now on until it goes on.
-spec halt(pid(), starl:robot_id()) -> ok.
halt(World, Robot) -> gen_server:call(World, {halt, Robot}).

%% @doc The node of a robot stands still, since a moment.
-spec halted(pid(), starl:robot_id()) -> ok.
halted(World, Robot) -> gen_server:call(World, {halted, Robot}).

%% @doc The node of a robot goes on, or has ended: the monitors are told of the pause.
-spec resumed(pid(), starl:robot_id()) -> ok.
resumed(World, Robot) -> gen_server:call(World, {resumed, Robot}).

%% @doc Ends the run.
-spec stop(pid()) -> ok.
stop(World) -> gen_server:cast(World, stop).

%% @doc Closes the monitors and returns the outcome, as of a simulation.
-spec finish(pid()) -> starl_sim_outcome:t().
finish(World) -> gen_server:call(World, finish, infinity).
