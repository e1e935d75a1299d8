%% A run that branches is the run itself up to the moment, and another one from then on.
-module(starl_sim_future_tests).
-include_lib("eunit/include/eunit.hrl").

-define(SCENARIO, #{
    app => starl_exercise,
    block => mutex,
    robots => 3,
    seed => 3,
    loss => 0.1,
    time => 5,
    random_faults => [network, clock, process, location],
    heal => 3
}).

%% With the draws that it has, a branch changes nothing, wherever it begins and however the robots
%% run.
without_salt_it_is_the_run_test_() ->
    {timeout, 60, fun() ->
        #{digest := Digest} = run(?SCENARIO, none),
        [
            ?assertMatch(
                {Mode, Counts, #{digest := Digest}},
                {Mode, Counts, run((?SCENARIO)#{mode => Mode, shards => 2}, Counts, none)}
            )
         || Mode <- [inline, process],
            Counts <- [#{}, #{1 => 40, 2 => 1, 3 => 77}, #{1 => 1000000, 3 => 5}]
        ]
    end}.

%% With a salt the robots have the same events up to the moment, and others afterwards. The same
%% salt gives the same.
a_salt_changes_only_what_comes_later_test_() ->
    {timeout, 60, fun() ->
        Counts = #{1 => 40, 2 => 60, 3 => 50},
        #{digest := Before, events := Known} = run(?SCENARIO, none),
        #{digest := One, events := Events} = run(?SCENARIO, Counts, 1),
        ?assertEqual(One, maps:get(digest, run(?SCENARIO, Counts, 1))),
        ?assertNotEqual(Before, One),
        ?assertNotEqual(One, maps:get(digest, run(?SCENARIO, Counts, 2))),
        [
            ?assertEqual(
                lists:sublist(maps:get(R, Known), N), lists:sublist(maps:get(R, Events), N)
            )
         || {R, N} <- maps:to_list(Counts)
        ]
    end}.

%% A machine that starts after the moment draws other numbers, but those that follow from the seed of
%% the team, which all robots know, are the same.
the_seed_of_the_team_stays_test_() ->
    {timeout, 60, fun() ->
        Branch = #{counts => #{2 => 7}, salt => 1, loss => 0.1, faults => []},
        {ok, {_, _, #{world := World}}} = starl_sim:plan(?SCENARIO, #{branch => Branch}),
        Body = starl_sim_platform:new(2, {0.0, 0.0, 0.0}, World),
        {7, Later} = starl_sim_branch:of_robot(2, World),
        #{team_seed := 3, random := Before} = starl_sim_platform:base(sap, 2, Body),
        Turned = starl_sim_platform:turn_off(Later, Body),
        #{team_seed := 3, random := After} = starl_sim_platform:base(sap, 2, Turned),
        ?assertNotEqual(Before, After)
    end}.

%% What robots are about to do when a run begins is how it begins, and no draw of a future: else the first
%% start of a robot's application would be what decides.
the_first_start_is_no_draw_test_() ->
    {timeout, 60, fun() ->
        Branch = #{counts => #{}, salt => 1, loss => 0.1, faults => []},
        {ok, {_, _, #{world := World}}} = starl_sim:plan(?SCENARIO, #{branch => Branch}),
        Body = starl_sim_platform:new(2, {0.0, 0.0, 0.0}, World),
        {0, Later} = starl_sim_branch:of_robot(2, World),
        #{random := Before} = starl_sim_platform:base(app, 1, Body),
        Turned = starl_sim_platform:turn_off(Later, Body),
        ?assertMatch(#{random := Before}, starl_sim_platform:base(app, 1, Turned)),
        #{random := Again} = starl_sim_platform:base(app, 2, Turned),
        ?assertNotEqual(Before, Again)
    end}.

%% Faults that have begun stay, others begin at another time after the moment.
faults_ahead_are_drawn_anew_test() ->
    Faults = [
        {begun, 100, 4000, isolate, 2, #{}},
        {ahead, 2000, 2500, reboot, 1, #{}},
        {everybody, 3000, 3001, location_dropout, all, #{}},
        {lost, 0, 5000, drop, {1, 2}, #{packet => 3}}
    ],
    Run = #{
        scenario => #{faults => Faults, loss => 0.0, robots => 4, time => 5.0},
        digest => <<>>,
        events => 0,
        violation => #{contract => c, what => w, at_us => 4000000, robots => [], details => #{}},
        loss => 0.0,
        moments => starl_sim_moments:new(#{}, Faults)
    },
    Ahead = fun(Salt) ->
        #{scenario := #{faults := All, time := 6.0, loss := 0.25}} =
            starl_sim_future:plan(Run, 1, Salt, #{loss => 0.25, until_s => 6.0}),
        All
    end,
    ?assertEqual(Ahead(1), Ahead(1)),
    ?assertNotEqual(Ahead(1), Ahead(2)),
    [
        begin
            [Begun, {ahead, From, To, reboot, Robot, #{}}, Everybody, Drop] = Ahead(Salt),
            ?assertEqual([hd(Faults), lists:last(Faults)], [Begun, Drop]),
            ?assertEqual({true, 500}, {From > 100 andalso From =< 4100, To - From}),
            ?assert(lists:member(Robot, [1, 2, 3, 4])),
            ?assertMatch({everybody, _, _, location_dropout, all, #{}}, Everybody)
        end
     || Salt <- lists:seq(1, 20)
    ].

nothing_to_ask_test_() ->
    {timeout, 60, ?_assertEqual({error, holds}, starl_sim_future:repeat((?SCENARIO)#{time => 1}))}.

%% -- helpers --------------------------------------------------------------------------------

run(Scenario, Counts, Salt) ->
    {ok, Sim} = starl_sim:start(Scenario),
    #{loss := Loss, faults := Faults} = starl_sim:scenario(Sim),
    ok = starl_sim:close(Sim),
    run(Scenario, #{counts => Counts, salt => Salt, loss => Loss, faults => Faults}).

run(#{robots := Robots} = Scenario, Branch) ->
    Ids = lists:seq(1, Robots),
    Options = [{record, maps:from_keys(Ids, {1, 100000})} | [{branch, B} || #{} = B <- [Branch]]],
    {ok, Sim} = starl_sim:start(Scenario, maps:from_list(Options)),
    _ = starl_sim:run(Sim),
    Events = maps:from_list([{Id, starl_sim:events(Sim, Id)} || Id <- Ids]),
    {Outcome, _} = starl_sim:finish(Sim),
    Outcome#{events := Events}.
