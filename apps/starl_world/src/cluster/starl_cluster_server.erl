%% @doc The process of a cluster ({@link starl_cluster}): opens the robots on their nodes, starts anew
%% what has ended or hangs, and does what hands, chaos and other terminals want. It waits for no node
%% ({@link starl_cluster_calls}).
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

%% What nodes are asked: at first, to be ready for a robot; to open it, with this code; to change their
%% air, and who waits for that, with the text of the answer; what they know of the others, and who wants to
%% know; to load code; to close their robots.
-type question() ::
    ready
    | {opened, starl:robot_id(), starl_reload:codes()}
    | {aired, gen_server:from() | none, unicode:chardata() | none}
    | {known, gen_server:from()}
    | loaded
    | {closed, gen_server:from()}.

-record(state, {
    world :: pid(),
    %% the process of the socket for commands
    control :: pid(),
    nodes :: starl_cluster_nodes:t(),
    calls = starl_cluster_calls:new() :: starl_cluster_calls:t(question()),
    watchdogs = starl_cluster_watchdog:new() :: starl_cluster_watchdog:t(),
    %% the robots whose nodes stand still, and nobody has halted them
    hanging = [] :: [starl:robot_id()],
    hands = starl_cluster_hands:new() :: starl_cluster_hands:t(),
    halts = starl_cluster_halts:new() :: starl_cluster_halts:t(),
    %% the modules of a robot's machines, and the reloads
    parts :: #{starl_machine:name() => module()},
    reloads :: starl_cluster_reload:t(),
    log :: fun((starl:robot_id(), logger:level(), binary()) -> term())
}).

%% The time after which a node that has ended is started anew.
-define(AGAIN_MS, 500).
%% The time within which the end of a node's process is known after its connection has gone.
-define(END_MS, 2000).
%% The longest time to open a robot; to wait for answers to hands; to load code (a node that hangs is killed
%% before); to end a recording.
-define(OPEN_MS, 60000).
-define(ANSWER_MS, 2000).
-define(LOAD_MS, 15000).
-define(CLOSE_MS, 15000).
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
    Code = maps:get(code, Options, []),
    case starl_cluster_nodes:start([Id || {Id, _} <- Poses], Code) of
        {ok, Nodes} -> readied(Nodes, Code, Plan, Options);
        {error, Reason} -> {stop, {shutdown, {peers, Reason}}}
    end.

%% Nodes load all of their code before the time of the run begins.
readied(Nodes, Code, Plan, Options) ->
    Self = self(),
    Up = starl_cluster_nodes:up(Nodes),
    Ready = fun(Id, Node) -> fun() -> starl_cluster_node:ready(Node, Id, Code, Self) end end,
    Joined = lists:foldl(
        fun({Id, _}, Calls) -> starl_cluster_calls:joined(Id, Calls) end,
        starl_cluster_calls:new(),
        Up
    ),
    Wanted = [{Id, Ready(Id, Node)} || {Id, Node} <- Up],
    {[{ready, Answers}], Calls} = starl_cluster_calls:await(
        starl_cluster_calls:ask(ready, Wanted, ?OPEN_MS, Joined)
    ),
    case [{Id, Why} || {Id, _} <- Up, {error, Why} <- [result(Id, Answers)]] of
        [] ->
            controlled(Nodes, Calls, Plan, Options);
        [{Id, Why} | _] ->
            Known = known_end(Id, Why, Nodes),
            ok = starl_cluster_calls:stop(Calls),
            ok = starl_cluster_nodes:stop(Nodes),
            {stop, {shutdown, {robot, Id, Known}}}
    end.

controlled(Nodes, Calls, Plan, Options) ->
    Self = self(),
    Handler = fun(Words) -> gen_server:call(Self, {control, Words}, infinity) end,
    case starl_cluster_control:start_link(Handler) of
        {ok, Control} ->
            {Clock, State} = peopled(Plan, Control, Nodes, Options),
            ok = plan(maps:get(chaos, Options, []), Clock),
            all_opened(State#state{calls = Calls});
        {error, Why} ->
            ok = starl_cluster_calls:stop(Calls),
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
        nodes = starl_cluster_nodes:specified(Specs, Nodes),
        parts = starl_robot_crew:parts(Tree),
        reloads = starl_cluster_reload:new(maps:get(speed, Options, 1)),
        log = maps:get(log, Options, fun(_, _, _) -> ok end)
    }}.

plan(Chaos, Clock) ->
    Due = fun(At) -> starl_live_clock:monotonic_ms(At, Clock) end,
    _ = [erlang:send_after(Due(At), self(), {chaos, Act}, [{abs, true}]) || {At, Act} <- Chaos],
    ok.

%% A robot that cannot be opened at first will not be later.
all_opened(#state{nodes = Nodes} = State) ->
    #state{calls = Calls} =
        Asked = lists:foldl(fun opening/2, State, starl_cluster_nodes:ids(Nodes)),
    {Ended, Left} = starl_cluster_calls:await(Calls),
    case
        [
            {Id, Why}
         || {{opened, Id, _}, Answers} <- lists:sort(Ended), {error, Why} <- [result(Id, Answers)]
        ]
    of
        [] ->
            {ok, lists:foldl(fun done/2, Asked#state{calls = Left}, Ended)};
        [{Id, Why} | _] ->
            Known = known_end(Id, Why, Nodes),
            ok = terminate(not_opened, Asked),
            {stop, {shutdown, {robot, Id, Known}}}
    end.

%% Why a robot could not be opened, in words. Its node may have ended just now.
known_end(Id, ended, Nodes) ->
    Control = starl_cluster_nodes:control(Id, Nodes),
    receive
        {starl_peer_ended, Control, Status} -> ["its node ", starl_sim_peers:format_end(Status)]
    after ?END_MS -> "its node has ended"
    end;
known_end(_Id, Why, _Nodes) ->
    Why.

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
handle_call(close, From, State) ->
    {noreply, closing(From, all_go_on(State))};
handle_call(heal, From, State) ->
    {noreply, healed(From, none, State)};
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
handle_call({act, Act}, From, State) ->
    acted(Act, From, none, State).

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
handle_info({starl_peer_ended, Control, Status}, State) ->
    ok = ended(Control, Status, State),
    {noreply, State};
handle_info({chaos, Act}, State) ->
    {noreply, chaos(Act, State)};
handle_info({again, Id}, State) ->
    {noreply, again(Id, State)};
handle_info({starl_silent, Id, Watchdog, Word}, #state{watchdogs = Watchdogs} = State) ->
    case starl_cluster_watchdog:is_of(Id, Watchdog, Watchdogs) of
        true -> {noreply, silent(Word, Id, State)};
        false -> {noreply, State}
    end;
handle_info(Message, #state{calls = Calls} = State) ->
    case starl_cluster_calls:hear(Message, Calls) of
        {Ended, Left} -> {noreply, lists:foldl(fun done/2, State#state{calls = Left}, Ended)};
        unknown -> {noreply, hear(Message, State)}
    end.

hear(Message, #state{halts = Halts, reloads = Reloads} = State) ->
    case starl_cluster_halts:hear(Message, Halts) of
        {Told, Next} -> told(Told, State#state{halts = Next});
        unknown -> State#state{reloads = starl_cluster_reload:hear(Message, Reloads)}
    end.

-spec terminate(term(), #state{}) -> ok.
terminate(_Reason, #state{nodes = Nodes, halts = Halts, world = World} = State) ->
    ok = starl_cluster_control:close(),
    ok = starl_cluster_watchdog:stop(State#state.watchdogs),
    ok = starl_cluster_calls:stop(State#state.calls),
    _ = starl_cluster_halts:undo_all(Halts),
    ok = starl_cluster_nodes:stop(Nodes),
    true = unlink(World),
    true = exit(World, shutdown),
    ok.

%% -- hands and chaos ------------------------------------------------------------------------

command(status, From, #state{nodes = Nodes} = State) ->
    Calls = [
        {Id, fun() -> starl_cluster_node:peers(Node) end}
     || {Id, Node} <- starl_cluster_nodes:up(Nodes)
    ],
    {noreply, ask({known, From}, Calls, ?ANSWER_MS, State)};
command(stop, _From, #state{world = World} = State) ->
    {reply, {starl_world:stop(World), "the run ends\n"}, State};
command(heal, From, State) ->
    {noreply, healed(From, "healed", State)};
command({reload, Source}, From, State) ->
    reload([Source], #{}, From, State);
command({act, Act}, From, State) ->
    acted(Act, From, "done", State).

acted(Act, From, Text, State) ->
    case act(Act, State) of
        {ok, Next} -> {noreply, aired(starl_cluster_hands:links(Act), From, Text, Next)};
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
            aired(starl_cluster_hands:links(Aimed), none, none, Next)
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
        ok -> {ok, doomed(Act, State#state{hands = Next})};
        {error, _} = Error -> {Error, State}
    end.

doomed({Kill, Robot}, #state{nodes = Nodes} = State) when
    Kill =:= kill; Kill =:= lose_store; Kill =:= set_back
->
    State#state{nodes = starl_cluster_nodes:doom(Robot, Nodes)};
doomed(_Act, State) ->
    State.

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
does({FillOrClear, Robot}, Hands, State) when FillOrClear =:= fill; FillOrClear =:= clear ->
    #state{world = World, nodes = Nodes} = State,
    case starl_cluster_nodes:disk(FillOrClear, Robot, Nodes) of
        ok -> starl_world:fill(World, starl_cluster_hands:full(Hands));
        {error, _} = Error -> Error
    end;
does({sense, _Robot, _Sense, _Fault}, Hands, #state{world = World}) ->
    starl_world:senses(World, starl_cluster_hands:senses(Hands));
does({_FreezeOrThaw, _Robot}, Hands, #state{world = World}) ->
    starl_world:freeze(World, starl_cluster_hands:frozen(Hands));
does({_CutOrMend, _A, _B}, Hands, #state{world = World}) ->
    starl_world:cut(World, starl_cluster_hands:cuts(Hands)).

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

told({halted, Robot, Found}, #state{world = World} = State) ->
    logger:notice(#{what => node_halted, robot => Robot, found => Found}),
    ok = starl_world:halted(World, Robot),
    State;
told({resumed, Robot, Found, Callers}, #state{world = World} = State) ->
    ok = starl_world:resumed(World, Robot),
    lists:foreach(fun(From) -> gen_server:reply(From, {ok, Found}) end, Callers),
    watched(Robot, State).

goes_on(Robot, #state{halts = Halts} = State) ->
    gone_on(starl_cluster_halts:undo(Robot, Halts), State).

all_go_on(#state{halts = Halts} = State) -> gone_on(starl_cluster_halts:undo_all(Halts), State).

gone_on({Told, Halts}, State) -> lists:foldl(fun told/2, State#state{halts = Halts}, Told).

healed(From, Text, Standing) ->
    #state{world = World, nodes = Nodes, hands = Hands} = State = all_go_on(Standing),
    None = starl_cluster_hands:healed(Hands),
    Back = fun(Robot) -> ok = starl_world:cable(World, Robot, back) end,
    _ = [starl_cluster_nodes:disk(clear, R, Nodes) || R <- starl_cluster_hands:full(Hands)],
    ok = starl_world:fill(World, []),
    ok = starl_world:freeze(World, []),
    ok = starl_world:senses(World, []),
    ok = lists:foreach(Back, starl_cluster_hands:unplugged(Hands)),
    ok = starl_world:cut(World, starl_cluster_hands:cuts(None)),
    aired(starl_cluster_nodes:ids(Nodes), From, Text, State#state{hands = None}).

%% These robots, as far as their nodes are up, hear and sense what they are to now.
aired(Robots, From, Text, #state{nodes = Nodes, hands = Hands} = State) ->
    Calls = [
        {Id, air(Node, starl_cluster_hands:deaf(Id, Hands), starl_cluster_hands:senses(Id, Hands))}
     || {Id, Node} <- starl_cluster_nodes:up(Nodes), lists:member(Id, Robots)
    ],
    ask({aired, From, Text}, Calls, ?ANSWER_MS, State).

air(Node, Deaf, Senses) ->
    fun() ->
        ok = starl_cluster_node:set_air(Node, #{cut => Deaf}),
        starl_cluster_node:set_senses(Node, Senses)
    end.

%% -- nodes and their code -------------------------------------------------------------------

reload(Sources, Options, From, #state{parts = Parts, nodes = Nodes, reloads = Reloads} = State) ->
    case starl_cluster_reload:start(Sources, Options, Parts, From, Reloads) of
        {ok, Code, Next} ->
            Load = fun(Node) -> fun() -> starl_cluster_node:load(Node, Code) end end,
            Calls = [{Id, Load(Node)} || {Id, Node} <- starl_cluster_nodes:up(Nodes)],
            {noreply, ask(loaded, Calls, ?LOAD_MS, State#state{reloads = Next})};
        {error, _} = Error ->
            {reply, Error, State}
    end.

%% A node that was started anew meanwhile has the former code: it is started once more.
loaded(Answers, #state{nodes = Nodes, reloads = Before} = State) ->
    Reloads = starl_cluster_reload:loaded(Answers, Before),
    Renewed = starl_cluster_reload:codes(Reloads) =/= starl_cluster_reload:codes(Before),
    Late = [Robot || Renewed, {Robot, down} <- maps:to_list(Answers)],
    _ = [starl_cluster_nodes:kill(Robot, Nodes) || Robot <- Late],
    Doomed = lists:foldl(fun starl_cluster_nodes:doom/2, Nodes, Late),
    State#state{reloads = Reloads, nodes = Doomed}.

%% Opens the robot of a node that is ready. What hands do meanwhile is asked of the node after this.
opening(Id, State) -> opening(Id, fun(_Node) -> ok end, State).

%% The same on a node that has just been started.
reopening(Id, #state{nodes = Nodes, reloads = Reloads, calls = Calls} = State) ->
    Self = self(),
    Code = starl_cluster_nodes:code(Nodes) ++ starl_cluster_reload:code(Reloads),
    Ready = fun(Node) -> starl_cluster_node:ready(Node, Id, Code, Self) end,
    opening(Id, Ready, State#state{calls = starl_cluster_calls:joined(Id, Calls)}).

opening(Id, Ready, #state{world = World, nodes = Nodes, hands = Hands0} = State) ->
    #state{reloads = Reloads} = State,
    {Fate, Hands} = starl_cluster_hands:store(Id, Hands0),
    Spec = starl_cluster_nodes:spec(Id, Nodes),
    ok = starl_cluster_store:before_start(Fate, Spec),
    Codes = starl_cluster_reload:codes(Reloads),
    Node = starl_cluster_nodes:name(Id, Nodes),
    Air = #{cut => starl_cluster_hands:deaf(Id, Hands)},
    Senses = starl_cluster_hands:senses(Id, Hands),
    Open = fun() ->
        case Ready(Node) of
            ok ->
                ok = starl_world:clock(World, Id, starl_cluster_node:ahead_us(Node)),
                starl_cluster_node:open(Node, Spec#{codes => Codes}, Air, Senses);
            {error, _} = Error ->
                Error
        end
    end,
    ask({opened, Id, Codes}, [{Id, Open}], ?OPEN_MS, State#state{hands = Hands}).

ask(Question, Wanted, LimitMs, #state{calls = Calls} = State) ->
    State#state{calls = starl_cluster_calls:ask(Question, Wanted, LimitMs, Calls)}.

%% The nodes have answered a question, or have not within its time.
done({{opened, Id, Codes}, Answers}, State) ->
    opened(Id, Codes, result(Id, Answers), State);
done({{aired, From, Text}, Answers}, State) ->
    _ = [gen_server:reply(From, heard(Text, Answers)) || From =/= none],
    State;
done({{known, From}, Answers}, State) ->
    Peers = maps:from_list([{Id, Known} || {Id, {ok, Known}} <- maps:to_list(Answers)]),
    ok = gen_server:reply(From, {ok, starl_cluster_command:described(status(State), Peers)}),
    State;
done({loaded, Answers}, State) ->
    loaded(Answers, State);
done({{closed, From}, _Answers}, State) ->
    ok = gen_server:reply(From, ok),
    State.

result(Id, Answers) ->
    case Answers of
        #{Id := {ok, Result}} -> Result;
        #{Id := silent} -> {error, "its node does not answer"};
        #{Id := down} -> down
    end.

heard(none, _Answers) ->
    ok;
heard(Text, Answers) ->
    {ok, [Text, starl_cluster_command:unheard([Id || {Id, silent} <- maps:to_list(Answers)]), "\n"]}.

opened(Id, Codes, {ok, Links}, #state{reloads = Reloads} = State) ->
    case starl_cluster_reload:codes(Reloads) of
        Codes ->
            Rejoined = starl_cluster_reload:rejoined(Id, Links, Reloads),
            watched(Id, State#state{reloads = Rejoined});
        _Newer ->
            not_opened(Id, "there is newer code", State)
    end;
opened(Id, _Codes, {error, Why}, State) ->
    not_opened(Id, Why, State);
opened(_Id, _Codes, down, State) ->
    State.

not_opened(Id, Why, #state{nodes = Nodes} = State) ->
    Line = unicode:characters_to_binary(known_end(Id, Why, Nodes)),
    logger:error(#{what => robot_not_started, robot => Id, why => Line}),
    later(Id, left(Id, State#state{nodes = starl_cluster_nodes:drop(Id, Nodes)})).

%% A recording of a robot that is closed may take long to end.
closing(From, #state{nodes = Nodes, watchdogs = Watchdogs} = State) ->
    ok = starl_cluster_watchdog:stop(Watchdogs),
    Close = fun(Node) -> fun() -> starl_cluster_node:close(Node) end end,
    Calls = [
        {Id, Close(Node)}
     || {Id, Node} <- starl_cluster_nodes:up(Nodes),
        is_map_key(recorder, starl_cluster_nodes:spec(Id, Nodes))
    ],
    ask({closed, From}, Calls, ?CLOSE_MS, State#state{watchdogs = starl_cluster_watchdog:new()}).

%% -- nodes that hang or have ended ----------------------------------------------------------

watched(Id, #state{nodes = Nodes, watchdogs = Watchdogs} = State) ->
    case starl_cluster_nodes:name(Id, Nodes) of
        none -> State;
        Node -> State#state{watchdogs = starl_cluster_watchdog:watch(Id, Node, Watchdogs)}
    end.

%% A halt by hand or chaos has its time. Of any other the world is told in the same way: nobody is
%% accused of what a node that hangs has not done.
-spec silent(starl_cluster_watchdog:word(), starl:robot_id(), #state{}) -> #state{}.
silent(Word, Id, #state{nodes = Nodes, halts = Halts} = State) ->
    case {Word, starl_cluster_halts:is_halted(Id, Halts)} of
        {doubtful, false} ->
            hangs(Id, State);
        {back, _} ->
            hangs_no_more(Id, State);
        {silent, false} ->
            logger:error(#{what => node_silent, robot => Id, then => killed_and_started_anew}),
            _ = starl_cluster_nodes:kill(Id, Nodes),
            State#state{nodes = starl_cluster_nodes:doom(Id, Nodes)};
        {doubtful, true} ->
            State;
        {silent, true} ->
            watched(Id, State)
    end.

hangs(Id, #state{world = World, hanging = Hanging} = State) ->
    ok = starl_world:halt(World, Id),
    ok = starl_world:halted(World, Id),
    State#state{hanging = [Id | lists:delete(Id, Hanging)]}.

hangs_no_more(Id, #state{world = World, hanging = Hanging} = State) ->
    _ = [ok = starl_world:resumed(World, Id) || lists:member(Id, Hanging)],
    State#state{hanging = lists:delete(Id, Hanging)}.

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

%% A signal is told, unless it came from here.
ended(Control, Status, #state{nodes = Nodes, log = Log}) ->
    case starl_cluster_nodes:of_control(Control, Nodes) of
        {ok, Id} ->
            Level = level(Status, starl_cluster_nodes:is_doomed(Id, Nodes)),
            Line = ["its node ", starl_sim_peers:format_end(Status)],
            _ = Log(Id, Level, unicode:characters_to_binary(Line)),
            ok;
        none ->
            ok
    end.

level(Status, false) when Status > 128 -> error;
level(_Status, _IsDoomed) -> notice.

lost(Id, Before) ->
    logger:notice(#{what => node_ended, robot => Id}),
    #state{nodes = Nodes, reloads = Reloads} = State = hangs_no_more(Id, goes_on(Id, Before)),
    later(
        Id,
        left(Id, State#state{
            nodes = starl_cluster_nodes:lost(Id, Nodes),
            reloads = starl_cluster_reload:lost(Id, Reloads)
        })
    ).

%% Nobody asks the node of a robot any more.
left(Id, #state{calls = Calls, watchdogs = Watchdogs} = State) ->
    {Ended, Left} = starl_cluster_calls:lost(Id, Calls),
    Next = State#state{calls = Left, watchdogs = starl_cluster_watchdog:leave(Id, Watchdogs)},
    lists:foldl(fun done/2, Next, Ended).

later(Id, State) ->
    _ = erlang:send_after(?AGAIN_MS, self(), {again, Id}),
    State.

%% A disk that is full stays so.
again(Id, #state{nodes = Nodes, hands = Hands} = State) ->
    Disk =
        case lists:member(Id, starl_cluster_hands:full(Hands)) of
            true -> fill;
            false -> clear
        end,
    case starl_cluster_nodes:again(Id, Disk, Nodes) of
        {ok, Up} ->
            reopening(Id, State#state{nodes = Up});
        {error, Reason} ->
            logger:error(#{what => node_not_started, robot => Id, why => Reason}),
            later(Id, State)
    end.
