%% Broken elections, one per pitfall, around the sound machines. The key `bug' says which:
%% early: the bully makes itself leader before the higher robots can have answered;
%% fickle: the bully takes each leader that is announced, also after it has reported one;
%% incomplete: the ballots are counted when but one is missing.
-module(starl_election_bug).
-behaviour(starl_machine).

-export([init/1, handle_event/5]).

init(#{bug := incomplete, participants := Team} = Config) ->
    %% everybody leaves out the next one of the ring
    Missing = starl_team:next(maps:get(robot, Config), Team),
    Fewer = starl_team:others(Missing, Team),
    begin_as(starl_election_ballots, incomplete, Config#{participants := Fewer});
init(#{bug := early} = Config) ->
    begin_as(starl_election_bully, early, Config#{answer_ms => 1});
init(#{bug := fickle} = Config) ->
    begin_as(starl_election_bully, fickle, Config).

begin_as(Module, Bug, Config) ->
    {ready, Data, Actions} = Module:init(Config),
    {ready, {Module, Bug, Config, Data}, Actions}.

handle_event(cast, {message, _, bully_leader, {E, L}} = Message, ready, {M, fickle, C, D}, Meta) ->
    case M:handle_event(cast, Message, ready, D, Meta) of
        {keep_state, Next, []} ->
            {keep_state, {M, fickle, C, Next}, [{trace, {elected, E, L, announcement}}]};
        {keep_state, Next, Actions} ->
            {keep_state, {M, fickle, C, Next}, Actions}
    end;
handle_event(Type, Content, ready, {Module, Bug, Config, Data}, Meta) ->
    case Module:handle_event(Type, Content, ready, Data, Meta) of
        {keep_state, Next, Actions} -> {keep_state, {Module, Bug, Config, Next}, Actions};
        {keep_state, Next} -> {keep_state, {Module, Bug, Config, Next}};
        Other -> Other
    end.
