-module(starl_world_positioning_tests).
-include_lib("eunit/include/eunit.hrl").

-define(M, starl_world_positioning).

%% A frozen robot gets the last pose that it was shown, at the present time; a pose that it has never been
%% shown it does not get. Others see the truth.
frozen_test() ->
    {[{1, First, 10}], P1} = shown(2, [{1, {1.0, 2.0, 0.5}}], 10, system(#{})),
    P2 = ?M:freeze([2], P1),
    Poses = [{1, {9.0, 9.0, 0.5}}, {3, {7.0, 7.0, 0.5}}],
    {Frozen, P3} = shown(2, Poses, 20, P2),
    ?assertEqual([{1, First, 20}], Frozen),
    {Free, P4} = shown(3, Poses, 20, P3),
    ?assertMatch([{1, _, 20}, {3, _, 20}], Free),
    {Thawed, _} = shown(2, Poses, 30, ?M:freeze([], P4)),
    ?assertMatch([{1, _, 30}, {3, _, 30}], Thawed),
    ?assertNotEqual(First, element(2, hd(Thawed))).

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
