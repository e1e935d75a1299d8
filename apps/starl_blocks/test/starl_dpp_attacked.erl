%% A participant of path planning whose store holds a term that nobody can have come to, as an earlier version
%% stored it; for tests ({@link starl_dpp_insider}). In its first life it finds it, later what it has stored.
-module(starl_dpp_attacked).
-behaviour(starl_machine).

-export([init/1, handle_event/5, accepts/2]).

init(#{stored := none} = Config) ->
    Term = {starl_dpp_insider:most(), 1, 1 bsl 57},
    starl_dpp_participant:init(Config#{stored := {stored, Term}});
init(Config) ->
    starl_dpp_participant:init(Config).

handle_event(Type, Content, State, Data, Meta) ->
    starl_dpp_participant:handle_event(Type, Content, State, Data, Meta).

accepts(Type, Body) -> starl_dpp_participant:accepts(Type, Body).
