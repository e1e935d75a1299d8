%% What ./starl test prints and counts: nothing that went wrong looks well.
-module(starl_test_report_tests).
-include_lib("eunit/include/eunit.hrl").

-define(R, starl_test_report).

job(Kind, Modules) ->
    #{name => "job", kind => Kind, modules => Modules, root => "/", logs => "/"}.

suite() -> (job(suite, [a_SUITE]))#{name := "a_SUITE"}.

tested(Name, Passed, Failed) -> #{name => Name, passed => Passed, failed => Failed, ms => 1500}.

%% The text of the jobs' outcomes and the summary, and whether all is well.
told(How, Jobs, Outcomes) ->
    {Texts, Report} = lists:mapfoldl(
        fun({Job, Outcome}, R) -> ?R:ended(Job, Outcome, R) end, ?R:new(Jobs), Outcomes
    ),
    {Summary, Sound} = ?R:summary(How, Report),
    {unicode:characters_to_list([Texts, Summary]), Sound}.

told(Outcome) -> told(done, [suite()], [{suite(), Outcome}]).

contains(Part, Text) -> ?assertNotEqual({nomatch, Text}, {string:find(Text, Part), Text}).

all_passed_test() ->
    {Text, Sound} = told(#{modules => [tested("a_SUITE", 7, 0)], told => []}),
    ?assertEqual({"[1/1]     a_SUITE: 7 passed, 1.5 s\n7 passed, 0 failed\n", true}, {Text, Sound}).

failed_case_is_told_before_its_suite_test() ->
    {Text, Sound} = told(#{
        modules => [tested("a_SUITE", 6, 1)], told => ["FAILED a_SUITE:b\nwhy\n"]
    }),
    ?assertEqual(
        {
            "FAILED a_SUITE:b\nwhy\n[1/1]     a_SUITE: 6 passed, 1 FAILED, 1.5 s\n"
            "Not everything is sound, see above.\n6 passed, 1 failed\n",
            false
        },
        {Text, Sound}
    ).

skipped_cases_have_not_failed_test() ->
    {Text, Sound} = told(#{modules => [(tested("a_SUITE", 2, 0))#{skipped => 3}], told => []}),
    contains("a_SUITE: 2 passed, 3 skipped", Text),
    contains("2 passed, 0 failed\n", Text),
    ?assert(Sound).

dead_vm_has_failed_test() ->
    {Text, Sound} = told({lost, noconnection, <<"a_SUITE:b">>}),
    contains("[1/1]     a_SUITE: FAILED, its VM has ended: noconnection, in a_SUITE:b\n", Text),
    contains("\n0 passed, 1 failed\n", Text),
    ?assertNot(Sound).

hanging_suite_has_failed_test() ->
    {Text, Sound} = told({lost, timeout, none}),
    contains("a_SUITE: FAILED, it hung and was killed\n", Text),
    ?assertNot(Sound).

suite_without_a_case_has_failed_test() ->
    {Text, Sound} = told(#{modules => [(tested("a_SUITE", 0, 0))#{skipped => 0}], told => []}),
    contains("a_SUITE: 0 passed, 1 FAILED, no test ran", Text),
    ?assertNot(Sound).

module_that_did_not_run_has_failed_test() ->
    Job = job(eunit, [a_tests, b, c_tests]),
    Outcome = #{modules => [tested("a_tests", 3, 0), tested("b_tests", 2, 0)], told => []},
    {Text, Sound} = told(done, [Job], [{Job, Outcome}]),
    contains("[3/3]     c_tests: 0 passed, 1 FAILED, no test ran", Text),
    contains("5 passed, 1 failed\n", Text),
    ?assertNot(Sound).

xref_counts_only_when_it_fails_test() ->
    Job = (job(xref, []))#{name := "xref"},
    {_, Report} = ?R:ended(Job, #{modules => [tested("xref", 0, 0)], told => []}, ?R:new([Job])),
    {Text, _} = ?R:summary(done, Report),
    contains("0 passed, 0 failed\n", unicode:characters_to_list(Text)),
    {_, false} = told(done, [Job], [{Job, #{modules => [tested("xref", 0, 1)], told => ["call\n"]}}]).

nothing_at_all_is_not_sound_test() ->
    {Text, Sound} = told(done, [], []),
    ?assertEqual({"starl: no test ran\n0 passed, 0 failed\n", false}, {Text, Sound}).

job_that_never_ended_is_missed_test() ->
    {Text, Sound} = told(done, [suite(), job(eunit, [b_tests])], [
        {suite(), #{modules => [tested("a_SUITE", 7, 0)], told => []}}
    ]),
    contains("FAILED: only 1 of 2 modules have run\n", Text),
    ?assertNot(Sound).

interrupted_run_is_not_sound_test() ->
    {Text, Sound} = told(interrupted, [suite(), job(eunit, [b_tests])], [
        {suite(), #{modules => [tested("a_SUITE", 7, 0)], told => []}}
    ]),
    contains("interrupted: 1 of 2 modules have run\n", Text),
    contains("7 passed, 0 failed\n", Text),
    ?assertNot(Sound).

lost_jobs_have_no_seconds_test() ->
    {_, One} = ?R:ended(suite(), #{modules => [tested("a_SUITE", 7, 0)], told => []}, ?R:new([])),
    {_, Both} = ?R:ended(job(eunit, [b_tests]), {lost, timeout, none}, One),
    ?assertEqual([{"a_SUITE", 1.5}], ?R:seconds(Both)).

the_duration_has_what_was_built_before_test() ->
    Said = fun(Tests, Built) -> lists:flatten(starl_test_report:duration(Tests, Built)) end,
    ?assertEqual("The tests took 14 min 59 s, after 1 min 2 s of building.\n", Said(899, 62)),
    ?assertEqual("The tests took 0 min 31 s.\n", Said(31, 0)).

%% -- what failed is run once more -----------------------------------------------------------

failed_once() ->
    Outcome = #{
        modules => [tested("a_SUITE", 6, 2)],
        told => [
            "FAILED a_SUITE:b\nwhy\n", "FAILED a_SUITE:c(g)\nwhy\n", "skipped a_SUITE:d: no\n"
        ],
        failed => [b, {c, g}]
    },
    {_, Report} = ?R:ended(suite(), Outcome, ?R:new([suite()])),
    Report.

summary(Report) ->
    {Text, Sound} = ?R:summary(done, Report),
    {unicode:characters_to_list(Text), Sound}.

the_failed_cases_alone_are_run_again_test() ->
    ?assertMatch(
        [#{name := "a_SUITE", cases := [b, {c, g}], logs := "/again"}], ?R:again(failed_once())
    ).

what_passes_alone_is_flaky_and_has_passed_test() ->
    Report = failed_once(),
    [Again] = ?R:again(Report),
    {Text, Then} = ?R:repeated(
        Again, #{modules => [tested("a_SUITE", 2, 0)], told => []}, Report
    ),
    contains("flaky: a_SUITE:b, it has passed alone\n", unicode:characters_to_list(Text)),
    ?assertEqual(["a_SUITE:b", "a_SUITE:c(g)"], ?R:flaky(Then)),
    ?assertEqual(
        {"flaky: a_SUITE:b\nflaky: a_SUITE:c(g)\n8 passed, 0 failed\n", true}, summary(Then)
    ).

what_fails_again_has_failed_test() ->
    Report = failed_once(),
    [Again] = ?R:again(Report),
    Failed = #{modules => [tested("a_SUITE", 1, 1)], told => ["FAILED a_SUITE:b\nwhy\n"]},
    {Text, Then} = ?R:repeated(Again, Failed, Report),
    contains(
        "FAILED a_SUITE:b\nwhy\na_SUITE has failed again, alone.\n",
        unicode:characters_to_list(Text)
    ),
    ?assertMatch({_, false}, summary(Then)),
    {_, Lost} = ?R:repeated(Again, {lost, timeout, none}, Report),
    ?assertMatch({_, false}, summary(Lost)).

a_run_in_which_nothing_ran_is_no_pass_test() ->
    Report = failed_once(),
    [Again] = ?R:again(Report),
    {_, Then} = ?R:repeated(Again, #{modules => [tested("a_SUITE", 0, 0)], told => []}, Report),
    ?assertMatch({_, false}, summary(Then)).

a_vm_that_ended_is_run_again_whole_test() ->
    {_, Report} = ?R:ended(suite(), {lost, noconnection, none}, ?R:new([suite()])),
    [Again] = ?R:again(Report),
    ?assertNot(is_map_key(cases, Again)),
    {_, Then} = ?R:repeated(Again, #{modules => [tested("a_SUITE", 8, 0)], told => []}, Report),
    ?assertMatch({"flaky: a_SUITE\n" ++ _, true}, summary(Then)).

of_modules_that_share_a_vm_the_failed_ones_are_run_again_test() ->
    Job = job(eunit, [a_tests, b_tests, c_tests]),
    Outcome = #{modules => [tested("a_tests", 2, 0), tested("b_tests", 1, 1)], told => []},
    {_, Report} = ?R:ended(Job, Outcome, ?R:new([Job])),
    ?assertMatch([#{modules := [b_tests, c_tests]}], ?R:again(Report)).

what_fails_everywhere_is_not_run_again_test() ->
    Jobs = [(suite())#{name := integer_to_list(N)} || N <- lists:seq(1, 21)],
    Outcome = #{modules => [tested("a_SUITE", 0, 1)], told => ["FAILED x\n"]},
    Report = lists:foldl(
        fun(Job, R) -> element(2, ?R:ended(Job, Outcome, R)) end, ?R:new(Jobs), Jobs
    ),
    ?assertEqual([], ?R:again(Report)).
