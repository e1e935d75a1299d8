%% @doc The process of a cluster ({@link starl_cluster}): opens the robots on their nodes, starts anew
%% what has ended, and does what hands, chaos and other terminals want.
-module(starl_cluster_server).
-behaviour(gen_server).

-export([start_link/2]).
-export([init/1, handle_call/3, handle_cast/2, handle_info/2, terminate/2]).

-export_type([reason/0]).

%% Why there is no cluster: no nodes, no socket for commands; a robot that cannot be opened.
-type reason() ::
    {peers, starl_sim_peers:reason()}
    | {control, unicode:chardata()}
    | {robot, starl:robot_id(), unicode:chardata()}.

-record(state, {
    world :: pid(),
    %% the process of the socket for commands
    control :: pid(),
    nodes :: starl_cluster_nodes:t(),
    hands = starl_cluster_hands:new() :: starl_cluster_hands:t(),
    halts = starl_cluster_halts:new() :: starl_cluster_halts:t(),
    %% the modules of a robot's machines, and the reloads
    parts :: #{starl_machine:name() => module()},
    reloads :: starl_cluster_reload:t(),
    log :: fun((starl:robot_id(), logger:level(), binary()) -> term())
}).

%% The time after which a node that has ended is started anew.
-define(AGAIN_MS, 500).
-define(CALL_MS, 60000).
%% Less than three quarters of the time (60 s) after which Erlang's distribution gives up a silent node.
-define(MOST_HALTED_S, 30).

%% @doc Starts the nodes, the world and the robots of a plan.
-spec start_link(starl_sim_plan:t(), starl_cluster:options()) -> gen_server:start_ret().
start_link(Plan, Options) ->
    gen_server:start_link(?MODULE, {Plan, Options}, [{timeout, infinity}]).

-spec init({starl_sim_plan:t(), starl_cluster:options()}) ->
    {ok, #state{}} | {stop, {shutdown, reason()}}.
init({#{robots := Poses} = Plan, Options}) ->
    process_flag(trap_exit, true),
    case starl_cluster_nodes:start([Id || {Id, _} <- Poses]) of
        {ok, Nodes} -> controlled(Nodes, Plan, Options);
        {error, Reason} -> {stop, {shutdown, {peers, Reason}}}
    end.

controlled(Nodes, Plan, Options) ->
    Self = self(),
    Handler = fun(Words) -> gen_server:call(Self, {control, Words}, ?CALL_MS) end,
    case starl_cluster_control:start_link(Handler) of
        {ok, Control} ->
            {Clock, State} = peopled(Plan, Control, Nodes, Options),
            ok = plan(maps:get(chaos, Options, []), Clock),
            all_opened(starl_cluster_nodes:ids(Nodes), State);
        {error, Why} ->
            ok = starl_cluster_nodes:stop(Nodes),
            {stop, {shutdown, {control, Why}}}
    end.

%% The world, and what its robots start with.
peopled(#{crew := #{tree := Tree}} = Plan, Control, Nodes, #{transport := Transport} = Options) ->
    Names = starl_cluster_nodes:names(Nodes),
    #{world := World, clock := Clock} =
        Stage = starl_world_stage:open(Plan, {Transport, Names}, Options),
    Specs = [
        {Id, starl_world_stage:robot_on_node(Id, self(), Stage)}
     || Id <- starl_cluster_nodes:ids(Nodes)
    ],
    {Clock, #state{
        world = World,
        control = Control,
        nodes = starl_cluster_nodes:specified(Specs, maps:get(code, Options, []), Nodes),
        parts = starl_robot_crew:parts(Tree),
        reloads = starl_cluster_reload:new(maps:get(speed, Options, 1)),
        log = maps:get(log, Options, fun(_, _, _) -> ok end)
    }}.

plan(Chaos, Clock) ->
    Due = fun(At) -> starl_live_clock:monotonic_ms(At, Clock) end,
    _ = [erlang:send_after(Due(At), self(), {chaos, Act}, [{abs, true}]) || {At, Act} <- Chaos],
    ok.

%% A robot that cannot be opened at first will not be later.
all_opened([], State) ->
    {ok, State};
all_opened([Id | Ids], State) ->
    case opened(Id, State) of
        {ok, Next} ->
            all_opened(Ids, Next);
        {error, Why} ->
            ok = terminate(not_opened, State),
            {stop, {shutdown, {robot, Id, Why}}}
    end.

-spec handle_call(term(), gen_server:from(), #state{}) ->
    {reply, term(), #state{}} | {noreply, #state{}}.
handle_call({reload, Sources, Options}, From, State) ->
    reload(Sources, Options, From, State);
handle_call({control, Words}, From, State) ->
    case starl_cluster_command:parse(Words) of
        {ok, Command} -> command(Command, From, State);
        {error, _} = Error -> {reply, Error, State}
    end;
handle_call(world, _From, #state{world = World} = State) ->
    {reply, World, State};
handle_call(status, _From, State) ->
    {reply, status(State), State};
handle_call(close, _From, State) ->
    #state{nodes = Nodes} = Moving = all_go_on(State),
    {reply, starl_cluster_nodes:close(Nodes), Moving};
handle_call(heal, _From, State) ->
    {reply, ok, healed(State)};
handle_call({place, Robot}, _From, #state{nodes = Nodes} = State) ->
    {reply, known([Robot], State, fun() -> {ok, place(Robot, Nodes)} end), State};
handle_call({halted, Pause}, From, State) ->
    case act(Pause, State) of
        {ok, #state{halts = Halts} = Next} ->
            Waiting = starl_cluster_halts:wait(element(2, Pause), From, Halts),
            {noreply, Next#state{halts = Waiting}};
        {{error, _} = Error, _} ->
            {reply, Error, State}
    end;
handle_call({act, Act}, _From, State) ->
    {Answer, Next} = act(Act, State),
    {reply, Answer, Next}.

status(#state{world = World, nodes = Nodes}) ->
    maps:merge(starl_world:status(World), #{
        restarts => starl_cluster_nodes:restarts(Nodes),
        os_pids => starl_cluster_nodes:os_pids(Nodes)
    }).

place(Robot, Nodes) ->
    #{transport := Line} = starl_cluster_nodes:spec(Robot, Nodes),
    #{node => starl_cluster_nodes:name(Robot, Nodes), transport => Line}.

-spec handle_cast(term(), #state{}) -> {noreply, #state{}}.
handle_cast(_Request, State) -> {noreply, State}.

-spec handle_info(term(), #state{}) -> {noreply, #state{}} | {stop, term(), #state{}}.
handle_info({starl_log, Id, Level, Line}, #state{log = Log} = State) ->
    _ = Log(Id, Level, Line),
    {noreply, State};
handle_info({'EXIT', Pid, Reason}, State) ->
    exited(Pid, Reason, State);
handle_info({chaos, Act}, State) ->
    {noreply, chaos(Act, State)};
handle_info({again, Id}, State) ->
    {noreply, again(Id, State)};
handle_info(Message, #state{halts = Halts, reloads = Reloads} = State) ->
    case starl_cluster_halts:hear(Message, Halts) of
        {Told, Next} ->
            ok = told(Told, State),
            {noreply, State#state{halts = Next}};
        unknown ->
            {noreply, State#state{reloads = starl_cluster_reload:hear(Message, Reloads)}}
    end.

-spec terminate(term(), #state{}) -> ok.
terminate(_Reason, #state{nodes = Nodes, halts = Halts, world = World}) ->
    ok = starl_cluster_control:close(),
    _ = starl_cluster_halts:undo_all(Halts),
    ok = starl_cluster_nodes:stop(Nodes),
    true = unlink(World),
    true = exit(World, shutdown),
    ok.

%% -- hands and chaos ------------------------------------------------------------------------

command(status, _From, State) ->
    {reply, {ok, starl_cluster_command:described(status(State))}, State};
command(stop, _From, #state{world = World} = State) ->
    {reply, {starl_world:stop(World), "the run ends\n"}, State};
command(heal, _From, State) ->
    {reply, {ok, "healed\n"}, healed(State)};
command({reload, Source}, From, State) ->
    reload([Source], #{}, From, State);
command({act, Act}, _From, State) ->
    case act(Act, State) of
        {ok, Next} -> {reply, {ok, "done\n"}, Next};
        {{error, _} = Error, Next} -> {reply, Error, Next}
    end.

chaos(Act, #state{world = World} = State) ->
    #{leader := Leader} = starl_world:status(World),
    case starl_cluster_chaos:targets(Act, Leader) of
        none ->
            State;
        Aimed ->
            logger:notice(#{what => chaos, act => Aimed}),
            {_, Next} = act(Aimed, State),
            Next
    end.

%% An act that succeeds holds from now on. A halt holds for a time of its own.
act({Pause, Robot, Seconds}, State) when Pause =:= pause; Pause =:= pause_at_work ->
    case known([Robot], State, fun() -> can_halt(Robot, Seconds, State) end) of
        {ok, OsPid} -> {ok, halt(Robot, {OsPid, round(1000 * Seconds)}, moment(Pause), State)};
        {error, _} = Error -> {Error, State}
    end;
act(Act, #state{hands = Hands} = State) ->
    Next = starl_cluster_hands:done(Act, Hands),
    case known(starl_cluster_hands:robots(Act), State, fun() -> does(Act, Next, State) end) of
        ok -> {ok, State#state{hands = Next}};
        {error, _} = Error -> {Error, State}
    end.

known(Robots, #state{nodes = Nodes}, Then) ->
    case Robots -- starl_cluster_nodes:ids(Nodes) of
        [] -> Then();
        [Robot | _] -> {error, io_lib:format("there is no robot ~b", [Robot])}
    end.

does({kill, Robot}, _Hands, State) ->
    kill(Robot, kill_robot, State);
does({lose_store, Robot}, _Hands, State) ->
    kill(Robot, store_lost, State);
does({set_back, Robot}, _Hands, State) ->
    kill(Robot, store_set_back, State);
does({unplug, Robot}, _Hands, #state{world = World}) ->
    starl_world:cable(World, Robot, pulled);
does({unplug_in_time, Robot}, _Hands, #state{world = World}) ->
    starl_world:cable(World, Robot, pulled_in_time);
does({plug, Robot}, _Hands, #state{world = World}) ->
    starl_world:cable(World, Robot, back);
does({_FreezeOrThaw, _Robot}, Hands, #state{world = World}) ->
    starl_world:freeze(World, starl_cluster_hands:frozen(Hands));
does({_CutOrMend, A, B}, Hands, State) ->
    cut([A, B], Hands, State).

%% What has to become of the store stands in the hands until the node is started anew.
kill(Robot, Fault, #state{nodes = Nodes, world = World}) ->
    case starl_cluster_nodes:kill(Robot, Nodes) of
        ok -> starl_world:struck(World, Fault, Robot);
        {error, _} = Error -> Error
    end.

can_halt(_Robot, Seconds, _State) when Seconds * 1000 < 1; Seconds > ?MOST_HALTED_S ->
    {error, io_lib:format("a node can be halted for 0.001 to ~b s", [?MOST_HALTED_S])};
can_halt(Robot, _Seconds, #state{nodes = Nodes, halts = Halts}) ->
    case {starl_cluster_halts:is_halted(Robot, Halts), starl_cluster_nodes:os_pids(Nodes)} of
        {true, _} -> {error, io_lib:format("the node of robot ~b stands still already", [Robot])};
        {false, #{Robot := OsPid}} -> {ok, OsPid};
        {false, #{}} -> {error, io_lib:format("the node of robot ~b is down", [Robot])}
    end.

moment(pause) -> now;
moment(pause_at_work) -> at_work.

halt(Robot, For, Moment, #state{world = World, halts = Halts} = State) ->
    ok = starl_world:halt(World, Robot),
    State#state{halts = starl_cluster_halts:halt(Robot, For, Moment, Halts)}.

told({halted, Robot, Found}, #state{world = World}) ->
    logger:notice(#{what => node_halted, robot => Robot, found => Found}),
    starl_world:halted(World, Robot);
told({resumed, Robot, Found, Callers}, #state{world = World}) ->
    ok = starl_world:resumed(World, Robot),
    lists:foreach(fun(From) -> gen_server:reply(From, {ok, Found}) end, Callers).

goes_on(Robot, #state{halts = Halts} = State) ->
    gone_on(starl_cluster_halts:undo(Robot, Halts), State).

all_go_on(#state{halts = Halts} = State) -> gone_on(starl_cluster_halts:undo_all(Halts), State).

gone_on({Told, Halts}, State) ->
    ok = lists:foreach(fun(Each) -> ok = told(Each, State) end, Told),
    State#state{halts = Halts}.

%% The robots hear what they are to hear now, and the world knows.
cut(Robots, Hands, #state{nodes = Nodes, world = World}) ->
    ok = starl_world:cut(World, starl_cluster_hands:cuts(Hands)),
    lists:foreach(
        fun(R) -> starl_cluster_nodes:deafen(R, starl_cluster_hands:deaf(R, Hands), Nodes) end,
        Robots
    ).

healed(Standing) ->
    #state{world = World, nodes = Nodes, hands = Hands} = State = all_go_on(Standing),
    None = starl_cluster_hands:healed(Hands),
    Back = fun(Robot) -> ok = starl_world:cable(World, Robot, back) end,
    ok = starl_world:freeze(World, []),
    ok = lists:foreach(Back, starl_cluster_hands:unplugged(Hands)),
    ok = cut(starl_cluster_nodes:ids(Nodes), None, State),
    State#state{hands = None}.

%% -- nodes and their code -------------------------------------------------------------------

reload(Sources, Options, From, #state{parts = Parts, nodes = Nodes, reloads = Reloads} = State) ->
    Up = [
        {Id, Node, Link}
     || {Id, Node} <- starl_cluster_nodes:up(Nodes), Link <- starl_cluster_node:robot_link(Node)
    ],
    case starl_cluster_reload:start(Sources, Options, {Parts, Up}, From, Reloads) of
        {ok, Next} -> {noreply, State#state{reloads = Next}};
        {error, _} = Error -> {reply, Error, State}
    end.

opened(Id, #state{nodes = Nodes, reloads = Reloads, hands = Hands0} = State) ->
    {Fate, Hands} = starl_cluster_hands:store(Id, Hands0),
    ok = starl_cluster_store:before_start(Fate, starl_cluster_nodes:spec(Id, Nodes)),
    New = {starl_cluster_reload:codes(Reloads), starl_cluster_reload:code(Reloads)},
    case starl_cluster_nodes:open(Id, New, Nodes) of
        {ok, Links} ->
            ok = starl_cluster_nodes:deafen(Id, starl_cluster_hands:deaf(Id, Hands), Nodes),
            {ok, State#state{
                reloads = starl_cluster_reload:rejoined(Id, Links, Reloads), hands = Hands
            }};
        {error, _} = Error ->
            Error
    end.

%% Of the processes that are linked, those of nodes may end.
exited(World, Reason, #state{world = World} = State) ->
    {stop, Reason, State};
exited(Control, Reason, #state{control = Control} = State) ->
    {stop, Reason, State};
exited(Pid, _Reason, #state{nodes = Nodes} = State) ->
    case starl_cluster_nodes:of_control(Pid, Nodes) of
        {ok, Id} -> {noreply, lost(Id, State)};
        none -> {noreply, State}
    end.

lost(Id, Before) ->
    logger:notice(#{what => node_ended, robot => Id}),
    #state{nodes = Nodes, reloads = Reloads} = State = goes_on(Id, Before),
    later(Id, State#state{
        nodes = starl_cluster_nodes:lost(Id, Nodes),
        reloads = starl_cluster_reload:lost(Id, Reloads)
    }).

later(Id, State) ->
    _ = erlang:send_after(?AGAIN_MS, self(), {again, Id}),
    State.

again(Id, #state{nodes = Nodes} = State) ->
    case starl_cluster_nodes:again(Id, Nodes) of
        {ok, Up} ->
            reopened(Id, State#state{nodes = Up});
        {error, Reason} ->
            logger:error(#{what => node_not_started, robot => Id, why => Reason}),
            later(Id, State)
    end.

reopened(Id, #state{nodes = Nodes} = State) ->
    case opened(Id, State) of
        {ok, Opened} ->
            Opened;
        {error, Why} ->
            Line = unicode:characters_to_binary(Why),
            logger:error(#{what => robot_not_started, robot => Id, why => Line}),
            later(Id, State#state{nodes = starl_cluster_nodes:drop(Id, Nodes)})
    end.
