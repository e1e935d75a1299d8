%% @doc The driver's state of a live robot: its clock, store and trace, and the lines to its radio,
%% positioning system and chassis. It is the world of its {@link starl_robot}.
%%
%% What a step sends, and the facts that it traces, are kept until the step is over ({@link
%% flush/1}). The facts leave first: whoever judges the run knows of a packet before anybody can
%% have received it. What has a latest moment is looked at again when it leaves; if it is late, its
%% machine gets an event, before any other that waits. Facts bear the time of this look, too, since the
%% robot may stand still before anybody has them.
-module(starl_live_body).
-behaviour(starl_driver).
-behaviour(starl_platform).

-export([
    new/1,
    at/2,
    now_us/1,
    flush/1,
    hear/2,
    result/1,
    figures/1,
    counts/1,
    line/2,
    life/1,
    moment/1,
    starts/1,
    started/2,
    tell_start/2
]).
-export([
    handles/4,
    clock/1,
    present/1,
    base/3,
    trace/3,
    plan/5,
    due_us/2,
    store/3,
    ended/2,
    perform/3,
    stop/1
]).
-export([reload/3, take_back/3, fallen/3, gone/3]).
-export([is_kept/1, input/2, snapshot/2]).

-export_type([t/0, config/0, figures/0, random/0, input/0, snapshot/0]).

%% The parts of the body: processes that the link has started, or their stand-ins. Facts go to the
%% `sink' as {@link starl_live_link:told()}, and to the observer of this node.
-type config() :: #{
    robot := starl:robot_id(),
    participants := starl_team:t(),
    team_seed := integer(),
    clock := starl_live_clock:t(),
    store := starl_live_store:t(),
    transport := pid(),
    positioning := pid(),
    chassis := pid(),
    senses := #{starl_sense:kind() => pid()},
    sink := pid() | none,
    record := starl_live_record:t() | none,
    parts := #{starl_machine:name() => module()},
    codes => starl_reload:codes(),
    reporter => pid(),
    observe => starl_observer:t(),
    random => random(),
    tell => step | at_once,
    inline => boolean(),
    snapshots_us => pos_integer() | none,
    atom() => term()
}.

%% The random stream of a machine that starts.
-type random() :: fun((starl_machine:name(), Incarnation :: pos_integer()) -> rand:state()).

%% The numbers of events handled and of packets sent.
-type figures() :: #{events := non_neg_integer(), packets := non_neg_integer()}.

%% A script that has not begun by this time after the step that wanted it is not begun at all: much
%% less than the pause of a robot that leases allow for (`jump_ms').
-define(LATEST_US, 500000).

-record(body, {
    id :: starl:robot_id(),
    participants :: starl_team:t(),
    team_seed :: integer(),
    clock :: starl_live_clock:t(),
    store :: starl_live_store:t(),
    transport :: pid(),
    positioning :: pid(),
    chassis :: pid(),
    senses :: #{starl_sense:kind() => pid()},
    sink :: pid() | none,
    record :: starl_live_record:t() | none,
    %% the modules of the robot's machines, those of new code, and who is told about reloads
    parts :: #{starl_machine:name() => module()},
    codes :: starl_reload:codes(),
    reporter = none :: pid() | none,
    observer = none :: starl_observer:t(),
    %% the random stream of a machine that starts
    random :: random(),
    %% facts are told at the end of the step, or at once
    tell :: step | at_once,
    %% the time at which the present step began
    now :: integer(),
    %% the marks of timers
    marks = 0 :: non_neg_integer(),
    %% of the present step, newest first
    traces = [] :: [fact()],
    out = [] :: [out()],
    %% whose facts and sendings were late, latest first
    late = [] :: [{starl_machine:name(), Mark :: term()}],
    %% the number of the next batch of facts
    batch = 1 :: pos_integer(),
    events = 0 :: non_neg_integer(),
    packets = 0 :: non_neg_integer(),
    counts = starl_live_counts:new() :: starl_live_counts:t(),
    result = running :: running | given_up | {done, term()},
    told = running :: running | given_up | {done, term()},
    %% the machines of whose calls histories are kept
    histories = [] :: [starl_machine:name()],
    %% are snapshots told, and has the first one been? then all that comes to the robot is told, too
    kept = no :: no | asked | begun,
    %% the timers by their marks
    dues = #{} :: #{starl_robot_timers:mark() => due()},
    %% the last script of the chassis, if snapshots are told
    script = none ::
        {AtUs :: integer(), starl_chassis:script(), {starl_machine:name(), term()}} | none
}).

%% A timer's event.
-type due() :: {DueUs :: integer(), starl_machine:name(), starl_robot_timers:timer(), term()}.

%% What came to the robot since its last snapshot: an event; a timer's; what its application did; the
%% next order that its application got. `now': the time at which a machine has handled an event. `other':
%% what a simulation cannot repeat. They are facts of machine `snapshot', as snapshots are.
-type input() ::
    {event, starl_machine:name(), starl_machine:event_type(), term()}
    | {timer, starl_machine:name(), starl_robot_timers:timer(), starl_robot_timers:mark(), term()}
    | acts
    | order
    | now
    | {other, atom()}.

%% A live robot as data, at a time of its clock.
-type snapshot() :: #{
    at_us := integer(),
    machines := starl_robot_machines:snapshot(),
    parts := starl_robot:parts(),
    dues := #{starl_robot_timers:mark() => due()},
    marks := non_neg_integer(),
    stored := #{starl_machine:name() => term()},
    script := {integer(), starl_chassis:script(), {starl_machine:name(), term()}} | none,
    result := running | given_up | {done, term()}
}.

-opaque t() :: #body{}.

%% A fact, or one that leaves before this time or not at all.
-type fact() ::
    starl_monitor:trace_event()
    | {until, Us :: integer(), starl_monitor:trace_event(), Owner :: term()}.

%% What a step sends.
-type out() ::
    {transmit, starl:robot_id() | all, starl_packet:t()}
    | {sense, Tag :: term(), [starl:robot_id()]}
    | {feel, starl_sense:kind(), Mark :: term()}
    | {drive, starl_chassis:script(), UntilUs :: integer(), Mark :: term()}
    | {actuate, atom(), term(), {mark, term()} | none}
    | {until, Us :: integer(), out(), Owner :: {starl_machine:name(), Mark :: term()}}
    | {report, term()}
    | {outlived, starl_packet:incarnation()}
    | rest
    | stop.

%% @doc The body of a robot.
-spec new(config()) -> t().
new(#{robot := Id, participants := Team, clock := Clock, store := Store, sink := Sink} = Config) ->
    #{transport := Transport, positioning := Positioning, chassis := Chassis} = Config,
    #{record := Record, parts := Parts, team_seed := Seed} = Config,
    #body{
        id = Id,
        participants = Team,
        team_seed = Seed,
        clock = Clock,
        store = Store,
        transport = Transport,
        positioning = Positioning,
        chassis = Chassis,
        senses = maps:get(senses, Config),
        sink = Sink,
        record = Record,
        parts = Parts,
        codes = maps:get(codes, Config, #{}),
        reporter = maps:get(reporter, Config, none),
        observer = maps:get(observe, Config, none),
        random = maps:get(random, Config, fun(_Name, _Incarnation) -> rand:seed_s(exsss) end),
        tell = maps:get(tell, Config, step),
        histories = histories(Config),
        kept = asked(maps:get(snapshots_us, Config, none)),
        now = starl_live_clock:now_us(Clock)
    }.

asked(none) -> no;
asked(_Us) -> asked.

%% Of real robots histories are kept: of the calls that a model explains.
histories(#{inline := true}) ->
    [];
histories(#{parts := Parts}) ->
    [Name || {Name, Module} <- lists:sort(maps:to_list(Parts)), has_history(Module)].

has_history(Module) ->
    {module, Module} = code:ensure_loaded(Module),
    erlang:function_exported(Module, has_history, 0) andalso Module:has_history().

%% @doc The body at a new event: time does not go back.
-spec at(event | same, t()) -> t().
at(event, Body) ->
    Body#body{now = present(Body)};
at(same, Body) ->
    Body.

%% @doc The time at which the present step began.
-spec now_us(t()) -> integer().
now_us(#body{now = Now}) -> Now.

%% @doc The application's result.
-spec result(t()) -> running | given_up | {done, term()}.
result(#body{result = Result}) -> Result.

%% @doc The counters of the robot.
-spec figures(t()) -> figures().
figures(#body{events = Events, packets = Packets}) -> #{events => Events, packets => Packets}.

%% @doc What the robot has counted since its link started.
-spec counts(t()) -> starl_live_counts:t().
counts(#body{counts = Counts}) -> Counts.

%% @doc The process of a line.
-spec line(transport | positioning | chassis, t()) -> pid().
line(transport, #body{transport = Pid}) -> Pid;
line(positioning, #body{positioning = Pid}) -> Pid;
line(chassis, #body{chassis = Pid}) -> Pid.

%% @doc Has the robot ever run before?
-spec life(t()) -> first | later.
life(#body{store = Store}) -> starl_live_store:life(Store).

%% @doc The number of starts of each machine, over all reboots, as far as the store knows it.
-spec starts(t()) -> starl_robot_machines:starts().
starts(#body{store = Store}) -> starl_live_store:starts(Store).

%% @doc The beginning of this life of the robot.
-spec moment(t()) -> starl_robot_machines:moment().
moment(#body{store = Store, clock = Clock, random = Random}) ->
    case starl_live_store:life(Store) of
        first ->
            first;
        later ->
            Ms = starl_live_clock:system_time(millisecond, Clock),
            {Lot, _} = rand:uniform_s(starl_robot_machines:lots(), Random(robot, Ms)),
            {Ms, Lot - 1}
    end.

%% @doc Makes the number of starts durable.
-spec started(starl_robot_machines:starts(), t()) -> ok | {error, unicode:chardata()}.
started(Starts, #body{store = Store}) -> starl_live_store:started(Starts, Store).

%% @doc Tells the observer of this node that the robot starts.
-spec tell_start([starl_machine:name()], t()) -> ok.
tell_start(Names, #body{id = Id, now = Now, observer = Observer}) ->
    starl_observer:tell({started, Now, Id, Names}, Observer).

%% -- snapshots ------------------------------------------------------------------------------

%% @doc Are snapshots of the robot told?
-spec is_kept(t()) -> boolean().
is_kept(#body{kept = Kept}) -> Kept =/= no.

%% @doc Tells what comes to the robot, from its first snapshot on.
-spec input(input(), t()) -> t().
input(Input, #body{kept = begun, id = Id, now = Now, traces = Traces} = Body) ->
    %% the times of messages may be those of others in a recording
    Body#body{traces = [{Now, Id, snapshot, {input, {Now, Input}}} | Traces]};
input(_Input, Body) ->
    Body.

%% @doc Tells a snapshot of the robot, between two events; without one what comes is of no use.
-spec snapshot(
    {ok, {starl_robot_machines:snapshot(), starl_robot:parts()}} | {error, starl_snapshot:reason()},
    t()
) -> t().
snapshot({ok, {Machines, #{timers := Running} = Parts}}, #body{dues = Dues, now = Now} = Body) ->
    Left = maps:with([Mark || {_, _, Mark} <- Running], Dues),
    Snapshot = #{
        at_us => Now,
        machines => Machines,
        parts => Parts,
        dues => Left,
        marks => Body#body.marks,
        stored => stored(Body),
        script => Body#body.script,
        result => Body#body.result
    },
    told(starl_snapshot:encode({live, Snapshot}), Body#body{dues = Left});
snapshot({error, _} = Error, Body) ->
    told(Error, Body).

told(Told, #body{id = Id, now = Now, traces = Traces} = Body) ->
    Kept =
        case Told of
            {ok, _} -> begun;
            {error, _} -> asked
        end,
    Body#body{kept = Kept, traces = [{Now, Id, snapshot, Told} | Traces]}.

stored(#body{parts = Parts, store = Store}) ->
    maps:from_list([
        {Name, Term}
     || Name <- maps:keys(Parts), {stored, Term} <- [starl_live_store:kept(Name, Store)]
    ]).

%% -- events from outside --------------------------------------------------------------------

%% @doc The events of the robot that a message of its lines is.
-spec hear(Message :: term(), t()) -> [starl_robot:local()] | unknown.
hear({starl_heard, Transport, Packets}, #body{transport = Transport}) ->
    [{sap, packet, Packet} || Packet <- Packets];
hear({starl_located, Positioning, {Name, Tag}, Seen}, #body{positioning = Positioning} = Body) ->
    ok = tell_seen(Seen, Body),
    [{Name, info, {located, Tag, Seen}}];
hear({starl_chassis, Chassis, sensed, Sense}, #body{chassis = Chassis}) ->
    [{app, info, {sensed, Sense}}];
hear({starl_chassis, Chassis, {Name, Mark}, Answer}, #body{chassis = Chassis}) ->
    said(Name, Mark, Answer);
hear({starl_felt, From, {Name, _Kind, Tag}, Felt}, #body{chassis = Chassis, senses = Senses}) ->
    case lists:member(From, [Chassis | maps:values(Senses)]) of
        true -> [{Name, info, {felt, Tag, Felt}}];
        false -> unknown
    end;
hear(_Message, _Body) ->
    unknown.

%% The robot's own place, at the time of the picture.
tell_seen(_Seen, #body{observer = none}) ->
    ok;
tell_seen(Seen, #body{id = Id, clock = Clock, observer = Observer}) ->
    case lists:keyfind(Id, 1, Seen) of
        {Id, Pose, Age} ->
            starl_observer:tell({seen, starl_live_clock:now_us(Clock) - Age, Id, Pose}, Observer);
        false ->
            ok
    end.

said(Name, Mark, {driven, HeardUs}) -> [{Name, info, {driven, Mark, HeardUs}}];
said(Name, Mark, {stalled, Told}) -> [{Name, info, {stalled, Mark, Told}}];
said(Name, Mark, {actuated, Device, Value}) -> [{Name, info, {actuated, Mark, Device, Value}}];
said(_Name, _Mark, {not_understood, _Commands}) -> [].

%% -- the actions of machines ----------------------------------------------------------------

%% @doc Carries out an action of a machine on the world, at the end of the step.
-spec perform(starl_platform:world_action(), starl_machine:name(), t()) ->
    {[starl_robot:local()], t()}.
perform({transmit, To, Packet}, _Name, #body{packets = Packets, counts = Counts} = Body) ->
    Counted = starl_live_counts:transmits(To, Packet, Counts),
    {[], out({transmit, To, Packet}, Body#body{packets = Packets + 1, counts = Counted})};
perform({sense, {near, _Mm}, Tag}, Name, #body{participants = Team} = Body) ->
    %% no positioning system answers that yet
    perform({sense, starl_team:members(Team), Tag}, Name, Body);
perform({sense, Robots, Tag}, Name, Body) ->
    {[], out({sense, {Name, Tag}, Robots}, Body)};
perform({feel, Kind, Tag}, Name, Body) ->
    {[], out({feel, Kind, {Name, Kind, Tag}}, Body)};
perform({drive, Script, Mark}, Name, #body{now = Now} = Body) ->
    Out = {drive, Script, Now + ?LATEST_US, {Name, Mark}},
    {[], out(Out, Body#body{script = {Now, Script, {Name, Mark}}})};
perform({actuate, Device, Value}, _Name, Body) ->
    {[], out({actuate, Device, Value, none}, Body)};
perform({actuate, Device, Value, Mark}, Name, Body) ->
    {[], out({actuate, Device, Value, {mark, {Name, Mark}}}, Body)};
perform({until, Us, {trace, Event}, Mark}, Name, #body{id = Id, now = Now} = Body) ->
    Fact = {Now, Id, Name, Event},
    {[], noted({until, Us, Fact, {Name, Mark}}, counted(Fact, Body))};
perform({until, Us, Action, Mark}, Name, Body) ->
    {Events, #body{out = [Out | Earlier]} = Next} = perform(Action, Name, Body),
    {Events, leased(Us, Action, Next#body{out = [{until, Us, Out, {Name, Mark}} | Earlier]})};
perform({outlived, N}, _Name, Body) ->
    {[], out({outlived, N}, Body)};
perform({reloaded, #{tell := nobody} = Told}, Name, Body) ->
    {[], reloaded(Told, Name, Body)};
perform({reloaded, #{tell := others} = Told}, Name, #body{parts = Parts} = Body) ->
    Others = lists:delete(Name, lists:sort(maps:keys(Parts))),
    {[{To, info, {restarted, Name}} || To <- Others], reloaded(Told, Name, Body)}.

leased(Us, {transmit, _, Packet}, #body{counts = Counts} = Body) ->
    Body#body{counts = starl_live_counts:sent_until(Us, Packet, Counts)};
leased(_Us, _Action, Body) ->
    Body.

%% -- new code -------------------------------------------------------------------------------

%% @doc A reload begins: the words for the robot's machines, which start with this code from now
%% on. This process is told how each machine heeds it: `{starl_reloaded, Robot, Machine, Told}'.
-spec reload(starl_reload:order(), pid(), t()) ->
    {[{starl_machine:name(), starl_reload:word()}], t()}.
reload(Order, Reporter, #body{parts = Parts, codes = Codes} = Body) ->
    {Words, Next} = starl_reload:take(Order, Parts, Codes),
    {Words, Body#body{codes = Next, reporter = Reporter}}.

%% @doc A reload has failed elsewhere: the words for the machines that have to go back.
-spec take_back(starl_reload:count(), Failed :: starl:robot_id(), t()) ->
    {[{starl_machine:name(), starl_reload:word()}], t()}.
take_back(N, Failed, #body{codes = Codes} = Body) ->
    {Words, Next} = starl_reload:back(N, Failed, Codes),
    {Words, Body#body{codes = Next}}.

%% @doc A machine that was given up takes no new code.
-spec gone(starl_machine:name(), starl_reload:word(), t()) -> t().
gone(Name, {take, #{number := N, module := Module}}, Body) ->
    Told = #{number => N, outcome => done, module => Module, tell => nobody},
    reloaded(Told, Name, Body);
gone(_Name, {back, _, _}, Body) ->
    Body.

%% @doc A machine has ended by itself: new code on trial is given up.
-spec fallen(starl_machine:name(), starl_crash:cause() | none, t()) -> t().
fallen(_Name, none, Body) ->
    Body;
fallen(Name, Cause, #body{now = Now, codes = Codes} = Body) ->
    all_reloaded(starl_reload:fallen(Name, Cause, Now, Codes), Name, Body).

all_reloaded(Told, Name, Body) ->
    lists:foldl(fun(One, B) -> reloaded(One, Name, B) end, Body, Told).

reloaded(#{number := N, outcome := Outcome, module := Module} = Told, Name, Body) ->
    #body{id = Id, codes = Codes} = Traced = trace(Name, {reloaded, N, Outcome}, Body),
    Line = unicode:characters_to_binary(starl_reload:format(Id, Name, Module, Outcome)),
    logger:notice(#{what => reload, outcome => Line}),
    Heard = starl_reload:heard(Name, Told, Codes),
    out({report, {starl_reloaded, Id, Name, Told}}, Traced#body{codes = Heard}).

%% @doc No machine commands the chassis any more.
-spec stop(t()) -> t().
stop(Body) -> out(stop, Body).

out(What, #body{out = Out} = Body) -> Body#body{out = [What | Out]}.

%% @doc Sends what the step has traced, and then what it sends; and says which machines must learn that
%% something was late.
-spec flush(t()) -> {Late :: [starl_robot:local()], t()}.
flush(#body{traces = [], out = [], late = [], told = Told, result = Told} = Body) ->
    {[], Body};
flush(#body{out = Out} = Body) ->
    Sent = lists:foldl(fun leave/2, tell(Body), lists:reverse(Out)),
    Late = [{Name, info, {late, Mark}} || {Name, Mark} <- lists:reverse(Sent#body.late)],
    {Late, Sent#body{out = [], late = []}}.

tell(#body{traces = Traces, batch = N, result = Result} = Body) ->
    Looked = present(Body),
    {Events, Late} = leaving(lists:reverse(Traces), Looked, [], []),
    Batch = {N, Looked, Events},
    Record = recorded(Batch, Body),
    ok = sunk(Batch, Body),
    ok = observed(Events, Body),
    Told = Body#body{traces = [], batch = N + 1, told = Result, record = Record},
    lists:foldl(fun late/2, Told, lists:uniq(Late)).

%% The facts that may leave now, and who is told that others are late.
leaving([{until, Us, Fact, _Owner} | Facts], Now, Left, Late) when Now =< Us ->
    leaving(Facts, Now, [Fact | Left], Late);
leaving([{until, _Us, _Fact, Owner} | Facts], Now, Left, Late) ->
    leaving(Facts, Now, Left, [Owner | Late]);
leaving([Fact | Facts], Now, Left, Late) ->
    leaving(Facts, Now, [Fact | Left], Late);
leaving([], _Now, Left, Late) ->
    {lists:reverse(Left), lists:reverse(Late)}.

recorded(_Batch, #body{record = none}) -> none;
recorded(Batch, #body{record = Record}) -> starl_live_record:write(Batch, Record).

sunk(_Batch, #body{sink = none}) ->
    ok;
sunk({_, _, Events} = Batch, #body{id = Id, sink = Sink, result = Result, told = Told}) ->
    _ = Events =/= [] andalso (Sink ! {starl_traced, Id, self(), Batch}),
    _ = Result =/= Told andalso (Sink ! {starl_ended, Id, self(), Result}),
    ok.

observed([], _Body) -> ok;
observed(Events, #body{observer = Observer}) -> starl_observer:tell({judged, Events, []}, Observer).

leave({until, Us, Out, Owner}, Body) ->
    case present(Body) =< Us of
        true ->
            _ = send_until(Us, Out, Owner, Body),
            Body;
        false ->
            late(Owner, Body)
    end;
leave(Out, Body) ->
    _ = send(Out, Body),
    Body.

send({transmit, To, Packet}, #body{transport = Transport}) ->
    starl_live_transport:transmit(Transport, To, Packet);
send({sense, Tag, Robots}, #body{positioning = Positioning}) ->
    starl_live_positioning:ask(Positioning, Tag, Robots);
%% What no sense of its own tells is asked of the chassis.
send({feel, Kind, Mark}, #body{senses = Senses, chassis = Chassis}) ->
    case Senses of
        #{Kind := Sense} -> starl_live_sense:ask(Sense, Mark);
        #{} -> starl_live_chassis:feel(Chassis, Kind, Mark)
    end;
send({drive, Script, Until, Mark}, #body{chassis = Chassis}) ->
    starl_live_chassis:drive(Chassis, Script, Until, Mark);
send({actuate, Device, Value, Mark}, #body{chassis = Chassis}) ->
    starl_live_chassis:actuate(Chassis, Device, Value, Mark);
send({report, _Report}, #body{reporter = none}) ->
    ok;
send({report, Report}, #body{reporter = Reporter}) ->
    Reporter ! Report;
%% The link ends, and with it the whole robot; its supervisor starts it anew.
send({outlived, N}, #body{store = Store}) ->
    logger:error(#{what => store_outdated, incarnation => N}),
    case starl_live_store:outdate(N, Store) of
        ok -> exit({shutdown, outlived});
        {error, Why} -> exit({shutdown, {store, unicode:characters_to_binary(Why)}})
    end;
send(rest, #body{chassis = Chassis}) ->
    starl_live_chassis:rest(Chassis);
send(stop, #body{chassis = Chassis}) ->
    starl_live_chassis:stop(Chassis).

%% The radio and the chassis look once more.
send_until(Us, {transmit, To, Packet}, Owner, #body{transport = Transport}) ->
    starl_live_transport:transmit(Transport, To, Packet, {Us, Owner});
send_until(Us, {drive, Script, Latest, Mark}, _Owner, Body) ->
    send({drive, Script, min(Us, Latest), Mark}, Body);
send_until(_Us, Out, _Owner, Body) ->
    send(Out, Body).

late({Name, _Mark} = Owner, #body{late = Late} = Body) ->
    logger:warning(#{what => late, machine => Name}),
    Body#body{late = [Owner | Late]}.

%% -- the robot's driver ---------------------------------------------------------------------

%% @doc Counts an event, whose step begins now: the steps before it in its turn took time.
-spec handles(starl_machine:name(), starl_machine:event_type() | boot, term(), t()) -> t().
handles(Name, boot, _Content, #body{events = Events} = Body0) ->
    #body{now = Now, codes = Codes} = Body = at(event, Body0),
    {Told, Begun} = starl_reload:started(Name, Now, Codes),
    input({other, boot}, all_reloaded(Told, Name, Body#body{events = Events + 1, codes = Begun}));
handles(app, info, {sensed, _} = Sensed, #body{events = Events} = Body) ->
    trace(chassis, Sensed, input(now, (at(event, Body))#body{events = Events + 1}));
handles(_Name, _Type, _Content, #body{events = Events} = Body) ->
    input(now, (at(event, Body))#body{events = Events + 1}).

%% @doc The time at which the present step began, by the robot's clock.
-spec clock(t()) -> integer().
clock(#body{now = Now}) -> Now.

%% @doc The time that the robot's clock shows now.
-spec present(t()) -> integer().
present(#body{clock = Clock, now = Now}) -> max(Now, starl_live_clock:now_us(Clock)).

%% @doc The start configuration of a machine. Its random stream is new with each start.
-spec base(starl_machine:name(), Incarnation :: pos_integer(), t()) -> starl_machine:config().
base(Name, Incarnation, #body{id = Id, participants = Team, now = Now, store = Store} = Body) ->
    #body{team_seed = Seed, random = Random} = Body,
    (own_clock(Name, starl_reload:code(Name, Body#body.codes), Body))#{
        robot => Id,
        participants => Team,
        name => Name,
        incarnation => Incarnation,
        stored => starl_live_store:kept(Name, Store),
        random => Random(Name, Incarnation),
        team_seed => Seed,
        now => Now,
        histories => Body#body.histories,
        snapshots => is_kept(Body)
    }.

%% An application looks at the clock itself when it is told of a grant.
own_clock(app, Base, #body{clock = Clock}) ->
    Base#{clock => fun() -> starl_live_clock:now_us(Clock) end};
own_clock(_Name, Base, _Body) ->
    Base.

%% @doc Records a fact.
-spec trace(starl_machine:name(), Event :: term(), t()) -> t().
trace(Name, Event, #body{id = Id, now = Now} = Body) ->
    _ = Event =:= late andalso logger:warning(#{what => late, machine => Name}),
    Fact = {Now, Id, Name, Event},
    noted(Fact, counted(Fact, Body)).

counted(Fact, #body{counts = Counts} = Body) ->
    Body#body{counts = starl_live_counts:traced(Fact, Counts)}.

noted(Fact, #body{traces = Traces} = Body) -> at_once(Body#body{traces = [Fact | Traces]}).

at_once(#body{tell = at_once} = Body) -> tell(Body);
at_once(#body{tell = step} = Body) -> Body.

%% @doc Plans a timer's event: the link gets `{timeout, _, {starl_timer, Name, Timer, Mark,
%% Content}}'. The time is rounded up to a millisecond.
-spec plan(starl_machine:name(), starl_robot_timers:timer(), non_neg_integer(), term(), t()) ->
    {starl_robot_timers:mark(), t()}.
plan(Name, Timer, Us, Content, #body{now = Now, clock = Clock, marks = Mark, dues = Dues} = Body) ->
    Due = starl_live_clock:monotonic_ms(Now + Us, Clock),
    Message = {starl_timer, Name, Timer, Mark, Content},
    At = max(Due, starl_live_clock:monotonic_time(millisecond, Clock)),
    _ = starl_live_clock:start_timer(At, Message, [{abs, true}], Clock),
    {Mark, Body#body{marks = Mark + 1, dues = Dues#{Mark => {Now + Us, Name, Timer, Content}}}}.

%% @doc When the first of these timers, which run, was due; the present time, if none is. All others are
%% forgotten.
-spec due_us([starl_robot_timers:mark()], t()) -> {DueUs :: integer(), t()}.
due_us(Running, #body{dues = Dues, now = Now} = Body) ->
    Left = maps:with(Running, Dues),
    First = maps:fold(fun(_Mark, {Due, _, _, _}, Us) -> min(Due, Us) end, Now, Left),
    {First, Body#body{dues = Left}}.

%% @doc Makes a term durable.
-spec store(starl_machine:name(), term(), t()) -> {ok, t()} | full.
store(Name, Term, #body{store = Store} = Body) ->
    case starl_live_store:keep(Name, Term, Store) of
        ok -> {ok, Body};
        full -> full
    end.

%% @doc The application has ended. Its first end counts, unless a result follows.
-spec ended(starl_robot:ended(), t()) -> t().
ended({done, _} = Done, Body) -> out(rest, Body#body{result = Done});
ended(given_up, #body{result = running} = Body) -> Body#body{result = given_up};
ended(_, Body) -> Body.
