%% SAP for tests, on all robots; that of one robot lies for a while about the lives of the others, in
%% each of its questions and answers, and asks whenever it hears a message.
-module(starl_leap_sap).
-behaviour(starl_machine).

-export([init/1, handle_event/5]).

%% `by': the robot that lies; `from_ms', `to_ms': when; `lives': what it says of the others.
-record(liar, {
    self :: starl:robot_id(),
    by :: starl:robot_id(),
    from_us :: integer(),
    to_us :: integer(),
    lives :: starl_packet:lives(),
    sap = none :: term()
}).

init(#{robot := Self, by := By, from_ms := From, to_ms := To, lives := Lives} = Config) ->
    {ready, Sap, Actions} = starl_sap:init(Config),
    Liar = #liar{self = Self, by = By, from_us = 1000 * From, to_us = 1000 * To, lives = Lives},
    {ready, Liar#liar{sap = Sap}, Actions}.

handle_event(Type, Content, ready, #liar{sap = Sap} = Liar, #{now := Now} = Meta) ->
    #liar{self = Self, by = By, from_us = From, to_us = To} = Liar,
    Lies = Self =:= By andalso Now >= From andalso Now < To,
    case starl_sap:handle_event(Type, Content, ready, Sap, Meta) of
        {keep_state, Next, Actions} ->
            {keep_state, Liar#liar{sap = Next}, said(Lies, Content, Actions, Liar)};
        {keep_state, Next} ->
            {keep_state, Liar#liar{sap = Next}, said(Lies, Content, [], Liar)};
        {keep_state_and_data, Actions} ->
            {keep_state_and_data, said(Lies, Content, Actions, Liar)};
        Other ->
            Other
    end.

said(false, _Content, Actions, _Liar) ->
    Actions;
said(true, Content, Actions, #liar{self = Self, lives = Lives} = Liar) ->
    [lie(Action, Liar) || Action <- Actions] ++
        [
            {transmit, From, starl_packet:ask(Self, 7, Lives)}
         || {starl, _, data, {From, _, _, _, _, _, _}} <- [Content]
        ].

lie({transmit, To, {starl, V, ask, By, Nonce, _}}, #liar{lives = Lives}) ->
    {transmit, To, {starl, V, ask, By, Nonce, Lives}};
lie({transmit, To, {starl, V, told, By, Own, Nonce, Lows, _}}, #liar{lives = Lives}) ->
    {transmit, To, {starl, V, told, By, Own, Nonce, Lows, Lives}};
lie(Action, _Liar) ->
    Action.
