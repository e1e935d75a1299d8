%% What a controller changes in a run: robots that heed each other, within the contract of motion.
-module(starl_sim_controller_tests).
-include_lib("eunit/include/eunit.hrl").

-define(TOUCH_MM, 330).

%% Two that drive at each other with velocities pass each other, and each comes where it wants to.
meets_test() ->
    [
        begin
            Given = #{chassis => Chassis, seed => Seed},
            ?assert(closest(run(cruise, "straight", Given)) < ?TOUCH_MM),
            Outcome = run(cruise, "wary", Given),
            ?assert(closest(Outcome) > ?TOUCH_MM),
            #{robots := [{1, #{pose := {X, Y, _}}} | _]} = Outcome,
            ?assert(starl_geometry:distance({X, Y}, {3000.0, 1000.0}) < 300)
        end
     || Chassis <- [differential, holonomic], Seed <- [1, 2, 3]
    ].

%% On its line a robot waits until the way is free.
waits_until_the_way_is_free_test() ->
    ?assert(closest(run(cross, "straight", #{})) < ?TOUCH_MM),
    ?assert(closest(run(cross, "wary", #{})) > ?TOUCH_MM).

%% It waits its time, and then goes on: it has to arrive.
does_not_wait_for_ever_test() ->
    Waits = starl_controller_wary:waits_us(#{}) / 1000,
    #{robots := [{1, #{result := {done, Ms}}} | _]} = run(stay, "wary", #{}),
    #{robots := [{1, #{result := {done, Else}}} | _]} = run(stay, "straight", #{}),
    ?assert(Ms - Else >= Waits - 500 andalso Ms - Else =< 2 * Waits).

under_faults_test_() ->
    {timeout, 120, fun() ->
        [
            run(How, "wary", #{
                seed => Seed, chassis => mixed, random_faults => [all], heal => 10, time => 120
            })
         || How <- [cruise, stay], Seed <- lists:seq(1, 15)
        ]
    end}.

closest(#{monitors := #{starl_run_paths_monitor := #{pieces := Pieces, until_us := Until}}}) ->
    Driven = lists:foldl(fun drive/2, starl_separation:new(0.0), Pieces),
    {_, {Mm, _, _}} = starl_separation:finish(Until, Driven),
    Mm.

drive({Robot, Piece}, Separation) ->
    {_, Advanced} = starl_separation:advance(starl_trajectory:start_us(Piece), Separation),
    starl_separation:motion(Robot, Piece, Advanced).

run(How, Controller, Given) ->
    Scenario = #{
        app => starl_sim_meeting_app, how => How, robots => 2, controller => Controller
    },
    {ok, Sim} = starl_sim:start(maps:merge(Scenario, Given), #{
        watch => [{starl_run_paths_monitor, #{most => 100000}}]
    }),
    _ = starl_sim:run(Sim),
    {#{violations := Violations} = Outcome, _} = starl_sim:finish(Sim),
    ?assertEqual({How, Controller, Given, []}, {How, Controller, Given, Violations}),
    Outcome.
