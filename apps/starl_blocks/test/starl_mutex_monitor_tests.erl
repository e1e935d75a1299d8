%% The contract of mutual exclusion, clause by clause: traces that keep it and that break it.
-module(starl_mutex_monitor_tests).
-include_lib("eunit/include/eunit.hrl").

judge(Events) -> judge(Events, 0, #{}).

judge(Events, End, Config) ->
    {Found, _} = run(Events, End, Config),
    Found.

run(Events, End, Config) ->
    Start = starl_monitor:new([{starl_mutex_monitor, Config}]),
    {Met, Fed} = lists:foldl(
        fun(Event, {Found, M}) ->
            case starl_monitor:step(trace(Event), M) of
                {ok, Next} -> {Found, Next};
                {violation, V, Next} -> {Found ++ [V], Next}
            end
        end,
        {[], Start},
        Events
    ),
    {Late, #{starl_mutex_monitor := Results}} = starl_monitor:finish(End, Fed),
    {[What || #{contract := mutex, what := What} <- Met ++ Late], Results}.

trace({T, Robot, died}) -> {T, Robot, robot, {died, killed}};
trace({T, Robot, Event}) -> {T, Robot, mutex, Event}.

got(T, Robot, Fence) -> {T, Robot, {acquired, a, Fence}}.
let_go(T, Robot, Fence) -> {T, Robot, {released, a, Fence}}.

one_after_the_other_test() ->
    ?assertEqual([], judge([got(1, 1, 5), let_go(2, 1, 5), got(3, 2, 6), let_go(4, 2, 6)])).

two_holders_test() ->
    ?assertEqual([two_holders], judge([got(1, 1, 5), got(2, 2, 6)])),
    ?assertEqual([], judge([got(1, 1, 5), {2, 2, {acquired, b, 6}}])).

every_end_of_a_hold_test() ->
    [?assertEqual([], judge([got(1, 1, 5), {2, 1, End}, got(3, 2, 6)]))
     || End <- [{lease_lost, a, 5}, crashed, died]],
    ?assertEqual([two_holders], judge([got(1, 1, 5), {2, 3, crashed}, got(3, 2, 6)])),
    ?assertEqual([two_holders], judge([got(1, 1, 5), {2, 3, died}, got(3, 2, 6)])).

fences_grow_test() ->
    [?assertEqual([fence_not_larger], judge([got(1, 1, 5), let_go(2, 1, 5), got(3, R, F)]))
     || {R, F} <- [{2, 5}, {2, 4}, {1, 5}]].

not_held_test() ->
    ?assertEqual([not_held], judge([let_go(1, 1, 5)])),
    ?assertEqual([not_held], judge([got(1, 1, 5), {2, 1, {lease_lost, a, 4}}])).

bound_test() ->
    Asked = [{10, 1, {requested, a}}],
    Bound = #{bound_us => 100},
    ?assertEqual([], judge(Asked ++ [got(110, 1, 5)], 900, Bound)),
    ?assertEqual([no_grant_in_time], judge(Asked ++ [got(111, 1, 5)], 900, Bound)),
    ?assertEqual([no_grant_in_time], judge(Asked, 900, Bound)),
    ?assertEqual([], judge(Asked, 900, Bound#{from_us => 11})),
    ?assertEqual([], judge(Asked ++ [{20, 1, crashed}], 900, Bound)).

failed_test() ->
    Failed = [{10, 1, {requested, a}}, {20, 1, {failed, a, timeout}}],
    ?assertEqual([], judge(Failed, 900, #{bound_us => 100})),
    ?assertEqual([not_granted], judge(Failed, 900, #{granted => true})).

fairness_test() ->
    {[], Results} = run([{0, 1, {requested, a}}, {0, 2, {requested, a}}, got(10, 1, 5),
                         let_go(20, 1, 5), got(30, 2, 6)], 40, #{}),
    ?assertMatch(#{longest_wait_us := 30, mean_wait_us := 20.0, unfairness := 1.5,
                   acquired := 2}, Results).
