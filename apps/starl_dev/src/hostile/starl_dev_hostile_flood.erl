%% @doc Sends hostile datagrams to the port of a robot's node, no faster than the node handles them. After each
%% batch it asks for the counters of the node's transport.
-module(starl_dev_hostile_flood).

-export([start/2, finish/1, lives/1]).
%% Called on the robot's node.
-export([vitals/0]).

-export_type([aim/0, report/0, vitals/0]).

-type aim() :: #{
    node := node(),
    port := inet:port_number(),
    packets := starl_dev_hostile_packets:t()
}.

%% Atoms, bytes of memory after garbage collection, and the loaded modules.
-type vitals() :: {Atoms :: non_neg_integer(), Bytes :: non_neg_integer(), [module()]}.

%% `sent': by kind; `genuine': how many datagrams of the pools were sent; `before': early in the
%% flood, when all code has been used.
-type report() :: #{
    sent := #{starl_dev_hostile_packets:kind() => pos_integer()},
    genuine := non_neg_integer(),
    before := vitals() | none,
    later := vitals(),
    figures := starl_live_transport:figures()
}.

-record(flood, {
    owner :: pid(),
    aim :: aim(),
    socket :: gen_udp:socket(),
    transport :: pid(),
    packets :: starl_dev_hostile_packets:t(),
    left :: non_neg_integer(),
    %% when the robot is looked at first: a tenth of all
    early :: non_neg_integer(),
    n = 0 :: non_neg_integer(),
    sent = #{} :: #{atom() => pos_integer()},
    genuine = 0 :: non_neg_integer(),
    before = none :: vitals() | none
}).

%% Fewer than the socket's buffer holds, so that the robots' own packets find room.
-define(BATCH, 50).
-define(POOL_EVERY, 10_000).
-define(CALL_MS, 60_000).
-define(PAUSE_MS, 100).
-define(LOOPBACK, {127, 0, 0, 1}).

%% @doc Sends so many datagrams at most.
-spec start(aim(), non_neg_integer()) -> pid().
start(Aim, Number) ->
    Owner = self(),
    spawn_link(fun() -> init(Owner, Aim, Number) end).

%% @doc Ends the flood.
-spec finish(pid()) -> report().
finish(Flood) ->
    Flood ! {finish, self()},
    receive
        {flood, Flood, Report} -> Report
    end.

init(Owner, #{node := Node, packets := Packets} = Aim, Number) ->
    {ok, Socket} = gen_udp:open(0, [binary, {ip, ?LOOPBACK}, {active, false}]),
    flood(#flood{
        owner = Owner,
        aim = Aim,
        socket = Socket,
        transport = transport(Node),
        packets = Packets,
        left = Number,
        early = Number div 10
    }).

transport(Node) ->
    Robot = erpc:call(Node, starl_live_sup, robot, [], ?CALL_MS),
    Link = erpc:call(Node, starl_live_robot, link, [Robot], ?CALL_MS),
    starl_live_link:port(Link, transport).

%% @doc The lives of the other robots, as soon as the robot of this node has heard them all.
-spec lives(node()) -> #{starl:robot_id() => starl_live_seal:life()}.
lives(Node) ->
    Peers = starl_live_transport:peers(transport(Node)),
    case [Robot || #{robot := Robot, life := none} <- Peers] of
        [] ->
            maps:from_list([{Robot, Life} || #{robot := Robot, life := Life} <- Peers]);
        _ ->
            receive
            after ?PAUSE_MS -> lives(Node)
            end
    end.

flood(#flood{left = 0} = Flood) ->
    receive
        {finish, From} -> report(From, Flood)
    end;
flood(#flood{} = Flood) ->
    receive
        {finish, From} -> report(From, Flood)
    after 0 ->
        Ready = early(pool(Flood)),
        Next = batch(min(?BATCH, Ready#flood.left), Ready),
        _ = starl_live_transport:figures(Next#flood.transport),
        flood(Next)
    end.

%% The datagrams of a pool are stale after some seconds.
pool(#flood{n = N, packets = Packets, genuine = Genuine} = Flood) when N rem ?POOL_EVERY =:= 0 ->
    Renewed = starl_dev_hostile_packets:renewed(Packets),
    Pool = starl_dev_hostile_packets:pool(Renewed),
    lists:foreach(fun(Datagram) -> send(Datagram, Flood) end, Pool),
    Flood#flood{packets = Renewed, genuine = Genuine + length(Pool)};
pool(Flood) ->
    Flood.

early(#flood{n = N, early = Early, before = none, aim = #{node := Node}} = Flood) when N >= Early ->
    Flood#flood{before = vitals(Node)};
early(Flood) ->
    Flood.

batch(0, Flood) ->
    Flood;
batch(Size, #flood{packets = Packets, sent = Sent, n = N, left = Left} = Flood) ->
    {Kind, Datagram, Next} = starl_dev_hostile_packets:next(Packets),
    ok = send(Datagram, Flood),
    Counted = maps:update_with(Kind, fun(Before) -> Before + 1 end, 1, Sent),
    batch(Size - 1, Flood#flood{packets = Next, sent = Counted, n = N + 1, left = Left - 1}).

send(Datagram, #flood{socket = Socket, aim = #{port := Port}}) ->
    ok = gen_udp:send(Socket, ?LOOPBACK, Port, Datagram).

report(From, #flood{aim = #{node := Node}, transport = Transport, socket = Socket} = Flood) ->
    ok = gen_udp:close(Socket),
    Report = #{
        sent => Flood#flood.sent,
        genuine => Flood#flood.genuine,
        before => Flood#flood.before,
        later => vitals(Node),
        figures => starl_live_transport:figures(Transport)
    },
    true = unlink(Flood#flood.owner),
    From ! {flood, self(), Report}.

vitals(Node) -> erpc:call(Node, ?MODULE, vitals, [], ?CALL_MS).

%% @private
-spec vitals() -> vitals().
vitals() ->
    lists:foreach(fun erlang:garbage_collect/1, processes()),
    %% the question for memory makes atoms itself
    Memory = erlang:memory(total),
    Modules = [Module || {Module, _} <- code:all_loaded()],
    {erlang:system_info(atom_count), Memory, Modules}.
