%% @doc The driver's state of a live robot: its clock, store, code, timers and trace, and its ports.
%% The ports lead to its radio, its positioning system, its chassis and its senses. It is the world of
%% the robot's {@link starl_robot}; {@link starl_live_link} holds it.
%%
%% A step's trace events, and what it sends, are kept until the step is over:
%% ```
%%     a step                              flush/1
%%       trace/3 ------------------------> 1. the sink of the run, the record on disk, the observer
%%       perform/3, reloads -------------> 2. the ports; the process that gets reports on reloads
%%       {late, Mark} for the machine <--- 3. what had a deadline that has passed
%% '''
%% The trace events leave first, so a judge of the run knows of a packet before anybody can have
%% received it. An action with a deadline is checked again when it leaves. If it is late, its machine
%% gets an event before any other that waits. A batch of trace events carries the time of this check,
%% too, since the robot may stall before anybody has them.
-module(starl_live_driver).
-behaviour(starl_driver).
-behaviour(starl_platform).

-export([new/1, report_start/2, hear/2, stop/1, flush/1]).
-export([at/1, now_us/1, due_us/2, moment/1, figures/1, counts/1, port/2]).
-export([reload/3, take_back/3, crashed/3, gone/3]).
-export([handles/4, clock/1, present/1, base/3, trace/3, plan/5, store/3, ended/2]).
-export([perform/3]).

-export_type([t/0, config/0, figures/0, random/0]).

%% `parts': the modules of the robot's machines. `codes': those of new code. `reporter': who gets
%% reports on reloads. `sink', `record', `observe': who gets trace events ({@link
%% starl_live_link:spec()}). `tell': when they get them. `inline': the machines are no processes, and
%% no histories of calls are kept.
-type config() :: #{
    robot := starl:robot_id(),
    participants := starl_team:t(),
    team_seed := integer(),
    clock := starl_live_clock:t(),
    store := starl_live_store:t(),
    parts := #{starl_machine:name() => module()},
    transport := pid(),
    positioning := pid(),
    chassis := pid(),
    senses := #{starl_sense:kind() => pid()},
    sink := pid() | none,
    record := starl_live_record:t() | none,
    observe => starl_observer:t(),
    codes => starl_reload:codes(),
    reporter => pid(),
    random => random(),
    tell => step | at_once,
    inline => boolean(),
    atom() => term()
}.

%% The random stream of a machine that starts.
-type random() :: fun((starl_machine:name(), Incarnation :: pos_integer()) -> rand:state()).

%% The numbers of events handled and of packets sent.
-type figures() :: #{events := non_neg_integer(), packets := non_neg_integer()}.

%% The machine that wants something of the world, and its mark for it.
-type owner() :: {starl_machine:name(), Mark :: term()}.

%% A trace event, or one that leaves before this time or not at all.
-type fact() ::
    starl_monitor:trace_event() | {until, Us :: integer(), starl_monitor:trace_event(), owner()}.

%% What a step sends. `until': by this time or not at all.
-type out() ::
    {transmit, starl:robot_id() | all, starl_packet:t()}
    | {sense, Tag :: term(), [starl:robot_id()]}
    | {feel, starl_sense:kind(), Mark :: term()}
    | {drive, starl_chassis:script(), UntilUs :: integer(), owner()}
    | {actuate, atom(), term(), {mark, term()} | none}
    | rest
    | stop
    | {until, Us :: integer(), out(), owner()}
    | {starl_reloaded, starl:robot_id(), starl_machine:name(), starl_reload:told()}
    | {outlived, starl_packet:incarnation()}.

%% The result of the robot's application.
-type result() :: running | given_up | {done, term()}.

%% A script that has not begun by this time after the step that wanted it is not begun at all: much
%% less than the pause of a robot that leases allow for (`jump_ms').
-define(LATEST_US, 500000).

%% What stays the same while the link lives.
-record(setup, {
    id :: starl:robot_id(),
    participants :: starl_team:t(),
    team_seed :: integer(),
    clock :: starl_live_clock:t(),
    store :: starl_live_store:t(),
    parts :: #{starl_machine:name() => module()},
    %% the machines of whose calls histories are kept
    histories :: [starl_machine:name()],
    random :: random(),
    transport :: pid(),
    positioning :: pid(),
    chassis :: pid(),
    senses :: #{starl_sense:kind() => pid()},
    sink :: pid() | none,
    observer :: starl_observer:t(),
    tell :: step | at_once
}).

-record(driver, {
    setup :: #setup{},
    %% the time at which the present step began
    now :: integer(),
    codes :: starl_reload:codes(),
    reporter :: pid() | none,
    record :: starl_live_record:t() | none,
    %% the timers that run, and the mark of the next one
    dues = #{} :: #{starl_robot_timers:mark() => DueUs :: integer()},
    mark = 0 :: starl_robot_timers:mark(),
    %% of the present step, newest first
    traces = [] :: [fact()],
    out = [] :: [out()],
    %% whose trace events and sendings were late, latest first
    late = [] :: [owner()],
    %% the number of the next batch of trace events
    batch = 1 :: pos_integer(),
    result = running :: result(),
    %% the result that the sink knows
    reported = running :: result(),
    events = 0 :: non_neg_integer(),
    packets = 0 :: non_neg_integer(),
    counts = starl_live_counts:new() :: starl_live_counts:t()
}).

-opaque t() :: #driver{}.

%% @doc The driver's state of a robot that starts.
-spec new(config()) -> t().
new(#{robot := Id, participants := Team, clock := Clock, store := Store, parts := Parts} = Config) ->
    #{transport := Transport, positioning := Positioning, chassis := Chassis} = Config,
    Setup = #setup{
        id = Id,
        participants = Team,
        team_seed = maps:get(team_seed, Config),
        clock = Clock,
        store = Store,
        parts = Parts,
        histories = histories(Config),
        random = maps:get(random, Config, fun(_Name, _Incarnation) -> rand:seed_s(exsss) end),
        transport = Transport,
        positioning = Positioning,
        chassis = Chassis,
        senses = maps:get(senses, Config),
        sink = maps:get(sink, Config),
        observer = maps:get(observe, Config, none),
        tell = maps:get(tell, Config, step)
    },
    #driver{
        setup = Setup,
        now = starl_live_clock:now_us(Clock),
        codes = maps:get(codes, Config, #{}),
        reporter = maps:get(reporter, Config, none),
        record = maps:get(record, Config)
    }.

%% Of real robots, histories are kept of the machines whose calls a model explains.
histories(#{inline := true}) ->
    [];
histories(#{parts := Parts}) ->
    [Name || {Name, Module} <- lists:sort(maps:to_list(Parts)), has_history(Module)].

has_history(Module) -> starl_callback:call(Module, has_history, [], false).

%% @doc Notifies the observer of this node that the robot starts, with these machines.
-spec report_start([starl_machine:name()], t()) -> ok.
report_start(Names, #driver{now = Now, setup = #setup{id = Id, observer = Observer}}) ->
    starl_observer:tell({started, Now, Id, Names}, Observer).

%% @doc The counters of the robot.
-spec figures(t()) -> figures().
figures(#driver{events = Events, packets = Packets}) -> #{events => Events, packets => Packets}.

%% @doc What the robot has counted since its link started.
-spec counts(t()) -> starl_live_counts:t().
counts(#driver{counts = Counts}) -> Counts.

%% @doc The process of a port.
-spec port(transport | positioning | chassis, t()) -> pid().
port(transport, #driver{setup = #setup{transport = Pid}}) -> Pid;
port(positioning, #driver{setup = #setup{positioning = Pid}}) -> Pid;
port(chassis, #driver{setup = #setup{chassis = Pid}}) -> Pid.

%% -- time -----------------------------------------------------------------------------------

%% @doc The state at a new event: time does not go back.
-spec at(t()) -> t().
at(Driver) -> Driver#driver{now = present(Driver)}.

%% @doc The time at which the present step began.
-spec now_us(t()) -> integer().
now_us(#driver{now = Now}) -> Now.

%% @doc The same, for {@link starl_driver}.
-spec clock(t()) -> integer().
clock(#driver{now = Now}) -> Now.

%% @doc The time that the robot's clock shows now.
-spec present(t()) -> integer().
present(#driver{setup = #setup{clock = Clock}, now = Now}) ->
    max(Now, starl_live_clock:now_us(Clock)).

%% @doc The beginning of this life of the robot.
-spec moment(t()) -> starl_robot_machines:moment().
moment(#driver{setup = #setup{store = Store, clock = Clock, random = Random}}) ->
    case starl_live_store:life(Store) of
        first ->
            first;
        later ->
            Ms = starl_live_clock:system_time(millisecond, Clock),
            {Number, _} = rand:uniform_s(starl_robot_machines:lots(), Random(robot, Ms)),
            {Ms, Number - 1}
    end.

%% @doc Plans a timer's event: this process gets `{timeout, _, {starl_timer, Name, Timer, Mark,
%% Content}}'. The time is rounded up to a millisecond.
-spec plan(starl_machine:name(), starl_robot_timers:timer(), non_neg_integer(), term(), t()) ->
    {starl_robot_timers:mark(), t()}.
plan(Name, Timer, Us, Content, #driver{now = Now, mark = Mark, dues = Dues} = Driver) ->
    #driver{setup = #setup{clock = Clock}} = Driver,
    Due = starl_live_clock:monotonic_ms(Now + Us, Clock),
    Message = {starl_timer, Name, Timer, Mark, Content},
    At = max(Due, starl_live_clock:monotonic_time(millisecond, Clock)),
    _ = starl_live_clock:start_timer(At, Message, [{abs, true}], Clock),
    Planned = Dues#{Mark => Now + Us},
    {Mark, Driver#driver{mark = Mark + 1, dues = Planned}}.

%% @doc When the first of these timers, which run, was due; the present time, if none is. All other
%% timers are forgotten.
-spec due_us([starl_robot_timers:mark()], t()) -> {DueUs :: integer(), t()}.
due_us(Running, #driver{now = Now} = Driver) ->
    #driver{dues = Dues} = Left = running(Running, Driver),
    {maps:fold(fun(_Mark, Due, Us) -> min(Due, Us) end, Now, Dues), Left}.

running(Running, #driver{dues = Dues} = Driver) ->
    Driver#driver{dues = maps:with(Running, Dues)}.

%% -- starts and steps of machines -----------------------------------------------------------

%% @doc The start configuration of a machine. Its random stream is new with each start.
-spec base(starl_machine:name(), Incarnation :: pos_integer(), t()) -> starl_machine:config().
base(Name, Incarnation, #driver{setup = Setup, now = Now, codes = Codes}) ->
    #setup{store = Store, random = Random} = Setup,
    (own_clock(Name, starl_reload:code(Name, Codes), Setup))#{
        robot => Setup#setup.id,
        participants => Setup#setup.participants,
        name => Name,
        incarnation => Incarnation,
        stored => starl_live_store:kept(Name, Store),
        random => Random(Name, Incarnation),
        team_seed => Setup#setup.team_seed,
        now => Now,
        histories => Setup#setup.histories
    }.

%% An application looks at the clock itself when it gets a grant.
own_clock(app, Base, #setup{clock = Clock}) ->
    Base#{clock => fun() -> starl_live_clock:now_us(Clock) end};
own_clock(_Name, Base, _Setup) ->
    Base.

%% @doc Counts an event, whose step begins now: the steps before it in its turn took time.
-spec handles(starl_machine:name(), starl_machine:event_type() | boot, term(), t()) -> t().
handles(Name, boot, _Content, #driver{events = Events} = Before) ->
    #driver{now = Now, codes = Codes} = Driver = at(Before),
    {Results, Begun} = starl_reload:started(Name, Now, Codes),
    Booted = Driver#driver{events = Events + 1, codes = Begun},
    all_reloaded(Results, Name, Booted);
handles(app, info, {sensed, _} = Sensed, #driver{events = Events} = Driver) ->
    trace(chassis, Sensed, (at(Driver))#driver{events = Events + 1});
handles(_Name, _Type, _Content, #driver{events = Events} = Driver) ->
    (at(Driver))#driver{events = Events + 1}.

%% @doc Makes a term durable.
-spec store(starl_machine:name(), term(), t()) -> {ok, t()} | full.
store(Name, Term, #driver{setup = #setup{store = Store}} = Driver) ->
    case starl_live_store:keep(Name, Term, Store) of
        ok -> {ok, Driver};
        full -> full
    end.

%% @doc The application has ended. Its first end counts, unless a result follows.
-spec ended(starl_robot:ended(), t()) -> t().
ended({done, _} = Done, Driver) -> out(rest, Driver#driver{result = Done});
ended(given_up, #driver{result = running} = Driver) -> Driver#driver{result = given_up};
ended(_, Driver) -> Driver.

%% @doc Records a trace event.
-spec trace(starl_machine:name(), Event :: term(), t()) -> t().
trace(Name, Event, #driver{setup = #setup{id = Id}, now = Now} = Driver) ->
    _ = Event =:= late andalso logger:warning(#{what => late, machine => Name}),
    Fact = {Now, Id, Name, Event},
    noted(Fact, counted(Fact, Driver)).

counted(Fact, #driver{counts = Counts} = Driver) ->
    Driver#driver{counts = starl_live_counts:traced(Fact, Counts)}.

noted(Fact, #driver{setup = Setup, traces = Traces} = Driver) ->
    Noted = Driver#driver{traces = [Fact | Traces]},
    case Setup#setup.tell of
        at_once -> report(Noted);
        step -> Noted
    end.

%% -- events from outside --------------------------------------------------------------------

%% @doc Turns a message from a port into events of the robot.
-spec hear(Message :: term(), t()) -> [starl_robot:local()] | unknown.
hear({starl_heard, Transport, Packets}, #driver{setup = #setup{transport = Transport}}) ->
    [{sap, packet, Packet} || Packet <- Packets];
hear(
    {starl_located, Positioning, {Name, Tag}, Seen},
    #driver{setup = #setup{positioning = Positioning} = Setup}
) ->
    ok = observe_place(Seen, Setup),
    [{Name, info, {located, Tag, Seen}}];
hear({starl_chassis, Chassis, sensed, Sense}, #driver{setup = #setup{chassis = Chassis}}) ->
    [{app, info, {sensed, Sense}}];
hear({starl_chassis, Chassis, {Name, Mark}, Answer}, #driver{setup = #setup{chassis = Chassis}}) ->
    answer(Name, Mark, Answer);
hear({starl_felt, From, {Name, _Kind, Tag}, Felt}, #driver{setup = Setup}) ->
    #setup{chassis = Chassis, senses = Senses} = Setup,
    case lists:member(From, [Chassis | maps:values(Senses)]) of
        true -> [{Name, info, {felt, Tag, Felt}}];
        false -> unknown
    end;
hear(_Message, _Driver) ->
    unknown.

answer(Name, Mark, {driven, HeardUs}) -> [{Name, info, {driven, Mark, HeardUs}}];
answer(Name, Mark, {stalled, Why}) -> [{Name, info, {stalled, Mark, Why}}];
answer(Name, Mark, {actuated, Device, Value}) -> [{Name, info, {actuated, Mark, Device, Value}}];
answer(_Name, _Mark, {not_understood, _Commands}) -> [].

%% The observer of this node gets the robot's own place, at the time of the picture.
observe_place(_Seen, #setup{observer = none}) ->
    ok;
observe_place(Seen, #setup{id = Id, clock = Clock, observer = Observer}) ->
    case lists:keyfind(Id, 1, Seen) of
        {Id, Pose, Age} ->
            starl_observer:tell({seen, starl_live_clock:now_us(Clock) - Age, Id, Pose}, Observer);
        false ->
            ok
    end.

%% -- the actions of machines ----------------------------------------------------------------

%% @doc Carries out an action of a machine on the world, at the end of the step.
-spec perform(starl_platform:world_action(), starl_machine:name(), t()) ->
    {[starl_robot:local()], t()}.
perform({transmit, To, Packet}, _Name, #driver{packets = Packets, counts = Counts} = Driver) ->
    Counted = starl_live_counts:transmits(To, Packet, Counts),
    {[], out({transmit, To, Packet}, Driver#driver{packets = Packets + 1, counts = Counted})};
perform({sense, {near, _Mm}, Tag}, Name, #driver{setup = #setup{participants = Team}} = Driver) ->
    %% no positioning system answers that yet
    perform({sense, starl_team:members(Team), Tag}, Name, Driver);
perform({sense, Robots, Tag}, Name, Driver) ->
    {[], out({sense, {Name, Tag}, Robots}, Driver)};
perform({feel, Kind, Tag}, Name, Driver) ->
    {[], out({feel, Kind, {Name, Kind, Tag}}, Driver)};
perform({drive, Script, Mark}, Name, #driver{now = Now} = Driver) ->
    {[], out({drive, Script, Now + ?LATEST_US, {Name, Mark}}, Driver)};
perform({actuate, Device, Value}, _Name, Driver) ->
    {[], out({actuate, Device, Value, none}, Driver)};
perform({actuate, Device, Value, Mark}, Name, Driver) ->
    {[], out({actuate, Device, Value, {mark, {Name, Mark}}}, Driver)};
perform({until, Us, {trace, Event}, Mark}, Name, #driver{now = Now} = Driver) ->
    #driver{setup = #setup{id = Id}} = Driver,
    Fact = {Now, Id, Name, Event},
    {[], noted({until, Us, Fact, {Name, Mark}}, counted(Fact, Driver))};
perform({until, Us, Action, Mark}, Name, Driver) ->
    {Events, #driver{out = [Out | Earlier]} = Next} = perform(Action, Name, Driver),
    {Events, leased(Us, Action, Next#driver{out = [{until, Us, Out, {Name, Mark}} | Earlier]})};
perform({outlived, N}, _Name, Driver) ->
    {[], out({outlived, N}, Driver)};
perform({reloaded, #{tell := nobody} = Result}, Name, Driver) ->
    {[], reloaded(Result, Name, Driver)};
perform({reloaded, #{tell := others} = Result}, Name, #driver{setup = Setup} = Driver) ->
    Others = lists:delete(Name, lists:sort(maps:keys(Setup#setup.parts))),
    {[{To, info, {restarted, Name}} || To <- Others], reloaded(Result, Name, Driver)}.

leased(Us, {transmit, _, Packet}, #driver{counts = Counts} = Driver) ->
    Driver#driver{counts = starl_live_counts:sent_until(Us, Packet, Counts)};
leased(_Us, _Action, Driver) ->
    Driver.

%% @doc No machine commands the chassis any more.
-spec stop(t()) -> t().
stop(Driver) -> out(stop, Driver).

out(What, #driver{out = Out} = Driver) -> Driver#driver{out = [What | Out]}.

%% -- new code -------------------------------------------------------------------------------

%% @doc A reload begins. Returns the commands for the robot's machines, which start with this code
%% from now on. This process gets a report on how each machine applies its command.
-spec reload(starl_reload:order(), pid(), t()) ->
    {[{starl_machine:name(), starl_reload:word()}], t()}.
reload(Order, Reporter, #driver{setup = Setup, codes = Before} = Driver) ->
    {Commands, Codes} = starl_reload:take(Order, Setup#setup.parts, Before),
    {Commands, Driver#driver{codes = Codes, reporter = Reporter}}.

%% @doc A reload has failed elsewhere. Returns the commands for the machines that have to go back.
-spec take_back(starl_reload:count(), Failed :: starl:robot_id(), t()) ->
    {[{starl_machine:name(), starl_reload:word()}], t()}.
take_back(N, Failed, #driver{codes = Before} = Driver) ->
    {Commands, Codes} = starl_reload:back(N, Failed, Before),
    {Commands, Driver#driver{codes = Codes}}.

%% @doc A machine that was given up takes no new code.
-spec gone(starl_machine:name(), starl_reload:word(), t()) -> t().
gone(Name, {take, #{number := N, module := Module}}, Driver) ->
    reloaded(#{number => N, outcome => done, module => Module, tell => nobody}, Name, Driver);
gone(_Name, {back, _, _}, Driver) ->
    Driver.

%% @doc A machine has crashed: new code on trial is given up.
-spec crashed(starl_machine:name(), starl_crash:cause() | none, t()) -> t().
crashed(_Name, none, Driver) ->
    Driver;
crashed(Name, Cause, #driver{now = Now, codes = Codes} = Driver) ->
    all_reloaded(starl_reload:fallen(Name, Cause, Now, Codes), Name, Driver).

all_reloaded(Results, Name, Driver) ->
    lists:foldl(fun(Result, D) -> reloaded(Result, Name, D) end, Driver, Results).

%% How a machine applies a reload is traced, logged, and reported when the step is over.
reloaded(#{number := N, outcome := Outcome, module := Module} = Result, Name, Before) ->
    Driver = trace(Name, {reloaded, N, Outcome}, Before),
    #driver{setup = #setup{id = Id}, codes = Codes} = Driver,
    Line = unicode:characters_to_binary(starl_reload:format(Id, Name, Module, Outcome)),
    logger:notice(#{what => reload, outcome => Line}),
    Heard = Driver#driver{codes = starl_reload:heard(Name, Result, Codes)},
    out({starl_reloaded, Id, Name, Result}, Heard).

%% -- the end of a step ----------------------------------------------------------------------

%% @doc Passes on what the step has traced, and then sends what it sends. Returns the events of the
%% machines that must learn that something was late.
-spec flush(t()) -> {Late :: [starl_robot:local()], t()}.
flush(#driver{traces = [], out = [], late = [], result = R, reported = R} = Driver) ->
    {[], Driver};
flush(#driver{out = Out} = Driver) ->
    Sent = lists:foldl(fun send/2, report(Driver), lists:reverse(Out)),
    Late = [{Name, info, {late, Mark}} || {Name, Mark} <- lists:reverse(Sent#driver.late)],
    {Late, Sent#driver{out = [], late = []}}.

%% The sink, the record and the observer get the trace events that may leave now; the sink gets a new
%% result, too.
report(#driver{traces = Traces, batch = N, result = Result, setup = Setup} = Driver) ->
    Now = present(Driver),
    {Events, Late} = leaving(lists:reverse(Traces), Now, [], []),
    Batch = {N, Now, Events},
    Record = record(Batch, Driver#driver.record),
    ok = sink(Batch, Result, Driver),
    ok = observe(Events, Setup),
    Reported = Driver#driver{traces = [], batch = N + 1, reported = Result, record = Record},
    lists:foldl(fun late/2, Reported, lists:uniq(Late)).

leaving([{until, Us, Fact, _Owner} | Facts], Now, Events, Late) when Now =< Us ->
    leaving(Facts, Now, [Fact | Events], Late);
leaving([{until, _Us, _Fact, Owner} | Facts], Now, Events, Late) ->
    leaving(Facts, Now, Events, [Owner | Late]);
leaving([Fact | Facts], Now, Events, Late) ->
    leaving(Facts, Now, [Fact | Events], Late);
leaving([], _Now, Events, Late) ->
    {lists:reverse(Events), lists:reverse(Late)}.

record(_Batch, none) -> none;
record(Batch, Record) -> starl_live_record:write(Batch, Record).

sink(_Batch, _Result, #driver{setup = #setup{sink = none}}) ->
    ok;
sink({_, _, Events} = Batch, Result, #driver{setup = Setup, reported = Reported}) ->
    #setup{id = Id, sink = Sink} = Setup,
    _ = Events =/= [] andalso (Sink ! {starl_traced, Id, self(), Batch}),
    _ = Result =/= Reported andalso (Sink ! {starl_ended, Id, self(), Result}),
    ok.

observe([], _Setup) -> ok;
observe(Events, #setup{observer = Observer}) -> starl_observer:tell({judged, Events, []}, Observer).

send({until, Us, Out, Owner}, #driver{setup = Setup} = Driver) ->
    case present(Driver) =< Us of
        true ->
            _ = send_until(Us, Out, Owner, Setup),
            Driver;
        false ->
            late(Owner, Driver)
    end;
send({starl_reloaded, _, _, _}, #driver{reporter = none} = Driver) ->
    Driver;
send({starl_reloaded, _, _, _} = Report, #driver{reporter = Reporter} = Driver) ->
    Reporter ! Report,
    Driver;
send(Out, #driver{setup = Setup} = Driver) ->
    _ = send_now(Out, Setup),
    Driver.

late({Name, _Mark} = Owner, #driver{late = Late} = Driver) ->
    logger:warning(#{what => late, machine => Name}),
    Driver#driver{late = [Owner | Late]}.

%% The radio and the chassis check the deadline once more.
send_until(Us, {transmit, To, Packet}, Owner, #setup{transport = Transport}) ->
    starl_live_transport:transmit(Transport, To, Packet, {Us, Owner});
send_until(Us, {drive, Script, Latest, Mark}, _Owner, Setup) ->
    send_now({drive, Script, min(Us, Latest), Mark}, Setup);
send_until(_Us, Out, _Owner, Setup) ->
    send_now(Out, Setup).

send_now({transmit, To, Packet}, #setup{transport = Transport}) ->
    starl_live_transport:transmit(Transport, To, Packet);
send_now({sense, Tag, Robots}, #setup{positioning = Positioning}) ->
    starl_live_positioning:ask(Positioning, Tag, Robots);
%% The chassis answers for the senses that have no process of their own.
send_now({feel, Kind, Mark}, #setup{senses = Senses, chassis = Chassis}) ->
    case Senses of
        #{Kind := Sense} -> starl_live_sense:ask(Sense, Mark);
        #{} -> starl_live_chassis:feel(Chassis, Kind, Mark)
    end;
send_now({drive, Script, Until, Mark}, #setup{chassis = Chassis}) ->
    starl_live_chassis:drive(Chassis, Script, Until, Mark);
send_now({actuate, Device, Value, Mark}, #setup{chassis = Chassis}) ->
    starl_live_chassis:actuate(Chassis, Device, Value, Mark);
send_now(rest, #setup{chassis = Chassis}) ->
    starl_live_chassis:rest(Chassis);
send_now(stop, #setup{chassis = Chassis}) ->
    starl_live_chassis:stop(Chassis);
%% The link ends, and with it the whole robot; its supervisor starts it anew.
send_now({outlived, N}, #setup{store = Store}) ->
    logger:error(#{what => store_outdated, incarnation => N}),
    case starl_live_store:outdate(N, Store) of
        ok -> exit({shutdown, outlived});
        {error, Why} -> exit({shutdown, {store, unicode:characters_to_binary(Why)}})
    end.
