%% @doc One robot, the same under every driver (the simulator, the checker, the link of a real
%% robot). It passes an event to a machine and carries out the machine's actions. Then it handles
%% the local events that these cause for the robot's other machines, until none is left.
%% ```
%%     event of the world or a timer --> machine --> actions --> world, timers, trace, store
%%                                          ^           |
%%                                          +-----------+ local events, in their order
%% '''
%% The module is pure: a driver ({@link starl_driver}) hands events in and handles each resulting
%% {@link turn()}. The loop itself is {@link starl_robot_loop}. This module holds the robot's state
%% between two turns, and handles lost machines, going down and coming up.
-module(starl_robot).

-export([
    new/4, restore/1, id/1, condition/1, world/1, world/2, machines/1, machines/2, timers/1
]).
-export([run/1, status/1, event/5, expire/4, fire/6, answered/3, busy/1, pace/2, next/1]).
-export([put_off/2, leave/1, act/4, stand_still/3, go_on/1, standing/1]).
-export([lost/3, attach/3, back/3, first/2, then/2, die/2, go_down/1, come_up/2]).

-export_type([t/0, turn/0, local/0, world/0, condition/0, ended/0, standing/0]).

%% A local event: a machine handles an event, or boots.
-type local() :: starl_robot_loop:local().

%% The driver's own state.
-type world() :: starl_driver:world().

%% Up, down for a while, or dead for good.
-type condition() :: up | down | dead.

%% The end of its application: with a result, by too many crashes, or with the death of the robot.
-type ended() :: {done, Result :: term()} | given_up | died.

%% The result of a turn. `quiet': the robot has nothing left to do. Else a process has to carry out
%% this order, which the driver sends; or a machine has crashed, by itself or by a full store. Or
%% the robot pauses ({@link pace/2}), or stalls in mid-step ({@link stand_still/3}).
-type turn() ::
    {quiet, t()}
    | {stands, t()}
    | {ask, pid(), starl_driver:order(), t()}
    | {crashed, starl_machine:name(), Reason :: term(), t()}
    | {paused, t()}.

-record(robot, {
    loop :: starl_robot_loop:t(),
    condition = up :: condition(),
    world :: world(),
    machines :: starl_robot_machines:t(),
    timers = starl_robot_timers:new() :: starl_robot_timers:t(),
    %% local events of the present moment, in order
    local = [] :: [local()],
    %% the machine whose process is at work
    busy = none :: {starl_machine:name(), pid()} | none,
    %% the rest of the step in which it stands still, or that is due now
    rest = none :: {stands | due, starl_robot_loop:rest()} | none
}).

%% What is left to do for a robot that is stalled in mid-step: the rest of the step, and the local
%% events that are due after it.
-type standing() :: {starl_robot_loop:rest(), [local()]}.

-opaque t() :: #robot{}.

%% @doc Makes a robot whose machines all boot first.
-spec new(starl:robot_id(), module(), world(), starl_robot_machines:t()) -> t().
new(Id, Driver, World, Machines) ->
    #robot{
        loop = starl_robot_loop:new(Id, Driver),
        world = World,
        machines = Machines,
        local = starl_robot_machines:boots(Machines)
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
        loop = starl_robot_loop:new(Id, Driver),
        condition = Condition,
        world = World,
        machines = Machines,
        timers = Timers
    },
    case maps:get(standing, Given, none) of
        none -> Quiet;
        {Left, Due} -> Quiet#robot{rest = {stands, Left}, local = Due}
    end.

%% @doc The robot's number.
-spec id(t()) -> starl:robot_id().
id(#robot{loop = Loop}) -> starl_robot_loop:id(Loop).

%% @doc The robot's condition.
-spec condition(t()) -> condition().
condition(#robot{condition = Condition}) -> Condition.

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
busy(#robot{busy = none}) -> none;
busy(#robot{busy = {Name, _}}) -> Name.

%% @doc Sets whether the robot runs until it is quiet, or pauses after each event.
-spec pace(on | single, t()) -> t().
pace(Pace, #robot{loop = Loop} = Robot) ->
    Robot#robot{loop = starl_robot_loop:pace(Pace, Loop)}.

%% -- the loop -------------------------------------------------------------------------------

%% @doc Handles the local events that are left.
-spec run(t()) -> turn().
run(#robot{rest = {stands, _}} = Robot) ->
    {stands, Robot};
run(#robot{rest = {due, Rest}, local = Local, world = World, loop = Loop} = Robot) ->
    #robot{machines = Machines, timers = Timers} = Robot,
    Turn = starl_robot_loop:resume(Rest, Local, World, Machines, Timers, Loop),
    turn(Turn, Robot#robot{rest = none});
run(#robot{local = []} = Robot) ->
    {quiet, Robot};
run(#robot{local = Local, world = World, loop = Loop} = Robot) ->
    #robot{machines = Machines, timers = Timers} = Robot,
    turn(starl_robot_loop:next(Local, World, Machines, Timers, Loop), Robot).

%% @doc Returns whether the robot is up with no local events left (`quiet'), up with some (`busy'),
%% or down or dead (`off'); and the driver's own state.
-spec status(t()) -> {quiet | busy | off, world()}.
status(#robot{condition = up, local = [], world = World}) -> {quiet, World};
status(#robot{condition = up, world = World}) -> {busy, World};
status(#robot{world = World}) -> {off, World}.

%% @doc Handles an event of a machine, and all local events that follow from it. The driver's state
%% must be at the event's time.
-spec event(starl_machine:name(), starl_machine:event_type(), Content :: term(), world(), t()) ->
    turn().
event(Name, Type, Content, World, #robot{local = Local, loop = Loop} = Robot) ->
    #robot{machines = Machines, timers = Timers} = Robot,
    turn(starl_robot_loop:step(Name, Type, Content, Local, World, Machines, Timers, Loop), Robot).

%% @doc Handles an expired timer with this mark. If the timer still runs, returns the kind of event
%% and the timers that are left, for {@link fire/6}.
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
fire(Name, Type, Content, World, Left, #robot{local = Local, loop = Loop} = Robot) ->
    Machines = Robot#robot.machines,
    turn(starl_robot_loop:step(Name, Type, Content, Local, World, Machines, Left, Loop), Robot).

%% @doc Carries out the actions that a process has returned. `ignored': it is not the process at
%% work, since a killed process may have answered before its end.
-spec answered(pid(), [starl_machine:action()], t()) -> turn() | ignored.
answered(Pid, Actions, #robot{busy = {Name, Pid}, world = World, loop = Loop} = Robot) ->
    #robot{local = Local, machines = Machines, timers = Timers} = Robot,
    turn(starl_robot_loop:stepped(Actions, Name, Local, World, Machines, Timers, Loop), Robot);
answered(_Pid, _Actions, #robot{}) ->
    ignored.

%% @doc Puts an order back that was not sent yet: it becomes the next local event again.
-spec put_off(starl_driver:order(), t()) -> t().
put_off(Order, #robot{busy = {Name, _Pid}, local = Local} = Robot) ->
    Robot#robot{busy = none, local = [starl_driver:event(Name, Order) | Local]}.

%% @doc Leaves the process at work alone, and goes on without it. {@link act/4} takes its answer
%% when the robot is quiet. Until then the driver must keep further orders to this process back.
%% Only a driver in real time does so, with an application that may compute for long.
-spec leave(t()) -> turn().
leave(#robot{busy = {_Name, _Pid}} = Robot) -> run(Robot#robot{busy = none}).

%% @doc Carries out the actions of a process that was left alone ({@link leave/1}). The driver's
%% state must be at the present time.
-spec act(starl_machine:name(), [starl_machine:action()], world(), t()) -> turn().
act(Name, Actions, World, #robot{busy = none, local = Local, loop = Loop} = Robot) ->
    #robot{machines = Machines, timers = Timers} = Robot,
    turn(starl_robot_loop:perform(Actions, Name, Local, World, Machines, Timers, Loop), Robot).

%% @doc Fault injection: stalls the robot in the next step of this machine that has more than
%% `Actions' actions, after that many. Trace events in a group with a deadline are not separated
%% from the check of the clock.
-spec stand_still(starl_machine:name(), Actions :: non_neg_integer(), t()) -> t().
stand_still(Name, After, Robot) -> still({Name, After}, Robot).

still(Still, #robot{loop = Loop} = Robot) ->
    Robot#robot{loop = starl_robot_loop:still(Still, Loop)}.

%% @doc Ends the stall of the robot: {@link run/1} goes on with the step. The driver's state must be
%% at the present time.
-spec go_on(t()) -> t().
go_on(#robot{rest = {stands, Rest}} = Robot) -> still(none, Robot#robot{rest = {due, Rest}});
go_on(Robot) -> still(none, Robot).

%% @doc Returns what is left to do, if the robot is stalled in mid-step.
-spec standing(t()) -> standing() | none.
standing(#robot{rest = {stands, Rest}, local = Local}) -> {Rest, Local};
standing(#robot{}) -> none.

%% @doc Removes and returns the next local event.
-spec next(t()) -> {local(), t()} | none.
next(#robot{local = []}) -> none;
next(#robot{local = [Event | Local]} = Robot) -> {Event, Robot#robot{local = Local}}.

turn({Outcome, Local, World, Machines, Timers, Loop}, #robot{condition = Condition, rest = Rest}) ->
    Left = #robot{
        loop = Loop,
        condition = Condition,
        world = World,
        machines = Machines,
        timers = Timers,
        local = Local,
        rest = Rest
    },
    case Outcome of
        quiet -> {quiet, Left};
        paused -> {paused, Left};
        {stands, _Rest} -> {stands, Left#robot{rest = Outcome}};
        {ask, Name, Pid, Order} -> {ask, Pid, Order, Left#robot{busy = {Name, Pid}}};
        {crashed, Name, Reason} -> {crashed, Name, Reason, Left}
    end.

%% -- crashes --------------------------------------------------------------------------------

%% @doc Handles the end of a machine, for this reason: its timers are forgotten. A crash by itself
%% is traced for its supervisor; an end from outside is not.
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

void_calls(Back, #robot{local = Local, rest = Rest} = Robot) ->
    Due = starl_robot_actions:without_call_events(Back, Local),
    Robot#robot{local = Due, rest = void_rest(Back, Rest)}.

void_rest(_Back, none) ->
    none;
void_rest(Back, {How, {Name, Actions, New, Since}}) ->
    Left = starl_robot_actions:without_calls(Back, Actions),
    {How, {Name, Left, starl_robot_actions:without_call_events(Back, New), Since}}.

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
        condition = Condition,
        machines = starl_robot_machines:down(Machines),
        timers = starl_robot_timers:new(),
        local = [],
        busy = none,
        rest = none
    }).

%% @doc A robot that was down comes up: all its machines boot.
-spec come_up(starl_robot_machines:t(), t()) -> t().
come_up(Machines, #robot{condition = down} = Robot) ->
    Boots = starl_robot_machines:boots(Machines),
    trace(robot, up, Robot#robot{condition = up, machines = Machines, local = Boots}).

trace(Name, Event, #robot{world = World} = Robot) ->
    Robot#robot{world = (driver(Robot)):trace(Name, Event, World)}.

stop(#robot{world = World} = Robot) -> Robot#robot{world = (driver(Robot)):stop(World)}.

ended(How, #robot{world = World} = Robot) ->
    Robot#robot{world = (driver(Robot)):ended(How, World)}.

driver(#robot{loop = Loop}) -> starl_robot_loop:driver(Loop).
