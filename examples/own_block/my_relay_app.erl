%% An application of a user's own, with a building block of its own beside it.
-module(my_relay_app).
-behaviour(starl_app).

-export([blocks/0, init/2, step/2]).

blocks() -> [{my_relay, #{greeting => hello}}].

init(_Robot, _Options) -> 1.

step(Robot, N) when N =< 3 ->
    {ok, _Others} = my_relay:greet(Robot),
    ok = starl:sleep(Robot, 100),
    {continue, N + 1};
step(_Robot, _N) ->
    {done, greeted}.
