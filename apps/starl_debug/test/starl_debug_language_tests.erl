-module(starl_debug_language_tests).

-include_lib("eunit/include/eunit.hrl").

typed(Text) ->
    {ok, Typed} = starl_debug:predicate(Text),
    Typed.

a_distance_of_two_robots_test() ->
    ?assertEqual({'<', {dist, {pos, 1}, {pos, 2}}, 400}, typed("dist(r1.pos, r2.pos) < 400 mm")),
    ?assertEqual({'>', {dist, {pos, 1}, {pos, 2}}, 40}, typed("4 cm <= dist(r1.pos, r2.pos)")).

a_length_may_stand_on_the_left_test() ->
    [
        ?assertEqual({Sign, typed("r1.x " ++ Right ++ " 400 mm")}, {
            Sign, typed("400 mm " ++ Sign ++ " r1.x")
        })
     || {Sign, Right} <- [{"<", ">"}, {"<=", ">="}, {">", "<"}, {">=", "<="}]
    ],
    ?assertEqual({'<', {x, 1}, 400}, typed("400 mm >= r1.x")).

and_binds_stronger_than_or_test() ->
    {'or', _, {'and', _, {'not', _}}} = typed("up(r1) or up(r2) and not up(r3)").

for_binds_stronger_than_and_test() ->
    {'and', _, {for, 2000000, _}} = typed("up(r1) and up(r2) for 2 s"),
    {within, 5000, _, _} = typed("up(r1) within 5 ms after up(r2)").

a_quantifier_reaches_to_the_end_test() ->
    {exists, [{robot, <<"a">>}, {token, <<"t">>}], {'and', _, _}} =
        typed("exists a, token t: owner(a, t) and up(a)").

an_expression_of_a_program_is_a_predicate_test() ->
    ?assertEqual(
        typed("owner(r1, t)"), typed({call, <<"owner">>, [{name, <<"r1">>}, {name, <<"t">>}]})
    ).

each_predicate_of_the_library_has_a_meaning_test_() ->
    Argument = #{none => "", length => "(1 mm)", duration => "(1 s)"},
    [
        ?_assertMatch({ok, _}, starl_debug:predicate([Name, maps:get(Kind, Argument)]))
     || {Name, Kind, _, _} <- starl_debug_library:known()
    ].

problems_have_their_column_test_() ->
    [
        {Text, fun() -> {error, {Column, _}} = starl_debug:predicate(Text) end}
     || {Column, Text} <- [
            {1, ""},
            {22, "dist(r1.pos, r2.pos) < 400"},
            {24, "dist(r1.pos, r2.pos) < 400 feet"},
            {6, "dist(r1, r2) < 4 mm"},
            {21, "dist(r1.pos, r2.pos < 400 mm"},
            {9, "r1.mode = movin"},
            {1, "r1.speed > 3 m"},
            {7, "owner(x, t)"},
            {1, "frob(r1)"},
            {8, "up(r1) up(r2)"},
            {12, "up(r1) for 2"},
            {6, "up(r1"},
            {7, "owner(\"r1)"},
            {1, "exists r1: up(r1)"},
            {17, "count(r: up(r)) > 3 mm"},
            {3, "1 < 2"},
            {1, "#"}
        ]
    ].

different_variables_are_different_robots_test() ->
    Formula = starl_debug_ground:formula(typed("too_near(1 m)"), #{
        robots => [1, 2, 3], tokens => [], elections => [], geocasts => []
    }),
    ?assertEqual({'or', [{'<', 1, 2, 1000}, {'<', 1, 3, 1000}, {'<', 2, 3, 1000}]}, Formula).

a_count_of_all_is_all_test() ->
    Known = #{robots => [1, 2, 3], tokens => [], elections => [], geocasts => []},
    Ground = fun(Text) -> starl_debug_ground:formula(typed(Text), Known) end,
    ?assertEqual(Ground("forall r: up(r)"), Ground("count(r: up(r)) >= 3")),
    ?assertEqual(Ground("exists r: not up(r)"), Ground("not count(r: up(r)) = 3")),
    ?assertEqual(false, Ground("count(r: up(r)) > 3")).
