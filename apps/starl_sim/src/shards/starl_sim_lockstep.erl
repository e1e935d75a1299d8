%% @doc Keeps a shard in step with the other shards, window by window. It decides which window is
%% next, how far the shard may be ahead of the monitors, and when the shard rests. All shards decide
%% by the same numbers, which they exchange at the end of each window ({@link starl_sim_mail}), so
%% there is no central coordinator.
%% ```
%%   resting --- run ---> a window --- mail from all ---> the next ... --- reason() ---> resting
%%                           | a robot halts in it: mail `held'
%%                           +-------------------------------- held ---> resting
%%                           <---- run: the window goes on ----------------+
%% '''
-module(starl_sim_lockstep).

-export([new/3, launch/4, solid/2, run/3, hear/2, planned/2]).

-export_type([t/0, reason/0, stop/0, message/0]).

-define(AHEAD, 16).

%% Why the shards rest: all applications have ended; the time is reached; nothing can happen any
%% more; they were told to halt; a robot has reached the event after which it is to halt.
-type reason() :: done | until | quiet | halted | held.

%% The robot that is to halt, and the number of the event after which it halts.
-type stop() :: {starl:robot_id(), N :: pos_integer()} | none.

%% A message to a resting shard: an order of the run, a peer's mail, news of processes, or the end
%% of an old timer.
-type message() ::
    {approve, N :: pos_integer()}
    | {reload, starl_run_reloads:t()}
    | halt
    | abandon
    | starl_sim_mail:mail()
    | {'DOWN', reference(), process, pid(), Reason :: term()}
    | {down, pid(), Reason :: term()}
    | starl_driver:attach()
    | {timeout, reference(), term()}
    | {who, pid(), reference()}.

%% A window that is not over: either a robot of this shard was held in it, with the data to finish
%% the window and the news of processes since then, latest first; or a robot of a peer was held, and
%% the peer's mail is still to come.
-type open() ::
    none
    | #{
        window := starl_sim_queue:window(),
        robot := starl:robot_id(),
        ids := [starl:robot_id()],
        at := starl_sim_queue:time(),
        mails := [starl_sim_mail:content() | abandoned],
        news := [message()]
    }
    | {peer, pid(), starl_sim_queue:time()}.

-record(steps, {
    run :: pid(),
    window_us :: pos_integer(),
    %% the wall time that a window may take
    patience_ms :: pos_integer(),
    queue :: starl_sim_queue:t(),
    mail :: starl_sim_mail:t(),
    sight = none :: starl_sim_sight:t() | none,
    %% the number of windows run, and of those approved
    windows = 0 :: non_neg_integer(),
    approved = 0 :: non_neg_integer(),
    now = 0 :: starl_sim_queue:time(),
    %% the same in all shards
    next = 0 :: starl_sim_queue:time() | infinity,
    running = 0 :: non_neg_integer(),
    %% was it told to halt while it rested?
    halt = false :: boolean(),
    %% the robot of this shard that is to halt; the window in which one was held
    stop = none :: starl:robot_id() | none,
    open = none :: open(),
    abandoned = false :: boolean(),
    %% the world, if bodies are solid; the robots with new pieces of motion, until all shards' are known
    solid = none :: starl_sim_world:t() | none,
    moved = [] :: [starl:robot_id()]
}).

-opaque t() :: #steps{}.

%% @doc A shard without robots or peers, which reports its windows to the process `Run' and gives up
%% when one takes longer than the patience, in wall time.
-spec new(Run :: pid(), WindowUs :: pos_integer(), PatienceMs :: pos_integer()) -> t().
new(Run, Width, Patience) ->
    #steps{
        run = Run,
        window_us = Width,
        patience_ms = Patience,
        queue = starl_sim_queue:new(Width),
        mail = starl_sim_mail:new([], #{})
    }.

%% @doc All robots are in place: the number of running applications of the whole team, and the
%% faults that strike this shard's robots.
-spec launch(
    Running :: non_neg_integer(),
    [starl_sim_queue:event()],
    {starl_sim_sight:t(), starl_sim_mail:t()},
    t()
) -> t().
launch(Running, Faults, {Sight, Mail}, #steps{queue = Queue} = Steps) ->
    Planned = starl_sim_queue:add_all(Faults, Queue),
    Steps#steps{queue = Planned, sight = Sight, mail = Mail, running = Running}.

%% @doc Bodies are solid, if the world has walls.
-spec solid(starl_sim_world:t(), t()) -> t().
solid(#{walls := _} = World, Steps) -> Steps#steps{solid = World};
solid(#{}, Steps) -> Steps.

%% @doc The events that are planned for a robot, in no order, while the shard rests.
-spec planned(starl:robot_id(), t()) -> [starl_sim_queue:event()].
planned(Robot, #steps{queue = Queue}) -> starl_sim_queue:of_robot(Robot, Queue).

%% @doc Runs until a time or, if that is earlier, until just after an event of one robot; meanwhile
%% it reports to the run as {@link starl_sim_shard:run/3} says.
-spec run(Until :: starl_sim_queue:time(), stop(), t()) -> t().
run(Until, Stop, #steps{now = Now, mail = Mail, patience_ms = Patience} = Steps) ->
    ok = starl_sim_window:be_patient({Now, Now}, Patience),
    Delivered = Steps#steps{mail = starl_sim_mail:deliver(Mail)},
    Rested = go_on(Until, resume(arm(Stop, Delivered))),
    ok = starl_sim_window:patient(),
    Rested.

%% @doc Handles a message while it rests. A process that went down between two windows was killed
%% from outside, or belongs to a robot that died. The robot is woken to go on in the next window.
-spec hear(message(), t()) -> t().
hear(News, #steps{open = #{news := Earlier} = Open} = Steps) when
    element(1, News) =:= 'DOWN'; element(1, News) =:= down; element(1, News) =:= starl_attach
->
    %% kept until the window goes on, which handles both in their order
    Steps#steps{open = Open#{news := [News | Earlier]}};
hear({'DOWN', _, process, Pid, Reason}, Steps) ->
    down(Pid, Reason, Steps);
hear({starl_attach, _, _, _} = Attach, Steps) ->
    %% a restarted process may attach before the end of its predecessor is known
    receive
        {'DOWN', _, process, Pid, Reason} ->
            self() ! Attach,
            down(Pid, Reason, Steps)
    end;
hear({down, Pid, Reason}, Steps) ->
    down(Pid, Reason, Steps);
hear({approve, N}, Steps) ->
    Steps#steps{approved = N};
hear({reload, Reload}, #steps{now = Now} = Steps) ->
    reload(Reload, Now, Steps);
hear({mail, _Peer, _N, _Content} = Early, #steps{mail = Mail} = Steps) ->
    Steps#steps{mail = starl_sim_mail:keep(Early, Mail)};
hear(halt, Steps) ->
    Steps#steps{halt = true};
hear(abandon, Steps) ->
    Steps#steps{abandoned = true};
hear({who, From, Ref}, Steps) ->
    ok = starl_sim_window:tell_at_work(From, Ref),
    Steps;
hear({timeout, _, _}, Steps) ->
    Steps.

%% -- window after window --------------------------------------------------------------------

%% Only one robot can be set to halt.
arm(Stop, #steps{stop = Old} = Steps) ->
    _ = Old =/= none andalso starl_sim_window:halt_after(Old, none),
    case Stop of
        {Id, N} -> arm(Id, N, starl_sim_mail:is_own(Id, Steps#steps.mail), Steps);
        none -> Steps#steps{stop = none}
    end.

arm(Id, N, true, Steps) ->
    ok = starl_sim_window:halt_after(Id, N),
    Steps#steps{stop = Id};
arm(_Id, _N, false, Steps) ->
    Steps#steps{stop = none}.

go_on(Until, #steps{open = none} = Steps) -> advance(Until, agree(Steps));
go_on(Until, Steps) -> advance(Until, Steps).

%% A robot may have been woken since all rested, so the shards agree on the next window again.
agree(#steps{windows = 0} = Steps) -> Steps;
agree(Steps) -> exchange(#{later => [], moved => [], ended => 0, trace => []}, Steps).

advance(_Until, #steps{abandoned = true} = Steps) ->
    rest(halted, Steps);
advance(_Until, #steps{open = #{at := At}} = Steps) ->
    rest(held, At, Steps);
advance(_Until, #steps{open = {peer, _, At}} = Steps) ->
    rest(held, At, Steps);
advance(Until, #steps{moved = [_ | _]} = Steps) ->
    advance(Until, meet(Steps));
advance(_Until, #steps{running = 0} = Steps) ->
    rest(done, Steps);
advance(_Until, #steps{next = infinity} = Steps) ->
    rest(quiet, Steps);
advance(Until, #steps{next = Next} = Steps) when Next >= Until ->
    rest(until, Steps#steps{now = max(Until, Steps#steps.now)});
advance(Until, #steps{windows = N, approved = Approved} = Steps) when N >= Approved + ?AHEAD ->
    await_approval(Until, Steps);
advance(Until, Steps) ->
    advance(Until, run_window(look_up(Steps))).

await_approval(_Until, #steps{halt = true} = Steps) ->
    rest_halted(Steps);
await_approval(Until, Steps) ->
    receive
        {approve, More} -> advance(Until, Steps#steps{approved = More});
        halt -> rest_halted(Steps);
        abandon -> rest(halted, Steps#steps{abandoned = true})
    end.

%% All shards plan all touches, and each keeps those of its robots.
meet(#steps{moved = Moved, now = Now, solid = World} = Steps) ->
    #steps{sight = Sight, mail = Mail, queue = Queue, next = Next} = Steps,
    Events = starl_sim_bodies:meetings(Moved, Now, Sight, World),
    Own = [Event || Event <- Events, starl_sim_mail:is_own(element(1, Event), Mail)],
    Steps#steps{
        moved = [],
        queue = starl_sim_queue:add_all(Own, Queue),
        next = lists:min([Next | [element(2, Event) || Event <- Events]])
    }.

rest(Reason, #steps{now = Now} = Steps) -> rest(Reason, Now, Steps).

%% The start of the first window that is not run: the same time whether or not the run paused on
%% the way there, in a stretch where nothing happens.
rest_halted(#steps{next = Next, window_us = Width} = Steps) ->
    rest(halted, Next - Next rem Width, Steps).

rest(Reason, Now, #steps{run = Run, running = Running} = Steps) ->
    Run ! {resting, self(), Now, Reason, Running},
    Steps.

%% Handles processes that went down while their robots had nothing to do.
look_up(Steps) ->
    receive
        {down, Pid, Reason} -> look_up(down(Pid, Reason, Steps));
        {reload, Reload} -> look_up(reload(Reload, after_next(Steps), Steps))
    after 0 -> Steps
    end.

%% The shards have agreed on the next window: nothing new comes into it.
after_next(#steps{next = Next, window_us = Width}) -> Next - Next rem Width + Width.

%% An order from outside is no strike of the schedule.
reload(#{robots := Robots} = Reload, At, #steps{queue = Queue, mail = Mail} = Steps) ->
    Events = [{Id, At, 0, 0, 0, {reload, Reload}} || Id <- Robots, starl_sim_mail:is_own(Id, Mail)],
    Steps#steps{queue = starl_sim_queue:add_all(Events, Queue)}.

down(Pid, Reason, #steps{now = Now} = Steps) ->
    case starl_sim_window:crashed(Pid, Reason, Now) of
        {ok, Id} -> wake(Id, Steps);
        none -> Steps
    end.

wake(Id, #steps{queue = Queue, now = Now} = Steps) ->
    Steps#steps{queue = starl_sim_queue:add({Id, Now, 0, 0, 0, wake}, Queue)}.

run_window(#steps{next = Next, window_us = Width, windows = N, queue = Queue} = Steps) ->
    From = Next - Next rem Width,
    To = From + Width,
    {Events, Rest} = starl_sim_queue:take_window(To, Queue),
    Steps1 = Steps#steps{queue = Rest, now = To, windows = N + 1},
    case starl_sim_window:run({From, To}, Events) of
        {hung, Hang} -> give_up(Hang, Steps1);
        Ids -> close({From, To}, Ids, none, Steps1)
    end.

%% A robot does not end its step: this shard's part of the run ends within the window.
give_up(Hang, #steps{run = Run, now = Now, window_us = Width} = Steps) ->
    Run ! {hung, Now - Width, Hang},
    Steps#steps{abandoned = true}.

%% Ends the window, unless a robot was held in it. `Mails' holds what the peers sent meanwhile.
close(Window, Ids, Mails, #steps{stop = Stop} = Steps) ->
    case Stop =/= none andalso starl_sim_robot:halted(starl_sim_window:robot(Stop)) of
        {at, At} -> hold(At, Window, Ids, Mails, Steps);
        _ -> finish(Ids, Mails, Steps)
    end.

%% The peers' mail waits until the window is over: this shard's robots must not see it earlier.
hold(At, Window, Ids, Mails0, #steps{mail = Mail, windows = N, stop = Id} = Steps) ->
    ok = starl_sim_mail:tell_held(N, At, Mail),
    Mails =
        case Mails0 of
            none -> [starl_sim_mail:await(Peer, N) || Peer <- starl_sim_mail:peers(Mail)];
            _ -> Mails0
        end,
    Steps#steps{
        open = #{
            window => Window, robot => Id, ids => Ids, at => At, mails => Mails, news => []
        }
    }.

finish(Ids, Mails, #steps{windows = N} = Steps) ->
    Yields = starl_sim_window:yields(Ids),
    Steps#steps.run ! {window_done, self(), N, maps:get(trace, Yields)},
    case Mails of
        none -> exchange(Yields, Steps);
        _ -> lists:foldl(fun take/2, tell(Yields, Steps), Mails)
    end.

%% Goes on with the window in which a robot was held, here or in another shard.
resume(#steps{open = #{window := Window, robot := Id, news := Waiting} = Open} = Steps) ->
    #{ids := Ids, mails := Mails} = Open,
    _ = [self() ! News || News <- lists:reverse(Waiting)],
    case starl_sim_window:resume(Window, Id) of
        ok -> close(Window, Ids, Mails, Steps#steps{open = none});
        {hung, Hang} -> give_up(Hang, Steps#steps{open = none})
    end;
resume(#steps{open = {peer, Peer, _}} = Steps) ->
    receive_mail(Peer, Steps#steps{open = none});
resume(#steps{open = none} = Steps) ->
    Steps.

%% Each shard tells every other one what it must know to run the next window.
exchange(Yields, #steps{mail = Mail} = Steps) ->
    lists:foldl(fun receive_mail/2, tell(Yields, Steps), starl_sim_mail:peers(Mail)).

tell(Yields, #steps{windows = N, queue = Queue, mail = Mail} = Steps) ->
    {News, Own} = starl_sim_mail:tell(N, Yields, Queue, Mail),
    take(News, Steps#steps{queue = Own, next = infinity}).

receive_mail(Peer, #steps{windows = N} = Steps) ->
    case starl_sim_mail:await(Peer, N) of
        {held, At} -> Steps#steps{open = {peer, Peer, At}};
        abandoned -> Steps#steps{abandoned = true};
        News -> take(News, Steps)
    end.

take({Next, Ended, Moved, Packets}, #steps{queue = Queue, sight = Sight} = Steps) ->
    ok = starl_sim_sight:moved(Moved, Sight),
    moved(Moved, Steps#steps{
        next = min(Next, Steps#steps.next),
        running = Steps#steps.running - Ended,
        queue = starl_sim_queue:add_all(Packets, Queue)
    }).

moved(_Moved, #steps{solid = none} = Steps) ->
    Steps;
moved(Moved, #steps{moved = Before} = Steps) ->
    Steps#steps{moved = [Id || {Id, _} <- Moved] ++ Before}.
