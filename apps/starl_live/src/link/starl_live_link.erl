%% @doc The link of a live robot: drives its {@link starl_robot} in real time. It hands the packets,
%% poses, answers of the chassis and timers that arrive to the robot's machines, one at a time.
%%
%% <em>The machines</em> run to completion, as in the simulator: while a machine's process is at work
%% all other events wait. <em>A sequential application</em> works beside the link, since it may
%% compute for seconds: its events wait for it, and the other machines go on.
%%
%% <em>An old store.</em> When a peer has proved that the robot has lived later than its store knows, the
%% store is marked, and the link ends.
%%
%% <em>Ends.</em> A crashed machine is restarted by its supervisor, and the link waits for that. When
%% the services have crashed too often, when a line of the robot (radio, positioning, chassis) ends,
%% or when the numbers of starts cannot be stored, the link ends, and with it the whole robot: the
%% chassis stops. The supervisor above then starts the robot anew, as after a reboot.
-module(starl_live_link).
-behaviour(gen_server).

-export([
    start_link/1,
    inspect/1,
    figures/1,
    metrics/1,
    line/2,
    reload/3,
    take_back/3,
    sense_faults/2,
    kill/2
]).
-export([processes/1, at_work/1]).
-export([init/1, handle_continue/2, handle_call/3, handle_cast/2, handle_info/2]).

-export_type([spec/0, line/0, told/0]).

%% A line of the robot: the module of its driver, and the driver's own configuration.
-type line() :: {module(), map()}.

%% A robot: its machines ({@link starl_robot_crew:tree()}), the seed of its team, which is the same
%% for all robots and all their starts ({@link starl_machine:config()}), its lines, the senses that are not its
%% chassis', its clock, the directory of
%% its store, and the process that gets the facts, if any; `record': whether the facts are also
%% written to a file there (false); `codes': the code of machines that have been reloaded;
%% `reporter': who is told about reloads; `packets': whether the sink is told of all packets;
%% `observe': who else is told everything, on this node. `robot_sup' is the supervisor under which
%% the machines' processes start. A simulation gives a robot lines that are open already, lets its
%% machines run inline, but for a sequential application, gives them their random streams, and may be
%% told each fact at once instead of at the end of its step (`tell').
-type spec() :: #{
    robot := starl:robot_id(),
    robot_sup := pid(),
    tree := starl_robot_crew:tree(),
    team_seed := integer(),
    profile := starl_chassis:profile(),
    clock := starl_live_clock:t(),
    dir := starl_live_disk:place(),
    transport := line() | pid(),
    positioning := line() | pid(),
    chassis := line() | pid(),
    senses => #{starl_sense:kind() => line()},
    sink := pid() | none,
    record => boolean(),
    codes => starl_reload:codes(),
    reporter => pid(),
    packets => boolean(),
    observe => starl_observer:t(),
    inline => boolean(),
    %% a snapshot of the robot is told this often, and all that comes to it
    snapshots_us => pos_integer() | none,
    random => starl_live_body:random(),
    tell => step | at_once
}.

%% A message to the sink: the names of the robot's machines, when it starts, and the file of its
%% record; the facts of its steps,
%% batch by batch; what it knows of packets; the end of its application.
-type told() ::
    {starl_started, starl:robot_id(), Link :: pid(), {
        [starl_machine:name()], file:filename() | none
    }}
    | {starl_traced, starl:robot_id(), Link :: pid(), starl_live_record:batch()}
    | {starl_radio, starl:robot_id(), [starl_monitor:trace_event()]}
    | {starl_ended, starl:robot_id(), Link :: pid(), given_up | {done, term()}}.

%% The period in which the link looks for a process that does not answer, and packets that may wait.
-define(WATCH_MS, 5000).
%% After this many watches in one step, an application is told of.
-define(LONG_STEP, 3).
-define(MOST_WAITING, 10000).
%% A timer that is not handled so long after it was due breaks the assumption of contracts, which is 250 ms.
-define(LATE_US, 200000).

%% An event that waits for its turn.
-type event() ::
    {event, starl_robot:local()}
    | {timer, starl_machine:name(), starl_robot_timers:timer(), starl_robot_timers:mark(), term()}
    | {acts, pid(), [starl_machine:action()]}
    | {reload, starl_reload:order(), pid()}
    | {take_back, starl_reload:count(), starl:robot_id()}.

-record(link, {
    id :: starl:robot_id(),
    clock :: starl_live_clock:t(),
    robot :: starl_robot:t(),
    senses :: starl_live_sense_fault:t(),
    tree :: starl_robot_tree:t(),
    %% the supervisor of the machines' processes
    machines_sup :: pid() | none,
    waiting = queue:new() :: queue:queue(event()),
    %% processes that work beside the link, or have just answered, with the orders that wait for them
    beside = #{} :: #{pid() => {at_work | idle, [starl_driver:order()]}},
    %% those that were at work at the last watches, on the same order, and at how many
    long = #{} :: #{pid() => pos_integer()},
    %% the number of turns, and what it was at the last watch, if a process was at work then
    turns = 0 :: non_neg_integer(),
    %% the period of snapshots, and is one due?
    snapshots = none :: pos_integer() | none,
    is_due = false :: boolean(),
    %% when timers were late last
    late_us = 0 :: integer(),
    watched = none :: non_neg_integer() | none
}).

%% @doc Starts the link, its lines, and then the robot's machines.
-spec start_link(spec()) -> gen_server:start_ret().
start_link(Spec) -> gen_server:start_link(?MODULE, Spec, []).

%% @doc The machines of the robot, each with its state and data.
-spec inspect(pid()) -> #{starl_machine:name() => starl_robot_tree:seen()}.
inspect(Link) -> gen_server:call(Link, inspect).

%% @doc The counters of the robot.
-spec figures(pid()) -> starl_live_body:figures().
figures(Link) -> gen_server:call(Link, figures).

%% @doc The counters of the robot since its link started, and its queues: for {@link
%% starl_live_counts:text/2}.
-spec metrics(pid()) -> {[starl_live_counts:gauge()], starl_live_counts:t()}.
metrics(Link) -> gen_server:call(Link, metrics).

%% @doc The process of one of the robot's lines.
-spec line(pid(), transport | positioning | chassis) -> pid().
line(Link, Line) -> gen_server:call(Link, {line, Line}).

%% @doc Gives the robot new code, whose modules are loaded. This process is told how each machine
%% heeds it: `{starl_reloaded, Robot, Machine, Told}' ({@link starl_reload:told()}).
-spec reload(pid(), starl_reload:order(), pid()) -> ok.
reload(Link, Order, Reporter) -> gen_server:cast(Link, {reload, Order, Reporter}).

%% @doc From now on the robot's senses have these faults, and no others.
-spec sense_faults(pid(), starl_live_sense_fault:faults()) -> ok.
sense_faults(Link, Faults) -> gen_server:cast(Link, {sense_faults, Faults}).

%% @doc Ends the process of a machine, as a crash does: its supervisor starts it anew.
-spec kill(pid(), starl_machine:name()) -> ok.
kill(Link, Name) -> gen_server:cast(Link, {kill, Name}).

%% @doc The reload of this number has failed on that robot: this one goes back.
-spec take_back(pid(), starl_reload:count(), Failed :: starl:robot_id()) -> ok.
take_back(Link, N, Failed) -> gen_server:cast(Link, {take_back, N, Failed}).

%% @doc The processes of the robot's machines, for a simulation that holds the link's state.
-spec processes(#link{}) -> [pid()].
processes(Link) -> maps:keys(starl_robot_machines:processes(machines(Link))).

%% @doc Those of them that have an open order: what a simulation waits for.
-spec at_work(#link{}) -> [pid()].
at_work(#link{robot = Robot, beside = Beside} = Link) ->
    Busy = starl_robot_machines:process(starl_robot:busy(Robot), machines(Link)),
    [Pid || Pid <- [Busy], is_pid(Pid)] ++ [Pid || {Pid, {at_work, _}} <- maps:to_list(Beside)].

-spec init(spec()) -> {ok, map(), {continue, launch}} | {stop, term()}.
init(#{robot := Robot, dir := Dir} = Spec) ->
    logger:set_process_metadata(#{domain => [starl, robot], robot => Robot}),
    case starl_live_store:open(Dir) of
        {ok, Store} -> recording(Spec#{store => Store});
        {error, Why} -> {stop, {shutdown, {store, unicode:characters_to_binary(Why)}}}
    end.

recording(#{record := true, dir := Dir} = Spec) ->
    case starl_live_record:open(Dir) of
        {ok, Record} -> lines([transport, positioning, chassis], Spec#{record := Record});
        {error, Why} -> {stop, {shutdown, {record, unicode:characters_to_binary(Why)}}}
    end;
recording(Spec) ->
    lines([transport, positioning, chassis], Spec#{record => none}).

lines([], Spec) ->
    senses(maps:to_list(maps:get(senses, Spec, #{})), Spec#{senses => #{}});
lines([Line | Lines], Spec) when is_pid(map_get(Line, Spec)) ->
    lines(Lines, Spec);
lines([Line | Lines], Spec) ->
    #{Line := {Module, Own}, robot := Robot, clock := Clock, tree := Tree, profile := P} = Spec,
    #{participants := Team} = Tree,
    Known = Own#{robot => Robot, participants => Team, clock => Clock, profile => P},
    Config = with_radio(Line, Known, Spec),
    case (process(Line)):start_link(Module, Config, self()) of
        {ok, Pid} -> lines(Lines, Spec#{Line => Pid});
        {error, Reason} -> {stop, Reason}
    end.

senses([], Spec) ->
    {ok, Spec, {continue, launch}};
senses([{Kind, {Module, Own}} | Others], #{robot := Robot, clock := Clock, senses := Open} = Spec) ->
    case starl_live_sense:start_link(Module, Own#{robot => Robot, clock => Clock}, self()) of
        {ok, Pid} -> senses(Others, Spec#{senses := Open#{Kind => Pid}});
        {error, Reason} -> {stop, Reason}
    end.

with_radio(transport, Config, Spec) -> Config#{tell => starl_live_packet_reports:teller(Spec)};
with_radio(_Line, Config, _Spec) -> Config.

process(transport) -> starl_live_transport;
process(positioning) -> starl_live_positioning;
process(chassis) -> starl_live_chassis.

-spec handle_continue(launch, map()) -> {noreply, #link{}} | {stop, term(), map()}.
handle_continue(launch, #{robot := Id, robot_sup := Sup, tree := Tree} = Spec) ->
    Body = starl_live_body:new(Spec#{
        participants => maps:get(participants, Tree), parts => starl_robot_crew:parts(Tree)
    }),
    Before = starl_live_body:starts(Body),
    {Left, Inline} = inline(Tree#{services := services(Tree)}, Spec),
    Moment = starl_live_body:moment(Body),
    Start = start(Left, Id, Sup),
    {Processes, Machines} = starl_robot_tree:resume(Id, Start, Inline, Moment, Before),
    case starl_live_body:started(starl_robot_machines:starts(Machines), Body) of
        ok -> launched(Spec, Body, Processes, Machines);
        {error, Why} -> {stop, {shutdown, {store, unicode:characters_to_binary(Why)}}, Spec}
    end.

inline(Tree, #{inline := true}) -> starl_robot_crew:inline(Tree);
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

launched(#{robot := Id, clock := Clock} = Spec, Body, Processes, Machines) ->
    _ = starl_live_clock:send_after(?WATCH_MS, watch, Clock),
    Names = starl_robot_machines:names(Machines),
    ok = tell_start(Names, Spec),
    ok = starl_live_body:tell_start(Names, Body),
    %% a robot that has run before comes up after a reboot
    Up =
        case starl_live_body:life(Body) of
            first -> Body;
            later -> starl_live_body:trace(robot, up, Body)
        end,
    Robot = starl_robot:new(Id, starl_live_body, Up, Machines),
    Link = #link{
        id = Id,
        clock = Clock,
        robot = Robot,
        senses = starl_live_sense_fault:new(Id),
        tree = Processes,
        machines_sup = starl_robot_tree:supervisor(Processes),
        snapshots = maps:get(snapshots_us, Spec, none)
    },
    ok = due_later(Link),
    {noreply, went(starl_robot:run(Robot), Link)}.

%% By the run's clock, so that all robots tell theirs at about the same time.
due_later(#link{snapshots = none}) ->
    ok;
due_later(#link{snapshots = Us, clock = Clock}) ->
    Now = starl_live_clock:now_us(Clock),
    Ms = starl_live_clock:monotonic_ms((Now div Us + 1) * Us, Clock),
    _ = starl_live_clock:start_timer(Ms, snapshot, [{abs, true}], Clock),
    ok.

tell_start(_Names, #{sink := none}) ->
    ok;
tell_start(Names, #{robot := Id, sink := Sink, record := Record}) ->
    File =
        case Record of
            none -> none;
            _ -> starl_live_record:file(Record)
        end,
    Sink ! {starl_started, Id, self(), {Names, File}},
    ok.

-spec handle_call(inspect | figures | metrics | {line, atom()}, gen_server:from(), #link{}) ->
    {reply, term(), #link{}}.
handle_call(metrics, _From, #link{robot = Robot} = Link) ->
    Body = starl_live_body:at(event, starl_robot:world(Robot)),
    Counts = starl_live_body:counts(Body),
    Leases = starl_live_counts:leases(starl_live_body:now_us(Body), Counts),
    {reply, {gauges(Link) ++ Leases, Counts}, Link};
handle_call({line, Line}, _From, #link{robot = Robot} = Link) ->
    {reply, starl_live_body:line(Line, starl_robot:world(Robot)), Link};
handle_call(inspect, _From, #link{robot = Robot} = Link) ->
    {reply, starl_robot_tree:inspect(starl_robot:machines(Robot)), Link};
handle_call(figures, _From, #link{robot = Robot} = Link) ->
    {reply, starl_live_body:figures(starl_robot:world(Robot)), Link}.

gauges(#link{waiting = Waiting, beside = Beside, long = Long} = Link) ->
    Starts = starl_robot_machines:starts(machines(Link)),
    Orders = lists:sum([length(Orders) || {_, Orders} <- maps:values(Beside)]),
    [
        {queue_events, [], queue:len(Waiting)},
        {queue_application, [], Orders},
        {step_seconds, [], lists:max([0 | [watched_s(N) || N <- maps:values(Long)]])}
        | [{starts, [{machine, Name}], N} || {Name, N} <- maps:to_list(Starts)]
    ].

-spec handle_cast(term(), #link{}) -> {noreply, #link{}}.
handle_cast({reload, _Order, _Reporter} = Reload, Link) ->
    {noreply, waits(Reload, Link)};
handle_cast({take_back, _N, _Failed} = Back, Link) ->
    {noreply, waits(Back, Link)};
handle_cast({sense_faults, Faults}, #link{senses = Senses} = Link) ->
    {noreply, Link#link{senses = starl_live_sense_fault:set(Faults, Senses)}};
handle_cast({kill, Name}, Link) ->
    case starl_robot_machines:process(Name, machines(Link)) of
        none -> ok;
        Pid -> true = exit(Pid, kill)
    end,
    {noreply, Link};
handle_cast(_Request, Link) ->
    {noreply, Link}.

-spec handle_info(term(), #link{}) -> {noreply, #link{}} | {stop, term(), #link{}}.
handle_info({starl_done, _, Pid, Actions}, #link{beside = Beside} = Link) when
    is_map_key(Pid, Beside)
->
    {noreply, waits({acts, Pid, Actions}, Link)};
handle_info({starl_done, _, Pid, Actions}, #link{robot = Robot} = Link) ->
    case starl_robot:answered(Pid, Actions, Robot) of
        ignored -> {noreply, Link};
        Turn -> {noreply, went(Turn, Link)}
    end;
handle_info({timeout, _, snapshot}, Link) ->
    ok = due_later(Link),
    {noreply, work(Link#link{is_due = true})};
handle_info({timeout, _, {starl_timer, Name, Timer, Mark, Content}}, Link) ->
    {noreply, waits({timer, Name, Timer, Mark, Content}, Link)};
handle_info({starl_attach, _, Name, _} = Attach, #link{robot = Robot} = Link) ->
    %% the end of its predecessor is on its way
    case starl_robot_machines:process(Name, starl_robot:machines(Robot)) of
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
handle_info(watch, #link{clock = Clock} = Link) ->
    _ = starl_live_clock:send_after(?WATCH_MS, watch, Clock),
    {noreply, watch(long_steps(Link))};
handle_info({starl_late, {Name, Mark}}, Link0) ->
    #link{robot = Robot} = Link = input({other, late}, Link0),
    {noreply, go_on(Link#link{robot = starl_robot:first([{Name, info, {late, Mark}}], Robot)})};
handle_info({starl_felt, From, {_, Kind, _} = Mark, Said}, #link{senses = Senses} = Link) ->
    {Felt, Next} = starl_live_sense_fault:felt(Kind, Said, Senses),
    line_says({starl_felt, From, Mark, Felt}, Link#link{senses = Next});
handle_info(Message, Link) ->
    line_says(Message, Link).

line_says(Message, #link{robot = Robot} = Link) ->
    case starl_live_body:hear(Message, starl_robot:world(Robot)) of
        unknown -> {noreply, Link};
        Events -> {noreply, heard(Events, Link)}
    end.

%% Packets may be lost; other events are few.
heard([{sap, packet, _} | _] = Packets, #link{waiting = Waiting} = Link) ->
    case queue:len(Waiting) > ?MOST_WAITING of
        true -> Link;
        false -> all_wait(Packets, Link)
    end;
heard(Events, Link) ->
    all_wait(Events, Link).

all_wait(Events, Link) ->
    lists:foldl(fun(Event, L) -> waits({event, Event}, L) end, Link, Events).

waits(Event, #link{waiting = Waiting} = Link) ->
    work(Link#link{waiting = queue:in(Event, Waiting)}).

%% -- turns ----------------------------------------------------------------------------------

%% Handles the next event, if the robot is quiet.
work(#link{robot = Robot, waiting = Waiting} = Link) ->
    case starl_robot:busy(Robot) =:= none andalso queue:out(Waiting) of
        false -> Link;
        _ when Link#link.is_due -> work(pictured(Link#link{is_due = false}));
        {empty, _} -> Link;
        {{value, Event}, Left} -> handle(Event, Link#link{waiting = Left})
    end.

%% The robot is quiet. An application that computes is asked another time.
pictured(#link{robot = Robot, beside = Beside} = Link) ->
    Machines = starl_robot:machines(Robot),
    Told =
        case map_size(Beside) =:= 0 andalso starl_robot_tree:snapshot(Machines) of
            false -> {error, at_work};
            {ok, Kept} -> {ok, {Kept, starl_robot:parts(Robot)}};
            {error, _} = Error -> Error
        end,
    Body = starl_live_body:snapshot(Told, starl_live_body:at(event, starl_robot:world(Robot))),
    flushed(starl_robot:world(Body, Robot), Link).

input(Input, #link{robot = Robot} = Link) ->
    Link#link{
        robot = starl_robot:world(starl_live_body:input(Input, starl_robot:world(Robot)), Robot)
    }.

handle({event, {Name, Type, Content}}, Link) ->
    {Body0, #link{robot = Robot} = Now} = at_event(Link),
    Body = starl_live_body:input({event, Name, Type, Content}, Body0),
    Noted = starl_live_body:handles(Name, Type, Content, Body),
    went(starl_robot:event(Name, Type, Content, Noted, Robot), Now);
handle({reload, Order, Reporter}, Link) ->
    {Body, Now} = at_event(input({other, reload}, Link)),
    {Words, Next} = starl_live_body:reload(Order, Reporter, Body),
    heeded(Words, Next, Now);
handle({take_back, N, Failed}, Link) ->
    {Body, Now} = at_event(input({other, reload}, Link)),
    {Words, Next} = starl_live_body:take_back(N, Failed, Body),
    heeded(Words, Next, Now);
handle({timer, Name, Timer, Mark, Content}, #link{robot = Robot} = Link) ->
    case starl_robot:expire(Name, Timer, Mark, Robot) of
        {ok, Type, Left} ->
            {Body0, Now} = at_event(Link),
            Body = starl_live_body:input({timer, Name, Timer, Mark, Content}, Body0),
            Noted = starl_live_body:handles(Name, Type, Content, Body),
            went(starl_robot:fire(Name, Type, Content, Noted, Left, Now#link.robot), Now);
        stale ->
            work(Link)
    end;
handle({acts, Pid, Actions}, #link{beside = Beside} = Link) ->
    case {Beside, starl_robot_machines:name_of(Pid, machines(Link))} of
        {#{Pid := {_, Orders}}, {ok, Name}} ->
            {Body0, #link{robot = Robot} = Now} = at_event(Link),
            Body = starl_live_body:input(acts, Body0),
            Idle = Now#link{beside = Beside#{Pid := {idle, Orders}}},
            Valid = starl_robot_actions:without_calls(starl_driver:restarted(Orders), Actions),
            Answered = Idle#link{long = maps:remove(Pid, Idle#link.long)},
            went(starl_robot:act(Name, Valid, Body, Robot), Answered);
        _ ->
            work(Link)
    end.

%% The robot's machines get words on new code.
heeded(Words, Body, #link{robot = Robot} = Link) ->
    Machines = starl_robot:machines(Robot),
    {There, Gone} = lists:partition(
        fun({Name, _}) -> starl_robot_machines:has(Name, Machines) end, Words
    ),
    Told = lists:foldl(fun({Name, Word}, B) -> starl_live_body:gone(Name, Word, B) end, Body, Gone),
    Local = [{Name, code, Word} || {Name, Word} <- There],
    went(starl_robot:run(starl_robot:then(Local, starl_robot:world(Told, Robot))), Link).

%% A timer that should have been handled long ago tells of the computer. One fact tells of all that were due in
%% that time.
at_event(#link{robot = Robot, turns = Turns, late_us = Before} = Link) ->
    Marks = starl_robot_timers:marks(starl_robot:timers(Robot)),
    Present = starl_live_body:at(event, starl_robot:world(Robot)),
    {Due, Body} = starl_live_body:due_us(Marks, Present),
    computer_late(max(Due, Before), Body, Link#link{turns = Turns + 1}).

computer_late(Since, Body, Link) ->
    case starl_live_body:now_us(Body) of
        Now when Now - Since > ?LATE_US ->
            ok = warn_late(),
            {starl_live_body:trace(robot, {late, Since, Now}, Body), Link#link{late_us = Now}};
        _Now ->
            {Body, Link}
    end.

warn_late() ->
    Why = io_lib:format("its computer was late by more than ~b ms", [?LATE_US div 1000]),
    Report = #{what => late, machine => robot, reason => unicode:characters_to_binary(Why)},
    logger:warning(Report, #{report_cb => fun report/1}).

%% The result of an event, with all that followed from it.
went({quiet, Robot}, Link) ->
    next(flushed(Robot, Link));
went({ask, Pid, Order, Robot}, #link{beside = Beside} = Link) ->
    case {starl_robot:busy(Robot), Beside} of
        {_, #{Pid := {How, Orders}}} ->
            Kept = Link#link{beside = Beside#{Pid := {How, Orders ++ [Order]}}},
            went(starl_robot:leave(Robot), Kept);
        {app, _} ->
            %% what is known of a grant leaves before the application can act on it
            Flushed = flushed(Robot, Link),
            Pid ! Order,
            Left = Flushed#link{beside = Beside#{Pid => {at_work, []}}},
            went(starl_robot:leave(Left#link.robot), Left);
        _ ->
            ask(Pid, Order, starl_live_body:flush(starl_robot:world(Robot)), Robot, Link)
    end;
went({crashed, Name, Reason, Robot}, Link) ->
    Flushed = flushed(Robot, Link),
    {ok, _Killed} = starl_robot_tree:kill(Name, machines(Flushed)),
    case crashed(Name, Reason, Flushed) of
        {ok, Next} -> go_on(Next);
        {gave_up, _} -> exit({shutdown, gave_up})
    end.

%% The machine of this order, too: what it was late with before comes first.
ask(Pid, Order, {[], Body}, Robot, Link) ->
    Pid ! Order,
    Link#link{robot = starl_robot:world(Body, Robot)};
ask(_Pid, Order, {[_ | _] = Late, Body}, Robot, Link) ->
    Waits = starl_robot:put_off(Order, starl_robot:world(late(Late, Body), Robot)),
    went(starl_robot:run(starl_robot:first(Late, Waits)), Link).

%% A machine learns that something of its step was late before it handles anything else.
flushed(Robot, Link) ->
    {Late, Flushed} = starl_live_body:flush(starl_robot:world(Robot)),
    Body = late(Late, Flushed),
    Link#link{robot = starl_robot:first(Late, starl_robot:world(Body, Robot))}.

late([], Body) -> Body;
late([_ | _], Body) -> starl_live_body:input({other, late}, Body).

next(#link{robot = Robot} = Link) ->
    case starl_robot:status(Robot) of
        {busy, _} -> went(starl_robot:run(Robot), Link);
        {_, _} -> work(order_next(Link))
    end.

%% Processes that have answered get their next order.
order_next(#link{beside = Beside} = Link) when map_size(Beside) =:= 0 -> Link;
order_next(#link{beside = Beside} = Link) ->
    Body = starl_live_body:at(event, starl_robot:world(Link#link.robot)),
    Now = starl_live_body:now_us(Body),
    Next = maps:filtermap(fun(Pid, Work) -> ordered(Pid, Work, Now) end, Beside),
    Told = lists:foldl(
        fun(_, B) -> starl_live_body:input(order, B) end,
        Body,
        [Pid || {Pid, {idle, [_ | _]}} <- maps:to_list(Beside)]
    ),
    Link#link{beside = Next, robot = starl_robot:world(Told, Link#link.robot)}.

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

%% -- crashes --------------------------------------------------------------------------------

down(Pid, Reason, Link) ->
    case starl_robot_machines:name_of(Pid, machines(Link)) of
        {ok, Name} ->
            case crashed(Name, Reason, Link) of
                {ok, Next} -> {noreply, go_on(Next)};
                {gave_up, Last} -> {stop, {shutdown, gave_up}, Last}
            end;
        none when Pid =:= Link#link.machines_sup ->
            {stop, {shutdown, gave_up}, Link};
        none ->
            {noreply, Link}
    end.

%% The link waits until the machine has been restarted, or given up. Whoever told the robot of new code
%% learns that it has failed also from a link that ends with it.
crashed(Name, Reason, Link0) ->
    #link{robot = Robot0, tree = Tree, beside = Beside} = Link = input({other, crashed}, Link0),
    Gone = starl_robot_machines:process(Name, starl_robot:machines(Robot0)),
    Cause = starl_crash:cause(Reason),
    Body = starl_live_body:fallen(
        Name, Cause, starl_live_body:at(event, starl_robot:world(Robot0))
    ),
    Bare = starl_robot:lost(Name, Reason, starl_robot:world(Body, Robot0)),
    tell(Name, Reason),
    case starl_robot_tree:restart(Name, starl_robot:machines(Bare), Tree) of
        {ok, #{back := Back, given_up := GivenUp, lost := Lost}, Machines} ->
            case starl_live_body:started(starl_robot_machines:starts(Machines), Body) of
                ok ->
                    Left = lists:foldr(fun({N, R}, B) -> starl_robot:lost(N, R, B) end, Bare, Lost),
                    With = starl_robot:machines(Machines, Left),
                    Robot = starl_robot:back(Back, GivenUp, With),
                    {ok, Link#link{robot = Robot, beside = maps:remove(Gone, Beside)}};
                {error, _} ->
                    {gave_up, flushed(Bare, Link)}
            end;
        gave_up ->
            {gave_up, flushed(Bare, Link)}
    end.

tell(Name, Reason) ->
    case starl_crash:cause(Reason) of
        none -> ok;
        Cause -> log(crashed, Name, starl_crash:format(Cause))
    end.

%% A report with its words, for handlers that show these.
log(What, Name, Text) ->
    Why = unicode:characters_to_binary(Text),
    Report = #{what => What, machine => Name, reason => Why},
    logger:error(Report, #{report_cb => fun report/1}).

report(#{what := crashed, machine := Name, reason := Why}) -> {"~tp crashed: ~ts", [Name, Why]};
report(#{what := _, reason := Why}) -> {"~ts", [Why]}.

%% Applications may take their time; of one that takes very long the log has one line, with its place.
long_steps(#link{beside = Beside, long = Long} = Link) ->
    AtWork = [Pid || {Pid, {at_work, _}} <- maps:to_list(Beside)],
    Watched = maps:from_list([{Pid, 1 + maps:get(Pid, Long, 0)} || Pid <- AtWork]),
    _ = [tell_long(Pid, Link) || {Pid, ?LONG_STEP} <- maps:to_list(Watched)],
    Link#link{long = Watched}.

tell_long(Pid, Link) ->
    {ok, Name} = starl_robot_machines:name_of(Pid, machines(Link)),
    Seconds = watched_s(?LONG_STEP),
    At = place(starl_crash:place(starl_crash:frames_of(Pid))),
    log(long_step, Name, io_lib:format("in one step for ~b s~ts", [Seconds, At])).

%% The time from the first of these watches to the last.
watched_s(Watches) -> (Watches - 1) * ?WATCH_MS div 1000.

place(none) -> "";
place({_, _, _, File, Line}) -> io_lib:format(" at ~ts:~b; an endless loop?", [File, Line]).

%% A process at work that has not answered for a whole period is killed: its supervisor starts it
%% anew.
watch(#link{robot = Robot, turns = Turns, watched = Turns} = Link) ->
    case starl_robot:busy(Robot) of
        none ->
            Link#link{watched = none};
        Name ->
            logger:error(#{what => no_answer, machine => Name}),
            true = exit(starl_robot_machines:process(Name, machines(Link)), kill),
            Link#link{watched = none}
    end;
watch(#link{robot = Robot, turns = Turns} = Link) ->
    case starl_robot:busy(Robot) of
        none -> Link#link{watched = none};
        _ -> Link#link{watched = Turns}
    end.

machines(#link{robot = Robot}) -> starl_robot:machines(Robot).
