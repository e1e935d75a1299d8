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
%% Owners are known (the paper's Proposition 2(c)). A robot whose claim the home has confirmed sends
%% all others one message: that it is the owner of this hand-over. The holder of a token has sent it
%% at most `announce_us' (default: none; in a run 1 s) after the hold has begun, or later by what its
%% own pauses and slowness explain. No other robot sends it. The messages are recognized by their
%% hashes of 27 bits. Another message may have the same hash, so a robot is accused only when it has
%% sent all others such a message twice. A missing announcement is excused if the robot's SAP has had no room or has restarted
%% since, or if its mutex machine has crashed since.
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

-type token() :: starl_mutex:token().
-type hand_over() :: {token(), starl:robot_id(), starl_mutex:fence()}.

%% Clocks are within 1 % of real time.
-define(DRIFT_PPM, 10000).
%% The time of the robots' own steps.
-define(MARGIN_US, 1000000).
%% The clause of progress.
-define(GRANTED, "holders release: every request is granted").
%% The steps of an announcement: the machine's and SAP's.
-define(ANNOUNCE_STEPS, 2).
%% The hand-overs of a token that are remembered: a confirmation may be long under way.
-define(KEPT, 8).

-record(state, {
    bound_us :: pos_integer() | infinity,
    from_us :: integer(),
    granted :: boolean(),
    holds :: starl_mutex_holds:t(),
    %% requests not granted yet, of each robot's several ones the oldest first; the grants owed
    open = #{} :: #{{token(), starl:robot_id()} => [RequestedUs :: integer()]},
    grants = starl_obligations:new(anew) ::
        starl_obligations:t({RequestedUs :: integer(), token(), starl:robot_id()}),
    %% the tokens that are asked for and not held
    idle_us :: pos_integer() | infinity,
    idle = starl_obligations:new(anew) :: starl_obligations:t(token()),
    %% the token for which a robot waited in vain last, if nobody has held it since
    vain = none :: none | {token, token()},
    %% was a token found to lie idle?
    found = false :: boolean(),
    announce_us :: pos_integer() | infinity,
    %% what the homes have confirmed, by the hash of its announcement, and of each token the latest ones
    confirmed = #{} :: #{Hash :: non_neg_integer() => hand_over()},
    latest = #{} :: #{token() => [Hash :: non_neg_integer()]},
    announced = #{} :: #{{starl:robot_id(), token()} => starl_mutex:fence()},
    %% the robots that seem to have announced another robot's hand-over, once
    suspected = #{} :: #{starl:robot_id() => true},
    %% holds of hand-overs that are not announced yet
    unannounced = starl_obligations:new({delayed, ?ANNOUNCE_STEPS}) ::
        starl_obligations:t({HeldUs :: integer(), hand_over()}),
    assumption :: starl_assumption:t(),
    faults :: starl_assumption:t(),
    robots :: [starl:robot_id()],
    died = [] :: [starl:robot_id()],
    unjudged :: [starl_unjudged:clause()],
    %% the robots to which the homes have given the tokens last
    last = #{} :: #{token() => starl:robot_id()},
    waits = {0, 0, 0} :: {Count :: integer(), SumUs :: integer(), LongestUs :: integer()},
    lost = 0 :: non_neg_integer(),
    failed = 0 :: non_neg_integer()
}).

%% @doc See above; all keys may be left out. `robots': the team; `faults': the windows of all faults. `lease_us', `drift_ppm' and `lag_us' are those of the
%% machines, by default theirs (8 s, 10000, 250 ms).
-spec init(#{
    robots => [starl:robot_id()],
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
        announce_us = maps:get(announce_us, Config, infinity),
        assumption = starl_assumption:new(maps:get(broken, Config, []), ?DRIFT_PPM),
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
broken(Window, #state{holds = Holds, faults = Faults, assumption = Assumption} = State) ->
    State#state{
        assumption = starl_assumption:broken(Window, Assumption),
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
    {Overdue, Current} = pass(T, State),
    {Lies, Announced} = owners({Machine, Event}, T, Robot, Current),
    {Broken, Judged} = judge({Machine, Event}, T, Robot, Announced),
    Next = noted(Event, T, Judged),
    starl_violation:step(Overdue ++ Lies ++ Broken, Next).

%% @doc Judges the time until `EndTimeUs'. Results: the number of `tokens' that were held, of
%% holds (`acquired'), of `lease_lost' and `failed', the longest and the mean wait of those
%% granted, and their ratio, the `unfairness'.
-spec finish(integer(), #state{}) ->
    {ok | {violation, [starl_monitor:violation(), ...]}, starl_monitor:results()}.
finish(EndTimeUs, State) ->
    {Overdue, #state{waits = {Count, Sum, Longest}} = End} = pass(EndTimeUs, State),
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
    starl_violation:finish(Overdue ++ Ended, Results).

%% Is any time of the run so long without a fault that an idle token is found? Else nothing is known of those who
%% waited until they gave up, or for most of the run.
off(_EndUs, #state{unjudged = [_ | _] = Unjudged}) ->
    Unjudged;
off(_EndUs, #state{idle_us = Idle, found = Found}) when Idle =:= infinity; Found ->
    [];
off(EndUs, #state{idle_us = Idle, idle = Unheld, vain = Vain, faults = Faults}) ->
    case starl_unjudged:excused(?GRANTED, Idle, EndUs, Faults) of
        [] ->
            Sinces = maps:values(starl_obligations:sinces(Unheld)),
            Long = [x || Since <- Sinces, 2 * (EndUs - Since) > EndUs],
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
        true ->
            #state{grants = Grants} = State,
            Owed = starl_obligations:owe({T, Token, Robot}, team, T, Bound, Grants),
            Opened#state{grants = Owed};
        false ->
            Opened
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
        #{Key := [Since]} ->
            Left = State#state{open = maps:remove(Key, Open)},
            {Since, granted(Since, Token, Robot, Left)};
        #{Key := [Since, Since | _] = [_ | Later]} ->
            {Since, State#state{open = Open#{Key := Later}}};
        #{Key := [Since | Later]} ->
            {Since, granted(Since, Token, Robot, State#state{open = Open#{Key := Later}})};
        #{} ->
            {none, State}
    end.

granted(Since, Token, Robot, #state{grants = Grants} = State) ->
    State#state{grants = starl_obligations:paid({Since, Token, Robot}, Grants)}.

forget(T, Robot, #state{holds = Holds, open = Open} = State) ->
    Tokens = lists:usort([Token || {Token, _} <- maps:keys(Open)]),
    Forgotten = State#state{
        holds = starl_mutex_holds:forget(Robot, Holds),
        grants = starl_obligations:dropped(
            fun({_, _, Who}) -> Who =:= Robot end, State#state.grants
        ),
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
look(Token, T, #state{idle = Idle, holds = Holds, idle_us = Us} = State) ->
    case waiting(Token, State) =/= [] andalso not starl_mutex_holds:is_held(Token, Holds) of
        false -> used(Token, State);
        true -> State#state{idle = starl_obligations:owe_once(Token, team, T, Us, Idle)}
    end.

used(Token, #state{idle = Idle} = State) ->
    State#state{idle = starl_obligations:paid(Token, Idle)}.

waiting(Token, #state{open = Open}) ->
    lists:sort([Robot || {Of, Robot} <- maps:keys(Open), Of =:= Token]).

%% The tokens that have been idle for too long before `T'; each is reported once for a time as long.
lie_idle(T, #state{idle = Idle, faults = Faults} = State) ->
    case starl_obligations:overdue(T, Faults, Idle) of
        none ->
            {[], State};
        {Late, Left} ->
            Found = [
                violation(lies_idle, Due, waiting(Token, State), #{
                    token => Token, last => maps:get(Token, State#state.last, none)
                })
             || {Due, Token} <- Late, has_home(Token, State)
            ],
            {Found, State#state{
                idle = lists:foldl(
                    fun({_, Token}, Owed) -> again(Token, T, Owed, State) end, Left, Late
                ),
                found = State#state.found orelse Found =/= []
            }}
    end.

%% A token whose home has died is idle since then all the same.
again(Token, T, Owed, #state{idle = Idle, idle_us = Us} = State) ->
    Since =
        case has_home(Token, State) of
            true -> T;
            false -> starl_obligations:since(Token, Idle)
        end,
    starl_obligations:owe(Token, team, Since, T + Us - Since, Owed).

has_home(_Token, #state{died = []}) ->
    true;
has_home(_Token, #state{robots = []}) ->
    false;
has_home(Token, #state{robots = Robots, died = Died}) ->
    not lists:member(starl_mutex:home(Token, Robots), Died).

%%% The owners of tokens

%% What a robot has announced that is not its own.
owners(_Event, _T, _Robot, #state{announce_us = infinity} = State) ->
    {[], State};
owners({mutex, {granted, Token, Fence, To}}, _T, _Home, State) ->
    {[], confirmed({Token, To, starl_mutex_home:hand_over(Fence)}, State)};
owners({mutex, {acquired, Token, Fence}}, T, Robot, State) ->
    {[], holds({Token, Robot, starl_mutex_home:hand_over(Fence)}, T, State)};
owners({sap, {sent, _Id, To, mutex, Hash}}, T, Robot, #state{confirmed = Confirmed} = State) ->
    #state{robots = Team} = State,
    case Confirmed of
        #{Hash := {_, Robot, _} = HandOver} ->
            {[], announced(HandOver, State)};
        #{Hash := HandOver} when length(To) + 1 >= length(Team) ->
            false_owner(HandOver, T, Robot, State);
        #{} ->
            {[], lists:foldl(fun announced/2, State, due(Robot, Hash, State))}
    end;
owners({Machine, Event}, _T, Robot, State) ->
    case loses(Machine, Event) of
        true -> {[], excused(Robot, State)};
        false -> {[], State}
    end.

%% Once it may be another message with the same hash.
false_owner({Token, Owner, Fence}, T, Robot, #state{suspected = Suspected} = State) ->
    Details = #{token => Token, owner => Owner, fence => Fence},
    {
        [violation(false_owner, T, [Robot], Details) || is_map_key(Robot, Suspected)],
        State#state{suspected = Suspected#{Robot => true}}
    }.

loses(sap, {overload, mutex}) -> true;
loses(sap, {started, _}) -> true;
loses(robot, {died, _}) -> true;
loses(Machine, crashed) -> Machine =:= sap orelse Machine =:= mutex;
loses(robot, down) -> true;
loses(_Machine, _Event) -> false.

%% A robot that stalls announces a hand-over when many later ones have been confirmed.
due(Robot, Hash, #state{unannounced = Unannounced}) ->
    [
        HandOver
     || {_, {_, Owner, _} = HandOver} <- maps:keys(starl_obligations:sinces(Unannounced)),
        Owner =:= Robot,
        hash(HandOver) =:= Hash
    ].

hash({Token, _Owner, Fence}) -> erlang:phash2({owner, Token, Fence}).

confirmed({Token, _, _} = HandOver, #state{confirmed = Confirmed, latest = Latest} = State) ->
    Hash = hash(HandOver),
    Hashes = [Hash | lists:delete(Hash, maps:get(Token, Latest, []))],
    Kept = lists:sublist(Hashes, ?KEPT),
    State#state{
        confirmed = maps:without(Hashes -- Kept, Confirmed#{Hash => HandOver}),
        latest = Latest#{Token => Kept}
    }.

holds({Token, Robot, Fence} = HandOver, T, #state{announced = Announced} = State) ->
    #state{unannounced = Unannounced, announce_us = Us} = State,
    Known = is_map_key(hash(HandOver), State#state.confirmed),
    case Announced of
        #{{Robot, Token} := Fence} ->
            State;
        #{} when Known ->
            Owed = starl_obligations:owe({T, HandOver}, Robot, T, Us, Unannounced),
            State#state{unannounced = Owed};
        #{} ->
            State
    end.

announced({Token, Robot, Fence} = HandOver, #state{announced = Announced} = State) ->
    IsOf = fun({_HeldUs, Of}) -> Of =:= HandOver end,
    State#state{
        announced = Announced#{{Robot, Token} => Fence},
        unannounced = starl_obligations:dropped(IsOf, State#state.unannounced)
    }.

excused(Robot, #state{confirmed = Confirmed} = State) ->
    Own = [HandOver || {_, To, _} = HandOver <- maps:values(Confirmed), To =:= Robot],
    lists:foldl(fun announced/2, State, lists:sort(Own)).

%%% The clauses of progress

refused(T, Robot, Token, Reason, Since, #state{granted = true, from_us = From}) when
    is_integer(Since), Since >= From
->
    [violation(not_granted, T, [Robot], #{token => Token, reason => Reason})];
refused(_T, _Robot, _Token, _Reason, _Since, _State) ->
    [].

%%% Time

%% All that is overdue before `T'; what happens at exactly its bound is in time.
pass(T, State) ->
    {Waiting, Granted} = not_granted(T, State),
    {Idle, Busy} = lie_idle(T, Granted),
    {Unannounced, Current} = not_announced(T, Busy),
    {Waiting ++ Idle ++ Unannounced, Current}.

not_granted(T, #state{grants = Grants, faults = Faults} = State) ->
    case starl_obligations:overdue(T, Faults, Grants) of
        none ->
            {[], State};
        {Late, Left} ->
            {
                [
                    violation(no_grant_in_time, Due, [Robot], #{token => Token})
                 || {Due, {_, Token, Robot}} <- Late
                ],
                State#state{grants = Left}
            }
    end.

not_announced(T, #state{unannounced = Unannounced, assumption = Assumption} = State) ->
    case starl_obligations:overdue(T, Assumption, Unannounced) of
        none ->
            {[], State};
        {Late, Left} ->
            {
                [
                    violation(owner_not_announced, Due, [Robot], #{token => Token, fence => Fence})
                 || {Due, {_HeldUs, {Token, Robot, Fence}}} <- Late
                ],
                State#state{unannounced = Left}
            }
    end.

violation(What, T, Robots, Details) ->
    starl_violation:new(mutex, What, T, Robots, Details).
