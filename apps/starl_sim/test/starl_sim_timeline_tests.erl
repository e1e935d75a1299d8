%% The timeline of a run: the order of events and faults, and what lies before each.
-module(starl_sim_timeline_tests).
-include_lib("eunit/include/eunit.hrl").

%% By time, a fault before the events of its time, then by robot, then by number.
order_test() ->
    ?assertEqual(
        [start, {1, 1}, {1, 2}, cut, {1, 3}, {2, 1}, {2, 2}],
        [named(starl_sim_timeline:entry(I, timeline())) || I <- lists:seq(0, 6)]
    ),
    ?assertEqual(6, starl_sim_timeline:last(timeline())).

%% A dropped packet is random loss that was made explicit: it is not on the timeline.
drops_are_not_on_it_test() ->
    Drop = {lost, 0, 9, drop, {1, 2}, #{packet => 3}},
    ?assertEqual(0, starl_sim_timeline:last(starl_sim_timeline:new(#{}, [Drop]))).

at_test() ->
    ?assertEqual(
        [0, 2, 2, 5, 6, 6],
        [starl_sim_timeline:at(Us, timeline()) || Us <- [-1, 0, 2999, 3000, 4000, 99999]]
    ).

before_test() ->
    Before = fun(I) -> starl_sim_timeline:before(I, timeline()) end,
    ?assertEqual(#{robots => #{}, faults => []}, Before(0)),
    ?assertEqual(#{robots => #{1 => {2, 12}}, faults => []}, Before(2)),
    ?assertEqual(#{robots => #{1 => {2, 12}}, faults => [cut()]}, Before(3)),
    ?assertEqual(#{robots => #{1 => {3, 13}, 2 => {1, 21}}, faults => [cut()]}, Before(5)).

following_test() ->
    Following = fun(I, Robots, Most) ->
        [named(E) || E <- starl_sim_timeline:following(I, Robots, Most, timeline())]
    end,
    ?assertEqual([{2, 1}, {2, 2}], Following(2, [2], 3)),
    ?assertEqual([{1, 2}, {1, 3}], Following(1, [], 2)),
    ?assertEqual([], Following(6, [], 2)).

timeline() ->
    starl_sim_timeline:new(
        #{
            1 => [event(1, 0, 11), event(2, 0, 12), event(3, 3000, 13)],
            2 => [event(1, 3000, 21), event(2, 4000, 22)]
        },
        [cut()]
    ).

cut() -> {cut, 3, 9, isolate, 1, #{}}.

event(N, AtUs, Chain) ->
    #{n => N, at_us => AtUs, chain => Chain, machine => sap, type => info, content => none}.

named(start) -> start;
named({_, fault, Fault}) -> element(1, Fault);
named({_, Robot, #{n := N}}) -> {Robot, N}.
