%% Robots that elect once, and say whom.
-module(starl_hands_app).
-behaviour(starl_app).

-export([blocks/0, init/2, step/2]).

blocks() -> [starl_election].

init(_Robot, _Options) -> elect.

step(Robot, elect) ->
    case starl_election:elect(Robot, first) of
        {ok, Leader} -> {done, Leader};
        {error, _} -> {continue, elect}
    end.
