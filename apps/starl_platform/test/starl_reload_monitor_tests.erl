%% What the report tells of reloads.
-module(starl_reload_monitor_tests).
-include_lib("eunit/include/eunit.hrl").

-define(CRASHED, {crashed, {"planted", [{my_app, step, 2, "my_app.erl", 7}]}}).

a_reload_that_all_run_test() ->
    [Reload] = watched([{1, app, 1, taken}, {2, app, 1, taken}]),
    ?assertNot(starl_reload_monitor:is_back(Reload)),
    ?assertEqual("reload 1 (app): taken by robots 1, 2", text(Reload)).

the_first_failure_is_the_reason_test() ->
    [Reload] = watched([
        {1, app, 1, taken},
        {2, app, 1, taken},
        {2, app, 1, ?CRASHED},
        {1, app, 1, {back, 2}}
    ]),
    ?assertMatch(#{taken := [1, 2], back := [1, 2]}, Reload),
    ?assertEqual(
        "reload 1 (app): taken by robots 1, 2; ROLLED BACK on robots 1, 2; first on robot 2 (app) at "
        "3.000 s: the new code crashed: planted at my_app:step/2 (my_app.erl:7)",
        text(Reload)
    ).

%% One after the other, and both go back.
a_version_that_was_replaced_goes_back_with_its_successor_test() ->
    [First, Second] = watched([
        {1, sap, 1, taken},
        {1, sap, 2, taken},
        {1, sap, 2, ?CRASHED},
        {1, sap, 1, {unproven, 2}}
    ]),
    ?assertMatch({#{number := 1, back := [1]}, #{number := 2, back := [1]}}, {First, Second}),
    ?assertNotEqual(nomatch, string:find(text(First), "together with reload 2")).

code_that_no_robot_could_take_test() ->
    [Reload] = watched([{1, app, 1, {migration_failed, {"planted", []}}}]),
    ?assertEqual(
        "reload 1 (app): taken by no robot; ROLLED BACK on robot 1; first on robot 1 (app) at "
        "1.000 s: the state could not be carried over: planted",
        text(Reload)
    ).

a_robot_that_is_done_does_not_count_test() ->
    [Reload] = watched([{1, app, 1, done}]),
    ?assertEqual("reload 1 (app): taken by no robot", text(Reload)).

a_large_team_is_not_listed_test() ->
    [Reload] = watched([{R, app, 1, taken} || R <- lists:seq(1, 9)]),
    ?assertEqual("reload 1 (app): taken by robots 1, 2, 3, 4, 5 and 4 more", text(Reload)).

%% A robot counts once, however many of its machines take the code or go back.
a_robot_of_several_machines_counts_once_test() ->
    Taken = [{R, Name, 1, taken} || Name <- [app, sap], R <- [2, 1]],
    [All] = watched(Taken),
    ?assertEqual("reload 1 (app, sap): taken by robots 1, 2", text(All)),
    [Back] = watched(Taken ++ [{2, app, 1, ?CRASHED}, {2, sap, 1, {back, 2}}]),
    ?assertMatch(#{taken := [1, 2], back := [2]}, Back).

%% However many there are, they come in their order, and the time of a failure is exact.
reloads_come_in_order_test() ->
    All = watched([{1, app, N, taken} || N <- lists:seq(40, 1, -1)]),
    ?assertEqual(lists:seq(1, 40), [N || #{number := N} <- All]).

a_late_failure_has_its_time_test() ->
    Begun = starl_reload_monitor:init(#{}),
    {ok, Told} = starl_reload_monitor:step(
        {5_000_000_000, 1, app, {reloaded, 1, ?CRASHED}}, Begun
    ),
    {ok, #{reloads := [Reload]}} = starl_reload_monitor:finish(9, Told),
    ?assertNotEqual(nomatch, string:find(text(Reload), "at 5000.000 s")).

%% A fact each second.
watched(Told) ->
    Facts = [
        {1000000 * At, R, Name, {reloaded, N, O}}
     || {At, {R, Name, N, O}} <- lists:zip(lists:seq(1, length(Told)), Told)
    ],
    State = lists:foldl(
        fun(Fact, S0) ->
            {ok, S} = starl_reload_monitor:step(Fact, S0),
            S
        end,
        starl_reload_monitor:init(#{}),
        Facts ++ [{1, 1, app, {counted, 1}}]
    ),
    {ok, #{reloads := Reloads}} = starl_reload_monitor:finish(9, State),
    Reloads.

text(Reload) -> unicode:characters_to_list(starl_reload_monitor:format(Reload)).
