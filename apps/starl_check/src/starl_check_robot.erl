%% @doc One robot of a checked team: its machines, their timers and its local part of SAP. Pure.
%%
%% An event and all local events that follow from it run to completion in the loop of every robot
%% ({@link starl_robot}, {@link starl_check_world}); nothing else happens to the robot meanwhile. A
%% crash affects one machine, which restarts with the next incarnation and its stored term.
%%
%% Or the robot stalls in the middle: in one of the machines' steps of an event, after some of its
%% actions. Then nothing happens to it, until it goes on or goes down; time passes. Numbers of steps
%% count from 1, from the machine to which the event happens.
-module(starl_check_robot).

-export([
    boot/2, event/3, cuts/3, timers/1, calls/1, is_done/1, condition/1, has_aged/1, must_go_on/2
]).
-export([shift/3, rename/2, own/1, place/1]).

-export_type([t/0, event/0, cut/0, sent/0, timer/0, due/0, condition/0]).

%% The machine and the name of a timer.
-type timer() :: {starl_machine:name(), Timer :: term()}.

-type event() ::
    {message, starl:robot_id(), Type :: atom(), Body :: term()}
    | {outcome, starl_check_sap:ref(), Lost :: [starl:robot_id()]}
    | {acknowledged | refused, starl_check_sap:ref(), starl:robot_id()}
    | {delayed, starl_check_sap:ref()}
    | {packet, starl_packet:t()}
    | {fire, timer()}
    | {crash, starl_machine:name()}
    | {still, cut(), event()}
    | go_on
    | down
    | up
    | die.

%% It stands still in this step, after so many actions.
-type cut() :: {Step :: pos_integer(), Actions :: non_neg_integer()}.

-type sent() :: starl_check_world:sent().

-type due() :: starl_check_world:due().

%% `stands': it stands still within a step; `down': the robot will start again; `dead': it never will.
-type condition() :: starl_robot:condition() | stands.

-record(robot, {
    place :: starl_check_term:place(),
    condition = up :: starl_robot:condition(),
    standing = none :: starl_robot:standing() | none,
    %% in the order of their start
    machines = [] :: [{starl_machine:name(), starl_machine:t()}],
    incarnations = #{} :: #{starl_machine:name() => pos_integer()},
    stored = #{} :: #{starl_machine:name() => term()},
    timers = [] :: [{timer(), due(), Content :: term()}],
    sap :: starl_check_sap:t() | real
}).

-opaque t() :: #robot{}.

%% The state while an event is handled.
-record(run, {
    robot :: starl_robot:t(),
    place :: starl_check_term:place(),
    model :: starl_check_model:t(),
    sap :: starl_check_sap:t() | real,
    %% the number of steps so far, and where the robot is to stand still
    steps = 0 :: non_neg_integer(),
    cut = none :: cut() | stands | none
}).

-type result() :: {[sent()], [starl_monitor:trace_event()], t()}.

%% @doc The robot at a place of its team, after the start of all its machines. If a machine crashes
%% by itself, now or at an event, this throws `{crashed, Machine, Reason}'.
-spec boot(starl_check_term:place(), starl_check_model:t()) -> result().
boot(Place, #{sap := Sap} = Model) ->
    Service =
        case Sap of
            real -> real;
            contract -> starl_check_sap:new()
        end,
    World = starl_check_world:new(Place, #{}, Model),
    Machines = starl_robot_machines:new(inline(Place, Model)),
    Robot = starl_robot:new(starl_check_model:id(Place, Model), starl_check_world, World, Machines),
    result(run(#run{robot = single(Robot), place = Place, model = Model, sap = Service})).

%% @doc The robot after an event.
-spec event(event(), t(), starl_check_model:t()) -> result().
event({still, Cut, Event}, Robot, Model) -> result(happened(Event, Cut, Robot, Model));
event(Event, Robot, Model) -> result(happened(Event, none, Robot, Model)).

happened({fire, {Name, Timer} = Key}, Cut, #robot{timers = Timers} = Robot, Model) ->
    {value, {_, _, Content}, Rest} = lists:keytake(Key, 1, Timers),
    Event = {Name, starl_robot_timers:event_type(Timer), Content},
    run([Event], cut(Cut, begun(#{}, Robot#robot{timers = Rest}, Model)));
happened({crash, _} = Crash, none, #robot{place = Place} = Robot, Model) ->
    happen(Crash, begun(inline(Place, Model), Robot, Model));
happened(up, none, #robot{place = Place} = Robot, Model) ->
    happen(up, begun(inline(Place, Model), Robot, Model));
happened(Event, Cut, Robot, Model) ->
    happen(Event, cut(Cut, begun(#{}, Robot, Model))).

cut(Cut, Run) -> Run#run{cut = Cut}.

%% @doc The moments at which the robot can stand still while it handles an event: with reduction only the
%% first of those that lead to the same.
-spec cuts(event(), t(), starl_check_model:t()) -> [cut()].
cuts(Event, Robot, #{reduce := Reduce} = Model) ->
    All = cuts({1, 0}, Event, Robot, Model),
    case Reduce of
        false -> [Cut || {Cut, _} <- All];
        true -> unlike(none, All)
    end.

%% Each with the actions that are left of the step. After its last action the next step begins.
cuts({Step, Actions} = Cut, Event, Robot, Model) ->
    case happened(Event, Cut, Robot, Model) of
        #run{cut = stands, robot = Stands} ->
            {{_, Left, _, _}, _} = starl_robot:standing(Stands),
            [{Cut, Left} | cuts({Step, Actions + 1}, Event, Robot, Model)];
        #run{steps = Steps} when Step < Steps -> cuts({Step + 1, 0}, Event, Robot, Model);
        #run{} ->
            []
    end.

%% What only the robot itself learns of, once the step is over, may come before it stands still or after.
unlike(_Before, []) ->
    [];
unlike({Step, Before}, [{{Step, _}, Left} | Cuts]) when Before =:= Left ->
    unlike({Step, Left}, Cuts);
unlike({Step, [Action | _]}, [{{Step, _} = Cut, Left} | Cuts]) ->
    [Cut || not is_local(Action)] ++ unlike({Step, Left}, Cuts);
unlike(_Before, [{{Step, _} = Cut, Left} | Cuts]) ->
    [Cut | unlike({Step, Left}, Cuts)].

%% Timers count from the beginning of their step.
is_local({{timeout, _}, _}) -> true;
is_local({{timeout, _}, _, _}) -> true;
is_local({cast, _, _}) -> true;
is_local({call, _, _, _}) -> true;
is_local({reply, _, _}) -> true;
is_local(_Action) -> false.

happen({message, From, Type, Body}, #run{sap = Sap} = Run) ->
    {Local, Next} = starl_check_sap:deliver(From, Type, Body, Sap),
    run(Local, Run#run{sap = Next});
happen({outcome, Ref, Lost}, #run{sap = Sap} = Run) ->
    {Local, Next} = starl_check_sap:settle(Ref, Lost, Sap),
    run(Local, Run#run{sap = Next});
happen({acknowledged, Ref, Dest}, #run{sap = Sap} = Run) ->
    Run#run{sap = starl_check_sap:acknowledge(Ref, Dest, Sap)};
happen({refused, Ref, Dest}, #run{sap = Sap} = Run) ->
    Run#run{sap = starl_check_sap:refuse(Ref, Dest, Sap)};
happen({delayed, Ref}, #run{sap = Sap} = Run) ->
    Run#run{sap = starl_check_sap:delay(Ref, Sap)};
happen({packet, Packet}, Run) ->
    run([{sap, packet, Packet}], Run);
happen(go_on, #run{robot = Robot} = Run) ->
    run(Run#run{robot = stepped(starl_robot:go_on(told(goes_on, Robot)))});
happen({crash, Name}, Run) ->
    crash(Name, Run);
happen(down, #run{robot = Robot} = Run) ->
    new_service(Run#run{robot = starl_robot:go_down(Robot)});
happen(die, #run{robot = Robot} = Run) ->
    new_service(Run#run{robot = starl_robot:die(killed, Robot)});
happen(up, #run{robot = Robot} = Run) ->
    Machines = starl_robot_machines:up(first, starl_robot:machines(Robot)),
    run(Run#run{robot = starl_robot:come_up(Machines, Robot)}).

crash(sap, #run{robot = Robot, sap = Sap} = Run) when Sap =/= real ->
    Bare = starl_robot:lost(sap, killed, Robot),
    Names = starl_robot_machines:names(starl_robot:machines(Bare)),
    run([{Name, info, {restarted, sap}} || Name <- Names], new_service(Run#run{robot = Bare}));
crash(Name, #run{robot = Robot} = Run) ->
    Bare = starl_robot:lost(Name, killed, Robot),
    {ok, Machines} = starl_robot_machines:restart(Name, infinity, starl_robot:machines(Bare)),
    run(Run#run{robot = starl_robot:back([Name], [], starl_robot:machines(Machines, Bare))}).

new_service(#run{sap = real} = Run) -> Run;
new_service(Run) -> Run#run{sap = starl_check_sap:new()}.

inline(Place, Model) ->
    Machines = starl_check_model:machines(Place, Model),
    maps:from_list([{Name, {Module, Config}} || {Name, Module, Config} <- Machines]).

%% @doc The running timers, and when each may fire.
-spec timers(t()) -> [{timer(), due()}].
timers(#robot{timers = Timers}) -> [{Key, Due} || {Key, Due, _} <- Timers].

%% @doc The calls of its SAP that wait for an answer; none if the model has the real SAP.
-spec calls(t()) -> [starl_check_sap:call()].
calls(#robot{sap = real}) -> [];
calls(#robot{sap = Sap}) -> starl_check_sap:calls(Sap).

%% @doc Whether it is up, stands still within a step, is down or dead.
-spec condition(t()) -> condition().
condition(#robot{standing = {_, _}}) -> stands;
condition(#robot{condition = Condition}) -> Condition.

%% @doc Whether time has passed since it began to stand still.
-spec has_aged(t()) -> boolean().
has_aged(#robot{place = Place, standing = {{_, _, _, Since}, _}}) ->
    Since < starl_check_term:now(Place).

%% @doc Whether its application has ended, or the robot has died.
-spec is_done(t()) -> boolean().
is_done(#robot{condition = dead}) ->
    true;
is_done(#robot{condition = down}) ->
    false;
is_done(#robot{machines = Machines}) ->
    {app, App} = lists:keyfind(app, 1, Machines),
    starl_machine:state(App) =:= done.

%% @doc Whether it has stood still for as long as a robot does here: what others send it is not lost, and
%% would become more and more.
-spec must_go_on(t(), starl_check_model:t()) -> boolean().
must_go_on(#robot{standing = none}, _Model) ->
    false;
must_go_on(#robot{place = Place, standing = {{_, _, _, Since}, _} = Standing}, Model) ->
    starl_check_term:now(Place) - Since > longest_us(Standing, Model).

%% @doc The robot after this number of ticks. No timer may have been due earlier, unless it stands still.
-spec shift(Ticks :: pos_integer(), t(), starl_check_model:t()) -> t().
shift(Ticks, #robot{machines = Machines, timers = Timers} = Robot, Model) ->
    Robot#robot{
        standing = longer(Robot#robot.standing, Ticks, Model),
        machines = older(Machines, Ticks, Model),
        stored = older(Robot#robot.stored, Ticks, Model),
        timers = [{Key, less(Due, Ticks), C} || {Key, Due, C} <- Timers]
    }.

%% To a machine all past times are equal.
older(Machines, Ticks, #{rates := Rates, past_us := Past}) ->
    starl_check_term:shift(Machines, Ticks, Rates, Past).

less(any, _Ticks) -> any;
less(Due, Ticks) -> max(0, Due - Ticks).

%% What it is about to send is aged as a message under way is; its moments and timers to their ends.
longer(none, _Ticks, _Model) ->
    none;
longer(Standing, Ticks, #{rates := Rates} = Model) ->
    starl_check_term:shift(Standing, Ticks, Rates, longest_us(Standing, Model) + 1).

%% Twice the longest time that matters: all that its moments forbid is over by then, and others have acted.
longest_us({{Name, Actions, _, _}, _}, #{horizon_us := Horizon, past_us := Past} = Model) ->
    2 * lists:max([Horizon, Past | timed(Name, Actions, Model)]).

timed(Name, Actions, Model) -> lists:append([times(Action, Name, Model) || Action <- Actions]).

times({until, _Us, Group, _Mark}, Name, Model) when is_list(Group) -> timed(Name, Group, Model);
times({{timeout, _}, cancel}, _Name, _Model) ->
    [];
times({{timeout, Timer}, Us, _}, Name, Model) ->
    [Us || starl_check_model:timer({Name, Timer}, Model) =:= timed];
times(_Action, _Name, _Model) ->
    [].

%% @doc The robot after a permutation of the robots of the team.
-spec rename(t(), starl_check_term:permutation()) -> t().
rename(#robot{place = Place, machines = Machines, timers = Timers, sap = Sap} = Robot, To) ->
    Robot#robot{
        stored = starl_check_term:rename(Robot#robot.stored, To),
        place = element(Place, To),
        standing = starl_check_term:rename(Robot#robot.standing, To),
        machines = starl_check_term:rename(Machines, To),
        timers = lists:sort(starl_check_term:rename(Timers, To)),
        sap = starl_check_term:rename(Sap, To)
    }.

%% @doc The robot when each robot has its own number.
-spec own(t()) -> t().
own(#robot{machines = Machines, timers = Timers, sap = Sap} = Robot) ->
    Robot#robot{
        stored = starl_check_term:own(Robot#robot.stored),
        standing = starl_check_term:own(Robot#robot.standing),
        machines = starl_check_term:own(Machines),
        timers = starl_check_term:own(Timers),
        sap = starl_check_term:own(Sap)
    }.

%% @doc The place of the robot in its team.
-spec place(t()) -> starl_check_term:place().
place(#robot{place = Place}) -> Place.

%% -- running to completion ------------------------------------------------------------------

%% The robot as the loop knows it.
begun(Inline, #robot{place = Place, machines = Machines, timers = Timers} = Robot, Model) ->
    #robot{condition = Condition, incarnations = Starts, stored = Stored, sap = Sap} = Robot,
    Running = [{Name, Timer, {Due, Content}} || {{Name, Timer}, Due, Content} <- Timers],
    Restored = starl_robot:restore(#{
        id => starl_check_model:id(Place, Model),
        driver => starl_check_world,
        condition => Condition,
        world => starl_check_world:new(Place, Stored, Model),
        machines => starl_robot_machines:restore(Inline, maps:from_list(Machines), Starts),
        timers => starl_robot_timers:from_list(Running),
        standing => Robot#robot.standing
    }),
    #run{robot = single(Restored), place = Place, model = Model, sap = Sap}.

single(Robot) -> starl_robot:pace(single, Robot).

%% The robot as the checker keeps it: equal situations are equal terms.
result(#run{robot = Robot, place = Place, sap = Sap}) ->
    Machines = starl_robot:machines(Robot),
    Now = starl_robot_machines:to_map(Machines),
    World = starl_robot:world(Robot),
    Timers = starl_robot_timers:to_list(starl_robot:timers(Robot)),
    Kept = #robot{
        place = Place,
        condition = starl_robot:condition(Robot),
        standing = starl_robot:standing(Robot),
        machines = [{Name, maps:get(Name, Now)} || Name <- starl_robot_machines:names(Machines)],
        incarnations = starl_robot_machines:starts(Machines),
        stored = starl_check_world:stored(World),
        timers = [{{Name, Timer}, Due, Content} || {Name, Timer, {Due, Content}} <- Timers],
        sap = Sap
    },
    {starl_check_world:sent(World), starl_check_world:traces(World), Kept}.

run(Local, #run{robot = Robot} = Run) -> run(Run#run{robot = starl_robot:first(Local, Robot)}).

%% Runs one event after the other. SAP by its contract has no machine.
run(#run{cut = stands} = Run) ->
    Run;
run(#run{robot = Robot, sap = Sap} = Run) ->
    case starl_robot:next(Robot) of
        none -> Run;
        {{sap, {call, From}, Request}, Rest} when Sap =/= real -> serve(Request, From, Rest, Run);
        {{sap, cast, Request}, Rest} when Sap =/= real -> serve(Request, none, Rest, Run);
        {{Name, boot, none}, _} -> run(Run#run{robot = aged(Name, stepped(Robot), Run)});
        {{Name, _, _}, _} -> run(step(Name, redrawn(Name, Robot, Run), Run))
    end.

step(Name, Robot, #run{steps = Before, cut = {Step, Actions}} = Run) when Step =:= Before + 1 ->
    Next = stepped(starl_robot:stand_still(Name, Actions, Robot)),
    case starl_robot:standing(Next) of
        none -> Run#run{robot = starl_robot:go_on(Next), steps = Step};
        _ -> Run#run{robot = told(stands, Next), steps = Step, cut = stands}
    end;
step(_Name, Robot, #run{steps = Before} = Run) ->
    Run#run{robot = stepped(Robot), steps = Before + 1}.

-spec told(starl_check_model:fact(), starl_robot:t()) -> starl_robot:t().
told(Event, Robot) ->
    starl_robot:world(starl_check_world:trace(robot, Event, starl_robot:world(Robot)), Robot).

%% A machine that crashes by itself ends the event.
stepped(Robot) ->
    case starl_robot:run(Robot) of
        {paused, Next} -> Next;
        {stands, Next} -> Next;
        {crashed, Name, Reason, _} -> throw({crashed, Name, Reason})
    end.

%% To a new machine all past times are equal.
aged(Name, Robot, #run{model = Model}) ->
    update(Name, fun(Machine) -> older(Machine, 0, Model) end, Robot).

%% In a model with equal draws a machine's stream of random numbers stays at its start.
redrawn(_Name, Robot, #run{model = #{draws := free}}) -> Robot;
redrawn(Name, Robot, _Run) -> update(Name, fun starl_check_term:redrawn/1, Robot).

update(Name, Fun, Robot) ->
    starl_robot:machines(
        starl_robot_machines:update(Name, Fun, starl_robot:machines(Robot)), Robot
    ).

serve(Request, From, Robot, #run{place = Place, sap = Sap, model = Model} = Run) ->
    #{ids := Ids} = Model,
    Self = starl_check_model:id(Place, Model),
    {Local, Messages, Next} =
        starl_check_sap:request(Request, From, Self, lists:delete(Self, Ids), Sap),
    Sent = [{message, To, Type, Body, Ref} || {To, Type, Body, Ref} <- Messages],
    World = starl_check_world:put_under_way(Sent, starl_robot:world(Robot)),
    run(Run#run{robot = starl_robot:then(Local, starl_robot:world(World, Robot)), sap = Next}).
