%% @doc Judges the progress of path planning, for {@link starl_dpp_monitor}. When no robot is on its
%% path and some robot waits for an answer, some robot must be answered. So a free line that can be
%% reached is assigned, and a deadlock, in which all wait, is resolved.
%% ```
%%   robot:  asks --> waits --> answered, assign --> is on its way --> asks
%%                              answered, something else
%% '''
%% Under a coordinator that knows the places of all robots, all of which live, an answer takes only
%% as long as a request and its answer over the radio. Otherwise another robot may have to lead
%% first, and the lines near silent robots may have to be abandoned. Then the answer takes as long
%% as all that together. Nothing is judged while a robot is down, nor without a quorum. A fault that
%% the team meets restarts the time.
%%
%% No line may be abandoned (`unreachable') without a reason. There are three reasons: a robot has
%% died; a robot has found its path closed; or a fault cut a robot off from the present term's
%% coordinator, so that it was silent.
-module(starl_dpp_monitor_service).

-export([times/2, new/1, broken/2, happened/4, pass/2, unjudged/2]).

-export_type([t/0, times/0]).

-type us() :: integer().

%% The windows of all faults; the time for an answer of a coordinator that leads all the time, that after which a
%% request is repeated, that for everything together, and that within which a robot falls silent for its coordinator that
%% is cut off. Where the answers to the beats of a lease may all be lost, a coordinator may lose its lease again and again:
%% no time for everything is sure (`infinity'). Where they may come too late no coordinator need ever lead. `unjudged' says
%% what is not judged.
-type times() :: #{
    faults := [starl_assumption:window()],
    answer_us := us() | infinity,
    again_us := us(),
    whole_us := us() | infinity,
    silent_us := us(),
    unjudged => [starl_unjudged:clause()]
}.

-record(service, {
    robots :: [starl:robot_id()],
    times :: times(),
    faults :: starl_assumption:t(),
    %% the robots that wait; those that are on their way; when this last changed
    asks = [] :: [starl:robot_id()],
    moves = [] :: [starl:robot_id()],
    changed_us = 0 :: us(),
    %% since when a coordinator has led that knows the places of all robots; those that it has not heard
    open_us = none :: us() | none,
    silent = [] :: [starl:robot_id()],
    %% those of them that a fault explains
    unheard = [] :: [starl:robot_id()],
    down = [] :: [starl:robot_id()],
    died = [] :: [starl:robot_id()],
    closed = false :: boolean(),
    answer = starl_obligations:new(anew) :: starl_obligations:t(answer)
}).

-opaque t() :: #service{}.

%% Of a participant: the time for a look at its position, and to ask again when SAP has given up; that
%% after which it repeats a request in any case.
-define(LOOK_US, 500000).
-define(AGAIN_US, 40000000).
%% Of a coordinator: the time after which it serves those who wait again, asks for places again, and gives
%% up the lines near silent robots.
-define(SERVE_US, 200000).
-define(RECOVER_US, 2000000).
-define(GIVE_UP_US, 60000000).
%% The robots' own steps.
-define(MARGIN_US, 1000000).
%% A bound that is exceeded more seldom is none.
-define(RARE, 1.0e-9).
%% A lease is so much longer than a message and its answer take.
-define(LONG_LEASE, 10).
-define(DRIFT_PPM, 10000).
-define(CLAUSE, "a free line that can be reached is assigned").
%% A lease ends after the robot was heard last, or after its coordinator began to lead, which may take as long.
-define(SILENT_LEASES, 3).

%% @doc The times of a run, from its radio and the leases. Everything together: the coordinator is missed by
%% the last robot of the team; promises to others end, and the claim is won; a silent robot's lease ends;
%% lines are given up; the messages of all that.
-spec times(starl_monitor:known(), #{
    robots := [starl:robot_id()], lease_us := us(), jump_us := us(), drift_ppm := non_neg_integer()
}) ->
    times().
times(#{sap := Sap, loss := Loss, delay_us := Delay, slack_us := Slack} = Known, Config) ->
    #{robots := Robots, lease_us := Lease, jump_us := Jump, drift_ppm := Ppm} = Config,
    Leases = #{lease_ms => Lease div 1000, jump_ms => Jump div 1000, drift_ppm => Ppm},
    #{faults := Faults} = Known,
    Reach = starl_sap_schedule:reach_us(Sap, Loss, Delay, ?LOOK_US),
    Missing = starl_dpp_vote:last_claim_us(length(Robots), Lease),
    Whole = Missing + 7 * Lease div 2 + ?RECOVER_US + ?AGAIN_US + ?GIVE_UP_US + 10 * Reach,
    Answer = 2 * ?LOOK_US + ?SERVE_US + 2 * Reach + ?MARGIN_US + Slack,
    InTime = (Whole + ?MARGIN_US) * 101 div 100 + Slack,
    Times = #{
        faults => Faults ++ maps:get(places, Known, maps:get(bodies, Known)),
        again_us => ?AGAIN_US,
        silent_us => ?SILENT_LEASES * Lease + ?MARGIN_US + Slack
    },
    case lease(Loss, Delay, Leases) of
        late ->
            Why = [{?CLAUSE, "packets take too long for a lease"}],
            Times#{answer_us => infinity, whole_us => infinity, unjudged => Why};
        lost ->
            Why = starl_unjudged:lossy(?CLAUSE ++ " after a fail-over", Loss),
            Times#{answer_us => Answer, whole_us => infinity, unjudged => Why};
        sure ->
            Times#{answer_us => Answer, whole_us => InTime}
    end.

%% Of the beats of a lease every other one is answered. May the answers come too late, or all be lost?
lease(Loss, Delay, Leases) ->
    Short = starl_dpp_lease:short_us(Leases),
    Answers = Short div (2 * starl_dpp_lease:beat_us(Leases)),
    Lost = math:pow(1 - (1 - Loss) * (1 - Loss), Answers),
    case ?LONG_LEASE * 2 * Delay =< Short of
        false -> late;
        true when Lost > ?RARE -> lost;
        true -> sure
    end.

%% @doc Without times nothing is judged but that no line is given up.
-spec new(#{robots := [starl:robot_id()], service => times(), _ => _}) -> t().
new(#{robots := Robots} = Config) ->
    None = #{
        faults => [], answer_us => infinity, again_us => 0, whole_us => infinity, silent_us => 0
    },
    #{faults := Faults} = Times = maps:get(service, Config, None),
    #service{
        robots = Robots, times = Times, faults = starl_assumption:new(Faults, ?DRIFT_PPM)
    }.

%% @doc A fault in this window, of which no event has been judged yet.
-spec broken(starl_assumption:window(), t()) -> t().
broken(Window, #service{faults = Faults} = S) ->
    S#service{faults = starl_assumption:broken(Window, Faults)}.

%% @doc What is not judged in a run that ends at this time.
-spec unjudged(EndUs :: us(), t()) -> [starl_unjudged:clause()].
unjudged(_End, #service{times = #{unjudged := Unjudged}}) ->
    Unjudged;
unjudged(_End, #service{times = #{answer_us := infinity}}) ->
    [];
unjudged(End, #service{times = #{answer_us := Answer, again_us := Again}, faults = Faults}) ->
    starl_unjudged:excused(?CLAUSE, Again + Answer, End, Faults).

%% @doc Time has passed: should a robot have been answered until then? Which ones waited?
-spec pass(TimeUs :: us(), t()) -> {none | {DueUs :: us(), [starl:robot_id(), ...]}, t()}.
pass(T, #service{answer = Answer, faults = Faults, asks = Asks} = S) ->
    case starl_obligations:overdue(T, Faults, Answer) of
        none -> {none, S};
        {[], Left} -> {none, S#service{answer = Left}};
        {[{Due, answer}], Left} -> {{Due, Asks}, S#service{answer = Left}}
    end.

%% @doc An event of a robot. `given_up': lines were, without a reason.
-spec happened(TimeUs :: us(), starl:robot_id(), {Machine :: atom(), Event :: term()}, t()) ->
    {none | given_up, t()}.
happened(T, Robot, {dpp, asks}, S) ->
    {none, changed(T, asks(Robot, S))};
happened(T, Robot, {dpp, {answered, assign}}, #service{moves = Moves} = S) ->
    Moving = S#service{moves = lists:usort([Robot | Moves])},
    {none, changed(T, answered(Robot, Moving))};
happened(T, Robot, {dpp, {answered, _End}}, S) ->
    {none, changed(T, answered(Robot, S))};
%% the coordinator does not know yet that it is not on its way any more
happened(T, Robot, {dpp, crashed}, S) ->
    {none, changed(T, answered(Robot, S))};
happened(T, Robot, {dpp_coordinator, {silent, Silent}}, #service{unheard = Known} = S) ->
    Unheard = [Silent || is_explained(T, [Robot, Silent], S)],
    {none, silent(Silent, S#service{unheard = lists:usort(Unheard ++ Known)})};
happened(T, _Robot, {dpp_coordinator, Event}, S) ->
    coordinates(T, Event, S);
happened(T, Robot, {robot, down}, #service{down = Down} = S) ->
    {none, changed(T, answered(Robot, S#service{down = lists:usort([Robot | Down])}))};
happened(T, Robot, {robot, up}, #service{down = Down} = S) ->
    {none, changed(T, S#service{down = lists:delete(Robot, Down)})};
happened(T, Robot, {robot, {died, _Reason}}, #service{died = Died, moves = Moves} = S) ->
    Dead = answered(Robot, S#service{
        died = lists:usort([Robot | Died]), moves = lists:delete(Robot, Moves)
    }),
    {none, changed(T, Dead)};
happened(_T, _Robot, _Event, S) ->
    {none, S}.

silent(Robot, #service{silent = Known} = S) ->
    due(S#service{silent = lists:usort([Robot | Known])}).

%% Does a fault of one of these robots, or of the radio of all, explain that the other is not heard? It has
%% lasted until now, or not ended long ago. On a radio that is not sure no fault is needed.
is_explained(_T, _Robots, #service{times = #{whole_us := infinity}}) ->
    true;
is_explained(T, Robots, #service{times = #{silent_us := Us}, faults = Faults}) ->
    lists:any(fun(R) -> starl_assumption:calm_us(R, T - Us, Us, Faults) > T end, Robots).

%% What a coordinator tells. It finds silent robots before it knows all places.
coordinates(_T, {leads, _Term}, S) ->
    {none, due(S#service{silent = [], unheard = []})};
coordinates(T, {coordinator, _Term}, S) ->
    {none, due(S#service{open_us = T})};
coordinates(_T, {closed, [_ | _]}, S) ->
    {none, S#service{closed = true}};
coordinates(_T, {unreachable, [_ | _]}, #service{closed = false} = S) ->
    #service{unheard = Unheard, died = Died, down = Down, open_us = Open} = S,
    case Open =/= none andalso Unheard ++ Died ++ Down of
        [] -> {given_up, S};
        _ -> {none, S}
    end;
coordinates(_T, Event, S) when
    Event =:= crashed; element(1, Event) =:= claims; element(1, Event) =:= stepped_down
->
    {none, due(S#service{open_us = none})};
coordinates(_T, _Event, S) ->
    {none, S}.

asks(Robot, #service{asks = Asks, moves = Moves} = S) ->
    S#service{asks = lists:usort([Robot | Asks]), moves = lists:delete(Robot, Moves)}.

answered(Robot, #service{asks = Asks} = S) -> S#service{asks = lists:delete(Robot, Asks)}.

changed(T, S) -> due(S#service{changed_us = T}).

%% Is an answer owed now, since when, and within which time?
due(#service{answer = Answer} = S) ->
    case owed(S) of
        {_Since, infinity} -> S#service{answer = starl_obligations:paid(answer, Answer)};
        {Since, Us} -> S#service{answer = starl_obligations:owe(answer, team, Since, Us, Answer)}
    end.

owed(#service{asks = Asks, moves = Moves, down = Down, changed_us = Changed}) when
    Asks =:= []; Moves =/= []; Down =/= []
->
    {Changed, infinity};
owed(#service{robots = Robots, died = Died, changed_us = Changed} = S) ->
    case starl_dpp_lease:quorum(Robots -- Died, Robots) of
        true -> owed(S#service.open_us, S#service.silent ++ Died, S);
        false -> {Changed, infinity}
    end.

%% A message from before may have been lost in a fault, which a robot makes good when it asks again: so a
%% fault that was over so long before counts, too.
owed(_Open, _Silent, #service{changed_us = Changed, times = #{answer_us := infinity}}) ->
    {Changed, infinity};
owed(Open, [], #service{changed_us = Changed, times = Times}) when is_integer(Open) ->
    #{answer_us := Answer, again_us := Again, whole_us := Whole} = Times,
    %% a robot that has lost its coordinator for a while, unlike the others, asks again, too
    case Whole of
        infinity -> {max(Open, Changed), Again + Answer};
        _Sure -> {max(Open, Changed) - Again, Again + Answer}
    end;
owed(_Open, _Silent, #service{changed_us = Changed, times = #{whole_us := Whole}}) ->
    {Changed, Whole}.
