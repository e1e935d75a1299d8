%% @doc Makes the plan of a run from a checked scenario and an application's scene: the robots with
%% their machines, the world, the monitors. It is the same wherever the run takes place; a simulation adds
%% what only it needs (`starl_sim_plan').
-module(starl_run_plan).

-export([context/2, context/3, profiles/1, make/5, parts/1, facts/2]).

-export_type([t/0, histories/0, options/0, world/0]).

%% By the models of those blocks that the run has: histories are only kept, in the trace; or judged, too;
%% or nothing else is judged.
-type histories() :: {kept | judged | alone, [module()]}.

%% Options of a run: further monitors, which only look on; whether histories of the calls are kept, and judged; the
%% time by which everything with a bound may be late (in real time, where a computer has other work, too); modules that
%% were compiled in memory, to be loaded wherever robots run; whether the scenario is checked already. Each kind of run has
%% further ones.
-type options() :: #{
    checked => boolean(),
    watch => [{module(), map()}],
    histories => histories(),
    slack_us => non_neg_integer(),
    code => [starl_version:code()],
    atom() => term()
}.

%% The radio, the clocks, the chassis and the compiled faults, all in microseconds and millimetres.
-type world() :: #{
    team := starl_team:t(),
    seed := integer(),
    profiles := starl_chassis:profiles(),
    atom() => term()
}.

%% The parts of a run and its time limit; its new code, in the order of time.
-type t() :: #{
    robots := [{starl:robot_id(), starl:pose()}],
    tree := starl_robot_services:tree(),
    world := world(),
    reloads := [starl_run_reloads:t()],
    code := [starl_version:code()],
    limit_us := non_neg_integer(),
    monitors := [{module(), map()}],
    %% of a run in real time
    placing => starl_floor_placement:rule()
}.

-define(INTENSITY, 1000).
%% A robot expects a command to take as long as this at most, whatever the scenario.
-define(LATENCY_MS, 5).
%% The same in real time, where a busy computer holds a command up: far less than the time that a clock may
%% be set by during a lease (`jump_ms' of path planning, 2,000).
-define(BUSY_MS, 500).

%% @doc The context from which the application makes its scene.
-spec context(module(), starl_run_scenario:t()) -> starl_scene:context().
context(App, Scenario) -> context(App, none, Scenario).

%% @doc The same on the floor plan that the scenario names.
-spec context(module(), starl_floor:t() | none, starl_run_scenario:t()) -> starl_scene:context().
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
-spec profiles(starl_run_scenario:t()) -> starl_chassis:profiles().
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

%% @doc The plan for a checked scenario, all of whose faults have been drawn, with its new code.
-spec make(
    starl_run_scenario:t(),
    starl_scene:t(),
    starl_scene:context(),
    {[starl_run_reloads:t()], [starl_version:code()]},
    options()
) -> t().
make(Scenario, Scene, #{robots := Ids} = Context, {Reloads, Code}, Options) ->
    Profiles = heard(profiles(maps:get(profile, Scene, #{}), Scenario), Options),
    #{
        robots => [{Id, pose(Id, Scene, Context)} || Id <- Ids],
        tree => tree(Scene, Profiles, Context),
        world => world(Scenario, Profiles, Context),
        reloads => Reloads,
        code => Code,
        limit_us => starl_run_contracts:limit_us(Scenario),
        monitors =>
            starl_run_contracts:monitors(Scenario, Scene, Profiles, Context, Options) ++
            maps:get(watch, Options, [])
    }.

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

%% @doc The facts of a planned run, for its observer, as of a simulation: a clock makes those of a live run of
%% them (`starl_live_clock'). Monitors that only look on are not among them.
-spec facts({starl_run_scenario:t(), starl_scene:t(), Plan}, Watching :: [{module(), map()}]) ->
    starl_observer:facts()
when
    Plan :: #{robots := [term()], monitors := [term()], atom() => term()}.
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

world(#{seed := Seed} = Scenario, Profiles, #{robots := Ids}) ->
    #{delay := {MinMs, MaxMs}, faults := Faults} = Scenario,
    (latency(Scenario))#{
        seed => Seed,
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
        store => faults(store, Faults)
    }.

latency(#{command_latency := {_, Most}}) when Most == 0 -> #{};
latency(#{command_latency := {Least, Most}}) ->
    #{latency_us => {round(1000 * Least), round(1000 * Most)}}.

tree(Scene, Profiles, #{robots := Ids} = Context) ->
    Given = maps:with([app, blocks, sap_machine, motion_machine], Scene),
    starl_robot_services:tree(Given#{
        waypoints => waypoints(Scene),
        floor => maps:get(floor, Scene, maps:get(floor, Context)),
        solid => is_map_key(floor, Scene),
        grid => true,
        robots => Ids,
        profiles => Profiles,
        sap => maps:merge(maps:get(sap, Context), maps:get(sap, Scene, #{})),
        intensity => ?INTENSITY
    }).

%% Robots without a start pose stand in rows two metres apart.
pose(Id, Scene, #{world := {Width, _}}) ->
    maps:get(Id, maps:get(poses, Scene, #{}), starl_floor_placement:row(Id, Width)).

faults(Class, Faults) ->
    [starl_run_fault:compile(F) || F <- Faults, starl_run_fault:class(F) =:= Class].

range(#{range := none}) -> infinity;
range(#{range := Range}) -> float(Range).

clock(#{clock_offset := OffsetMs, clock_drift := Ppm}) ->
    {round(OffsetMs * 1000), round(Ppm * 1000)}.
