%% An actuator with a bug: it answers as soon as it has told its device what to do, without a word
%% of the device, and never tells it again.
-module(starl_actuator_planted).
-behaviour(starl_machine).

-export([init/1, handle_event/5]).

init(Config) -> starl_actuator:init(Config).

handle_event({call, From}, {set, _, _} = Set, State, Data, Meta) ->
    {keep_state, Told, Actions} = starl_actuator:handle_event({call, From}, Set, State, Data, Meta),
    {keep_state, Told, [{reply, From, ok} | [A || {actuate, _, _, _} = A <- Actions]]};
handle_event(info, {actuated, _, _, _}, _State, _Data, _Meta) ->
    keep_state_and_data;
handle_event(Type, Content, State, Data, Meta) ->
    starl_actuator:handle_event(Type, Content, State, Data, Meta).
