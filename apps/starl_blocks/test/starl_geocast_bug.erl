%% Broken geocasts, one per pitfall, around the sound machine. The key `bug' says which:
%% clocks: packets carry the sender's clock's time of expiry, compared with the receiver's clock;
%% holds: the time that a message lies with a relay is not deducted;
%% trusts: what is left counts from the arrival of the answer, not from the question;
%% forgets: a message is forgotten, and that it was delivered, while copies of it still travel;
%% restart: a restarted machine takes itself for a new one.
-module(starl_geocast_bug).
-behaviour(starl_machine).

-export([init/1, handle_event/5]).

init(#{bug := restart} = Config) -> begin_as(restart, Config#{incarnation := 1});
init(#{bug := Bug} = Config) -> begin_as(Bug, Config).

begin_as(Bug, Config) ->
    {ready, Data, Actions} = starl_geocast_flood:init(Config),
    {ready, {Bug, Data}, Actions}.

handle_event(
    cast,
    {message, From, geocast, {give, Parcel, Askers}},
    ready,
    {clocks, _} = Bug,
    #{now := Now} = Meta
) ->
    Left = element(6, Parcel) - Now,
    forward(cast, {message, From, geocast, {give, setelement(6, Parcel, Left), Askers}}, Bug, Meta);
handle_event(
    cast,
    {message, From, geocast, {give, Parcel, Askers}},
    ready,
    {trusts, _} = Bug,
    #{now := Now} = Meta
) ->
    Arrived = [{Robot, {Life, Now}} || {Robot, {Life, _Asked}} <- Askers],
    forward(cast, {message, From, geocast, {give, Parcel, Arrived}}, Bug, Meta);
handle_event({timeout, {over, Id}}, Content, ready, {forgets, _} = Bug, Meta) ->
    {keep_state, {forgets, Data}, Actions} = forward({timeout, {over, Id}}, Content, Bug, Meta),
    {keep_state, {forgets, emptied(Data)}, Actions ++ [{{timeout, {forget, Id}}, 0, forget}]};
handle_event(Type, Content, ready, Bug, Meta) ->
    forward(Type, Content, Bug, Meta).

forward(Type, Content, {Bug, Data}, Meta) ->
    case starl_geocast_flood:handle_event(Type, Content, ready, Data, Meta) of
        {keep_state, Next, Actions} -> {keep_state, {Bug, Next}, twist(Bug, Actions, Meta)};
        {keep_state, Next} -> {keep_state, {Bug, Next}};
        {keep_state_and_data, Actions} -> {keep_state_and_data, twist(Bug, Actions, Meta)};
        Other -> Other
    end.

%% The machine's data with empty memories of what was delivered, wherever they are in it.
emptied(Data) when is_tuple(Data), element(1, Data) =:= memory ->
    starl_geocast_memory:new(1);
emptied(Data) when is_tuple(Data) ->
    list_to_tuple([emptied(Part) || Part <- tuple_to_list(Data)]);
emptied(Data) ->
    Data.

twist(Bug, Actions, Meta) -> [twisted(Bug, Action, Meta) || Action <- Actions].

twisted(clocks, {cast, sap, {shout, Type, {give, Parcel, Askers}}}, #{now := Now}) ->
    {cast, sap, {shout, Type, {give, setelement(6, Parcel, element(6, Parcel) + Now), Askers}}};
twisted(holds, {cast, sap, {shout, Type, {give, Parcel, Askers}}}, _Meta) ->
    {cast, sap, {shout, Type, {give, setelement(6, Parcel, element(5, Parcel)), Askers}}};
twisted(_Bug, Action, _Meta) ->
    Action.
