%% When messages were sent, by our clock.
-module(starl_live_clock_offset_tests).
-include_lib("eunit/include/eunit.hrl").

-define(OFFSET, 5000).
-define(WINDOW, 10_000_000).

a_late_message_is_as_old_as_the_fastest_ones_show_test() ->
    ?assertEqual(
        [1000 + ?OFFSET, 2000 + ?OFFSET, 3000 + ?OFFSET], sent([{1000, 0}, {2000, 0}, {3000, 900}])
    ).

no_message_was_sent_after_it_came_test() ->
    ?assertEqual([1700 + ?OFFSET, 2000 + ?OFFSET], sent([{1000, 700}, {2000, 0}])),
    %% one that was faster than all that are known
    Known = starl_live_clock_offset:add(1000, 1700, ?WINDOW, starl_live_clock_offset:new()),
    ?assertEqual(2400, starl_live_clock_offset:ours(2000, 2400, Known)).

a_first_message_was_sent_when_it_came_test() ->
    ?assertEqual(77, starl_live_clock_offset:ours(5, 77, starl_live_clock_offset:new())).

a_clock_that_was_set_is_off_test() ->
    Known = starl_live_clock_offset:add(1000, 1000, ?WINDOW, starl_live_clock_offset:new()),
    IsOff = fun(Their, Our) -> starl_live_clock_offset:is_off(Their, Our, 2_000_000, Known) end,
    ?assertEqual([true, true], [IsOff(90_000_000, 2000), IsOff(1000, 2_001_001)]),
    ?assertEqual([false, false], [IsOff(2_001_000, 1000), IsOff(1000, 2_001_000)]),
    ?assertNot(starl_live_clock_offset:is_off(90_000_000, 0, 1, starl_live_clock_offset:new())).

a_clock_that_drifts_is_followed_test() ->
    Sent = fun(Our, Before) ->
        Their = round(Our * 0.999),
        Known = starl_live_clock_offset:add(Their, Our, ?WINDOW, Before),
        {starl_live_clock_offset:ours(Their, Our, Known) - Our, Known}
    end,
    Times = lists:seq(0, 100_000_000, 1_000_000),
    {Off, _} = lists:mapfoldl(Sent, starl_live_clock_offset:new(), Times),
    ?assert(lists:all(fun(Us) -> Us =< 0 andalso Us >= -21000 end, Off)).

%% The times of messages that were sent then and came so much later than by the offset.
sent(Messages) ->
    {Times, _} = lists:mapfoldl(
        fun({Their, Delay}, Before) ->
            Our = Their + ?OFFSET + Delay,
            Known = starl_live_clock_offset:add(Their, Our, ?WINDOW, Before),
            {starl_live_clock_offset:ours(Their, Our, Known), Known}
        end,
        starl_live_clock_offset:new(),
        Messages
    ),
    Times.
