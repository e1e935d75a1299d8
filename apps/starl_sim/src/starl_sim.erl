%% @doc The simulator's interface: start a simulation, run it on in virtual time, look inside,
%% and tell what came of it.
%% ```
%%   {ok, Sim} = starl_sim:start(#{app => starl_painting, robots => 4}).
%%   starl_sim:run(Sim, 10.0).          % to virtual second 10
%%   starl_sim:step(Sim, 0.5).          % half a second on
%%   starl_sim:inspect(Sim, 2).         % every machine of robot 2
%%   starl_sim:run(Sim).                % to the end
%%   {Outcome, Report} = starl_sim:finish(Sim).
%% '''
%% Over several Erlang nodes it comes to the same digest:
%% ```
%%   {ok, Sim} = starl_sim:start(#{app => starl_painting, robots => 100}, #{nodes => 2}).
%% '''
-module(starl_sim).

-export([start/1, start/2, run/1, run/2, step/2, stop/1, status/1, inspect/2, finish/1, close/1]).
-export([scenario/1, robot_pids/2, format_error/1]).

-export_type([sim/0, options/0, reason/0]).

-define(ROBOTS_PER_SHARD, 16).
%% Larger teams are simulated inline, where the scenario does not say.
-define(MANY_ROBOTS, 300).
-define(INTENSITY, 1000).
-define(NODE_TIMEOUT_MS, 30000).

-record(sim, {
    sup :: pid(),
    run :: pid(),
    scenario :: starl_sim_scenario:t(),
    scene :: starl_app:scene()
}).

%% A running simulation, linked to the process that started it.
-opaque sim() :: #sim{}.

%% What does not belong to the scenario and changes nothing in the run: over which nodes it goes,
%% so many peers on this machine or those that run already with the same code
%% ({@link starl_sim_nodes}); how long, in wall time, a node may keep the others waiting; and
%% modules that were compiled in memory and are to be loaded there.
-type options() :: #{
    nodes => starl_sim_nodes:nodes(),
    node_timeout_ms => pos_integer(),
    code => [{module(), file:filename(), Beam :: binary()}]
}.

-type reason() ::
    {scenario, starl_sim_scenario:reason()}
    | {scene, unicode:chardata()}
    | {no_such_app, module()}
    | {fault_target, atom(), starl:robot_id()}
    | {fault_machine, atom(), starl_machine:name(), Known :: [starl_machine:name()]}
    | {nodes, starl_sim_nodes:reason()}.

%% @doc Starts the simulation of a scenario. The key `app' is the application's module.
-spec start(#{app := module(), atom() => term()}) -> {ok, sim()} | {error, reason()}.
start(Given) -> start(Given, #{}).

%% @doc The same with options of the run.
-spec start(#{app := module(), atom() => term()}, options()) -> {ok, sim()} | {error, reason()}.
start(#{app := App} = Given, Options) ->
    case code:ensure_loaded(App) of
        {module, App} ->
            case starl_sim_scenario:check(Given, starl_app:options(App)) of
                {ok, Scenario} -> prepare(App, Scenario, Options);
                {error, Reason} -> {error, {scenario, Reason}}
            end;
        {error, _} ->
            {error, {no_such_app, App}}
    end.

%% @doc Runs to the end: all applications done, the scenario's time up, a contract violated.
-spec run(sim()) -> starl_sim_run:status().
run(#sim{run = Run, scenario = #{time := Seconds}}) -> starl_sim_run:run(Run, micros(Seconds)).

%% @doc Runs to a virtual time in seconds, or an earlier end.
-spec run(sim(), Seconds :: number()) -> starl_sim_run:status().
run(#sim{run = Run}, Seconds) -> starl_sim_run:run(Run, micros(Seconds)).

%% @doc Runs so many virtual seconds on.
-spec step(sim(), Seconds :: number()) -> starl_sim_run:status().
step(#sim{run = Run}, Seconds) ->
    #{now_us := Now} = starl_sim_run:status(Run),
    starl_sim_run:run(Run, Now + micros(Seconds)).

%% @doc Ends a run after the present window; may be called from any process.
-spec stop(sim()) -> ok.
stop(#sim{run = Run}) -> starl_sim_run:stop(Run).

%% @doc The virtual time, and how many applications still run.
-spec status(sim()) -> starl_sim_run:status().
status(#sim{run = Run}) -> starl_sim_run:status(Run).

%% @doc The machines of a robot, each with its state and data; while the run rests.
-spec inspect(sim(), starl:robot_id()) ->
    #{starl_machine:name() => term()} | unknown | {error, running}.
inspect(#sim{run = Run}, Robot) -> starl_sim_run:inspect(Run, Robot).

%% @doc The checked scenario, with all defaults.
-spec scenario(sim()) -> starl_sim_scenario:t().
scenario(#sim{scenario = Scenario}) -> Scenario.

%% @doc The supervisors of the robots, for a look at their trees with OTP's own tools.
-spec robot_pids(sim(), all) -> [pid()].
robot_pids(#sim{sup = Sup}, all) ->
    Pools = [Robots || #{robots_sup := Robots} <- starl_sim_sup:sites(Sup)],
    [Pid || Robots <- Pools, {_, Pid, _, _} <- supervisor:which_children(Robots)].

%% @doc Ends the simulation and tells what came of it.
-spec finish(sim()) -> {starl_sim_run:outcome(), starl_app:report()}.
finish(#sim{run = Run, scenario = #{app := App}, scene = Scene} = Sim) ->
    Outcome = starl_sim_run:finish(Run),
    close(Sim),
    {Outcome, starl_app:report(App, Scene, Outcome)}.

%% @doc Ends the simulation.
-spec close(sim()) -> ok.
close(#sim{sup = Sup}) ->
    true = unlink(Sup),
    Ref = erlang:monitor(process, Sup),
    exit(Sup, shutdown),
    receive
        {'DOWN', Ref, process, Sup, _} -> ok
    end.

%% @doc One line that says why a simulation could not be started.
-spec format_error(reason()) -> unicode:chardata().
format_error({scenario, Reason}) -> starl_sim_scenario:format_error(Reason);
format_error({scene, Why}) -> Why;
format_error({no_such_app, App}) -> io_lib:format("there is no application ~ts", [App]);
format_error({nodes, Reason}) -> starl_sim_nodes:format_error(Reason);
format_error({fault_target, Id, Robot}) ->
    io_lib:format("fault ~ts: there is no robot ~b", [Id, Robot]);
format_error({fault_machine, Id, Name, Known}) ->
    Names = lists:join(", ", [atom_to_list(N) || N <- Known]),
    io_lib:format("fault ~ts: a robot has no machine ~ts; it has ~ts", [Id, Name, Names]).

%% -- internals ------------------------------------------------------------------------------

prepare(App, Scenario, Options) ->
    #{robots := N, faults := Faults} = Scenario,
    Targets = [{element(1, Fault), R} || Fault <- Faults, R <- starl_sim_fault:targets(Fault)],
    case [{Id, R} || {Id, R} <- Targets, R > N] of
        [{Id, Robot} | _] -> {error, {fault_target, Id, Robot}};
        [] -> set_scene(App, Scenario, Options)
    end.

set_scene(App, Scenario, Options) ->
    Context = context(App, Scenario),
    case starl_app:scene(App, Context) of
        {ok, Scene} -> check_faults(Scenario, Scene, Context, Options);
        {error, Why} -> {error, {scene, Why}}
    end.

check_faults(#{faults := Faults} = Scenario, Scene, Context, Options) ->
    Known = [sap, location, motion, app | [N || {N, _, _} <- maps:get(blocks, Scene, [])]],
    case [{Id, N} || {Id, _, _, kill_machine, {_, N}, _} <- Faults, not lists:member(N, Known)] of
        [] -> launch(with_random_faults(Known, Scenario), Scene, Context, Options);
        [{Id, Name} | _] -> {error, {fault_machine, Id, Name, Known}}
    end.

%% What was drawn stands in the scenario from now on as if it had been given.
with_random_faults(_Known, #{random_faults := []} = Scenario) ->
    Scenario;
with_random_faults(Known, #{faults := Given, random_faults := What, heal := Heal} = Scenario) ->
    Drawn = starl_sim_fault_draw:draw(#{
        seed => maps:get(seed, Scenario),
        robots => maps:get(robots, Scenario),
        machines => Known,
        until_ms => max(1, round(1000 * Heal)),
        kinds => What
    }),
    Scenario#{faults := Given ++ Drawn, random_faults := []}.

context(App, #{robots := N, world := World, seed := Seed} = Scenario) ->
    #{
        robots => lists:seq(1, N),
        world => World,
        seed => Seed,
        profile => starl_motion:profile(profile(Scenario)),
        sap => sap(Scenario),
        options => maps:with([Key || {Key, _, _, _} <- starl_app:options(App)], Scenario)
    }.

profile(#{speed := Speed, heading_error := H, distance_error := D, position_error := P}) ->
    #{
        speed => float(Speed),
        near_speed => float(Speed),
        heading_error => float(H),
        distance_error => float(D),
        position_error_mm => float(P)
    }.

%% The first retransmission waits for a little more than the longest way there and back.
sap(#{delay := {_, MaxMs}}) -> #{retransmit_ms => max(50, round(2.5 * MaxMs))}.

launch(Scenario, Scene, #{robots := Ids} = Context, Options) ->
    #{delay := {MinMs, MaxMs}, shards := Shards, faults := Faults} = Scenario,
    Profile = starl_motion:profile(maps:merge(profile(Scenario), maps:get(profile, Scene, #{}))),
    World = #{
        seed => maps:get(seed, Scenario),
        team => starl_team:new(Ids),
        loss => float(maps:get(loss, Scenario)),
        duplicate => float(maps:get(duplicate, Scenario)),
        delay_us => {round(MinMs * 1000), round(MaxMs * 1000)},
        range_mm => range(Scenario),
        clock => clock(Scenario),
        profile => Profile,
        network => faults(network, Faults),
        clocks => faults(clock, Faults),
        location => faults(location, Faults),
        actuation => faults(actuation, Faults)
    },
    Plan = #{
        robots => [{Id, pose(Id, Scene, Context)} || Id <- Ids],
        crew => crew(mode(Scenario), Scene, Profile, Context),
        world => World,
        window_us => round(MinMs * 1000),
        limit_us => limit_us(Scenario),
        shards => shards(Shards, length(Ids), Options),
        faults => strikes(Faults),
        monitors => monitors(Scenario, Scene, Context)
    },
    case starl_sim_sup:start_link(maps:merge(Plan, nodes(Scenario, Scene, Options))) of
        {ok, Sup} ->
            Run = starl_sim_sup:run(Sup),
            {ok, #sim{sup = Sup, run = Run, scenario = Scenario, scene = Scene}};
        {error, Reason} ->
            {error, {nodes, Reason}}
    end.

nodes(#{app := App}, #{app := Playing} = Scene, #{nodes := Nodes} = Options) ->
    Blocks = [Module || {_, Module, _} <- maps:get(blocks, Scene, [])],
    #{
        nodes => #{
            nodes => Nodes,
            timeout_ms => maps:get(node_timeout_ms, Options, ?NODE_TIMEOUT_MS),
            modules => lists:usort([App, element(2, Playing) | Blocks]),
            code => maps:get(code, Options, [])
        }
    };
nodes(_Scenario, _Scene, _Options) ->
    #{}.

crew(Mode, Scene, Profile, #{robots := Ids} = Context) ->
    Sap = maps:merge(maps:get(sap, Context), maps:get(sap, Scene, #{})),
    Services = [
        {sap, starl_sap, Sap},
        {location, starl_location, #{waypoints => maps:get(waypoints, Scene, #{})}},
        {motion, starl_motion, #{profile => Profile}}
    ],
    Tree = #{
        participants => starl_team:new(Ids),
        services => Services,
        blocks => maps:get(blocks, Scene, []),
        app => maps:get(app, Scene),
        intensity => ?INTENSITY
    },
    interpreted(Mode, Tree).

%% Inline, only a sequential application is left as a process.
interpreted(process, Tree) ->
    #{tree => Tree, inline => #{}};
interpreted(inline, #{services := Services, blocks := Blocks, app := App} = Tree) ->
    Machines = maps:from_list([{Name, {M, Config}} || {Name, M, Config} <- Services ++ Blocks]),
    case App of
        {machine, Module, Config} ->
            #{tree => none, inline => Machines#{app => {Module, Config}}};
        {sequential, _, _} ->
            #{tree => Tree#{services := [], blocks := []}, inline => Machines}
    end.

mode(#{mode := auto, robots := N}) when N > ?MANY_ROBOTS -> inline;
mode(#{mode := auto}) -> process;
mode(#{mode := Mode}) -> Mode.

%% Without a place of their own, robots stand in rows two metres apart.
pose(Id, Scene, #{world := {Width, _}}) ->
    PerRow = max(1, trunc(Width / 2000)),
    Default = {
        1000.0 + 2000.0 * ((Id - 1) rem PerRow), 1000.0 + 2000.0 * ((Id - 1) div PerRow), 0.0
    },
    maps:get(Id, maps:get(poses, Scene, #{}), Default).

%% Whatever is bounded in time may take longer by what faults of clocks and processes cost.
monitors(#{faults := Faults} = Scenario, Scene, #{sap := Sap0, robots := Ids}) ->
    Sap = maps:merge(Sap0, maps:get(sap, Scene, #{})),
    Slack = starl_sim_fault:slack_us(Faults),
    %% a hundredth more for the drift of the sender's clock
    Bound = starl_sap:bound_us(Sap) * 101 div 100 + 1000000,
    Own = [{starl_sap_monitor, #{bound_us => Bound, robots => Ids}} | progress(Scenario, Ids)],
    [{Module, widened(Slack, Config)} || {Module, Config} <- Own ++ maps:get(monitors, Scene, [])].

widened(Slack, #{bound_us := Bound} = Config) when is_integer(Bound) ->
    Config#{bound_us := Bound + Slack};
widened(_Slack, Config) ->
    Config.

progress(#{converge := none}, _Ids) ->
    [];
progress(Scenario, Ids) ->
    [{starl_sim_progress_monitor, #{robots => Ids, deadline_us => deadline_us(Scenario)}}].

deadline_us(#{heal := Heal, converge := Converge, faults := Faults}) ->
    micros(Heal) + micros(Converge) + starl_sim_fault:slack_us(Faults).

%% A run that has to converge is not longer than that takes.
limit_us(#{converge := none, time := Time}) -> micros(Time);
limit_us(#{time := Time} = Scenario) -> min(micros(Time), deadline_us(Scenario)).

strikes(Faults) ->
    Strikes = lists:append([starl_sim_fault:strikes(Fault) || Fault <- Faults]),
    [
        {Robot, Time, 0, 0, N, Strike}
     || {N, {Robot, Time, Strike}} <- lists:zip(lists:seq(1, length(Strikes)), Strikes)
    ].

faults(Class, Faults) ->
    [starl_sim_fault:compile(F) || F <- Faults, starl_sim_fault:class(F) =:= Class].

%% Few robots are not worth a shard of their own, but every node has one.
shards(none, Robots, Options) ->
    %% two a core, so that a core has work while a shard waits for another
    Most = 2 * erlang:system_info(schedulers_online) * machines(Options),
    min(Robots, max(nodes_of(Options), min(Most, Robots div ?ROBOTS_PER_SHARD)));
shards(Shards, Robots, _Options) ->
    min(Shards, Robots).

%% Other machines are taken to be like this one.
machines(#{nodes := [_ | _] = Nodes}) -> length(Nodes);
machines(#{}) -> 1.

nodes_of(#{nodes := N}) when is_integer(N) -> max(1, N);
nodes_of(Options) -> machines(Options).

range(#{range := none}) -> infinity;
range(#{range := Range}) -> float(Range).

clock(#{clock_offset := OffsetMs, clock_drift := Ppm}) ->
    {round(OffsetMs * 1000), round(Ppm * 1000)}.

micros(Seconds) -> round(Seconds * 1000000).
