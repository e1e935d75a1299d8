%% A share of the search's acceptance (doc/search.md): the five plans, teams up to sixteen, a fifth of
%% the packets lost, a door that closes meanwhile. The seed is printed, and taken from STARL_SEED.
-module(starl_search_plans_tests).
-include_lib("eunit/include/eunit.hrl").

the_plans_are_those_that_were_made_test_() ->
    [
        ?_assertEqual(
            {ok, starl_search_plans:Plan()}, file:read_file(starl_search_plans:file(Plan))
        )
     || Plan <- [maze, rooms]
    ].

%% All floor is seen where there is no ball, it is found where there is one, and all are done.
every_room_is_searched_test_() ->
    Seed = seed(),
    [
        {timeout, 300, fun() ->
            #{violations := Violations, report := Report, robots := Robots} =
                outcome(Plan, #{robots => N, ball => Ball, seed => Seed}),
            Left = [Id || {Id, #{result := Result}} <- Robots, not is_done(Ball, Result)],
            ?assertMatch(
                {Plan, N, Ball, Seed, [], [], #{complete := true}},
                {Plan, N, Ball, Seed, Violations, Left, Report}
            )
        end}
     || {Plan, Teams} <- [
            {house, [1, 3, 8]},
            {original, [2, 5, 16]},
            {doors, [1, 4, 16]},
            {rooms, [9]}
        ],
        N <- Teams,
        Ball <- [nowhere, random]
    ].

%% Houses with furniture and compartments, the ball anywhere: it is found, or the floor that is named has it.
the_ball_is_found_or_its_floor_is_named_test_() ->
    Seed = seed(),
    [
        {timeout, 300, fun() ->
            Floor = starl_search_houses:house(3, 2, Seed + N),
            #{violations := Violations, report := Report, ball := Ball, monitors := Monitors} =
                starl_search_houses:search(Floor, Seed + N, #{loss => 0.1}),
            #{starl_search_monitor := #{found_us := Found, left := Left}} = Monitors,
            IsNamed = lists:any(fun(P) -> starl_geometry:distance(P, Ball) < 150 end, Left),
            ?assertMatch({Seed, N, Ball, []}, {Seed, N, Ball, Violations}),
            ?assert(Found =/= none orelse IsNamed, {Seed, N, Ball}),
            ?assertMatch(
                {Seed, N, #{complete := Is}} when Is =:= (Found =/= none), {Seed, N, Report}
            )
        end}
     || N <- lists:seq(1, 8)
    ].

%% A false blob may be taken for a ball at its place only, so a found ball is one.
is_done(nowhere, {done, complete}) -> true;
is_done(random, {done, {found, _}}) -> true;
is_done(_, _) -> false.

seed() ->
    case os:getenv("STARL_SEED") of
        false -> erlang:phash2(make_ref(), 1 bsl 24);
        Text -> list_to_integer(Text)
    end.

outcome(Plan, More) ->
    Dir = filename:dirname(filename:dirname(starl_search_plans:file(maze))),
    {ok, Given} = starl_run_scenario:read(
        filename:join(Dir, "search_" ++ atom_to_list(Plan) ++ ".term")
    ),
    #{floor := Floor} = Given,
    Beside =
        case filename:dirname(Floor) of
            "." -> Floor;
            _ -> filename:join(Dir, Floor)
        end,
    Scenario = maps:merge(Given#{app => starl_search, floor => Beside, time => 7200}, More),
    {ok, Sim} = starl_sim:start(Scenario),
    _ = starl_sim:run(Sim),
    {Outcome, Report} = starl_sim:finish(Sim),
    Outcome#{report => Report}.
