%% @doc The transport of a run on this computer: the line of each robot's link to the others.
-module(starl_world_transport).

-export([new/3, line/3]).

-export_type([t/0, name/0]).

%% A transport's name: within one VM, by Erlang distribution, by UDP.
-type name() :: local | dist | udp.

-record(transport, {
    name :: name(),
    common :: map(),
    %% of UDP: the address of each robot
    ports = #{} :: #{starl:robot_id() => {inet:ip_address(), inet:port_number()}}
}).

-opaque t() :: #transport{}.

-define(SPREAD_MS, 25).
-define(LOOPBACK, {127, 0, 0, 1}).
-define(PORTS, {10240, 32767}).

%% @doc A transport for these robots, with the radio of a scenario. Its time passes this much faster
%% than real time, so the delays of packets are shorter. `air': other air than the scenario's.
-spec new(name(), [starl:robot_id()], #{
    sim := starl_sim_world:t(), speed := number(), air => starl_live_air:settings()
}) -> t().
new(Name, Robots, #{sim := Sim, speed := Speed} = Options) ->
    #{loss := Loss, duplicate := Duplicate, delay_us := {Least, Most}} = Sim,
    <<Run:64>> = crypto:strong_rand_bytes(8),
    Common = #{
        fleet => "cluster",
        run => Run,
        air => maps:merge(
            #{seed => maps:get(seed, Sim)},
            maps:get(air, Options, #{
                loss => Loss,
                duplicates => Duplicate,
                delay_ms => {round(Least / 1000 / Speed), round(Most / 1000 / Speed)}
            })
        ),
        %% answers to a packet for all wait for a shorter time, too
        spread_ms => round(min(?SPREAD_MS, length(Robots) div 2) / Speed)
    },
    sockets(Name, Robots, #transport{name = Name, common = Common}).

sockets(udp, Robots, #transport{common = Common} = Transport) ->
    Addresses = [{?LOOPBACK, Port} || Port <- free_ports(length(Robots))],
    Transport#transport{
        common = Common#{key => starl_live_key:new()},
        ports = maps:from_list(lists:zip(Robots, Addresses))
    };
sockets(_Name, _Robots, Transport) ->
    Transport.

%% These are out of the range from which computers take ports for anybody, since a robot that is started anew
%% needs its port again. Another cluster may take one in the moment before the robot does: then its
%% start fails with one line.
free_ports(Number) ->
    Sockets = free_ports(Number, first(Number), []),
    Ports = [Port || {Port, _Socket} <- Sockets],
    ok = lists:foreach(fun({_, Socket}) -> ok = gen_udp:close(Socket) end, Sockets),
    Ports.

first(Number) ->
    {Least, Most} = ?PORTS,
    Least + rand:uniform(max(1, Most - Least - 2 * Number)).

%% All are open until all are found: so none is found twice.
free_ports(0, _Port, Sockets) ->
    Sockets;
free_ports(Number, Port, Sockets) ->
    case gen_udp:open(Port) of
        {ok, Socket} -> free_ports(Number - 1, Port + 1, [{Port, Socket} | Sockets]);
        {error, _} -> free_ports(Number, Port + 1, Sockets)
    end.

%% @doc The line of a robot; `Nodes' are the robots' nodes.
-spec line(starl:robot_id(), #{starl:robot_id() => node()}, t()) -> starl_live_link:line().
line(Robot, Nodes, #transport{name = Name, common = #{air := Air} = Common, ports = Ports}) ->
    %% each robot has a chance of its own
    #{seed := Seed} = Air,
    Own = Common#{air := Air#{seed := erlang:phash2({Seed, Robot})}},
    case Name of
        local -> {starl_live_local, Own};
        dist -> {starl_live_dist, Own#{peers => Nodes}};
        udp -> {starl_live_udp, Own#{peers => Ports}}
    end.
