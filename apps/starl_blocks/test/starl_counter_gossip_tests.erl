%% The machine of the shared counter.
-module(starl_counter_gossip_tests).
-include_lib("eunit/include/eunit.hrl").

-define(META, #{now => 0}).

start(Life) ->
    {ready, Data, Actions} = starl_counter_gossip:init(#{
        robot => 2,
        participants => starl_team:new([1, 2, 3]),
        incarnation => Life,
        stored => none,
        gossip_ms => 5
    }),
    ?assertEqual([starl_sap:listen(counter, counter), {{timeout, gossip}, 5000, gossip}], Actions),
    Data.

does(Type, Content, Data) ->
    case starl_counter_gossip:handle_event(Type, Content, ready, Data, ?META) of
        {keep_state, Next} -> {Next, []};
        {keep_state, Next, Actions} -> {Next, Actions};
        {keep_state_and_data, Actions} -> {Data, Actions};
        keep_state_and_data -> {Data, []}
    end.

%% What was counted in one life each.
hears(List, Data) ->
    Told = [{Robot, 0, 0, [{Life, N}]} || {Robot, Life, N} <- List],
    does(cast, {message, 1, counter, {tallies, Told}}, Data).

value(Data) ->
    {Data, [{trace, {read, Value}}, {reply, {app, t}, Value}]} = does(
        {call, {app, t}}, value, Data
    ),
    Value.

increments_are_answered_with_the_value_test() ->
    Data = start(1),
    ?assertEqual(0, value(Data)),
    {One, Said} = does({call, {app, t}}, increment, Data),
    Own = {{0, 0, [{1, 1}]}, #{}},
    ?assertEqual([{trace, {incremented, 1}}, {store, Own}, {reply, {app, t}, 1}], Said),
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
    Told = fun(To) -> starl_sap:post(To, counter, {tallies, [{2, 0, 0, [{1, 1}]}]}) end,
    {Next, [To1, {{timeout, gossip}, 5000, gossip}]} = does({timeout, gossip}, gossip, One),
    {Last, [To3, _]} = does({timeout, gossip}, gossip, Next),
    {_, [Again, _]} = does({timeout, gossip}, gossip, Last),
    ?assertEqual([Told(1), Told(3), Told(1)], [To1, To3, Again]).

%% Another life counts beside what the others know of the one before.
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

%% A restarted machine has what it stored, and says so; with a damaged store it has nothing.
stored_test() ->
    Start = fun(Stored) ->
        {ready, Data, Actions} = starl_counter_gossip:init(#{
            robot => 2, participants => [{1, 3}], incarnation => 6, stored => Stored
        }),
        {value(Data), [Trace || {trace, Trace} <- Actions]}
    end,
    ?assertEqual({12, [{holds, 12}]}, Start({stored, {{1, 3, [{2, 4}, {5, 5}]}, #{}}})),
    ?assertEqual({0, []}, Start(none)),
    ?assertEqual({0, []}, Start(damaged)).

accepts_test() ->
    ?assert(starl_counter_gossip:accepts(counter, {tallies, [{1, 0, 0, [{1, 1}]}, {2, 3, 4, []}]})),
    [
        ?assertNot(starl_counter_gossip:accepts(Type, Body))
     || {Type, Body} <- [
            {counter, {tallies, [{1, 0, 0, [{1, 0}]}]}},
            {counter, {tallies, [{1, 0, -1, []}]}},
            {counter, {tallies, [{1, 0, 0, [{1, 1, 1}]}]}},
            {counter, {tallies, [{1, 1}]}},
            {counter, {tallies, x}},
            {other, {tallies, []}}
        ]
    ].

%% Without an option it tells the others once a second; what is given is heeded.
gossips_once_a_second_test() ->
    Config = #{
        robot => 1, participants => starl_team:new([1, 2]), incarnation => 1, stored => none
    },
    {ready, _, [_, Timer]} = starl_counter_gossip:init(Config),
    ?assertEqual({{timeout, gossip}, 1000000, gossip}, Timer).

%% The tallies are told in an order that no map has: that of the robots. Of other robots there are none.
tells_in_order_test() ->
    {ready, Data, _} = starl_counter_gossip:init(#{
        robot => 2, participants => [{1, 50}], incarnation => 1, stored => none
    }),
    Told = [{R, 0, 0, [{1, 1}, {2, 2}]} || R <- lists:seq(1, 52)],
    {Known, _} = does(cast, {message, 1, counter, {tallies, lists:reverse(Told)}}, Data),
    {_, [Post, _]} = does({timeout, gossip}, gossip, Known),
    ?assertEqual(starl_sap:post(1, counter, {tallies, lists:sublist(Told, 50)}), Post).
