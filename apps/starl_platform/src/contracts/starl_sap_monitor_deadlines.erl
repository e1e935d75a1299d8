%% @doc The deadlines of each message: its outcomes and its answer must be known within a bound. The
%% module also says when the monitor may forget the content of a lost message. Pure; a part of
%% {@link starl_sap_monitor}.
%%
%% A message may take longer by the time that its source's own clock, pauses and slowness explain
%% while it is under way ({@link starl_assumption:delayed_us/5}).
-module(starl_sap_monitor_deadlines).

-export([new/1, broken/2, sent/4, lost/4, due/1, pass/3]).

-export_type([t/0, overdue/0]).

-type id() :: starl_sap_monitor_sources:id().
-type sources() :: starl_sap_monitor_sources:t().

%% What is missing, since when, whose fault it is, and what is known of it.
-type overdue() :: {
    outcome_overdue | answer_overdue, AtUs :: integer(), [starl_monitor:robot_id(), ...], map()
}.

-record(deadlines, {
    bound_us :: pos_integer(),
    steps :: pos_integer(),
    assumption :: starl_assumption:t(),
    late_us :: non_neg_integer(),
    %% the next time at which the head of a queue is due
    due = infinity :: integer() | infinity,
    outcomes = starl_sap_monitor_alarms:new() :: starl_sap_monitor_alarms:t(),
    %% messages past the bound whose sources have an excuse: until when, and the bound's end; ordered
    excused = [] :: [{UntilUs :: integer(), DueUs :: integer(), id()}],
    stale = starl_sap_monitor_alarms:new() :: starl_sap_monitor_alarms:t()
}).

-opaque t() :: #deadlines{}.

-define(LATE_US, 60_000_000).
%% One step for each of the 16 transmissions, and one for the report.
-define(STEPS, 17).
%% Clocks are within 1 % of real time.
-define(DRIFT_PPM, 10_000).

%% @doc No message yet; see {@link starl_sap_monitor:init/1}.
-spec new(#{
    bound_us := pos_integer(),
    steps => pos_integer(),
    broken => [starl_assumption:window()],
    late_us => non_neg_integer(),
    atom() => term()
}) -> t().
new(#{bound_us := Bound} = Config) ->
    #deadlines{
        bound_us = Bound,
        steps = maps:get(steps, Config, ?STEPS),
        assumption = starl_assumption:new(maps:get(broken, Config, []), ?DRIFT_PPM),
        late_us = maps:get(late_us, Config, ?LATE_US)
    }.

%% @doc The window excuses what it meets.
-spec broken(starl_assumption:window(), t()) -> t().
broken(Window, #deadlines{assumption = Assumption} = Deadlines) ->
    Deadlines#deadlines{assumption = starl_assumption:broken(Window, Assumption)}.

%% @doc A message was sent at this time.
-spec sent(Us :: integer(), id(), sources(), t()) -> t().
sent(T, Id, Sources, #deadlines{bound_us = Bound, outcomes = Outcomes} = Deadlines) ->
    Due = T + Bound,
    Deadlines#deadlines{
        outcomes = starl_sap_monitor_alarms:push(Due, Id, Sources, Outcomes),
        due = min(Due, Deadlines#deadlines.due)
    }.

%% @doc A message was lost at this time: all its outcomes are known, and it may still be delivered.
-spec lost(Us :: integer(), id(), sources(), t()) -> t().
lost(T, Id, Sources, #deadlines{late_us = Late, stale = Stale} = Deadlines) ->
    Due = T + Late,
    Deadlines#deadlines{
        stale = starl_sap_monitor_alarms:push(Due, Id, Sources, Stale),
        due = min(Due, Deadlines#deadlines.due)
    }.

%% @doc The next time at which something is due.
-spec due(t()) -> integer() | infinity.
due(#deadlines{due = Due}) -> Due.

%% @doc Passes every time before this one (what is due exactly then is still in time): what is overdue, and
%% the messages that are to be forgotten.
-spec pass(Us :: integer(), sources(), t()) -> {[overdue()], [id()], t()}.
pass(T, Sources, Deadlines) ->
    {Overdue, Judged} = pass_outcomes(T, Sources, Deadlines, []),
    {Stale, Queue} = pass_stale(T, Judged#deadlines.stale),
    #deadlines{outcomes = Outcomes, excused = Excused} = Judged,
    Due = lists:min([
        first_until(Excused) | [starl_sap_monitor_alarms:due(Alarms) || Alarms <- [Outcomes, Queue]]
    ]),
    {Overdue, Stale, Judged#deadlines{stale = Queue, due = Due}}.

first_until([{Until, _, _} | _]) -> Until;
first_until([]) -> infinity.

%% An excuse is looked at again when it ends: a further window may have come to light meanwhile.
pass_outcomes(T, Sources, #deadlines{outcomes = Outcomes} = Deadlines, Found) ->
    case {Deadlines#deadlines.excused, starl_sap_monitor_alarms:pop(T, Outcomes)} of
        {[{Until, Due, Id} | Left], _} when Until < T ->
            pass_alarm(T, Due, Id, Sources, Deadlines#deadlines{excused = Left}, Found);
        {_, {{Due, Id}, Queue}} ->
            pass_alarm(T, Due, Id, Sources, Deadlines#deadlines{outcomes = Queue}, Found);
        {_, {none, Queue}} ->
            {lists:sort(fun earlier/2, Found), Deadlines#deadlines{outcomes = Queue}}
    end.

earlier({_, A, _, _}, {_, B, _, _}) -> A =< B.

pass_alarm(T, Due, {Source, _, _} = Id, Sources, Deadlines, Found) ->
    #deadlines{bound_us = Bound, steps = Steps, assumption = Assumption} = Deadlines,
    case late(Due, Id, Sources) of
        none ->
            pass_outcomes(T, Sources, Deadlines, Found);
        Late ->
            case starl_assumption:delayed_us(Source, Due - Bound, Due, Steps, Assumption) of
                Until when Until < T ->
                    pass_outcomes(T, Sources, Deadlines, [setelement(2, Late, Until) | Found]);
                Until ->
                    More = lists:merge([{Until, Due, Id}], Deadlines#deadlines.excused),
                    pass_outcomes(T, Sources, Deadlines#deadlines{excused = More}, Found)
            end
    end.

late(Due, {Source, _, _} = Id, Sources) ->
    case starl_sap_monitor_sources:find(Id, Sources) of
        none ->
            none;
        Message ->
            Dests = starl_sap_monitor_message:open(Message),
            missing(Due, Source, Dests, #{message => Id}, starl_sap_monitor_message:due(Message))
    end.

missing(Due, Source, [_ | _] = Dests, What, _Answer) ->
    {outcome_overdue, Due, [Source | Dests], What};
missing(Due, Source, [], What, {answer, _}) ->
    {answer_overdue, Due, [Source], What};
missing(_Due, _Source, [], _What, not_called) ->
    none.

pass_stale(T, Stale) ->
    case starl_sap_monitor_alarms:pop(T, Stale) of
        {none, Queue} ->
            {[], Queue};
        {{_Due, Id}, Queue} ->
            {Ids, Left} = pass_stale(T, Queue),
            {[Id | Ids], Left}
    end.
