%% Who is near: in a large team the world is asked for those alone, and says the same.
-module(starl_sim_neighbours_tests).
-include_lib("eunit/include/eunit.hrl").

near_are_those_that_are_near_of_all_test_() ->
    [
        {timeout, 60, fun() ->
            Results = results(#{robots => N, mm => Mm, position_error => 0, faults => Faults}),
            [?assertEqual(Measured, Near) || {Near, Measured} <- Results],
            ?assert(lists:any(fun({Near, _}) -> Near =/= [] end, Results))
        end}
     || {N, Mm} <- [{10, 5000}, {80, 2500}, {80, 50000}],
        Faults <- [[], [{f, 0, 60000, location_swap, {1, 5}, #{}}]]
    ].

results(Scenario) ->
    {ok, Sim} = starl_sim:start(Scenario#{app => starl_looker, world => {20000, 20000}, time => 60}),
    _ = starl_sim:run(Sim),
    {#{robots := Robots}, _} = starl_sim:finish(Sim),
    [Result || {_, #{result := {done, Result}}} <- Robots].

%% A look costs what is near, not the team: of a thousand robots it tells of nine.
a_look_tells_of_those_near_only_test() ->
    Place = fun(I) -> {1000.0 * (I rem 32), 1000.0 * (I div 32)} end,
    Pieces = [{I, starl_trajectory:standing(0, Place(I), 0.0)} || I <- lists:seq(1, 1000)],
    World = #{
        seed => 1,
        team => starl_team:new(lists:seq(1, 1000)),
        location => [],
        profiles => [starl_chassis:profile(starl_chassis_differential, #{})],
        sight => starl_sim_sight:new(Pieces, infinity)
    },
    {X, Y} = Place(500),
    Vehicle = starl_sim_vehicle:new(500, {X, Y, 0.0}, World),
    {Seen, _} = starl_sim_vehicle:sense({near, 1500}, {0, 0}, Vehicle),
    ?assertEqual(9, length(Seen)).
