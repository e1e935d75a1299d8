%% @doc Runs a scenario in real time in a simulated world ({@link starl_world}). The robots are all
%% in this VM, or each on an Erlang node of its own on this computer: the option `transport' says
%% which.
%% ```
%%   {ok, Run} = starl_run:start(starl_world_run, #{app => painting, robots => 3}, #{
%%       dir => "state", transport => dist
%%   }),
%%   ok = starl_run:inject(Run, [{isolate, 2, #{}, 5000}]),
%%   done = starl_run:await(Run),
%%   {Outcome, Report} = starl_run:finish(Run).
%% '''
%% The process of a run starts and restarts the robots, and carries out all faults: those of the
%% schedule, random ones (chaos) and manual ones. It reports each fault to the world. What a fault
%% does to a robot is done by the host that runs the robots.
%% ```
%%   schedule, chaos, inject, heal --> this process -- began, ended --> starl_world
%%                                       |      ^
%%          start, kill, halt, disk, notify     up, renewed, down, halted, resumed ...
%%                                       v      |
%%                    starl_world_host: starl_world_here or starl_cluster
%% '''
-module(starl_world_run).
-behaviour(starl_run).
-behaviour(gen_server).

-export([
    start/2, world/1, scenario/1, status/1, inject/2, heal/2, await/1, until/2, stop/1, finish/1
]).
-export([link/2, place/2, halt_at_work/3, reload/2, reload/3, command/2, format_error/1]).
-export([init/1, handle_call/3, handle_cast/2, handle_info/2, terminate/2]).

-export_type([t/0, options/0, status/0, reason/0]).

-record(run, {
    server :: pid(),
    world :: pid(),
    host :: module(),
    scenario :: starl_run_scenario:t(),
    scene :: starl_scene:t()
}).

%% A run in real time, linked to the process that started it.
-opaque t() :: #run{}.

%% `dir': the directory of the robots' stores. `transport': how packets travel. By `local', the
%% default, all robots are in this VM; by another one, each is on a node of its own. `host': runs the
%% robots instead ({@link starl_world_host}). `speed': 2.0 is
%% twice as fast as real time. `air': other link conditions than those of the scenario's radio.
%% `chassis': what the robots have in place of a chassis of the world. `watch': further monitors,
%% which judge nothing. `packets': whether the observer gets all packets.
%%
%% On nodes: `epoch_us': the system time of the run's time 0, for robots that go on from the stores
%% of an earlier run; by default the present one. `code': modules that were compiled in memory.
%% `metrics': robot N serves its metrics at this port plus N. `chaos': random faults, with their
%% times. `recorder': records each robot on its own node. `log': gets each line of the nodes' logs.
-type options() :: #{
    dir := file:filename(),
    transport => starl_world_setup:name(),
    host => module(),
    speed => number(),
    air => starl_live_conditions:settings(),
    watch => [{module(), map()}],
    observe => starl_observer:t(),
    facts => starl_observer:facts(),
    packets => boolean(),
    rate_hz => number() | none,
    chassis => starl_world_chassis:lines(),
    whole_mm => boolean(),
    arena => starl_world_floor:arena(),
    epoch_us => integer(),
    recorder => starl_observer:recorder(),
    metrics => inet:port_number() | none,
    chaos => [{AtUs :: integer(), starl_cluster_chaos:fault()}],
    code => starl_cluster_nodes:code(),
    log => fun((starl:robot_id(), logger:level(), binary()) -> term())
}.

%% As of {@link starl_world:status()}. On nodes, also the number of restarts of each node, and its
%% process in the operating system.
-type status() :: #{
    now_us := integer(),
    leader := starl:robot_id() | none,
    running := non_neg_integer(),
    up := [starl:robot_id()],
    ending := starl_world:ending() | none,
    restarts => #{starl:robot_id() => non_neg_integer()},
    os_pids => #{starl:robot_id() => string()}
}.

%% Why a run could not be started.
-type reason() ::
    starl_run:reason()
    | {peers, starl_sim_peers:reason()}
    | {control, unicode:chardata()}
    | {robot, starl:robot_id(), unicode:chardata()}.

-type answer() :: ok | {error, unicode:chardata()}.

-record(state, {
    world :: pid(),
    clock :: starl_live_clock:t(),
    speed :: number(),
    %% what each robot starts with
    specs :: #{starl:robot_id() => starl_live_robot:spec()},
    faults :: starl_world_faults:t(),
    host :: module(),
    robots :: starl_world_host:state(),
    %% what robots are notified of when the present message has been handled
    notices = [] :: [{conditions, starl:robot_id()} | {kill_machine, starl:robot_id(), atom()}]
}).

-define(CALL_MS, 60000).
%% The time after which a robot that has ended is started anew.
-define(AGAIN_MS, 500).

%% -- the run --------------------------------------------------------------------------------

%% @doc Starts the robots of a scenario.
-spec start(#{app := module(), atom() => term()}, options()) -> {ok, t()} | {error, reason()}.
start(Given, Options) ->
    case plan(Given, Options) of
        {ok, {Scenario, Scene, Plan} = Planned, Schedule} ->
            Observed = observed(Planned, Options),
            Started = gen_server:start_link(
                ?MODULE, {Plan, Schedule, Observed}, [{timeout, infinity}]
            ),
            started(Started, host(Options), Scenario#{faults := Schedule}, Scene);
        {error, _} = Error ->
            Error
    end.

started({ok, Server}, Host, Scenario, Scene) ->
    World = gen_server:call(Server, world, infinity),
    {ok, #run{server = Server, world = World, host = Host, scenario = Scenario, scene = Scene}};
started({error, {shutdown, Reason}}, _Host, _Scenario, _Scene) ->
    {error, Reason}.

%% This computer has other work, too, so every bound on a duration is extended by some real time.
%% Monitors are notified of each fault when it begins and when it has ended. So the faults of the
%% schedule are no part of the plan.
plan(Given, Options) ->
    Slack = round(starl_world:slack_us() * maps:get(speed, Options, 1)),
    Own = (maps:with([watch], Options))#{slack_us => Slack},
    case starl_run:plan(Given#{mode => process}, Own) of
        {ok, {_Scenario, #{floor := _}, _Plan}} ->
            {error, {scene, "in real time there are no floor plans yet: run it in virtual time"}};
        {ok, {#{faults := []}, _Scene, _Plan} = Planned} ->
            {ok, placed(Planned), []};
        {ok, {#{faults := Faults} = Scenario, _Scene, _Plan}} ->
            scheduled(
                starl_run_manual_fault:refused((host(Options)):world(), Faults), Scenario, Own
            );
        {error, _} = Error ->
            Error
    end.

%% The settle time after the last fault is the same in real time.
scheduled([], #{faults := Faults, heal := Heal} = Scenario, Own) ->
    Healed = max(Heal, starl_run_fault:healed_us(Faults) / 1.0e6),
    {ok, Planned} = starl_run:plan(Scenario#{faults := [], heal := Healed}, Own),
    {ok, placed(Planned), Faults};
scheduled(Refused, _Scenario, _Own) ->
    {error, {scene, lists:join("; ", Refused)}}.

%% Live robots check whether they are placed well.
placed({Scenario, Scene, Plan} = Planned) ->
    {Scenario, Scene, Plan#{placing => starl_run_floor:placing(Planned)}}.

%% The first report for the observer of the run, and for the recorders of its robots.
observed(Planned, Options) when is_map_key(observe, Options); is_map_key(recorder, Options) ->
    Options#{facts => starl_run_plan:facts(Planned, maps:get(watch, Options, []))};
observed(_Planned, Options) ->
    Options.

host(#{host := Host}) ->
    Host;
host(Options) ->
    case maps:get(transport, Options, local) of
        local -> starl_world_here;
        _ -> starl_cluster
    end.

%% @doc Where the robots are.
-spec world(t()) -> one_vm | nodes.
world(#run{host = Host}) -> Host:world().

%% @doc The checked scenario, with all defaults.
-spec scenario(t()) -> starl_run_scenario:t().
scenario(#run{scenario = Scenario}) -> Scenario.

%% @doc The present time, the robots at work, and their nodes.
-spec status(t()) -> status().
status(#run{server = Server}) -> gen_server:call(Server, status, ?CALL_MS).

%% @doc Injects manual faults now. If one cannot be injected, the others after it are not, and it is
%% the answer. A reboot of no length kills the robot's processes; they are restarted. A store that is
%% set back in no time gets the state that it had when the robot was last started. A pause halts the
%% robot's node at once, for a time by the computer's clock.
-spec inject(t(), [starl_run_manual_fault:t()]) -> answer().
inject(#run{server = Server}, Faults) ->
    case gen_server:call(Server, {inject, Faults}, ?CALL_MS) of
        {ok, _Unheard} -> ok;
        {error, _} = Error -> Error
    end.

%% @doc Ends these faults. Pauses end only with `all'.
-spec heal(t(), starl_run_manual_fault:heal()) -> ok.
heal(#run{server = Server}, What) ->
    {ok, _Unheard} = gen_server:call(Server, {heal, What}, ?CALL_MS),
    ok.

%% @doc Waits for the end of the run.
-spec await(t()) -> starl_world:ending().
await(#run{world = World}) -> starl_world:await(World).

%% @doc Waits until this time of the run.
-spec until(t(), Us :: integer()) -> ok.
until(#run{world = World}, Us) -> starl_world:until(World, Us).

%% @doc Ends the run.
-spec stop(t()) -> ok.
stop(#run{world = World}) -> starl_world:stop(World).

%% @doc Ends the robots and the world; returns the outcome and the application's report.
-spec finish(t()) -> {starl_run:outcome(), starl_scene:report()}.
finish(#run{server = Server, world = World, scenario = #{app := App}, scene = Scene}) ->
    Outcome = starl_world:finish(World),
    {ok, _} = gen_server:call(Server, close, infinity),
    true = unlink(Server),
    ok = gen_server:stop(Server, normal, infinity),
    {Outcome, starl_scene:report(App, Scene, Outcome)}.

%% @doc The link of a robot in this VM; `none' while it restarts.
-spec link(t(), starl:robot_id()) -> pid() | none.
link(#run{server = Server}, Robot) -> gen_server:call(Server, {host, {link, Robot}}, infinity).

%% @doc The node of a robot, and the parameters of its end of the transport: for tests that attack
%% it.
-spec place(t(), starl:robot_id()) ->
    {ok, #{node := node() | none, transport := starl_live_link:adapter()}}
    | {error, unicode:chardata()}.
place(#run{server = Server}, Robot) -> gen_server:call(Server, {host, {place, Robot}}, ?CALL_MS).

%% @doc Halts the node of a robot in the middle of its work, as soon as it does something, for a
%% time by the computer's clock. Returns where it was found, when the node goes on.
-spec halt_at_work(t(), starl:robot_id(), Seconds :: number()) ->
    {ok, starl_cluster_halts:found()} | {error, unicode:chardata()}.
halt_at_work(#run{server = Server}, Robot, Seconds) ->
    gen_server:call(Server, {halt_at_work, Robot, Seconds}, infinity).

%% @doc Reloads code on all nodes, with a trial time ({@link starl_cluster_reload}). Returns when
%% the trial is over, or has failed.
-spec reload(t(), [starl_version:source()]) -> starl_cluster_reload:answer().
reload(Run, Sources) -> reload(Run, Sources, #{}).

%% @doc The same, with another trial time.
-spec reload(t(), [starl_version:source()], starl_cluster_reload:options()) ->
    starl_cluster_reload:answer().
reload(#run{server = Server}, Sources, Options) ->
    gen_server:call(Server, {host, {reload, Sources, Options}}, infinity).

%% @doc One line on why a run could not be started.
-spec format_error(reason()) -> unicode:chardata().
format_error({control, Why}) -> ["the cluster's socket for commands: ", Why];
format_error({peers, Reason}) -> starl_sim_peers:format_error(Reason);
format_error({robot, Robot, Why}) -> io_lib:format("robot ~b does not start: ~ts", [Robot, Why]);
format_error(Reason) -> starl_run:format_error(Reason).

%% @private Carries out a command of another terminal ({@link starl_cluster_command}), in a process
%% of its own.
-spec command(Server :: pid(), starl_cluster_command:t()) -> starl_cluster_command:answer().
command(Server, status) ->
    Peers = gen_server:call(Server, {host, peers}, infinity),
    {ok, starl_cluster_command:described(gen_server:call(Server, status, infinity), Peers)};
command(Server, stop) ->
    ok = starl_world:stop(gen_server:call(Server, world, infinity)),
    {ok, "the run ends\n"};
command(Server, {reload, Source}) ->
    gen_server:call(Server, {host, {reload, [Source], #{}}}, infinity);
command(Server, Request) ->
    starl_cluster_command:done(Request, gen_server:call(Server, Request, infinity)).

%% -- the process ----------------------------------------------------------------------------

-spec init({starl_run_plan:t(), [starl_run_fault:t()], options()}) ->
    {ok, #state{}} | {stop, {shutdown, reason()}}.
init({Plan, Schedule, Options}) ->
    _ = process_flag(trap_exit, true),
    Host = host(Options),
    case Host:open(Plan, Options) of
        {ok, Nodes, Robots} ->
            %% the time of the run begins with the world
            Setup = starl_world_setup:open(Plan, Nodes, Options),
            #state{specs = Specs} = State = new(Setup, Plan, {Host, Robots}, Options),
            Planned = planned(Schedule, maps:get(chaos, Options, []), State),
            all_started(lists:sort(maps:keys(Specs)), Planned);
        {error, Reason} ->
            {stop, {shutdown, Reason}}
    end.

new(#{world := World, clock := Clock} = Setup, #{robots := Poses}, {Host, Robots}, Options) ->
    Ids = [Id || {Id, _} <- Poses],
    #state{
        world = World,
        clock = Clock,
        speed = maps:get(speed, Options, 1),
        specs = maps:from_list([{Id, starl_world_setup:robot(Id, Setup)} || Id <- Ids]),
        faults = starl_world_faults:new(Ids),
        host = Host,
        robots = Robots
    }.

%% Faults that hold from the start begin here: robots get them with their start.
planned(Schedule, Chaos, State) ->
    {AtOnce, InTime} = starl_world_faults:from_the_start(Schedule),
    ok = lists:foreach(fun(Fault) -> at(element(2, Fault), {inject, Fault}, State) end, InTime),
    ok = lists:foreach(fun({Us, Fault}) -> at(Us div 1000, {chaos, Fault}, State) end, Chaos),
    lists:foldl(fun inject_planned/2, State, AtOnce).

%% A robot that cannot be started at first will not be later.
all_started([], #state{host = Host, robots = Robots} = State) ->
    case Host:await(Robots) of
        {ok, Events, Next} -> {ok, notified(happened(Events, State#state{robots = Next}))};
        {error, Reason} -> not_started(Reason, State)
    end;
all_started([Id | Ids], State) ->
    case launch(Id, State) of
        {ok, Next} -> all_started(Ids, Next);
        {{error, Why}, Next} -> not_started({robot, Id, Why}, Next)
    end.

not_started(Reason, State) ->
    ok = terminate(Reason, State),
    {stop, {shutdown, Reason}}.

-spec handle_call(term(), gen_server:from(), #state{}) ->
    {reply, term(), #state{}} | {noreply, #state{}}.
handle_call(world, _From, #state{world = World} = State) ->
    {reply, World, State};
handle_call(status, _From, #state{world = World, host = Host, robots = Robots} = State) ->
    {reply, maps:merge(starl_world:status(World), Host:status(Robots)), State};
handle_call({inject, Faults}, From, State) ->
    case inject_manual(Faults, State) of
        {ok, Next} -> {noreply, notified(replies(From), Next)};
        {{error, _} = Error, Next} -> {reply, Error, notified(Next)}
    end;
handle_call({heal, What}, From, State) ->
    {noreply, notified(replies(From), healed(What, State))};
handle_call({halt_at_work, Robot, Seconds}, From, State) ->
    Pause = {pause, Robot, #{at_work => true}, round(1000 * Seconds)},
    case inject_manual([Pause], State) of
        {ok, Next} -> call_host({wait, Robot}, From, notified(Next));
        {{error, _} = Error, Next} -> {reply, Error, notified(Next)}
    end;
handle_call(close, From, #state{host = Host, robots = Robots} = State) ->
    {Events, Closing} = Host:close(replies(From), Robots),
    {noreply, notified(happened(Events, State#state{robots = Closing}))};
handle_call({host, Request}, From, State) ->
    call_host(Request, From, State).

replies(From) -> fun(Unheard) -> gen_server:reply(From, {ok, Unheard}) end.

call_host(Request, From, #state{host = Host, robots = Robots} = State) ->
    case Host:call(Request, From, Robots) of
        {reply, Answer, Next} -> {reply, Answer, State#state{robots = Next}};
        {noreply, Next} -> {noreply, State#state{robots = Next}}
    end.

-spec handle_cast(term(), #state{}) -> {noreply, #state{}}.
handle_cast(_Request, State) -> {noreply, State}.

-spec handle_info(term(), #state{}) -> {noreply, #state{}} | {stop, term(), #state{}}.
handle_info({inject, Fault}, State) ->
    {noreply, notified(inject_scheduled(Fault, State))};
handle_info({end_fault, Id}, State) ->
    {noreply, notified(end_fault(Id, State))};
handle_info({chaos, Fault}, State) ->
    {noreply, notified(inject_chaos(Fault, State))};
handle_info({restart, Id}, State) ->
    {noreply, notified(restart(Id, State))};
handle_info({'EXIT', World, Reason}, #state{world = World} = State) ->
    {stop, Reason, State};
handle_info(Message, #state{host = Host, robots = Robots} = State) ->
    case Host:info(Message, Robots) of
        {stop, Reason} -> {stop, Reason, State};
        {Events, Next} -> {noreply, notified(happened(Events, State#state{robots = Next}))}
    end.

-spec terminate(term(), #state{}) -> ok.
terminate(_Reason, #state{world = World, host = Host, robots = Robots}) ->
    ok = Host:stop(Robots),
    true = unlink(World),
    starl_sim_stop:shutdown(World, infinity).

now_ms(#state{clock = Clock}) -> starl_live_clock:now_us(Clock) div 1000.

%% This process gets a message at this time of the run.
at(Ms, Message, #state{clock = Clock}) ->
    At = starl_live_clock:monotonic_ms(1000 * Ms, Clock),
    _ = erlang:send_after(At, self(), Message, [{abs, true}]),
    ok.

%% -- faults ---------------------------------------------------------------------------------

inject_manual(Faults, State) ->
    case check(Faults, State) of
        ok -> inject_all(Faults, State);
        {error, _} = Error -> {Error, State}
    end.

check(Faults, #state{specs = Specs, host = Host}) ->
    Named = lists:usort(lists:append([starl_run_manual_fault:robots(Fault) || Fault <- Faults])),
    Given = [starl_run_manual_fault:fault(manual, {0, 0}, Fault) || Fault <- Faults],
    case {Named -- maps:keys(Specs), starl_run_manual_fault:refused(Host:world(), Given)} of
        {[], []} -> ok;
        {[Robot | _], _} -> {error, io_lib:format("there is no robot ~b", [Robot])};
        {[], [Why | _]} -> {error, Why}
    end.

inject_all([], State) ->
    {ok, State};
inject_all([Manual | More], #state{speed = Speed, faults = Faults} = State) ->
    {Fault, Named} = starl_world_faults:named(Manual, now_ms(State), Speed, Faults),
    Next = State#state{faults = Named},
    case possible(Fault, Next) of
        ok -> inject_rest(inject_now(Fault, Next), More);
        {error, _} = Error -> {Error, Next}
    end.

inject_rest({ok, State}, More) -> inject_all(More, State);
inject_rest({{error, _}, _} = Refused, _More) -> Refused.

%% The target of a random fault may be the leader of that moment.
inject_chaos(Random, #state{world = World} = State) ->
    #{leader := Leader} = starl_world:status(World),
    case starl_cluster_chaos:aimed(Random, Leader) of
        none ->
            State;
        Aimed ->
            logger:notice(#{what => chaos, act => Aimed}),
            {_, Next} = inject_manual([Aimed], State),
            Next
    end.

%% A node that is down cannot be halted, but may well stay down for longer.
inject_scheduled({_, _, _, Kind, _, _} = Fault, State) ->
    case possible(Fault, State) of
        {error, Why} when Kind =:= pause; Kind =:= store_full -> not_injected(Fault, Why, State);
        _ -> inject_planned(Fault, State)
    end.

inject_planned(Fault, State) ->
    case inject_now(Fault, State) of
        {ok, Next} -> Next;
        {{error, Why}, Next} -> not_injected(Fault, Why, Next)
    end.

not_injected(Fault, Why, State) ->
    Line = unicode:characters_to_binary(Why),
    logger:warning(#{what => fault_not_played, fault => Fault, why => Line}),
    State.

possible({_, From, To, _, _, _} = Fault, #state{host = Host, robots = Robots} = State) ->
    RealMs =
        case To of
            forever -> 0;
            _ -> real_ms(To - From, State)
        end,
    Host:check(Fault, RealMs, Robots).

%% The world may refuse it. A fault that could not be carried out is over, since the world has had the
%% report that it began.
inject_now(Fault, #state{faults = Faults} = State) ->
    {Reports, Effects, Next} = starl_world_faults:inject(Fault, now_ms(State), Faults),
    case report(Reports, State) of
        ok ->
            case effects(Effects, State#state{faults = Next}) of
                {ok, _} = Injected -> Injected;
                {{error, _} = Error, Begun} -> {Error, end_fault(element(1, Fault), Begun)}
            end;
        {error, _} = Error ->
            {Error, State}
    end.

end_fault(Id, #state{faults = Faults} = State) ->
    {Reports, Effects, Next} = starl_world_faults:end_fault(Id, now_ms(State), Faults),
    _ = report(Reports, State),
    {_, Ended} = effects(Effects, State#state{faults = Next}),
    Ended.

healed(all, #state{specs = Specs, host = Host, robots = Robots} = State) ->
    {Events, Released} = Host:release(Robots),
    Next = end_faults(all, happened(Events, State#state{robots = Released})),
    with_conditions(maps:keys(Specs), Next);
healed(What, State) ->
    end_faults(What, State).

end_faults(What, #state{faults = Faults} = State) ->
    lists:foldl(fun end_fault/2, State, starl_world_faults:healable(What, Faults)).

report([], _State) ->
    ok;
report([Report | More], #state{world = World} = State) ->
    case starl_world:fault(World, Report) of
        ok -> report(More, State);
        {error, _} = Error -> Error
    end.

%% -- effects --------------------------------------------------------------------------------

%% An error is the answer.
effects(Effects, State) ->
    lists:foldl(
        fun(Effect, {Answer, Before}) ->
            {Own, Next} = effect(Effect, Before),
            {lists:max([Answer, Own]), Next}
        end,
        {ok, State},
        Effects
    ).

-spec effect(starl_world_faults:effect(), #state{}) -> {answer(), #state{}}.
effect({kill, Id}, #state{host = Host, robots = Robots} = State) ->
    {ok, restart(Id, State#state{robots = Host:kill(Id, Robots)})};
effect({start, Id}, State) ->
    {ok, restart(Id, State)};
effect({dead, Id}, #state{world = World} = State) ->
    {starl_world:dead(World, Id), State};
effect({halt, Id, Ms, Moment, Fault}, #state{world = World, host = Host} = State) ->
    ok = starl_world:halt(World, Id, Fault),
    RealMs = max(1, round(real_ms(Ms, State))),
    {ok, State#state{robots = Host:halt(Id, RealMs, Moment, State#state.robots)}};
effect({machine, Id, Name}, #state{notices = Notices} = State) ->
    {ok, State#state{notices = [{kill_machine, Id, Name} | Notices]}};
effect({notify, Ids}, State) ->
    {ok, with_conditions(Ids, State)};
effect({due, AtMs, Id}, State) ->
    {at(AtMs, {end_fault, Id}, State), State};
effect({Disk, Id}, #state{host = Host, robots = Robots} = State) ->
    {Host:disk(Disk, Id, Robots), State}.

real_ms(Ms, #state{speed = Speed}) -> Ms / Speed.

with_conditions(Ids, #state{notices = Notices} = State) ->
    State#state{notices = [{conditions, Id} || Id <- Ids] ++ Notices}.

%% Robots are notified once a message, however much has changed for them.
notified(State) -> notified(fun(_Unheard) -> ok end, State).

notified(Done, #state{notices = Notices, host = Host, robots = Robots} = State) ->
    Full = [notice(Notice, State) || Notice <- lists:usort(Notices)],
    State#state{notices = [], robots = Host:notify(Full, Done, Robots)}.

notice({conditions, Id}, State) -> {Id, {conditions, links(Id, State), senses(Id, State)}};
notice({kill_machine, Id, Name}, _State) -> {Id, {kill_machine, Name}}.

links(Id, #state{speed = Speed, faults = Faults}) ->
    starl_world_faults:link_conditions(Id, Speed, Faults).

senses(Id, #state{faults = Faults}) -> starl_world_faults:senses(Id, Faults).

%% -- robots that start and end --------------------------------------------------------------

%% A fault may keep it down, or it runs already.
restart(Id, #state{host = Host, robots = Robots, faults = Faults} = State) ->
    IsRunning = Host:is_running(Id, Robots),
    case IsRunning orelse starl_world_faults:is_down(Id, now_ms(State), Faults) of
        true -> State;
        false -> restarted(Id, launch(Id, State))
    end.

restarted(_Id, {ok, State}) ->
    State;
restarted(Id, {{error, Why}, State}) ->
    Line = unicode:characters_to_binary(Why),
    logger:error(#{what => robot_not_started, robot => Id, why => Line}),
    happened([{down, Id}], State).

launch(Id, #state{specs = Specs, faults = Before, host = Host} = State) ->
    #{Id := Spec} = Specs,
    {Store, Faults} = starl_world_faults:take_store(Id, Before),
    ok = starl_world_setup:prepare_store(Store, Spec),
    Launch = #{
        spec => Spec, disk => disk(Id, Faults), air => links(Id, State), senses => senses(Id, State)
    },
    {Answer, Events, Robots} = Host:start(Id, Launch, State#state.robots),
    {Answer, happened(Events, State#state{faults = Faults, robots = Robots})}.

%% A disk that is full stays so.
disk(Id, Faults) ->
    case starl_world_faults:is_full(Id, Faults) of
        true -> fill;
        false -> clear
    end.

happened(Events, State) -> lists:foldl(fun event/2, State, Events).

-spec event(starl_world_host:event(), #state{}) -> #state{}.
event({up, Id}, #state{faults = Faults} = State) ->
    {Reports, Up} = starl_world_faults:up(Id, now_ms(State), Faults),
    ok = report(Reports, State),
    %% a fault may have begun, or ended, since the robot began to start
    with_conditions([Id], State#state{faults = Up});
event({renewed, Id}, State) ->
    with_conditions([Id], State);
event({down, Id}, State) ->
    _ = erlang:send_after(?AGAIN_MS, self(), {restart, Id}),
    State;
event({given_up, Id}, #state{world = World} = State) ->
    ok = starl_world:dead(World, Id),
    State;
event({halted, Id}, #state{world = World} = State) ->
    ok = starl_world:halted(World, Id),
    State;
event({resumed, Id}, #state{world = World} = State) ->
    ok = starl_world:resumed(World, Id),
    State;
event({hangs, Id}, #state{world = World, faults = Faults} = State) ->
    {Fault, Named} = starl_world_faults:unnamed("hang", Faults),
    ok = starl_world:halt(World, Id, Fault),
    ok = starl_world:halted(World, Id),
    State#state{faults = Named}.
