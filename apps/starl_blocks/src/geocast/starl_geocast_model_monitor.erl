%% @doc Monitors geocast in the exhaustive checker, which has no real time. It runs
%% {@link starl_geocast_monitor} with invented times in the right order. Every crash takes a
%% microsecond. The window ends with the event `{window, over}' of the client's timer.
-module(starl_geocast_model_monitor).
-behaviour(starl_monitor).

-export([init/1, step/2, finish/2, interests/0, vocabulary/0, timeless/1]).

-record(state, {
    casts :: starl_monitor:state(),
    lifetime_us :: pos_integer(),
    now_us = 0 :: non_neg_integer()
}).

-spec init(#{lifetime_us := pos_integer(), robots := [starl:robot_id()]}) -> #state{}.
init(#{lifetime_us := Lifetime} = Config) ->
    Casts = starl_geocast_monitor:init(maps:remove(lifetime_us, Config)),
    #state{casts = Casts, lifetime_us = Lifetime}.

-spec interests() -> [atom()].
interests() -> [app, geocast, robot].

%% @doc The events of geocast, and those of the client.
-spec vocabulary() -> starl_event:vocabulary().
vocabulary() -> (starl_geocast_monitor:vocabulary())#{app => [{window, 1}]}.

-spec timeless(#state{}) -> term().
timeless(#state{casts = Casts, now_us = Now}) -> {Now, Casts}.

-spec step(starl_monitor:trace_event(), #state{}) ->
    {ok, #state{}} | {violation, starl_monitor:violation(), #state{}}.
step({_, _, app, {window, over}}, #state{now_us = Now, lifetime_us = Lifetime} = State) ->
    {ok, State#state{now_us = Now + Lifetime + 1}};
step({_, _, app, _}, State) ->
    {ok, State};
step({_, Robot, Machine, Event}, #state{casts = Casts} = State0) ->
    State = State0#state{now_us = State0#state.now_us + took(Event)},
    case starl_geocast_monitor:step({State#state.now_us, Robot, Machine, Event}, Casts) of
        {ok, Next} -> {ok, State#state{casts = Next}};
        {violation, Violation, Next} -> {violation, Violation, State#state{casts = Next}}
    end.

took(crashed) -> 1;
took(_Event) -> 0.

-spec finish(integer(), #state{}) ->
    {ok | {violation, [starl_monitor:violation(), ...]}, starl_monitor:results()}.
finish(_End, #state{casts = Casts, now_us = Now}) -> starl_geocast_monitor:finish(Now, Casts).
