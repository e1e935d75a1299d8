%% @doc The driver's state of a live robot: its clock, store and trace, and the ports to its radio,
%% positioning system and chassis. It is the world of the robot's {@link starl_robot}.
%%
%% What a step sends, and the trace events that it emits, are kept until the step is over
%% ({@link flush/1}). The trace events leave first, so a judge of the run knows of a packet before
%% anybody can have received it. An action with a deadline is checked again when it leaves. If it is
%% late, its machine gets an event before any other that waits. Trace events carry the time of this
%% check, too, since the robot may stall before anybody has them.
-module(starl_live_body).
-behaviour(starl_driver).
-behaviour(starl_platform).

-export([new/1, at/1, now_us/1, moment/1, tell_start/2, hear/2, flush/1]).
-export([figures/1, counts/1, line/2]).
-export([handles/4, clock/1, present/1, base/3, trace/3, plan/5, due_us/2, store/3, ended/2]).
-export([perform/3, stop/1, reload/3, take_back/3, fallen/3, gone/3]).

-export_type([t/0, config/0, figures/0, random/0]).

%% The body's own part of a configuration; that of its lines, its witnesses and its code: {@link
%% starl_live_lines:lines()}, {@link starl_live_witnesses:config()}, {@link starl_live_codes:config()}.
-type config() :: #{
    robot := starl:robot_id(),
    participants := starl_team:t(),
    team_seed := integer(),
    clock := starl_live_clock:t(),
    store := starl_live_store:t(),
    random => random(),
    tell => step | at_once,
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
    lines :: starl_live_lines:t(),
    witnesses :: starl_live_witnesses:t(),
    codes :: starl_live_codes:t(),
    %% the random stream of a machine that starts
    random :: random(),
    %% facts are told at the end of the step, or at once
    tell :: step | at_once,
    %% the time at which the present step began
    now :: integer(),
    timers = starl_live_timers:new() :: starl_live_timers:t(),
    %% of the present step, newest first
    traces = [] :: [starl_live_witnesses:fact()],
    out = [] :: [out()],
    %% whose facts and sendings were late, latest first
    late = [] :: [{starl_machine:name(), Mark :: term()}],
    events = 0 :: non_neg_integer(),
    packets = 0 :: non_neg_integer(),
    counts = starl_live_counts:new() :: starl_live_counts:t(),
    result = running :: starl_live_witnesses:result(),
    %% the machines of whose calls histories are kept
    histories = [] :: [starl_machine:name()]
}).

-opaque t() :: #body{}.

%% What a step sends.
-type out() ::
    starl_live_lines:out()
    | {until, Us :: integer(), out(), Owner :: {starl_machine:name(), Mark :: term()}}
    | {report, starl_live_codes:report()}
    | {outlived, starl_packet:incarnation()}.

%% @doc The body of a robot.
-spec new(config()) -> t().
new(#{robot := Id, participants := Team, clock := Clock, store := Store} = Config) ->
    #body{
        id = Id,
        participants = Team,
        team_seed = maps:get(team_seed, Config),
        clock = Clock,
        store = Store,
        lines = starl_live_lines:new(Config),
        witnesses = starl_live_witnesses:new(Config),
        codes = starl_live_codes:new(Config),
        random = maps:get(random, Config, fun(_Name, _Incarnation) -> rand:seed_s(exsss) end),
        tell = maps:get(tell, Config, step),
        histories = starl_live_codes:histories(Config),
        now = starl_live_clock:now_us(Clock)
    }.

%% @doc The body at a new event: time does not go back.
-spec at(t()) -> t().
at(Body) -> Body#body{now = present(Body)}.

%% @doc The time at which the present step began.
-spec now_us(t()) -> integer().
now_us(#body{now = Now}) -> Now.

%% @doc The counters of the robot.
-spec figures(t()) -> figures().
figures(#body{events = Events, packets = Packets}) -> #{events => Events, packets => Packets}.

%% @doc What the robot has counted since its link started.
-spec counts(t()) -> starl_live_counts:t().
counts(#body{counts = Counts}) -> Counts.

%% @doc The process of a line.
-spec line(transport | positioning | chassis, t()) -> pid().
line(Line, #body{lines = Lines}) -> starl_live_lines:process(Line, Lines).

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

%% @doc Tells the observer of this node that the robot starts.
-spec tell_start([starl_machine:name()], t()) -> ok.
tell_start(Names, #body{now = Now, witnesses = Witnesses}) ->
    starl_live_witnesses:started(Now, Names, Witnesses).

%% -- events from outside --------------------------------------------------------------------

%% @doc The events of the robot that a message of its lines is.
-spec hear(Message :: term(), t()) -> [starl_robot:local()] | unknown.
hear(Message, #body{lines = Lines, witnesses = Witnesses, clock = Clock}) ->
    Events = starl_live_lines:hear(Message, Lines),
    ok = starl_live_witnesses:seen(Events, Clock, Witnesses),
    Events.

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
    {[], out({drive, Script, Now + ?LATEST_US, {Name, Mark}}, Body)};
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
perform({reloaded, #{tell := others} = Told}, Name, #body{codes = Codes} = Body) ->
    Others = starl_live_codes:others(Name, Codes),
    {[{To, info, {restarted, Name}} || To <- Others], reloaded(Told, Name, Body)}.

leased(Us, {transmit, _, Packet}, #body{counts = Counts} = Body) ->
    Body#body{counts = starl_live_counts:sent_until(Us, Packet, Counts)};
leased(_Us, _Action, Body) ->
    Body.

%% -- new code -------------------------------------------------------------------------------

%% @doc A reload begins. Returns the commands for the robot's machines. This process gets a report
%% on how each machine applies its command.
-spec reload(starl_reload:order(), pid(), t()) -> {starl_live_codes:words(), t()}.
reload(Order, Reporter, #body{codes = Codes} = Body) ->
    {Words, Next} = starl_live_codes:reload(Order, Reporter, Codes),
    {Words, Body#body{codes = Next}}.

%% @doc A reload has failed elsewhere. Returns the commands for the machines that have to go back.
-spec take_back(starl_reload:count(), Failed :: starl:robot_id(), t()) ->
    {starl_live_codes:words(), t()}.
take_back(N, Failed, #body{codes = Codes} = Body) ->
    {Words, Next} = starl_live_codes:take_back(N, Failed, Codes),
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
fallen(Name, Cause, #body{now = Now, codes = Codes} = Body) ->
    all_reloaded(starl_live_codes:fallen(Name, Cause, Now, Codes), Name, Body).

all_reloaded(Told, Name, Body) ->
    lists:foldl(fun(One, B) -> reloaded(One, Name, B) end, Body, Told).

reloaded(#{number := N, outcome := Outcome} = Told, Name, Body) ->
    #body{id = Id, codes = Codes} = Traced = trace(Name, {reloaded, N, Outcome}, Body),
    {Report, Heard} = starl_live_codes:heeded(Told, Name, Id, Codes),
    out({report, Report}, Traced#body{codes = Heard}).

%% @doc No machine commands the chassis any more.
-spec stop(t()) -> t().
stop(Body) -> out(stop, Body).

out(What, #body{out = Out} = Body) -> Body#body{out = [What | Out]}.

%% @doc Sends what the step has traced, and then what it sends; and says which machines must learn that
%% something was late.
-spec flush(t()) -> {Late :: [starl_robot:local()], t()}.
flush(#body{traces = [], out = [], late = [], result = Result} = Body) ->
    case starl_live_witnesses:has_heard(Result, Body#body.witnesses) of
        true -> {[], Body};
        false -> left(Body)
    end;
flush(Body) ->
    left(Body).

left(#body{out = Out} = Body) ->
    Sent = lists:foldl(fun leave/2, tell(Body), lists:reverse(Out)),
    Late = [{Name, info, {late, Mark}} || {Name, Mark} <- lists:reverse(Sent#body.late)],
    {Late, Sent#body{out = [], late = []}}.

tell(#body{traces = Traces, result = Result, witnesses = Before} = Body) ->
    {Late, Witnesses} = starl_live_witnesses:tell(Traces, present(Body), Result, Before),
    lists:foldl(fun late/2, Body#body{traces = [], witnesses = Witnesses}, Late).

leave({until, Us, Out, Owner}, Body) ->
    case present(Body) =< Us of
        true ->
            _ = starl_live_lines:send_until(Us, Out, Owner, Body#body.lines),
            Body;
        false ->
            late(Owner, Body)
    end;
leave(Out, Body) ->
    _ = send(Out, Body),
    Body.

send({report, Report}, #body{codes = Codes}) ->
    starl_live_codes:report(Report, Codes);
%% The link ends, and with it the whole robot; its supervisor starts it anew.
send({outlived, N}, #body{store = Store}) ->
    logger:error(#{what => store_outdated, incarnation => N}),
    case starl_live_store:outdate(N, Store) of
        ok -> exit({shutdown, outlived});
        {error, Why} -> exit({shutdown, {store, unicode:characters_to_binary(Why)}})
    end;
send(Out, #body{lines = Lines}) ->
    starl_live_lines:send(Out, Lines).

late({Name, _Mark} = Owner, #body{late = Late} = Body) ->
    logger:warning(#{what => late, machine => Name}),
    Body#body{late = [Owner | Late]}.

%% -- the robot's driver ---------------------------------------------------------------------

%% @doc Counts an event, whose step begins now: the steps before it in its turn took time.
-spec handles(starl_machine:name(), starl_machine:event_type() | boot, term(), t()) -> t().
handles(Name, boot, _Content, #body{events = Events} = Body0) ->
    #body{now = Now, codes = Codes} = Body = at(Body0),
    {Told, Begun} = starl_live_codes:started(Name, Now, Codes),
    all_reloaded(Told, Name, Body#body{events = Events + 1, codes = Begun});
handles(app, info, {sensed, _} = Sensed, #body{events = Events} = Body) ->
    trace(chassis, Sensed, (at(Body))#body{events = Events + 1});
handles(_Name, _Type, _Content, #body{events = Events} = Body) ->
    (at(Body))#body{events = Events + 1}.

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
    (own_clock(Name, starl_live_codes:code(Name, Body#body.codes), Body))#{
        robot => Id,
        participants => Team,
        name => Name,
        incarnation => Incarnation,
        stored => starl_live_store:kept(Name, Store),
        random => Random(Name, Incarnation),
        team_seed => Seed,
        now => Now,
        histories => Body#body.histories
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

%% @doc Plans a timer's event.
-spec plan(starl_machine:name(), starl_robot_timers:timer(), non_neg_integer(), term(), t()) ->
    {starl_robot_timers:mark(), t()}.
plan(Name, Timer, Us, Content, #body{now = Now, clock = Clock, timers = Before} = Body) ->
    {Mark, Timers} = starl_live_timers:plan({Name, Timer, Us, Content}, Now, Clock, Before),
    {Mark, Body#body{timers = Timers}}.

%% @doc When the first of these timers, which run, was due; the present time, if none is.
-spec due_us([starl_robot_timers:mark()], t()) -> {DueUs :: integer(), t()}.
due_us(Running, #body{timers = Before, now = Now} = Body) ->
    {First, Timers} = starl_live_timers:due_us(Running, Now, Before),
    {First, Body#body{timers = Timers}}.

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
