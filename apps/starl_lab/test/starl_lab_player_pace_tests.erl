-module(starl_lab_player_pace_tests).
-include_lib("eunit/include/eunit.hrl").

-define(P, starl_lab_player_pace).
-define(END_US, 60000000).

%% A second of the wall is as much of the run as the speed says, to the end of the run.
target_test() ->
    Pace = ?P:new(2, false, 1000),
    ?assertEqual(2000000, ?P:target(2000, ?END_US, Pace)),
    ?assertEqual(?END_US, ?P:target(1000000, ?END_US, Pace)),
    ?assertEqual(?END_US, ?P:target(1000, ?END_US, ?P:speed(max, Pace))).

%% Time that the run has rested is not made up for.
rests_test() ->
    Resting = ?P:rest(?P:new(1, false, 0)),
    ?assert(?P:rests(Resting)),
    ?assertEqual(5000, ?P:target(9000, ?END_US, ?P:go(9000, 5000, Resting))).

%% To its goal it goes as fast as it can, and rests there.
goal_test() ->
    Pace = ?P:goal(7000, ?P:new(1, false, 0)),
    ?assertNot(?P:rests(Pace)),
    ?assertEqual(7000, ?P:target(1, ?END_US, Pace)),
    ?assertEqual(0, ?P:wait_ms(0, 1, Pace)),
    ?assertNot(?P:rests(?P:arrived(1, 6999, Pace))),
    ?assert(?P:rests(?P:arrived(1, 7000, Pace))).

%% A run may go on from its goal, from there at its speed.
goes_on_test() ->
    Going = ?P:arrived(9000, 7000, ?P:goal(7000, true, ?P:new(1, true, 0))),
    ?assertNot(?P:rests(Going)),
    ?assertEqual(1007000, ?P:target(10000, ?END_US, Going)).

%% The next piece begins a tick after the last one did, at once if that took longer.
wait_test() ->
    Pace = ?P:new(1, false, 0),
    ?assertEqual(?P:wait_ms(100, 100, Pace) - 7, ?P:wait_ms(100, 107, Pace)),
    ?assert(?P:wait_ms(100, 107, Pace) > 0),
    ?assertEqual(0, ?P:wait_ms(100, 900, Pace)),
    ?assertEqual(0, ?P:wait_ms(100, 107, ?P:speed(max, Pace))).

%% A run that is too slow for its speed goes on from where it is; a little lost is made up for.
late_test() ->
    Pace = ?P:new(1, false, 0),
    ?assertEqual(1000000, ?P:target(1000, ?END_US, ?P:arrived(1000, 800000, Pace))),
    ?assertEqual(500000, ?P:target(1000, ?END_US, ?P:arrived(1000, 500000, Pace))).

%% Pieces become shorter where they take long, and longer where they do not.
piece_test() ->
    Pace = ?P:new(max, false, 0),
    Piece = ?P:piece(Pace),
    ?assertEqual(2 * Piece, ?P:piece(?P:ran(Piece, 1, Pace))),
    ?assertEqual(Piece div 10, ?P:piece(?P:ran(Piece, 300, Pace))),
    ?assert(?P:piece(?P:ran(1, 300, Pace)) > 0).

measured_test() ->
    Pace = ?P:new(1, false, 0),
    ?assertMatch(#{real := 0.0}, ?P:clock(?P:measured(499, 900000, Pace))),
    Measured = ?P:measured(500, 1500000, Pace),
    ?assertMatch(#{real := 3.0}, ?P:clock(Measured)),
    %% a run that goes back in time has no speed at first, and then its own
    Back = ?P:measured(600, 200000, Measured),
    ?assertMatch(#{real := 0.0}, ?P:clock(Back)),
    ?assertMatch(#{real := 2.0}, ?P:clock(?P:measured(1500, 2200000, Back))).
