%% The timers of a live robot that run, and when the first of them was due.
-module(starl_live_timers_tests).
-include_lib("eunit/include/eunit.hrl").
-behaviour(starl_live_clock).

-export([system_time/2, time_of_day/2, monotonic_time/2, start_timer/4, send_after/3]).

%% The time is always 7 ms.
system_time(Unit, _) -> erlang:convert_time_unit(7000, microsecond, Unit).
time_of_day(Unit, _) -> system_time(Unit, none).
monotonic_time(Unit, _) -> system_time(Unit, none).
start_timer(_Ms, _Message, [{abs, true}], _) -> make_ref().
send_after(_Ms, _Message, _) -> make_ref().

planned() ->
    Clock = starl_live_clock:on({?MODULE, none}, starl_live_clock:new(0, 1)),
    lists:foldl(
        fun({Mark, Us}, Before) ->
            {Mark, Timers} = starl_live_timers:plan({app, Mark, Us, x}, 7000, Clock, Before),
            Timers
        end,
        starl_live_timers:new(),
        [{0, 500}, {1, 300}, {2, 900}]
    ).

%% Of those that run the first counts; one that is due later than now is not due yet.
the_first_that_runs_is_due_test() ->
    Due = fun(Running, Now) -> element(1, starl_live_timers:due_us(Running, Now, planned())) end,
    ?assertEqual(7300, Due([0, 1, 2], 9000)),
    ?assertEqual(7500, Due([0, 2], 9000)),
    ?assertEqual(7400, Due([0, 2], 7400)),
    ?assertEqual(9000, Due([], 9000)).

%% What does not run any more is forgotten; marks are never given again.
others_are_forgotten_test() ->
    {7300, Left} = starl_live_timers:due_us([1], 9000, planned()),
    ?assertEqual({7300, Left}, starl_live_timers:due_us([0, 1, 2], 9000, Left)),
    Clock = starl_live_clock:on({?MODULE, none}, starl_live_clock:new(0, 1)),
    ?assertMatch({3, _}, starl_live_timers:plan({app, wake, 100, x}, 7000, Clock, Left)).
