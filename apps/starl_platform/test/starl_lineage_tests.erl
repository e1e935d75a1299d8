%% The versions of a machine: which one it goes back to.
-module(starl_lineage_tests).
-include_lib("eunit/include/eunit.hrl").

-define(TRIAL_US, 1000).

the_first_code_is_not_on_trial_test() ->
    L = starl_lineage:new(first),
    ?assertEqual({first, true, false}, {
        starl_lineage:code(L), starl_lineage:is_first(L), starl_lineage:is_on_trial(0, L)
    }).

a_version_is_on_trial_for_its_time_test() ->
    L = taken([{1, 10}]),
    ?assertEqual(
        [true, true, false],
        [starl_lineage:is_on_trial(Now, L) || Now <- [10, 9 + ?TRIAL_US, 10 + ?TRIAL_US]]
    ).

back_is_the_version_that_has_passed_test() ->
    ?assertEqual({[2], v1}, back(taken([{1, 0}, {2, ?TRIAL_US}]))).

what_was_replaced_in_its_trial_time_is_left_too_test() ->
    ?assertEqual({[2, 1], first}, back(taken([{1, 0}, {2, ?TRIAL_US - 1}]))),
    ?assertEqual({[4, 3, 2], v1}, back(taken([{1, 0}, {2, 1000}, {3, 1001}, {4, 1002}]))).

%% A way back of two versions that have passed is enough; the third is forgotten.
older_versions_are_forgotten_test() ->
    L = taken([{1, 0}, {2, 1000}, {3, 2000}, {4, 3000}]),
    ?assertEqual({[4], v3}, back(L)),
    {_, Passed} = starl_lineage:back(L),
    ?assertEqual({[3], v2}, back(Passed)),
    {_, Base} = starl_lineage:back(Passed),
    ?assert(starl_lineage:is_first(Base)),
    ?assertNot(starl_lineage:has(2, L)).

%% One robot fails 1, when this one has 2; then one fails 2.
a_failure_of_a_replaced_version_test() ->
    L = taken([{1, 0}, {2, ?TRIAL_US}]),
    {skipped, Skipped} = starl_lineage:leave(1, L),
    ?assertEqual(v2, starl_lineage:code(Skipped)),
    ?assertEqual(unknown, starl_lineage:leave(1, Skipped)),
    {left, Left, Earlier} = starl_lineage:leave(2, Skipped),
    ?assertEqual({[2, 1], first}, {numbers(Left), starl_lineage:code(Earlier)}).

%% The other order.
a_failure_of_the_last_version_first_test() ->
    L = taken([{1, 0}, {2, ?TRIAL_US}]),
    {left, [#{number := 2}], Earlier} = starl_lineage:leave(2, L),
    ?assertEqual(v1, starl_lineage:code(Earlier)),
    {left, [#{number := 1}], First} = starl_lineage:leave(1, Earlier),
    ?assertEqual(first, starl_lineage:code(First)),
    ?assertEqual(unknown, starl_lineage:leave(2, First)).

what_a_runner_keeps_is_its_own_test() ->
    {[#{kept := none}], _} = starl_lineage:back(starl_lineage:bare(taken([{1, 0}]))).

taken(Takes) ->
    lists:foldl(
        fun({N, Now}, L) ->
            Module = list_to_atom("v" ++ integer_to_list(N)),
            Version = #{number => N, module => Module, trial_us => ?TRIAL_US, kept => mine},
            starl_lineage:take(Version, Now, L)
        end,
        starl_lineage:new(first),
        Takes
    ).

back(Lineage) ->
    {Left, Earlier} = starl_lineage:back(Lineage),
    {numbers(Left), starl_lineage:code(Earlier)}.

numbers(Versions) -> [N || #{number := N} <- Versions].
