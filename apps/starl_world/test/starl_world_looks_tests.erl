-module(starl_world_looks_tests).
-include_lib("eunit/include/eunit.hrl").

-define(L, starl_world_looks).

look(Ids) -> {{1, self()}, Ids}.

nobody_is_waited_for_without_hardware_test() ->
    ?assertEqual(taken, ?L:begun(look([1, 2]), 0, [], ?L:new())).

the_last_answer_takes_the_picture_of_the_look_test() ->
    {Words, Asked} = ?L:begun(look([1, 2, 3]), 700, [{2, self()}, {3, self()}], ?L:new()),
    [{_, N}, {_, N}] = Words,
    {waits, One} = ?L:settled(3, N, Asked),
    %% twice is no other one
    {waits, Same} = ?L:settled(3, N, One),
    ?assertMatch({taken, {{1, _}, [1, 2, 3]}, 700, _}, ?L:settled(2, N, Same)),
    {taken, _, _, Done} = ?L:settled(2, N, Same),
    ?assertMatch({waits, _}, ?L:settled(2, N, Done)).

looks_do_not_mix_test() ->
    {[{_, A}], First} = ?L:begun(look([2]), 1, [{2, self()}], ?L:new()),
    {[{_, B}], Both} = ?L:begun(look([2, 3]), 2, [{2, self()}], First),
    {taken, {_, [2, 3]}, 2, Left} = ?L:settled(2, B, Both),
    ?assertMatch({taken, {_, [2]}, 1, _}, ?L:settled(2, A, Left)).

looks_that_nobody_answers_are_forgotten_test() ->
    {[{_, A}], First} = ?L:begun(look([2]), 0, [{2, self()}], ?L:new()),
    {_, Later} = ?L:begun(look([3]), 1000001, [{3, self()}], First),
    ?assertMatch({waits, _}, ?L:settled(2, A, Later)).
