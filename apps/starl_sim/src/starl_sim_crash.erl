%% @doc The crashes of a robot and its recoveries: a machine of it, or the whole robot for a
%% while or for good. Virtual time waits meanwhile for whoever restarts it.
%% ```
%%           machine gone: the rest goes on, it is restarted, or given up
%%              +--+                 gave up, killed
%%              |  v          +------------------------> dead
%%               up ----------+                            ^
%%               ^ +-- go_down --> down --- killed --------+
%%               +---- come_up ------+
%% '''
-module(starl_sim_crash).

-export([strike/3, crashed/4, die/3, boots/1]).

-export_type([aftermath/0, local/0, struck/0]).

%% What one of the machines has to do: handle an event, or start.
-type local() :: starl_platform:local() | {starl_machine:name(), boot, none}.

%% What becomes of what the robot still has to do: it goes on with it; it does this first, or
%% nothing but this; of its events, only faults remain, or none.
-type aftermath() :: go_on | {first, [local()]} | {anew, [local()]} | faults_only | nothing.

%% The aftermath, and the robot's body and machines.
-type struck() :: {aftermath(), starl_sim_platform:t(), starl_sim_machines:t()}.

%% @doc Faults that strike the whole robot.
-spec strike(kill_robot | go_down | come_up, starl_sim_platform:t(), starl_sim_machines:t()) ->
    struck().
strike(Fault, Body, Machines) ->
    case {Fault, starl_sim_machines:condition(Machines)} of
        {kill_robot, dead} -> {go_on, Body, Machines};
        {kill_robot, _} -> die(killed, Body, Machines);
        {go_down, up} -> go_down(Body, Machines);
        {come_up, down} -> come_up(Body, Machines);
        _ -> {go_on, Body, Machines}
    end.

%% @doc A machine is gone, for this reason. Virtual time waits until it has been restarted; the
%% others are told. A block or an application that crashes too often is given up, and the robot does
%% without; without its services it has died.
-spec crashed(
    starl_machine:name(), Reason :: term(), starl_sim_platform:t(), starl_sim_machines:t()
) -> struck().
crashed(Name, Reason, Body, Machines) ->
    Bare = blame(Name, starl_crash:cause(Reason), lose(Name, Body)),
    case starl_sim_machines:crashed(Name, Machines) of
        {ok, Names, GivenUp, Back} ->
            Others = starl_sim_machines:names(Back),
            Ends = [End || Lost <- GivenUp, End <- farewell(Lost, Others)],
            Left = lists:foldl(fun give_up/2, Bare, GivenUp),
            {{first, Ends ++ restarts(Names, Others)}, Left, Back};
        gave_up ->
            die(gave_up, Bare, Machines)
    end.

%% What was done to a machine is not its fault.
blame(_Name, none, Body) -> Body;
blame(Name, Cause, Body) -> starl_sim_platform:trace(supervisor, {crashed, Name, Cause}, Body).

give_up(Name, Body) ->
    Traced = starl_sim_platform:trace(supervisor, {given_up, Name}, Body),
    case Name of
        app -> starl_sim_platform:give_up(Traced);
        _ -> Traced
    end.

%% Nobody but its application has an idea where the robot is to go.
farewell(Name, Others) ->
    Stop = [starl_platform:local(starl_motion:stop(), app) || lists:member(motion, Others)],
    Told = [{To, info, {given_up, Name}} || To <- Others],
    case Name of
        app -> Stop ++ Told;
        _ -> Told
    end.

restarts(Names, All) ->
    [{Name, boot, none} || Name <- Names] ++
        [{To, info, {restarted, Name}} || Name <- Names, To <- All, To =/= Name].

lose(Name, Body) ->
    starl_sim_platform:forget_timers(Name, starl_sim_platform:trace(Name, crashed, Body)).

%% @doc A robot that dies for good: it stands where it is, for ever.
-spec die(gave_up | killed, starl_sim_platform:t(), starl_sim_machines:t()) -> struck().
die(Reason, Body, Machines) ->
    Stopped = starl_sim_platform:stop(Body),
    Traced = starl_sim_platform:trace(robot, {died, Reason}, Stopped),
    {nothing, starl_sim_platform:ended(Traced), starl_sim_machines:down(dead, Machines)}.

go_down(Body, Machines) ->
    Stopped = starl_sim_platform:trace(robot, down, starl_sim_platform:stop(Body)),
    Lost = lists:foldl(fun lose/2, Stopped, starl_sim_machines:names(Machines)),
    {faults_only, Lost, starl_sim_machines:down(down, Machines)}.

come_up(Body, Machines) ->
    Up = starl_sim_machines:up(Machines),
    {{anew, boots(Up)}, starl_sim_platform:trace(robot, up, Body), Up}.

%% @doc The start of all machines, in their order.
-spec boots(starl_sim_machines:t()) -> [local()].
boots(Machines) -> [{Name, boot, none} || Name <- starl_sim_machines:names(Machines)].
