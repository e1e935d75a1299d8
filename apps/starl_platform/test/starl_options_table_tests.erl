%% What is told of an application's own table of options.
-module(starl_options_table_tests).
-include_lib("eunit/include/eunit.hrl").

told(Table) -> told(Table, []).

told(Table, Taken) ->
    case starl_options:check_table(Table, Taken) of
        ok -> ok;
        {error, Line} -> unicode:characters_to_list(Line)
    end.

%% Every type, with a default at its bound.
sound_test() ->
    IsEven = fun(N) -> N rem 2 =:= 0 end,
    ?assertEqual(
        ok,
        told(
            [
                {a, {integer, 1, 3}, 3, "a"},
                {b, {number, 0, 0.5}, 0.5, "b"},
                {c, {between, {integer, 0, 9}}, {0, 9}, "c"},
                {d, {size, {integer, 0, 9}}, {9, 1}, "d"},
                {e, {one_of, [on, off]}, off, "e"},
                {f, {optional, {integer, 1, 2}}, none, "f"},
                {g, string, "text", "ünïcode"},
                {h, file, "none", ""},
                {i, boolean, true, "i"},
                {j, {term, "an even number", IsEven}, 4, "j"}
            ],
            [robots]
        )
    ),
    ?assertEqual(ok, told([], [robots])).

-define(LIST, "a list of {Key, Type, Default, \"Doc\"} expected, not ").
-define(OPTION, "an option is {Key, Type, Default, \"Doc\"}, not ").

wrong_test_() ->
    A = {a, boolean, true, "a"},
    [
        {Text, ?_assertEqual(Text, told(Table, [robots]))}
     || {Text, Table} <- [
            {?LIST "#{}", #{}},
            {?LIST "x", [A | x]},
            {?OPTION "{a,boolean,true}", [{a, boolean, true}]},
            {?OPTION "{\"a\",boolean,true,\"a\"}", [{"a", boolean, true, "a"}]},
            {"the key robots is taken already", [A, {robots, boolean, true, "r"}]},
            {"the key a is taken already", [A, A]},
            {"a: the default 4 is not a whole number from 1 to 3", [{a, {integer, 1, 3}, 4, "a"}]},
            {"a: the default 7 is not true or false", [{a, boolean, 7, "a"}]},
            {"a: the last element is a text, not doc", [{a, boolean, true, doc}]}
        ]
    ].

%% A type that is none is told as such, with those that are.
no_type_test_() ->
    [
        ?_assertMatch("a: " ++ _, contains(" is no type; types are {integer, Min, Max}, ", Line))
     || Type <- [
            int,
            {integer, 1},
            {integer, 1.5, 2},
            {number, low, 2},
            {between, int},
            {size, int},
            {one_of, [1]},
            {one_of, on},
            {optional, int},
            {term, "x", fun() -> true end},
            {term, x, fun(_) -> true end}
        ],
        Line <- [told([{a, Type, 1, "a"}])]
    ].

contains(Part, Line) ->
    ?assertNotEqual({nomatch, Line}, {string:find(Line, Part), Line}),
    Line.
