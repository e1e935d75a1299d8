%% @doc A shard: some of the robots of a simulation. The shards of a simulation run it window by
%% window among themselves, in step:
%% ```
%%   run                     shard                            every other shard
%%     | run, Until ----------->|                                   |
%%     |                        | runs window N                     |
%%     |<--- window_done, N ----|---- mail, N: packets, motion ---->|
%%     |                        |<--- mail, N ----------------------|
%%     |---- approve, N ------->| window N + 1: the first that has an event anywhere
%%     |                        | ...
%%     |<--- resting, why ------|
%% '''
%% A window is as long as the shortest delay of a packet, so what is sent in one arrives in a
%% later one. All shards decide by the same numbers which window is next and when to rest. They
%% run at most `AHEAD' windows ahead of what the monitors have judged, and rest there if they are
%% told to halt, so where a run ends depends on nothing but the scenario.
%%
%% A robot may be told to halt just after its N-th event. When it does, the other robots finish
%% the window; the mail of its shard says `held', and all shards rest until it is resumed.
%%
%% Shards may be on different nodes. One that waits for what will never come, since a node is lost,
%% is told to abandon the run, and rests for good.
%%
%% Each shard keeps its own copy of where all robots were when the window began.
-module(starl_sim_shard).
-behaviour(gen_server).

-export([start_link/1, launch/2, run/3, approve/2, halt/1, abandon/1, inspect/3]).
-export([init/1, handle_call/3, handle_cast/2, handle_info/2]).

-export_type([load/0, crew/0, reason/0, stop/0, question/0, answer/0]).

-define(AHEAD, 16).
%% The shard's heap turns over fast, and what lives in it is copied each time: room for so many
%% words per robot, within these bounds.
-define(WORDS_PER_ROBOT, 2000).
-define(LEAST_WORDS, 100000).
-define(MOST_WORDS, 1000000).

%% What all robots are made of: the tree of a robot's processes, if it has any, but for its
%% number and its driver; and the machines that get no process.
-type crew() :: #{tree := map() | none, inline := starl_sim_machines:inline()}.

%% What a shard begins with. `peers' are the other shards, `owners' says which shard has a robot.
-type load() :: #{
    robots := [{starl:robot_id(), starl:pose()}],
    crew := crew(),
    faults := [starl_sim_queue:event()],
    peers := [pid()],
    owners := #{starl:robot_id() => pid()},
    sight := [{starl:robot_id(), starl_trajectory:piece()}],
    running := non_neg_integer()
}.

%% Why the shards rest: all applications have ended, the time is reached, nothing can happen any
%% more, they were told to halt, or a robot has come to the event that it is to halt after.
-type reason() :: done | until | quiet | halted | held.

%% The robot that is to halt, and after how many events.
-type stop() :: {starl:robot_id(), N :: pos_integer()} | none.

%% What can be asked about robots: a summary of all at a time; one's machines, how many events it
%% has had, or its recorded events.
-type question() ::
    {summary, starl_sim_queue:time()} | {robot | count | events, starl:robot_id()}.

-type answer() ::
    [{starl:robot_id(), starl_sim_robot:summary()}]
    | #{starl_machine:name() => starl_sim_machines:seen()}
    | [starl_sim_ledger:event()]
    | non_neg_integer()
    | unknown.

%% A window that is not over: a robot of this shard was held in it, this much is to be done then,
%% and this news has come of processes meanwhile, the latest first; or it is a peer's, and its
%% mail is yet to come.
-type open() ::
    none
    | #{
        window := starl_sim_robot:window(),
        robot := starl:robot_id(),
        ids := [starl:robot_id()],
        at := starl_sim_queue:time(),
        mails := [term()],
        news := [term()]
    }
    | {peer, pid(), starl_sim_queue:time()}.

-record(shard, {
    run :: pid(),
    world :: starl_sim_platform:world(),
    robots_sup :: pid(),
    peers = [] :: [pid()],
    owners = #{} :: #{starl:robot_id() => pid()},
    queue :: starl_sim_queue:t(),
    window_us :: pos_integer(),
    %% how many windows were run, and how many of them are approved
    windows = 0 :: non_neg_integer(),
    approved = 0 :: non_neg_integer(),
    now = 0 :: starl_sim_queue:time(),
    %% the same in all shards
    next = 0 :: starl_sim_queue:time() | infinity,
    running = 0 :: non_neg_integer(),
    %% told to halt while it rested
    halt = false :: boolean(),
    %% the robot of this shard that is to halt; the window in which one was held
    stop = none :: starl:robot_id() | none,
    open = none :: open(),
    abandoned = false :: boolean(),
    %% mail of peers that were told to run before this shard was
    early = [] :: [tuple()]
}).

%% @doc Starts an empty shard for about so many robots.
-spec start_link(#{
    run := pid(),
    world := starl_sim_platform:world(),
    window_us := pos_integer(),
    robots_sup := pid(),
    robots := pos_integer()
}) -> gen_server:start_ret().
start_link(#{robots := Robots} = Config) ->
    Words = max(?LEAST_WORDS, min(?MOST_WORDS, Robots * ?WORDS_PER_ROBOT)),
    Heap = [{min_heap_size, Words}, {fullsweep_after, 100}],
    gen_server:start_link(?MODULE, Config, [{spawn_opt, Heap}]).

%% @doc Starts robots on the shard and plants faults; returns when all their processes run.
-spec launch(pid(), load()) -> ok.
launch(Shard, Load) -> gen_server:call(Shard, {launch, Load}, infinity).

%% @doc Runs until a time or, if that is earlier, until just after an event of one robot; must be
%% asked of all shards. Each tells of its windows with `{window_done, Shard, N, Trace}' and at last
%% `{resting, Shard, Now, reason(), Running}'.
-spec run(pid(), Until :: starl_sim_queue:time(), stop()) -> ok.
run(Shard, Until, Stop) -> gen_server:cast(Shard, {run, Until, Stop}).

%% @doc The monitors have judged the first N windows.
-spec approve(pid(), N :: pos_integer()) -> ok.
approve(Shard, N) ->
    Shard ! {approve, N},
    ok.

%% @doc Has the shards rest as far ahead of the last approval as they may go.
-spec halt(pid()) -> ok.
halt(Shard) ->
    Shard ! halt,
    ok.

%% @doc The run cannot go on: the shard rests, wherever it waits.
-spec abandon(pid()) -> ok.
abandon(Shard) ->
    Shard ! abandon,
    ok.

%% @doc Looks at the robots. For a shard that rests.
-spec inspect(pid(), question(), Ms :: timeout()) -> answer().
inspect(Shard, What, Ms) -> gen_server:call(Shard, {inspect, What}, Ms).

-spec init(map()) -> {ok, #shard{}}.
init(#{run := Run, world := World, window_us := Width, robots_sup := RobotsSup}) ->
    {ok, #shard{
        run = Run,
        world = World,
        robots_sup = RobotsSup,
        queue = starl_sim_queue:new(Width),
        window_us = Width
    }}.

-spec handle_call(term(), gen_server:from(), #shard{}) -> {reply, term(), #shard{}}.
handle_call({launch, Load}, _From, #shard{world = #{range_mm := Range} = World0} = Shard) ->
    #{robots := Robots, crew := Crew, faults := Faults, peers := Peers, owners := Owners} = Load,
    World = World0#{sight => starl_sim_sight:new(maps:get(sight, Load), Range)},
    ok = starl_sim_window:hold([start_robot(Robot, Crew, World, Shard) || Robot <- Robots]),
    Launched = Shard#shard{
        world = World,
        queue = starl_sim_queue:add_all(Faults, Shard#shard.queue),
        peers = Peers,
        owners = Owners,
        running = maps:get(running, Load)
    },
    {reply, ok, Launched};
handle_call({inspect, {summary, Time}}, _From, Shard) ->
    Robots = starl_sim_window:robots(),
    {reply, [{Id, starl_sim_robot:summary(Time, Robot)} || {Id, Robot} <- Robots], Shard};
handle_call({inspect, {What, Id}}, _From, Shard) ->
    case starl_sim_window:robot(Id) of
        undefined -> {reply, unknown, Shard};
        Robot -> {reply, seen(What, Robot), Shard}
    end.

seen(robot, Robot) -> starl_sim_robot:machines(Robot);
seen(count, Robot) -> maps:get(events, starl_sim_robot:summary(0, Robot));
seen(events, Robot) -> starl_sim_robot:recorded(Robot).

-spec handle_cast({run, starl_sim_queue:time(), stop()}, #shard{}) -> {noreply, #shard{}}.
handle_cast({run, Until, Stop}, #shard{now = Now, early = Early} = Shard) ->
    Timer = starl_sim_window:be_patient({Now, Now}),
    _ = [self() ! Mail || Mail <- Early],
    Rested = go_on(Until, resume(arm(Stop, Shard#shard{early = []}))),
    _ = erlang:cancel_timer(Timer),
    {noreply, Rested}.

%% A process that went down between two windows: killed from outside, or one of a robot that
%% died. The robot is woken to go on in the next window.
-spec handle_info(term(), #shard{}) -> {noreply, #shard{}}.
handle_info(News, #shard{open = #{news := Earlier} = Open} = Shard) when
    element(1, News) =:= 'DOWN'; element(1, News) =:= down; element(1, News) =:= starl_attach
->
    %% left for the moment when the window goes on, which sees to both in their order
    {noreply, Shard#shard{open = Open#{news := [News | Earlier]}}};
handle_info({'DOWN', _, process, Pid, Reason}, Shard) ->
    {noreply, down(Pid, Reason, Shard)};
handle_info({starl_attach, _, _, _} = Attach, Shard) ->
    %% a process that was restarted may say so before the end of the one before it is heard of
    receive
        {'DOWN', _, process, Pid, Reason} ->
            self() ! Attach,
            {noreply, down(Pid, Reason, Shard)}
    end;
handle_info({down, Pid, Reason}, Shard) ->
    {noreply, down(Pid, Reason, Shard)};
handle_info({approve, N}, Shard) ->
    {noreply, Shard#shard{approved = N}};
handle_info({mail, _Peer, _N, _Mail} = Mail, #shard{early = Early} = Shard) ->
    %% one at most of each peer, which waits for this shard's
    {noreply, Shard#shard{early = [Mail | Early]}};
handle_info(halt, Shard) ->
    {noreply, Shard#shard{halt = true}};
handle_info(abandon, Shard) ->
    {noreply, Shard#shard{abandoned = true}};
handle_info({out_of_patience, _}, Shard) ->
    {noreply, Shard}.

%% -- starting -------------------------------------------------------------------------------

start_robot({Id, Pose}, #{tree := Tree, inline := Inline}, World, Shard) ->
    Machines = starl_sim_machines:new(Id, starter(Id, Tree, Shard), Inline),
    {Id, starl_sim_robot:new(Id, starl_sim_platform:new(Id, Pose, World), Machines)}.

%% start_child returns when the whole tree has started, so all attachments are here then.
starter(_Id, none, _Shard) ->
    none;
starter(Id, Tree, #shard{robots_sup = Sup}) ->
    Spec = Tree#{id => Id, driver => self()},
    fun() ->
        {ok, Pid} = supervisor:start_child(Sup, [Spec]),
        _ = erlang:monitor(process, Pid),
        Pid
    end.

%% -- window after window --------------------------------------------------------------------

%% Only one robot is to halt at a time.
arm(Stop, #shard{stop = Old} = Shard) ->
    _ = Old =/= none andalso starl_sim_window:halt_after(Old, none),
    case Stop of
        {Id, N} when map_get(Id, Shard#shard.owners) =:= self() ->
            ok = starl_sim_window:halt_after(Id, N),
            Shard#shard{stop = Id};
        _ ->
            Shard#shard{stop = none}
    end.

go_on(Until, #shard{open = none} = Shard) -> advance(Until, agree(Shard));
go_on(Until, Shard) -> advance(Until, Shard).

%% A robot may have been woken since all rested, so the next window is found again.
agree(#shard{windows = 0} = Shard) -> Shard;
agree(Shard) -> exchange(#{later => [], moved => [], ended => 0, trace => []}, Shard).

advance(_Until, #shard{abandoned = true} = Shard) ->
    rest(halted, Shard);
advance(_Until, #shard{open = #{at := At}} = Shard) ->
    rest(held, At, Shard);
advance(_Until, #shard{open = {peer, _, At}} = Shard) ->
    rest(held, At, Shard);
advance(_Until, #shard{running = 0} = Shard) ->
    rest(done, Shard);
advance(_Until, #shard{next = infinity} = Shard) ->
    rest(quiet, Shard);
advance(Until, #shard{next = Next} = Shard) when Next >= Until ->
    rest(until, Shard#shard{now = max(Until, Shard#shard.now)});
advance(_Until, #shard{windows = N, approved = Approved, halt = true} = Shard) when
    N >= Approved + ?AHEAD
->
    rest_halted(Shard);
advance(Until, #shard{windows = N, approved = Approved} = Shard) when N >= Approved + ?AHEAD ->
    receive
        {approve, More} -> advance(Until, Shard#shard{approved = More});
        halt -> rest_halted(Shard);
        abandon -> rest(halted, Shard#shard{abandoned = true})
    end;
advance(Until, Shard) ->
    advance(Until, run_window(look_up(Shard))).

rest(Reason, #shard{now = Now} = Shard) -> rest(Reason, Now, Shard).

%% The first window that is not run any more: the same time whether or not the run paused on the
%% way there, where nothing happens.
rest_halted(#shard{next = Next, window_us = Width} = Shard) ->
    rest(halted, Next - Next rem Width, Shard).

rest(Reason, Now, #shard{run = Run, running = Running} = Shard) ->
    Run ! {resting, self(), Now, Reason, Running},
    Shard.

%% Processes that went down while their robots had nothing to do.
look_up(Shard) ->
    receive
        {down, Pid, Reason} -> look_up(down(Pid, Reason, Shard))
    after 0 -> Shard
    end.

down(Pid, Reason, #shard{now = Now} = Shard) ->
    case starl_sim_window:crashed(Pid, Reason, Now) of
        {ok, Id} -> wake(Id, Shard);
        none -> Shard
    end.

wake(Id, #shard{queue = Queue, now = Now} = Shard) ->
    Shard#shard{queue = starl_sim_queue:add({Id, Now, 0, 0, 0, wake}, Queue)}.

run_window(#shard{next = Next, window_us = Width, queue = Queue, windows = N} = Shard) ->
    From = Next - Next rem Width,
    To = From + Width,
    {Events, Rest} = starl_sim_queue:take_window(To, Queue),
    Ids = starl_sim_window:run({From, To}, Events),
    close({From, To}, Ids, none, Shard#shard{queue = Rest, now = To, windows = N + 1}).

%% The window's end, but for a robot that was held. `Mails' has what the peers sent meanwhile.
close(Window, Ids, Mails, #shard{stop = Stop} = Shard) ->
    case Stop =/= none andalso starl_sim_robot:halted(starl_sim_window:robot(Stop)) of
        {at, At} -> hold(At, Window, Ids, Mails, Shard);
        _ -> finish(Ids, Mails, Shard)
    end.

%% Nothing of the peers' mail is taken before the window is over: its robots must not see it.
hold(At, Window, Ids, Mails0, #shard{peers = Peers, windows = N, stop = Id} = Shard) ->
    _ = [Peer ! {mail, self(), N, {held, At}} || Peer <- Peers],
    Mails =
        case Mails0 of
            none -> [next_mail(Peer, N) || Peer <- Peers];
            _ -> Mails0
        end,
    Shard#shard{
        open = #{
            window => Window, robot => Id, ids => Ids, at => At, mails => Mails, news => []
        }
    }.

finish(Ids, Mails, #shard{windows = N} = Shard) ->
    Yields = starl_sim_window:yields(Ids),
    Shard#shard.run ! {window_done, self(), N, maps:get(trace, Yields)},
    case Mails of
        none -> exchange(Yields, Shard);
        _ -> lists:foldl(fun take/2, tell(Yields, Shard), Mails)
    end.

%% Goes on with the window in which a robot was held, here or in another shard.
resume(#shard{open = #{window := Window, robot := Id, ids := Ids, mails := Mails} = Open} = Shard) ->
    _ = [self() ! News || News <- lists:reverse(maps:get(news, Open))],
    ok = starl_sim_window:resume(Window, Id),
    close(Window, Ids, Mails, Shard#shard{open = none});
resume(#shard{open = {peer, Peer, _}} = Shard) ->
    receive_mail(Peer, Shard#shard{open = none});
resume(#shard{open = none} = Shard) ->
    Shard.

%% Everybody tells everybody what they must know to run the next window.
exchange(Yields, #shard{peers = Peers} = Shard) ->
    lists:foldl(fun receive_mail/2, tell(Yields, Shard), Peers).

tell(#{later := Later, moved := Moved, ended := Ended}, #shard{peers = []} = Shard) ->
    Queue = starl_sim_queue:add_all(Later, Shard#shard.queue),
    Next = starl_sim_queue:next_time(Queue),
    take({Next, Ended, Moved, []}, Shard#shard{queue = Queue, next = infinity});
tell(#{later := Later, moved := Moved, ended := Ended}, Shard) ->
    #shard{peers = Peers, owners = Owners, queue = Queue, windows = N} = Shard,
    ByShard = maps:groups_from_list(fun(E) -> maps:get(element(1, E), Owners) end, Later),
    Own = starl_sim_queue:add_all(maps:get(self(), ByShard, []), Queue),
    Times = [Time || {_, Time, _, _, _, _} <- Later],
    %% whole numbers sort before the atom infinity
    Next = lists:min([starl_sim_queue:next_time(Own) | Times]),
    _ = [
        Peer ! {mail, self(), N, {Next, Ended, Moved, maps:get(Peer, ByShard, [])}}
     || Peer <- Peers
    ],
    take({Next, Ended, Moved, []}, Shard#shard{queue = Own, next = infinity}).

receive_mail(Peer, #shard{windows = N} = Shard) ->
    case next_mail(Peer, N) of
        {held, At} -> Shard#shard{open = {peer, Peer, At}};
        abandoned -> Shard#shard{abandoned = true};
        Mail -> take(Mail, Shard)
    end.

%% Whoever is told to abandon the run waits for no other peer, either.
next_mail(Peer, N) ->
    receive
        {mail, Peer, N, Mail} ->
            Mail;
        abandon ->
            self() ! abandon,
            abandoned
    end.

take({Next, Ended, Moved, Packets}, #shard{queue = Queue, world = #{sight := Sight}} = Shard) ->
    ok = starl_sim_sight:moved(Moved, Sight),
    Shard#shard{
        next = min(Next, Shard#shard.next),
        running = Shard#shard.running - Ended,
        queue = starl_sim_queue:add_all(Packets, Queue)
    }.
