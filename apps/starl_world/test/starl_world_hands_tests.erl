-module(starl_world_hands_tests).
-include_lib("eunit/include/eunit.hrl").

-define(H, starl_world_hands).

%% What is new begins, what is no longer named ends, what is still named goes on.
holds_test() ->
    {[{began, {hand_1, 1000, forever, loss, {1, 2}, #{part := 1.0}}}], One} =
        ?H:holds(loss, [{1, 2}], 1000000, ?H:new()),
    {[{began, {hand_2, 2000, forever, location_frozen, 1, _}}], Two} =
        ?H:holds(location_frozen, [1], 2000000, One),
    ?assertMatch({[], _}, ?H:holds(loss, [{1, 2}], 3000000, Two)),
    {Told, Three} = ?H:holds(loss, [{3, 4}], 4000000, Two),
    ?assertMatch(
        [
            {ended, {hand_1, 1000, 4000, loss, {1, 2}, _}},
            {began, {hand_3, 4000, forever, loss, {3, 4}, _}}
        ],
        Told
    ),
    {Healed, Four} = ?H:holds(loss, [], 5000000, Three),
    ?assertMatch([{ended, {hand_3, 4000, 5000, loss, {3, 4}, _}}], Healed),
    ?assertMatch(
        {[{ended, {hand_2, _, 6000, _, _, _}}], _}, ?H:holds(location_frozen, [], 6000000, Four)
    ).

%% A kill has no end, and is not ended by healing.
struck_test() ->
    {Told, Hands} = ?H:struck(kill_robot, 3, 7000000, ?H:new()),
    ?assertEqual([{began, {hand_1, 7000, 7000, kill_robot, 3, #{}}}], Told),
    ?assertMatch({[], _}, ?H:holds(kill_robot, [], 8000000, Hands)).
