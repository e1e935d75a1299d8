%% @doc The link of a live robot drives its {@link starl_robot} in real time. It passes the packets,
%% poses, answers of the chassis and timers that arrive to the robot's machines, one at a time.
%%
%% {@link starl_live_turns} handles them.
%%
%% <em>An old store.</em> If a peer has proved that the robot has had a later life than its store
%% knows, the link marks the store and ends.
%%
%% <em>Ends.</em> A crashed machine is restarted by its supervisor, and the link waits for that. The
%% link ends, and with it the whole robot, in three cases. The services have crashed too often, a
%% port of the robot (radio, positioning, chassis) ends, or the numbers of starts cannot be stored.
%% Then the chassis stops, and the supervisor above starts the robot anew, as after a reboot.
-module(starl_live_link).
-behaviour(gen_server).

-export([
    start_link/1,
    inspect/1,
    figures/1,
    metrics/1,
    line/2,
    reload/3,
    take_back/3,
    sense_faults/2,
    kill/2,
    mark/2
]).
-export([processes/1, at_work/1]).
-export([init/1, handle_continue/2, handle_call/3, handle_cast/2, handle_info/2]).

-export_type([spec/0, line/0, told/0]).

%% A line of the robot: the module of its driver, and the driver's own configuration.
-type line() :: {module(), map()}.

%% A robot: its machines ({@link starl_robot_crew:tree()}), the seed of its team, which is the same
%% for all robots and all their starts ({@link starl_machine:config()}), its lines, the senses that are not its
%% chassis', its clock, the directory of
%% its store, and the process that gets the facts, if any; `record': whether the facts are also
%% written to a file there (false); `codes': the code of machines that have been reloaded;
%% `reporter': who is told about reloads; `packets': whether the sink is told of all packets;
%% `observe': who else is told everything, on this node. `robot_sup' is the supervisor under which
%% the machines' processes start. A simulation gives a robot lines that are open already, lets its
%% machines run inline, but for a sequential application, gives them their random streams, and may be
%% told each fact at once instead of at the end of its step (`tell').
-type spec() :: #{
    robot := starl:robot_id(),
    robot_sup := pid(),
    tree := starl_robot_crew:tree(),
    team_seed := integer(),
    profile := starl_chassis:profile(),
    clock := starl_live_clock:t(),
    dir := starl_live_disk:place(),
    transport := line() | pid(),
    positioning := line() | pid(),
    chassis := line() | pid(),
    senses => #{starl_sense:kind() => line()},
    sink := pid() | none,
    record => boolean(),
    codes => starl_reload:codes(),
    reporter => pid(),
    packets => boolean(),
    observe => starl_observer:t(),
    inline => boolean(),
    random => starl_live_body:random(),
    tell => step | at_once
}.

%% A message to the sink: the names of the robot's machines, when it starts, and the file of its
%% record; the facts of its steps,
%% batch by batch; what it knows of packets; the end of its application.
-type told() ::
    {starl_started, starl:robot_id(), Link :: pid(), {
        [starl_machine:name()], file:filename() | none
    }}
    | {starl_traced, starl:robot_id(), Link :: pid(), starl_live_record:batch()}
    | {starl_radio, starl:robot_id(), [starl_monitor:trace_event()]}
    | {starl_ended, starl:robot_id(), Link :: pid(), given_up | {done, term()}}.

-record(link, {
    turns :: starl_live_turns:t(),
    clock :: starl_live_clock:t()
}).

%% @doc Starts the link, its lines, and then the robot's machines.
-spec start_link(spec()) -> gen_server:start_ret().
start_link(Spec) -> gen_server:start_link(?MODULE, Spec, []).

%% @doc The machines of the robot, each with its state and data.
-spec inspect(pid()) -> #{starl_machine:name() => starl_robot_tree:seen()}.
inspect(Link) -> gen_server:call(Link, inspect).

%% @doc The counters of the robot.
-spec figures(pid()) -> starl_live_body:figures().
figures(Link) -> gen_server:call(Link, figures).

%% @doc The counters of the robot since its link started, and its queues: for {@link
%% starl_live_counts:text/2}.
-spec metrics(pid()) -> {[starl_live_counts:gauge()], starl_live_counts:t()}.
metrics(Link) -> gen_server:call(Link, metrics).

%% @doc The process of one of the robot's lines.
-spec line(pid(), transport | positioning | chassis) -> pid().
line(Link, Line) -> gen_server:call(Link, {line, Line}).

%% @doc Gives the robot new code, whose modules are loaded. This process gets a report on how each
%% machine applies it: `{starl_reloaded, Robot, Machine, Told}' ({@link starl_reload:told()}).
-spec reload(pid(), starl_reload:order(), pid()) -> ok.
reload(Link, Order, Reporter) -> gen_server:cast(Link, {reload, Order, Reporter}).

%% @doc From now on the robot's senses have these faults, and no others.
-spec sense_faults(pid(), starl_live_sense_fault:faults()) -> ok.
sense_faults(Link, Faults) -> gen_server:cast(Link, {sense_faults, Faults}).

%% @doc Ends the process of a machine, as a crash does: its supervisor starts it anew.
-spec kill(pid(), starl_machine:name()) -> ok.
kill(Link, Name) -> gen_server:cast(Link, {kill, Name}).

%% @doc This process is sent `{starl_marked, Robot, Link, Mark}' behind all facts of what the robot has done until
%% now.
-spec mark(pid(), Mark :: term()) -> ok.
mark(Link, Mark) -> gen_server:cast(Link, {mark, self(), Mark}).

%% @doc The reload of this number has failed on that robot: this one goes back.
-spec take_back(pid(), starl_reload:count(), Failed :: starl:robot_id()) -> ok.
take_back(Link, N, Failed) -> gen_server:cast(Link, {take_back, N, Failed}).

%% @doc The processes of the robot's machines, for a simulation that holds the link's state.
-spec processes(#link{}) -> [pid()].
processes(#link{turns = Turns}) -> starl_live_turns:processes(Turns).

%% @doc Those of them that have an open order: what a simulation waits for.
-spec at_work(#link{}) -> [pid()].
at_work(#link{turns = Turns}) -> starl_live_turns:at_work(Turns).

-spec init(spec()) -> {ok, starl_live_launch:opened(), {continue, launch}} | {stop, term()}.
init(#{robot := Robot} = Spec) ->
    logger:set_process_metadata(#{domain => [starl, robot], robot => Robot}),
    case starl_live_launch:open(Spec) of
        {ok, Opened} -> {ok, Opened, {continue, launch}};
        {stop, Reason} -> {stop, Reason}
    end.

-spec handle_continue(launch, starl_live_launch:opened()) ->
    {noreply, #link{}} | {stop, term(), starl_live_launch:opened()}.
handle_continue(launch, #{clock := Clock, store := Store} = Opened) ->
    case starl_live_launch:machines(Opened) of
        {ok, Robot, Tree} ->
            Turns = starl_live_turns:new(Robot, Tree, Store),
            Link = #link{turns = Turns, clock = Clock},
            ok = watch_later(Link),
            {noreply, Link#link{turns = starl_live_turns:start(Turns)}};
        {stop, Reason} ->
            {stop, Reason, Opened}
    end.

watch_later(#link{clock = Clock}) ->
    _ = starl_live_clock:send_after(starl_live_watch:period_ms(), watch, Clock),
    ok.

-spec handle_call(inspect | figures | metrics | {line, atom()}, gen_server:from(), #link{}) ->
    {reply, term(), #link{}}.
handle_call(What, _From, #link{turns = Turns} = Link) ->
    {reply, told(What, starl_live_turns:robot(Turns), Turns), Link}.

told(metrics, Robot, Turns) ->
    Body = starl_live_body:at(starl_robot:world(Robot)),
    Counts = starl_live_body:counts(Body),
    Leases = starl_live_counts:leases(starl_live_body:now_us(Body), Counts),
    {starl_live_turns:gauges(Turns) ++ Leases, Counts};
told({line, Line}, Robot, _Turns) ->
    starl_live_body:line(Line, starl_robot:world(Robot));
told(inspect, Robot, _Turns) ->
    starl_robot_tree:inspect(starl_robot:machines(Robot));
told(figures, Robot, _Turns) ->
    starl_live_body:figures(starl_robot:world(Robot)).

-spec handle_cast(term(), #link{}) -> {noreply, #link{}}.
handle_cast({reload, _Order, _Reporter} = Reload, #link{turns = Turns} = Link) ->
    next(starl_live_turns:waits(Reload, Turns), Link);
handle_cast({take_back, _N, _Failed} = Back, #link{turns = Turns} = Link) ->
    next(starl_live_turns:waits(Back, Turns), Link);
handle_cast({mark, _From, _Mark} = Mark, #link{turns = Turns} = Link) ->
    next(starl_live_turns:waits(Mark, Turns), Link);
handle_cast({sense_faults, Faults}, #link{turns = Turns} = Link) ->
    next(starl_live_turns:sense_faults(Faults, Turns), Link);
handle_cast({kill, Name}, #link{turns = Turns} = Link) ->
    case starl_live_turns:machine(Name, Turns) of
        none -> ok;
        Pid -> true = exit(Pid, kill)
    end,
    {noreply, Link};
handle_cast(_Request, Link) ->
    {noreply, Link}.

-spec handle_info(term(), #link{}) -> {noreply, #link{}} | {stop, term(), #link{}}.
handle_info({starl_attach, _, Name, _} = Attach, #link{turns = Turns} = Link) ->
    %% the end of its predecessor is on its way
    case starl_live_turns:machine(Name, Turns) of
        none ->
            {noreply, Link};
        Before ->
            self() ! Attach,
            receive
                {'DOWN', _, process, Before, Reason} -> down(Before, Reason, Link)
            end
    end;
handle_info({'DOWN', _, process, Pid, Reason}, Link) ->
    down(Pid, Reason, Link);
handle_info(watch, #link{turns = Turns} = Link) ->
    ok = watch_later(Link),
    next(starl_live_turns:watch(Turns), Link);
handle_info(Message, #link{turns = Turns} = Link) ->
    next(hear(Message, Turns), Link).

hear({starl_done, _, Pid, Actions}, Turns) ->
    starl_live_turns:answered(Pid, Actions, Turns);
hear({timeout, _, {starl_timer, Name, Timer, Mark, Content}}, Turns) ->
    starl_live_turns:waits({timer, Name, Timer, Mark, Content}, Turns);
hear({starl_late, Owner}, Turns) ->
    starl_live_turns:late(Owner, Turns);
hear(Message, Turns) ->
    starl_live_turns:hear(Message, Turns).

next(Turns, Link) -> {noreply, Link#link{turns = Turns}}.

down(Pid, Reason, #link{turns = Turns} = Link) ->
    case starl_live_turns:down(Pid, Reason, Turns) of
        {ok, Next} -> next(Next, Link);
        {gave_up, Last} -> {stop, {shutdown, gave_up}, Link#link{turns = Last}}
    end.
