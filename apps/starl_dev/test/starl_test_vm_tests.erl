%% Jobs of ./starl test in VMs of their own, as they end: with passed, failed and skipped cases, and
%% with a VM that dies.
-module(starl_test_vm_tests).
-include_lib("eunit/include/eunit.hrl").

-define(SUITE, starl_test_vm_sample_SUITE).
-define(HEAD,
    "-module(starl_test_vm_sample_SUITE). -compile([export_all, nowarn_export_all]). "
    "all() -> [one, two]. one(_) -> ok. "
).

%% The outcome of a suite with this source, in a VM that finds its code.
outcome(Source) -> outcome(Source, #{}).

outcome(Source, More) ->
    Dir = filename:join("/tmp", "starl-test-vm-" ++ os:getpid()),
    _ = file:del_dir_r(Dir),
    ok = file:make_dir(Dir),
    try
        File = filename:join(Dir, atom_to_list(?SUITE)),
        ok = file:write_file(File ++ ".erl", Source),
        {ok, ?SUITE} = compile:file(File ++ ".erl", [{outdir, Dir}]),
        answer(Dir, More)
    after
        file:del_dir_r(Dir)
    end.

answer(Dir, More) ->
    Name = atom_to_list(?SUITE),
    Job = More#{name => Name, kind => suite, modules => [?SUITE], root => Dir, logs => Dir},
    Vm = starl_lab_jobs:vm(1, []),
    true = unlink(Vm),
    true = peer:call(Vm, code, add_patha, [Dir]),
    Answer =
        try
            {ok, peer:call(Vm, starl_test_vm, run, [Job], 60000)}
        catch
            _:_ -> {lost, file:read_file(starl_test_vm:case_file(Job))}
        end,
    _ = exit(Vm, kill),
    Answer.

the_case_that_failed_is_told_test_() ->
    {timeout, 60, fun() ->
        {ok, #{modules := [Tested], told := [Told]}} = outcome(?HEAD "two(_) -> error(wrong)."),
        ?assertMatch(#{passed := 1, failed := 1, skipped := 0}, Tested),
        Text = unicode:characters_to_list(Told),
        ?assertNotEqual(nomatch, string:find(Text, "FAILED starl_test_vm_sample_SUITE:two")),
        ?assertNotEqual(nomatch, string:find(Text, "wrong"))
    end}.

only_the_failed_case_runs_again_test_() ->
    {timeout, 60, fun() ->
        {ok, First} = outcome(?HEAD "two(_) -> error(wrong)."),
        ?assertMatch(#{failed := [two]}, First),
        {ok, Second} = outcome(?HEAD "two(_) -> ok.", #{cases => [two]}),
        ?assertMatch(#{modules := [#{passed := 1, failed := 0}]}, Second)
    end}.

a_case_of_a_group_runs_again_in_it_test_() ->
    {timeout, 60, fun() ->
        Head =
            "-module(starl_test_vm_sample_SUITE). -compile([export_all, nowarn_export_all]). "
            "all() -> [{group, outer}, two]. one(_) -> ok. two(_) -> ok. "
            "groups() -> [{outer, [], [{group, g}]}, {g, [], [one, three]}]. ",
        {ok, First} = outcome(Head ++ "three(_) -> error(wrong)."),
        ?assertMatch(#{failed := [{three, g}]}, First),
        {ok, Second} = outcome(Head ++ "three(_) -> ok.", #{cases => [{three, g}]}),
        ?assertMatch(#{modules := [#{passed := 1, failed := 0}]}, Second)
    end}.

a_preparation_that_failed_is_run_again_whole_test_() ->
    {timeout, 60, fun() ->
        {ok, First} = outcome(?HEAD "two(_) -> ok. init_per_suite(_) -> error(wrong)."),
        ?assertMatch(#{failed := []}, First)
    end}.

a_skipped_case_has_not_failed_test_() ->
    {timeout, 60, fun() ->
        {ok, #{modules := [Tested], told := [Told]}} = outcome(
            ?HEAD "two(_) -> {skip, \"no radio\"}."
        ),
        ?assertMatch(#{passed := 1, failed := 0, skipped := 1}, Tested),
        ?assertEqual(
            "skipped starl_test_vm_sample_SUITE:two: no radio\n", unicode:characters_to_list(Told)
        )
    end}.

a_preparation_that_fails_is_a_failure_of_each_case_test_() ->
    {timeout, 60, fun() ->
        {ok, #{modules := [Tested]}} = outcome(
            ?HEAD "two(_) -> ok. init_per_suite(_) -> error(wrong). end_per_suite(_) -> ok."
        ),
        ?assertMatch(#{passed := 0, failed := Failed} when Failed >= 2, Tested)
    end}.

%% On which no case depends.
an_end_that_fails_is_a_failure_test_() ->
    {timeout, 60, fun() ->
        {ok, #{modules := [Tested]}} = outcome(
            ?HEAD "two(_) -> ok. init_per_suite(C) -> C. end_per_suite(_) -> error(wrong)."
        ),
        ?assertMatch(#{passed := 2, failed := 1}, Tested)
    end}.

a_vm_that_dies_is_lost_in_its_case_test_() ->
    {timeout, 60, fun() ->
        ?assertEqual(
            {lost, {ok, <<"starl_test_vm_sample_SUITE:two">>}}, outcome(?HEAD "two(_) -> halt(0).")
        )
    end}.
