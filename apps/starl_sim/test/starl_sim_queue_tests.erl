%% The event queue: window by window, by robot, and those of a robot in the order of (time, class,
%% source, sequence).
-module(starl_sim_queue_tests).
-include_lib("eunit/include/eunit.hrl").

an_empty_queue_has_no_next_time_test() ->
    Q = starl_sim_queue:new(10),
    ?assertEqual({[], Q}, starl_sim_queue:take_window(1000, Q)),
    ?assertEqual({infinity, 0}, {starl_sim_queue:next_time(Q), starl_sim_queue:size(Q)}).

%% A window is taken whole, and not before it is over.
a_window_is_taken_whole_and_not_before_its_end_test() ->
    Q = add([{25, 1}, {3, 1}, {9, 1}, {10, 1}]),
    ?assertEqual(0, starl_sim_queue:next_time(Q)),
    ?assertEqual({[], Q}, starl_sim_queue:take_window(9, Q)),
    {First, Q1} = starl_sim_queue:take_window(10, Q),
    ?assertEqual([3, 9], times(First)),
    ?assertEqual({10, 2}, {starl_sim_queue:next_time(Q1), starl_sim_queue:size(Q1)}),
    {Second, Q2} = starl_sim_queue:take_window(20, Q1),
    ?assertEqual([10], times(Second)),
    ?assertEqual(20, starl_sim_queue:next_time(Q2)),
    {Third, Q3} = starl_sim_queue:take_window(30, Q2),
    ?assertEqual([25], times(Third)),
    ?assertEqual(0, starl_sim_queue:size(Q3)).

%% Whatever the order in which they were added, and with equal times.
events_come_in_order_however_they_were_added_test() ->
    Events = [
        {R, T, C, S, N, x}
     || R <- [1, 2], T <- [5, 7], C <- [0, 1, 2], S <- [1, 2], N <- [1, 2]
    ],
    [
        begin
            Shuffled = [E || {_, E} <- lists:sort([{erlang:phash2({Seed, E}), E} || E <- Events])],
            Q = lists:foldl(fun starl_sim_queue:add/2, starl_sim_queue:new(10), Shuffled),
            {Taken, _} = starl_sim_queue:take_window(10, Q),
            ?assertEqual(Events, Taken)
        end
     || Seed <- lists:seq(1, 20)
    ].

%% Against a sorted list, with 2000 random events.
the_queue_is_a_sorted_list_test() ->
    Times = [erlang:phash2({model, N}, 5000) || N <- lists:seq(1, 2000)],
    Q = add([{T, 1} || T <- Times]),
    ?assertEqual(2000, starl_sim_queue:size(Q)),
    ?assertEqual(lists:sort(Times), drain(Q)).

drain(Q) ->
    case starl_sim_queue:next_time(Q) of
        infinity ->
            [];
        Next ->
            {Events, Rest} = starl_sim_queue:take_window((Next div 10 + 1) * 10, Q),
            ?assertNotEqual([], Events),
            times(Events) ++ drain(Rest)
    end.

add(List) ->
    lists:foldl(
        fun({N, {T, R}}, Q) -> starl_sim_queue:add({R, T, 1, R, N, x}, Q) end,
        starl_sim_queue:new(10),
        lists:zip(lists:seq(1, length(List)), List)
    ).

times(Events) -> [element(2, E) || E <- Events].
