%% Each operator makes what it says and nothing else; no mutant is its source.
-module(starl_mutate_operators_tests).
-include_lib("eunit/include/eunit.hrl").

form(Text) ->
    {ok, Tokens, _} = erl_scan:string(Text),
    {ok, Form} = erl_parse:parse_form(Tokens),
    Form.

%% Where blanks stand depends on the release of OTP.
text(Form) -> bare(erl_pp:form(Form)).

bare(Text) -> lists:append(string:lexemes(lists:flatten(Text), " \n")).

%% The mutants that an operator makes of a function, as text, behind its head.
made(Operator, Text) ->
    Form = form("f(X, Y) -> " ++ Text ++ "."),
    [
        lists:nthtail(length("f(X,Y)->"), lists:droplast(text(New)))
     || #{operator := O, form := New} <- starl_mutate_operators:mutants(Form), O =:= Operator
    ].

-define(MADE(Expected, Operator, Text),
    ?assertEqual([bare(E) || E <- Expected], made(Operator, Text))
).

compare_test() ->
    ?MADE(["X =< Y", "X >= Y"], compare, "X < Y"),
    ?MADE(["X < Y", "X > Y"], compare, "X =< Y"),
    ?MADE(["X >= Y", "X =< Y"], compare, "X > Y"),
    ?MADE(["X > Y", "X < Y"], compare, "X >= Y"),
    ?MADE(["X =/= Y"], compare, "X =:= Y"),
    ?MADE(["X =:= Y"], compare, "X =/= Y"),
    ?MADE(["X /= Y"], compare, "X == Y"),
    ?MADE(["X == Y"], compare, "X /= Y"),
    ?MADE([], compare, "X + Y").

constant_test() ->
    ?MADE(["8", "6"], constant, "7"),
    ?MADE(["1"], constant, "0"),
    ?MADE(["2.5"], constant, "1.5"),
    %% of a pattern, too
    ?MADE(["{2, X} = Y", "{0, X} = Y"], constant, "{1, X} = Y"),
    ?MADE([], constant, "<<X:8, 7>>"),
    ?MADE([], constant, "fun lists:nth/2"),
    ?MADE([], constant, "[$a, \"7\", seven]").

clause_test() ->
    ?MADE(["case X of b -> 2 end", "case X of a -> 1 end"], clause, "case X of a -> 1; b -> 2 end"),
    ?MADE(["fun (2) -> a end", "fun (1) -> b end"], clause, "fun(1) -> b; (2) -> a end"),
    ?MADE([], clause, "case X of a -> 1 end"),
    Two = form("g(a) -> 1; g(b) -> 2."),
    ?assertEqual(
        ["g(b)->2.", "g(a)->1."],
        [text(F) || #{operator := clause, form := F} <- starl_mutate_operators:mutants(Two)]
    ).

guard_test() ->
    ?MADE(["case X of Z -> Z end"], guard, "case X of Z when Z < 1 -> Z end"),
    ?MADE(
        ["case X of Z when is_atom(Z) -> Z end", "case X of Z when Z < a -> Z end"],
        guard,
        "case X of Z when Z < a, is_atom(Z) -> Z end"
    ),
    ?MADE(
        ["case X of Z when is_atom(Z) -> Z end", "case X of Z when Z < a -> Z end"],
        guard,
        "case X of Z when Z < a; is_atom(Z) -> Z end"
    ),
    ?MADE(["X", "Y"], guard, "X andalso Y"),
    ?MADE(["X", "Y"], guard, "X orelse Y"),
    ?MADE(["[ Z || Z <- X ]"], guard, "[Z || Z <- X, Y]").

action_test() ->
    ?MADE(["Y"], action, "X ! a, Y"),
    ?MADE(["Y"], action, "ok = g(X), Y"),
    ?MADE(["Y"], action, "_ = g(X), Y"),
    %% what binds a variable is needed
    ?MADE([], action, "Z = g(X), Z"),
    ?MADE([], action, "Y").

field_test() ->
    ?MADE(["X#{b => 2}", "X#{a := 1}"], field, "X#{a := 1, b => 2}"),
    ?MADE(["X"], field, "X#{a => 1}"),
    ?MADE(["X#r{b = 2}", "X#r{a = 1}"], field, "X#r{a = 1, b = 2}"),
    ?MADE(["X"], field, "X#r{a = 1}"),
    %% what is made anew is no update
    ?MADE([], field, "{#{a => 1}, #r{a = 1}}").

element_test() ->
    ?MADE(["[Y]", "[X]"], element, "[X, Y]"),
    ?MADE(["Y"], element, "[X | Y]"),
    ?MADE(["X", "Y"], element, "X ++ Y"),
    ?MADE(["X"], element, "X -- Y"),
    %% a timer that is not cancelled
    ?MADE(["Y"], element, "[{{timeout, again}, cancel} | Y]"),
    ?MADE([], element, "case X of [Z | _] -> Z end").

negate_test() ->
    ?MADE(["false"], negate, "true"),
    ?MADE(["X"], negate, "not X"),
    ?MADE(["X orelse Y", "not X andalso Y", "X andalso not Y"], negate, "X andalso Y"),
    ?MADE(["X < 1 andalso Y < 1"], negate, "X < 1 orelse Y < 1"),
    ?MADE(
        ["case not g(X) of true -> a; false -> b end"],
        negate,
        "case g(X) of true -> a; false -> b end"
    ),
    %% no truth value
    ?MADE([], negate, "case g(X) of yes -> a; false -> b end").

arithmetic_test() ->
    [
        ?MADE(["X " ++ New ++ " Y" || New <- Others], arithmetic, "X " ++ Op ++ " Y")
     || {Op, Others} <- [
            {"+", ["-"]},
            {"-", ["+"]},
            {"*", ["+"]},
            {"/", ["*"]},
            {"div", ["*", "rem"]},
            {"rem", ["div"]},
            {"band", ["bor"]},
            {"bor", ["band"]},
            {"bxor", ["bor"]},
            {"bsl", ["bsr"]},
            {"bsr", ["bsl"]}
        ]
    ].

call_test() ->
    ?MADE(["min(X, Y)"], call, "max(X, Y)"),
    ?MADE(["max(X, Y)"], call, "min(X, Y)"),
    [
        ?MADE(New, call, Old)
     || {Old, New} <- [
            {"maps:put(a, b, X)", ["X"]},
            {"maps:remove(a, X)", ["X"]},
            {"maps:without(Y, X)", ["X"]},
            {"maps:merge(X, Y)", ["X", "Y"]},
            {"lists:delete(X, Y)", ["Y"]},
            {"lists:sort(X)", ["X"]},
            {"lists:usort(X)", ["X"]},
            {"lists:reverse(X)", ["X"]},
            {"lists:all(X, Y)", ["lists:any(X, Y)"]},
            {"lists:max(X)", ["lists:min(X)"]},
            {"ordsets:union(X, Y)", ["X", "Y"]},
            {"lists:map(X, Y)", []},
            {"other:sort(X)", []}
        ]
    ].

%% Every place is reached: what a function is made of, with a number in each.
everywhere_test() ->
    [
        ?assertMatch({Text, [_, _ | _]}, {Text, made(constant, Text)})
     || Text <- [
            "try X of 1 -> a catch _:_ -> b after c end",
            "try X catch _:_ -> 1 after c end",
            "try X catch _:_ -> a after 1 end",
            "begin X, 1 end",
            "fun() -> 1 end",
            "fun F() -> F(1) end",
            "X#{a => 1}",
            "X#r{a = 1}",
            "#r{a = 1}",
            "g(1)",
            "m:g(1)",
            "[1 || _ <- X]",
            "[Z || Z <- 1]",
            "[Z || Z <- X, Z > 1]",
            "<< <<Z>> || Z <- [1] >>",
            "if X > 1 -> a end",
            "receive 1 -> a end",
            "receive a -> b after 1 -> c end",
            "receive a -> b after X -> 1 end",
            "-1",
            "catch 1",
            "X#r{a = 2}#r.a"
        ]
    ].

%% Of the blocks' own code: no mutant is what it was made from, and no two of a function are equal
%% but where the operators say the same in two ways.
own_code_test() ->
    {ok, #{forms := Forms}} = starl_mutate_code:forms("starl_election_bully.erl"),
    All = [{Form, M} || Form <- Forms, M <- starl_mutate_operators:mutants(Form)],
    ?assert(length(All) > 100),
    ?assertEqual([], [M || {Form, #{form := Form} = M} <- All]),
    Used = lists:usort([O || {_, #{operator := O}} <- All]),
    ?assertEqual([], Used -- [O || {O, _} <- starl_mutate_operators:operators()]).
