%% Parts of a segment: what they cover together, and the first that they leave out. Where a segment
%% is near another one is held against sampling in starl_painting_monitor_tests.
-module(starl_painting_parts_tests).
-include_lib("eunit/include/eunit.hrl").

-import(starl_painting_parts, [unite/2, gap/2]).

%% In whatever order parts come, what they cover is ascending and disjoint; parts that touch are one.
unite_test() ->
    Parts = [{0.0, 1.0}, {1.0, 2.0}, {5.0, 6.0}, {3.0, 4.0}, {3.5, 5.5}, {8.0, 9.0}],
    [
        ?assertEqual(
            [{0.0, 2.0}, {3.0, 6.0}, {8.0, 9.0}],
            lists:foldl(fun starl_painting_parts:unite/2, [], Some)
        )
     || Some <- [Parts, lists:reverse(Parts), lists:keysort(2, Parts), Parts ++ Parts]
    ],
    ?assertEqual([{0.0, 9.0}], unite({0.0, 9.0}, [{1.0, 2.0}, {3.0, 4.0}])).

%% The first part that is not covered: before, between or behind the others, or all of it; a part
%% may reach over the end, and a gap that rounding has left is none.
gap_test() ->
    ?assertEqual({0.0, 9.0}, gap(9.0, [])),
    ?assertEqual({0.0, 1.0}, gap(9.0, [{1.0, 2.0}, {3.0, 9.0}])),
    ?assertEqual({2.0, 3.0}, gap(9.0, [{0.0, 2.0}, {3.0, 4.0}])),
    ?assertEqual({4.0, 9.0}, gap(9.0, [{0.0, 4.0}])),
    ?assertEqual(none, gap(9.0, [{0.0, 4.0}, {4.0 + 1.0e-7, 9.0 - 1.0e-7}])),
    ?assertEqual(none, gap(9.0, [{-1.0, 10.0}])).
