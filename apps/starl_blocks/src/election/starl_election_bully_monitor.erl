%% @doc The contract of the election by the bully algorithm, as a monitor.
%%
%% Safety: a robot reports at most one leader per term. A term is an election within one life of the
%% election machine (a crash begins a new one). A leader is a robot of the team, and only that robot
%% makes itself leader. A robot that entered elects or fails within `bound_us', unless it died or
%% its machine crashed. It may be later only by what its own clock, pauses and slowness explain in
%% that time ({@link starl_assumption:delayed_us/5}).
%%
%% More holds where no packet is lost, delays are bounded, and the patience is long enough. Then no
%% robot fails, and all elect the same leader unless it has died meanwhile. The leader was alive
%% when the election began. No robot above the leader was alive from then until the leader was
%% elected, unless its machine crashed in between. `lossless' sets where this is judged. `true': in
%% the whole run. `false' (the default): nowhere. `{calm, Us}': in each election that no fault has
%% met, neither in the election nor in the time before it in which a message may be under way. In a
%% run `Us' follows from the radio, `answer_us' and the patience ({@link context/2}).
%%
%% Events of machine `election': {@link starl_election_bully:event()}, `crashed'; of machine
%% `robot': `died'.
-module(starl_election_bully_monitor).
-behaviour(starl_monitor).

-export([init/1, context/2, broken/2, step/2, finish/2]).
-export([interests/0, vocabulary/0, sometimes/0, timeless/1]).

-type election() :: term().

-type lossless() :: boolean() | {calm, SinceBeforeUs :: non_neg_integer()}.

%% A robot's patience is one timer of its own; it enters, is told by the timer, and reports.
-define(STEPS, 3).
%% The clause of progress.
-define(HIGHEST, "all elect the highest robot alive").
%% Clocks are within 1 % of real time.
-define(DRIFT_PPM, 10000).
%% By so much the bound is longer than the patience.
-define(MARGIN_US, 1000000).

-record(state, {
    robots :: [starl:robot_id()],
    bound_us :: pos_integer(),
    lossless :: lossless(),
    faults :: starl_assumption:t(),
    %% when the election began, and every leader reported, with the robot and life that reported it
    began = #{} :: #{election() => integer()},
    reported = #{} :: #{
        {election(), starl:robot_id(), Life :: non_neg_integer()} => starl:robot_id()
    },
    leaders = #{} :: #{election() => starl:robot_id()},
    lives = #{} :: #{starl:robot_id() => pos_integer()},
    crashed = #{} :: #{starl:robot_id() => integer()},
    died = #{} :: #{starl:robot_id() => integer()},
    open = starl_obligations:new({delayed, ?STEPS}) ::
        starl_obligations:t({election(), starl:robot_id()}),
    assumption :: starl_assumption:t(),
    unjudged :: [starl_unjudged:clause()],
    failed = 0 :: non_neg_integer(),
    %% the results that were judged as lossless
    lossless_results = 0 :: non_neg_integer()
}).

%% @doc `robots': the team; `bound_us': the longest time from entering to the result;
%% `broken': the windows of broken assumptions; `faults': those of all faults.
-spec init(#{
    robots := [starl:robot_id()],
    bound_us := pos_integer(),
    answer_us => pos_integer(),
    broken => [starl_assumption:window()],
    faults => [starl_assumption:window()],
    lossless => lossless(),
    unjudged => [starl_unjudged:clause()]
}) -> #state{}.
init(#{robots := Robots, bound_us := Bound} = Config) ->
    #state{
        robots = Robots,
        bound_us = Bound,
        lossless = maps:get(lossless, Config, false),
        unjudged = maps:get(unjudged, Config, []),
        faults = starl_assumption:new(maps:get(faults, Config, []), ?DRIFT_PPM),
        assumption = starl_assumption:new(maps:get(broken, Config, []), ?DRIFT_PPM)
    }.

%% @doc The configuration with the windows of broken assumptions and of all faults; the bound is longer on a
%% computer that has other work, too. Elections without a fault are judged as lossless where the radio
%% loses nothing, an answer comes in time, and the patience outlasts the highest robot's wait for answers
%% and its announcement. The network of a live run may lose anything.
-spec context(starl_monitor:known(), map()) -> map().
context(#{broken := Broken, slack_us := Slack} = Known, #{bound_us := Bound} = Config) ->
    Lossless = maps:get(lossless, Config, lossless(Known, Config)),
    maps:merge(
        #{
            broken => Broken,
            lossless => Lossless,
            faults => maps:get(faults, Known, []),
            unjudged => [U || Lossless =:= false, is_map_key(answer_us, Config), U <- lossy(Known)]
        },
        Config#{bound_us := Bound + Slack}
    ).

lossy(#{slack_us := Slack}) when Slack > 0 ->
    [{?HIGHEST, "a network in real time may lose any packet"}];
lossy(#{loss := Loss}) when Loss > 0 ->
    starl_unjudged:lossy(?HIGHEST, Loss);
lossy(_Known) ->
    [{?HIGHEST, "answers take longer than a robot waits for them"}].

lossless(
    #{loss := Loss, delay_us := Delay, sap := Sap, slack_us := 0},
    #{answer_us := Answer, bound_us := Bound}
) when
    Loss == 0, 2 * Delay * 102 =< 100 * Answer, 2 * Answer =< Bound - ?MARGIN_US
->
    {calm, starl_sap_schedule:bound_us(Sap)};
lossless(_Known, _Config) ->
    false.

%% @doc The window excuses what it meets.
-spec broken(starl_assumption:window(), #state{}) -> #state{}.
broken(Window, #state{assumption = Assumption, faults = Faults} = State) ->
    State#state{
        assumption = starl_assumption:broken(Window, Assumption),
        faults = starl_assumption:broken(Window, Faults)
    }.

%% @doc The elections' own events and the end of robots.
-spec interests() -> [atom()].
interests() -> [election, robot].

%% @doc {@link starl_election_bully:event()}.
-spec vocabulary() -> starl_event:vocabulary().
vocabulary() -> #{election => [{entered, 1}, {elected, 3}, {failed, 2}]}.

%% @doc Results of elections in which nothing is lost.
-spec sometimes() -> [{atom(), owed}].
sometimes() -> [{lossless, owed}].

%% @doc The leaders reported, in which lives, and the robots without a result.
-spec timeless(#state{}) -> term().
timeless(#state{reported = Reported, leaders = Leaders, lives = Lives} = State) ->
    #state{began = Began, crashed = Crashed, died = Died} = State,
    {Reported, Leaders, Lives, Began, Crashed, Died}.

%% @doc Judges one event.
-spec step(starl_monitor:trace_event(), #state{}) ->
    {ok, #state{}} | {violation, starl_monitor:violation(), #state{}}.
step({T, Robot, Machine, Event}, State) ->
    {Overdue, Current} = overdue(T, State),
    {Broken, Next} = judge({Machine, Event}, T, Robot, Current),
    starl_violation:step(Overdue ++ Broken, Next).

%% @doc Judges the time until `EndTimeUs'. Results: the number of `elections', of results
%% `elected' (by one robot in one life) and `failed', and the `leaders' of each election.
-spec finish(integer(), #state{}) ->
    {ok | {violation, [starl_monitor:violation(), ...]}, starl_monitor:results()}.
finish(EndTimeUs, State) ->
    {Overdue, #state{began = Began, reported = Reported, failed = Failed}} =
        overdue(EndTimeUs, State),
    Results = starl_unjudged:with(State#state.unjudged, #{
        elections => map_size(Began),
        elected => map_size(Reported),
        failed => Failed,
        sometimes => #{lossless => State#state.lossless_results},
        leaders => [
            {E, lists:usort([L || {{Of, _, _}, L} <- maps:to_list(Reported), Of =:= E])}
         || E <- lists:sort(maps:keys(Began))
        ]
    }),
    starl_violation:finish(Overdue, Results).

%% -- events ---------------------------------------------------------------------------------

judge({election, {entered, Election}}, T, Robot, #state{open = Open, bound_us = Bound} = State) ->
    Began = begin_election(Election, T, State),
    Entered = starl_obligations:owe({Election, Robot}, Robot, T, Bound, Open),
    {[], Began#state{open = Entered}};
judge({election, {elected, Election, Leader, How}}, T, Robot, State) ->
    elected(Election, Leader, How, T, Robot, begin_election(Election, T, State));
judge({election, {failed, Election, _Reason}}, T, Robot, #state{failed = Failed} = State) ->
    Broken = [
        violation(failed_without_loss, T, [Robot], Election)
     || is_lossless(Election, T, State)
    ],
    Open = starl_obligations:paid({Election, Robot}, State#state.open),
    {Broken, State#state{failed = Failed + 1, open = Open}};
judge({election, crashed}, T, Robot, #state{crashed = Crashed, lives = Lives} = State) ->
    Life = maps:get(Robot, Lives, 1) + 1,
    {
        [],
        absent(Robot, State#state{
            crashed = Crashed#{Robot => T}, lives = Lives#{Robot => Life}
        })
    };
judge({robot, {died, _Reason}}, T, Robot, #state{died = Died} = State) ->
    {[], absent(Robot, State#state{died = Died#{Robot => T}})};
judge({_Machine, _Other}, _T, _Robot, State) ->
    {[], State}.

elected(Election, Leader, How, T, Robot, State) ->
    Term = {Election, Robot, maps:get(Robot, State#state.lives, 1)},
    Broken =
        two_leaders(Term, Leader, T, State) ++ unfit(Election, Leader, How, T, Robot, State) ++
            lossless(Election, Leader, T, Robot, State),
    Judged = length([x || is_lossless(Election, T, State)]),
    {Broken, State#state{
        lossless_results = State#state.lossless_results + Judged,
        reported = maps:merge(#{Term => Leader}, State#state.reported),
        leaders = maps:merge(#{Election => Leader}, State#state.leaders),
        open = starl_obligations:paid({Election, Robot}, State#state.open)
    }}.

begin_election(Election, T, #state{began = Began} = State) ->
    State#state{began = maps:merge(#{Election => T}, Began)}.

absent(Robot, #state{open = Open} = State) ->
    State#state{open = starl_obligations:dropped(fun({_, Who}) -> Who =:= Robot end, Open)}.

%% -- the clauses of the contract ------------------------------------------------------------

two_leaders({Election, Robot, _} = Term, Leader, T, #state{reported = Reported}) ->
    case Reported of
        #{Term := Other} when Other =/= Leader ->
            [violation(two_leaders_at_one_robot, T, [Robot], Election)];
        #{} ->
            []
    end.

unfit(Election, Leader, How, T, Robot, #state{robots = Robots}) ->
    [violation(not_a_robot, T, [Robot], Election) || not lists:member(Leader, Robots)] ++
        [violation(not_itself, T, [Robot], Election) || How =:= highest, Leader =/= Robot].

is_lossless(_Election, _T, #state{lossless = Always}) when is_boolean(Always) ->
    Always;
is_lossless(Election, T, #state{lossless = {calm, Us}, began = Began, faults = Faults}) ->
    starl_assumption:is_kept(maps:get(Election, Began, T) - Us, T, Faults).

lossless(Election, Leader, T, Robot, State) ->
    case is_lossless(Election, T, State) of
        true -> agreed(Election, Leader, T, Robot, State);
        false -> []
    end.

agreed(Election, Leader, T, Robot, State) ->
    Began = maps:get(Election, State#state.began),
    Higher = [
        Other
     || Other <- State#state.robots, Other > Leader, throughout(Other, Began, State)
    ],
    Other = maps:get(Election, State#state.leaders, Leader),
    Differs = Other =/= Leader andalso not is_map_key(Other, State#state.died),
    [violation(different_leaders, T, [Robot], Election) || Differs] ++
        [violation(not_the_highest, T, [Robot | Higher], Election) || Higher =/= []] ++
        [
            violation(dead_leader, T, [Robot], Election)
         || maps:get(Leader, State#state.died, T) < Began
        ].

%% Alive until now, with its machine, since the election began?
throughout(Robot, Began, #state{died = Died, crashed = Crashed}) ->
    not is_map_key(Robot, Died) andalso maps:get(Robot, Crashed, Began - 1) < Began.

%% The robots overdue before `T'; a result at exactly the deadline is in time.
overdue(T, #state{open = Open, assumption = Assumption} = State) ->
    case starl_obligations:overdue(T, Assumption, Open) of
        none ->
            {[], State};
        {Late, Left} ->
            {
                [violation(no_result, Due, [Robot], E) || {Due, {E, Robot}} <- Late],
                State#state{open = Left}
            }
    end.

violation(What, T, Robots, Election) ->
    starl_violation:new(election, What, T, Robots, #{election => Election}).
