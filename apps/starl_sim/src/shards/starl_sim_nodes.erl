%% @doc Manages the nodes of a simulation. It opens node parts on them before the run
%% ({@link starl_sim_sites}), assigns the shards to them, and monitors the nodes. Every failure of a
%% node is reported to the run in bounded time.
%% ```
%%   node gone          its site's monitor fires                        down
%%   node stopped       it answers no ping for the time-out             silent
%%   a shard hangs      the node answers, but no window has come to     slow
%%                      an end within the time-out
%% '''
%% A silent node is disconnected. That frees all processes that wait for it or for room in the
%% buffer to it. Time is counted in ticks that this process has seen: if this VM itself was held up,
%% no other node is blamed.
-module(starl_sim_nodes).
-behaviour(gen_server).

-export([start_link/0, open/2, watch/2, loss/2, sites/1, format_error/1, format_loss/1]).
-export([init/1, handle_call/3, handle_cast/2, handle_info/2, terminate/2]).

-export_type([options/0, nodes/0, loss/0, reason/0]).

%% A number of peers on this machine, or running nodes that have the application's code.
-type nodes() :: pos_integer() | [node(), ...].

%% `modules' are those of the scene; `code' was compiled in memory and is in no file.
-type options() :: #{
    nodes := nodes(),
    timeout_ms := pos_integer(),
    modules := [module()],
    code := [{module(), file:filename(), Beam :: binary()}]
}.

%% A lost node, why it was lost, and the virtual time up to which all windows are known; `work': who was at
%% work on a slow one.
-type loss() :: #{
    node := node(),
    why := down | silent | slow,
    timeout_ms := pos_integer(),
    at_us := starl_sim_queue:time(),
    work => [starl_sim_watchdog:work(), ...]
}.

-type reason() :: starl_sim_sites:reason() | {lost, loss()}.

-record(nodes, {
    timeout_ms = 0 :: non_neg_integer(),
    peers = [] :: [starl_sim_peers:t()],
    sites = #{} :: #{node() => starl_sim_site:t()},
    %% the number of pings sent to each node since its last answer
    unanswered = #{} :: #{node() => non_neg_integer()},
    run = none :: pid() | none,
    lost = [] :: [loss()],
    %% the run's last report of its progress, and how often it has repeated it
    progress = none :: starl_sim_run:progress() | none,
    same = 0 :: non_neg_integer(),
    asked = false :: boolean()
}).

%% The number of ticks in the time-out, and the shortest tick in milliseconds.
-define(TICKS, 10).
-define(LEAST_TICK_MS, 20).

%% @doc Starts the process, without any nodes.
-spec start_link() -> gen_server:start_ret().
start_link() -> gen_server:start_link(?MODULE, [], []).

%% @doc Starts or checks the nodes and opens a site on each, in their order.
-spec open(pid(), options()) -> {ok, [starl_sim_site:t()]} | {error, reason()}.
open(Nodes, Options) -> gen_server:call(Nodes, {open, Options}, infinity).

%% @doc Registers the run: from now on it gets `{lost, loss()}' when a node is lost.
-spec watch(pid(), Run :: pid()) -> ok.
watch(Nodes, Run) -> gen_server:cast(Nodes, {watch, Run}).

%% @doc The loss of a node that was found to be out of reach.
-spec loss(pid(), node()) -> loss().
loss(Nodes, Node) -> gen_server:call(Nodes, {loss, Node}, infinity).

%% @doc The sites that are not lost.
-spec sites(pid()) -> [starl_sim_site:t()].
sites(Nodes) -> gen_server:call(Nodes, sites, infinity).

%% @doc One line on why the nodes cannot be used, and what to do.
-spec format_error(reason()) -> unicode:chardata().
format_error({lost, Loss}) -> format_loss(Loss);
format_error(Reason) -> starl_sim_sites:format_error(Reason).

%% @doc One line on a lost node: which node, when, and what to do.
-spec format_loss(loss()) -> unicode:chardata().
format_loss(#{node := Node, why := Why, at_us := At, timeout_ms := Ms} = Loss) ->
    io_lib:format("node ~ts ~ts~ts; virtual time ~.3f s; ~ts", [
        Node, what(Why, Ms / 1000), at_work(Loss), At / 1.0e6, advice(Why)
    ]).

at_work(#{work := Work}) -> [": ", starl_sim_watchdog:format_work(Work)];
at_work(#{}) -> "".

what(down, _Seconds) -> "is gone";
what(silent, Seconds) -> io_lib:format("has not answered for ~.1f s", [Seconds]);
what(slow, Seconds) -> io_lib:format("answers, but has not ended a window for ~.1f s", [Seconds]).

advice(down) ->
    "see why it ended (killed, out of memory, unplugged?), then run again, without it if need be";
advice(silent) ->
    "see whether it is stopped, swapping or cut off, then run again, without it if need be";
advice(slow) ->
    "is there an endless loop in the application, or can it not reach one of the other nodes? "
    "If it only is slow, raise the time-out".

%% -- server ---------------------------------------------------------------------------------

-spec init([]) -> {ok, #nodes{}}.
init([]) ->
    _ = process_flag(trap_exit, true),
    {ok, #nodes{}}.

-spec handle_call(term(), gen_server:from(), #nodes{}) -> {reply, term(), #nodes{}}.
handle_call({open, #{nodes := Wanted, timeout_ms := Ms} = Options}, _From, Nodes) ->
    case starl_sim_sites:start(Wanted) of
        {ok, Names, Peers} ->
            Own = Nodes#nodes{timeout_ms = Ms, peers = Peers},
            opened(starl_sim_sites:open(Names, Options), Own);
        {error, _} = Error ->
            {reply, Error, Nodes}
    end;
handle_call(sites, _From, #nodes{sites = Sites} = Nodes) ->
    {reply, maps:values(Sites), Nodes};
handle_call({loss, Node}, _From, #nodes{lost = Lost} = Nodes) ->
    case [Loss || #{node := N} = Loss <- Lost, N =:= Node] of
        [Loss | _] ->
            {reply, Loss, Nodes};
        [] ->
            Next = lose(Node, down, Nodes),
            {reply, hd(Next#nodes.lost), Next}
    end.

-spec handle_cast({watch, pid()}, #nodes{}) -> {noreply, #nodes{}}.
handle_cast({watch, Run}, #nodes{lost = Lost} = Nodes) ->
    _ = [Run ! {lost, Loss} || Loss <- lists:reverse(Lost)],
    {noreply, Nodes#nodes{run = Run}}.

-spec handle_info(term(), #nodes{}) -> {noreply, #nodes{}} | {stop, shutdown, #nodes{}}.
handle_info(tick, Nodes) ->
    {noreply, tick(Nodes)};
handle_info({pong, Site, _K}, #nodes{unanswered = Unanswered} = Nodes) ->
    case Unanswered of
        #{node(Site) := _} ->
            {noreply, Nodes#nodes{unanswered = Unanswered#{node(Site) := 0}}};
        #{} ->
            {noreply, Nodes}
    end;
handle_info({progress, Progress}, Nodes) ->
    {noreply, progressed(Progress, Nodes#nodes{asked = false})};
handle_info({'DOWN', _, process, Site, _}, #nodes{sites = Sites} = Nodes) ->
    case Sites of
        #{node(Site) := #{server := Site}} -> {noreply, lose(node(Site), down, Nodes)};
        #{} -> {noreply, Nodes}
    end;
handle_info({timeout, _, close}, Nodes) ->
    {noreply, Nodes};
handle_info({'EXIT', _Peer, _}, Nodes) ->
    %% the node's monitor reports it
    {noreply, Nodes}.

%% Nothing is left over: not on other nodes, and no peer.
-spec terminate(term(), #nodes{}) -> ok.
terminate(_Reason, #nodes{sites = Sites, peers = Peers, lost = Lost}) ->
    ok = starl_sim_sites:close(maps:values(Sites)),
    Silent = [Node || #{node := Node, why := silent} <- Lost],
    lists:foreach(
        fun(Peer) ->
            case lists:member(starl_sim_peers:node(Peer), Silent) of
                true -> starl_sim_peers:kill(Peer);
                false -> starl_sim_peers:stop(Peer)
            end
        end,
        Peers
    ).

opened({ok, Sites}, Nodes) ->
    _ = [erlang:monitor(process, Server) || #{server := Server} <- Sites],
    ok = tick_later(Nodes),
    {reply, {ok, Sites}, Nodes#nodes{
        sites = maps:from_list([{Node, Site} || #{node := Node} = Site <- Sites]),
        unanswered = maps:from_list([{Node, 0} || #{node := Node} <- Sites])
    }};
opened({error, _} = Error, Nodes) ->
    {reply, Error, Nodes}.

%% -- watching -------------------------------------------------------------------------------

tick_later(#nodes{timeout_ms = Ms}) ->
    _ = erlang:send_after(max(?LEAST_TICK_MS, Ms div ?TICKS), self(), tick),
    ok.

tick(#nodes{unanswered = Unanswered} = Nodes) ->
    ok = tick_later(Nodes),
    Silent = [Node || {Node, ?TICKS} <- lists:sort(maps:to_list(Unanswered))],
    Left = lists:foldl(fun(Node, N) -> lose(Node, silent, N) end, Nodes, Silent),
    ask(ping(Left)).

ping(#nodes{sites = Sites, unanswered = Unanswered} = Nodes) ->
    ok = lists:foreach(fun(Site) -> starl_sim_site:ping(Site, 0) end, maps:values(Sites)),
    Nodes#nodes{unanswered = maps:map(fun(_, K) -> K + 1 end, Unanswered)}.

%% One question at a time: a run that is busy judging must not have to answer many of them.
ask(#nodes{run = Run, asked = false} = Nodes) when is_pid(Run) ->
    Run ! {progress, self()},
    Nodes#nodes{asked = true};
ask(Nodes) ->
    Nodes.

%% When a run makes no progress, its shards wait for the shards that are still missing.
progressed({_, _, [Late | _]} = Progress, #nodes{progress = Progress, same = ?TICKS} = Nodes) ->
    Node = node(Late),
    Why =
        case maps:get(Node, Nodes#nodes.unanswered, 0) > ?TICKS div 2 of
            true -> silent;
            false -> slow
        end,
    lose(Node, Why, work(Why, Nodes#nodes.run), Nodes#nodes{progress = none, same = 0});
progressed({_, _, [_ | _]} = Progress, #nodes{progress = Progress, same = Same} = Nodes) ->
    Nodes#nodes{same = Same + 1};
progressed(Progress, Nodes) ->
    Nodes#nodes{progress = Progress, same = 0}.

%% The shards that are waited for answer, or are at work themselves.
work(slow, Run) ->
    case [Work || {_, _, _} = Work <- starl_sim_watchdog:at_work(Run)] of
        [] -> #{};
        [_ | _] = Known -> #{work => Known}
    end;
work(silent, _Run) ->
    #{}.

lose(Node, Why, Nodes) -> lose(Node, Why, #{}, Nodes).

lose(Node, Why, Work, #nodes{sites = Sites, timeout_ms = Ms} = Nodes) ->
    Loss = Work#{node => Node, why => Why, timeout_ms => Ms, at_us => 0},
    Left = maps:remove(Node, Sites),
    _ = Why =:= silent andalso erlang:disconnect_node(Node),
    ok = lists:foreach(fun(Site) -> starl_sim_site:abandon(Site, Node) end, maps:values(Left)),
    _ = is_pid(Nodes#nodes.run) andalso (Nodes#nodes.run ! {lost, Loss}),
    %% a slow node is told that the run is over
    Slow = [Site || {N, Site} <- maps:to_list(Sites), N =:= Node, Why =:= slow],
    ok = starl_sim_sites:close(Slow),
    Nodes#nodes{
        sites = Left,
        unanswered = maps:remove(Node, Nodes#nodes.unanswered),
        lost = [Loss | Nodes#nodes.lost]
    }.
