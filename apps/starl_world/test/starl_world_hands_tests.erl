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

%% Faults of one kind with other parameters hold beside each other.
faults_with_parameters_test() ->
    Camera = #{sense => camera},
    {[_], One} = ?H:holds(sense_gone, Camera, [1], 1000000, ?H:new()),
    {[{began, {_, _, _, sense_gone, 1, #{sense := bump}}}], Two} =
        ?H:holds(sense_gone, #{sense => bump}, [1], 2000000, One),
    {Told, _} = ?H:holds(sense_gone, Camera, [], 3000000, Two),
    ?assertMatch([{ended, {hand_1, 1000, 3000, sense_gone, 1, #{sense := camera}}}], Told).

%% The kinds and parameters of faults of live senses are those of a scenario.
faults_of_senses_are_those_of_scenarios_test() ->
    [
        begin
            Kind = starl_live_sense_fault:kind(Fault),
            {_, sense, robots, Params, _} = lists:keyfind(Kind, 1, starl_sim_fault:kinds()),
            ?assertEqual(
                lists:sort([element(1, P) || P <- Params]),
                lists:sort(maps:keys(starl_live_sense_fault:params(camera, Fault)))
            )
        end
     || {_, Fault} <- starl_live_sense_fault:known()
    ].
