%% Which tests share a VM.
-module(starl_test_plan_tests).
-include_lib("eunit/include/eunit.hrl").

-define(P, starl_test_plan).

-define(LIMIT, <<"{", "timeout, 60, fun() -> ok end}">>).

sources() ->
    [
        {a_SUITE, ?LIMIT},
        {quick_tests, <<"a_test() -> ok.">>},
        {brief_tests, ?LIMIT},
        {long_tests, ?LIMIT},
        {program_tests, <<"open_", "port(">>}
    ].

%% The modules of each VM.
shares(Jobs) -> lists:sort([Modules || #{modules := [_ | _] = Modules} <- Jobs]).

suites_programs_and_long_modules_have_a_vm_each_test() ->
    More = [{more_quick_tests, <<>>}, {more_brief_tests, ?LIMIT} | sources()],
    Jobs = ?P:jobs(all, lists:append(lists:duplicate(10, More)), [long_tests]),
    Alone = [a_SUITE, long_tests, program_tests],
    ?assertEqual(
        [[Name] || Name <- Alone, _ <- lists:seq(1, 10)],
        [Modules || Modules <- shares(Jobs), Modules -- Alone =/= Modules]
    ).

only_those_without_limits_are_quick_test() ->
    ?assertEqual([[quick_tests]], shares(?P:jobs(quick, sources(), []))).

%% Of many modules each is in one job, and no more jobs share than there are hands.
each_module_is_in_one_job_test() ->
    Names = [list_to_atom("m" ++ integer_to_list(N)) || N <- lists:seq(1, 100)],
    Jobs = ?P:jobs(all, [{Name, ?LIMIT} || Name <- Names], []),
    ?assertEqual(lists:sort(Names), lists:sort(lists:append(shares(Jobs)))),
    ?assert(length(Jobs) < 20).
