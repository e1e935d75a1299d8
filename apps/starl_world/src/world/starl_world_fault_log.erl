%% @doc The faults of a live run that its watchers were told of: those of the schedule and by hand, and the
%% pauses of robots whose nodes are halted, which begin where a robot stands. A pure module.
-module(starl_world_fault_log).

-export([new/0, entry/2, halt/3, stands/3, faults/2]).

-export_type([t/0]).

-record(log, {
    %% latest first
    faults = [] :: [starl_world_faults:fault()],
    %% the fault of each pause, and since when the robot stands
    pauses = #{} :: #{starl:robot_id() => {Fault :: atom(), SinceMs :: integer() | none}}
}).

-opaque t() :: #log{}.

%% @doc None yet.
-spec new() -> t().
new() -> #log{}.

%% @doc The entry of a fault that begins, or ends: its watchers are told of it as of one in a schedule.
-spec entry(starl_world_faults:told(), t()) -> {starl_world_faults:told(), t()}.
entry({Is, Fault}, #log{faults = Faults} = Log) ->
    Own = setelement(6, Fault, maps:remove(in_time, element(6, Fault))),
    {{Is, Own}, Log#log{faults = [Own | lists:keydelete(element(1, Own), 1, Faults)]}}.

%% @doc The node of a robot is about to be halted, by the fault of this name.
-spec halt(starl:robot_id(), Fault :: atom(), t()) -> t().
halt(Robot, Fault, #log{pauses = Pauses} = Log) ->
    Log#log{pauses = Pauses#{Robot => {Fault, none}}}.

%% @doc These robots stand now: the pauses that have begun, and those that have ended.
-spec stands([starl:robot_id()], NowMs :: integer(), t()) -> {[starl_world_faults:told()], t()}.
stands(Standing, Now, #log{pauses = Pauses} = Log) ->
    lists:foldl(
        fun({Robot, Pause}, {Told, L}) ->
            {More, Next} = paused(Robot, Pause, lists:member(Robot, Standing), Now, L),
            {Told ++ More, Next}
        end,
        {[], Log},
        lists:sort(maps:to_list(Pauses))
    ).

paused(Robot, {Fault, none}, true, Now, #log{pauses = Pauses} = Log) ->
    Begun = Log#log{pauses = Pauses#{Robot := {Fault, Now}}},
    {[{began, {Fault, Now, forever, pause, Robot, #{}}}], Begun};
paused(Robot, {Fault, Since}, false, Now, #log{pauses = Pauses} = Log) when is_integer(Since) ->
    Over = Log#log{pauses = maps:remove(Robot, Pauses)},
    {[{ended, {Fault, Since, Now, pause, Robot, #{}}}], Over};
paused(_Robot, _Pause, _Stands, _Now, Log) ->
    {[], Log}.

%% @doc All of them, by their beginnings, at the end of the run: what has not ended ends with it.
-spec faults(NowMs :: integer(), t()) -> [starl_run_fault:t()].
faults(Now, #log{faults = Faults}) -> lists:keysort(2, [ended_by(Now, F) || F <- Faults]).

ended_by(Now, {Id, From, forever, Kind, Target, Params}) -> {Id, From, Now, Kind, Target, Params};
ended_by(_Now, Fault) -> Fault.
