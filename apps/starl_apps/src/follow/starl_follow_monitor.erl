%% @doc The contract of following. Until its application restarts, a robot never goes back from a
%% later term to an earlier one. While robots drive, some robot leads at least once a minute,
%% counted from the end of all faults of the network, the clocks, the processes and the stores.
%%
%% Events of machine `app': {@link starl_leadership:event()}, `crashed', `done'; of machine `robot':
%% `up', `died'; of machine `supervisor': `given_up'.
-module(starl_follow_monitor).
-behaviour(starl_monitor).

-export([init/1, context/2, broken/2, step/2, finish/2, interests/0, vocabulary/0]).

-record(state, {
    %% the robots that drive; none when the first is done, since all drive for the same time
    left :: [starl:robot_id()],
    healed :: integer() | never,
    terms = #{} :: #{starl:robot_id() => non_neg_integer()},
    leaders = #{} :: #{starl:robot_id() => true},
    %% when somebody led last, and the longest time between
    led = 0 :: integer(),
    longest = 0 :: integer(),
    told = false :: boolean()
}).

-define(WITHIN_US, 60000000).

-spec init(#{robots := [starl:robot_id()], healed_us => integer() | never}) -> #state{}.
init(#{robots := Robots} = Config) ->
    #state{left = Robots, healed = maps:get(healed_us, Config, 0)}.

%% @doc When all faults are over that can keep robots from agreeing on a leader.
-spec context(starl_monitor:known(), map()) -> map().
context(Known, Config) ->
    Classes = [network, clock, process, store],
    Config#{healed_us => starl_monitor:healed_us(Classes, Known)}.

%% @doc In real time a fault is known when it happens.
-spec broken(starl_assumption:window(), #state{}) -> #state{}.
broken({_, _, To, _}, #state{healed = Healed} = State) -> State#state{healed = max(Healed, To)}.

-spec interests() -> [atom()].
interests() -> [app, robot, supervisor].

%% @doc {@link starl_leadership:event()}.
-spec vocabulary() -> starl_event:vocabulary().
vocabulary() -> #{app => [{leads, 1}, {follows, 2}, {doubted, 1}]}.

-spec step(starl_monitor:trace_event(), #state{}) ->
    {ok, #state{}} | {violation, starl_monitor:violation(), #state{}}.
step({T, _, _, _} = Event, State) ->
    {Late, Next} = late(T, State),
    starl_violation:first(Late, judge(Event, Next)).

judge({T, Robot, app, {leads, Term}}, #state{leaders = Leaders} = State) ->
    Led = lead(T, State#state{leaders = Leaders#{Robot => true}}),
    term(T, Robot, Term, Led);
judge({T, Robot, app, {follows, Term, _}}, State) ->
    term(T, Robot, Term, State);
judge({_, Robot, app, crashed}, #state{terms = Terms} = State) ->
    {ok, State#state{terms = maps:remove(Robot, Terms)}};
judge({T, _, app, {done, _}}, State) ->
    {ok, (lead(T, State))#state{left = []}};
judge({T, Robot, Machine, {Gone, _}}, #state{left = [_ | _] = Left} = State) when
    Machine =:= robot, Gone =:= died; Machine =:= supervisor, Gone =:= given_up
->
    case lists:delete(Robot, Left) of
        [] -> {ok, (lead(T, State))#state{left = []}};
        Others -> {ok, State#state{left = Others}}
    end;
judge(_Event, State) ->
    {ok, State}.

lead(_T, #state{left = []} = State) ->
    State;
lead(T, #state{led = Led, longest = Longest} = State) ->
    State#state{led = T, longest = max(Longest, T - Led)}.

term(T, Robot, Term, #state{terms = Terms} = State) ->
    Next = State#state{terms = Terms#{Robot => Term}},
    case Terms of
        #{Robot := Later} when Later > Term ->
            Details = #{term => Term, after_term => Later},
            {violation, violation(went_back, T, [Robot], Details), Next};
        #{} ->
            {ok, Next}
    end.

%% Nobody has led in time.
late(T, #state{left = [_ | _] = Left, healed = Healed, led = Led, told = false} = State) when
    Healed =/= never
->
    Due = max(Led, Healed) + ?WITHIN_US,
    case T > Due of
        true -> {[violation(nobody_leads, Due, Left, #{})], State#state{told = true}};
        false -> {[], State}
    end;
late(_T, State) ->
    {[], State}.

violation(What, T, Robots, Details) ->
    starl_violation:new(follow, What, T, Robots, Details).

%% @doc Results: the number of robots that have led, and the longest time without a leader.
-spec finish(integer(), #state{}) ->
    {ok | {violation, [starl_monitor:violation(), ...]}, #{atom() => term()}}.
finish(EndUs, State) ->
    {Late, Last} = late(EndUs, State),
    #state{leaders = Leaders, longest = Longest} = lead(EndUs, Last),
    Results = starl_unjudged:with(
        starl_unjudged:unhealed("one of the robots leads", Last#state.healed, EndUs),
        #{leaders => map_size(Leaders), longest_us => Longest}
    ),
    starl_violation:finish(Late, Results).
