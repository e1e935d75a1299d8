%% Mutation testing from end to end, on a small module whose tests have known gaps.
-module(starl_mutate_tests).
-include_lib("eunit/include/eunit.hrl").

-define(FIXTURE, "apps/starl_cli/test/starl_mutate_fixture.erl").
-define(TESTS, {unit, starl_mutate_fixture_tests}).

candidates() ->
    {ok, Source} = starl_mutate_code:forms(?FIXTURE),
    starl_mutate_sample:all([Source]).

%% What a mutant is, as text; where blanks stand depends on the release of OTP.
changed(#{candidate := #{mutant := #{form := Form}}}) -> bare(lists:flatten(erl_pp:form(Form))).

bare(Text) -> lists:append(string:lexemes(Text, " \n")).

%% -- the sample -------------------------------------------------------------------------------

%% A seed draws the same sample again, of so many, none twice; another seed draws another one.
sample_test_() -> {timeout, 60, fun sample/0}.

sample() ->
    Ids = fun(Most, Seed) ->
        {Drawn, _} = starl_mutate_sample:draw(candidates(), Most, Seed),
        [Id || #{id := Id} <- Drawn]
    end,
    ?assertEqual(Ids(5, 1), Ids(5, 1)),
    ?assertEqual(5, length(lists:usort(Ids(5, 1)))),
    ?assertNotEqual(lists:sort(Ids(5, 1)), lists:sort(Ids(5, 2))),
    All = Ids(infinity, 1),
    ?assertEqual(length(All), length(lists:usort(All))),
    ?assertEqual(Ids(5, 1), lists:sublist(All, 5)).

%% A name stays when lines move and when other clauses change; it finds its mutant again.
id_test_() -> {timeout, 60, fun id/0}.

id() ->
    [One | _] = All = candidates(),
    Id = starl_mutate_sample:id(One),
    ?assertEqual([One], starl_mutate_sample:only(All, Id)),
    ?assertMatch("starl_mutate_fixture:larger/2-" ++ _, Id),
    #{before := Before, mutant := #{form := Form} = Mutant} = One,
    Moved = fun(F) -> erl_parse:map_anno(fun(_) -> erl_anno:new(99) end, F) end,
    ?assertEqual(
        Id,
        starl_mutate_sample:id(One#{
            before := Moved(Before), mutant := Mutant#{form := Moved(Form)}
        })
    ),
    Gone = "starl_mutate_fixture:larger/2-00000000",
    ?assertEqual([], starl_mutate_sample:only(All, Gone)),
    %% nothing is said of other modules
    ?assertEqual([Gone], starl_mutate_sample:stale(All, [Id, Gone, "lists:map/2-00000000"])).

%% What does not compile, or compiles to the same, is drawn but not counted.
compiled_test() ->
    {ok, #{forms := Forms} = Source} = starl_mutate_code:forms(?FIXTURE),
    [Count] = [F || {function, _, count, 1, _} = F <- Forms],
    ?assertEqual(same, starl_mutate_code:compiled(Count, Source)),
    {function, A, count, 1, [First, Second]} = Count,
    ?assertMatch(
        {ok, <<_/binary>>}, starl_mutate_code:compiled({function, A, count, 1, [First]}, Source)
    ),
    Unbound = setelement(5, Second, [{var, A, 'Nowhere'}]),
    ?assertEqual(broken, starl_mutate_code:compiled({function, A, count, 1, [Unbound]}, Source)).

%% -- the whole --------------------------------------------------------------------------------

whole_test_() -> {timeout, 120, fun whole/0}.

whole() ->
    {Drawn, #{broken := 0}} = starl_mutate_sample:draw(candidates(), infinity, 1),
    {done, Measures, []} = starl_mutate_plan:baseline([?TESTS], [starl_mutate_fixture], 1),
    #{?TESTS := #{called := Called}} = Measures,
    ?assert(lists:member({starl_mutate_fixture, count, 1}, Called)),
    ?assertNot(lists:member({starl_mutate_fixture, unused, 0}, Called)),
    Jobs = starl_mutate_plan:jobs(Drawn, Measures),
    {done, Found} = starl_mutate_plan:run(Jobs, 1, fun(_) -> ok end),
    Verdicts = maps:from_list(Found),
    Results = [{D, maps:get(Id, Verdicts)} || #{id := Id} = D <- Drawn],
    Survived = [D || {D, survived} <- Results],
    ?assertEqual(
        [
            bare(Text)
         || Text <- [
                "larger(A, B) when A >= B -> A; larger(_, B) -> B.",
                "seen(What, Seen) -> Seen#{What => false}.",
                "unused() -> 0.",
                "unused() -> 2."
            ]
        ],
        lists:sort([changed(D) || D <- Survived])
    ),
    reported(Results, Survived).

%% The cheapest test comes first, of whatever kind; one that does not call the function never comes.
cheapest_first_test() ->
    {Drawn, _} = starl_mutate_sample:draw(candidates(), infinity, 1),
    Measure = fun(Ms, Called) ->
        #{outcome => passed, cpu_ms => Ms, wall_ms => 2 * Ms, called => Called}
    end,
    Larger = [{starl_mutate_fixture, larger, 2}],
    Suite = {suite, starl_mutex_SUITE, [some_case]},
    Soak = {soak, mutex, 2, 1},
    Measures = #{
        ?TESTS => Measure(300, Larger),
        Suite => Measure(1, Larger),
        Soak => Measure(20, Larger),
        {unit, starl_mutate_tests} => Measure(0, [{starl_mutate_fixture, seen, 2}])
    },
    [#{units := Units} | _] = [
        Job
     || #{id := "starl_mutate_fixture:larger/2-" ++ _} = Job <- starl_mutate_plan:jobs(
            Drawn, Measures
        )
    ],
    ?assertEqual([Suite, Soak, ?TESTS], [Unit || {Unit, _} <- Units]).

%% Survivors that have a reason are told apart.
reported(Results, [#{id := One} | _] = Survived) ->
    Count = length(Results),
    Caught = Count - length(Survived),
    {Part, _} = starl_mutate_report:score(Results, #{}),
    ?assertEqual(Caught / Count, Part),
    {Better, Words} = starl_mutate_report:score(Results, #{One => "a reason"}),
    ?assertEqual(Caught / (Count - 1), Better),
    ?assertMatch({match, _}, re:run(lists:flatten(Words), "1 more are equivalent")),
    Text = unicode:characters_to_list(starl_mutate_report:survivors(Results, #{One => "a reason"})),
    [
        ?assertEqual(Id =/= One, string:find(Text, Id) =/= nomatch)
     || #{id := Id} <- Survived
    ],
    Diff = [bare(D) || D <- string:lexemes(Text, "\n"), hd(D) =:= $+ orelse hd(D) =:= $-],
    ?assert(lists:member("-1.", Diff)),
    Table = unicode:characters_to_list(starl_mutate_report:table(Results)),
    ?assertMatch({match, _}, re:run(Table, "all +" ++ integer_to_list(Count))).

%% What fails without a change is told, and catches nothing.
unsound_test_() ->
    {timeout, 60, fun() ->
        Units = [{unit, starl_mutate_no_such_tests}, ?TESTS],
        {done, Measures, Failed} = starl_mutate_plan:baseline(Units, [starl_mutate_fixture], 1),
        ?assertEqual([?TESTS], maps:keys(Measures)),
        ?assertMatch([{{unit, starl_mutate_no_such_tests}, {failed, _}}], Failed)
    end}.

%% A mutant that runs for ever, or eats memory, is caught; and the module is as before.
mutants_in_a_vm_test_() ->
    {timeout, 60, fun() ->
        Vm = starl_lab_jobs:vm(1, []),
        Attempt = fun(Body) ->
            peer:call(
                Vm,
                starl_mutate_worker,
                attempt,
                [
                    #{
                        id => "endless",
                        module => starl_mutate_fixture,
                        code => code(Body),
                        units => [{?TESTS, {100, 60000}}]
                    }
                ],
                60000
            )
        end,
        ?assertEqual({caught, ?TESTS, timeout}, Attempt("count(L) -> count(L)")),
        ?assertMatch({caught, ?TESTS, {failed, _}}, Attempt("count(_) -> exit(kill)")),
        %% it stands where the module stood, so it is as much StarL's own
        ?assertEqual(
            survived,
            Attempt(
                "count(L) -> \".beam\" = filename:extension(code:which(starl_mutate_fixture)), length(L)"
            )
        ),
        ?assertEqual([0, 1], [peer:call(Vm, starl_mutate_fixture, count, [L]) || L <- [[], [a]]]),
        %% what a test that fails has left behind would end the tests of other mutants
        ?assertMatch(
            {caught, ?TESTS, {failed, _}},
            Attempt(
                "count(L) -> ok = logger:add_handler(starl_left, starl_live_log, #{}),"
                "true = register(starl_left, spawn(timer, sleep, [infinity])), L"
            )
        ),
        ?assertEqual(undefined, peer:call(Vm, erlang, whereis, [starl_left])),
        ?assertNot(lists:member(starl_left, peer:call(Vm, logger, get_handler_ids, []))),
        true = unlink(Vm),
        peer:stop(Vm)
    end}.

%% The fixture with another function.
code(Body) ->
    {ok, Source} = starl_mutate_code:forms(?FIXTURE),
    {ok, Tokens, _} = erl_scan:string(Body ++ "."),
    {ok, Form} = erl_parse:parse_form(Tokens),
    {ok, Code} = starl_mutate_code:compiled(Form, Source),
    Code.

%% -- cases of Common Test ---------------------------------------------------------------------

%% Every case of a suite is found, in its groups.
paths_test() ->
    ?assert(lists:member([contract_under_faults], starl_mutate_suite:paths(starl_barrier_SUITE))),
    Grouped = starl_mutate_suite:paths(starl_determinism_SUITE),
    ?assertEqual([], [P || P <- Grouped, length(P) =/= 2]),
    ?assert(length(Grouped) > 3).

%% A worker has not loaded the suite of its first case: the beginnings of suite and group run all the same.
first_case_of_a_worker_test() ->
    _ = code:purge(starl_mutate_grouped),
    _ = code:delete(starl_mutate_grouped),
    _ = code:purge(starl_mutate_grouped),
    ?assertEqual(ok, starl_mutate_suite:run(starl_mutate_grouped, [inner, both])).

%% -- blocks -----------------------------------------------------------------------------------

%% Each block has sources, and the tests of a block are found by their names.
blocks_test() ->
    Root = starl_cli_target:root(),
    [
        ?assertNotEqual({Name, []}, {Name, starl_mutate_block:sources(Name, Root)})
     || Name <- starl_mutate_block:names()
    ],
    Tests = [starl_mutex_home_tests, starl_sap_monitor_tests, starl_mutex_SUITE, starl_mutex_app],
    Units = starl_mutate_block:units(mutex, Tests, 4),
    ?assertEqual([{unit, starl_mutex_home_tests}], [U || {unit, _} = U <- Units]),
    ?assertEqual([starl_mutex_SUITE], lists:usort([S || {suite, S, _} <- Units])),
    ?assertEqual([1, 2, 3, 4], lists:sort([Seed || {soak, mutex, _, Seed} <- Units])).
