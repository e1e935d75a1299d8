%% The intersection: its road, the contract, and runs.
-module(starl_crossing_tests).
-include_lib("eunit/include/eunit.hrl").

-define(FLOOR, {12000, 12000}).

%% Evenly along the road, which is closed and passes the crossing twice; no two sections are near each other.
road_test_() ->
    [
        fun() ->
            [First | Others] = Road = starl_crossing:sections(Floor),
            N = length(Road),
            Steps = [starl_geometry:distance(P, Q) || {P, Q} <- lists:zip(Road, Others ++ [First])],
            ?assert(lists:max(Steps) < 1.15 * lists:min(Steps)),
            Crossing = [
                P
             || {I, P} <- lists:enumerate(0, Road), starl_crossing:token(I, Road) =:= crossing
            ],
            ?assertMatch([_, _], Crossing),
            ?assert(starl_geometry:distance(hd(Crossing), lists:last(Crossing)) < 10),
            Sections = lists:droplast(Crossing) ++ (Road -- Crossing),
            Apart = [starl_geometry:distance(P, Q) || P <- Sections, Q <- Sections, P =/= Q],
            ?assert(lists:min(Apart) > 0.85 * lists:min(Steps)),
            Tokens = lists:usort([starl_crossing:token(I, Road) || I <- lists:seq(0, N - 1)]),
            ?assertEqual(N - 1, length(Tokens)),
            [
                ?assertEqual(I, starl_crossing:nearest(P, Road))
             || {I, P} <- lists:enumerate(0, Road), I rem (N div 2) =/= 0
            ]
        end
     || Floor <- [?FLOOR, {8000, 6000}, {30000, 20000}]
    ].

robots_begin_in_sections_of_their_own_test() ->
    Road = starl_crossing:sections(?FLOOR),
    [
        begin
            Starts = starl_crossing:starts(lists:seq(1, N), Road),
            Tokens = [
                starl_crossing:token(starl_crossing:nearest({X, Y}, Road), Road)
             || {_, {X, Y, _}} <- Starts
            ],
            ?assertEqual(N, length(lists:usort(Tokens))),
            ?assertNot(lists:member(crossing, Tokens))
        end
     || N <- lists:seq(1, starl_crossing:most(Road))
    ].

%% Found by soaking and shrunk: the positions of robots 2 and 7 are exchanged for a while. Robot 2 came off the road, and
%% later drove straight across it to where it believed to be next.
%%
%% Holds: A robot that was led off the road drives back to the section that is nearest, and across no others
%% Red: 0422e6ed: two robots 3.9 mm apart, half a minute after the fault
led_off_the_road_test_() ->
    {timeout, 120, fun() ->
        Scenario = #{
            app => crossing,
            robots => 10,
            seed => 91000109,
            loss => 0.05,
            delay => {1, 1000},
            clock_offset => 0,
            clock_drift => 0,
            time => 120,
            heal => 25,
            faults => [
                {location_swap_1, 21797, 25000, location_swap, {2, 7}, #{}},
                {pause_1, 19353, 25000, pause, 7, #{}},
                {store_lost_3, 4082, 5934, store_lost, 10, #{}},
                {store_set_back_1, 10607, 12738, store_set_back, 8, #{}},
                {store_set_back_2, 20216, 21713, store_set_back, 2, #{}},
                {store_set_back_3, 22509, 25000, store_set_back, 1, #{}}
            ]
        },
        #{violations := Violations} = starl_platform_ct:quietly(fun() ->
            {ok, Sim} = starl_sim:start(Scenario),
            _ = starl_sim:run(Sim),
            {Outcome, _} = starl_sim:finish(Sim),
            Outcome
        end),
        ?assertEqual([], Violations)
    end}.

%% -- the contract ---------------------------------------------------------------------------

judged(Mm, Faults) ->
    Events = [
        starl_team_runs:standing(0, 1, {0, 0}),
        {1, 1, app, passes},
        starl_team_runs:standing(0, 2, {5000, 0}),
        starl_team_runs:standing(2000000, 2, {Mm, 0}),
        starl_team_runs:standing(4000000, 2, {5000, 0})
    ],
    starl_team_runs:judged(Events, {starl_crossing_monitor, #{faults => Faults}}).

apart_test() ->
    ?assertMatch({[], #{passes := 1, least_mm := 501.0}}, judged(501, [])),
    ?assertMatch({[too_near], _}, judged(499, [])),
    ?assertMatch({[], _}, judged(499, [{1, 0, 1000, fault}])),
    ?assertMatch({[too_near], _}, judged(499, [{1, 5000000, 6000000, fault}])).

passes_are_owed_test() ->
    Judged = fun(Events) -> starl_team_runs:judged(Events, {starl_crossing_monitor, #{}}) end,
    At = fun(S, Robot) -> starl_team_runs:standing(S * 1000000, Robot, {0, 0}) end,
    Passes = fun(S) -> {S * 1000000, 1, app, passes} end,
    ?assertMatch({[], #{passes := 2}}, Judged([At(0, 1), Passes(100), Passes(219), At(330, 1)])),
    ?assertMatch({[nobody_passes], #{passes := 1}}, Judged([At(0, 1), Passes(100), Passes(221)])),
    ?assertMatch({[nobody_passes], #{passes := 0}}, Judged([At(0, 1), At(121, 1)])),
    [
        ?assertMatch({[], _}, Judged([At(0, 1), {4000000, 2, Machine, End}, At(400, 1)]))
     || {Machine, End} <- [{robot, {died, killed}}, {supervisor, {given_up, app}}, {app, {done, 4}}]
    ].

%% -- runs -----------------------------------------------------------------------------------

too_many_test() ->
    {error, Why} = starl_crossing:scene(#{
        robots => lists:seq(1, 50), world => ?FLOOR, options => #{}
    }),
    ?assertEqual(
        "this road has room for 11 robots: use fewer, or a larger floor (--world)",
        lists:flatten(Why)
    ).

%% Holds: Robots in the intersection are apart
%% Red: sections that are entered without their token
runs_test_() ->
    [
        {timeout, 120, fun() ->
            #{report := #{figures := [{passes, Passes}, _, {least_mm, Least}]}} =
                Outcome = starl_team_runs:both_ways(maps:merge(#{app => starl_crossing}, More)),
            ?assert(Passes >= Expected, Passes),
            %% null is greater than every number
            ?assert(Least > 1000),
            ?assertEqual(Passes, length(starl_team_runs:noted(passes_per_min, Outcome))),
            #{robots := Robots} = Outcome,
            ?assertEqual(Passes, lists:sum([N || {_, #{result := {done, N}}} <- Robots]))
        end}
     || {Expected, More} <- [
            {3, #{robots => 1}},
            {15, #{robots => 6}},
            {10, #{robots => 10, loss => 0.2}}
        ]
    ].
