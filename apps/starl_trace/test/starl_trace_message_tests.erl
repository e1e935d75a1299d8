%% Which terms of a file have the outer shape of a message.
-module(starl_trace_message_tests).
-include_lib("eunit/include/eunit.hrl").

-define(IS(Message), starl_trace_message:is_message(Message)).

%% Of each topic; `n' stands in for each number, `l' for each list, `m' for the map of a scenario.
shapes() ->
    [
        {scenario, n, #{app => a, kind => live, monitors => l, robots => l, scenario => m}},
        {trace, n, {n, note, said}},
        {poses, n, #{full => true, robots => l}},
        {places, n, l},
        {packets, n, {n, n, {ping, 1}, n, fate}},
        {ways, n, {n, {sent, n, what, n, n}}},
        {ways, n, {n, {came, n, what, n, n, fate}}},
        {verdicts, n, {violation, #{contract => sap, at_us => 1}}},
        {verdicts, n, {ended, #{end_us => n, violations => l}}},
        {metrics, n, #{events => 1}},
        {faults, n, {began, {f1, 0}}},
        {log, n, {info, 1, line}},
        {gap, n, n}
    ].

every_topic_has_messages_test() ->
    Messages = [filled(Shape) || Shape <- shapes()],
    [?assertEqual({Message, true}, {Message, ?IS(Message)}) || Message <- Messages],
    ?assertEqual(
        lists:sort(starl_trace_message:topics()), lists:usort([element(1, M) || M <- Messages])
    ),
    ?assert(?IS({gap, 1, no_end})),
    ?assert(?IS({gap, 1, {hole, 5}})).

%% With an atom in the place of one number, list or map it is none.
a_wrong_part_makes_it_none_test() ->
    [
        ?assertEqual({Wrong, false}, {Wrong, ?IS(Wrong)})
     || Shape <- shapes(), Wrong <- wrong(Shape)
    ],
    [
        ?assertEqual({Other, false}, {Other, ?IS(Other)})
     || Other <- [
            nothing,
            {trace, 1},
            {other, 1, 2},
            {trace, 1, {1, "note", said}},
            {scenario, 1, #{
                app => "a", kind => live, monitors => [], robots => [], scenario => #{}
            }},
            {scenario, 1, #{app => a, kind => live, monitors => [], robots => []}},
            {ways, 1, {1, {lost, 1, what, 2, 3}}},
            {faults, 1, {began, f1}},
            {gap, 1, for_no_reason}
        ]
    ].

%% Every way to leave one of the places wrong.
wrong(n) ->
    [wrong];
wrong(l) ->
    [wrong];
wrong(m) ->
    [wrong];
wrong(Tuple) when is_tuple(Tuple) -> [list_to_tuple(L) || L <- one_wrong(tuple_to_list(Tuple))];
wrong(Map) when is_map(Map) ->
    [
        (filled(Map))#{Key := Wrong}
     || {Key, Value} <- maps:to_list(Map), Wrong <- wrong(Value)
    ];
wrong(_) ->
    [].

one_wrong([]) ->
    [];
one_wrong([First | Rest]) ->
    [[Wrong | [filled(R) || R <- Rest]] || Wrong <- wrong(First)] ++
        [[filled(First) | Wrong] || Wrong <- one_wrong(Rest)].

filled(n) -> 1;
filled(l) -> [];
filled(m) -> #{};
filled(Tuple) when is_tuple(Tuple) -> list_to_tuple([filled(T) || T <- tuple_to_list(Tuple)]);
filled(Map) when is_map(Map) -> maps:map(fun(_, Value) -> filled(Value) end, Map);
filled(Other) -> Other.
