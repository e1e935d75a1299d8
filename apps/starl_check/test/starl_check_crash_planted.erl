%% A barrier that crashes by itself: when it is called, in the way that `how' says, or as it starts.
%% `renamed': it goes on, and traces what no barrier does.
-module(starl_check_crash_planted).
-behaviour(starl_machine).

-export([init/1, handle_event/5]).

init(#{how := start}) -> error(oops);
init(#{how := How}) -> {ready, How, []}.

handle_event({call, _}, _, ready, error, _) -> error(oops);
handle_event({call, _}, _, ready, exit, _) -> exit(oops);
handle_event({call, _}, _, ready, throw, _) -> throw(oops);
handle_event({call, _}, _, ready, renamed, _) -> {keep_state_and_data, [{trace, {came, gate, 1}}]};
handle_event(_, _, _, _, _) -> unknown_event.
