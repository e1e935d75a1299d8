%% @doc Records a sequential application's step so that it can be replayed. It keeps the application
%% as data at the beginning of the step, and the events since. A stack is no data. So the step is
%% executed again with the same events, without repeating its effects. Pure; a part of
%% {@link starl_app_turn}.
-module(starl_app_replay).

-export([new/1, add/2, entries/1]).

-export_type([t/0, entry/0, place/0, snapshot/0]).

%% What came to a step from outside: an event, at this time of the robot's clock; what the clock showed.
-type entry() ::
    {event, starl_machine:event_type() | code, Content :: term(), NowUs :: integer()}
    | {clock, Us :: integer()}.

%% Before the first step, before this step, or after the last.
-type place() :: init | {step, starl_app_code:running()} | over.

%% The turn as it was at this place, and what came.
-type snapshot() :: #{turn := tuple(), at := place(), log := [entry()]}.

%% Newest first, with their number.
-opaque t() :: {non_neg_integer(), [entry()]}.

%% The events of a step that are kept for a snapshot.
-define(MOST_EVENTS, 5000).

%% @doc A step begins; is there to be a snapshot?
-spec new(boolean()) -> t() | none.
new(true) -> {0, []};
new(false) -> none.

%% @doc Something comes. What is too much is not kept.
-spec add(entry(), t()) -> t().
add(_Entry, {N, _}) when N >= ?MOST_EVENTS -> {N + 1, []};
add(Entry, {N, Log}) -> {N + 1, [Entry | Log]}.

%% @doc All that has come, in its order, if it was not too much.
-spec entries(t()) -> {ok, [entry()]} | {error, long_step}.
entries({N, _}) when N > ?MOST_EVENTS -> {error, long_step};
entries({_N, Log}) -> {ok, lists:reverse(Log)}.
