%% Runs of applications for their tests: the same in all ways of running, without a crash; and traces for monitors.
-module(starl_team_runs).

-export([outcome/1, both_ways/1, judged/2, standing/3, noted/2, borne/0]).

-include_lib("stdlib/include/assert.hrl").

outcome(Scenario) ->
    {ok, Sim} = starl_sim:start(Scenario, #{
        watch => [
            {starl_run_measures_monitor, #{most => 100000}}, {starl_run_drawings_monitor, #{}}
        ]
    }),
    _ = starl_sim:run(Sim),
    {Outcome, Report} = starl_sim:finish(Sim),
    Outcome#{report => Report}.

%% The classes and kinds of faults that a team bears whose clocks drift as far as they may.
borne() ->
    [
        network,
        clock_offset,
        clock_step,
        clock_freeze,
        process,
        location,
        actuation,
        serial,
        store
    ].

%% The outcome of a run in which no contract is broken and no application crashes.
both_ways(Scenario) ->
    Ways = [#{mode => inline}, #{mode => process, shards => 2}],
    [#{monitors := Monitors} = Outcome | _] =
        Outcomes = [outcome(maps:merge(Scenario, Way)) || Way <- Ways],
    [?assertEqual([], Violations) || #{violations := Violations} <- Outcomes],
    ?assertMatch([_], lists:usort([Digest || #{digest := Digest} <- Outcomes])),
    ?assertMatch(#{starl_crash_monitor := #{crashes := 0}}, Monitors),
    Outcome.

%% What the application has noted of a run: the values of a measure.
noted(Key, #{monitors := #{starl_run_measures_monitor := #{values := Values}}}) ->
    [Value || {_, _, K, Value} <- Values, K =:= Key].

%% Which violations a monitor finds in a trace, and its results.
judged(Events, {Module, _} = Monitor) ->
    Step = fun(Event, {Found, M}) ->
        case starl_monitor:step(Event, M) of
            {ok, Next} -> {Found, Next};
            {violation, Violation, Next} -> {Found ++ [Violation], Next}
        end
    end,
    {Found, Last} = lists:foldl(Step, {[], starl_monitor:new([Monitor])}, Events),
    {T, _, _, _} = lists:last(Events),
    {More, #{Module := Results}} = starl_monitor:finish(T, Last),
    {[What || #{what := What} <- Found ++ More], Results}.

standing(T, Robot, {X, Y}) ->
    {T, Robot, chassis, {motion, starl_trajectory:standing(T, {float(X), float(Y)}, 0.0)}}.
