%% A run that branches is the run itself up to the index, and another one from then on.
-module(starl_sim_continuation_tests).
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

-define(BLOCKS, [sap, motion, election, bully, mutex, barrier, geocast, registers, counter]).

%% With the draws that it has, a branch changes nothing, wherever it begins and however the robots
%% run.
without_a_branch_seed_it_is_the_run_test_() ->
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

%% The nine exercises with loss, duplicates, drift and faults of every class, and robots that move, each
%% in the midst of its run: every fact is that of the run, and so is the digest of all events.
with_its_own_draws_a_run_goes_on_as_it_did_test_() ->
    Given = (?SCENARIO)#{seed => 5, duplicate => 0.05, clock_drift => 200, time => 20, heal => 12},
    Exercises = [Given#{block => Block, random_faults => [all]} || Block <- ?BLOCKS],
    Moving = [
        (maps:without([block, random_faults, heal], Given))#{app => App, robots => 4, mode => Mode}
     || {App, Mode} <- [{starl_painting, inline}, {starl_follow, process}, {starl_crossing, inline}]
    ],
    [
        {
            lists:concat([maps:get(app, S), " ", maps:get(block, S, "")]),
            {timeout, 60, fun() -> same(S) end}
        }
     || S <- Exercises ++ Moving
    ].

same(Given) ->
    Scenario = maps:merge(#{mode => inline, shards => 1}, Given),
    {#{digest := Digest, events := Events}, Facts} = with_facts(fun(Options) ->
        run_with(Scenario, none, Options)
    end),
    Counts = maps:map(fun(_, Own) -> length(Own) * 3 div 5 end, Events),
    {#{digest := Again}, Others} = with_facts(fun(Options) ->
        run_with(Scenario, branch(Scenario, Counts, none), Options)
    end),
    ?assert(length(Facts) > 20),
    ?assertEqual({Digest, Facts}, {Again, Others}).

with_facts(Run) ->
    Self = self(),
    Observer = fun
        ({judged, Trace, _}) ->
            Self ! {facts, Trace},
            ok;
        (_) ->
            ok
    end,
    Outcome = Run(#{observe => Observer}),
    {Outcome, facts([])}.

facts(Traces) ->
    receive
        {facts, Trace} -> facts([Trace | Traces])
    after 0 -> lists:append(lists:reverse(Traces))
    end.

%% With a branch seed the robots have the same events up to the index, and others afterwards. The
%% same seed gives the same.
a_branch_seed_changes_only_what_comes_later_test_() ->
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

%% A machine that starts after the index draws other numbers, but those that follow from the seed of
%% the team, which all robots know, are the same.
the_seed_of_the_team_stays_test_() ->
    {timeout, 60, fun() ->
        Branch = #{counts => #{2 => 7}, branch_seed => 1, loss => 0.1, faults => []},
        {ok, {_, _, #{world := World}}} = starl_sim:plan(?SCENARIO, #{branch => Branch}),
        Body = starl_sim_platform:new(2, {0.0, 0.0, 0.0}, World),
        {7, Later} = starl_sim_branch:of_robot(2, World),
        #{team_seed := 3, random := Before} = starl_sim_platform:base(sap, 2, Body),
        Turned = starl_sim_platform:turn_off(Later, Body),
        #{team_seed := 3, random := After} = starl_sim_platform:base(sap, 2, Turned),
        ?assertNotEqual(Before, After)
    end}.

%% What robots are about to do when a run begins is how it begins, and no draw of a continuation: else the first
%% start of a robot's application would be what decides.
%% Holds: `when` blames no start of a run for what the program does by itself: what robots are
%% about to do when a run begins is no draw of its continuations; where it breaks is named
%% Red: d3ad7b5b, run (the first); there a mutex that grants what is held was blamed on the start
%% of another robot's application, with 10 of 10 branch seeds
the_first_start_is_no_draw_test_() ->
    {timeout, 60, fun() ->
        Branch = #{counts => #{}, branch_seed => 1, loss => 0.1, faults => []},
        {ok, {_, _, #{world := World}}} = starl_sim:plan(?SCENARIO, #{branch => Branch}),
        Body = starl_sim_platform:new(2, {0.0, 0.0, 0.0}, World),
        {0, Later} = starl_sim_branch:of_robot(2, World),
        #{random := Before} = starl_sim_platform:base(app, 1, Body),
        Turned = starl_sim_platform:turn_off(Later, Body),
        ?assertMatch(#{random := Before}, starl_sim_platform:base(app, 1, Turned)),
        #{random := Again} = starl_sim_platform:base(app, 2, Turned),
        ?assertNotEqual(Before, Again)
    end}.

%% Faults that have begun stay, others begin at another time after the index.
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
        end_us => 5000000,
        unjudged => [],
        violation => #{contract => c, what => w, at_us => 4000000, robots => [], details => #{}},
        loss => 0.0,
        timeline => starl_sim_timeline:new(#{}, Faults)
    },
    Ahead = fun(Within, BranchSeed) ->
        #{scenario := #{faults := All, time := 6.0, loss := 0.25}} =
            starl_sim_continuation:plan(Run, 1, BranchSeed, #{
                contract => any, loss => 0.25, until_s => 6.0, faults_ahead => Within
            }),
        All
    end,
    ?assertEqual(Ahead({within_ms, 4000}, 1), Ahead({within_ms, 4000}, 1)),
    ?assertNotEqual(Ahead({within_ms, 4000}, 1), Ahead({within_ms, 4000}, 2)),
    [
        begin
            [Begun, {ahead, From, To, reboot, Robot, #{}}, Everybody, Drop] = Ahead(Within, Seed),
            ?assertEqual([hd(Faults), lists:last(Faults)], [Begun, Drop]),
            ?assertEqual({true, 500}, {From > 100 andalso From =< Last, To - From}),
            ?assert(lists:member(Robot, [1, 2, 3, 4])),
            ?assertMatch({everybody, _, _, location_dropout, all, #{}}, Everybody)
        end
     || {Within, Last} <- [{{within_ms, 4000}, 4100}, {{by_ms, 400}, 400}],
        Seed <- lists:seq(1, 20)
    ].

%% A sound run has no violation to ask about; it goes on from a time before its end.
a_sound_run_is_continued_test_() ->
    {timeout, 60, fun() ->
        {ok, Run} = starl_sim_continuation:repeat((?SCENARIO)#{time => 1, heal => 0.5}),
        ?assertMatch(#{violation := none, end_us := 1000000}, Run),
        ?assertEqual({error, holds}, starl_sim_continuation:settings(Run, violation)),
        ?assertMatch(
            {ok, #{contract := any, until_s := 2.0, faults_ahead := {by_ms, 1000}}},
            starl_sim_continuation:settings(Run, {at, 500000})
        ),
        ?assertEqual(
            {error, {ended, 1000000}}, starl_sim_continuation:settings(Run, {at, 1000001})
        )
    end}.

%% After its violation a run has nothing to decide.
a_time_after_the_violation_is_refused_test() ->
    Violation = #{contract => c, what => w, at_us => 500, robots => [], details => #{}},
    Run = #{violation => Violation, end_us => 1000, loss => 0.0},
    ?assertMatch({ok, _}, starl_sim_continuation:settings(Run, {at, 499})),
    ?assertEqual({error, {broken, Violation}}, starl_sim_continuation:settings(Run, {at, 500})).

%% -- helpers --------------------------------------------------------------------------------

run(Scenario, Counts, BranchSeed) -> run(Scenario, branch(Scenario, Counts, BranchSeed)).

run(Scenario, Branch) -> run_with(Scenario, Branch, #{}).

branch(Scenario, Counts, BranchSeed) ->
    {ok, Sim} = starl_sim:start(Scenario),
    #{loss := Loss, faults := Faults} = starl_sim:scenario(Sim),
    ok = starl_sim:close(Sim),
    #{counts => Counts, branch_seed => BranchSeed, loss => Loss, faults => Faults}.

run_with(#{robots := Robots} = Scenario, Branch, Options) ->
    Ids = lists:seq(1, Robots),
    Branches = maps:from_list([{branch, Branch} || Branch =/= none]),
    {ok, Sim} = starl_sim:start(
        Scenario,
        maps:merge(Options, Branches#{record => maps:from_keys(Ids, {1, 100000})})
    ),
    _ = starl_sim:run(Sim),
    Events = maps:from_list([{Id, starl_sim:events(Sim, Id)} || Id <- Ids]),
    {Outcome, _} = starl_sim:finish(Sim),
    Outcome#{events := Events}.
