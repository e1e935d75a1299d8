%% Who has not finished by the deadline, by traces.
-module(starl_sim_convergence_tests).
-include_lib("eunit/include/eunit.hrl").

late(Events) -> late(Events, 100).

late(Events, EndUs) ->
    Config = #{robots => [1, 2], deadline_us => 100},
    Fed = lists:foldl(
        fun(Event, State) ->
            {ok, Next} = starl_run_progress_monitor:step(Event, State),
            Next
        end,
        starl_run_progress_monitor:init(Config),
        Events
    ),
    case starl_run_progress_monitor:finish(EndUs, Fed) of
        {ok, #{}} -> [];
        {{violation, [#{what := not_finished, robots := Robots}]}, _} -> Robots
    end.

done_or_dead_test() ->
    ?assertEqual([], late([{5, 1, app, {done, 3}}, {6, 2, robot, {died, killed}}])),
    ?assertEqual([2], late([{5, 1, app, {done, 3}}])),
    ?assertEqual([1, 2], late([{5, 1, app, {went, on}}, {6, 2, robot, up}])).

nothing_is_late_before_the_deadline_test() -> ?assertEqual([], late([], 99)).

%% A crash is no end: the application begins anew, and has to finish.
crashed_is_not_done_test() ->
    ?assertEqual([1], late([{5, 1, app, crashed}, {5, 2, app, {done, 3}}])),
    Done = [{5, 1, app, {done, 3}}, {5, 2, app, {done, 3}}],
    ?assertEqual([1], late(Done ++ [{6, 1, app, crashed}])),
    ?assertEqual([], late(Done ++ [{6, 1, app, crashed}, {9, 1, app, {done, 4}}])),
    ?assertEqual([2], late(Done ++ [{6, 2, app, crashed}, {7, 1, sap, crashed}])),
    ?assertEqual([], late(Done ++ [{6, 2, robot, {died, killed}}, {6, 2, app, crashed}])).
