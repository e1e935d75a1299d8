%% Which packets were lost, in the order of time, and nothing else.
-module(starl_run_loss_monitor_tests).
-include_lib("eunit/include/eunit.hrl").

run(Events) ->
    M0 = starl_monitor:new([{starl_run_loss_monitor, #{}}]),
    {ok, M} = starl_monitor:step(Events, M0),
    {[], #{starl_run_loss_monitor := Results}} = starl_monitor:finish(100, M),
    Results.

lost_test() ->
    ?assertEqual(#{lost => []}, run([])),
    ?assertEqual(
        #{lost => [{5, 1, 2, 7}, {6, 2, 3, {all, 1}}, {6, 2, 1, {all, 1}}]},
        run([
            {5, 1, radio, {lost, 2, 7}},
            {5, 1, sap, {lost, 2, 9}},
            {6, 2, radio, {lost, 3, {all, 1}}},
            {6, 2, radio, {lost, 1, {all, 1}}}
        ])
    ).
