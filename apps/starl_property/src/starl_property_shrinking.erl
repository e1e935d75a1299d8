%% @doc How many runs PropEr may take to make a failing case small. Its own bound counts only those that
%% succeed; a scenario with six faults has thousands of neighbours, most of which hold. What is
%% left over is for the simulator's shrinker, which goes on from there and knows runs.
%%
%% It stands in the dictionary of the process that tests, as PropEr's own state does. A property that
%% is tested by PropEr itself (`rebar3 proper') has no such bound.
-module(starl_property_shrinking).

-export([within_bound/1, judged/2]).

-define(KEY, {?MODULE, state}).
-define(MOST, 300).

%% @doc Tests a property with the bound.
-spec within_bound(fun(() -> Answer)) -> Answer.
within_bound(Test) ->
    Outer = put(?KEY, testing),
    try
        Test()
    after
        put(?KEY, Outer)
    end.

%% @doc The verdict on a scenario; once the bound is reached every new one holds, so that PropEr ends. The
%% one that failed last is always judged: PropEr tells of it at its end.
-spec judged(Scenario :: map(), fun(() -> Verdict)) -> Verdict | holds.
judged(Scenario, Verdict) ->
    case get(?KEY) of
        {shrinking, ?MOST, Failing} when Failing =/= Scenario -> holds;
        State -> noted(Verdict(), Scenario, State)
    end.

noted(Verdict, _Scenario, undefined) ->
    Verdict;
noted(holds, _Scenario, testing) ->
    holds;
noted(holds, _Scenario, {shrinking, Runs, Failing}) ->
    _ = put(?KEY, {shrinking, min(?MOST, Runs + 1), Failing}),
    holds;
noted(Verdict, Scenario, State) ->
    _ = put(?KEY, {shrinking, runs(State), Scenario}),
    Verdict.

runs(testing) -> 0;
runs({shrinking, Runs, _}) -> min(?MOST, Runs + 1).
