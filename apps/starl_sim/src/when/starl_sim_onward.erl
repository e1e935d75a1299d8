%% @doc Continues a recorded run in the simulator, many times with different random draws. It
%% resumes the run at a snapshot of its robots, replays it up to each requested moment, and then
%% draws anew.
%%
%% Up to the moments every fact is compared with the recording, so the continued run is the recorded
%% one. The continuations draw anew what those of {@link starl_sim_future} do.
-module(starl_sim_onward).
-include_lib("starl_platform/include/starl_robot_order.hrl").

-export([moments/3, live/3, time_us/1, play/3, facts/3, format_error/1]).

-export_type([recorded/0, live/0, image/0, point/0, settings/0, verdict/0, reason/0]).

%% What is known of a run: its facts, in the order of their times, and images of all its robots, the
%% earliest first.
-type recorded() :: #{
    scenario := starl_run_scenario:t(),
    facts := [starl_monitor:trace_event()],
    images := [image()]
}.

%% What is known of a live run at a moment: its facts by then; of each robot what it takes to follow it, or
%% why it cannot be; its piece of motion; the packets that are under way, with the times at which they
%% arrive.
-type live() :: #{
    scenario := starl_run_scenario:t(),
    facts := [starl_monitor:trace_event()],
    robots := #{
        starl:robot_id() => {ok, starl_sim_follow:past()} | {error, starl_sim_follow:reason()}
    },
    pieces := #{starl:robot_id() => starl_trajectory:piece()},
    packets := [
        {To :: starl:robot_id(), AtUs :: integer(), From :: starl:robot_id(), starl_packet:t()}
    ]
}.

%% All robots at a time between two windows, and the number of windows up to then.
-type image() :: {
    starl_sim_queue:time(), Windows :: pos_integer(), #{
        starl:robot_id() => starl_sim_robot:snapshot()
    }
}.

%% A moment from which a run can go on.
-opaque point() :: #{
    scenario := starl_run_scenario:t(),
    image := image(),
    %% what the monitors with these configurations have judged by then; the facts, if others may judge
    judged := {[{module(), map()}], starl_monitor:t()},
    facts := [starl_monitor:trace_event()]
}.

%% The part of the packets that futures lose (`same': as many as the run), and the time at which they end, s.
%% `until_ms': faults that have not begun strike before that.
-type settings() :: #{
    loss := number() | same,
    until_s := number(),
    until_ms := pos_integer(),
    %% the time by which a computer may have prolonged anything
    slack_us => non_neg_integer(),
    histories => starl_run_plan:histories()
}.

%% The contracts that a future breaks; none, as far as it is judged (`unjudged': not to its end).
-type verdict() :: {broken, [atom(), ...]} | kept | unjudged.

-type reason() ::
    {start, starl_sim:reason()}
    | {ended, starl_sim_queue:time()}
    | {broken, starl_monitor:violation()}
    | {parted, starl_monitor:trace_event() | none, starl_monitor:trace_event() | none}
    | {not_kept, starl:robot_id(), starl_snapshot:reason()}
    | {not_followed, starl:robot_id(), starl_sim_follow:reason()}
    | {failed, term()}.

%% No robot is told of on its way from one moment to the next.
-define(NEVER_US, 1 bsl 50).
-define(MANY, 1 bsl 40).

%% @doc The moments of a recording at these times, ascending; each is the beginning of the first window
%% from its time on.
-spec moments(recorded(), [starl_sim_queue:time(), ...], starl_sim:options()) ->
    {ok, [{starl_sim_queue:time(), point()}, ...]} | {error, reason()}.
moments(Recorded, Times, Options) ->
    case starl_sim_trial:apart(fun() -> taken_up(Recorded, Times, Options) end) of
        {ok, Answer} -> Answer;
        {error, _} = Error -> Error
    end.

taken_up(#{scenario := Scenario, facts := Facts, images := Images}, [First | _] = Times, Options) ->
    Alone = Scenario#{mode => inline, shards => 1},
    {From, Now} = from([Image || {At, _, _} = Image <- Images, At =< First]),
    Self = self(),
    Observe = fun(News) -> told(News, Self) end,
    Own = maps:merge(Options, From#{observe => Observe, snapshots_us => ?NEVER_US}),
    case starl_sim:plan(Alone, Own) of
        {ok, {_, _, #{monitors := Monitors}}} ->
            {ok, Sim} = starl_sim:start(Alone, Own),
            {Before, Later} = until(Now, Facts),
            Judged = judged(Before, starl_monitor:guarded(Monitors)),
            State = #{
                sim => Sim,
                scenario => Scenario,
                monitors => Monitors,
                now => Now,
                before => [Before]
            },
            each(Times, Later, Judged, State, []);
        {error, Reason} ->
            {error, {start, Reason}}
    end.

from([]) ->
    {#{}, 0};
from(Images) ->
    {At, Windows, Robots} = lists:last(Images),
    %% the facts of the recording are judged
    Past = fun(_Monitors) -> starl_monitor:guarded([]) end,
    {#{from => #{at_us => At, windows => Windows, robots => Robots, past => Past}}, At}.

told({judged, Trace, _}, To) ->
    To ! {facts, Trace},
    ok;
told(_Other, _To) ->
    ok.

each([], _Facts, _Judged, #{sim := Sim}, Points) ->
    ok = starl_sim:close(Sim),
    {ok, lists:reverse(Points)};
each([Time | Times], Facts, Judged0, #{sim := Sim} = State, Points) ->
    #{now_us := Now, ending := Ending} = starl_sim:run(Sim, Time / 1.0e6),
    {Recorded, Later} = until(Now, Facts),
    case {Ending, parted(Recorded, all_told([])), judged(Recorded, Judged0)} of
        {_, {_, _} = Two, _} ->
            ended(Sim, {parted, element(1, Two), element(2, Two)});
        {_, same, {broken, Violation}} ->
            ended(Sim, {broken, Violation});
        {none, same, Judged} ->
            pictured(Time, Times, Now, {Recorded, Later}, Judged, State, Points);
        {_, same, _} ->
            ended(Sim, {ended, Now})
    end.

ended(Sim, Reason) ->
    ok = starl_sim:close(Sim),
    {error, Reason}.

pictured(
    Time, Times, Now, {Recorded, Later}, Judged, #{sim := Sim, before := Before} = State, Points
) ->
    #{scenario := #{faults := Faults} = Scenario, monitors := Monitors} = State,
    {Windows, Kept} = starl_sim:snapshots(Sim),
    case [{Id, Reason} || {Id, {error, Reason}} <- Kept] of
        [{Id, Reason} | _] ->
            ended(Sim, {not_kept, Id, Reason});
        [] ->
            Robots = maps:from_list([{Id, Robot} || {Id, {ok, Robot}} <- Kept]),
            All = [Recorded | Before],
            Point = #{
                scenario => Scenario,
                image => {Now, max(1, Windows), Robots},
                judged => {Monitors, Judged},
                facts => wanted(has_ahead(Now, Faults), All)
            },
            each(Times, Later, Judged, State#{before := All}, [{Time, Point} | Points])
    end.

%% Only drawn faults have other monitors judge.
wanted(true, All) -> lists:append(lists:reverse(All));
wanted(false, _All) -> [].

has_ahead(Now, Faults) -> lists:any(fun(Fault) -> not is_begun(Now, Fault) end, Faults).

is_begun(Now, {_, FromMs, _, _, _, _}) -> 1000 * FromMs < Now.

until(Us, Facts) -> lists:splitwith(fun({At, _, _, _}) -> At < Us end, Facts).

judged(_Facts, {broken, _} = Broken) ->
    Broken;
judged([], Monitors) ->
    Monitors;
judged(Facts, Monitors) ->
    case starl_monitor:step(Facts, Monitors) of
        {ok, Next} -> Next;
        {violation, Violation, _} -> {broken, Violation}
    end.

all_told(Traces) ->
    receive
        {facts, Trace} -> all_told([Trace | Traces])
    after 0 -> lists:append(lists:reverse(Traces))
    end.

parted([], []) -> same;
parted([Fact | Facts], [Fact | Others]) -> parted(Facts, Others);
parted(Facts, Others) -> {first(Facts), first(Others)}.

first([]) -> none;
first([Fact | _]) -> Fact.

%% @doc The moment of a live run: the beginning of the first window from this time on. Robots that
%% cannot be replayed restart; they are returned with the reasons.
-spec live(live(), starl_sim_queue:time(), starl_sim:options()) ->
    {ok, point(), [{starl:robot_id(), starl_sim_follow:reason()}]} | {error, reason()}.
live(#{scenario := Scenario, robots := Robots} = Live, Time, Options) ->
    case starl_sim:plan(Scenario#{mode => inline, shards => 1}, Options) of
        {ok, {_, _, #{window_us := Window, monitors := Monitors} = Plan}} ->
            At = (Time + Window - 1) div Window * Window,
            Setting = (maps:with([world, crew], Plan))#{at_us => At},
            Each = [
                {Id, followed(Id, maps:get(Id, Robots), Live, Setting)}
             || Id <- lists:sort(maps:keys(Robots))
            ],
            joined(Each, At, Monitors, Live);
        {error, Reason} ->
            {error, {start, Reason}}
    end.

followed(Id, {ok, Past}, Live, Setting) ->
    case starl_sim_follow:robot(Id, Past, Setting) of
        {ok, Kept, Facts} -> {ok, Kept, Facts, none};
        {error, Why} -> followed(Id, {error, Why}, Live, Setting)
    end;
followed(Id, {error, Why}, #{pieces := Pieces}, Setting) ->
    case starl_sim_follow:anew(Id, maps:get(Id, Pieces), Setting) of
        {ok, Kept, Facts} -> {ok, Kept, Facts, Why};
        {error, Reason} -> {error, Reason}
    end.

joined(Each, At, Monitors, #{scenario := Scenario, facts := Before, packets := Packets}) ->
    case [{Id, Why} || {Id, {error, Why}} <- Each] of
        [{Id, Why} | _] ->
            {error, {not_followed, Id, Why}};
        [] ->
            Robots = maps:from_list([{Id, Kept} || {Id, {ok, Kept, _, _}} <- Each]),
            More = lists:append([Facts || {_, {ok, _, Facts, _}} <- Each]),
            case judged(Before ++ lists:keysort(1, More), starl_monitor:guarded(Monitors)) of
                {broken, Violation} ->
                    {error, {broken, Violation}};
                Judged ->
                    Point = #{
                        scenario => Scenario,
                        image => {At, 1, under_way(Packets, At, Robots)},
                        judged => {Monitors, Judged},
                        facts => []
                    },
                    {ok, Point, [{Id, Why} || {Id, {ok, _, _, Why}} <- Each, Why =/= none]}
            end
    end.

under_way(Packets, At, Robots) ->
    lists:foldl(
        fun({N, {To, Us, From, Packet}}, Acc) ->
            #{To := #{planned := Planned} = Robot} = Acc,
            %% no number of a robot's own
            Event = {To, max(At, Us), ?CLASS_PACKET, From, ?MANY + N, {sap, packet, Packet}},
            Acc#{To := Robot#{planned := [Event | Planned]}}
        end,
        Robots,
        lists:enumerate(Packets)
    ).

%% @doc The time from which a continuation of a moment differs.
-spec time_us(point()) -> starl_sim_queue:time().
time_us(#{image := {Now, _, _}}) -> Now.

%% @doc Runs the continuation of this branch seed from a moment, in the calling process; a failing
%% simulation ends that process, too. `none': with the draws of the run.
-spec play(point(), settings(), Salt :: integer() | none) -> {ok, verdict(), Digest :: binary()}.
play(Point, Settings, Salt) ->
    Sim = started(Point, Settings, Salt, #{}),
    _ = starl_sim_trial:whole(Sim),
    {#{violations := Violations, unjudged := Unjudged, digest := Digest}, _} = starl_sim:finish(
        Sim
    ),
    {ok, verdict(lists:usort([Contract || #{contract := Contract} <- Violations]), Unjudged),
        Digest}.

verdict([], []) -> kept;
verdict([], _Unjudged) -> unjudged;
verdict(Broken, _Unjudged) -> {broken, Broken}.

%% @doc The facts of such a continuation.
-spec facts(point(), settings(), Salt :: integer() | none) -> [starl_monitor:trace_event()].
facts(Point, Settings, Salt) ->
    Self = self(),
    Sim = started(Point, Settings, Salt, #{observe => fun(News) -> told(News, Self) end}),
    _ = starl_sim_trial:whole(Sim),
    _ = starl_sim:finish(Sim),
    all_told([]).

started(#{scenario := Scenario, image := {Now, Windows, Robots}} = Point, Settings, Salt, Options) ->
    #{until_s := Until} = Settings,
    From = #{
        at_us => Now,
        windows => Windows,
        robots => Robots,
        past => fun(Given) -> past(Given, Point) end
    },
    Future = drawn(Salt, Now, Settings, Scenario#{time := Until, mode => inline, shards => 1}),
    {ok, Sim} = starl_sim:start(
        Future,
        maps:merge(
            maps:with([histories, slack_us], Settings), Options#{
                from => salted(Salt, Scenario, From)
            }
        )
    ),
    Sim.

past(Given, #{judged := {Given, Judged}}) -> Judged;
past(Given, #{facts := Facts}) -> judged(Facts, starl_monitor:guarded(Given)).

salted(none, _Scenario, From) -> From;
salted(Salt, #{seed := Seed}, From) -> From#{seed => erlang:phash2({Seed, Salt}, 1 bsl 32)}.

drawn(none, _Now, _Settings, Scenario) ->
    Scenario;
drawn(Salt, Now, #{loss := Loss, until_ms := UntilMs}, Scenario) ->
    #{faults := Faults, robots := Robots, loss := Before} = Scenario,
    After = Now div 1000,
    Span = {After, max(1, UntilMs - After)},
    Team = #{robots => Robots, seed => Salt},
    Scenario#{
        loss := chosen(Loss, Before),
        faults := [
            ahead(is_begun(Now, F), F, Span, Salt, Team)
         || F <- Faults, element(4, F) =/= drop
        ]
    }.

chosen(same, Before) -> Before;
chosen(Loss, _Before) -> Loss.

ahead(true, Fault, _Span, _Salt, _Team) ->
    Fault;
ahead(false, Fault, Span, Salt, Team) ->
    starl_run_fault_draw:again(Fault, Span, {Salt, ahead}, Team).

%% @doc One line on why there are no continuations.
-spec format_error(reason()) -> unicode:chardata().
format_error({start, Reason}) ->
    starl_sim:format_error(Reason);
format_error({ended, Us}) ->
    io_lib:format("the run has ended by then, at ~.3f s; choose an earlier moment", [Us / 1.0e6]);
format_error({broken, Violation}) ->
    [
        starl_violation:format(Violation),
        ", before the moment; choose an earlier one"
    ];
format_error({parted, Recorded, Now}) ->
    io_lib:format(
        "what goes on here is not what was recorded: ~ts in the recording, ~ts here; was the program "
        "another one?",
        [fact(Recorded), fact(Now)]
    );
format_error({not_kept, Robot, Reason}) ->
    io_lib:format("robot ~b cannot be taken up: ~ts", [Robot, starl_snapshot:format_reason(Reason)]);
format_error({not_followed, Robot, Reason}) ->
    io_lib:format("robot ~b cannot be taken up: ~ts", [
        Robot, starl_sim_follow:format_reason(Reason)
    ]);
format_error({failed, Reason}) ->
    io_lib:format("the simulation failed: ~0tP", [Reason, 15]).

fact(none) ->
    "nothing more";
fact({At, Robot, Machine, Event}) ->
    io_lib:format("~ts of robot ~b at ~.6f s (~0tP)", [Machine, Robot, At / 1.0e6, Event, 12]).
