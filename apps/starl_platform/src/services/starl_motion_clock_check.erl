%% @doc Detects pauses of a robot by comparing its clock with that of its chassis.
%%
%% The chassis adds to each answer the time of its own clock at which it heard the command. It hears
%% a command within the profile's `latency_ms' (5). So from one command to the next both clocks must
%% advance by the same time, up to this latency and their drift. Otherwise the robot's clock has
%% stopped, or was set. An answer comes no sooner than the end of the command. An answer that is a
%% second late reveals a robot that was paused.
%%
%% A longer latency hides a pause of that length between two commands. A lease allows for that: its
%% holder subtracts twice `jump_ms' (`starl_dpp_lease', 2000), and `jump_ms' must be much longer
%% than `latency_ms'.
-module(starl_motion_clock_check).

-export([new/1, agree/3]).

-export_type([t/0, command/0]).

%% The largest delay of an answer (us); the default latency; the largest drift between the two
%% clocks, as a fraction.
-define(LATE_US, 1000000).
-define(LATENCY_MS, 5).
-define(DRIFT, 0.02).

%% The latency of commands; the times at which the robot gave the last answered command, and at
%% which the chassis heard it.
-opaque t() :: {LatencyUs :: non_neg_integer(), none | {ToldUs :: integer(), HeardUs :: integer()}}.

%% A command: the time at which it was given, its least and greatest duration, and the time at which
%% its answer was handled, by the robot's clock.
-type command() :: {
    ToldUs :: integer(),
    Takes :: {LeastUs :: non_neg_integer(), MostUs :: non_neg_integer()},
    AnsweredUs :: integer()
}.

%% @doc A watch without any comparison yet.
-spec new(starl_chassis:profile()) -> t().
new(Profile) -> {round(1000 * maps:get(latency_ms, Profile, ?LATENCY_MS)), none}.

%% @doc Do the clocks agree, given an answered command that the chassis heard at this time?
-spec agree(command(), HeardUs :: integer(), t()) -> {boolean(), t()}.
agree({Told, Takes, Answered}, Heard, {Latency, Last}) ->
    Agree = in_time(Answered - Told, Takes, Latency) andalso since(Told, Heard, Last, Latency),
    {Agree, {Latency, {Told, Heard}}}.

in_time(Took, {Least, Most}, Latency) ->
    Took >= Least - fine(Least, Latency) andalso Took =< Most + fine(Most, Latency) + ?LATE_US.

since(_Told, _Heard, none, _Latency) ->
    true;
since(Told, Heard, {Told0, Heard0}, Latency) ->
    abs((Told - Told0) - (Heard - Heard0)) =< fine(Heard - Heard0, Latency).

fine(Us, Latency) -> ?DRIFT * Us + Latency.
