%% @doc The timers that run on a robot. Each has the number under which its event was planned: a
%% timer that was cancelled or started anew meanwhile is known by it when that event comes.
-module(starl_sim_timers).

-export([new/0, start/4, cancel/3, expire/4, forget/2, event_type/1]).

-export_type([t/0, timer/0]).

%% `state_timeout', or the name of another: whatever the machine calls it.
-type timer() :: term().

%% By machine and timer: two names are found faster than a pair of them.
-opaque t() :: #{starl_machine:name() => #{timer() => Seq :: non_neg_integer()}}.

%% @doc None runs.
-spec new() -> t().
new() -> #{}.

%% @doc Starts a timer whose event has this number; one of its name that runs counts no more.
-spec start(starl_machine:name(), timer(), Seq :: non_neg_integer(), t()) -> t().
start(Machine, Timer, Seq, Timers) ->
    case Timers of
        #{Machine := Own} -> Timers#{Machine := Own#{Timer => Seq}};
        #{} -> Timers#{Machine => #{Timer => Seq}}
    end.

%% @doc Cancels a timer, if it runs.
-spec cancel(starl_machine:name(), timer(), t()) -> t().
cancel(Machine, Timer, Timers) ->
    case Timers of
        #{Machine := #{Timer := _} = Own} -> Timers#{Machine := maps:remove(Timer, Own)};
        #{} -> Timers
    end.

%% @doc The event of this number has come: is the timer still waited for?
-spec expire(starl_machine:name(), timer(), Seq :: non_neg_integer(), t()) -> {ok, t()} | stale.
expire(Machine, Timer, Seq, Timers) ->
    case Timers of
        #{Machine := #{Timer := Seq} = Own} ->
            {ok, Timers#{Machine := maps:remove(Timer, Own)}};
        #{} ->
            stale
    end.

%% @doc Forgets the timers of a machine that crashed.
-spec forget(starl_machine:name(), t()) -> t().
forget(Machine, Timers) -> maps:remove(Machine, Timers).

%% @doc How the machine is told that a timer has expired.
-spec event_type(timer()) -> starl_machine:event_type().
event_type(state_timeout) -> state_timeout;
event_type(Timer) -> {timeout, Timer}.
