%% How far a broken assumption reaches: the windows' edges, what adds up, whose they are.
-module(starl_assumption_tests).
-include_lib("eunit/include/eunit.hrl").

-define(A, starl_assumption).

but(Windows) -> ?A:new([{1, From, To, Broken} || {From, To, Broken} <- Windows], 0).

lost(Us, At) -> {At, At, {clock, -Us}}.
gained(Us, At) -> {At, At, {clock, Us}}.

kept_test() ->
    ?assert(?A:is_kept(but([]))),
    ?assertNot(?A:is_kept(but([{5, 9, pause}]))),
    [
        ?assertEqual(Kept, ?A:is_kept(From, To, but([{5, 9, pause}, {7, 8, position}])))
     || {From, To, Kept} <- [
            {0, 4, true},
            {0, 5, false},
            {6, 7, false},
            {9, 20, false},
            {10, 20, true}
        ]
    ].

%% A window that is told later is like one that was known.
told_later_test() ->
    Windows = [{1, 5, 9, pause}, {1, 2, 2, {clock, -3}}, {all, 4, 6, position}],
    ?assertEqual(?A:new(Windows, 7), lists:foldl(fun ?A:broken/2, ?A:new([], 7), Windows)).

%% A pause of which two have told, in part, is no longer for that: what both tell of counts once.
pauses_that_meet_are_one_test() ->
    Told = lists:foldl(fun ?A:broken/2, ?A:new([], 7), [
        {1, 5, 9, pause}, {1, 20, 25, pause}, {2, 8, 12, pause}, {1, 2, 4, still}, {1, 8, 12, pause}
    ]),
    Windows = [{1, 5, 12, pause}, {1, 20, 25, pause}, {2, 8, 12, pause}, {1, 2, 4, still}],
    ?assertEqual(?A:new(Windows, 7), Told).

%% Live robots tell themselves when their computers were late.
late_computers_test() ->
    Facts = [{9, 1, robot, {late, 4, 9}}, {9, 1, robot, up}, {9, 2, app, {late, 4, 9}}],
    ?assertEqual([{1, 4, 9, pause}], ?A:late(Facts)).

%% Each robot's own, and those of all.
robots_test() ->
    Mixed = ?A:new(
        [
            {2, 10, 10, {clock, -1}},
            {all, 10, 10, {clock, -10}},
            {1, 10, 10, {clock, -100}}
        ],
        0
    ),
    ?assertEqual([110, 11, 10], [?A:lost_us(R, 0, 20, Mixed) || R <- [1, 2, 3]]).

%% What a clock loses until then makes it later, and then counts what it loses until later.
clock_later_test() ->
    Set = [lost(5, 20), lost(5, 24), lost(5, 36), lost(7, 9), gained(9, 15)],
    ?assertEqual(30, ?A:clock_later(1, 10, 20, but(Set))),
    ?assertEqual(19, ?A:clock_later(1, 10, 19, but(Set))),
    ?assertEqual(31 + 5, ?A:clock_later(1, 10, 31, but([lost(5, 31)]))),
    %% one that stands still when it begins
    ?assertEqual(30, ?A:clock_later(1, 10, 20, but([{0, 10, {clock, -10}}]))),
    ?assertEqual(20, ?A:clock_later(1, 10, 20, but([{0, 9, {clock, -9}}]))).

%% Likewise, back.
clock_earlier_test() ->
    Earlier = fun(Since, Windows) -> ?A:clock_earlier(1, 20, Since, but(Windows)) end,
    ?assertEqual(0, Earlier(10, [lost(5, 10), lost(5, 6), lost(7, 21), gained(9, 15)])),
    ?assertEqual([5, 10], [Earlier(10, [lost(5, At)]) || At <- [20, 21]]),
    %% set back from 10 at 5, and at 4: 5 it has shown before, which was at 5 and is at 10
    ?assertEqual([5, 10], [Earlier(10, [lost(5, At)]) || At <- [5, 4]]),
    %% what stands still shows nothing twice
    ?assertEqual([5, 10], [Earlier(10, [{At - 5, At, {clock, -5}}]) || At <- [10, 9]]),
    %% the second one is reached by what the first one has lost, however they lie
    ?assertEqual([4, 4, 10], [Earlier(10, [lost(5, At), lost(1, 8)]) || At <- [7, 4, 3]]),
    ?assertEqual([1, 9], [Earlier(10, [lost(1, 9), {At - 8, At, {clock, -8}}]) || At <- [9, 8]]),
    %% it stood still from 2 to 8, and was set back by 3 meanwhile: what it shows at 10 it shows at
    %% 1, too; set back by 1, what it shows at 9 it showed until 4; at 10 it showed that never before
    ?assertEqual(1, Earlier(10, [lost(3, 4), {2, 8, {clock, -6}}])),
    ?assertEqual(2, Earlier(9, [lost(1, 4), {2, 8, {clock, -6}}])),
    ?assertEqual(10, Earlier(10, [lost(1, 4), {2, 8, {clock, -6}}])).

%% A clock that gains nothing is as right as before, also while it loses in another window.
no_gain_test() ->
    Slow = [{25, 32, {clock, -6}}, {31, 52, {clock, -12}}],
    Earlier = fun(Windows) -> ?A:clock_earlier(1, 60, 48, but(Windows)) end,
    ?assertEqual(42, Earlier(Slow)),
    ?assertEqual(42, Earlier([{38, 43, {clock, 0}} | Slow])).

%% Held against a clock that is looked at in every microsecond.
clock_earlier_is_exact_test() ->
    Seed = starl_platform_ct:seed(),
    io:format("seed ~p~n", [Seed]),
    lists:foldl(
        fun(_, Random0) ->
            {Windows, Since, Random} = drawn(Random0),
            A = but(Windows),
            Shown = [At || At <- lists:seq(-300, 60), At + ?A:lost_us(1, At, 60, A) >= Since],
            ?assertEqual(
                {Windows, Since, hd(Shown)},
                {Windows, Since, ?A:clock_earlier(1, 60, Since, A)}
            ),
            Random
        end,
        rand:seed_s(exsss, Seed),
        lists:seq(1, 2000)
    ).

drawn(Random0) ->
    lists:foldl(
        fun(_, {Windows, Since, R0}) ->
            {From, R1} = rand:uniform_s(60, R0),
            {Long, R2} = rand:uniform_s(15, R1),
            {Kind, R3} = rand:uniform_s(2, R2),
            Window =
                case Kind of
                    1 -> lost(Long, From);
                    2 -> {From, From + Long, {clock, -Long}}
                end,
            {[Window | Windows], Since, R3}
        end,
        begin
            {Since, R} = rand:uniform_s(60, Random0),
            {[], Since, R}
        end,
        [1, 2, 3]
    ).

%% Between the two times, both included; of a clock that stands still the part.
amounts_test() ->
    Set = [lost(5, 10), lost(7, 20), gained(3, 12)],
    Between = fun(F, T) -> {?A:lost_us(1, F, T, but(Set)), ?A:gained_us(1, F, T, but(Set))} end,
    [
        ?assertEqual({Lost, Gained}, Between(From, To))
     || {From, To, Lost, Gained} <- [
            {10, 20, 12, 3},
            {11, 20, 7, 3},
            {10, 19, 5, 3},
            {12, 12, 0, 3},
            {13, 19, 0, 0}
        ]
    ],
    Least = but([lost(1, 10), gained(1, 10)]),
    ?assertEqual({1, 1}, {?A:lost_us(1, 0, 20, Least), ?A:gained_us(1, 0, 20, Least)}),
    Stands = but([{10, 20, {clock, -10}}]),
    ?assertEqual(
        [10, 4, 6, 2, 0],
        [
            ?A:lost_us(1, F, T, Stands)
         || {F, T} <- [
                {0, 30},
                {0, 14},
                {14, 30},
                {13, 15},
                {20, 30}
            ]
        ]
    ),
    ?assertEqual(1, ?A:lost_us(1, 0, 11, but([{10, 20, {clock, -3}}]))).

%% A clock that is slow within its bound takes longer to make up for what it has lost.
drift_test() ->
    Drifting = ?A:new([{1, 10, 10, {clock, -98}}], 20000),
    ?assertEqual(100, ?A:lost_us(1, 0, 20, Drifting)),
    ?assertEqual(120, ?A:clock_later(1, 0, 20, Drifting)),
    ?assertEqual(
        [0, 101, 100], [?A:longest_us(Us, Ppm) || {Us, Ppm} <- [{0, 7}, {100, 1}, {100, 0}]]
    ).

%% In order within the lag; else at the end of the pauses that it runs into, or as slow as it is.
handled_test() ->
    At = fun(Due, Windows) -> ?A:handled(1, Due, 3, but(Windows)) end,
    ?assertEqual(13, At(10, [])),
    ?assertEqual(23, At(10, [{5, 20, pause}])),
    ?assertEqual(23, At(10, [{13, 20, pause}])),
    ?assertEqual(13, At(10, [{14, 20, pause}])),
    ?assertEqual(13, At(10, [{5, 9, pause}])),
    ?assertEqual(33, At(10, [{21, 30, pause}, {5, 20, pause}])),
    ?assertEqual(23, At(10, [{24, 30, pause}, {5, 20, pause}])),
    ?assertEqual(17, At(10, [{5, 20, {slow, 7}}])),
    ?assertEqual(13, At(10, [{5, 20, {slow, 3}}])),
    ?assertEqual(13, At(10, [{5, 9, {slow, 7}}])),
    ?assertEqual([17, 17], [At(10, [{5, 10, {slow, 7}}]), At(10, [{13, 20, {slow, 7}}])]),
    ?assertEqual(13, At(10, [{14, 20, {slow, 7}}])),
    ?assertEqual(13, At(10, [{5, 20, {clock, -7}}])).

%% What is traced at the end of a step that stood still may have begun with it.
begun_test() ->
    Told = but([{5, 20, still}, {5, 20, pause}, {30, 40, pause}]),
    ?assertEqual(
        [4, 5, 5, 5, 21, 35], [?A:begun_us(1, At, Told) || At <- [4, 5, 9, 20, 21, 35]]
    ),
    ?assertEqual(9, ?A:begun_us(2, 9, Told)).

misplaced_test() ->
    Told = but([{10, 20, position}, {30, 40, pause}]),
    [
        ?assertEqual(Wrong, ?A:is_misplaced(1, From, To, Told))
     || {From, To, Wrong} <- [
            {0, 9, false},
            {0, 10, true},
            {19, 25, true},
            {20, 25, false},
            {30, 40, false}
        ]
    ],
    ?assertNot(?A:is_misplaced(2, 0, 100, Told)).

%% Work is late by what it meets: a part of a pause, what the clock loses, the lag of each step; and
%% what it meets because it is late already.
delayed_test() ->
    Delayed = fun(Windows) -> ?A:delayed_us(1, 10, 20, 3, but(Windows)) - 20 end,
    ?assertEqual([0, 6, 6, 0], [
        Delayed([{From, To, pause}])
     || {From, To} <- [{2, 9}, {14, 20}, {20, 26}, {21, 27}]
    ]),
    ?assertEqual(3, Delayed([{2, 13, pause}])),
    ?assertEqual([0, 5, 5, 0], [Delayed([lost(5, At)]) || At <- [9, 10, 20, 21]]),
    ?assertEqual(0, Delayed([gained(5, 15)])),
    ?assertEqual(6, Delayed([{5, 15, {slow, 2}}])),
    ?assertEqual(10, Delayed([lost(5, 18), {24, 29, pause}])),
    ?assertEqual(0, Delayed([{12, 15, position}, {12, 15, still}])),
    ?assertEqual(5, Delayed([{5, 15, {clock, -10}}])).

%% Another robot's trouble is no excuse.
delayed_by_its_own_windows_test() ->
    Windows = ?A:new([{2, 10, 19, pause}, {all, 12, 13, pause}], 0),
    ?assertEqual([21, 30], [?A:delayed_us(R, 10, 20, 3, Windows) || R <- [1, 2]]).
