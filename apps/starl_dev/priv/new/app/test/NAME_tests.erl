-module(@NAME@_tests).

%% PropEr first: both have a macro LET.
-include_lib("proper/include/proper.hrl").
-include_lib("eunit/include/eunit.hrl").

%% One run in the simulator.
a_team_goes_round_test_() ->
    {timeout, 60, fun() ->
        {ok, Outcome} = starl_sim_trial:run(#{app => @NAME@, robots => 3, seed => 1}),
        ?assertMatch(#{violations := [], ending := done}, Outcome),
        ?assertMatch(#{monitors := #{@NAME@_monitor := #{round := 3}}}, Outcome)
    end}.

%% Many runs, of teams of all sizes, under faults of all kinds.
@NAME@_test_() -> starl_property:eunit(fun prop_@NAME@/0, #{cases => 50}).

prop_@NAME@() ->
    Team = #{app => @NAME@, robots => {1, 6}, random_faults => [all], vary => [side, loss], time => 600},
    ?FORALL(Scenario, starl_property:scenario(Team), starl_property:holds(Scenario)).

%% Without faults all of them come round.
all_come_round_test_() -> starl_property:eunit(fun prop_all_come_round/0, #{cases => 20}).

prop_all_come_round() ->
    Team = #{app => @NAME@, robots => {1, 6}, vary => [side]},
    ?FORALL(
        Scenario,
        starl_property:scenario(Team),
        starl_property:holds(Scenario, #{complete => true})
    ).
