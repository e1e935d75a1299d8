%% @doc Keeps the running timers of a robot, by machine and name. Each has a mark, under which its
%% driver planned the event. A driver never cancels a plan. The event of a timer that was cancelled,
%% or started anew meanwhile, is recognized by its mark and dropped.
-module(starl_robot_timers).

-export([new/0, start/4, cancel/3, expire/4, runs/4, forget/2, marks/1, to_list/1, from_list/1]).
-export([event_type/1]).

-export_type([t/0, timer/0, mark/0]).

%% `state_timeout', or the machine's name for another timer.
-type timer() :: term().

%% The driver's mark of the timer's event.
-type mark() :: term().

%% Keyed by machine, then by timer: two names are found faster than a pair of them.
-opaque t() :: #{starl_machine:name() => #{timer() => mark()}}.

%% @doc No timer runs.
-spec new() -> t().
new() -> #{}.

%% @doc Starts a timer whose event has this mark; it replaces a running timer of its name.
-spec start(starl_machine:name(), timer(), mark(), t()) -> t().
start(Machine, Timer, Mark, Timers) ->
    case Timers of
        #{Machine := Own} -> Timers#{Machine := Own#{Timer => Mark}};
        #{} -> Timers#{Machine => #{Timer => Mark}}
    end.

%% @doc Cancels a timer, if it runs.
-spec cancel(starl_machine:name(), timer(), t()) -> t().
cancel(Machine, Timer, Timers) ->
    case Timers of
        #{Machine := #{Timer := _} = Own} -> Timers#{Machine := maps:remove(Timer, Own)};
        #{} -> Timers
    end.

%% @doc The event of this mark has come: does the timer still run?
-spec expire(starl_machine:name(), timer(), mark(), t()) -> {ok, t()} | stale.
expire(Machine, Timer, Mark, Timers) ->
    case Timers of
        #{Machine := #{Timer := Mark} = Own} ->
            {ok, Timers#{Machine := maps:remove(Timer, Own)}};
        #{} ->
            stale
    end.

%% @doc Does the timer run whose event has this mark?
-spec runs(starl_machine:name(), timer(), mark(), t()) -> boolean().
runs(Machine, Timer, Mark, Timers) ->
    case Timers of
        #{Machine := #{Timer := Mark}} -> true;
        #{} -> false
    end.

%% @doc Forgets the timers of a machine that crashed.
-spec forget(starl_machine:name(), t()) -> t().
forget(Machine, Timers) -> maps:remove(Machine, Timers).

%% @doc The marks of all running timers.
-spec marks(t()) -> [mark()].
marks(Timers) -> [Mark || Own <- maps:values(Timers), Mark <- maps:values(Own)].

%% @doc All running timers, in the order of their names.
-spec to_list(t()) -> [{starl_machine:name(), timer(), mark()}].
to_list(Timers) ->
    lists:sort([
        {Machine, Timer, Mark}
     || {Machine, Own} <- maps:to_list(Timers), {Timer, Mark} <- maps:to_list(Own)
    ]).

%% @doc Timers from a list.
-spec from_list([{starl_machine:name(), timer(), mark()}]) -> t().
from_list(Running) ->
    lists:foldl(
        fun({Machine, Timer, Mark}, Timers) -> start(Machine, Timer, Mark, Timers) end,
        new(),
        Running
    ).

%% @doc The kind of event by which the machine learns that a timer has expired.
-spec event_type(timer()) -> starl_machine:event_type().
event_type(state_timeout) -> state_timeout;
event_type(Timer) -> {timeout, Timer}.
