%% Teams of robots' ends of a transport, for tests: each end tells this process what it hears.
-module(starl_live_team_ct).

-export([start/3, stop/1, add/3, drop/2, config/2]).
-export([transmit/4, figures/2, set_air/3, pid/2, hear/3, exchange/2, greet/1, counted/3]).
-export([start_node/1]).
%% called on nodes
-export([hold/3]).

%% A team: the transport, the configuration of each end, each robot's process and its holder.
start(Kind, Robots, More) ->
    Configs = configs(Kind, Robots, More),
    Empty = #{kind => Kind, configs => Configs, ends => #{}, nodes => maps:get(nodes, More, #{})},
    Team = lists:foldl(fun(Robot, Before) -> add(Robot, #{}, Before) end, Empty, Robots),
    ok = greet(Team),
    Team.

stop(#{ends := Ends} = Team) ->
    _ = [drop(Robot, Team) || Robot <- maps:keys(Ends)],
    ok.

%% Opens a robot's end with more configuration. Its holder stands on the robot's node.
add(Robot, More, #{ends := Ends, nodes := Nodes} = Team) ->
    Config = maps:merge(config(Robot, Team), More),
    Node = maps:get(Robot, Nodes, node()),
    Holder = spawn(Node, ?MODULE, hold, [self(), module(Team), Config]),
    receive
        {Holder, {ok, Pid}} ->
            Team#{ends := Ends#{Robot => {Pid, Holder}}};
        {Holder, {error, Why}} ->
            Holder ! drop,
            {error, Why}
    end.

config(Robot, #{configs := Configs}) -> maps:get(Robot, Configs).

hold(Owner, Module, Config) ->
    process_flag(trap_exit, true),
    %% A packet with an atom that no loaded module knows would not be taken.
    _ = starl_live_packets:plain(),
    {module, _} = code:ensure_loaded(starl_live_transport_SUITE),
    Owner ! {self(), starl_live_transport:start_link(Module, Config, Owner)},
    Monitor = monitor(process, Owner),
    receive
        drop -> ok;
        {'DOWN', Monitor, process, Owner, _} -> ok
    end,
    exit(shutdown).

drop(Robot, #{ends := Ends} = Team) ->
    {{Pid, Holder}, Left} = maps:take(Robot, Ends),
    Monitors = [{monitor(process, Process), Process} || Process <- [Pid, Holder]],
    Holder ! drop,
    [ended(Monitor) || Monitor <- Monitors],
    Team#{ends := Left}.

ended({Monitor, Process}) ->
    receive
        {'DOWN', Monitor, process, Process, _} -> ok
    end.

module(#{kind := local}) -> starl_live_local;
module(#{kind := dist}) -> starl_live_dist;
module(#{kind := _}) -> starl_live_udp.

pid(Robot, #{ends := Ends}) ->
    {Pid, _} = maps:get(Robot, Ends),
    Pid.

transmit(From, To, Packet, Team) -> starl_live_transport:transmit(pid(From, Team), To, Packet).

figures(Robot, Team) -> starl_live_transport:figures(pid(Robot, Team)).

set_air(Robot, Settings, Team) -> starl_live_transport:set_conditions(pid(Robot, Team), Settings).

%% The next packets that a robot hears.
hear(Robot, Number, Team) -> heard(Number, [], pid(Robot, Team)).

heard(Number, Packets, _Pid) when length(Packets) >= Number ->
    Packets;
heard(Number, Packets, Pid) ->
    receive
        {starl_heard, Pid, More} -> heard(Number, Packets ++ More, Pid)
    end.

%% Sends packets, and gives all that each robot hears of them: a mark follows on each way.
exchange(Script, Team) ->
    [transmit(From, To, Packet, Team) || {From, To, Packet} <- Script],
    Robots = robots(Team),
    [transmit(From, To, mark(From, one), Team) || From <- Robots, To <- Robots, From =/= To],
    [transmit(From, all, mark(From, all), Team) || From <- Robots],
    [{Robot, until(marks(Robot, Robots), pid(Robot, Team))} || Robot <- Robots].

robots(#{ends := Ends}) -> lists:sort(maps:keys(Ends)).

mark(From, Way) -> starl_packet:shout(From, mark, Way).

marks(Robot, Robots) -> [mark(From, Way) || From <- Robots, From =/= Robot, Way <- [one, all]].

until([], _Pid) ->
    [];
until(Marks, Pid) ->
    receive
        {starl_heard, Pid, Packets} ->
            [P || P <- Packets -- Marks, not is_greeting(P)] ++ until(Marks -- Packets, Pid)
    end.

%% Greets until every robot has heard every other: nodes take a while to connect, and what is sent
%% meanwhile is lost.
greet(Team) ->
    Robots = robots(Team),
    greet([{From, To} || From <- Robots, To <- Robots, From =/= To], Team).

greet([], _Team) ->
    ok;
greet(Pairs, Team) ->
    [transmit(From, To, starl_packet:shout(From, greeting, []), Team) || {From, To} <- Pairs],
    greet(Pairs -- greeted(Team), Team).

greeted(#{ends := Ends} = Team) ->
    receive
        {starl_heard, Pid, Packets} ->
            [Robot] = [Robot || {Robot, {End, _}} <- maps:to_list(Ends), End =:= Pid],
            [{starl_packet:source(P), Robot} || P <- Packets, is_greeting(P)] ++ greeted(Team)
    after 20 -> []
    end.

is_greeting(Packet) -> Packet =:= starl_packet:shout(starl_packet:source(Packet), greeting, []).

%% Waits until a robot's counter has come so far: nothing else tells that a packet was refused.
counted(Robot, {Name, Number}, Team) ->
    case maps:get(Name, figures(Robot, Team), 0) of
        Number -> ok;
        Less when Less < Number -> counted(Robot, {Name, Number}, Team);
        More -> error({counted, Robot, Name, More})
    end.

%% -- configurations -------------------------------------------------------------------------

configs(Kind, Robots, More) ->
    Common = maps:merge(
        #{participants => Robots, fleet => "tests", run => 1, spread_ms => 0},
        maps:without([nodes], More)
    ),
    Place = place(Kind, Robots, More),
    maps:from_list([
        {Robot, maps:merge(Place#{robot => Robot}, Common)}
     || Robot <- Robots
    ]).

place(local, _Robots, _More) ->
    #{};
place(dist, _Robots, #{nodes := Nodes}) ->
    #{peers => Nodes};
place(udp, Robots, _More) ->
    Ports = lists:zip(Robots, ports(length(Robots))),
    Peers = maps:from_list([{Robot, {{127, 0, 0, 1}, Port}} || {Robot, Port} <- Ports]),
    #{peers => Peers, key => fun() -> <<7:256>> end};
place(multicast, Robots, More) ->
    [Port] = ports(1),
    All = {multicast, {239, 255, 17, 4}, Port},
    (place(udp, Robots, More))#{all => All, interface => {127, 0, 0, 1}}.

%% Ports that nobody has.
ports(Number) ->
    Sockets = [element(2, {ok, _} = gen_udp:open(0, [])) || _ <- lists:seq(1, Number)],
    Ports = [element(2, {ok, _} = inet:port(Socket)) || Socket <- Sockets],
    lists:foreach(fun gen_udp:close/1, Sockets),
    Ports.

%% -- nodes ----------------------------------------------------------------------------------

%% A node that ends with the process that started it.
start_node(Cookie) ->
    Own = [Dir || Dir <- code:get_path(), not lists:prefix(code:lib_dir(), Dir)],
    Paths = lists:append([["-pa", filename:absname(Dir)] || Dir <- Own, filelib:is_dir(Dir)]),
    peer:start_link(#{
        name => peer:random_name("starl_live"),
        host => "127.0.0.1",
        longnames => true,
        connection => standard_io,
        wait_boot => 60_000,
        args => [
            "-setcookie", Cookie, "-connect_all", "false", "-kernel", "logger_level", "none" | Paths
        ]
    }).
