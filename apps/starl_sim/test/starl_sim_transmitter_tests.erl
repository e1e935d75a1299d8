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
%% doubled packet arrives twice.
drawn_by_link_test() ->
    World = (world(infinity, []))#{duplicate := 1.0},
    {Copies, [], _} = starl_sim_transmitter:send(all, sender(), World, starl_sim_transmitter:new()),
    Drawn = [
        {Dest, Copy}
     || Dest <- [2, 3, 4], Copy <- starl_sim_radio:arrivals({1, 1, Dest, {all, 1}}, 7, World)
    ],
    ?assertEqual(6, length(Drawn)),
    ?assertEqual(Drawn, Copies),
    Deaf = World#{network := [{deaf, 5, 9, loss, all, #{part => 1.0}}]},
    ?assertMatch(
        {[], [{7, 1, radio, {lost, 2, 1}}], _},
        starl_sim_transmitter:send(2, sender(), Deaf, starl_sim_transmitter:new())
    ).

%% Each link counts its packets, and those for all have a count of their own; lost is told by it.
counts_by_link_test() ->
    World = (world(infinity, []))#{loss := 1.0},
    {Lost, Sent} = lists:mapfoldl(
        fun(To, Links) ->
            {[], Lost, Next} = starl_sim_transmitter:send(To, sender(), World, Links),
            {[{Dest, N} || {7, 1, radio, {lost, Dest, N}} <- Lost], Next}
        end,
        starl_sim_transmitter:new(),
        [2, 3, 2, all]
    ),
    ?assertEqual([[{2, 1}], [{3, 1}], [{2, 2}], [{D, {all, 1}} || D <- [2, 3, 4]]], Lost),
    ?assertEqual(4, starl_sim_transmitter:packets(Sent)).

%% Copies arrive after their delays under numbers of their own; a corrupt one is not the packet.
plan_test() ->
    Copies = [{2, {50, intact}}, {3, {40, corrupt}}],
    [Second, First, earlier] =
        starl_sim_transmitter:plan(Copies, <<"hello">>, sender(), 5, [earlier]),
    ?assertEqual({2, 57, 2, 1, 5, {sap, packet, <<"hello">>}}, First),
    ?assertMatch({3, 47, 2, 1, 6, {sap, packet, <<_:32>>}}, Second).

reached(To, World) -> reached(To, sender(), World).

reached(To, Sender, World) ->
    {Copies, [], _} = starl_sim_transmitter:send(To, Sender, World, starl_sim_transmitter:new()),
    [Dest || {Dest, {_Delay, intact}} <- Copies].

sender() -> {1, 7, 0, at(0.0)}.

%% Robots stand 1 m, 2 m and 3 m from the sender; 2 m is still in a range of 2 m.
world(Range, Faults) ->
    Robots = [{1, at(0.0)}, {2, at(1000.0)}, {3, at(2000.0)}, {4, at(3000.0)}],
    #{
        seed => 1, team => starl_team:new([1, 2, 3, 4]), range_mm => Range, network => Faults,
        loss => 0.0, duplicate => 0.0, delay_us => {5000, 20000},
        sight => starl_sim_sight:new(Robots, Range)
    }.

at(X) -> starl_trajectory:standing(0, {X, 0.0}, 0.0).
