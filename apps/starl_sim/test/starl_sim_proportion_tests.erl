%% The fraction of trials and its interval, against values that were computed elsewhere.
-module(starl_sim_proportion_tests).
-include_lib("eunit/include/eunit.hrl").

the_interval_is_that_of_wilson_test_() ->
    [
        ?_assertEqual({Low, High}, rounded(starl_sim_proportion:interval(Count)))
     || {Count, Low, High} <- [
            {{0, 10}, 0.0, 0.278},
            {{0, 20}, 0.0, 0.161},
            {{10, 20}, 0.299, 0.701},
            {{20, 20}, 0.839, 1.0},
            {{50, 50}, 0.929, 1.0},
            {{100, 100}, 0.963, 1.0},
            {{200, 400}, 0.451, 0.549}
        ]
    ].

rounded({Low, High}) -> {round(1000 * Low) / 1000, round(1000 * High) / 1000}.

fractions_are_apart_only_beyond_both_intervals_test() ->
    ?assert(starl_sim_proportion:are_apart({2, 20}, {18, 20})),
    ?assertNot(starl_sim_proportion:are_apart({18, 20}, {2, 20})),
    ?assertNot(starl_sim_proportion:are_apart({8, 20}, {12, 20})).
