%% @doc The simulator's interface: starts a simulation, runs it in virtual time, looks inside,
%% and reports the outcome.
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
-behaviour(starl_run).

-export([
    world/1,
    start/1, start/2,
    launch/1,
    await/1,
    run/1, run/2,
    step/2,
    stop/1,
    status/1,
    inspect/2,
    conclude/1,
    finish/1,
    close/1
]).
-export([watch/2, at_work/1]).
-export([
    run_until_event/3,
    robots/1,
    events/2,
    timers/2,
    violations/1,
    reload/2, reload/3,
    reloads/1
]).
-export([scenario/1, notes/1, robot_pids/2, plan/2, format_error/1]).

-export_type([sim/0, options/0, planned/0, reason/0]).

-record(sim, {
    sup :: pid(),
    run :: pid(),
    scenario :: starl_run_scenario:t(),
    scene :: starl_scene:t()
}).

%% A running simulation, linked to the process that started it; unless `linked' is `false' in the
%% environment of the application, as in `./starl shell', where each mistake at the prompt ends that
%% process.
-opaque sim() :: #sim{}.

%% Options outside the scenario: the events of which robots to record; further monitors, which only
%% look on; the observer of the run, and whether it is told of each packet; whether
%% histories of the calls are kept, and judged; the nodes of the run, either a number of peers on this machine or nodes that already run
%% the same code ({@link starl_sim_nodes}); the wall time that one node may keep the others waiting;
%% the wall time that the robots may take for a window of virtual time, before the run is given up;
%% the time by which everything with a bound may be late (in real time, where a computer has other
%% work, too); what the mode `auto' is for teams of up to 300 robots (`process'); and modules that were compiled in memory, to be loaded on the nodes.
-type options() :: #{
    record => #{starl:robot_id() => starl_sim_ledger:range()},
    watch => [{module(), map()}],
    observe => starl_observer:t(),
    packets => boolean(),
    histories => starl_run_plan:histories(),
    nodes => starl_sim_nodes:nodes(),
    node_timeout_ms => pos_integer(),
    patience_ms => pos_integer(),
    slack_us => non_neg_integer(),
    auto => process | inline,
    code => [starl_version:code()],
    %% the values of the scenario were checked before
    checked => boolean(),
    %% other draws from a moment on, which do change the result
    branch => starl_sim_branch:t()
}.

%% A simulation that has not begun: its scenario with all defaults and drawn faults, its scene, and
%% its plan.
-type planned() :: {starl_run_scenario:t(), starl_scene:t(), starl_sim_plan:t()}.

-type reason() ::
    starl_run:reason()
    | {program, unicode:chardata()}
    | {nodes, starl_sim_nodes:reason()}
    | {reload, starl_reload:reason() | {node(), unreachable}}
    | starl_sim_run:missed().

%% @doc Starts the simulation of a scenario. The key `app' is the application's module, or its name
%% without `starl_'. An application alone runs with the defaults.
-spec start(module() | #{app := module(), atom() => term()}) -> {ok, sim()} | {error, reason()}.
start(Given) -> start(Given, #{}).

%% @doc Starts the simulation with options of the run, which do not change its result.
-spec start(module() | #{app := module(), atom() => term()}, options()) ->
    {ok, sim()} | {error, reason()}.
start(Given, Options) ->
    case plan(Given, Options) of
        {ok, Planned} ->
            Facts = fun() -> starl_run_plan:facts(Planned, maps:get(watch, Options, [])) end,
            ok = begun(maps:get(observe, Options, none), Facts),
            launch(Planned);
        {error, _} = Error ->
            Error
    end.

begun(none, _Facts) -> ok;
begun(Observer, Facts) -> starl_observer:tell({begun, Facts()}, Observer).

%% @doc Plans the simulation of a scenario, without starting it.
-spec plan(module() | #{app := module(), atom() => term()}, options()) ->
    {ok, planned()} | {error, reason()}.
plan(Given, Options) ->
    case starl_run:plan(Given, Options) of
        {ok, {Scenario, Scene, _Plan} = Planned} ->
            made(starl_sim_plan:make(Planned, Options), Scenario, Scene);
        {error, _} = Error ->
            Error
    end.

made({ok, Plan}, Scenario, Scene) -> {ok, {Scenario, Scene, Plan}};
made({error, Why}, _Scenario, _Scene) -> {error, {program, Why}}.

%% @doc Runs to the end: all applications are done, the time is up, or a contract is violated.
-spec run(sim()) -> starl_sim_run:status().
run(#sim{run = Run, scenario = #{time := Seconds}}) -> starl_sim_run:run(Run, micros(Seconds)).

%% @doc The robots are in the simulator.
-spec world(_Sim) -> simulation.
world(_Sim) -> simulation.

%% @doc Runs to the end, and returns why the run has ended.
-spec await(sim()) -> starl_run:ending().
await(Sim) ->
    case run(Sim) of
        #{ending := none} -> time;
        #{ending := Ending} -> Ending
    end.

%% @doc Runs to a virtual time in seconds, or to an earlier end.
-spec run(sim(), Seconds :: number()) -> starl_sim_run:status().
run(#sim{run = Run}, Seconds) -> starl_sim_run:run(Run, micros(Seconds)).

%% @doc Runs on for the given virtual seconds.
-spec step(sim(), Seconds :: number()) -> starl_sim_run:status().
step(#sim{run = Run}, Seconds) ->
    #{now_us := Now} = starl_sim_run:status(Run),
    starl_sim_run:run(Run, Now + micros(Seconds)).

%% @doc Runs until just after the N-th event of a robot. That robot halts there,
%% the others finish the window; {@link run/1} goes on from there as if there had been no stop.
-spec run_until_event(sim(), starl:robot_id(), N :: pos_integer()) ->
    {ok, starl_sim_run:status()} | {error, starl_sim_run:missed() | running}.
run_until_event(#sim{run = Run}, Robot, N) -> starl_sim_run:run_to(Run, {Robot, N}).

%% @doc Ends a run after the present window; any process may call it.
-spec stop(sim()) -> ok.
stop(#sim{run = Run}) -> starl_sim_run:stop(Run).

%% @doc The virtual time, and the number of applications that still run.
-spec status(sim()) -> starl_sim_run:status().
status(#sim{run = Run}) -> starl_sim_run:status(Run).

%% @doc The machines of a robot, each with its state and data. Only while the run rests.
-spec inspect(sim(), starl:robot_id()) ->
    #{starl_machine:name() => starl_robot_tree:seen()} | unknown | {error, running}.
inspect(#sim{run = Run}, Robot) -> starl_sim_run:inspect(Run, Robot).

%% @doc A summary of every robot. Only while the run rests.
-spec robots(sim()) -> [{starl:robot_id(), starl_sim_summary:t()}] | {error, running}.
robots(#sim{run = Run}) -> starl_sim_run:robots(Run).

%% @doc The recorded events of a robot so far, as the option `record' of {@link start/2} asked.
%% Only while the run rests.
-spec events(sim(), starl:robot_id()) -> [starl_sim_ledger:event()] | unknown | {error, running}.
events(#sim{run = Run}, Robot) -> starl_sim_run:events(Run, Robot).

%% @doc The timers of a robot that run, by machine and name. Only while the run rests.
-spec timers(sim(), starl:robot_id()) ->
    [starl_sim_timers:timer()] | unknown | {error, running}.
timers(#sim{run = Run}, Robot) -> starl_sim_run:timers(Run, Robot).

%% @doc All violations, including those that would be found if the run ended here. Only while it
%% rests.
-spec violations(sim()) -> [starl_monitor:violation()] | {error, running}.
violations(#sim{run = Run}) -> starl_sim_run:violations(Run).

%% @doc Gives all robots new code, like a reload of the scenario ({@link starl_reload}). The source
%% is a module from the place of its code, a source file, or compiled code. Each machine switches to
%% it at its next step, on trial for five seconds of virtual time. If it fails on one robot, all go
%% back. {@link reloads/1} and the log report the result.
-spec reload(sim(), starl_run_reloads:source()) -> ok | {error, reason()}.
reload(Sim, Source) -> reload(Sim, Source, #{}).

%% @doc The same with another trial time.
-spec reload(sim(), starl_run_reloads:source(), #{trial_ms => non_neg_integer()}) ->
    ok | {error, reason()}.
reload(#sim{run = Run}, Source, Options) ->
    TrialMs = maps:get(trial_ms, Options, starl_reload:trial_ms()),
    case starl_sim_run:reload(Run, starl_run_reloads:sources(Source), TrialMs) of
        {error, Reason} -> {error, {reload, Reason}};
        ok -> ok
    end.

%% @doc The results of all reloads so far, including those of the scenario.
%% {@link starl_reload_monitor:format/1} formats each as a line.
-spec reloads(sim()) -> [starl_reload_monitor:reload()].
reloads(#sim{run = Run}) -> starl_sim_run:reloads(Run).

%% @doc Watches for a run that makes no progress in real time ({@link starl_sim_watchdog}).
-spec watch(sim(), starl_sim_watchdog:config()) -> pid().
watch(#sim{run = Run}, Config) -> starl_sim_watchdog:start_link(Run, Config).

%% @doc The processes that are at work in a run without progress. Any process may ask.
-spec at_work(sim()) -> [starl_sim_watchdog:work()].
at_work(#sim{run = Run}) -> starl_sim_watchdog:at_work(Run).

%% @doc The checked scenario, with all defaults.
-spec scenario(sim()) -> starl_run_scenario:t().
scenario(#sim{scenario = Scenario}) -> Scenario.

%% @doc Notes of the application's scene before the run begins, a line each.
-spec notes(sim()) -> [unicode:chardata()].
notes(#sim{scene = Scene}) -> maps:get(notes, Scene, []).

%% @doc The supervisors of the robots, to inspect their trees with OTP's own tools.
-spec robot_pids(sim(), all) -> [pid()].
robot_pids(#sim{sup = Sup}, all) ->
    Pools = [Robots || #{robots_sup := Robots} <- starl_sim_sup:sites(Sup)],
    [Pid || Robots <- Pools, {_, Pid, _, _} <- supervisor:which_children(Robots)].

%% @doc The outcome of a run that has ended, and the application's report. The simulation stays open
%% for inspection. It cannot go on, and must be closed.
-spec conclude(sim()) -> {starl_sim_run:outcome(), starl_scene:report()}.
conclude(#sim{run = Run, scenario = #{app := App}, scene = Scene}) ->
    Outcome = starl_sim_run:finish(Run),
    {Outcome, starl_scene:report(App, Scene, Outcome)}.

%% @doc Ends the simulation; returns its outcome and the application's report.
-spec finish(sim()) -> {starl_sim_run:outcome(), starl_scene:report()}.
finish(Sim) ->
    Concluded = conclude(Sim),
    ok = close(Sim),
    Concluded.

%% @doc Ends the simulation.
-spec close(sim()) -> ok.
close(#sim{sup = Sup}) -> starl_sim_sup:stop(Sup).

%% @doc One line on why a simulation could not be started.
-spec format_error(reason()) -> unicode:chardata().
format_error({program, Why}) ->
    Why;
format_error({nodes, Reason}) ->
    starl_sim_nodes:format_error(Reason);
format_error({lost, Loss}) ->
    starl_sim_nodes:format_loss(Loss);
format_error({hung, Hang}) ->
    starl_sim_watchdog:format_hang(Hang);
format_error({reload, {Node, unreachable}}) ->
    io_lib:format("node ~ts cannot be reached: nothing was reloaded", [Node]);
format_error({reload, Reason}) ->
    lists:join("; ", starl_reload:format_error(Reason));
format_error({no_robot, Robot}) ->
    io_lib:format("there is no robot ~b", [Robot]);
format_error({past, Robot, Events}) ->
    io_lib:format("robot ~b has had ~b events already", [Robot, Events]);
format_error({ended, Robot, Events}) ->
    io_lib:format("robot ~b has no more than ~b events until the run ends", [Robot, Events]);
format_error(Reason) ->
    starl_run:format_error(Reason).

%% -- internals ------------------------------------------------------------------------------

%% @doc Starts the simulation of a plan. Nobody is told that it begins.
-spec launch(planned()) -> {ok, sim()} | {error, reason()}.
launch({Scenario, Scene, Plan}) ->
    case starl_sim_sup:start_link(Plan) of
        {ok, Sup} ->
            _ = application:get_env(starl_sim, linked, true) orelse unlink(Sup),
            Run = starl_sim_sup:run(Sup),
            {ok, #sim{sup = Sup, run = Run, scenario = Scenario, scene = Scene}};
        {error, Reason} ->
            {error, {nodes, Reason}}
    end.

micros(Seconds) -> round(Seconds * 1000000).
