%% The lines on what a run has not judged.
-module(starl_unjudged_tests).
-include_lib("eunit/include/eunit.hrl").

lines(Results) -> [lists:flatten(Line) || Line <- starl_monitor:clauses_not_judged(Results)].

%% In the order of monitors; none for those that have judged all.
clauses_test() ->
    Results = #{
        starl_sap_monitor => #{sent => 3, unjudged => [{"delivered", "why"}]},
        starl_mutex_monitor => starl_unjudged:with(starl_unjudged:lossy("granted", 0.6), #{}),
        starl_counter_monitor => starl_unjudged:with([], #{agreed => 1})
    },
    ?assertEqual(
        ["not judged: mutex, granted: the radio loses 60.0 %", "not judged: sap, delivered: why"],
        lines(Results)
    ).

reasons_test() ->
    Text = fun(Clauses) -> [lists:flatten(Why) || {"c", Why} <- Clauses] end,
    ?assertEqual(
        ["too few messages for a radio that loses 5.0 %"], Text(starl_unjudged:too_few("c", 0.05))
    ),
    ?assertEqual(
        ["they wait, for less than the bound of 2.5 s"],
        Text(starl_unjudged:too_short("c", 2500000, "they wait"))
    ),
    ?assertEqual([], starl_unjudged:unhealed("c", 9, 10)),
    ?assertEqual([], starl_unjudged:unhealed("c", 0, 0)),
    ?assertMatch([_], starl_unjudged:unhealed("c", 10, 10)),
    ?assertMatch([_], starl_unjudged:unhealed("c", never, 10)).

%% A bound that begins anew after each fault has room in the run, or not.
excused_test() ->
    Excused = fun(Windows) ->
        starl_unjudged:excused("c", 100, 1000, starl_assumption:new(Windows, 0))
    end,
    ?assertEqual([], Excused([])),
    ?assertEqual([], Excused([{1, 50, 850, fault}])),
    ?assertMatch([_], Excused([{1, 50, 950, fault}])).
