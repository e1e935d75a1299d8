%% @doc Sleep of an emulated Create, and its line BRC. A Create 2 falls asleep in Passive after five
%% minutes without a command; a low pulse on BRC wakes it, and keeps it awake. Three pulses just after
%% power-on set 19200 baud.
-module(starl_create_sleep).

-export([new/3, is_asleep/1, is_tired/3, sleep/1, command/2, boot/2, brc/3]).

-export_type([t/0]).

-record(sleep, {
    model :: starl_create_packet:model(),
    after_us :: pos_integer(),
    %% is BRC not connected?
    no_wake :: boolean(),
    asleep :: boolean(),
    %% when it heard the last command or pulse
    heard_at :: integer(),
    brc = high :: high | {low, Since :: integer()},
    booted_at :: integer(),
    pulses = 0 :: non_neg_integer()
}).

-opaque t() :: #sleep{}.

%% Pulses count within this time after power-on. A pulse: at least this long.
-define(BOOT_US, 2000000).
-define(PULSE_US, 20000).

%% @doc Just switched on.
-spec new(starl_create_packet:model(), starl_create_quirks:t(), NowUs :: integer()) -> t().
new(Model, #{asleep := Asleep, no_wake := NoWake, sleep_s := Seconds}, Now) ->
    #sleep{
        model = Model,
        after_us = Seconds * 1000000,
        no_wake = NoWake,
        asleep = Asleep,
        heard_at = Now,
        booted_at = Now
    }.

%% @doc Does it sleep?
-spec is_asleep(t()) -> boolean().
is_asleep(#sleep{asleep = Asleep}) -> Asleep.

%% @doc Does it fall asleep, in this mode, at this time?
-spec is_tired(atom(), NowUs :: integer(), t()) -> boolean().
is_tired(Mode, Now, #sleep{model = 2, asleep = false, heard_at = Heard, after_us = After}) when
    Mode =:= passive; Mode =:= off
->
    Now - Heard >= After;
is_tired(_Mode, _Now, _Sleep) ->
    false.

%% @doc It sleeps from now on.
-spec sleep(t()) -> t().
sleep(Sleep) -> Sleep#sleep{asleep = true}.

%% @doc It hears a command.
-spec command(NowUs :: integer(), t()) -> t().
command(Now, Sleep) -> Sleep#sleep{heard_at = Now}.

%% @doc Wakes up, or restarts.
-spec boot(NowUs :: integer(), t()) -> t().
boot(Now, Sleep) ->
    Sleep#sleep{asleep = false, booted_at = Now, heard_at = Now, pulses = 0}.

%% @doc The level of BRC changes. What follows: nothing, it starts, or its line becomes slow.
-spec brc(low | high, NowUs :: integer(), t()) -> {nothing | boot | slow, t()}.
brc(_Level, _Now, #sleep{no_wake = true} = Sleep) ->
    {nothing, Sleep};
brc(low, Now, Sleep) ->
    {nothing, Sleep#sleep{brc = {low, Now}}};
brc(high, Now, #sleep{brc = {low, Since}} = Sleep) when Now - Since >= ?PULSE_US ->
    pulse(Now, Sleep#sleep{brc = high});
brc(high, _Now, Sleep) ->
    {nothing, Sleep#sleep{brc = high}}.

pulse(_Now, #sleep{asleep = true} = Sleep) ->
    {boot, Sleep};
pulse(Now, #sleep{booted_at = Booted, pulses = N} = Sleep) when Now - Booted < ?BOOT_US, N >= 2 ->
    {slow, Sleep#sleep{pulses = 0, heard_at = Now}};
pulse(Now, #sleep{pulses = N} = Sleep) ->
    {nothing, Sleep#sleep{pulses = N + 1, heard_at = Now}}.
