%% Configuration as data: every problem is reported together, unknown keys are problems.
-module(starl_options_tests).
-include_lib("eunit/include/eunit.hrl").

-define(OPTIONS, [
    {robots, {integer, 1, 10}, 4, "how many"},
    {loss, {number, 0, 1}, 0.0, "part lost"},
    {delay, {between, {number, 1, 100}}, {5, 20}, "ms"},
    {world, {size, {number, 1, 100}}, {10, 10}, "mm"},
    {range, {optional, {number, 1, 9}}, none, "mm"},
    {mode, {one_of, [slow, fast]}, slow, "how"},
    {name, string, "x", "a name"},
    {flag, boolean, false, "a flag"},
    {faults, {term, "a list", fun is_list/1}, [], "faults"}
]).

defaults_complete_test() ->
    {ok, Checked} = starl_options:check(#{robots => 7}, ?OPTIONS),
    ?assertEqual(9, map_size(Checked)),
    ?assertMatch(#{robots := 7, loss := +0.0, delay := {5, 20}, mode := slow}, Checked).

all_problems_at_once_test() ->
    Given = #{robots => 0, los => 1, delay => {9, 3}, mode => fats, flag => 1, name => ""},
    {error, Problems} = starl_options:check(Given, ?OPTIONS),
    ?assertEqual(6, length(Problems)),
    ?assertMatch([{unknown_key, los, [loss]}], [P || {unknown_key, _, _} = P <- Problems]),
    ?assertEqual(
        [delay, flag, mode, name, robots],
        lists:sort([Key || {bad_value, Key, _, _} <- Problems])
    ).

bounds_are_inclusive_test_() ->
    Is = fun(Key, Value) -> element(1, starl_options:check(#{Key => Value}, ?OPTIONS)) end,
    [
        ?_assertEqual({K, V, Expected}, {K, V, Is(K, V)})
     || {K, V, Expected} <- [
            {robots, 1, ok},
            {robots, 10, ok},
            {robots, 11, error},
            {robots, 2.0, error},
            {loss, 0, ok},
            {loss, 1, ok},
            {loss, 1.01, error},
            {loss, -0.01, error},
            {loss, a, error},
            {delay, {1, 1}, ok},
            {delay, {1, 101}, error},
            {world, {1, 100}, ok},
            {world, {0, 1}, error},
            {range, none, ok},
            {range, 9, ok},
            {range, nine, error},
            {mode, fast, ok},
            {name, "å", ok},
            {name, <<"x">>, error},
            {name, [a], error},
            {flag, true, ok},
            {faults, [], ok},
            {faults, x, error}
        ]
    ].

parse_test_() ->
    [
        ?_assertEqual({Type, Text, Expected}, {Type, Text, starl_options:parse(Type, Text)})
     || {Type, Text, Expected} <- [
            {{integer, 1, 10}, "3", {ok, 3}},
            {{integer, 1, 10}, "0", error},
            {{integer, 1, 10}, "3.0", error},
            {{integer, 1, 10}, "3x", error},
            {{integer, 1, 10}, "", error},
            {{number, 0, 1}, "0.5", {ok, 0.5}},
            {{number, 0, 1}, ".5", {ok, 0.5}},
            {{number, 0, 1}, "1", {ok, 1}},
            {{number, 0, 1}, "2", error},
            {{number, 0, 1}, "-.5", error},
            {{number, 0, 1}, "", error},
            {{number, 0, 1}, ".", error},
            {{number, 0, 1}, "..5", error},
            {{number, 0, 1}, "nan", error},
            {{number, 0, 1}, "0.5 ", error},
            {{between, {number, 0, 99}}, "5..50", {ok, {5, 50}}},
            {{between, {number, 0, 99}}, "5.5..50", {ok, {5.5, 50}}},
            {{between, {number, 0, 99}}, "7", {ok, {7, 7}}},
            {{between, {number, 0, 99}}, "50..5", error},
            {{between, {number, 0, 99}}, "5..", error},
            {{size, {number, 1, 99}}, "12x8", {ok, {12, 8}}},
            {{size, {number, 1, 99}}, "12", error},
            {{size, {number, 1, 99}}, "12x0", error},
            {{optional, {number, 1, 9}}, "none", {ok, none}},
            {{optional, {number, 1, 9}}, "3", {ok, 3}},
            {{one_of, [slow, fast]}, "fast", {ok, fast}},
            {{one_of, [slow]}, "fats", error},
            {string, "x y", {ok, "x y"}},
            {string, "", error},
            {boolean, "true", {ok, true}},
            {boolean, "yes", error}
        ]
    ].

parse_term_test() ->
    Type = {term, "a list", fun is_list/1},
    ?assertEqual({ok, [{a, 1}]}, starl_options:parse(Type, "[{a, 1}]")),
    [
        ?assertEqual({T, error}, {T, starl_options:parse(Type, T)})
     || T <- ["a", "[", "[a", "f()", "[self()]", "'", "[a]. [b]", ""]
    ].

%% Text from outside makes no atoms of options.
parse_one_of_makes_no_atoms_test() ->
    error = starl_options:parse({one_of, [slow]}, "starl_no_such_option_value"),
    ?assertError(badarg, list_to_existing_atom("starl_no_such_option_" ++ "value")).

%% What parse/2 accepts, check/2 accepts.
parsed_values_are_valid_test() ->
    [
        begin
            {ok, Value} = starl_options:parse(Type, Text),
            ?assertMatch({ok, _}, starl_options:check(#{Key => Value}, ?OPTIONS))
        end
     || {Key, Text} <- [
            {robots, "3"},
            {loss, "0.2"},
            {delay, "5..9"},
            {delay, "5"},
            {world, "3x4"},
            {range, "none"},
            {mode, "fast"},
            {name, "a"},
            {flag, "true"},
            {faults, "[]"}
        ],
        {K, Type, _, _} <- ?OPTIONS,
        K =:= Key
    ].

%% A value that the text of a type allows is allowed: `a number, or two as LOW..HIGH'.
what_the_text_says_is_valid_test() ->
    ?assertMatch({ok, _}, starl_options:check(#{delay => 20}, ?OPTIONS)).

a_bound_is_written_without_an_exponent_test() ->
    ?assertEqual(
        "a number from 0.5 to 1000000000, or none",
        lists:flatten(starl_options:type_text({optional, {number, 0.5, 1.0e9}}))
    ).

problems_in_one_line_test() ->
    Line = fun(P) -> lists:flatten(io_lib:format("~ts", [starl_options:format_problem(P)])) end,
    ?assertEqual("unknown key los (did you mean loss?)", Line({unknown_key, los, [loss]})),
    ?assertEqual("unknown key \"x\"", Line({unknown_key, "x", []})),
    Types = [Type || {_, Type, _, _} <- ?OPTIONS],
    [?assertNotEqual("", Line({bad_value, k, v, Type})) || Type <- Types],
    ?assertEqual(
        "robots: a whole number from 1 to 10 expected, not 0",
        Line({bad_value, robots, 0, {integer, 1, 10}})
    ).

%% Of a list the entry that does not fit is named, in a file as on a command line.
the_entry_that_does_not_fit_is_named_test() ->
    Is = fun(List) -> is_list(List) andalso lists:all(fun is_integer/1, List) end,
    Type = {term, "a list of numbers", Is},
    Line = fun(Value) ->
        Text = starl_options:format_problem({bad_value, k, Value, Type}),
        unicode:characters_to_list(Text)
    end,
    ?assertEqual("k: a list of numbers expected, not [1,x,y] (entry 2 is x)", Line([1, x, y])),
    ?assertEqual("k: a list of numbers expected, not x", Line(x)),
    ?assertEqual("k: a list of numbers expected, not [1|x]", Line([1 | x])),
    Misread = fun(Text) -> lists:flatten(starl_options:misread(Type, Text)) end,
    ?assertEqual("entry 2 is x", Misread("[1,x]")),
    ?assertEqual("it ends too early", Misread("[1,")),
    ?assertEqual(none, starl_options:misread(Type, "x")).
