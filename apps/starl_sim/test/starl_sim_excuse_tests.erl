%% An excuse has a robot and a window: what goes wrong elsewhere, or at another time, hides nothing.
-module(starl_sim_excuse_tests).
-include_lib("eunit/include/eunit.hrl").

%% A SAP that takes too long is found out, whatever happens to another robot a minute later.
another_robot_excuses_no_overrun_test_() ->
    {timeout, 60, fun() ->
        [
            ?assertEqual({Faults, [{outcome_overdue, [1, 2]}]}, {Faults, overruns(Faults)})
         || Faults <- [
                [],
                [{p, 100000, 160000, pause, 3, #{}}],
                [{p, 100000, 160000, pause, 1, #{}}],
                [{c, 0, 1000, clock_offset, 3, #{ms => 30000}}],
                [{r, 0, 60000, reboot, 3, #{}}]
            ]
        ]
    end}.

%% What happens to the robot itself meanwhile is an excuse.
its_own_pause_excuses_test() ->
    ?assertEqual([], overruns(starl_sap, [{p, 100, 60000, pause, 1, #{}}])).

overruns(Faults) -> overruns(starl_sim_dawdling_sap, Faults).

overruns(Sap, Faults) ->
    Script = fun(R) ->
        case starl:id(R) of
            1 -> starl:send(R, 2, greeting, hello);
            _ -> ok
        end
    end,
    Scene = #{sap => #{limit => 3}, sap_machine => Sap},
    {#{violations := Violations}, _, _} = starl_sim_ct:played(3, Script, #{
        around => Scene,
        clock_offset => 0,
        faults => [{dead, 0, 0, kill_robot, 2, #{}} | Faults]
    }),
    lists:usort([{What, Robots} || #{what := What, robots := Robots} <- Violations]).
