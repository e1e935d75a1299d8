%% @doc The clock of live robots: the system time of their computer, in microseconds since an epoch
%% that the whole run shares. A simulated world may run faster than real time; then all durations
%% shrink in proportion.
%%
%% System time must be set (by NTP, PTP, chrony) before a robot starts. The VM never lets it jump
%% afterwards: it corrects the time slowly, by at most 1 % (`erl' without time warp). The time of
%% day follows the computer's clock, and jumps with it. It decides whether packets are fresh.
%%
%% The robot accesses its computer's time and timers only through this clock. A simulation gives it
%% another computer: a module of this behaviour.
-module(starl_live_clock).

-export([new/2, on/2, epoch_us/1, now_us/1, monotonic_ms/2, at_us/2]).
-export([system_time/2, time_of_day/2, monotonic_time/2, start_timer/4, send_after/3]).
-export([ahead_us/1, live_facts/2]).

-export_type([t/0]).

%% The epoch in microseconds of system time, the pace of the run (2.0 is twice as fast as real), and
%% the computer whose time it is: this one, or a simulated one.
-opaque t() :: {EpochUs :: integer(), Pace :: float(), computer | {module(), Handle :: term()}}.

%% The functions of this name in `erlang', on a simulated computer. A timer's message comes to the
%% calling process.
-callback system_time(erlang:time_unit(), Handle :: term()) -> integer().
%% As `os:system_time/1'.
-callback time_of_day(erlang:time_unit(), Handle :: term()) -> integer().
-callback monotonic_time(erlang:time_unit(), Handle :: term()) -> integer().
-callback start_timer(Ms :: integer(), Message :: term(), [{abs, boolean()}], Handle :: term()) ->
    reference().
-callback send_after(Ms :: non_neg_integer(), Message :: term(), Handle :: term()) -> reference().

%% @doc A clock with this epoch, which passes `Pace' times as fast as real time.
-spec new(EpochUs :: integer(), Pace :: number()) -> t().
new(EpochUs, Pace) when Pace > 0 -> {EpochUs, float(Pace), computer}.

%% @doc The facts of a run, as one in real time by this clock.
-spec live_facts(starl_observer:facts(), t()) -> starl_observer:facts().
live_facts(Facts, Clock) -> Facts#{kind := live, epoch_us => epoch_us(Clock)}.

%% @doc The same clock on a simulated computer.
-spec on({module(), Handle :: term()}, t()) -> t().
on({_Module, _Handle} = Computer, {Epoch, Pace, _}) -> {Epoch, Pace, Computer}.

%% @doc The system time of this clock's time 0, in microseconds.
-spec epoch_us(t()) -> integer().
epoch_us({Epoch, _Pace, _}) -> Epoch.

%% @doc The present time.
-spec now_us(t()) -> integer().
now_us(Clock) -> at_us(system_time(microsecond, Clock), Clock).

%% @doc The time of this clock at a system time.
-spec at_us(SystemUs :: integer(), t()) -> integer().
at_us(SystemUs, {Epoch, Pace, _}) when Pace == 1, is_integer(SystemUs), is_integer(Epoch) ->
    SystemUs - Epoch;
at_us(SystemUs, {Epoch, Pace, _}) ->
    round((SystemUs - Epoch) * Pace).

%% @doc The monotonic time in milliseconds at which this clock will have reached a time, rounded up:
%% for `erlang:start_timer/4' with an absolute time. It may be in the past.
-spec monotonic_ms(DueUs :: integer(), t()) -> integer().
monotonic_ms(DueUs, {_, Pace, _} = Clock) ->
    LeftUs = (DueUs - now_us(Clock)) / Pace,
    ceil((monotonic_time(microsecond, Clock) + LeftUs) / 1000).

%% -- the computer ---------------------------------------------------------------------------

%% @doc The computer's system time, which other computers share.
-spec system_time(erlang:time_unit(), t()) -> integer().
system_time(Unit, {_, _, computer}) -> erlang:system_time(Unit);
system_time(Unit, {_, _, {Module, Handle}}) -> Module:system_time(Unit, Handle).

%% @doc What the computer's clock shows now: it jumps when the clock is set.
-spec time_of_day(erlang:time_unit(), t()) -> integer().
time_of_day(Unit, {_, _, computer}) -> os:system_time(Unit);
time_of_day(Unit, {_, _, {Module, Handle}}) -> Module:time_of_day(Unit, Handle).

%% @doc How far the VM's time is ahead of the computer's clock, which was set since the VM started.
-spec ahead_us(t()) -> integer().
ahead_us(Clock) -> system_time(microsecond, Clock) - time_of_day(microsecond, Clock).

%% @doc The computer's monotonic time.
-spec monotonic_time(erlang:time_unit(), t()) -> integer().
monotonic_time(Unit, {_, _, computer}) -> erlang:monotonic_time(Unit);
monotonic_time(Unit, {_, _, {Module, Handle}}) -> Module:monotonic_time(Unit, Handle).

%% @doc Starts a timer of the calling process, in milliseconds of the computer's time.
-spec start_timer(Ms :: integer(), Message :: term(), [{abs, boolean()}], t()) -> reference().
start_timer(Ms, Message, Options, {_, _, computer}) ->
    erlang:start_timer(Ms, self(), Message, Options);
start_timer(Ms, Message, Options, {_, _, {Module, Handle}}) ->
    Module:start_timer(Ms, Message, Options, Handle).

%% @doc Sends the calling process a message after this time.
-spec send_after(Ms :: non_neg_integer(), Message :: term(), t()) -> reference().
send_after(Ms, Message, {_, _, computer}) -> erlang:send_after(Ms, self(), Message);
send_after(Ms, Message, {_, _, {Module, Handle}}) -> Module:send_after(Ms, Message, Handle).
