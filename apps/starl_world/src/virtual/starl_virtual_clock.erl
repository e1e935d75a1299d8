%% @doc The clock of a simulated computer ({@link starl_live_clock}). It shows the time that the
%% simulation has set, to each of the robot's processes. What the computer's timers are asked for
%% comes to the calling process at once, as a {@link timer()}: the process that runs the simulation
%% plans it. Its time of day may be wrong, and is set right; the system time of the VM goes on as it
%% was at its start.
-module(starl_virtual_clock).
-behaviour(starl_live_clock).

-export([new/1, set/2, set_ahead/3]).
-export([system_time/2, time_of_day/2, monotonic_time/2, start_timer/4, send_after/3]).

-export_type([t/0, timer/0]).

-opaque t() :: atomics:atomics_ref().

%% This message is due at a time of the computer, in microseconds.
-type timer() :: {starl_virtual_timer, DueUs :: integer(), Message :: term()}.

%% The system time at the beginning of a simulation: some day.
-define(EPOCH_US, 1700000000000000).

%% @doc A clock that shows this time of the computer, in microseconds since the beginning.
-spec new(Us :: integer()) -> t().
new(Us) ->
    Clock = atomics:new(3, [{signed, true}]),
    ok = set(Us, Clock),
    Clock.

%% @doc Sets the time of the computer.
-spec set(Us :: integer(), t()) -> ok.
set(Us, Clock) -> atomics:put(Clock, 1, Us).

%% @doc Sets the system time, and the time of day, to this much ahead of the computer's other times.
-spec set_ahead(SystemUs :: integer(), DayUs :: integer(), t()) -> ok.
set_ahead(SystemUs, DayUs, Clock) ->
    ok = atomics:put(Clock, 2, SystemUs),
    atomics:put(Clock, 3, DayUs).

-spec system_time(erlang:time_unit(), t()) -> integer().
system_time(Unit, Clock) -> since_epoch(Unit, 2, Clock).

-spec time_of_day(erlang:time_unit(), t()) -> integer().
time_of_day(Unit, Clock) -> since_epoch(Unit, 3, Clock).

since_epoch(Unit, Ahead, Clock) ->
    Us = ?EPOCH_US + atomics:get(Clock, 1) + atomics:get(Clock, Ahead),
    erlang:convert_time_unit(Us, microsecond, Unit).

-spec monotonic_time(erlang:time_unit(), t()) -> integer().
monotonic_time(Unit, Clock) ->
    erlang:convert_time_unit(atomics:get(Clock, 1), microsecond, Unit).

-spec start_timer(integer(), term(), [{abs, boolean()}], t()) -> reference().
start_timer(Ms, Message, Options, Clock) ->
    Timer = make_ref(),
    Due =
        case lists:member({abs, true}, Options) of
            true -> 1000 * Ms;
            false -> atomics:get(Clock, 1) + 1000 * Ms
        end,
    self() ! {starl_virtual_timer, Due, {timeout, Timer, Message}},
    Timer.

-spec send_after(non_neg_integer(), term(), t()) -> reference().
send_after(Ms, Message, Clock) ->
    self() ! {starl_virtual_timer, atomics:get(Clock, 1) + 1000 * Ms, Message},
    make_ref().
