%% Counters with a bug, to show that the monitor finds it. `adds': what is heard is added to what is
%% known. `replaces': what is heard takes the place of what is known. `zero': it never shows a count.
%% `reborn': a later life counts as the first one, and has forgotten what that counted.
-module(starl_counter_bug).
-behaviour(starl_machine).

-export([init/1, handle_event/5]).

init(#{bug := reborn} = Config) ->
    begun(reborn, Config#{incarnation := 1, stored := none});
init(#{bug := Bug} = Config) ->
    begun(Bug, Config).

begun(Bug, Config) ->
    {State, Data, Actions} = starl_counter_gossip:init(maps:remove(bug, Config)),
    {State, {Bug, Data}, Actions}.

handle_event(Type, Content, State, {Bug, Data}, Meta) ->
    Heard = heard(Bug, Type, Content, Meta),
    Known = known(Bug, Type, Data),
    wrapped(Bug, starl_counter_gossip:handle_event(Type, Heard, State, Known, Meta)).

%% The third element of its record are its tallies.
known(replaces, cast, Data) -> setelement(3, Data, #{});
known(_Bug, _Type, Data) -> Data.

%% Counts that are added look like those of a life that nobody has.
heard(adds, cast, {message, From, counter, {tallies, [{Robot, H, Sum, Lives} | Rest]}}, #{
    now := Now
}) ->
    Added = [{Life + abs(Now), N} || {Life, N} <- Lives],
    {message, From, counter, {tallies, [{Robot, H, Sum, Added} | Rest]}};
heard(_Bug, _Type, Content, _Meta) ->
    Content.

wrapped(Bug, {keep_state, Data}) -> {keep_state, {Bug, Data}};
wrapped(Bug, {keep_state, Data, Actions}) -> {keep_state, {Bug, Data}, shown(Bug, Actions)};
wrapped(Bug, {keep_state_and_data, Actions}) -> {keep_state_and_data, shown(Bug, Actions)};
wrapped(_Bug, Other) -> Other.

shown(zero, Actions) -> [zero(Action) || Action <- Actions];
shown(_Bug, Actions) -> Actions.

zero({trace, {What, _Value}}) -> {trace, {What, 0}};
zero({reply, From, _Value}) -> {reply, From, 0};
zero(Action) -> Action.
