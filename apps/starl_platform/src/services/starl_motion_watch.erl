%% @doc Whether a robot's clock goes as that of its chassis does.
%%
%% The chassis says with each answer what its own clock showed when it heard the command. Nothing
%% is late about that time, nor about the one at which the robot gave the command, so from one
%% command to the next both clocks have to advance by as much, but for their drift: else the robot's
%% has stood still, or was set. The answer itself comes no sooner than the command has been carried
%% out; one that comes a second later shows a robot that was paused.
-module(starl_motion_watch).

-export([new/0, agree/3]).

-export_type([t/0, command/0]).

%% So late may an answer be (us); so far apart may two clocks count, and drift, as a part.
-define(LATE_US, 1000000).
-define(FINE_US, 5000).
-define(DRIFT, 0.02).

%% When the robot gave the last command that was answered, and when the chassis heard it.
-opaque t() :: none | {ToldUs :: integer(), HeardUs :: integer()}.

%% A command: when it was given and how long it takes, at least and at most, when its answer was
%% handled, by the robot's clock.
-type command() :: {
    ToldUs :: integer(),
    Takes :: {LeastUs :: non_neg_integer(), MostUs :: non_neg_integer()},
    AnsweredUs :: integer()
}.

%% @doc Nothing was compared yet.
-spec new() -> t().
new() -> none.

%% @doc A command is answered that the chassis heard at this time of its clock: do the clocks agree?
-spec agree(command(), HeardUs :: integer(), t()) -> {boolean(), t()}.
agree({Told, Takes, Answered}, Heard, Watch) ->
    {in_time(Answered - Told, Takes) andalso since(Told, Heard, Watch), {Told, Heard}}.

in_time(Took, {Least, Most}) ->
    Took >= Least - fine(Least) andalso Took =< Most + fine(Most) + ?LATE_US.

since(_Told, _Heard, none) ->
    true;
since(Told, Heard, {Told0, Heard0}) ->
    abs((Told - Told0) - (Heard - Heard0)) =< fine(Heard - Heard0).

fine(Us) -> ?DRIFT * Us + ?FINE_US.
