%% The contract of reloads in a soak of the live half: runs that keep each clause, and runs that break it.
-module(starl_lab_soak_reloads_tests).
-include_lib("eunit/include/eunit.hrl").

-define(M, starl_lab_soak_reloads).
-define(CAUSE, {"planted", []}).

%% Reload 1 is sound, reload 2 is not; robots 1 and 2 get both.
config() -> #{sound => [1], orders => #{1 => {1000000, [1, 2]}, 2 => {5000000, [1, 2]}}}.

judged(Facts) -> judged(Facts, ?M:init(config())).

judged([], _State) ->
    none;
judged([Fact | Facts], State) ->
    case ?M:step(Fact, State) of
        {ok, Next} -> judged(Facts, Next);
        {violation, #{what := What}, _} -> What
    end.

told(At, Robot, N, Outcome) -> {1000000 * At, Robot, app, {reloaded, N, Outcome}}.

%% Twenty calls, one each second.
calls(At, Robot) -> [{1000000 * S, Robot, app, {call, c, none}} || S <- lists:seq(At, At + 19)].

crash(At, Robot) ->
    [
        {1000000 * At, Robot, app, crashed},
        {1000000 * At, Robot, supervisor, {crashed, app, ?CAUSE}}
    ].

both_taken_test() ->
    ?assertEqual(none, judged([told(2, 1, 1, taken), told(6, 1, 2, taken) | calls(7, 1)])).

sound_code_does_not_fail_test() ->
    ?assertEqual(sound_code_failed, judged([told(2, 1, 1, {crashed, ?CAUSE})])),
    ?assertEqual(sound_code_failed, judged([told(2, 1, 1, {migration_failed, ?CAUSE})])),
    ?assertEqual(none, judged([told(2, 1, 1, {unproven, 2}), told(2, 1, 2, {crashed, ?CAUSE})])).

each_reload_is_told_test() ->
    ?assertEqual(not_told, judged(calls(2, 1))),
    ?assertEqual(none, judged([{1500000, 1, robot, down} | calls(2, 1)])),
    ?assertEqual(none, judged(lists:sublist(calls(2, 1), 9))).

failed_code_is_left_by_all_test() ->
    Taken = [told(2, R, 1, taken) || R <- [1, 2]] ++ [told(6, R, 2, taken) || R <- [1, 2]],
    Failed = Taken ++ [told(7, 2, 2, {crashed, ?CAUSE})],
    ?assertEqual(still_runs, judged(Failed ++ calls(8, 1))),
    ?assertEqual(none, judged(Failed ++ [told(8, 1, 2, {back, 2}) | calls(9, 1)])),
    ?assertEqual(none, judged(Failed ++ lists:sublist(calls(8, 1), 9))).

no_application_ends_by_itself_test() ->
    Left = [told(2, 1, 1, taken), told(6, 1, 2, {crashed, ?CAUSE})],
    ?assertEqual(ended, judged(crash(2, 1))),
    ?assertEqual(ended, judged(Left ++ crash(6, 1))),
    %% it has started with the code that it leaves
    ?assertEqual(none, judged([{1500000, 1, app, crashed} | Left ++ crash(6, 1)])),
    ?assertEqual(ended, judged([{1500000, 1, app, crashed} | Left ++ calls(6, 1) ++ crash(26, 1)])),
    ?assertEqual(given_up, judged([{1000000, 1, supervisor, {given_up, app}}])).

%% Every kind of code is drawn, for some robots and for all, and is a version of the application.
drawn_test() ->
    Scenarios = [?M:add(Seed, #{robots => 3, block => mutex}) || Seed <- lists:seq(1, 60)],
    Reloads = [R || #{reloads := Rs} <- Scenarios, R <- Rs],
    Count = length([S || #{reloads := _} = S <- Scenarios]),
    ?assert(Count > 15 andalso Count < 45),
    ?assertEqual(
        [[1], [1, 2, 3], [2], [3]], lists:usort([Robots || {_, Robots, _, _} <- Reloads])
    ),
    Codes = lists:usort([Code || {_, _, Code, _} <- Reloads]),
    ?assertEqual(6, length(Codes)),
    [{ok, #{versions := #{starl_exercise := _}}} = starl_version:make([Code]) || Code <- Codes].
