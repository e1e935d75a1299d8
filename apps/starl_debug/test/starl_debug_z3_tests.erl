%% Three robots whose overlap is certain by cases only; a solver that is absent, killed or hangs.
-module(starl_debug_z3_tests).

-include_lib("eunit/include/eunit.hrl").

%% Robot 3 always; one of the two holds of robot 2 meets that of robot 1 whatever the clocks.
-define(WINDOWS, #{1 => {-50000, 50000}, 2 => {-50000, 50000}, 3 => {-50000, 50000}}).

decided(Second, Solver) ->
    Part = fun(R) -> {local, R, {state, {owner, any}}} end,
    Sets = #{1 => [{4990000, 5020000}], 2 => Second, 3 => [{0, 9000000}]},
    Facts = #{
        states => #{},
        tracks => #{},
        drift_ppm => 100,
        locals => maps:from_list([{Part(R), {S, S}} || {R, S} <- maps:to_list(Sets)])
    },
    Limits = #{drift => 10, fine => 100, looks => 1},
    Range = {4900000, 5100000},
    starl_debug_cases:decide(
        {'and', [Part(1), Part(2), Part(3)]}, {Range, ?WINDOWS}, Facts, Limits, Solver
    ).

%% Two intervals are apart for errors that leave less between them than the clocks may run apart.
a_query_leaves_room_for_the_drift_test() ->
    Windows = #{1 => {-50, 50}, 2 => {-50, 50}},
    Tuple = [{1, {100, 200}}, {2, {150, 300}}],
    Query = unicode:characters_to_list(starl_debug_cases:query([Tuple], Windows, 10, [1, 2])),
    [
        ?assertNotEqual({Part, nomatch}, {Part, string:find(Query, Part)})
     || Part <- ["(> (- o2 o1) 190.0)", "(> (- o1 o2) 40.0)", "(<= (- 50.0) o1) (<= o1 50.0)"]
    ].

cases_test_() ->
    case starl_debug_z3:find() of
        none ->
            [];
        {ok, File} ->
            Solver = starl_debug_z3:solver(File),
            [
                {timeout, 60,
                    ?_assertEqual(
                        certainly, decided([{4000000, 5000000}, {5010000, 6000000}], Solver)
                    )},
                {timeout, 60,
                    ?_assertEqual(
                        not_certainly, decided([{4000000, 5000000}, {5050000, 6000000}], Solver)
                    )},
                %% there is one for each error, but the clocks may run apart from the one to the other
                {timeout, 60,
                    ?_assertEqual(
                        not_certainly, decided([{4000000, 4990005}, {5020000, 6000000}], Solver)
                    )},
                {timeout, 60,
                    ?_assertEqual(
                        undecided, starl_debug_z3:ask(File, "(assert (< nobody 1))\n", 1000)
                    )}
            ]
    end.

a_program_that_is_not_there_or_fails_decides_nothing_test_() ->
    [
        {timeout, 60, ?_assertEqual(undecided, starl_debug_z3:ask(File, "", 100))}
     || File <- ["/nowhere/z3", os:find_executable("false"), os:find_executable("cat")]
    ].

a_program_that_hangs_is_killed_test_() ->
    {timeout, 60, fun() ->
        File = filename:join(os:getenv("TMPDIR", "/tmp"), "starl_z3_" ++ os:getpid()),
        ok = file:write_file(File, "#!/bin/sh\nexec sleep 1000\n"),
        ok = file:change_mode(File, 8#755),
        ?assertEqual(undecided, starl_debug_z3:ask(File, "", 10)),
        ok = file:delete(File)
    end}.
