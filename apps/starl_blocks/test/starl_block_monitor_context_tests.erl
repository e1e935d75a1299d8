%% What monitors are told of a run, its faults and its time: each takes what it asks for, and what a
%% scene says itself stays. What none says is as it is documented.
-module(starl_block_monitor_context_tests).
-include_lib("eunit/include/eunit.hrl").

-define(BROKEN, [{1, 5, 9, pause}]).
-define(FAULTS, [{1, 5, 9, pause}, {2, 3, 4, fault}]).
-define(CLOCKS, #{offset_us => 3, drift_ppm => 2}).
-define(KNOWN, #{
    broken => ?BROKEN,
    clocks => ?CLOCKS,
    faults => ?FAULTS,
    healed_us => 20,
    delay_us => 7,
    loss => 0,
    positions => [],
    sap => #{},
    slack_us => 100
}).

told(Monitor, Config) -> Monitor:context(?KNOWN, Config).

%% Events come later by the slack than by the rules: the bound is wider by that, once.
slack_test_() ->
    [
        {
            atom_to_list(Monitor),
            ?_assertEqual(
                {5100, kept}, begin
                    #{bound_us := Bound, own := Own} = told(Monitor, #{
                        bound_us => 5000, own => kept
                    }),
                    {Bound, Own}
                end
            )
        }
     || Monitor <- [
            starl_barrier_monitor,
            starl_election_monitor,
            starl_election_bully_monitor,
            starl_mutex_monitor,
            starl_registers_monitor,
            starl_sap_monitor
        ]
    ].

%% A bound that is none gets no wider.
without_bound_test() ->
    Infinity = #{bound_us => infinity},
    Faults = #{faults => ?FAULTS},
    ?assertEqual(maps:merge(Infinity, Faults), told(starl_barrier_monitor, Infinity)),
    ?assertEqual(Faults, told(starl_barrier_monitor, #{})),
    ?assertEqual(
        maps:merge(Infinity, Faults#{broken => ?BROKEN}), told(starl_mutex_monitor, Infinity)
    ),
    ?assertEqual(Faults#{broken => ?BROKEN}, told(starl_mutex_monitor, #{})),
    ?assertEqual(
        #{healed_us => 20, broken => ?BROKEN, clocks => ?CLOCKS}, told(starl_registers_monitor, #{})
    ).

%% What is known of faults goes to those that ask for it; what the scene says stays.
faults_test_() ->
    [
        {lists:concat([Monitor, " ", Key]), fun() ->
            ?assertEqual(Value, maps:get(Key, told(Monitor, #{bound_us => 1}))),
            ?assertEqual(own, maps:get(Key, told(Monitor, #{Key => own, bound_us => 1})))
        end}
     || {Monitor, Known} <- [
            {starl_counter_monitor, [healed_us]},
            {starl_dpp_monitor, [broken]},
            {starl_geocast_monitor, [broken, healed_us, delay_us]},
            {starl_barrier_monitor, [faults]},
            {starl_mutex_monitor, [broken, faults]},
            {starl_registers_monitor, [broken, clocks, healed_us]}
        ],
        Key <- Known,
        Value <- [maps:get(Key, ?KNOWN)]
    ].

%% A window that is told when it is over is like one that was known from the beginning.
told_later_test_() ->
    Known = ?KNOWN#{faults := ?BROKEN, healed_us := 9, delay_us := 0, slack_us := 0},
    [Window] = ?BROKEN,
    [
        {
            atom_to_list(Monitor),
            ?_assertEqual(
                Monitor:init(Monitor:context(Known, Config)),
                Monitor:broken(Window, Monitor:init(Config))
            )
        }
     || {Monitor, Config} <- [
            {starl_barrier_monitor, #{robots => [1, 2], bound_us => 50, delta_us => 50}},
            {starl_counter_monitor, #{robots => [1, 2], within_us => 50}},
            {starl_election_monitor, #{robots => [1, 2], bound_us => 50}},
            {starl_election_bully_monitor, #{robots => [1, 2], bound_us => 50}},
            {starl_geocast_monitor, #{robots => [1, 2]}},
            {starl_mutex_monitor, #{bound_us => 50}},
            {starl_registers_monitor, #{robots => [1, 2], within_us => 50, clocks => ?CLOCKS}},
            {starl_sap_monitor, #{bound_us => 50, unlucky => 0.0, whole_us => 40}}
        ]
    ].

%% What was due after the beginning of the window is due later: what a robot does alone by the length
%% of the window; what takes a team begins anew.
due_later_test_() ->
    [
        {atom_to_list(Monitor), fun() ->
            Ends = fun(End) ->
                {ok, Begun} = starl_monitor:step(Events, starl_monitor:new([{Monitor, Config}])),
                {Found, _} = starl_monitor:finish(
                    End, starl_monitor:broken({1, 5, 9, pause}, Begun)
                ),
                [What || #{what := What} <- Found]
            end,
            ?assertEqual([], Ends(Due + 4)),
            ?assertMatch([_ | _], Ends(Due + 5))
        end}
     || {Monitor, Config, Events, Due} <- [
            {starl_election_monitor, #{robots => [1, 2], bound_us => 50},
                [{2, 1, election, {entered, e}}], 52},
            {starl_election_bully_monitor, #{robots => [1, 2], bound_us => 50},
                [{2, 1, election, {entered, e}}], 52},
            {starl_mutex_monitor, #{bound_us => 50}, [{2, 1, mutex, {requested, t}}], 55},
            {starl_sap_monitor, #{bound_us => 50}, [{2, 1, sap, {sent, {1, 1, 1}, [2], t, 0}}], 52}
        ]
    ].

%% Agreement is due when the window is over, and the time for it has passed.
agreement_due_later_test() ->
    Config = #{robots => [1, 2], within_us => 50},
    Events = [{2, 1, counter, {incremented, 1}}, {2, 1, counter, {holds, 1}}],
    {ok, Begun} = starl_monitor:step(Events, starl_monitor:new([{starl_counter_monitor, Config}])),
    Told = starl_monitor:broken({1, 5, 9, pause}, Begun),
    Found = fun(End) -> length(element(1, starl_monitor:finish(End, Told))) end,
    ?assertEqual([0, 1], [Found(59), Found(60)]).

%% And nothing else.
nothing_else_test() ->
    Keys = fun(Monitor) -> lists:sort(maps:keys(told(Monitor, #{bound_us => 1}))) end,
    ?assertEqual([bound_us, broken, delay_us, healed_us, loss], Keys(starl_geocast_monitor)),
    ?assertEqual([bound_us, broken], Keys(starl_dpp_monitor)),
    ?assertEqual([bound_us, healed_us], Keys(starl_counter_monitor)).

%% What is left out is what it would be if it were said.
defaults_test_() ->
    [
        {
            atom_to_list(Monitor),
            ?_assertEqual(
                Monitor:init(maps:merge(Given, Defaults)), Monitor:init(Given)
            )
        }
     || {Monitor, Given, Defaults} <- [
            {starl_barrier_monitor, #{robots => [1, 2]}, #{
                bound_us => infinity, delta_us => infinity
            }},
            {starl_counter_monitor, #{robots => [1, 2]}, #{within_us => infinity, healed_us => 0}},
            {starl_dpp_monitor, #{tube_radius => 300.0, r_s => 500.0}, #{
                slice_us => 1000000,
                tracking_mm => #{},
                robots => [],
                lease_us => 10000000,
                jump_us => 2000000,
                drift_ppm => 10000,
                broken => []
            }},
            {starl_geocast_monitor, #{robots => [1, 2]}, #{
                progress => false,
                healed_us => 0,
                margin_mm => 4.0,
                grace_us => 1000000,
                delay_us => 0,
                drift_ppm => 10000,
                broken => []
            }},
            {starl_election_monitor, #{robots => [1, 2], bound_us => 5}, #{
                complete => false, settle_us => infinity
            }},
            {starl_election_bully_monitor, #{robots => [1, 2], bound_us => 5}, #{
                lossless => false
            }},
            {starl_registers_monitor, #{robots => [1, 2]}, #{
                owners => #{}, bound_us => infinity, healed_us => 0, apart_us => 0
            }}
        ]
    ].
