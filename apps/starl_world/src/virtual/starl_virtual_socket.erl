%% @doc The sockets of a simulated network, in the place of `gen_udp' ({@link starl_live_udp}). What is
%% sent comes to the calling process at once, as a {@link datagram()}: the process that runs the
%% simulation decides what becomes of it. Robot N has the address 10.0.0.N.
-module(starl_virtual_socket).

-export([peers/1, heard/3]).
-export([open/2, send/4, close/1]).

-export_type([t/0, datagram/0]).

-opaque t() :: {?MODULE, inet:port_number()}.

-type datagram() :: {starl_virtual_sent, To :: starl:robot_id(), binary()}.

-define(PORT, 5000).

%% @doc The addresses of robots, for the configuration of {@link starl_live_udp}.
-spec peers([starl:robot_id()]) ->
    #{starl:robot_id() => {inet:ip4_address(), inet:port_number()}}.
peers(Robots) -> maps:from_list([{Robot, {address(Robot), ?PORT + Robot}} || Robot <- Robots]).

address(Robot) -> {10, 0, Robot div 256, Robot rem 256}.

%% @doc The message of a robot's socket when this datagram of another one has come.
-spec heard(From :: starl:robot_id(), To :: starl:robot_id(), binary()) -> tuple().
heard(From, To, Bytes) ->
    {udp, {?MODULE, ?PORT + To}, address(From), ?PORT + From, Bytes}.

%% @doc As `gen_udp:open/2'.
-spec open(inet:port_number(), [term()]) -> {ok, t()}.
open(Port, _Options) -> {ok, {?MODULE, Port}}.

%% @doc As `gen_udp:send/4'.
-spec send(t(), inet:ip4_address(), inet:port_number(), iodata()) -> ok.
send({?MODULE, _From}, _Address, Port, Bytes) ->
    self() ! {starl_virtual_sent, Port - ?PORT, iolist_to_binary(Bytes)},
    ok.

%% @doc As `gen_udp:close/1'.
-spec close(t()) -> ok.
close({?MODULE, _Port}) -> ok.
