%% @doc Handles the events of a live robot in turn: the queue of waiting events, and the steps that
%% follow from each. It is the state of the {@link starl_live_link}.
%%
%% <em>The machines</em> run to completion, as in the simulator: while a machine's process is at
%% work, all other events wait. <em>A sequential application</em> works beside the link, since it
%% may compute for seconds. Its own events wait for it, and the other machines go on.
-module(starl_live_turns).

-export([
    new/3, start/1, waits/2, answered/3, late/2, hear/2, sense_faults/2, down/3, watch/1
]).
-export([robot/1, machine/2, gauges/1, processes/1, at_work/1]).

-export_type([t/0, event/0]).

-define(MOST_WAITING, 10000).
%% A timer that is not handled so long after it was due breaks the assumption of contracts, which is 250 ms.
-define(LATE_US, 200000).

%% An event that waits for its turn.
-type event() ::
    {event, starl_robot:local()}
    | {timer, starl_machine:name(), starl_robot_timers:timer(), starl_robot_timers:mark(), term()}
    | {acts, pid(), [starl_machine:action()]}
    | {reload, starl_reload:order(), pid()}
    | {take_back, starl_reload:count(), starl:robot_id()}
    | {mark, pid(), term()}.

-record(turns, {
    robot :: starl_robot:t(),
    tree :: starl_robot_tree:t(),
    store :: starl_live_store:t(),
    senses :: starl_live_sense_fault:t(),
    waiting = queue:new() :: queue:queue(event()),
    %% processes that work beside the link, or have just answered, with the orders that wait for them
    beside = #{} :: #{pid() => {at_work | idle, [starl_driver:order()]}},
    watch = starl_live_watch:new() :: starl_live_watch:t(),
    %% the number of turns
    number = 0 :: non_neg_integer(),
    %% when timers were late last
    late_us = 0 :: integer()
}).

-opaque t() :: #turns{}.

%% @doc Those of a robot that has not run yet, whose processes are in this tree.
-spec new(starl_robot:t(), starl_robot_tree:t(), starl_live_store:t()) -> t().
new(Robot, Tree, Store) ->
    Senses = starl_live_sense_fault:new(starl_robot:id(Robot)),
    #turns{robot = Robot, tree = Tree, store = Store, senses = Senses}.

%% @doc The robot runs.
-spec start(t()) -> t().
start(#turns{robot = Robot} = Turns) -> went(starl_robot:run(Robot), Turns).

%% @doc The robot.
-spec robot(t()) -> starl_robot:t().
robot(#turns{robot = Robot}) -> Robot.

%% @doc The process of a machine, if it is one.
-spec machine(starl_machine:name() | none, t()) -> pid() | none.
machine(Name, Turns) -> starl_robot_machines:process(Name, machines(Turns)).

%% @doc The processes of the robot's machines.
-spec processes(t()) -> [pid()].
processes(Turns) -> maps:keys(starl_robot_machines:processes(machines(Turns))).

%% @doc Those of them that have an open order.
-spec at_work(t()) -> [pid()].
at_work(#turns{robot = Robot} = Turns) ->
    [Pid || Pid <- [machine(starl_robot:busy(Robot), Turns)], is_pid(Pid)] ++ at_work_beside(Turns).

at_work_beside(#turns{beside = Beside}) ->
    [Pid || {Pid, {at_work, _}} <- maps:to_list(Beside)].

%% @doc The queues, the longest step, and the numbers of starts.
-spec gauges(t()) -> [starl_live_counts:gauge()].
gauges(#turns{waiting = Waiting, beside = Beside, watch = Watch} = Turns) ->
    Starts = starl_robot_machines:starts(machines(Turns)),
    Orders = lists:sum([length(Orders) || {_, Orders} <- maps:values(Beside)]),
    [
        {queue_events, [], queue:len(Waiting)},
        {queue_application, [], Orders},
        {step_seconds, [], starl_live_watch:longest_s(Watch)}
        | [{starts, [{machine, Name}], N} || {Name, N} <- maps:to_list(Starts)]
    ].

%% @doc Looks for processes that do not answer. One at work for a whole period is killed: its supervisor
%% starts it anew.
-spec watch(t()) -> t().
watch(#turns{robot = Robot, number = N, watch = Before} = Turns) ->
    Busy = starl_robot:busy(Robot),
    Beside = [{Pid, name(Pid, Turns)} || Pid <- at_work_beside(Turns)],
    {Do, Watch} = starl_live_watch:look({N, Busy}, Beside, Before),
    _ = Do =:= kill andalso exit(machine(Busy, Turns), kill),
    Turns#turns{watch = Watch}.

name(Pid, Turns) ->
    {ok, Name} = starl_robot_machines:name_of(Pid, machines(Turns)),
    Name.

%% -- what comes -----------------------------------------------------------------------------

%% @doc A process has answered with its machine's actions.
-spec answered(pid(), [starl_machine:action()], t()) -> t().
answered(Pid, Actions, #turns{beside = Beside} = Turns) when is_map_key(Pid, Beside) ->
    waits({acts, Pid, Actions}, Turns);
answered(Pid, Actions, #turns{robot = Robot} = Turns) ->
    case starl_robot:answered(Pid, Actions, Robot) of
        ignored -> Turns;
        Turn -> went(Turn, Turns)
    end.

%% @doc A line was too late with what a machine has sent.
-spec late({starl_machine:name(), Mark :: term()}, t()) -> t().
late({Name, Mark}, #turns{robot = Robot} = Turns) ->
    go_on(Turns#turns{robot = starl_robot:first([{Name, info, {late, Mark}}], Robot)}).

%% @doc From now on the robot's senses have these faults, and no others.
-spec sense_faults(starl_live_sense_fault:faults(), t()) -> t().
sense_faults(Faults, #turns{senses = Senses} = Turns) ->
    Turns#turns{senses = starl_live_sense_fault:set(Faults, Senses)}.

%% @doc A message of the robot's lines, or another one.
-spec hear(Message :: term(), t()) -> t().
hear({starl_felt, From, {_, Kind, _} = Mark, Said}, #turns{senses = Senses} = Turns) ->
    {Felt, Next} = starl_live_sense_fault:felt(Kind, Said, Senses),
    line_says({starl_felt, From, Mark, Felt}, Turns#turns{senses = Next});
hear(Message, Turns) ->
    line_says(Message, Turns).

line_says(Message, #turns{robot = Robot} = Turns) ->
    case starl_live_body:hear(Message, starl_robot:world(Robot)) of
        unknown -> Turns;
        Events -> heard(Events, Turns)
    end.

%% Packets may be lost; other events are few.
heard([{sap, packet, _} | _] = Packets, #turns{waiting = Waiting} = Turns) ->
    case queue:len(Waiting) > ?MOST_WAITING of
        true -> Turns;
        false -> all_wait(Packets, Turns)
    end;
heard(Events, Turns) ->
    all_wait(Events, Turns).

all_wait(Events, Turns) ->
    lists:foldl(fun(Event, L) -> waits({event, Event}, L) end, Turns, Events).

%% @doc An event waits for its turn.
-spec waits(event(), t()) -> t().
waits(Event, #turns{waiting = Waiting} = Turns) ->
    work(Turns#turns{waiting = queue:in(Event, Waiting)}).

%% -- turns ----------------------------------------------------------------------------------

%% Handles the next event, if the robot is quiet.
work(#turns{robot = Robot, waiting = Waiting} = Turns) ->
    case starl_robot:busy(Robot) =:= none andalso queue:out(Waiting) of
        false -> Turns;
        {empty, _} -> Turns;
        {{value, Event}, Left} -> handle(Event, Turns#turns{waiting = Left})
    end.

handle({event, {Name, Type, Content}}, Turns) ->
    {Body, #turns{robot = Robot} = Now} = at_event(Turns),
    Noted = starl_live_body:handles(Name, Type, Content, Body),
    went(starl_robot:event(Name, Type, Content, Noted, Robot), Now);
handle({reload, Order, Reporter}, Turns) ->
    {Body, Now} = at_event(Turns),
    {Words, Next} = starl_live_body:reload(Order, Reporter, Body),
    heeded(Words, Next, Now);
handle({take_back, N, Failed}, Turns) ->
    {Body, Now} = at_event(Turns),
    {Words, Next} = starl_live_body:take_back(N, Failed, Body),
    heeded(Words, Next, Now);
handle({timer, Name, Timer, Mark, Content}, #turns{robot = Robot} = Turns) ->
    case starl_robot:expire(Name, Timer, Mark, Robot) of
        {ok, Type, Left} ->
            {Body, Now} = at_event(Turns),
            Noted = starl_live_body:handles(Name, Type, Content, Body),
            went(starl_robot:fire(Name, Type, Content, Noted, Left, Now#turns.robot), Now);
        stale ->
            work(Turns)
    end;
handle({mark, From, Mark}, #turns{robot = Robot} = Turns) ->
    From ! {starl_marked, starl_robot:id(Robot), self(), Mark},
    work(Turns);
handle({acts, Pid, Actions}, Turns) ->
    acted(Pid, Actions, Turns).

acted(Pid, Actions, #turns{beside = Beside} = Turns) ->
    case {Beside, starl_robot_machines:name_of(Pid, machines(Turns))} of
        {#{Pid := {_, Orders}}, {ok, Name}} ->
            {Body, #turns{robot = Robot} = Now} = at_event(Turns),
            Idle = Now#turns{beside = Beside#{Pid := {idle, Orders}}},
            Valid = starl_robot_actions:without_calls(starl_driver:restarted(Orders), Actions),
            Answered = Idle#turns{watch = starl_live_watch:answered(Pid, Idle#turns.watch)},
            went(starl_robot:act(Name, Valid, Body, Robot), Answered);
        _ ->
            work(Turns)
    end.

%% The robot's machines get words on new code.
heeded(Words, Body, #turns{robot = Robot} = Turns) ->
    Machines = starl_robot:machines(Robot),
    {There, Gone} = lists:partition(
        fun({Name, _}) -> starl_robot_machines:has(Name, Machines) end, Words
    ),
    Told = lists:foldl(fun({Name, Word}, B) -> starl_live_body:gone(Name, Word, B) end, Body, Gone),
    Local = [{Name, code, Word} || {Name, Word} <- There],
    went(starl_robot:run(starl_robot:then(Local, starl_robot:world(Told, Robot))), Turns).

%% A timer that should have been handled long ago tells of the computer. One fact tells of all that were due in
%% that time.
at_event(#turns{robot = Robot, number = N, late_us = Before} = Turns) ->
    Marks = starl_robot_timers:marks(starl_robot:timers(Robot)),
    Present = starl_live_body:at(starl_robot:world(Robot)),
    {Due, Body} = starl_live_body:due_us(Marks, Present),
    computer_late(max(Due, Before), Body, Turns#turns{number = N + 1}).

computer_late(Since, Body, Turns) ->
    case starl_live_body:now_us(Body) of
        Now when Now - Since > ?LATE_US ->
            ok = warn_late(),
            {starl_live_body:trace(robot, {late, Since, Now}, Body), Turns#turns{late_us = Now}};
        _Now ->
            {Body, Turns}
    end.

warn_late() ->
    Why = io_lib:format("its computer was late by more than ~b ms", [?LATE_US div 1000]),
    starl_live_log:of_machine(warning, late, robot, Why).

%% The result of an event, with all that followed from it.
went({quiet, Robot}, Turns) ->
    next(flushed(Robot, Turns));
went({ask, Pid, Order, Robot}, #turns{beside = Beside} = Turns) ->
    case {starl_robot:busy(Robot), Beside} of
        {_, #{Pid := {How, Orders}}} ->
            Kept = Turns#turns{beside = Beside#{Pid := {How, Orders ++ [Order]}}},
            went(starl_robot:leave(Robot), Kept);
        {app, _} ->
            %% what is known of a grant leaves before the application can act on it
            Flushed = flushed(Robot, Turns),
            Pid ! Order,
            Left = Flushed#turns{beside = Beside#{Pid => {at_work, []}}},
            went(starl_robot:leave(Left#turns.robot), Left);
        _ ->
            ask(Pid, Order, starl_live_body:flush(starl_robot:world(Robot)), Robot, Turns)
    end;
went({crashed, Name, Reason, Robot}, Turns) ->
    Flushed = flushed(Robot, Turns),
    {ok, _Killed} = starl_robot_tree:kill(Name, machines(Flushed)),
    case crashed(Name, Reason, Flushed) of
        {ok, Next} -> go_on(Next);
        {gave_up, _} -> exit({shutdown, gave_up})
    end.

%% The machine of this order, too: what it was late with before comes first.
ask(Pid, Order, {[], Body}, Robot, Turns) ->
    Pid ! Order,
    Turns#turns{robot = starl_robot:world(Body, Robot)};
ask(_Pid, Order, {[_ | _] = Late, Body}, Robot, Turns) ->
    Waits = starl_robot:put_off(Order, starl_robot:world(Body, Robot)),
    went(starl_robot:run(starl_robot:first(Late, Waits)), Turns).

%% A machine learns that something of its step was late before it handles anything else.
flushed(Robot, Turns) ->
    {Late, Body} = starl_live_body:flush(starl_robot:world(Robot)),
    Turns#turns{robot = starl_robot:first(Late, starl_robot:world(Body, Robot))}.

next(#turns{robot = Robot} = Turns) ->
    case starl_robot:status(Robot) of
        {busy, _} -> went(starl_robot:run(Robot), Turns);
        {_, _} -> work(order_next(Turns))
    end.

%% Processes that have answered get their next order.
order_next(#turns{beside = Beside} = Turns) when map_size(Beside) =:= 0 -> Turns;
order_next(#turns{beside = Beside} = Turns) ->
    Body = starl_live_body:at(starl_robot:world(Turns#turns.robot)),
    Now = starl_live_body:now_us(Body),
    Next = maps:filtermap(fun(Pid, Work) -> ordered(Pid, Work, Now) end, Beside),
    Turns#turns{beside = Next, robot = starl_robot:world(Body, Turns#turns.robot)}.

ordered(_Pid, {at_work, _}, _Now) ->
    true;
ordered(_Pid, {idle, []}, _Now) ->
    false;
ordered(Pid, {idle, [Order | Orders]}, Now) ->
    Pid ! starl_driver:later(Now, Order),
    {true, {at_work, Orders}}.

go_on(#turns{robot = Robot} = Turns) ->
    case starl_robot:busy(Robot) of
        none -> went(starl_robot:run(Robot), Turns);
        _ -> flushed(Robot, Turns)
    end.

%% -- crashes --------------------------------------------------------------------------------

%% @doc A process has ended. `gave_up': the robot ends with it.
-spec down(pid(), Reason :: term(), t()) -> {ok | gave_up, t()}.
down(Pid, Reason, Turns) ->
    case starl_robot_machines:name_of(Pid, machines(Turns)) of
        {ok, Name} ->
            case crashed(Name, Reason, Turns) of
                {ok, Next} -> {ok, go_on(Next)};
                {gave_up, Last} -> {gave_up, Last}
            end;
        none ->
            case starl_robot_tree:supervisor(Turns#turns.tree) of
                Pid -> {gave_up, Turns};
                _ -> {ok, Turns}
            end
    end.

%% The link waits until the machine has been restarted, or given up. Whoever told the robot of new code
%% learns that it has failed also from a link that ends with it.
crashed(Name, Reason, #turns{robot = Robot0, tree = Tree, beside = Beside} = Turns) ->
    #turns{store = Store} = Turns,
    Gone = starl_robot_machines:process(Name, starl_robot:machines(Robot0)),
    Cause = starl_crash:cause(Reason),
    Body = starl_live_body:fallen(
        Name, Cause, starl_live_body:at(starl_robot:world(Robot0))
    ),
    Bare = starl_robot:lost(Name, Reason, starl_robot:world(Body, Robot0)),
    tell(Name, Reason),
    case starl_robot_tree:restart(Name, starl_robot:machines(Bare), Tree) of
        {ok, #{back := Back, given_up := GivenUp, lost := Lost}, Machines} ->
            case starl_live_store:started(starl_robot_machines:starts(Machines), Store) of
                ok ->
                    Left = lists:foldr(fun({N, R}, B) -> starl_robot:lost(N, R, B) end, Bare, Lost),
                    With = starl_robot:machines(Machines, Left),
                    Robot = starl_robot:back(Back, GivenUp, With),
                    {ok, Turns#turns{robot = Robot, beside = maps:remove(Gone, Beside)}};
                {error, _} ->
                    {gave_up, flushed(Bare, Turns)}
            end;
        gave_up ->
            {gave_up, flushed(Bare, Turns)}
    end.

tell(Name, Reason) ->
    case starl_crash:cause(Reason) of
        none -> ok;
        Cause -> starl_live_log:of_machine(error, crashed, Name, starl_crash:format(Cause))
    end.

machines(#turns{robot = Robot}) -> starl_robot:machines(Robot).
