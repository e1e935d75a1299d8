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
    cable/3,
    until/2
]).
-export([kill/2]).

-export_type([t/0, options/0]).

-record(run, {
    world :: pid(),
    robots :: [{starl:robot_id(), Supervisor :: pid()}],
    specs :: #{starl:robot_id() => starl_live_robot:spec()},
    dir :: file:filename(),
    scenario :: starl_sim_scenario:t(),
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
    {ok, t()} | {error, starl_sim:reason()}.
start(Given, Options) ->
    case starl_world:plan(Given, Options) of
        {ok, Planned} -> {ok, started(Planned, starl_world:observed(Planned, Options))};
        {error, _} = Error -> Error
    end.

started({Scenario, Scene, Plan}, #{dir := Dir} = Options) ->
    Speed = maps:get(speed, Options, 1),
    Clock = starl_live_clock:new(erlang:system_time(microsecond), Speed),
    World0 = maps:with([rate_hz, whole_mm, arena, observe, facts], Options),
    {ok, World} = starl_world:start_link(World0#{plan => Plan, clock => Clock}),
    #{robots := Poses, world := Sim} = Plan,
    Ids = [Id || {Id, _} <- Poses],
    Transport = starl_world_transport:new(
        local, Ids, maps:merge(maps:with([air], Options), #{sim => Sim, speed => Speed})
    ),
    Specs = [{Id, spec(Id, World, Clock, Options, Plan, Transport)} || Id <- Ids],
    #run{
        world = World,
        robots = [{Id, robot(Spec)} || {Id, Spec} <- Specs],
        specs = maps:from_list(Specs),
        dir = Dir,
        scenario = Scenario,
        scene = Scene
    }.

spec(Id, World, Clock, Options, #{crew := #{tree := Tree}, world := Sim}, Transport) ->
    #{profiles := Profiles} = Sim,
    #{dir := Dir} = Options,
    #{
        robot => Id,
        tree => Tree,
        profile => starl_chassis:of_robot(Id, Profiles),
        clock => Clock,
        dir => filename:join(Dir, "robot-" ++ integer_to_list(Id)),
        transport => starl_world_transport:line(Id, #{}, Transport),
        positioning => {starl_world_sight, #{world => World}},
        chassis => starl_world_chassis:line(Id, World, Options),
        sink => World,
        packets => maps:get(packets, Options, false)
    }.

robot(Spec) ->
    {ok, Sup} = starl_live_robot:start_link(Spec),
    Sup.

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

%% @doc From now on this robot, too, gets no new positions.
-spec freeze_too(t(), starl:robot_id()) -> ok.
freeze_too(#run{world = World}, Robot) -> starl_world:freeze_too(World, Robot).

%% @doc The link of a robot; `none' while it starts anew.
-spec link(t(), starl:robot_id()) -> pid() | none.
link(#run{robots = Robots}, Id) ->
    {Id, Sup} = lists:keyfind(Id, 1, Robots),
    starl_live_robot:link(Sup).

%% @doc Kills all processes of a robot at once, as the death of its node does, and starts it anew.
-spec kill(t(), starl:robot_id()) -> t().
kill(#run{robots = Robots, specs = Specs} = Run, Id) ->
    #{Id := Spec} = Specs,
    {Id, Sup} = lists:keyfind(Id, 1, Robots),
    true = unlink(Sup),
    Ends = [erlang:monitor(process, P) || P <- [Sup, starl_live_robot:link(Sup)], is_pid(P)],
    true = exit(Sup, kill),
    lists:foreach(fun await_end/1, Ends),
    Run#run{robots = lists:keystore(Id, 1, Robots, {Id, robot(Spec)})}.

await_end(Monitor) ->
    receive
        {'DOWN', Monitor, process, _, _} -> ok
    end.

%% @doc Ends the robots and the world; returns the outcome and the application's report.
-spec finish(t()) -> {starl_sim_outcome:t(), starl_scene:report()}.
finish(#run{world = World, robots = Robots, scenario = #{app := App}, scene = Scene}) ->
    Outcome = starl_world:finish(World),
    lists:foreach(fun({_, Sup}) -> close(Sup) end, Robots),
    close(World),
    {Outcome, starl_scene:report(App, Scene, Outcome)}.

%% A robot that could not start any more has ended already.
close(Pid) ->
    true = unlink(Pid),
    Ref = erlang:monitor(process, Pid),
    exit(Pid, shutdown),
    await_end(Ref).
