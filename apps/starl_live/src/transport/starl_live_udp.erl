%% @doc The transport by UDP: sealed datagrams between the robots of a fleet. See
%% `doc/transports.md' for their format and for what an attacker can do.
%%
%% A packet for all goes to each robot in turn, or once to a multicast or broadcast address, by
%% configuration. Bytes leave at a bounded pace ({@link starl_live_pace}). A robot that has just
%% heard a packet for all waits for a short random time before it sends something to that packet's
%% source, so that the acknowledgements of a broadcast do not come all at once. The time is at most
%% a tenth of SAP's first retransmission delay.
-module(starl_live_udp).
-behaviour(starl_live_transport).

-export([open/1, transmit/3, hear/2, figures/1, close/1]).

-export_type([config/0]).

%% Beside the keys of every transport and of {@link starl_live_seal}: `peers': where each robot
%% hears, this one as well; `all': the way of a packet for all; `interface': the address of the
%% network that carries multicast; `rate': bytes per millisecond; `spread_ms': the longest wait
%% before an answer to a packet for all. A simulation gives it other sockets, a module with the
%% functions of `gen_udp' that are used here, and a random stream.
-type config() :: #{
    robot := starl:robot_id(),
    participants := starl_team:t(),
    fleet := unicode:chardata(),
    run := non_neg_integer(),
    key := starl_live_key:t(),
    peers := #{starl:robot_id() => {inet:hostname() | inet:ip_address(), inet:port_number()}},
    all => each | {multicast | broadcast, inet:ip4_address(), inet:port_number()},
    interface => inet:ip4_address(),
    rate => pos_integer(),
    spread_ms => non_neg_integer(),
    fresh_ms => pos_integer(),
    clock => starl_live_clock:t(),
    sockets => module(),
    random => fun(() -> rand:state()),
    atom() => term()
}.

%% Messages of the socket to the process before it must ask for more: hostile traffic fills the
%% socket's buffer, not the process's mailbox.
-define(ACTIVE, 100).
-define(BUFFER, 1_000_000).
%% 8 Mbit/s, and a burst of some milliseconds of a usual wireless network.
-define(RATE, 1000).
-define(BURST, 16_000).
%% What is sent to a robot within this time after its packet for all is taken for an answer.
-define(ANSWER_MS, 20).
-define(SPREAD_MS, 25).
%% The most datagrams that wait before an answer; beyond that they go at once.
-define(HELD, 1000).

-type address() :: {inet:ip_address(), inet:port_number()}.
-type datagram() :: {address(), iodata()}.

-record(udp, {
    clock :: starl_live_clock:t(),
    sockets :: module(),
    socket :: gen_udp:socket(),
    group :: gen_udp:socket() | none,
    %% the addresses of a packet for all
    all :: [address()],
    peers :: #{starl:robot_id() => address()},
    seal :: starl_live_seal:t(),
    fragments :: starl_live_fragment:t(),
    pace :: starl_live_pace:t(datagram()),
    flush = none :: reference() | none,
    spread_ms :: non_neg_integer(),
    %% when each robot was last heard with a packet for all
    calls = #{} :: #{starl:robot_id() => Ms :: integer()},
    held = 0 :: non_neg_integer(),
    random :: rand:state(),
    figures = #{} :: starl_live_figures:t()
}).

%% -- opening --------------------------------------------------------------------------------

-spec open(config()) -> {ok, #udp{}} | {error, unicode:chardata()}.
open(#{robot := Robot, participants := Team, peers := Peers} = Config) ->
    steps(
        [
            fun(Opened) -> peers([Robot | starl_team:others(Robot, Team)], Peers, Opened) end,
            fun(Opened) -> sealed(Config, Opened) end,
            fun(Opened) -> socket(Robot, sockets(Config), Opened) end,
            fun(Opened) -> group(Config, Opened) end,
            fun(Opened) -> {ok, udp(Config, Opened)} end
        ],
        #{}
    ).

steps([], Opened) ->
    {ok, Opened};
steps([Step | Steps], Opened) ->
    case Step(Opened) of
        {ok, Next} -> steps(Steps, Next);
        {error, _} = Error -> Error
    end.

peers(Robots, Peers, Opened) ->
    Found = [{Robot, peer(maps:get(Robot, Peers, none))} || Robot <- Robots],
    case [{Robot, Why} || {Robot, {error, Why}} <- Found] of
        [] -> {ok, Opened#{peers => maps:from_list(Found)}};
        [{Robot, Why} | _] -> {error, io_lib:format("peers: robot ~b: ~ts", [Robot, Why])}
    end.

peer({Host, Port}) when is_integer(Port), Port > 0, Port < 65_536 ->
    case address(Host) of
        {ok, Address} -> {Address, Port};
        {error, Why} -> {error, io_lib:format("~tp: ~ts", [Host, inet:format_error(Why)])}
    end;
peer(_) ->
    {error, "an address and a port expected, {\"192.168.1.11\", 5001}"}.

address(Address) when tuple_size(Address) =:= 4; tuple_size(Address) =:= 8 -> {ok, Address};
address(Host) -> inet:getaddr(Host, inet).

sealed(Config, Opened) ->
    case starl_live_seal:new(Config, starl_live_clock:system_time(millisecond, clock(Config))) of
        {ok, Seal} -> {ok, Opened#{seal => Seal}};
        {error, _} = Error -> Error
    end.

%% Without a clock: that of this computer.
clock(Config) -> maps:get(clock, Config, starl_live_clock:new(0, 1)).

sockets(Config) -> maps:get(sockets, Config, gen_udp).

socket(Robot, Sockets, #{peers := Peers} = Opened) ->
    {Address, Port} = maps:get(Robot, Peers),
    case Sockets:open(Port, options([family(Address), {broadcast, true}])) of
        {ok, Socket} -> {ok, Opened#{socket => Socket}};
        {error, Why} -> {error, io_lib:format("port ~b: ~ts", [Port, inet:format_error(Why)])}
    end.

family(Address) when tuple_size(Address) =:= 8 -> inet6;
family(_) -> inet.

options(Options) -> [binary, {active, ?ACTIVE}, {recbuf, ?BUFFER} | Options].

%% Packets for all come to a port of their own. The robots of one computer share it.
group(#{all := {multicast, {A, _, _, _} = Address, _}}, #{socket := Socket}) when
    A < 224; A > 239
->
    gen_udp:close(Socket),
    Line = "multicast ~ts: an address from 224.0.0.0 to 239.255.255.255 expected",
    {error, io_lib:format(Line, [inet:ntoa(Address)])};
group(#{all := {Way, Address, Port}} = Config, #{socket := Socket} = Opened) ->
    Interface = maps:get(interface, Config, {0, 0, 0, 0}),
    case joined_group(Way, Address, Port, Interface, Socket) of
        {ok, Group} ->
            {ok, Opened#{group => Group, all => [{Address, Port}]}};
        {error, Why} ->
            gen_udp:close(Socket),
            Line = "~ts ~ts, port ~b: ~ts",
            {error, io_lib:format(Line, [Way, inet:ntoa(Address), Port, inet:format_error(Why)])}
    end;
group(#{robot := Robot}, #{peers := Peers} = Opened) ->
    {ok, Opened#{group => none, all => maps:values(maps:remove(Robot, Peers))}}.

joined_group(Way, Address, Port, Interface, Socket) ->
    case gen_udp:open(Port, options([{reuseaddr, true}])) of
        {ok, Group} -> set(Group, Socket, Way, Address, Interface);
        {error, _} = Error -> Error
    end.

set(Group, Socket, Way, Address, Interface) ->
    Set = [
        inet:setopts(Group, membership(Way, Address, Interface)),
        inet:setopts(Socket, outgoing(Way, Interface))
    ],
    case [Error || {error, _} = Error <- Set] of
        [] ->
            {ok, Group};
        [Error | _] ->
            gen_udp:close(Group),
            Error
    end.

membership(multicast, Address, Interface) -> [{add_membership, {Address, Interface}}];
membership(broadcast, _Address, _Interface) -> [].

outgoing(multicast, Interface) -> [{multicast_if, Interface}, {multicast_loop, true}];
outgoing(broadcast, _Interface) -> [].

udp(Config, #{socket := Socket, group := Group, all := All, peers := Peers, seal := Seal}) ->
    Rate = maps:get(rate, Config, ?RATE),
    Clock = clock(Config),
    Random = maps:get(random, Config, fun() -> rand:seed_s(exsss) end),
    #udp{
        clock = Clock,
        sockets = sockets(Config),
        socket = Socket,
        group = Group,
        all = All,
        peers = Peers,
        seal = Seal,
        fragments = starl_live_fragment:new(starl_live_seal:room()),
        pace = starl_live_pace:new(Rate, max(?BURST, Rate), now_us(Clock)),
        spread_ms = maps:get(spread_ms, Config, min(?SPREAD_MS, map_size(Peers) div 2)),
        random = Random()
    }.

%% -- sending --------------------------------------------------------------------------------

-spec transmit(starl:robot_id() | all, starl_packet:t(), #udp{}) ->
    {ok, #udp{}} | {refused, unicode:chardata(), #udp{}}.
transmit(To, Packet, #udp{} = Udp) ->
    case {starl_live_codec:encode(Packet), addresses(To, Udp)} of
        {{error, Why}, _} ->
            {refused, starl_live_codec:format_error(Packet, Why), Udp};
        {_, unknown} ->
            {ok, count(unknown_peer, Udp)};
        {{ok, Bytes}, Addresses} ->
            Datagrams = [
                {Address, Sealed}
             || Sealed <- sealed(To, Bytes, now_ms(Udp), Udp#udp.seal), Address <- Addresses
            ],
            {ok, answer(To, Datagrams, count(sent, Udp))}
    end.

addresses(all, #udp{all = All}) ->
    All;
addresses(To, #udp{peers = Peers}) ->
    case Peers of
        #{To := Address} -> [Address];
        #{} -> unknown
    end.

sealed(To, Bytes, Now, Seal) ->
    Payloads = starl_live_fragment:split(starl_live_seal:room(), Bytes),
    [starl_live_seal:seal(To, Payload, Now, Seal) || Payload <- Payloads].

answer(To, Datagrams, #udp{calls = Calls, spread_ms = Spread, held = Held} = Udp) ->
    case Calls of
        #{To := At} when Spread > 0, Held < ?HELD ->
            hold(now_ms(Udp) - At =< max(?ANSWER_MS, Spread), Datagrams, Udp);
        #{} ->
            put_on_air(Datagrams, Udp)
    end.

hold(false, Datagrams, Udp) ->
    put_on_air(Datagrams, Udp);
hold(true, Datagrams, #udp{spread_ms = Spread, held = Held, random = Random} = Udp) ->
    {Wait, Next} = rand:uniform_s(Spread + 1, Random),
    _ = starl_live_clock:send_after(Wait - 1, {?MODULE, held, Datagrams}, Udp#udp.clock),
    Udp#udp{held = Held + 1, random = Next}.

put_on_air(Datagrams, Udp) -> flush(lists:foldl(fun wait/2, Udp, Datagrams)).

wait({_, Bytes} = Datagram, #udp{pace = Pace} = Udp) ->
    case starl_live_pace:put(Datagram, iolist_size(Bytes), Pace) of
        {ok, Next} -> Udp#udp{pace = Next};
        full -> count(queue_full, Udp)
    end.

%% Sends what may go now; the rest when its time has come.
flush(#udp{flush = none, pace = Pace, clock = Clock} = Udp) ->
    {Datagrams, Wait, Next} = starl_live_pace:take(now_us(Clock), Pace),
    Sent = lists:foldl(fun send/2, Udp#udp{pace = Next}, Datagrams),
    Sent#udp{flush = timer(Wait, Clock)};
flush(Udp) ->
    Udp.

timer(infinity, _Clock) -> none;
timer(Wait, Clock) -> starl_live_clock:start_timer(Wait, flush, [], Clock).

send({{Address, Port}, Bytes}, #udp{sockets = Sockets, socket = Socket} = Udp) ->
    case Sockets:send(Socket, Address, Port, Bytes) of
        ok -> count(datagrams, Udp);
        %% No way to that robot now: the packet is lost.
        {error, _} -> count(send_error, Udp)
    end.

%% -- hearing --------------------------------------------------------------------------------

-spec hear(term(), #udp{}) -> {[starl_packet:t()], #udp{}} | unknown.
hear({udp, _Socket, _Address, _Port, Datagram}, #udp{seal = Seal} = Udp) ->
    case starl_live_seal:open(Datagram, now_ms(Udp), Seal) of
        {ok, From, To, Payload, Next} ->
            joined(From, Payload, called(From, To, Udp#udp{seal = Next}));
        {error, Why} ->
            {[], count(Why, Udp)}
    end;
hear({udp_passive, Socket}, Udp) ->
    ok = inet:setopts(Socket, [{active, ?ACTIVE}]),
    {[], Udp};
hear({timeout, Timer, flush}, #udp{flush = Timer} = Udp) ->
    {[], flush(Udp#udp{flush = none})};
hear({?MODULE, held, Datagrams}, #udp{held = Held} = Udp) ->
    {[], put_on_air(Datagrams, Udp#udp{held = Held - 1})};
%% A robot's computer has nobody at that port, or the like.
hear({udp_error, _Socket, _Why}, Udp) ->
    {[], count(socket_error, Udp)};
hear(_Message, _Udp) ->
    unknown.

called(From, all, #udp{calls = Calls} = Udp) -> Udp#udp{calls = Calls#{From => now_ms(Udp)}};
called(_From, _To, Udp) -> Udp.

joined(From, Payload, #udp{fragments = Fragments} = Udp) ->
    case starl_live_fragment:join(From, Payload, now_ms(Udp), Fragments) of
        {whole, Bytes, Next} ->
            decoded(From, starl_live_codec:decode(From, Bytes), Udp#udp{fragments = Next});
        {more, Next} ->
            {[], Udp#udp{fragments = Next}};
        {error, Why, Next} ->
            {[], count(Why, Udp#udp{fragments = Next})}
    end.

decoded(_From, {ok, Packet}, Udp) ->
    {[Packet], Udp};
decoded(From, {error, Why}, #udp{figures = Figures} = Udp) ->
    {[], Udp#udp{figures = starl_live_figures:refused(Why, From, Figures)}}.

count(What, #udp{figures = Figures} = Udp) ->
    Udp#udp{figures = starl_live_figures:count(What, Figures)}.

%% The clock by which packets are fresh: that of the computers, whatever the pace of the run.
now_ms(#udp{clock = Clock}) -> starl_live_clock:system_time(millisecond, Clock).

now_us(Clock) -> starl_live_clock:monotonic_time(microsecond, Clock).

-spec figures(#udp{}) -> starl_live_transport:figures().
figures(#udp{figures = Figures}) -> Figures.

-spec close(#udp{}) -> ok.
close(#udp{sockets = Sockets, socket = Socket, group = Group}) ->
    _ = [ok = Sockets:close(Group) || Group =/= none],
    Sockets:close(Socket).
