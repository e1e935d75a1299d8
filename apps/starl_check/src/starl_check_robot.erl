%% @doc One robot of a checked team: its machines, their timers, its part of SAP. Pure.
%%
%% An event is worked off with all the local events that it gives rise to, as the runtime does
%% (see starl_sim_robot): nothing else happens to the robot meanwhile. A crash is that of one
%% machine: it starts anew with the next incarnation and with what it has stored, its timers are
%% forgotten, and the robot's other machines are told.
-module(starl_check_robot).

-export([boot/2, event/3, timers/1, calls/1, is_done/1, condition/1, shift/3, rename/2]).

-export_type([t/0, event/0, sent/0, timer/0, due/0, condition/0]).

%% Where a timer belongs and what it is called.
-type timer() :: {starl_machine:name(), Timer :: term()}.

-type event() ::
    {message, starl:robot_id(), Type :: atom(), Body :: term()}
    | {outcome, starl_check_sap:ref(), Lost :: [starl:robot_id()]}
    | {acknowledged | refused, starl_check_sap:ref(), starl:robot_id()}
    | {delayed, starl_check_sap:ref()}
    | {packet, starl_packet:t()}
    | {fire, timer()}
    | {crash, starl_machine:name()}
    | down
    | up
    | die.

%% What the robot puts under way.
-type sent() ::
    {message, starl:robot_id(), Type :: atom(), Body :: term(), starl_check_sap:ref() | none}
    | {packet, starl:robot_id(), starl_packet:t()}.

%% When a timer may fire: at any time, or when so many ticks have passed.
-type due() :: any | non_neg_integer().

%% `down': it will start anew; `dead': it never will.
-type condition() :: up | down | dead.

-record(robot, {
    place :: starl_check_term:place(),
    condition = up :: condition(),
    %% in the order in which they start
    machines = [] :: [{starl_machine:name(), starl_machine:t()}],
    incarnations = #{} :: #{starl_machine:name() => pos_integer()},
    stored = #{} :: #{starl_machine:name() => term()},
    timers = [] :: [{timer(), due(), Content :: term()}],
    sap :: starl_check_sap:t() | real
}).

-opaque t() :: #robot{}.

%% What an event brings about, newest first.
-record(run, {
    robot :: #robot{},
    model :: starl_check_model:t(),
    sent = [] :: [sent()],
    traces = [] :: [starl_monitor:trace_event()]
}).

-type result() :: {[sent()], [starl_monitor:trace_event()], t()}.

%% @doc The robot at a place of its team, when all its machines have started. A machine that crashes
%% by itself, now or at an event, is thrown: `{crashed, Machine, Reason}'.
-spec boot(starl_check_term:place(), starl_check_model:t()) -> result().
boot(Place, #{sap := Sap} = Model) ->
    Service =
        case Sap of
            real -> real;
            contract -> starl_check_sap:new()
        end,
    Robot = #robot{place = Place, sap = Service},
    result(run(boots(Place, Model), #run{robot = Robot, model = Model})).

%% @doc The robot after an event.
-spec event(event(), t(), starl_check_model:t()) -> result().
event(Event, Robot, Model) ->
    result(happen(Event, #run{robot = Robot, model = Model})).

happen({message, From, Type, Body}, #run{robot = #robot{sap = Sap} = Robot} = Run) ->
    {Local, Next} = starl_check_sap:deliver(From, Type, Body, Sap),
    run(Local, Run#run{robot = Robot#robot{sap = Next}});
happen({outcome, Ref, Lost}, #run{robot = #robot{sap = Sap} = Robot} = Run) ->
    {Local, Next} = starl_check_sap:settle(Ref, Lost, Sap),
    run(Local, Run#run{robot = Robot#robot{sap = Next}});
happen({acknowledged, Ref, Dest}, #run{robot = #robot{sap = Sap} = Robot} = Run) ->
    Run#run{robot = Robot#robot{sap = starl_check_sap:acknowledge(Ref, Dest, Sap)}};
happen({refused, Ref, Dest}, #run{robot = #robot{sap = Sap} = Robot} = Run) ->
    Run#run{robot = Robot#robot{sap = starl_check_sap:refuse(Ref, Dest, Sap)}};
happen({delayed, Ref}, #run{robot = #robot{sap = Sap} = Robot} = Run) ->
    Run#run{robot = Robot#robot{sap = starl_check_sap:delay(Ref, Sap)}};
happen({packet, Packet}, Run) ->
    run([{sap, packet, Packet}], Run);
happen({fire, {Name, Timer} = Key}, #run{robot = #robot{timers = Timers} = Robot} = Run) ->
    {value, {_, _, Content}, Rest} = lists:keytake(Key, 1, Timers),
    run([{Name, timer_type(Timer), Content}], Run#run{robot = Robot#robot{timers = Rest}});
happen({crash, Name}, #run{robot = #robot{timers = Timers} = Robot} = Run) ->
    Left = [T || {{Of, _}, _, _} = T <- Timers, Of =/= Name],
    Bare = trace(Name, crashed, Run#run{robot = Robot#robot{timers = Left}}),
    Others = [Other || {Other, _} <- Robot#robot.machines, Other =/= Name],
    Told = [{Other, info, {restarted, Name}} || Other <- Others],
    case {Name, Robot#robot.sap} of
        {sap, Sap} when Sap =/= real -> run(Told, new_service(Bare));
        _ -> run([{Name, boot, none} | Told], Bare)
    end;
happen(down, #run{robot = #robot{machines = Machines}} = Run) ->
    Gone = gone(down, trace(robot, down, Run)),
    lists:foldl(fun({Name, _}, R) -> trace(Name, crashed, R) end, Gone, Machines);
happen(die, Run) ->
    gone(dead, trace(robot, {died, killed}, Run));
happen(up, #run{robot = #robot{place = Place} = Robot, model = Model} = Run) ->
    Up = trace(robot, up, Run#run{robot = Robot#robot{condition = up}}),
    run(boots(Place, Model), Up).

%% Nothing is left of a robot but its numbers of starts.
gone(Condition, #run{robot = #robot{sap = Sap} = Robot} = Run) ->
    Bare = Robot#robot{condition = Condition, machines = [], timers = []},
    case Sap of
        real -> Run#run{robot = Bare};
        _ -> new_service(Run#run{robot = Bare})
    end.

boots(Place, Model) ->
    [{Name, boot, none} || {Name, _, _} <- starl_check_model:machines(Place, Model)].

new_service(#run{robot = Robot} = Run) ->
    Run#run{robot = Robot#robot{sap = starl_check_sap:new()}}.

timer_type(state_timeout) -> state_timeout;
timer_type(Timer) -> {timeout, Timer}.

%% @doc Its timers that run, and when they may fire.
-spec timers(t()) -> [{timer(), due()}].
timers(#robot{timers = Timers}) -> [{Key, Due} || {Key, Due, _} <- Timers].

%% @doc Its calls of SAP that wait for an answer; none where SAP is real.
-spec calls(t()) -> [starl_check_sap:call()].
calls(#robot{sap = real}) -> [];
calls(#robot{sap = Sap}) -> starl_check_sap:calls(Sap).

%% @doc Is it up?
-spec condition(t()) -> condition().
condition(#robot{condition = Condition}) -> Condition.

%% @doc Has its application ended, or died?
-spec is_done(t()) -> boolean().
is_done(#robot{condition = dead}) ->
    true;
is_done(#robot{condition = down}) ->
    false;
is_done(#robot{machines = Machines}) ->
    {app, App} = lists:keyfind(app, 1, Machines),
    starl_machine:state(App) =:= done.

%% @doc The robot when so many ticks have passed. None of its timers has been due earlier.
-spec shift(Ticks :: pos_integer(), t(), starl_check_model:t()) -> t().
shift(Ticks, #robot{machines = Machines, timers = Timers} = Robot, Model) ->
    Robot#robot{
        machines = older(Machines, Ticks, Model),
        stored = older(Robot#robot.stored, Ticks, Model),
        timers = [{Key, less(Due, Ticks), C} || {Key, Due, C} <- Timers]
    }.

%% All times of a machine that are over are the same to it.
older(Machines, Ticks, #{rates := Rates, past_us := Past}) ->
    starl_check_term:shift(Machines, Ticks, Rates, Past).

less(any, _Ticks) -> any;
less(Due, Ticks) -> Due - Ticks.

%% @doc The robot with each robot of the team in the place of another.
-spec rename(t(), starl_check_term:permutation()) -> t().
rename(#robot{place = Place, machines = Machines, timers = Timers, sap = Sap} = Robot, To) ->
    Robot#robot{
        stored = starl_check_term:rename(Robot#robot.stored, To),
        place = element(Place, To),
        machines = starl_check_term:rename(Machines, To),
        timers = lists:sort(starl_check_term:rename(Timers, To)),
        sap = starl_check_term:rename(Sap, To)
    }.

%% -- running to completion ------------------------------------------------------------------

result(#run{robot = Robot, sent = Sent, traces = Traces}) ->
    {lists:reverse(Sent), lists:reverse(Traces), Robot}.

run([], Run) ->
    Run;
run([{Name, Type, Content} | Local], Run) ->
    {New, Next} = handle(Name, Type, Content, Run),
    run(Local ++ New, Next).

handle(Name, boot, none, #run{robot = #robot{place = Place} = Robot, model = Model} = Run) ->
    #robot{machines = Machines, incarnations = Incarnations} = Robot,
    Incarnation = maps:get(Name, Incarnations, 0) + 1,
    {_, Module, Config} = lists:keyfind(Name, 1, starl_check_model:machines(Place, Model)),
    Base = (base(Name, Incarnation, Place, Model))#{stored => stored(Name, Robot)},
    {Actions, Machine} = guarded(Name, fun() -> starl_machine:new(Module, Config, Base) end),
    perform(Actions, Name, Run#run{
        robot = Robot#robot{
            machines = lists:keystore(Name, 1, Machines, {Name, older(Machine, 0, Model)}),
            incarnations = Incarnations#{Name => Incarnation}
        }
    });
handle(sap, {call, From}, Request, #run{robot = #robot{sap = Sap}} = Run) when Sap =/= real ->
    serve(Request, From, Run);
handle(sap, cast, Request, #run{robot = #robot{sap = Sap}} = Run) when Sap =/= real ->
    serve(Request, none, Run);
handle(Name, Type, Content, #run{robot = #robot{place = Place} = Robot} = Run) ->
    #robot{machines = Machines} = Robot,
    {Name, Machine} = lists:keyfind(Name, 1, Machines),
    Meta = #{now => starl_check_term:now(Place), robot => starl_check_term:id(Place)},
    Drawing = before_draws(Machine, Run),
    {Actions, Next} = guarded(Name, fun() -> starl_machine:step(Type, Content, Meta, Drawing) end),
    Kept = lists:keyreplace(Name, 1, Machines, {Name, Next}),
    perform(Actions, Name, Run#run{robot = Robot#robot{machines = Kept}}).

stored(Name, #robot{stored = Stored}) ->
    case Stored of
        #{Name := Term} -> {stored, Term};
        #{} -> none
    end.

%% A machine that cannot handle what happens to it ends the event there.
guarded(Name, Fun) ->
    try
        Fun()
    catch
        Class:Reason:Stack -> throw({crashed, Name, starl_crash:reason(Class, Reason, Stack)})
    end.

%% Where a machine is to draw the same each time, its stream does not go on.
before_draws(Machine, #run{model = #{draws := free}}) -> Machine;
before_draws(Machine, _Run) -> starl_check_term:redrawn(Machine).

base(Name, Incarnation, Place, #{ids := Ids, same_random := Same, waits := Waits}) ->
    Seed =
        case Same of
            true -> erlang:phash2(Name);
            false -> erlang:phash2({Place, Name})
        end,
    #{
        robot => starl_check_term:id(Place),
        participants => Ids,
        name => Name,
        incarnation => Incarnation,
        random => rand:seed_s(exsss, Seed),
        now => started(Place, lists:member(Place, Waits))
    }.

started(Place, true) -> starl_check_term:now(Place);
started(Place, false) -> starl_check_term:long_ago(Place).

serve(Request, From, #run{robot = #robot{place = Place, sap = Sap} = Robot} = Run) ->
    Self = starl_check_term:id(Place),
    Others = lists:delete(Self, maps:get(ids, Run#run.model)),
    {Local, Messages, Next} = starl_check_sap:request(Request, From, Self, Others, Sap),
    Sent = [{message, To, Type, Body, Ref} || {To, Type, Body, Ref} <- Messages],
    {Local, Run#run{
        robot = Robot#robot{sap = Next}, sent = lists:reverse(Sent, Run#run.sent)
    }}.

perform(Actions, Name, Run) ->
    {Local, Done} = lists:foldl(
        fun(Action, {L, R}) ->
            case perform_one(Action, Name, R) of
                #run{} = Next -> {L, Next};
                Event -> {[Event | L], R}
            end
        end,
        {[], Run},
        Actions
    ),
    {lists:reverse(Local), Done}.

perform_one({trace, Event}, Name, Run) ->
    trace(Name, Event, Run);
perform_one({store, Term}, Name, #run{robot = Robot, model = Model} = Run) ->
    Stored = (Robot#robot.stored)#{Name => older(Term, 0, Model)},
    Run#run{robot = Robot#robot{stored = Stored}};
%% A datagram: over SAP's contract a message like others, of which nobody hears.
perform_one(
    {transmit, Dest, {starl, 1, shout, _, Type, Body}},
    _Name,
    #run{
        robot = #robot{sap = Sap}
    } = Run
) when Sap =/= real ->
    Sent = [{message, To, Type, Body, none} || To <- dests(Dest, Run)],
    Run#run{sent = lists:reverse(Sent, Run#run.sent)};
perform_one({transmit, Dest, Packet}, _Name, #run{} = Run) ->
    Sent = [{packet, To, Packet} || To <- dests(Dest, Run)],
    Run#run{sent = lists:reverse(Sent, Run#run.sent)};
perform_one({{timeout, Timer}, cancel}, Name, Run) ->
    cancel({Name, Timer}, Run);
perform_one({state_timeout, cancel}, Name, Run) ->
    cancel({Name, state_timeout}, Run);
perform_one({{timeout, Timer}, Us, Content}, Name, Run) ->
    start({Name, Timer}, Us, Content, Run);
perform_one({state_timeout, Us, Content}, Name, Run) ->
    start({Name, state_timeout}, Us, Content, Run);
perform_one(Action, Name, _Run) when
    element(1, Action) =:= cast; element(1, Action) =:= call; element(1, Action) =:= reply
->
    starl_platform:local(Action, Name).

dests(all, #run{robot = #robot{place = Place}, model = #{ids := Ids}}) ->
    lists:delete(starl_check_term:id(Place), Ids);
dests(Dest, _Run) ->
    [Dest].

trace(Name, Event, #run{robot = #robot{place = Place}, traces = Traces} = Run) ->
    Run#run{traces = [{0, starl_check_term:id(Place), Name, Event} | Traces]}.

cancel(Key, #run{robot = #robot{timers = Timers} = Robot} = Run) ->
    Run#run{robot = Robot#robot{timers = lists:keydelete(Key, 1, Timers)}}.

%% Rounded up to ticks: a timer never fires before its time.
start(Key, Us, Content, #run{robot = Robot, model = Model} = Run) ->
    #robot{place = Place, timers = Timers} = Robot,
    Due =
        case starl_check_model:timer(Key, Model) of
            timed ->
                Rate = element(Place, maps:get(rates, Model)),
                (Us + Rate - 1) div Rate;
            _ ->
                any
        end,
    New = lists:keystore(Key, 1, Timers, {Key, Due, Content}),
    Run#run{robot = Robot#robot{timers = lists:sort(New)}}.
