%% The sockets of the transport by UDP: the places of robots, and the group to which packets for all go, here on the
%% loopback interface.
-module(starl_live_udp_sockets_tests).
-include_lib("eunit/include/eunit.hrl").

%% This module is a network, too: its sockets are its own.
-export([open/2, close/1]).

-define(LOCAL, {127, 0, 0, 1}).

open(Port, _Options) -> {ok, {own, Port}}.

close({own, Port}) ->
    self() ! {closed, Port},
    ok.

%% Each robot has a host and a port; an address in a text is a number.
places_test_() ->
    Places = fun(Place) ->
        starl_live_udp_sockets:places([1, 2], #{1 => {?LOCAL, 1}, 2 => Place})
    end,
    [
        ?_assertEqual({Place, {ok, #{1 => {?LOCAL, 1}, 2 => Found}}}, {Place, Places(Place)})
     || {Place, Found} <- [
            {{?LOCAL, 65535}, {?LOCAL, 65535}},
            {{"10.0.0.2", 7}, {{10, 0, 0, 2}, 7}},
            {{"::1", 7}, {{0, 0, 0, 0, 0, 0, 0, 1}, 7}},
            {{"robot-2.lab", 7}, {"robot-2.lab", 7}},
            {{'robot-2', 7}, {'robot-2', 7}}
        ]
    ] ++
        [
            ?_assertMatch({Place, {error, _}}, {Place, Places(Place)})
         || Place <- [
                {?LOCAL, 0},
                {?LOCAL, 65536},
                {?LOCAL, -1},
                {?LOCAL, "7"},
                {?LOCAL, 7.5},
                ?LOCAL,
                none
            ]
        ] ++
        [
            ?_assertEqual(
                "peers: robot 2: an address and a port expected, {\"192.168.1.11\", 5001}",
                line(starl_live_udp_sockets:places([1, 2, 3], #{1 => {?LOCAL, 1}}))
            )
        ].

line({error, Line}) -> lists:flatten(Line).

%% A datagram goes from one socket to another; a hundred come, and more when the socket is asked for more.
datagrams_test() ->
    {ok, A, each} = opens(?LOCAL, #{}),
    {ok, B, each} = opens("localhost", #{}),
    {Socket, Port} = socket(B),
    Sends = fun(N) -> ok = starl_live_udp_sockets:send({?LOCAL, Port}, [<<N:32>>], A) end,
    [Sends(N) || N <- lists:seq(1, 100)],
    ?assertEqual(lists:seq(1, 100), [heard(Socket) || _ <- lists:seq(1, 100)]),
    receive
        {udp_passive, Socket} -> ok
    end,
    Sends(101),
    ok = starl_live_udp_sockets:more(Socket),
    ?assertEqual(101, heard(Socket)),
    {ok, [{recbuf, Buffer}, {broadcast, IsBroadcast}]} = inet:getopts(Socket, [recbuf, broadcast]),
    ?assert(Buffer > 100_000),
    ?assert(IsBroadcast),
    ok = starl_live_udp_sockets:close(A),
    ok = starl_live_udp_sockets:close(B),
    ?assertEqual(undefined, erlang:port_info(Socket)).

heard(Socket) ->
    receive
        {udp, Socket, _, _, <<N:32>>} -> N
    end.

%% The last port that this process has opened.
socket(_Sockets) ->
    {links, Links} = process_info(self(), links),
    Socket = lists:last(lists:sort([Port || Port <- Links, is_port(Port)])),
    {ok, Port} = inet:port(Socket),
    {Socket, Port}.

opens(Host, Config) -> starl_live_udp_sockets:open({Host, 0}, gen_udp, Config).

%% An address of six is one of the newer protocol.
families_test() ->
    case opens({0, 0, 0, 0, 0, 0, 0, 1}, #{}) of
        {ok, Sockets, each} ->
            {Socket, _} = socket(Sockets),
            ?assertMatch({ok, {{_, _, _, _, _, _, _, _}, _}}, inet:sockname(Socket)),
            ok = starl_live_udp_sockets:close(Sockets);
        {error, _} ->
            %% a computer without it
            ok
    end.

%% Packets for all go to the group; robots of one computer share its port, and hear each other.
groups_test() ->
    {links, Before} = process_info(self(), links),
    {ok, Any} = gen_udp:open(0, [{reuseaddr, true}]),
    {ok, Port} = inet:port(Any),
    ok = gen_udp:close(Any),
    Group = {239, 255, 77, 1},
    Config = #{all => {multicast, Group, Port}, interface => ?LOCAL},
    {ok, A, {Group, Port}} = opens(?LOCAL, Config),
    {ok, B, {Group, Port}} = opens(?LOCAL, Config),
    ok = starl_live_udp_sockets:send({Group, Port}, <<7:32>>, A),
    [
        receive
            {udp, _, _, _, <<7:32>>} -> ok
        end
     || _ <- [a, b]
    ],
    ok = starl_live_udp_sockets:close(A),
    ok = starl_live_udp_sockets:close(B),
    %% both of each are closed
    {links, After} = process_info(self(), links),
    ?assertEqual([], After -- Before).

%% A broadcast has no members.
broadcast_test() ->
    {ok, Any} = gen_udp:open(0, [{reuseaddr, true}]),
    {ok, Port} = inet:port(Any),
    ok = gen_udp:close(Any),
    All = {{127, 255, 255, 255}, Port},
    {ok, A, All} = opens(?LOCAL, #{all => {broadcast, {127, 255, 255, 255}, Port}}),
    ok = starl_live_udp_sockets:close(A).

%% One line on what is wrong; what was open is closed.
mistakes_are_one_line_test() ->
    {links, Before} = process_info(self(), links),
    Multicast = fun(First) ->
        line(opens(?LOCAL, #{all => {multicast, {First, 0, 0, 1}, 7}}))
    end,
    [
        ?assertEqual(
            "multicast " ++ integer_to_list(First) ++
                ".0.0.1: an address from 224.0.0.0 to 239.255.255.255 expected",
            Multicast(First)
        )
     || First <- [223, 240]
    ],
    {ok, Other} = gen_udp:open(0, []),
    {ok, Taken} = inet:port(Other),
    Line = io_lib:format("multicast 224.0.0.1, port ~b: address already in use", [Taken]),
    ?assertEqual(
        lists:flatten(Line), line(opens(?LOCAL, #{all => {multicast, {224, 0, 0, 1}, Taken}}))
    ),
    ?assertEqual(
        lists:flatten(io_lib:format("port ~b: address already in use", [Taken])),
        line(starl_live_udp_sockets:open({?LOCAL, Taken}, gen_udp, #{}))
    ),
    {ok, Any} = gen_udp:open(0, [{reuseaddr, true}]),
    {ok, Free} = inet:port(Any),
    ok = gen_udp:close(Any),
    %% no address of an interface
    NoSuch = #{all => {multicast, {239, 1, 2, 3}, Free}, interface => {256, 0, 0, 1}},
    ?assertMatch("multicast 239.1.2.3, port " ++ _, line(opens(?LOCAL, NoSuch))),
    ok = gen_udp:close(Other),
    {links, After} = process_info(self(), links),
    ?assertEqual(lists:sort(Before), lists:sort(After)).

%% What has opened a socket closes it, where there is no way to all.
a_socket_that_is_of_no_use_is_closed_test() ->
    All = {multicast, {192, 168, 1, 1}, 5000},
    {error, Line} = starl_live_udp_sockets:open({{10, 0, 0, 1}, 5001}, ?MODULE, #{all => All}),
    ?assertEqual(
        "multicast 192.168.1.1: an address from 224.0.0.0 to 239.255.255.255 expected",
        lists:flatten(Line)
    ),
    ?assertEqual(
        {closed, 5001},
        receive
            {closed, _} = Closed -> Closed
        after 0 -> open
        end
    ).

%% Modules of tests share a process: those after this one find nothing of it.
nothing_is_left_test() -> starl_platform_ct:forget().
