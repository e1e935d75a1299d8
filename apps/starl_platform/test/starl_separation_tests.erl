%% Separation in continuous time: encounters below the limit are found with time and pair, and
%% the reported minimum is the true one, against all pairs of all pieces (seeded).
-module(starl_separation_tests).
-include_lib("eunit/include/eunit.hrl").

-define(S, 1_000_000).

still(X, Y) -> starl_trajectory:standing(0, {X, Y}, 0.0).

drive(T, X, Y, Heading, V) -> starl_trajectory:piece(T, {X, Y}, Heading, V, 0.0).

%% Feeds {T, Robot, Piece} and returns the encounters and the least distance.
watch(Limit, Motions, End) ->
    Step = fun({T, Robot, Piece}, {Found, S0}) ->
        {Met, S1} = starl_separation:advance(T, S0),
        {Found ++ Met, starl_separation:motion(Robot, Piece, S1)}
    end,
    {Found, S} = lists:foldl(Step, {[], starl_separation:new(Limit)}, Motions),
    {Last, Least} = starl_separation:finish(End, S),
    {Found ++ Last, Least}.

nobody_and_one_test() ->
    ?assertEqual({[], none}, watch(100.0, [], ?S)),
    ?assertEqual({[], none}, watch(100.0, [{0, 1, still(0.0, 0.0)}], ?S)).

%% A slice takes time.
slice_test() ->
    ?assertError(function_clause, starl_separation:new(100.0, 0)),
    ?assertEqual({[], none}, starl_separation:finish(?S, starl_separation:new(100.0, 1))).

exactly_at_the_limit_test() ->
    Two = [{0, 1, still(0.0, 0.0)}, {0, 2, still(30.0, 40.0)}],
    ?assertEqual({[], {50.0, 0, {1, 2}}}, watch(50.0, Two, 9 * ?S)),
    ?assertMatch({[{50.0, 0, {1, 2}}], _}, watch(50.00001, Two, 9 * ?S)),
    %% Rounding is no encounter.
    ?assertMatch({[], {50.0, 0, {1, 2}}}, watch(50.0000005, Two, 9 * ?S)).

a_pair_is_reported_once_test() ->
    Two = [{0, 2, still(0.0, 0.0)}, {0, 1, drive(0, 1.0, 0.0, 0.0, 1.0)}],
    ?assertMatch({[{1.0, 0, {1, 2}}], {1.0, 0, {1, 2}}}, watch(50.0, Two, 9 * ?S)).

%% While time passes: in the slice that has it, once, and no more at the end.
encounters_during_the_run_test() ->
    S0 = starl_separation:new(50.0),
    S1 = starl_separation:motion(1, drive(0, 0.0, 0.0, 0.0, 100.0), S0),
    S2 = starl_separation:motion(2, still(1000.0, 10.0), S1),
    {[], S3} = starl_separation:advance(9 * ?S, S2),
    {[{_, At, {1, 2}}], S4} = starl_separation:advance(12 * ?S, S3),
    ?assertEqual(10 * ?S, At),
    ?assertMatch({[], _}, starl_separation:advance(13 * ?S, S4)),
    ?assertMatch({[], {_, At, {1, 2}}}, starl_separation:finish(20 * ?S, S4)),
    %% several slices at once lose none of theirs
    ?assertMatch({[{_, At, {1, 2}}], _}, starl_separation:advance(30 * ?S, S2)).

%% The end belongs to what is judged: a robot that starts in that moment is seen.
starting_at_the_end_test() ->
    Two = [{0, 1, still(0.0, 0.0)}, {?S, 2, starl_trajectory:standing(?S, {30.0, 0.0}, 0.0)}],
    ?assertEqual({[{30.0, ?S, {1, 2}}], {30.0, ?S, {1, 2}}}, watch(50.0, Two, ?S)).

%% A robot that drives piece after piece: those that are over are forgotten.
memory_test() ->
    Driven = fun(N) ->
        lists:foldl(
            fun(I, S) ->
                {[], Judged} = starl_separation:advance(I * ?S, S),
                starl_separation:motion(1, drive(I * ?S, 100.0 * I, 0.0, 0.0, 100.0), Judged)
            end,
            starl_separation:new(50.0),
            lists:seq(0, N)
        )
    end,
    ?assertEqual(erts_debug:flat_size(Driven(5)), erts_debug:flat_size(Driven(50))).

%% Who appears after a time in which nothing moved is seen at once.
appearing_test() ->
    [
        begin
            Here = starl_trajectory:standing(T, {30.0, 0.0}, 0.0),
            Events = [{0, 1, still(0.0, 0.0)}, {0, 2, still(1000.0, 0.0)}, {T, 2, Here}],
            ?assertMatch({T, {[{30.0, T, {1, 2}}], _}}, {T, watch(50.0, Events, 6 * ?S)})
        end
     || Slices <- [2, 3], T <- [Slices * ?S - 1, Slices * ?S, Slices * ?S + 1]
    ].

%% What is announced may be called off: it is not judged before its time.
called_off_test() ->
    Events = [
        {0, 1, drive(0, 0.0, 0.0, 0.0, 100.0)},
        {0, 1, starl_trajectory:standing(5 * ?S, {500.0, 0.0}, 0.0)},
        {0, 2, still(300.0, 10.0)},
        {0, 2, starl_trajectory:standing(5 * ?S, {300.0, 10.0}, 0.0)},
        {2 * ?S, 1, starl_trajectory:standing(2 * ?S, {200.0, 0.0}, 0.0)}
    ],
    {[], {Distance, At, {1, 2}}} = watch(50.0, Events, 10 * ?S),
    ?assertEqual(2 * ?S, At),
    ?assert(abs(Distance - math:sqrt(10100.0)) < 1.0e-9).

%% Of two that go on with another piece in one moment, what one has done before does not meet what
%% the other does then.
both_change_at_once_test() ->
    Then = fun(X) -> starl_trajectory:standing(?S div 2, {X, 0.0}, 0.0) end,
    Events = [
        {0, 1, still(0.0, 0.0)},
        {0, 2, still(1000.0, 0.0)},
        {?S div 2, 1, Then(5000.0)},
        {?S div 2, 2, Then(10.0)}
    ],
    ?assertEqual({[], {1000.0, 0, {1, 2}}}, watch(50.0, Events, 3 * ?S)).

%% What a robot did before another one appeared does not meet that one.
over_before_the_other_came_test() ->
    At = fun(Us, X, Y) -> starl_trajectory:standing(Us, {X, Y}, 0.0) end,
    Events = [
        {0, 1, drive(0, 0.0, 0.0, 0.0, 1000.0)},
        {300_000, 1, At(300_000, 300.0, 0.0)},
        {500_000, 2, At(500_000, 500.0, 0.0)}
    ],
    ?assertEqual({[], {200.0, 500_000, {1, 2}}}, watch(50.0, Events, ?S)),
    %% likewise where others are nearer
    Near = [{0, 3, still(0.0, 9000.0)}, {0, 4, still(100.0, 9000.0)} | Events],
    ?assertEqual({[], {100.0, 0, {3, 4}}}, watch(50.0, Near, ?S)).

%% Two that come towards each other fast enough to be far apart in the middle of a second.
far_apart_in_the_middle_test() ->
    Two = [
        {0, 1, drive(0, 1000.0, 0.0, 0.0, 4000.0)},
        {0, 2, drive(0, 10000.0, 0.0, math:pi(), 4000.0)}
    ],
    {[{Distance, ?S, {1, 2}}], _} = watch(1001.0, Two, ?S),
    ?assert(abs(Distance - 1000.0) < 1.0e-6).

%% Wherever the two stand, on whatever sides of a corner of the grid.
around_a_corner_test() ->
    [
        begin
            Two = [{0, 1, still(XA, YA)}, {0, 2, still(XB, YB)}],
            ?assertMatch(
                {{{XA, YA}, {XB, YB}}, {[_], _}},
                {{{XA, YA}, {XB, YB}}, watch(50.0, Two, ?S)}
            )
        end
     || XA <- [49.0, 51.0], YA <- [49.0, 51.0], XB <- [49.0, 51.0], YB <- [49.0, 51.0]
    ].

%% Between two instants at which both are far apart: no tick would see it.
passing_between_ticks_test() ->
    Two = [{0, 1, drive(0, -1000.0, 0.0, 0.0, 4000.0)}, {0, 2, still(0.0, 10.0)}],
    {[{Distance, At, {1, 2}}], _} = watch(50.0, Two, 10 * ?S),
    ?assert(abs(Distance - 10.0) < 1.0e-9),
    ?assertEqual(?S div 4, At).

%% On the edge between two slices.
meeting_on_a_slice_edge_test() ->
    Two = [{0, 1, drive(0, 0.0, 0.0, 0.0, 100.0)}, {0, 2, still(200.0, 10.0)}],
    {[{_, At, _}], {Distance, At, {1, 2}}} = watch(50.0, Two, 10 * ?S),
    ?assertEqual(2 * ?S, At),
    ?assert(abs(Distance - 10.0) < 1.0e-9).

%% The piece that was driven last counts until the end, also after a long silence.
open_piece_counts_test() ->
    Two = [{0, 1, drive(0, 0.0, 0.0, 0.0, 10.0)}, {0, 2, still(1000.0, 0.0)}],
    ?assertMatch({[], {_, 90_000_000, _}}, watch(50.0, Two, 90 * ?S)),
    ?assertMatch({[{_, _, {1, 2}}], _}, watch(50.0, Two, 96 * ?S)).

%% What is said beforehand takes nothing from what is driven until then.
announced_motion_test() ->
    Drive = drive(0, 0.0, 0.0, 0.0, 100.0),
    Then = starl_trajectory:standing(5 * ?S, {500.0, 0.0}, 0.0),
    Events = [{0, 1, Drive}, {0, 1, Then}, {0, 2, still(300.0, 10.0)}],
    {[{Distance, At, {1, 2}}], _} = watch(50.0, Events, 10 * ?S),
    ?assertEqual(3 * ?S, At),
    ?assert(abs(Distance - 10.0) < 1.0e-9).

%% A robot that has stopped is met by one that starts an hour later.
stopped_robot_still_counts_test() ->
    Hour = 3600 * ?S,
    S0 = starl_separation:new(50.0),
    S1 = starl_separation:motion(1, drive(0, 0.0, 0.0, 0.0, 100.0), S0),
    S2 = starl_separation:motion(2, still(1000.0, 0.0), S1),
    {[], S3} = starl_separation:advance(5 * ?S, S2),
    S4 = starl_separation:stop(1, 5 * ?S, S3),
    {[], S5} = starl_separation:advance(Hour, S4),
    S6 = starl_separation:motion(2, drive(Hour, 1000.0, 0.0, math:pi(), 100.0), S5),
    {[{Distance, At, {1, 2}}], _} = starl_separation:finish(Hour + 10 * ?S, S6),
    ?assert(Distance < 50.0),
    ?assert(At > Hour),
    ?assertMatch(
        {[], {Least, _, _}} when abs(Least - 500.0) < 1.0e-6,
        starl_separation:finish(Hour, S5)
    ).

%% The minimum is true when nobody is anywhere near the limit.
far_apart_minimum_test() ->
    Robots = [{0, I, still(I * 1.0e5, (I * I) * 1.0e4)} || I <- lists:seq(1, 30)],
    {[], {Distance, 0, Pair}} = watch(1.0, Robots, ?S),
    ?assertEqual({1, 2}, Pair),
    ?assert(abs(Distance - math:sqrt(1.0e10 + 9.0e8)) < 1.0e-6).

%% Every pair, every overlap of pieces.
against_all_pairs_test_() ->
    {timeout, 60, fun() -> [against_all_pairs(Seed) || Seed <- lists:seq(1, 25)] end}.

against_all_pairs(Seed) ->
    {Motions, End} = random_motions(12, 8, rand:seed_s(exsss, Seed)),
    {Met, {Least, _, Pair}} = watch(60.0, lists:sort(Motions), End),
    All = lists:sort([
        {nearest(A, B, Motions, End), {A, B}}
     || A <- lists:seq(1, 12), B <- lists:seq(A + 1, 12)
    ]),
    {True, _} = hd(All),
    ?assert(abs(True - Least) < 2.0e-3, {seed, Seed, True, Least}),
    ?assert(element(1, lists:keyfind(Pair, 2, All)) < True + 2.0e-3, {seed, Seed}),
    Sure = [P || {D, P} <- All, D < 59.998],
    Possible = [P || {D, P} <- All, D < 60.0],
    Found = lists:sort([P || {_, _, P} <- Met]),
    ?assertEqual([], Sure -- Found, {seed, Seed}),
    ?assertEqual([], Found -- Possible, {seed, Seed}).

nearest(A, B, Motions, End) ->
    lists:min([
        element(1, starl_trajectory:closest_approach(PA, PB, max(FA, FB), min(TA, TB)))
     || {FA, TA, PA} <- stretches(A, Motions, End),
        {FB, TB, PB} <- stretches(B, Motions, End),
        max(FA, FB) =< min(TA, TB)
    ]).

stretches(Robot, Motions, End) ->
    Mine = lists:sort([{T, Piece} || {T, R, Piece} <- Motions, R =:= Robot]),
    Ends = [T || {T, _} <- tl(Mine)] ++ [End],
    [{From, To, Piece} || {{From, Piece}, To} <- lists:zip(Mine, Ends)].

%% Robots that drive N pieces each, one after the other, as far as they get.
random_motions(Robots, N, S0) ->
    {Lists, _} = lists:mapfoldl(
        fun(Robot, S) -> random_robot(Robot, N, S) end,
        S0,
        lists:seq(1, Robots)
    ),
    {lists:append(Lists), N * ?S}.

random_robot(Robot, N, S0) ->
    {X, S1} = rand:uniform_s(S0),
    {Y, S2} = rand:uniform_s(S1),
    Start = starl_trajectory:standing(0, {2000.0 * X, 2000.0 * Y}, 0.0),
    random_pieces(Robot, N, 0, Start, S2, []).

random_pieces(_Robot, 0, _T, _Last, S, Motions) ->
    {Motions, S};
random_pieces(Robot, N, T, Last, S0, Motions) ->
    {X, Y, _} = starl_trajectory:pose(T, Last),
    {H, S1} = rand:uniform_s(S0),
    {Kind, S2} = rand:uniform_s(3, S1),
    {Span, S3} = rand:uniform_s(2 * ?S, S2),
    {V, W} = element(Kind, {{0.0, 0.0}, {250.0, 0.0}, {250.0, 4.0 * (H - 0.5)}}),
    Piece = starl_trajectory:piece(T, {X, Y}, 6.3 * H, V, W),
    Next = min(T + Span, 8 * ?S - 1),
    random_pieces(Robot, N - 1, Next, Piece, S3, [{T, Robot, Piece} | Motions]).

%% Just nearer than the limit, though a hair of it is across, on whatever sides of a corner of the
%% grid: 49.995 mm are less than 50.
just_across_test() ->
    X = math:sqrt(49.995 * 49.995 - 1.0),
    [
        begin
            Two = [{0, 1, still(A, B)}, {0, 2, still(A + X, B + Y)}, {0, 3, still(500.0, 500.0)}],
            ?assertMatch({[{D, 0, {1, 2}}], _} when abs(D - 49.995) < 1.0e-9, watch(50.0, Two, ?S))
        end
     || {A, B} <- [{0.0, 0.0}, {25.0, 49.5}, {25.0, 50.5}], Y <- [1.0, -1.0]
    ].

%% To the end of a slice, too: what was to begin at that moment, and was called off then, has not
%% been.
called_off_at_the_end_of_a_slice_test() ->
    At = fun(X) -> starl_trajectory:standing(?S, {X, 0.0}, 0.0) end,
    Events = [
        {0, 1, drive(0, 0.0, 0.0, 0.0, 100.0)},
        {0, 2, still(1000.0, 0.0)},
        {0, 1, At(990.0)},
        {?S, 1, At(100.0)}
    ],
    ?assertMatch({[], {900.0, ?S, {1, 2}}}, watch(50.0, Events, 3 * ?S)).

%% A limit within rounding is none.
no_limit_test() ->
    Two = [{0, 1, still(7.0, 7.0)}, {0, 2, still(7.0, 7.0)}],
    ?assertMatch({[], {+0.0, 0, {1, 2}}}, watch(1.0e-6, Two, ?S)),
    ?assertMatch({[_], _}, watch(1.1e-6, Two, ?S)).
