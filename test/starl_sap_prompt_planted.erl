%% The contract of SAP once more, beside the one of every run, for runs in which no packet is lost:
%% there the acknowledgement of each message arrives within two delays of a packet, and the outcome
%% is due with it. A monitor goes by its module's name, so that this one needs its own.
-module(starl_sap_prompt_planted).
-behaviour(starl_monitor).

-export([init/1, step/2, finish/2, interests/0]).

init(#{bound_us := Bound}) -> starl_sap_monitor:init(#{bound_us => Bound}).

interests() -> starl_sap_monitor:interests().

step(Event, State) -> starl_sap_monitor:step(Event, State).

finish(EndUs, State) -> starl_sap_monitor:finish(EndUs, State).
