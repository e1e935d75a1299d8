%% The coordinator of path planning with a planted bug, chosen by the key `bug':
%% "late_clear": it takes a Clear for the path that the robot has now, whichever it was said of;
%% "freed": when an assignment is reported lost it gives free what was reserved for it;
%% "untimely": what it says leaves whenever it does;
%% "idle": it takes no more requests than a few.
-module(starl_coordinator_planted).
-behaviour(starl_machine).

-export([init/1, handle_event/5]).

-define(REAL, starl_dpp_coordinator).
-define(FEW, 5).

init(#{bug := Bug} = Config) ->
    {State, Data, Actions} = ?REAL:init(maps:remove(bug, Config)),
    {State, {Bug, #{}, Data}, Actions}.

handle_event(
    cast,
    {message, Robot, dpp_passed, {Term, _, N}},
    State,
    {"late_clear", Sent, _} = P,
    Meta
) when is_map_key(Robot, Sent) ->
    {_, Id} = map_get(Robot, Sent),
    forward(cast, {message, Robot, dpp_passed, {Term, Id, N}}, State, P, Meta);
handle_event(
    {reply, {answered, _, Robot}} = Type,
    {error, _} = Lost,
    State,
    {"freed", Sent, _} = Planted,
    Meta
) when is_map_key(Robot, Sent) ->
    {Term, Id} = map_get(Robot, Sent),
    {To, Told, Actions} = whole(forward(Type, Lost, State, Planted, Meta), State, Planted),
    %% as if the robot had passed all of its path
    All = {message, Robot, dpp_passed, {Term, Id, 1 bsl 20}},
    {Last, Next, More} = whole(forward(cast, All, To, Told, Meta), To, Told),
    {next_state, Last, Next, Actions ++ More};
handle_event(cast, {message, _, dpp_request, _} = Asks, State, {"idle", Taken, Data}, Meta) ->
    case maps:get(requests, Taken, 0) of
        N when N < ?FEW ->
            forward(cast, Asks, State, {"idle", Taken#{requests => N + 1}, Data}, Meta);
        _ ->
            keep_state_and_data
    end;
handle_event(Type, Content, State, Planted, Meta) ->
    forward(Type, Content, State, Planted, Meta).

forward(Type, Content, State, {Bug, Sent, Data}, Meta) ->
    case ?REAL:handle_event(Type, Content, State, Data, Meta) of
        {next_state, To, Next, Actions} when Bug =:= "untimely" ->
            {next_state, To, {Bug, Sent, Next}, starl_action:without_latest(Actions)};
        {keep_state, Next, Actions} when Bug =:= "untimely" ->
            {keep_state, {Bug, Sent, Next}, starl_action:without_latest(Actions)};
        {next_state, To, Next, Actions} ->
            {next_state, To, {Bug, sent(starl_action:without_latest(Actions), Sent), Next},
                Actions};
        {keep_state, Next, Actions} ->
            {keep_state, {Bug, sent(starl_action:without_latest(Actions), Sent), Next}, Actions};
        Other ->
            Other
    end.

%% The request that each robot was last answered.
sent(Actions, Sent) ->
    lists:foldl(
        fun
            ({call, sap, {send, Robot, dpp_answer, {Term, Id, {assign, _, _}, _}}, _}, Acc) ->
                Acc#{Robot => {Term, Id}};
            (_, Acc) ->
                Acc
        end,
        Sent,
        Actions
    ).

whole({next_state, State, Data, Actions}, _, _) -> {State, Data, Actions};
whole({keep_state, Data, Actions}, State, _) -> {State, Data, Actions};
whole(_Nothing, State, Data) -> {State, Data, []}.
