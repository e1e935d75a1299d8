%% A SAP for tests that reports a lost message much later than its configuration allows.
-module(starl_sim_dawdling_sap).
-behaviour(starl_machine).

-export([init/1, handle_event/5]).

init(#{limit := Limit} = Config) -> starl_sap:init(Config#{limit := 4 * Limit}).

handle_event(Type, Content, State, Data, Meta) ->
    starl_sap:handle_event(Type, Content, State, Data, Meta).
