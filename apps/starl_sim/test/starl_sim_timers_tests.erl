%% Holds: Timers come as if each start had put its event into the queue; one that does not run any
%% more does not come
%% Red: a start that never waits, or always; what is not running comes; what has come stays known;
%% what waits comes at once, or out of its turn
-module(starl_sim_timers_tests).
-include_lib("eunit/include/eunit.hrl").

%% Events of timers come as if each start had put its event into the queue, except those of timers that do
%% not run any more.

-define(UNTIL, 100).

a_timer_is_put_into_the_queue_test() ->
    {Answer, Timers} = starl_sim_timers:start(event(1, 500), starl_sim_timers:new()),
    ?assertEqual(put, Answer),
    ?assertEqual([], starl_sim_timers:waiting(Timers)).

a_later_start_waits_behind_the_first_test() ->
    Timers = started([{1, 500}, {2, 800}]),
    ?assertEqual([event(2, 800)], starl_sim_timers:waiting(Timers)).

only_the_last_start_waits_test() ->
    Timers = started([{1, 500}, {2, 800}, {3, 900}]),
    ?assertEqual([event(3, 900)], starl_sim_timers:waiting(Timers)).

an_earlier_start_is_put_into_the_queue_test() ->
    {_, Timers} = starl_sim_timers:start(event(1, 500), starl_sim_timers:new()),
    ?assertMatch({put, _}, starl_sim_timers:start(event(2, 400), Timers)).

other_names_and_machines_do_not_wait_test() ->
    {_, One} = starl_sim_timers:start(event(1, 500), starl_sim_timers:new()),
    {Name, Two} = starl_sim_timers:start(event(2, 800, motion, other), One),
    {Machine, _} = starl_sim_timers:start(event(3, 800, sap, state_timeout), Two),
    ?assertEqual({put, put}, {Name, Machine}).

what_waits_takes_the_place_of_what_comes_test() ->
    Timers = started([{1, 50}, {2, 800}]),
    {Come, Later, Left} = starl_sim_timers:come([event(1, 50)], ?UNTIL, running(2), Timers),
    ?assertEqual({[], [event(2, 800)]}, {Come, Later}),
    %% and is then the one in the queue
    ?assertMatch({waits, _}, starl_sim_timers:start(event(3, 900), Left)),
    ?assertEqual([], starl_sim_timers:waiting(Left)).

what_waits_comes_in_its_turn_in_the_same_window_test() ->
    Timers = started([{1, 50}, {2, 80}]),
    Others = [packet(60), packet(90)],
    {Come, Later, _} = starl_sim_timers:come(
        [event(1, 50) | Others], ?UNTIL, running(2), Timers
    ),
    ?assertEqual({[packet(60), event(2, 80), packet(90)], []}, {Come, Later}).

the_running_timer_comes_test() ->
    Timers = started([{1, 50}]),
    {Come, Later, Left} = starl_sim_timers:come([event(1, 50)], ?UNTIL, running(1), Timers),
    ?assertEqual({[event(1, 50)], []}, {Come, Later}),
    %% nothing of it is left in the queue
    ?assertMatch({put, _}, starl_sim_timers:start(event(2, 900), Left)).

a_cancelled_timer_does_not_come_test() ->
    Timers = started([{1, 50}, {2, 800}]),
    None = starl_robot_timers:new(),
    {Come, Later, Left} = starl_sim_timers:come([event(1, 50)], ?UNTIL, None, Timers),
    ?assertEqual({[], []}, {Come, Later}),
    ?assertMatch({put, _}, starl_sim_timers:start(event(3, 900), Left)).

an_event_of_a_start_that_was_overtaken_does_not_come_test() ->
    Timers = started([{1, 50}, {2, 40}]),
    {Come, Later, Left} = starl_sim_timers:come(
        [event(2, 40), event(1, 50)], ?UNTIL, running(2), Timers
    ),
    ?assertEqual({[event(2, 40)], []}, {Come, Later}),
    ?assertMatch({put, _}, starl_sim_timers:start(event(3, 900), Left)).

started(Starts) ->
    lists:foldl(
        fun({Seq, Due}, Timers) -> element(2, starl_sim_timers:start(event(Seq, Due), Timers)) end,
        starl_sim_timers:new(),
        Starts
    ).

running(Seq) -> starl_robot_timers:from_list([{motion, state_timeout, Seq}]).

event(Seq, Due) -> event(Seq, Due, motion, state_timeout).

event(Seq, Due, Machine, Timer) -> {1, Due, 1, 1, Seq, {timer, Machine, Timer, patience}}.

packet(Due) -> {1, Due, 2, 2, 7, {sap, packet, none}}.
