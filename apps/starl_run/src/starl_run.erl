%% @doc Starts and controls a run, wherever it takes place: in the simulator (`starl_sim'), or in
%% real time with live robots (`starl_world_run'). The scenario is checked and planned here, and all
%% runs end with an outcome of the same shape.
%% ```
%%   {ok, Run} = starl_run:start(starl_world_run, #{app => painting, robots => 3}, #{dir => "state"}),
%%   ok = starl_run:inject(Run, [{isolate, 2, #{}, 5000}]),
%%   done = starl_run:await(Run),
%%   {Outcome, Report} = starl_run:finish(Run).
%% '''
-module(starl_run).

-export([start/3, world/1, scenario/1, status/1, inject/2, heal/2, await/1, stop/1, finish/1]).
-export([plan/2, check_app/1, format_error/1]).

-export_type([t/0, status/0, planned/0, reason/0, outcome/0, ending/0]).

%% A run of one of the modules with this behaviour.
-opaque t() :: {module(), Run :: term()}.

%% The present time and the number of robots at work. Each kind of run tells more.
-type status() :: #{
    now_us := integer(),
    running := non_neg_integer(),
    ending := ending() | none,
    atom() => term()
}.

%% They know each other's messages, and are of one version.
-define(SIBLINGS, [
    starl_platform, starl_run, starl_sim, starl_blocks, starl_live, starl_world
]).

-define(EXAMPLE, "#{app => painting, robots => 3}").

%% A run that has not begun: its scenario with all defaults and drawn faults, its scene, and
%% its plan.
-type planned() :: {starl_run_scenario:t(), starl_scene:t(), starl_run_plan:t()}.

%% Why a scenario cannot be run.
-type reason() ::
    {scenario, starl_run_scenario:reason()}
    | {app | scene, unicode:chardata()}
    | {no_such_app, module()}
    %% at a prompt it is all that one sees
    | {no_app, Example :: string()}
    | {fault_target, atom(), starl:robot_id()}
    | {fault_machine, atom(), starl_machine:name(), Known :: [starl_machine:name()]}
    | starl_run_floor:problem_of_fault()
    | {versions, [{atom(), Version :: string()}, ...]}
    | {new_code, unicode:chardata()}.

%% Why a run ended: all applications finished, its time was up, a contract was violated, it was
%% stopped from outside, nothing could happen any more, a node was lost, or a robot did not end its step.
-type ending() :: done | time | violation | stopped | quiet | lost | hung.

%% The outcome. The robots of lost nodes are missing in it. Live runs have no digest; that of a simulation is
%% empty if nodes were lost, or a robot did not end its step. `starl_sim_outcome' makes
%% that of a simulation.
-type outcome() :: #{
    ending := ending() | none,
    end_us := non_neg_integer(),
    %% the time until which contracts are judged
    judged_us := non_neg_integer(),
    violations := [starl_monitor:violation()],
    %% the parts of the run of which there is no verdict
    unjudged := [starl_unjudged:t()],
    monitors := #{module() => map()},
    robots := [{starl:robot_id(), map()}],
    digest := binary(),
    events := non_neg_integer(),
    packets := non_neg_integer(),
    lost := [term()],
    hung => term(),
    %% of a run in real time: the robots whose computers were late, how often, and by how much at most
    late_computers => [{starl:robot_id(), pos_integer(), Us :: pos_integer()}],
    %% of a run in real time: the faults that were injected, manual ones among them
    faults => [starl_run_fault:t()]
}.

%% Where its robots are.
-callback world(Run :: term()) -> starl_run_manual_fault:world().
%% Starts it, linked to the calling process.
-callback start(Given :: #{app := module(), atom() => term()}, Options :: map()) ->
    {ok, Run :: term()} | {error, Reason :: term()}.
%% One line on why it could not be started.
-callback format_error(Reason :: term()) -> unicode:chardata().
%% The checked scenario, with all defaults.
-callback scenario(Run :: term()) -> starl_run_scenario:t().
-callback status(Run :: term()) -> status().
%% Runs to the end.
-callback await(Run :: term()) -> ending().
%% Ends it; any process may.
-callback stop(Run :: term()) -> ok.
%% The outcome of a run that has come to its end, and the application's report. Nothing of the run is left.
-callback finish(Run :: term()) -> {outcome(), starl_scene:report()}.
%% Injects manual faults now. A simulation has none: virtual time is too fast for them, so a fault is
%% part of its scenario.
-callback inject(Run :: term(), [starl_run_manual_fault:t()]) -> ok | {error, unicode:chardata()}.
%% These faults are over.
-callback heal(Run :: term(), starl_run_manual_fault:heal()) -> ok.

-optional_callbacks([inject/2, heal/2]).

%% @doc Starts a run of this kind, linked to the calling process.
-spec start(module(), #{app := module(), atom() => term()}, Options :: map()) ->
    {ok, t()} | {error, unicode:chardata()}.
start(Kind, Given, Options) ->
    case Kind:start(Given, Options) of
        {ok, Run} -> {ok, {Kind, Run}};
        {error, Reason} -> {error, Kind:format_error(Reason)}
    end.

%% @doc Where the robots of a run are.
-spec world(t()) -> starl_run_manual_fault:world().
world({Kind, Run}) -> Kind:world(Run).

%% @doc The checked scenario of a run, with all defaults.
-spec scenario(t()) -> starl_run_scenario:t().
scenario({Kind, Run}) -> Kind:scenario(Run).

%% @doc The present time, and the number of robots at work.
-spec status(t()) -> status().
status({Kind, Run}) -> Kind:status(Run).

%% @doc Injects manual faults now, in a run in real time.
-spec inject(t(), [starl_run_manual_fault:t()]) -> ok | {error, unicode:chardata()}.
inject({Kind, Run}, Faults) -> Kind:inject(Run, Faults).

%% @doc Ends these faults.
-spec heal(t(), starl_run_manual_fault:heal()) -> ok.
heal({Kind, Run}, What) -> Kind:heal(Run, What).

%% @doc Runs to the end.
-spec await(t()) -> ending().
await({Kind, Run}) -> Kind:await(Run).

%% @doc Ends a run; any process may.
-spec stop(t()) -> ok.
stop({Kind, Run}) -> Kind:stop(Run).

%% @doc The outcome of a run that has ended, and the application's report. Nothing of the run is
%% left afterwards.
-spec finish(t()) -> {outcome(), starl_scene:report()}.
finish({Kind, Run}) -> Kind:finish(Run).

%% @doc Plans the run of a scenario, without starting it. The key `app' is the application's module, or its name
%% without `starl_'. An application alone runs with the defaults. With the option `checked' the values
%% are those that `starl_run_scenario:check/2' has returned.
-spec plan(module() | #{app := module(), atom() => term()}, starl_run_plan:options()) ->
    {ok, planned()} | {error, reason()}.
plan(App, Options) when is_atom(App) ->
    plan(#{app => App}, Options);
plan(#{app := Name} = Given, Options) when is_atom(Name) ->
    case {starl_code:versions(?SIBLINGS), module_named(Name)} of
        {{differ, Versions}, _} -> {error, {versions, Versions}};
        {same, {ok, App}} -> checked(Given#{app := App}, Options);
        {same, none} -> {error, {no_such_app, Name}}
    end;
plan(_Given, _Options) ->
    {error, {no_app, ?EXAMPLE}}.

module_named(Name) ->
    Names = [Name, list_to_atom("starl_" ++ atom_to_list(Name))],
    case [M || M <- Names, code:ensure_loaded(M) =:= {module, M}] of
        [Module | _] -> {ok, Module};
        [] -> none
    end.

checked(#{app := App} = Given, Options) ->
    case check_app(App) of
        ok -> with_values(values(Given, Options), App, Options);
        {error, _} = Error -> Error
    end.

values(Scenario, #{checked := true}) -> {ok, Scenario};
values(#{app := App} = Given, _Options) -> starl_run_scenario:check(Given, starl_app:options(App)).

with_values({ok, Scenario}, App, Options) -> set_up(App, Scenario, Options);
with_values({error, Reason}, _App, _Options) -> {error, {scenario, Reason}}.

%% @doc Checks whether this module can run as an application: whether its callbacks exist, and
%% whether its table of options is sound.
-spec check_app(module()) -> ok | {error, {app, unicode:chardata()}}.
check_app(App) ->
    case starl_app:check(App, [Key || {Key, _, _, _} <- starl_run_scenario:options()]) of
        ok -> ok;
        {error, Why} -> {error, {app, Why}}
    end.

%% -- a run is set up ------------------------------------------------------------------------

%% The scenario with its floor and its drawn faults, the scene, and the plan, or the first problem.
set_up(App, Scenario, Options) ->
    #{robots := N, faults := Faults} = Scenario,
    Targets = [{element(1, Fault), R} || Fault <- Faults, R <- starl_run_fault:targets(Fault)],
    case [{Id, R} || {Id, R} <- Targets, R > N] of
        [{Id, Robot} | _] -> {error, {fault_target, Id, Robot}};
        [] -> set_scene(App, Scenario, Options)
    end.

set_scene(App, Scenario, Options) ->
    case starl_run_floor:read(Scenario) of
        {ok, Floor} -> set_scene(App, Floor, starl_run_floor:given(Floor, Scenario), Options);
        {error, Why} -> {error, {scene, Why}}
    end.

set_scene(App, Floor, Scenario, Options) ->
    Context = starl_run_plan:context(App, Floor, Scenario),
    case starl_scene:make(App, Context) of
        {ok, Scene} -> on_floor(Floor, Scenario, Scene, Context, Options);
        {error, Why} -> {error, {scene, Why}}
    end.

%% The scenario's floor plan, or else that of the application.
on_floor(none, Scenario, #{floor := #{size := Size} = Floor} = Scene, Context, Options) ->
    Placed = Context#{floor := Floor, world := Size},
    stand(starl_run_floor:given(Floor, Scenario), Scene, Placed, Options);
on_floor(none, Scenario, Scene, Context, Options) ->
    stand(Scenario, Scene, Context, Options);
on_floor(Floor, Scenario, Scene, Context, Options) ->
    stand(Scenario, Scene#{floor => Floor}, Context, Options).

stand(Scenario, Scene, Context, Options) ->
    case starl_run_floor:stand(Scenario, Scene, Context) of
        {ok, Standing} -> check_faults(Scenario, Standing, Context, Options);
        {error, Why} -> {error, {scene, Why}}
    end.

check_faults(#{faults := Faults} = Scenario, Scene, Context, Options) ->
    Known = [sap, location, motion, app | [N || {N, _, _} <- maps:get(blocks, Scene, [])]],
    Unknown = [
        {fault_machine, Id, N, Known}
     || {Id, _, _, kill_machine, {_, N}, _} <- Faults, not lists:member(N, Known)
    ],
    case Unknown ++ starl_run_floor:faults(Faults, Scene) of
        [] -> planned(with_random_faults(Known, Scene, Scenario), Scene, Context, Options);
        [Problem | _] -> {error, Problem}
    end.

%% Drawn faults stand in the scenario from now on as if the user had given them.
with_random_faults(_Known, _Scene, #{random_faults := []} = Scenario) ->
    Scenario;
with_random_faults(Known, Scene, Scenario) ->
    #{faults := Given, random_faults := What, heal := Heal} = Scenario,
    Drawn = starl_run_fault_draw:draw((longest(Scenario))#{
        seed => maps:get(seed, Scenario),
        robots => maps:get(robots, Scenario),
        machines => Known,
        floor => drawn_on(Scene),
        until_ms => max(1, round(1000 * Heal)),
        kinds => What
    }),
    Scenario#{faults := Given ++ Drawn, random_faults := []}.

drawn_on(#{floor := #{doors := Doors, size := Size}}) -> {length(Doors), Size};
drawn_on(_Scene) -> none.

longest(#{longest_fault := none}) -> #{};
longest(#{longest_fault := Seconds}) -> #{longest_ms => max(1, round(1000 * Seconds))}.

%% The new code of the scenario is loaded, here and on the nodes.
planned(Scenario, Scene, Context, Options) ->
    case starl_run_reloads:make(Scenario, starl_run_plan:parts(Scene)) of
        {ok, Reloads, Code} ->
            Own = {Reloads, Code ++ maps:get(code, Options, [])},
            {ok, {Scenario, Scene, starl_run_plan:make(Scenario, Scene, Context, Own, Options)}};
        {error, Why} ->
            {error, {new_code, Why}}
    end.

%% -- problems -------------------------------------------------------------------------------

%% @doc One line on why a scenario cannot be run.
-spec format_error(reason()) -> unicode:chardata().
format_error({scenario, Reason}) ->
    starl_run_scenario:format_error(Reason);
format_error({What, Why}) when What =:= app; What =:= scene; What =:= new_code ->
    Why;
format_error({no_such_app, App}) ->
    Meant = starl_similar:meant(starl_code:resembling(App), "; is it compiled, and in the path?"),
    [io_lib:format("there is no application ~ts", [App]), Meant];
format_error({versions, Versions}) ->
    Each = [io_lib:format("~ts is ~ts", [App, Version]) || {App, Version} <- Versions],
    [
        "applications of StarL of unlike versions: ",
        lists:join(", ", Each),
        "; a project takes all of them from one commit"
    ];
format_error({no_app, Example}) ->
    ["which application? A scenario names it: ", Example];
format_error(Fault) ->
    format_fault(Fault).

%% A fault for which the run has no place.
format_fault({fault_target, Id, Robot}) ->
    io_lib:format("fault ~ts: there is no robot ~b", [Id, Robot]);
format_fault({fault_machine, Id, Name, Known}) ->
    Names = lists:join(", ", [atom_to_list(N) || N <- Known]),
    io_lib:format("fault ~ts: a robot has no machine ~ts; it has ~ts", [Id, Name, Names]);
format_fault({fault_floor, Id}) ->
    io_lib:format("fault ~ts is one of a floor plan: give a plan with --floor", [Id]);
format_fault({fault_door, Id, Door, 0}) ->
    io_lib:format("fault ~ts: there is no door ~b, the floor plan has no doors", [Id, Door]);
format_fault({fault_door, Id, Door, Doors}) ->
    io_lib:format("fault ~ts: there is no door ~b, the floor plan has doors 1 to ~b", [
        Id, Door, Doors
    ]).
