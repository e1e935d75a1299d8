%% @doc The clock of live robots: the system time of their computer, in microseconds since an epoch
%% that the whole run shares. The time of a simulated world may pass faster than real time; then all
%% durations shrink alike.
%%
%% System time must be set (by NTP, PTP, chrony) before a robot starts. The VM never lets it jump
%% afterwards: it corrects the time slowly, by at most 1 % (`erl' without time warp).
-module(starl_live_clock).

-export([new/2, epoch_us/1, now_us/1, monotonic_ms/2, at_us/2]).

-export_type([t/0]).

%% The epoch in microseconds of system time, and the pace of the run: 2.0 is twice as fast as real.
-opaque t() :: {EpochUs :: integer(), Pace :: float()}.

%% @doc A clock with this epoch, which passes `Pace' times as fast as real time.
-spec new(EpochUs :: integer(), Pace :: number()) -> t().
new(EpochUs, Pace) when Pace > 0 -> {EpochUs, float(Pace)}.

%% @doc The system time of this clock's time 0, in microseconds.
-spec epoch_us(t()) -> integer().
epoch_us({Epoch, _Pace}) -> Epoch.

%% @doc The present time.
-spec now_us(t()) -> integer().
now_us(Clock) -> at_us(erlang:system_time(microsecond), Clock).

%% @doc The time of this clock at a system time.
-spec at_us(SystemUs :: integer(), t()) -> integer().
at_us(SystemUs, {Epoch, Pace}) when Pace == 1, is_integer(SystemUs), is_integer(Epoch) ->
    SystemUs - Epoch;
at_us(SystemUs, {Epoch, Pace}) ->
    round((SystemUs - Epoch) * Pace).

%% @doc The monotonic time in milliseconds at which this clock will have reached a time, rounded up:
%% for `erlang:start_timer/4' with an absolute time. It may be in the past.
-spec monotonic_ms(DueUs :: integer(), t()) -> integer().
monotonic_ms(DueUs, {_, Pace} = Clock) ->
    LeftUs = (DueUs - now_us(Clock)) / Pace,
    ceil((erlang:monotonic_time(microsecond) + LeftUs) / 1000).
