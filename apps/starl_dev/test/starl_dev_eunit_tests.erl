%% What EUnit tells ./starl test: the count of each module, and the failures with their places.
-module(starl_dev_eunit_tests).
-include_lib("eunit/include/eunit.hrl").

-define(MODULE_UNDER, starl_dev_eunit_sample).

outcome(Source) ->
    {ok, Tokens, _} = erl_scan:string(Source),
    {ok, ?MODULE_UNDER, Beam} = compile:forms(forms(Tokens, [], []), [debug_info]),
    {module, _} = code:load_binary(?MODULE_UNDER, "sample", Beam),
    Outcome = tested(?MODULE_UNDER),
    _ = code:purge(?MODULE_UNDER),
    _ = code:delete(?MODULE_UNDER),
    Outcome.

%% In a process of its own, without the listener of the tests that are running.
tested(Module) ->
    {Pid, Ref} = spawn_monitor(fun() ->
        true = group_leader(starl_mutate_worker:sink(), self()),
        Answer = eunit:test(Module, [no_tty, {report, {starl_dev_eunit, [{to, self()}]}}]),
        receive
            {starl_dev_eunit, Outcome} -> exit({Answer, Outcome})
        end
    end),
    receive
        {'DOWN', Ref, process, Pid, Outcome} -> Outcome
    end.

forms([], [], Forms) ->
    lists:reverse(Forms);
forms([{dot, _} = Dot | Tokens], Form, Forms) ->
    {ok, Parsed} = erl_parse:parse_form(lists:reverse([Dot | Form])),
    forms(Tokens, [], [Parsed | Forms]);
forms([Token | Tokens], Form, Forms) ->
    forms(Tokens, [Token | Form], Forms).

contains(Part, Text) -> ?assertNotEqual({nomatch, Text}, {string:find(Text, Part), Text}).

-define(HEAD, "-module(starl_dev_eunit_sample). -export([a_test/0, b_test/0]). ").

passed_tests_are_counted_test() ->
    {Answer, #{modules := Modules, told := Told}} = outcome(
        ?HEAD "a_test() -> ok. b_test() -> ok."
    ),
    ?assertEqual({ok, []}, {Answer, Told}),
    ?assertMatch([#{name := "starl_dev_eunit_sample", passed := 2, failed := 0}], Modules).

failed_test_is_told_with_its_reason_test() ->
    {Answer, #{modules := Modules, told := [Told]}} =
        outcome(?HEAD "a_test() -> ok. b_test() -> error(wrong)."),
    ?assertEqual(error, Answer),
    contains("FAILED starl_dev_eunit_sample:b_test", lists:flatten(Told)),
    contains("wrong", lists:flatten(Told)),
    ?assertMatch([#{name := "starl_dev_eunit_sample", passed := 1, failed := 1}], Modules).

%% EUnit makes no group for it.
single_test_is_its_modules_test() ->
    {ok, #{modules := Modules}} = outcome(
        "-module(starl_dev_eunit_sample). -export([a_test/0]). a_test() -> ok."
    ),
    ?assertMatch([#{name := "starl_dev_eunit_sample", passed := 1, failed := 0}], Modules).

%% A generator that crashes hides how many tests there are.
cancelled_tests_have_failed_test() ->
    {error, #{modules := Modules, told := Told}} = outcome(
        "-module(starl_dev_eunit_sample). -export([a_test/0, b_test_/0]). "
        "a_test() -> ok. b_test_() -> error(no_tests)."
    ),
    ?assertMatch([_ | _], Told),
    ?assert(lists:sum([Failed || #{failed := Failed} <- Modules]) >= 1).

missing_module_has_failed_test() ->
    {error, #{modules := Modules}} = tested(starl_dev_eunit_nowhere),
    ?assert(lists:sum([Failed || #{failed := Failed} <- Modules]) >= 1).
