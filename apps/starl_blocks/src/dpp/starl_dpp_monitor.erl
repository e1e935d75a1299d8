%% @doc The contract of distributed path planning (DPP), as a monitor.
%%
%% Reservations (Lemma 7 of the paper): at every change of a robot's reservation, its centre line
%% is at least two tube radii away from every other robot's. Separation: any two robots are at
%% least `r_s' apart at every instant, in continuous time ({@link starl_separation}).
%%
%% Leadership: only the coordinator of the latest term assigns. The latest term counts from the
%% instant at which its coordinator has the votes, which is before it assigns anything. If the store
%% of a robot that voted for it was set back, a lower term may follow once the term has ended.
%% Lease: a robot begins no motion outside its reservation, nor without a reservation. So it does
%% not drive on when its space has become free; it may come to rest there.
%%
%% Horizon (the paper's ComputePath bounds the path; here H bounds its lines): on one path a robot
%% draws at most `path_mm', the horizon plus the line on which it ends.
%%
%% Progress: requests are answered, and no line is abandoned without a reason
%% ({@link starl_dpp_monitor_service}).
%%
%% Events. Of machine `dpp_coordinator': {@link starl_dpp_coordinator:event()}. A later
%% `coordinator' starts with an empty view, filled before anything is assigned; `assigned' and
%% `reserved' give the robot's whole reservation afterwards. Of machine `dpp':
%% {@link starl_dpp_participant:event()}. Of machine `app': `{stroke, Segment}', the line that the
%% robot is about to draw. Of machine `chassis': `motion'. Of machine `robot': `down', `up' and
%% `died'; a dead robot stays where it is, and keeps its reservation.
%%
%% Separation is judged at the end of a slice of time. So a violation is reported up to a second
%% after the instant that it names. Each pair of robots is reported once.
-module(starl_dpp_monitor).
-behaviour(starl_monitor).

-export([
    init/1,
    context/2,
    broken/2,
    step/2,
    finish/2,
    interests/0,
    vocabulary/0,
    sometimes/0,
    timeless/1
]).

-export_type([left/0]).

%% The number of edges that the team has given up; the silent robots that stand in the way of some, each with the
%% time at which its lease had ended, and the number of these edges; the number of those that no robot stands in
%% the way of: the ways to them are closed.
-type left() :: #{
    edges := pos_integer(),
    in_the_way := [{starl:robot_id(), SilentUs :: integer(), Edges :: pos_integer()}],
    cut_off := non_neg_integer()
}.
-type reservation() :: {starl_geometry:box(), [starl_geometry:segment(), ...]}.

-record(state, {
    %% The least distance of two centre lines (mm).
    apart_mm :: float(),
    r_s :: float(),
    %% The most by which a robot may be off its centre line (mm).
    off_mm :: float(),
    %% The same for single robots, where it is less.
    offs = #{} :: #{starl:robot_id() => float()},
    %% The latest term in which every robot's place was known.
    term = none :: term(),
    %% The robots that have led, latest first; the latest term that was won, and by which robot.
    coordinators = [] :: [starl:robot_id()],
    leads = none :: {Term :: term(), starl:robot_id()} | none,
    %% Has that term ended; was the store of a robot set back since it was won?
    ended = false :: boolean(),
    set_back = false :: boolean(),
    %% The team, and what is assumed of its clocks.
    robots :: [starl:robot_id()],
    lease_us :: non_neg_integer(),
    jump_us :: non_neg_integer(),
    assumption :: starl_assumption:t(),
    reservations = #{} :: #{starl:robot_id() => reservation()},
    %% Have any two reservations ever been too near to each other?
    overlaps = false :: boolean(),
    separation :: starl_separation:t(),
    service :: starl_dpp_monitor_service:t(),
    path_mm :: float() | infinity,
    %% the lines that each robot has drawn of its path
    drawn = #{} :: #{starl:robot_id() => [starl_geometry:segment()]},
    %% when each robot was found to be silent; the lines that it is in the way of; what is given up
    silent = #{} :: #{starl:robot_id() => integer()},
    in_the_way = #{} :: #{starl:robot_id() => {SilentUs :: integer(), [starl_geometry:segment()]}},
    left = none :: left() | none,
    assignments = 0 :: non_neg_integer(),
    deadlocks = 0 :: non_neg_integer(),
    %% what deluded coordinators have said
    deluded = 0 :: non_neg_integer(),
    %% Violations that are not returned yet: an event returns one.
    waiting = [] :: [starl_monitor:violation()]
}).

%% Rounding in the planner's own comparison (mm).
-define(SLACK_MM, 1.0e-6).
%% The same for the lines of a path: they are added up (mm).
-define(SUM_MM, 0.01).
%% The greatest error of the place at which a standing robot is seen (mm).
-define(SEEN_MM, 1.0).
-define(LEASE_US, 10000000).
-define(JUMP_US, 2000000).
-define(DRIFT_PPM, 10000).

%% @doc `tube_radius': the radius of a reach tube (mm); `r_s': the least distance of two robots
%% (mm); `tracking_mm': r(v) of single robots, where it is less than tubes have room for;
%% `slice_us': the time that is judged at once (default one second). `lease_us', `jump_us' and
%% `drift_ppm' are those of the machines (by default 10 s, 2 s, 10000); `path_mm': the most of the lines
%% of one path (by default any); `robots': the team;
%% `broken': the times at which clocks were not as assumed (by default never); `service': the times of
%% {@link starl_dpp_monitor_service}.
-spec init(#{
    tube_radius := float(),
    r_s := float(),
    tracking_mm => #{starl:robot_id() => float()},
    slice_us => pos_integer(),
    robots => [starl:robot_id()],
    lease_us => pos_integer(),
    jump_us => non_neg_integer(),
    drift_ppm => non_neg_integer(),
    path_mm => float() | infinity,
    broken => [starl_assumption:window()],
    service => starl_dpp_monitor_service:times()
}) -> #state{}.
init(#{tube_radius := Radius, r_s := Limit} = Config) ->
    Slice = maps:get(slice_us, Config, 1_000_000),
    Ppm = maps:get(drift_ppm, Config, ?DRIFT_PPM),
    #state{
        apart_mm = 2 * Radius - ?SLACK_MM,
        r_s = float(Limit),
        off_mm = Radius - Limit / 2 + ?SEEN_MM,
        offs = maps:map(fun(_, Mm) -> Mm + ?SEEN_MM end, maps:get(tracking_mm, Config, #{})),
        robots = maps:get(robots, Config, []),
        lease_us = starl_assumption:longest_us(maps:get(lease_us, Config, ?LEASE_US), Ppm),
        jump_us = maps:get(jump_us, Config, ?JUMP_US),
        path_mm = maps:get(path_mm, Config, infinity),
        assumption = starl_assumption:new(maps:get(broken, Config, []), Ppm),
        service = starl_dpp_monitor_service:new(
            maps:merge(#{robots => []}, Config)
        ),
        separation = starl_separation:new(Limit, Slice)
    }.

%% @doc The configuration with the times at which clocks were not as assumed, and those of the service.
-spec context(starl_monitor:known(), map()) -> map().
context(#{broken := Broken} = Known, #{robots := _, lease_us := _} = Config) ->
    Service = starl_dpp_monitor_service:times(Known, Config),
    maps:merge(#{broken => Broken, service => Service}, Config);
context(#{broken := Broken}, Config) ->
    maps:merge(#{broken => Broken}, Config).

%% @doc A fault in this window excuses what it meets.
-spec broken(starl_assumption:window(), #state{}) -> #state{}.
broken(Window, #state{assumption = Assumption, service = Service} = State) ->
    State#state{
        assumption = starl_assumption:broken(Window, Assumption),
        service = starl_dpp_monitor_service:broken(Window, Service)
    }.

%% @doc Requests, plans, lines that are drawn, motions and the end of robots.
-spec interests() -> [atom()].
interests() -> [dpp, dpp_coordinator, app, chassis, robot].

%% @doc {@link starl_dpp_coordinator:event()}, {@link starl_dpp_participant:event()}.
-spec vocabulary() -> starl_event:vocabulary().
vocabulary() ->
    #{
        dpp => [
            {stale_answer, 3}, {doubted, 2}, {void, 1}, {blocked, 1}, {asks, 0}, {answered, 1}
        ],
        dpp_coordinator => [
            {claims, 1},
            {leads, 1},
            {stepped_down, 1},
            {doubted, 2},
            {coordinator, 1},
            {reserved, 2},
            {assigned, 3},
            {deadlock_resolved, 1},
            {silent, 1},
            {in_the_way, 2},
            {unreachable, 1},
            {closed, 1},
            {reopened, 0},
            {malformed, 2}
        ]
    }.

%% @doc Another robot takes over; a coordinator goes on that broken clocks let believe that it leads. A message
%% that is malformed, or a number that is not believed, comes from a computer that is broken, or an insider's.
-spec sometimes() -> [{atom() | {atom(), atom()}, owed | seldom}].
sometimes() ->
    [
        {fail_over, owed},
        {deluded_coordinator, seldom},
        {{dpp_coordinator, malformed}, seldom},
        {{dpp_coordinator, doubted}, seldom},
        {{dpp, doubted}, seldom}
    ].

%% @doc The coordinator and the reservations, while no robot moves.
-spec timeless(#state{}) -> term().
timeless(#state{term = Term, coordinators = Coordinators} = State) ->
    #state{reservations = Reservations, overlaps = Overlaps, waiting = Waiting} = State,
    {Term, lists:sublist(Coordinators, 1), Reservations, Overlaps, Waiting}.

%% @doc Judges one event.
-spec step(starl_monitor:trace_event(), #state{}) ->
    {ok, #state{}} | {violation, starl_monitor:violation(), #state{}}.
step({T, Robot, Machine, Event}, #state{separation = Separation, r_s = Limit} = State) ->
    {Met, Advanced} = starl_separation:advance(T, Separation),
    {Stuck, Served} = served({Machine, Event}, T, Robot, State#state{separation = Advanced}),
    {Broken, Next} = judge({Machine, Event}, T, Robot, Served),
    Found = [encounter(Meeting, Limit) || Meeting <- Met] ++ Stuck ++ Broken,
    case State#state.waiting ++ Found of
        [] -> {ok, Next};
        [First | Rest] -> {violation, First, Next#state{waiting = Rest}}
    end.

%% @doc Judges the time until `EndTimeUs'. Results: `min_separation_mm' (`infinity' with fewer
%% than two robots), and `at_us' and `robots' where there is one; `assignments' and
%% `deadlocks_resolved' are counts; `coordinators' are the robots that led, in order; `left' is what was given
%% up last, if nothing was assigned after that.
-spec finish(integer(), #state{}) ->
    {ok | {violation, [starl_monitor:violation(), ...]}, starl_monitor:results()}.
finish(EndTimeUs, #state{separation = Separation, waiting = Waiting, r_s = Limit} = State) ->
    {Met, Least} = starl_separation:finish(EndTimeUs, Separation),
    Counts = #{
        assignments => State#state.assignments,
        deadlocks_resolved => State#state.deadlocks,
        coordinators => lists:reverse(State#state.coordinators),
        left => State#state.left,
        sometimes => #{
            fail_over => max(0, length(State#state.coordinators) - 1),
            deluded_coordinator => State#state.deluded
        }
    },
    {Unanswered, _} = starl_dpp_monitor_service:pass(EndTimeUs, State#state.service),
    Late = [encounter(Meeting, Limit) || Meeting <- Met] ++ unanswered(Unanswered),
    Off = starl_dpp_monitor_service:unjudged(EndTimeUs, State#state.service),
    Results = starl_unjudged:with(Off, maps:merge(results(Least), Counts)),
    starl_violation:finish(Waiting ++ Late, Results).

results(none) ->
    #{min_separation_mm => infinity};
results({Distance, AtUs, {A, B}}) ->
    #{min_separation_mm => Distance, at_us => AtUs, robots => [A, B]}.

encounter({Distance, AtUs, {A, B}}, Limit) ->
    violation(too_close, AtUs, [A, B], #{distance_mm => Distance, limit_mm => Limit}).

served(Event, T, Robot, #state{service = Before} = State) ->
    {Unanswered, Passed} = starl_dpp_monitor_service:pass(T, Before),
    {GivenUp, Service} = starl_dpp_monitor_service:happened(T, Robot, Event, Passed),
    Lost = [
        violation(given_up, T, [Robot], #{lines => length(unreachable(Event))})
     || GivenUp =/= none
    ],
    {unanswered(Unanswered) ++ Lost, State#state{service = Service}}.

unanswered(none) -> [];
unanswered({Due, Robots}) -> [violation(unanswered, Due, Robots, #{})].

unreachable({dpp_coordinator, {unreachable, Lines}}) -> Lines.

judge({chassis, {motion, Piece}}, T, Robot, #state{separation = Separation} = State) ->
    {without_lease(T, Robot, Piece, State), State#state{
        separation = starl_separation:motion(Robot, Piece, Separation)
    }};
judge({dpp, {answered, assign}}, _T, Robot, #state{drawn = Drawn} = State) ->
    {[], State#state{drawn = Drawn#{Robot => []}}};
judge({app, {stroke, {{_, _}, {_, _}} = Line}}, T, Robot, #state{path_mm = Most} = State) when
    is_float(Most)
->
    draws(T, Robot, Line, State);
judge({robot, {died, _Reason}}, T, Robot, #state{separation = Separation} = State) ->
    Stopped = State#state{separation = starl_separation:stop(Robot, T, Separation)},
    {[], ended_with(Robot, Stopped)};
judge({robot, store_set_back}, _T, _Robot, State) ->
    {[], State#state{set_back = true}};
judge({dpp_coordinator, Event}, _T, Robot, #state{leads = {Term, Robot}} = State) when
    Event =:= crashed; Event =:= {stepped_down, Term}
->
    {[], State#state{ended = true}};
judge({dpp_coordinator, Event}, T, Coordinator, State) ->
    case is_deluded(T, Coordinator, State) of
        true when element(1, Event) =/= leads ->
            {[], State#state{deluded = State#state.deluded + 1}};
        _ ->
            coordinated(Event, T, Coordinator, State)
    end;
judge({_Machine, _Other}, _T, _Robot, State) ->
    {[], State}.

%% A term ends with the robot that leads in it.
ended_with(Robot, #state{leads = {_Term, Robot}} = State) -> State#state{ended = true};
ended_with(_Robot, State) -> State.

coordinated({assigned, Robot, _ReqId, Segments}, T, Coordinator, State) ->
    {Broken, Next} =
        reserve(T, Robot, Segments, State#state{
            assignments = State#state.assignments + 1, left = none, in_the_way = #{}
        }),
    {usurped(T, Coordinator, State) ++ Broken, Next};
coordinated({deadlock_resolved, _Robots}, _T, _Robot, #state{deadlocks = N} = State) ->
    {[], State#state{deadlocks = N + 1}};
coordinated({reserved, Robot, Segments}, T, _Coordinator, State) ->
    reserve(T, Robot, Segments, State);
coordinated({silent, Robot}, T, _Coordinator, #state{silent = Silent} = State) ->
    {[], State#state{silent = Silent#{Robot => T}}};
coordinated({in_the_way, Robot, Lines}, T, _Coordinator, #state{silent = Silent} = State) ->
    Known = State#state.in_the_way,
    Since = maps:get(Robot, Silent, T),
    {[], State#state{in_the_way = Known#{Robot => {Since, Lines}}}};
coordinated({unreachable, [_ | _] = Edges}, _T, _Coordinator, State) ->
    Left = left(length(Edges), lists:sort(maps:to_list(State#state.in_the_way))),
    {[], State#state{left = Left, in_the_way = #{}}};
coordinated({coordinator, Term}, _T, Robot, #state{term = Last} = State) when
    Last =:= none; Term > Last
->
    #state{coordinators = Known} = State,
    {[], State#state{
        term = Term, reservations = #{}, coordinators = led(Robot, Known)
    }};
coordinated({leads, Term}, _T, Robot, #state{leads = Latest} = State) when
    Latest =:= none; {Term, Robot} > Latest
->
    {[], State#state{leads = {Term, Robot}, ended = false, set_back = false}};
%% The robots that know of the later term have forgotten it.
coordinated({leads, Term}, _T, Robot, #state{ended = true, set_back = true} = State) ->
    {[], State#state{leads = {Term, Robot}, ended = false, term = none}};
coordinated(_Other, _T, _Robot, State) ->
    {[], State}.

%% Another robot leads, and broken clocks explain that this one does not know it: its own has lost,
%% or a voter's has gained, more than a clock may be set. Two that are each set within the bound
%% explain nothing.
is_deluded(_T, Robot, #state{leads = {_, Robot}}) ->
    false;
is_deluded(_T, _Robot, #state{leads = none}) ->
    false;
is_deluded(T, Robot, #state{robots = Robots, assumption = Assumption} = State) ->
    case starl_assumption:is_kept(Assumption) of
        true ->
            false;
        false ->
            Since = starl_assumption:clock_earlier(
                Robot, T, T - State#state.lease_us, Assumption
            ),
            Lost = starl_assumption:lost_us(Robot, Since, T, Assumption),
            Gained = [
                starl_assumption:gained_us(Voter, Since, T, Assumption)
             || Voter <- Robots, Voter =/= Robot
            ],
            lists:max([Lost | Gained]) > State#state.jump_us
    end.

left(Edges, InTheWay) ->
    Closed = lists:usort(lists:append([Lines || {_Robot, {_Since, Lines}} <- InTheWay])),
    #{
        edges => Edges,
        in_the_way => [{Robot, Since, length(Lines)} || {Robot, {Since, Lines}} <- InTheWay],
        cut_off => Edges - length(Closed)
    }.

led(Robot, [Robot | _] = Known) -> Known;
led(Robot, Known) -> [Robot | Known].

usurped(T, Coordinator, #state{leads = {Term, Leader}}) when Leader =/= Coordinator ->
    Robots = [min(Coordinator, Leader), max(Coordinator, Leader)],
    [violation(two_coordinators, T, Robots, #{term => Term})];
usurped(_T, _Coordinator, #state{coordinators = []}) ->
    [];
usurped(_T, Coordinator, #state{coordinators = [Coordinator | _]}) ->
    [];
usurped(T, Coordinator, #state{coordinators = [Leader | _], term = Term}) ->
    Robots = [min(Coordinator, Leader), max(Coordinator, Leader)],
    [violation(two_coordinators, T, Robots, #{term => Term})].

without_lease(T, Robot, Piece, #state{reservations = Reservations} = State) ->
    case {starl_trajectory:rests_from(Piece), Reservations} of
        {never, #{Robot := {_, Segments}}} ->
            Off = off_mm(starl_trajectory:position(T, Piece), Segments),
            Most = maps:get(Robot, State#state.offs, State#state.off_mm),
            [
                violation(moves_without_lease, T, [Robot], #{off_mm => Off, limit_mm => Most})
             || Off > Most
            ];
        {never, #{}} ->
            [violation(moves_without_reservation, T, [Robot], #{})];
        {_Rests, _} ->
            []
    end.

%% An application that begins anew may draw a line of its path again.
draws(T, Robot, Line, #state{drawn = Drawn, path_mm = Most} = State) ->
    Before = maps:get(Robot, Drawn, []),
    Lines = [Line | lists:delete(Line, Before)],
    Mm = lists:sum([starl_geometry:length(Each) || Each <- Lines]),
    {
        [
            violation(beyond_horizon, T, [Robot], #{lines_mm => Mm, limit_mm => Most})
         || Mm > Most + ?SUM_MM, length(Lines) > length(Before)
        ],
        State#state{drawn = Drawn#{Robot => Lines}}
    }.

%% The robot need be on one segment only.
off_mm(Point, Segments) ->
    lists:min([starl_geometry:point_segment(Point, Segment) || Segment <- Segments]).

%%% Reservations

reserve(_T, Robot, [], #state{reservations = Reservations} = State) ->
    {[], State#state{reservations = maps:remove(Robot, Reservations)}};
reserve(T, Robot, Segments, #state{reservations = Reservations, overlaps = Overlaps} = State) ->
    Own = {box(Segments), Segments},
    Broken =
        case not Overlaps andalso is_part(Segments, maps:get(Robot, Reservations, none)) of
            true -> [];
            false -> overlaps(T, Robot, Own, State)
        end,
    {Broken, State#state{
        reservations = Reservations#{Robot => Own}, overlaps = Overlaps orelse Broken =/= []
    }}.

%% Is the new reservation the end of the one that the robot held? While all reservations are apart,
%% so is this one.
is_part(_Segments, none) -> false;
is_part(Segments, {_Box, Held}) -> lists:suffix(Segments, Held).

overlaps(T, Robot, {Box, Segments} = Own, #state{reservations = Reservations} = State) ->
    Apart = State#state.apart_mm,
    Zone = starl_geometry:grow(Box, Apart),
    Near = [
        Other
     || {Who, {Theirs, Held}} = Other <- maps:to_list(Reservations),
        Who =/= Robot,
        starl_geometry:overlap(Zone, Theirs),
        closer(Segments, Held, Apart)
    ],
    [overlap(T, Robot, Own, Other, State) || Other <- lists:sort(Near)].

box(Segments) ->
    starl_geometry:box(lists:append([[A, B] || {A, B} <- Segments])).

closer(Segments, Others, Apart) ->
    Meets = fun(S) -> lists:any(fun(O) -> starl_geometry:closer(S, O, Apart) end, Others) end,
    lists:any(Meets, Segments).

overlap(T, Robot, {_, Segments}, {Other, {_, Others}}, #state{apart_mm = Apart}) ->
    Distance = lists:min([starl_geometry:segment_segment(S, O) || S <- Segments, O <- Others]),
    Details = #{distance_mm => Distance, limit_mm => Apart + ?SLACK_MM},
    violation(tubes_overlap, T, [min(Robot, Other), max(Robot, Other)], Details).

violation(What, T, Robots, Details) ->
    starl_violation:new(dpp, What, T, Robots, Details).
