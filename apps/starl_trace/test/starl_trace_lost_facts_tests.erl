%% What the recording of a killed node has lost, by the record of its facts.
-module(starl_trace_lost_facts_tests).
-include_lib("eunit/include/eunit.hrl").

fact(N) -> {N, 3, sap, {told, N}}.

facts(Numbers) -> [fact(N) || N <- Numbers].

recorded(Numbers) -> [{sap, {told, N}} || N <- Numbers].

facts_after_the_recording_are_lost_test() ->
    Facts = facts(lists:seq(1, 300)),
    [
        ?assertEqual(
            facts(lists:seq(N + 1, 300)),
            starl_trace_lost_facts:lost(recorded(lists:seq(1, N)), Facts)
        )
     || N <- [1, 2, 99, 100, 101, 299, 300]
    ].

%% Events that are alike: those of the latest that fit are recorded.
latest_of_alike_events_are_recorded_test() ->
    Facts = [{1, 3, sap, tick}, {2, 3, sap, tick}, {3, 3, sap, tock}, {4, 3, sap, tick}],
    ?assertEqual(
        [{4, 3, sap, tick}],
        starl_trace_lost_facts:lost([{sap, tick}, {sap, tick}, {sap, tock}], Facts)
    ).

%% Before the end of an earlier start of the same node nothing of the last start is recorded.
earlier_start_test() ->
    End = [{robot, down}, {sap, crashed}, {app, crashed}],
    Facts = facts([5, 6, 7]),
    ?assertEqual(Facts, starl_trace_lost_facts:lost(recorded([1, 2]) ++ End, Facts)),
    ?assertEqual(
        facts([7]), starl_trace_lost_facts:lost(recorded([1, 2]) ++ End ++ recorded([5, 6]), Facts)
    ),
    ?assertEqual(Facts, starl_trace_lost_facts:lost([], Facts)),
    ?assertEqual([], starl_trace_lost_facts:lost(recorded([1]), [])).

%% A machine of the last start has crashed at once, as those of the start before did with their robot.
same_crash_test() ->
    End = [{robot, down}, {sap, crashed}, {app, crashed}],
    Facts = [{5, 3, app, crashed}, fact(6)],
    ?assertEqual(Facts, starl_trace_lost_facts:lost(recorded([1, 2]) ++ End, Facts)).

%% The oldest facts are not kept.
oldest_facts_are_not_kept_test() ->
    ?assertEqual(
        facts([8, 9]), starl_trace_lost_facts:lost(recorded(lists:seq(1, 7)), facts([6, 7, 8, 9]))
    ).
