%% The clock of a run: its epoch and pace, and the computer whose time it is.
-module(starl_live_clock_tests).
-include_lib("eunit/include/eunit.hrl").
-behaviour(starl_live_clock).

-export([system_time/2, time_of_day/2, monotonic_time/2, start_timer/4, send_after/3]).

%% -- a computer: each of its times is a number ---------------------------------------------------------

system_time(Unit, {System, _Day, _Monotonic}) -> in(Unit, System).
time_of_day(Unit, {_System, Day, _Monotonic}) -> in(Unit, Day).
monotonic_time(Unit, {_System, _Day, Monotonic}) -> in(Unit, Monotonic).

in(Unit, Us) -> erlang:convert_time_unit(Us, microsecond, Unit).

start_timer(Ms, Message, Options, _Times) ->
    self() ! {timer, Ms, Message, Options},
    make_ref().

send_after(Ms, Message, _Times) ->
    self() ! {sent_after, Ms, Message},
    make_ref().

clock(Times, EpochUs, Pace) ->
    starl_live_clock:on({?MODULE, Times}, starl_live_clock:new(EpochUs, Pace)).

%% -- the time of the run -------------------------------------------------------------------------------

%% Time counts from the epoch, and passes at the run's pace: a time that is no whole number is rounded.
time_counts_from_the_epoch_at_the_pace_test_() ->
    [
        ?_assertEqual(Us, starl_live_clock:at_us(SystemUs, starl_live_clock:new(EpochUs, Pace)))
     || {Us, SystemUs, EpochUs, Pace} <- [
            {0, 700, 700, 1},
            {300, 1000, 700, 1},
            {-300, 400, 700, 1},
            {600, 1000, 700, 2},
            {150, 1000, 700, 0.5},
            {-150, 400, 700, 0.5},
            {3, 5, 0, 0.5},
            {4, 3, 0, 1.25},
            %% real time is exact for ever: no float has all microseconds of so long a run
            {1 bsl 60 + 1, 1 bsl 60 + 1, 0, 1}
        ]
    ].

%% Time passes.
no_pace_is_not_positive_test() ->
    [?assertError(function_clause, starl_live_clock:new(0, Pace)) || Pace <- [0, -1, 0.0]].

now_is_the_computers_system_time_test() ->
    ?assertEqual(300, starl_live_clock:now_us(clock({1000, 5, 6}, 700, 1))),
    ?assertEqual(750, starl_live_clock:now_us(clock({1000, 5, 6}, 700, 2.5))),
    ?assertEqual(700, starl_live_clock:epoch_us(clock({1000, 5, 6}, 700, 2.5))).

%% What is left until then shrinks with the pace, and is added to the monotonic time, rounded up.
a_time_of_the_run_is_one_of_the_monotonic_clock_test_() ->
    [
        ?_assertEqual(
            Ms, starl_live_clock:monotonic_ms(DueUs, clock({9000, 0, MonotonicUs}, 4000, Pace))
        )
     || {Ms, DueUs, MonotonicUs, Pace} <- [
            {100, 5000, 100_000, 1},
            {103, 8000, 100_000, 1},
            {104, 8001, 100_000, 1},
            {98, 3000, 100_000, 1},
            %% 10 ms of the run are over
            {100, 10_000, 100_000, 2},
            {103, 16_000, 100_000, 2},
            {105, 5000, 100_000, 0.5},
            {101, 5000, 100_001, 1}
        ]
    ].

%% -- the computer --------------------------------------------------------------------------------------

a_simulated_computer_is_asked_test() ->
    Clock = clock({9_000_000, 7_000_000, 5_000_000}, 0, 1),
    ?assertEqual(9000, starl_live_clock:system_time(millisecond, Clock)),
    ?assertEqual(7000, starl_live_clock:time_of_day(millisecond, Clock)),
    ?assertEqual(5000, starl_live_clock:monotonic_time(millisecond, Clock)),
    %% its clock was set back since the VM started
    ?assertEqual(2_000_000, starl_live_clock:ahead_us(Clock)),
    _ = starl_live_clock:start_timer(8, ring, [{abs, true}], Clock),
    _ = starl_live_clock:send_after(9, word, Clock),
    ?assertEqual({timer, 8, ring, [{abs, true}]}, next(timer)),
    ?assertEqual({sent_after, 9, word}, next(sent_after)).

%% This computer's times lie between two looks at them.
this_computer_is_asked_test_() ->
    Clock = starl_live_clock:new(0, 1),
    [
        ?_test(begin
            Before = Own(microsecond),
            Told = Ask(microsecond, Clock),
            ?assert(Before =< Told andalso Told =< Own(microsecond))
        end)
     || {Own, Ask} <- [
            {fun erlang:system_time/1, fun starl_live_clock:system_time/2},
            {fun os:system_time/1, fun starl_live_clock:time_of_day/2},
            {fun erlang:monotonic_time/1, fun starl_live_clock:monotonic_time/2}
        ]
    ].

%% A timer that is due rings at once, and in this process.
timers_of_this_computer_ring_here_test() ->
    Clock = starl_live_clock:new(0, 1),
    Now = erlang:monotonic_time(millisecond),
    Timer = starl_live_clock:start_timer(Now, ring, [{abs, true}], Clock),
    receive
        {timeout, Timer, Rung} -> ?assertEqual(ring, Rung)
    end,
    Word = make_ref(),
    _ = starl_live_clock:send_after(0, Word, Clock),
    receive
        Word -> ok
    end.

%% The facts of a live run.
a_live_run_has_its_epoch_test() ->
    Clock = starl_live_clock:new(700, 1),
    ?assertEqual(
        #{kind => live, epoch_us => 700},
        starl_live_clock:live_facts(#{kind => simulated, epoch_us => none}, Clock)
    ).

next(What) ->
    receive
        Message when element(1, Message) =:= What -> Message
    end.
