%% @doc Runs the robots of a run on nodes of their own on this computer. Each node is an operating
%% system process. A node that ends or hangs is restarted with the same store, and its robot rejoins
%% the team. All nodes end with the process of the run, however it ends: OTP's `peer' holds them by
%% their standard input.
%% ```
%%     starl_world_run (this host) --- starl_world     this VM
%%        | peer   | peer   | peer
%%     robot 1   robot 2   robot 3                     a VM each: starl_live_sup - starl_live_robot
%% '''
%% The host waits for no node ({@link starl_cluster_calls}). Commands of other terminals come by a
%% socket ({@link starl_cluster_command}).
%%
%% A watchdog, a process for each node, asks the link of its robot every second. It reports when it
%% has missed two answers, and when it has an answer again. It also reports when it has missed more
%% answers than a busy computer can delay; then it ends. Misses are counted, not measured: a computer
%% that stood still as a whole misses one answer.
%% ```
%%     {starl_silent, Robot, Watchdog, doubtful | back | silent}
%% '''
-module(starl_cluster).
-behaviour(starl_world_host).

-export([world/0, open/2, await/1, start/3, is_running/2, kill/2, halt/4, disk/3, notify/3]).
-export([check/3, release/1, info/2, call/3, status/1, close/2, stop/1]).
-export([most_halted_ms/0]).

-type reason() ::
    {peers, starl_sim_peers:reason()}
    | {control, unicode:chardata()}
    | {robot, starl:robot_id(), unicode:chardata()}.

%% What nodes are asked: to open their robot, with this code; to notify it; what they know of the
%% others; to load code; to close their robots.
-type question() ::
    {opened, starl:robot_id(), starl_reload:codes()}
    | {notified, starl_world_host:done()}
    | {known, gen_server:from()}
    | loaded
    | {closed, starl_world_host:done()}.

-record(cluster, {
    nodes :: starl_cluster_nodes:t(),
    calls :: starl_cluster_calls:t(question()),
    %% the process of the socket for commands
    control :: pid(),
    watchdogs = #{} :: #{starl:robot_id() => pid()},
    halts = starl_cluster_halts:new() :: starl_cluster_halts:t(),
    %% the robots whose nodes stand still without a halt
    hanging = [] :: [starl:robot_id()],
    %% the modules of a robot's machines, and the reloads
    parts :: #{starl_machine:name() => module()},
    reloads :: starl_cluster_reload:t(),
    log :: fun((starl:robot_id(), logger:level(), binary()) -> term())
}).

-type happened() :: {[starl_world_host:event()], #cluster{}}.

%% The longest time to load all code at first; to open a robot; to wait until robots are notified; to
%% load new code (a node that hangs is killed before); to end a recording.
-define(READY_MS, 60000).
-define(OPEN_MS, 60000).
-define(ANSWER_MS, 2000).
-define(LOAD_MS, 15000).
-define(CLOSE_MS, 15000).
%% Less than three quarters of the time (60 s) after which Erlang's distribution gives up a silent node.
-define(MOST_HALTED_S, 30).
%% The period of a watchdog, which is also the time for an answer, and the misses that it reports.
-define(PERIOD_MS, 1000).
-define(DOUBTFUL, 2).
-define(SILENT, 10).

%% @doc The longest time for which a node can be halted, by the computer's clock.
-spec most_halted_ms() -> pos_integer().
most_halted_ms() -> 1000 * ?MOST_HALTED_S.

%% -- the start ------------------------------------------------------------------------------

-spec world() -> nodes.
world() -> nodes.

%% Nodes with all their code; then the socket for commands.
-spec open(starl_run_plan:t(), starl_world_run:options()) ->
    {ok, #{starl:robot_id() => node()}, #cluster{}} | {error, reason()}.
open(#{robots := Poses} = Plan, Options) ->
    Code = maps:get(code, Options, []),
    case starl_cluster_nodes:start([Id || {Id, _} <- Poses], Code) of
        {ok, Nodes} ->
            {Answers, Calls} = ready(starl_cluster_nodes:up(Nodes), Code),
            case problems(Answers) of
                [] -> controlled(Nodes, Calls, Plan, Options);
                [Problem | _] -> not_opened(failed(Problem, Nodes), Nodes, Calls)
            end;
        {error, Reason} ->
            {error, {peers, Reason}}
    end.

ready(Up, Code) ->
    Self = self(),
    Joined = lists:foldl(
        fun({Id, _}, Calls) -> starl_cluster_calls:joined(Id, Calls) end,
        starl_cluster_calls:new(),
        Up
    ),
    Ready = fun(Id, Node) -> fun() -> starl_cluster_node:ready(Node, Id, Code, Self) end end,
    Wanted = [{Id, Ready(Id, Node)} || {Id, Node} <- Up],
    Asked = starl_cluster_calls:ask(ready, Wanted, ?READY_MS, Joined),
    {[{ready, Answers}], Calls} = starl_cluster_calls:await(Asked),
    {Answers, Calls}.

problems(Answers) ->
    [
        {Id, Why}
     || Id <- lists:sort(maps:keys(Answers)),
        {error, Why} <- [starl_cluster_calls:result(Id, Answers)]
    ].

failed({Id, Why}, Nodes) -> {robot, Id, starl_cluster_nodes:known_end(Id, Why, Nodes)}.

not_opened(Reason, Nodes, Calls) ->
    ok = starl_cluster_calls:stop(Calls),
    ok = starl_cluster_nodes:stop(Nodes),
    {error, Reason}.

controlled(Nodes, Calls, #{tree := Tree}, Options) ->
    Self = self(),
    case starl_cluster_command:start_link(fun(C) -> starl_world_run:command(Self, C) end) of
        {ok, Control} ->
            {ok, starl_cluster_nodes:names(Nodes), #cluster{
                nodes = Nodes,
                calls = Calls,
                control = Control,
                parts = starl_robot_services:parts(Tree),
                reloads = starl_cluster_reload:new(maps:get(speed, Options, 1)),
                log = maps:get(log, Options, fun(_, _, _) -> ok end)
            }};
        {error, Why} ->
            not_opened({control, Why}, Nodes, Calls)
    end.

-spec await(#cluster{}) -> {ok, [starl_world_host:event()], #cluster{}} | {error, reason()}.
await(#cluster{nodes = Nodes, calls = Calls} = Cluster) ->
    {Ended, Left} = starl_cluster_calls:await(Calls),
    case lists:append([problems(Answers) || {{opened, _, _}, Answers} <- lists:sort(Ended)]) of
        [] ->
            {Events, Next} = all_done(Ended, Cluster#cluster{calls = Left}),
            {ok, Events, Next};
        [Problem | _] ->
            {error, failed(Problem, Nodes)}
    end.

%% A node that has ended is started anew; all code is loaded on it first.
-spec start(starl:robot_id(), starl_world_host:launch(), #cluster{}) ->
    {ok | {error, unicode:chardata()}, [], #cluster{}}.
start(Id, #{disk := Disk} = Launch, #cluster{nodes = Nodes} = Cluster) ->
    case starl_cluster_nodes:name(Id, Nodes) of
        none ->
            case starl_cluster_nodes:again(Id, Disk, Nodes) of
                {ok, Up} -> {ok, [], reopening(Id, Launch, Cluster#cluster{nodes = Up})};
                {error, Reason} -> {{error, starl_sim_peers:format_error(Reason)}, [], Cluster}
            end;
        _Node ->
            {ok, [], opening(Id, fun(_) -> ok end, Launch, Cluster)}
    end.

reopening(Id, Launch, #cluster{nodes = Nodes, reloads = Reloads, calls = Calls} = Cluster) ->
    Self = self(),
    Code = starl_cluster_nodes:code(Nodes) ++ starl_cluster_reload:code(Reloads),
    Ready = fun(Node) -> starl_cluster_node:ready(Node, Id, Code, Self) end,
    opening(Id, Ready, Launch, Cluster#cluster{calls = starl_cluster_calls:joined(Id, Calls)}).

%% The node is notified of later faults after this.
opening(Id, Ready, #{spec := Spec, air := Air, senses := Senses}, Cluster) ->
    #cluster{nodes = Nodes, reloads = Reloads} = Cluster,
    #{sink := World} = Spec,
    Codes = starl_cluster_reload:codes(Reloads),
    Node = starl_cluster_nodes:name(Id, Nodes),
    Open = fun() ->
        case Ready(Node) of
            ok ->
                ok = starl_world:clock(World, Id, starl_cluster_node:ahead_us(Node)),
                starl_cluster_node:open(Node, Spec#{codes => Codes}, Air, Senses);
            {error, _} = Error ->
                Error
        end
    end,
    Known = Cluster#cluster{nodes = starl_cluster_nodes:specified(Id, Spec, Nodes)},
    ask({opened, Id, Codes}, [{Id, Open}], ?OPEN_MS, Known).

ask(Question, Wanted, LimitMs, #cluster{calls = Calls} = Cluster) ->
    Cluster#cluster{calls = starl_cluster_calls:ask(Question, Wanted, LimitMs, Calls)}.

%% -- what is done to robots -----------------------------------------------------------------

-spec is_running(starl:robot_id(), #cluster{}) -> boolean().
is_running(Id, #cluster{nodes = Nodes}) -> starl_cluster_nodes:name(Id, Nodes) =/= none.

%% A node that is down has nothing to lose.
-spec kill(starl:robot_id(), #cluster{}) -> #cluster{}.
kill(Id, #cluster{nodes = Nodes} = Cluster) ->
    Cluster#cluster{nodes = starl_cluster_nodes:kill(Id, Nodes)}.

-spec halt(starl:robot_id(), pos_integer(), now | at_work, #cluster{}) -> #cluster{}.
halt(Id, Ms, Moment, #cluster{nodes = Nodes, halts = Halts} = Cluster) ->
    #{Id := OsPid} = starl_cluster_nodes:os_pids(Nodes),
    Cluster#cluster{halts = starl_cluster_halts:halt(Id, {OsPid, Ms}, Moment, Halts)}.

-spec disk(fill | clear, starl:robot_id(), #cluster{}) -> ok | {error, unicode:chardata()}.
disk(Change, Id, #cluster{nodes = Nodes}) -> starl_cluster_nodes:disk(Change, Id, Nodes).

-spec notify([starl_world_host:notice()], starl_world_host:done(), #cluster{}) -> #cluster{}.
notify(Notices, Done, #cluster{nodes = Nodes} = Cluster) ->
    Up = maps:from_list(starl_cluster_nodes:up(Nodes)),
    case [{Id, notice(Notice, Node)} || {Id, Notice} <- Notices, #{Id := Node} <- [Up]] of
        [] ->
            _ = Done([]),
            Cluster;
        Calls ->
            ask({notified, Done}, Calls, ?ANSWER_MS, Cluster)
    end.

notice({conditions, Air, Senses}, Node) ->
    fun() ->
        ok = starl_cluster_node:set_air(Node, Air),
        starl_cluster_node:set_senses(Node, Senses)
    end;
notice({kill_machine, Name}, Node) ->
    fun() -> starl_cluster_node:kill(Node, Name) end.

-spec check(starl_world_faults:fault(), number(), #cluster{}) ->
    ok | {error, unicode:chardata()}.
check({_, _, _, pause, Robot, _}, Ms, Cluster) ->
    check_halt(Robot, Ms, Cluster);
check({_, _, _, Kind, Robot, _}, _Ms, Cluster) when
    Kind =:= reboot; Kind =:= kill_robot; Kind =:= store_lost; Kind =:= store_set_back
->
    case is_running(Robot, Cluster) of
        false -> {error, io_lib:format("the node of robot ~b is down already", [Robot])};
        true -> ok
    end;
check({_, _, _, store_full, _, _}, _Ms, _Cluster) ->
    starl_cluster_nodes:has_disks();
check(_Fault, _Ms, _Cluster) ->
    ok.

check_halt(_Robot, Ms, _Cluster) when Ms < 1; Ms > 1000 * ?MOST_HALTED_S ->
    {error, io_lib:format("a node can be halted for 0.001 to ~b s", [?MOST_HALTED_S])};
check_halt(Robot, _Ms, #cluster{halts = Halts} = Cluster) ->
    case {starl_cluster_halts:is_halted(Robot, Halts), is_running(Robot, Cluster)} of
        {true, _} -> {error, io_lib:format("the node of robot ~b stands still already", [Robot])};
        {false, true} -> ok;
        {false, false} -> {error, io_lib:format("the node of robot ~b is down", [Robot])}
    end.

-spec release(#cluster{}) -> happened().
release(#cluster{halts = Halts} = Cluster) ->
    {Reports, Next} = starl_cluster_halts:undo_all(Halts),
    halt_reports(Reports, Cluster#cluster{halts = Next}).

-spec status(#cluster{}) -> starl_world_host:status().
status(#cluster{nodes = Nodes}) ->
    #{
        restarts => starl_cluster_nodes:restarts(Nodes),
        os_pids => starl_cluster_nodes:os_pids(Nodes)
    }.

%% -- requests -------------------------------------------------------------------------------

-spec call(term(), gen_server:from(), #cluster{}) ->
    {reply, term(), #cluster{}} | {noreply, #cluster{}}.
call({wait, Robot}, From, #cluster{halts = Halts} = Cluster) ->
    {noreply, Cluster#cluster{halts = starl_cluster_halts:wait(Robot, From, Halts)}};
call({place, Robot}, _From, #cluster{nodes = Nodes} = Cluster) ->
    {reply, starl_cluster_nodes:place(Robot, Nodes), Cluster};
call({link, _Robot}, _From, Cluster) ->
    {reply, none, Cluster};
call(peers, From, #cluster{nodes = Nodes} = Cluster) ->
    Calls = [
        {Id, fun() -> starl_cluster_node:peers(Node) end}
     || {Id, Node} <- starl_cluster_nodes:up(Nodes)
    ],
    {noreply, ask({known, From}, Calls, ?ANSWER_MS, Cluster)};
call({reload, Sources, Options}, From, Cluster) ->
    #cluster{parts = Parts, nodes = Nodes, reloads = Reloads} = Cluster,
    case starl_cluster_reload:start(Sources, Options, Parts, From, Reloads) of
        {ok, Code, Next} ->
            Load = fun(Node) -> fun() -> starl_cluster_node:load(Node, Code) end end,
            Calls = [{Id, Load(Node)} || {Id, Node} <- starl_cluster_nodes:up(Nodes)],
            {noreply, ask(loaded, Calls, ?LOAD_MS, Cluster#cluster{reloads = Next})};
        {error, _} = Error ->
            {reply, Error, Cluster}
    end.

%% A recording of a robot that is closed may take long to end.
-spec close(starl_world_host:done(), #cluster{}) -> happened().
close(Done, Open) ->
    {Events, #cluster{nodes = Nodes, watchdogs = Watchdogs} = Cluster} = release(Open),
    ok = call_off(Watchdogs),
    Close = fun(Node) -> fun() -> starl_cluster_node:close(Node) end end,
    Calls = [
        {Id, Close(Node)}
     || {Id, Node} <- starl_cluster_nodes:up(Nodes),
        is_map_key(recorder, starl_cluster_nodes:spec(Id, Nodes))
    ],
    {Events, ask({closed, Done}, Calls, ?CLOSE_MS, Cluster#cluster{watchdogs = #{}})}.

-spec stop(#cluster{}) -> ok.
stop(#cluster{nodes = Nodes, calls = Calls, halts = Halts, watchdogs = Watchdogs}) ->
    ok = starl_cluster_command:close(),
    ok = call_off(Watchdogs),
    ok = starl_cluster_calls:stop(Calls),
    _ = starl_cluster_halts:undo_all(Halts),
    starl_cluster_nodes:stop(Nodes).

%% -- messages -------------------------------------------------------------------------------

-spec info(term(), #cluster{}) -> happened() | {stop, term()}.
info({starl_log, Id, Level, Line}, #cluster{log = Log} = Cluster) ->
    _ = Log(Id, Level, Line),
    {[], Cluster};
info({'EXIT', Control, Reason}, #cluster{control = Control}) ->
    {stop, Reason};
%% Of the processes that are linked, those of nodes may end.
info({'EXIT', Pid, _Reason}, #cluster{nodes = Nodes} = Cluster) ->
    case starl_cluster_nodes:of_control(Pid, Nodes) of
        {ok, Id} -> lost(Id, Cluster);
        none -> {[], Cluster}
    end;
info({starl_peer_ended, Peer, Status}, #cluster{nodes = Nodes, log = Log} = Cluster) ->
    _ = [
        Log(Id, Level, unicode:characters_to_binary(Line))
     || {Id, Level, Line} <- starl_cluster_nodes:ended(Peer, Status, Nodes)
    ],
    {[], Cluster};
info({starl_silent, Id, Watchdog, Report}, #cluster{watchdogs = Watchdogs} = Cluster) ->
    %% one that was called off may have sent its report already
    case Watchdogs of
        #{Id := Watchdog} -> silent(Report, Id, Cluster);
        #{} -> {[], Cluster}
    end;
info(Message, #cluster{calls = Calls, halts = Halts, reloads = Reloads} = Cluster) ->
    case {starl_cluster_calls:hear(Message, Calls), starl_cluster_halts:hear(Message, Halts)} of
        {{Ended, Left}, _} ->
            all_done(Ended, Cluster#cluster{calls = Left});
        {unknown, {Report, Left}} ->
            halt_reports([Report], Cluster#cluster{halts = Left});
        {unknown, unknown} ->
            {[], Cluster#cluster{reloads = starl_cluster_reload:hear(Message, Reloads)}}
    end.

%% The nodes have answered questions, or have not within their time.
all_done(Ended, Cluster) -> each(fun done/2, Ended, Cluster).

each(Do, List, Cluster) ->
    {Events, Next} = lists:mapfoldl(Do, Cluster, List),
    {lists:append(Events), Next}.

done({{opened, Id, Codes}, Answers}, Cluster) ->
    opened(Id, Codes, starl_cluster_calls:result(Id, Answers), Cluster);
done({{notified, Done}, Answers}, Cluster) ->
    _ = Done([Id || {Id, silent} <- maps:to_list(Answers)]),
    {[], Cluster};
done({{known, From}, Answers}, Cluster) ->
    ok = gen_server:reply(
        From, maps:from_list([{Id, Known} || {Id, {ok, Known}} <- maps:to_list(Answers)])
    ),
    {[], Cluster};
done({loaded, Answers}, Cluster) ->
    {[], loaded(Answers, Cluster)};
done({{closed, Done}, _Answers}, Cluster) ->
    _ = Done([]),
    {[], Cluster}.

opened(Id, Codes, {ok, Links}, #cluster{reloads = Reloads} = Cluster) ->
    case starl_cluster_reload:codes(Reloads) of
        Codes ->
            Rejoined = starl_cluster_reload:rejoined(Id, Links, Reloads),
            {[{up, Id}], watched(Id, Cluster#cluster{reloads = Rejoined})};
        _Newer ->
            dropped(Id, "there is newer code", Cluster)
    end;
opened(Id, _Codes, {error, Why}, Cluster) ->
    dropped(Id, Why, Cluster);
opened(_Id, _Codes, down, Cluster) ->
    {[], Cluster}.

dropped(Id, Why, #cluster{nodes = Nodes} = Cluster) ->
    Line = unicode:characters_to_binary(starl_cluster_nodes:known_end(Id, Why, Nodes)),
    logger:error(#{what => robot_not_started, robot => Id, why => Line}),
    left(Id, Cluster#cluster{nodes = starl_cluster_nodes:drop(Id, Nodes)}).

%% A node that was started anew meanwhile has the former code: it is started once more.
loaded(Answers, #cluster{reloads = Before} = Cluster) ->
    Reloads = starl_cluster_reload:loaded(Answers, Before),
    Renewed = starl_cluster_reload:codes(Reloads) =/= starl_cluster_reload:codes(Before),
    Late = [Robot || Renewed, {Robot, down} <- maps:to_list(Answers)],
    lists:foldl(fun kill/2, Cluster#cluster{reloads = Reloads}, Late).

%% -- nodes that end, stand still or hang ----------------------------------------------------

lost(Id, #cluster{nodes = Nodes, reloads = Reloads, halts = Halts} = Cluster) ->
    logger:notice(#{what => node_ended, robot => Id}),
    {Reports, Moving} = starl_cluster_halts:undo(Id, Halts),
    {Resumed, Lost} = halt_reports(Reports, Cluster#cluster{
        nodes = starl_cluster_nodes:lost(Id, Nodes),
        reloads = starl_cluster_reload:lost(Id, Reloads),
        halts = Moving
    }),
    {Back, Unhung} = answers_again(Id, Lost),
    {Events, Next} = left(Id, Unhung),
    {Resumed ++ Back ++ Events, Next}.

%% Nobody asks the node of a robot any more.
left(Id, #cluster{calls = Calls, watchdogs = Watchdogs} = Cluster) ->
    {Ended, Left} = starl_cluster_calls:lost(Id, Calls),
    ok = call_off(maps:with([Id], Watchdogs)),
    {Events, Next} = all_done(Ended, Cluster#cluster{
        calls = Left, watchdogs = maps:remove(Id, Watchdogs)
    }),
    {[{down, Id} | Events], Next}.

halt_reports(Reports, Cluster) -> each(fun halt_report/2, Reports, Cluster).

halt_report({halted, Id, Found}, Cluster) ->
    logger:notice(#{what => node_halted, robot => Id, found => Found}),
    {[{halted, Id}], Cluster};
halt_report({resumed, Id, Found, Callers}, Cluster) ->
    ok = lists:foreach(fun(From) -> gen_server:reply(From, {ok, Found}) end, Callers),
    {[{resumed, Id}], watched(Id, Cluster)}.

%% A halt has its own time. Any other silence is reported to the world in the same way, so no robot
%% is accused because its node hangs.
silent(back, Id, Cluster) ->
    answers_again(Id, Cluster);
silent(Report, Id, #cluster{halts = Halts, hanging = Hanging} = Cluster) ->
    case {Report, starl_cluster_halts:is_halted(Id, Halts)} of
        {doubtful, true} ->
            {[], Cluster};
        {doubtful, false} ->
            {[{hangs, Id}], Cluster#cluster{hanging = [Id | lists:delete(Id, Hanging)]}};
        {silent, true} ->
            {[], watched(Id, Cluster)};
        {silent, false} ->
            logger:error(#{what => node_silent, robot => Id, then => killed_and_started_anew}),
            {[], kill(Id, Cluster)}
    end.

answers_again(Id, #cluster{hanging = Hanging} = Cluster) ->
    Events = [{resumed, Id} || lists:member(Id, Hanging)],
    {Events, Cluster#cluster{hanging = lists:delete(Id, Hanging)}}.

%% -- watchdogs ------------------------------------------------------------------------------

%% Watches a node from now on. If it was watched before, the watch begins again.
watched(Id, #cluster{nodes = Nodes, watchdogs = Watchdogs} = Cluster) ->
    case starl_cluster_nodes:name(Id, Nodes) of
        none ->
            Cluster;
        Node ->
            ok = call_off(maps:with([Id], Watchdogs)),
            Owner = self(),
            Watchdog = spawn_link(fun() -> watch(0, {Id, Node, Owner}) end),
            Cluster#cluster{watchdogs = Watchdogs#{Id => Watchdog}}
    end.

call_off(Watchdogs) ->
    lists:foreach(
        fun(Pid) ->
            true = unlink(Pid),
            true = exit(Pid, kill)
        end,
        maps:values(Watchdogs)
    ).

watch(?SILENT, Watched) ->
    say(silent, Watched);
watch(Missed, {_Robot, Node, _Owner} = Watched) ->
    Next = erlang:start_timer(?PERIOD_MS, self(), look),
    case starl_cluster_node:answers(Node, ?PERIOD_MS) of
        true ->
            _ = Missed >= ?DOUBTFUL andalso say(back, Watched),
            watch_at(Next, 0, Watched);
        false ->
            _ = Missed + 1 =:= ?DOUBTFUL andalso say(doubtful, Watched),
            watch_at(Next, Missed + 1, Watched);
        gone ->
            ok
    end.

watch_at(Timer, Missed, Watched) ->
    receive
        {timeout, Timer, look} -> watch(Missed, Watched)
    end.

say(Report, {Robot, _Node, Owner}) ->
    Owner ! {starl_silent, Robot, self(), Report},
    ok.
