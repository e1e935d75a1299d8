%% What the monitor of the barrier takes a team to know of a robot's rounds, after crashes and bad stores.
-module(starl_barrier_monitor_memory_tests).
-include_lib("eunit/include/eunit.hrl").

-define(M, starl_barrier_monitor_memory).

%% Which round may be next, by what is in doubt: of a robot that has passed round 5 and reached round 6.
may_be_next_test() ->
    Next = fun(Doubt) -> [K || K <- lists:seq(1, 9), ?M:may_be_next(Doubt, K, 5, 6)] end,
    ?assertEqual([1, 2, 3, 4, 5, 6, 7], Next(lost)),
    ?assertEqual([3, 4, 5, 6, 7], Next({from, 3})),
    ?assertEqual([5, 6, 7], Next(damaged_and_forgotten)),
    ?assertEqual([6, 7], Next(damaged)),
    [?assertEqual([], Next(Sound)) || Sound <- [none, forgotten, untold]].

%% Of a robot that was set back, whom nobody else knows, the store counts, but not below what another has passed.
set_back_test() ->
    Keys = [{b, R} || R <- [1, 2, 3]],
    Back = fun(Crashed) ->
        Forgot = lists:foldl(fun(R, M) -> ?M:crashed(R, Keys, M) end, ?M:new(), Crashed),
        ?M:set_back(1, Keys, Forgot)
    end,
    Doubt = fun(Others, Memory) -> ?M:doubt({b, 1}, Others, Memory) end,
    ?assertEqual({from, 4}, Doubt([{2, 4}, {3, 2}], Back([2, 3]))),
    ?assertEqual({from, 0}, Doubt([{2, 0}, {3, 0}], Back([2, 3]))),
    ?assertEqual({from, 0}, Doubt([], Back([]))),
    ?assertEqual(damaged_and_forgotten, Doubt([{2, 4}, {3, 2}], Back([2]))),
    %% each robot that crashed stays ignorant of it, whoever crashes next and however often
    ?assertEqual({from, 4}, Doubt([{2, 4}, {3, 2}], Back([2, 3, 2]))),
    %% nobody is left who knows anything of the name
    All = lists:foldl(fun(R, M) -> ?M:set_back(R, Keys, M) end, ?M:new(), [1, 2, 3]),
    ?assertEqual(lost, Doubt([{2, 4}, {3, 2}], All)).

%% Who has crashed hears of a robot again when that passes a round that it reached since: who reached it before
%% may not have been heard.
heard_again_test() ->
    Keys = [{b, R} || R <- [1, 2]],
    Judge = fun(Steps) ->
        Memory = lists:foldl(
            fun
                ({crashed, R}, M) -> ?M:crashed(R, Keys, M);
                (What, M) -> ?M:What({b, 1}, M)
            end,
            ?M:new(),
            Steps
        ),
        ?M:doubt({b, 1}, [{2, 4}], ?M:set_back(1, Keys, Memory))
    end,
    Crash = {crashed, 2},
    ?assertEqual({from, 4}, Judge([Crash])),
    ?assertEqual({from, 4}, Judge([Crash, reached])),
    ?assertEqual({from, 4}, Judge([Crash, passed])),
    ?assertNotMatch({from, _}, Judge([Crash, reached, passed])),
    ?assertEqual({from, 4}, Judge([Crash, reached, Crash, passed])),
    ?assertNotMatch({from, _}, Judge([])).

%% A store is good again when the robot has passed a round; what is damaged is told apart from what is forgotten.
sound_again_test() ->
    Keys = [{b, R} || R <- [1, 2]],
    Damaged = ?M:damaged(1, Keys, ?M:new()),
    ?assertEqual([true, false], [?M:is_unsound(Key, Damaged) || Key <- Keys]),
    ?assertEqual(#{{b, 1} => damaged}, ?M:damages(Damaged)),
    ?assertNot(?M:is_unsound({b, 1}, ?M:passed({b, 1}, Damaged))),
    Forgot = ?M:crashed(2, Keys, ?M:new()),
    ?assertEqual(#{}, ?M:damages(Forgot)),
    ?assertEqual(#{{b, 1} => damaged_and_forgotten}, ?M:damages(?M:damaged(1, Keys, Forgot))),
    Untold = ?M:reached({b, 1}, Forgot),
    ?assertEqual(#{}, ?M:damages(Untold)),
    ?assertEqual(#{}, ?M:damages(?M:crashed(2, Keys, Untold))),
    ?assertEqual(#{{b, 1} => damaged_and_forgotten}, ?M:damages(?M:damaged(1, Keys, Untold))).
