%% Hostile datagrams ({@link starl_dev_hostile_packets}) for a robot's end by UDP, without a socket. None
%% is to be taken, but for absurd ones; atoms and memory stay bounded, and other robots are heard as
%% before.
-module(starl_live_hostile).

-export([flood/3]).

-define(TEAM, [1, 2, 3]).

%% What came of so many: the packets taken, the new atoms, the words of the state before and after,
%% the counters, and whether another packet is still heard from each robot.
flood(Kinds, Number, Seed) ->
    {ok, Opened} = starl_live_udp:open(config(2, port())),
    Packets = packets(Kinds, Seed),
    Pool = starl_dev_hostile_packets:pool(Packets),
    Heard = lists:foldl(fun(Datagram, Udp) -> element(2, hear(Datagram, Udp)) end, Opened, Pool),
    %% All code is loaded, and each robot has been refused for each reason.
    {_, _, Known} = flooded(500 * length(Kinds), Packets, [], Heard),
    Atoms = erlang:system_info(atom_count),
    {Taken, Last, Udp} = flooded(Number, Packets, [], Known),
    Report = #{
        taken => Taken,
        atoms => erlang:system_info(atom_count) - Atoms,
        words => {words(Known), words(Udp)},
        figures => starl_live_udp:figures(Udp),
        still_heard => [R || R <- [1, 3], {[_], _} <- [hear(still(R, Last), Udp)]]
    },
    ok = starl_live_udp:close(Udp),
    Report.

still(Robot, Packets) ->
    starl_dev_hostile_packets:genuine(Robot, starl_packet:shout(Robot, dpp, still), Packets).

%% Without the counters: one that was never needed before takes some words too.
words(Udp) -> erts_debug:flat_size(Udp) - erts_debug:flat_size(starl_live_udp:figures(Udp)).

flooded(0, Packets, Taken, Udp) ->
    {Taken, Packets, Udp};
flooded(Number, Packets, Taken, Udp) ->
    {Kind, Datagram, More} = starl_dev_hostile_packets:next(Packets),
    {Heard, Next} = hear(Datagram, Udp),
    flooded(Number - 1, More, [{Kind, P} || P <- Heard] ++ Taken, Next).

hear(Datagram, Udp) -> starl_live_udp:hear({udp, none, {127, 0, 0, 1}, 1, Datagram}, Udp).

packets(Kinds, Seed) ->
    starl_dev_hostile_packets:new(#{
        line => config(2, 1), robot => 2, participants => ?TEAM, kinds => Kinds, seed => Seed
    }).

config(Robot, Port) ->
    #{
        robot => Robot,
        participants => ?TEAM,
        key => fun() -> <<7:256>> end,
        fleet => "tests",
        run => 1,
        %% hours: what is replayed is refused because it was heard, not for its age
        fresh_ms => 10_000_000,
        %% nor because it may be of a former life
        beat_ms => infinity,
        peers => maps:from_list([{R, {{127, 0, 0, 1}, Port}} || R <- ?TEAM])
    }.

port() ->
    {ok, Socket} = gen_udp:open(0, []),
    {ok, Port} = inet:port(Socket),
    ok = gen_udp:close(Socket),
    Port.
