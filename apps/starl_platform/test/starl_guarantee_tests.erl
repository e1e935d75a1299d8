-module(starl_guarantee_tests).
-include_lib("eunit/include/eunit.hrl").

parts() ->
    [
        {radio, [
            {delivered, progress, "delivered", [delivery]}, {once, safety, "at most once", []}
        ]},
        {lock, [
            {one, safety, "one holder", [clock_rate]},
            {granted, progress, "granted", [{radio, delivered}]}
        ]},
        {app, [
            {counts, safety, "counts right", [{lock, one}]},
            {ends, progress, "ends", [{lock, granted}]},
            {order, safety, "in order", [{any, [store, clock_forward]}]}
        ]}
    ].

verdicts(Broken) ->
    [
        {Name, Guarantee, Verdict}
     || {Name, Own} <- starl_guarantee:composed(parts(), Broken),
        {{Guarantee, _, _, _}, Verdict} <- Own
    ].

open(Broken) -> [{Name, Guarantee} || {Name, Guarantee, {open, _}} <- verdicts(Broken)].

all_hold_where_nothing_is_broken_test() -> ?assertEqual([], open([])).

a_broken_condition_reaches_what_rests_on_it_test() ->
    ?assertEqual([{lock, one}, {app, counts}], open([clock_rate])),
    ?assertEqual([{radio, delivered}, {lock, granted}, {app, ends}], open([delivery])).

one_of_several_is_enough_test() ->
    ?assertEqual([], open([store])),
    ?assertEqual([], open([clock_forward])),
    ?assertEqual([{app, order}], open([store, clock_forward])).

the_reason_is_what_is_missing_test() ->
    ?assertEqual(
        [{lock, one, {open, [clock_rate]}}, {app, counts, {open, [{lock, one}]}}],
        [One || {_, _, {open, _}} = One <- verdicts([clock_rate])]
    ).

what_rests_on_an_absent_block_is_open_test() ->
    [_ | WithoutRadio] = parts(),
    ?assertMatch(
        [
            {lock, [_, {{granted, _, _, _}, {open, [{radio, delivered}]}}]},
            {app, [_, {_, {open, _}}, _]}
        ],
        starl_guarantee:composed(WithoutRadio, [])
    ).

%% Two that rest on each other stand or fall together.
circles_end_test() ->
    Circle = [
        {a, [{x, progress, "x", [{b, y}]}]},
        {b, [{y, progress, "y", [{a, x}, delivery]}]}
    ],
    ?assertMatch([{a, [{_, holds}]}, {b, [{_, holds}]}], starl_guarantee:composed(Circle, [])),
    ?assertMatch(
        [{a, [{_, {open, _}}]}, {b, [{_, {open, _}}]}], starl_guarantee:composed(Circle, [delivery])
    ).

mistakes_are_one_line_test_() ->
    [
        ?_assertEqual({error, true}, one_line(starl_guarantee:check(Term)))
     || Term <- [
            x,
            [x],
            [{a, always, "x", []}],
            [{a, safety, <<"x">>, []}],
            [{a, safety, "x", [no_such_condition]}],
            [{a, safety, "x", [{any, []}]}],
            [{a, safety, "x", delivery}]
        ]
    ].

one_line({error, Line}) ->
    {error, not lists:member($\n, lists:flatten(io_lib:format("~ts", [Line])))};
one_line(ok) ->
    ok.

each_condition_has_words_test() ->
    [
        ?assert(is_list(starl_guarantee:text(Condition)))
     || {Condition, _} <- starl_guarantee:conditions()
    ].
