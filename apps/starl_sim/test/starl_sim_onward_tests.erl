%% A run that is taken up at snapshots of its robots goes on as it did; with other draws it goes another way.
-module(starl_sim_onward_tests).
-include_lib("eunit/include/eunit.hrl").

-define(SCENARIO, #{
    app => starl_exercise,
    robots => 3,
    seed => 5,
    loss => 0.1,
    duplicate => 0.05,
    clock_drift => 200,
    time => 20
}).
-define(BLOCKS, [sap, motion, election, bully, mutex, barrier, geocast, registers, counter]).

%% The nine exercises with loss, duplicates, drift and faults of every class, at a moment in the midst of
%% them: with the draws of the run every fact after the moment is that of the run, and so is the digest of
%% all events.
with_its_own_draws_a_run_goes_on_as_it_did_test_() ->
    [
        {
            atom_to_list(Block),
            {timeout, 60, fun() ->
                same((?SCENARIO)#{block => Block, random_faults => [all], heal => 12})
            end}
        }
     || Block <- ?BLOCKS
    ].

robots_that_move_go_on_as_they_did_test_() ->
    [
        {
            atom_to_list(App),
            {timeout, 60, fun() ->
                same((maps:without([robots], ?SCENARIO))#{app => App, robots => 4, mode => Mode})
            end}
        }
     || {App, Mode} <- [{starl_painting, inline}, {starl_follow, process}, {starl_crossing, inline}]
    ].

same(Scenario) ->
    {Recorded, #{digest := Digest, end_us := End}} = recorded(Scenario),
    At = End * 3 div 5,
    {ok, [{At, Point}]} = starl_sim_onward:moments(Recorded, [At], #{}),
    Now = starl_sim_onward:time_us(Point),
    After = lists:dropwhile(fun({Us, _, _, _}) -> Us < Now end, maps:get(facts, Recorded)),
    ?assertMatch({true, _}, {length(After) > 20, length(After)}),
    ?assertEqual(same, parted(After, starl_sim_onward:facts(Point, settings(Scenario), none))),
    ?assertMatch({ok, _, Digest}, starl_sim_onward:play(Point, settings(Scenario), none)).

settings(#{time := Time}) -> #{loss => same, until_s => Time, until_ms => 1000 * Time}.

%% Two futures with one salt are one.
a_salt_draws_another_future_test_() ->
    {timeout, 60, fun() ->
        Scenario = (?SCENARIO)#{block => mutex, random_faults => [network], heal => 15},
        {Recorded, #{digest := Digest}} = recorded(Scenario),
        {ok, [{_, One}, {_, Two}]} = starl_sim_onward:moments(Recorded, [3000000, 12000000], #{}),
        Futures = [
            begin
                {ok, kept, Other} = starl_sim_onward:play(Point, settings(Scenario), Salt),
                Other
            end
         || Point <- [One, Two], Salt <- [1, 1, 2]
        ],
        [A, A, B, C, C, D] = Futures,
        ?assertEqual(5, length(lists:usort([A, B, C, D, Digest])))
    end}.

%% Where the program, or the scenario, is not that of the recording, nothing is said.
what_is_not_the_recording_is_refused_test_() ->
    {timeout, 60, fun() ->
        {Recorded, _} = recorded((?SCENARIO)#{block => mutex}),
        #{scenario := Scenario, images := Images} = Recorded,
        Other = Recorded#{scenario := Scenario#{loss := 0.2}},
        ?assertMatch({error, {parted, _, _}}, starl_sim_onward:moments(Other, [12000000], #{})),
        ?assertMatch(
            {error, {parted, _, _}},
            starl_sim_onward:moments(Other#{images := lists:sublist(Images, 1)}, [12000000], #{})
        ),
        {error, Ended} = starl_sim_onward:moments(Recorded, [20000000], #{}),
        ?assertMatch({ended, 20000000}, Ended)
    end}.

%% The first facts that differ.
parted([Fact | Facts], [Fact | Others]) -> parted(Facts, Others);
parted([], []) -> same;
parted(Facts, Others) -> {lists:sublist(Facts, 2), lists:sublist(Others, 2)}.

recorded(Given) ->
    Self = self(),
    Observer = fun
        ({judged, Trace, _}) ->
            Self ! {facts, Trace},
            ok;
        (_) ->
            ok
    end,
    {ok, Sim} = starl_sim:start(
        maps:merge(#{mode => inline, shards => 1}, Given), #{
            observe => Observer, snapshots_us => 5000000
        }
    ),
    Scenario = starl_sim:scenario(Sim),
    _ = starl_sim:run(Sim),
    {Outcome, _} = starl_sim:finish(Sim),
    {Told, Facts} = lists:partition(fun(F) -> element(3, F) =:= snapshot end, told([])),
    Times = lists:usort([At || {At, _, _, _} <- Told]),
    Images = [image(At, [{Id, Kept} || {Us, Id, _, Kept} <- Told, Us =:= At]) || At <- Times],
    ?assert(length(Images) >= 2),
    {#{scenario => Scenario, facts => Facts, images => Images}, Outcome}.

image(At, All) ->
    Read = [{Id, starl_snapshot:of_term(binary_to_term(Kept))} || {Id, {ok, Kept}} <- All],
    [N] = lists:usort([Windows || {_, {ok, {simulation, Windows, _}}} <- Read]),
    {At, N, maps:from_list([{Id, Robot} || {Id, {ok, {simulation, _, Robot}}} <- Read])}.

told(Traces) ->
    receive
        {facts, Trace} -> told([Trace | Traces])
    after 0 -> lists:append(lists:reverse(Traces))
    end.
