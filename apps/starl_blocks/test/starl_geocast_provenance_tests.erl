%% Whose clocks count for a deadline, and while when.
-module(starl_geocast_provenance_tests).
-include_lib("eunit/include/eunit.hrl").

way(Gifts) ->
    lists:foldl(
        fun({T, Robot, From}, Way) -> starl_geocast_provenance:held(T, Robot, From, Way) end,
        starl_geocast_provenance:new(1, 10),
        Gifts
    ).

spans(Robot, Until, Gifts) -> starl_geocast_provenance:spans(Robot, Until, way(Gifts)).

before(Robot, Until, Gifts) -> starl_geocast_provenance:spans_before(Robot, Until, way(Gifts)).

source_counts_to_the_end_test() ->
    ?assertEqual([{1, 10, 90}], spans(1, 90, [{20, 2, 1}])).

%% Each counts from when the one before had it to when the next one had it.
each_counts_from_receipt_to_gift_test() ->
    Gifts = [{20, 2, 1}, {30, 3, 2}, {40, 4, 3}],
    ?assertEqual([{1, 10, 20}, {2, 10, 30}, {3, 20, 40}, {4, 30, 90}], spans(4, 90, Gifts)),
    ?assertEqual([{1, 10, 20}, {2, 10, 90}], spans(2, 90, Gifts)).

%% What was given later than that, or to others, has no part in it.
later_gifts_have_no_part_test() ->
    Gifts = [{20, 2, 1}, {25, 5, 1}, {30, 3, 2}, {60, 2, 5}],
    ?assertEqual([{1, 10, 20}, {2, 10, 30}, {3, 20, 50}], spans(3, 50, Gifts)).

%% Two that give it to each other in the same moment: each counts, once.
each_other_test() ->
    Gifts = [{20, 2, 1}, {20, 3, 1}, {30, 2, 3}, {30, 3, 2}, {30, 4, 2}],
    ?assertEqual([{1, 10, 20}, {2, 10, 30}, {3, 10, 30}, {4, 20, 90}], spans(4, 90, Gifts)).

%% Given again: both ways count, each robot once and for as long as it counts in any.
given_again_both_ways_count_test() ->
    Gifts = [{20, 2, 1}, {25, 5, 1}, {30, 3, 2}, {40, 3, 5}],
    ?assertEqual([{1, 10, 25}, {2, 10, 30}, {3, 20, 50}, {5, 10, 40}], spans(3, 50, Gifts)).

%% A robot that is met on the way twice counts until the later of the two.
met_twice_test() ->
    Gifts = [{15, 2, 1}, {20, 3, 2}, {35, 4, 2}, {40, 4, 3}],
    ?assertEqual([{1, 10, 15}, {2, 10, 35}, {3, 15, 40}, {4, 15, 50}], spans(4, 50, Gifts)),
    %% delivered as soon as it is held
    ?assertEqual([{1, 10, 15}, {2, 10, 15}], spans(2, 15, Gifts)).

%% Round in a circle, also to the source.
a_circle_ends_test() ->
    Gifts = [{20, 2, 1}, {30, 3, 2}, {40, 2, 3}, {50, 1, 2}, {50, 3, 2}],
    ?assertEqual([{1, 10, 20}, {2, 10, 50}, {3, 20, 60}], spans(3, 60, Gifts)),
    ?assertEqual([{1, 10, 60}, {2, 10, 50}, {3, 20, 40}], spans(1, 60, Gifts)).

%% What was left when it was given: the robot's own clock counts only where it gave it on before,
%% and got it back.
own_clock_counts_before_only_where_it_gave_it_on_test() ->
    ?assertEqual([{1, 10, 20}, {2, 10, 30}], before(3, 90, [{20, 2, 1}, {30, 3, 2}])),
    ?assertEqual(
        [{1, 10, 20}, {2, 10, 30}, {3, 20, 40}, {4, 30, 60}],
        before(3, 90, [{20, 2, 1}, {30, 3, 2}, {40, 4, 3}, {60, 3, 4}])
    ),
    ?assertEqual([], before(1, 90, [{20, 2, 1}])).

%% A robot of which nothing was said.
unknown_robot_has_no_span_test() ->
    ?assertEqual([{4, 90, 90}], spans(4, 90, [{20, 2, 1}])).
