-module(starl_world_positioning_tests).
-include_lib("eunit/include/eunit.hrl").

-define(M, starl_world_positioning).

%% A frozen robot gets the last pose that it was shown, at the present time; a pose that it has never been
%% shown it does not get. Others see the truth.
frozen_test() ->
    {[{1, First, 10}], P1} = shown(2, [{1, {1.0, 2.0, 0.5}}], 10, system(#{})),
    Frost = {manual_1, 10, forever, location_frozen, 2, #{}},
    P2 = ?M:fault({began, Frost}, P1),
    Poses = [{1, {9.0, 9.0, 0.5}}, {3, {7.0, 7.0, 0.5}}],
    {Frozen, P3} = shown(2, Poses, 20, P2),
    ?assertEqual([{1, First, 20}], Frozen),
    {Free, P4} = shown(3, Poses, 20, P3),
    ?assertMatch([{1, _, 20}, {3, _, 20}], Free),
    {Thawed, _} = shown(2, Poses, 30, ?M:fault({ended, Frost}, P4)),
    ?assertMatch([{1, _, 30}, {3, _, 30}], Thawed),
    ?assertNotEqual(First, element(2, hd(Thawed))).

%% The other kinds of a scenario: nobody is seen; the positions are shifted, or those of two robots swapped.
kinds_test() ->
    Poses = [{1, {1.0, 2.0, 0.5}}, {2, {5.0, 6.0, 0.5}}],
    See = fun(Kind, Target, Params) ->
        System = ?M:fault(
            {began, {f, 0, forever, Kind, Target, Params}}, system(#{whole_mm => true})
        ),
        {Shown, _} = shown(3, Poses, 20, System),
        [{R, round(X), round(Y)} || {R, {X, Y, _}, 20} <- Shown]
    end,
    ?assertEqual([], See(location_dropout, 3, #{})),
    [{1, X, Y}, _] = See(location_bias, all, #{mm => 50}),
    ?assert(abs(math:sqrt((X - 1) * (X - 1) + (Y - 2) * (Y - 2)) - 50) < 3),
    [{1, X1, _}, {2, X2, _}] = See(location_swap, {1, 2}, #{}),
    ?assert(abs(X1 - 5) =< 1 andalso abs(X2 - 1) =< 1).

%% Whole millimetres; the heading is as it is.
rounded_test() ->
    {[{1, {X, Y, _}, 10}], _} = ?M:seen(0, [{1, {1.4, 2.6, 0.5}, 10}], system(#{whole_mm => true})),
    ?assert(is_float(X) andalso is_float(Y)),
    ?assertEqual({X, Y}, {float(round(X)), float(round(Y))}).

%% -- looks that wait for hardware -------------------------------------------------------------------

nobody_is_waited_for_without_hardware_test() ->
    ?assertEqual(taken, ?M:begun(look([1, 2]), 0, [], system(#{}))).

the_last_answer_takes_the_picture_of_the_look_test() ->
    {Words, Asked} = ?M:begun(look([1, 2, 3]), 700, [{2, self()}, {3, self()}], system(#{})),
    [{_, N}, {_, N}] = Words,
    {waits, One} = ?M:settled(3, N, Asked),
    %% twice is no other one
    {waits, Same} = ?M:settled(3, N, One),
    ?assertMatch({taken, {{1, _}, [1, 2, 3]}, 700, _}, ?M:settled(2, N, Same)),
    {taken, _, _, Done} = ?M:settled(2, N, Same),
    ?assertMatch({waits, _}, ?M:settled(2, N, Done)).

looks_do_not_mix_test() ->
    {[{_, A}], First} = ?M:begun(look([2]), 1, [{2, self()}], system(#{})),
    {[{_, B}], Both} = ?M:begun(look([2, 3]), 2, [{2, self()}], First),
    {taken, {_, [2, 3]}, 2, Left} = ?M:settled(2, B, Both),
    ?assertMatch({taken, {_, [2]}, 1, _}, ?M:settled(2, A, Left)).

looks_that_nobody_answers_are_forgotten_test() ->
    {[{_, A}], First} = ?M:begun(look([2]), 0, [{2, self()}], system(#{})),
    {_, Later} = ?M:begun(look([3]), 1000001, [{3, self()}], First),
    ?assertMatch({waits, _}, ?M:settled(2, A, Later)).

look(Ids) -> {{1, self()}, Ids}.

shown(Id, Poses, Now, System) ->
    {Seen, Drawn} = ?M:seen(0, [{R, Pose, Now} || {R, Pose} <- Poses], System),
    ?M:shown(Id, Seen, Now, Drawn).

system(Options) ->
    {ok, {_, _, #{world := World}}} = starl_sim:plan(
        #{app => starl_world_app, robots => 3, play => #{}, mode => process}, #{}
    ),
    ?M:new(World, Options).
