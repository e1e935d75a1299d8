%% What path planning can be told: the tables' defaults and bounds, as the pages and types say them.
-module(starl_dpp_settings_tests).
-include_lib("eunit/include/eunit.hrl").

segments() -> [{{1.0, 2.0}, {3.0, 4.0}}].

required() ->
    #{
        segments => segments(), world => {5000.0, 5000.0}, robots => [1, 2], tube_radius => 220.0
    }.

%% What need not be told has a default; what is told stays.
complete_test() ->
    Defaults = #{
        slack => 0.0,
        horizon => 3000.0,
        edge_length => 500.0,
        leg => 500.0,
        turn_mm => 160.0,
        overhead_mm => 100.0,
        choice => ink,
        middle => 0.7,
        patience => {1.05, 50.0},
        seed => 1,
        ways => none
    },
    ?assertEqual(maps:merge(required(), Defaults), starl_dpp_settings:complete(required())),
    Own = maps:merge(required(), maps:map(fun(_, _) -> own end, Defaults)),
    ?assertEqual(Own, starl_dpp_settings:complete(Own)),
    ?assertEqual(Defaults, starl_dpp_settings:complete(#{})).

checked(Given) -> starl_options:check(Given, starl_dpp:options()).

%% Of the block's options what is not told is that of the tables.
defaults_test() ->
    {ok, Options} = checked(#{}),
    ?assertEqual(
        #{
            segments => [],
            world => {12000.0, 12000.0},
            tube_radius => 365.0,
            slack => 0.0,
            horizon => 3000.0,
            edge_length => 500.0,
            leg => 500.0,
            turn_mm => 160.0,
            overhead_mm => 100.0,
            choice => ink,
            middle => 0.7,
            patience => {1.05, 50.0},
            seed => 1,
            ways => none,
            lease_ms => 10000,
            drift_ppm => 10000,
            jump_ms => 2000
        },
        Options
    ).

%% The least and the most of each number is taken, what is beyond is refused.
bounds_test_() ->
    [
        {atom_to_list(Key), fun() ->
            [
                ?assertMatch({ok, #{Key := Value}}, checked(#{Key => Value}))
             || Value <- [Least, Most]
            ],
            [
                ?assertMatch({error, _}, checked(#{Key => Value}))
             || Value <- [Least - Step, Most + Step]
            ]
        end}
     || {Key, Least, Most, Step} <-
            [
                {Key, 0, 1.0e9, 0.5}
             || Key <- [tube_radius, slack, horizon, edge_length, leg, turn_mm, overhead_mm]
            ] ++
                [
                    {middle, 0, 1, 0.001},
                    {seed, 0, 1 bsl 64, 1},
                    {lease_ms, 1, 1000000000, 1},
                    {drift_ppm, 0, 100000, 1},
                    {jump_ms, 0, 1000000000, 1}
                ]
    ].

%% Floors are from a metre to a kilometre.
world_test() ->
    [
        ?assertMatch({Taken, {ok, _}}, {Taken, checked(#{world => Taken})})
     || Taken <- [{1000, 1000}, {1000000, 1000.0}]
    ],
    [
        ?assertMatch({Refused, {error, _}}, {Refused, checked(#{world => Refused})})
     || Refused <- [{999, 1000}, {1000, 1000001}, {1000}, wide]
    ].

patience_test() ->
    [?assertMatch({ok, #{patience := P}}, checked(#{patience => P})) || P <- [infinity, {1, 2.0}]],
    [
        ?assertMatch({error, _}, checked(#{patience => P}))
     || P <- [none, {1.0}, {a, 2.0}, {1.0, b}, 7]
    ].

segments_test() ->
    ?assertMatch({ok, _}, checked(#{segments => segments()})),
    ?assertMatch({error, _}, checked(#{segments => line})).
