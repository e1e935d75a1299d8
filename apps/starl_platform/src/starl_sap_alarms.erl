%% @doc Messages to look at when their time has passed, first in first out. Pure; a part of
%% {@link starl_sap_monitor}.
%%
%% Most messages are closed long before their time: their entries are thrown out when they
%% outnumber the others.
-module(starl_sap_alarms).

-export([new/0, push/4, pop/2, due/1]).

-export_type([t/0]).

-type alarm() :: {DueUs :: integer(), Id :: term()}.

-opaque t() :: {Front :: [alarm()], Back :: [alarm()], non_neg_integer()}.

%% A queue shorter than this is not worth compacting.
-define(COMPACT, 1024).

%% @doc No alarms.
-spec new() -> t().
new() -> {[], [], 0}.

%% @doc An alarm that is due no earlier than those before; `Open' are the messages still open.
-spec push(DueUs :: integer(), Id :: term(), Open :: #{Id :: term() => term()}, t()) -> t().
push(Due, Id, Open, {Front, Back, N}) when N > ?COMPACT, N > 2 * map_size(Open) ->
    Live = [Alarm || {_, Other} = Alarm <- Front ++ lists:reverse(Back), is_map_key(Other, Open)],
    {Live, [{Due, Id}], length(Live) + 1};
push(Due, Id, _Open, {Front, Back, N}) ->
    {Front, [{Due, Id} | Back], N + 1}.

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
