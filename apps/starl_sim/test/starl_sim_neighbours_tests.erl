%% Who is near: in a large team the world is asked for those alone, and says the same.
%%
%% Holds: Who is near costs what is near, and is what measuring all robots gives
%% Red: with too near a look, run: neighbours are missing
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
    {Look, _} = amid(1024, 1000.0),
    ?assertEqual(9, length(Look(1500))).

%% Who sees as many pays as much in every team, in reductions, which no load of the computer changes.
a_look_costs_the_same_in_every_team_test() ->
    Cost = fun(N) ->
        {Look, Robot} = amid(N, 800.0),
        ?assert(lists:member(Robot, [Seen || {Seen, _} <- Look(2000)])),
        {reductions, Before} = process_info(self(), reductions),
        _ = [?assertEqual(21, length(Look(2000))) || _ <- lists:seq(1, 20)],
        {reductions, After} = process_info(self(), reductions),
        After - Before
    end,
    [Least | _] = Costs = lists:sort([Cost(N) || N <- [100, 400, 1600]]),
    ?assert(lists:last(Costs) =< 1.1 * Least, Costs).

%% A robot in the middle of so many that stand on a square grid, and its look.
amid(N, Mm) ->
    Row = round(math:sqrt(N)),
    Place = fun(I) -> {Mm * (I rem Row), Mm * (I div Row)} end,
    Pieces = [{I, starl_trajectory:standing(0, Place(I), 0.0)} || I <- lists:seq(0, N - 1)],
    World = #{
        seed => 1,
        team => starl_team:new(lists:seq(0, N - 1)),
        location => [],
        profiles => [starl_chassis:profile(starl_chassis_differential, #{})],
        sight => starl_sim_sight:new(Pieces, infinity)
    },
    Robot = Row * (Row div 2) + Row div 2,
    {X, Y} = Place(Robot),
    Vehicle = starl_sim_vehicle:new(Robot, {X, Y, 0.0}, World),
    {
        fun(Reach) -> element(1, starl_sim_vehicle:sense({near, Reach}, {0, 0}, Vehicle)) end,
        Robot
    }.
