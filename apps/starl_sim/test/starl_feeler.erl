%% An application that asks all its senses, and is told of one.
-module(starl_feeler).
-behaviour(starl_app).
-export([scene/1, init/2, step/2]).

%% A ball and a lamp before robot 1, at whose back is robot 2.
scene(_Context) ->
    {ok, #{
        app => {sequential, ?MODULE, none},
        floor => starl_floor:empty({4000, 3000}),
        poses => #{1 => {1000.0, 1000.0, 0.0}, 2 => {500.0, 1000.0, 0.0}},
        things => [#{at => {2000, 1100}, colour => orange, lamp_mm => 1000}]
    }}.

init(Robot, none) ->
    ok = starl:watch(Robot, camera, 100),
    [].

step(Robot, Felt) when length(Felt) < 20 ->
    _ = starl:await(Robot, sense, 500),
    Kinds = [Kind || {Kind, _} <- starl_sense:kinds()],
    {continue, [[{Kind, starl:sense(Robot, Kind)} || Kind <- Kinds] | Felt]};
step(Robot, Felt) ->
    Told =
        case starl:await(Robot, sense, 1000) of
            {ok, From, {camera, [#{colour := Colour}]}} -> {From, Colour};
            timeout -> timeout
        end,
    {done, {Told, lists:reverse(Felt)}}.
