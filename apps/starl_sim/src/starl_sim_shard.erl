%% @doc A shard: some of the robots of a simulation, run window by window.
%%
%% The exchange with {@link starl_sim_run}:
%% ```
%%   run                                        shard
%%     | {window, From, To, Packets} ------------>|  runs all its events in From =< time < To
%%     |<-- {window_done, Pid, Outcome} ----------|  packets for others, trace, next event's time
%% '''
%% A robot's machine is stepped by one message and answers with its actions (see
%% {@link starl_machine_proc}); nothing else of that robot runs meanwhile, but other robots do:
%% what a robot does reaches the others in a later window only, so within one they cannot
%% disturb each other ({@link starl_sim_robot}).
-module(starl_sim_shard).
-behaviour(gen_server).

-export([start_link/1, launch/2, window/4, inspect/2]).
-export([init/1, handle_call/3, handle_cast/2, handle_info/2]).

-export_type([outcome/0, robot_spec/0]).

%% How long, in wall time, a window may take before the run is given up.
-define(PATIENCE_MS, 60000).
%% The shard's heap turns over fast.
-define(HEAP_WORDS, 100000).

%% A robot to be started: its tree and where it stands.
-type robot_spec() :: #{tree := starl_robot_sup:spec(), pose := starl:pose()}.

%% What came of a window. The trace is in the order of time, then robot.
-type outcome() :: #{
    packets := [starl_sim_queue:event()],
    trace := [starl_monitor:trace_event()],
    next := starl_sim_queue:time() | infinity,
    running := non_neg_integer()
}.

-record(shard, {
    run :: pid(),
    world :: starl_sim_platform:world(),
    robots_sup :: pid(),
    queue :: starl_sim_queue:t(),
    robots = #{} :: #{starl:robot_id() => starl_sim_robot:t()},
    running = 0 :: non_neg_integer(),
    window_us :: pos_integer(),
    window = 0 :: starl_sim_queue:time()
}).

%% @doc Starts an empty shard.
-spec start_link(#{
    run := pid(),
    world := starl_sim_platform:world(),
    window_us := pos_integer(),
    robots_sup := pid()
}) -> gen_server:start_ret().
start_link(Config) -> gen_server:start_link(?MODULE, Config, [
        {spawn_opt, [{min_heap_size, ?HEAP_WORDS}, {fullsweep_after, 100}]}
    ]).

%% @doc Starts robots on the shard and plants faults; returns when all their processes run.
-spec launch(pid(), {[robot_spec()], [starl_sim_queue:event()]}) -> ok.
launch(Shard, Load) -> gen_server:call(Shard, {launch, Load}, infinity).

%% @doc Runs a window; the shard answers with `{window_done, Shard, outcome()}'.
-spec window(pid(), From :: starl_sim_queue:time(), To :: starl_sim_queue:time(), Packets) -> ok
when
    Packets :: [starl_sim_queue:event()].
window(Shard, From, To, Packets) -> gen_server:cast(Shard, {window, From, To, Packets}).

%% @doc Looks at the robots: a summary of all at a time, or the machines of one.
-spec inspect(pid(), {summary, starl_sim_queue:time()} | {robot, starl:robot_id()}) ->
    [{starl:robot_id(), starl_sim_robot:summary()}] | #{starl_machine:name() => term()} | unknown.
inspect(Shard, What) -> gen_server:call(Shard, {inspect, What}, infinity).

-spec init(map()) -> {ok, #shard{}}.
init(#{run := Run, world := World, window_us := Width, robots_sup := RobotsSup}) ->
    Queue = starl_sim_queue:new(Width),
    {ok, #shard{
        run = Run, world = World, robots_sup = RobotsSup, queue = Queue, window_us = Width
    }}.

-spec handle_call(term(), gen_server:from(), #shard{}) -> {reply, term(), #shard{}}.
handle_call({launch, {Specs, Faults}}, _From, Shard) ->
    Robots = maps:from_list([start_robot(Spec, Shard) || Spec <- Specs]),
    ok = show(maps:to_list(Robots), Shard),
    Queue = lists:foldl(fun starl_sim_queue:add/2, Shard#shard.queue, Faults),
    {reply, ok, Shard#shard{robots = Robots, queue = Queue, running = map_size(Robots)}};
handle_call({inspect, {summary, Time}}, _From, #shard{robots = Robots} = Shard) ->
    Summaries = [
        {Id, starl_sim_robot:summary(Time, Robot)}
     || {Id, Robot} <- lists:sort(maps:to_list(Robots))
    ],
    {reply, Summaries, Shard};
handle_call({inspect, {robot, Id}}, _From, #shard{robots = Robots} = Shard) ->
    case Robots of
        #{Id := Robot} -> {reply, starl_sim_robot:machines(Robot), Shard};
        #{} -> {reply, unknown, Shard}
    end.

-spec handle_cast({window, integer(), integer(), [starl_sim_queue:event()]}, #shard{}) ->
    {noreply, #shard{}}.
handle_cast({window, From, To, Packets}, #shard{run = Run, queue = Queue} = Shard) ->
    Filled = lists:foldl(fun starl_sim_queue:add/2, Queue, Packets),
    {Events, Rest} = starl_sim_queue:take_window(To, Filled),
    %% one timer a window: one in each receive would cost as much as the event
    Timer = erlang:send_after(?PATIENCE_MS, self(), {out_of_patience, From}),
    {Outcome, Ran} = run_window(To, Events, Shard#shard{queue = Rest, window = From}),
    _ = erlang:cancel_timer(Timer, [{async, true}, {info, false}]),
    Run ! {window_done, self(), Outcome},
    {noreply, Ran}.

%% A machine that was killed from outside between two windows; or one of a robot that died.
-spec handle_info(term(), #shard{}) -> {noreply, #shard{}}.
handle_info({'DOWN', _, process, Pid, Reason}, #shard{robots = Robots} = Shard) ->
    case owner(Pid, Robots) of
        {Id, Robot} ->
            Crashed = Robots#{Id := starl_sim_robot:crashed(Pid, Reason, Robot)},
            {noreply, wake(Id, Shard#shard{robots = Crashed})};
        none ->
            {noreply, Shard}
    end;
handle_info({wake, Id}, Shard) ->
    {noreply, wake(Id, Shard)};
handle_info({out_of_patience, _}, Shard) ->
    {noreply, Shard}.

%% start_child returns when the whole tree has started, so all attachments are here already.
start_robot(#{tree := #{id := Id} = Tree, pose := Pose}, #shard{world = World, robots_sup = Sup}) ->
    {ok, Pid} = supervisor:start_child(Sup, [Tree#{driver => self()}]),
    _ = erlang:monitor(process, Pid),
    Robot = starl_sim_robot:new(Id, starl_sim_platform:new(Id, Pose, World), Pid),
    {Id, starl_sim_robot:boot(attach_all(Id, Robot))}.

attach_all(Id, Robot) ->
    receive
        {starl_attach, Id, Name, Pid} ->
            attach_all(Id, starl_sim_robot:attach(Name, Pid, Robot))
    after 0 -> Robot
    end.

%% -- windows --------------------------------------------------------------------------------

%% All robots that have something to do in the window work at once.
run_window(To, Events, #shard{robots = Robots, window = From} = Shard) ->
    Window = {From, To},
    {Ids, Active, Begun} = begin_robots(agenda(From, Events, Robots), Window, [], 0, Robots),
    Done = collect(Active, Begun, Window),
    close_window(Ids, Shard#shard{robots = Done}).

%% In the first window every robot boots.
agenda(0, Events, Robots) ->
    lists:sort([{Id, 0, 0, 0, 0, wake} || Id <- maps:keys(Robots)] ++ Events);
agenda(_From, Events, _Robots) ->
    Events.

%% Events come by robot, and in the robot's order.
begin_robots([], _Window, Ids, Active, Robots) ->
    {Ids, Active, Robots};
begin_robots([{Id, _, _, _, _, _} = Event | Events], Window, Ids, Active, Robots) ->
    {Own, Rest} = take_own(Id, Events, [Event]),
    #{Id := Robot} = Robots,
    case starl_sim_robot:proceed(Window, starl_sim_robot:open(Own, Robot)) of
        {busy, Next} ->
            begin_robots(Rest, Window, [Id | Ids], Active + 1, Robots#{Id := Next});
        {idle, Next} ->
            begin_robots(Rest, Window, [Id | Ids], Active, Robots#{Id := Next})
    end.

take_own(Id, [{Id, _, _, _, _, _} = Event | Events], Own) -> take_own(Id, Events, [Event | Own]);
take_own(_Id, Events, [_] = Own) -> {Own, Events};
take_own(_Id, Events, Own) -> {lists:reverse(Own), Events}.

collect(0, Robots, _Window) ->
    Robots;
collect(Active, Robots, Window) ->
    receive
        {starl_done, Id, Actions} ->
            #{Id := Robot} = Robots,
            Answered = starl_sim_robot:answered(Actions, Robot),
            case starl_sim_robot:proceed(Window, Answered) of
                {busy, Next} -> collect(Active, Robots#{Id := Next}, Window);
                {idle, Next} -> collect(Active - 1, Robots#{Id := Next}, Window)
            end;
        {'DOWN', _, process, Pid, Reason} ->
            {Change, Next} = interrupted(Pid, Reason, Robots, Window),
            collect(Active + Change, Next, Window);
        {out_of_patience, From} when From =:= element(1, Window) ->
            exit({no_answer, [B || R <- maps:values(Robots), B <- starl_sim_robot:busy(R)]})
    end.

%% A crash of a robot at work: it goes on when its supervisor has restarted what crashed. The
%% processes of the others are left for later.
interrupted(Pid, Reason, Robots, Window) ->
    case owner(Pid, Robots) of
        {Id, Robot} ->
            Crashed = starl_sim_robot:crashed(Pid, Reason, Robot),
            case {starl_sim_robot:busy(Robot), starl_sim_robot:busy(Crashed)} of
                {[_], []} ->
                    go_on(Id, starl_sim_robot:proceed(Window, Crashed), Robots);
                {[_], [_]} ->
                    {0, Robots#{Id := Crashed}};
                {[], []} ->
                    self() ! {wake, Id},
                    {0, Robots#{Id := Crashed}}
            end;
        none ->
            {0, Robots}
    end.

go_on(Id, {busy, Robot}, Robots) -> {0, Robots#{Id := Robot}};
go_on(Id, {idle, Robot}, Robots) -> {-1, Robots#{Id := Robot}}.

%% Has the robot go on, in the next window, with what a crash has left it to do.
wake(Id, #shard{queue = Queue, window = Window, window_us = Width} = Shard) ->
    Shard#shard{queue = starl_sim_queue:add({Id, Window + Width, 0, 0, 0, wake}, Queue)}.

owner(Pid, Robots) ->
    case [{Id, R} || {Id, R} <- maps:to_list(Robots), starl_sim_robot:owns(Pid, R)] of
        [Owner] -> Owner;
        [] -> none
    end.

%% Robots are closed in descending order, so that what they yield comes in ascending order.
close_window(Ids, #shard{robots = Robots0, queue = Queue} = Shard) ->
    {Robots, {Later, Trace, Moved, Ended}} = close_robots(Ids, Robots0, {[], [], [], 0}),
    {Own, Others} = lists:partition(fun(E) -> is_map_key(element(1, E), Robots) end, Later),
    Filled = lists:foldl(fun starl_sim_queue:add/2, Queue, Own),
    ok = show(Moved, Shard),
    Running = Shard#shard.running - Ended,
    Outcome = #{
        packets => Others,
        %% by time, then robot: keysort is stable
        trace => lists:keysort(1, Trace),
        next => starl_sim_queue:next_time(Filled),
        running => Running
    },
    {Outcome, Shard#shard{robots = Robots, queue = Filled, running = Running}}.

close_robots([], Robots, Yields) ->
    {Robots, Yields};
close_robots([Id | Ids], Robots, {Later, Trace, Moved, Ended}) ->
    #{Id := Robot} = Robots,
    {{New, Traced, Changes}, Closed} = starl_sim_robot:close(Robot),
    Yields = {New ++ Later, lists:reverse(Traced, Trace), Moved, Ended},
    close_robots(Ids, Robots#{Id := Closed}, changes(Changes, Id, Closed, Yields)).

changes([], _Id, _Robot, Yields) ->
    Yields;
changes(Changes, Id, Robot, {Later, Trace, Moved, Ended}) ->
    {
        Later,
        Trace,
        [{Id, Robot} || lists:member(moved, Changes)] ++ Moved,
        Ended + length([ended || lists:member(ended, Changes)])
    }.

%% Lets the others see where robots are, from the next window on.
show([], _Shard) ->
    ok;
show(Robots, #shard{world = #{sight := Sight}}) ->
    true = ets:insert(Sight, [{Id, starl_sim_robot:piece(Robot)} || {Id, Robot} <- Robots]),
    ok.
