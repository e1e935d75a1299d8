%% Other robots' clocks as witnesses against the own one (the page on path planning, clocks that
%% stand still).
-module(starl_dpp_clock_check_tests).
-include_lib("eunit/include/eunit.hrl").

-define(S, 1000000).

%% What is made of messages {Robot, Stamp, Now}: clocks may be set by 2 s and drift by 1 %.
heard(Messages) ->
    {Answers, _} = lists:mapfoldl(
        fun({Robot, Stamp, Now}, Witnesses) ->
            starl_dpp_clock_check:hear(Robot, Stamp, Now, {2 * ?S, 10000, 10 * ?S}, Witnesses)
        end,
        starl_dpp_clock_check:new(),
        Messages
    ),
    Answers.

%% However far apart the clocks are, and however long a later message takes.
clocks_that_agree_test() ->
    ?assertEqual(
        [agrees, agrees, agrees],
        heard([
            {1, 500 * ?S, 0}, {1, 510 * ?S, 10 * ?S}, {1, 520 * ?S, 60 * ?S}
        ])
    ),
    ?assertEqual([agrees, agrees], heard([{1, -500 * ?S, 0}, {1, none, 9 * ?S}])).

%% The own clock stands still, or was set back, by more than it may be.
own_clock_lags_test() ->
    ?assertEqual([agrees, agrees], heard([{1, 0, 0}, {1, 2 * ?S, 0}])),
    ?assertEqual([agrees, lags], heard([{1, 0, 0}, {1, 2 * ?S + 1, 0}])),
    ?assertEqual([agrees, agrees, lags], heard([{1, 0, 0}, {2, 9 * ?S, 0}, {1, 3 * ?S, 0}])).

%% Both clocks may drift while time shows.
both_clocks_may_drift_while_time_shows_test() ->
    ?assertEqual([agrees, agrees], heard([{1, 0, 0}, {1, 103 * ?S, 99 * ?S}])),
    ?assertEqual([agrees, lags], heard([{1, 0, 0}, {1, 103 * ?S + 1, 99 * ?S}])).

%% The own clock may be the slowest and the other the fastest: it lags no more than both may by their bound.
%% Holds: Clocks at their bounds of drift are no reason for another term
%% Red: c27ddcd2, run: a lag of 20,000 us in 0.99 s is told
slowest_clock_test() ->
    Hear = fun(Ahead) ->
        {agrees, First} = starl_dpp_clock_check:hear(
            1, 0, 0, {0, 10000, ?S}, starl_dpp_clock_check:new()
        ),
        {Answer, _} = starl_dpp_clock_check:hear(1, 990000 + Ahead, 990000, {0, 10000, ?S}, First),
        Answer
    end,
    ?assertEqual([agrees, lags], [Hear(Ahead) || Ahead <- [20000, 20001]]).

%% A message that took long shows less; the one that took least counts.
least_delay_counts_test() ->
    ?assertEqual(
        [agrees, agrees, agrees, lags],
        heard([
            {1, 0, ?S}, {1, ?S, ?S}, {1, ?S, 2 * ?S}, {1, 4 * ?S + 40001, 2 * ?S}
        ])
    ).

%% A clock that loses little from message to message, and more than it may in all, is found.
%% Holds: A clock that stands still is found by messages that come more often than `jump_ms`
%% Red: 3be728d, run: `tubes overlap`
loses_little_by_little_test() ->
    Beats = fun(Part) -> [{1, N * ?S, N * ?S * Part div 10} || N <- lists:seq(0, 9)] end,
    %% it stands still
    ?assertEqual([agrees, agrees, agrees, lags], lists:sublist(heard(Beats(0)), 4)),
    %% it runs at half its rate, and the window passes by its own time
    ?assert(lists:member(lags, heard(Beats(5)))),
    ?assertNot(lists:member(lags, heard(Beats(10)))),
    Slow = [{1, N * ?S, N * ?S * 98 div 100} || N <- lists:seq(0, 1000)],
    ?assertNot(lists:member(lags, heard(Slow))).

%% ... also after long: drift is allowed for in the time since the last window but one only.
found_after_long_test() ->
    Well = [{1, N * ?S, N * ?S} || N <- lists:seq(0, 1000)],
    Stands = fun(S) -> lists:last(heard(Well ++ [{1, (1000 + S) * ?S, 1000 * ?S}])) end,
    ?assertEqual([agrees, lags], [Stands(S) || S <- [2, 3]]).

%% What was lost is known then, of all robots: it is not found again.
known_once_test() ->
    ?assertEqual(
        [agrees, agrees, lags, agrees, agrees, lags],
        heard([
            {1, 0, 0}, {2, 0, 0}, {1, 5 * ?S, 0}, {1, 5 * ?S, 0}, {2, 5 * ?S, 0}, {2, 8 * ?S, 0}
        ])
    ).

%% A message that took much longer than all before it makes the next one, in time, no lag.
slow_between_test() ->
    ?assertEqual(
        [agrees, agrees, agrees, lags],
        heard([{1, 0, 0}, {1, ?S, 4 * ?S}, {1, 4 * ?S, 4 * ?S}, {1, 6 * ?S + 80810, 4 * ?S}])
    ).

%% A lead is not forgotten with its window: messages that all took long for a whole window make the next one, in
%% time, no lag.
lead_outlasts_its_window_test() ->
    Late = [{1, (T - 5) * ?S, T * ?S} || T <- [10, 15, 20]],
    ?assertEqual(
        [agrees, agrees, agrees, agrees, agrees],
        heard([{1, 0, 0}] ++ Late ++ [{1, 22 * ?S, 22 * ?S}])
    ).

%% The greatest lead of a window counts in the next one, not its last.
greatest_lead_of_a_window_counts_test() ->
    ?assertEqual(
        [agrees, agrees, agrees, agrees, agrees],
        heard([
            {1, 0, 0},
            {1, 3 * ?S, 2 * ?S},
            {1, 0, 5 * ?S},
            {1, 5 * ?S, 10 * ?S},
            {1, 13 * ?S + 500000, 11 * ?S}
        ])
    ).
