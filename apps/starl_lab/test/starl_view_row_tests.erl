-module(starl_view_row_tests).
-include_lib("eunit/include/eunit.hrl").

rows(Machine, Event) -> starl_view_row:of_message({trace, 7, {2, Machine, Event}}).

motion_test() ->
    Piece = starl_trajectory:piece(5, {1.0, 2.0}, 0.5, 100.0, 0.25),
    ?assertEqual(
        [[<<"m">>, 7, 2, 0, 5, 1.0, 2.0, 0.5, 100.0, 0.25]], rows(chassis, {motion, Piece})
    ),
    Ramp = starl_trajectory:ramp(5, {1.0, 2.0}, 0.5, {1.0, 2.0}, {3.0, 4.0}, 60),
    ?assertEqual(
        [[<<"m">>, 7, 2, 1, 5, 1.0, 2.0, 0.5, 1.0, 2.0, 3.0, 4.0, 60]],
        rows(chassis, {motion, Ramp})
    ).

%% What a body feels.
sensed_test() ->
    ?assertEqual(
        [[<<"x">>, 7, 2, chassis, <<"{bump,left}">>]], rows(chassis, {sensed, {bump, left}})
    ).

%% The coordinator tells which robot holds what; a user's own event of that name is something else.
held_test() ->
    Lines = [{{1.0, 2.0}, {3.0, 4.0}}],
    Row = [[<<"r">>, 7, 5, [[1.0, 2.0, 3.0, 4.0]]]],
    ?assertEqual(Row, rows(dpp_coordinator, {reserved, 5, Lines})),
    ?assertEqual(Row, rows(dpp_coordinator, {assigned, 5, {1, 1}, Lines})),
    ?assertEqual([], rows(own, {reserved, 5, [table, chair]})),
    ?assertEqual([], rows(own, {reserved, table, 5})).

packets_test() ->
    Brief = {data, {app, note}, 3},
    ?assertMatch(
        [[<<"p">>, 7, 2, 4, <<"{data,{app,note},3}">>, 50, <<"arrives">>, 20]],
        rows(radio, {packet, 4, Brief, 50, {arrives, [{20, intact}]}})
    ),
    ?assertMatch(
        [[<<"p">>, 7, 2, 4, _, 50, <<"manual_1">>, 0]],
        rows(radio, {packet, 4, Brief, 50, {lost, {fault, manual_1}}})
    ),
    ?assertMatch(
        [[<<"p">>, 7, 2, 4, _, 50, <<"corrupt">>, 20]],
        rows(radio, {packet, 4, Brief, 50, {arrives, [{20, corrupt}]}})
    ).

ends_test() ->
    ?assertEqual([[<<"x">>, 7, 2, robot, died]], rows(robot, {died, killed})),
    ?assertEqual([[<<"x">>, 7, 2, robot, down]], rows(robot, down)),
    ?assertEqual([[<<"x">>, 7, 2, sap, crashed]], rows(sap, crashed)),
    ?assertEqual([], rows(app, {anything, at, all})),
    %% an application may trace what looks like a measure
    ?assertEqual([], rows(app, {measure, "no", key})).

%% What is not judged is told as what is broken: at its time, with the contracts as their lights name them.
%% Holds: The window says what is not judged, from when on and why: a computer that stood still, a
%% monitor that was put aside
%% Red: 1b63aeb: its light said *kept*
not_judged_test() ->
    Mistake = starl_unjudged:mistake("exercise", 5, "it crashes"),
    Ended = {ended, #{ending => done, end_us => 9, violations => [], unjudged => [Mistake]}},
    ?assertEqual(
        [[<<"u">>, 5, [<<"calls">>], iolist_to_binary(starl_unjudged:format(Mistake))]],
        starl_view_row:of_message({verdicts, 9, Ended})
    ),
    %% recordings of earlier versions do not say it
    Kept = {ended, #{ending => done, end_us => 9, violations => []}},
    ?assertEqual([], starl_view_row:of_message({verdicts, 9, Kept})),
    Gap = fun(Why) ->
        [[<<"u">>, 7, [], Text]] = starl_view_row:of_message({gap, 7, Why}),
        Text
    end,
    ?assertMatch({_, _}, binary:match(Gap({stood_still, 1000000, 2000000}), <<"stood still">>)),
    ?assertMatch({_, _}, binary:match(Gap(3), <<"3 events are missing">>)).

%% A long term stays short, and a whole number of characters.
text_test() ->
    Long = starl_view_row:text(lists:duplicate(1000, "ä"), 40),
    ?assert(string:length(Long) =< 40),
    ?assertEqual(Long, unicode:characters_to_binary(unicode:characters_to_list(Long))).

%% The page draws what faults of the floor put in the way.
a_fault_of_the_floor_has_its_place_test() ->
    Row = fun(Kind, Params) -> starl_view_row:fault(0, {f, 1, 2, Kind, all, Params}) end,
    ?assertEqual([7], lists:last(Row(closed, #{door => 7}))),
    Box = #{x => 1, y => 2, width => 3, height => 4},
    ?assertEqual([1, 2, 3, 4], lists:last(Row(obstacle, Box))),
    ?assertEqual(8, length(Row(pause, #{}))).
