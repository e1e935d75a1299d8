%% What a robot's positioning believes, and which questions it answers.
-module(starl_live_poses_tests).
-include_lib("eunit/include/eunit.hrl").

-define(MS, 1000).
-define(S, 1000000).

%% The robot itself must be seen as it was when it asked, or later.
answered_by_a_later_picture_test() ->
    A = starl_live_poses:ask(q, [1, 2], 100, new()),
    {[], [], B} = starl_live_poses:show([{1, at(0), 99}, {2, at(9), 50}], 150, A),
    {[], [], C} = starl_live_poses:show([{2, at(8), 180}], 200, B),
    {[{q, Picture}], [], D} = starl_live_poses:show([{1, at(1), 190}], 250, C),
    ?assertEqual([{1, at(1), 60}, {2, at(8), 70}], Picture),
    {[], [], _} = starl_live_poses:show([{1, at(2), 260}], 270, D).

%% Oldest first, each once, also if it was asked again; the bound holds.
questions_test() ->
    Ask = fun(Tag, S) -> starl_live_poses:ask(Tag, [1], 100, S) end,
    Many = lists:foldl(Ask, new(), lists:seq(1, 1500) ++ lists:seq(1400, 1500)),
    ?assertEqual(1000, maps:get(open, starl_live_poses:figures(Many))),
    {Answers, [], _} = starl_live_poses:show([{1, at(0), 100}], 100, Many),
    ?assertEqual(lists:seq(501, 1500), [Tag || {Tag, _} <- Answers]).

asked_again_counts_from_the_first_time_test() ->
    A = starl_live_poses:ask(q, [1], 500, starl_live_poses:ask(q, [1], 100, new())),
    ?assertMatch({[{q, _}], [], _}, starl_live_poses:show([{1, at(0), 100}], 600, A)).

%% What was taken earlier, or at the same time, renews nothing.
late_test() ->
    {_, _, A} = starl_live_poses:show([{2, at(1), 1000}], 1000, new()),
    {_, _, B} = starl_live_poses:show([{2, at(5), 900}, {2, at(5), 1000}], 1100, A),
    ?assertEqual([{2, at(1), 500}], others(1500, B)),
    ?assertEqual(2, figure(late, B)).

%% A pose that repeats itself to the bit is as old as it was, unless the source rounds.
frozen_test() ->
    Show = fun(S) ->
        {_, _, Next} = starl_live_poses:show([{2, at(1), 1000}, {2, at(1), 2000}], 2000, S),
        others(2500, Next)
    end,
    ?assertEqual([{2, at(1), 1500}], Show(new())),
    ?assertEqual([{2, at(1), 500}], Show(new(#{exact => true}))).

%% A source that was stuck before the robot looked for the first time shows the same picture for ever: the
%% robot itself is known only when another one has followed that fits.
%% Holds: A robot that is started anew while its source of positions is stuck does not take the
%% stuck picture for its place
%% Red: c27ddcd2, run: the first picture answers its questions
stuck_from_the_first_test() ->
    Stuck = lists:foldl(
        fun(Ms, S) ->
            {[], [], Next} = starl_live_poses:show([{1, at(0), Ms * ?MS}], Ms * ?MS, S),
            Next
        end,
        starl_live_poses:ask(q, [1], 0, unseen(#{speed => 500.0})),
        [10, 100, 200, 300]
    ),
    ?assertEqual(1, figure(open, Stuck)),
    {[{q, Picture}], [], _} = starl_live_poses:show([{1, at(1), 400 * ?MS}], 400 * ?MS, Stuck),
    ?assertEqual([{1, at(1), 0}], Picture).

%% The source wakes up and shows the robot elsewhere: that is known when it has lasted, and said.
stuck_from_the_first_and_elsewhere_test() ->
    Asked = starl_live_poses:ask(q, [1], 0, unseen(#{speed => 500.0})),
    {Answers, Events, _} = lists:foldl(
        fun({Ms, X}, {Before, Said, S}) ->
            {More, New, Next} = starl_live_poses:show([{1, at(X), Ms * ?MS}], Ms * ?MS, S),
            {Before ++ More, Said ++ New, Next}
        end,
        {[], [], Asked},
        [{0, 0}, {10, 0}] ++ [{N * 100, 2000 + N} || N <- lists:seq(1, 12)]
    ),
    ?assertMatch([{q, [{1, {2011.0, _, _}, 0}]}], Answers),
    ?assertMatch([#{what := position_jumped}], Events).

%% A source that rounds may show a robot that stands the same twice.
first_of_an_exact_source_test() ->
    Asked = starl_live_poses:ask(q, [1], 0, unseen(#{exact => true})),
    ?assertMatch({[{q, _}], [], _}, starl_live_poses:show([{1, at(0), 10}], 10, Asked)).

%% A picture from the future is from now, and those that follow are newer.
future_test() ->
    {_, _, A} = starl_live_poses:show([{2, at(1), 99 * ?S}], 1000, new()),
    {_, _, B} = starl_live_poses:show([{2, at(2), 1500}], 1500, A),
    ?assertEqual([{2, at(2), 0}], others(1500, B)).

strangers_test() ->
    {[], [], A} = starl_live_poses:show([{77, at(1), 10}], 10, new()),
    ?assertEqual(1, figure(strangers, A)),
    ?assertEqual([], others([77], 20, A)).

%% -- jumps ----------------------------------------------------------------------------------

%% 500 mm/s and 50 mm more: in 100 ms 100 mm are possible.
possible_test() ->
    A = seen([{0, 0}, {100, 99}], limited()),
    ?assertEqual([{2, at(99), 0}], others(100 * ?MS, A)),
    B = seen([{0, 0}, {100, 101}], limited()),
    ?assertEqual([{2, at(0), 100 * ?MS}], others(100 * ?MS, B)),
    ?assertEqual(1, figure(jumps_refused, B)).

%% It is carried by two metres: refused for a second, then believed, and said once.
carried_test() ->
    Carried = [{N * 100, 2000 + N} || N <- lists:seq(1, 20)],
    {Events, S} = play([{0, 0} | Carried], limited()),
    ?assertMatch(
        [#{what := position_jumped, of_robot := 2, from := {0.0, _, _}, to := {2011.0, _, _}}],
        Events
    ),
    ?assertEqual(10, figure(jumps_refused, S)),
    ?assertEqual(1, figure(jumps_believed, S)),
    ?assertEqual([{2, at(2020), 0}], others(2000 * ?MS, S)).

%% Single wrong poses are never believed, however many there are, while right ones come between.
flicker_test() ->
    Flicker = [{N * 100, N + (N rem 2) * 5000} || N <- lists:seq(0, 100)],
    {[], S} = play(Flicker, limited()),
    ?assertEqual([{2, at(100), 0}], others(10000 * ?MS, S)),
    ?assertEqual(50, figure(jumps_refused, S)).

%% A pose that is stuck speaks for nothing: the one that lives beside it is believed.
stuck_beside_live_test() ->
    Both = [{N * 100, (N rem 2) * (5000 + N)} || N <- lists:seq(0, 13)],
    {[#{what := position_jumped}], S} = play(Both, limited()),
    ?assertEqual([{2, at(5013), 0}], others(1300 * ?MS, S)).

%% Wrong poses that do not agree with each other are not believed after the time, either.
noise_test() ->
    Noise = [{N * 100, 5000 + 3000 * (N * N rem 7)} || N <- lists:seq(1, 20)],
    {[], S} = play([{0, 0} | Noise], limited()),
    ?assertEqual(20, figure(jumps_refused, S)).

%% A robot that was not seen for a time may be as far as it could drive.
unseen_for_long_test() ->
    {[], S} = play([{0, 0}, {10000, 5000}], limited()),
    ?assertEqual([{2, at(5000), 0}], others(10000 * ?MS, S)).

%% The markers are taken the wrong way round: the heading flips.
flipped_test() ->
    S0 = new(#{turn => 4.0}),
    {_, _, S1} = starl_live_poses:show([{2, {0.0, 0.0, 3.1}, 0}], 0, S0),
    {_, _, S2} = starl_live_poses:show([{2, {0.0, 0.0, -3.1}, 10 * ?MS}], 10 * ?MS, S1),
    {_, _, S3} = starl_live_poses:show([{2, {0.0, 0.0, 0.05}, 20 * ?MS}], 20 * ?MS, S2),
    ?assertEqual([{2, {0.0, 0.0, -3.1}, 10 * ?MS}], others(20 * ?MS, S3)).

%% -- silence --------------------------------------------------------------------------------

%% Said once when the robot has asked and is not seen for two seconds, and once when it is back.
silent_test() ->
    {_, _, A} = starl_live_poses:show([{1, at(0), ?S}], ?S, new()),
    Asked = starl_live_poses:ask(one, [1], 2 * ?S, A),
    {[], B} = starl_live_poses:silence(4 * ?S - 1, Asked),
    {[#{what := position_silent, for_us := 2000000}], C} = starl_live_poses:silence(4 * ?S, B),
    {[], D} = starl_live_poses:silence(9 * ?S, C),
    {[], [], E} = starl_live_poses:show([{2, at(0), 9 * ?S}], 9 * ?S, D),
    {[{one, _}], [#{what := position_back, for_us := 9000000}], F} =
        starl_live_poses:show([{1, at(1), 10 * ?S}], 10 * ?S, E),
    {[], [], _} = starl_live_poses:show([{1, at(2), 11 * ?S}], 11 * ?S, F).

%% A source that nobody has asked for long is not silent.
not_silent_test() ->
    {_, _, A} = starl_live_poses:show([{1, at(0), ?S}], ?S, new()),
    ?assertMatch({[], _}, starl_live_poses:silence(9 * ?S, A)),
    Asked = starl_live_poses:ask(one, [1], 9 * ?S, A),
    ?assertMatch({[], _}, starl_live_poses:silence(9 * ?S, Asked)).

%% -- robots that are put down -----------------------------------------------------------------

%% A robot that stands badly is not told where it is, and why is said once; when it stands well, it is told. What
%% comes near to it later is no matter of that.
who_is_put_down_badly_is_not_told_where_it_is_test() ->
    Rule = #{radii => #{1 => 165.0, 2 => 165.0}, apart_mm => 340, error_mm => 1.0},
    Show = fun(Us, Other, S) ->
        starl_live_poses:show([{1, at(Us / 100), Us}, {2, at(Other), Us}], Us, S)
    end,
    A = starl_live_poses:ask(q, [1], 0, unseen(#{placing => Rule})),
    ?assertEqual([1, 2, 3], starl_live_poses:wanted([1], A)),
    {[], [], B} = Show(100, 300, A),
    {[], [#{what := badly_placed, why := Why}], C} = Show(200, 300, B),
    ?assertEqual(
        <<"robot 1 stands 298 mm from robot 2, at (2, 0) mm, and does not drive: put them down at least 340 mm apart">>,
        Why
    ),
    {[], [], D} = Show(300, 200, C),
    ?assertEqual([1, 2, 3], starl_live_poses:wanted([1], D)),
    {[{q, [{1, _, _}]}], [#{what := well_placed}], E} = Show(400, 400, D),
    ?assertEqual([1], starl_live_poses:wanted([1], E)),
    ?assertMatch({[{r, _}], [], _}, Show(600, 100, starl_live_poses:ask(r, [1], 500, E))).

%% Where a robot that has not been seen for long stood says nothing.
who_is_not_seen_is_not_in_the_way_test() ->
    Rule = #{radii => #{1 => 165.0, 2 => 165.0}, apart_mm => 340, error_mm => 1.0},
    A = starl_live_poses:ask(q, [1], 0, unseen(#{placing => Rule})),
    {[], [], B} = starl_live_poses:show([{1, at(0), 100}, {2, at(9), 100}], 100, A),
    Later = 3 * ?S,
    ?assertMatch({[{q, _}], [], _}, starl_live_poses:show([{1, at(1), Later}], Later, B)).

options_test() ->
    ?assertEqual(ok, starl_live_poses:options(#{speed => 500.0, turn => infinity, exact => true})),
    {error, Line} = starl_live_poses:options(#{speed => fast}),
    ?assertEqual("speed must be a speed in mm/s, or infinity, not fast", lists:flatten(Line)),
    ?assertMatch({error, _}, starl_live_poses:options(#{jump_mm => -1})).

%% -- helpers --------------------------------------------------------------------------------

new() -> new(#{}).

%% The robot has just been seen, twice.
new(Options) ->
    {[], [], Seen} = starl_live_poses:show(
        [{1, at(-2), -2}, {1, at(-1), -1}], 0, unseen(Options)
    ),
    Seen.

unseen(Options) ->
    Clock = starl_live_clock:new(0, 1),
    Config = #{robot => 1, participants => starl_team:new([1, 2, 3]), clock => Clock},
    starl_live_poses:new(maps:merge(Config, Options), 0).

limited() -> new(#{speed => 500.0}).

at(X) -> {float(X), 0.0, 0.0}.

seen(Places, S) -> element(2, play(Places, S)).

%% Robot 2 at these times (ms) and places.
play(Places, S0) ->
    lists:foldl(
        fun({Ms, X}, {Events, S}) ->
            {[], More, Next} = starl_live_poses:show([{2, at(X), Ms * ?MS}], Ms * ?MS, S),
            {Events ++ More, Next}
        end,
        {[], S0},
        Places
    ).

others(Now, S) -> others([2], Now, S).

%% What the robot would be shown now of others.
others(Robots, Now, S) ->
    {[{other, Picture}], _, _} =
        starl_live_poses:show(
            [{1, at(1), Now}], Now, starl_live_poses:ask(other, [1 | Robots], Now, S)
        ),
    [One || {Robot, _, _} = One <- Picture, Robot =/= 1].

figure(Figure, S) -> maps:get(Figure, starl_live_poses:figures(S), 0).
