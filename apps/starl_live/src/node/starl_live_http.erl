%% @doc Serves the metrics of a robot's node over HTTP: `/metrics' in the text format of Prometheus,
%% and `/health', which names what is wrong with the robot (status 503). The parser of OTP's sockets reads the
%% requests. Each request has a process of its own and a limited time. When there are too many
%% clients, the oldest is closed.
-module(starl_live_http).

-export([start_link/1]).

-export_type([problems/0]).

-type problems() :: fun(() -> [unicode:chardata()]).

-define(TEXT, "text/plain; version=0.0.4; charset=utf-8").
%% The longest time that a request may take to come, and an answer to go; the most lines of a request; the
%% most clients at a time.
-define(PATIENCE_MS, 2000).
-define(MOST_LINES, 100).
-define(MOST_CLIENTS, 16).
%% The time after which a server without a free file descriptor tries again.
-define(AGAIN_MS, 200).

%% @doc Starts the server at an address, which should be one of a network that the fleet trusts.
%% `problems' answers what is wrong with the robot, beside a link that does not answer.
-spec start_link(#{ip := inet:ip_address(), port := inet:port_number(), problems => problems()}) ->
    {ok, pid()} | {error, unicode:chardata()}.
start_link(#{ip := Ip, port := Port} = Config) ->
    Problems = maps:get(problems, Config, fun() -> [] end),
    Options =
        [{ip, Ip}, {active, false}, {packet, http_bin}, {reuseaddr, true}, binary] ++
            [{send_timeout, ?PATIENCE_MS}, {send_timeout_close, true}],
    case gen_tcp:listen(Port, Options) of
        {ok, Socket} ->
            Pid = proc_lib:spawn_link(fun() -> serve(Socket, Problems, []) end),
            ok = gen_tcp:controlling_process(Socket, Pid),
            {ok, Pid};
        {error, Posix} ->
            {error, io_lib:format("metrics at port ~b: ~ts", [Port, inet:format_error(Posix)])}
    end.

%% `Clients': the processes of the last ones, the newest first.
serve(Listening, Problems, Clients) ->
    case gen_tcp:accept(Listening) of
        {ok, Socket} ->
            serve(Listening, Problems, [client(Socket, Problems) | fewer(Clients)]);
        {error, closed} ->
            exit({shutdown, {metrics, closed}});
        {error, _Posix} ->
            receive
            after ?AGAIN_MS -> serve(Listening, Problems, Clients)
            end
    end.

fewer(Clients) ->
    Alive = [Pid || Pid <- Clients, is_process_alive(Pid)],
    {Left, Old} = lists:split(min(?MOST_CLIENTS - 1, length(Alive)), Alive),
    lists:foreach(fun(Pid) -> exit(Pid, kill) end, Old),
    Left.

client(Socket, Problems) ->
    Pid = spawn(fun() -> answered(Socket, Problems) end),
    _ = gen_tcp:controlling_process(Socket, Pid),
    Pid ! {Socket, yours},
    Pid.

answered(Socket, Problems) ->
    receive
        {Socket, yours} -> ok
    end,
    Until = erlang:monotonic_time(millisecond) + ?PATIENCE_MS,
    _ = answer(request(Socket, Until, ?MOST_LINES, none), Problems, Socket),
    gen_tcp:close(Socket).

%% The path, when all lines of the request have been read.
request(_Socket, _Until, 0, _Path) ->
    bad;
request(Socket, Until, Left, Path) ->
    case gen_tcp:recv(Socket, 0, max(0, Until - erlang:monotonic_time(millisecond))) of
        {ok, {http_request, 'GET', {abs_path, Asked}, _}} ->
            request(Socket, Until, Left - 1, Asked);
        {ok, {http_header, _, _, _, _}} ->
            request(Socket, Until, Left - 1, Path);
        {ok, http_eoh} ->
            Path;
        _ ->
            bad
    end.

answer(<<"/metrics">>, _Ills, Socket) -> send(metrics(), Socket);
answer(<<"/health">>, Problems, Socket) -> send(health(Problems), Socket);
answer(bad, _Ills, Socket) -> send({400, "GET, please\n"}, Socket);
answer(_Path, _Ills, Socket) -> send({404, "there are /metrics and /health\n"}, Socket).

send({Status, Text}, Socket) ->
    Body = unicode:characters_to_binary(Text),
    Head =
        "HTTP/1.1 ~b ~ts\r\nContent-Type: ~ts\r\nContent-Length: ~b\r\nConnection: close\r\n\r\n",
    Values = [Status, reason(Status), ?TEXT, byte_size(Body)],
    gen_tcp:send(Socket, [io_lib:format(Head, Values), Body]).

reason(200) -> "OK";
reason(400) -> "Bad Request";
reason(404) -> "Not Found";
reason(503) -> "Service Unavailable".

health(Problems) ->
    case link() of
        none -> {503, "no robot runs\n"};
        _ -> health_of(Problems)
    end.

health_of(Ask) ->
    try Ask() of
        [] -> {200, "ok\n"};
        Problems -> {503, [["it ", Problem, $\n] || Problem <- Problems]}
    catch
        exit:_ -> {503, "the robot does not answer\n"}
    end.

metrics() ->
    case link() of
        none -> {503, "no robot runs\n"};
        Link -> with(Link)
    end.

with(Link) ->
    try {starl_live_link:metrics(Link), gauges(Link)} of
        {{Gauges, Counts}, Ports} -> {200, starl_live_counts:text(Gauges ++ Ports ++ vm(), Counts)}
    catch
        exit:_ -> {503, "the robot does not answer\n"}
    end.

link() ->
    try starl_live_sup:robot() of
        none -> none;
        Robot -> starl_live_robot:link(Robot)
    catch
        exit:_ -> none
    end.

%% The counters of the radio and of the positioning system, the other robots, and the body.
gauges(Link) ->
    Transport = starl_live_link:port(Link, transport),
    Radio = starl_live_transport:figures(Transport),
    Peers = starl_live_transport:peers(Transport),
    Chassis = starl_live_chassis:condition(starl_live_link:port(Link, chassis)),
    Sight = starl_live_positioning:figures(starl_live_link:port(Link, positioning)),
    [{radio, [{what, What}], N} || {What, N} <- maps:to_list(Radio)] ++
        [{positioning, [{what, What}], N} || {What, N} <- maps:to_list(Sight)] ++
        starl_live_counts:peers(Peers) ++ starl_live_counts:chassis(Chassis).

vm() ->
    [
        {memory_bytes, [], erlang:memory(total)},
        {processes, [], erlang:system_info(process_count)},
        {atoms, [], erlang:system_info(atom_count)},
        {uptime_seconds, [], erlang:convert_time_unit(uptime(), native, second)}
    ].

uptime() -> erlang:monotonic_time() - erlang:system_info(start_time).
