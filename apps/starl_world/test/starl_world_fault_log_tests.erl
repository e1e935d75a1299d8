%% What the watchers of a live run are told of its faults, and what is left of them at its end.
-module(starl_world_fault_log_tests).
-include_lib("eunit/include/eunit.hrl").

loss(From, To) -> {hand_1, From, To, loss, {1, 2}, #{part => 1.0}}.

pause(Fault, Robot, From, To) -> {Fault, From, To, pause, Robot, #{}}.

told(Told, Log) ->
    {Told, Next} = starl_world_fault_log:entry(Told, Log),
    Next.

%% These robots stand at that time: what is told of it.
stands(Standing, Now, Log) -> starl_world_fault_log:stands(Standing, Now, Log).

new() -> starl_world_fault_log:new().

%% When a fault of a schedule begins is no matter of the watchers, but for the time itself.
a_fault_is_told_as_one_of_a_schedule_test() ->
    {Id, From, To, Kind, Target, Params} = loss(900, forever),
    Given = {Id, From, To, Kind, Target, Params#{in_time => true}},
    {Told, Log} = starl_world_fault_log:entry({began, Given}, new()),
    ?assertEqual({began, loss(900, forever)}, Told),
    ?assertEqual([loss(900, 5000)], starl_world_fault_log:faults(5000, Log)).

%% The end of a fault takes the place of its beginning; what has not ended, ends with the run.
each_fault_is_kept_once_by_its_beginning_test() ->
    Other = {hand_2, 400, forever, loss, {2, 3}, #{part => 1.0}},
    Log = lists:foldl(fun told/2, new(), [
        {began, loss(900, forever)}, {began, Other}, {ended, loss(900, 2000)}
    ]),
    ?assertEqual(
        [setelement(3, Other, 5000), loss(900, 2000)], starl_world_fault_log:faults(5000, Log)
    ).

%% A halt is told as a pause from when the robot stands, however long that takes, until it does no more, each once.
a_pause_lasts_while_its_robot_stands_test() ->
    Halted = starl_world_fault_log:halt(1, a, starl_world_fault_log:halt(2, b, new())),
    {[], Moving} = stands([], 100, Halted),
    {[{began, Began}], One} = stands([1], 200, Moving),
    ?assertEqual(pause(a, 1, 200, forever), Began),
    {[{began, _}], Both} = stands([2, 1], 300, One),
    {[], Still} = stands([1, 2], 400, Both),
    {Ended, Over} = stands([], 500, Still),
    ?assertEqual([{ended, pause(a, 1, 200, 500)}, {ended, pause(b, 2, 300, 500)}], Ended),
    %% who stands without a halt, or after it, is no pause
    ?assertMatch({[], _}, stands([1, 3], 600, Over)).
