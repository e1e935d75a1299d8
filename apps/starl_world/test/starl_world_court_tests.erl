%% What the watchers of a live run are told of its faults, and what is left of them at its end.
-module(starl_world_court_tests).
-include_lib("eunit/include/eunit.hrl").

loss(From, To) -> {hand_1, From, To, loss, {1, 2}, #{part => 1.0}}.

pause(Fault, Robot, From, To) -> {Fault, From, To, pause, Robot, #{}}.

new() ->
    Self = self(),
    starl_world_court:new([], fun(Told) ->
        Self ! {watched, Told},
        ok
    end).

%% What the watchers are told of faults.
told() ->
    receive
        {watched, {fault, _Us, Told}} -> [Told | told()];
        {watched, _Other} -> told()
    after 0 -> []
    end.

faults(Ms, Court) ->
    {ok, {_, _, #{world := World}}} = starl_sim:plan(
        #{app => starl_world_app, robots => 3, play => #{}, mode => process}, #{}
    ),
    {_, Robots} = starl_world_team:new([], World),
    #{faults := Faults} = starl_world_court:outcome(time, 1000 * Ms, Robots, Court),
    _ = told(),
    Faults.

%% When a fault of a schedule begins is no matter of the watchers, but for the time itself.
a_fault_is_told_as_one_of_a_schedule_test() ->
    {Id, From, To, Kind, Target, Params} = loss(900, forever),
    Given = {Id, From, To, Kind, Target, Params#{in_time => true}},
    Court = starl_world_court:fault({began, Given}, 900000, new()),
    ?assertEqual([{began, loss(900, forever)}], told()),
    ?assertEqual([loss(900, 5000)], faults(5000, Court)).

%% The end of a fault takes the place of its beginning; what has not ended, ends with the run.
each_fault_is_kept_once_by_its_beginning_test() ->
    Other = {hand_2, 400, forever, loss, {2, 3}, #{part => 1.0}},
    Told = [{began, loss(900, forever)}, {began, Other}, {ended, loss(900, 2000)}],
    Court = lists:foldl(fun(One, C) -> starl_world_court:fault(One, 0, C) end, new(), Told),
    ?assertEqual(Told, told()),
    ?assertEqual([setelement(3, Other, 5000), loss(900, 2000)], faults(5000, Court)).

%% A halt is told as a pause from when the robot stands, however long that takes, until it is heard again, each once.
a_pause_lasts_while_its_robot_stands_test() ->
    Halted = starl_world_court:halt(1, a, 0, starl_world_court:halt(2, b, 0, new())),
    ?assertEqual([], told()),
    One = starl_world_court:halted(1, 200000, Halted),
    ?assertEqual([{began, pause(a, 1, 200, forever)}], told()),
    Both = starl_world_court:halted(2, 300000, One),
    ?assertEqual([{began, pause(b, 2, 300, forever)}], told()),
    Released = starl_world_court:released(2, 400000, starl_world_court:released(1, 400000, Both)),
    ?assertEqual([], told()),
    Heard = starl_world_court:heard(2, 500000, starl_world_court:heard(1, 500000, Released)),
    Ended = [pause(a, 1, 200, 500), pause(b, 2, 300, 500)],
    ?assertEqual([{ended, Pause} || Pause <- Ended], told()),
    %% who is heard without a halt, or after it, is no pause
    _ = starl_world_court:heard(3, 600000, starl_world_court:heard(1, 600000, Heard)),
    ?assertEqual([], told()),
    ?assertEqual(Ended, faults(700, Heard)).
