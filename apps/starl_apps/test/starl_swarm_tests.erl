%% The swarm: who must hear, and runs over several hops.
%%
%% Holds: Who must hear hears, over hops
%% Red: a monitor that finds nothing late
-module(starl_swarm_tests).
-include_lib("eunit/include/eunit.hrl").

%% Four robots in a row, 1.5 m apart; the radio reaches 2.5 m, of which a second's drive of two is left out.
row() -> [starl_team_runs:standing(0, N, {1500 * N, 0}) || N <- [1, 2, 3, 4]].

-define(ID, {1, 1, 1}).

sent(Area) -> {10, 1, geocast, {sent, ?ID, Area, 5000000, 7}}.

delivered(Robot) -> {500000, Robot, geocast, {delivered, ?ID, 7}}.

judged(Events) -> judged(Events, #{}).

judged(Events, More) ->
    Config = #{range_mm => 2500, speed => 400, loss => 0, delay_us => 20000},
    starl_team_runs:judged(
        row() ++ Events ++ [{9000000000, 1, geocast, nothing}],
        {starl_swarm_monitor, maps:merge(Config, More)}
    ).

%% The last two are inside.
-define(AREA, {circle, {5500.0, 0.0}, 1600.0}).

over_hops_test() ->
    ?assertMatch({[], #{owed := 2}}, judged([sent(?AREA), delivered(3), delivered(4)])),
    ?assertMatch({[not_heard], _}, judged([sent(?AREA), delivered(4)])),
    ?assertMatch({[not_heard], _}, judged([sent(?AREA)])),
    Late = {1500000, 4, geocast, {delivered, ?ID, 7}},
    ?assertMatch({[not_heard], _}, judged([sent(?AREA), delivered(3), Late])).

%% Who is not linked, or near the border, may hear.
not_owed_test() ->
    ?assertMatch({[], #{owed := 0}}, judged([sent(?AREA)], #{range_mm => 2200})),
    ?assertMatch({[], #{owed := 0}}, judged([sent({circle, {5250.0, 0.0}, 1000.0})])),
    ?assertMatch(
        {[], #{owed := 0, unjudged := [_]}}, judged([sent(?AREA)], #{loss => 0.5})
    ),
    ?assertMatch({[], #{owed := 0}}, judged([sent(?AREA)], #{delay_us => 300000})),
    ?assertMatch({[], #{owed := 0}}, judged([sent(?AREA)], #{faults => [{3, 0, 5, fault}]})),
    Died = {5, 2, robot, {died, killed}},
    ?assertMatch({[], #{owed := 0}}, judged([Died, sent(?AREA)])),
    ?assertMatch({[not_heard], #{owed := 2}}, judged([sent(?AREA)], #{range_mm => none})).

%% The N-th message, of robot 1, sent after N times ten seconds.
later(N, Area, Hear) ->
    T = 10000000 * N,
    Id = {1, 1, N},
    [
        {T, 1, geocast, {sent, Id, Area, 5000000, 7}}
        | [{T + 500000, Robot, geocast, {delivered, Id, 7}} || Robot <- Hear]
    ] ++ [{T + 2000000, 1, geocast, nothing}].

%% On a radio that loses packets chance explains some messages that are missed in a row, the fewer the less it loses;
%% that a neighbour hears says nothing of those behind it.
lossy_test() ->
    Trace = fun(Most, Hear) -> lists:append([later(N, ?AREA, Hear) || N <- lists:seq(1, Most)]) end,
    Judged = fun(Loss, Most, Hear) ->
        {Found, Results} = judged(Trace(Most, Hear), #{loss => Loss}),
        {lists:usort(Found), maps:is_key(unjudged, Results)}
    end,
    ?assertEqual({[], true}, Judged(0.1, 1, [1])),
    ?assertEqual({[not_heard], false}, Judged(0.1, 40, [1])),
    ?assertEqual({[], true}, Judged(0.3, 5, [1])),
    ?assertEqual({[not_heard], false}, Judged(0.2, 200, [1])),
    ?assertEqual({[], false}, Judged(0.2, 200, [3, 4])),
    Near = {circle, {4000.0, 0.0}, 9000.0},
    Direct = lists:append([later(N, Near, [1, 2]) || N <- lists:seq(1, 200)]),
    ?assertMatch({[not_heard | _], _}, judged(Direct, #{loss => 0.2})).

%% Wheels keep nobody from hearing; a robot that does not know its place need not.
excused_by_class_test() ->
    Known = #{broken => [], faults => [], loss => 0, delay_us => 5, bodies => [{3, 1, 2, fault}]},
    Told = fun(Places) -> starl_swarm_monitor:context(Known#{places => Places}, #{}) end,
    ?assertMatch(#{faults := []}, Told([])),
    ?assertMatch(#{faults := [_]}, Told([{3, 1, 2, fault}])).

%% Robots that are told wrong positions hear elsewhere: that breaks no contract.
%% Holds: Who is told wrong positions by noise or a bias hears elsewhere without breaking the
%% contract of geocast; a contract that knows no positions is not excused
%% Red: 862fcda8, run: `outside` in three of three seeds
wrong_positions_test_() ->
    {timeout, 60, fun() ->
        [
            ?assertMatch(
                #{violations := []},
                starl_team_runs:outcome(#{
                    app => starl_swarm,
                    robots => 12,
                    range => 4000,
                    time => 20,
                    faults => [{f, 2000, 20000, Kind, all, #{mm => 900}}]
                })
            )
         || Kind <- [location_noise, location_bias]
        ]
    end}.

runs_test_() ->
    [
        {timeout, 120, fun() ->
            #{report := #{figures := Figures}} =
                Outcome = starl_team_runs:both_ways(maps:merge(#{app => starl_swarm}, More)),
            [{sent, Sent}, {delivered, Delivered}, {owed, Owed}] = Figures,
            ?assert(Sent > 0),
            ?assertEqual(IsOwed, Owed > 0),
            ?assert(Delivered >= Owed),
            ?assertEqual(Delivered, length(starl_team_runs:noted(heard, Outcome)))
        end}
     || {IsOwed, More} <- [
            {true, #{robots => 16, range => 4000}},
            {true, #{robots => 6, loss => 0.2}},
            {false, #{robots => 6, range => 9000, shadowing => 6}},
            {true, #{robots => 6, faults => [{f, 20000, 25000, isolate, 2, #{}}]}}
        ]
    ].
