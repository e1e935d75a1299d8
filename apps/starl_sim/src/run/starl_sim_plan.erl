%% @doc Makes the plan of a simulation from a planned run ({@link starl_run_plan}). It adds the
%% shards and nodes, the length of the windows, how the machines run or which kind of robots runs
%% (`program'), and the simulator's part of the world.
-module(starl_sim_plan).

-export([make/2, mode/2, add_strikes/2]).

-export_type([t/0]).

%% The parts of a simulation and its time limit; its nodes, if any, and, once these are
%% open, its sites.
-type t() :: #{
    robots := [{starl:robot_id(), starl:pose()}],
    crew := starl_sim_shard:crew(),
    world := starl_sim_world:t(),
    window_us := pos_integer(),
    patience_ms := pos_integer(),
    shards := pos_integer(),
    faults := [starl_sim_queue:event()],
    limit_us := starl_sim_queue:time(),
    monitors := [{module(), map()}],
    observe => starl_observer:t(),
    nodes => starl_sim_nodes:options(),
    sites => [starl_sim_site:t(), ...]
}.

-define(ROBOTS_PER_SHARD, 16).
%% Teams above this size are simulated inline, unless the scenario says otherwise.
-define(MANY_ROBOTS, 300).
-define(NODE_TIMEOUT_MS, 30000).
-define(PATIENCE_MS, 60000).

%% @doc The plan of the simulation of a planned run.
-spec make(starl_run:planned(), starl_sim:options()) -> {ok, t()} | {error, unicode:chardata()}.
make({Scenario, Scene, #{tree := Tree, robots := Robots} = Run}, Options) ->
    #{delay := {MinMs, _}, shards := Shards, faults := Faults} = Scenario,
    #{reloads := Reloads, code := Code} = Run,
    Plan = (maps:with([robots, limit_us, monitors], Run))#{
        crew => crew(mode(Scenario, Options), Tree),
        world => starl_sim_branch:plant(
            maps:get(branch, Options, none), world(Scenario, Scene, Run, Options)
        ),
        window_us => round(MinMs * 1000),
        patience_ms => maps:get(patience_ms, Options, ?PATIENCE_MS),
        shards => shards(Shards, length(Robots), Options),
        faults => strikes(Faults, Reloads)
    },
    Observed = maps:with([observe], Options),
    Whole = maps:merge(maps:merge(Plan, Observed), nodes(Scenario, Scene, Code, Options)),
    of_kind(maps:get(program, Scenario, simulated), Scenario, Whole, Tree).

%% The robots of the simulator, or those of another kind that an application lists.
of_kind(simulated, _Scenario, Plan, _Tree) ->
    {ok, Plan};
of_kind(Name, Scenario, Plan, Tree) ->
    {Name, Kind} = lists:keyfind(Name, 1, starl_catalogue:listed(starl_programs)),
    Kind:plan(Scenario, Plan#{crew := #{kind => Kind, tree => Tree, inline => #{}}}).

%% In inline mode, only a sequential application is a process.
crew(process, Tree) ->
    #{tree => Tree, inline => #{}};
crew(inline, Tree) ->
    {Left, Inline} = starl_robot_services:inline(Tree),
    #{tree => Left, inline => Inline}.

world(#{faults := Faults}, Scene, #{world := World, reloads := Reloads}, Options) ->
    Parts = [
        #{
            packets =>
                maps:get(packets, Options, false) andalso maps:get(observe, Options, none) =/= none,
            record => maps:get(record, Options, #{})
        },
        walls(Faults, Scene),
        kept(starl_run_contracts:models(Scene, Options)),
        starl_run_reloads:world(Reloads, starl_run_plan:parts(Scene))
    ],
    lists:foldl(fun(Part, Whole) -> maps:merge(Whole, Part) end, World, Parts).

%% On a floor plan bodies are solid, and there is something to sense.
walls(Faults, #{floor := Floor} = Scene) ->
    (starl_run_floor:obstacles(Faults, Floor))#{
        walls => starl_walls:new(Floor), senses => starl_sim_senses:new(Scene)
    };
walls(_Faults, _Scene) ->
    #{}.

nodes(#{app := App}, #{app := Playing} = Scene, Code, #{nodes := Nodes} = Options) ->
    Services = [
        maps:get(sap_machine, Scene, starl_sap), maps:get(motion_machine, Scene, starl_motion)
    ],
    Blocks = [Module || {_, Module, _} <- maps:get(blocks, Scene, [])],
    #{
        nodes => #{
            nodes => Nodes,
            timeout_ms => maps:get(node_timeout_ms, Options, ?NODE_TIMEOUT_MS),
            modules => lists:usort([App, element(2, Playing) | Services ++ Blocks]),
            code => Code
        }
    };
nodes(_Scenario, _Scene, _Code, _Options) ->
    #{}.

%% @doc How the robots of a scenario are simulated. A caller that lets nobody look at their processes says
%% `auto => inline', which is cheaper.
-spec mode(starl_run_scenario:t(), starl_sim:options()) -> process | inline.
mode(#{mode := auto, robots := N}, _Options) when N > ?MANY_ROBOTS -> inline;
mode(#{mode := auto}, Options) -> maps:get(auto, Options, process);
mode(#{mode := Mode}, _Options) -> Mode.

kept([]) -> #{};
kept(Models) -> #{histories => lists:usort([Model:machine() || {Model, _} <- Models])}.

strikes(Faults, Reloads) ->
    Strikes = lists:append([starl_run_fault:strikes(Fault) || Fault <- Faults]),
    numbered(1, Strikes ++ starl_run_reloads:strikes(Reloads)).

numbered(First, Strikes) ->
    [
        {Robot, Time, 0, 0, N, Strike}
     || {N, {Robot, Time, Strike}} <- lists:enumerate(First, Strikes)
    ].

%% @doc The plan with further effects on robots, each at its time (us).
-spec add_strikes([{starl:robot_id(), starl_sim_queue:time(), Strike :: term()}], t()) -> t().
add_strikes(Strikes, #{faults := Before} = Plan) ->
    Plan#{faults := Before ++ numbered(length(Before) + 1, Strikes)}.

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
