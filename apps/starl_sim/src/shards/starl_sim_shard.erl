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
%% A window is as long as the shortest delay of a packet, so a packet sent in one window arrives in
%% a later one. All shards decide by the same numbers which window is next and when to rest
%% ({@link starl_sim_lockstep}). They run at most 16 windows ahead of the judged ones, and rest
%% there on the command to halt, so the end of a run depends only on the scenario.
%%
%% A robot can be halted just after its N-th event. When it does, the other robots finish the
%% window; the mail of its shard says `held', and all shards rest until it is resumed.
%%
%% Shards may be on different nodes. A shard that waits for a lost node gets the command to abandon
%% the run, and rests for good.
%%
%% Each shard keeps its own copy of all robots' places at the beginning of the window.
-module(starl_sim_shard).
-behaviour(gen_server).

-export([start_link/1, launch/2, run/3, approve/2, reload/2, halt/1, abandon/1, inspect/3]).
-export([init/1, handle_call/3, handle_cast/2, handle_info/2]).

-export_type([load/0, crew/0, question/0, answer/0]).

%% The shard's heap turns over fast, and each collection copies its live data: initial words per
%% robot, within these bounds. Up to some 80 robots the heap stays below 128 Ki words and
%% is collected in place: a larger one is handed to a dirty scheduler, which the shard waits for.
-define(WORDS_PER_ROBOT, 1500).
-define(LEAST_WORDS, 100000).
-define(MOST_WORDS, 1000000).

%% The parts of every robot: the tree of its processes, if it has any, without its
%% number and driver; the machines that get no process; the module of its kind, if it is not one of
%% the simulator's own.
-type crew() :: #{
    tree := starl_robot_services:tree() | none,
    inline := starl_robot_machines:inline(),
    kind => module()
}.

%% The initial load of a shard. `peers' are the other shards, `owners' gives the shard of each
%% robot.
-type load() :: #{
    robots := [{starl:robot_id(), starl:pose()}],
    crew := crew(),
    faults := [starl_sim_queue:event()],
    peers := [pid()],
    owners := #{starl:robot_id() => pid()},
    sight := [{starl:robot_id(), starl_trajectory:piece()}],
    running := non_neg_integer()
}.

%% A question about robots: a summary of all at a time; one robot's machines, its timers, its number
%% of events, or its recorded events.
-type question() ::
    {summary, starl_sim_queue:time()}
    | {robot | timers | count | events, starl:robot_id()}.

-type answer() ::
    [{starl:robot_id(), starl_sim_summary:t()}]
    | #{starl_machine:name() => starl_robot_tree:seen()}
    | [starl_sim_timers:timer()]
    | [starl_sim_ledger:event()]
    | non_neg_integer()
    | unknown.

-record(shard, {
    world :: starl_sim_world:t(),
    robots_sup :: pid(),
    steps :: starl_sim_lockstep:t()
}).

%% @doc Starts an empty shard, with room for about `robots' robots.
-spec start_link(#{
    run := pid(),
    world := starl_sim_world:t(),
    window_us := pos_integer(),
    patience_ms := pos_integer(),
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
%% called for all shards. Each shard reports its windows with `{window_done, Shard, N, Trace}' and
%% in the end `{resting, Shard, Now, Reason, Running}' ({@link starl_sim_lockstep:reason()}).
-spec run(pid(), Until :: starl_sim_queue:time(), starl_sim_lockstep:stop()) -> ok.
run(Shard, Until, Stop) -> gen_server:cast(Shard, {run, Until, Stop}).

%% @doc The monitors have judged the first N windows.
-spec approve(pid(), N :: pos_integer()) -> ok.
approve(Shard, N) ->
    Shard ! {approve, N},
    ok.

%% @doc Its robots get new code: at the time at which it rests, or in the second window from now.
-spec reload(pid(), starl_run_reloads:t()) -> ok.
reload(Shard, Reload) ->
    Shard ! {reload, Reload},
    ok.

%% @doc Lets the shards rest as far ahead of the last approval as they may go.
-spec halt(pid()) -> ok.
halt(Shard) ->
    Shard ! halt,
    ok.

%% @doc The run cannot go on: the shard rests and waits for nothing.
-spec abandon(pid()) -> ok.
abandon(Shard) ->
    Shard ! abandon,
    ok.

%% @doc Answers a question about robots, while the shard rests.
-spec inspect(pid(), question(), Ms :: timeout()) -> answer().
inspect(Shard, What, Ms) -> gen_server:call(Shard, {inspect, What}, Ms).

-spec init(map()) -> {ok, #shard{}}.
init(#{run := Run, world := World, robots_sup := RobotsSup} = Config) ->
    #{window_us := Width, patience_ms := Patience} = Config,
    Steps = starl_sim_lockstep:new(Run, Width, Patience),
    {ok, #shard{world = World, robots_sup = RobotsSup, steps = Steps}}.

-spec handle_call(term(), gen_server:from(), #shard{}) -> {reply, term(), #shard{}}.
handle_call({launch, Load}, _From, #shard{world = #{range_mm := Range} = World0} = Shard) ->
    Sight = starl_sim_sight:new(maps:get(sight, Load), Range),
    World = World0#{sight => Sight},
    #{robots := Robots, crew := Crew} = Load,
    ok = starl_sim_window:hold([start_robot(Robot, Crew, World, Shard) || Robot <- Robots]),
    {reply, ok, launched(Sight, Load, Shard#shard{world = World})};
handle_call({inspect, {summary, Time}}, _From, Shard) ->
    Robots = starl_sim_window:robots(),
    {reply, [{Id, starl_sim_robot:summary(Time, Robot)} || {Id, Robot} <- Robots], Shard};
handle_call({inspect, {What, Id}}, _From, Shard) ->
    case starl_sim_window:robot(Id) of
        undefined -> {reply, unknown, Shard};
        Robot -> {reply, seen(What, Id, Robot, Shard), Shard}
    end.

seen(robot, _Id, Robot, _Shard) ->
    starl_sim_robot:machines(Robot);
seen(timers, Id, Robot, #shard{steps = Steps}) ->
    starl_sim_robot:timers(starl_sim_lockstep:planned(Id, Steps), Robot);
seen(count, _Id, Robot, _Shard) ->
    maps:get(events, starl_sim_robot:summary(0, Robot));
seen(events, _Id, Robot, _Shard) ->
    starl_sim_robot:recorded(Robot).

-spec handle_cast({run, starl_sim_queue:time(), starl_sim_lockstep:stop()}, #shard{}) ->
    {noreply, #shard{}}.
handle_cast({run, Until, Stop}, #shard{steps = Steps} = Shard) ->
    {noreply, Shard#shard{steps = starl_sim_lockstep:run(Until, Stop, Steps)}}.

-spec handle_info(starl_sim_lockstep:message(), #shard{}) -> {noreply, #shard{}}.
handle_info(Message, #shard{steps = Steps} = Shard) ->
    {noreply, Shard#shard{steps = starl_sim_lockstep:hear(Message, Steps)}}.

%% -- starting -------------------------------------------------------------------------------

launched(Sight, Load, #shard{steps = Steps, world = World} = Shard) ->
    #{faults := Faults, running := Running, peers := Peers, owners := Owners} = Load,
    Mail = starl_sim_mail:new(Peers, Owners),
    Solid = starl_sim_lockstep:solid(World, Steps),
    Shard#shard{steps = starl_sim_lockstep:launch(Running, Faults, {Sight, Mail}, Solid)}.

start_robot({Id, _Pose} = Placed, Crew, World, Shard) ->
    Robot = new_robot(Placed, Crew, World, Shard),
    case starl_sim_branch:of_robot(Id, World) of
        none -> {Id, Robot};
        {N, Later} -> {Id, starl_sim_robot:branch_after(N, Later, Robot)}
    end.

new_robot({Id, Pose}, #{kind := Kind, tree := Tree}, World, _Shard) ->
    Kind:new(Id, Pose, Tree, World);
new_robot({Id, Pose}, #{tree := Tree, inline := Inline}, World, Shard) ->
    {Processes, Machines} = starl_robot_tree:launch(Id, starter(Id, Tree, Shard), Inline),
    Body = starl_sim_platform:new(Id, Pose, World),
    starl_sim_robot:new(Id, Body, Machines, Processes).

%% start_child returns when the whole tree has started, so all attach messages are here then.
starter(_Id, none, _Shard) ->
    none;
starter(Id, Tree, #shard{robots_sup = Sup}) ->
    Spec = Tree#{id => Id, driver => self()},
    fun() ->
        {ok, Pid} = supervisor:start_child(Sup, [Spec]),
        _ = erlang:monitor(process, Pid),
        {Pid, starl_robot_sup:parts(Pid)}
    end.
