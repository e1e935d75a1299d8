%% @doc The socket on which a positioning system's datagrams arrive: unicast, broadcast, or a
%% multicast group to join. Several robots of one computer may listen to the same port, if the
%% datagrams are broadcast or multicast.
%%
%% Options: `port'; `group', the multicast address to join; `interface', the address of the network
%% card on which it is joined (any). Addresses are strings, "239.255.42.99", or tuples.
-module(starl_live_datagrams).

-export([open/2, address/1, hear/2]).

%% Datagrams that may wait in the process' mailbox; the system holds the others, and drops what is
%% beyond its buffer.
-define(ACTIVE, 64).
-define(BUFFER, 1048576).
%% The largest datagram.
-define(LARGEST, 65536).

%% @doc Opens the socket for the calling process; one line on what went wrong.
-spec open(inet:port_number(), map()) -> {ok, gen_udp:socket()} | {error, iolist()}.
open(Port, Options) ->
    case membership(Options) of
        {ok, Membership} -> opened(Port, gen_udp:open(Port, options() ++ Membership), Options);
        {error, _} = Error -> Error
    end.

options() ->
    [
        binary,
        {active, ?ACTIVE},
        {reuseaddr, true},
        {broadcast, true},
        {recbuf, ?BUFFER},
        {buffer, ?LARGEST}
    ].

opened(_Port, {ok, Socket}, _Options) ->
    {ok, Socket};
opened(Port, {error, Reason}, #{group := Group}) ->
    {error,
        io_lib:format("cannot join the multicast group ~s on UDP port ~b: ~s", [
            text(Group), Port, inet:format_error(Reason)
        ])};
opened(Port, {error, Reason}, _Options) ->
    {error, io_lib:format("cannot open UDP port ~b: ~s", [Port, inet:format_error(Reason)])}.

text(Address) when is_tuple(Address) -> inet:ntoa(Address);
text(Address) -> Address.

membership(#{group := Group} = Options) ->
    case {address(Group), address(maps:get(interface, Options, {0, 0, 0, 0}))} of
        {{ok, {A, _, _, _} = At}, {ok, Interface}} when A >= 224, A =< 239 ->
            {ok, [{add_membership, {At, Interface}}, {multicast_loop, true}]};
        {{ok, _}, {ok, _}} ->
            {error,
                io_lib:format("~0p is no multicast address (224.0.0.0 to 239.255.255.255)", [Group])};
        {{error, _} = Error, _} ->
            Error;
        {_, {error, _} = Error} ->
            Error
    end;
membership(_Options) ->
    {ok, []}.

%% @doc An IPv4 address, from a string or a tuple.
-spec address(term()) -> {ok, inet:ip4_address()} | {error, iolist()}.
address({_, _, _, _} = Address) ->
    case inet:ntoa(Address) of
        {error, _} -> no_address(Address);
        _ -> {ok, Address}
    end;
address(Text) ->
    case io_lib:printable_unicode_list(Text) andalso inet:parse_ipv4strict_address(Text) of
        {ok, Address} -> {ok, Address};
        _ -> no_address(Text)
    end.

no_address(Term) -> {error, io_lib:format("~0p is no IPv4 address like \"192.168.1.20\"", [Term])}.

%% @doc What a message means to the socket: a datagram, nothing to do, or that it is another's.
-spec hear(Message :: term(), gen_udp:socket()) ->
    {datagram, inet:ip_address(), binary()} | nothing | unknown.
hear({udp, Socket, From, _Port, Datagram}, Socket) ->
    {datagram, From, Datagram};
hear({udp_passive, Socket}, Socket) ->
    %% A socket that is closed says so by a message of its own.
    _ = inet:setopts(Socket, [{active, ?ACTIVE}]),
    nothing;
hear({udp_error, Socket, _Reason}, Socket) ->
    nothing;
hear({udp_closed, Socket}, Socket) ->
    exit(positioning_socket_closed);
hear(_, _) ->
    unknown.
