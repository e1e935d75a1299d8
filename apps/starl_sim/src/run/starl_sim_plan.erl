%% @doc Makes the plan of a run from a checked scenario and an application's scene: the robots with
%% their machines, the world, the faults with their times, the monitors.
-module(starl_sim_plan).

-export([context/2, context/3, profiles/1, make/4, mode/2, parts/1, facts/2]).

-export_type([t/0, histories/0]).

%% By the models of those blocks that the run has: histories are only kept, in the trace; or judged, too;
%% or nothing else is judged.
-type histories() :: {kept | judged | alone, [module()]}.

%% The parts of a simulation and its time limit; its nodes, if any, and, once these are
%% open, its sites.
-type t() :: #{
    robots := [{starl:robot_id(), starl:pose()}],
    crew := starl_sim_shard:crew(),
    world := starl_sim_platform:world(),
    window_us := pos_integer(),
    patience_ms := pos_integer(),
    shards := pos_integer(),
    faults := [starl_sim_queue:event()],
    limit_us := starl_sim_queue:time(),
    monitors := [{module(), map()}],
    observe => starl_observer:t(),
    from => starl_sim_checkpoint:t(),
    nodes => starl_sim_nodes:options(),
    sites => [starl_sim_site:t(), ...]
}.

-define(ROBOTS_PER_SHARD, 16).
%% Teams above this size are simulated inline, unless the scenario says otherwise.
-define(MANY_ROBOTS, 300).
-define(INTENSITY, 1000).
-define(NODE_TIMEOUT_MS, 30000).
-define(PATIENCE_MS, 60000).
%% A robot expects a command to take as long as this at most, whatever the scenario.
-define(LATENCY_MS, 5).
%% The same in real time, where a busy computer holds a command up: far less than the time that a clock may
%% be set by during a lease (`jump_ms' of path planning, 2,000).
-define(BUSY_MS, 500).

%% @doc The context from which the application makes its scene.
-spec context(module(), starl_sim_scenario:t()) -> starl_scene:context().
context(App, Scenario) -> context(App, none, Scenario).

%% @doc The same on the floor plan that the scenario names.
-spec context(module(), starl_floor:t() | none, starl_sim_scenario:t()) -> starl_scene:context().
context(App, Floor, #{robots := N, world := World, seed := Seed} = Scenario) ->
    #{
        robots => lists:seq(1, N),
        world => World,
        floor => plan(Floor, World),
        seed => Seed,
        profiles => profiles(#{}, Scenario),
        sap => sap(Scenario),
        range => maps:get(range, Scenario, none),
        options => maps:with([Key || {Key, _, _, _} <- starl_app:options(App)], Scenario)
    }.

plan(none, World) -> starl_floor:empty(World);
plan(Floor, _World) -> Floor.

%% @doc The profiles of the robots of a checked scenario, in turn, unless its application has others.
-spec profiles(starl_sim_scenario:t()) -> starl_chassis:profiles().
profiles(Scenario) -> profiles(#{}, Scenario).

%% The application's scene may override these profiles.
profiles(Overrides, #{chassis := Choice} = Scenario) ->
    starl_chassis_choice:profiles(Choice, maps:merge(profile(Scenario), Overrides)).

profile(
    #{
        speed := Speed,
        acceleration := Acceleration,
        heading_error := H,
        distance_error := D,
        position_error := P,
        command_latency := {_, LatencyMs}
    } = Scenario
) ->
    (controller(Scenario))#{
        latency_ms => max(?LATENCY_MS, LatencyMs),
        speed => float(Speed),
        acceleration => float(Acceleration),
        near_speed => float(Speed),
        heading_error => float(H),
        distance_error => float(D),
        position_error_mm => float(P)
    }.

%% The usual one needs no entry.
controller(#{controller := Text}) ->
    case starl_controller:named(Text) of
        {ok, none} -> #{};
        {ok, Module} -> #{controller => Module}
    end;
controller(_Scenario) ->
    #{}.

%% The first retransmission waits a little longer than the longest way there and back.
sap(#{delay := {_, MaxMs}}) -> #{retransmit_ms => max(50, round(2.5 * MaxMs))}.

%% @doc The plan for a checked scenario, all of whose faults have been drawn.
-spec make(starl_sim_scenario:t(), starl_scene:t(), starl_scene:context(), starl_sim:options()) ->
    t().
make(Scenario, Scene, #{robots := Ids} = Context, Options) ->
    #{delay := {MinMs, _}, shards := Shards, faults := Faults} = Scenario,
    Reloads = maps:get(reloads, Options, []),
    Profiles = heard(profiles(maps:get(profile, Scene, #{}), Scenario), Options),
    Plan = #{
        robots => [{Id, pose(Id, Scene, Context)} || Id <- Ids],
        crew => crew(mode(Scenario, Options), Scene, Profiles, Context),
        world => starl_sim_branch:plant(
            maps:get(branch, Options, none),
            maps:merge(
                maps:merge(
                    maps:merge(world(Scenario, Profiles, Context, Options), walls(Faults, Scene)),
                    kept(starl_sim_contracts:models(Scene, Options))
                ),
                starl_sim_reloads:world(Reloads, parts(Scene))
            )
        ),
        window_us => round(MinMs * 1000),
        patience_ms => maps:get(patience_ms, Options, ?PATIENCE_MS),
        limit_us => starl_sim_contracts:limit_us(Scenario),
        shards => shards(Shards, length(Ids), Options),
        faults => strikes(Faults, Reloads),
        monitors =>
            starl_sim_contracts:monitors(Scenario, Scene, Profiles, Context, Options) ++
            maps:get(watch, Options, [])
    },
    Observed = maps:with([observe, from], Options),
    maps:merge(maps:merge(Plan, Observed), nodes(Scenario, Scene, Options)).

%% A run whose bounds have a slack passes in real time.
heard(Profiles, #{slack_us := Slack}) when Slack > 0 ->
    [
        Profile#{latency_ms => max(?BUSY_MS, maps:get(latency_ms, Profile, ?LATENCY_MS))}
     || Profile <- Profiles
    ];
heard(Profiles, #{}) ->
    Profiles.

%% @doc The modules of a robot's machines.
-spec parts(starl_scene:t()) -> #{starl_machine:name() => module()}.
parts(Scene) ->
    Sap = maps:get(sap_machine, Scene, starl_sap),
    Blocks = maps:from_list([{Name, M} || {Name, M, _} <- maps:get(blocks, Scene, [])]),
    Blocks#{
        app => element(2, maps:get(app, Scene)),
        sap => Sap,
        location => starl_location,
        motion => maps:get(motion_machine, Scene, starl_motion)
    }.

%% @doc The facts of a planned run, for its observer. Monitors that only look on are not among them.
-spec facts(starl_sim:planned(), Watching :: [{module(), map()}]) -> starl_observer:facts().
facts({#{app := App} = Scenario, Scene, #{robots := Robots, monitors := Monitors}}, Watching) ->
    (maps:with([floor], Scene))#{
        kind => simulation,
        app => App,
        scenario => maps:remove(app, Scenario),
        robots => Robots,
        monitors => Monitors -- Watching,
        machines => parts(Scene),
        waypoints => waypoints(Scene)
    }.

%% The places of the floor plan, and those of the application.
waypoints(#{floor := #{places := Places}} = Scene) ->
    maps:merge(Places, maps:get(waypoints, Scene, #{}));
waypoints(Scene) ->
    maps:get(waypoints, Scene, #{}).

%% On a floor plan bodies are solid, and there is something to sense.
walls(Faults, #{floor := Floor} = Scene) ->
    (starl_sim_floor:obstacles(Faults, Floor))#{
        walls => starl_walls:new(Floor), senses => starl_sim_senses:new(Scene)
    };
walls(_Faults, _Scene) ->
    #{}.

nodes(#{app := App}, #{app := Playing} = Scene, #{nodes := Nodes} = Options) ->
    Services = [
        maps:get(sap_machine, Scene, starl_sap), maps:get(motion_machine, Scene, starl_motion)
    ],
    Blocks = [Module || {_, Module, _} <- maps:get(blocks, Scene, [])],
    #{
        nodes => #{
            nodes => Nodes,
            timeout_ms => maps:get(node_timeout_ms, Options, ?NODE_TIMEOUT_MS),
            modules => lists:usort([App, element(2, Playing) | Services ++ Blocks]),
            code => maps:get(code, Options, [])
        }
    };
nodes(_Scenario, _Scene, _Options) ->
    #{}.

world(Scenario, Profiles, #{robots := Ids}, Options) ->
    #{delay := {MinMs, MaxMs}, faults := Faults} = Scenario,
    (maps:merge(maps:merge(latency(Scenario), told(Options)), seeds(Scenario, Options)))#{
        team => starl_team:new(Ids),
        loss => float(maps:get(loss, Scenario)),
        duplicate => float(maps:get(duplicate, Scenario)),
        delay_us => {round(MinMs * 1000), round(MaxMs * 1000)},
        range_mm => range(Scenario),
        wall_loss => float(maps:get(wall_loss, Scenario)),
        shadowing => float(maps:get(shadowing, Scenario)),
        clock => clock(Scenario),
        profiles => Profiles,
        network => faults(network, Faults),
        clocks => faults(clock, Faults),
        location => faults(location, Faults),
        sense => faults(sense, Faults),
        actuation => faults(actuation, Faults) ++ faults(serial, Faults),
        store => faults(store, Faults),
        packets =>
            maps:get(packets, Options, false) andalso maps:get(observe, Options, none) =/= none,
        record => maps:get(record, Options, #{})
    }.

%% What an observer is told beside the facts.
told(#{observe := Observer, snapshots_us := Us}) when Observer =/= none -> #{snapshots_us => Us};
told(#{}) -> #{}.

%% A run that goes on with other draws than it began with.
seeds(#{seed := Seed}, #{from := #{seed := Later}}) -> #{seed => Later, team_seed => Seed};
seeds(#{seed := Seed}, #{}) -> #{seed => Seed}.

latency(#{command_latency := {_, Most}}) when Most == 0 -> #{};
latency(#{command_latency := {Least, Most}}) ->
    #{latency_us => {round(1000 * Least), round(1000 * Most)}}.

crew(Mode, Scene, Profiles, #{robots := Ids} = Context) ->
    Given = maps:with([app, blocks, sap_machine, motion_machine], Scene),
    Tree = starl_robot_crew:tree(Given#{
        waypoints => waypoints(Scene),
        floor => maps:get(floor, Scene, maps:get(floor, Context)),
        solid => is_map_key(floor, Scene),
        grid => true,
        robots => Ids,
        profiles => Profiles,
        sap => maps:merge(maps:get(sap, Context), maps:get(sap, Scene, #{})),
        intensity => ?INTENSITY
    }),
    interpreted(Mode, Tree).

%% In inline mode, only a sequential application is a process.
interpreted(process, Tree) ->
    #{tree => Tree, inline => #{}};
interpreted(inline, Tree) ->
    {Left, Inline} = starl_robot_crew:inline(Tree),
    #{tree => Left, inline => Inline}.

%% @doc How the robots of a scenario are simulated. A caller that lets nobody look at their processes says
%% `auto => inline', which is cheaper.
-spec mode(starl_sim_scenario:t(), starl_sim:options()) -> process | inline.
mode(#{mode := auto, robots := N}, _Options) when N > ?MANY_ROBOTS -> inline;
mode(#{mode := auto}, Options) -> maps:get(auto, Options, process);
mode(#{mode := Mode}, _Options) -> Mode.

%% Robots without a start pose stand in rows two metres apart.
pose(Id, Scene, #{world := {Width, _}}) ->
    maps:get(Id, maps:get(poses, Scene, #{}), starl_floor_placement:row(Id, Width)).

kept([]) -> #{};
kept(Models) -> #{histories => lists:usort([Model:machine() || {Model, _} <- Models])}.

strikes(Faults, Reloads) ->
    Strikes =
        lists:append([starl_sim_fault:strikes(Fault) || Fault <- Faults]) ++
            starl_sim_reloads:strikes(Reloads),
    [
        {Robot, Time, 0, 0, N, Strike}
     || {N, {Robot, Time, Strike}} <- lists:zip(lists:seq(1, length(Strikes)), Strikes)
    ].

faults(Class, Faults) ->
    [starl_sim_fault:compile(F) || F <- Faults, starl_sim_fault:class(F) =:= Class].

%% A few robots are not worth a shard of their own, but every node has one.
shards(none, Robots, Options) ->
    %% two shards a core, so that a core has work while a shard waits for another
    Most = 2 * erlang:system_info(schedulers_online) * machines(Options),
    min(Robots, max(nodes_of(Options), min(Most, Robots div ?ROBOTS_PER_SHARD)));
shards(Shards, Robots, _Options) ->
    min(Shards, Robots).

%% Other machines are assumed to have as many cores as this one.
machines(#{nodes := [_ | _] = Nodes}) -> length(Nodes);
machines(#{}) -> 1.

nodes_of(#{nodes := N}) when is_integer(N) -> max(1, N);
nodes_of(Options) -> machines(Options).

range(#{range := none}) -> infinity;
range(#{range := Range}) -> float(Range).

clock(#{clock_offset := OffsetMs, clock_drift := Ppm}) ->
    {round(OffsetMs * 1000), round(Ppm * 1000)}.
