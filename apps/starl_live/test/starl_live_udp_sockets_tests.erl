%% The sockets of a robot. This module is a network, too: its sockets are its own.
-module(starl_live_udp_sockets_tests).
-include_lib("eunit/include/eunit.hrl").

-export([open/2, close/1]).

open(Port, _Options) -> {ok, {own, Port}}.

close({own, Port}) ->
    self() ! {closed, Port},
    ok.

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
