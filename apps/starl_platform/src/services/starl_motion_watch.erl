%% @doc Whether a robot's clock goes as that of its chassis does.
%%
%% The chassis says with each answer what its own clock showed when it heard the command. A command is
%% heard at most the profile's `latency_ms' (5) after it was given, so from one command to the next
%% both clocks have to advance by as much, but for that and their drift: else the robot's has stood
%% still, or was set. The answer itself comes no sooner than the command has been carried out; one that
%% comes a second later shows a robot that was paused.
%%
%% A longer latency hides a pause of that length between two commands. What rests on it is a lease: its
%% holder takes it to end earlier than its giver does, by `jump_ms' (`starl_dpp_lease', 2000), which has
%% to be much more than `latency_ms'.
-module(starl_motion_watch).

-export([new/1, agree/3]).

-export_type([t/0, command/0]).

%% So late may an answer be (us); so far apart may two clocks count, beside the drift, as a part, when
%% the profile does not say.
-define(LATE_US, 1000000).
-define(LATENCY_MS, 5).
-define(DRIFT, 0.02).

%% How late a command may be heard; when the robot gave the last one that was answered, and when the
%% chassis heard it.
-opaque t() :: {LatencyUs :: non_neg_integer(), none | {ToldUs :: integer(), HeardUs :: integer()}}.

%% A command: when it was given and how long it takes, at least and at most, when its answer was
%% handled, by the robot's clock.
-type command() :: {
    ToldUs :: integer(),
    Takes :: {LeastUs :: non_neg_integer(), MostUs :: non_neg_integer()},
    AnsweredUs :: integer()
}.

%% @doc Nothing was compared yet.
-spec new(starl_chassis:profile()) -> t().
new(Profile) -> {round(1000 * maps:get(latency_ms, Profile, ?LATENCY_MS)), none}.

%% @doc A command is answered that the chassis heard at this time of its clock: do the clocks agree?
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
