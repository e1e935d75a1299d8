%% @doc A shard: some of the robots of a simulation, run window by window.
%%
%% The exchange with {@link starl_sim_run}:
%% ```
%%   run                                        shard
%%     | {window, From, To, Packets} ------------>|  runs all its events in From =< time < To
%%     |<-- {window_done, Pid, Outcome} ----------|  packets for others, trace, next event's time
%% '''
%% A robot's machine is stepped by one message and answers with its actions (see
%% {@link starl_machine_proc}); nothing else of that robot runs meanwhile. All events of one
%% robot at one time are worked off, in the order in which they arose, before the next.
-module(starl_sim_shard).
-behaviour(gen_server).

-export([start_link/1, launch/2, window/4, inspect/2]).
-export([init/1, handle_call/3, handle_cast/2, handle_info/2]).

-export_type([outcome/0, robot_spec/0, summary/0]).

%% How long, in wall time, a machine may take over one event before the run is given up.
-define(PATIENCE_MS, 60000).
-define(CLASS_FAULT, 0).

%% A robot to be started: its tree and where it stands.
-type robot_spec() :: #{tree := starl_robot_sup:spec(), pose := starl:pose()}.

%% What came of a window. The trace is in the order of time, then robot.
-type outcome() :: #{
    packets := [starl_sim_queue:event()],
    trace := [starl_monitor:trace_event()],
    next := starl_sim_queue:time() | infinity,
    running := non_neg_integer()
}.

%% What is known of a robot: its digest chain, its events and packets, its application's result.
-type summary() :: #{
    chain := non_neg_integer(),
    events := non_neg_integer(),
    packets := non_neg_integer(),
    result := running | died | {done, term()},
    pose := starl:pose()
}.

-record(robot, {
    body :: starl_sim_platform:t(),
    sup :: pid() | undefined,
    processes = #{} :: #{starl_machine:name() => pid()},
    incarnations = #{} :: #{starl_machine:name() => pos_integer()}
}).

-record(shard, {
    run :: pid(),
    world :: starl_sim_platform:world(),
    robots_sup :: pid(),
    queue :: starl_sim_queue:t(),
    robots = #{} :: #{starl:robot_id() => #robot{}},
    moved = [] :: [starl:robot_id()],
    window = 0 :: starl_sim_queue:time(),
    out = [] :: [starl_sim_queue:event()],
    trace = [] :: [starl_monitor:trace_event()]
}).

%% @doc Starts an empty shard.
-spec start_link(#{
    run := pid(),
    world := starl_sim_platform:world(),
    window_us := pos_integer(),
    robots_sup := pid()
}) -> {ok, pid()} | {error, term()}.
start_link(Config) -> gen_server:start_link(?MODULE, Config, [{spawn_opt, [{priority, normal}]}]).

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
    [{starl:robot_id(), summary()}] | #{starl_machine:name() => term()} | unknown.
inspect(Shard, What) -> gen_server:call(Shard, {inspect, What}, infinity).

-spec init(map()) -> {ok, #shard{}}.
init(#{run := Run, world := World, window_us := Width, robots_sup := RobotsSup}) ->
    process_flag(message_queue_data, on_heap),
    Queue = starl_sim_queue:new(Width),
    {ok, #shard{run = Run, world = World, robots_sup = RobotsSup, queue = Queue}}.

-spec handle_call(term(), gen_server:from(), #shard{}) -> {reply, term(), #shard{}}.
handle_call({launch, {Specs, Faults}}, _From, Shard) ->
    Started = [start_robot(Spec, Shard) || Spec <- Specs],
    Attached = maps:from_list([{Id, attach_all(Robot, Id)} || {Id, Robot} <- Started]),
    Queue = lists:foldl(fun starl_sim_queue:add/2, Shard#shard.queue, Faults),
    Booted = lists:foldl(
        fun boot_robot/2,
        Shard#shard{robots = Attached, queue = Queue},
        lists:sort(maps:keys(Attached))
    ),
    {reply, ok, publish(Booted#shard{moved = maps:keys(Attached)})};
handle_call({inspect, {summary, Time}}, _From, #shard{robots = Robots} = Shard) ->
    {reply, [{Id, summary(Time, Robot)} || {Id, Robot} <- lists:sort(maps:to_list(Robots))], Shard};
handle_call({inspect, {robot, Id}}, _From, #shard{robots = Robots} = Shard) ->
    case Robots of
        #{Id := Robot} -> {reply, machines(Robot), Shard};
        #{} -> {reply, unknown, Shard}
    end.

-spec handle_cast({window, integer(), integer(), [starl_sim_queue:event()]}, #shard{}) ->
    {noreply, #shard{}}.
handle_cast({window, From, To, Packets}, #shard{run = Run, queue = Queue} = Shard) ->
    Filled = lists:foldl(fun starl_sim_queue:add/2, Queue, Packets),
    Ran = publish(run_window(To, Shard#shard{queue = Filled, window = From})),
    Run ! {window_done, self(), #{
        packets => Ran#shard.out,
        trace => lists:reverse(Ran#shard.trace),
        next => starl_sim_queue:next_time(Ran#shard.queue),
        running => running(Ran#shard.robots)
    }},
    {noreply, Ran#shard{out = [], trace = []}}.

%% A machine that was killed from outside between two windows; or one of a robot that died.
-spec handle_info({'DOWN', reference(), process, pid(), term()}, #shard{}) -> {noreply, #shard{}}.
handle_info({'DOWN', _, process, Pid, _}, #shard{robots = Robots} = Shard) ->
    case [{Id, N} || {Id, R} <- maps:to_list(Robots), {N, P} <- processes(R), P =:= Pid] of
        [{Id, Name}] ->
            {Work, Robot} = recover(Name, Id, maps:get(Id, Robots)),
            {noreply, store(Id, work(Work, Id, Robot, Shard), Shard)};
        [] ->
            {noreply, Shard}
    end.

processes(#robot{processes = Processes}) -> maps:to_list(Processes).

%% -- starting -------------------------------------------------------------------------------

start_robot(#{tree := #{id := Id} = Tree, pose := Pose}, #shard{world = World, robots_sup = Sup}) ->
    {ok, Pid} = supervisor:start_child(Sup, [Tree#{driver => self()}]),
    _ = erlang:monitor(process, Pid),
    {Id, #robot{body = starl_sim_platform:new(Id, Pose, World), sup = Pid}}.

%% start_child returns when the whole tree has started, so all attachments are here already.
attach_all(Robot, Id) ->
    receive
        {starl_attach, Id, Name, Pid} -> attach_all(attach(Name, Pid, Robot), Id)
    after 0 -> Robot
    end.

attach(Name, Pid, #robot{processes = Processes, incarnations = Incarnations} = Robot) ->
    _ = erlang:monitor(process, Pid),
    Incarnation = maps:get(Name, Incarnations, 0) + 1,
    Robot#robot{
        processes = Processes#{Name => Pid}, incarnations = Incarnations#{Name => Incarnation}
    }.

boot_robot(Id, #shard{robots = Robots} = Shard) ->
    #robot{processes = Processes} = Robot = maps:get(Id, Robots),
    Boots = [{Name, boot, none} || Name <- boot_order(maps:keys(Processes))],
    store(Id, work(Boots, Id, Robot, Shard), Shard).

%% The platform's machines first, the application last, whatever their names.
boot_order(Names) ->
    First = [Name || Name <- [sap, location, motion], lists:member(Name, Names)],
    Last = [app || lists:member(app, Names)],
    First ++ lists:sort(Names -- (First ++ Last)) ++ Last.

%% -- running --------------------------------------------------------------------------------

run_window(To, #shard{queue = Queue} = Shard) ->
    case starl_sim_queue:take(To, Queue) of
        none -> Shard;
        {Event, Rest} -> run_window(To, run_event(Event, Shard#shard{queue = Rest}))
    end.

run_event({Time, Id, Class, _Source, Seq, Content}, #shard{robots = Robots} = Shard) ->
    case Robots of
        #{Id := #robot{sup = undefined}} ->
            Shard;
        #{Id := #robot{body = Body0} = Robot0} ->
            Body = starl_sim_platform:at({Time, Shard#shard.window}, Body0),
            Robot = Robot0#robot{body = Body},
            case Class of
                ?CLASS_FAULT -> store(Id, strike(Content, Id, Robot, Shard), Shard);
                _ -> run_content(Content, Seq, Id, Robot, Shard)
            end
    end.

run_content({timer, Machine, Timer, Content}, Seq, Id, #robot{body = Body} = Robot, Shard) ->
    case starl_sim_platform:fire(Machine, Timer, Seq, Body) of
        {ok, Fired} ->
            Type = timer_type(Timer),
            Work = [{Machine, Type, Content}],
            store(Id, work(Work, Id, Robot#robot{body = Fired}, Shard), Shard);
        stale ->
            Shard
    end;
run_content(Local, _Seq, Id, Robot, Shard) ->
    store(Id, work([Local], Id, Robot, Shard), Shard).

timer_type(state_timeout) -> state_timeout;
timer_type(Timer) -> {timeout, Timer}.

%% Works off the robot's events, and those that they give rise to, in order.
work([], _Id, Robot, _Shard) ->
    Robot;
work([{Name, _, _} = Local | Rest], Id, #robot{processes = Processes} = Robot, Shard) ->
    case Processes of
        #{Name := Pid} ->
            {New, Next} = dispatch(Local, Pid, Id, Robot, Shard),
            work(Rest ++ New, Id, Next, Shard);
        #{} ->
            Body = starl_sim_platform:trace(Name, {unknown_machine, Name}, Robot#robot.body),
            work(Rest, Id, Robot#robot{body = Body}, Shard)
    end.

dispatch({Name, Type, Content} = Local, Pid, Id, #robot{body = Body0} = Robot, Shard) ->
    Body = starl_sim_platform:hash_event(Name, Type, Content, Body0),
    Pid ! message(Local, Id, Robot, Shard),
    receive
        {starl_done, Pid, Actions} ->
            {New, Next} = starl_platform:perform(Actions, Name, starl_sim_platform, Body),
            {New, Robot#robot{body = Next}};
        {'DOWN', _, process, Pid, _Reason} ->
            recover(Name, Id, Robot#robot{body = Body})
    after ?PATIENCE_MS ->
        exit({no_answer, #{robot => Id, machine => Name, event => {Type, Content}}})
    end.

message({Name, boot, none}, Id, #robot{body = Body, incarnations = Incarnations}, Shard) ->
    #shard{world = #{seed := Seed, team := Team}} = Shard,
    {starl_boot, #{
        robot => Id,
        participants => Team,
        name => Name,
        incarnation => maps:get(Name, Incarnations),
        random => rand:seed_s(exsss, erlang:phash2({Seed, Id, Name}, 4294967296)),
        now => starl_sim_platform:local_time(Body)
    }};
message({_Name, Type, Content}, Id, #robot{body = Body}, _Shard) ->
    {starl_step, Type, Content, #{now => starl_sim_platform:local_time(Body), robot => Id}}.

store(Id, #robot{body = Body} = Robot, #shard{robots = Robots} = Shard) ->
    {Events, Trace, Rest} = starl_sim_platform:collect(Body),
    {Queue, Out} = lists:foldl(
        fun(Event, Acc) -> sort_out(Event, Robots, Acc) end,
        {Shard#shard.queue, Shard#shard.out},
        Events
    ),
    Shard#shard{
        robots = Robots#{Id := Robot#robot{body = Rest}},
        queue = Queue,
        out = Out,
        trace = Trace ++ Shard#shard.trace,
        moved = moved(Id, Body, (maps:get(Id, Robots))#robot.body, Shard#shard.moved)
    }.

moved(Id, New, Old, Moved) ->
    case starl_sim_platform:piece(New) =:= starl_sim_platform:piece(Old) of
        true -> Moved;
        false -> [Id | Moved]
    end.

sort_out({_, Dest, _, _, _, _} = Event, Robots, {Queue, Out}) ->
    case is_map_key(Dest, Robots) of
        true -> {starl_sim_queue:add(Event, Queue), Out};
        false -> {Queue, [Event | Out]}
    end.

%% Shows the others where this shard's robots are, from the next window on.
publish(#shard{moved = []} = Shard) ->
    Shard;
publish(#shard{moved = Moved, robots = Robots, world = #{sight := Sight}} = Shard) ->
    Pieces = [
        {Id, starl_sim_platform:piece((maps:get(Id, Robots))#robot.body)}
     || Id <- lists:usort(Moved)
    ],
    true = ets:insert(Sight, Pieces),
    Shard#shard{moved = []}.

running(Robots) ->
    maps:fold(
        fun
            (_, #robot{sup = undefined}, N) -> N;
            (_, #robot{body = Body}, N) ->
                case starl_sim_platform:result(Body) of
                    running -> N + 1;
                    _ -> N
                end
        end,
        0,
        Robots
    ).

%% -- faults and crashes ---------------------------------------------------------------------

strike({kill_machine, Name}, Id, #robot{processes = Processes} = Robot, Shard) ->
    case Processes of
        #{Name := Pid} ->
            exit(Pid, kill),
            receive
                {'DOWN', _, process, Pid, _} -> ok
            end,
            {Work, Next} = recover(Name, Id, Robot),
            work(Work, Id, Next, Shard);
        #{} ->
            Robot
    end;
strike(kill_robot, _Id, #robot{sup = Sup} = Robot, _Shard) ->
    exit(Sup, kill),
    receive
        {'DOWN', _, process, Sup, _} -> died(killed, Robot)
    end.

%% Virtual time waits until the supervisor has restarted what crashed.
recover(Name, Id, #robot{body = Body} = Robot) ->
    Traced = starl_sim_platform:trace(Name, crashed, Body),
    Bare = forget(Name, Robot#robot{body = Traced}),
    case await_restart([Name], [], Id, Bare) of
        {ok, Names, Restarted} ->
            Back = boot_order(Names),
            Told = boot_order(maps:keys(Restarted#robot.processes)),
            Work =
                [{N, boot, none} || N <- Back] ++
                    [{T, info, {restarted, N}} || N <- Back, T <- Told, T =/= N],
            {Work, Restarted};
        {died, Dead} ->
            {[], Dead}
    end.

forget(Name, #robot{body = Body, processes = Processes} = Robot) ->
    Robot#robot{
        body = starl_sim_platform:forget_timers(Name, Body),
        processes = maps:remove(Name, Processes)
    }.

await_restart([], Back, _Id, Robot) ->
    {ok, Back, Robot};
await_restart(Missing, Back, Id, #robot{sup = Sup} = Robot) ->
    receive
        {starl_attach, Id, Name, Pid} ->
            await_restart(lists:delete(Name, Missing), [Name | Back], Id, attach(Name, Pid, Robot));
        {'DOWN', _, process, Sup, _} ->
            {died, died(gave_up, Robot)};
        {'DOWN', _, process, Pid, _} ->
            case [N || {N, P} <- maps:to_list(Robot#robot.processes), P =:= Pid] of
                [Name] ->
                    Rest = lists:delete(Name, Back),
                    await_restart([Name | Missing], Rest, Id, forget(Name, Robot));
                [] ->
                    await_restart(Missing, Back, Id, Robot)
            end
    end.

%% A robot that died for good: it stands where it is, for ever.
died(Reason, #robot{body = Body} = Robot) ->
    Stopped = starl_sim_platform:halt(Body),
    Traced = starl_sim_platform:trace(robot, {died, Reason}, Stopped),
    Robot#robot{body = Traced, sup = undefined, processes = #{}}.

%% -- looking --------------------------------------------------------------------------------

summary(Time, #robot{body = Body, sup = Sup}) ->
    {Chain, Events, Packets} = starl_sim_platform:digest(Body),
    Piece = starl_sim_platform:piece(Body),
    #{
        chain => Chain,
        events => Events,
        packets => Packets,
        result =>
            case Sup of
                undefined -> died;
                _ -> starl_sim_platform:result(Body)
            end,
        pose => starl_trajectory:pose(Time, Piece)
    }.

machines(#robot{processes = Processes}) -> maps:map(fun(_, Pid) -> machine(Pid) end, Processes).

machine(Pid) ->
    case proc_lib:translate_initial_call(Pid) of
        {starl_app_proc, _, _} ->
            sequential;
        _ ->
            {Machine, _Shell} = sys:get_state(Pid),
            #{
                module => starl_machine:module(Machine),
                state => starl_machine:state(Machine),
                data => starl_machine:data(Machine)
            }
    end.
