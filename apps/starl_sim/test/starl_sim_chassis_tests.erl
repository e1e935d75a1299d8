%% What a scenario may say about the chassis of its robots.
-module(starl_sim_chassis_tests).
-include_lib("eunit/include/eunit.hrl").

choices_test() ->
    Check = fun(Choice) ->
        starl_options:check(#{chassis => Choice}, [starl_chassis_choice:option()])
    end,
    Good = [differential, holonomic, mixed, [holonomic], [differential, differential, holonomic]],
    [?assertMatch({ok, _}, Check(Choice)) || Choice <- Good],
    Bad = [wings, [], [wings], [mixed], [holonomic | differential], "holonomic", {holonomic}, 1],
    [?assertMatch({Choice, {error, [_]}}, {Choice, Check(Choice)}) || Choice <- Bad].

in_turn_test() ->
    Kinds = fun(Choice, Robots) ->
        Profiles = starl_chassis_choice:profiles(Choice, #{speed => 300.0}),
        [starl_chassis:kind(starl_chassis:of_robot(Robot, Profiles)) || Robot <- Robots]
    end,
    {D, H} = {starl_chassis_differential, starl_chassis_holonomic},
    ?assertEqual([D, D], Kinds(differential, [1, 2])),
    ?assertEqual([D, H, D, H], Kinds(mixed, [1, 2, 3, 4])),
    ?assertEqual([H, D, D, H], Kinds([holonomic, differential, differential], [1, 2, 3, 4])),
    ?assertEqual(
        [300.0, 300.0], [
            maps:get(speed, P)
         || P <- starl_chassis_choice:profiles(mixed, #{speed => 300.0})
        ]
    ).

%% The widest of a team is that of the robot that needs most.
widest_test() ->
    [Wheels, Holonomic] = Profiles = starl_chassis_choice:profiles(mixed, #{}),
    [R1, R2] = [starl_chassis:tracking_radius(P) || P <- [Wheels, Holonomic]],
    ?assert(R1 /= R2),
    ?assertEqual(max(R1, R2), starl_chassis:widest(Profiles)).
