%% @doc One robot, the same under every driver (the simulator, the checker, the link of a real
%% robot). It hands an event to a machine, carries out the machine's actions, and then handles the
%% local events that these cause for the robot's other machines, until none is left.
%% ```
%%     event of the world or a timer --> machine --> actions --> world, timers, trace, store
%%                                          ^           |
%%                                          +-----------+ local events, in their order
%% '''
%% The module is pure: a driver hands events in and handles each resulting {@link turn()}. The
%% driver adds time, a store, a trace, and the world ({@link starl_platform}), with a state of its
%% own, through the callbacks of this behaviour.
%%
%% Rules for a driver:
%% <ul>
%% <li>The driver hands in an event of the world or of a timer when the robot is quiet, one at a
%%   time, ordered by time, then class (`starl_robot_order.hrl'). Local events come before.</li>
%% <li>A planned timer is never taken back: when its event comes, {@link expire/4} says whether
%%   the timer still runs; the event of a cancelled or replaced timer is dropped there.</li>
%% <li>While a process is at work the driver hands in nothing else. The actions and trace events of
%%   the process have the time at which its event began, not the time of its answer. Actions with a
%%   latest moment (`until') take place only if the driver's `present' time allows it.</li>
%% <li>A simulator can let the robot stand still in mid-step ({@link stand_still/3}): the turn ends
%%   there (`stands'), the driver hands in nothing before {@link go_on/1}, and the rest of the step
%%   takes place at the time of that call.</li>
%% <li>An answer counts only if it comes from the process at work: see {@link answered/3}.</li>
%% <li>A process may attach before the end of its predecessor is known. It has to wait until that
%%   end has been handled ({@link starl_robot_machines:attach/3} returns `early').</li>
%% <li>A full store crashes the machine that stores: the driver ends its process, if it has one,
%%   and no later action of the machine takes place.</li>
%% <li>When the robot goes down or dies, or its services are given up, the chassis stops
%%   (`stop'), and only events of the chassis itself reach the robot.</li>
%% </ul>
-module(starl_robot).

-export([
    new/4, parts/1, restore/1, id/1, condition/1, world/1, world/2, machines/1, machines/2, timers/1
]).
-export([run/1, status/1, event/5, expire/4, fire/6, answered/3, busy/1, pace/2, next/1]).
-export([put_off/2, leave/1, act/4, stand_still/3, go_on/1, standing/1]).
-export([lost/3, attach/3, back/3, first/2, then/2, die/2, go_down/1, come_up/2]).

-export_type([t/0, turn/0, local/0, world/0, condition/0, ended/0, standing/0, parts/0]).

%% A local event: a machine handles an event, or boots.
-type local() ::
    {starl_machine:name(), starl_machine:event_type(), Content :: term()}
    | {starl_machine:name(), boot, none}.

%% The driver's own state.
-type world() :: term().

%% Up, down for a while, or dead for good.
-type condition() :: up | down | dead.

%% The end of its application: with a result, by too many crashes, or with the death of the robot.
-type ended() :: {done, Result :: term()} | given_up | died.

%% The result of a turn: the robot has nothing left to do; a process has to carry out this order,
%% which the driver sends; a machine has crashed, by itself or by a full store; the robot pauses
%% ({@link pace/2}); or it stands still in mid-step ({@link stand_still/3}).
-type turn() ::
    {quiet, t()}
    | {stands, t()}
    | {ask, pid(), starl_driver:order(), t()}
    | {crashed, starl_machine:name(), Reason :: term(), t()}
    | {paused, t()}.

%% Notes that a machine is about to handle a local event, or to boot. The driver itself notes
%% an event that it hands in.
-callback handles(starl_machine:name(), starl_machine:event_type() | boot, Content, World) ->
    World
when
    Content :: term(), World :: world().
%% The time of the robot's own clock at which the present step began, in microseconds.
-callback clock(world()) -> integer().
%% The time that the robot's own clock shows now, in mid-step.
-callback present(world()) -> integer().
%% The start configuration of a machine, but for `life', which this module adds.
-callback base(starl_machine:name(), Incarnation :: pos_integer(), world()) ->
    starl_machine:config().
%% Records a fact.
-callback trace(starl_machine:name(), Event :: term(), World) -> World when World :: world().
%% Plans a timer's event after this time by the robot's clock; returns the mark of the event.
-callback plan(starl_machine:name(), starl_robot_timers:timer(), Us, Content, World) ->
    {starl_robot_timers:mark(), World}
when
    Us :: non_neg_integer(), Content :: term(), World :: world().
%% Makes a term durable for a machine in place of its earlier term; `full': nothing is stored.
-callback store(starl_machine:name(), term(), World) -> {ok, World} | full when World :: world().
%% The application has ended.
-callback ended(ended(), World) -> World when World :: world().

%% The driver's functions, looked up once: to call a fun is much faster than to call by module and
%% name.
-record(driver, {
    module :: module(),
    handles :: fun(),
    clock :: fun(),
    present :: fun(),
    trace :: fun(),
    plan :: fun(),
    perform :: fun()
}).

-record(robot, {
    id :: starl:robot_id(),
    driver :: #driver{},
    condition = up :: condition(),
    world :: world(),
    machines :: starl_robot_machines:t(),
    timers = starl_robot_timers:new() :: starl_robot_timers:t(),
    %% local events of the present moment, in order
    local = [] :: [local()],
    %% the machine whose process is at work
    busy = none :: {starl_machine:name(), pid()} | none,
    pace = on :: on | single,
    %% the machine in whose next step of more actions than this it stands still, after so many
    still = none :: {starl_machine:name(), Actions :: non_neg_integer()} | none,
    %% the rest of the step in which it stands still, or that is due now
    rest = none :: {stands | due, rest()} | none
}).

%% The machine of a step, its actions that are left, the local events that have resulted so far,
%% newest first, and the time of the robot's clock at which it began to stand still.
-type rest() :: {starl_machine:name(), [starl_machine:action()], New :: [local()], integer()}.

%% What is left to do of a robot that stands still in mid-step: the rest of the step, and the local
%% events that are due after it.
-type standing() :: {rest(), [local()]}.

%% A robot as data, between two events.
-type parts() :: #{
    condition := condition(),
    timers := [{starl_machine:name(), starl_robot_timers:timer(), starl_robot_timers:mark()}],
    local := [local()],
    rest := {stands | due, rest()} | none,
    still := {starl_machine:name(), Actions :: non_neg_integer()} | none
}.

-opaque t() :: #robot{}.

%% @doc A robot whose machines all boot first.
-spec new(starl:robot_id(), module(), world(), starl_robot_machines:t()) -> t().
new(Id, Driver, World, Machines) ->
    Robot = #robot{id = Id, driver = driver(Driver), world = World, machines = Machines},
    Robot#robot{local = boots(Machines)}.

%% @doc What a robot is between two events, beside its machines and its driver's state.
-spec parts(t()) -> parts().
parts(#robot{condition = Condition, timers = Timers, local = Local, rest = Rest, still = Still}) ->
    #{
        condition => Condition,
        timers => starl_robot_timers:to_list(Timers),
        local => Local,
        rest => Rest,
        still => Still
    }.

%% @doc A robot from its parts: a quiet one, or one that stands still in mid-step. Those that {@link parts/1}
%% tells come with `parts'.
-spec restore(
    #{
        id := starl:robot_id(),
        driver := module(),
        world := world(),
        machines := starl_robot_machines:t(),
        parts := parts()
    }
    | #{
        id := starl:robot_id(),
        driver := module(),
        world := world(),
        condition := condition(),
        machines := starl_robot_machines:t(),
        timers := starl_robot_timers:t(),
        standing => standing() | none
    }
) -> t().
restore(#{id := Id, driver := Driver, world := World, machines := Machines, parts := Parts}) ->
    #{condition := Condition, timers := Timers, local := Local, rest := Rest, still := Still} =
        Parts,
    #robot{
        id = Id,
        driver = driver(Driver),
        condition = Condition,
        world = World,
        machines = Machines,
        timers = starl_robot_timers:from_list(Timers),
        local = Local,
        still = Still,
        rest = Rest
    };
restore(#{condition := Condition, machines := Machines, timers := Timers} = Parts) ->
    #{id := Id, driver := Driver, world := World} = Parts,
    Robot = #robot{id = Id, driver = driver(Driver), world = World, machines = Machines},
    Quiet = Robot#robot{condition = Condition, timers = Timers},
    case maps:get(standing, Parts, none) of
        none -> Quiet;
        {Left, Due} -> Quiet#robot{rest = {stands, Left}, local = Due}
    end.

driver(Module) ->
    #driver{
        module = Module,
        handles = fun Module:handles/4,
        clock = fun Module:clock/1,
        present = fun Module:present/1,
        trace = fun Module:trace/3,
        plan = fun Module:plan/5,
        perform = fun Module:perform/3
    }.

%% @doc The robot's number.
-spec id(t()) -> starl:robot_id().
id(#robot{id = Id}) -> Id.

%% @doc The robot's condition.
-spec condition(t()) -> condition().
condition(#robot{condition = Condition}) -> Condition.

%% @doc The driver's own state.
-spec world(t()) -> world().
world(#robot{world = World}) -> World.

%% @doc The robot with a new state of the driver.
-spec world(world(), t()) -> t().
world(World, Robot) -> Robot#robot{world = World}.

%% @doc The robot's machines.
-spec machines(t()) -> starl_robot_machines:t().
machines(#robot{machines = Machines}) -> Machines.

%% @doc The robot with other machines.
-spec machines(starl_robot_machines:t(), t()) -> t().
machines(Machines, Robot) -> Robot#robot{machines = Machines}.

%% @doc The timers that run.
-spec timers(t()) -> starl_robot_timers:t().
timers(#robot{timers = Timers}) -> Timers.

%% @doc The machine whose process is at work.
-spec busy(t()) -> starl_machine:name() | none.
busy(#robot{busy = none}) -> none;
busy(#robot{busy = {Name, _}}) -> Name.

%% @doc Sets whether the robot goes on until it is quiet, or pauses after each event.
-spec pace(on | single, t()) -> t().
pace(Pace, Robot) -> Robot#robot{pace = Pace}.

%% -- the loop -------------------------------------------------------------------------------

%% @doc Goes on with the local events.
-spec run(t()) -> turn().
run(#robot{rest = {stands, _}} = Robot) ->
    {stands, Robot};
run(#robot{rest = {due, {Name, Actions, New, Since}}, local = Local, world = World} = Robot) ->
    #robot{machines = Machines, timers = Timers, driver = #driver{present = Present}} = Robot,
    Rest = starl_robot_actions:aged(max(0, Present(World) - Since), Actions),
    perform(Rest, Name, New, Local, World, Machines, Timers, Robot#robot{rest = none});
run(#robot{local = []} = Robot) ->
    {quiet, Robot};
run(#robot{local = Local, world = World, machines = Machines, timers = Timers} = Robot) ->
    next(Local, World, Machines, Timers, Robot).

%% @doc Is it up with no local events left (`quiet'), up with some (`busy'), or down or dead (`off')?
%% And the driver's own state.
-spec status(t()) -> {quiet | busy | off, world()}.
status(#robot{condition = up, local = [], world = World}) -> {quiet, World};
status(#robot{condition = up, world = World}) -> {busy, World};
status(#robot{world = World}) -> {off, World}.

%% @doc Handles an event of a machine, and all local events that follow from it. The driver's state
%% must be at the event's time.
-spec event(starl_machine:name(), starl_machine:event_type(), Content :: term(), world(), t()) ->
    turn().
event(Name, Type, Content, World, #robot{machines = Machines, timers = Timers} = Robot) ->
    step(Name, Type, Content, Robot#robot.local, World, Machines, Timers, Robot).

%% @doc The event of a timer has come, with this mark. If the timer still runs, returns the kind of
%% event and the timers that are left, for {@link fire/6}.
-spec expire(starl_machine:name(), starl_robot_timers:timer(), starl_robot_timers:mark(), t()) ->
    {ok, starl_machine:event_type(), Left :: starl_robot_timers:t()} | stale.
expire(Name, Timer, Mark, #robot{timers = Timers}) ->
    case starl_robot_timers:expire(Name, Timer, Mark, Timers) of
        {ok, Left} -> {ok, starl_robot_timers:event_type(Timer), Left};
        stale -> stale
    end.

%% @doc Handles the event of an expired timer, as {@link event/5}.
-spec fire(
    starl_machine:name(), starl_machine:event_type(), Content :: term(), world(), Left, t()
) ->
    turn()
when
    Left :: starl_robot_timers:t().
fire(Name, Type, Content, World, Left, #robot{local = Local, machines = Machines} = Robot) ->
    step(Name, Type, Content, Local, World, Machines, Left, Robot).

%% @doc Carries out the actions with which a process has answered; `ignored' if it is not the
%% process at work: a killed process may have answered before its end.
-spec answered(pid(), [starl_machine:action()], t()) -> turn() | ignored.
answered(Pid, Actions, #robot{busy = {Name, Pid}, world = World, machines = Machines} = Robot) ->
    #robot{local = Local, timers = Timers} = Robot,
    stepped(Actions, Name, Local, World, Machines, Timers, Robot);
answered(_Pid, _Actions, #robot{}) ->
    ignored.

%% @doc The process that is about to be asked is not asked yet: what the order says is the next local event again.
-spec put_off(starl_driver:order(), t()) -> t().
put_off(Order, #robot{busy = {Name, _Pid}, local = Local} = Robot) ->
    Event =
        case Order of
            {starl_step, Type, Content, _Meta} -> {Name, Type, Content};
            {starl_boot, _Base} -> {Name, boot, none}
        end,
    Robot#robot{busy = none, local = [Event | Local]}.

%% @doc Leaves the process at work alone, and goes on without it. Its answer comes with {@link act/4}
%% when the robot is quiet. Until then the driver must keep further orders to this process back. Only
%% a driver in real time does so, with an application that may compute for long.
-spec leave(t()) -> turn().
leave(#robot{busy = {_Name, _Pid}} = Robot) -> run(Robot#robot{busy = none}).

%% @doc Carries out the actions with which a process has answered that was left alone. The driver's
%% state must be at the present time.
-spec act(starl_machine:name(), [starl_machine:action()], world(), t()) -> turn().
act(Name, Actions, World, #robot{busy = none, local = Local} = Robot) ->
    #robot{machines = Machines, timers = Timers} = Robot,
    perform(Actions, Name, [], Local, World, Machines, Timers, Robot).

%% @doc In the next step of this machine that has more actions than this the robot stands still, after
%% so many of them. Facts of a group with a latest moment are not parted from the look at the clock.
-spec stand_still(starl_machine:name(), Actions :: non_neg_integer(), t()) -> t().
stand_still(Name, After, Robot) -> Robot#robot{still = {Name, After}}.

%% @doc The robot stands still no longer: {@link run/1} goes on with the step. The driver's state
%% must be at the present time.
-spec go_on(t()) -> t().
go_on(#robot{rest = {stands, Rest}} = Robot) -> Robot#robot{still = none, rest = {due, Rest}};
go_on(Robot) -> Robot#robot{still = none}.

%% @doc What is left to do, if the robot stands still in mid-step.
-spec standing(t()) -> standing() | none.
standing(#robot{rest = {stands, Rest}, local = Local}) -> {Rest, Local};
standing(#robot{}) -> none.

%% @doc Removes and returns the next local event.
-spec next(t()) -> {local(), t()} | none.
next(#robot{local = []}) -> none;
next(#robot{local = [Event | Local]} = Robot) -> {Event, Robot#robot{local = Local}}.

%% Values that change at every event are passed beside the record, which would be copied each time.
work(Local, World, Machines, Timers, #robot{pace = on} = Robot) ->
    next(Local, World, Machines, Timers, Robot);
work(Local, World, Machines, Timers, Robot) ->
    {paused, put_back(Local, World, Machines, Timers, Robot)}.

next([], World, Machines, Timers, Robot) ->
    {quiet, put_back([], World, Machines, Timers, Robot)};
next([{Name, boot, none} | Local], World, Machines, Timers, Robot) ->
    boot(Name, Local, World, Machines, Timers, Robot);
next([{Name, Type, Content} | Local], World, Machines, Timers, #robot{driver = Driver} = Robot) ->
    Handles = Driver#driver.handles,
    Noted = Handles(Name, Type, Content, World),
    step(Name, Type, Content, Local, Noted, Machines, Timers, Robot).

%% No process is at work any more.
put_back(Local, World, Machines, Timers, Robot) ->
    Robot#robot{
        local = Local, world = World, machines = Machines, timers = Timers, busy = none
    }.

boot(Name, Local, World, Machines, Timers, #robot{driver = Driver} = Robot) ->
    #driver{module = Module, handles = Handles, trace = Trace} = Driver,
    Noted = Handles(Name, boot, none, World),
    Given = Module:base(Name, starl_robot_machines:incarnation(Name, Machines), Noted),
    Base = Given#{life => starl_robot_machines:life(Name, Machines)},
    %% monitors learn that the machine has lost its stored term, if it had one
    Known =
        case Base of
            #{stored := damaged} -> Trace(Name, store_damaged, Noted);
            #{} -> Noted
        end,
    Answer = starl_robot_machines:boot(Name, Base, Machines),
    answer(Answer, Name, boot, Local, Known, Machines, Timers, Robot).

step(Name, Type, Content, Local, World, Machines, Timers, #robot{id = Id} = Robot) ->
    Clock = (Robot#robot.driver)#driver.clock,
    Meta = #{now => Clock(World), robot => Id},
    Answer = starl_robot_machines:step(Name, Type, Content, Meta, Machines),
    answer(Answer, Name, Type, Local, World, Machines, Timers, Robot).

answer({done, Actions, Machines}, Name, _Type, Local, World, _Before, Timers, Robot) ->
    stepped(Actions, Name, Local, World, Machines, Timers, Robot);
answer({ask, Pid, Order}, Name, _Type, Local, World, Machines, Timers, Robot) ->
    Asked = Robot#robot{
        local = Local, world = World, machines = Machines, timers = Timers, busy = {Name, Pid}
    },
    {ask, Pid, Order, Asked};
answer({crashed, Reason}, Name, _Type, Local, World, Machines, Timers, Robot) ->
    {crashed, Name, Reason, put_back(Local, World, Machines, Timers, Robot)};
answer(absent, Name, Type, Local, World, Machines, Timers, #robot{driver = Driver} = Robot) ->
    Trace = Driver#driver.trace,
    Traced = Trace(Name, {unknown_machine, Name}, World),
    work(Local ++ refusal(Name, Type), Traced, Machines, Timers, Robot).

%% A call to a machine that the robot does not have gets an answer, so nothing waits for ever.
refusal(Name, {call, {From, Tag}}) -> [{From, {reply, Tag}, {no_such_machine, Name}}];
refusal(_Name, _Type) -> [].

%% The robot may be about to stand still in this step.
stepped(Actions, Name, Local, World, Machines, Timers, #robot{still = {Name, After}} = Robot) ->
    case starl_robot_actions:standing_still(After, Actions) of
        {ok, Cut} ->
            Armed = Robot#robot{still = none},
            perform(Cut, Name, [], Local, World, Machines, Timers, Armed);
        too_few ->
            perform(Actions, Name, [], Local, World, Machines, Timers, Robot)
    end;
stepped(Actions, Name, Local, World, Machines, Timers, Robot) ->
    perform(Actions, Name, [], Local, World, Machines, Timers, Robot).

%% Carries out actions in their order; New holds the resulting local events, newest first.
perform([], _Name, [], Local, World, Machines, Timers, Robot) ->
    work(Local, World, Machines, Timers, Robot);
perform([], _Name, New, Local, World, Machines, Timers, Robot) ->
    work(Local ++ lists:reverse(New), World, Machines, Timers, Robot);
perform([Action | Rest], Name, New, Local, World, Machines, Timers, Robot) ->
    case Action of
        {trace, Event} ->
            Trace = (Robot#robot.driver)#driver.trace,
            perform(Rest, Name, New, Local, Trace(Name, Event, World), Machines, Timers, Robot);
        {cast, To, Content} ->
            Heard = [{To, cast, Content} | New],
            perform(Rest, Name, Heard, Local, World, Machines, Timers, Robot);
        {reply, {To, Tag}, Answer} ->
            Heard = [{To, {reply, Tag}, Answer} | New],
            perform(Rest, Name, Heard, Local, World, Machines, Timers, Robot);
        {call, To, Request, Tag} ->
            Heard = [{To, {call, {Name, Tag}}, Request} | New],
            perform(Rest, Name, Heard, Local, World, Machines, Timers, Robot);
        {{timeout, Timer}, cancel} ->
            Left = starl_robot_timers:cancel(Name, Timer, Timers),
            perform(Rest, Name, New, Local, World, Machines, Left, Robot);
        {{timeout, Timer}, Us, Content} ->
            start(Timer, Us, Content, Rest, Name, New, Local, World, Machines, Timers, Robot);
        {state_timeout, cancel} ->
            Left = starl_robot_timers:cancel(Name, state_timeout, Timers),
            perform(Rest, Name, New, Local, World, Machines, Left, Robot);
        {state_timeout, Us, Content} ->
            start(
                state_timeout, Us, Content, Rest, Name, New, Local, World, Machines, Timers, Robot
            );
        {store, Term} ->
            store(Term, Rest, Name, New, Local, World, Machines, Timers, Robot);
        {done, Result} ->
            Done = done(Result, World, Robot),
            perform(Rest, Name, New, Local, Done, Machines, Timers, Robot);
        {until, Us, Group, Mark} when is_list(Group) ->
            until(Us, Group, Mark, Rest, Name, New, Local, World, Machines, Timers, Robot);
        stand_still ->
            Present = (Robot#robot.driver)#driver.present,
            Stands = Robot#robot{rest = {stands, {Name, Rest, New, Present(World)}}},
            {stands, put_back(Local, World, Machines, Timers, Stands)};
        _ ->
            Perform = (Robot#robot.driver)#driver.perform,
            case Perform(Action, Name, World) of
                {[], Next} ->
                    perform(Rest, Name, New, Local, Next, Machines, Timers, Robot);
                {Told, Next} ->
                    Heard = lists:reverse(Told, New),
                    perform(Rest, Name, Heard, Local, Next, Machines, Timers, Robot)
            end
    end.

%% What has a latest moment leaves only before it.
until(Us, Group, Mark, Rest, Name, New, Local, World, Machines, Timers, Robot) ->
    Present = (Robot#robot.driver)#driver.present,
    case Present(World) =< Us of
        true ->
            All = starl_robot_actions:bounded(Us, Mark, Group) ++ Rest,
            perform(All, Name, New, Local, World, Machines, Timers, Robot);
        false ->
            Told = late({Name, info, {late, Mark}}, Local),
            Trace = (Robot#robot.driver)#driver.trace,
            Noted = Trace(Name, late, World),
            perform(Rest, Name, New, Told, Noted, Machines, Timers, Robot)
    end.

%% A machine learns what was too late before it handles anything else, one thing after the other.
late(Event, [{_, info, {late, _}} = Earlier | Local]) -> [Earlier | late(Event, Local)];
late(Event, Local) -> [Event | Local].

start(Timer, Us, Content, Rest, Name, New, Local, World, Machines, Timers, Robot) ->
    Plan = (Robot#robot.driver)#driver.plan,
    {Mark, Planned} = Plan(Name, Timer, Us, Content, World),
    Running = starl_robot_timers:start(Name, Timer, Mark, Timers),
    perform(Rest, Name, New, Local, Planned, Machines, Running, Robot).

%% Later actions take place only when the term is durable.
store(Term, Rest, Name, New, Local, World, Machines, Timers, #robot{driver = Driver} = Robot) ->
    case (Driver#driver.module):store(Name, Term, World) of
        {ok, Stored} ->
            perform(Rest, Name, New, Local, Stored, Machines, Timers, Robot);
        full ->
            Left = put_back(Local ++ lists:reverse(New), World, Machines, Timers, Robot),
            {crashed, Name, store_full, Left}
    end.

done(Result, World, #robot{driver = #driver{module = Module, trace = Trace}}) ->
    Trace(app, {done, Result}, Module:ended({done, Result}, World)).

%% -- crashes --------------------------------------------------------------------------------

%% @doc A machine has ended, for this reason: its timers are forgotten. A crash by itself is traced
%% for its supervisor; an end from outside is not.
-spec lost(starl_machine:name(), Reason :: term(), t()) -> t().
lost(Name, Reason, #robot{busy = Busy} = Robot) ->
    Bare = rest_lost(Name, lose(Name, Robot)),
    Left =
        case Busy of
            {Name, _} -> Bare#robot{busy = none};
            _ -> Bare
        end,
    case starl_crash:cause(Reason) of
        none -> Left;
        Cause -> trace(supervisor, {crashed, Name, Cause}, Left)
    end.

rest_lost(Name, #robot{rest = {How, {Name, _Actions, New, Since}}} = Robot) ->
    Robot#robot{rest = {How, {Name, [], New, Since}}};
rest_lost(_Name, Robot) ->
    Robot.

%% It may not even have booted: its successor boots.
lose(Name, #robot{timers = Timers, local = Local} = Robot) ->
    trace(Name, crashed, Robot#robot{
        timers = starl_robot_timers:forget(Name, Timers),
        local = lists:delete({Name, boot, none}, Local)
    }).

%% @doc A process has started as the machine of this name ({@link starl_robot_machines:attach/3}).
-spec attach(starl_machine:name(), pid(), t()) -> {ok, t()} | early.
attach(Name, Pid, #robot{machines = Machines} = Robot) ->
    case starl_robot_machines:attach(Name, Pid, Machines) of
        {ok, Attached} -> {ok, Robot#robot{machines = Attached}};
        early -> early
    end.

%% @doc Handles restarts first of all: the machines that have come back boot, and the robot's
%% others are told, also of the machines that were given up. Without its
%% application the robot stops: no other machine knows its next goal. Calls under way to a machine
%% that has come back are void: their callers are told.
-spec back(Back :: [starl_machine:name()], GivenUp :: [starl_machine:name()], t()) -> t().
back(Back, GivenUp, #robot{machines = Machines} = Robot) ->
    Names = starl_robot_machines:names(Machines),
    Ends = [End || Name <- GivenUp, End <- farewell(Name, Names)],
    Left = lists:foldl(fun give_up/2, void_calls(Back, Robot), GivenUp),
    first(Ends ++ restarts(starl_robot_order:boot(Back), Names), Left).

void_calls(Back, #robot{local = Local, rest = Rest} = Robot) ->
    Robot#robot{local = without_events(Back, Local), rest = void_rest(Back, Rest)}.

void_rest(_Back, none) ->
    none;
void_rest(Back, {How, {Name, Actions, New, Since}}) ->
    {How,
        {Name, starl_robot_actions:without_calls(Back, Actions), without_events(Back, New), Since}}.

without_events(Back, Local) ->
    [Event || Event <- Local, not is_call_event(Event, Back)].

is_call_event({To, {call, _From}, _Request}, Names) -> lists:member(To, Names);
is_call_event(_Event, _Names) -> false.

give_up(app, Robot) -> ended(given_up, trace(supervisor, {given_up, app}, Robot));
give_up(Name, Robot) -> trace(supervisor, {given_up, Name}, Robot).

farewell(Name, Others) ->
    Stop = [{motion, cast, stop} || Name =:= app, lists:member(motion, Others)],
    Stop ++ [{To, info, {given_up, Name}} || To <- Others].

restarts(Back, All) ->
    [{Name, boot, none} || Name <- Back] ++
        [{To, info, {restarted, Name}} || Name <- Back, To <- All, To =/= Name].

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
    Robot#robot{
        condition = Condition,
        machines = starl_robot_machines:down(Machines),
        timers = starl_robot_timers:new(),
        local = [],
        busy = none,
        still = none,
        rest = none
    }.

%% @doc A robot that was down comes up: all its machines boot.
-spec come_up(starl_robot_machines:t(), t()) -> t().
come_up(Machines, #robot{condition = down} = Robot) ->
    trace(robot, up, Robot#robot{
        condition = up, machines = Machines, local = boots(Machines)
    }).

boots(Machines) -> [{Name, boot, none} || Name <- starl_robot_machines:names(Machines)].

trace(Name, Event, #robot{driver = #driver{trace = Trace}, world = World} = Robot) ->
    Robot#robot{world = Trace(Name, Event, World)}.

stop(#robot{driver = #driver{module = Module}, world = World} = Robot) ->
    Robot#robot{world = Module:stop(World)}.

ended(How, #robot{driver = #driver{module = Module}, world = World} = Robot) ->
    Robot#robot{world = Module:ended(How, World)}.
