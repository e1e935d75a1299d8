%% @doc Opens the sockets of the UDP transport ({@link starl_live_udp}). They are the robot's own
%% socket and, if the configuration names a group, the socket for packets to all. It also reads the
%% addresses of the robots from the configuration.
-module(starl_live_udp_sockets).

-export([places/2, open/3, send/3, more/1, close/1]).

-export_type([t/0, all/0]).

-record(sockets, {
    %% gen_udp, or its stand-in in a simulation
    module :: module(),
    socket :: gen_udp:socket(),
    group = none :: gen_udp:socket() | none
}).

-opaque t() :: #sockets{}.

%% The address of a packet for all; `each': those of all robots.
-type all() :: each | starl_live_peers:address().

%% Messages of the socket to the process before it must ask for more: hostile traffic fills the
%% socket's buffer, not the process's mailbox.
-define(ACTIVE, 100).
-define(BUFFER, 1_000_000).

%% @doc The places of these robots, if each of them has one.
-spec places([starl:robot_id()], Given :: #{starl:robot_id() => term()}) ->
    {ok, #{starl:robot_id() => starl_live_peers:place()}} | {error, unicode:chardata()}.
places(Robots, Places) ->
    Given = [{Robot, maps:get(Robot, Places, none)} || Robot <- Robots],
    case [Robot || {Robot, Place} <- Given, not is_place(Place)] of
        [] ->
            {ok, maps:from_list([{Robot, numeric(Place)} || {Robot, Place} <- Given])};
        [Robot | _] ->
            Line = "peers: robot ~b: an address and a port expected, {\"192.168.1.11\", 5001}",
            {error, io_lib:format(Line, [Robot])}
    end.

is_place({_Host, Port}) -> is_integer(Port) andalso Port > 0 andalso Port < 65_536;
is_place(_) -> false.

%% A number that is written as a text needs no server of names.
numeric({Host, Port} = Place) when is_list(Host) ->
    case inet:parse_strict_address(Host) of
        {ok, Ip} -> {Ip, Port};
        {error, _} -> Place
    end;
numeric(Place) ->
    Place.

%% @doc Opens the sockets of a robot at its place; the configuration says where packets for all go.
-spec open(starl_live_peers:place(), module(), starl_live_udp:config()) ->
    {ok, t(), all()} | {error, unicode:chardata()}.
open({Host, Port}, Module, Config) ->
    case Module:open(Port, options([family(Host), {broadcast, true}])) of
        {ok, Socket} -> with_group(#sockets{module = Module, socket = Socket}, Config);
        {error, Why} -> {error, io_lib:format("port ~b: ~ts", [Port, inet:format_error(Why)])}
    end.

family(Address) when tuple_size(Address) =:= 8 -> inet6;
family(_) -> inet.

options(Options) -> [binary, {active, ?ACTIVE}, {recbuf, ?BUFFER} | Options].

%% Packets for all come to a port of their own. The robots of one computer share it.
with_group(#sockets{module = Module, socket = Socket}, #{
    all := {multicast, {A, _, _, _} = Address, _}
}) when
    A < 224; A > 239
->
    ok = Module:close(Socket),
    Line = "multicast ~ts: an address from 224.0.0.0 to 239.255.255.255 expected",
    {error, io_lib:format(Line, [inet:ntoa(Address)])};
with_group(
    #sockets{module = Module, socket = Socket} = Sockets, #{all := {Kind, Address, Port}} = Config
) ->
    Interface = maps:get(interface, Config, {0, 0, 0, 0}),
    case joined_group(Kind, Address, Port, Interface, Socket) of
        {ok, Group} ->
            {ok, Sockets#sockets{group = Group}, {Address, Port}};
        {error, Why} ->
            ok = Module:close(Socket),
            Line = "~ts ~ts, port ~b: ~ts",
            {error, io_lib:format(Line, [Kind, inet:ntoa(Address), Port, inet:format_error(Why)])}
    end;
with_group(Sockets, _Config) ->
    {ok, Sockets, each}.

joined_group(Kind, Address, Port, Interface, Socket) ->
    case gen_udp:open(Port, options([{reuseaddr, true}])) of
        {ok, Group} -> set(Group, Socket, Kind, Address, Interface);
        {error, _} = Error -> Error
    end.

set(Group, Socket, Kind, Address, Interface) ->
    Set = [
        inet:setopts(Group, membership(Kind, Address, Interface)),
        inet:setopts(Socket, outgoing(Kind, Interface))
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

%% @doc Sends a datagram.
-spec send(starl_live_peers:address(), iodata(), t()) -> ok | {error, inet:posix()}.
send({Address, Port}, Bytes, #sockets{module = Module, socket = Socket}) ->
    Module:send(Socket, Address, Port, Bytes).

%% @doc Asks a socket that has fallen silent for more.
-spec more(gen_udp:socket()) -> ok.
more(Socket) ->
    ok = inet:setopts(Socket, [{active, ?ACTIVE}]).

%% @doc Closes them.
-spec close(t()) -> ok.
close(#sockets{module = Module, socket = Socket, group = Group}) ->
    _ = [ok = Module:close(Group) || Group =/= none],
    Module:close(Socket).
