%% @doc The contract of mutual exclusion by tokens, as a monitor.
%%
%% Safety: see {@link starl_mutex_holds}. Always: fences grow from hold to hold of a robot. Only the
%% robot to which the token's home has confirmed a hand-over holds it, so no fence is used twice.
%% Only tokens that are held are answered, released or lost. As long as clocks keep the assumptions:
%% there are never two holds of one token at once, and the fence of a hold is larger than those of
%% all earlier holds. As long as robots are also prompt: a hold ends with its lease. `broken' lists
%% the times at which an assumption is broken ({@link starl_assumption}; see {@link context/2}), and
%% only deviations that it explains are excused. A hold ends with `released' or `lease_lost', with
%% the crash of the robot's mutex machine, or with the robot.
%%
%% Progress: a token that a robot asks for does not lie idle. Some robot holds it within `idle_us'
%% (default: none; in a run it follows from the lease, `retry_us', the radio and SAP, see
%% {@link context/2}). The time counts from the request, the end of the last hold, or a hand-over
%% that was lost. It also counts from the last crash of a mutex machine, and from the last fault
%% that the team meets meanwhile ({@link starl_assumption:calm_us/3}). It is not judged once the
%% token's home has died. The holds themselves are as long as applications hold.
%%
%% Owners are known ({@link starl_mutex_monitor_owners}): the holder of a token has announced itself
%% to all others within `announce_us' (default: none; in a run 1 s), and nobody else does.
%%
%% A request is granted within `bound_us' (default: none) of it and of the last fault that it meets,
%% if it was made at `from_us' or later (default 0). With `granted' (default false) a request that
%% fails is a violation as well. A robot's death or the crash of its mutex machine ends its
%% requests.
%%
%% Events of machine `mutex': {@link starl_mutex_tokens:event()}, `crashed'; of machine `sap': `sent',
%% `overload', `started', `crashed'; of machine `robot': `died'.
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
    owners :: starl_mutex_monitor_owners:t(),
    %% requests not granted yet, of each robot's several ones the oldest first
    open = #{} :: #{{token(), robot_id()} => [RequestedUs :: integer()]},
    %% the bounds in their order; those that `open' does not confirm are void
    deadlines = queue:new() :: queue:queue({integer(), token(), robot_id()}),
    %% the tokens that are asked for and not held, since when, and the earliest time at which one of
    %% them may have been idle for too long
    idle_us :: pos_integer() | infinity,
    idle = #{} :: #{token() => SinceUs :: integer()},
    %% the token for which a robot waited in vain last, if nobody has held it since
    vain = none :: none | {token, token()},
    %% was a token found to lie idle?
    found = false :: boolean(),
    idle_due = infinity :: integer() | infinity,
    faults :: starl_assumption:t(),
    robots :: [robot_id()],
    died = [] :: [robot_id()],
    unjudged :: [starl_unjudged:clause()],
    %% the robots to which the homes have given the tokens last
    last = #{} :: #{token() => robot_id()},
    waits = {0, 0, 0} :: {Count :: integer(), SumUs :: integer(), LongestUs :: integer()},
    lost = 0 :: non_neg_integer(),
    failed = 0 :: non_neg_integer()
}).

%% Clocks are within 1 % of real time.
-define(DRIFT_PPM, 10000).
%% The time of the robots' own steps.
-define(MARGIN_US, 1000000).
%% The clause of progress.
-define(GRANTED, "holders release: every request is granted").

%% @doc See above; all keys may be left out. `robots': the team; `faults': the windows of all faults. `lease_us', `drift_ppm' and `lag_us' are those of the
%% machines, by default theirs (8 s, 10000, 250 ms).
-spec init(#{
    robots => [robot_id()],
    faults => [starl_assumption:window()],
    idle_us => pos_integer() | infinity,
    bound_us => pos_integer() | infinity,
    from_us => integer(),
    granted => boolean(),
    lease_us => pos_integer(),
    drift_ppm => non_neg_integer(),
    lag_us => non_neg_integer(),
    announce_us => pos_integer(),
    broken => [starl_assumption:window()],
    unjudged => [starl_unjudged:clause()]
}) -> #state{}.
init(Config) ->
    #state{
        bound_us = maps:get(bound_us, Config, infinity),
        from_us = maps:get(from_us, Config, 0),
        granted = maps:get(granted, Config, false),
        idle_us = maps:get(idle_us, Config, infinity),
        faults = starl_assumption:new(maps:get(faults, Config, []), ?DRIFT_PPM),
        robots = maps:get(robots, Config, []),
        unjudged = maps:get(unjudged, Config, []),
        owners = starl_mutex_monitor_owners:new(Config),
        holds = starl_mutex_holds:new(
            maps:with([lease_us, drift_ppm, lag_us, broken], Config)
        )
    }.

%% @doc The configuration with the times of broken assumptions and of all faults, and with the longest
%% time for which a token is idle, if `retry_us', the time after which a waiting robot asks again, is
%% given. At worst the last holder has gone: the lease of its claim runs out, and that of a claim
%% which its home may have forgotten. The robot then asks again at the home, which passes it on to the
%% holder, which hands the token over; the robot claims it at the home, a second time if that was
%% lost, and is answered. Before that the token may go to each robot of its queue, of which none wants
%% it any more. Where a claim and its answer may take a lease, by a clock that is 1 % fast, all this comes again: so
%% many times that all claims are too late at most once in 10^9 cases.
-spec context(starl_monitor:known(), map()) -> map().
context(#{broken := Broken, faults := Faults, slack_us := Slack} = Known, Config) ->
    Told = idle(Known, announces(maps:merge(#{broken => Broken, faults => Faults}, Config))),
    maps:map(
        fun
            (Key, Us) when
                is_integer(Us), Key =:= bound_us orelse Key =:= idle_us orelse Key =:= announce_us
            ->
                Us + Slack;
            (_Key, Value) ->
                Value
        end,
        Told
    ).

%% A robot alone has nobody to tell.
announces(#{robots := [_, _ | _]} = Told) -> maps:merge(#{announce_us => ?MARGIN_US}, Told);
announces(Told) -> Told.

idle(
    #{sap := Sap, loss := Loss, delay_us := Delay}, #{retry_us := Retry, lease_us := Lease} = Told
) when
    not is_map_key(idle_us, Told)
->
    #{lag_us := Lag} = Told,
    Messages = 5 + length(maps:get(robots, Told, [])),
    Reach = starl_sap_schedule:reach_us(Sap, Loss, Delay, Retry),
    Waits = 2 * (Lease + Retry) * 101 div 100 + 2 * Lag,
    InTime = Lease * 100 div 101 div 2,
    TooLate = min(1.0, 2 * starl_sap_schedule:missed(Sap, Loss, Delay, InTime)),
    case starl_sap_schedule:rounds(TooLate) of
        never -> Told#{unjudged => unjudged(Loss, Delay, InTime)};
        Rounds -> Told#{idle_us => Rounds * (Waits + Messages * Reach) + ?MARGIN_US}
    end;
idle(_Known, Told) ->
    Told.

unjudged(_Loss, Delay, InTime) when Delay > InTime ->
    [{?GRANTED, "a claim takes longer than a lease"}];
unjudged(Loss, _Delay, _InTime) ->
    starl_unjudged:lossy(?GRANTED, Loss).

%% @doc Leases that run into the window may be noticed later; it excuses what it meets.
-spec broken(starl_assumption:window(), #state{}) -> #state{}.
broken(Window, #state{holds = Holds, faults = Faults, owners = Owners} = State) ->
    State#state{
        owners = starl_mutex_monitor_owners:broken(Window, Owners),
        holds = starl_mutex_holds:broken(Window, Holds),
        faults = starl_assumption:broken(Window, Faults)
    }.

%% @doc The mutex machines' own events, what is sent, and the end of robots.
-spec interests() -> [atom()].
interests() -> [mutex, sap, robot].

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
    {Idle, Busy} = lie_idle(T, Current),
    {Unknown, Announced} = owners({Machine, Event}, T, Robot, Busy),
    {Broken, Judged} = judge({Machine, Event}, T, Robot, Announced),
    Next = noted(Event, T, Judged),
    starl_violation:step(Overdue ++ Idle ++ Unknown ++ Broken, Next).

%% @doc Judges the time until `EndTimeUs'. Results: the number of `tokens' that were held, of
%% holds (`acquired'), of `lease_lost' and `failed', the longest and the mean wait of those
%% granted, and their ratio, the `unfairness'.
-spec finish(integer(), #state{}) ->
    {ok | {violation, [starl_monitor:violation(), ...]}, starl_monitor:results()}.
finish(EndTimeUs, State) ->
    {Overdue, Passed} = pass(EndTimeUs, State, []),
    {Idle, Busy} = lie_idle(EndTimeUs, Passed),
    {Unannounced, #state{waits = {Count, Sum, Longest}} = End} = unannounced(EndTimeUs, Busy),
    Mean = Sum / max(1, Count),
    Results = starl_unjudged:with(off(EndTimeUs, End), #{
        tokens => starl_mutex_holds:tokens(End#state.holds),
        acquired => Count,
        lease_lost => End#state.lost,
        failed => End#state.failed,
        longest_wait_us => Longest,
        mean_wait_us => Mean,
        unfairness => Longest / max(1.0, Mean)
    }),
    Ended = starl_mutex_holds:finish(EndTimeUs, End#state.holds),
    starl_violation:finish(Overdue ++ Idle ++ Unannounced ++ Ended, Results).

%% Is any time of the run so long without a fault that an idle token is found? Else nothing is known of those who
%% waited until they gave up, or for most of the run.
off(_EndUs, #state{unjudged = [_ | _] = Unjudged}) ->
    Unjudged;
off(_EndUs, #state{idle_us = Idle, found = Found}) when Idle =:= infinity; Found ->
    [];
off(EndUs, #state{idle_us = Idle, idle = Waiting, vain = Vain, faults = Faults}) ->
    case starl_unjudged:excused(?GRANTED, Idle, EndUs, Faults) of
        [] ->
            Long = [x || Since <- maps:values(Waiting), 2 * (EndUs - Since) > EndUs],
            InVain = Long =/= [] orelse Vain =/= none,
            [
                Clause
             || InVain,
                Clause <- starl_unjudged:too_short(?GRANTED, Idle, "somebody waited in vain")
            ];
        Excused ->
            Excused
    end.

%%% Events: each gives the violations it shows

judge({mutex, Event}, T, Robot, State) ->
    token(Event, T, Robot, State);
judge({robot, store_set_back}, _T, Robot, #state{holds = Holds} = State) ->
    {[], State#state{holds = starl_mutex_holds:set_back(Robot, Holds)}};
judge({robot, {died, _Reason}}, T, Robot, #state{faults = Faults, died = Died} = State) ->
    Fault = {Robot, T, T, fault},
    {
        [],
        forget(T, Robot, State#state{
            faults = starl_assumption:broken(Fault, Faults), died = [Robot | Died]
        })
    };
judge({_Machine, _Other}, _T, _Robot, State) ->
    {[], State}.

token({requested, Token}, T, Robot, State) ->
    {[], request(T, Robot, Token, State)};
token({granted, Token, Fence, To}, T, Home, #state{holds = Holds, last = Last} = State) ->
    Given = State#state{last = Last#{Token => To}},
    kept(starl_mutex_holds:granted(T, Home, Token, Fence, To, Holds), Given);
token({leased, Token, Fence, Left}, T, Robot, #state{holds = Holds} = State) ->
    {[], State#state{holds = starl_mutex_holds:leased(T, Robot, Token, Fence, Left, Holds)}};
token({acquired, Token, Fence}, T, Robot, #state{holds = Holds} = State) ->
    Held = starl_mutex_holds:acquired(T, Robot, Token, Fence, Holds),
    kept(Held, served(Token, wait(T, Robot, Token, State)));
token({answered, Fences}, T, Robot, #state{holds = Holds} = State) ->
    {starl_mutex_holds:answered(T, Robot, Fences, Holds), State};
token({released, Token, Fence}, T, Robot, #state{holds = Holds} = State) ->
    kept(starl_mutex_holds:ended(released, T, Robot, Token, Fence, Holds), State);
token({lease_lost, Token, Fence}, T, Robot, #state{holds = Holds} = State) ->
    Ended = starl_mutex_holds:ended(lost, T, Robot, Token, Fence, Holds),
    kept(Ended, State#state{lost = State#state.lost + 1});
token({failed, Token, Reason}, T, Robot, #state{failed = Failed} = State) ->
    {Since, Closed} = close(Token, Robot, State#state{
        failed = Failed + 1, vain = {token, Token}
    }),
    {refused(T, Robot, Token, Reason, Since, State), Closed};
token(crashed, T, Robot, #state{faults = Faults} = State) ->
    Fault = {Robot, T, T, fault},
    {[], forget(T, Robot, State#state{faults = starl_assumption:broken(Fault, Faults)})};
token(_Event, _T, _Robot, State) ->
    {[], State}.

served(Token, #state{vain = {token, Token}} = State) -> State#state{vain = none};
served(_Token, State) -> State.

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

forget(T, Robot, #state{holds = Holds, open = Open} = State) ->
    Tokens = lists:usort([Token || {Token, _} <- maps:keys(Open)]),
    Forgotten = State#state{
        holds = starl_mutex_holds:forget(Robot, Holds),
        open = maps:filter(fun({_, Who}, _) -> Who =/= Robot end, Open)
    },
    lists:foldl(fun(Token, S) -> look(Token, T, S) end, Forgotten, Tokens).

%%% Tokens that lie idle

noted(_Event, _T, #state{idle_us = infinity} = State) ->
    State;
noted({requested, Token}, T, State) ->
    look(Token, T, State);
noted({acquired, Token, _}, T, State) ->
    look(Token, T, State);
noted({released, Token, _}, T, State) ->
    look(Token, T, State);
noted({lease_lost, Token, _}, T, State) ->
    look(Token, T, State);
noted({failed, Token, _}, T, State) ->
    look(Token, T, State);
noted({hand_over_lost, Token, _, _}, T, State) ->
    look(Token, T, used(Token, State));
%% A request of a robot that has died is still in the queue; its lease has to end first.
noted({handed_over, Token, _, To}, T, #state{died = Died} = State) ->
    case lists:member(To, Died) of
        true -> look(Token, T, used(Token, State));
        false -> State
    end;
noted(_Other, _T, State) ->
    State.

%% Is the token idle from now on, still, or no longer?
look(_Token, _T, #state{idle_us = infinity} = State) ->
    State;
look(Token, T, #state{idle = Idle, holds = Holds, idle_us = Us, idle_due = Due} = State) ->
    case waiting(Token, State) =/= [] andalso not starl_mutex_holds:is_held(Token, Holds) of
        false -> used(Token, State);
        true when is_map_key(Token, Idle) -> State;
        true -> State#state{idle = Idle#{Token => T}, idle_due = min(Due, T + Us)}
    end.

used(Token, #state{idle = Idle} = State) -> State#state{idle = maps:remove(Token, Idle)}.

waiting(Token, #state{open = Open}) ->
    lists:sort([Robot || {Of, Robot} <- maps:keys(Open), Of =:= Token]).

%% The tokens that have been idle for too long before `T'; each is told once for a time as long.
lie_idle(T, #state{idle_due = Due} = State) when T =< Due ->
    %% an atom, `infinity', is greater than every number
    {[], State};
lie_idle(T, #state{idle = Idle, idle_us = Us, faults = Faults} = State) ->
    Dues = [
        {starl_assumption:calm_us(Since, Us, Faults), Token}
     || {Token, Since} <- maps:to_list(Idle), has_home(Token, State)
    ],
    {Over, Left} = lists:partition(fun({Due, _}) -> Due < T end, lists:sort(Dues)),
    Told = maps:from_list([{Token, T} || {_, Token} <- Over]),
    {
        [
            violation(lies_idle, Due, waiting(Token, State), #{
                token => Token, last => maps:get(Token, State#state.last, none)
            })
         || {Due, Token} <- Over
        ],
        State#state{
            idle = maps:merge(Idle, Told),
            found = State#state.found orelse Over =/= [],
            idle_due = lists:min([infinity | [Due || {Due, _} <- Left] ++ [T + Us || _ <- Over]])
        }
    }.

has_home(_Token, #state{died = []}) ->
    true;
has_home(_Token, #state{robots = []}) ->
    false;
has_home(Token, #state{robots = Robots, died = Died}) ->
    not lists:member(starl_mutex:home(Token, Robots), Died).

%%% The owners of tokens

owners(Event, T, Robot, State) ->
    {Late, #state{owners = Owners} = Current} = unannounced(T, State),
    {False, Next} = starl_mutex_monitor_owners:event(Event, T, Robot, Owners),
    Lies = [
        violation(false_owner, T, [By], #{token => Token, owner => Owner, fence => Fence})
     || {false_owner, By, {Token, Owner, Fence}} <- False
    ],
    {Late ++ Lies, Current#state{owners = Next}}.

unannounced(T, #state{owners = Owners} = State) ->
    {Late, Left} = starl_mutex_monitor_owners:overdue(T, Owners),
    {
        [
            violation(owner_not_announced, Due, [Robot], #{token => Token, fence => Fence})
         || {Due, {Token, Robot, Fence}} <- Late
        ],
        State#state{owners = Left}
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
            Due = starl_assumption:calm_us(Since, Bound, State#state.faults),
            case lists:member(Since, maps:get({Token, Robot}, Open, [])) of
                true when Due < T ->
                    Late = violation(no_grant_in_time, Due, [Robot], #{token => Token}),
                    pass(T, Left, [Late | Found]);
                true ->
                    %% requests that came later are due no earlier
                    {lists:reverse(Found), State};
                false ->
                    pass(T, Left, Found)
            end;
        _NothingDue ->
            {lists:reverse(Found), State}
    end.

violation(What, T, Robots, Details) ->
    starl_violation:new(mutex, What, T, Robots, Details).
