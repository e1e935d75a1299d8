%% The contract of bounded convergence: who has finished, who need not, and when it is judged.
-module(starl_run_progress_monitor_tests).
-include_lib("eunit/include/eunit.hrl").

-define(DEADLINE, 1000).

%% The robots that have not finished at the end, and how many are told of.
judge(Events) -> judge(Events, ?DEADLINE).

judge(Events, End) ->
    Config = #{robots => [1, 2, 3], deadline_us => ?DEADLINE},
    M0 = starl_monitor:new([{starl_run_progress_monitor, Config}]),
    M = lists:foldl(
        fun(Event, Monitor) ->
            {ok, Next} = starl_monitor:step(Event, Monitor),
            Next
        end,
        M0,
        Events
    ),
    {Late, #{starl_run_progress_monitor := #{unfinished := Count}}} = starl_monitor:finish(End, M),
    {
        [
            {What, At, Robots}
         || #{contract := progress, what := What, at_us := At, robots := Robots} <- Late
        ],
        Count
    }.

done(Robot) -> {10, Robot, app, {done, ok}}.

all_finish_test() ->
    ?assertEqual({[], 0}, judge([done(3), done(1), done(2)])).

not_finished_test() ->
    ?assertEqual({[{not_finished, ?DEADLINE, [1, 3]}], 2}, judge([done(2)])).

%% A robot that died need not finish.
died_test() ->
    ?assertEqual({[], 0}, judge([done(3), done(1), {10, 2, robot, {died, killed}}])).

%% An application that crashed starts again and has to finish all the same; so has one whose robot
%% was down, or whose other machines end something.
crashed_is_not_done_test() ->
    Others = [done(1), done(3)],
    [
        ?assertEqual({[{not_finished, ?DEADLINE, [2]}], 1}, judge(Others ++ [Event]))
     || Event <- [
            {10, 2, app, crashed},
            {10, 2, app, {crashed, why}},
            {10, 2, robot, down},
            {10, 2, robot, up},
            {10, 2, app, {stopped, ok}}
        ]
    ],
    ?assertEqual({[], 0}, judge(Others ++ [{10, 2, app, crashed}, done(2)])).

%% Who had finished and crashed has to finish anew.
crashed_when_done_test() ->
    All = [done(R) || R <- [1, 2, 3]],
    Crashed = All ++ [{11, 2, app, crashed}],
    ?assertEqual({[{not_finished, ?DEADLINE, [2]}], 1}, judge(Crashed)),
    ?assertEqual({[], 0}, judge(Crashed ++ [done(2)])).

%% A run that ends before the deadline is not judged.
before_the_deadline_test() ->
    ?assertEqual({[], 3}, judge([], ?DEADLINE - 1)).

%% What is told names the deadline; at the deadline it is judged. Whose robot died is not waited for
%% any more, whatever its application did then.
told_test() ->
    M = starl_monitor:new([{starl_run_progress_monitor, #{robots => [2], deadline_us => 50}}]),
    ?assertMatch({[#{details := #{deadline_us := 50}}], _}, starl_monitor:finish(50, M)),
    Died = {10, 2, robot, {died, killed}},
    ?assertEqual({[], 0}, judge([done(1), done(3), Died, {11, 2, app, crashed}])),
    ?assertEqual({[], 0}, judge([done(1), done(3), {9, 2, app, crashed}, Died])).
