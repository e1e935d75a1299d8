%% @doc A robot in a shard: a {@link starl_robot}, its processes, and its open events of this
%% window. Its actions reach no other robot before the next window, so a shard has
%% many robots at work at once; each robot handles its events one by one, in the order of
%% their keys, each with all the local events that follow from it.
%% ```
%%           machine gone: the rest goes on, it is restarted, or given up
%%              +--+                 gave up, killed
%%              |  v          +------------------------> dead
%%               up ----------+                            ^
%%               ^ +-- go_down --> down --- killed --------+
%%               +---- come_up ------+
%% '''
-module(starl_sim_robot).
-include_lib("starl_platform/include/starl_robot_order.hrl").

-export([new/4, at/2, open/3, answered/3, down/4, yield/1]).
-export([halt_after/2, halted/1, resume/1, branch_after/3]).
-export([at_work/1, owns/2, result/1, piece/1, summary/2, recorded/1, machines/1, timers/2]).

-export_type([t/0, work/0]).

%% The number of a robot's crashes that are remembered.
-define(REMEMBERED, 10).

%% A machine at work, with its process and that of the robot's application. By the number of the robot's
%% events a machine that does not answer is told from a loop that calls it.
-type work() :: #{
    robot := starl:robot_id(),
    machine := starl_machine:name(),
    process := pid(),
    events := non_neg_integer(),
    application := pid() | none
}.

-record(robot, {
    id :: starl:robot_id(),
    %% its world is its body in the simulated world (starl_sim_platform)
    robot :: starl_robot:t(),
    tree :: starl_robot_tree:t(),
    %% events of this window, by key
    events = [] :: [starl_sim_queue:event()],
    %% after this number of events it halts until it is resumed, or turns off into a branch
    stop = none :: pos_integer() | {branch, Events :: non_neg_integer(), Later :: map()} | none,
    hold = {0, 0} :: starl_sim_queue:hold(),
    %% until when it stands still, if it does so in a step of a machine that a fault has named
    still = 0 :: starl_sim_queue:time(),
    crashes = [] :: [{starl_machine:name(), Reason :: term()}],
    despair = starl_sim_crash_loop:new() :: starl_sim_crash_loop:t()
}).

-opaque t() :: #robot{}.

%% @doc A robot whose machines all boot first.
-spec new(starl:robot_id(), starl_sim_platform:t(), starl_robot_machines:t(), Tree) -> t() when
    Tree :: starl_robot_tree:t().
new(Id, Body, Machines, Tree) ->
    Robot = starl_robot:new(Id, starl_sim_platform, Body, Machines),
    #robot{id = Id, robot = Robot, tree = Tree}.

%% @doc Opens a window with these events of the robot, sorted, and begins with the first.
-spec open([starl_sim_queue:event()], starl_sim_queue:window(), t()) -> {busy | idle | held, t()}.
open([{_, Time, _, _, _, _} | _] = Planned, Window, #robot{robot = Robot, hold = Hold} = Site) ->
    {Status, World} = starl_robot:status(Robot),
    Opened = starl_sim_platform:open(Time, Window, World),
    {Events, Body} = starl_sim_platform:come(Planned, starl_robot:timers(Robot), Opened),
    case Status of
        %% most robots are quiet then, and go straight to the first event
        quiet when Hold =:= {0, 0}, Site#robot.stop =:= none ->
            next(Events, Robot, Body, Site);
        busy when Hold =:= {0, 0}, Site#robot.stop =:= none ->
            went(starl_robot:run(starl_robot:world(Body, Robot)), Events, Site);
        off ->
            proceed(body(Body, Site#robot{events = faults_of(Events)}));
        _ ->
            proceed(postpone(body(Body, Site#robot{events = Events})))
    end.

%% Events for a robot that is down are lost.
faults_of(Events) -> [Event || {_, _, ?CLASS_WORLD, _, _, _} = Event <- Events].

%% @doc The robot at a later time, between two windows.
-spec at(starl_sim_queue:time(), t()) -> t().
at(Now, Site) -> body(starl_sim_platform:rest(Now, body(Site)), Site).

%% @doc A process has answered with its machine's actions; if it is the one at work, the robot goes on.
-spec answered(pid(), [starl_machine:action()], t()) -> {busy | idle | held, t()} | ignored.
answered(Pid, Actions, #robot{robot = Robot, events = Events} = Site) ->
    case starl_robot:answered(Pid, Actions, Robot) of
        ignored -> ignored;
        Turn -> went(Turn, Events, Site)
    end.

%% @doc One of its processes has ended. If that was the one at work, the robot can go on.
-spec down(pid(), Reason :: term(), go_on | rest, t()) -> {busy | idle | held, t()}.
down(Pid, Reason, Then, #robot{robot = Robot, tree = Tree} = Site) ->
    Crashed =
        case starl_robot_machines:name_of(Pid, starl_robot:machines(Robot)) of
            {ok, Name} -> crashed(Name, Reason, settle(Site));
            none -> computer(starl_sim_computer:give_up({Robot, Tree}), Site)
        end,
    case starl_robot:busy(Crashed#robot.robot) of
        none when Then =:= go_on -> proceed(Crashed);
        none -> {idle, Crashed};
        _ -> {busy, Crashed}
    end.

%% @doc Makes the robot halt just after its N-th event, in mid-window; `none': it does not halt.
-spec halt_after(N :: pos_integer() | none, t()) -> t().
halt_after(none, #robot{robot = Robot} = Site) ->
    Site#robot{stop = none, robot = starl_robot:pace(on, Robot)};
halt_after(N, #robot{robot = Robot} = Site) ->
    Site#robot{stop = N, robot = starl_robot:pace(single, Robot)}.

%% @doc The time at which it halted, if it has.
-spec halted(t()) -> {at, starl_sim_queue:time()} | no.
halted(#robot{stop = none}) ->
    no;
halted(#robot{stop = N} = Site) ->
    case count(Site) of
        N -> {at, starl_sim_platform:now(body(Site))};
        _ -> no
    end.

%% @doc Goes on with the window in which it was held.
-spec resume(t()) -> {busy | idle | held, t()}.
resume(Site) -> proceed(Site).

%% @doc Makes the robot turn off into a branch just after its N-th event ({@link starl_sim_branch}).
-spec branch_after(N :: non_neg_integer(), Later :: map(), t()) -> t().
branch_after(N, Later, #robot{robot = Robot} = Site) ->
    Site#robot{stop = {branch, N, Later}, robot = starl_robot:pace(single, Robot)}.

%% @doc The yield of the window.
-spec yield(t()) -> starl_sim_platform:yield().
yield(Site) -> starl_sim_platform:yield(body(Site)).

%% @doc The machine that is at work, if any.
-spec at_work(t()) -> [work()].
at_work(#robot{id = Id, robot = Robot} = Site) ->
    Machines = starl_robot:machines(Robot),
    [
        #{
            robot => Id,
            machine => Name,
            process => starl_robot_machines:process(Name, Machines),
            events => count(Site),
            application => starl_robot_machines:process(app, Machines)
        }
     || Name <- [starl_robot:busy(Robot)], Name =/= none
    ].

%% @doc Is this process one of its own?
-spec owns(pid(), t()) -> boolean().
owns(Pid, #robot{robot = Robot, tree = Tree}) ->
    starl_robot_tree:owns(Pid, starl_robot:machines(Robot), Tree).

%% @doc Its application's result.
-spec result(t()) -> starl_sim_summary:result().
result(#robot{robot = Robot}) -> starl_sim_summary:result(Robot).

%% @doc The piece of motion that it is in.
-spec piece(t()) -> starl_trajectory:piece().
piece(Site) -> starl_sim_platform:piece(body(Site)).

%% @doc A summary of the robot at a time.
-spec summary(starl_sim_queue:time(), t()) -> starl_sim_summary:t().
summary(Time, #robot{robot = Robot, crashes = Crashes}) ->
    starl_sim_summary:of_robot(Time, Crashes, Robot).

%% @doc Its recorded events.
-spec recorded(t()) -> [starl_sim_ledger:event()].
recorded(Site) ->
    starl_sim_ledger:events(starl_sim_chain:ledger(starl_sim_platform:chain(body(Site)))).

%% @doc Its machines, each with its state and data.
-spec machines(t()) -> #{starl_machine:name() => starl_robot_tree:seen()}.
machines(#robot{robot = Robot}) -> starl_robot_tree:inspect(starl_robot:machines(Robot)).

%% @doc The timers that run, by machine and name, with the times at which they are due; `Later' are the
%% robot's events of later windows.
-spec timers(Later :: [starl_sim_queue:event()], t()) -> [starl_sim_timers:timer()].
timers(Later, #robot{robot = Robot, events = Events} = Site) ->
    Planned = Later ++ Events ++ starl_sim_platform:pending(body(Site)),
    starl_sim_timers:due(Planned, starl_robot:timers(Robot)).

%% -- events ---------------------------------------------------------------------------------

%% Goes on with the rest of this window, unless the robot is to halt here.
proceed(#robot{robot = Robot, events = Events, stop = none} = Site) ->
    went(starl_robot:run(Robot), Events, Site);
proceed(#robot{robot = Robot, events = Events, stop = {branch, N, Later}} = Site) ->
    case count(Site) < N of
        true -> went(starl_robot:run(Robot), Events, Site);
        false -> proceed(halt_after(none, in_branch(Later, Site)))
    end;
proceed(#robot{robot = Robot, events = Events, stop = N} = Site) ->
    case count(Site) of
        N -> {held, Site};
        _ -> went(starl_robot:run(Robot), Events, Site)
    end.

in_branch(Later, Site) -> body(starl_sim_platform:turn_off(Later, body(Site)), Site).

%% The result of an event, with all that followed from it.
went({quiet, Robot}, Events, Site) ->
    Body = starl_robot:world(Robot),
    case starl_sim_platform:soon(Body) of
        [] when Events =:= [] -> {idle, Site#robot{robot = Robot, events = []}};
        [] -> next(Events, Robot, Body, Site);
        _ -> next(plan(Body, Events), Robot, starl_sim_platform:planned(Body), Site)
    end;
went({ask, Pid, Order, Robot}, Events, Site) ->
    Pid ! Order,
    {busy, Site#robot{robot = Robot, events = Events}};
went({crashed, Name, Reason, Robot}, Events, Site) ->
    Left = settle(Site#robot{robot = Robot, events = Events}),
    {ok, _Killed} = starl_robot_tree:kill(Name, starl_robot:machines(Robot)),
    proceed(crashed(Name, Reason, Left));
went({stands, Robot}, Events, #robot{still = Until, hold = {Before, Lag}} = Site) ->
    Stands = Site#robot{robot = Robot, events = Events, hold = {max(Before, Until), Lag}},
    %% its chassis goes on
    #robot{events = Left} = Held = postpone(settle(Stands)),
    next(Left, Robot, body(Held), Held);
went({paused, Robot}, Events, Site) ->
    proceed(settle(Site#robot{robot = Robot, events = Events})).

%% The body is passed beside the robot: it may be newer than the robot's own.
next([], Robot, Body, Site) ->
    {idle, Site#robot{robot = starl_robot:world(Body, Robot), events = []}};
next([{_, Time, ?CLASS_WORLD, _, _, Fault} | Events], Robot, Body, Site) ->
    Moved = starl_robot:world(starl_sim_platform:at(Time, Body), Robot),
    proceed(strike(Fault, Site#robot{robot = Moved, events = Events}));
next([{_, Time, _, _, Seq, {timer, Name, Timer, Content}} | Events], Robot, Body, Site) ->
    case starl_robot:expire(Name, Timer, Seq, Robot) of
        {ok, Type, Left} ->
            Noted = starl_sim_platform:happens(Time, Name, Type, Content, Body),
            went(starl_robot:fire(Name, Type, Content, Noted, Left, Robot), Events, Site);
        stale ->
            next(Events, Robot, Body, Site)
    end;
next([{_, Time, _, _, _, {says, Run, Name, Content}} | Events], Robot, Body, Site) ->
    case starl_sim_platform:says(Run, Body) of
        true -> handle(Time, Name, info, Content, Events, Robot, Body, Site);
        false -> next(Events, Robot, Body, Site)
    end;
next([{Id, Time, Class, Source, Seq, {late, Content}} | Events], Robot, Body, Site) ->
    next([{Id, Time, Class, Source, Seq, Content} | Events], Robot, Body, Site);
next([{_, Time, _, _, _, {Name, Type, Content}} | Events], Robot, Body, Site) ->
    handle(Time, Name, Type, Content, Events, Robot, Body, Site).

handle(Time, Name, Type, Content, Events, Robot, Body, Site) ->
    Noted = starl_sim_platform:happens(Time, Name, Type, Content, Body),
    went(starl_robot:event(Name, Type, Content, Noted, Robot), Events, Site).

count(#robot{robot = Robot}) ->
    starl_sim_chain:events(starl_sim_platform:chain(starl_robot:world(Robot))).

body(#robot{robot = Robot}) -> starl_robot:world(Robot).

body(Body, #robot{robot = Robot} = Site) -> Site#robot{robot = starl_robot:world(Body, Robot)}.

%% New events of this robot in this window are merged with the others.
plan(Body, Events) -> lists:merge(lists:sort(starl_sim_platform:soon(Body)), Events).

settle(#robot{events = Events} = Site) ->
    Body = body(Site),
    case starl_sim_platform:soon(Body) of
        [] -> Site;
        _ -> body(starl_sim_platform:planned(Body), Site#robot{events = plan(Body, Events)})
    end.

%% -- faults and crashes ---------------------------------------------------------------------

strike(wake, Site) ->
    Site;
strike(turn_wheels, Site) ->
    rides(turn_wheels, Site);
strike({go_on, _} = Beat, Site) ->
    rides(Beat, Site);
strike({watch, _, _} = Beat, Site) ->
    rides(Beat, Site);
strike({hears, _, _, _} = Beat, Site) ->
    rides(Beat, Site);
strike({touch, _, _} = Touch, Site) ->
    rides(Touch, Site);
strike({look, _} = Look, Site) ->
    rides(Look, Site);
strike({kill_machine, Name}, #robot{robot = Robot} = Site) ->
    case starl_robot_tree:kill(Name, starl_robot:machines(Robot)) of
        {ok, Reason} -> crashed(Name, Reason, Site);
        none -> Site
    end;
strike({pause, Until}, #robot{hold = {Before, Lag}} = Site) ->
    postpone(Site#robot{hold = {max(Before, Until), Lag}});
strike({stand_still, Name, After, Until}, #robot{robot = Robot} = Site) ->
    Site#robot{robot = starl_robot:stand_still(Name, After, Robot), still = Until};
strike(go_on, #robot{robot = Robot} = Site) ->
    Site#robot{robot = starl_robot:go_on(Robot)};
strike({lag, Lag}, #robot{hold = {Until, _}} = Site) ->
    postpone(Site#robot{hold = {Until, Lag}});
%% The whole robot starts anew, as one that has lived so often.
strike({outlived, N}, #robot{robot = Robot} = Site) ->
    case starl_robot:condition(Robot) of
        up -> lists:foldl(fun strike/2, Site, [go_down, {outdate, N}, come_up]);
        _ -> Site
    end;
strike(Fault, #robot{robot = Robot, tree = Tree} = Site) ->
    computer(starl_sim_computer:strike(Fault, {Robot, Tree}), Site).

%% Events that wait for a robot that is up are lost with it.
computer({Robot, Tree}, #robot{robot = Before, events = Events} = Site) ->
    Left =
        case {starl_robot:condition(Before), starl_robot:condition(Robot)} of
            {up, down} -> faults_of(Events);
            {Alive, dead} when Alive =/= dead -> [];
            _ -> Events
        end,
    Site#robot{robot = Robot, tree = Tree, events = Left}.

%% An answer of the chassis in this window joins the other events; it may have to wait for the robot.
rides(Step, Before) ->
    Site = settle(body(starl_sim_platform:ride(Step, body(Before)), Before)),
    case Site of
        #robot{hold = {0, 0}} -> Site;
        #robot{} -> postpone(Site)
    end.

%% An event that comes while the robot is held up waits, in this window or for a later one.
postpone(#robot{events = Events, hold = Hold} = Site) ->
    {Late, Ready} = starl_sim_queue:delayed(Events, Hold),
    settle(body(starl_sim_platform:postpone(Late, body(Site)), Site#robot{events = Ready})).

%% A machine has ended.
crashed(Name, Reason, #robot{robot = Robot, tree = Tree} = Site) ->
    #robot{crashes = Crashes, despair = Before} = Site,
    {Despair, Computer} = starl_sim_computer:crashed(Name, Reason, Before, {Robot, Tree}),
    Remembered = lists:sublist([{Name, Reason} | Crashes], ?REMEMBERED),
    computer(Computer, Site#robot{crashes = Remembered, despair = Despair}).
