%% @doc The process of a cluster ({@link starl_cluster}). It opens the robots on their nodes,
%% restarts those that have ended or hang, and carries out manual faults, chaos and commands from
%% other terminals. It waits for no node ({@link starl_cluster_calls}).
-module(starl_cluster_server).
-behaviour(gen_server).

-export([start_link/3]).
-export([init/1, handle_call/3, handle_cast/2, handle_info/2, terminate/2]).

%% What nodes are asked: to open their robot, with this code; to change its air, and who waits for that, with
%% the text of the answer; what they know of the others, and who wants to know; to load code; to close their
%% robots.
-type question() ::
    {opened, starl:robot_id(), starl_reload:codes()}
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
    faults :: starl_cluster_faults:t(),
    %% the modules of a robot's machines, and the reloads
    parts :: #{starl_machine:name() => module()},
    reloads :: starl_cluster_reload:t(),
    log :: fun((starl:robot_id(), logger:level(), binary()) -> term())
}).

%% The time after which a node that has ended is started anew.
-define(AGAIN_MS, 500).
%% The longest time to open a robot; to wait for answers to hands; to load code (a node that hangs is killed
%% before); to end a recording.
-define(OPEN_MS, 60000).
-define(ANSWER_MS, 2000).
-define(LOAD_MS, 15000).
-define(CLOSE_MS, 15000).

%% @doc Starts the nodes, the world and the robots of a plan; plays its schedule of faults.
-spec start_link(starl_run_plan:t(), [starl_run_fault:t()], starl_cluster:options()) ->
    gen_server:start_ret().
start_link(Plan, Schedule, Options) ->
    gen_server:start_link(?MODULE, {Plan, Schedule, Options}, [{timeout, infinity}]).

-spec init({starl_run_plan:t(), [starl_run_fault:t()], starl_cluster:options()}) ->
    {ok, #state{}} | {stop, {shutdown, starl_cluster_start:reason()}}.
init({Plan, Schedule, Options}) ->
    process_flag(trap_exit, true),
    case starl_cluster_start:start(Plan, Schedule, Options) of
        {ok, Started} -> started(Started, maps:get(log, Options, fun(_, _, _) -> ok end));
        {error, Reason} -> {stop, {shutdown, Reason}}
    end.

started(#{world := World, control := Control, nodes := Nodes, speed := Speed} = Started, Log) ->
    #{calls := Calls, faults := Faults, parts := Parts} = Started,
    all_opened(#state{
        world = World,
        control = Control,
        nodes = Nodes,
        calls = Calls,
        faults = Faults,
        parts = Parts,
        reloads = starl_cluster_reload:new(Speed),
        log = Log
    }).

%% A robot that cannot be opened at first will not be later.
all_opened(#state{nodes = Nodes} = State) ->
    #state{calls = Calls} =
        Asked = lists:foldl(fun opening/2, State, starl_cluster_nodes:ids(Nodes)),
    {Ended, Left} = starl_cluster_calls:await(Calls),
    case
        [{Id, Why} || {{opened, Id, _}, A} <- lists:sort(Ended), {error, Why} <- [result(Id, A)]]
    of
        [] ->
            {ok, lists:foldl(fun done/2, Asked#state{calls = Left}, Ended)};
        [{Id, Why} | _] ->
            Known = starl_cluster_nodes:known_end(Id, Why, Nodes),
            ok = terminate(not_opened, Asked),
            {stop, {shutdown, {robot, Id, Known}}}
    end.

result(Id, Answers) -> starl_cluster_calls:result(Id, Answers).

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
handle_call(close, From, #state{faults = Faults} = State) ->
    {noreply, closing(From, faulted(starl_cluster_faults:all_go_on(Faults), State))};
handle_call({heal, What}, From, State) ->
    {noreply, healed(What, From, none, State)};
handle_call({place, Robot}, _From, #state{nodes = Nodes} = State) ->
    {reply, starl_cluster_nodes:place(Robot, Nodes), State};
handle_call({halted, Robot, Seconds}, From, #state{nodes = Nodes, faults = Faults} = State) ->
    case starl_cluster_faults:halt_at_work(Robot, Seconds, From, Nodes, Faults) of
        {ok, Next} -> {noreply, State#state{faults = Next}};
        {error, _} = Error -> {reply, Error, State}
    end;
handle_call({act, Hands}, From, State) ->
    acted(Hands, From, none, State).

status(#state{world = World, nodes = Nodes}) ->
    maps:merge(starl_world:status(World), #{
        restarts => starl_cluster_nodes:restarts(Nodes),
        os_pids => starl_cluster_nodes:os_pids(Nodes)
    }).

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
handle_info({again, Id}, State) ->
    {noreply, again(Id, State)};
handle_info({starl_silent, Id, Watchdog, Word}, State) ->
    #state{watchdogs = Watchdogs, faults = Faults} = State,
    case starl_cluster_watchdog:is_of(Id, Watchdog, Watchdogs) of
        true -> {noreply, faulted(starl_cluster_faults:silent(Word, Id, Faults), State)};
        false -> {noreply, State}
    end;
handle_info(Message, #state{calls = Calls} = State) ->
    case starl_cluster_calls:hear(Message, Calls) of
        {Ended, Left} -> {noreply, lists:foldl(fun done/2, State#state{calls = Left}, Ended)};
        unknown -> {noreply, hear(Message, State)}
    end.

hear(Message, #state{nodes = Nodes, faults = Faults, reloads = Reloads} = State) ->
    case starl_cluster_faults:hear(Message, Nodes, Faults) of
        unknown -> State#state{reloads = starl_cluster_reload:hear(Message, Reloads)};
        Heard -> faulted(Heard, State)
    end.

-spec terminate(term(), #state{}) -> ok.
terminate(_Reason, #state{nodes = Nodes, faults = Faults, world = World} = State) ->
    ok = starl_cluster_control:close(),
    ok = starl_cluster_watchdog:stop(State#state.watchdogs),
    ok = starl_cluster_calls:stop(State#state.calls),
    ok = starl_cluster_faults:stop(Faults),
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

acted(Hands, From, Text, #state{nodes = Nodes, faults = Faults} = State) ->
    case starl_cluster_faults:act(Hands, Nodes, Faults) of
        {ok, Wants, Next} -> {noreply, wanted(Wants, From, Text, State#state{faults = Next})};
        {{error, _} = Error, Wants, Next} -> {reply, Error, faulted({Wants, Next}, State)}
    end.

healed(What, From, Text, #state{nodes = Nodes, faults = Faults} = State) ->
    {Wants, Next} = starl_cluster_faults:heal(What, Nodes, Faults),
    wanted(Wants, From, Text, State#state{faults = Next}).

%% What faults want, and nobody waits for.
faulted({Wants, Faults}, State) -> wanted(Wants, none, none, State#state{faults = Faults}).

%% Nodes that are up are told once, however much has changed for them.
wanted(Wants, From, Text, State) ->
    Done = lists:foldl(fun does/2, State, Wants),
    #state{nodes = Nodes, faults = Faults} = Done,
    Up = maps:from_list(starl_cluster_nodes:up(Nodes)),
    Calls = [
        {element(2, Want), call(Want, maps:get(element(2, Want), Up), Faults)}
     || Want <- lists:usort(Wants), is_told(Want), is_map_key(element(2, Want), Up)
    ],
    aired(Calls, From, Text, Done).

aired([], none, _Text, State) -> State;
aired(Calls, From, Text, State) -> ask({aired, From, Text}, Calls, ?ANSWER_MS, State).

is_told({machine, _, _}) -> true;
is_told({What, _}) -> What =:= tell.

call({tell, Id}, Node, Faults) ->
    {Air, Senses} = starl_cluster_faults:changes(Id, Faults),
    fun() ->
        ok = starl_cluster_node:set_air(Node, Air),
        starl_cluster_node:set_senses(Node, Senses)
    end;
call({machine, _Id, Name}, Node, _Faults) ->
    fun() -> starl_cluster_node:kill(Node, Name) end.

-spec does(starl_cluster_faults:want(), #state{}) -> #state{}.
does({kill, Id}, #state{nodes = Nodes} = State) ->
    %% one that is down has nothing to lose
    _ = starl_cluster_nodes:kill(Id, Nodes),
    State#state{nodes = starl_cluster_nodes:doom(Id, Nodes)};
does({start, Id}, State) ->
    again(Id, State);
does({dead, Id}, #state{world = World} = State) ->
    ok = starl_world:dead(World, Id),
    State;
does({watch, Id}, State) ->
    watched(Id, State);
does(_Told, State) ->
    State.

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
loaded(Answers, #state{reloads = Before} = State) ->
    Reloads = starl_cluster_reload:loaded(Answers, Before),
    Renewed = starl_cluster_reload:codes(Reloads) =/= starl_cluster_reload:codes(Before),
    Late = [{kill, Robot} || Renewed, {Robot, down} <- maps:to_list(Answers)],
    lists:foldl(fun does/2, State#state{reloads = Reloads}, Late).

%% Opens the robot of a node that is ready. What hands do meanwhile is asked of the node after this.
opening(Id, State) -> opening(Id, fun(_Node) -> ok end, State).

%% The same on a node that has just been started.
reopening(Id, #state{nodes = Nodes, reloads = Reloads, calls = Calls} = State) ->
    Self = self(),
    Code = starl_cluster_nodes:code(Nodes) ++ starl_cluster_reload:code(Reloads),
    Ready = fun(Node) -> starl_cluster_node:ready(Node, Id, Code, Self) end,
    opening(Id, Ready, State#state{calls = starl_cluster_calls:joined(Id, Calls)}).

opening(Id, Ready, #state{world = World, nodes = Nodes, reloads = Reloads} = State) ->
    Spec = starl_cluster_nodes:spec(Id, Nodes),
    Faults = starl_cluster_faults:starts(Id, Spec, State#state.faults),
    Codes = starl_cluster_reload:codes(Reloads),
    Node = starl_cluster_nodes:name(Id, Nodes),
    {Air, Senses} = starl_cluster_faults:changes(Id, Faults),
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

heard(none, _Answers) ->
    ok;
heard(Text, Answers) ->
    {ok, [Text, starl_cluster_command:unheard([Id || {Id, silent} <- maps:to_list(Answers)]), "\n"]}.

opened(Id, Codes, {ok, Links}, #state{reloads = Reloads, faults = Faults} = State) ->
    case starl_cluster_reload:codes(Reloads) of
        Codes ->
            Rejoined = starl_cluster_reload:rejoined(Id, Links, Reloads),
            Up = starl_cluster_faults:up(Id, Faults),
            %% A fault may have begun, or ended, since the node was asked to open.
            faulted({[{watch, Id}, {tell, Id}], Up}, State#state{reloads = Rejoined});
        _Newer ->
            not_opened(Id, "there is newer code", State)
    end;
opened(Id, _Codes, {error, Why}, State) ->
    not_opened(Id, Why, State);
opened(_Id, _Codes, down, State) ->
    State.

not_opened(Id, Why, #state{nodes = Nodes} = State) ->
    Line = unicode:characters_to_binary(starl_cluster_nodes:known_end(Id, Why, Nodes)),
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

ended(Control, Status, #state{nodes = Nodes, log = Log}) ->
    _ = [
        Log(Id, Level, unicode:characters_to_binary(Line))
     || {Id, Level, Line} <- starl_cluster_nodes:ended(Control, Status, Nodes)
    ],
    ok.

lost(Id, Before) ->
    logger:notice(#{what => node_ended, robot => Id}),
    #state{nodes = Nodes, reloads = Reloads, faults = Faults} = Before,
    Lost = Before#state{
        nodes = starl_cluster_nodes:lost(Id, Nodes),
        reloads = starl_cluster_reload:lost(Id, Reloads),
        faults = starl_cluster_faults:lost(Id, Faults)
    },
    later(Id, left(Id, Lost)).

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
    IsDown = starl_cluster_nodes:name(Id, Nodes) =:= none,
    case IsDown andalso starl_cluster_faults:may_start(Id, Faults) of
        true ->
            Disk = starl_cluster_faults:disk(Id, Faults),
            started_again(Id, starl_cluster_nodes:again(Id, Disk, Nodes), State);
        false ->
            State
    end.

started_again(Id, {ok, Up}, State) ->
    reopening(Id, State#state{nodes = Up});
started_again(Id, {error, Reason}, State) ->
    logger:error(#{what => node_not_started, robot => Id, why => Reason}),
    later(Id, State).
