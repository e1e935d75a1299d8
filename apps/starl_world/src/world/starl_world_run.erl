%% @doc Runs the robots of a scenario in one VM, in real time and in a simulated world.
-module(starl_world_run).
-behaviour(starl_run).

-export([
    world/0,
    start/2,
    format_error/1,
    await/1,
    stop/1,
    status/1,
    finish/1,
    scenario/1,
    link/2,
    act/2,
    heal/2,
    until/2
]).

-export_type([t/0, options/0]).

-record(run, {
    world :: pid(),
    robots :: pid(),
    scenario :: starl_run_scenario:t(),
    scene :: starl_scene:t()
}).

%% A live run, linked to the process that started it.
-opaque t() :: #run{}.

%% `speed': 2.0 is twice as fast as real time; `air': other air than
%% that of the scenario's radio; `watch': further monitors, which only look on. `dir': where the robots' stores are;
%% `chassis': what the robots have in place of a chassis of the world; `packets': whether the observer
%% is told of all packets.
-type options() :: #{
    speed => number(),
    air => starl_live_air:settings(),
    watch => [{module(), map()}],
    observe => starl_observer:t(),
    packets => boolean(),
    dir := file:filename(),
    rate_hz => number() | none,
    chassis => starl_world_chassis:lines(),
    whole_mm => boolean(),
    arena => starl_world_floor:arena()
}.

%% @doc Starts the robots of a scenario.
-spec start(#{app := module(), atom() => term()}, options()) ->
    {ok, t()} | {error, starl_run:reason()}.
start(Given, Options) ->
    case starl_world:plan(Given, Options#{world => one_vm}) of
        {ok, Planned, Schedule} ->
            {ok, started(Planned, Schedule, starl_world:observed(Planned, Options))};
        {error, _} = Error ->
            Error
    end.

started({Scenario, Scene, #{robots := Poses} = Plan}, Schedule, Options) ->
    #{world := World, clock := Clock} =
        Stage = starl_world_stage:open(Plan, {local, #{}}, Options),
    Specs = [{Id, starl_world_stage:robot(Id, Stage)} || {Id, _} <- Poses],
    {ok, Robots} = starl_world_robots:start_link(maps:from_list(Specs), #{
        world => World,
        clock => Clock,
        speed => maps:get(speed, Options, 1),
        schedule => Schedule
    }),
    #run{
        world = World,
        robots = Robots,
        scenario = Scenario#{faults := Schedule},
        scene = Scene
    }.

%% @doc All robots are in this VM.
-spec world() -> one_vm.
world() -> one_vm.

%% @doc One line on why a run could not be started.
-spec format_error(starl_run:reason()) -> unicode:chardata().
format_error(Reason) -> starl_run:format_error(Reason).

%% @doc Waits for the end of the run.
-spec await(t()) -> starl_world:ending().
await(#run{world = World}) -> starl_world:await(World).

%% @doc Ends the run.
-spec stop(t()) -> ok.
stop(#run{world = World}) -> starl_world:stop(World).

%% @doc The present time and the robots at work.
-spec status(t()) -> starl_world:status().
status(#run{world = World}) -> starl_world:status(World).

%% @doc The checked scenario, with all defaults.
-spec scenario(t()) -> starl_run_scenario:t().
scenario(#run{scenario = Scenario}) -> Scenario.

%% @doc Waits until this time of the run.
-spec until(t(), Us :: integer()) -> ok.
until(#run{world = World}, Us) -> starl_world:until(World, Us).

%% @doc The link of a robot; `none' while it restarts.
-spec link(t(), starl:robot_id()) -> pid() | none.
link(#run{robots = Robots}, Id) -> starl_world_robots:link(Robots, Id).

%% @doc Applies manual faults now.
-spec act(t(), [starl_run_hand:t()]) -> ok | {error, unicode:chardata()}.
act(#run{robots = Robots}, Hands) -> starl_world_robots:act(Robots, Hands).

%% @doc Ends these faults.
-spec heal(t(), starl_run_hand:heal()) -> ok.
heal(#run{robots = Robots}, What) -> starl_world_robots:heal(Robots, What).

%% @doc Ends the robots and the world; returns the outcome and the application's report.
-spec finish(t()) -> {starl_run:outcome(), starl_scene:report()}.
finish(#run{world = World, robots = Robots, scenario = #{app := App}, scene = Scene}) ->
    Outcome = starl_world:finish(World),
    ok = starl_world_robots:stop(Robots),
    true = unlink(World),
    ok = starl_sim_stop:shutdown(World, infinity),
    {Outcome, starl_scene:report(App, Scene, Outcome)}.
