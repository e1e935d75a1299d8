%% @doc A first-in-first-out queue of messages, each to be checked after its due time. Pure; a part
%% of {@link starl_sap_monitor}.
%%
%% Most messages are closed long before they are due: their entries are thrown out when they
%% outnumber the others.
-module(starl_sap_monitor_alarms).

-export([new/0, push/4, pop/2, due/1]).

-export_type([t/0]).

-type alarm() :: {DueUs :: integer(), starl_sap_monitor_sources:id()}.

-type sources() :: starl_sap_monitor_sources:t().

-opaque t() :: {Front :: [alarm()], Back :: [alarm()], non_neg_integer()}.

%% A queue shorter than this is not worth compacting.
-define(COMPACT, 1024).

%% @doc No alarms.
-spec new() -> t().
new() -> {[], [], 0}.

%% @doc Adds an alarm that is due no earlier than those before; the sources know which messages are
%% outstanding.
-spec push(DueUs :: integer(), starl_sap_monitor_sources:id(), sources(), t()) -> t().
push(Due, Id, Sources, {_, _, Count} = Alarms) ->
    {Front, Back, N} =
        case Count > ?COMPACT andalso Count > 2 * starl_sap_monitor_sources:outstanding(Sources) of
            true -> compacted(Sources, Alarms);
            false -> Alarms
        end,
    {Front, [{Due, Id} | Back], N + 1}.

compacted(Sources, {Front, Back, _}) ->
    Live = [
        Alarm
     || {_, Id} = Alarm <- Front ++ lists:reverse(Back),
        starl_sap_monitor_sources:find(Id, Sources) =/= none
    ],
    {Live, [], length(Live)}.

%% @doc The first alarm, if it was due before this time.
-spec pop(TimeUs :: integer(), t()) -> {alarm() | none, t()}.
pop(T, {[{Due, _} = Alarm | Front], Back, N}) when Due < T ->
    {Alarm, {Front, Back, N - 1}};
pop(T, {[], [_ | _] = Back, N}) ->
    pop(T, {lists:reverse(Back), [], N});
pop(_T, Alarms) ->
    {none, Alarms}.

%% @doc When the first alarm is due.
-spec due(t()) -> integer() | infinity.
due({[{Due, _} | _], _Back, _N}) -> Due;
due({[], [], 0}) -> infinity;
due({[], Back, _N}) -> element(1, lists:last(Back)).
