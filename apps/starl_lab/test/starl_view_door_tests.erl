%% The door of the window: connections that show no token take nobody's room, and none of them stays when there
%% are too many.
-module(starl_view_door_tests).
-include_lib("eunit/include/eunit.hrl").

-define(C, starl_view_client).
-define(MOST, 128).

view(Test) ->
    {timeout, 120, fun() ->
        {ok, View} = starl_view:start(#{port => 0}),
        #{port := Port, fragment := Token} = uri_string:parse(
            binary_to_list(starl_view:address(View))
        ),
        Test(View, {Port, Token}),
        starl_view:stop(View)
    end}.

open(Port, From) ->
    {ok, Socket} = gen_tcp:connect({127, 0, 0, 1}, Port, [
        binary, {active, false}, {ip, From}
    ]),
    Socket.

page({Port, _} = Door) ->
    {Status, Socket} = ?C:connect(Door, [{"Origin", "http://127.0.0.1:" ++ integer_to_list(Port)}]),
    ?assertEqual(101, Status),
    ?assertMatch({rows, _}, ?C:next(Socket, 20000)),
    Socket.

is_open(Socket) ->
    case gen_tcp:recv(Socket, 0, 0) of
        {error, timeout} -> true;
        {error, closed} -> false
    end.

%% What has been asked before this has been handled.
settled(View) -> starl_view_door:strangers(starl_view:door(View)).

%% 1,400 connections that say nothing: who has the token gets in, and who was in stays in; few of the
%% others are left.
silent_connections_test_() -> view(fun silent_connections/2).

silent_connections(View, {Port, _} = Door) ->
    Before = page(Door),
    Silent = [open(Port, {127, 0, 0, 1}) || _ <- lists:seq(1, 1400)],
    After = page(Door),
    ?assert(settled(View) =< ?MOST),
    ?assert(length([S || S <- Silent, is_open(S)]) =< ?MOST + 4),
    [?assertEqual(ok, ?C:send("k", Page)) || Page <- [Before, After]],
    [?assertNotMatch({error, closed}, ?C:next(Page, 0)) || Page <- [Before, After]],
    ?assertMatch({200, _}, ?C:get(Port, "/", [])).

%% The same with requests that are not finished.
slow_requests_test_() -> view(fun slow_requests/2).

slow_requests(View, {Port, _} = Door) ->
    Slow = [open(Port, {127, 0, 0, 1}) || _ <- lists:seq(1, 400)],
    _ = [gen_tcp:send(Socket, "GET / HTTP/1.1\r\nHost: 127.0.0.1\r\n") || Socket <- Slow],
    _ = page(Door),
    ?assert(settled(View) =< ?MOST).

%% Connections that show wrong tokens again and again: each answer takes half a second, and a connection may ask
%% a thousand times.
%% Holds: Who has the token always gets into the window, whatever comes without one
%% Red: 4ca8e259, run
wrong_tokens_test_() -> view(fun wrong_tokens/2).

wrong_tokens(View, {Port, _} = Door) ->
    Test = self(),
    Open = fun() ->
        Socket = open(Port, {127, 0, 0, 1}),
        Test ! opened,
        guess(Socket)
    end,
    Guessing = [spawn_link(Open) || _ <- lists:seq(1, 1400)],
    [
        receive
            opened -> ok
        end
     || _ <- Guessing
    ],
    Page = page(Door),
    ?assertEqual(ok, ?C:send("k", Page)),
    ?assert(settled(View) =< ?MOST),
    [
        begin
            unlink(Pid),
            exit(Pid, kill)
        end
     || Pid <- Guessing
    ].

guess(Socket) ->
    Request = "GET /ws?token=no HTTP/1.1\r\nHost: 127.0.0.1\r\nConnection: keep-alive\r\n\r\n",
    case {gen_tcp:send(Socket, Request), gen_tcp:recv(Socket, 0, 60000)} of
        {ok, {ok, _}} -> guess(Socket);
        _ -> ok
    end.

%% One address that opens many does not shut out another one.
another_address_test_() -> view(fun another_address/2).

another_address(View, {Port, _}) ->
    Other = open(Port, {127, 0, 0, 2}),
    %% its connection has begun
    ok = gen_tcp:send(Other, "GET / HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n"),
    {ok, _} = gen_tcp:recv(Other, 15, 20000),
    _ = [open(Port, {127, 0, 0, 3}) || _ <- lists:seq(1, 400)],
    ?assert(settled(View) =< ?MOST),
    ok = gen_tcp:send(Other, "GET / HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n"),
    ?assertMatch({ok, _}, gen_tcp:recv(Other, 15, 20000)).

%% Connections that end are forgotten.
forgotten_test_() -> view(fun forgotten/2).

forgotten(View, {Port, _}) ->
    [gen_tcp:close(open(Port, {127, 0, 0, 1})) || _ <- lists:seq(1, 10)],
    none_left(View).

none_left(View) ->
    case settled(View) of
        0 ->
            ok;
        _ ->
            erlang:yield(),
            none_left(View)
    end.
