%% @doc The behaviour of a simulated chassis. A callback module turns the commands of a script into
%% motion for one kind of chassis ({@link starl_chassis}, which names it). It adds the errors of a
%% real chassis and the faults of actuation. {@link starl_sim_vehicle} handles scripts, their
%% numbers, answers and clocks for all kinds.
-module(starl_sim_chassis).

-export_type([command/0, errors/0, drive/0, key/0]).

%% The command to the drive, as far as the drive can follow it.
-type command() :: starl_chassis:movement().

%% The error of the heading, rad, and the actual distance as a fraction of the commanded one.
-type errors() :: {Skew :: float(), Part :: float()}.

%% A command with its errors; it begins now, or goes on.
-type drive() :: {command(), errors(), begins | goes_on}.

%% The key of random draws.
-type key() :: {Seed :: integer(), starl:robot_id(), non_neg_integer()}.

%% The command to stand.
-callback standing() -> command().
%% A command of a script, and its duration.
-callback command(tuple(), starl_chassis:profile()) -> {command(), Us :: pos_integer()}.
%% The errors of a command, drawn by the key.
-callback errors(command(), key(), starl_chassis:profile()) -> errors().
%% The piece of motion from now on, `same' if it does not change; and whether the chassis notices
%% that its drive does not obey.
-callback move(drive(), Faults, Now, Old, starl_chassis:profile()) ->
    {IsOff :: boolean(), same | starl_trajectory:piece()}
when
    Faults :: [starl_run_fault:compiled()],
    Now :: starl_sim_queue:time(),
    Old :: starl_trajectory:piece().
%% The duration of a script until the robot stands, if it is known beforehand.
-callback lasts_us(starl_chassis:commands()) -> Us :: non_neg_integer() | unknown.
%% The time until a robot in this piece of motion stands, once it is told to stand.
-callback stops_us(starl_sim_queue:time(), starl_trajectory:piece()) -> Us :: non_neg_integer().
