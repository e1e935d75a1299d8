%% The times of a program by the robot's clock.
-module(starl_live_program_clock_tests).
-include_lib("eunit/include/eunit.hrl").

-define(SHIFT, 5000).

%% A line that has come late was said when the quickest lines tell.
a_late_line_was_said_before_test() ->
    ?assertEqual(
        [1000 + ?SHIFT, 2000 + ?SHIFT, 3000 + ?SHIFT], said([{1000, 0}, {2000, 0}, {3000, 900}])
    ).

%% Nothing was said after it came.
nothing_is_said_in_the_future_test() ->
    [First, Second] = said([{1000, 700}, {2000, 0}]),
    ?assertEqual({1700 + ?SHIFT, 2000 + ?SHIFT}, {First, Second}).

what_bears_no_time_was_said_now_test() ->
    {Us, _} = starl_live_program_clock:said(none, 77, starl_live_program_clock:new()),
    ?assertEqual(77, Us).

%% A clock that was set is taken anew, one that drifts is followed.
a_clock_that_was_set_test() ->
    Clock = starl_live_program_clock:new(),
    {_, Known} = starl_live_program_clock:said(1000, 1000, Clock),
    {Us, _} = starl_live_program_clock:said(90_000_000, 2000, Known),
    ?assertEqual(2000, Us).

a_clock_that_is_slow_test() ->
    Times = lists:seq(0, 100_000_000, 1_000_000),
    Said = fun(Now, Clock) ->
        {Us, Next} = starl_live_program_clock:said(round(Now * 0.999), Now, Clock),
        {Us - Now, Next}
    end,
    {Off, _} = lists:mapfoldl(Said, starl_live_program_clock:new(), Times),
    ?assert(lists:all(fun(Us) -> Us =< 0 andalso Us >= -21000 end, Off)).

%% The times of lines that were said then and came so much later.
said(Lines) ->
    {Times, _} = lists:mapfoldl(
        fun({At, Lag}, Clock) ->
            starl_live_program_clock:said(At, At + ?SHIFT + Lag, Clock)
        end,
        starl_live_program_clock:new(),
        Lines
    ),
    Times.
