%% SAP with a planted bug, chosen by the key `variant' of the configuration.
-module(starl_check_sap_planted).
-behaviour(starl_machine).

-export([init/1, handle_event/5]).

%% same_incarnation: a restarted SAP takes itself for the old one.
init(#{variant := same_incarnation} = Config) ->
    {State, Sap, Actions} = starl_sap:init(Config#{incarnation => 1}),
    {State, {same_incarnation, Sap}, Actions};
init(#{variant := Variant} = Config) ->
    {State, Sap, Actions} = starl_sap:init(Config),
    {State, {Variant, Sap}, Actions}.

%% careless: forgets what it has taken (the field `peers' of #sap{}) whenever it is to send.
handle_event({call, _} = Type, Request, State, {careless, Sap}, Meta) ->
    forward(Type, Request, State, {careless, setelement(7, Sap, starl_sap_peers:new())}, Meta);
handle_event(Type, Content, State, Data, Meta) ->
    forward(Type, Content, State, Data, Meta).

forward(Type, Content, State, {Variant, Sap}, Meta) ->
    case starl_sap:handle_event(Type, Content, State, Sap, Meta) of
        {keep_state, Next, Actions} -> {keep_state, {Variant, Next}, Actions};
        {keep_state, Next} -> {keep_state, {Variant, Next}};
        Other -> Other
    end.
