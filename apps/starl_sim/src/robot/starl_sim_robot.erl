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
%% Robots of another kind have a module with this behaviour in place of this one. Such a robot is a
%% record whose name is its module, so the robots of the simulator pay nothing for it. The module
%% also changes the plan of a simulation whose scenario names its kind (`program').
-module(starl_sim_robot).
-include_lib("starl_platform/include/starl_robot_order.hrl").

-export([new/4, at/2, open/3, answered/3, down/4, yield/1]).
-export([halt_after/2, halted/1, resume/1, branch_after/3]).
-export([at_work/1, owns/2, piece/1, summary/2, recorded/1, machines/1, timers/2]).

-export_type([t/0, kind/0, stop/0, work/0]).

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
    stop = none :: stop(),
    hold = {0, 0} :: starl_sim_queue:hold(),
    %% until when it stands still, if it does so in a step of a machine that a fault has named
    still = 0 :: starl_sim_queue:time(),
    crashes = [] :: [{starl_machine:name(), Reason :: term()}],
    despair = starl_sim_crash_loop:new() :: starl_sim_crash_loop:t()
}).

%% After this number of events a robot halts until it is resumed, or turns off into a branch.
-type stop() :: pos_integer() | {branch, Events :: non_neg_integer(), Later :: map()} | none.

-opaque t() :: #robot{} | kind().

%% A robot of another kind: a record whose name is its module.
-type kind() :: tuple().

%% The plan of a simulation with such robots, or why there is none.
-callback plan(starl_run_scenario:t(), starl_sim_plan:t()) ->
    {ok, starl_sim_plan:t()} | {error, unicode:chardata()}.
%% A robot at rest, whose first event is `wake'. The calling process is its shard.
-callback new(starl:robot_id(), starl:pose(), starl_robot_services:tree(), starl_sim_world:t()) ->
    kind().
%% As the functions of these names here. A robot is busy until its shard has got `{starl_done, Robot, Pid,
%% Answer}'.
-callback open([starl_sim_queue:event()], starl_sim_queue:window(), kind()) ->
    {busy | idle | held, kind()}.
-callback answered(pid(), Answer :: term(), kind()) -> {busy | idle | held, kind()} | ignored.
-callback stop_at(stop(), kind()) -> kind().
-callback halted(kind()) -> {at, starl_sim_queue:time()} | no.
-callback resume(kind()) -> {busy | idle | held, kind()}.
-callback at_work(kind()) -> [work()].
%% Its body in the simulated world, which has the yield of the window, its chain and its motion.
-callback body(kind()) -> starl_sim_platform:t().
-callback summary(starl_sim_queue:time(), kind()) -> starl_sim_summary:t().
-callback machines(kind()) -> #{starl_machine:name() => starl_robot_tree:seen()}.

%% The module of a robot of another kind.
-define(KIND(Robot), (element(1, Robot))).

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
    end;
open(Planned, Window, Other) ->
    ?KIND(Other):open(Planned, Window, Other).

%% Events for a robot that is down are lost.
faults_of(Events) -> [Event || {_, _, ?CLASS_WORLD, _, _, _} = Event <- Events].

%% @doc The robot at a later time, between two windows.
-spec at(starl_sim_queue:time(), t()) -> t().
at(Now, Site) -> body(starl_sim_platform:rest(Now, body(Site)), Site).

%% @doc A process has answered with its machine's actions; if it is the one at work, the robot goes on.
-spec answered(pid(), [starl_machine:action()] | (Answer :: term()), t()) ->
    {busy | idle | held, t()} | ignored.
answered(Pid, Actions, #robot{robot = Robot, events = Events} = Site) ->
    case starl_robot:answered(Pid, Actions, Robot) of
        ignored -> ignored;
        Turn -> went(Turn, Events, Site)
    end;
answered(Pid, Answer, Other) ->
    ?KIND(Other):answered(Pid, Answer, Other).

%% @doc One of its processes has ended. If that was the one at work, the robot can go on.
-spec down(pid(), Reason :: term(), go_on | rest, t()) -> {busy | idle | held, t()}.
down(Pid, Reason, Then, #robot{robot = Robot} = Site) ->
    Crashed =
        case starl_robot_machines:name_of(Pid, starl_robot:machines(Robot)) of
            {ok, Name} -> crashed(Name, Reason, settle(Site));
            none -> die(gave_up, Site)
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
    Site#robot{stop = N, robot = starl_robot:pace(single, Robot)};
halt_after(Stop, Other) ->
    ?KIND(Other):stop_at(Stop, Other).

%% @doc The time at which it halted, if it has.
-spec halted(t()) -> {at, starl_sim_queue:time()} | no.
halted(#robot{stop = none}) ->
    no;
halted(#robot{stop = N} = Site) ->
    case count(Site) of
        N -> {at, starl_sim_platform:now(body(Site))};
        _ -> no
    end;
halted(Other) ->
    ?KIND(Other):halted(Other).

%% @doc Goes on with the window in which it was held.
-spec resume(t()) -> {busy | idle | held, t()}.
resume(#robot{} = Site) -> proceed(Site);
resume(Other) -> ?KIND(Other):resume(Other).

%% @doc Makes the robot turn off into a branch just after its N-th event ({@link starl_sim_branch}).
-spec branch_after(N :: non_neg_integer(), Later :: map(), t()) -> t().
branch_after(N, Later, #robot{robot = Robot} = Site) ->
    Site#robot{stop = {branch, N, Later}, robot = starl_robot:pace(single, Robot)};
branch_after(N, Later, Other) ->
    ?KIND(Other):stop_at({branch, N, Later}, Other).

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
    ];
at_work(Other) ->
    ?KIND(Other):at_work(Other).

%% @doc Is this process one of its own, which may crash? Those of another kind end with the shard.
-spec owns(pid(), t()) -> boolean().
owns(Pid, #robot{robot = Robot, tree = Tree}) ->
    starl_robot_tree:owns(Pid, starl_robot:machines(Robot), Tree);
owns(_Pid, _Other) ->
    false.

%% @doc The piece of motion that it is in.
-spec piece(t()) -> starl_trajectory:piece().
piece(Site) -> starl_sim_platform:piece(body(Site)).

%% @doc A summary of the robot at a time.
-spec summary(starl_sim_queue:time(), t()) -> starl_sim_summary:t().
summary(Time, #robot{robot = Robot, crashes = Crashes}) ->
    starl_sim_summary:of_robot(Time, Crashes, Robot);
summary(Time, Other) ->
    ?KIND(Other):summary(Time, Other).

%% @doc Its recorded events.
-spec recorded(t()) -> [starl_sim_ledger:event()].
recorded(Site) ->
    starl_sim_ledger:events(starl_sim_chain:ledger(starl_sim_platform:chain(body(Site)))).

%% @doc Its machines, each with its state and data.
-spec machines(t()) -> #{starl_machine:name() => starl_robot_tree:seen()}.
machines(#robot{robot = Robot}) -> starl_robot_tree:inspect(starl_robot:machines(Robot));
machines(Other) -> ?KIND(Other):machines(Other).

%% @doc The timers that run, by machine and name, with the times at which they are due; `Later' are the
%% robot's events of later windows.
-spec timers(Later :: [starl_sim_queue:event()], t()) -> [starl_sim_timers:timer()].
timers(Later, #robot{robot = Robot, events = Events} = Site) ->
    Planned = Later ++ Events ++ starl_sim_platform:pending(body(Site)),
    starl_sim_timers:due(Planned, starl_robot:timers(Robot));
timers(_Later, _Other) ->
    [].

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

body(#robot{robot = Robot}) -> starl_robot:world(Robot);
body(Other) -> ?KIND(Other):body(Other).

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
strike(Fault, #robot{robot = Robot} = Site) ->
    strike(Fault, starl_robot:condition(Robot), Site).

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

%% -- its computer ---------------------------------------------------------------------------

%% A fault of the whole robot, if it can strike in this condition. Events that wait for a robot that is
%% up are lost with it.
strike(kill_robot, Condition, Site) when Condition =/= dead ->
    ok = report(killed, robot, "by a fault", Site),
    die(killed, Site);
strike(go_down, up, #robot{robot = Robot, tree = Tree, events = Events} = Site) ->
    Site#robot{
        robot = starl_robot:go_down(Robot),
        tree = starl_robot_tree:down(Tree),
        events = faults_of(Events)
    };
strike(come_up, down, #robot{robot = Robot, tree = Tree} = Site) ->
    Moment = starl_sim_platform:moment(body(Site)),
    Waiting = starl_robot_machines:up(Moment, starl_robot:machines(Robot)),
    {Launched, Machines} = starl_robot_tree:launch(Tree, Waiting),
    Site#robot{robot = starl_robot:come_up(Machines, Robot), tree = Launched};
%% Its machines get words on new code; a robot that is down starts with it.
strike({reload, _} = Order, _Condition, Site) ->
    heed(Order, Site);
strike({reload_failed, _, _} = Order, _Condition, Site) ->
    heed(Order, Site);
%% Its store is known to be old, since it has lived N times.
strike({outdate, N}, down, Site) ->
    strike_store(outdate, maps:map(fun(_, Start) -> max(N, Start) end, starts(Site)), Site);
strike(lose_store, down, Site) ->
    strike_store(lose_store, starts(Site), Site);
strike({Kind, _} = Strike, down, Site) when Kind =:= save_store; Kind =:= set_back_store ->
    strike_store(Strike, starts(Site), Site);
strike(_Fault, _Condition, Site) ->
    Site.

heed(Order, #robot{robot = Robot} = Site) ->
    {Words, Body} = starl_sim_platform:reload(Order, body(Site)),
    Machines = starl_robot:machines(Robot),
    Local = [{Name, code, Word} || {Name, Word} <- Words, starl_robot_machines:has(Name, Machines)],
    Site#robot{robot = starl_robot:then(Local, starl_robot:world(Body, Robot))}.

strike_store(Strike, Starts, #robot{robot = Robot} = Site) ->
    {Next, Body} = starl_sim_platform:strike_store(Strike, Starts, body(Site)),
    Counted = starl_robot_machines:starts(Next, starl_robot:machines(Robot)),
    Site#robot{robot = starl_robot:machines(Counted, starl_robot:world(Body, Robot))}.

starts(#robot{robot = Robot}) -> starl_robot_machines:starts(starl_robot:machines(Robot)).

%% The supervision of its processes has ended, or a fault has killed it.
die(Reason, #robot{robot = Robot, tree = Tree} = Site) ->
    Body = starl_sim_platform:planned(body(Site)),
    Site#robot{
        robot = starl_robot:die(Reason, starl_robot:world(Body, Robot)),
        tree = starl_robot_tree:down(Tree),
        events = []
    }.

%% A machine has ended. Virtual time waits until it has been restarted, or the robot has died of it.
crashed(Name, Reason, #robot{robot = Robot, tree = Tree, crashes = Crashes} = Site) ->
    Cause = starl_crash:cause(Reason),
    {Hope, Despair} = hope(Name, Cause, Reason, Site),
    Fallen = starl_sim_platform:fallen(Name, Cause, body(Site)),
    Bare = starl_robot:lost(Name, Reason, starl_robot:world(Fallen, Robot)),
    Noted = Site#robot{
        robot = Bare,
        despair = Despair,
        crashes = lists:sublist([{Name, Reason} | Crashes], ?REMEMBERED)
    },
    Restarted = starl_robot_tree:restart(Name, starl_robot:machines(Bare), Tree),
    case starl_robot_tree:give_up(Hope, Name, Restarted, Tree) of
        {ok, #{back := Back, given_up := GivenUp, lost := Lost}, Machines} ->
            ok = report_crash(lists:member(Name, GivenUp), Name, Cause, Site),
            Left = lists:foldr(fun({N, R}, B) -> starl_robot:lost(N, R, B) end, Bare, Lost),
            With = starl_robot:machines(Machines, Left),
            Noted#robot{robot = starl_robot:back(Back, GivenUp, With)};
        gave_up ->
            ok = report_crash(true, Name, Cause, Site),
            die(gave_up, Noted)
    end.

%% Is it worthwhile to restart this machine? Only an application may be hopeless.
hope(app, {_, _} = Cause, Reason, #robot{despair = Despair} = Site) ->
    Body = body(Site),
    Now = starl_sim_platform:now(Body),
    Crash = #{
        cause => Cause,
        endless => starl_crash:is_endless(Reason),
        steps => starl_crash:steps(Reason),
        at_us => Now,
        pose => starl_trajectory:pose(Now, starl_sim_platform:piece(Body)),
        stored => starl_sim_platform:stored(app, Body)
    },
    starl_sim_crash_loop:crashed(Crash, Despair);
hope(_Name, _Cause, _Reason, #robot{despair = Despair}) ->
    {goes_on, Despair}.

%% -- the log --------------------------------------------------------------------------------

%% The log has one line for each crash that no fault caused, in every mode.
report_crash(false, _Name, none, _Site) ->
    ok;
report_crash(true, Name, none, Site) ->
    report(given_up, Name, "it was killed too often", Site);
report_crash(IsGivenUp, Name, Cause, Site) ->
    ok = report(crashed, Name, starl_crash:format(Cause), Site),
    _ = IsGivenUp andalso report(given_up, Name, "it crashed again and again", Site),
    ok.

report(What, Name, Why, #robot{id = Id} = Site) ->
    Event = #{
        what => What,
        robot => Id,
        machine => Name,
        at_us => starl_sim_platform:now(body(Site)),
        reason => unicode:characters_to_binary(Why)
    },
    logger:log(level(What), Event, #{
        domain => [starl, robot], robot => Id, machine => Name, report_cb => fun line/1
    }).

level(killed) -> notice;
level(_) -> error.

line(#{what := What, robot := Robot, machine := Machine, at_us := AtUs, reason := Why}) ->
    Seconds = AtUs / 1.0e6,
    {"robot ~b, ~.6f s: ~ts: ~ts", [Robot, Seconds, what_happened(What, Machine), Why]}.

what_happened(killed, _Robot) ->
    "killed";
what_happened(crashed, Machine) ->
    io_lib:format("~tp crashed", [Machine]);
what_happened(given_up, Machine) ->
    io_lib:format("~tp is given up and not started again", [Machine]).
