-module(starl_world_setup_tests).
-include_lib("eunit/include/eunit.hrl").

%% Each robot has a port of its own, and none that computers give to anybody who asks for one.
each_robot_has_a_port_of_its_own_test() ->
    Sim = #{loss => 0.0, duplicate => 0.0, delay_us => {0, 0}, seed => 1},
    Robots = lists:seq(1, 200),
    Transport = starl_world_setup:transport(udp, Robots, #{sim => Sim, speed => 1}),
    {starl_live_udp, #{peers := Peers}} = starl_world_setup:line(1, #{}, Transport),
    Ports = [Port || {_, Port} <- maps:values(Peers)],
    ?assertEqual(Robots, lists:sort(maps:keys(Peers))),
    ?assertEqual(200, length(lists:usort(Ports))),
    ?assertEqual([], [Port || Port <- Ports, Port < 10240 orelse Port > 32767]).

%% What is told of a transport between nodes is all that a command needs to offer it.
each_transport_between_nodes_has_a_line_test() ->
    Sim = #{loss => 0.0, duplicate => 0.0, delay_us => {0, 0}, seed => 1},
    Lines = [
        starl_world_setup:line(
            1, #{}, starl_world_setup:transport(Name, [1, 2], #{sim => Sim, speed => 1})
        )
     || {Name, _Text} <- starl_world_setup:transports()
    ],
    ?assertMatch([_, _ | _], lists:usort([Module || {Module, _} <- Lines])),
    [
        ?assertEqual({Module, [starl_live_transport]}, {Module, behaviours(Module)})
     || {Module, _} <- Lines
    ].

behaviours(Module) -> lists:append([B || {behaviour, B} <- Module:module_info(attributes)]).

%% The record of facts, a witness, always stays.
what_happens_to_a_store_before_its_robot_starts_test() ->
    Dir = filename:join(
        os:getenv("TMPDIR", "/tmp"), "starl-world-setup-" ++ os:getpid()
    ),
    Spec = #{dir => Dir},
    Live = fun(Fate, Life) ->
        ok = starl_world_setup:prepare_store(Fate, Spec),
        _ = Life =:= 1 andalso starl_live_store:commission(Dir),
        Found = kept(Dir),
        {ok, Store} = starl_live_store:open(Dir),
        ok = starl_live_store:started(#{a => Life}, Store),
        ok = starl_live_store:keep(a, Life, Store),
        {ok, _} = starl_live_record:open(Dir),
        Found
    end,
    try
        Lives = [{kept, 1}, {kept, 2}, {kept, 3}, {set_back, 4}, {lost, 5}, {set_back, 6}],
        Found = [Live(Fate, Life) || {Fate, Life} <- Lives],
        ?assertEqual(
            [none, {stored, 1}, {stored, 2}, {stored, 2}, damaged, damaged],
            Found
        ),
        ?assertEqual(6, length(starl_live_record:starts(Dir)))
    after
        _ = file:del_dir_r(Dir),
        file:del_dir_r(Dir ++ ".earlier")
    end.

kept(Dir) ->
    {ok, Store} = starl_live_store:open(Dir),
    starl_live_store:kept(a, Store).
