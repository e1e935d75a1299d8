%% The transmitter: whom a packet reaches, and how its copies are planned.
-module(starl_sim_transmitter_tests).
-include_lib("eunit/include/eunit.hrl").

%% A radio without bounds reaches every other robot, and none that is not there.
unbounded_test() ->
    World = world(infinity, []),
    ?assertEqual([2, 3, 4], reached(all, World)),
    ?assertEqual([3], reached(3, World)),
    ?assertEqual([], reached(9, World)).

%% A bounded one reaches those within its range, ascending, the sender not among them; a fault
%% shortens it while it holds.
in_range_test() ->
    World = world(2000.0, []),
    ?assertEqual([2, 3], reached(all, World)),
    ?assertEqual([3], reached(3, World)),
    ?assertEqual([], reached(4, World)),
    Short = world(2000.0, [{short, 0, 1000000, range, all, #{range_mm => 1500}}]),
    ?assertEqual([2], reached(all, Short)),
    ?assertEqual([], reached(3, Short)).

%% Each wall in the way takes its part of the packets: robot 3 is behind one, robot 4 behind two.
%% Holds: A wall takes its part of the packets, a block as one wall
%% Red: without it, and with a block as two walls, run
walls_take_packets_test() ->
    Floor = starl_floor:new(#{
        size => {5000, 4000},
        walls => [[{1500, 0}, {1500, 4000}], starl_floor:box(2400, 0, 2600, 4000)]
    }),
    Stand = fun(X) -> starl_trajectory:standing(0, {X, 2000.0}, 0.0) end,
    Robots = [{1, Stand(100.0)}, {2, Stand(1100.0)}, {3, Stand(2100.0)}, {4, Stand(3100.0)}],
    World = (world(infinity, []))#{
        walls => starl_walls:new(Floor),
        wall_loss => 0.5,
        sight := starl_sim_sight:new(Robots, infinity)
    },
    Sender = {1, 7, 0, Stand(100.0)},
    {Planned, _} = lists:mapfoldl(
        fun(_, Links) ->
            {{_, Plans, _}, Next} = starl_sim_transmitter:send(
                all, <<"hello">>, Sender, World, {0, [], []}, Links
            ),
            {[element(1, Plan) || Plan <- Plans], Next}
        end,
        starl_sim_transmitter:new(),
        lists:seq(1, 1000)
    ),
    Heard = fun(Id) -> length([x || Plans <- Planned, R <- Plans, R =:= Id]) end,
    ?assertEqual(1000, Heard(2)),
    ?assert(abs(Heard(3) - 500) < 70),
    ?assert(abs(Heard(4) - 250) < 70).

%% Shadowing makes a radio's range shorter, for a pair and its places: all packets come or none, in both
%% directions. Of pairs at 0.63 of the range, 6 dB below it, four in ten are cut off with a deviation of 7 dB
%% (half a normal distribution beyond 0.86 deviations); of those beside each other none.
%% Holds: Shadows shorten the range of a pair in both directions, and lengthen none
%% Red: without them, run: none of 1,000 pairs is cut off
shadows_shorten_the_range_test() ->
    Stand = fun(X) -> starl_trajectory:standing(0, {X, 100.0}, 0.0) end,
    Heard = fun(From, To, Mm, Seed) ->
        Robots = [{1, Stand(100.0)}, {2, Stand(100.0 + Mm)}],
        World = (world(10000.0, []))#{
            seed := Seed,
            team := starl_team:new([1, 2]),
            shadowing => 7.0,
            sight := starl_sim_sight:new(Robots, 10000.0)
        },
        {From, Piece} = lists:keyfind(From, 1, Robots),
        {{_, Plans, _}, _} = starl_sim_transmitter:send(
            To, <<"hello">>, {From, 7, 0, Piece}, World, {0, [], []}, starl_sim_transmitter:new()
        ),
        [element(1, Plan) || Plan <- Plans] =:= [To]
    end,
    Far = [Heard(1, 2, 6310.0, Seed) || Seed <- lists:seq(1, 1000)],
    ?assertEqual(Far, [Heard(2, 1, 6310.0, Seed) || Seed <- lists:seq(1, 1000)]),
    Cut = length([x || false <- Far]),
    ?assert(abs(Cut - 391) < 110, Cut),
    ?assert(lists:all(fun(Seed) -> Heard(1, 2, 500.0, Seed) end, lists:seq(1, 1000))).

%% Robots are where they were when the window began, the sender is where it is now.
others_as_of_the_window_test() ->
    Drives = fun(X) -> starl_trajectory:piece(0, {X, 0.0}, 0.0, 500.0, 0.0) end,
    %% at the second when the window began: 1.5 m, 2.3 m, 2.9 m; unknown of robot 5
    Robots = [{2, Drives(1000.0)}, {3, Drives(1800.0)}, {4, at(2900.0)}],
    Sight = starl_sim_sight:new(Robots, 2000.0),
    World = (world(2000.0, []))#{sight := Sight, team := starl_team:new([1, 2, 3, 4, 5])},
    Shorter = [{short, 0, 9000000, range, all, #{range_mm => 1999}}],
    Cases = [
        %% it stands at the origin; it is there, from where it was 1 m away
        {{1, 3000000, 1000000, at(0.0)}, [2]},
        {{1, 3000000, 1000000, Drives(-500.0)}, [2, 3, 4]}
    ],
    [
        begin
            Reached = reached(all, Sender, Given),
            ?assertEqual({Sender, Near}, {Sender, Reached}),
            ?assertEqual(Near, [R || R <- [2, 3, 4, 5], reached(R, Sender, Given) =:= [R]])
        end
     || {Sender, Near} <- Cases, Given <- [World, World#{network := Shorter}]
    ].

%% What the radio makes of a packet is drawn by its link and number, with the faults of now; a
%% doubled packet arrives twice. Each copy has a number of its own.
drawn_by_link_test() ->
    World = (world(infinity, []))#{duplicate := 1.0},
    {{11, Planned, []}, _} = sent(all, World, starl_sim_transmitter:new()),
    Drawn = [
        {Dest, 7 + Delay, 2, 1, {sap, packet, <<"hello">>}}
     || Dest <- [2, 3, 4],
        {Delay, intact} <- starl_sim_radio:arrivals({1, 1, Dest, {all, 1}}, 7, World)
    ],
    ?assertEqual(6, length(Drawn)),
    ?assertEqual(Drawn, [{D, T, C, S, What} || {D, T, C, S, _, What} <- lists:reverse(Planned)]),
    ?assertEqual(lists:seq(5, 10), [Seq || {_, _, _, _, Seq, _} <- lists:reverse(Planned)]),
    Deaf = World#{network := [{deaf, 5, 9, loss, all, #{part => 1.0}}]},
    ?assertMatch(
        {{5, [], [{7, 1, radio, {lost, 2, 1}}]}, _}, sent(2, Deaf, starl_sim_transmitter:new())
    ).

%% Each link counts its packets, and those for all have a count of their own; lost is told by it.
counts_by_link_test() ->
    World = (world(infinity, []))#{loss := 1.0},
    {Lost, Sent} = lists:mapfoldl(
        fun(To, Links) ->
            {{5, [], Lost}, Next} = sent(To, World, Links),
            {lists:reverse([{Dest, N} || {7, 1, radio, {lost, Dest, N}} <- Lost]), Next}
        end,
        starl_sim_transmitter:new(),
        [2, 3, 2, all]
    ),
    ?assertEqual([[{2, 1}], [{3, 1}], [{2, 2}], [{D, {all, 1}} || D <- [2, 3, 4]]], Lost),
    ?assertEqual(4, starl_sim_transmitter:packets(Sent)).

%% What was planned and traced before stays behind what comes new; a corrupt packet is not itself.
adds_to_what_is_there_test() ->
    Corrupt = {flip, 5, 9, corrupt, {1, 2}, #{part => 1.0}},
    Lossy = {deaf, 5, 9, loss, {1, 3}, #{part => 1.0}},
    Packet = starl_packet:shout(1, {app, note}, hello),
    {{7, Planned, Traced}, _} = starl_sim_transmitter:send(
        all,
        Packet,
        sender(),
        world(infinity, [Corrupt, Lossy]),
        {5, [earlier], [fact]},
        starl_sim_transmitter:new()
    ),
    ?assertMatch([{7, 1, radio, {lost, 3, {all, 1}}}, fact], Traced),
    ?assertMatch(
        [
            {4, _, 2, 1, 6, {sap, packet, Packet}},
            {2, _, 2, 1, 5, {sap, packet, <<_:32>>}},
            earlier
        ],
        Planned
    ).

%% Bytes arrive as other bytes: the receiver finds out that they are damaged.
a_damaged_datagram_arrives_as_other_bytes_test() ->
    Corrupt = {flip, 5, 9, corrupt, {1, 2}, #{part => 1.0}},
    {{6, [{2, _, 2, 1, 5, {sap, packet, Received}}], []}, _} = starl_sim_transmitter:send(
        2,
        <<"hello">>,
        sender(),
        world(infinity, [Corrupt]),
        {5, [], []},
        starl_sim_transmitter:new()
    ),
    ?assert(is_binary(Received)),
    ?assertNotEqual(<<"hello">>, Received).

sent(To, World, Links) ->
    starl_sim_transmitter:send(To, <<"hello">>, sender(), World, {5, [], []}, Links).

reached(To, World) -> reached(To, sender(), World).

reached(To, Sender, World) ->
    {{_, Planned, []}, _} = starl_sim_transmitter:send(
        To, <<"hello">>, Sender, World, {0, [], []}, starl_sim_transmitter:new()
    ),
    [Dest || {Dest, _, _, _, _, {sap, packet, <<"hello">>}} <- lists:reverse(Planned)].

sender() -> {1, 7, 0, at(0.0)}.

%% Robots stand 1 m, 2 m and 3 m from the sender; 2 m is still in a range of 2 m.
world(Range, Faults) ->
    Robots = [{1, at(0.0)}, {2, at(1000.0)}, {3, at(2000.0)}, {4, at(3000.0)}],
    #{
        seed => 1,
        team => starl_team:new([1, 2, 3, 4]),
        range_mm => Range,
        network => Faults,
        loss => 0.0,
        duplicate => 0.0,
        delay_us => {5000, 20000},
        sight => starl_sim_sight:new(Robots, Range)
    }.

at(X) -> starl_trajectory:standing(0, {X, 0.0}, 0.0).
