%% @doc Monitors mutual exclusion in the exhaustive checker. It extends {@link starl_mutex_monitor}
%% by robots that stall within a step. Such a robot cannot notice that its lease is over before it
%% goes on and its timers have fired. In the checker, trace events have no times that would show the
%% end of the lease. So a hold of a robot that has stalled counts as over when another hold begins.
%% What the robot later reports of it is judged as everywhere else. The check without this fault
%% shows that no other robot holds the token too early: to the others, a stalled robot looks like a
%% robot that is cut off.
-module(starl_mutex_model_monitor).
-behaviour(starl_monitor).

-export([init/1, step/2, finish/2, interests/0, vocabulary/0, timeless/1]).

%% A hold of a token.
-type hold() :: {starl:robot_id(), Token :: term(), Fence :: integer()}.

-record(state, {
    holds :: starl_monitor:state(),
    %% the holds that are not known to be over; those taken for over that nobody has told of yet
    held = #{} :: #{hold() => []},
    over = #{} :: #{hold() => []},
    %% those during which their robot has stood still
    stood = #{} :: #{hold() => []}
}).

-spec init(map()) -> #state{}.
init(Config) -> #state{holds = starl_mutex_monitor:init(Config)}.

-spec interests() -> [atom()].
interests() -> starl_mutex_monitor:interests().

%% @doc The events of mutual exclusion.
-spec vocabulary() -> starl_event:vocabulary().
vocabulary() -> starl_mutex_monitor:vocabulary().

-spec timeless(#state{}) -> term().
timeless(#state{holds = Holds, held = Held, over = Over, stood = Stood}) ->
    {starl_mutex_monitor:timeless(Holds), Held, Over, Stood}.

-spec step(starl_monitor:trace_event(), #state{}) ->
    {ok, #state{}} | {violation, starl_monitor:violation(), #state{}}.
step({_, Robot, robot, stands}, #state{held = Held, stood = Stood} = State) ->
    {ok, State#state{
        stood = maps:merge(Stood, maps:filter(fun({R, _, _}, _) -> R =:= Robot end, Held))
    }};
step({T, Robot, mutex, {acquired, Token, Fence}} = Event, State) ->
    #state{held = Held} = Ended = ended(T, Robot, Token, State),
    judged(Event, Ended#state{held = Held#{{Robot, Token, Fence} => []}});
step({_, Robot, mutex, {How, Token, Fence}} = Event, State) when
    How =:= released; How =:= lease_lost
->
    let_go({Robot, Token, Fence}, Event, State);
step({_, Robot, mutex, crashed} = Event, State) ->
    #state{held = Held, over = Over, stood = Stood} = State,
    judged(Event, State#state{
        held = without(Robot, Held), over = without(Robot, Over), stood = without(Robot, Stood)
    });
step(Event, State) ->
    judged(Event, State).

let_go(Hold, Event, #state{held = Held, over = Over, stood = Stood} = State) ->
    case is_map_key(Hold, Over) of
        true ->
            {ok, State#state{over = maps:remove(Hold, Over)}};
        false ->
            judged(Event, State#state{
                held = maps:remove(Hold, Held), stood = maps:remove(Hold, Stood)
            })
    end.

without(Robot, Holds) -> maps:filter(fun({Whose, _, _}, _) -> Whose =/= Robot end, Holds).

%% The holds of robots that have stood still end as those of robots that crash do.
ended(T, Robot, Token, #state{held = Held, over = Over, stood = Stood} = State) ->
    Ends = maps:filter(
        fun({Whose, What, _}, _) -> Whose =/= Robot andalso What =:= Token end, Stood
    ),
    Keys = maps:keys(Ends),
    Left = State#state{
        held = maps:without(Keys, Held),
        over = maps:merge(Over, Ends),
        stood = maps:without(Keys, Stood)
    },
    lists:foldl(
        fun({Whose, _, _}, Before) ->
            {ok, Next} = judged({T, Whose, mutex, crashed}, Before),
            Next
        end,
        Left,
        Keys
    ).

judged(Event, #state{holds = Holds} = State) ->
    case starl_mutex_monitor:step(Event, Holds) of
        {ok, Next} -> {ok, State#state{holds = Next}};
        {violation, Violation, Next} -> {violation, Violation, State#state{holds = Next}}
    end.

-spec finish(integer(), #state{}) ->
    {ok | {violation, [starl_monitor:violation(), ...]}, starl_monitor:results()}.
finish(End, #state{holds = Holds}) -> starl_mutex_monitor:finish(End, Holds).
