%% Who bumps into what, and where it feels it: the geometry of the floor.
-module(starl_world_floor_tests).
-include_lib("eunit/include/eunit.hrl").

-define(PI, 3.141592653589793).
-define(STILL, {0.0, 0.0}).

%% Robot 1 at (1000, 1000), which looks and drives in these directions (degrees), and what it feels.
felt(Heading, Course, Others, Arena) ->
    Floor = starl_world_floor:new(#{arena => Arena}),
    One = {1, {1000.0, 1000.0, radians(Heading)}, along(Course, 200.0)},
    Bodies = [One | [{Id, {X, Y, 0.0}, ?STILL} || {Id, {X, Y}} <- lists:enumerate(2, Others)]],
    case starl_world_floor:look([1], Bodies, Floor) of
        {[{1, Touch}], _} -> Touch;
        {[], _} -> nothing
    end.

radians(Degrees) -> Degrees * ?PI / 180.

along(Degrees, V) -> {V * math:cos(radians(Degrees)), V * math:sin(radians(Degrees))}.

%% Another robot in this direction, so far away.
at(Degrees, Mm) ->
    {X, Y} = along(Degrees, Mm),
    [{1000.0 + X, 1000.0 + Y}].

%% Bits 2 (left) and 1 (right) of packet 7, in every direction that the robot may look in.
bits_test_() ->
    [
        ?_assertEqual({Heading, Where, {Bits, Bits > 0}}, {
            Heading, Where, felt(Heading, Heading, at(Heading + Where, 329.0), none)
        })
     || Heading <- [0, 37, 90, 180, 271, 720],
        {Where, Bits} <- [
            {0, 3}, {14, 3}, {-14, 3}, {16, 2}, {60, 2}, {89, 2}, {-16, 1}, {-60, 1}, {-89, 1}
        ]
    ].

nothing_is_felt_from_afar_test() ->
    ?assertEqual(nothing, felt(0, 0, at(0, 331.0), none)),
    ?assertEqual(nothing, felt(0, 0, [], none)).

%% It stands still, and another one has come.
a_robot_that_stands_feels_who_comes_from_the_front_test() ->
    Floor = starl_world_floor:new(#{}),
    Bodies = [
        {1, {0.0, 0.0, 0.0}, ?STILL},
        {2, {329.0, 0.0, ?PI}, {-200.0, 0.0}}
    ],
    {Changes, _} = starl_world_floor:look([1, 2], Bodies, Floor),
    ?assertEqual([{1, {3, false}}, {2, {3, true}}], Changes).

%% Who is pushed from behind feels nothing, and drives on.
a_robot_pushed_from_behind_does_not_bump_test() ->
    ?assertEqual(nothing, felt(0, 0, at(180, 329.0), none)),
    ?assertEqual(nothing, felt(0, 0, at(120, 329.0), none)).

%% Backwards nothing is felt, but the way is closed.
backwards_test() ->
    ?assertEqual({0, true}, felt(0, 180, at(180, 329.0), none)),
    ?assertEqual({3, false}, felt(0, 180, at(0, 329.0), none)).

walls_test() ->
    [
        ?assertEqual({Heading, Touch}, {Heading, felt(Heading, Heading, [], Arena)})
     || {Heading, Arena, Touch} <- [
            {0, {1164, 5000}, {3, true}},
            {0, {1166, 5000}, nothing},
            {45, {1164, 5000}, {1, true}},
            {-45, {1164, 5000}, {2, true}},
            {90, {5000, 1164}, {3, true}},
            {180, {1164, 5000}, nothing},
            {45, {1164, 1164}, {3, true}}
        ]
    ],
    Near = {1, {164.0, 1000.0, ?PI}, {-100.0, 0.0}},
    {Felt, _} = starl_world_floor:look(
        [1], [Near], starl_world_floor:new(#{arena => {5000, 5000}})
    ),
    ?assertEqual([{1, {3, true}}], Felt).

%% 1 drives into 2, which drives into 3, which stands; then 3 leaves, 2 can go, and then 1.
three_in_a_row_test() ->
    Row = fun(X2, X3) ->
        [{1, {0.0, 0.0, 0.0}, ?STILL}, {2, {X2, 0.0, 0.0}, ?STILL}, {3, {X3, 0.0, 0.0}, ?STILL}]
    end,
    Driving = [{1, {0.0, 0.0, 0.0}, {200.0, 0.0}}, {2, {329.0, 0.0, 0.0}, {200.0, 0.0}}],
    Three = {3, {658.0, 0.0, 0.0}, ?STILL},
    Steps = [Driving ++ [Three], Row(329.0, 658.0), Row(329.0, 760.0), Row(420.0, 760.0)],
    {Felt, _} = lists:mapfoldl(
        fun(Bodies, Floor) -> starl_world_floor:look([1, 2, 3], Bodies, Floor) end,
        starl_world_floor:new(#{}),
        Steps
    ),
    ?assertEqual(
        [[{1, {3, true}}, {2, {3, true}}], [], [{2, {0, false}}], [{1, {0, false}}]], Felt
    ).

%% One that was told to drive is told anew that it cannot, or that it can.
a_new_command_is_judged_anew_test() ->
    [
        begin
            Bodies = fun(V) -> [{1, {0.0, 0.0, 0.0}, V}, {2, {329.0, 0.0, 0.0}, ?STILL}] end,
            Floor0 = starl_world_floor:new(#{}),
            {_, Floor1} = starl_world_floor:look([1], Bodies({100.0, 0.0}), Floor0),
            Told = starl_world_floor:commanded(1, Floor1),
            {Felt, Floor2} = starl_world_floor:look([1], Bodies(New), Told),
            ?assertEqual([{1, {3, IsBlocked}}], Felt),
            ?assertMatch({[], _}, starl_world_floor:look([1], Bodies(?STILL), Floor2))
        end
     || {New, IsBlocked} <- [{{100.0, 0.0}, true}, {{-100.0, 0.0}, false}, {{0.0, 100.0}, false}]
    ].

%% Only these are asked, and only what has changed is told.
only_changes_are_told_test() ->
    Bodies = [{1, {0.0, 0.0, 0.0}, {10.0, 0.0}}, {2, {329.0, 0.0, ?PI}, {-10.0, 0.0}}],
    {Felt, Floor} = starl_world_floor:look([2], Bodies, starl_world_floor:new(#{})),
    ?assertEqual([{2, {3, true}}], Felt),
    ?assertMatch({[{1, {3, true}}], _}, starl_world_floor:look([1, 2], Bodies, Floor)).
