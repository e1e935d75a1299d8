%% @doc Monitors path planning's votes, leases and terms in the exhaustive checker. It extends
%% {@link starl_dpp_monitor}, which cannot see two kinds of violation. First, a coordinator acts
%% after another has been elected, even though the new one assigns nothing yet. Second, a term is
%% won twice or after a later term. The event `{acts, Term}' comes from
%% {@link starl_dpp_model_service}.
-module(starl_dpp_model_monitor).
-behaviour(starl_monitor).

-export([init/1, step/2, finish/2, interests/0, vocabulary/0, timeless/1]).

-record(state, {
    plan :: starl_monitor:state(),
    %% the latest term that was won
    led = {0, 0, 0} :: starl_dpp:term_id()
}).

-spec init(map()) -> #state{}.
init(Config) -> #state{plan = starl_dpp_monitor:init(Config)}.

-spec interests() -> [atom()].
interests() -> starl_dpp_monitor:interests().

%% @doc The events of path planning, and `acts'.
-spec vocabulary() -> starl_event:vocabulary().
vocabulary() ->
    Planning = starl_dpp_monitor:vocabulary(),
    #{dpp_coordinator := Own} = Planning,
    Planning#{dpp_coordinator := [{acts, 1} | Own]}.

-spec timeless(#state{}) -> term().
timeless(#state{plan = Plan, led = Led}) -> {starl_dpp_monitor:timeless(Plan), Led}.

-spec step(starl_monitor:trace_event(), #state{}) ->
    {ok, #state{}} | {violation, starl_monitor:violation(), #state{}}.
step({T, Robot, dpp_coordinator, {acts, Term}}, #state{led = Led} = State) when Term < Led ->
    {violation, violation(two_coordinators, T, Robot, Led), State};
step({_, _, dpp_coordinator, {acts, _}}, State) ->
    {ok, State};
step({T, Robot, dpp_coordinator, {leads, Term}}, #state{led = Led} = State) when Term =< Led ->
    {violation, violation(term_goes_back, T, Robot, Led), State};
step({_, _, dpp_coordinator, {leads, Term}} = Event, State) ->
    planned(Event, State#state{led = Term});
step(Event, State) ->
    planned(Event, State).

violation(What, T, Robot, {_, Leader, _} = Led) ->
    starl_violation:new(dpp, What, T, lists:usort([Robot, Leader]), #{term => Led}).

planned(Event, #state{plan = Plan} = State) ->
    case starl_dpp_monitor:step(Event, Plan) of
        {ok, Next} -> {ok, State#state{plan = Next}};
        {violation, Violation, Next} -> {violation, Violation, State#state{plan = Next}}
    end.

-spec finish(integer(), #state{}) ->
    {ok | {violation, [starl_monitor:violation(), ...]}, starl_monitor:results()}.
finish(End, #state{plan = Plan}) -> starl_dpp_monitor:finish(End, Plan).
