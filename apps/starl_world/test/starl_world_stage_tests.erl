-module(starl_world_stage_tests).
-include_lib("eunit/include/eunit.hrl").

%% Each robot has a port of its own, and none that computers give to anybody who asks for one.
ports_test() ->
    Sim = #{loss => 0.0, duplicate => 0.0, delay_us => {0, 0}, seed => 1},
    Robots = lists:seq(1, 200),
    Transport = starl_world_stage:transport(udp, Robots, #{sim => Sim, speed => 1}),
    {starl_live_udp, #{peers := Peers}} = starl_world_stage:line(1, #{}, Transport),
    Ports = [Port || {_, Port} <- maps:values(Peers)],
    ?assertEqual(Robots, lists:sort(maps:keys(Peers))),
    ?assertEqual(200, length(lists:usort(Ports))),
    ?assertEqual([], [Port || Port <- Ports, Port < 10240 orelse Port > 32767]).

%% What is told of a transport between nodes is all that a command needs to offer it.
each_transport_between_nodes_has_a_line_test() ->
    Sim = #{loss => 0.0, duplicate => 0.0, delay_us => {0, 0}, seed => 1},
    Lines = [
        starl_world_stage:line(
            1, #{}, starl_world_stage:transport(Name, [1, 2], #{sim => Sim, speed => 1})
        )
     || {Name, _Text} <- starl_world_stage:transports()
    ],
    ?assertMatch([_, _ | _], lists:usort([Module || {Module, _} <- Lines])),
    [
        ?assertEqual({Module, [starl_live_transport]}, {Module, behaviours(Module)})
     || {Module, _} <- Lines
    ].

behaviours(Module) -> lists:append([B || {behaviour, B} <- Module:module_info(attributes)]).
