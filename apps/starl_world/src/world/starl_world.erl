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
%% A robot whose process or node ends goes down: its chassis stops, and the monitors are notified.
%% This module starts and asks the world; its process is {@link starl_world_server}.
-module(starl_world).

-export([
    plan/2,
    slack_us/0,
    observed/2,
    start_link/1,
    embody/2,
    inhabit/2,
    track/2,
    await/1,
    status/1,
    until/2,
    fault/2,
    dead/2,
    clock/3,
    halt/3,
    halted/2,
    resumed/2,
    stop/1,
    finish/1
]).

-export_type([config/0, status/0, ending/0]).

%% The world of a run: the plan of its simulation ({@link starl_run_plan:t()}), its clock, and the
%% positioning system: its rate (`none': it shows a picture whenever it is asked) and whether it
%% rounds to whole millimetres; walls. An observer of the run comes with the facts that he is told
%% first.
-type config() :: #{
    plan := starl_run_plan:t(),
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

%% @doc Plans the run of a scenario that passes `speed' times as fast as real time. `watch': further
%% monitors, which judge nothing. This computer has other work, too, so every bound on a duration is
%% extended by some real time. The schedule of faults is returned beside the plan: monitors are
%% notified of each fault when it begins and when it has ended, as of manual faults.
-spec plan(#{app := module(), atom() => term()}, #{
    world := one_vm | nodes, speed => number(), watch => [{module(), map()}], atom() => term()
}) ->
    {ok, starl_run:planned(), [starl_run_fault:t()]} | {error, starl_run:reason()}.
plan(Given, #{world := Where} = Options) ->
    Slack = round(?SLACK_US * maps:get(speed, Options, 1)),
    Own = (maps:with([watch], Options))#{slack_us => Slack},
    case starl_run:plan(Given#{mode => process}, Own) of
        {ok, {_Scenario, #{floor := _}, _Plan}} ->
            {error, {scene, "in real time there are no floor plans yet: run it in virtual time"}};
        {ok, {#{faults := []}, _Scene, _Plan} = Planned} ->
            {ok, placed(Planned), []};
        {ok, {#{faults := Faults} = Scenario, _Scene, _Plan}} ->
            scheduled(starl_run_hand:refused(Where, Faults), Scenario, Own);
        {error, _} = Error ->
            Error
    end.

%% Live robots look whether they stand well.
placed({Scenario, Scene, Plan} = Planned) ->
    {Scenario, Scene, Plan#{placing => starl_run_floor:placing(Planned)}}.

%% The settle time after the last fault is the same in real time.
scheduled([], #{faults := Faults, heal := Heal} = Scenario, Own) ->
    Healed = max(Heal, starl_run_fault:healed_us(Faults) / 1.0e6),
    {ok, Planned} = starl_run:plan(Scenario#{faults := [], heal := Healed}, Own),
    {ok, placed(Planned), Faults};
scheduled(Refused, _Scenario, _Own) ->
    {error, {scene, lists:join("; ", Refused)}}.

%% @doc The time by which contracts extend every bound, in a run as fast as real time.
-spec slack_us() -> pos_integer().
slack_us() -> ?SLACK_US.

%% @doc Adds to the options of a run the first reports for its observer and for the recorders of its
%% robots.
-spec observed(starl_run:planned(), Options) -> Options when Options :: map().
observed(Planned, Options) when is_map_key(observe, Options); is_map_key(recorder, Options) ->
    Options#{facts => starl_run_plan:facts(Planned, maps:get(watch, Options, []))};
observed(_Planned, Options) ->
    Options.

%% @doc Starts the world of a run.
-spec start_link(config()) -> gen_server:start_ret().
start_link(#{facts := Facts, clock := Clock} = Config) ->
    starl_world_server:start_link(Config#{facts := starl_live_clock:live_facts(Facts, Clock)});
start_link(Config) ->
    starl_world_server:start_link(Config).

%% @doc Makes the calling process the chassis of this robot.
-spec embody(pid(), starl:robot_id()) -> ok | {error, unicode:chardata()}.
embody(World, Robot) -> gen_server:call(World, {embody, Robot}).

%% @doc Makes the calling process the hardware of this robot: it drives the body, which goes on when
%% the robot's link ends. On the message `{starl_settle, World, N}' it reports all that it has done
%% until then, and afterwards sends `{starl_settled, Robot, N}' ({@link starl_world_positioning}).
-spec inhabit(pid(), starl:robot_id()) -> ok | {error, unicode:chardata()}.
inhabit(World, Robot) -> gen_server:call(World, {inhabit, Robot}).

%% @doc Makes the calling process the chassis of this robot, which reports where its body is. The
%% world does not move this body. The report is `{starl_body, Robot, self(), {told, AtUs, {moves,
%% Piece}}}'. The world asks for it as it asks hardware ({@link inhabit/2}). Returns the place of
%% the body until then. If the process ends, the body stands where it was last.
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

%% @doc Begins or ends a fault: the world applies its part of it, on positions and cables, and
%% notifies its observer and its judge. A cable fault of a robot without hardware is an error.
-spec fault(pid(), starl_world_faults:told()) -> ok | {error, unicode:chardata()}.
fault(World, Told) -> gen_server:call(World, {fault, Told}).

%% @doc Declares a robot dead for good.
-spec dead(pid(), starl:robot_id()) -> ok.
dead(World, Robot) ->
    World ! {starl_ended, Robot, self(), given_up},
    ok.

%% @doc Reports by how much the clock of a robot's node is ahead of this VM's clock, or behind. If
%% the difference is large, nothing is judged from now on.
-spec clock(pid(), starl:robot_id(), AheadUs :: integer()) -> ok.
clock(World, Robot, AheadUs) -> gen_server:call(World, {clock, Robot, AheadUs}, infinity).

%% @doc Announces that the node of a robot is about to be halted: nothing is judged from now on
%% until it goes on. The fault, a pause, is reported under this name.
-spec halt(pid(), starl:robot_id(), Fault :: atom()) -> ok.
halt(World, Robot, Fault) -> gen_server:call(World, {halt, Robot, Fault}).

%% @doc Reports that the node of a robot has stopped a moment ago.
-spec halted(pid(), starl:robot_id()) -> ok.
halted(World, Robot) -> gen_server:call(World, {halted, Robot}).

%% @doc Reports that the node of a robot goes on, or has ended: the monitors are notified of the
%% pause.
-spec resumed(pid(), starl:robot_id()) -> ok.
resumed(World, Robot) -> gen_server:call(World, {resumed, Robot}).

%% @doc Ends the run.
-spec stop(pid()) -> ok.
stop(World) -> gen_server:cast(World, stop).

%% @doc Closes the monitors and returns the outcome, as of a simulation.
-spec finish(pid()) -> starl_run:outcome().
finish(World) -> gen_server:call(World, finish, infinity).
