%% The contract of transports, over each of them: a packet arrives as it was sent or not at all, at
%% one robot or at all others, and nothing comes from anybody but a robot of the same fleet and run,
%% in its own name.
-module(starl_live_transport_SUITE).
-include_lib("proper/include/proper.hrl").
-include_lib("stdlib/include/assert.hrl").
-import(starl_live_team_ct, [
    start/3, stop/1, add/3, drop/2, transmit/4, figures/2, set_air/3, hear/3, exchange/2, counted/3
]).

-export([
    suite/0, all/0, groups/0, init_per_suite/1, end_per_suite/1, init_per_group/2, end_per_group/2
]).
-export([
    to_one/1,
    to_all/1,
    unchanged/1,
    plain_data/1,
    odd_refused/1,
    refused_line_said_once/1,
    strangers/1,
    impostor/1,
    not_for_us/1,
    reboot/1,
    gone/1,
    lossy_air/1,
    delayed_air/1,
    mistakes/1,
    secrets_hidden/1
]).
-export([dead_connection/1]).
%% called in the conductor
-export([contract/2, dead_connection_there/2]).

suite() -> [{timetrap, {minutes, 1}}].

all() -> [{group, Kind} || Kind <- kinds()].

kinds() -> [local, udp, multicast, dist].

groups() -> [{Kind, [], cases(Kind)} || Kind <- kinds()].

cases(dist) -> contract() ++ [dead_connection];
cases(_Kind) -> contract().

contract() ->
    [
        to_one,
        to_all,
        unchanged,
        plain_data,
        odd_refused,
        refused_line_said_once,
        strangers,
        impostor,
        not_for_us,
        reboot,
        gone,
        lossy_air,
        delayed_air,
        mistakes,
        secrets_hidden
    ].

init_per_suite(Config) -> starl_platform_ct:without_log(Config).

end_per_suite(Config) -> starl_platform_ct:with_log(Config).

%% Nodes find each other in a node: this VM is none.
init_per_group(dist, Config) ->
    Cookie = "starl" ++ integer_to_list(erlang:phash2(make_ref())),
    Starter = starter(),
    {ok, Conductor, _} = started(Starter, Cookie),
    Others = [started(Starter, Cookie) || _ <- [1, 2, 3]],
    Nodes = maps:from_list(lists:zip([1, 2, 3], [Node || {ok, _, Node} <- Others])),
    [{kind, dist}, {more, #{nodes => Nodes}}, {conductor, Conductor}, {starter, Starter} | Config];
init_per_group(Kind, Config) ->
    [{kind, Kind}, {more, #{}} | Config].

end_per_group(dist, Config) ->
    Starter = proplists:get_value(starter, Config),
    Monitor = monitor(process, Starter),
    Starter ! stop,
    receive
        {'DOWN', Monitor, process, Starter, _} -> ok
    end;
end_per_group(_Kind, _Config) ->
    ok.

%% The nodes end with the process that started them, which outlives this one.
starter() -> spawn(fun start_nodes/0).

start_nodes() ->
    receive
        {start, From, Cookie} ->
            From ! {self(), starl_live_team_ct:start_node(Cookie)},
            start_nodes();
        stop ->
            exit(shutdown)
    end.

started(Starter, Cookie) ->
    Starter ! {start, self(), Cookie},
    receive
        {Starter, Started} -> Started
    end.

to_one(Config) -> contract(?FUNCTION_NAME, Config).
to_all(Config) -> contract(?FUNCTION_NAME, Config).
unchanged(Config) -> contract(?FUNCTION_NAME, Config).
plain_data(Config) -> contract(?FUNCTION_NAME, Config).
odd_refused(Config) -> contract(?FUNCTION_NAME, Config).
refused_line_said_once(Config) -> contract(?FUNCTION_NAME, Config).
strangers(Config) -> contract(?FUNCTION_NAME, Config).
impostor(Config) -> contract(?FUNCTION_NAME, Config).
not_for_us(Config) -> contract(?FUNCTION_NAME, Config).
reboot(Config) -> contract(?FUNCTION_NAME, Config).
gone(Config) -> contract(?FUNCTION_NAME, Config).
lossy_air(Config) -> contract(?FUNCTION_NAME, Config).
delayed_air(Config) -> contract(?FUNCTION_NAME, Config).
mistakes(Config) -> contract(?FUNCTION_NAME, Config).
secrets_hidden(Config) -> contract(?FUNCTION_NAME, Config).

%% Runs a case here, or in a node.
contract(Case, Config) when is_list(Config) ->
    Kind = proplists:get_value(kind, Config),
    More = proplists:get_value(more, Config),
    case proplists:get_value(conductor, Config) of
        undefined -> contract(Case, {Kind, More});
        Conductor -> peer:call(Conductor, ?MODULE, contract, [Case, {Kind, More}], 100_000)
    end;
contract(Case, {Kind, More}) ->
    Team = start(Kind, [1, 2, 3], More),
    try
        ok = run(Case, Team)
    after
        stop(Team)
    end.

news(From, Body) -> starl_packet:shout(From, {app, news}, Body).

%% -- what arrives ---------------------------------------------------------------------------

run(to_one, Team) ->
    Script = [{F, T, news(F, {F, T, N})} || F <- [1, 2, 3], T <- [1, 2, 3], F =/= T, N <- [1, 2]],
    Heard = exchange(Script, Team),
    [
        ?assertEqual(lists:sort([P || {_, T, P} <- Script, T =:= Robot]), lists:sort(Packets))
     || {Robot, Packets} <- Heard
    ],
    ok;
run(to_all, Team) ->
    Script = [{F, all, news(F, {F, N})} || F <- [1, 2, 3], N <- [1, 2]],
    Heard = exchange(Script, Team),
    [
        ?assertEqual(lists:sort([P || {F, all, P} <- Script, F =/= Robot]), lists:sort(Packets))
     || {Robot, Packets} <- Heard
    ],
    ok;
%% the packets' bodies are up to some kilobytes long
run(unchanged, Team) ->
    Prop = ?FORALL(
        Packets,
        list(starl_live_packets:packet(1)),
        starl_platform_ct:safely(fun() ->
            Heard = exchange([{1, 2, Packet} || Packet <- Packets], Team),
            Heard =:= [{1, []}, {2, Packets}, {3, []}]
        end)
    ),
    starl_platform_ct:property(Prop, 60);
%% Each for itself: the largest of them take many datagrams, and a socket's buffer is bounded.
run(plain_data, Team) ->
    [
        ?assertEqual(
            [{1, []}, {2, [news(1, Body)]}, {3, []}], exchange([{1, 2, news(1, Body)}], Team)
        )
     || Body <- starl_live_packets:plain()
    ],
    ok;
run(Case, Team) ->
    refused(Case, Team).

%% -- what does not arrive -----------------------------------------------------------------

refused(odd_refused, Team) ->
    Odd = starl_live_packets:odd(),
    Script = [{1, To, news(1, Body)} || {Body, _} <- Odd, To <- [2, all]],
    ?assertEqual([{1, []}, {2, []}, {3, []}], exchange(Script, Team)),
    ?assertMatch(#{refused := N} when N =:= 2 * length(Odd), figures(1, Team)),
    ok;
%% SAP sends again and again what cannot be sent.
refused(refused_line_said_once, Team) ->
    Node = node(starl_live_team_ct:pid(1, Team)),
    Lines = erpc:call(Node, starl_live_log_ct, lines, [
        starl_live_team_ct:pid(1, Team), [news(1, B) || B <- [{self()}, {self()}, make_ref()]]
    ]),
    ?assertMatch(
        [<<"a datagram {app,news} cannot be sent: it holds a process", _/binary>>, _], Lines
    ),
    ok;
%% Robots outside the team, of another run and of another fleet; the team is heard as before.
refused(strangers, Team) ->
    Others = [
        {stranger, renamed(Team)},
        {run, #{run => 2}},
        {fleet, #{fleet => "others"}}
    ],
    Before = lists:foldl(fun stranger/2, Team, Others),
    ?assertEqual([{1, []}, {2, []}], exchange([], Before)),
    ok;
%% A packet in another robot's name.
refused(impostor, Team) ->
    Heard = exchange([{1, 2, news(3, lie)}, {1, all, news(3, lie)}, {1, 2, news(1, truth)}], Team),
    ?assertEqual([{1, []}, {2, [news(1, truth)]}, {3, []}], Heard),
    ?assertMatch(#{sender := 2}, figures(2, Team)),
    ?assertMatch(#{sender := 1}, figures(3, Team)),
    ok;
refused(not_for_us, Team) ->
    ?assertEqual([{1, []}, {2, []}, {3, []}], exchange([{1, 9, news(1, x)}], Team)),
    ok;
refused(Case, Team) ->
    come_and_go(Case, Team).

%% -- robots that go and come ----------------------------------------------------------------

come_and_go(reboot, Team) ->
    Without = drop(2, Team),
    ?assertEqual(
        [{1, []}, {3, [news(1, x)]}], exchange([{1, 2, news(1, x)}, {1, 3, news(1, x)}], Without)
    ),
    Again = add(2, #{}, Without),
    ok = starl_live_team_ct:greet(Again),
    Script = [{2, all, news(2, back)}, {1, 2, news(1, welcome)}],
    ?assertEqual(
        [{1, [news(2, back)]}, {2, [news(1, welcome)]}, {3, [news(2, back)]}],
        exchange(Script, Again)
    ),
    _ = drop(2, Again),
    ok;
%% Nobody hears: the sender goes on.
come_and_go(gone, Team) ->
    Alone = drop(3, drop(2, Team)),
    ?assertEqual([{1, []}], exchange([{1, To, news(1, x)} || To <- [2, 3, all]], Alone)),
    ?assertMatch(#{}, figures(1, Alone)),
    ok;
come_and_go(Case, Team) ->
    air(Case, Team).

%% -- the air ----------------------------------------------------------------------------------

air(lossy_air, Team) ->
    Packet = news(1, x),
    ok = set_air(2, #{cut => [1]}, Team),
    transmit(1, all, Packet, Team),
    ?assertEqual([Packet], news_of(hear(3, 1, Team))),
    ok = counted(2, {air_lost, 1}, Team),
    ok = set_air(2, #{cut => [], duplicates => 1}, Team),
    transmit(1, 2, Packet, Team),
    ?assertEqual([Packet, Packet], hear(2, 2, Team)),
    ok = set_air(2, #{loss => 1}, Team),
    transmit(3, 2, news(3, y), Team),
    ok = counted(2, {air_lost, 2}, Team),
    ok = set_air(2, #{loss => 0, duplicates => 0}, Team),
    ?assertMatch([{1, []}, {2, [Packet]}, {3, []}], exchange([{1, 2, Packet}], Team)),
    ?assertMatch({error, _}, set_air(2, #{los => 1}, Team)),
    ok;
air(delayed_air, Team) ->
    ok = set_air(2, #{delay_ms => {1, 30}, seed => 4}, Team),
    Packets = [news(1, N) || N <- lists:seq(1, 30)],
    [transmit(1, 2, Packet, Team) || Packet <- Packets],
    Heard = hear(2, 30, Team),
    ?assertEqual(Packets, lists:sort(Heard)),
    ?assertNotEqual(Packets, Heard),
    ok;
air(Case, Team) ->
    configured(Case, Team).

%% -- configuration --------------------------------------------------------------------------

configured(mistakes, #{kind := Kind} = Team) ->
    Peers = maps:get(peers, starl_live_team_ct:config(1, Team), #{}),
    Kind =/= dist orelse ?assertEqual("robot 1 runs on this node already", refusal(#{}, Team)),
    Without = drop(1, Team),
    [
        ?assertEqual(Line, refusal(Mistake, Without))
     || {Mistake, Line} <- mistakes_of(local, Peers) ++ mistakes_of(Kind, Peers)
    ],
    ok;
configured(secrets_hidden, Team) ->
    Pid = starl_live_team_ct:pid(1, Team),
    Shown = lists:flatten(io_lib:format("~p ~w", [sys:get_status(Pid), sys:get_status(Pid)])),
    ?assertEqual(nomatch, string:find(Shown, "seal")),
    ?assertNotEqual(nomatch, string:find(Shown, "hidden")),
    ok.

%% Robot 3's end is another's for a while.
stranger({Why, More}, Team) ->
    Other = add(3, More, without(3, Team)),
    shouted(Why, maps:get(Why, figures(1, Team), 0), maps:get(robot, More, 3), Other),
    drop(3, Other).

%% Robot 9, at the place of robot 3.
renamed(Team) ->
    Named = #{robot => 9, participants => [1, 2, 9]},
    case starl_live_team_ct:config(3, Team) of
        #{peers := #{3 := Place} = Peers} -> Named#{peers => Peers#{9 => Place}};
        #{} -> Named
    end.

without(Robot, #{ends := Ends} = Team) when is_map_key(Robot, Ends) -> drop(Robot, Team);
without(_Robot, Team) -> Team.

%% Until it is counted; the first packets may meet no connection. Within one VM, robots of other runs
%% and fleets do not even find each other.
shouted(Why, Before, Name, #{kind := Kind} = Team) ->
    transmit(3, all, news(Name, x), Team),
    _ = figures(3, Team),
    case figures(1, Team) of
        #{Why := Count} when Count > Before -> ok;
        #{} when Kind =:= local, Why =/= stranger -> ok;
        #{} -> shouted(Why, Before, Name, Team)
    end.

news_of(Packets) -> [Packet || {starl, 1, shout, _, {app, news}, _} = Packet <- Packets].

refusal(Mistake, Team) ->
    {error, {shutdown, {transport, Line}}} = add(1, Mistake, Team),
    unicode:characters_to_list(Line).

mistakes_of(local, _Peers) ->
    [{#{air => #{loss => 2}}, "air: loss: a number from 0 to 1 expected, not 2"}];
mistakes_of(dist, Peers) ->
    [{#{peers => maps:remove(3, Peers)}, "peers: no node of robot 3"}];
mistakes_of(udp, Peers) ->
    Where = "an address and a port expected, {\"192.168.1.11\", 5001}",
    #{2 := {_, Port}} = Peers,
    [
        {#{peers => maps:remove(3, Peers)}, "peers: robot 3: " ++ Where},
        {#{peers => Peers#{3 => {{127, 0, 0, 1}, 0}}}, "peers: robot 3: " ++ Where},
        {
            #{peers => Peers#{1 => {{127, 0, 0, 1}, Port}}},
            lists:concat(["port ", Port, ": address already in use"])
        },
        {
            #{participants => [1, 2, 3, 1 bsl 32], peers => Peers#{1 bsl 32 => {"localhost", 1}}},
            "robot 4294967296: numbers up to 4294967295 only"
        }
    ];
mistakes_of(multicast, _Peers) ->
    Line = "multicast 10.0.0.1: an address from 224.0.0.0 to 239.255.255.255 expected",
    [{#{all => {multicast, {10, 0, 0, 1}, 5001}}, Line}].

%% -- a connection that is dead --------------------------------------------------------------

%% A node that is there and answers nothing: neither packets to others nor questions wait for it.
dead_connection(Config) ->
    Conductor = proplists:get_value(conductor, Config),
    #{nodes := Nodes} = More = proplists:get_value(more, Config),
    OsPid = peer:call(Conductor, erpc, call, [maps:get(3, Nodes), os, getpid, []]),
    peer:call(Conductor, ?MODULE, dead_connection_there, [More, OsPid], 100_000).

dead_connection_there(#{nodes := Nodes} = More, OsPid) ->
    Team = start(dist, [1, 2], More#{participants => [1, 2, 3], peers => Nodes}),
    %% it is stopped first: nobody can connect again meanwhile
    _ = os:cmd("kill -STOP " ++ OsPid),
    try
        true = erpc:call(maps:get(1, Nodes), erlang, disconnect_node, [maps:get(3, Nodes)]),
        Script = [{1, To, news(1, N)} || N <- [1, 2, 3], To <- [all, 3]],
        Expected = [news(1, N) || N <- [1, 2, 3]],
        ?assertEqual([{1, []}, {2, Expected}], exchange(Script, Team)),
        %% The first packet starts the attempt to connect; the VM takes those that follow while that
        %% goes on, and drops them with it.
        ?assertMatch(#{not_connected := N} when N >= 1, figures(1, Team))
    after
        _ = os:cmd("kill -CONT " ++ OsPid),
        stop(Team)
    end,
    ok.
