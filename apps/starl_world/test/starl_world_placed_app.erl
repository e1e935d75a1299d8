%% An application of these tests whose robots stand where the test wants them: each drives half a metre, and tells the
%% test that it has arrived.
-module(starl_world_placed_app).
-behaviour(starl_app).
-behaviour(starl_scene).

-export([options/0, scene/1, init/2, step/2]).

options() ->
    [
        {test, {optional, {term, "a process", fun is_pid/1}}, none, "the test"},
        {places, {term, "a map", fun is_map/1}, #{}, "where each robot stands"},
        {apart, {integer, 0, 10000}, 0, "how far apart they have to stand, mm"}
    ].

scene(#{options := #{test := Test, places := Places, apart := Apart}}) ->
    {ok, #{
        app => {sequential, ?MODULE, Test},
        poses => maps:map(fun(_, {X, Y}) -> {X, Y, 0.0} end, Places),
        apart_mm => Apart
    }}.

init(_Robot, Test) -> Test.

step(Robot, Test) ->
    case starl:position(Robot) of
        {ok, {X, Y, _}} ->
            ok = starl:go_to(Robot, {X + 500, Y}),
            Test ! {arrived, starl:id(Robot)},
            {done, arrived};
        {error, _} ->
            {continue, Test}
    end.
