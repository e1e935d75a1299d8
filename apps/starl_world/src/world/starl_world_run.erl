%% @doc A live run in one VM: the robots of a scenario in real time, in a simulated world.
-module(starl_world_run).

-export([
    start/2,
    await/1,
    stop/1,
    status/1,
    finish/1,
    scenario/1,
    link/2,
    freeze/2,
    freeze_too/2,
    sense/4,
    kill/2,
    cut/3,
    heal/1,
    cable/3,
    until/2
]).

-export_type([t/0, options/0]).

-record(run, {
    world :: pid(),
    robots :: pid(),
    ids :: [starl:robot_id()],
    scenario :: starl_sim_scenario:t(),
    scene :: starl_scene:t()
}).

-type answer() :: ok | {error, unicode:chardata()}.

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
    snapshots_us => pos_integer(),
    dir := file:filename(),
    rate_hz => number() | none,
    chassis => starl_world_chassis:lines(),
    whole_mm => boolean(),
    arena => starl_world_floor:arena()
}.

%% @doc Starts the robots of a scenario.
-spec start(#{app := module(), atom() => term()}, options()) ->
    {ok, t()} | {error, starl_sim:reason()}.
start(Given, Options) ->
    case starl_world:plan(Given, Options) of
        {ok, Planned} -> {ok, started(Planned, starl_world:observed(Planned, Options))};
        {error, _} = Error -> Error
    end.

started({Scenario, Scene, #{robots := Poses} = Plan}, Options) ->
    #{world := World} = Stage = starl_world_stage:open(Plan, {local, #{}}, Options),
    Ids = [Id || {Id, _} <- Poses],
    Specs = [{Id, starl_world_stage:robot(Id, Stage)} || Id <- Ids],
    {ok, Robots} = starl_world_robots:start_link(World, maps:from_list(Specs)),
    #run{
        world = World,
        robots = Robots,
        ids = Ids,
        scenario = Scenario,
        scene = Scene
    }.

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
-spec scenario(t()) -> starl_sim_scenario:t().
scenario(#run{scenario = Scenario}) -> Scenario.

%% @doc Waits until this time of the run.
-spec until(t(), Us :: integer()) -> ok.
until(#run{world = World}, Us) -> starl_world:until(World, Us).

%% @doc From now on these robots, and no others, get no new positions.
-spec freeze(t(), [starl:robot_id()]) -> ok.
freeze(#run{world = World}, Robots) -> starl_world:freeze(World, Robots).

%% @doc Pulls the cable of a robot's hardware, or puts it back.
-spec cable(t(), starl:robot_id(), starl_world:cable()) -> ok | {error, unicode:chardata()}.
cable(#run{world = World}, Robot, Cable) -> starl_world:cable(World, Robot, Cable).

%% @doc The link of a robot; `none' while it starts anew.
-spec link(t(), starl:robot_id()) -> pid() | none.
link(#run{robots = Robots}, Id) -> starl_world_robots:link(Robots, Id).

%% @doc From now on this robot, too, gets no new positions.
-spec freeze_too(t(), starl:robot_id()) -> answer().
freeze_too(Run, Id) ->
    known([Id], Run, fun(Robots) -> starl_world_robots:freeze(Robots, Id) end).

%% @doc A sense of this robot, or all of them, has a fault from now on; `well': no more.
-spec sense(
    t(), starl:robot_id(), starl_sense:kind() | all, starl_live_sense_fault:fault() | well
) -> answer().
sense(Run, Id, Sense, Fault) ->
    known([Id], Run, fun(Robots) -> starl_world_robots:sense(Robots, Id, Sense, Fault) end).

%% @doc Kills all processes of a robot at once, as the death of its node does, and starts it anew.
-spec kill(t(), starl:robot_id()) -> answer().
kill(Run, Id) ->
    known([Id], Run, fun(Robots) -> starl_world_robots:kill(Robots, Id) end).

%% @doc These two robots do not hear each other any more.
-spec cut(t(), starl:robot_id(), starl:robot_id()) -> answer().
cut(Run, A, B) ->
    known([A, B], Run, fun(Robots) -> starl_world_robots:cut(Robots, A, B) end).

%% @doc All links, positions and senses are as they were.
-spec heal(t()) -> ok.
heal(#run{robots = Robots}) -> starl_world_robots:heal(Robots).

known(Named, #run{robots = Robots, ids = Ids}, Do) ->
    case Named -- Ids of
        [] -> Do(Robots);
        [Robot | _] -> {error, io_lib:format("there is no robot ~b", [Robot])}
    end.

%% @doc Ends the robots and the world; returns the outcome and the application's report.
-spec finish(t()) -> {starl_sim_outcome:t(), starl_scene:report()}.
finish(#run{world = World, robots = Robots, scenario = #{app := App}, scene = Scene}) ->
    Outcome = starl_world:finish(World),
    ok = starl_world_robots:stop(Robots),
    true = unlink(World),
    ok = starl_sim_stop:shutdown(World, infinity),
    {Outcome, starl_scene:report(App, Scene, Outcome)}.
