%% @doc A robot in a shard: its machines, and what they still have to do in this window. What it
%% does reaches no other robot before the next window, so a shard has many robots at work at once;
%% the events of one robot are worked off one by one, in the order of their keys, each with all the
%% local events that it gives rise to. What a crash does to it: {@link starl_sim_crash}.
-module(starl_sim_robot).

-export([new/3, at/2, open/3, answered/2, down/4, yield/1]).
-export([halt_after/2, halted/1, resume/1]).
-export([busy/1, owns/2, result/1, piece/1, summary/2, recorded/1, machines/1]).

-export_type([t/0, summary/0, window/0]).

-define(CLASS_FAULT, 0).
%% So many crashes of a robot are remembered.
-define(REMEMBERED, 10).

%% What is known of a robot: when it was last at work (us), its digest chain with checkpoints, its
%% events and packets, its application's result, and its latest crashes, newest first.
-type summary() :: #{
    at_us := starl_sim_queue:time(),
    chain := non_neg_integer(),
    checkpoints := [starl_sim_ledger:checkpoint()],
    events := non_neg_integer(),
    packets := non_neg_integer(),
    result := running | died | given_up | {done, term()},
    pose := starl:pose(),
    crashes := [{starl_machine:name(), Reason :: term()}]
}.

%% When a window begins and ends.
-type window() :: {From :: starl_sim_queue:time(), Until :: starl_sim_queue:time()}.

-record(robot, {
    id :: starl:robot_id(),
    body :: starl_sim_platform:t(),
    machines :: starl_sim_machines:t(),
    %% events of this window, by key; local events of the present moment, in order
    events = [] :: [starl_sim_queue:event()],
    local = [] :: [starl_sim_crash:local()],
    %% the machine whose process is at work
    busy = none :: starl_machine:name() | none,
    %% after so many events it does no more until it is resumed
    stop = none :: pos_integer() | none,
    hold = {0, 0} :: starl_sim_hold:t(),
    crashes = [] :: [{starl_machine:name(), Reason :: term()}]
}).

-opaque t() :: #robot{}.

%% @doc A robot all of whose machines are to be booted before anything else.
-spec new(starl:robot_id(), starl_sim_platform:t(), starl_sim_machines:t()) -> t().
new(Id, Body, Machines) ->
    Boots = starl_sim_crash:boots(Machines),
    #robot{id = Id, body = Body, machines = Machines, local = Boots}.

%% @doc Opens a window with these events of the robot, sorted, and goes about the first.
-spec open([starl_sim_queue:event()], window(), t()) -> {busy | idle | held, t()}.
open([{_, Time, _, _, _, _} | _] = Events, Window, #robot{body = Body, machines = M} = Robot) ->
    Opened = starl_sim_platform:open(Time, Window, Body),
    case starl_sim_machines:condition(M) of
        up when Robot#robot.hold =:= {0, 0} ->
            work(Robot#robot.local, Events, Opened, M, Robot);
        up ->
            proceed(postpone(Robot#robot{body = Opened, events = Events}));
        _ ->
            proceed(Robot#robot{body = Opened, events = faults_of(Events)})
    end.

%% What comes to a robot that is down is lost.
faults_of(Events) -> [Event || {_, _, ?CLASS_FAULT, _, _, _} = Event <- Events].

%% @doc The robot at a later time, between two windows.
-spec at(starl_sim_queue:time(), t()) -> t().
at(Now, #robot{body = Body} = Robot) ->
    Robot#robot{body = starl_sim_platform:rest(Now, Body)}.

%% @doc The process at work has answered with its machine's actions; the robot goes on.
-spec answered([starl_machine:action()], t()) -> {busy | idle | held, t()} | ignored.
answered(_Actions, #robot{busy = none}) ->
    %% the last word of a process that was killed meanwhile
    ignored;
answered(Actions, #robot{busy = Name, body = Body, machines = Machines} = Robot) ->
    #robot{local = Local, events = Events} = Robot,
    perform(Actions, Name, Local, Events, Body, Machines, Robot#robot{busy = none}).

%% @doc One of its processes is gone. If that was the one at work, the robot can go on.
-spec down(pid(), Reason :: term(), go_on | rest, t()) -> {busy | idle | held, t()}.
down(Pid, Reason, Then, #robot{machines = Machines, busy = Busy} = Robot) ->
    Crashed =
        case starl_sim_machines:name_of(Pid, Machines) of
            {ok, Busy} -> crashed(Busy, Reason, Robot#robot{busy = none});
            {ok, Name} -> crashed(Name, Reason, Robot);
            none -> died(gave_up, Robot)
        end,
    case Crashed of
        #robot{busy = none} when Then =:= go_on -> proceed(Crashed);
        #robot{busy = none} -> {idle, Crashed};
        #robot{} -> {busy, Crashed}
    end.

%% @doc Has it halt just after its N-th event, in the midst of a window; `none': no more.
-spec halt_after(N :: pos_integer() | none, t()) -> t().
halt_after(N, Robot) -> Robot#robot{stop = N}.

%% @doc When it came to the event after which it is to halt, if it has.
-spec halted(t()) -> {at, starl_sim_queue:time()} | no.
halted(#robot{stop = none}) ->
    no;
halted(#robot{stop = N, body = Body}) ->
    case count(Body) of
        N -> {at, starl_sim_platform:now(Body)};
        _ -> no
    end.

%% @doc Goes on with the window in which it was held.
-spec resume(t()) -> {busy | idle | held, t()}.
resume(Robot) -> proceed(Robot).

%% @doc What has come out of the window.
-spec yield(t()) -> starl_sim_platform:yield().
yield(#robot{body = Body}) -> starl_sim_platform:yield(Body).

%% @doc The machine that is at work, if any.
-spec busy(t()) -> [{starl:robot_id(), starl_machine:name()}].
busy(#robot{busy = none}) -> [];
busy(#robot{id = Id, busy = Name}) -> [{Id, Name}].

%% @doc Is this one of its processes?
-spec owns(pid(), t()) -> boolean().
owns(Pid, #robot{machines = Machines}) -> starl_sim_machines:owns(Pid, Machines).

%% @doc Its application's result.
-spec result(t()) -> running | died | given_up | {done, term()}.
result(#robot{body = Body, machines = Machines}) ->
    case starl_sim_machines:condition(Machines) of
        dead -> died;
        _ -> starl_sim_platform:result(Body)
    end.

%% @doc The piece of motion that it is in.
-spec piece(t()) -> starl_trajectory:piece().
piece(#robot{body = Body}) -> starl_sim_platform:piece(Body).

%% @doc What is known of it at a time.
-spec summary(starl_sim_queue:time(), t()) -> summary().
summary(Time, #robot{body = Body} = Robot) ->
    Chain = starl_sim_platform:chain(Body),
    At = starl_sim_platform:now(Body),
    #{
        at_us => At,
        chain => starl_sim_chain:value(Chain),
        checkpoints => starl_sim_ledger:checkpoints(starl_sim_chain:ledger(Chain)),
        events => starl_sim_chain:events(Chain),
        packets => starl_sim_platform:packets(Body),
        result => result(Robot),
        %% while another robot is held this one may be further on
        pose => starl_trajectory:pose(max(At, Time), starl_sim_platform:piece(Body)),
        crashes => Robot#robot.crashes
    }.

%% @doc Its events, as far as they were recorded.
-spec recorded(t()) -> [starl_sim_ledger:event()].
recorded(#robot{body = Body}) ->
    starl_sim_ledger:events(starl_sim_chain:ledger(starl_sim_platform:chain(Body))).

%% @doc Its machines, each with its state and data.
-spec machines(t()) -> #{starl_machine:name() => starl_sim_machines:seen()}.
machines(#robot{machines = Machines}) -> starl_sim_machines:inspect(Machines).

%% -- events ---------------------------------------------------------------------------------

%% Goes about what is left to do in this window. What changes at every event is passed along
%% beside the record, which would be copied each time.
proceed(#robot{events = Events, local = Local, body = Body, machines = Machines} = Robot) ->
    work(Local, Events, Body, Machines, Robot).

work(Local, Events, Body, Machines, #robot{stop = none} = Robot) ->
    next(Local, Events, Body, Machines, Robot);
work(Local, Events, Body, Machines, #robot{stop = N} = Robot) ->
    case count(Body) of
        N -> {held, put_back(Local, Events, Body, Machines, Robot)};
        _ -> next(Local, Events, Body, Machines, Robot)
    end.

next([{Name, boot, none} | Local], Events, Body, Machines, #robot{id = Id} = Robot) ->
    Hashed = starl_sim_platform:hash_event(Name, boot, none, Body),
    Incarnation = starl_sim_machines:incarnation(Name, Machines),
    Base = starl_sim_platform:boot(Id, Name, Incarnation, Hashed),
    Answer = starl_sim_machines:boot(Name, Base, Machines),
    answer(Answer, Name, boot, Local, Events, found(Base, Hashed), Machines, Robot);
next([{Name, Type, Content} | Local], Events, Body, Machines, Robot) ->
    Hashed = starl_sim_platform:hash_event(Name, Type, Content, Body),
    step(Name, Type, Content, Local, Events, Hashed, Machines, Robot);
next([], [{_, Time, ?CLASS_FAULT, _, _, Fault} | Events], Body, Machines, Robot) ->
    Moved = starl_sim_platform:at(Time, Body),
    proceed(strike(Fault, put_back([], Events, Moved, Machines, Robot)));
next([], [{_, Time, _, _, Seq, {timer, Name, Timer, Content}} | Events], Body, Machines, Robot) ->
    case starl_sim_platform:fire(Time, Name, Timer, Content, Seq, Body) of
        {ok, Type, Fired} -> step(Name, Type, Content, [], Events, Fired, Machines, Robot);
        stale -> work([], Events, Body, Machines, Robot)
    end;
next([], [{_, Time, _, _, _, {says, Run, Name, Content}} | Events], Body, Machines, Robot) ->
    case starl_sim_platform:says(Run, Body) of
        true ->
            Hashed = starl_sim_platform:hash_event(Time, Name, info, Content, Body),
            step(Name, info, Content, [], Events, Hashed, Machines, Robot);
        false ->
            work([], Events, Body, Machines, Robot)
    end;
next([], [{Id, Time, Class, Source, Seq, {late, Content}} | Events], Body, Machines, Robot) ->
    next([], [{Id, Time, Class, Source, Seq, Content} | Events], Body, Machines, Robot);
next([], [{_, Time, _, _, _, {Name, Type, Content}} | Events], Body, Machines, Robot) ->
    Hashed = starl_sim_platform:hash_event(Time, Name, Type, Content, Body),
    step(Name, Type, Content, [], Events, Hashed, Machines, Robot);
next([], [], Body, Machines, Robot) ->
    {idle, put_back([], [], Body, Machines, Robot)}.

%% Monitors are told by the platform of what a machine cannot know any more.
found(#{stored := damaged, name := Name}, Body) ->
    starl_sim_platform:trace(Name, store_damaged, Body);
found(_Base, Body) ->
    Body.

count(Body) -> starl_sim_chain:events(starl_sim_platform:chain(Body)).

put_back(Local, Events, Body, Machines, Robot) ->
    Robot#robot{local = Local, events = Events, body = Body, machines = Machines}.

step(Name, Type, Content, Local, Events, Body, Machines, #robot{id = Id} = Robot) ->
    Meta = #{now => starl_sim_platform:local_time(Body), robot => Id},
    Answer = starl_sim_machines:step(Name, Type, Content, Meta, Machines),
    answer(Answer, Name, Type, Local, Events, Body, Machines, Robot).

answer({done, Actions, Machines}, Name, _Type, Local, Events, Body, _Before, Robot) ->
    perform(Actions, Name, Local, Events, Body, Machines, Robot);
answer(busy, Name, _Type, Local, Events, Body, Machines, Robot) ->
    {busy, (put_back(Local, Events, Body, Machines, Robot))#robot{busy = Name}};
answer({crashed, Reason}, Name, _Type, Local, Events, Body, Machines, Robot) ->
    proceed(crashed(Name, Reason, put_back(Local, Events, Body, Machines, Robot)));
answer(absent, Name, Type, Local, Events, Body, Machines, Robot) ->
    Traced = starl_sim_platform:trace(Name, {unknown_machine, Name}, Body),
    work(Local ++ refusal(Name, Type), Events, Traced, Machines, Robot).

%% A call to a machine that the robot does not have must not wait for ever.
refusal(Name, {call, {From, Tag}}) -> [{From, {reply, Tag}, {no_such_machine, Name}}];
refusal(_Name, _Type) -> [].

perform([], _Name, Local, Events, Body, Machines, Robot) ->
    work(Local, Events, Body, Machines, Robot);
perform(Actions, Name, Local, Events, Body0, Machines, Robot) ->
    case starl_sim_platform:perform(Actions, Name, Body0) of
        {New, Body} -> performed(Local ++ New, Events, Body, Machines, Robot);
        {store_full, New, Body} -> fail_stop(Name, Local ++ New, Events, Body, Machines, Robot)
    end.

performed(Local, Events, Body, Machines, Robot) ->
    case starl_sim_platform:soon(Body) of
        [] ->
            work(Local, Events, Body, Machines, Robot);
        _ ->
            Planned = starl_sim_platform:planned(Body),
            work(Local, plan(Body, Events), Planned, Machines, Robot)
    end.

%% The machine could not make durable what the rest of its actions rests on.
fail_stop(Name, Local, Events, Body, Machines, Robot) ->
    {ok, _Killed} = starl_sim_machines:kill(Name, Machines),
    Planned = starl_sim_platform:planned(Body),
    Stopped = put_back(Local, plan(Body, Events), Planned, Machines, Robot),
    proceed(crashed(Name, store_full, Stopped)).

%% New events of this robot in this window take their places among the others.
plan(Body, Events) -> lists:merge(lists:sort(starl_sim_platform:soon(Body)), Events).

%% -- faults and crashes ---------------------------------------------------------------------

strike(wake, Robot) ->
    Robot;
strike(turn_wheels, #robot{body = Body} = Robot) ->
    settle(Robot#robot{body = starl_sim_platform:turn_wheels(Body)});
strike({go_on, _} = Beat, #robot{body = Body} = Robot) ->
    settle(Robot#robot{body = starl_sim_platform:beat(Beat, Body)});
strike({watch, _, _} = Beat, #robot{body = Body} = Robot) ->
    settle(Robot#robot{body = starl_sim_platform:beat(Beat, Body)});
strike({kill_machine, Name}, #robot{machines = Machines} = Robot) ->
    case starl_sim_machines:kill(Name, Machines) of
        {ok, Reason} -> crashed(Name, Reason, Robot);
        none -> Robot
    end;
strike({pause, Until}, #robot{hold = {Before, Lag}} = Robot) ->
    postpone(Robot#robot{hold = {max(Before, Until), Lag}});
strike({lag, Lag}, #robot{hold = {Until, _}} = Robot) ->
    postpone(Robot#robot{hold = {Until, Lag}});
strike(Fault, #robot{body = Body, machines = Machines} = Robot) ->
    struck(starl_sim_crash:strike(Fault, Body, Machines), Robot).

%% What the chassis has to say in this window takes its place; it may have to wait for the robot.
settle(#robot{body = Body, events = Events, hold = Hold} = Robot) ->
    case starl_sim_platform:soon(Body) of
        [] ->
            Robot;
        _ ->
            Planned = starl_sim_platform:planned(Body),
            Settled = Robot#robot{events = plan(Body, Events), body = Planned},
            case Hold of
                {0, 0} -> Settled;
                _ -> postpone(Settled)
            end
    end.

%% What comes too early for a robot that is held up waits: in this window or for a later one.
postpone(#robot{events = Events, hold = Hold, body = Body} = Robot) ->
    {Late, Ready} = starl_sim_hold:part(Events, Hold),
    Planned = starl_sim_platform:postpone(Late, Body),
    Robot#robot{events = plan(Planned, Ready), body = starl_sim_platform:planned(Planned)}.

crashed(Name, Reason, #robot{body = Body, machines = Machines, crashes = Crashes} = Robot) ->
    Remembered = lists:sublist([{Name, Reason} | Crashes], ?REMEMBERED),
    Struck = starl_sim_crash:crashed(Name, Reason, Body, Machines),
    ok = tell(Name, Reason, Struck, Robot),
    struck(Struck, Robot#robot{crashes = Remembered}).

%% The log has one line for each crash that nobody planned, in every mode.
tell(Name, Reason, {_, _, Left}, #robot{id = Id, machines = Machines}) ->
    Lost = starl_sim_machines:names(Machines) -- starl_sim_machines:names(Left),
    What =
        case lists:member(Name, Lost) of
            true -> given_up;
            false -> crashed
        end,
    case starl_crash:cause(Reason) of
        none when What =:= crashed -> ok;
        none -> told(What, Id, Name, "it was killed too often");
        Cause -> told(What, Id, Name, starl_crash:format(Cause))
    end.

told(What, Id, Name, Why) ->
    Text = unicode:characters_to_binary(Why),
    logger:error(
        #{what => What, robot => Id, machine => Name, reason => Text},
        #{domain => [starl, robot], robot => Id, machine => Name}
    ).

died(Reason, #robot{body = Body, machines = Machines} = Robot) ->
    struck(starl_sim_crash:die(Reason, Body, Machines), Robot).

struck({Aftermath, Body, Machines}, Robot) ->
    after_that(Aftermath, Robot#robot{body = Body, machines = Machines}).

after_that(go_on, Robot) ->
    Robot;
after_that({first, New}, #robot{local = Local} = Robot) ->
    %% who has yet to start need not be told
    Waiting = [Name || {Name, boot, none} <- Local],
    Heard = [L || {To, Type, _} = L <- New, Type =/= info orelse not lists:member(To, Waiting)],
    Robot#robot{local = Heard ++ Local};
after_that({anew, New}, Robot) ->
    Robot#robot{local = New};
after_that(faults_only, #robot{events = Events} = Robot) ->
    Robot#robot{local = [], events = faults_of(Events), busy = none};
after_that(nothing, Robot) ->
    Robot#robot{local = [], events = [], busy = none}.
