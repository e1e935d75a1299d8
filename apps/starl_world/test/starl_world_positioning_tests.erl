-module(starl_world_positioning_tests).
-include_lib("eunit/include/eunit.hrl").

-define(M, starl_world_positioning).

%% A frozen robot gets the last pose that it was shown, at the present time; a pose that it has never been
%% shown it does not get. Others see the truth.
frozen_test() ->
    {[{1, First, 10}], P1} = shown(2, [{1, {1.0, 2.0, 0.5}}], 10, system(#{})),
    Frost = {hand_1, 10, forever, location_frozen, 2, #{}},
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

shown(Id, Poses, Now, System) ->
    {Seen, Drawn} = ?M:seen(0, [{R, Pose, Now} || {R, Pose} <- Poses], System),
    ?M:shown(Id, Seen, Now, Drawn).

system(Options) ->
    {ok, {_, _, #{world := World}}} = starl_sim:plan(
        #{app => starl_world_app, robots => 3, play => #{}, mode => process}, #{}
    ),
    ?M:new(World, Options).
