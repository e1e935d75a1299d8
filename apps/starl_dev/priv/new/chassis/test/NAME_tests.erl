-module(@NAME@_tests).

-include_lib("eunit/include/eunit.hrl").

%% The chassis drives for some seconds, in real time; each clause of its contract holds.
the_contract_of_a_chassis_test_() ->
    {timeout, 60, fun() ->
        Found = starl_live_chassis_check:check({@NAME@, #{port => 0}}),
        ?assertEqual([], [{Clause, Text} || {How, Clause, Text} <- Found, How =/= ok])
    end}.

%% One run of the application, in virtual time.
a_team_drives_test_() ->
    {timeout, 60, fun() ->
        {ok, Outcome} = starl_sim_trial:run(#{app => @NAME@_app, robots => 3, seed => 1}),
        ?assertMatch(#{violations := [], ending := done}, Outcome)
    end}.
