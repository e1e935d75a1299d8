-module(@NAME@_tests).

%% PropEr first: both have a macro LET.
-include_lib("proper/include/proper.hrl").
-include_lib("eunit/include/eunit.hrl").

%% One run of an application that uses the block.
a_team_greets_test_() ->
    {timeout, 60, fun() ->
        {ok, Outcome} = starl_sim_trial:run(#{app => @NAME@_app, robots => 3, seed => 1}),
        ?assertMatch(#{violations := [], ending := done}, Outcome)
    end}.

%% Many runs, of teams of all sizes, under faults of all kinds.
@NAME@_test_() -> starl_property:eunit(fun prop_@NAME@/0, #{cases => 50}).

prop_@NAME@() ->
    Team = #{app => @NAME@_app, robots => {1, 6}, random_faults => [all], vary => [loss], time => 600},
    ?FORALL(Scenario, starl_property:scenario(Team), starl_property:holds(Scenario)).
