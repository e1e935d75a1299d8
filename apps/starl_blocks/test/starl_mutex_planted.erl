%% Mutual exclusion with a planted bug, chosen by the key `variant' of the configuration.
-module(starl_mutex_planted).
-behaviour(starl_machine).

-export([init/1, handle_event/5]).

-define(REAL, starl_mutex_tokens).
-define(HOUR_US, 3600000000).

%% impatient_home: the home does not wait until a lease is surely over.
init(#{variant := impatient_home} = Config) ->
    start(Config#{drift_ppm => -900000});
%% forgetful_home: after a crash the home grants at once, with the numbers of the beginning.
init(#{variant := forgetful_home} = Config) ->
    start(Config#{incarnation => 1});
%% circles: see below.
init(#{variant := circles} = Config) ->
    {ready, Data, Actions} = ?REAL:init(Config),
    {ready, {circles, #{}, Data}, Actions};
%% trusting: see below.
init(#{variant := trusting, incarnation := Incarnation, participants := Team} = Config) ->
    {ready, Data, Actions} = ?REAL:init(Config),
    {ready, {trusting, {Incarnation, starl_team:members(Team)}, Data}, Actions};
init(Config) ->
    start(Config).

start(#{variant := Variant, incarnation := Incarnation} = Config) ->
    {ready, Data, Actions} = ?REAL:init(Config),
    {ready, {Variant, Incarnation, Data}, Actions}.

%% trusting: whoever gets a token holds it, without the home's word.
handle_event(cast, {message, _, mutex, {token, T, F, _}} = M, ready, {trusting, Of, Data}, Meta) ->
    #{now := Now} = Meta,
    {Incarnation, Team} = Of,
    {First, Actions} = run(cast, M, Data, Meta),
    Grant = {message, starl_mutex:home(T, Team), mutex, {granted, T, F, {Incarnation, Now}}},
    {Next, More} = run(cast, Grant, First, Meta),
    {keep_state, {trusting, Of, Next}, Actions ++ More};
handle_event(cast, {message, _, mutex, {refused, _, _, _}}, ready, {trusting, _, _}, _Meta) ->
    keep_state_and_data;
%% overstaying: the holder does not heed the end of its lease: it takes it for one of an hour.
handle_event(
    cast,
    {message, From, mutex, {granted, T, F, {Life, Sent}}},
    ready,
    {overstaying, I, Data},
    Meta
) ->
    Endless = {message, From, mutex, {granted, T, F, {Life, Sent + ?HOUR_US}}},
    {Next, Actions} = run(cast, Endless, Data, Meta),
    {keep_state, {overstaying, I, Next}, Actions};
%% queueless: what a token brings along of its queue is lost, but for the robot's own request.
handle_event(
    cast,
    {message, From, mutex, {token, T, F, [First | _]}},
    ready,
    {queueless, I, Data},
    Meta
) ->
    {Next, Actions} = run(cast, {message, From, mutex, {token, T, F, [First]}}, Data, Meta),
    {keep_state, {queueless, I, Next}, Actions};
%% untimely: what is said of a hold leaves whenever it does.
handle_event(Type, Content, ready, {untimely, I, Data}, Meta) ->
    {Next, Actions} = run(Type, Content, Data, Meta),
    {keep_state, {untimely, I, Next}, starl_action:without_latest(Actions)};
%% unreleased: the tokens of an application that has crashed are kept.
handle_event(info, {restarted, app}, ready, {unreleased, _, _}, _Meta) ->
    keep_state_and_data;
%% misnames: an owner announces another token than the one that it has.
handle_event(Type, Content, ready, {misnames, I, Data}, Meta) ->
    {Next, Actions} = run(Type, Content, Data, Meta),
    {keep_state, {misnames, I, Next}, [misnamed(Action) || Action <- Actions]};
%% unheeding: what others announce is not taken.
handle_event(cast, {message, _, mutex, {owner, _, _}}, ready, {unheeding, _, _}, _Meta) ->
    keep_state_and_data;
%% circles: a request is sent after the other robot that was last heard to own the token, however
%% old that is, and to the home only if there is none.
handle_event(Type, Content, ready, {circles, Owners, Data}, Meta) ->
    Heard = heard(Type, Content, Owners),
    {Next, Actions} = run(Type, Content, Data, Meta),
    {keep_state, {circles, Heard, Next}, [chase(Action, Heard) || Action <- Actions]};
handle_event(Type, Content, ready, {Variant, I, Data}, Meta) ->
    {Next, Actions} = run(Type, Content, Data, Meta),
    {keep_state, {Variant, I, Next}, Actions}.

run(Type, Content, Data, Meta) ->
    case ?REAL:handle_event(Type, Content, ready, Data, Meta) of
        {keep_state, Next, Actions} -> {Next, Actions};
        unknown_event -> {Data, [{trace, {unknown_event, Type, Content}}]}
    end.

misnamed({cast, sap, {broadcast, mutex, {owner, Token, Fence}}}) ->
    {cast, sap, {broadcast, mutex, {owner, {another, Token}, Fence}}};
misnamed(Action) ->
    Action.

heard(cast, {message, From, mutex, {owner, Token, _}}, Owners) -> Owners#{Token => From};
heard(_Type, _Content, Owners) -> Owners.

chase({cast, sap, {send, _, mutex, {request, Token, Request, _, _}}} = Action, Owners) ->
    case Owners of
        #{Token := Owner} -> starl_sap:post(Owner, mutex, {request, Token, Request, 0, none});
        #{} -> Action
    end;
chase(Action, _Owners) ->
    Action.
