%% The order in which facts of several robots are judged.
-module(starl_world_judge_tests).
-include_lib("eunit/include/eunit.hrl").

-behaviour(starl_monitor).
-export([init/1, step/2, finish/2]).

%% A monitor that keeps what it sees, and finds `bad' a violation.
init(#{}) -> [].
step({T, Robot, _, bad} = Event, Seen) ->
    Violation = #{contract => test, what => bad, at_us => T, robots => [Robot], details => #{}},
    {violation, Violation, [Event | Seen]};
step(Event, Seen) ->
    {ok, [Event | Seen]}.
finish(End, Seen) -> {ok, #{seen => lists:reverse(Seen), ended => End}}.

%% Facts wait until they are older than the horizon, and come in the order of their time; of one
%% time, in the order of arrival.
order_test() ->
    Judge = told([[{5, 1, a, x}, {9, 1, a, y}], [{3, 2, a, z}, {5, 2, a, w}]], new(10)),
    {ok, Early} = starl_world_judge:judge(12, Judge),
    {ok, Late} = starl_world_judge:judge(15, Early),
    ?assertEqual([{3, z}, {5, x}, {5, w}, {9, y}], seen(Late)),
    ?assertEqual(0, starl_world_judge:late(Late)).

%% A fact that comes too late is judged at the time of the last one, and counted.
late_test() ->
    {ok, Judge} = starl_world_judge:judge(30, told([[{5, 1, a, x}, {9, 1, a, y}]], new(10))),
    {ok, Next} = starl_world_judge:judge(40, told([[{4, 2, a, late}, {20, 2, a, z}]], Judge)),
    ?assertEqual([{5, x}, {9, y}, {9, late}, {20, z}], seen(Next)),
    ?assertEqual(1, starl_world_judge:late(Next)).

violation_test() ->
    Judge = told([[{5, 1, a, bad}], [{6, 1, a, bad}]], new(10)),
    {ok, Before} = starl_world_judge:judge(14, Judge),
    {violation, After} = starl_world_judge:judge(15, Before),
    ?assertMatch([#{at_us := 5}], starl_world_judge:violations(After)),
    {Violations, _} = starl_world_judge:close(20, After),
    ?assertMatch([#{at_us := 5}, #{at_us := 6}], Violations).

%% The end comes not before the last fact.
close_test() ->
    {[], #{?MODULE := Results}} = starl_world_judge:close(7, told([[{9, 1, a, x}]], new(10))),
    ?assertMatch(#{ended := 9, seen := [{9, 1, a, x}]}, Results).

new(Horizon) -> starl_world_judge:new([{?MODULE, #{}}], Horizon).

told(Batches, Judge) -> lists:foldl(fun starl_world_judge:told/2, Judge, Batches).

seen(Judge) ->
    {_, #{?MODULE := #{seen := Seen}}} = starl_world_judge:close(0, Judge),
    [{T, Event} || {T, _, _, Event} <- Seen].
