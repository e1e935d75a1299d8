%% A goal of motion: its line, what is in its way, and how near a robot has to be for a try.
-module(starl_motion_goal_tests).
-include_lib("eunit/include/eunit.hrl").

-define(ROUTE, {{0.0, 0.0}, {3000.0, 0.0}}).

%% The line to a point begins where the robot is seen first; a line is told once.
the_line_is_told_once_test() ->
    {Lines, To} = starl_motion_goal:begins({1.0, 2.0, 0.0}, goal(to, {unknown, {9.0, 9.0}})),
    ?assertEqual([{line, {{1.0, 2.0}, {9.0, 9.0}}}], Lines),
    ?assertEqual({[], To}, starl_motion_goal:begins({3.0, 4.0, 0.0}, To)),
    ?assertMatch(
        {[{line, ?ROUTE}], _}, starl_motion_goal:begins({1.0, 2.0, 0.0}, goal(along, ?ROUTE))
    ).

%% A robot that faces a line drives to its beginning.
it_heads_to_the_end_or_to_the_beginning_test() ->
    ?assertEqual({goal, along, {3000.0, 0.0}}, starl_motion_goal:said(goal(along, ?ROUTE))),
    ?assertEqual({goal, face, {0.0, 0.0}}, starl_motion_goal:said(goal(face, ?ROUTE))).

%% Three times in a row, and only on a given line.
three_stalls_block_a_line_test() ->
    Stalls = fun(N, Goal) ->
        lists:foldl(fun(_, G) -> starl_motion_goal:stalled(G) end, Goal, lists:seq(1, N))
    end,
    ?assertNot(starl_motion_goal:is_blocked(Stalls(2, goal(along, ?ROUTE)))),
    ?assert(starl_motion_goal:is_blocked(Stalls(3, goal(along, ?ROUTE)))),
    ?assertNot(starl_motion_goal:is_blocked(Stalls(3, goal(to, ?ROUTE)))),
    ?assertNot(
        starl_motion_goal:is_blocked(
            Stalls(2, starl_motion_goal:moves(Stalls(2, goal(along, ?ROUTE))))
        )
    ).

%% A try may lead anywhere: it needs room up to the tracking radius; without a line there is none to leave.
a_try_stays_on_the_line_test() ->
    Chassis = starl_chassis_differential,
    #{position_error_mm := Error} = Profile = starl_chassis:profile(Chassis, #{}),
    Room = Chassis:tracking_radius(Profile) - Chassis:try_mm(Profile) - Error,
    Keeps = fun(Place, Goal) -> starl_motion_goal:keeps(Place, Chassis, Profile, Goal) end,
    ?assert(Keeps({100.0, Room - 1.0}, goal(along, ?ROUTE))),
    ?assertNot(Keeps({100.0, Room + 1.0}, goal(along, ?ROUTE))),
    %% in round numbers: 2 mm of error and a try of 2 mm leave 11.25 mm of 15.25
    Round = starl_platform_ct:two_wheels(),
    ?assertEqual(
        [true, false],
        [
            starl_motion_goal:keeps({100.0, Mm}, Chassis, Round, goal(along, ?ROUTE))
         || Mm <- [11.25, 11.26]
        ]
    ),
    ?assertNot(Keeps(unknown, goal(along, ?ROUTE))),
    ?assert(Keeps(unknown, goal(to, {unknown, {9.0, 9.0}}))).

goal(Way, Line) -> starl_motion_goal:new(Way, Line).
