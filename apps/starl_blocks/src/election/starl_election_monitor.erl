%% @doc The contract of the election by randomized ballots, as a monitor.
%%
%% Safety: any two robots that elect in the same election elect the same leader, and each only one.
%% The leader took part and has cast a ballot. A robot has at most one ballot per election, even
%% across restarts and the loss of its store. A robot that entered elects or fails within
%% `bound_us', unless it died. It may be later only by what its own clock, pauses and slowness
%% explain in that time ({@link starl_assumption:delayed_us/5}). With `complete' (default false) an
%% election by `all_ballots' also needs a ballot of every robot named in the configuration.
%%
%% An announcement elects. A robot that is electing when the announcement of a leader is delivered
%% to it has elected within `step_us' (default 1 s). It may be later by what its own pauses and
%% slowness explain. This holds whatever happens to ballots and to the other links.
%%
%% Progress, with `settle_us' (default infinity; in a run it follows from the radio and from
%% `again_us', the time after which a robot asks again, see {@link context/2}). Every robot that is
%% electing when the last ballot is cast has elected at most `settle_us' after it, and after the
%% last fault that the team meets meanwhile ({@link starl_assumption:calm_us/3}). So it must have
%% kept the ballots that came before it took part itself. The election is no longer judged once a
%% robot that had cast its ballot has died, has lost its machine in a crash, or has failed after a
%% fault. Such a robot need not send its ballot again, not even to a robot that has lost it in a
%% crash or was away after a crash.
%%
%% Events of machine `election': {@link starl_election_ballots:event()}, `crashed'; of machine `sap':
%% `delivered', `crashed'; of machine `robot': `died'. Entering again, after a restart, starts the bound afresh.
-module(starl_election_monitor).
-behaviour(starl_monitor).

-export([init/1, context/2, broken/2, step/2, finish/2, interests/0, vocabulary/0, timeless/1]).

-type election() :: term().
-type owed(Key) :: starl_obligations:t(Key).
%% Ballots cast, and each robot's leader.
-type tally() :: {
    Ballots :: #{starl:robot_id() => term()}, Elected :: #{starl:robot_id() => starl:robot_id()}
}.

%% A robot's patience is one timer of its own; it enters, is told by the timer, and reports.
-define(STEPS, 3).
%% Clocks are within 1 % of real time.
-define(DRIFT_PPM, 10000).
%% The time of the robots' own steps.
-define(MARGIN_US, 1000000).

-record(state, {
    robots :: [starl:robot_id()],
    bound_us :: pos_integer(),
    complete :: boolean(),
    settle_us :: pos_integer() | infinity,
    step_us :: pos_integer(),
    elections = #{} :: #{election() => tally()},
    %% The robots that are still electing.
    open = starl_obligations:new({delayed, ?STEPS}) :: owed({election(), starl:robot_id()}),
    assumption :: starl_assumption:t(),
    faults :: starl_assumption:t(),
    forgotten = #{} :: #{election() => []},
    %% The last crash of each robot's machine, and when the robot has taken part again.
    away = #{} :: #{starl:robot_id() => {CrashUs :: integer(), BackUs :: integer() | infinity}},
    %% The robots that were electing when the last ballot was cast.
    settling = starl_obligations:new(anew) :: owed({election(), starl:robot_id()}),
    %% By the hash of its announcement, what has been decided; and who heard of it while it was electing.
    decided = #{} :: #{non_neg_integer() => {election(), starl:robot_id()}},
    informed = starl_obligations:new({delayed, ?STEPS}) ::
        owed({starl:robot_id(), election(), Leader :: starl:robot_id(), AtUs :: integer()}),
    failed = 0 :: non_neg_integer()
}).

%% @doc `robots': the team; `bound_us': the longest time from entering to the result;
%% `broken': the windows of broken assumptions, `faults': those of all faults.
-spec init(#{
    robots := [starl:robot_id()],
    bound_us := pos_integer(),
    broken => [starl_assumption:window()],
    faults => [starl_assumption:window()],
    complete => boolean(),
    settle_us => pos_integer() | infinity,
    step_us => pos_integer()
}) -> #state{}.
init(#{robots := Robots, bound_us := Bound} = Config) ->
    #state{
        robots = Robots,
        bound_us = Bound,
        assumption = starl_assumption:new(maps:get(broken, Config, []), ?DRIFT_PPM),
        faults = starl_assumption:new(maps:get(faults, Config, []), ?DRIFT_PPM),
        complete = maps:get(complete, Config, false),
        settle_us = maps:get(settle_us, Config, infinity),
        step_us = maps:get(step_us, Config, ?MARGIN_US)
    }.

%% @doc The configuration with the windows of broken assumptions and of all faults; the bounds are longer
%% on a computer that has other work, too. A robot that misses ballots waits until it asks again, asks,
%% and is answered; the last ballot itself may be on its way at first.
-spec context(starl_monitor:known(), map()) -> map().
context(#{broken := Broken, faults := Faults, slack_us := Slack} = Known, Config) ->
    #{bound_us := Bound} = Config,
    Longer = Config#{
        bound_us := Bound + Slack, step_us => maps:get(step_us, Config, ?MARGIN_US) + Slack
    },
    Told = maps:merge(#{broken => Broken, faults => Faults}, Longer),
    case settle_us(Known, Config) of
        Settle when is_integer(Settle) -> Told#{settle_us => Settle + Slack};
        _ -> Told
    end.

settle_us(_Known, #{settle_us := Settle}) ->
    Settle;
settle_us(#{sap := Sap, loss := Loss, delay_us := Delay}, #{again_us := Again}) ->
    case starl_sap_schedule:reach_us(Sap, Loss, Delay, Again) of
        never -> infinity;
        Reach -> Again * 101 div 100 + 3 * Reach + ?MARGIN_US
    end;
settle_us(_Known, _Config) ->
    infinity.

%% @doc The window excuses what it meets.
-spec broken(starl_assumption:window(), #state{}) -> #state{}.
broken(Window, #state{assumption = Assumption, faults = Faults} = State) ->
    State#state{
        assumption = starl_assumption:broken(Window, Assumption),
        faults = starl_assumption:broken(Window, Faults)
    }.

%% @doc The elections' own events, what is delivered, and the end of robots.
-spec interests() -> [atom()].
interests() -> [election, sap, robot].

%% @doc {@link starl_election_ballots:event()}.
-spec vocabulary() -> starl_event:vocabulary().
vocabulary() -> #{election => [{entered, 1}, {ballot, 2}, {elected, 3}, {failed, 2}]}.

%% @doc The ballots and each robot's leader.
-spec timeless(#state{}) -> term().
timeless(#state{elections = Elections}) -> Elections.

%% @doc Judges one event.
-spec step(starl_monitor:trace_event(), #state{}) ->
    {ok, #state{}} | {violation, starl_monitor:violation(), #state{}}.
step({T, Robot, Machine, Event}, State) ->
    {Overdue, Current} = pass(T, State),
    {Broken, Next} = judge({Machine, Event}, T, Robot, Current),
    starl_violation:step(Overdue ++ Broken, Next).

%% @doc Judges the time until `EndTimeUs'. Results: the number of `elections', of robots that
%% `elected' and `failed' in them, and the `leaders' in the order of the elections.
-spec finish(integer(), #state{}) ->
    {ok | {violation, [starl_monitor:violation(), ...]}, starl_monitor:results()}.
finish(EndTimeUs, State) ->
    {Overdue, #state{elections = Elections, failed = Failed}} = pass(EndTimeUs, State),
    Held = lists:sort(maps:to_list(Elections)),
    Results = starl_unjudged:with(off(EndTimeUs, State), #{
        elections => length(Held),
        elected => lists:sum([map_size(Elected) || {_, {_, Elected}} <- Held]),
        failed => Failed,
        leaders => [{E, lists:usort(maps:values(Elected))} || {E, {_, Elected}} <- Held]
    }),
    starl_violation:finish(Overdue, Results).

off(_EndUs, #state{settle_us = infinity}) ->
    [];
off(EndUs, #state{settle_us = Settle, faults = Faults}) ->
    starl_unjudged:excused("all elect the same", Settle, EndUs, Faults).

%%% Events: each gives the violations it shows

judge({election, {entered, Election}}, T, Robot, State) ->
    {stranger(T, Robot, Election, State), enter(T, Robot, Election, State)};
judge({election, {ballot, Election, Ballot}}, T, Robot, State) ->
    {Ballots, Elected} = record_of(Election, State),
    Broken = second_ballot(T, Robot, Election, Ballot, Ballots),
    Kept = keep(Election, {maps:merge(#{Robot => Ballot}, Ballots), Elected}, State),
    {Broken, settle(T, Election, not is_map_key(Robot, Ballots), Kept)};
judge({election, {elected, Election, Leader, How}}, T, Robot, State) ->
    elected(Election, Leader, How, T, Robot, State);
judge({election, {failed, Election, _Reason}}, T, Robot, #state{failed = Failed} = State) ->
    Given = given_up(T, Election, Robot, State),
    {[], conclude(Election, Robot, Given#state{failed = Failed + 1})};
%% Its caller is told that the machine has restarted, and may take part anew.
judge({election, crashed}, T, Robot, State) ->
    {[], absent(T, Robot, uninformed(Robot, State))};
judge({robot, {died, _Reason}}, T, Robot, State) ->
    {[], absent(T, Robot, uninformed(Robot, State))};
judge({sap, {delivered, _Id, leader, Hash}}, T, Robot, #state{decided = Decided} = State) when
    is_map_key(Hash, Decided)
->
    {[], informed(T, Robot, map_get(Hash, Decided), State)};
%% What it has delivered may have waited for a listener, and is lost.
judge({Machine, Gone}, _T, Robot, State) when
    Machine =:= sap, Gone =:= crashed; Machine =:= robot, Gone =:= down
->
    {[], uninformed(Robot, State)};
judge({_Machine, _Other}, _T, _Robot, State) ->
    {[], State}.

elected(Election, Leader, How, T, Robot, State) ->
    {Ballots, Elected} = Record = record_of(Election, State),
    Broken =
        stranger(T, Robot, Election, State) ++
            disagreement(T, Robot, Election, Leader, Elected) ++
            unfit(T, Robot, Election, Leader, Ballots) ++
            incomplete(How, T, Robot, Election, Record, State),
    Known = {Ballots, maps:merge(#{Robot => Leader}, Elected)},
    Concluded = conclude(Election, Robot, decided(Election, Leader, State)),
    {Broken, keep(Election, Known, Concluded)}.

%% The others need not have heard its ballot, if a fault came in between.
given_up(T, Election, Robot, #state{open = Open, faults = Faults, forgotten = Of} = State) ->
    %% an atom is greater than every number
    Entered = min(T, starl_obligations:since({Election, Robot}, Open)),
    case starl_assumption:is_kept(Entered, T, Faults) andalso all_there(Entered, State) of
        true -> State;
        false -> State#state{forgotten = Of#{Election => []}}
    end.

%% Has no robot been away since then?
all_there(Since, #state{away = Away}) ->
    lists:all(fun({_Crash, Back}) -> Back < Since end, maps:values(Away)).

absent(T, Robot, State) ->
    #state{open = Open, elections = Elections, forgotten = Forgotten, away = Away} = State,
    Cast = [
        Election
     || {Election, {Ballots, _} = Record} <- maps:to_list(Elections),
        is_map_key(Robot, Ballots) orelse is_given_up(Election, Record, Open)
    ],
    State#state{
        away = Away#{Robot => {T, infinity}},
        open = starl_obligations:dropped(fun({_Election, Who}) -> Who =:= Robot end, Open),
        forgotten = maps:merge(Forgotten, maps:from_keys(Cast, []))
    }.

%% Has a robot cast a ballot that it does not tell any more, nor the result?
is_given_up(Election, {Ballots, Elected}, Open) ->
    lists:any(
        fun(Robot) -> starl_obligations:since({Election, Robot}, Open) =:= none end,
        maps:keys(maps:without(maps:keys(Elected), Ballots))
    ).

record_of(Election, #state{elections = Elections}) ->
    maps:get(Election, Elections, {#{}, #{}}).

keep(Election, Record, #state{elections = Elections} = State) ->
    State#state{elections = Elections#{Election => Record}}.

enter(T, Robot, Election, #state{open = Open, bound_us = Bound, away = Away} = State) ->
    keep(Election, record_of(Election, State), State#state{
        away = back(T, Robot, Away),
        open = starl_obligations:owe({Election, Robot}, Robot, T, Bound, Open)
    }).

back(T, Robot, Away) ->
    case Away of
        #{Robot := {Crash, infinity}} -> Away#{Robot := {Crash, T}};
        #{} -> Away
    end.

conclude(Election, Robot, #state{open = Open} = State) ->
    State#state{open = starl_obligations:paid({Election, Robot}, Open)}.

%% A message of this body announces it.
decided(Election, Leader, #state{decided = Decided} = State) ->
    State#state{decided = Decided#{erlang:phash2({Election, Leader}) => {Election, Leader}}}.

informed(T, Robot, {Election, Leader}, #state{open = Open, informed = Informed} = State) ->
    Key = {Robot, Election, Leader, T},
    case starl_obligations:since({Election, Robot}, Open) of
        none ->
            State;
        _Entered ->
            #state{step_us = Step} = State,
            State#state{informed = starl_obligations:owe(Key, Robot, T, Step, Informed)}
    end.

uninformed(Robot, #state{informed = Informed} = State) ->
    IsOf = fun({Who, _, _, _}) -> Who =:= Robot end,
    State#state{informed = starl_obligations:dropped(IsOf, Informed)}.

%% With the last ballot the robots that are electing must come to an end.
settle(T, Election, true, #state{settle_us = Settle, robots = Robots} = State) when
    is_integer(Settle), not is_map_key(Election, State#state.forgotten)
->
    {Ballots, _} = record_of(Election, State),
    Owe = fun(Key, Settling) -> starl_obligations:owe(Key, team, T, Settle, Settling) end,
    case [Robot || Robot <- Robots, not is_map_key(Robot, Ballots)] of
        [] ->
            Electing = [
                {Election, Robot}
             || Robot <- Robots,
                starl_obligations:since({Election, Robot}, State#state.open) =/= none
            ],
            State#state{settling = lists:foldl(Owe, State#state.settling, Electing)};
        _Missing ->
            State
    end;
settle(_T, _Election, _First, State) ->
    State.

%%% The clauses of the contract

stranger(T, Robot, Election, #state{robots = Robots}) ->
    [
        violation(not_a_participant, T, [Robot], #{election => Election})
     || not lists:member(Robot, Robots)
    ].

second_ballot(T, Robot, Election, Ballot, Ballots) ->
    case Ballots of
        #{Robot := First} when First =/= Ballot ->
            Details = #{election => Election, first => First, second => Ballot},
            [violation(second_ballot, T, [Robot], Details)];
        #{} ->
            []
    end.

%% A robot's own earlier choice first, else the lowest robot that chose otherwise.
disagreement(T, Robot, Election, Leader, Elected) ->
    case [{Who, Other} || {Who, Other} <- maps:to_list(Elected), Other =/= Leader] of
        [] ->
            [];
        Differing ->
            {Who, Other} = opponent(Robot, Differing),
            Details = #{election => Election, leaders => [Other, Leader]},
            [violation(clash(Who, Robot), T, lists:usort([Who, Robot]), Details)]
    end.

opponent(Robot, Differing) ->
    case lists:keyfind(Robot, 1, Differing) of
        false -> lists:min(Differing);
        Own -> Own
    end.

clash(Robot, Robot) -> two_leaders_at_one_robot;
clash(_Who, _Robot) -> different_leaders.

unfit(T, Robot, Election, Leader, Ballots) ->
    [
        violation(leader_without_ballot, T, [Robot], #{election => Election, leader => Leader})
     || not is_map_key(Leader, Ballots)
    ].

incomplete(all_ballots, T, Robot, Election, {Ballots, _}, #state{complete = true} = State) ->
    Missing = [Other || Other <- State#state.robots, not is_map_key(Other, Ballots)],
    [
        violation(incomplete_ballots, T, [Robot], #{election => Election, missing => Missing})
     || Missing =/= []
    ];
incomplete(_How, _T, _Robot, _Election, _Record, _State) ->
    [].

%% Deadlines by the last ballot are named before those by the general bound.
pass(T, State) ->
    {Unsettled, Passed} = unsettled(T, State),
    {Ignored, Attentive} = ignored(T, Passed),
    {Late, Current} = overdue(T, Attentive),
    {Unsettled ++ Ignored ++ Late, Current}.

%% Those that were electing at the last ballot and still are.
unsettled(T, #state{settling = Settling, faults = Faults, forgotten = Forgotten} = State) ->
    case starl_obligations:overdue(T, Faults, Settling) of
        none ->
            {[], State};
        {Late, Left} ->
            Open = [
                {Due, Election, Robot}
             || {Due, {Election, Robot} = Key} <- Late,
                is_electing(starl_obligations:since(Key, Settling), Election, Robot, State),
                not is_map_key(Election, Forgotten)
            ],
            Concluded = lists:foldl(fun({_, E, R}, S) -> conclude(E, R, S) end, State, Open),
            {
                [violation(not_settled, Due, [R], #{election => E}) || {Due, E, R} <- Open],
                Concluded#state{settling = Left}
            }
    end.

%% Those that have not elected, though they heard long before `T' whom.
ignored(T, #state{informed = Informed, assumption = Assumption} = State) ->
    case starl_obligations:overdue(T, Assumption, Informed) of
        none ->
            {[], State};
        {Late, Left} ->
            {
                [
                    violation(announcement_ignored, Due, [R], #{election => E, leader => Leader})
                 || {Due, {R, E, Leader, At}} <- Late, is_electing(At, E, R, State)
                ],
                State#state{informed = Left}
            }
    end.

%% Has it been electing since then? A robot that has entered again since has the bound anew.
is_electing(Since, Election, Robot, #state{open = Open}) ->
    %% an atom is greater than every number
    starl_obligations:since({Election, Robot}, Open) =< Since.

%% The robots overdue before `T'; a result at exactly the deadline is in time.
overdue(T, #state{open = Open, assumption = Assumption} = State) ->
    case starl_obligations:overdue(T, Assumption, Open) of
        none ->
            {[], State};
        {Late, Left} ->
            {
                [violation(no_result, Due, [R], #{election => E}) || {Due, {E, R}} <- Late],
                State#state{open = Left}
            }
    end.

violation(What, T, Robots, Details) ->
    starl_violation:new(election, What, T, Robots, Details).
