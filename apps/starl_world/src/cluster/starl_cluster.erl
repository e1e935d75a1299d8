%% @doc A cluster on this machine: one Erlang node, a process of the operating system, for each robot
%% of a scenario, in real time, and the world ({@link starl_world}) in this one.
%%
%% A node that ends is started anew, with the same store, and its robot rejoins the team. All nodes
%% end with this process, however it ends: OTP's `peer' holds them by their standard input.
%% ```
%%     starl_cluster --- starl_world          this VM
%%        | peer   | peer   | peer
%%     robot 1   robot 2   robot 3            a VM each: starl_live_sup - starl_live_robot
%% '''
-module(starl_cluster).
-behaviour(gen_server).

-export([
    start/2,
    await/1,
    until/2,
    status/1,
    place/2,
    reload/2, reload/3,
    kill/2,
    cut/3,
    freeze/2,
    unplug/2,
    heal/1,
    stop/1,
    finish/1
]).
-export([scenario/1, format_error/1]).
-export([init/1, handle_call/3, handle_cast/2, handle_info/2, terminate/2]).

-export_type([t/0, options/0, status/0, reason/0]).

-record(cluster, {
    server :: pid(),
    scenario :: starl_sim_scenario:t(),
    scene :: starl_scene:t()
}).

%% A running cluster, linked to the process that started it.
-opaque t() :: #cluster{}.

%% `transport': how packets travel between the nodes. `speed': 2.0 is twice as fast as real time; `air': other air than
%% that of the scenario's radio; `chassis': what the robots have in place of a chassis of the world;
%% `watch': further monitors, which only look on. `dir': the
%% directory of the robots' stores. `code': modules that were compiled in memory. `metrics': robot N
%% serves its metrics at this port plus N. `chaos': what
%% happens to the nodes, at which times of the run. `packets': whether the observer is told of all
%% packets; `recorder': what each robot is recorded with on its own node. `log': gets each line of the
%% nodes' logs.
-type options() :: #{
    dir := file:filename(),
    transport := dist | udp,
    speed => number(),
    air => starl_live_air:settings(),
    watch => [{module(), map()}],
    observe => starl_observer:t(),
    packets => boolean(),
    recorder => starl_observer:recorder(),
    rate_hz => number() | none,
    chassis => starl_world_chassis:lines(),
    whole_mm => boolean(),
    arena => starl_world_floor:arena(),
    metrics => inet:port_number() | none,
    chaos => [{AtUs :: integer(), starl_cluster_chaos:act()}],
    code => [{module(), file:filename(), Beam :: binary()}],
    log => fun((starl:robot_id(), logger:level(), binary()) -> term())
}.

-type status() :: #{
    now_us := integer(),
    running := non_neg_integer(),
    up := [starl:robot_id()],
    ending := starl_world:ending() | none,
    restarts := #{starl:robot_id() => non_neg_integer()},
    os_pids := #{starl:robot_id() => string()}
}.

-type reason() ::
    starl_sim:reason()
    | {peers, starl_sim_peers:reason()}
    | {control, unicode:chardata()}
    | {robot, starl:robot_id(), unicode:chardata()}.

-record(node, {
    peer :: starl_sim_peers:t() | none,
    restarts = 0 :: non_neg_integer()
}).

-record(state, {
    world :: pid(),
    %% the start arguments of each robot
    specs :: #{starl:robot_id() => starl_live_robot:spec()},
    names :: #{starl:robot_id() => string()},
    nodes = #{} :: #{starl:robot_id() => #node{}},
    cuts = [] :: [{starl:robot_id(), starl:robot_id()}],
    frozen = [] :: [starl:robot_id()],
    unplugged = [] :: [starl:robot_id()],
    code :: [{module(), file:filename(), binary()}],
    %% the modules of a robot's machines, and the reloads
    parts :: #{starl_machine:name() => module()},
    reloads :: starl_cluster_reload:t(),
    log :: fun((starl:robot_id(), logger:level(), binary()) -> term())
}).

%% The time after which a node that has ended is started anew.
-define(AGAIN_MS, 500).
-define(CALL_MS, 60000).

%% @doc Starts the nodes and robots of a scenario.
-spec start(#{app := module(), atom() => term()}, options()) -> {ok, t()} | {error, reason()}.
start(Given, Options) ->
    case starl_world:plan(Given, Options) of
        {ok, {Scenario, Scene, Plan} = Planned} ->
            Observed = starl_world:observed(Planned, Options),
            case gen_server:start_link(?MODULE, {Plan, Observed}, [{timeout, infinity}]) of
                {ok, Server} ->
                    {ok, #cluster{server = Server, scenario = Scenario, scene = Scene}};
                {error, {shutdown, Reason}} ->
                    {error, Reason}
            end;
        {error, _} = Error ->
            Error
    end.

%% @doc Waits for the end of the run.
-spec await(t()) -> starl_world:ending().
await(#cluster{server = Server}) ->
    starl_world:await(gen_server:call(Server, world, infinity)).

%% @doc Waits until this time of the run.
-spec until(t(), Us :: integer()) -> ok.
until(#cluster{server = Server}, Us) ->
    starl_world:until(gen_server:call(Server, world, infinity), Us).

%% @doc The present time, the robots at work, and their nodes.
-spec status(t()) -> status().
status(#cluster{server = Server}) -> gen_server:call(Server, status, ?CALL_MS).

%% @doc Reloads code on all nodes, with a trial time ({@link starl_cluster_reload}); answers when it
%% is over, or has failed.
-spec reload(t(), [starl_version:source()]) -> starl_cluster_reload:answer().
reload(Cluster, Sources) -> reload(Cluster, Sources, #{}).

%% @doc The same, with another trial time.
-spec reload(t(), [starl_version:source()], starl_cluster_reload:options()) ->
    starl_cluster_reload:answer().
reload(#cluster{server = Server}, Sources, Options) ->
    gen_server:call(Server, {reload, Sources, Options}, infinity).

%% @doc The node of a robot, and what its end of the transport was opened with: for tests that
%% attack it.
-spec place(t(), starl:robot_id()) ->
    {ok, #{node := node() | none, transport := starl_live_link:line()}}
    | {error, unicode:chardata()}.
place(#cluster{server = Server}, Robot) -> gen_server:call(Server, {place, Robot}, ?CALL_MS).

%% @doc Kills the node of a robot, by SIGKILL; it is started anew.
-spec kill(t(), starl:robot_id()) -> ok | {error, unicode:chardata()}.
kill(#cluster{server = Server}, Robot) -> gen_server:call(Server, {kill, Robot}, ?CALL_MS).

%% @doc Two robots do not hear each other any more.
-spec cut(t(), starl:robot_id(), starl:robot_id()) -> ok | {error, unicode:chardata()}.
cut(#cluster{server = Server}, A, B) -> gen_server:call(Server, {cut, A, B}, ?CALL_MS).

%% @doc A robot gets no new positions any more.
-spec freeze(t(), starl:robot_id()) -> ok | {error, unicode:chardata()}.
freeze(#cluster{server = Server}, Robot) -> gen_server:call(Server, {freeze, Robot}, ?CALL_MS).

%% @doc Pulls the cable of a robot's Create.
-spec unplug(t(), starl:robot_id()) -> ok | {error, unicode:chardata()}.
unplug(#cluster{server = Server}, Robot) -> gen_server:call(Server, {unplug, Robot}, ?CALL_MS).

%% @doc Undoes all cuts and freezes, and puts the cables back.
-spec heal(t()) -> ok.
heal(#cluster{server = Server}) -> gen_server:call(Server, heal, ?CALL_MS).

%% @doc Ends the run.
-spec stop(t()) -> ok.
stop(#cluster{server = Server}) -> starl_world:stop(gen_server:call(Server, world, infinity)).

%% @doc The checked scenario, with all defaults.
-spec scenario(t()) -> starl_sim_scenario:t().
scenario(#cluster{scenario = Scenario}) -> Scenario.

%% @doc Ends the nodes and the world; returns the outcome and the application's report.
-spec finish(t()) -> {starl_sim_outcome:t(), starl_scene:report()}.
finish(#cluster{server = Server, scenario = #{app := App}, scene = Scene}) ->
    Outcome = starl_world:finish(gen_server:call(Server, world, infinity)),
    ok = gen_server:call(Server, close, infinity),
    ok = gen_server:stop(Server, normal, infinity),
    {Outcome, starl_scene:report(App, Scene, Outcome)}.

%% @doc One line on why a cluster could not be started.
-spec format_error(reason()) -> unicode:chardata().
format_error({control, Why}) -> ["the cluster's socket for commands: ", Why];
format_error({robot, Id, Why}) -> io_lib:format("robot ~b does not start: ~ts", [Id, Why]);
format_error({peers, Reason}) -> starl_sim_peers:format_error(Reason);
format_error(Reason) -> starl_sim:format_error(Reason).

%% -- server ---------------------------------------------------------------------------------

-spec init({starl_sim_plan:t(), options()}) -> {ok, #state{}} | {stop, {shutdown, term()}}.
init({#{robots := Poses, crew := #{tree := Tree}, world := Sim} = Plan, Options}) ->
    process_flag(trap_exit, true),
    Ids = [Id || {Id, _} <- Poses],
    Run = peer:random_name("starl"),
    Names = maps:from_list([{Id, Run ++ "-robot" ++ integer_to_list(Id)} || Id <- Ids]),
    case starl_sim_peers:start_as([maps:get(Id, Names) || Id <- Ids]) of
        {ok, Peers} ->
            Clock = starl_live_clock:new(
                erlang:system_time(microsecond), maps:get(speed, Options, 1)
            ),
            Known = maps:with([rate_hz, whole_mm, arena, observe, facts], Options),
            {ok, World} = starl_world:start_link(Known#{plan => Plan, clock => Clock}),
            Nodes = maps:from_list([
                {Id, starl_sim_peers:node(Peer)}
             || {Id, Peer} <- lists:zip(Ids, Peers)
            ]),
            Radio = maps:merge(#{speed => 1}, maps:with([speed, air], Options)),
            Transport = starl_world_transport:new(
                maps:get(transport, Options), Ids, Radio#{sim => Sim}
            ),
            Lines = maps:from_list([
                {Id, starl_world_transport:line(Id, Nodes, Transport)}
             || Id <- Ids
            ]),
            Specs = [
                {Id, recorded(spec(Id, World, Clock, Tree, Sim, Lines, Options), Options)}
             || Id <- Ids
            ],
            State = #state{
                world = World,
                specs = maps:from_list(Specs),
                names = Names,
                code = maps:get(code, Options, []),
                parts = starl_robot_crew:parts(Tree),
                reloads = starl_cluster_reload:new(maps:get(speed, Options, 1)),
                log = maps:get(log, Options, fun(_, _, _) -> ok end)
            },
            Self = self(),
            Handler = fun(Words) -> gen_server:call(Self, {control, Words}, ?CALL_MS) end,
            case starl_cluster_control:start_link(Handler) of
                {ok, _} ->
                    ok = plan(maps:get(chaos, Options, []), Clock),
                    all_opened(lists:zip(Ids, Peers), State);
                {error, Why} ->
                    {stop, {shutdown, {control, Why}}}
            end;
        {error, Reason} ->
            {stop, {shutdown, {peers, Reason}}}
    end.

all_opened([], State) ->
    {ok, State};
all_opened([{Id, Peer} | Peers], State) ->
    case opened(Id, Peer, State) of
        {ok, Next} ->
            all_opened(Peers, Next);
        {error, Why} ->
            lists:foreach(fun given_up/1, [Peer | [P || {_, P} <- Peers]]),
            {stop, {shutdown, {robot, Id, Why}}}
    end.

plan(Chaos, Clock) ->
    lists:foreach(
        fun({At, Act}) ->
            Due = starl_live_clock:monotonic_ms(At, Clock),
            erlang:send_after(Due, self(), {chaos, Act}, [{abs, true}])
        end,
        Chaos
    ).

spec(Id, World, Clock, Tree, #{profiles := Profiles}, Lines, #{dir := Dir} = Options) ->
    #{
        robot => Id,
        tree => Tree,
        profile => starl_chassis:of_robot(Id, Profiles),
        clock => Clock,
        dir => filename:join(Dir, "robot-" ++ integer_to_list(Id)),
        transport => maps:get(Id, Lines),
        positioning => {starl_world_sight, #{world => World}},
        chassis => starl_world_chassis:line(Id, World, Options),
        sink => World,
        reporter => self(),
        record => true,
        packets => maps:get(packets, Options, false),
        metrics => maps:get(metrics, Options, none)
    }.

recorded(#{clock := Clock} = Spec, #{recorder := {Module, Own}, facts := Facts}) ->
    Spec#{recorder => {Module, Own#{facts => starl_world:live(Facts, Clock)}}};
recorded(Spec, #{}) ->
    Spec.

-spec handle_call(term(), gen_server:from(), #state{}) ->
    {reply, term(), #state{}} | {noreply, #state{}}.
handle_call({reload, Sources, Options}, From, State) ->
    reloads(Sources, Options, From, State);
handle_call({control, ["reload", What]}, From, State) ->
    reloads([source(What)], #{}, From, State);
handle_call(world, _From, #state{world = World} = State) ->
    {reply, World, State};
handle_call(status, _From, State) ->
    {reply, status_of(State), State};
handle_call(close, _From, State) ->
    {reply, closed(State), State};
handle_call({control, Words}, _From, State) ->
    {Answer, Next} = command(Words, State),
    {reply, Answer, Next};
handle_call(heal, _From, State) ->
    {reply, ok, healed(State)};
handle_call(Request, _From, State) ->
    case unknown(tl(tuple_to_list(Request)), State) of
        [] ->
            {Answer, Next} = does(Request, State),
            {reply, Answer, Next};
        [Robot | _] ->
            {reply, {error, io_lib:format("there is no robot ~b", [Robot])}, State}
    end.

unknown(Robots, #state{nodes = Nodes}) -> [R || R <- Robots, not is_map_key(R, Nodes)].

status_of(#state{world = World, nodes = Nodes}) ->
    maps:merge(starl_world:status(World), #{
        restarts => maps:map(fun(_, #node{restarts = N}) -> N end, Nodes),
        os_pids => maps:from_list([
            {Id, starl_sim_peers:os_pid(Peer)}
         || {Id, #node{peer = Peer}} <- maps:to_list(Nodes), Peer =/= none
        ])
    }).

does({place, Robot}, #state{nodes = Nodes, specs = Specs} = State) ->
    #{Robot := #{transport := Line}} = Specs,
    {{ok, #{node => node_of(maps:get(Robot, Nodes)), transport => Line}}, State};
does({kill, Robot}, #state{nodes = Nodes} = State) ->
    case Nodes of
        #{Robot := #node{peer = none}} ->
            {{error, io_lib:format("the node of robot ~b is down already", [Robot])}, State};
        #{Robot := #node{peer = Peer}} ->
            _ = os:cmd("kill -KILL " ++ starl_sim_peers:os_pid(Peer)),
            ok = starl_world:killed(State#state.world, Robot),
            {ok, State}
    end;
does({cut, A, B}, #state{cuts = Cuts} = State) ->
    {ok, cut([A, B], State#state{cuts = lists:usort([{A, B}, {B, A} | Cuts])})};
does({mend, A, B}, #state{cuts = Cuts} = State) ->
    {ok, cut([A, B], State#state{cuts = Cuts -- [{A, B}, {B, A}]})};
does({thaw, Robot}, #state{frozen = Frozen, world = World} = State) ->
    Left = lists:delete(Robot, Frozen),
    {starl_world:freeze(World, Left), State#state{frozen = Left}};
does({unplug, Robot}, State) ->
    pulled(pulled, Robot, State);
does({unplug_in_time, Robot}, State) ->
    pulled(pulled_in_time, Robot, State);
does({plug, Robot}, #state{unplugged = Unplugged, world = World} = State) ->
    {starl_world:cable(World, Robot, back), State#state{
        unplugged = lists:delete(Robot, Unplugged)
    }};
does({freeze, Robot}, #state{frozen = Frozen, world = World} = State) ->
    Next = lists:usort([Robot | Frozen]),
    {starl_world:freeze(World, Next), State#state{frozen = Next}}.

pulled(How, Robot, #state{unplugged = Unplugged, world = World} = State) ->
    case starl_world:cable(World, Robot, How) of
        ok -> {ok, State#state{unplugged = lists:usort([Robot | Unplugged])}};
        {error, _} = Error -> {Error, State}
    end.

node_of(#node{peer = none}) -> none;
node_of(#node{peer = Peer}) -> starl_sim_peers:node(Peer).

healed(#state{world = World, nodes = Nodes, unplugged = Unplugged} = State) ->
    Next = State#state{cuts = [], frozen = [], unplugged = []},
    ok = starl_world:freeze(World, []),
    ok = lists:foreach(fun(Robot) -> ok = starl_world:cable(World, Robot, back) end, Unplugged),
    cut(maps:keys(Nodes), Next).

%% The robots hear what they are to hear now, and the world knows.
cut(Robots, #state{cuts = Cuts, world = World} = State) ->
    ok = starl_world:cut(World, Cuts),
    ok = lists:foreach(fun(Robot) -> aired(Robot, State) end, Robots),
    State.

%% -- new code -------------------------------------------------------------------------------

reloads(Sources, Options, From, #state{parts = Parts, reloads = Reloads} = State) ->
    case starl_cluster_reload:start(Sources, Options, {Parts, links(State)}, From, Reloads) of
        {ok, Next} -> {noreply, State#state{reloads = Next}};
        {error, _} = Error -> {reply, Error, State}
    end.

%% The robots whose nodes are up.
links(#state{nodes = Nodes}) ->
    [
        {Id, Node, Link}
     || {Id, #node{peer = Peer}} <- lists:sort(maps:to_list(Nodes)),
        Peer =/= none,
        Node <- [starl_sim_peers:node(Peer)],
        Link <- link_of(Node)
    ].

link_of(Node) ->
    try
        Robot = erpc:call(Node, starl_live_sup, robot, [], ?CALL_MS),
        [erpc:call(Node, starl_live_robot, link, [Robot], ?CALL_MS)]
    catch
        error:{erpc, _} -> [];
        exit:_ -> []
    end.

%% A file, an application as users name it, or a module.
source(What) ->
    case filename:extension(What) of
        ".erl" -> What;
        _ -> module(["starl_" ++ What, What])
    end.

%% A user's own word: few atoms.
module([Name]) ->
    list_to_atom(Name);
module([Name | Names]) ->
    case code:which(list_to_atom(Name)) of
        non_existing -> module(Names);
        _ -> list_to_atom(Name)
    end.

%% Sets what a robot hears, if its node is up.
aired(Robot, #state{nodes = Nodes, cuts = Cuts}) ->
    case Nodes of
        #{Robot := #node{peer = Peer}} when Peer =/= none ->
            Deaf = [Other || {R, Other} <- Cuts, R =:= Robot],
            set_air(starl_sim_peers:node(Peer), #{cut => Deaf});
        #{} ->
            ok
    end.

set_air(Node, Settings) ->
    try
        Robot = erpc:call(Node, starl_live_sup, robot, [], ?CALL_MS),
        Link = erpc:call(Node, starl_live_robot, link, [Robot], ?CALL_MS),
        starl_live_transport:set_air(starl_live_link:line(Link, transport), Settings)
    catch
        error:{erpc, _} -> ok;
        exit:_ -> ok
    end.

%% -- commands from other terminals ----------------------------------------------------------

command(["status"], State) ->
    {{ok, described(status_of(State))}, State};
command(["stop"], #state{world = World} = State) ->
    {{starl_world:stop(World), "the run ends\n"}, State};
command(["heal"], State) ->
    {{ok, "healed\n"}, healed(State)};
command([Word | Robots], State) ->
    case {Word, [string:to_integer(Robot) || Robot <- Robots]} of
        {"kill", [{Robot, []}]} -> told({kill, Robot}, State);
        {"freeze", [{Robot, []}]} -> told({freeze, Robot}, State);
        {"unplug", [{Robot, []}]} -> told({unplug, Robot}, State);
        {"cut", [{A, []}, {B, []}]} when A =/= B -> told({cut, A, B}, State);
        _ -> {{error, [Word, ": robots by their numbers, as in cut 1 2 or kill 3"]}, State}
    end.

told(Request, State) ->
    case unknown(tl(tuple_to_list(Request)), State) of
        [] ->
            case does(Request, State) of
                {ok, Next} -> {{ok, "done\n"}, Next};
                {{error, Why}, Next} -> {{error, Why}, Next}
            end;
        [Robot | _] ->
            {{error, io_lib:format("there is no robot ~b", [Robot])}, State}
    end.

described(#{now_us := Now, running := Running, up := Up, restarts := Restarts, os_pids := Pids}) ->
    [
        io_lib:format("~.1f s, ~b at work~n", [Now / 1.0e6, Running])
        | [
            io_lib:format("robot ~b  ~-5s process ~s, started ~b times~n", [
                Id, up(lists:member(Id, Up)), maps:get(Id, Pids, "-"), N + 1
            ])
         || {Id, N} <- lists:sort(maps:to_list(Restarts))
        ]
    ].

up(true) -> "up";
up(false) -> "down".

-spec handle_cast(term(), #state{}) -> {noreply, #state{}}.
handle_cast(_Request, State) -> {noreply, State}.

-spec handle_info(term(), #state{}) -> {noreply, #state{}} | {stop, term(), #state{}}.
handle_info({starl_log, Id, Level, Line}, #state{log = Log} = State) ->
    _ = Log(Id, Level, Line),
    {noreply, State};
handle_info({'EXIT', World, Reason}, #state{world = World} = State) ->
    {stop, Reason, State};
handle_info({'EXIT', Pid, Reason}, #state{nodes = Nodes} = State) ->
    case
        [
            Id
         || {Id, #node{peer = P}} <- maps:to_list(Nodes),
            P =/= none,
            starl_sim_peers:control(P) =:= Pid
        ]
    of
        [Id] -> {noreply, lost(Id, State)};
        [] when Reason =:= normal -> {noreply, State};
        [] -> {stop, Reason, State}
    end;
handle_info({chaos, Act}, #state{world = World} = State) ->
    #{leader := Leader} = starl_world:status(World),
    case starl_cluster_chaos:targets(Act, Leader) of
        none ->
            {noreply, State};
        Aimed ->
            logger:notice(#{what => chaos, act => Aimed}),
            {_, Next} = does(Aimed, State),
            {noreply, Next}
    end;
handle_info({starl_reloaded, Robot, Name, Told}, #state{reloads = Reloads} = State) ->
    {noreply, State#state{reloads = starl_cluster_reload:hear({Robot, Name, Told}, Reloads)}};
handle_info({timeout, Timer, reload_trial}, #state{reloads = Reloads} = State) ->
    {noreply, State#state{reloads = starl_cluster_reload:expired({trial, Timer}, Reloads)}};
handle_info({reload_patience, N}, #state{reloads = Reloads} = State) ->
    {noreply, State#state{reloads = starl_cluster_reload:expired({patience, N}, Reloads)}};
handle_info({again, Id}, State) ->
    {noreply, again(Id, State)};
handle_info(_Message, State) ->
    {noreply, State}.

-spec terminate(term(), #state{}) -> ok.
terminate(_Reason, #state{nodes = Nodes, world = World}) ->
    ok = starl_cluster_control:close(),
    lists:foreach(
        fun starl_sim_peers:kill/1, [P || #node{peer = P} <- maps:values(Nodes), P =/= none]
    ),
    true = unlink(World),
    true = exit(World, shutdown),
    ok.

%% -- nodes ----------------------------------------------------------------------------------

%% Ends the robots and their recordings; a node that does not answer is killed soon.
closed(#state{nodes = Nodes, specs = Specs}) ->
    Recorded = [
        starl_sim_peers:node(Peer)
     || {Id, #node{peer = Peer}} <- maps:to_list(Nodes),
        Peer =/= none,
        #{Id := #{recorder := _}} <- [Specs]
    ],
    _ = erpc:multicall(Recorded, starl_live_sup, close, [], ?CALL_MS),
    ok.

opened(Id, Peer, #state{nodes = Nodes, specs = Specs} = State) ->
    #{Id := Spec} = Specs,
    Before = maps:get(Id, Nodes, #node{peer = none}),
    Node = starl_sim_peers:node(Peer),
    case starl_cluster_node:open(Node, Id, coded(Spec, State), code(State)) of
        {ok, _} ->
            Links = link_of(Node),
            Opened = State#state{
                nodes = Nodes#{Id => Before#node{peer = Peer}},
                reloads = starl_cluster_reload:rejoined(Id, Links, State#state.reloads)
            },
            ok = aired(Id, Opened),
            {ok, Opened};
        {error, Reason} ->
            {error, starl_live_sup:format_error(Reason)}
    end.

%% Its end is no news.
given_up(Peer) ->
    true = unlink(starl_sim_peers:control(Peer)),
    ok = starl_sim_peers:kill(Peer).

coded(Spec, #state{reloads = Reloads}) -> Spec#{codes => starl_cluster_reload:codes(Reloads)}.

code(#state{code = Code, reloads = Reloads}) -> Code ++ starl_cluster_reload:code(Reloads).

lost(Id, #state{nodes = Nodes, reloads = Reloads} = State) ->
    #{Id := Node} = Nodes,
    logger:notice(#{what => node_ended, robot => Id}),
    later(Id, State#state{
        nodes = Nodes#{Id := Node#node{peer = none}},
        reloads = starl_cluster_reload:lost(Id, Reloads)
    }).

later(Id, State) ->
    _ = erlang:send_after(?AGAIN_MS, self(), {again, Id}),
    State.

again(Id, #state{names = Names, nodes = Nodes} = State) ->
    #{Id := #node{restarts = N} = Node} = Nodes,
    Counted = State#state{nodes = Nodes#{Id := Node#node{restarts = N + 1}}},
    case starl_sim_peers:start_as([maps:get(Id, Names)]) of
        {ok, [Peer]} ->
            opened_again(Id, Peer, Counted);
        {error, Reason} ->
            logger:error(#{what => node_not_started, robot => Id, why => Reason}),
            later(Id, State)
    end.

opened_again(Id, Peer, State) ->
    case opened(Id, Peer, State) of
        {ok, Next} ->
            Next;
        {error, Why} ->
            Line = unicode:characters_to_binary(Why),
            logger:error(#{what => robot_not_started, robot => Id, why => Line}),
            ok = given_up(Peer),
            later(Id, State)
    end.
