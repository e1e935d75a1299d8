%% What ddmin promises: a part of the list in its order, which fails, of which no item can be
%% left out, after a bounded number of tests.
-module(starl_sim_ddmin_tests).
-include_lib("proper/include/proper.hrl").
-include_lib("eunit/include/eunit.hrl").

-define(FEW_TESTS(N), (N * N + 5 * N + 1)).

nothing_is_needed_test() -> ?assertEqual({[], 1}, counted([1, 2, 3], fun(_) -> true end)).

nothing_to_leave_out_test() -> ?assertEqual({[], 0}, counted([], fun(_) -> true end)).

the_paper_s_example_test() ->
    %% three of eight, as in section 3.2 of the paper
    {Found, _} = counted(lists:seq(1, 8), needs([1, 7, 8])),
    ?assertEqual([1, 7, 8], Found).

%% 3 of 40 take about k log n tests, not n^2.
few_of_many_test() ->
    {Found, Tests} = counted(lists:seq(1, 40), needs([5, 17, 31])),
    ?assertEqual([5, 17, 31], Found),
    ?assert(Tests < 80, Tests).

one_of_many_is_a_binary_search_test() ->
    {[777], Tests} = counted(lists:seq(1, 1024), needs([777])),
    ?assert(Tests =< 21, Tests).

%% What is known is not asked for again: of two parts that are left, neither fails alone.
no_test_is_made_twice_test() ->
    Needs = needs([1, 4]),
    Test = fun(Part, Seen) -> {Needs(Part), [Part | Seen]} end,
    {[1, 4], Seen} = starl_sim_ddmin:minimize([1, 2, 3, 4], Test, []),
    ?assertEqual(lists:sort(Seen), lists:usort(Seen)).

%% Where a set of items fails and so does all that holds it.
monotone_test_() ->
    {timeout, 60, fun() ->
        holds(
            ?FORALL(
                {N, Drawn},
                {range(1, 60), list(range(1, 60))},
                safely(fun() ->
                    Needed = [I || I <- lists:usort(Drawn), I =< N],
                    {Found, Tests} = counted(lists:seq(1, N), needs(Needed)),
                    Found =:= Needed andalso Tests =< ?FEW_TESTS(N)
                end)
            )
        )
    end}.

%% Where anything may fail: any other part fails or does not by a hash of it.
any_predicate_test_() ->
    {timeout, 60, fun() ->
        holds(
            ?FORALL(
                {N, Salt, Of},
                {range(1, 40), integer(), range(2, 5)},
                safely(fun() ->
                    All = lists:seq(1, N),
                    Fails = fun(Items) ->
                        Items =:= All orelse erlang:phash2({Salt, Items}, Of) =:= 0
                    end,
                    {Found, Tests} = counted(All, Fails),
                    Fails(Found) andalso Found -- All =:= [] andalso Found =:= lists:usort(Found) andalso
                        not lists:any(Fails, [lists:delete(I, Found) || I <- Found]) andalso
                        Tests =< ?FEW_TESTS(N)
                end)
            )
        )
    end}.

needs(Needed) -> fun(Items) -> Needed -- Items =:= [] end.

counted(Items, Fails) ->
    starl_sim_ddmin:minimize(Items, fun(Part, Count) -> {Fails(Part), Count + 1} end, 0).

safely(Fun) -> starl_platform_ct:safely(Fun).

holds(Prop) -> starl_platform_ct:property(Prop, 400).
