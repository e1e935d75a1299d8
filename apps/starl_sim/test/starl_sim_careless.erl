%% A machine for tests that does as it is told: `{act, Actions}' are its actions, `{return, Result}'
%% is its result.
-module(starl_sim_careless).
-behaviour(starl_machine).

-export([init/1, handle_event/5]).

init(Config) -> {ready, none, maps:get(actions, Config, [])}.

handle_event(cast, {act, Actions}, ready, _, _) -> {keep_state_and_data, Actions};
handle_event(cast, {return, Result}, ready, _, _) -> Result;
handle_event(info, {restarted, _}, ready, _, _) -> keep_state_and_data;
handle_event(_, _, _, _, _) -> unknown_event.
