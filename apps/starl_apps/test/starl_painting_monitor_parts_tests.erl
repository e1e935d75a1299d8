%% Parts of a segment: what they cover together, and the first that they leave out. Where a segment
%% is near another one is held against sampling in starl_painting_monitor_tests.
-module(starl_painting_monitor_parts_tests).
-include_lib("eunit/include/eunit.hrl").

-import(starl_painting_monitor_parts, [unite/2, gap/2]).

%% In whatever order parts come, what they cover is ascending and disjoint; parts that touch are
%% one.
unite_test() ->
    Parts = [{0.0, 1.0}, {1.0, 2.0}, {5.0, 6.0}, {3.0, 4.0}, {3.5, 5.5}, {8.0, 9.0}],
    [
        ?assertEqual(
            [{0.0, 2.0}, {3.0, 6.0}, {8.0, 9.0}],
            lists:foldl(fun starl_painting_monitor_parts:unite/2, [], Some)
        )
     || Some <- [Parts, lists:reverse(Parts), lists:keysort(2, Parts), Parts ++ Parts]
    ],
    ?assertEqual([{0.0, 9.0}], unite({0.0, 9.0}, [{1.0, 2.0}, {3.0, 4.0}])).

%% What is beside a line, at most so far off, and no farther before its start or past its end.
beside_test() ->
    Line = {{0.0, 0.0}, {100.0, 0.0}},
    Beside = fun(Ink) -> starl_painting_monitor_parts:beside(10.0, 2.0, Line, Ink) end,
    ?assertEqual({20.0, 50.0}, Beside({{50.0, -10.0}, {20.0, 10.0}})),
    ?assertEqual({-2.0, 102.0}, Beside({{-5.0, 0.0}, {150.0, 0.0}})),
    ?assertEqual({50.0, 60.0}, Beside({{50.0, 0.0}, {90.0, 40.0}})),
    ?assertEqual({30.0, 30.0}, Beside({{30.0, 0.0}, {30.0, 99.0}})),
    ?assertEqual({7.0, 7.0}, Beside({{7.0, 0.0}, {7.0, 0.0}})),
    ?assertEqual(none, Beside({{50.0, 10.1}, {90.0, 10.1}})),
    ?assertEqual(none, Beside({{103.0, 0.0}, {110.0, 0.0}})).

%% What is missing by more than is allowed: at the ends, in between, or all of it.
gaps_test() ->
    Gaps = fun(Parts) -> starl_painting_monitor_parts:gaps(9.0, 2.0, Parts) end,
    ?assertEqual([{0.0, 9.0}], Gaps([])),
    ?assertEqual([], Gaps([{2.0, 7.0}])),
    ?assertEqual([], Gaps([{-2.0, 2.0}, {6.0, 7.0}])),
    ?assertEqual([{0.0, 2.5}, {6.5, 9.0}], Gaps([{2.5, 6.5}])),
    ?assertEqual([{1.0, 5.5}], Gaps([{0.0, 1.0}, {5.5, 11.0}])),
    %% beyond its end, before its start
    ?assertEqual([{0.0, 9.0}], Gaps([{10.0, 11.0}])),
    ?assertEqual([{0.0, 9.0}], Gaps([{-2.0, -1.0}])).

%% The first part that is not covered: before, between or behind the others, or all of it; a part
%% may reach over the end, and a gap that rounding has left is none.
gap_test() ->
    ?assertEqual({0.0, 9.0}, gap(9.0, [])),
    ?assertEqual({0.0, 1.0}, gap(9.0, [{1.0, 2.0}, {3.0, 9.0}])),
    ?assertEqual({2.0, 3.0}, gap(9.0, [{0.0, 2.0}, {3.0, 4.0}])),
    ?assertEqual({4.0, 9.0}, gap(9.0, [{0.0, 4.0}])),
    ?assertEqual(none, gap(9.0, [{0.0, 4.0}, {4.0 + 1.0e-7, 9.0 - 1.0e-7}])),
    ?assertEqual(none, gap(9.0, [{-1.0, 10.0}])).
