%% What the shared counter declares as a block, its model, and the end of its exercise.
-module(starl_counter_block_tests).
-include_lib("eunit/include/eunit.hrl").

declared_test() ->
    ?assertMatch([{gossip_ms, {integer, 10, 1000000}, 1000, _}], starl_counter:options()),
    ?assertEqual(
        [{counter, starl_counter_gossip, #{gossip_ms => 7}}],
        starl_counter:machines(#{gossip_ms => 7})
    ),
    ?assertEqual(
        [
            {starl_counter_monitor, #{
                robots => [1, 2, 3], within_us => 6200000, turn_us => 600000
            }}
        ],
        starl_counter:monitors(#{gossip_ms => 200}, #{robots => [1, 2, 3]})
    ),
    ?assertEqual(starl_counter_exercise, starl_counter:exercise()),
    ?assert(starl_counter_gossip:has_history()),
    %% only that all agree rests on anything
    ?assertEqual(
        [{grows, []}, {counts, []}, {agree, [delivery]}],
        [{Name, Needs} || {Name, _, _, Needs} <- starl_counter:guarantees()]
    ),
    [
        ?assertError(function_clause, starl_counter:within_ms(Ms, Robots))
     || {Ms, Robots} <- [{200.0, 3}, {200, 3.0}]
    ].

%% The model: the first robot counts twice, the others once and read; a machine may crash; no robot is
%% like another.
model_test() ->
    [{counter, _, Model}] = starl_counter:models(),
    #{script := Script, crash := [counter], fixed := [1, 2, 3], monitor := Monitor} = Model(#{
        robots => [4, 5, 6]
    }),
    ?assertEqual({starl_counter_monitor, #{robots => [4, 5, 6]}}, Monitor),
    Increment = {'try', counter, increment},
    ?assertEqual([Increment, Increment], Script(1)),
    ?assertEqual([Increment, {'try', counter, value}], Script(2)).

exercise_test() ->
    Use = #{gossip => 200, team => 3},
    ?assertMatch([{gossip, {integer, 10, 1000000}, 1000, _}], starl_counter_exercise:flags()),
    ?assertEqual(#{gossip_ms => 200}, starl_counter_exercise:block_options(Use)),
    ?assertEqual(6200, starl_counter_exercise:within_ms(Use)),
    ?assertEqual(600, starl_counter_exercise:again_ms(Use)),
    [
        ?assertError(function_clause, starl_counter_exercise:again_ms(Bad))
     || Bad <- [Use#{gossip := 200.0}, Use#{team := 3.0}]
    ],
    All = fun(gossip, Values) -> Values end,
    ?assertEqual(#{gossip => [200, 1000, 3000]}, starl_counter_exercise:draw(All)).

%% In the end each of three robots counts twice, and waits until all have to agree, and a fiftieth more:
%% with a second more between two messages 6 s longer.
agrees_in_the_end_test_() -> {timeout, 60, fun agrees_in_the_end/0}.

agrees_in_the_end() ->
    {ok, #{end_us := Second}} = finally(1000),
    {ok, #{end_us := Two, violations := [], monitors := Monitors}} = finally(2000),
    ?assertMatch(#{agreed := 1, increments := 6}, maps:get(starl_counter_monitor, Monitors)),
    ?assert(abs(Two - Second - 6120000) =< 20000, {Second, Two}).

%% Every turn reads, and one of three counts.
one_of_three_turns_counts_test_() -> {timeout, 60, fun one_of_three_turns_counts/0}.

one_of_three_turns_counts() ->
    Turns = 600,
    Script = fun(Robot) ->
        [starl_counter_exercise:work(Robot, Turn, #{}) || Turn <- lists:seq(1, Turns)]
    end,
    Trace = starl_blocks_script_app:trace(
        starl_blocks_script_app:play(Script, #{blocks => [starl_counter]}, #{robots => 1, seed => 1})
    ),
    Asked = [What || {_, 1, app, {call, What, none}} <- Trace],
    Counts = length([increment || increment <- Asked]),
    ?assertEqual(Turns, length(Asked) - Counts),
    %% one of two or of four would be 50 away at least
    ?assert(abs(Counts - Turns div 3) < 30, Counts).

finally(GossipMs) ->
    starl_sim_trial:run(#{
        app => starl_exercise,
        block => counter,
        robots => 3,
        seed => 1,
        work => 0.001,
        final => 2,
        gossip => GossipMs
    }).
