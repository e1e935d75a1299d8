%% @doc The contract of the barrier, as a monitor.
%%
%% Safety: no robot passes round K of a name before all participants have reached it. A robot passes
%% only the round that it has reached last, each once. The round that it reaches is the one after
%% the last that it has passed, across all crashes and reboots.
%%
%% Only a robot whose store was set back, or was damaged when its barrier machine started, may go on
%% with another round, and only once. It may go on with one of these:
%%
%% (a) The round after the last that it has reached.
%%
%% (b) The last round that it has passed. Either its store was set back, or another robot's machine
%% has crashed, too, since it reached that round. (The crashed machine has forgotten the round, and
%% need not have heard of the next.)
%%
%% (c) An earlier round, if the stores of all robots were damaged.
%%
%% (d) A round that is not earlier than the latest that another robot has passed. This holds only if
%% its store was set back, and the machines of all others have crashed since it reached its last
%% round.
%%
%% A robot learns anew what all have surely reached when it passes a round. Until then its damage
%% counts for this.
%%
%% Progress: a robot that has reached a round passes it or fails within `bound_us' (default: none).
%% The time counts from the last participant's reaching the round, from the last fault that the team
%% meets meanwhile, and from the last crash of a barrier machine
%% ({@link starl_assumption:calm_us/3}). If not all reach the round, the robot need not pass it. In
%% a run, the bound follows from `retry_us', the radio and SAP ({@link context/2}). δ is the time
%% between the first and the last robot's passing. It is at most `delta_us' (default: none; in a run
%% it follows from the radio and SAP: a message and its acknowledgement). If the team has met a
%% fault since the first robot reached the round, the last robot passes at most `bound_us' after the
%% fault. A robot whose call has ended, because it failed or its machine crashed, need not pass
%% before it has reached or passed a round again. If a robot has died, no robot need pass: the
%% others may not have heard of the dead robot in time.
%%
%% Events of machine `barrier': {@link starl_barrier_rounds:event()}, `crashed', `store_damaged';
%% of machine `sap': `overload', `crashed'; of machine `robot': `died', `store_set_back'.
-module(starl_barrier_monitor).
-behaviour(starl_monitor).

-export([init/1, context/2, broken/2, step/2, finish/2]).
-export([interests/0, vocabulary/0, sometimes/0, timeless/1]).

-type name() :: term().

-type key() :: starl_barrier_monitor_memory:key().

%% A round that not all have passed: when the first and the last robot reached it, and when which robots
%% passed it.
-record(round, {
    begun_us = none :: integer() | none,
    complete_us = none :: integer() | none,
    first_us = none :: integer() | none,
    passed = 0 :: non_neg_integer()
}).

-record(state, {
    robots :: [starl:robot_id()],
    bound_us :: pos_integer() | infinity,
    delta_us :: pos_integer() | infinity,
    %% the highest and the last round reached, the last passed
    reached = #{} :: #{key() => non_neg_integer()},
    at = #{} :: #{key() => non_neg_integer()},
    passed = #{} :: #{key() => non_neg_integer()},
    %% what of it may be forgotten
    memory = starl_barrier_monitor_memory:new() :: starl_barrier_monitor_memory:t(),
    rounds = #{} :: #{{name(), K :: pos_integer()} => #round{}},
    %% whose call has ended since it reached its last round of the name
    excused = [] :: [key()],
    faults :: starl_assumption:t(),
    is_whole = true :: boolean(),
    %% of the rounds that all have passed
    deltas = {0, 0, 0} :: {Count :: integer(), SumUs :: integer(), LongestUs :: integer()},
    passes = 0 :: non_neg_integer(),
    %% the robots that have waited for a round until their patience was over
    vain = #{} :: #{{name(), K :: pos_integer()} => [starl:robot_id(), ...]},
    failed = 0 :: non_neg_integer(),
    %% machines that started with a damaged store, and stores that were set back
    damaged = 0 :: non_neg_integer(),
    set_back = 0 :: non_neg_integer()
}).

%% Clocks are within 1 % of real time.
-define(DRIFT_PPM, 10000).
%% The time of the robots' own steps.
-define(MARGIN_US, 1000000).
-define(STEPS_US, 10000).

%% @doc `robots': the participants; `faults': the windows of all faults; the other keys: see above.
-spec init(#{
    robots := [starl:robot_id()],
    faults => [starl_assumption:window()],
    bound_us => pos_integer() | infinity,
    delta_us => pos_integer() | infinity
}) -> #state{}.
init(#{robots := Robots} = Config) ->
    #state{
        robots = Robots,
        faults = starl_assumption:new(maps:get(faults, Config, []), ?DRIFT_PPM),
        bound_us = maps:get(bound_us, Config, infinity),
        delta_us = maps:get(delta_us, Config, infinity)
    }.

%% @doc The configuration with the windows of all faults, and with a bound, if `retry_us', the time
%% after which a waiting robot asks again, is given: an announcement may have been given up just
%% before, so a robot waits until it asks again, asks, and is answered; and so does the one that it
%% asks, which must know of it.
-spec context(starl_monitor:known(), map()) -> map().
context(#{faults := Faults, slack_us := Slack} = Known, Config) ->
    Told = maps:merge(#{faults => Faults}, Config),
    case bound(Known, Told) of
        Bound when is_integer(Bound) ->
            maps:merge(Told#{bound_us => Bound + Slack}, delta(Known, Bound, Told));
        _ ->
            Told
    end.

%% When the first robot passes, all have sent that they have reached the round. Where SAP may give that up, a
%% robot has to ask again.
delta(#{slack_us := Slack}, _Bound, #{delta_us := Delta}) ->
    #{delta_us => Delta + Slack};
delta(#{sap := Sap, loss := Loss, delay_us := Delay, slack_us := Slack}, Bound, #{retry_us := _}) ->
    case starl_sap_schedule:reach_us(Sap, 1 - (1 - Loss) * (1 - Loss), 2 * Delay, never) of
        never -> #{delta_us => Bound + Slack};
        Reach -> #{delta_us => min(Bound, Reach + ?STEPS_US) + Slack}
    end;
delta(_Known, _Bound, _Told) ->
    #{}.

bound(_Known, #{bound_us := Bound}) ->
    Bound;
bound(#{sap := Sap, loss := Loss, delay_us := Delay}, #{retry_us := Retry}) ->
    case starl_sap_schedule:reach_us(Sap, Loss, Delay, Retry) of
        never -> infinity;
        Reach -> 2 * (Retry * 101 div 100 + 2 * Reach) + ?MARGIN_US
    end;
bound(_Known, _Config) ->
    infinity.

%% @doc The window excuses what it meets.
-spec broken(starl_assumption:window(), #state{}) -> #state{}.
broken(Window, #state{faults = Faults} = State) ->
    State#state{faults = starl_assumption:broken(Window, Faults)}.

%% @doc The barrier machines' own events, what is not sent, and the end of robots.
-spec interests() -> [atom()].
interests() -> [barrier, sap, robot].

%% @doc {@link starl_barrier_rounds:event()}.
-spec vocabulary() -> starl_event:vocabulary().
vocabulary() -> #{barrier => [{reached, 2}, {passed, 2}, {recalled, 3}, {failed, 3}]}.

%% @doc A robot goes on with a damaged store, or with an old one.
-spec sometimes() -> [{atom(), owed | seldom}].
sometimes() -> [{damaged_store, owed}, {store_set_back, owed}].

%% @doc The rounds that each robot has reached and passed; without `bound_us' and `delta_us' nothing
%% else is judged. The checker damages no store, so the others' forgetting makes no difference.
-spec timeless(#state{}) -> term().
timeless(#state{reached = Reached, at = At, passed = Passed, memory = Memory}) ->
    {Reached, At, Passed, starl_barrier_monitor_memory:damages(Memory)}.

%% @doc Judges one event.
-spec step(starl_monitor:trace_event(), #state{}) ->
    {ok, #state{}} | {violation, starl_monitor:violation(), #state{}}.
step({T, Robot, Machine, Event}, State) ->
    {Broken, Next} = judge({Machine, Event}, T, Robot, State),
    starl_violation:step(Broken, Next).

%% @doc Judges the time until `EndTimeUs'. Results: `rounds' passed by all, `passed' and
%% `failed' calls, the longest and the mean δ (first to last pass of a round); `missed': the rounds that some
%% have waited for in vain, and the robots that have not come.
-spec finish(integer(), #state{}) ->
    {ok | {violation, [starl_monitor:violation(), ...]}, starl_monitor:results()}.
finish(EndTimeUs, #state{deltas = {Count, Sum, Longest}} = State) ->
    Results = starl_unjudged:with(unjudged(EndTimeUs, State), #{
        rounds => Count,
        passed => State#state.passes,
        failed => State#state.failed,
        longest_delta_us => Longest,
        mean_delta_us => Sum / max(1, Count),
        missed => missed(State),
        sometimes => #{
            damaged_store => State#state.damaged, store_set_back => State#state.set_back
        }
    }),
    starl_violation:finish(overdue(EndTimeUs, State), Results).

unjudged(_EndUs, #state{bound_us = infinity}) ->
    [];
unjudged(EndUs, #state{bound_us = Bound, faults = Faults}) ->
    starl_unjudged:excused("all pass", Bound, EndUs, Faults).

judge({barrier, {reached, Name, K}}, T, Robot, State) ->
    {skipped(T, Robot, Name, K, State), reach(T, Robot, Name, K, State)};
judge({barrier, {passed, Name, K}}, T, Robot, State) ->
    Broken =
        early(T, Robot, Name, K, State) ++
            out_of_order(T, Robot, Name, K, State) ++
            too_late(T, Robot, Name, K, State) ++
            late(T, Robot, Name, K, State),
    {Broken, pass(T, Robot, Name, K, State)};
judge({barrier, {recalled, Name, At, Passed}}, T, Robot, State) ->
    recalled(T, Robot, Name, {At, Passed}, State);
judge({barrier, {failed, Name, K, Reason}}, T, Robot, #state{failed = Failed} = State) ->
    Vain = waited(Reason, {Name, K}, Robot, State#state.vain),
    Next = State#state{failed = Failed + 1, vain = Vain},
    {too_late(T, Robot, Name, K, State), excuse([{Name, Robot}], Next)};
judge({barrier, crashed}, T, Robot, State) ->
    {[], crashed(T, Robot, State)};
judge({sap, {overload, barrier}}, T, Robot, State) ->
    {[], fault(T, Robot, State)};
judge({Lost, How}, T, Robot, State) when
    {Lost, How} =:= {sap, crashed}; {Lost, How} =:= {robot, down}
->
    {[], begins_anew(T, Robot, State)};
judge({barrier, store_damaged}, _T, Robot, #state{damaged = Count} = State) ->
    Damaged = remembers(fun starl_barrier_monitor_memory:damaged/3, Robot, State),
    {[], Damaged#state{damaged = Count + 1}};
judge({robot, store_set_back}, _T, Robot, #state{set_back = Count} = State) ->
    Back = remembers(fun starl_barrier_monitor_memory:set_back/3, Robot, State),
    {[], Back#state{set_back = Count + 1}};
judge({robot, {died, _Reason}}, _T, Robot, State) ->
    {[], excuse(keys(Robot, State), State#state{is_whole = false})};
judge({_Machine, _Other}, _T, _Robot, State) ->
    {[], State}.

waited(timeout, Round, Robot, Vain) ->
    Vain#{Round => lists:usort([Robot | maps:get(Round, Vain, [])])};
waited(restarted, _Round, _Robot, Vain) ->
    Vain.

missed(#state{vain = Vain} = State) ->
    [
        #{name => Name, round => K, absent => Absent, waited => Waited}
     || {{Name, K}, Waited} <- lists:sort(maps:to_list(Vain)),
        [_ | _] = Absent <- [absent(Name, K, State)]
    ].

crashed(T, Robot, State) ->
    Forgets = remembers(fun starl_barrier_monitor_memory:crashed/3, Robot, State),
    fault(T, Robot, excuse(keys(Robot, State), Forgets)).

%% What a machine has stored and not told, since its life has ended in that step, counts from now. One
%% of two stores in a step is told. But a round that counts as passed since the store was damaged, or set
%% back, may have been skipped, and nobody was told that all have reached it: it is no pass.
recalled(T, Robot, Name, {K, Passed}, State) ->
    Key = {Name, Robot},
    Reached = K > maps:get(Key, State#state.reached, 0),
    Left =
        Passed =:= maps:get(Key, State#state.at, 0) andalso
            Passed =/= maps:get(Key, State#state.passed, 0) andalso
            not starl_barrier_monitor_memory:is_unsound(Key, State#state.memory),
    case {Reached, Left} of
        %% whoever called has been told of the crash, and need not pass
        {true, _} ->
            {Found, Next} = judge({barrier, {reached, Name, K}}, T, Robot, State),
            {Found, excuse([Key], Next)};
        {false, true} ->
            judge({barrier, {passed, Name, Passed}}, T, Robot, State);
        {false, false} ->
            {[], State}
    end.

keys(Robot, #state{reached = Reached}) -> [Key || {_, R} = Key <- maps:keys(Reached), R =:= Robot].

excuse(Keys, #state{excused = Excused} = State) ->
    State#state{excused = lists:usort(Keys ++ Excused)}.

excuse_no_more(Key, #state{excused = Excused} = State) ->
    State#state{excused = lists:delete(Key, Excused)}.

fault(T, Robot, #state{faults = Faults} = State) ->
    State#state{faults = starl_assumption:broken({Robot, T, T, fault}, Faults)}.

%% Others ask a robot that has begun anew for its number, before they take its first messages.
begins_anew(T, Robot, #state{faults = Faults} = State) ->
    Window = {Robot, T, T + starl_sap_schedule:settled_us(), fault},
    State#state{faults = starl_assumption:broken(Window, Faults)}.

%% Something has happened to a robot, and to what is known of the rounds reached.
remembers(Happens, Robot, #state{memory = Memory, reached = Reached} = State) ->
    State#state{memory = Happens(Robot, maps:keys(Reached), Memory)}.

reach(T, Robot, Name, K, #state{reached = Reached, passed = Passed} = State) ->
    Key = {Name, Robot},
    Next = (excuse_no_more(Key, State))#state{
        reached = Reached#{Key => max(K, maps:get(Key, Reached, 0))},
        at = (State#state.at)#{Key => K},
        %% a round that was skipped counts as passed, one that comes again does not
        passed = Passed#{Key => K - 1},
        memory = starl_barrier_monitor_memory:reached(Key, State#state.memory),
        rounds = begun_again(Name, K, K < maps:get(Key, State#state.at, 0), State#state.rounds)
    },
    Round = begun(T, round_of(Name, K, Next)),
    case Round#round.complete_us =:= none andalso is_complete(Name, K, Next) of
        true -> put_round(Name, K, Round#round{complete_us = T}, Next);
        false -> put_round(Name, K, Round, Next)
    end.

begun(T, #round{begun_us = none} = Round) -> Round#round{begun_us = T};
begun(_T, Round) -> Round.

%% A robot that reaches a round again, because stores were damaged, begins that round and all later ones anew: it
%% completes none of them before, and no time of before counts.
begun_again(_Name, _K, false, Rounds) ->
    Rounds;
begun_again(Name, K, true, Rounds) ->
    maps:filter(fun({N, Of}, _) -> N =/= Name orelse Of < K end, Rounds).

is_complete(Name, K, #state{robots = Robots, at = At}) ->
    lists:all(fun(R) -> maps:get({Name, R}, At, 0) >= K end, Robots).

pass(T, Robot, Name, K, #state{passed = Passed, passes = Passes, robots = Robots} = State) ->
    #round{passed = N, first_us = First} = Round = round_of(Name, K, State),
    Key = {Name, Robot},
    Next = (excuse_no_more(Key, State))#state{
        passed = Passed#{Key => K},
        passes = Passes + 1,
        memory = starl_barrier_monitor_memory:passed(Key, State#state.memory)
    },
    case {N + 1 =:= length(Robots), First} of
        {true, none} ->
            close(Name, K, 0, Next);
        {true, _} ->
            close(Name, K, T - First, Next);
        {false, none} ->
            put_round(Name, K, Round#round{passed = 1, first_us = T}, Next);
        {false, _} ->
            put_round(Name, K, Round#round{passed = N + 1}, Next)
    end.

close(Name, K, Delta, #state{rounds = Rounds, deltas = {Count, Sum, Longest}} = State) ->
    State#state{
        rounds = maps:remove({Name, K}, Rounds),
        deltas = {Count + 1, Sum + Delta, max(Delta, Longest)}
    }.

round_of(Name, K, #state{rounds = Rounds}) -> maps:get({Name, K}, Rounds, #round{}).

put_round(Name, K, Round, #state{rounds = Rounds} = State) ->
    State#state{rounds = Rounds#{{Name, K} => Round}}.

absent(Name, K, #state{robots = Robots, reached = Reached}) ->
    [R || R <- Robots, maps:get({Name, R}, Reached, 0) < K].

%%% The clauses of the contract

early(T, Robot, Name, K, State) ->
    Absent = absent(Name, K, State),
    [
        violation(passed_early, T, [Robot], #{name => Name, round => K, absent => Absent})
     || Absent =/= []
    ].

out_of_order(T, Robot, Name, K, #state{passed = Passed, at = At} = State) ->
    Key = {Name, Robot},
    Last = maps:get(Key, Passed, 0),
    Reached = maps:get(Key, State#state.reached, 0),
    [
        violation(passed_out_of_order, T, [Robot], #{name => Name, round => K, last => Last})
     || K =< Last orelse K =/= maps:get(Key, At, 0),
        %% the store of a robot that was set back may say that it has reached the round, and not passed it
        K > Reached orelse not may_be_next(K, Last, Reached, Key, State)
    ].

skipped(T, Robot, Name, K, #state{passed = Passed, reached = Reached} = State) ->
    Key = {Name, Robot},
    Last = maps:get(Key, Passed, 0),
    [
        violation(reached_out_of_order, T, [Robot], #{name => Name, round => K, passed => Last})
     || K =/= Last + 1, not may_be_next(K, Last, maps:get(Key, Reached, 0), Key, State)
    ].

%% With what may be forgotten.
may_be_next(
    K, Last, Reached, {Name, Robot} = Key, #state{robots = Robots, passed = Passed} = State
) ->
    Others = [{R, maps:get({Name, R}, Passed, 0)} || R <- Robots, R =/= Robot],
    Doubt = starl_barrier_monitor_memory:doubt(Key, Others, State#state.memory),
    starl_barrier_monitor_memory:may_be_next(Doubt, K, Last, Reached).

late(T, Robot, Name, K, #state{delta_us = Delta, excused = Excused} = State) ->
    case round_of(Name, K, State) of
        #round{first_us = First} = Round when is_integer(First), T - First > Delta ->
            [
                violation(late_pass, T, [Robot], #{name => Name, round => K, after_us => T - First})
             || not lists:member({Name, Robot}, Excused), last_us(T, Round, State) < T
            ];
        #round{} ->
            []
    end.

%% The latest time at which the last robot passes. What was sent during a fault may be under way after it, and
%% who has died, or forgotten it, acknowledges nothing: then it follows from the bound, if there is one. An
%% atom is greater than every number.
last_us(_T, #round{first_us = First}, #state{bound_us = infinity, delta_us = Delta}) ->
    First + Delta;
last_us(_T, _Round, #state{is_whole = false}) ->
    infinity;
last_us(T, #round{begun_us = Begun, first_us = First}, #state{faults = Faults} = State) ->
    #state{delta_us = Delta, bound_us = Bound} = State,
    case Begun =/= none andalso starl_assumption:is_kept(Begun, T, Faults) of
        true -> First + Delta;
        false -> max(First + Delta, starl_assumption:calm_us(First, Bound, Faults))
    end.

%% Judged when a robot passes or fails, and at the end: the rounds that all have reached long ago and not all
%% have passed.
too_late(T, Robot, Name, K, #state{excused = Excused} = State) ->
    [
        violation(not_passed, Due, [Robot], #{name => Name, round => K})
     || Due <- overdue_since(T, round_of(Name, K, State), State),
        not lists:member({Name, Robot}, Excused)
    ].

overdue(End, #state{rounds = Rounds} = State) ->
    [
        violation(not_passed, Due, Waiting, #{name => Name, round => K})
     || {{Name, K}, Round} <- lists:sort(maps:to_list(Rounds)),
        Due <- overdue_since(End, Round, State),
        Waiting <- [waiting(Name, K, State)],
        Waiting =/= []
    ].

overdue_since(_T, _Round, #state{bound_us = infinity}) ->
    [];
overdue_since(
    T, #round{complete_us = Complete}, #state{bound_us = Bound, is_whole = true} = State
) when
    is_integer(Complete), Complete + Bound < T
->
    [Due || Due <- [starl_assumption:calm_us(Complete, Bound, State#state.faults)], Due < T];
overdue_since(_T, _Round, _State) ->
    [].

waiting(Name, K, #state{robots = Robots, at = At, passed = Passed, excused = Excused}) ->
    [
        R
     || R <- Robots,
        not lists:member({Name, R}, Excused),
        maps:get({Name, R}, At, 0) =:= K,
        maps:get({Name, R}, Passed, 0) < K
    ].

violation(What, T, Robots, Details) ->
    starl_violation:new(barrier, What, T, Robots, Details).
