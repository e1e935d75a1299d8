%% @doc The process of a cluster ({@link starl_cluster}): opens the robots on their nodes, starts anew
%% what has ended or hangs, and does what hands, chaos and other terminals want. It waits for no node
%% ({@link starl_cluster_calls}).
-module(starl_cluster_server).
-behaviour(gen_server).

-export([start_link/3, most_halted_ms/0]).
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
    clock :: starl_live_clock:t(),
    speed :: number(),
    faults :: starl_world_faults:t(),
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

%% @doc The longest that a node can be halted, by the computer's clock.
-spec most_halted_ms() -> pos_integer().
most_halted_ms() -> 1000 * ?MOST_HALTED_S.

%% @doc Starts the nodes, the world and the robots of a plan; plays its schedule of faults.
-spec start_link(starl_run_plan:t(), [starl_run_fault:t()], starl_cluster:options()) ->
    gen_server:start_ret().
start_link(Plan, Schedule, Options) ->
    gen_server:start_link(?MODULE, {Plan, Schedule, Options}, [{timeout, infinity}]).

-spec init({starl_run_plan:t(), [starl_run_fault:t()], starl_cluster:options()}) ->
    {ok, #state{}} | {stop, {shutdown, reason()}}.
init({#{robots := Poses} = Plan, Schedule, Options}) ->
    process_flag(trap_exit, true),
    Code = maps:get(code, Options, []),
    case starl_cluster_nodes:start([Id || {Id, _} <- Poses], Code) of
        {ok, Nodes} -> readied(Nodes, Code, {Plan, Schedule}, Options);
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

controlled(Nodes, Calls, {Plan, Schedule}, Options) ->
    Self = self(),
    Handler = fun(Words) -> gen_server:call(Self, {control, Words}, infinity) end,
    case starl_cluster_control:start_link(Handler) of
        {ok, Control} ->
            State = peopled(Plan, Control, Nodes, Options),
            Chaos = maps:get(chaos, Options, []),
            ok = lists:foreach(fun({Us, H}) -> at(Us div 1000, {chaos, H}, State) end, Chaos),
            {AtOnce, InTime} = starl_world_faults:from_the_start(Schedule),
            ok = lists:foreach(fun(F) -> at(element(2, F), {begins, F}, State) end, InTime),
            all_opened(lists:foldl(fun at_once/2, State#state{calls = Calls}, AtOnce));
        {error, Why} ->
            ok = starl_cluster_calls:stop(Calls),
            ok = starl_cluster_nodes:stop(Nodes),
            {stop, {shutdown, {control, Why}}}
    end.

%% Nodes are told of it when they are asked to open.
at_once(Fault, State) ->
    case begins(Fault, State) of
        {ok, _Calls, Begun} -> Begun;
        {{error, Why}, _, _} -> not_played(Fault, Why, State)
    end.

%% The world, and what its robots start with.
peopled(#{tree := Tree} = Plan, Control, Nodes, #{transport := Transport} = Options) ->
    Names = starl_cluster_nodes:names(Nodes),
    #{world := World, clock := Clock} =
        Stage = starl_world_stage:open(Plan, {Transport, Names}, Options),
    Specs = [
        {Id, starl_world_stage:robot_on_node(Id, self(), Stage)}
     || Id <- starl_cluster_nodes:ids(Nodes)
    ],
    Speed = maps:get(speed, Options, 1),
    #state{
        world = World,
        control = Control,
        clock = Clock,
        speed = Speed,
        faults = starl_world_faults:new(starl_cluster_nodes:ids(Nodes)),
        nodes = starl_cluster_nodes:specified(Specs, Nodes),
        parts = starl_robot_crew:parts(Tree),
        reloads = starl_cluster_reload:new(Speed),
        log = maps:get(log, Options, fun(_, _, _) -> ok end)
    }.

%% This process gets a message at this time of the run.
at(Ms, Message, #state{clock = Clock}) ->
    At = starl_live_clock:monotonic_ms(1000 * Ms, Clock),
    _ = erlang:send_after(At, self(), Message, [{abs, true}]),
    ok.

now_ms(#state{clock = Clock}) -> starl_live_clock:now_us(Clock) div 1000.

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
handle_call({heal, What}, From, State) ->
    {noreply, healed(What, From, none, State)};
handle_call({place, Robot}, _From, #state{nodes = Nodes} = State) ->
    {reply, known([Robot], State, fun() -> {ok, place(Robot, Nodes)} end), State};
handle_call({halted, Robot, Seconds}, From, State) ->
    Hand = {pause, Robot, #{at_work => true}, round(1000 * Seconds)},
    case hands([Hand], State) of
        {ok, _Calls, #state{halts = Halts} = Next} ->
            {noreply, Next#state{halts = starl_cluster_halts:wait(Robot, From, Halts)}};
        {{error, _} = Error, _Calls, _} ->
            {reply, Error, State}
    end;
handle_call({act, Hands}, From, State) ->
    acted(Hands, From, none, State).

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
handle_info({chaos, Hand}, State) ->
    {noreply, chaos(Hand, State)};
handle_info({begins, Fault}, State) ->
    {noreply, scheduled(Fault, State)};
handle_info({over, Id}, State) ->
    {Calls, Next} = over(Id, {[], State}),
    {noreply, changed(Calls, none, none, Next)};
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
command({heal, What}, From, State) ->
    {noreply, healed(What, From, "healed", State)};
command({reload, Source}, From, State) ->
    reload([Source], #{}, From, State);
command({act, Hands}, From, State) ->
    acted(Hands, From, "done", State).

acted(Hands, From, Text, State) ->
    case hands(Hands, State) of
        {ok, Calls, Next} -> {noreply, changed(Calls, From, Text, Next)};
        {{error, _} = Error, _Calls, _Next} -> {reply, Error, State}
    end.

%% The first that cannot be done is the answer; all are of the same kind, for the same robots.
hands(Hands, State) ->
    Named = lists:usort(lists:append([starl_run_hand:robots(Hand) || Hand <- Hands])),
    case known(Named, State, fun() -> ok end) of
        ok -> hands(Hands, [], State);
        {error, _} = Error -> {Error, [], State}
    end.

hands([], Calls, State) ->
    {ok, Calls, State};
hands([Hand | More], Calls, #state{faults = Faults, speed = Speed} = State) ->
    {Fault, Named} = starl_world_faults:named(Hand, now_ms(State), Speed, Faults),
    case can(Fault, State) of
        ok ->
            case begins(Fault, State#state{faults = Named}) of
                {ok, Own, Next} -> hands(More, Own ++ Calls, Next);
                {{error, _}, _, _} = Error -> Error
            end;
        {error, _} = Error ->
            {Error, Calls, State}
    end.

chaos(Hand, #state{world = World} = State) ->
    #{leader := Leader} = starl_world:status(World),
    case starl_cluster_chaos:aimed(Hand, Leader) of
        none ->
            State;
        Aimed ->
            logger:notice(#{what => chaos, act => Aimed}),
            case hands([Aimed], State) of
                {ok, Calls, Next} -> changed(Calls, none, none, Next);
                {{error, _}, _, _} -> State
            end
    end.

%% A node that is down is not there to be halted, but may well stay down for longer.
scheduled(Fault, State) ->
    case {element(4, Fault), can(Fault, State)} of
        {Kind, {error, Why}} when Kind =:= pause; Kind =:= store_full ->
            not_played(Fault, Why, State);
        _ ->
            played(begins(Fault, State), Fault, State)
    end.

played({ok, Calls, Next}, _Fault, _State) -> changed(Calls, none, none, Next);
played({{error, Why}, _, _}, Fault, State) -> not_played(Fault, Why, State).

not_played(Fault, Why, State) ->
    Line = unicode:characters_to_binary(Why),
    logger:warning(#{what => fault_not_played, fault => Fault, why => Line}),
    State.

%% Those that lead to nothing where a node is down.
can({_, From, To, pause, Robot, _}, #state{speed = Speed} = State) ->
    can_halt(Robot, (To - From) / 1000 / Speed, State);
can({_, _, _, Kind, Robot, _}, #state{nodes = Nodes}) when
    Kind =:= reboot; Kind =:= kill_robot; Kind =:= store_lost; Kind =:= store_set_back
->
    case starl_cluster_nodes:name(Robot, Nodes) of
        none -> {error, io_lib:format("the node of robot ~b is down already", [Robot])};
        _ -> ok
    end;
can({_, _, _, store_full, _, _}, _State) ->
    starl_cluster_quota:is_possible();
can(_Fault, _State) ->
    ok.

%% Gives the calls to nodes that have to be told of it, too.
begins(Fault, #state{faults = Faults} = State) ->
    {Told, Effects, Next} = starl_world_faults:begins(Fault, now_ms(State), Faults),
    case told_world(Told, State) of
        ok -> effects(Effects, {ok, [], State#state{faults = Next}});
        {error, _} = Error -> {Error, [], State}
    end.

told_world([], _State) ->
    ok;
told_world([Told | More], #state{world = World} = State) ->
    case starl_world:fault(World, Told) of
        ok -> told_world(More, State);
        {error, _} = Error -> Error
    end.

over(Id, {Calls, #state{faults = Faults} = State}) ->
    {Told, Effects, Next} = starl_world_faults:over(Id, now_ms(State), Faults),
    _ = told_world(Told, State),
    {_, Own, Last} = effects(Effects, {ok, [], State#state{faults = Next}}),
    {Own ++ Calls, Last}.

effects(Effects, Begun) -> lists:foldl(fun does/2, Begun, Effects).

-spec does(starl_world_faults:effect(), {Answer, Calls, #state{}}) -> {Answer, Calls, #state{}} when
    Answer :: ok | {error, unicode:chardata()},
    Calls :: [{starl:robot_id(), tell | {kill, starl_machine:name()}}].
does({kill, Robot}, {Answer, Calls, #state{nodes = Nodes} = State}) ->
    %% one that is down has nothing to lose
    _ = starl_cluster_nodes:kill(Robot, Nodes),
    {Answer, Calls, State#state{nodes = starl_cluster_nodes:doom(Robot, Nodes)}};
does({start, Robot}, {Answer, Calls, State}) ->
    {Answer, Calls, again(Robot, State)};
does({dead, Robot}, {Answer, Calls, #state{world = World} = State}) ->
    ok = starl_world:dead(World, Robot),
    {Answer, Calls, State};
does({halt, Robot, Ms, Moment, Fault}, {Answer, Calls, #state{speed = Speed} = State}) ->
    #{Robot := OsPid} = starl_cluster_nodes:os_pids(State#state.nodes),
    {Answer, Calls, halt(Robot, {OsPid, max(1, round(Ms / Speed))}, {Moment, Fault}, State)};
does({machine, Robot, Name}, {Answer, Calls, State}) ->
    {Answer, [{Robot, {kill, Name}} | Calls], State};
does({tell, Robots}, {Answer, Calls, State}) ->
    {Answer, [{Robot, tell} || Robot <- Robots] ++ Calls, State};
does({due, Ms, Id}, {Answer, Calls, State}) ->
    ok = at(Ms, {over, Id}, State),
    {Answer, Calls, State};
does({FillOrClear, Robot}, {Answer, Calls, #state{nodes = Nodes} = State}) ->
    Filled = starl_cluster_nodes:disk(FillOrClear, Robot, Nodes),
    {lists:max([Answer, Filled]), Calls, State}.

known(Robots, #state{nodes = Nodes}, Then) ->
    case Robots -- starl_cluster_nodes:ids(Nodes) of
        [] -> Then();
        [Robot | _] -> {error, io_lib:format("there is no robot ~b", [Robot])}
    end.

can_halt(_Robot, Seconds, _State) when Seconds * 1000 < 1; Seconds > ?MOST_HALTED_S ->
    {error, io_lib:format("a node can be halted for 0.001 to ~b s", [?MOST_HALTED_S])};
can_halt(Robot, _Seconds, #state{nodes = Nodes, halts = Halts}) ->
    case {starl_cluster_halts:is_halted(Robot, Halts), starl_cluster_nodes:os_pids(Nodes)} of
        {true, _} -> {error, io_lib:format("the node of robot ~b stands still already", [Robot])};
        {false, #{Robot := _}} -> ok;
        {false, #{}} -> {error, io_lib:format("the node of robot ~b is down", [Robot])}
    end.

halt(Robot, For, {Moment, Fault}, #state{world = World, halts = Halts} = State) ->
    ok = starl_world:halt(World, Robot, Fault),
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

healed(What, From, Text, Standing) ->
    #state{nodes = Nodes, faults = Faults} = State = go_on(What, Standing),
    {Calls, Healed} = lists:foldl(
        fun over/2, {[], State}, starl_world_faults:healable(What, Faults)
    ),
    All = [{Id, tell} || What =:= all, Id <- starl_cluster_nodes:ids(Nodes)],
    changed(All ++ Calls, From, Text, Healed).

go_on(all, State) -> all_go_on(State);
go_on(_What, State) -> State.

%% These robots, as far as their nodes are up, hear and sense what they are to now, and lose their machines.
changed(Wanted, From, Text, #state{nodes = Nodes, faults = Faults, speed = Speed} = State) ->
    Up = maps:from_list(starl_cluster_nodes:up(Nodes)),
    Calls = [
        {Id,
            call(What, Node, {
                starl_world_faults:air(Id, Speed, Faults), starl_world_faults:senses(Id, Faults)
            })}
     || {Id, What} <- lists:usort(Wanted), #{Id := Node} <- [Up]
    ],
    ask({aired, From, Text}, Calls, ?ANSWER_MS, State).

call(tell, Node, {Air, Senses}) ->
    fun() ->
        ok = starl_cluster_node:set_air(Node, Air),
        starl_cluster_node:set_senses(Node, Senses)
    end;
call({kill, Name}, Node, _Changes) ->
    fun() -> starl_cluster_node:kill(Node, Name) end.

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

opening(Id, Ready, #state{world = World, nodes = Nodes, faults = Before} = State) ->
    #state{reloads = Reloads, speed = Speed} = State,
    {Fate, Faults} = starl_world_faults:fate(Id, Before),
    Spec = starl_cluster_nodes:spec(Id, Nodes),
    ok = starl_world_store:before_start(Fate, Spec),
    Codes = starl_cluster_reload:codes(Reloads),
    Node = starl_cluster_nodes:name(Id, Nodes),
    Air = starl_world_faults:air(Id, Speed, Faults),
    Senses = starl_world_faults:senses(Id, Faults),
    Open = fun() ->
        case Ready(Node) of
            ok ->
                ok = starl_world:clock(World, Id, starl_cluster_node:ahead_us(Node)),
                starl_cluster_node:open(Node, Spec#{codes => Codes}, Air, Senses);
            {error, _} = Error ->
                Error
        end
    end,
    ask({opened, Id, Codes}, [{Id, Open}], ?OPEN_MS, State#state{faults = Faults}).

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

opened(Id, Codes, {ok, Links}, #state{reloads = Reloads, faults = Faults} = State) ->
    case starl_cluster_reload:codes(Reloads) of
        Codes ->
            Rejoined = starl_cluster_reload:rejoined(Id, Links, Reloads),
            {Told, Up} = starl_world_faults:up(Id, now_ms(State), Faults),
            ok = told_world(Told, State),
            Watched = watched(Id, State#state{reloads = Rejoined, faults = Up}),
            %% A fault may have begun, or ended, since the node was asked to open.
            changed([{Id, tell}], none, none, Watched);
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

hangs(Id, #state{world = World, hanging = Hanging, faults = Faults} = State) ->
    {Fault, Named} = starl_world_faults:unnamed("hang", Faults),
    ok = starl_world:halt(World, Id, Fault),
    ok = starl_world:halted(World, Id),
    State#state{hanging = [Id | lists:delete(Id, Hanging)], faults = Named}.

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

%% A fault may keep it down, or has started it already. A disk that is full stays so.
again(Id, #state{nodes = Nodes, faults = Faults} = State) ->
    IsDown = starl_world_faults:is_down(Id, now_ms(State), Faults),
    case IsDown orelse starl_cluster_nodes:name(Id, Nodes) =/= none of
        true -> State;
        false -> started(Id, starl_cluster_nodes:again(Id, disk(Id, Faults), Nodes), State)
    end.

disk(Id, Faults) ->
    case starl_world_faults:is_full(Id, Faults) of
        true -> fill;
        false -> clear
    end.

started(Id, {ok, Up}, State) ->
    reopening(Id, State#state{nodes = Up});
started(Id, {error, Reason}, State) ->
    logger:error(#{what => node_not_started, robot => Id, why => Reason}),
    later(Id, State).
