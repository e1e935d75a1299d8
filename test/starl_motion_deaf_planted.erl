%% Motion that waits for ever for the answer to a command: it takes no time-out of one to heart.
-module(starl_motion_deaf_planted).
-behaviour(starl_machine).

-export([init/1, handle_event/5]).

init(Config) -> starl_motion:init(Config).

handle_event(state_timeout, heard_nothing, _State, _Drive, _Meta) ->
    keep_state_and_data;
handle_event(Type, Content, State, Drive, Meta) ->
    starl_motion:handle_event(Type, Content, State, Drive, Meta).
