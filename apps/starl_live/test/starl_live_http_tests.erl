%% The server of metrics and health: many clients side by side, slow ones among them.
-module(starl_live_http_tests).
-include_lib("eunit/include/eunit.hrl").
-export([init/1, idle/0]).

%% Clients that say nothing more keep nobody: they wait on while another one is answered.
slow_test() ->
    {Server, Port} = started(),
    Slow = [slow(Port) || _ <- lists:seq(1, 3)],
    ?assertMatch(<<"HTTP/1.1 503", _/binary>>, asked("/health", Port)),
    ?assertMatch(<<"HTTP/1.1 404", _/binary>>, asked("/", Port)),
    ?assertEqual([open, open, open], [state(Socket) || Socket <- Slow]),
    stopped(Server).

%% Of too many, the first ones have to go; the last one is answered.
many_test() ->
    {Server, Port} = started(),
    Slow = [slow(Port) || _ <- lists:seq(1, 20)],
    ?assertMatch(<<"HTTP/1.1 503", _/binary>>, asked("/health", Port)),
    ?assertEqual({error, closed}, gen_tcp:recv(hd(Slow), 0)),
    ?assertEqual(open, state(lists:last(Slow))),
    stopped(Server).

%% A robot whose link is there is well as far as it says so itself.
health_test() ->
    {ok, Sup} = starl_live_sup:start_link(),
    {ok, _} = supervisor:start_child(Sup, #{
        id => robot, type => supervisor, start => {supervisor, start_link, [?MODULE, []]}
    }),
    Health = fun(Problems) ->
        Port = free(),
        {ok, Server} = starl_live_http:start_link(#{
            ip => {127, 0, 0, 1}, port => Port, problems => Problems
        }),
        [Head, Body] = binary:split(asked("/health", Port), <<"\r\n\r\n">>),
        stopped(Server),
        {binary:part(Head, 9, 3), Body}
    end,
    ?assertEqual({<<"200">>, <<"ok\n">>}, Health(fun() -> [] end)),
    ?assertEqual(
        {<<"503">>, <<"it has given up\nit is lost\n">>},
        Health(fun() -> ["has given up", "is lost"] end)
    ),
    ?assertEqual(
        {<<"503">>, <<"the robot does not answer\n">>}, Health(fun() -> exit(noproc) end)
    ),
    stopped(Sup).

%% A robot with a link that does nothing.
init([]) -> {ok, {#{}, [#{id => link, start => {?MODULE, idle, []}}]}}.

idle() ->
    {ok,
        spawn_link(fun() ->
            receive
                stop -> ok
            end
        end)}.

%% A server of metrics that ends does not end the node.
ended_test() ->
    Robot = self(),
    {ok, Sup} = starl_live_sup:start_link(),
    {error, _} = starl_live_sup:open(#{robot => Robot}, #{ip => {127, 0, 0, 1}, port => free()}),
    [{metrics, Metrics, _, _}] = [
        C
     || C <- supervisor:which_children(Sup), element(1, C) =:= metrics
    ],
    Ref = erlang:monitor(process, Metrics),
    exit(Metrics, {shutdown, {metrics, closed}}),
    receive
        {'DOWN', Ref, _, _, _} -> ok
    end,
    ?assert(is_list(supervisor:which_children(Sup))),
    stopped(Sup).

started() ->
    Port = free(),
    {ok, Server} = starl_live_http:start_link(#{ip => {127, 0, 0, 1}, port => Port}),
    {Server, Port}.

stopped(Pid) ->
    true = unlink(Pid),
    Ref = erlang:monitor(process, Pid),
    exit(Pid, shutdown),
    receive
        {'DOWN', Ref, _, _, _} -> ok
    end.

free() ->
    {ok, Socket} = gen_tcp:listen(0, [{ip, {127, 0, 0, 1}}]),
    {ok, Port} = inet:port(Socket),
    ok = gen_tcp:close(Socket),
    Port.

connected(Port) ->
    {ok, Socket} = gen_tcp:connect({127, 0, 0, 1}, Port, [binary, {active, false}]),
    Socket.

slow(Port) ->
    Socket = connected(Port),
    ok = gen_tcp:send(Socket, "GET /metrics HTTP/1.1\r\nHo"),
    Socket.

asked(Path, Port) ->
    Socket = connected(Port),
    ok = gen_tcp:send(Socket, ["GET ", Path, " HTTP/1.1\r\nHost: robot\r\n\r\n"]),
    all(Socket, <<>>).

all(Socket, Read) ->
    case gen_tcp:recv(Socket, 0) of
        {ok, Bytes} -> all(Socket, <<Read/binary, Bytes/binary>>);
        {error, closed} -> Read
    end.

state(Socket) ->
    case gen_tcp:recv(Socket, 0, 0) of
        {error, timeout} -> open;
        {error, closed} -> closed
    end.
