%% @doc The contract of the barrier, as a monitor.
%%
%% Safety: no robot passes round K of a name before all participants have reached it; a robot
%% passes only the round that it has reached last, each once; the round that it reaches is the
%% one after the last that it has passed, across all crashes and reboots.
%%
%% Only a robot whose store was damaged when its barrier machine started, or set back, may go on with another
%% round, once: with the one after the last that it has reached; with the last that it has
%% passed, if its store was set back, or another robot's machine has crashed, too, since it reached
%% that one (the one that crashed has forgotten that round, and need not have heard of the next); or with an earlier one,
%% if the stores of all robots were damaged.
%%
%% Progress: a robot that has reached a round passes it or fails within `bound_us' (default: none)
%% of the last participant's reaching it; if not all reach it, it need not pass. `delta_us'
%% (default: none) bounds the time between the first and the last robot's passing. A robot that died
%% or whose barrier machine crashed may take longer.
%%
%% Events of machine `barrier': {@link starl_barrier_rounds:event()}, `crashed', `store_damaged';
%% of machine `robot': `died', `store_set_back'.
-module(starl_barrier_monitor).
-behaviour(starl_monitor).

-export([init/1, context/2, broken/2, step/2, finish/2, interests/0, vocabulary/0, timeless/1]).

-type robot_id() :: starl_monitor:robot_id().
-type name() :: term().

-type key() :: {name(), robot_id()}.

%% The damage since a round was reached: another robot may have forgotten its count of this one; or
%% had so when the round was reached, and need not know of it before it is passed; or this one's
%% store is damaged, and the other may have forgotten, too; or all stores are damaged.
-type doubt() :: forgotten | untold | damaged | damaged_and_forgotten | lost.

%% A round that not all have passed: when the last robot reached it, and when which robots
%% passed it.
-record(round, {
    complete_us = none :: integer() | none,
    first_us = none :: integer() | none,
    passed = 0 :: non_neg_integer()
}).

-record(state, {
    robots :: [robot_id()],
    bound_us :: pos_integer() | infinity,
    delta_us :: pos_integer() | infinity,
    %% the highest and the last round reached, the last passed
    reached = #{} :: #{key() => non_neg_integer()},
    at = #{} :: #{key() => non_neg_integer()},
    passed = #{} :: #{key() => non_neg_integer()},
    %% what has happened since the last round was reached
    doubts = #{} :: #{key() => doubt()},
    rounds = #{} :: #{{name(), K :: pos_integer()} => #round{}},
    excused = [] :: [robot_id()],
    %% of the rounds that all have passed
    deltas = {0, 0, 0} :: {Count :: integer(), SumUs :: integer(), LongestUs :: integer()},
    passes = 0 :: non_neg_integer(),
    failed = 0 :: non_neg_integer()
}).

%% @doc `robots': the participants; the other keys: see above.
-spec init(#{
    robots := [robot_id()],
    bound_us => pos_integer() | infinity,
    delta_us => pos_integer() | infinity
}) -> #state{}.
init(#{robots := Robots} = Config) ->
    #state{
        robots = Robots,
        bound_us = maps:get(bound_us, Config, infinity),
        delta_us = maps:get(delta_us, Config, infinity)
    }.

%% @doc Faults of clocks and processes widen the bound.
-spec context(starl_monitor:known(), map()) -> map().
context(#{slack_us := Slack}, #{bound_us := Bound} = Config) when is_integer(Bound) ->
    Config#{bound_us := Bound + Slack};
context(_Known, Config) ->
    Config.

%% @doc The window widens the bound.
-spec broken(starl_assumption:window(), #state{}) -> #state{}.
broken({_, From, To, _}, #state{bound_us = Bound} = State) when is_integer(Bound) ->
    State#state{bound_us = Bound + To - From};
broken(_Window, State) ->
    State.

%% @doc The barrier machines' own events and the end of robots.
-spec interests() -> [atom()].
interests() -> [barrier, robot].

%% @doc {@link starl_barrier_rounds:event()}.
-spec vocabulary() -> starl_event:vocabulary().
vocabulary() -> #{barrier => [{reached, 2}, {passed, 2}, {recalled, 3}, {failed, 3}]}.

%% @doc The rounds that each robot has reached and passed; without `bound_us' and `delta_us' nothing
%% else is judged. The checker damages no store, so the others' forgetting makes no difference.
-spec timeless(#state{}) -> term().
timeless(#state{reached = Reached, at = At, passed = Passed, doubts = Doubts}) ->
    {Reached, At, Passed, maps:filter(fun(_Key, Doubt) -> is_damage(Doubt) end, Doubts)}.

%% @doc Judges one event.
-spec step(starl_monitor:trace_event(), #state{}) ->
    {ok, #state{}} | {violation, starl_monitor:violation(), #state{}}.
step({T, Robot, Machine, Event}, State) ->
    case judge({Machine, Event}, T, Robot, State) of
        {[], Next} -> {ok, Next};
        {[First | _], Next} -> {violation, First, Next}
    end.

%% @doc Judges the time until `EndTimeUs'. Results: `rounds' passed by all, `passed' and
%% `failed' calls, the longest and the mean δ (first to last pass of a round).
-spec finish(integer(), #state{}) ->
    {ok | {violation, [starl_monitor:violation(), ...]}, starl_monitor:results()}.
finish(EndTimeUs, #state{deltas = {Count, Sum, Longest}} = State) ->
    Results = #{
        rounds => Count,
        passed => State#state.passes,
        failed => State#state.failed,
        longest_delta_us => Longest,
        mean_delta_us => Sum / max(1, Count)
    },
    case overdue(EndTimeUs, State) of
        [] -> {ok, Results};
        Late -> {{violation, Late}, Results}
    end.

judge({barrier, {reached, Name, K}}, T, Robot, State) ->
    {skipped(T, Robot, Name, K, State), reach(T, Robot, Name, K, State)};
judge({barrier, {passed, Name, K}}, T, Robot, State) ->
    Broken =
        early(T, Robot, Name, K, State) ++
            out_of_order(T, Robot, Name, K, State) ++
            late(T, Robot, Name, K, State),
    {Broken, pass(T, Robot, Name, K, State)};
judge({barrier, {recalled, Name, At, Passed}}, T, Robot, State) ->
    recalled(T, Robot, Name, {At, Passed}, State);
judge({barrier, {failed, _Name, _K, _Reason}}, _T, Robot, #state{failed = Failed} = State) ->
    {[], excuse(Robot, State#state{failed = Failed + 1})};
judge({barrier, crashed}, _T, Robot, State) ->
    {[], excuse(Robot, forgets(Robot, State))};
judge({barrier, store_damaged}, _T, Robot, State) ->
    {[], damage(Robot, State)};
judge({robot, store_set_back}, _T, Robot, State) ->
    %% it gives a round back as reached and not passed, if nobody knows of a later life
    Back = damage(Robot, State),
    {[], doubt(fun(R) -> R =:= Robot end, fun forgotten/1, Back)};
judge({robot, {died, _Reason}}, _T, Robot, State) ->
    {[], excuse(Robot, State)};
judge({_Machine, _Other}, _T, _Robot, State) ->
    {[], State}.

%% What a machine has stored and not told, since its life has ended in that step, counts from now. One
%% of two stores in a step is told.
recalled(T, Robot, Name, {K, Passed}, State) ->
    Key = {Name, Robot},
    Reached = K > maps:get(Key, State#state.reached, 0),
    Left =
        Passed =:= maps:get(Key, State#state.at, 0) andalso
            Passed =/= maps:get(Key, State#state.passed, 0),
    case {Reached, Left} of
        {true, _} -> judge({barrier, {reached, Name, K}}, T, Robot, State);
        {false, true} -> judge({barrier, {passed, Name, Passed}}, T, Robot, State);
        {false, false} -> {[], State}
    end.

excuse(Robot, #state{excused = Excused} = State) ->
    State#state{excused = lists:usort([Robot | Excused])}.

%% A machine that crashed has forgotten the others' counts.
forgets(Robot, State) ->
    doubt(fun(R) -> R =/= Robot end, fun forgotten/1, State).

forgotten(Doubt) when Doubt =:= none; Doubt =:= forgotten; Doubt =:= untold -> forgotten;
forgotten(lost) -> lost;
forgotten(_Damaged) -> damaged_and_forgotten.

damage(Robot, State) ->
    Damaged = doubt(fun(R) -> R =:= Robot end, fun damaged/1, State),
    Doubts = Damaged#state.doubts,
    Sound = [Key || Key <- maps:keys(State#state.reached), not is_damaged(Key, Doubts)],
    Lost = [Key || {Name, _} = Key <- maps:keys(Doubts), not lists:keymember(Name, 1, Sound)],
    Damaged#state{doubts = maps:merge(Doubts, maps:from_keys(Lost, lost))}.

damaged(none) -> damaged;
damaged(Doubt) when Doubt =:= forgotten; Doubt =:= untold -> damaged_and_forgotten;
damaged(Damaged) -> Damaged.

is_damaged(Key, Doubts) -> is_damage(maps:get(Key, Doubts, none)).

is_damage(Doubt) -> not lists:member(Doubt, [none, forgotten, untold]).

%% A robot that has forgotten the last round need not have heard of the one that is reached now.
reached_with(none) -> none;
reached_with(damaged) -> none;
reached_with(_Forgotten) -> untold.

%% A robot passes a round when all others have heard that it has reached it.
passed_with(untold) -> none;
passed_with(Doubt) -> Doubt.

change(Key, Change, Doubts) ->
    case Change(maps:get(Key, Doubts, none)) of
        none -> maps:remove(Key, Doubts);
        Doubt -> Doubts#{Key => Doubt}
    end.

doubt(Concerns, Grow, #state{reached = Reached, doubts = Doubts} = State) ->
    Concerned = [Key || {_, Robot} = Key <- maps:keys(Reached), Concerns(Robot)],
    Grown = maps:from_list([{Key, Grow(maps:get(Key, Doubts, none))} || Key <- Concerned]),
    State#state{doubts = maps:merge(Doubts, Grown)}.

reach(T, Robot, Name, K, #state{reached = Reached, passed = Passed} = State) ->
    Key = {Name, Robot},
    Next = State#state{
        reached = Reached#{Key => max(K, maps:get(Key, Reached, 0))},
        at = (State#state.at)#{Key => K},
        %% a round that was skipped counts as passed, one that comes again does not
        passed = Passed#{Key => K - 1},
        doubts = change(Key, fun reached_with/1, State#state.doubts)
    },
    Round = round_of(Name, K, Next),
    case Round#round.complete_us =:= none andalso absent(Name, K, Next) =:= [] of
        true -> put_round(Name, K, Round#round{complete_us = T}, Next);
        false -> put_round(Name, K, Round, Next)
    end.

pass(T, Robot, Name, K, #state{passed = Passed, passes = Passes, robots = Robots} = State) ->
    #round{passed = N, first_us = First} = Round = round_of(Name, K, State),
    Key = {Name, Robot},
    Next = State#state{
        passed = Passed#{Key => K},
        passes = Passes + 1,
        doubts = change(Key, fun passed_with/1, State#state.doubts)
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

out_of_order(T, Robot, Name, K, #state{passed = Passed, at = At, doubts = Doubts} = State) ->
    Key = {Name, Robot},
    Last = maps:get(Key, Passed, 0),
    Reached = maps:get(Key, State#state.reached, 0),
    %% the store of a robot that was set back may say that it has reached the round, and not passed it
    Again = K =< Reached andalso may_be_next(maps:get(Key, Doubts, none), K, Last, Reached),
    [
        violation(passed_out_of_order, T, [Robot], #{name => Name, round => K, last => Last})
     || not Again, K =< Last orelse K =/= maps:get(Key, At, 0)
    ].

skipped(T, Robot, Name, K, #state{passed = Passed, reached = Reached, doubts = Doubts}) ->
    Key = {Name, Robot},
    Last = maps:get(Key, Passed, 0),
    Doubt = maps:get(Key, Doubts, none),
    [
        violation(reached_out_of_order, T, [Robot], #{name => Name, round => K, passed => Last})
     || K =/= Last + 1, not may_be_next(Doubt, K, Last, maps:get(Key, Reached, 0))
    ].

may_be_next(lost, K, _Last, Reached) -> K =< Reached + 1;
may_be_next(damaged_and_forgotten, K, Last, Reached) -> K >= Last andalso K =< Reached + 1;
may_be_next(damaged, K, Last, Reached) -> K > Last andalso K =< Reached + 1;
may_be_next(_Sound, _K, _Last, _Reached) -> false.

late(T, Robot, Name, K, #state{delta_us = Delta, excused = Excused} = State) ->
    case round_of(Name, K, State) of
        #round{first_us = First} when is_integer(First), T - First > Delta ->
            [
                violation(late_pass, T, [Robot], #{name => Name, round => K, after_us => T - First})
             || not lists:member(Robot, Excused)
            ];
        #round{} ->
            []
    end.

%% Judged at the end: the rounds that all have reached long ago and not all have passed.
overdue(_End, #state{bound_us = infinity}) ->
    [];
overdue(End, #state{rounds = Rounds, bound_us = Bound} = State) ->
    [
        violation(not_passed, Complete + Bound, Waiting, #{name => Name, round => K})
     || {{Name, K}, #round{complete_us = Complete}} <- lists:sort(maps:to_list(Rounds)),
        is_integer(Complete),
        Complete + Bound < End,
        Waiting <- [waiting(Name, K, State)],
        Waiting =/= []
    ].

waiting(Name, K, #state{robots = Robots, passed = Passed, excused = Excused}) ->
    [R || R <- Robots -- Excused, maps:get({Name, R}, Passed, 0) < K].

violation(What, T, Robots, Details) ->
    #{contract => barrier, what => What, at_us => T, robots => Robots, details => Details}.
