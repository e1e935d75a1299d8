%% Which job of ./starl test runs next, on two cores.
%%
%% Holds: Suites that wait run beside suites that compute; each failure is told with its case; a
%% suite that hangs, or whose VM ends, has failed
%% Red: 253846e; told by 1822124: one suite ran after another
-module(starl_test_schedule_tests).
-include_lib("eunit/include/eunit.hrl").

-define(S, starl_test_schedule).

-define(TABLE, [
    {long, computes, 90},
    {short, computes, 5},
    {doctor, waits, 70},
    {fleet, waits, 60},
    {cable, waits, 20},
    {quiet, alone, 100}
]).

known() -> ?S:known(?TABLE, []).

jobs(Names) -> [#{name => atom_to_list(Name)} || Name <- Names].

names(Jobs) -> [list_to_atom(Name) || #{name := Name} <- Jobs].

next(Running, Later) ->
    case ?S:next(jobs(Running), jobs(Later), known(), 2) of
        {#{name := Name}, Others} -> {list_to_atom(Name), names(Others)};
        wait -> wait
    end.

longest_first_and_those_alone_last_test() ->
    ?assertEqual(
        [long, doctor, fleet, cable, unknown, short, quiet],
        names(?S:order(jobs([short, quiet, unknown, cable, long, fleet, doctor]), known()))
    ).

the_first_job_that_fits_is_next_test() ->
    ?assertEqual({long, [doctor, short]}, next([], [long, doctor, short])),
    ?assertEqual({short, [cable]}, next([doctor, fleet, long], [cable, short])).

one_job_computes_for_each_core_test() ->
    ?assertEqual({fleet, [unknown]}, next([long, short], [unknown, fleet])),
    ?assertEqual(wait, next([long, short, fleet], [unknown, quiet])).

one_more_computes_when_none_is_left_that_waits_test() ->
    ?assertEqual({unknown, [quiet]}, next([long, short], [unknown, quiet])),
    ?assertEqual(wait, next([long, short, other], [unknown, quiet])).

as_many_wait_beside_them_test() ->
    ?assertEqual(wait, next([doctor, fleet], [cable])),
    ?assertEqual(4, ?S:at_most(2)).

nothing_runs_beside_one_that_must_be_alone_test() ->
    ?assertEqual(wait, next([long], [quiet])),
    ?assertEqual({quiet, []}, next([], [quiet])),
    ?assertEqual(wait, next([quiet], [short, cable])).

the_last_run_knows_the_seconds_and_the_checkout_the_load_test() ->
    Known = ?S:known(?TABLE, [{doctor, computes, 10}, {gone, computes, 500}]),
    ?assertMatch(#{"doctor" := {waits, 10}, "fleet" := {waits, 60}}, Known),
    ?assertEqual(
        [{doctor, waits, 11}, {new, computes, 3}],
        ?S:kept(
            [{"new", 3.2}, {"doctor", 10.6}], Known
        )
    ).

%% Whatever the jobs are and in whatever order they end, each runs once, and never more of a kind than
%% there are cores.
every_job_runs_once_test() ->
    Seed = erlang:phash2({os:timestamp(), make_ref()}, 1 bsl 32),
    io:format("seed ~b", [Seed]),
    _ = lists:foldl(
        fun(_, Random) -> run_drawn(Random) end, rand:seed_s(exsss, Seed), lists:seq(1, 200)
    ).

run_drawn(Random) ->
    {Number, Random1} = rand:uniform_s(30, Random),
    {Cores, Random2} = rand:uniform_s(4, Random1),
    {Table, Random3} = lists:mapfoldl(fun row/2, Random2, lists:seq(1, Number)),
    Known = ?S:known(Table, []),
    Jobs = ?S:order([#{name => atom_to_list(Name)} || {Name, _, _} <- Table], Known),
    {Ran, Random4} = run([], Jobs, {Known, Cores}, [], Random3),
    ?assertEqual(lists:sort(Jobs), lists:sort(Ran)),
    Random4.

row(N, Random) ->
    {Load, Random1} = rand:uniform_s(3, Random),
    {Seconds, Random2} = rand:uniform_s(100, Random1),
    Name = list_to_atom("job_" ++ integer_to_list(N)),
    {{Name, element(Load, {computes, waits, alone}), Seconds}, Random2}.

run([], [], _Machine, Ran, Random) ->
    {Ran, Random};
run(Running, [], Machine, Ran, Random) ->
    one_ends(Running, [], Machine, Ran, Random);
run(Running, Later, {Known, Cores} = Machine, Ran, Random) ->
    case ?S:next(Running, Later, Known, Cores) of
        {Job, Others} ->
            sound([Job | Running], Machine),
            run([Job | Running], Others, Machine, [Job | Ran], Random);
        wait ->
            ?assertNotEqual([], Running),
            one_ends(Running, Later, Machine, Ran, Random)
    end.

one_ends(Running, Later, Machine, Ran, Random) ->
    {N, Random1} = rand:uniform_s(length(Running), Random),
    run(Running -- [lists:nth(N, Running)], Later, Machine, Ran, Random1).

sound(Running, {Known, Cores}) ->
    Loads = [element(1, maps:get(Name, Known)) || #{name := Name} <- Running],
    Number = fun(Kind) -> length([L || L <- Loads, L =:= Kind]) end,
    ?assert(Number(waits) =< Cores),
    ?assert(Number(computes) =< Cores orelse {Number(computes), Number(waits)} =:= {Cores + 1, 0}),
    ?assert(length(Running) =< ?S:at_most(Cores)),
    ?assert(not lists:member(alone, Loads) orelse length(Loads) =:= 1).
