%% @doc One robot, the same under every driver (the simulator, the checker, the link of a real
%% robot). It passes an event to a machine and carries out the machine's actions, in their order.
%% Then it handles the local events that these cause for the robot's other machines, until none is
%% left.
%% ```
%%     event of the world or a timer --> machine --> actions --> world, timers, trace, store
%%                                          ^           |
%%                                          +-----------+ local events, in their order
%% '''
%% The module is pure: a driver ({@link starl_driver}) hands events in and handles each
%% {@link result()}. It hands in the next one when the robot is quiet. Before that the robot may
%% need its driver:
%% ```
%%     up --> busy       a process has an order, until answered/3 or leave/1
%%     up --> stalled    in mid-step (fault injection), until go_on/1 and run/1
%%     up --> down       until come_up/2
%%     up, down --> dead for good
%% '''
%% The module also handles lost machines and restarts. The machines themselves are in
%% {@link starl_robot_machines}, the timers that run in {@link starl_robot_timers}.
-module(starl_robot).

-export([
    new/4, restore/1, id/1, condition/1, world/1, world/2, machines/1, machines/2, timers/1
]).
-export([run/1, status/1, event/5, expire/4, fire/6, answered/3, busy/1, pace/2, next/1]).
-export([put_off/2, leave/1, act/4, stand_still/3, go_on/1, standing/1]).
-export([lost/3, attach/3, back/3, without_calls/2, first/2, then/2, die/2, go_down/1, come_up/2]).

-export_type([t/0, local/0, world/0, condition/0, ended/0, standing/0]).

%% Actions are what most of a run's time goes to.
-compile({inline, [effect/6, outward/7, answer/6, stepped/5, performed/4, work/4]}).

%% A local event: a machine handles an event, or boots.
-type local() ::
    {starl_machine:name(), starl_machine:event_type(), Content :: term()}
    | {starl_machine:name(), boot, none}.

%% The driver's own state.
-type world() :: starl_driver:world().

%% Up, down for a while, or dead for good.
-type condition() :: up | down | dead.

%% The end of its application: with a result, by too many crashes, or with the death of the robot.
-type ended() :: {done, Result :: term()} | given_up | died.

%% What the driver does next. `quiet': the robot has nothing left to do. Else a process has to carry
%% out this order, which the driver sends; or a machine has crashed, by itself or by a full store.
%% Or the robot pauses ({@link pace/2}), or stalls in mid-step ({@link stand_still/3}).
-type result() ::
    {quiet, t()}
    | {stands, t()}
    | {ask, pid(), starl_driver:order(), t()}
    | {crashed, starl_machine:name(), Reason :: term(), t()}
    | {paused, t()}.

%% The rest of a step in which the robot stalls: the machine, its actions that are left, the local
%% events that have resulted so far, newest first, and the time of the robot's clock at the stall.
-type rest() :: {starl_machine:name(), [action()], New :: [local()], SinceUs :: integer()}.

%% An action, a point at which the robot stalls, or actions with a latest moment.
-type action() ::
    starl_machine:action() | stand_still | {until, Us :: integer(), [action()], Mark :: term()}.

%% Fault injection: stall after N actions in this machine's next step that has more than N.
-type still() :: {starl_machine:name(), Actions :: non_neg_integer()} | none.

%% What is left to do for a robot that is stalled in mid-step: the rest of the step, and the local
%% events that are due after it.
-type standing() :: {rest(), [local()]}.

%% `busy': the process of this machine is at work. `stands': the robot is stalled; `due': it is to
%% go on with the rest of the step.
-type state() ::
    up | {busy, starl_machine:name(), pid()} | {stands | due, rest()} | down | dead.

%% What hardly changes. The driver's functions are looked up once: to call a fun is much faster than
%% to call by module and name.
-record(setup, {
    id :: starl:robot_id(),
    driver :: module(),
    handles :: fun(),
    clock :: fun(),
    present :: fun(),
    trace :: fun(),
    plan :: fun(),
    perform :: fun(),
    pace = on :: on | single,
    still = none :: still()
}).

%% It is copied at each event, so it is small. During a turn, the world and the timers are passed
%% beside it.
-record(robot, {
    setup :: #setup{},
    state = up :: state(),
    world :: world(),
    machines :: starl_robot_machines:t(),
    timers = starl_robot_timers:new() :: starl_robot_timers:t(),
    %% local events of the present moment, in order
    local = [] :: [local()]
}).

-opaque t() :: #robot{}.

%% @doc Makes a robot whose machines all boot first. Its driver has the callbacks of
%% {@link starl_driver} and {@link starl_platform}.
-spec new(starl:robot_id(), Driver :: module(), world(), starl_robot_machines:t()) -> t().
new(Id, Driver, World, Machines) ->
    #robot{
        setup = setup(Id, Driver),
        world = World,
        machines = Machines,
        local = starl_robot_machines:boots(Machines)
    }.

setup(Id, Driver) ->
    #setup{
        id = Id,
        driver = Driver,
        handles = fun Driver:handles/4,
        clock = fun Driver:clock/1,
        present = fun Driver:present/1,
        trace = fun Driver:trace/3,
        plan = fun Driver:plan/5,
        perform = fun Driver:perform/3
    }.

%% @doc Restores a robot that is quiet or is stalled in mid-step.
-spec restore(
    #{
        id := starl:robot_id(),
        driver := module(),
        world := world(),
        condition := condition(),
        machines := starl_robot_machines:t(),
        timers := starl_robot_timers:t(),
        standing => standing() | none
    }
) -> t().
restore(#{id := Id, driver := Driver, world := World, machines := Machines} = Given) ->
    #{condition := Condition, timers := Timers} = Given,
    Quiet = #robot{
        setup = setup(Id, Driver),
        state = Condition,
        world = World,
        machines = Machines,
        timers = Timers
    },
    case maps:get(standing, Given, none) of
        none -> Quiet;
        {Left, Due} -> Quiet#robot{state = {stands, Left}, local = Due}
    end.

%% @doc The robot's number.
-spec id(t()) -> starl:robot_id().
id(#robot{setup = #setup{id = Id}}) -> Id.

%% @doc The robot's condition.
-spec condition(t()) -> condition().
condition(#robot{state = down}) -> down;
condition(#robot{state = dead}) -> dead;
condition(#robot{}) -> up.

%% @doc The driver's own state.
-spec world(t()) -> world().
world(#robot{world = World}) -> World.

%% @doc Replaces the driver's own state.
-spec world(world(), t()) -> t().
world(World, Robot) -> Robot#robot{world = World}.

%% @doc The robot's machines.
-spec machines(t()) -> starl_robot_machines:t().
machines(#robot{machines = Machines}) -> Machines.

%% @doc Replaces the robot's machines.
-spec machines(starl_robot_machines:t(), t()) -> t().
machines(Machines, Robot) -> Robot#robot{machines = Machines}.

%% @doc The timers that run.
-spec timers(t()) -> starl_robot_timers:t().
timers(#robot{timers = Timers}) -> Timers.

%% @doc The machine whose process is at work.
-spec busy(t()) -> starl_machine:name() | none.
busy(#robot{state = {busy, Name, _Pid}}) -> Name;
busy(#robot{}) -> none.

%% @doc Sets whether the robot runs until it is quiet, or pauses after each event.
-spec pace(on | single, t()) -> t().
pace(Pace, #robot{setup = Setup} = Robot) -> Robot#robot{setup = Setup#setup{pace = Pace}}.

%% @doc Returns whether the robot is up with no local events left (`quiet'), up with some (`busy'),
%% or down or dead (`off'); and the driver's own state.
-spec status(t()) -> {quiet | busy | off, world()}.
status(#robot{state = State, world = World}) when State =:= down; State =:= dead -> {off, World};
status(#robot{local = [], world = World}) -> {quiet, World};
status(#robot{world = World}) -> {busy, World}.

%% -- events ---------------------------------------------------------------------------------

%% @doc Handles the local events that are left.
-spec run(t()) -> result().
run(#robot{state = {stands, _}} = Robot) ->
    {stands, Robot};
run(#robot{state = {due, {Name, Actions, New, Since}}, world = World, timers = Timers} = Robot) ->
    Present = Robot#robot.setup#setup.present,
    Rest = aged(max(0, Present(World) - Since), Actions),
    perform(Rest, Name, New, World, Timers, Robot#robot{state = up});
run(#robot{local = Local, world = World, timers = Timers} = Robot) ->
    next(Local, World, Timers, Robot).

%% @doc Handles an event of a machine, and all local events that follow from it. The driver's state
%% must be at the event's time.
-spec event(starl_machine:name(), starl_machine:event_type(), Content :: term(), world(), t()) ->
    result().
event(Name, Type, Content, World, #robot{timers = Timers} = Robot) ->
    fire(Name, Type, Content, World, Timers, Robot).

%% @doc Handles an expired timer with this mark. If the timer still runs, returns the kind of event
%% and the timers that are left, for {@link fire/6}.
-spec expire(starl_machine:name(), starl_robot_timers:timer(), starl_robot_timers:mark(), t()) ->
    {ok, starl_machine:event_type(), Left :: starl_robot_timers:t()} | stale.
expire(Name, Timer, Mark, #robot{timers = Timers}) ->
    case starl_robot_timers:expire(Name, Timer, Mark, Timers) of
        {ok, Left} -> {ok, starl_robot_timers:event_type(Timer), Left};
        stale -> stale
    end.

%% @doc Handles the event of an expired timer, as {@link event/5}; these timers are left.
-spec fire(
    starl_machine:name(), starl_machine:event_type(), Content :: term(), world(), Left, t()
) ->
    result()
when
    Left :: starl_robot_timers:t().
fire(Name, Type, Content, World, Timers, #robot{setup = Setup, machines = Machines} = Robot) ->
    #setup{id = Id, clock = Clock} = Setup,
    Meta = #{now => Clock(World), robot => Id},
    Answer = starl_robot_machines:step(Name, Type, Content, Meta, Machines),
    answer(Answer, Name, Type, World, Timers, Robot).

boot(Name, World, Timers, #robot{setup = Setup, machines = Machines} = Robot) ->
    #setup{driver = Driver, handles = Handles, trace = Trace} = Setup,
    Noted = Handles(Name, boot, none, World),
    Given = Driver:base(Name, starl_robot_machines:incarnation(Name, Machines), Noted),
    Base = lived(Name, Machines, Given#{life => starl_robot_machines:life(Name, Machines)}),
    %% monitors learn that the machine has lost its stored term, if it had one
    Known =
        case Base of
            #{stored := damaged} -> Trace(Name, store_damaged, Noted);
            #{} -> Noted
        end,
    answer(starl_robot_machines:boot(Name, Base, Machines), Name, boot, Known, Timers, Robot).

%% Others know only the lives of SAP.
lived(sap, Machines, Base) -> Base#{latest_life => starl_robot_machines:latest_life(Machines)};
lived(_Name, _Machines, Base) -> Base.

answer({done, Actions, Machines}, Name, _Type, World, Timers, Robot) ->
    stepped(Actions, Name, World, Timers, Robot#robot{machines = Machines});
answer({ask, Pid, Order}, Name, _Type, World, Timers, Robot) ->
    {ask, Pid, Order, Robot#robot{state = {busy, Name, Pid}, world = World, timers = Timers}};
answer({crashed, Reason}, Name, _Type, World, Timers, Robot) ->
    {crashed, Name, Reason, Robot#robot{world = World, timers = Timers}};
answer(absent, Name, Type, World, Timers, Robot) ->
    Trace = Robot#robot.setup#setup.trace,
    performed(refusal(Name, Type), Trace(Name, {unknown_machine, Name}, World), Timers, Robot).

%% A call to a machine that the robot does not have gets an answer, so nothing waits for ever.
refusal(Name, {call, {From, Tag}}) -> [{From, {reply, Tag}, {no_such_machine, Name}}];
refusal(_Name, _Type) -> [].

%% @doc Carries out the actions that a process has returned. `ignored': it is not the process at
%% work, since a killed process may have answered before its end.
-spec answered(pid(), [starl_machine:action()], t()) -> result() | ignored.
answered(Pid, Actions, #robot{state = {busy, Name, Pid}, world = World} = Robot) ->
    stepped(Actions, Name, World, Robot#robot.timers, Robot#robot{state = up});
answered(_Pid, _Actions, #robot{}) ->
    ignored.

%% @doc Puts an order back that was not sent yet: it becomes the next local event again.
-spec put_off(starl_driver:order(), t()) -> t().
put_off(Order, #robot{state = {busy, Name, _Pid}, local = Local} = Robot) ->
    Robot#robot{state = up, local = [starl_driver:event(Name, Order) | Local]}.

%% @doc Leaves the process at work alone, and goes on without it. {@link act/4} takes its answer
%% when the robot is quiet. Until then the driver must keep further orders to this process back.
%% Only a driver in real time does so, with an application that may compute for long.
-spec leave(t()) -> result().
leave(#robot{state = {busy, _Name, _Pid}} = Robot) -> run(Robot#robot{state = up}).

%% @doc Carries out the actions of a process that was left alone ({@link leave/1}). The driver's
%% state must be at the present time.
-spec act(starl_machine:name(), [starl_machine:action()], world(), t()) -> result().
act(Name, Actions, World, #robot{timers = Timers} = Robot) ->
    none = busy(Robot),
    perform(Actions, Name, [], World, Timers, Robot).

%% @doc Removes and returns the next local event.
-spec next(t()) -> {local(), t()} | none.
next(#robot{local = []}) -> none;
next(#robot{local = [Event | Local]} = Robot) -> {Event, Robot#robot{local = Local}}.

%% The next local event, if there is one.
next([], World, Timers, Robot) ->
    {quiet, Robot#robot{local = [], world = World, timers = Timers}};
next([{Name, boot, none} | Left], World, Timers, Robot) ->
    boot(Name, World, Timers, Robot#robot{local = Left});
next([{Name, Type, Content} | Left], World, Timers, #robot{setup = Setup} = Robot) ->
    Handles = Setup#setup.handles,
    Noted = Handles(Name, Type, Content, World),
    fire(Name, Type, Content, Noted, Timers, Robot#robot{local = Left}).

%% -- actions --------------------------------------------------------------------------------

%% Carries out the actions of a step. The robot may have to stall in it.
stepped(Actions, Name, World, Timers, #robot{setup = #setup{still = {Name, After}}} = Robot) ->
    case with_stall(After, Actions) of
        {ok, Cut} -> perform(Cut, Name, [], World, Timers, still(none, Robot));
        too_few -> perform(Actions, Name, [], World, Timers, Robot)
    end;
stepped(Actions, Name, World, Timers, Robot) ->
    perform(Actions, Name, [], World, Timers, Robot).

%% New holds the resulting local events, newest first.
perform([], _Name, New, World, Timers, Robot) ->
    performed(New, World, Timers, Robot);
perform([Action | Rest] = Actions, Name, New, World, Timers, Robot) ->
    case Action of
        {trace, Event} ->
            Trace = Robot#robot.setup#setup.trace,
            perform(Rest, Name, New, Trace(Name, Event, World), Timers, Robot);
        {cast, To, Content} ->
            perform(Rest, Name, [{To, cast, Content} | New], World, Timers, Robot);
        {reply, {To, Tag}, Answer} ->
            perform(Rest, Name, [{To, {reply, Tag}, Answer} | New], World, Timers, Robot);
        {call, To, Request, Tag} ->
            Call = {To, {call, {Name, Tag}}, Request},
            perform(Rest, Name, [Call | New], World, Timers, Robot);
        _ ->
            effect(Actions, Name, New, World, Timers, Robot)
    end.

%% The first action is neither a trace event nor a message to another machine.
effect([Action | Rest], Name, New, World, Timers, Robot) ->
    case Action of
        {{timeout, Timer}, cancel} ->
            Left = starl_robot_timers:cancel(Name, Timer, Timers),
            perform(Rest, Name, New, World, Left, Robot);
        {{timeout, Timer}, Us, Content} ->
            start({Timer, Us, Content}, Rest, Name, New, World, Timers, Robot);
        {state_timeout, cancel} ->
            Left = starl_robot_timers:cancel(Name, state_timeout, Timers),
            perform(Rest, Name, New, World, Left, Robot);
        {state_timeout, _Us, _Content} ->
            start(Action, Rest, Name, New, World, Timers, Robot);
        {store, Term} ->
            store(Term, Rest, Name, New, World, Timers, Robot);
        {done, Result} ->
            perform(Rest, Name, New, done(Result, World, Robot), Timers, Robot);
        {until, Us, Group, Mark} when is_list(Group) ->
            until({Us, Group, Mark}, Rest, Name, New, World, Timers, Robot);
        stand_still ->
            Since = (Robot#robot.setup#setup.present)(World),
            State = {stands, {Name, Rest, New, Since}},
            {stands, Robot#robot{state = State, world = World, timers = Timers}};
        _ ->
            outward(Action, Rest, Name, New, World, Timers, Robot)
    end.

%% What the world does.
outward(Action, Rest, Name, New, World, Timers, Robot) ->
    Perform = Robot#robot.setup#setup.perform,
    case Perform(Action, Name, World) of
        {[], Next} ->
            perform(Rest, Name, New, Next, Timers, Robot);
        {Events, Next} ->
            perform(Rest, Name, lists:reverse(Events, New), Next, Timers, Robot)
    end.

start({Timer, Us, Content}, Rest, Name, New, World, Timers, Robot) ->
    Plan = Robot#robot.setup#setup.plan,
    {Mark, Planned} = Plan(Name, Timer, Us, Content, World),
    Running = starl_robot_timers:start(Name, Timer, Mark, Timers),
    perform(Rest, Name, New, Planned, Running, Robot).

%% Later actions take place only when the term is durable.
store(Term, Rest, Name, New, World, Timers, #robot{local = Local} = Robot) ->
    case (driver(Robot)):store(Name, Term, World) of
        {ok, Stored} ->
            perform(Rest, Name, New, Stored, Timers, Robot);
        full ->
            Due = Local ++ lists:reverse(New),
            {crashed, Name, store_full, Robot#robot{local = Due, world = World, timers = Timers}}
    end.

done(Result, World, #robot{setup = #setup{trace = Trace}} = Robot) ->
    Trace(app, {done, Result}, (driver(Robot)):ended({done, Result}, World)).

%% Actions with a latest moment are carried out only before it.
until({Us, Group, Mark}, Rest, Name, New, World, Timers, #robot{setup = Setup} = Robot) ->
    #setup{present = Present, trace = Trace} = Setup,
    case Present(World) =< Us of
        true ->
            perform(bounded(Us, Mark, Group) ++ Rest, Name, New, World, Timers, Robot);
        false ->
            Local = late({Name, info, {late, Mark}}, Robot#robot.local),
            Late = Robot#robot{local = Local},
            perform(Rest, Name, New, Trace(Name, late, World), Timers, Late)
    end.

%% A machine learns what was too late before it handles anything else, one thing after the other.
late(Event, [{_, info, {late, _}} = Earlier | Local]) -> [Earlier | late(Event, Local)];
late(Event, Local) -> [Event | Local].

%% Each action of a group keeps the latest moment, and the driver looks at the clock again.
bounded(Us, Mark, Group) -> [bound(Us, Mark, Action) || Action <- Group].

bound(Us, Mark, {trace, _} = Action) -> {until, Us, Action, Mark};
bound(Us, Mark, {transmit, _, _} = Action) -> {until, Us, Action, Mark};
bound(Us, Mark, {drive, _, _} = Action) -> {until, Us, Action, Mark};
bound(Us, Mark, Action) when element(1, Action) =:= actuate -> {until, Us, Action, Mark};
bound(_Us, _Mark, Action) -> Action.

%% All actions are carried out: the local events that result come behind the others.
performed([], World, Timers, #robot{local = Local} = Robot) ->
    work(Local, World, Timers, Robot);
performed(New, World, Timers, #robot{local = Local} = Robot) ->
    work(Local ++ lists:reverse(New), World, Timers, Robot).

work(Local, World, Timers, #robot{setup = #setup{pace = on}} = Robot) ->
    next(Local, World, Timers, Robot);
work(Local, World, Timers, Robot) ->
    {paused, Robot#robot{local = Local, world = World, timers = Timers}}.

%% -- stalls ---------------------------------------------------------------------------------

%% @doc Fault injection: stalls the robot in the next step of this machine that has more than
%% `Actions' actions, after that many. Trace events in a group with a deadline are not separated
%% from the check of the clock.
-spec stand_still(starl_machine:name(), Actions :: non_neg_integer(), t()) -> t().
stand_still(Name, After, Robot) -> still({Name, After}, Robot).

still(Still, #robot{setup = Setup} = Robot) -> Robot#robot{setup = Setup#setup{still = Still}}.

%% @doc Ends the stall of the robot: {@link run/1} goes on with the step. The driver's state must be
%% at the present time.
-spec go_on(t()) -> t().
go_on(#robot{state = {stands, Rest}} = Robot) -> still(none, Robot#robot{state = {due, Rest}});
go_on(Robot) -> still(none, Robot).

%% @doc Returns what is left to do, if the robot is stalled in mid-step.
-spec standing(t()) -> standing() | none.
standing(#robot{state = {stands, Rest}, local = Local}) -> {Rest, Local};
standing(#robot{}) -> none.

%% The actions with the mark `stand_still' after this number, if there are more.
with_stall(After, Actions) ->
    case lists:sum([size_of(Action) || Action <- Actions]) > After of
        true -> {ok, cut(After, Actions)};
        false -> too_few
    end.

size_of({until, _Us, Group, _Mark}) when is_list(Group) -> length(Group);
%% a history of calls does not count: a run is the same with it and without
size_of({trace, {history, _}}) -> 0;
size_of(_Action) -> 1.

cut(0, Actions) ->
    [stand_still | Actions];
cut(After, [{until, Us, Group, Mark} | Rest]) when After =< length(Group) ->
    [{until, Us, cut_group(After, Group), Mark} | Rest];
cut(After, [{until, _, Group, _} = Until | Rest]) ->
    [Until | cut(After - length(Group), Rest)];
cut(After, [Action | Rest]) ->
    [Action | cut(After - size_of(Action), Rest)].

%% The trace events of a group leave with the check of the clock.
cut_group(After, Group) ->
    Facts = lists:takewhile(fun(Action) -> element(1, Action) =:= trace end, Group),
    {Before, Behind} = lists:split(max(After, length(Facts)), Group),
    Before ++ [stand_still | Behind].

%% The actions of a step that began this long ago: its timers count from its beginning.
aged(Us, Actions) -> [older(Us, Action) || Action <- Actions].

older(Us, {{timeout, Name}, Time, Content}) ->
    {{timeout, Name}, max(0, Time - Us), Content};
older(Us, {state_timeout, Time, Content}) ->
    {state_timeout, max(0, Time - Us), Content};
older(Us, {until, Latest, Group, Mark}) when is_list(Group) ->
    {until, Latest, aged(Us, Group), Mark};
older(_Us, Action) ->
    Action.

%% -- crashes --------------------------------------------------------------------------------

%% @doc Handles the end of a machine, for this reason: its timers are forgotten. A crash by itself
%% is traced for its supervisor; an end from outside is not.
-spec lost(starl_machine:name(), Reason :: term(), t()) -> t().
lost(Name, Reason, Robot) ->
    #robot{state = State} = Bare = lose(Name, Robot),
    Left = Bare#robot{state = state_without(Name, State)},
    case starl_crash:cause(Reason) of
        none -> Left;
        Cause -> trace(supervisor, {crashed, Name, Cause}, Left)
    end.

state_without(Name, {busy, Name, _Pid}) -> up;
state_without(Name, {How, {Name, _Actions, New, Since}}) -> {How, {Name, [], New, Since}};
state_without(_Name, State) -> State.

%% It may not even have booted: its successor boots.
lose(Name, #robot{timers = Timers, local = Local} = Robot) ->
    trace(Name, crashed, Robot#robot{
        timers = starl_robot_timers:forget(Name, Timers),
        local = lists:delete({Name, boot, none}, Local)
    }).

%% @doc Attaches a process that has started as the machine of this name
%% ({@link starl_robot_machines:attach/3}).
-spec attach(starl_machine:name(), pid(), t()) -> {ok, t()} | early.
attach(Name, Pid, #robot{machines = Machines} = Robot) ->
    case starl_robot_machines:attach(Name, Pid, Machines) of
        {ok, Attached} -> {ok, Robot#robot{machines = Attached}};
        early -> early
    end.

%% @doc Handles restarts, before all other local events. The machines that have come back boot. The
%% robot's other machines are notified of them, and of the machines that were given up
%% ({@link starl_robot_machines:news/3}). Pending calls to a machine that has come back are void,
%% and their callers are notified.
-spec back(Back :: [starl_machine:name()], GivenUp :: [starl_machine:name()], t()) -> t().
back(Back, GivenUp, #robot{machines = Machines} = Robot) ->
    Left = lists:foldl(fun give_up/2, void_calls(Back, Robot), GivenUp),
    first(starl_robot_machines:news(Back, GivenUp, Machines), Left).

void_calls(Back, #robot{local = Local, state = State} = Robot) ->
    Robot#robot{local = without_call_events(Back, Local), state = void_rest(Back, State)}.

void_rest(Back, {How, {Name, Actions, New, Since}}) ->
    Left = without_calls(Back, Actions),
    {How, {Name, Left, without_call_events(Back, New), Since}};
void_rest(_Back, State) ->
    State.

%% @doc The actions of a step without its calls of these machines, which have restarted since the step
%% began: the caller is about to learn of that, and takes it for the end of its call ({@link
%% back/3}). A call that reached the new machine all the same would be answered to nobody.
-spec without_calls([starl_machine:name()], [starl_machine:action()]) -> [starl_machine:action()].
without_calls([], Actions) -> Actions;
without_calls(Restarted, Actions) -> [A || A <- Actions, not is_call(A, Restarted)].

is_call({call, To, _, _}, Names) -> lists:member(To, Names);
is_call(_Action, _Names) -> false.

without_call_events(Restarted, Events) -> [E || E <- Events, not is_call_event(E, Restarted)].

is_call_event({To, {call, _From}, _Request}, Names) -> lists:member(To, Names);
is_call_event(_Event, _Names) -> false.

give_up(app, Robot) -> ended(given_up, trace(supervisor, {given_up, app}, Robot));
give_up(Name, Robot) -> trace(supervisor, {given_up, Name}, Robot).

%% @doc Puts local events in front of the others. Machines that have yet to boot need no news.
-spec first([local()], t()) -> t().
first(New, #robot{local = Local} = Robot) ->
    Waiting = [Name || {Name, boot, none} <- Local],
    Heard = [L || {To, Type, _} = L <- New, Type =/= info orelse not lists:member(To, Waiting)],
    Robot#robot{local = Heard ++ Local}.

%% @doc Puts local events behind the others.
-spec then([local()], t()) -> t().
then(New, #robot{local = Local} = Robot) -> Robot#robot{local = Local ++ New}.

%% @doc The robot dies for good: it stops at its place for ever.
-spec die(gave_up | killed, t()) -> t().
die(Reason, Robot) ->
    Dead = ended(died, trace(robot, {died, Reason}, stop(Robot))),
    gone(dead, Dead).

%% @doc The robot goes down for a while: it stops, and all its machines are lost.
-spec go_down(t()) -> t().
go_down(#robot{machines = Machines} = Robot) ->
    Stopped = trace(robot, down, stop(Robot)),
    gone(down, lists:foldl(fun lose/2, Stopped, starl_robot_machines:names(Machines))).

%% Only its numbers of starts are left.
gone(Condition, #robot{machines = Machines} = Robot) ->
    still(none, Robot#robot{
        state = Condition,
        machines = starl_robot_machines:down(Machines),
        timers = starl_robot_timers:new(),
        local = []
    }).

%% @doc A robot that was down comes up: all its machines boot.
-spec come_up(starl_robot_machines:t(), t()) -> t().
come_up(Machines, #robot{state = down} = Robot) ->
    Boots = starl_robot_machines:boots(Machines),
    trace(robot, up, Robot#robot{state = up, machines = Machines, local = Boots}).

trace(Name, Event, #robot{world = World} = Robot) ->
    Robot#robot{world = (driver(Robot)):trace(Name, Event, World)}.

stop(#robot{world = World} = Robot) -> Robot#robot{world = (driver(Robot)):stop(World)}.

ended(How, #robot{world = World} = Robot) ->
    Robot#robot{world = (driver(Robot)):ended(How, World)}.

driver(#robot{setup = #setup{driver = Driver}}) -> Driver.
