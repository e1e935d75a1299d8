%% The contract of the barrier, clause by clause: traces that keep it and that break it.
-module(starl_barrier_monitor_tests).
-include_lib("eunit/include/eunit.hrl").

judge(Events) -> judge(Events, 0, #{}).

judge(Events, End, Extra) ->
    {Found, _} = run(Events, End, Extra),
    Found.

run(Events, End, Extra) ->
    Start = starl_monitor:new([{starl_barrier_monitor, Extra#{robots => [1, 2]}}]),
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
    {Late, #{starl_barrier_monitor := Results}} = starl_monitor:finish(End, Fed),
    {[What || #{contract := barrier, what := What} <- Met ++ Late], Results}.

trace({T, R, died}) -> {T, R, robot, {died, killed}};
trace({T, R, crashed}) -> {T, R, barrier, crashed};
trace({T, R, down}) -> {T, R, robot, down};
trace({T, R, Event, K}) -> {T, R, barrier, {Event, b, K}}.

all_reach() -> [{1, 1, reached, 1}, {2, 2, reached, 1}].

round_test() ->
    {[], Results} = run(all_reach() ++ [{5, 1, passed, 1}, {9, 2, passed, 1}], 9, #{}),
    ?assertMatch(#{rounds := 1, passed := 2, longest_delta_us := 4}, Results).

passed_early_test() ->
    ?assertEqual([passed_early], judge([{1, 1, reached, 1}, {2, 1, passed, 1}])),
    ?assertEqual([passed_early], judge(all_reach() ++ [{5, 1, passed, 1}, {6, 1, reached, 2},
                                                       {7, 1, passed, 2}])).

out_of_order_test() ->
    ?assertEqual([passed_out_of_order],
                 judge(all_reach() ++ [{5, 1, passed, 1}, {6, 1, passed, 1}])),
    ?assertEqual([reached_out_of_order], judge([{1, 1, reached, 2}])),
    ?assertEqual([passed_early, passed_out_of_order], judge([{1, 1, passed, 1}]) ++
                 judge(all_reach() ++ [{5, 1, passed, 1}, {6, 1, passed, 1}])),
    ?assertEqual([], judge(all_reach() ++ [{3, 1, reached, 1}])).

%% Who has rebooted does not know whether it has passed the round that it had reached. It may go
%% on with the one after it, once, and passes neither early nor a round of before.
reboot_test() ->
    Down = all_reach() ++ [{3, 2, down}],
    ?assertEqual([], judge(Down ++ [{4, 2, reached, 1}, {5, 2, passed, 1}])),
    ?assertEqual([], judge(Down ++ [{4, 2, reached, 2}])),
    ?assertEqual([passed_early], judge(Down ++ [{4, 2, reached, 2}, {5, 2, passed, 2}])),
    ?assertEqual([passed_out_of_order], judge(Down ++ [{4, 2, reached, 2}, {5, 2, passed, 1}])),
    ?assertEqual([reached_out_of_order], judge(Down ++ [{4, 2, reached, 3}])),
    ?assertEqual([reached_out_of_order],
                 judge(Down ++ [{4, 2, reached, 2}, {5, 2, reached, 3}])),
    ?assertEqual([reached_out_of_order], judge(Down ++ [{4, 1, reached, 2}])),
    ?assertEqual([reached_out_of_order],
                 judge(all_reach() ++ [{3, 2, crashed}, {4, 2, reached, 2}])).

late_pass_test() ->
    Late = all_reach() ++ [{5, 1, passed, 1}, {16, 2, passed, 1}],
    ?assertEqual([late_pass], judge(Late, 20, #{delta_us => 10})),
    ?assertEqual([], judge(Late, 20, #{delta_us => 11})),
    ?assertEqual([], judge([{0, 2, crashed} | Late], 20, #{delta_us => 10})).

not_passed_test() ->
    Bound = #{bound_us => 10},
    ?assertEqual([not_passed], judge(all_reach(), 13, Bound)),
    ?assertEqual([], judge(all_reach(), 12, Bound)),
    ?assertEqual([], judge([{1, 1, reached, 1}], 900, Bound)),
    ?assertEqual([], judge(all_reach() ++ [{3, 1, died}, {3, 2, died}], 900, Bound)).
