%% What my_relay promises its callers: who greets has said hello.
-module(my_relay_history).
-behaviour(starl_history_model).

-export([machine/0, contract/0, objects/2, judge/3]).

machine() -> my_relay.

contract() -> my_relay_monitor.

%% Each greeting is judged with all others.
objects([], _Config) -> [];
objects(Calls, _Config) -> [{greetings, Calls}].

judge(Calls, _Config, _Judge) ->
    case [Said || #{answer := {ok, Said}} <- Calls, Said =/= hello] of
        [] -> {explained, "all said hello"};
        [_ | _] -> {unexplained, "hello"}
    end.
