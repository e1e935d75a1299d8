%% @doc The benchmark of live robots: message round trips and rates over each transport, and the
%% start of nodes. It measures a SAP message until it is acknowledged, and the messages per second
%% of a pair of robots. A bare round trip of the same kind, in the same minute, serves for
%% comparison. For nodes it measures the start-up time and the memory.
-module(starl_dev_bench_live).
-behaviour(starl_dev_benchmark).

-export([flags/0, run/1, echo_udp/0]).
-export([head/1, line/1]).

-spec flags() -> [starl_cli_flags:flag()].
flags() ->
    [
        {messages, {integer, 10, 100000}, 1000, "messages sent one by one, and posted at once"},
        {nodes, {integer, 2, 50}, 5, "nodes that are started at once"}
    ].

-spec run(starl_dev_benchmark:options()) -> [starl_dev_benchmark:figures()].
run(#{messages := N, nodes := Nodes}) ->
    _ = process_flag(trap_exit, true),
    starl_cli_terminal:out(head(N)),
    Rows = [pair(Transport, N) || Transport <- [local, dist, udp]],
    Rows ++ [start_up(Nodes)].

pair(Transport, N) ->
    Bare = bare(Transport, N),
    #{robots := [{1, #{result := {done, Times}}}, {2, #{result := {done, Took}}}]} =
        play(Transport, #{robots => 2, sends => N, posts => N}),
    {BareMedian, BareLate} = quantiles(Bare),
    {Median, Late} = quantiles(Times),
    Rate = N * 1000000 div max(1, Took),
    Figures = [
        {transport, atom_to_binary(Transport)},
        {bare_us_median, BareMedian},
        {bare_us_p99, BareLate},
        {message_us_median, Median},
        {message_us_p99, Late},
        {times_bare, Median / max(1, BareMedian)},
        {messages_per_s, Rate}
    ],
    starl_cli_terminal:out(line(Figures)),
    Figures.

%% @private The heading.
-spec head(Messages :: pos_integer()) -> unicode:chardata().
head(N) ->
    [
        io_lib:format("live, ~b messages; round trips, us: median and 99 %~n", [N]),
        "bare: a term, or a datagram, there and back between two processes\n"
        "transport  bare us     99 %  message us      99 %   ratio  messages/s\n"
    ].

%% @private A row.
-spec line(starl_dev_benchmark:figures()) -> unicode:chardata().
line(Figures) ->
    io_lib:format("~-9ts ~8b ~8b ~11b ~9b ~7.1f ~11b\n", [Value || {_, Value} <- Figures]).

quantiles(Times) ->
    Sorted = lists:sort(Times),
    {at(0.5, Sorted), at(0.99, Sorted)}.

at(Part, Sorted) -> lists:nth(max(1, round(Part * length(Sorted))), Sorted).

%% -- robots ---------------------------------------------------------------------------------

play(local, Given) ->
    with_dir(fun(Dir) ->
        {ok, Run} = starl_world_run:start(scenario(Given), #{dir => Dir, air => #{}}),
        done = starl_world_run:await(Run),
        {Outcome, _} = starl_world_run:finish(Run),
        Outcome
    end);
play(Transport, Given) ->
    with_dir(fun(Dir) ->
        Options = #{dir => Dir, transport => Transport, air => #{}},
        {ok, Cluster} = starl_world_run:start(scenario(Given), Options),
        done = starl_world_run:await(Cluster),
        {Outcome, _} = starl_world_run:finish(Cluster),
        Outcome
    end).

scenario(Given) -> Given#{app => starl_live_pair}.

with_dir(Do) ->
    {ok, Dir} = starl_private_dir:new("bench"),
    try
        Do(Dir)
    after
        starl_private_dir:remove(Dir)
    end.

start_up(Nodes) ->
    with_dir(fun(Dir) ->
        Begin = erlang:monotonic_time(millisecond),
        {ok, Cluster} = starl_world_run:start(
            scenario(#{robots => Nodes, sends => 1, posts => 1}), #{dir => Dir, transport => udp}
        ),
        Ms = erlang:monotonic_time(millisecond) - Begin,
        #{os_pids := Pids} = starl_world_run:status(Cluster),
        Mb = [resident_mb(Pid) || Pid <- maps:values(Pids)],
        _ = starl_world_run:await(Cluster),
        _ = starl_world_run:finish(Cluster),
        starl_cli_terminal:out("~b nodes: started in ~b ms, ~.1f MB each (resident)\n", [
            Nodes, Ms, lists:sum(Mb) / Nodes
        ]),
        [{nodes, Nodes}, {start_ms, Ms}, {resident_mb_each, lists:sum(Mb) / Nodes}]
    end).

%% Linux counts pages of 4 KiB.
resident_mb(OsPid) ->
    {ok, Text} = file:read_file("/proc/" ++ OsPid ++ "/statm"),
    [_, Pages | _] = string:lexemes(Text, " "),
    binary_to_integer(Pages) * 4096 / 1.0e6.

%% -- bare round trips -----------------------------------------------------------------------

bare(local, N) ->
    Echo = spawn_link(fun echo/0),
    Times = [there_and_back(Echo) || _ <- lists:seq(1, N)],
    true = unlink(Echo),
    true = exit(Echo, kill),
    Times;
bare(dist, N) ->
    with_peer(fun(Node) ->
        Echo = spawn(Node, fun echo/0),
        [there_and_back(Echo) || _ <- lists:seq(1, N)]
    end);
bare(udp, N) ->
    with_peer(fun(Node) ->
        Port = erpc:call(Node, ?MODULE, echo_udp, []),
        {ok, Socket} = gen_udp:open(0, [binary, {ip, {127, 0, 0, 1}}, {active, true}]),
        Times = [datagram(Socket, Port) || _ <- lists:seq(1, N)],
        ok = gen_udp:close(Socket),
        Times
    end).

with_peer(Do) ->
    {ok, [Peer]} = starl_sim_peers:start(1),
    try
        Do(starl_sim_peers:node(Peer))
    after
        starl_sim_peers:stop(Peer)
    end.

echo() ->
    receive
        {From, Term} -> From ! {back, Term}
    end,
    echo().

there_and_back(Echo) ->
    Begin = erlang:monotonic_time(microsecond),
    Echo ! {self(), {starl, message, Begin}},
    receive
        {back, _} -> erlang:monotonic_time(microsecond) - Begin
    end.

%% @private
-spec echo_udp() -> inet:port_number().
echo_udp() ->
    Caller = self(),
    _ = spawn(fun() ->
        {ok, Socket} = gen_udp:open(0, [binary, {ip, {127, 0, 0, 1}}, {active, true}]),
        {ok, Port} = inet:port(Socket),
        Caller ! {port, Port},
        reflect(Socket)
    end),
    receive
        {port, Port} -> Port
    end.

reflect(Socket) ->
    receive
        {udp, Socket, Ip, Port, Bytes} -> ok = gen_udp:send(Socket, Ip, Port, Bytes)
    end,
    reflect(Socket).

datagram(Socket, Port) ->
    Begin = erlang:monotonic_time(microsecond),
    ok = gen_udp:send(Socket, {127, 0, 0, 1}, Port, <<Begin:64, 0:(92 * 8)>>),
    receive
        {udp, Socket, _, _, _} -> erlang:monotonic_time(microsecond) - Begin
    end.
