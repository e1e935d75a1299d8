%% Broken registers around the sound machine. The key `bug' says which:
%% restart: a restarted machine takes itself for a new one, its clock goes back;
%% last_heard: what comes last by the network wins, whatever its stamp: copies differ;
%% no_exchange: no digests are exchanged: what a broadcast missed stays missed.
-module(starl_registers_bug).
-behaviour(starl_machine).

-export([init/1, handle_event/5]).

init(#{bug := restart} = Config) ->
    begin_as(restart, Config#{incarnation := 1, now := 0, stored => none});
init(#{bug := Bug} = Config) ->
    begin_as(Bug, Config).

begin_as(Bug, Config) ->
    {State, Data, Actions} = starl_registers_lww:init(Config),
    {State, {Bug, Data}, Actions}.

handle_event({timeout, sync}, _, _State, {no_exchange, _}, _Meta) ->
    keep_state_and_data;
handle_event(
    cast,
    {message, From, registers, {write, Name, Value, Stamp}},
    State,
    {last_heard, Data},
    Meta
) ->
    %% the entry that is there is forgotten first
    Empty = setelement(9, Data, maps:remove(Name, element(9, Data))),
    Message = {message, From, registers, {write, Name, Value, Stamp}},
    forward(cast, Message, State, {last_heard, Empty}, Meta);
handle_event(Type, Content, State, Bug, Meta) ->
    forward(Type, Content, State, Bug, Meta).

forward(Type, Content, State, {Bug, Data}, Meta) ->
    case starl_registers_lww:handle_event(Type, Content, State, Data, Meta) of
        {next_state, To, Next, Actions} -> {next_state, To, {Bug, Next}, Actions};
        {keep_state, Next, Actions} -> {keep_state, {Bug, Next}, Actions};
        {keep_state, Next} -> {keep_state, {Bug, Next}};
        Other -> Other
    end.
