-module(starl_live_conditions_tests).
-include_lib("eunit/include/eunit.hrl").

conditions(Settings) ->
    {ok, Conditions} = starl_live_conditions:new(Settings),
    Conditions.

pass(N, Conditions) ->
    {Passed, _} = lists:mapfoldl(
        fun(_, A) -> starl_live_conditions:pass(2, A) end, Conditions, lists:seq(1, N)
    ),
    Passed.

nothing_is_disturbed_test() -> ?assertEqual([[0], [0]], pass(2, conditions(#{}))).

all_or_nothing_test_() ->
    [
        ?_assertEqual([[]], pass(1, conditions(#{loss => 1}))),
        ?_assertEqual([[0, 0]], pass(1, conditions(#{duplicates => 1}))),
        ?_assertEqual([[7]], pass(1, conditions(#{delay_ms => {7, 7}}))),
        ?_assertEqual([[7]], pass(1, conditions(#{delay_ms => 7}))),
        ?_assertEqual([[]], pass(1, conditions(#{cut => [1, 2]}))),
        ?_assertEqual([[0]], pass(1, conditions(#{cut => [1, 3]})))
    ].

%% What disturbs one link disturbs no other.
disturbed_test_() ->
    [
        ?_assertEqual(Delays, pass(1, conditions(#{disturbed => #{Robot => Disturbances}})))
     || {Delays, Robot, Disturbances} <- [
            {[[]], 2, [{lost, 1}]},
            {[[0]], 3, [{lost, 1}]},
            {[[0, 0, 0]], 2, [{again, 1, 2}]},
            {[[9]], 2, [{late, 1, {9, 9}}]},
            {[[9, 9]], 2, [{again, 1, 1}, {late, 1, {9, 9}}]},
            {[[0]], 2, [{late, 0, {9, 9}}, {lost, 0}]}
        ]
    ] ++
        [
            %% one that comes twice already comes once more for each time
            ?_assertEqual(
                [[0, 0, 0, 0]],
                pass(1, conditions(#{duplicates => 1, disturbed => #{2 => [{again, 1, 2}]}}))
            )
        ].

%% What is drawn for a disturbance is drawn anew for the next one.
disturbances_are_drawn_anew_test() ->
    Conditions = conditions(#{seed => 3, disturbed => #{2 => [{lost, 0}]}}),
    {_, Disturbed} = starl_live_conditions:pass(2, Conditions),
    {_, Other} = starl_live_conditions:pass(3, Conditions),
    ?assertNotEqual(Other, Disturbed).

%% Without disturbances nothing is drawn; conditions without a seed have seed 0.
without_disturbances_nothing_is_drawn_test() ->
    Clear = conditions(#{seed => 3}),
    ?assertEqual({[0], Clear}, starl_live_conditions:pass(2, Clear)),
    Lossy = #{loss => 0.5, delay_ms => {0, 9}},
    ?assertEqual(pass(20, conditions(Lossy#{seed => 0})), pass(20, conditions(Lossy))).

parts_are_about_right_test() ->
    Passed = pass(
        10_000, conditions(#{loss => 0.2, duplicates => 0.5, delay_ms => {1, 3}, seed => 7})
    ),
    Lost = length([lost || [] <- Passed]),
    Twice = length([twice || [_, _] <- Passed]),
    ?assert(abs(Lost - 2000) < 200),
    ?assert(abs(Twice - 4000) < 250),
    ?assertEqual([1, 2, 3], lists:usort(lists:append(Passed))).

a_seed_gives_the_same_again_test() ->
    Settings = #{loss => 0.5, delay_ms => {0, 9}, seed => 3},
    ?assertEqual(pass(100, conditions(Settings)), pass(100, conditions(Settings))),
    ?assertNotEqual(pass(100, conditions(Settings)), pass(100, conditions(Settings#{seed => 4}))).

%% Cutting a link changes nothing for the packets that are heard: which others are lost stays.
settings_change_nothing_else_test() ->
    Lossy = conditions(#{loss => 0.5, seed => 3}),
    {ok, Cut} = starl_live_conditions:set(#{cut => [9]}, Lossy),
    ?assertEqual(pass(100, Lossy), pass(100, Cut)),
    {ok, Deaf} = starl_live_conditions:set(#{cut => [2]}, Lossy),
    {_, Later} = starl_live_conditions:pass(2, Lossy),
    {_, Healed} = starl_live_conditions:pass(2, Deaf),
    {ok, Same} = starl_live_conditions:set(#{cut => []}, Healed),
    ?assertEqual(pass(100, Later), pass(100, Same)).

%% A packet is lost or doubled if what is drawn for it is less than the part, not if it is just that.
parts_are_bounds_test() ->
    {Lost, Next} = rand:uniform_s(rand:seed_s(exsss, 3)),
    {Doubled, _} = rand:uniform_s(Next),
    More = 1.0e-9,
    ?assertEqual([[0]], pass(1, conditions(#{seed => 3, loss => Lost}))),
    ?assertEqual([[]], pass(1, conditions(#{seed => 3, loss => Lost + More}))),
    ?assertEqual([[0]], pass(1, conditions(#{seed => 3, duplicates => Doubled}))),
    ?assertEqual([[0, 0]], pass(1, conditions(#{seed => 3, duplicates => Doubled + More}))),
    %% a disturbance is drawn after the packet's own four
    Skip = fun(_, Random) -> element(2, rand:uniform_s(Random)) end,
    {Fifth, _} = rand:uniform_s(lists:foldl(Skip, rand:seed_s(exsss, 3), lists:seq(1, 4))),
    Disturbed = fun(Part) -> conditions(#{seed => 3, disturbed => #{2 => [{lost, Part}]}}) end,
    ?assertEqual([[0]], pass(1, Disturbed(Fifth))),
    ?assertEqual([[]], pass(1, Disturbed(Fifth + More))).

%% The largest and the least values are none too large or small.
bounds_of_settings_test_() ->
    Most = 1 bsl 58,
    [
        ?_assertMatch({{ok, _}, _}, {starl_live_conditions:new(Given), Given})
     || Given <- [#{seed => Most}, #{seed => -Most}, #{delay_ms => 60_000}, #{delay_ms => {0, 0}}]
    ] ++
        [
            ?_assertMatch({{error, _}, _}, {starl_live_conditions:new(Given), Given})
         || Given <- [
                #{seed => Most + 1},
                #{seed => -Most - 1},
                #{delay_ms => 60_001},
                #{delay_ms => -1},
                #{loss => -0.1},
                #{duplicates => 1.1},
                #{disturbed => []},
                #{cut => [x]}
            ]
        ].

%% A delay lies between the least and the most, and both come.
delays_lie_between_bounds_test() ->
    ?assertEqual(
        [3, 4], lists:usort(lists:append(pass(100, conditions(#{delay_ms => {3, 4}, seed => 1}))))
    ),
    Late = #{2 => [{late, 1, {3, 4}}]},
    ?assertEqual(
        [3, 4], lists:usort(lists:append(pass(100, conditions(#{disturbed => Late, seed => 1}))))
    ).

mistakes_are_said_test_() ->
    [
        ?_assertEqual(Line, line(Settings))
     || {Settings, Line} <- [
            {#{los => 1}, "air: unknown key los (did you mean loss?)"},
            {#{loss => 2}, "air: loss: a number from 0 to 1 expected, not 2"},
            {#{cut => 3}, "air: cut: a list of robots expected, not 3"}
        ]
    ].

line(Settings) ->
    {error, Line} = starl_live_conditions:new(Settings),
    lists:flatten(Line).
