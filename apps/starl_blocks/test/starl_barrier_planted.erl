%% The barrier with a planted bug, chosen by the key `variant' of the configuration.
-module(starl_barrier_planted).
-behaviour(starl_machine).

-export([init/1, handle_event/5]).

-define(REAL, starl_barrier_rounds).

%% forgetful: after a crash it begins again with round 1 and asks nobody.
init(#{variant := forgetful} = Config) ->
    start(Config#{incarnation => 1, stored => none});
%% careless: what is damaged it takes for what was never stored, by a robot that has never run.
init(#{variant := careless, stored := damaged} = Config) ->
    start(Config#{stored => none, life => {0, 1}});
init(Config) ->
    start(Config).

start(#{variant := Variant} = Config) ->
    {ready, Data, Actions} = ?REAL:init(Config),
    {ready, {Variant, #{}, Data}, Actions}.

%% recreated: what comes a second time opens the entry of the next round.
handle_event(
    cast,
    {message, From, barrier, {reached, Name, K, Known, Answer}},
    ready,
    {recreated, Seen, Data},
    Meta
) ->
    Key = {From, Name},
    Count =
        case Seen of
            #{Key := K} -> K + 1;
            #{} -> K
        end,
    Message = {message, From, barrier, {reached, Name, Count, Known, Answer}},
    pass(recreated, Seen#{Key => K}, ?REAL:handle_event(cast, Message, ready, Data, Meta), Data);
%% alone: does not wait for those that it has not heard of when it first asks.
handle_event({timeout, {again, Name}} = T, C, ready, {alone, Seen, Data}, #{robot := Me} = Meta) ->
    Forged = lists:foldl(
        fun(Robot, D) ->
            M = {message, Robot, barrier, {reached, Name, 1 bsl 20, 0, false}},
            next(?REAL:handle_event(cast, M, ready, D, Meta), D)
        end,
        Data,
        lists:delete(Me, [1, 2, 3, 4])
    ),
    pass(alone, Seen, ?REAL:handle_event(T, C, ready, Forged, Meta), Forged);
%% doubting: takes nobody's acknowledgement for a sign that its announcement is known, and asks after a while.
handle_event({reply, {announced, _, _}}, _Outcome, ready, {doubting, _, _}, _Meta) ->
    keep_state_and_data;
%% hasty: stores what it has reached, and not that it has passed it.
handle_event(Type, Content, ready, {hasty, Seen, Data}, Meta) ->
    pass(hasty, Seen, hastened(?REAL:handle_event(Type, Content, ready, Data, Meta)), Data);
handle_event(Type, Content, ready, {Variant, Seen, Data}, Meta) ->
    pass(Variant, Seen, ?REAL:handle_event(Type, Content, ready, Data, Meta), Data).

hastened({keep_state, Next, Actions}) -> {keep_state, Next, hastened_actions(Actions)};
hastened(Result) -> Result.

hastened_actions([{store, _}, {trace, {passed, _, _}} = Passed | Actions]) -> [Passed | Actions];
hastened_actions([Action | Actions]) -> [Action | hastened_actions(Actions)];
hastened_actions([]) -> [].

pass(Variant, Seen, {keep_state, Next, Actions}, _) ->
    {keep_state, {Variant, Seen, Next}, Actions};
pass(Variant, Seen, {keep_state, Next}, _) ->
    {keep_state, {Variant, Seen, Next}, []};
pass(Variant, Seen, {keep_state_and_data, Actions}, D) ->
    {keep_state, {Variant, Seen, D}, Actions};
pass(Variant, Seen, keep_state_and_data, Data) ->
    {keep_state, {Variant, Seen, Data}, []};
pass(_, _, unknown_event, _) ->
    unknown_event.

next({keep_state, Next, _}, _) -> Next;
next(_, Data) -> Data.
