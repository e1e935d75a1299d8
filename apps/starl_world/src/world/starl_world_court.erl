%% @doc The live judge of a run: its judge ({@link starl_world_judge}), the faults that were
%% reported to its watchers, and its observer. The faults are scheduled and manual ones, and the
%% pauses of robots whose nodes are halted; such a pause begins when the robot stops. Parts of the
%% run that are no longer judged are logged. At the end there is an outcome as of a simulation, with
%% the counters of the robots that still run.
-module(starl_world_court).

-export([new/2, told/2, leader/1, radioed/2, undone/3, late/3, clock/3]).
-export([up/3, down/2, complete/4]).
-export([fault/3, halt/4, halted/3, released/3, heard/3]).
-export([look/3, accept/3, accuse/2, close/2, outcome/4]).

-export_type([t/0]).

-record(court, {
    judge :: starl_world_judge:t(),
    observer :: starl_observer:t(),
    %% latest first
    faults = [] :: [starl_world_faults:fault()],
    %% the fault of each pause, and since when the robot stands
    pauses = #{} :: #{starl:robot_id() => {Fault :: atom(), SinceMs :: integer() | none}},
    leader = none :: starl:robot_id() | none
}).

-opaque t() :: #court{}.

%% @doc A live judge with these monitors.
-spec new([{module(), map()}], starl_observer:t()) -> t().
new(Monitors, Observer) ->
    Judge = starl_world_judge:new(Monitors, starl_world_judge:horizon_us(), Observer),
    #court{judge = Judge, observer = Observer}.

%% -- facts ----------------------------------------------------------------------------------

%% @doc Handles reported facts.
-spec told([starl_monitor:trace_event()], t()) -> t().
told(Events, #court{judge = Judge, leader = Leader} = Court) ->
    Court#court{
        judge = starl_world_judge:told(Events, Judge),
        leader = lists:foldl(fun leads/2, Leader, Events)
    }.

leads({_Us, Robot, _Machine, {leads, _Term}}, _Leader) -> Robot;
leads(_Event, Leader) -> Leader.

%% @doc The robot that leads, by the latest report.
-spec leader(t()) -> starl:robot_id() | none.
leader(#court{leader = Leader}) -> Leader.

%% @doc Handles the reports of a robot's radio on packets.
-spec radioed([starl_monitor:trace_event()], t()) -> t().
radioed(Events, #court{judge = Judge} = Court) ->
    Court#court{judge = starl_world_judge:heard(Events, Judge)}.

%% @doc Withdraws reported facts.
-spec undone([starl_monitor:trace_event(), ...], NowUs :: integer(), t()) -> t().
undone(Events, Now, #court{judge = Judge} = Court) ->
    by(starl_world_judge:undone(Events, Now, Judge), Court).

%% @doc Something is heard now that has happened then: so late it cannot be judged at its time.
-spec late(ThenUs :: integer(), NowUs :: integer(), t()) -> t().
late(Then, Now, #court{judge = Judge} = Court) ->
    case Then < Now - starl_world_judge:back_us() of
        true -> by(starl_world_judge:stood_still(Then, Now, Judge), Court);
        false -> Court
    end.

%% @doc Records how far the clock of a robot's computer is ahead, or behind.
-spec clock(starl:robot_id(), AheadUs :: integer(), t()) -> t().
clock(Id, Us, #court{judge = Judge} = Court) -> by(starl_world_judge:clock(Id, Us, Judge), Court).

%% @doc A robot is up: its facts are waited for.
-spec up(starl:robot_id(), NowUs :: integer(), t()) -> t().
up(Id, Now, #court{judge = Judge} = Court) ->
    Court#court{judge = starl_world_judge:up(Id, Now, Judge)}.

%% @doc A robot is down: all its facts have come.
-spec down(starl:robot_id(), t()) -> t().
down(Id, #court{judge = Judge} = Court) ->
    Court#court{judge = starl_world_judge:down(Id, Judge)}.

%% @doc A robot that was asked then answers now: all its facts up to then have come.
-spec complete(starl:robot_id(), ThenUs :: integer(), NowUs :: integer(), t()) -> t().
complete(Id, Then, Now, #court{judge = Judge} = Court) ->
    Court#court{judge = starl_world_judge:complete(Id, Then, Now, Judge)}.

%% -- faults ---------------------------------------------------------------------------------

%% @doc Begins or ends a scheduled or manual fault. The watchers are notified of both alike.
-spec fault(starl_world_faults:report(), NowUs :: integer(), t()) -> t().
fault({Is, Fault}, Now, #court{judge = Judge, observer = Observer, faults = Faults} = Court) ->
    Own = setelement(6, Fault, maps:remove(in_time, element(6, Fault))),
    ok = starl_observer:tell({fault, Now, {Is, Own}}, Observer),
    Court#court{
        judge = starl_world_judge:faults([{Is, Own}], Judge),
        faults = [Own | lists:keydelete(element(1, Own), 1, Faults)]
    }.

%% @doc The node of a robot is about to be halted, by the fault of this name.
-spec halt(starl:robot_id(), Fault :: atom(), NowUs :: integer(), t()) -> t().
halt(Id, Fault, Now, #court{judge = Judge} = Court) ->
    Held = stands(Now, Court#court{judge = starl_world_judge:hold(Id, Now, Judge)}),
    Held#court{pauses = (Held#court.pauses)#{Id => {Fault, none}}}.

%% @doc The robot stands.
-spec halted(starl:robot_id(), NowUs :: integer(), t()) -> t().
halted(Id, Now, #court{judge = Judge} = Court) ->
    stands(Now, Court#court{judge = starl_world_judge:halted(Id, Now, Judge)}).

%% @doc The robot may go on.
-spec released(starl:robot_id(), NowUs :: integer(), t()) -> t().
released(Id, Now, #court{judge = Judge} = Court) ->
    stands(Now, Court#court{judge = starl_world_judge:released(Id, Now, Judge)}).

%% @doc The robot is heard. A node that goes on may have had to wait for its processor.
-spec heard(starl:robot_id(), NowUs :: integer(), t()) -> t().
heard(Id, Now, #court{judge = Judge} = Court) ->
    case starl_world_judge:is_awaited(Id, Judge) of
        true -> stands(Now, Court#court{judge = starl_world_judge:resumed(Id, Now, Judge)});
        false -> Court
    end.

%% A pause has begun where a robot stands, and ended where it does no more.
stands(Now, #court{judge = Judge, pauses = Pauses} = Court) ->
    Standing = starl_world_judge:standing(Judge),
    lists:foldl(
        fun({Robot, Pause}, C) ->
            paused(Robot, Pause, lists:member(Robot, Standing), Now, C)
        end,
        Court,
        lists:sort(maps:to_list(Pauses))
    ).

paused(Robot, {Fault, none}, true, Now, #court{pauses = Pauses} = Court) ->
    Begun = Court#court{pauses = Pauses#{Robot := {Fault, Now div 1000}}},
    fault({began, {Fault, Now div 1000, forever, pause, Robot, #{}}}, Now, Begun);
paused(Robot, {Fault, Since}, false, Now, #court{pauses = Pauses} = Court) when is_integer(Since) ->
    Over = Court#court{pauses = maps:remove(Robot, Pauses)},
    fault({ended, {Fault, Since, Now div 1000, pause, Robot, #{}}}, Now, Over);
paused(_Robot, _Pause, _Stands, _Now, Court) ->
    Court.

%% -- verdicts -------------------------------------------------------------------------------

%% @doc The judge looks, as in each of these periods. What he finds counts when it is accepted, or said.
-spec look(NowUs :: integer(), PeriodUs :: pos_integer(), t()) ->
    {ok | violation, starl_world_judge:t()}.
look(Now, Period, #court{judge = Judge}) -> starl_world_judge:look(Now, Period, Judge).

%% @doc What this judge has found without a violation counts.
-spec accept(starl_world_judge:t(), NowUs :: integer(), t()) -> t().
accept(Judge, Now, Court) -> stands(Now, by(Judge, Court)).

%% @doc The violation that this judge has found is said.
-spec accuse(starl_world_judge:t(), t()) -> t().
accuse(Judge, Court) -> by(starl_world_judge:accuse(Judge), Court).

%% @doc What this judge has found last, when the time is over.
-spec close(starl_world_judge:t(), t()) -> t().
close(Judge, Court) -> by(Judge, Court).

%% What is not judged any more is logged.
by(Judge, #court{judge = Before} = Court) ->
    Known = starl_world_judge:unjudged(Before),
    _ = [
        logger:warning(#{what => not_judged, why => unicode:characters_to_binary(Line)})
     || Part <- starl_world_judge:unjudged(Judge) -- Known, Line <- [starl_unjudged:format(Part)]
    ],
    Court#court{judge = Judge}.

%% @doc The outcome of a run that ends now. It closes the monitors and notifies the observer.
-spec outcome(starl_world:ending() | none, NowUs :: integer(), starl_world_team:t(), t()) ->
    starl_run:outcome().
outcome(Ending, Now, Robots, #court{judge = Judge, observer = Observer, faults = Faults}) ->
    {Violations, Results, Unjudged} = starl_world_judge:close(Now, Judge),
    Told = #{
        ending => Ending,
        end_us => Now,
        violations => Violations,
        unjudged => Unjudged,
        digest => <<>>
    },
    ok = starl_observer:tell({ended, Told}, Observer),
    Outcome = closed(Ending, Now, {Violations, Results, Unjudged}, Robots),
    Outcome#{
        late_computers => starl_world_judge:late_computers(Judge),
        faults => lists:keysort(2, [ended_by(Now div 1000, Fault) || Fault <- Faults])
    }.

%% What has not ended ends with the run.
ended_by(Now, {Id, From, forever, Kind, Target, Params}) -> {Id, From, Now, Kind, Target, Params};
ended_by(_Now, Fault) -> Fault.

closed(Ending, Now, {Violations, Results, Unjudged}, Robots) ->
    Summaries = [
        {Id, summary(Now, Robot)}
     || {Id, Robot} <- starl_world_team:summaries(Now, Robots)
    ],
    #{
        ending => Ending,
        end_us => Now,
        judged_us => Now,
        violations => Violations,
        unjudged => Unjudged,
        monitors => Results,
        robots => Summaries,
        digest => <<>>,
        events => lists:sum([E || {_, #{events := E}} <- Summaries]),
        packets => lists:sum([P || {_, #{packets := P}} <- Summaries]),
        lost => []
    }.

summary(Now, #{result := Result, pose := Pose, link := Link}) ->
    Figures = figures(Link),
    Figures#{
        at_us => Now,
        chain => 0,
        checkpoints => [],
        result => Result,
        pose => Pose,
        crashes => []
    }.

figures(none) ->
    #{events => 0, packets => 0};
figures(Link) ->
    try
        starl_live_link:figures(Link)
    catch
        exit:_ -> #{events => 0, packets => 0}
    end.
