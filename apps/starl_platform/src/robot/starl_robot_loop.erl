%% @doc The event loop of a robot. An event goes to a machine, and the machine's actions are carried
%% out in their order. The local events that they cause follow. The loop ends when no event is left,
%% a process has to be asked, a machine crashes, or the robot stalls in mid-step.
%%
%% Pure; a part of {@link starl_robot}, which keeps what a turn of the loop returns.
-module(starl_robot_loop).

-export([new/2, id/1, driver/1, pace/2, still/2]).
-export([next/5, step/8, stepped/7, perform/7, resume/6]).

-export_type([t/0, local/0, rest/0, still/0, outcome/0, turn/0]).

%% Actions are what most of a run's time goes to.
-compile({inline, [effect/8, outward/9]}).

%% A local event: a machine handles an event, or boots.
-type local() ::
    {starl_machine:name(), starl_machine:event_type(), Content :: term()}
    | {starl_machine:name(), boot, none}.

%% The machine of a step, its actions that are left, the local events that have resulted so far,
%% newest first, and the time of the robot's clock at which it began to stand still.
-type rest() :: {starl_machine:name(), [starl_machine:action()], New :: [local()], integer()}.

%% Fault injection: stall after N actions in this machine's next step that has more than N.
-type still() :: {starl_machine:name(), Actions :: non_neg_integer()} | none.

%% How a turn ends: nothing is left to do; the robot pauses; it stalls in mid-step; a process has to
%% carry out this order; a machine has crashed.
-type outcome() ::
    quiet
    | paused
    | {stands, rest()}
    | {ask, starl_machine:name(), pid(), starl_driver:order()}
    | {crashed, starl_machine:name(), Reason :: term()}.

%% The end of a turn, and what has changed.
-type turn() :: {
    outcome(),
    [local()],
    starl_driver:world(),
    starl_robot_machines:t(),
    starl_robot_timers:t(),
    t()
}.

%% The driver's functions are looked up once: to call a fun is much faster than to call by module and
%% name.
-record(loop, {
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

-opaque t() :: #loop{}.

%% @doc The loop of this robot, whose driver has the callbacks of {@link starl_driver} and {@link starl_platform}.
-spec new(starl:robot_id(), Driver :: module()) -> t().
new(Id, Driver) ->
    #loop{
        id = Id,
        driver = Driver,
        handles = fun Driver:handles/4,
        clock = fun Driver:clock/1,
        present = fun Driver:present/1,
        trace = fun Driver:trace/3,
        plan = fun Driver:plan/5,
        perform = fun Driver:perform/3
    }.

%% @doc The robot's number.
-spec id(t()) -> starl:robot_id().
id(#loop{id = Id}) -> Id.

%% @doc The driver's module.
-spec driver(t()) -> module().
driver(#loop{driver = Driver}) -> Driver.

%% @doc Sets whether it goes on until the robot is quiet, or pauses after each event.
-spec pace(on | single, t()) -> t().
pace(Pace, Loop) -> Loop#loop{pace = Pace}.

%% @doc Sets that the robot is to stall in this step.
-spec still(still(), t()) -> t().
still(Still, Loop) -> Loop#loop{still = Still}.

%% @doc Goes on with the local events. Values that change at every event are passed beside the loop's
%% record, which would be copied each time.
-spec next([local()], World, Machines, Timers, t()) -> turn() when
    World :: starl_driver:world(),
    Machines :: starl_robot_machines:t(),
    Timers :: starl_robot_timers:t().
next([], World, Machines, Timers, Loop) ->
    {quiet, [], World, Machines, Timers, Loop};
next([{Name, boot, none} | Local], World, Machines, Timers, Loop) ->
    boot(Name, Local, World, Machines, Timers, Loop);
next([{Name, Type, Content} | Local], World, Machines, Timers, #loop{handles = Handles} = Loop) ->
    Noted = Handles(Name, Type, Content, World),
    step(Name, Type, Content, Local, Noted, Machines, Timers, Loop).

work(Local, World, Machines, Timers, #loop{pace = on} = Loop) ->
    next(Local, World, Machines, Timers, Loop);
work(Local, World, Machines, Timers, Loop) ->
    {paused, Local, World, Machines, Timers, Loop}.

boot(Name, Local, World, Machines, Timers, Loop) ->
    #loop{driver = Driver, handles = Handles, trace = Trace} = Loop,
    Noted = Handles(Name, boot, none, World),
    Given = Driver:base(Name, starl_robot_machines:incarnation(Name, Machines), Noted),
    Base = lived(Name, Machines, Given#{life => starl_robot_machines:life(Name, Machines)}),
    %% monitors learn that the machine has lost its stored term, if it had one
    Known =
        case Base of
            #{stored := damaged} -> Trace(Name, store_damaged, Noted);
            #{} -> Noted
        end,
    Answer = starl_robot_machines:boot(Name, Base, Machines),
    answer(Answer, Name, boot, Local, Known, Machines, Timers, Loop).

%% SAP alone is told of lives by others.
lived(sap, Machines, Base) -> Base#{latest_life => starl_robot_machines:latest_life(Machines)};
lived(_Name, _Machines, Base) -> Base.

%% @doc A machine handles an event; the local events that follow from it come behind the others.
-spec step(
    starl_machine:name(),
    starl_machine:event_type(),
    Content :: term(),
    [local()],
    World,
    Machines,
    Timers,
    t()
) -> turn() when
    World :: starl_driver:world(),
    Machines :: starl_robot_machines:t(),
    Timers :: starl_robot_timers:t().
step(Name, Type, Content, Local, World, Machines, Timers, #loop{id = Id, clock = Clock} = Loop) ->
    Meta = #{now => Clock(World), robot => Id},
    Answer = starl_robot_machines:step(Name, Type, Content, Meta, Machines),
    answer(Answer, Name, Type, Local, World, Machines, Timers, Loop).

answer({done, Actions, Machines}, Name, _Type, Local, World, _Before, Timers, Loop) ->
    stepped(Actions, Name, Local, World, Machines, Timers, Loop);
answer({ask, Pid, Order}, Name, _Type, Local, World, Machines, Timers, Loop) ->
    {{ask, Name, Pid, Order}, Local, World, Machines, Timers, Loop};
answer({crashed, Reason}, Name, _Type, Local, World, Machines, Timers, Loop) ->
    {{crashed, Name, Reason}, Local, World, Machines, Timers, Loop};
answer(absent, Name, Type, Local, World, Machines, Timers, #loop{trace = Trace} = Loop) ->
    Traced = Trace(Name, {unknown_machine, Name}, World),
    work(Local ++ refusal(Name, Type), Traced, Machines, Timers, Loop).

%% A call to a machine that the robot does not have gets an answer, so nothing waits for ever.
refusal(Name, {call, {From, Tag}}) -> [{From, {reply, Tag}, {no_such_machine, Name}}];
refusal(_Name, _Type) -> [].

%% @doc Carries out the actions of a step. The robot may be about to stall in it.
-spec stepped([starl_machine:action()], starl_machine:name(), [local()], W, M, T, t()) ->
    turn()
when
    W :: starl_driver:world(), M :: starl_robot_machines:t(), T :: starl_robot_timers:t().
stepped(Actions, Name, Local, World, Machines, Timers, #loop{still = {Name, After}} = Loop) ->
    case starl_robot_actions:standing_still(After, Actions) of
        {ok, Cut} ->
            perform(Cut, Name, [], Local, World, Machines, Timers, Loop#loop{still = none});
        too_few ->
            perform(Actions, Name, [], Local, World, Machines, Timers, Loop)
    end;
stepped(Actions, Name, Local, World, Machines, Timers, Loop) ->
    perform(Actions, Name, [], Local, World, Machines, Timers, Loop).

%% @doc Carries out the actions of a machine.
-spec perform([starl_machine:action()], starl_machine:name(), [local()], W, M, T, t()) ->
    turn()
when
    W :: starl_driver:world(), M :: starl_robot_machines:t(), T :: starl_robot_timers:t().
perform(Actions, Name, Local, World, Machines, Timers, Loop) ->
    perform(Actions, Name, [], Local, World, Machines, Timers, Loop).

%% @doc Carries out the rest of a step in which the robot was stalled, up to the present time.
-spec resume(rest(), [local()], World, Machines, Timers, t()) -> turn() when
    World :: starl_driver:world(),
    Machines :: starl_robot_machines:t(),
    Timers :: starl_robot_timers:t().
resume({Name, Actions, New, Since}, Local, World, Machines, Timers, #loop{} = Loop) ->
    Present = Loop#loop.present,
    Rest = starl_robot_actions:aged(max(0, Present(World) - Since), Actions),
    perform(Rest, Name, New, Local, World, Machines, Timers, Loop).

%% New holds the resulting local events, newest first.
perform([], _Name, [], Local, World, Machines, Timers, Loop) ->
    work(Local, World, Machines, Timers, Loop);
perform([], _Name, New, Local, World, Machines, Timers, Loop) ->
    work(Local ++ lists:reverse(New), World, Machines, Timers, Loop);
perform([Action | Rest] = Actions, Name, New, Local, World, Machines, Timers, Loop) ->
    case Action of
        {trace, Event} ->
            Trace = Loop#loop.trace,
            perform(Rest, Name, New, Local, Trace(Name, Event, World), Machines, Timers, Loop);
        {cast, To, Content} ->
            Heard = [{To, cast, Content} | New],
            perform(Rest, Name, Heard, Local, World, Machines, Timers, Loop);
        {reply, {To, Tag}, Answer} ->
            Heard = [{To, {reply, Tag}, Answer} | New],
            perform(Rest, Name, Heard, Local, World, Machines, Timers, Loop);
        {call, To, Request, Tag} ->
            Heard = [{To, {call, {Name, Tag}}, Request} | New],
            perform(Rest, Name, Heard, Local, World, Machines, Timers, Loop);
        _ ->
            effect(Actions, Name, New, Local, World, Machines, Timers, Loop)
    end.

%% The first action is neither a fact nor a word to another machine.
effect([Action | Rest], Name, New, Local, World, Machines, Timers, Loop) ->
    case Action of
        {{timeout, Timer}, cancel} ->
            cancel(Timer, Rest, Name, New, Local, World, Machines, Timers, Loop);
        {{timeout, Timer}, Us, Content} ->
            start(Timer, Us, Content, Rest, Name, New, Local, World, Machines, Timers, Loop);
        {state_timeout, cancel} ->
            cancel(state_timeout, Rest, Name, New, Local, World, Machines, Timers, Loop);
        {state_timeout, Us, Content} ->
            start(
                state_timeout, Us, Content, Rest, Name, New, Local, World, Machines, Timers, Loop
            );
        {store, Term} ->
            store(Term, Rest, Name, New, Local, World, Machines, Timers, Loop);
        {done, Result} ->
            perform(Rest, Name, New, Local, done(Result, World, Loop), Machines, Timers, Loop);
        {until, Us, Group, Mark} when is_list(Group) ->
            until(Us, Group, Mark, Rest, Name, New, Local, World, Machines, Timers, Loop);
        stand_still ->
            Since = (Loop#loop.present)(World),
            {{stands, {Name, Rest, New, Since}}, Local, World, Machines, Timers, Loop};
        _ ->
            outward(Action, Rest, Name, New, Local, World, Machines, Timers, Loop)
    end.

%% What the world does.
outward(Action, Rest, Name, New, Local, World, Machines, Timers, Loop) ->
    Perform = Loop#loop.perform,
    case Perform(Action, Name, World) of
        {[], Next} ->
            perform(Rest, Name, New, Local, Next, Machines, Timers, Loop);
        {Told, Next} ->
            Heard = lists:reverse(Told, New),
            perform(Rest, Name, Heard, Local, Next, Machines, Timers, Loop)
    end.

%% What has a latest moment leaves only before it.
until(Us, Group, Mark, Rest, Name, New, Local, World, Machines, Timers, Loop) ->
    #loop{present = Present, trace = Trace} = Loop,
    case Present(World) =< Us of
        true ->
            All = starl_robot_actions:bounded(Us, Mark, Group) ++ Rest,
            perform(All, Name, New, Local, World, Machines, Timers, Loop);
        false ->
            Told = late({Name, info, {late, Mark}}, Local),
            perform(Rest, Name, New, Told, Trace(Name, late, World), Machines, Timers, Loop)
    end.

%% A machine learns what was too late before it handles anything else, one thing after the other.
late(Event, [{_, info, {late, _}} = Earlier | Local]) -> [Earlier | late(Event, Local)];
late(Event, Local) -> [Event | Local].

cancel(Timer, Rest, Name, New, Local, World, Machines, Timers, Loop) ->
    Left = starl_robot_timers:cancel(Name, Timer, Timers),
    perform(Rest, Name, New, Local, World, Machines, Left, Loop).

start(Timer, Us, Content, Rest, Name, New, Local, World, Machines, Timers, Loop) ->
    Plan = Loop#loop.plan,
    {Mark, Planned} = Plan(Name, Timer, Us, Content, World),
    Running = starl_robot_timers:start(Name, Timer, Mark, Timers),
    perform(Rest, Name, New, Local, Planned, Machines, Running, Loop).

%% Later actions take place only when the term is durable.
store(Term, Rest, Name, New, Local, World, Machines, Timers, #loop{driver = Driver} = Loop) ->
    case Driver:store(Name, Term, World) of
        {ok, Stored} ->
            perform(Rest, Name, New, Local, Stored, Machines, Timers, Loop);
        full ->
            Due = Local ++ lists:reverse(New),
            {{crashed, Name, store_full}, Due, World, Machines, Timers, Loop}
    end.

done(Result, World, #loop{driver = Driver, trace = Trace}) ->
    Trace(app, {done, Result}, Driver:ended({done, Result}, World)).
