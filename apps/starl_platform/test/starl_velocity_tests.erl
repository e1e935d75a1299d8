%% A robot with two wheels that drives with a velocity: the pure machine in a closed loop with a
%% chassis without errors, and the law that turns a velocity into commands.
-module(starl_velocity_tests).
-include_lib("eunit/include/eunit.hrl").
-include("starl_motion_loop.hrl").

-import(starl_motion_loop, [new/2, goto/3, event/3, until/2, finish/1]).

drives_until_its_time_is_up_test() ->
    Loop = finish(velocity({0.0, 300.0}, 2000000, 1, exact())),
    ?assertEqual([{0, ok}], Loop#loop.replies),
    %% it has turned from 0.3 to the left while it drove, and then drove straight on
    {X, Y, Heading} = pose(Loop),
    ?assert(abs(Heading - math:pi() / 2) < 1.0e-3),
    ?assert(Y > 450.0 andalso Y < 600.0),
    ?assert(X >= 0.0 andalso X < 60.0),
    ?assertEqual(2000000, starl_trajectory:start_us(Loop#loop.piece)),
    ?assert(is_still(Loop)).

%% Each call within the time replaces the script; nobody but the last one's end stops the robot.
another_velocity_in_time_test() ->
    One = until(500000, velocity({300.0, 0.0}, 1000000, 1, exact())),
    Two = until(1400000, velocity({0.0, 300.0}, 1000000, 2, One)),
    ?assertNot(is_still(Two)),
    ?assertEqual([ok, ok], answers(Two)),
    Three = until(1500000, Two),
    ?assert(is_still(Three)).

go_to_ends_a_velocity_test() ->
    One = until(500000, velocity({300.0, 0.0}, 60000000, 1, exact())),
    Gone = finish(goto({0.0, 500.0}, 2, One)),
    ?assertEqual([ok, ok], answers(Gone)),
    {X, Y, _} = pose(Gone),
    ?assert(starl_geometry:distance({X, Y}, {0.0, 500.0}) < 10.0).

%% The later call wins, the earlier one is told.
velocity_ends_a_go_to_test() ->
    One = until(500000, goto({3000.0, 0.0}, 1, exact())),
    Two = finish(velocity({0.0, 0.0}, 1000000, 2, One)),
    ?assertMatch([{_, ok}, {_, {error, stopped}}], Two#loop.replies),
    ?assert(is_still(Two)).

stop_ends_a_velocity_test() ->
    One = until(500000, velocity({300.0, 0.0}, 60000000, 1, exact())),
    Two = event({call, {app, 2}}, stop, One),
    ?assertEqual([ok, ok], answers(Two)),
    ?assert(is_still(Two)),
    ?assertEqual(500000, starl_trajectory:start_us(Two#loop.piece)).

%% Without a position it stops, half a second later, and says so.
without_a_position_it_stops_test() ->
    One = until(500000, velocity({300.0, 0.0}, 60000000, 1, exact())),
    Two = until(1100000, velocity({0.0, 300.0}, 60000000, 2, One#loop{eyes = fun(_) -> lost end})),
    ?assertMatch([{1000000, {error, unknown}}, {0, ok}], Two#loop.replies),
    ?assert(is_still(Two)),
    Three = velocity({0.0, 300.0}, 60000000, 3, Two#loop{eyes = fun(_) -> unknown end}),
    ?assertMatch([{_, {error, unknown}} | _], Three#loop.replies).

%% A wheel does not obey: the cruise is over, the robot tries to and fro, and drives again later.
a_cruise_ends_when_a_wheel_does_not_obey_test() ->
    One = until(500000, velocity({300.0, 0.0}, 60000000, 1, exact())),
    #loop{commands = [{Mark, _} | _]} = One,
    Off = event(info, {stalled, Mark, {300.0, 300.0}}, One#loop{chassis = none}),
    Refused = velocity({300.0, 0.0}, 1000000, 2, Off),
    ?assertMatch([{_, {error, stalled}} | _], Refused#loop.replies),
    Tried = finish(Refused),
    ?assertEqual(
        [ok], answers(finish(velocity({300.0, 0.0}, 1000000, 3, Tried#loop{replies = []})))
    ).

%% An answer of the chassis that it has no word for changes nothing.
an_unknown_answer_changes_nothing_test() ->
    One = until(500000, velocity({300.0, 0.0}, 60000000, 1, exact())),
    #loop{commands = [{Mark, _} | _], machine = Machine} = One,
    {Actions, Same} = starl_machine:step(
        info, {stalled, Mark, nonsense}, #{now => 500000, robot => 1}, Machine
    ),
    ?assertMatch([{trace, {unknown_event, info, _}}], Actions),
    ?assertEqual(Machine, Same).

%% What it traces: a velocity, and what ended it.
a_velocity_and_its_end_are_traced_test() ->
    Start = #{
        robot => 1,
        participants => [1],
        name => motion,
        incarnation => 2,
        random => rand:seed_s(exsss, 1),
        now => 0
    },
    Profile = starl_chassis:profile(starl_chassis_holonomic, #{}),
    {Again, New} = starl_machine:new(starl_motion, #{profiles => [Profile]}, Start),
    ?assertEqual([{velocity_over, restarted}], traced(Again)),
    Velocity = {{call, {app, 1}}, {velocity, {600.0, 0.0}, 5000}},
    Pose = {{reply, 1}, {ok, {0.0, 0.0, 0.0}}},
    {Told, Drives} = steps([Velocity, Pose], New),
    ?assertEqual([{velocity, {500.0, 0.0}, 5000}], traced(Told)),
    [
        ?assertMatch(
            {Why, [{velocity_over, Why} | _]}, {Why, traced(element(1, steps(Ends, Drives)))}
        )
     || {Why, Ends} <- [
            {time, [{info, {driven, (2 bsl 32) + 2, 0}}]},
            {stalled, [{info, {stalled, (2 bsl 32) + 2, {500.0, 0.0}}}]},
            {no_answer, [{state_timeout, heard_nothing}]},
            {command, [{cast, stop}]},
            {unknown, [Velocity, {{reply, 2}, {error, unknown}}]}
        ]
    ].

steps(Events, Machine) ->
    lists:foldl(
        fun({Type, Content}, {_, M}) ->
            starl_machine:step(Type, Content, #{now => 0, robot => 1}, M)
        end,
        {[], Machine},
        Events
    ).

traced(Actions) -> [Event || {trace, Event} <- Actions].

two_wheels_follow_the_law_test() ->
    %% straight on; a small correction takes a quarter of a second
    ?assertEqual([{300.0, 300.0, 1000000}], script({300.0, 0.0}, 0.0, 1000000)),
    [{L, R, 250000}, {300.0, 300.0, 750000}] = script({300.0, 0.0}, 0.1, 1000000),
    ?assert(L > R),
    ?assert(abs((L + R) / 2 - 300.0 * math:cos(0.1)) < 1.0e-9),
    ?assert(abs((R - L) / 258.0 * 0.25 + 0.1) < 1.0e-9),
    %% it looks away: a turn in place at the turn rate
    [{L1, R1, Us1}, _] = script({300.0, 0.0}, 2.0, 1000000),
    ?assertEqual(0.0, L1 + R1),
    ?assertEqual(round(2.0 / 3.0 * 1.0e6), Us1),
    %% no wheel is faster than the limit, nor does it drive backwards
    [
        begin
            ?assert(Left =< 500.0 + 1.0e-9 andalso Right =< 500.0 + 1.0e-9),
            ?assert(Left + Right >= -1.0e-9)
        end
     || N <- lists:seq(-31, 31), {Left, Right, _} <- script({500.0, 0.0}, N / 10, 2000000)
    ],
    %% the script is as long as its time, however short that is
    [
        ?assertEqual(Us, lists:sum([U || {_, _, U} <- script({300.0, 0.0}, A, Us)]))
     || Us <- [1, 1000, 250000, 250001, 3000000], A <- [0.0, 0.05, -0.7, 1.6, 3.1]
    ],
    ?assertEqual([{0.0, 0.0, 1000}], script({0.0, 0.0}, 1.0, 1000)),
    %% a turn that takes the whole time is the whole script; a whole second's turn takes one
    ?assertMatch([{_, _, 1000}], script({300.0, 0.0}, 0.05, 1000)),
    ?assertMatch([{_, _, 250000}], script({300.0, 0.0}, 0.05, 250000)),
    ?assertMatch([{_, _, 250000}, {300.0, 300.0, 1}], script({300.0, 0.0}, 0.05, 250001)),
    ?assertMatch([{_, _, 1000000}, {_, _, 7}], script({300.0, 0.0}, 3.0, 1000007)),
    %% a thousandth of a rad is worth a turn; slow is not none, down to a thousandth of a mm/s
    ?assertMatch([{_, _, 250000}, _], script({300.0, 0.0}, 1.0e-3, 1000000)),
    ?assertEqual([{300.0, 300.0, 1000000}], script({300.0, 0.0}, 0.9e-3, 1000000)),
    ?assertEqual([{0.5, 0.5, 1000}], script({0.5, 0.0}, 0.0, 1000)),
    ?assertMatch([{V, V, 1000}] when V > 0.0, script({1.0e-3, 0.0}, 0.0, 1000)),
    ?assertEqual([{0.0, 0.0, 1000}], script({0.9e-3, 0.0}, 0.0, 1000)).

%% A velocity beyond the limit is taken at the limit.
a_velocity_beyond_the_limit_is_taken_at_it_test() ->
    Profile = starl_chassis:profile(starl_chassis_holonomic, #{speed => 500.0}),
    ?assertEqual({300.0, 400.0}, starl_chassis:limited({3000, 4000}, Profile)),
    ?assertEqual({30.0, 40.0}, starl_chassis:limited({30, 40}, Profile)),
    [{F, L, 5}] = starl_chassis_holonomic:cruise(
        {0.0, 505.0}, {0.0, 0.0, math:pi() / 2}, 5, Profile
    ),
    ?assert(abs(F - 500.0) < 1.0e-6),
    ?assert(abs(L) < 1.0e-6).

script(Velocity, Heading, Us) ->
    Profile = starl_chassis:profile(starl_chassis_differential, #{}),
    starl_chassis_differential:cruise(Velocity, {0.0, 0.0, Heading}, Us, Profile).

exact() -> new(fun(_) -> 0.0 end, starl_chassis:profile(starl_chassis_differential, #{})).

velocity(Velocity, Us, Tag, Loop) -> event({call, {app, Tag}}, {velocity, Velocity, Us}, Loop).

answers(#loop{replies = Replies}) -> lists:reverse([Answer || {_, Answer} <- Replies]).

pose(#loop{now = Now, piece = Piece}) -> starl_trajectory:pose(Now, Piece).

is_still(#loop{piece = Piece}) -> starl_trajectory:is_still(Piece).
