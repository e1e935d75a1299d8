%% A machine for tests: it traces what it found when it started, and when its timer fires it stores
%% the robots of its team and a time.
-module(starl_check_keeper).
-behaviour(starl_machine).

-export([init/1, handle_event/5]).

init(#{stored := Stored, participants := Team}) ->
    {ready, Team, [{trace, {found, Stored}}, {{timeout, keep}, 1000, keep}]}.

handle_event({timeout, keep}, keep, ready, Team, #{now := Now}) ->
    {keep_state_and_data, [{store, {hd(Team), Now}}]};
handle_event(info, {restarted, _}, ready, _, _) ->
    keep_state_and_data;
handle_event(_, _, _, _, _) ->
    unknown_event.
