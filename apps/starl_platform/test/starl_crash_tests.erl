%% What a crash is called: its reason in words, and the place that its reader can mend.
-module(starl_crash_tests).
-include_lib("eunit/include/eunit.hrl").

%% Each kind of mistake, made in earnest, has a sentence of its own.
words_test_() ->
    [
        ?_assertEqual(Words, reason(Mistake))
     || {Words, Mistake} <- [
            {"no match of the value {error,lost}", fun() -> ok = opaque({error, lost}) end},
            {"the map has no key place", fun() -> maps:get(place, opaque(#{})) end},
            {"the map has no key place", fun() -> (opaque(#{}))#{place := 1} end},
            {"this is no map: 7", fun() -> maps:get(place, opaque(7)) end},
            {"no clause of a case takes 7", fun() ->
                case opaque(7) of
                    8 -> ok
                end
            end},
            {"no branch of an if is true", fun() ->
                if
                    node() =:= nowhere -> ok
                end
            end},
            {"bad argument: erlang:atom_to_list(7)", fun() -> atom_to_list(opaque(7)) end},
            {"thrown and not caught: ball", fun() -> throw(ball) end},
            {"exit with gone", fun() -> exit(gone) end},
            {"{my,own}", fun() -> error({my, own}) end},
            {"there is no function starl:goto/2 (did you mean go_to?)", fun() ->
                apply(opaque(starl), goto, [1, 2])
            end},
            {"there is no function starl:sleep/1 (but /2)", fun() ->
                apply(opaque(starl), sleep, [1])
            end},
            {"there is no module starl_electon (did you mean starl_election?)", fun() ->
                apply(opaque(starl_electon), elect, [1])
            end},
            {"there is no module election (did you mean starl_election?)", fun() ->
                apply(opaque(election), elect, [1])
            end}
        ]
    ].

%% The arguments are told, but for the handle of the robot.
function_clause_test() ->
    Robot = starl:robot(1, starl_team:new([1, 2])),
    ?assertEqual(
        "no clause of starl_crash_tests:placed/2 takes (Robot, nowhere)",
        reason(fun() -> placed(Robot, opaque(nowhere)) end)
    ).

placed(_Robot, here) -> ok.

%% What the runtime itself says of an application.
mistakes_of_an_application_test() ->
    ?assertEqual(
        "step/2 returned {next,s}; it returns {continue, State} or {done, Result}",
        text({bad_return, {my_app, step}, {next, s}}, [{my_app, step, 2, []}])
    ),
    Elect = [{starl_election, elect, 3, []}, {my_app, step, 2, []}],
    ?assertEqual(
        "this robot has no machine election; list its block: blocks() -> [starl_election]",
        text({no_such_machine, election, add_it_to_blocks}, Elect)
    ),
    ?assertEqual(
        "this robot has no machine odd; is its block in the list of blocks/0?",
        text({no_such_machine, odd, add_it_to_blocks}, [{starl, call, 4, []}])
    ).

%% Erlang gives the numbers of a calculation with some operators only.
calculations_test() ->
    ?assertEqual(
        "1 + north cannot be calculated",
        text(badarith, [{erlang, '+', [1, north], []}, {my_app, step, 2, []}])
    ),
    ?assertEqual(
        "no calculation with these values: is each of them a number?",
        text(badarith, [{my_app, step, 2, []}])
    ).

%% Neither processes nor functions differ from run to run.
no_names_of_processes_test() ->
    ?assertEqual("no match of the value <>", text({badmatch, self()}, [{m, f, 1, []}])).

%% The number of steps is not part of the cause.
steps_test() ->
    Reason = starl_crash:reason(error, oops, [{my_app, step, 2, []}]),
    ?assertEqual(7, starl_crash:steps(starl_crash:with_steps(7, Reason))),
    ?assertEqual(unknown, starl_crash:steps(Reason)),
    ?assertEqual(
        starl_crash:cause(Reason), starl_crash:cause(starl_crash:with_steps(7, Reason))
    ).

%% The place is neither in Erlang nor in StarL if it can be elsewhere.
place_test() ->
    Library = {lists, map, 2, "lists.erl", 1559},
    Starl = {starl, sleep, 2, "starl.erl", 7},
    Own = {my_app, step, 2, "my_app.erl", 5},
    Bare = {erlang, map_get, 2, "", 0},
    ?assertEqual(Own, starl_crash:place([Bare, Library, Starl, Own, {my_app, go, 0, "b.erl", 1}])),
    ?assertEqual(Starl, starl_crash:place([Bare, Starl])),
    ?assertEqual(none, starl_crash:place([Bare])),
    ?assertEqual(none, starl_crash:place([])).

%% A function without a known place is shown without one.
frame_test() ->
    ?assertEqual(
        "oops at erlang:map_get/2, my_app:step/2 (my_app.erl:5)",
        lists:flatten(
            starl_crash:format(
                {"oops", [{erlang, map_get, 2, "", 0}, {my_app, step, 2, "my_app.erl", 5}]}
            )
        )
    ).

reason(Mistake) ->
    try Mistake() of
        Value -> {no_crash, Value}
    catch
        Class:Reason:Stack ->
            {Text, [_ | _]} = starl_crash:cause(starl_crash:reason(Class, Reason, Stack)),
            Text
    end.

text(Reason, Stack) ->
    {Text, _} = starl_crash:cause({Reason, Stack}),
    Text.

%% The compiler does not see the mistake.
opaque(Term) -> binary_to_term(term_to_binary(Term)).
