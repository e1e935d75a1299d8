%% @doc The contract of mutual exclusion by tokens, as a monitor.
%%
%% Safety: see {@link starl_mutex_holds}. Always: fences grow from hold to hold of a robot, and only
%% the robot to which the token's home has confirmed a hand-over holds it, so that no fence is used
%% twice; only tokens that are held are answered, released or lost. As long as clocks keep the
%% assumptions: never two holds of one token at once, and the fence of a hold is larger than those
%% of all earlier holds; as long as robots are prompt: a hold ends with its lease. `broken' tells
%% the times at which an assumption is broken ({@link starl_assumption}; see {@link context/2}), and
%% only deviations that it explains are excused. A hold ends with `released' or `lease_lost', with
%% the crash of the robot's mutex machine, or with the robot.
%%
%% Progress: a request is granted within `bound_us' (default: none), as far as it was made at
%% `from_us' or later (default 0); with `granted' (default false) a request that fails is a
%% violation as well. A robot's death or the crash of its mutex machine ends its requests.
%%
%% Events of machine `mutex': {@link starl_mutex_tokens:event()}, `crashed'; of machine `robot':
%% `died'.
-module(starl_mutex_monitor).
-behaviour(starl_monitor).

-export([init/1, context/2, broken/2, step/2, finish/2, interests/0, vocabulary/0, timeless/1]).

-type robot_id() :: starl_monitor:robot_id().
-type token() :: term().

-record(state, {
    bound_us :: pos_integer() | infinity,
    from_us :: integer(),
    granted :: boolean(),
    holds :: starl_mutex_holds:t(),
    %% requests not granted yet, of each robot's several ones the oldest first
    open = #{} :: #{{token(), robot_id()} => [RequestedUs :: integer()]},
    %% the bounds in their order; those that `open' does not confirm are void
    deadlines = queue:new() :: queue:queue({integer(), token(), robot_id()}),
    waits = {0, 0, 0} :: {Count :: integer(), SumUs :: integer(), LongestUs :: integer()},
    lost = 0 :: non_neg_integer(),
    failed = 0 :: non_neg_integer()
}).

%% @doc See above; all keys may be left out. `lease_us', `drift_ppm' and `lag_us' are those of the
%% machines, by default theirs (8 s, 10000, 250 ms).
-spec init(#{
    bound_us => pos_integer() | infinity,
    from_us => integer(),
    granted => boolean(),
    lease_us => pos_integer(),
    drift_ppm => non_neg_integer(),
    lag_us => non_neg_integer(),
    broken => [starl_assumption:window()]
}) -> #state{}.
init(Config) ->
    #state{
        bound_us = maps:get(bound_us, Config, infinity),
        from_us = maps:get(from_us, Config, 0),
        granted = maps:get(granted, Config, false),
        holds = starl_mutex_holds:new(
            maps:with([lease_us, drift_ppm, lag_us, broken], Config)
        )
    }.

%% @doc The configuration with the times of broken assumptions; faults of clocks and processes widen
%% the bound.
-spec context(starl_monitor:known(), map()) -> map().
context(#{broken := Broken, slack_us := Slack}, Config) ->
    Told = maps:merge(#{broken => Broken}, Config),
    case Told of
        #{bound_us := Bound} when is_integer(Bound) -> Told#{bound_us := Bound + Slack};
        #{} -> Told
    end.

%% @doc Leases that run into the window may be noticed later; it widens the bound.
-spec broken(starl_assumption:window(), #state{}) -> #state{}.
broken({_, From, To, _} = Window, #state{holds = Holds, bound_us = Bound} = State) ->
    Told = State#state{holds = starl_mutex_holds:broken(Window, Holds)},
    case Bound of
        infinity -> Told;
        _ -> Told#state{bound_us = Bound + To - From}
    end.

%% @doc The mutex machines' own events and the end of robots.
-spec interests() -> [atom()].
interests() -> [mutex, robot].

%% @doc {@link starl_mutex_tokens:event()}.
-spec vocabulary() -> starl_event:vocabulary().
vocabulary() ->
    #{
        mutex => [
            {requested, 1},
            {leased, 3},
            {acquired, 2},
            {answered, 1},
            {released, 2},
            {lease_lost, 2},
            {failed, 2},
            {granted, 3},
            {handed_over, 3},
            {hand_over_lost, 3}
        ]
    }.

%% @doc The holders and the fences; without `bound_us' and `granted' nothing else is judged.
-spec timeless(#state{}) -> term().
timeless(#state{holds = Holds}) -> starl_mutex_holds:timeless(Holds).

%% @doc Judges one event.
-spec step(starl_monitor:trace_event(), #state{}) ->
    {ok, #state{}} | {violation, starl_monitor:violation(), #state{}}.
step({T, Robot, Machine, Event}, State) ->
    {Overdue, Current} = pass(T, State, []),
    {Broken, Next} = judge({Machine, Event}, T, Robot, Current),
    case Overdue ++ Broken of
        [] -> {ok, Next};
        [First | _] -> {violation, First, Next}
    end.

%% @doc Judges the time until `EndTimeUs'. Results: the number of `tokens' that were held, of
%% holds (`acquired'), of `lease_lost' and `failed', the longest and the mean wait of those
%% granted, and their ratio, the `unfairness'.
-spec finish(integer(), #state{}) ->
    {ok | {violation, [starl_monitor:violation(), ...]}, starl_monitor:results()}.
finish(EndTimeUs, State) ->
    {Overdue, #state{waits = {Count, Sum, Longest}} = End} = pass(EndTimeUs, State, []),
    Mean = Sum / max(1, Count),
    Results = #{
        tokens => starl_mutex_holds:tokens(End#state.holds),
        acquired => Count,
        lease_lost => End#state.lost,
        failed => End#state.failed,
        longest_wait_us => Longest,
        mean_wait_us => Mean,
        unfairness => Longest / max(1.0, Mean)
    },
    {verdict(Overdue ++ starl_mutex_holds:finish(EndTimeUs, End#state.holds)), Results}.

verdict([]) -> ok;
verdict(Violations) -> {violation, Violations}.

%%% Events: each gives the violations it shows

judge({mutex, {requested, Token}}, T, Robot, State) ->
    {[], request(T, Robot, Token, State)};
judge({mutex, {granted, Token, Fence, To}}, T, Home, #state{holds = Holds} = State) ->
    kept(starl_mutex_holds:granted(T, Home, Token, Fence, To, Holds), State);
judge({mutex, {leased, Token, Fence, Left}}, T, Robot, #state{holds = Holds} = State) ->
    {[], State#state{holds = starl_mutex_holds:leased(T, Robot, Token, Fence, Left, Holds)}};
judge({mutex, {acquired, Token, Fence}}, T, Robot, #state{holds = Holds} = State) ->
    Held = starl_mutex_holds:acquired(T, Robot, Token, Fence, Holds),
    kept(Held, wait(T, Robot, Token, State));
judge({mutex, {answered, Fences}}, T, Robot, #state{holds = Holds} = State) ->
    {starl_mutex_holds:answered(T, Robot, Fences, Holds), State};
judge({mutex, {released, Token, Fence}}, T, Robot, #state{holds = Holds} = State) ->
    kept(starl_mutex_holds:ended(released, T, Robot, Token, Fence, Holds), State);
judge({mutex, {lease_lost, Token, Fence}}, T, Robot, #state{holds = Holds} = State) ->
    Ended = starl_mutex_holds:ended(lost, T, Robot, Token, Fence, Holds),
    kept(Ended, State#state{lost = State#state.lost + 1});
judge({mutex, {failed, Token, Reason}}, T, Robot, #state{failed = Failed} = State) ->
    {Since, Closed} = close(Token, Robot, State#state{failed = Failed + 1}),
    {refused(T, Robot, Token, Reason, Since, State), Closed};
judge({mutex, crashed}, _T, Robot, State) ->
    {[], forget(Robot, State)};
judge({robot, {died, _Reason}}, _T, Robot, State) ->
    {[], forget(Robot, State)};
judge({_Machine, _Other}, _T, _Robot, State) ->
    {[], State}.

kept({Broken, Holds}, State) -> {Broken, State#state{holds = Holds}}.

request(T, Robot, Token, #state{open = Open, bound_us = Bound, from_us = From} = State) ->
    Key = {Token, Robot},
    Opened = State#state{open = Open#{Key => maps:get(Key, Open, []) ++ [T]}},
    case Bound =/= infinity andalso T >= From of
        true -> Opened#state{deadlines = queue:in({T, Token, Robot}, Opened#state.deadlines)};
        false -> Opened
    end.

wait(T, Robot, Token, #state{waits = {Count, Sum, Longest}} = State) ->
    case close(Token, Robot, State) of
        {none, Closed} ->
            Closed;
        {Since, Closed} ->
            Closed#state{waits = {Count + 1, Sum + T - Since, max(Longest, T - Since)}}
    end.

%% Takes the robot's oldest request for the token as answered.
close(Token, Robot, #state{open = Open} = State) ->
    Key = {Token, Robot},
    case Open of
        #{Key := [Since]} -> {Since, State#state{open = maps:remove(Key, Open)}};
        #{Key := [Since | Later]} -> {Since, State#state{open = Open#{Key := Later}}};
        #{} -> {none, State}
    end.

forget(Robot, #state{holds = Holds, open = Open} = State) ->
    State#state{
        holds = starl_mutex_holds:forget(Robot, Holds),
        open = maps:filter(fun({_, Who}, _) -> Who =/= Robot end, Open)
    }.

%%% The clauses of progress

refused(T, Robot, Token, Reason, Since, #state{granted = true, from_us = From}) when
    is_integer(Since), Since >= From
->
    [violation(not_granted, T, [Robot], #{token => Token, reason => Reason})];
refused(_T, _Robot, _Token, _Reason, _Since, _State) ->
    [].

%% The requests that are overdue before `T'; a grant at exactly the bound is in time.
pass(T, #state{deadlines = Deadlines, bound_us = Bound, open = Open} = State, Found) ->
    case queue:peek(Deadlines) of
        {value, {Since, Token, Robot}} when Since + Bound < T ->
            Left = State#state{deadlines = queue:drop(Deadlines)},
            case lists:member(Since, maps:get({Token, Robot}, Open, [])) of
                true ->
                    Details = #{token => Token},
                    Late = violation(no_grant_in_time, Since + Bound, [Robot], Details),
                    pass(T, Left, [Late | Found]);
                false ->
                    pass(T, Left, Found)
            end;
        _NothingDue ->
            {lists:reverse(Found), State}
    end.

violation(What, T, Robots, Details) ->
    #{contract => mutex, what => What, at_us => T, robots => Robots, details => Details}.
