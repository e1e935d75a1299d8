%% The shared counter: its machine, and its contract under drawn faults. The contract by traces:
%% starl_counter_monitor_tests.
-module(starl_counter_tests).
%% in this order: both have a macro LET
-include_lib("proper/include/proper.hrl").
-include_lib("eunit/include/eunit.hrl").

-define(META, #{now => 0}).

%% -- the machine ----------------------------------------------------------------------------

start(Life) ->
    {ready, Data, Actions} = starl_counter_gossip:init(#{
        robot => 2, participants => starl_team:new([1, 2, 3]), incarnation => Life, gossip_ms => 5
    }),
    ?assertEqual([starl_sap:listen(counter, counter), {{timeout, gossip}, 5000, gossip}], Actions),
    Data.

does(Type, Content, Data) ->
    case starl_counter_gossip:handle_event(Type, Content, ready, Data, ?META) of
        {keep_state, Next, Actions} -> {Next, Actions};
        {keep_state_and_data, Actions} -> {Data, Actions};
        keep_state_and_data -> {Data, []}
    end.

hears(List, Data) -> does(cast, {message, 1, counter, {entries, List}}, Data).

value(Data) ->
    {Data, [{trace, {read, Value}}, {reply, {app, t}, Value}]} = does(
        {call, {app, t}}, value, Data
    ),
    Value.

increments_are_answered_with_the_value_test() ->
    Data = start(1),
    ?assertEqual(0, value(Data)),
    {One, Said} = does({call, {app, t}}, increment, Data),
    ?assertEqual([{trace, {incremented, 1}}, {reply, {app, t}, 1}], Said),
    {Two, _} = does({call, {app, t}}, increment, One),
    ?assertEqual(2, value(Two)).

%% Of two numbers for one entry the larger counts, in whatever order they come, and once.
merged_by_maximum_test() ->
    {A, Said} = hears([{1, 1, 4}, {3, 2, 5}], start(1)),
    ?assertEqual([{trace, {holds, 9}}], Said),
    ?assertEqual({A, []}, hears([{1, 1, 3}, {3, 2, 5}], A)),
    {B, _} = hears([{1, 1, 6}], A),
    ?assertEqual(11, value(B)).

%% The others are told in turn; who knows of nothing tells nothing.
gossip_test() ->
    Empty = start(1),
    ?assertMatch({_, [{{timeout, gossip}, 5000, gossip}]}, does({timeout, gossip}, gossip, Empty)),
    {One, _} = does({call, {app, t}}, increment, Empty),
    Told = fun(To) -> starl_sap:post(To, counter, {entries, [{2, 1, 1}]}) end,
    {Next, [To1, {{timeout, gossip}, 5000, gossip}]} = does({timeout, gossip}, gossip, One),
    {Last, [To3, _]} = does({timeout, gossip}, gossip, Next),
    {_, [Again, _]} = does({timeout, gossip}, gossip, Last),
    ?assertEqual([Told(1), Told(3), Told(1)], [To1, To3, Again]).

%% Another life counts in an entry of its own.
restarted_test() ->
    {Known, _} = hears([{2, 1, 7}], start(2)),
    {One, _} = does({call, {app, t}}, increment, Known),
    ?assertEqual(8, value(One)),
    ?assertEqual(
        [starl_sap:listen(counter, counter)], element(2, does(info, {restarted, sap}, One))
    ),
    ?assertEqual([], element(2, does(info, {restarted, app}, One))),
    ?assertEqual(
        unknown_event, starl_counter_gossip:handle_event(cast, nonsense, ready, One, ?META)
    ).

accepts_test() ->
    ?assert(starl_counter_gossip:accepts(counter, {entries, [{1, 1, 1}]})),
    [
        ?assertNot(starl_counter_gossip:accepts(Type, Body))
     || {Type, Body} <- [
            {counter, {entries, [{1, 1, 0}]}},
            {counter, {entries, [{1, 1, -1}]}},
            {counter, {entries, [{1, 1}]}},
            {counter, {entries, x}},
            {other, {entries, []}}
        ]
    ].

%% Without an option it tells the others once a second; what is given is heeded.
gossips_once_a_second_test() ->
    Config = #{robot => 1, participants => starl_team:new([1, 2]), incarnation => 1},
    {ready, _, [_, Timer]} = starl_counter_gossip:init(Config),
    ?assertEqual({{timeout, gossip}, 1000000, gossip}, Timer).

%% A list of entries has an order that no map has: that of the robots and their lives.
tells_in_order_test() ->
    Lives = [{R, L, 1} || R <- lists:seq(1, 20), L <- [1, 2]],
    {Known, _} = hears(lists:reverse(Lives), start(1)),
    {_, [Post, _]} = does({timeout, gossip}, gossip, Known),
    ?assertEqual(starl_sap:post(1, counter, {entries, Lives}), Post).

%% -- the declaration --------------------------------------------------------------------------

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
agrees_in_the_end_test() ->
    {ok, #{end_us := Second}} = finally(1000),
    {ok, #{end_us := Two, violations := [], monitors := Monitors}} = finally(2000),
    ?assertMatch(#{agreed := 1}, maps:get(starl_counter_monitor, Monitors)),
    ?assert(abs(Two - Second - 6120000) =< 20000, {Second, Two}).

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

%% -- the contract under drawn faults ----------------------------------------------------------

contract_holds_test_() ->
    {timeout, 120, fun() -> starl_platform_ct:property(prop_contract(none), 30) end}.

%% The same property fails over a counter with a bug.
bugs_are_found_test_() ->
    {timeout, 120, fun() ->
        [
            ?assertEqual(
                {Bug, true},
                {Bug,
                    lists:any(
                        fun(Seed) -> broken(Bug, 4, Seed) =/= [] end, lists:seq(1, 30)
                    )}
            )
         || Bug <- [adds, replaces, zero, reborn]
        ]
    end}.

prop_contract(Bug) ->
    ?FORALL(
        {N, Seed},
        {proper_types:oneof([1, 2, 4, 6]), proper_types:oneof(lists:seq(1, 100000))},
        starl_platform_ct:safely(fun() -> broken(Bug, N, Seed) =:= [] end)
    ).

broken(Bug, N, Seed) ->
    #{violations := Violations} =
        starl_blocks_script_app:play(fun script/1, around(Bug, N), #{
            robots => N,
            seed => Seed,
            random_faults => [network, process, clock],
            heal => 10,
            time => 60
        }),
    Violations.

around(none, _N) ->
    #{blocks => [{starl_counter, #{gossip_ms => 500}}]};
around(Bug, N) ->
    #{
        blocks => [{counter, starl_counter_bug, #{bug => Bug, gossip_ms => 500}}],
        monitors => [
            {starl_counter_monitor, #{
                robots => lists:seq(1, N), within_us => 1000 * starl_counter:within_ms(500, N)
            }}
        ]
    }.

script(Robot) ->
    _ = [
        begin
            _ = starl_counter:increment(Robot),
            ok = starl:sleep(Robot, 1 + trunc(2000 * starl:random(Robot)))
        end
     || _ <- lists:seq(1, 10)
    ],
    ok = starl:sleep(Robot, 20000),
    starl_counter:value(Robot).
