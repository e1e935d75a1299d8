%% A machine for tests that keeps terms: `{keep, Term}' stores it and then answers, traces and
%% starts a timer; `stored' is what it found when it started and what it has kept since.
-module(starl_sim_store_machine).
-behaviour(starl_machine).

-export([init/1, handle_event/5]).

init(#{stored := Stored}) -> {ready, Stored, []}.

handle_event({call, From}, {keep, Term}, ready, _, _) ->
    {keep_state, {stored, Term}, [
        {trace, {keeps, Term}},
        {store, Term},
        {trace, {kept, Term}},
        {{timeout, t}, 1000, Term},
        {reply, From, ok}
    ]};
handle_event({call, From}, stored, ready, Stored, _) ->
    {keep_state_and_data, [{reply, From, Stored}]};
handle_event({call, _}, ignore, ready, _, _) ->
    keep_state_and_data;
handle_event({timeout, t}, Term, ready, _, _) ->
    {keep_state_and_data, [{trace, {fired, Term}}]};
handle_event(info, {restarted, _}, ready, _, _) ->
    keep_state_and_data;
handle_event(_, _, _, _, _) ->
    unknown_event.
