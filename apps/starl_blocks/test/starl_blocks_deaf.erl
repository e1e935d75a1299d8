%% A machine of a block, the key `real' of its configuration, that hears nothing of the others.
-module(starl_blocks_deaf).
-behaviour(starl_machine).

-export([init/1, handle_event/5]).

init(#{real := Real} = Config) ->
    {ready, Data, Actions} = Real:init(Config),
    {ready, {Real, Data}, Actions}.

handle_event(cast, {message, _, _, _}, ready, _, _Meta) ->
    keep_state_and_data;
handle_event(Type, Content, ready, {Real, Data}, Meta) ->
    case Real:handle_event(Type, Content, ready, Data, Meta) of
        {keep_state, Next, Actions} -> {keep_state, {Real, Next}, Actions};
        {keep_state, Next} -> {keep_state, {Real, Next}};
        Kept -> Kept
    end.
