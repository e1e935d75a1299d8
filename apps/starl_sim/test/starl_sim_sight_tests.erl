%% The contract of the spatial index: what it answers is what measuring every robot gives, however
%% old its grid is and however the robots have moved since.
-module(starl_sim_sight_tests).
-include_lib("eunit/include/eunit.hrl").

-define(RANGE, 1000.0).
-define(SIDE, 5000.0).
-define(ROBOTS, 60).
-define(ROUNDS, 40).

as_measured_test_() ->
    [{lists:concat(["STARL_SEED=", Seed]), fun() -> as_measured(Seed) end} || Seed <- seeds()].

seeds() ->
    case os:getenv("STARL_SEED") of
        false -> lists:seq(1, 20);
        Seed -> [list_to_integer(Seed)]
    end.

as_measured(Seed) ->
    Random0 = rand:seed_s(exsss, Seed),
    {Pieces, Random} = lists:mapfoldl(fun standing/2, Random0, lists:seq(1, ?ROBOTS)),
    Sight = starl_sim_sight:new(Pieces, ?RANGE),
    rounds(?ROUNDS, 0, maps:from_list(Pieces), Sight, Random).

rounds(0, _Now, _Pieces, _Sight, _Random) ->
    ok;
rounds(N, Now, Pieces, Sight, Random0) ->
    {Point, Random1} = point(Random0),
    Near = [
        Id
     || {Id, Piece} <- lists:sort(maps:to_list(Pieces)),
        starl_geometry:distance(Point, starl_trajectory:position(Now, Piece)) =< ?RANGE
    ],
    ?assertEqual(Near, starl_sim_sight:within(Point, Now, Sight)),
    %% and within any other distance
    Mm = 300.0 * (1 + N rem 9),
    Nearer = [
        Id
     || {Id, Piece} <- lists:sort(maps:to_list(Pieces)),
        starl_geometry:distance(Point, starl_trajectory:position(Now, Piece)) =< Mm
    ],
    ?assertEqual(Nearer, starl_sim_sight:near(Point, Mm, Now, Sight)),
    {Moved, Random2} = lists:mapfoldl(
        fun(Id, R) -> turned(Id, Now, Pieces, R) end,
        Random1,
        [Id || Id <- lists:seq(1, ?ROBOTS), Id rem 7 =:= N rem 7]
    ),
    ok = starl_sim_sight:moved(Moved, Sight),
    %% many questions at one time, others a while later
    {Step, Random} = rand:uniform_s(900000, Random2),
    Later =
        case N rem 3 of
            0 -> Now + Step;
            _ -> Now
        end,
    rounds(N - 1, Later, maps:merge(Pieces, maps:from_list(Moved)), Sight, Random).

%% A robot at the very border of the range counts, one beyond it does not.
border_test() ->
    Place = fun(X) -> starl_trajectory:standing(0, {X, 0.0}, 0.0) end,
    Sight = starl_sim_sight:new([{1, Place(?RANGE)}, {2, Place(?RANGE + 0.01)}], ?RANGE),
    ?assertEqual([1], starl_sim_sight:within({0.0, 0.0}, 0, Sight)),
    ?assertEqual([1], starl_sim_sight:within({0.0, 0.0}, 10000000, Sight)).

%% Places may be on either side of the origin.
negative_places_test() ->
    Places = [{X * 700.0, Y * 700.0} || X <- lists:seq(-3, 3), Y <- lists:seq(-3, 3)],
    Robots = lists:zip(lists:seq(1, length(Places)), Places),
    Sight = starl_sim_sight:new(
        [{Id, starl_trajectory:standing(0, Place, 0.0)} || {Id, Place} <- Robots], ?RANGE
    ),
    [
        ?assertEqual(
            [Id || {Id, Place} <- Robots, starl_geometry:distance(Point, Place) =< ?RANGE],
            starl_sim_sight:within(Point, 0, Sight)
        )
     || Point <- Places
    ].

%% Who drives out of range is not found by the grid of the time before.
driven_away_test() ->
    Sight = starl_sim_sight:new([{1, starl_trajectory:standing(0, {0.0, 0.0}, 0.0)}], ?RANGE),
    ?assertEqual([1], starl_sim_sight:within({0.0, 0.0}, 0, Sight)),
    Away = starl_trajectory:piece(0, {0.0, 0.0}, 0.0, 500.0, 0.0),
    ok = starl_sim_sight:moved([{1, Away}], Sight),
    ?assertEqual([1], starl_sim_sight:within({0.0, 0.0}, 1990000, Sight)),
    ?assertEqual([], starl_sim_sight:within({0.0, 0.0}, 2010000, Sight)).

unknown_test() ->
    Piece = starl_trajectory:standing(0, {0.0, 0.0}, 0.0),
    Sight = starl_sim_sight:new([{1, Piece}], infinity),
    ?assertEqual({ok, Piece}, starl_sim_sight:piece(1, Sight)),
    ?assertEqual(unknown, starl_sim_sight:piece(2, Sight)).

standing(Id, Random0) ->
    {Point, Random} = point(Random0),
    {{Id, starl_trajectory:standing(0, Point, 0.0)}, Random}.

%% It goes on from where it is: straight, in an arc or in place.
turned(Id, Now, Pieces, Random0) ->
    {X, Y, _} = starl_trajectory:pose(Now, maps:get(Id, Pieces)),
    {Turn, Random1} = rand:uniform_s(Random0),
    {Speed, Random2} = rand:uniform_s(Random1),
    {Rate, Random} = rand:uniform_s(Random2),
    Heading = 2 * math:pi() * Turn,
    V =
        case Id rem 5 of
            0 -> 0.0;
            _ -> 500.0 * Speed
        end,
    W =
        case Id rem 2 of
            0 -> 0.0;
            _ -> 2.0 * Rate - 1.0
        end,
    {{Id, starl_trajectory:piece(Now, {X, Y}, Heading, V, W)}, Random}.

point(Random0) ->
    {X, Random1} = rand:uniform_s(Random0),
    {Y, Random} = rand:uniform_s(Random1),
    {{?SIDE * X, ?SIDE * Y}, Random}.
