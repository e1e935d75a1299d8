%% @doc The link of a live robot drives its {@link starl_robot} in real time. It opens the robot's
%% store, record and ports, starts its machines, and then handles the packets, poses, answers of the
%% chassis and timers that arrive, one at a time. The rest of the driver's state is {@link
%% starl_live_driver}.
%% ```
%%   transport, positioning,        +--------------- link ----------------+
%%   chassis, senses, timers  ----> | waiting events --> starl_robot      | ----> ports
%%   reloads, marks                 |     (one at a time, when quiet)     |       (when a step is over)
%%                                  +-------------------------------------+
%%                                     order |  ^ actions     order |  ^ actions
%%                                           v  |                   v  |
%%                              processes of machines: all   a sequential application:
%%                              events wait for an answer    only its own events wait
%% '''
%% <em>The machines</em> run to completion, as in the simulator: while a machine's process is at
%% work, all other events wait. <em>A sequential application</em> works beside the link, since it
%% may compute for seconds. Its own events wait for it, and the other machines go on.
%%
%% <em>An old store.</em> If a peer has proved that the robot has had a later life than its store
%% knows, the link marks the store and ends.
%%
%% <em>Ends.</em> A crashed machine is restarted by its supervisor, and the link waits for that. The
%% link ends, and with it the whole robot, in three cases. The services have crashed too often, a
%% port of the robot (radio, positioning, chassis) ends, or the numbers of starts cannot be stored.
%% Then the chassis stops, and the supervisor above starts the robot anew, as after a reboot.
-module(starl_live_link).
-behaviour(gen_server).

-export([
    start_link/1,
    inspect/1,
    figures/1,
    metrics/1,
    port/2,
    reload/3,
    take_back/3,
    sense_faults/2,
    kill/2,
    mark/2
]).
-export([processes/1, at_work/1]).
-export([init/1, handle_continue/2, handle_call/3, handle_cast/2, handle_info/2]).

-export_type([spec/0, adapter/0, report/0]).

%% What drives a port of the robot: a module, and its own configuration.
-type adapter() :: {module(), map()}.

%% A robot: its machines ({@link starl_robot_services:tree()}), the seed of its team, which is the same
%% for all robots and all their starts ({@link starl_machine:config()}), its ports, the senses that are not its
%% chassis', its clock, the directory of
%% its store, and the process that gets the facts, if any; `record': whether the facts are also
%% written to a file there (false); `codes': the code of machines that have been reloaded;
%% `reporter': who is told about reloads; `packets': whether the sink is told of all packets;
%% `observe': who else is told everything, on this node. `robot_sup' is the supervisor under which
%% the machines' processes start. A simulation gives a robot ports that are open already, lets its
%% machines run inline, but for a sequential application, gives them their random streams, and may be
%% told each fact at once instead of at the end of its step (`tell').
-type spec() :: #{
    robot := starl:robot_id(),
    robot_sup := pid(),
    tree := starl_robot_services:tree(),
    team_seed := integer(),
    profile := starl_chassis:profile(),
    clock := starl_live_clock:t(),
    dir := starl_live_disk:place(),
    transport := adapter() | pid(),
    positioning := adapter() | pid(),
    chassis := adapter() | pid(),
    senses => #{starl_sense:kind() => adapter()},
    sink := pid() | none,
    record => boolean(),
    codes => starl_reload:codes(),
    reporter => pid(),
    packets => boolean(),
    observe => starl_observer:t(),
    inline => boolean(),
    random => starl_live_driver:random(),
    tell => step | at_once
}.

%% A message to the sink: the names of the robot's machines, when it starts, and the file of its
%% record; the trace events of its steps, batch by batch; what it knows of packets; the end of its
%% application.
-type report() ::
    {starl_started, starl:robot_id(), Link :: pid(), {
        [starl_machine:name()], file:filename() | none
    }}
    | {starl_traced, starl:robot_id(), Link :: pid(), starl_live_record:batch()}
    | {starl_radio, starl:robot_id(), [starl_monitor:trace_event()]}
    | {starl_ended, starl:robot_id(), Link :: pid(), given_up | {done, term()}}.

%% A specification whose ports are processes, with the store and the record.
-type opened() :: #{store := starl_live_store:t(), atom() => term()}.

%% An event that waits until the robot is quiet.
-type event() ::
    {event, starl_robot:local()}
    | {timer, starl_machine:name(), starl_robot_timers:timer(), starl_robot_timers:mark(), term()}
    | {acts, pid(), [starl_machine:action()]}
    | {reload, starl_reload:order(), pid()}
    | {take_back, starl_reload:count(), starl:robot_id()}
    | {mark, pid(), term()}.

%% Packets are dropped while more events wait.
-define(MOST_WAITING, 10000).
%% A timer that is not handled so long after it was due breaks the assumption of contracts, which is 250 ms.
-define(LATE_US, 200000).

-record(link, {
    robot :: starl_robot:t(),
    tree :: starl_robot_tree:t(),
    store :: starl_live_store:t(),
    clock :: starl_live_clock:t(),
    senses :: starl_live_sense_fault:t(),
    waiting = queue:new() :: queue:queue(event()),
    %% processes that work beside the link, or have just answered, with the orders that wait for them
    beside = #{} :: #{pid() => {at_work | idle, [starl_driver:order()]}},
    watch = starl_live_watch:new() :: starl_live_watch:t(),
    %% the number of events handled
    number = 0 :: non_neg_integer(),
    %% when timers were late last
    late_us = 0 :: integer()
}).

%% @doc Starts the link, its ports, and then the robot's machines.
-spec start_link(spec()) -> gen_server:start_ret().
start_link(Spec) -> gen_server:start_link(?MODULE, Spec, []).

%% @doc The machines of the robot, each with its state and data.
-spec inspect(pid()) -> #{starl_machine:name() => starl_robot_tree:seen()}.
inspect(Link) -> gen_server:call(Link, inspect).

%% @doc The counters of the robot.
-spec figures(pid()) -> starl_live_driver:figures().
figures(Link) -> gen_server:call(Link, figures).

%% @doc The counters of the robot since its link started, and its queues: for {@link
%% starl_live_counts:text/2}.
-spec metrics(pid()) -> {[starl_live_counts:gauge()], starl_live_counts:t()}.
metrics(Link) -> gen_server:call(Link, metrics).

%% @doc The process of one of the robot's ports.
-spec port(pid(), transport | positioning | chassis) -> pid().
port(Link, Port) -> gen_server:call(Link, {port, Port}).

%% @doc Gives the robot new code, whose modules are loaded. This process gets a report on how each
%% machine applies it: `{starl_reloaded, Robot, Machine, Result}' ({@link starl_reload:told()}).
-spec reload(pid(), starl_reload:order(), pid()) -> ok.
reload(Link, Order, Reporter) -> gen_server:cast(Link, {reload, Order, Reporter}).

%% @doc From now on the robot's senses have these faults, and no others.
-spec sense_faults(pid(), starl_live_sense_fault:faults()) -> ok.
sense_faults(Link, Faults) -> gen_server:cast(Link, {sense_faults, Faults}).

%% @doc Ends the process of a machine, as a crash does: its supervisor starts it anew.
-spec kill(pid(), starl_machine:name()) -> ok.
kill(Link, Name) -> gen_server:cast(Link, {kill, Name}).

%% @doc This process is sent `{starl_marked, Robot, Link, Mark}' behind all facts of what the robot has done until
%% now.
-spec mark(pid(), Mark :: term()) -> ok.
mark(Link, Mark) -> gen_server:cast(Link, {mark, self(), Mark}).

%% @doc The reload of this number has failed on that robot: this one goes back.
-spec take_back(pid(), starl_reload:count(), Failed :: starl:robot_id()) -> ok.
take_back(Link, N, Failed) -> gen_server:cast(Link, {take_back, N, Failed}).

%% @doc The processes of the robot's machines, for a simulation that holds the link's state.
-spec processes(#link{}) -> [pid()].
processes(Link) -> maps:keys(starl_robot_machines:processes(machines(Link))).

%% @doc Those of them that have an open order: what a simulation waits for.
-spec at_work(#link{}) -> [pid()].
at_work(#link{robot = Robot} = Link) ->
    [Pid || Pid <- [process(starl_robot:busy(Robot), Link)], is_pid(Pid)] ++ at_work_beside(Link).

at_work_beside(#link{beside = Beside}) ->
    [Pid || {Pid, {at_work, _}} <- maps:to_list(Beside)].

%% -- callbacks ------------------------------------------------------------------------------

-spec init(spec()) -> {ok, opened(), {continue, launch}} | {stop, term()}.
init(#{robot := Robot} = Spec) ->
    logger:set_process_metadata(#{domain => [starl, robot], robot => Robot}),
    case opened(Spec) of
        {ok, Opened} -> {ok, Opened, {continue, launch}};
        {stop, Reason} -> {stop, Reason}
    end.

-spec handle_continue(launch, opened()) -> {noreply, #link{}} | {stop, term(), opened()}.
handle_continue(launch, #{clock := Clock, store := Store} = Opened) ->
    case launched(Opened) of
        {ok, Robot, Tree} ->
            Link = #link{
                robot = Robot,
                tree = Tree,
                store = Store,
                clock = Clock,
                senses = starl_live_sense_fault:new(starl_robot:id(Robot))
            },
            ok = watch_later(Link),
            {noreply, went(starl_robot:run(Robot), Link)};
        {stop, Reason} ->
            {stop, Reason, Opened}
    end.

-spec handle_call(inspect | figures | metrics | {port, atom()}, gen_server:from(), #link{}) ->
    {reply, term(), #link{}}.
handle_call(inspect, _From, Link) ->
    {reply, starl_robot_tree:inspect(machines(Link)), Link};
handle_call(figures, _From, Link) ->
    {reply, starl_live_driver:figures(driver(Link)), Link};
handle_call({port, Port}, _From, Link) ->
    {reply, starl_live_driver:port(Port, driver(Link)), Link};
handle_call(metrics, _From, Link) ->
    Driver = starl_live_driver:at(driver(Link)),
    Counts = starl_live_driver:counts(Driver),
    Leases = starl_live_counts:leases(starl_live_driver:now_us(Driver), Counts),
    {reply, {gauges(Link) ++ Leases, Counts}, Link}.

%% The queues, the longest step, and the numbers of starts.
gauges(#link{waiting = Waiting, beside = Beside, watch = Watch} = Link) ->
    Starts = starl_robot_machines:starts(machines(Link)),
    Orders = lists:sum([length(Orders) || {_, Orders} <- maps:values(Beside)]),
    [
        {queue_events, [], queue:len(Waiting)},
        {queue_application, [], Orders},
        {step_seconds, [], starl_live_watch:longest_s(Watch)}
        | [{starts, [{machine, Name}], N} || {Name, N} <- maps:to_list(Starts)]
    ].

-spec handle_cast(term(), #link{}) -> {noreply, #link{}}.
handle_cast({reload, _Order, _Reporter} = Reload, Link) ->
    {noreply, waits(Reload, Link)};
handle_cast({take_back, _N, _Failed} = Back, Link) ->
    {noreply, waits(Back, Link)};
handle_cast({mark, _From, _Mark} = Mark, Link) ->
    {noreply, waits(Mark, Link)};
handle_cast({sense_faults, Faults}, #link{senses = Senses} = Link) ->
    {noreply, Link#link{senses = starl_live_sense_fault:set(Faults, Senses)}};
handle_cast({kill, Name}, Link) ->
    case process(Name, Link) of
        none -> ok;
        Pid -> true = exit(Pid, kill)
    end,
    {noreply, Link};
handle_cast(_Request, Link) ->
    {noreply, Link}.

-spec handle_info(term(), #link{}) -> {noreply, #link{}} | {stop, term(), #link{}}.
handle_info({starl_attach, _, Name, _} = Attach, Link) ->
    %% the end of its predecessor is on its way
    case process(Name, Link) of
        none ->
            {noreply, Link};
        Before ->
            self() ! Attach,
            receive
                {'DOWN', _, process, Before, Reason} -> down(Before, Reason, Link)
            end
    end;
handle_info({'DOWN', _, process, Pid, Reason}, Link) ->
    down(Pid, Reason, Link);
handle_info(watch, Link) ->
    ok = watch_later(Link),
    {noreply, watch(Link)};
handle_info({starl_done, _, Pid, Actions}, Link) ->
    {noreply, answered(Pid, Actions, Link)};
handle_info({timeout, _, {starl_timer, Name, Timer, Mark, Content}}, Link) ->
    {noreply, waits({timer, Name, Timer, Mark, Content}, Link)};
handle_info({starl_late, Owner}, Link) ->
    {noreply, late(Owner, Link)};
handle_info({starl_felt, From, {_, Kind, _} = Mark, Said}, #link{senses = Senses} = Link) ->
    {Felt, Next} = starl_live_sense_fault:felt(Kind, Said, Senses),
    {noreply, hear({starl_felt, From, Mark, Felt}, Link#link{senses = Next})};
handle_info(Message, Link) ->
    {noreply, hear(Message, Link)}.

%% -- launch ---------------------------------------------------------------------------------

%% Opens what is to be open before the machines start. The ports are linked to this process.
opened(#{dir := Dir} = Spec) ->
    case starl_live_store:open(Dir) of
        {ok, Store} -> recording(Spec#{store => Store});
        {error, Why} -> {stop, failure(store, Why)}
    end.

failure(Part, Why) -> {shutdown, {Part, unicode:characters_to_binary(Why)}}.

recording(#{record := true, dir := Dir} = Spec) ->
    case starl_live_record:open(Dir) of
        {ok, Record} -> ports([transport, positioning, chassis], Spec#{record := Record});
        {error, Why} -> {stop, failure(record, Why)}
    end;
recording(Spec) ->
    ports([transport, positioning, chassis], Spec#{record => none}).

ports([], Spec) ->
    senses(maps:to_list(maps:get(senses, Spec, #{})), Spec#{senses => #{}});
ports([Port | Ports], Spec) when is_pid(map_get(Port, Spec)) ->
    ports(Ports, Spec);
ports([Port | Ports], Spec) ->
    #{Port := {Module, Own}, robot := Robot, clock := Clock, tree := Tree, profile := P} = Spec,
    #{participants := Team} = Tree,
    Known = Own#{robot => Robot, participants => Team, clock => Clock, profile => P},
    case start_port(Port, Module, Known, Spec) of
        {ok, Pid} -> ports(Ports, Spec#{Port => Pid});
        {error, Reason} -> {stop, Reason}
    end.

start_port(transport, Module, Config, Spec) ->
    Reports = Config#{tell => starl_live_packet_reports:teller(Spec)},
    starl_live_transport:start_link(Module, Reports, self());
start_port(positioning, Module, Config, _Spec) ->
    starl_live_positioning:start_link(Module, Config, self());
start_port(chassis, Module, Config, _Spec) ->
    starl_live_chassis:start_link(Module, Config, self()).

senses([], Spec) ->
    {ok, Spec};
senses([{Kind, {Module, Own}} | Others], #{robot := Robot, clock := Clock, senses := Open} = Spec) ->
    case starl_live_sense:start_link(Module, Own#{robot => Robot, clock => Clock}, self()) of
        {ok, Pid} -> senses(Others, Spec#{senses := Open#{Kind => Pid}});
        {error, Reason} -> {stop, Reason}
    end.

%% Starts the machines, makes the numbers of their starts durable, and reports the start. The robot
%% has not run yet.
launched(#{robot := Id, robot_sup := Sup, tree := Tree, store := Store} = Spec) ->
    Driver = starl_live_driver:new(Spec#{
        participants => maps:get(participants, Tree), parts => starl_robot_services:parts(Tree)
    }),
    {Left, Inline} = inline(Tree#{services := services(Tree)}, Spec),
    Moment = starl_live_driver:moment(Driver),
    Start = start(Left, Id, Sup),
    Before = starl_live_store:starts(Store),
    {Processes, Machines} = starl_robot_tree:resume(Id, Start, Inline, Moment, Before),
    case starl_live_store:started(starl_robot_machines:starts(Machines), Store) of
        ok -> {ok, started(Spec, Driver, Machines), Processes};
        {error, Why} -> {stop, failure(store, Why)}
    end.

inline(Tree, #{inline := true}) -> starl_robot_services:inline(Tree);
inline(Tree, _Spec) -> {Tree, #{}}.

%% Starts the machines that are processes.
start(none, _Id, _Sup) ->
    none;
start(Tree, Id, Sup) ->
    Robot = Tree#{id => Id, driver => self()},
    fun() ->
        {ok, Machines} = starl_live_robot:start_machines(Sup, Robot),
        _ = erlang:monitor(process, Machines),
        {Machines, starl_robot_sup:parts(Machines)}
    end.

%% The positioning process itself finds a source that is stuck ({@link starl_live_positioning}); a
%% rounded pose of a robot that stands repeats itself rightly.
services(#{services := Services}) ->
    [
        case Service of
            {location, Module, Config} -> {location, Module, Config#{exact => true}};
            _ -> Service
        end
     || Service <- Services
    ].

started(#{robot := Id, store := Store} = Spec, Driver, Machines) ->
    Names = starl_robot_machines:names(Machines),
    ok = report_start(Names, Spec),
    ok = starl_live_driver:report_start(Names, Driver),
    %% a robot that has run before comes up after a reboot
    Up =
        case starl_live_store:life(Store) of
            first -> Driver;
            later -> starl_live_driver:trace(robot, up, Driver)
        end,
    starl_robot:new(Id, starl_live_driver, Up, Machines).

report_start(_Names, #{sink := none}) ->
    ok;
report_start(Names, #{robot := Id, sink := Sink, record := Record}) ->
    File =
        case Record of
            none -> none;
            _ -> starl_live_record:file(Record)
        end,
    Sink ! {starl_started, Id, self(), {Names, File}},
    ok.

%% -- what comes -----------------------------------------------------------------------------

%% A process has answered with its machine's actions.
answered(Pid, Actions, #link{beside = Beside} = Link) when is_map_key(Pid, Beside) ->
    waits({acts, Pid, Actions}, Link);
answered(Pid, Actions, #link{robot = Robot} = Link) ->
    case starl_robot:answered(Pid, Actions, Robot) of
        ignored -> Link;
        Turn -> went(Turn, Link)
    end.

%% A port was too late with what a machine has sent.
late({Name, Mark}, #link{robot = Robot} = Link) ->
    go_on(Link#link{robot = starl_robot:first([{Name, info, {late, Mark}}], Robot)}).

%% A message of the robot's ports, or an unknown one. Packets may be lost; other events are few.
hear(Message, #link{waiting = Waiting} = Link) ->
    case starl_live_driver:hear(Message, driver(Link)) of
        unknown ->
            Link;
        [{sap, packet, _} | _] = Packets ->
            case queue:len(Waiting) > ?MOST_WAITING of
                true -> Link;
                false -> all_wait(Packets, Link)
            end;
        Events ->
            all_wait(Events, Link)
    end.

all_wait(Events, Link) ->
    lists:foldl(fun(Event, L) -> waits({event, Event}, L) end, Link, Events).

waits(Event, #link{waiting = Waiting} = Link) ->
    work(Link#link{waiting = queue:in(Event, Waiting)}).

%% -- one event at a time --------------------------------------------------------------------

%% Handles the next event, if the robot is quiet.
work(#link{robot = Robot, waiting = Waiting} = Link) ->
    case starl_robot:busy(Robot) =:= none andalso queue:out(Waiting) of
        false -> Link;
        {empty, _} -> Link;
        {{value, Event}, Left} -> handle(Event, Link#link{waiting = Left})
    end.

handle({event, {Name, Type, Content}}, Link) ->
    {Driver, #link{robot = Robot} = Now} = at_event(Link),
    Noted = starl_live_driver:handles(Name, Type, Content, Driver),
    went(starl_robot:event(Name, Type, Content, Noted, Robot), Now);
handle({reload, Order, Reporter}, Link) ->
    {Driver, Now} = at_event(Link),
    {Commands, Next} = starl_live_driver:reload(Order, Reporter, Driver),
    command(Commands, Next, Now);
handle({take_back, N, Failed}, Link) ->
    {Driver, Now} = at_event(Link),
    {Commands, Next} = starl_live_driver:take_back(N, Failed, Driver),
    command(Commands, Next, Now);
handle({timer, Name, Timer, Mark, Content}, #link{robot = Robot} = Link) ->
    case starl_robot:expire(Name, Timer, Mark, Robot) of
        {ok, Type, Left} ->
            {Driver, Now} = at_event(Link),
            Noted = starl_live_driver:handles(Name, Type, Content, Driver),
            went(starl_robot:fire(Name, Type, Content, Noted, Left, Now#link.robot), Now);
        stale ->
            work(Link)
    end;
handle({mark, From, Mark}, #link{robot = Robot} = Link) ->
    From ! {starl_marked, starl_robot:id(Robot), self(), Mark},
    work(Link);
handle({acts, Pid, Actions}, Link) ->
    acted(Pid, Actions, Link).

acted(Pid, Actions, #link{beside = Beside} = Link) ->
    case {Beside, starl_robot_machines:name_of(Pid, machines(Link))} of
        {#{Pid := {_, Orders}}, {ok, Name}} ->
            {Driver, #link{robot = Robot, watch = Watch} = Now} = at_event(Link),
            Idle = Now#link{
                beside = Beside#{Pid := {idle, Orders}},
                watch = starl_live_watch:answered(Pid, Watch)
            },
            Valid = starl_robot:without_calls(starl_driver:restarted(Orders), Actions),
            went(starl_robot:act(Name, Valid, Driver, Robot), Idle);
        _ ->
            work(Link)
    end.

%% The robot's machines get these commands on new code.
command(Commands, Driver, #link{robot = Robot} = Link) ->
    Machines = starl_robot:machines(Robot),
    {There, Gone} = lists:partition(
        fun({Name, _}) -> starl_robot_machines:has(Name, Machines) end, Commands
    ),
    Next = lists:foldl(fun({Name, C}, D) -> starl_live_driver:gone(Name, C, D) end, Driver, Gone),
    Local = [{Name, code, Command} || {Name, Command} <- There],
    went(starl_robot:run(starl_robot:then(Local, starl_robot:world(Next, Robot))), Link).

%% The driver's state at an event. A timer that should have been handled long ago shows that the
%% computer was late; one trace event speaks for all timers that were due in that time.
at_event(#link{robot = Robot, number = N, late_us = Before} = Link) ->
    Marks = starl_robot_timers:marks(starl_robot:timers(Robot)),
    {Due, Driver} = starl_live_driver:due_us(Marks, starl_live_driver:at(driver(Link))),
    computer_late(max(Due, Before), Driver, Link#link{number = N + 1}).

computer_late(Since, Driver, Link) ->
    case starl_live_driver:now_us(Driver) of
        Now when Now - Since > ?LATE_US ->
            ok = warn_late(),
            {starl_live_driver:trace(robot, {late, Since, Now}, Driver), Link#link{late_us = Now}};
        _Now ->
            {Driver, Link}
    end.

warn_late() ->
    Why = io_lib:format("its computer was late by more than ~b ms", [?LATE_US div 1000]),
    starl_live_log:of_machine(warning, late, robot, Why).

%% The result of an event, with all that followed from it.
went({quiet, Robot}, Link) ->
    next(flushed(Robot, Link));
went({ask, Pid, Order, Robot}, #link{beside = Beside} = Link) ->
    case {starl_robot:busy(Robot), Beside} of
        {_, #{Pid := {How, Orders}}} ->
            Kept = Link#link{beside = Beside#{Pid => {How, Orders ++ [Order]}}},
            went(starl_robot:leave(Robot), Kept);
        {app, _} ->
            %% what is known of a grant leaves before the application can act on it
            Flushed = flushed(Robot, Link),
            Pid ! Order,
            Left = Flushed#link{beside = Beside#{Pid => {at_work, []}}},
            went(starl_robot:leave(Left#link.robot), Left);
        _ ->
            ask(Pid, Order, starl_live_driver:flush(starl_robot:world(Robot)), Robot, Link)
    end;
went({crashed, Name, Reason, Robot}, Link) ->
    Flushed = flushed(Robot, Link),
    {ok, _Killed} = starl_robot_tree:kill(Name, machines(Flushed)),
    case crashed(Name, Reason, Flushed) of
        {ok, Next} -> go_on(Next);
        {gave_up, _} -> exit({shutdown, gave_up})
    end.

%% If something was late then that comes first, also for the machine of this order.
ask(Pid, Order, {[], Driver}, Robot, Link) ->
    Pid ! Order,
    Link#link{robot = starl_robot:world(Driver, Robot)};
ask(_Pid, Order, {[_ | _] = Late, Driver}, Robot, Link) ->
    Waits = starl_robot:put_off(Order, starl_robot:world(Driver, Robot)),
    went(starl_robot:run(starl_robot:first(Late, Waits)), Link).

%% A machine learns that something of its step was late before it handles anything else.
flushed(Robot, Link) ->
    {Late, Driver} = starl_live_driver:flush(starl_robot:world(Robot)),
    Link#link{robot = starl_robot:first(Late, starl_robot:world(Driver, Robot))}.

next(#link{robot = Robot} = Link) ->
    case starl_robot:status(Robot) of
        {busy, _} -> went(starl_robot:run(Robot), Link);
        {_, _} -> work(order_next(Link))
    end.

%% Processes that have answered get their next order.
order_next(#link{beside = Beside} = Link) when map_size(Beside) =:= 0 -> Link;
order_next(#link{beside = Beside, robot = Robot} = Link) ->
    Driver = starl_live_driver:at(driver(Link)),
    Now = starl_live_driver:now_us(Driver),
    Next = maps:filtermap(fun(Pid, Work) -> ordered(Pid, Work, Now) end, Beside),
    Link#link{beside = Next, robot = starl_robot:world(Driver, Robot)}.

ordered(_Pid, {at_work, _}, _Now) ->
    true;
ordered(_Pid, {idle, []}, _Now) ->
    false;
ordered(Pid, {idle, [Order | Orders]}, Now) ->
    Pid ! starl_driver:later(Now, Order),
    {true, {at_work, Orders}}.

go_on(#link{robot = Robot} = Link) ->
    case starl_robot:busy(Robot) of
        none -> went(starl_robot:run(Robot), Link);
        _ -> flushed(Robot, Link)
    end.

%% -- the watchdog ---------------------------------------------------------------------------

watch_later(#link{clock = Clock}) ->
    _ = starl_live_clock:send_after(starl_live_watch:period_ms(), watch, Clock),
    ok.

%% Kills a process that does not answer: its supervisor starts it anew.
watch(#link{robot = Robot, number = N, watch = Before} = Link) ->
    Busy = starl_robot:busy(Robot),
    Beside = [{Pid, name(Pid, Link)} || Pid <- at_work_beside(Link)],
    {Do, Watch} = starl_live_watch:look({N, Busy}, Beside, Before),
    _ = Do =:= kill andalso exit(process(Busy, Link), kill),
    Link#link{watch = Watch}.

name(Pid, Link) ->
    {ok, Name} = starl_robot_machines:name_of(Pid, machines(Link)),
    Name.

%% -- crashes --------------------------------------------------------------------------------

%% A process has ended.
down(Pid, Reason, #link{tree = Tree} = Link) ->
    case starl_robot_machines:name_of(Pid, machines(Link)) of
        {ok, Name} ->
            case crashed(Name, Reason, Link) of
                {ok, Next} -> {noreply, go_on(Next)};
                {gave_up, Last} -> {stop, {shutdown, gave_up}, Last}
            end;
        none ->
            case starl_robot_tree:supervisor(Tree) of
                Pid -> {stop, {shutdown, gave_up}, Link};
                _ -> {noreply, Link}
            end
    end.

%% The link waits until the machine has been restarted, or given up. The failure of new code is
%% reported also by a link that ends with it.
crashed(Name, Reason, #link{robot = Robot, tree = Tree} = Link) ->
    Gone = process(Name, Link),
    Driver = starl_live_driver:at(driver(Link)),
    Judged = starl_live_driver:crashed(Name, starl_crash:cause(Reason), Driver),
    Bare = starl_robot:lost(Name, Reason, starl_robot:world(Judged, Robot)),
    ok = log_crash(Name, starl_crash:cause(Reason)),
    case starl_robot_tree:restart(Name, starl_robot:machines(Bare), Tree) of
        {ok, Restarted, Machines} -> restarted(Restarted, Machines, Gone, Bare, Link);
        gave_up -> {gave_up, flushed(Bare, Link)}
    end.

log_crash(_Name, none) ->
    ok;
log_crash(Name, Cause) ->
    starl_live_log:of_machine(error, crashed, Name, starl_crash:format(Cause)).

restarted(#{back := Back, given_up := GivenUp, lost := Lost}, Machines, Gone, Bare, Link) ->
    #link{store = Store, beside = Beside} = Link,
    case starl_live_store:started(starl_robot_machines:starts(Machines), Store) of
        ok ->
            Left = lists:foldr(fun({N, R}, B) -> starl_robot:lost(N, R, B) end, Bare, Lost),
            Robot = starl_robot:back(Back, GivenUp, starl_robot:machines(Machines, Left)),
            {ok, Link#link{robot = Robot, beside = maps:remove(Gone, Beside)}};
        {error, _} ->
            {gave_up, flushed(Bare, Link)}
    end.

%% -- parts of the state ---------------------------------------------------------------------

driver(#link{robot = Robot}) -> starl_robot:world(Robot).

machines(#link{robot = Robot}) -> starl_robot:machines(Robot).

%% The process of a machine, if it is one.
process(Name, Link) -> starl_robot_machines:process(Name, machines(Link)).
