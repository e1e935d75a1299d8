%% The clocks of a robot and its chassis: what shows that the robot's is wrong, and what does not.
-module(starl_motion_clock_check_tests).
-include_lib("eunit/include/eunit.hrl").

-define(S, 1000000).

%% Answers come late by up to a fifth of a second, the clocks drift by one per cent, either way, and
%% are apart by an hour.
clocks_within_drift_agree_test_() ->
    [
        ?_assertEqual([], broken(fun(T) -> 3600 * ?S + round(T * Rate) end, fun late/1))
     || Rate <- [0.99, 1.0, 1.01]
    ].

late(K) -> erlang:phash2(K, 200000).

%% A clock that is set, back or forward, or stood still for a quarter of a second, while the robot
%% drives or between two commands: it is noticed with the next answer, and never again.
clock_that_was_set_is_noticed_test_() ->
    After = fun(At, Shift) ->
        fun
            (T) when T > At -> T + Shift;
            (T) -> T
        end
    end,
    [
        ?_assertEqual([51], broken(After(At, Shift), fun late/1))
     || At <- [50 * ?S + 700000], Shift <- [-250000, -2 * ?S, 3 * ?S]
    ].

%% Set while a command is carried out: with its answer if it is back, and with the next one.
while_driving_test() ->
    Back = fun
        (T) when T > 50 * ?S + 100000 -> T - 2 * ?S;
        (T) -> T
    end,
    ?assertEqual([50, 51], broken(Back, fun(_) -> 0 end)).

%% A clock that stands still is noticed by every answer.
standing_clock_is_noticed_by_every_answer_test() ->
    Frozen = fun(T) -> min(T, 50 * ?S + 700000) end,
    ?assertEqual(lists:seq(51, 100), broken(Frozen, fun late/1)).

%% Who was paused handles one answer too late.
paused_robot_handles_one_answer_too_late_test() ->
    Paused = fun
        (50) -> 20 * ?S;
        (K) -> late(K)
    end,
    ?assertEqual([50], broken(fun(T) -> T end, Paused)).

%% Commands that are heard late, at random: by as much as the profile bears, the clocks agree; by more
%% they do not, so a line that is slower than said is found out.
commands_later_than_the_profile_bears_are_noticed_test_() ->
    Heard = fun(Ms) -> fun(K) -> K * ?S + erlang:phash2({K, heard}, 1000 * Ms + 1) end end,
    Count = fun(Said, Ms) ->
        length(broken(#{latency_ms => Said}, fun(T) -> T end, fun(_) -> 0 end, Heard(Ms)))
    end,
    [?_assertEqual({Said, 0}, {Said, Count(Said, Said)}) || Said <- [5, 20, 50]] ++
        [?_assert(Count(5, Ms) > 0) || Ms <- [50, 100]] ++
        [?_assertEqual(0, length(broken(#{}, fun(T) -> T end, fun(_) -> 0 end, Heard(5))))].

%% Between two commands a second apart the drift of the clocks explains 20 ms, and the latency 5 ms more.
a_latency_of_5_ms_is_borne_unless_another_is_said_test() ->
    {true, Watch} = starl_motion_clock_check:agree(
        {0, {0, 0}, 0}, 0, starl_motion_clock_check:new(#{})
    ),
    Agree = fun(Later) ->
        element(1, starl_motion_clock_check:agree({?S + Later, {0, 0}, ?S + Later}, ?S, Watch))
    end,
    ?assertEqual([true, false, true, false], [Agree(Us) || Us <- [25000, 25001, -25000, -25001]]).

%% A pause longer than the latency and the drift explain is noticed all the same.
pause_with_latency_test() ->
    After = fun
        (T) when T > 50 * ?S + 700000 -> T - 250000;
        (T) -> T
    end,
    ?assertEqual(
        [51], broken(#{latency_ms => 50}, After, fun late/1, fun(K) -> K * ?S end)
    ).

broken(Clock, Late) -> broken(#{}, Clock, Late, fun(K) -> K * ?S end).

%% Commands are given once a second and take 0.29 s: the numbers of those after which the clocks
%% did not agree. The chassis' clock shows the true time.
broken(Profile, Clock, Late, Heard) ->
    Step = fun(K, {Broken, Watch}) ->
        Command = {Clock(K * ?S), {290000, 290000}, Clock(K * ?S + 290000 + Late(K))},
        {Agree, Next} = starl_motion_clock_check:agree(Command, Heard(K), Watch),
        {[K || not Agree] ++ Broken, Next}
    end,
    {Broken, _} = lists:foldl(Step, {[], starl_motion_clock_check:new(Profile)}, lists:seq(1, 100)),
    lists:reverse(Broken).
