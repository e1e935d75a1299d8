%% What the interface of distributed path planning asks the participant, and what it makes of the
%% answers.
-module(starl_dpp_interface_tests).
-include_lib("eunit/include/eunit.hrl").

-import(starl_blocks_driver, [play/2]).

%% Two lines, the second one painted.
path() -> {{1, 7}, {0.0, 0.0}, [{{5.0, 0.0}, up}, {{5.0, 9.0}, {down, 3}}]}.

robot() -> starl:robot(1, [1, 2]).

join_test() ->
    Join = fun(R) -> starl_dpp:join(R, 1) end,
    Asked = [{dpp, {join, 1}, infinity}],
    ?assertEqual({Asked, ok}, play(Join, [{answer, ok}])),
    ?assertEqual({Asked, {error, restarted}}, play(Join, [restarted])).

coordinator_test() ->
    Asked = [{dpp, coordinator, infinity}],
    [
        ?assertEqual({Asked, Answer}, play(fun starl_dpp:coordinator/1, [Said]))
     || {Said, Answer} <- [
            {{answer, 2}, {ok, 2}},
            {{answer, none}, {error, no_coordinator}},
            {restarted, {error, restarted}}
        ]
    ].

request_path_test() ->
    Asked = [{dpp, request, infinity}],
    [
        ?assertEqual({Asked, Answer}, play(fun starl_dpp:request_path/1, [{answer, Answer}]))
     || Answer <- [{ok, path()}, complete, incomplete, {error, no_answer}]
    ],
    ?assertEqual({Asked, {error, restarted}}, play(fun starl_dpp:request_path/1, [restarted])).

%% Line by line, each by its number and that of the path.
move_test() ->
    [
        begin
            Move = fun(R) -> starl_dpp:What(R, path(), N) end,
            Asked = [{dpp, {What, {1, 7}, N}, infinity}],
            ?assertEqual({Asked, ok}, play(Move, [{answer, ok}])),
            ?assertEqual({Asked, {error, void}}, play(Move, [{answer, {error, void}}])),
            ?assertEqual({Asked, {error, restarted}}, play(Move, [restarted]))
        end
     || What <- [face, drive], N <- [1, 2]
    ].

lines_test() ->
    ?assertEqual(
        [{1, {{0.0, 0.0}, {5.0, 0.0}}, up}, {2, {{5.0, 0.0}, {5.0, 9.0}}, down}],
        starl_dpp:lines(path())
    ).

%% The mistake in a call is told with the function that was called.
mistakes_test() ->
    [
        ?assertError(
            {bad_argument, #{function := {starl_dpp, Name, Arity}, argument := Argument}}, Call()
        )
     || {{Name, Arity}, Argument, Call} <- [
            {{join, 2}, 'Coordinator', fun() -> starl_dpp:join(robot(), 3) end},
            {{drive, 3}, 'N', fun() -> starl_dpp:drive(robot(), path(), 0) end},
            {{drive, 3}, 'N', fun() -> starl_dpp:drive(robot(), path(), 3) end},
            {{face, 3}, 'N', fun() -> starl_dpp:face(robot(), path(), 1.0) end},
            {{face, 3}, 'Path', fun() -> starl_dpp:face(robot(), complete, 1) end},
            {{face, 3}, 'Path', fun() -> starl_dpp:face(robot(), {{1, 7}, {0.0, 0.0}, none}, 1) end},
            {{drive, 3}, 'Path', fun() -> starl_dpp:drive(robot(), complete, 1) end},
            {{lines, 1}, 'Path', fun() -> starl_dpp:lines(complete) end},
            {{lines, 1}, 'Path', fun() -> starl_dpp:lines({{1, 7}, {0.0, 0.0}, none}) end}
        ]
    ].

%% The participant is told what it needs of the configuration, the coordinator all.
machines_test() ->
    Config = #{slack => 5.0, lease_ms => 1000, drift_ppm => 1, jump_ms => 2, horizon => 9.0},
    ?assertEqual(
        [
            {dpp, starl_dpp_participant, maps:remove(horizon, Config)},
            {dpp_coordinator, starl_dpp_coordinator, Config}
        ],
        starl_dpp:machines(Config)
    ).

%% Lengths and times for the monitor: two robots within the slack of their paths are no nearer than
%% what is left of two tubes; where chassis differ, each has its own r(v).
monitors_test() ->
    Options = #{
        tube_radius => 300.0,
        slack => 40.0,
        horizon => 3000.0,
        edge_length => 500.0,
        lease_ms => 9,
        jump_ms => 2,
        drift_ppm => 5
    },
    Wide = starl_chassis:profile(starl_chassis_differential, #{}),
    Told = fun(Profiles) ->
        [{starl_dpp_monitor, Config}] =
            starl_dpp:monitors(Options, #{robots => [1, 2], profiles => Profiles}),
        Config
    end,
    Same = #{
        tube_radius => 300.0,
        tracking_mm => #{},
        r_s => 520.0,
        path_mm => 3500.0,
        robots => [1, 2],
        lease_us => 9000,
        jump_us => 2000,
        drift_ppm => 5
    },
    ?assertEqual(Same, Told([Wide])),
    Mm = starl_chassis:tracking_radius(Wide),
    ?assertEqual(Same#{tracking_mm := #{1 => Mm, 2 => Mm}}, Told([Wide, Wide])).

%% The tables of settings and of leases, and one model.
block_test() ->
    ?assertEqual(
        starl_dpp_settings:options() ++ starl_dpp_lease:options(), starl_dpp:options()
    ),
    ?assertMatch([{terms, _, New}] when is_function(New, 1), starl_dpp:models()),
    ?assertMatch([_ | _], starl_dpp:contract()).
