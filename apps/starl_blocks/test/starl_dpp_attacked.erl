%% A participant of path planning that finds a term in its store in its first life (`first', a function of the
%% robot), and later what it has stored; for tests ({@link starl_dpp_insider}).
-module(starl_dpp_attacked).
-behaviour(starl_machine).

-export([init/1, handle_event/5, accepts/2]).

init(#{first := First, stored := Stored, robot := Robot} = Config) ->
    Given = maps:remove(first, Config),
    starl_dpp_participant:init(Given#{stored := found(Stored, First(Robot))}).

found(none, none) -> none;
found(none, Term) -> {stored, Term};
found(Stored, _Term) -> Stored.

handle_event(Type, Content, State, Data, Meta) ->
    starl_dpp_participant:handle_event(Type, Content, State, Data, Meta).

accepts(Type, Body) -> starl_dpp_participant:accepts(Type, Body).
