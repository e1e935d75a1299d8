%% @doc A robot in a shard: its processes, what they still have to do in this window, and its
%% crashes. What it does reaches no other robot before the next window, so a shard has many
%% robots at work at once; the events of one robot are worked off one by one, in the order of
%% their keys, each with all the local events that it gives rise to.
-module(starl_sim_robot).

-export([new/3, attach/3, boot/1]).
-export([at/2, open/3, proceed/2, answered/2, crashed/3, close/1]).
-export([busy/1, owns/2, result/1, piece/1, summary/2, machines/1]).

-export_type([t/0, summary/0, window/0]).

-define(CLASS_FAULT, 0).
%% So many crashes of a robot are remembered.
-define(REMEMBERED, 10).

%% What is known of a robot: its digest chain, its events and packets, its application's result,
%% and its latest crashes, newest first.
-type summary() :: #{
    chain := non_neg_integer(),
    events := non_neg_integer(),
    packets := non_neg_integer(),
    result := running | died | {done, term()},
    pose := starl:pose(),
    crashes := [{starl_machine:name(), Reason :: term()}]
}.

%% When a window begins and ends.
-type window() :: {From :: starl_sim_queue:time(), Until :: starl_sim_queue:time()}.

%% What one of the machines has to do: handle an event, or start.
-type local() :: starl_platform:local() | {starl_machine:name(), boot, none}.

-record(robot, {
    id :: starl:robot_id(),
    body :: starl_sim_platform:t(),
    sup :: pid() | dead,
    processes = #{} :: #{starl_machine:name() => pid()},
    incarnations = #{} :: #{starl_machine:name() => pos_integer()},
    %% events of this window, by key; local events of the present moment, in order
    events = [] :: [starl_sim_queue:event()],
    local = [] :: [local()],
    %% the machine that is at work
    busy = none :: starl_machine:name() | none,
    crashes = [] :: [{starl_machine:name(), Reason :: term()}]
}).

-opaque t() :: #robot{}.

%% @doc A robot whose tree has been started under this supervisor.
-spec new(starl:robot_id(), starl_sim_platform:t(), Sup :: pid()) -> t().
new(Id, Body, Sup) -> #robot{id = Id, body = Body, sup = Sup}.

%% @doc One of its processes has started.
-spec attach(starl_machine:name(), pid(), t()) -> t().
attach(Name, Pid, #robot{processes = Processes, incarnations = Incarnations} = Robot) ->
    _ = erlang:monitor(process, Pid),
    Incarnation = maps:get(Name, Incarnations, 0) + 1,
    Robot#robot{
        processes = Processes#{Name => Pid}, incarnations = Incarnations#{Name => Incarnation}
    }.

%% @doc All machines are to be booted, before anything else.
-spec boot(t()) -> t().
boot(#robot{processes = Processes} = Robot) ->
    Robot#robot{local = [{Name, boot, none} || Name <- boot_order(maps:keys(Processes))]}.

%% @doc Opens a window with these events of the robot, sorted, and goes about the first.
-spec open([starl_sim_queue:event()], window(), t()) -> {busy | idle, t()}.
open(_Events, _Window, #robot{sup = dead} = Robot) -> {idle, Robot};
open(Events, Window, #robot{local = []} = Robot) -> next_event(Events, Window, Robot);
open([{_, Time, _, _, _, _} | _] = Events, {From, Until} = Window, #robot{body = Body} = Robot) ->
    Moved = starl_sim_platform:at({Time, From, Until}, Body),
    proceed(Window, Robot#robot{events = Events, body = Moved}).

%% @doc Sends the next step to one of its machines, if there is anything left to do in this
%% window.
-spec proceed(window(), t()) -> {busy | idle, t()}.
proceed(Window, #robot{local = [{Name, Type, Content} | Rest], body = Body} = Robot) ->
    case Robot#robot.processes of
        #{Name := Pid} ->
            Hashed = starl_sim_platform:hash_event(Name, Type, Content, Body),
            Pid ! message(Name, Type, Content, Hashed, Robot),
            {busy, Robot#robot{local = Rest, body = Hashed, busy = Name}};
        #{} ->
            proceed(Window, refuse(Name, Type, Robot#robot{local = Rest}))
    end;
proceed(Window, #robot{events = Events} = Robot) ->
    next_event(Events, Window, Robot).

%% @doc The robot, which rests, at a later time.
-spec at(starl_sim_queue:time(), t()) -> t().
at(Now, #robot{body = Body} = Robot) ->
    Robot#robot{body = starl_sim_platform:at({Now, Now, Now}, Body)}.

%% @doc The machine at work has answered with its actions.
-spec answered([starl_machine:action()], t()) -> {ok, t()} | ignored.
answered(_Actions, #robot{busy = none}) ->
    %% the last word of a process that was killed meanwhile
    ignored;
answered(Actions, #robot{busy = Name, body = Body0, local = Local} = Robot) ->
    {New, Body} = starl_sim_platform:perform(Actions, Name, Body0),
    Next = Robot#robot{busy = none, body = Body, local = Local ++ New},
    case starl_sim_platform:soon(Body) of
        [] -> {ok, Next};
        _ -> {ok, plan(Next)}
    end.

%% New events of this robot in this window take their places among the others.
plan(#robot{body = Body, events = Events} = Robot) ->
    {Soon, Rest} = starl_sim_platform:take_soon(Body),
    Robot#robot{body = Rest, events = lists:merge(lists:sort(Soon), Events)}.

%% @doc One of its processes is gone. Virtual time waits until its supervisor has restarted it;
%% the others are told. If the supervisor gives up, the robot has died.
-spec crashed(pid(), Reason :: term(), t()) -> t().
crashed(Pid, _Reason, #robot{sup = Pid} = Robot) ->
    died(gave_up, Robot);
crashed(Pid, Reason, #robot{busy = Busy, crashes = Crashes} = Robot) ->
    Name = name_of(Pid, Robot),
    Bare = forget(Name, Robot#robot{
        body = starl_sim_platform:trace(Name, crashed, Robot#robot.body),
        busy = still_busy(Name, Busy),
        crashes = lists:sublist([{Name, Reason} | Crashes], ?REMEMBERED)
    }),
    case await_restart([Name], [], Bare) of
        {ok, Names, Back} -> Back#robot{local = restarts(Names, Back) ++ Back#robot.local};
        {died, Dead} -> Dead
    end.

%% @doc Closes the window and gives what came out of it.
-spec close(t()) -> {starl_sim_platform:yield(), t()}.
close(#robot{body = Body} = Robot) ->
    {Yield, Rest} = starl_sim_platform:take(Body),
    {Yield, Robot#robot{body = Rest}}.

%% @doc The machine that is at work, if any.
-spec busy(t()) -> [{starl:robot_id(), starl_machine:name()}].
busy(#robot{busy = none}) -> [];
busy(#robot{id = Id, busy = Name}) -> [{Id, Name}].

%% @doc Is this one of its processes?
-spec owns(pid(), t()) -> boolean().
owns(Pid, #robot{sup = Sup, processes = Processes}) ->
    Pid =:= Sup orelse lists:member(Pid, maps:values(Processes)).

%% @doc Its application's result.
-spec result(t()) -> running | died | {done, term()}.
result(#robot{sup = dead}) -> died;
result(#robot{body = Body}) -> starl_sim_platform:result(Body).

%% @doc The piece of motion that it is in.
-spec piece(t()) -> starl_trajectory:piece().
piece(#robot{body = Body}) -> starl_sim_platform:piece(Body).

%% @doc What is known of it at a time.
-spec summary(starl_sim_queue:time(), t()) -> summary().
summary(Time, #robot{body = Body} = Robot) ->
    {Chain, Events, Packets} = starl_sim_platform:digest(Body),
    #{
        chain => Chain,
        events => Events,
        packets => Packets,
        result => result(Robot),
        pose => starl_trajectory:pose(Time, starl_sim_platform:piece(Body)),
        crashes => Robot#robot.crashes
    }.

%% @doc Its machines, each with its state and data.
-spec machines(t()) -> #{starl_machine:name() => term()}.
machines(#robot{processes = Processes}) -> maps:map(fun(_, Pid) -> machine(Pid) end, Processes).

%% -- events ---------------------------------------------------------------------------------

next_event([], _Window, Robot) ->
    {idle, Robot};
next_event([{_, Time, Class, _, Seq, Content} | Rest], {From, Until} = Window, Robot) ->
    Moment = {Time, From, Until},
    case Class of
        ?CLASS_FAULT ->
            Body = starl_sim_platform:at(Moment, Robot#robot.body),
            proceed(Window, strike(Content, Robot#robot{events = Rest, body = Body}));
        _ ->
            begin_event(Content, Seq, Moment, Window, Rest, Robot)
    end.

begin_event({timer, Name, Timer, Content}, Seq, Moment, Window, Rest, Robot) ->
    #robot{body = Body} = Robot,
    case starl_sim_platform:fire(Name, Timer, Seq, Body) of
        {ok, Fired} ->
            dispatch(Name, timer_type(Timer), Content, Moment, Window, Rest, Fired, Robot);
        stale ->
            next_event(Rest, Window, Robot)
    end;
begin_event({Name, Type, Content}, _Seq, Moment, Window, Rest, #robot{body = Body} = Robot) ->
    dispatch(Name, Type, Content, Moment, Window, Rest, Body, Robot).

timer_type(state_timeout) -> state_timeout;
timer_type(Timer) -> {timeout, Timer}.

dispatch(Name, Type, Content, Moment, Window, Rest, Body, #robot{processes = Processes} = Robot) ->
    Hashed = starl_sim_platform:hash_event(Moment, Name, Type, Content, Body),
    case Processes of
        #{Name := Pid} ->
            Pid ! message(Name, Type, Content, Hashed, Robot),
            {busy, Robot#robot{events = Rest, body = Hashed, busy = Name}};
        #{} ->
            proceed(Window, refuse(Name, Type, Robot#robot{events = Rest, body = Hashed}))
    end.

refuse(Name, Type, #robot{body = Body, local = Local} = Robot) ->
    Traced = starl_sim_platform:trace(Name, {unknown_machine, Name}, Body),
    Robot#robot{body = Traced, local = Local ++ refusal(Name, Type)}.

%% A call to a machine that the robot does not have must not wait for ever.
refusal(Name, {call, {From, Tag}}) -> [{From, {reply, Tag}, {no_such_machine, Name}}];
refusal(_Name, _Type) -> [].

message(Name, boot, none, Body, #robot{id = Id, incarnations = Incarnations}) ->
    {starl_boot, starl_sim_platform:boot(Id, Name, maps:get(Name, Incarnations), Body)};
message(_Name, Type, Content, Body, #robot{id = Id}) ->
    {starl_step, Type, Content, #{now => starl_sim_platform:local_time(Body), robot => Id}}.

%% The platform's machines first, the application last, whatever their names.
boot_order(Names) ->
    First = [Name || Name <- [sap, location, motion], lists:member(Name, Names)],
    Last = [app || lists:member(app, Names)],
    First ++ lists:sort(Names -- (First ++ Last)) ++ Last.

%% -- faults and crashes ---------------------------------------------------------------------

strike(wake, Robot) ->
    Robot;
strike(_Fault, #robot{sup = dead} = Robot) ->
    Robot;
strike({kill_machine, Name}, #robot{processes = Processes} = Robot) ->
    case Processes of
        #{Name := Pid} ->
            exit(Pid, kill),
            receive
                {'DOWN', _, process, Pid, Reason} -> crashed(Pid, Reason, Robot)
            end;
        #{} ->
            Robot
    end;
strike(kill_robot, #robot{sup = Sup} = Robot) ->
    exit(Sup, kill),
    receive
        {'DOWN', _, process, Sup, _} -> died(killed, Robot)
    end.

name_of(Pid, #robot{processes = Processes}) ->
    [Name] = [N || {N, P} <- maps:to_list(Processes), P =:= Pid],
    Name.

still_busy(Name, Name) -> none;
still_busy(_, Busy) -> Busy.

forget(Name, #robot{body = Body, processes = Processes} = Robot) ->
    Robot#robot{
        body = starl_sim_platform:forget_timers(Name, Body),
        processes = maps:remove(Name, Processes)
    }.

%% Another robot's process that goes down meanwhile is left for the shard to see.
await_restart([], Back, Robot) ->
    {ok, boot_order(Back), Robot};
await_restart(Missing, Back, #robot{id = Id, sup = Sup, processes = Processes} = Robot) ->
    Own = maps:from_list([{Pid, Name} || {Name, Pid} <- maps:to_list(Processes)]),
    receive
        {starl_attach, Id, Name, Pid} ->
            await_restart(lists:delete(Name, Missing), [Name | Back], attach(Name, Pid, Robot));
        {'DOWN', _, process, Sup, _} ->
            {died, died(gave_up, Robot)};
        {'DOWN', _, process, Pid, _} when is_map_key(Pid, Own) ->
            Name = maps:get(Pid, Own),
            await_restart([Name | Missing], lists:delete(Name, Back), forget(Name, Robot))
    end.

restarts(Names, #robot{processes = Processes}) ->
    Told = boot_order(maps:keys(Processes)),
    [{Name, boot, none} || Name <- Names] ++
        [{To, info, {restarted, Name}} || Name <- Names, To <- Told, To =/= Name].

%% A robot that died for good: it stands where it is, for ever.
died(Reason, #robot{body = Body} = Robot) ->
    Stopped = starl_sim_platform:stop(Body),
    Traced = starl_sim_platform:trace(robot, {died, Reason}, Stopped),
    Robot#robot{
        body = starl_sim_platform:ended(Traced),
        sup = dead,
        processes = #{},
        local = [],
        events = [],
        busy = none
    }.

machine(Pid) ->
    case proc_lib:translate_initial_call(Pid) of
        {starl_app_proc, _, _} ->
            sequential;
        _ ->
            seen(starl_machine_proc:machine(Pid))
    end.

seen(waiting) ->
    waiting;
seen(Machine) ->
    #{
        module => starl_machine:module(Machine),
        state => starl_machine:state(Machine),
        data => starl_machine:data(Machine)
    }.
