%% Mutual exclusion with a planted bug, chosen by the key `variant' of the configuration.
-module(starl_mutex_planted).
-behaviour(starl_machine).

-export([init/1, handle_event/5]).

-define(REAL, starl_mutex_tokens).

%% impatient_home: the home does not wait until a lease is surely over.
init(#{variant := impatient_home} = Config) -> start(Config#{drift_ppm => -900000});
%% forgetful_home: after a crash the home grants at once, with the numbers of the beginning.
init(#{variant := forgetful_home} = Config) -> start(Config#{incarnation => 1});
init(Config) -> start(Config).

start(#{variant := Variant, incarnation := Incarnation} = Config) ->
    {ready, Data, Actions} = ?REAL:init(Config),
    {ready, {Variant, Incarnation, Data}, Actions}.

%% trusting: whoever gets a token holds it, without the home's word.
handle_event(cast, {message, _, mutex, {token, T, F, _}} = M, ready, {trusting, I, Data}, Meta) ->
    #{now := Now, robot := Robot} = Meta,
    {First, Actions} = run(cast, M, Data, Meta),
    Grant = {message, Robot, mutex, {granted, T, F, {I, Now}}},
    {Next, More} = run(cast, Grant, First, Meta),
    {keep_state, {trusting, I, Next}, Actions ++ More};
handle_event(cast, {message, _, mutex, {refused, _, _, _}}, ready, {trusting, _, _}, _Meta) ->
    keep_state_and_data;
%% overstaying: the holder does not heed the end of its lease.
handle_event({timeout, {lease, _}}, _, ready, {overstaying, _, _}, _Meta) ->
    keep_state_and_data;
handle_event(Type, Content, ready, {Variant, I, Data}, Meta) ->
    {Next, Actions} = run(Type, Content, Data, Meta),
    {keep_state, {Variant, I, Next}, Actions}.

run(Type, Content, Data, Meta) ->
    case ?REAL:handle_event(Type, Content, ready, Data, Meta) of
        {keep_state, Next, Actions} -> {Next, Actions};
        unknown_event -> {Data, [{trace, {unknown_event, Type, Content}}]}
    end.
