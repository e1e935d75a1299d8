%% The convoy: its lane, the contract, and runs.
%%
%% Holds: The lane leads through each door once, clear of all walls; a robot that begins anew finds
%% its place on it
%% Red: without tokens and looks: `too near` after 21 s
%% Holds: Nobody overtakes, nobody comes too near, somebody moves on
%% Red: one of 200 seeds (63): a robot that took itself for another drove against the others for
%% ever; it now gives up, and looks where it is; 177: one that stood a section ahead of where it
%% took itself to be waited for ever
-module(starl_convoy_tests).
-include_lib("eunit/include/eunit.hrl").

-define(WALL_MM, 185.0).

lane() -> lane("doors").

lane(Plan) ->
    {ok, Floor} = starl_floor_file:read(Plan, 1000),
    route(Floor).

route(Floor) ->
    Profiles = [starl_chassis:profile(starl_chassis_differential, #{})],
    starl_convoy_route:new(Floor, #{profiles => Profiles, section_mm => 600}).

%% From start to goal, in steps of one length, through each door once, and clear of all walls.
lane_test() ->
    {ok, Lane} = lane(),
    {ok, #{places := #{start := Start, goal := Goal}} = Floor} = starl_floor_file:read(
        "doors", 1000
    ),
    Ends = [lists:last(Way) || {Way, _} <- Lane],
    ?assertEqual(Start, hd(Ends)),
    ?assert(starl_geometry:distance(lists:last(Ends), Goal) < 600),
    Steps = [
        starl_geometry:distance(P, Q)
     || {P, Q} <- lists:zip(lists:droplast(Ends), tl(Ends))
    ],
    ?assert(lists:min(Steps) >= 600 andalso lists:max(Steps) < 611),
    ?assertEqual([1, 2, 3], [Door || {_, Door} <- Lane, Door =/= none]),
    Points = lists:append([Way || {Way, _} <- Lane]),
    Walls = starl_walls:new(Floor),
    [
        ?assert(starl_walls:clearance({P, Q}, 300.0, Walls) >= ?WALL_MM - 1.0e-3, {P, Q})
     || {P, Q} <- lists:zip(lists:droplast(Points), tl(Points))
    ].

%% Also one that is under way, or has stopped beside a corner of the lane.
a_robot_finds_its_place_on_the_lane_test() ->
    {ok, Lane} = lane(),
    Ends = [lists:last(Way) || {Way, _} <- Lane],
    [
        begin
            ?assertEqual(I, starl_convoy_place:locate(P, Lane)),
            Part = starl_geometry:interpolate(P, hd(Way), 0.5),
            ?assertEqual(I, starl_convoy_place:locate(Part, Lane))
        end
     || {I, P, {Way, _}} <- lists:zip3(
            lists:seq(0, length(Ends) - 2), lists:droplast(Ends), tl(Lane)
        )
    ].

a_robot_that_does_not_get_on_looks_where_it_stands_test() ->
    {ok, Lane} = lane(),
    {ok, Floor} = starl_floor_file:read("doors", 1000),
    Middle = fun(I) ->
        {Way, _} = lists:nth(I + 1, Lane),
        lists:last(Way)
    end,
    Between = starl_geometry:interpolate(Middle(3), Middle(4), 0.6),
    Next = fun(Refused, Here, Others, Ms) ->
        starl_convoy_place:next(Refused, #{
            lane => Lane, floor => Floor, at => 3, here => Here, others => Others, waited_ms => Ms
        })
    end,
    ?assertEqual(stay, Next(occupied, Middle(3), [Middle(4)], 60000)),
    ?assertEqual({at, 6}, Next(occupied, Middle(6), [], 0)),
    Column = [Middle(I) || I <- lists:seq(4, length(Lane) - 1)],
    ?assertEqual(arrived, Next(occupied, Middle(3), Column, 0)),
    %% one beside it holds it up for long: the one behind drives back, the one ahead lets it
    {X, Y} = Between,
    ?assertEqual(stay, Next(occupied, Between, [{X + 150, Y - 295}], 19999)),
    ?assertMatch(
        {back, #{token := {section, 3}, way := [_]}},
        Next(occupied, Between, [{X + 150, Y - 295}], 20000)
    ),
    ?assertEqual(leave, Next(occupied, Between, [{X - 150, Y - 295}], 20000)),
    %% a wall is between it and the lane
    ?assertEqual(stay, Next(stuck, Middle(3), [], 0)),
    ?assertMatch({at, _}, Next(stuck, {3000.0, 6000.0}, [], 0)),
    %% it touches the post of a door: the way on leads into it, that back does not
    Post = {7358.0, 2157.2},
    {at, Back} = Next(stuck, Post, [], 0),
    ?assertEqual(starl_convoy_place:locate(Post, Lane) - 1, Back).

what_a_plan_lacks_is_told_test() ->
    ?assertEqual(
        {error, "a convoy needs the places `start' and `goal' of the floor plan"}, lane("search")
    ),
    Places = #{start => {500, 500}, goal => {3500, 500}},
    Wall = starl_floor:box(1950, 0, 2050, 1700),
    Floor = starl_floor:new(#{size => {4000, 2000}, walls => [Wall], places => Places}),
    ?assertEqual(
        {error, "no way from `start' to `goal' is wide enough for a robot"},
        route(Floor)
    ).

too_many_test() ->
    {error, Why} = starl_sim:start(#{app => starl_convoy, robots => 11}),
    ?assertEqual(
        "before the first door, or behind the last one, is room for 10 robots: use fewer",
        lists:flatten(starl_sim:format_error(Why))
    ).

%% Nobody drives before the robots stand as far apart as is promised from then on.
robots_begin_as_far_apart_as_is_promised_test() ->
    {ok, Floor} = starl_floor_file:read("doors", 1000),
    {ok, Scene} = starl_convoy:scene(#{
        robots => [1, 2],
        profiles => [starl_chassis:profile(starl_chassis_differential, #{})],
        floor => Floor,
        world => {10000, 10000},
        options => #{section => 600}
    }),
    ?assertMatch(#{apart_mm := 400}, Scene).

%% -- the contract ---------------------------------------------------------------------------

judged(Events) -> judged(Events, []).

judged(Events, Faults) -> judged(Events, [1, 2], Faults).

judged(Events, Robots, Faults) ->
    Lane = [{[{600.0 * I, 0.0}], none} || I <- lists:seq(0, 20)],
    Config = #{robots => Robots, lane => Lane, faults => Faults},
    starl_team_runs:judged(Events, {starl_convoy_monitor, Config}).

at(S, Robot, Door) -> {S * 1000000, Robot, app, {at, 7, Door}}.

stands(S, Robot, X) -> starl_team_runs:standing(S * 1000000, Robot, {X, 0}).

%% Holds: A convoy's excuse ends: who was overtaken in a fault is not to be overtaken later, and
%% who drives to and fro does not move on
%% Red: the monitor of 133c6985: both pass unseen
nobody_overtakes_test() ->
    ?assertMatch({[], #{passes := 2}}, judged([at(1, 1, 3), at(2, 2, 3), stands(3, 1, 0)])),
    ?assertMatch({[overtaken], _}, judged([at(1, 2, 3), at(2, 1, 3), stands(3, 1, 0)])),
    %% at another door, or between doors, that says nothing
    ?assertMatch({[], _}, judged([at(1, 2, 3), at(2, 1, 4), stands(3, 1, 0)])),
    ?assertMatch({[], _}, judged([at(1, 2, none), at(2, 1, none), stands(3, 1, 0)])),
    Fault = [{1, 0, 1000, fault}],
    ?assertMatch({[], _}, judged([at(1, 2, 3), at(2, 1, 3), stands(3, 1, 0)], Fault)),
    ?assertMatch({[overtaken], _}, judged([at(40, 2, 3), at(41, 1, 3), stands(42, 1, 0)], Fault)),
    %% who was overtaken in a fault comes through later, and is not to be overtaken again, or to overtake
    Mixed = [at(20, 2, 3), stands(25, 2, 5000), stands(25, 1, 3000), at(60, 1, 3)],
    Later = Mixed ++ [at(70, 2, 4), at(80, 1, 4), stands(81, 1, 0)],
    ?assertMatch({[], _}, judged(Later, Fault)),
    Again = Mixed ++ [at(70, 1, 4), at(80, 2, 4), stands(81, 1, 0)],
    ?assertMatch({[overtaken], _}, judged(Again, Fault)),
    %% who stood beside each other may go on in either order
    Beside = [stands(25, 2, 3200), stands(25, 1, 3000), at(60, 1, 3), at(61, 2, 3)],
    ?assertMatch({[], _}, judged(Beside ++ [stands(81, 1, 0)], Fault)).

apart_test() ->
    Near = fun(Mm) ->
        [stands(0, 1, 0), stands(0, 2, 5000), stands(2, 2, Mm), stands(4, 2, 5000)]
    end,
    ?assertMatch({[], #{least_mm := 401.0}}, judged(Near(401))),
    ?assertMatch({[too_near], _}, judged(Near(399))),
    ?assertMatch({[], _}, judged(Near(399), [{1, 0, 1000, fault}])).

%% Beside the two, the homes of the tokens of the sections between which they stand.
%% Holds: A robot's fault excuses no two others of a convoy that come too near to each other
%% Red: the monitor of d7c73771, run: passes unseen
a_fault_of_another_robot_excuses_nobody_test() ->
    Team = lists:seq(1, 9),
    Near = [stands(0, 1, 1500), stands(0, 2, 6500), stands(2, 2, 1899), stands(4, 2, 6500)],
    Homes = [starl_mutex:home({section, I}, Team) || I <- [2, 3, 4]],
    Concerned = fun(Robot) -> lists:member(Robot, [all, 1, 2 | Homes]) end,
    [
        ?assertMatch(
            {Robot, {Found, _}} when (Found =:= []) =:= IsExcused,
            {Robot, judged(Near, Team, [{Robot, 0, 1000, fault}])}
        )
     || Robot <- [all | Team], IsExcused <- [Concerned(Robot)]
    ],
    ?assertNotEqual([], Homes -- [1, 2]),
    ?assertNot(lists:all(Concerned, Team)).

somebody_moves_on_test() ->
    ?assertMatch({[], _}, judged([at(100, 1, none), at(219, 2, none), stands(330, 1, 0)])),
    ?assertMatch({[nobody_moves], _}, judged([at(100, 1, none), stands(221, 1, 0)])),
    %% who drives to and fro does not move on
    ?assertMatch({[nobody_moves], _}, judged([at(100, 1, none), at(200, 1, 3), stands(221, 1, 0)])),
    Done = [{S * 1000000, Robot, app, {done, arrived}} || {S, Robot} <- [{2, 1}, {3, 2}]],
    ?assertMatch({[], _}, judged(Done ++ [stands(400, 1, 0)])),
    ?assertMatch({[nobody_moves], _}, judged([hd(Done), stands(400, 1, 0)])),
    ?assertMatch({[], _}, judged([{1000000, 2, robot, {died, killed}}, stands(400, 1, 0)])).

%% -- runs -----------------------------------------------------------------------------------

%% In the end the column stands behind the last door, in its order; a bump would break `contact'.
runs_test_() ->
    [
        {timeout, 120, fun() ->
            Scenario = maps:merge(#{app => starl_convoy, robots => N}, More),
            #{report := #{figures := Figures}, robots := Robots} =
                Outcome = starl_team_runs:both_ways(Scenario),
            ?assertMatch([{there, N}, {passes, _}, {seconds, _}, {least_mm, _}], Figures),
            ?assertEqual(3 * N, proplists:get_value(passes, Figures)),
            %% null is greater than every number
            ?assert(proplists:get_value(least_mm, Figures) > 550),
            Xs = [X || {_, #{pose := {X, Y, _}}} <- Robots, Y > 6000],
            ?assertEqual(N, length(Xs)),
            ?assertEqual(Xs, lists:sort(Xs)),
            ?assertEqual(N =:= 1, starl_team_runs:noted(gap_mm, Outcome) =:= [])
        end}
     || {N, More} <- [
            {1, #{}}, {4, #{chassis => mixed}}, {10, #{}}, {4, #{loss => 0.2, seed => 7}}
        ]
    ].

%% A robot whose application is killed again and again goes on where it is.
restarts_test_() ->
    {timeout, 120, fun() ->
        Kills = [
            {
                list_to_atom("k" ++ integer_to_list(S)),
                1000 * S,
                1000 * S,
                kill_machine,
                {2, app},
                #{}
            }
         || S <- lists:seq(3, 45, 3)
        ],
        #{report := #{figures := Figures}, violations := []} = starl_team_runs:outcome(#{
            app => starl_convoy, robots => 3, faults => Kills
        }),
        ?assertEqual(3, proplists:get_value(there, Figures))
    end}.

%% A robot that begins anew while it takes itself for another one wants to drive through the others: it gives up, and
%% finds its place.
a_robot_that_was_misled_finds_its_place_test_() ->
    {timeout, 120, fun() ->
        #{report := #{figures := Figures}, violations := []} = starl_team_runs:outcome(#{
            app => starl_convoy,
            robots => 4,
            faults => [
                {swap, 6000, 9000, location_swap, {4, 2}, #{}},
                {kill, 7000, 7000, kill_machine, {4, app}, #{}}
            ]
        }),
        ?assertEqual(4, proplists:get_value(there, Figures))
    end}.

%% Wrong positions have mixed up the column: the one behind does not wait for a place behind another one, which has come to
%% stay before it.
%% Holds: A convoy that wrong positions have mixed up arrives, and one that they have led behind a
%% wall comes back to the lane
%% Red: cd3d8cf0, run: `nobody moves`
a_column_that_is_mixed_up_arrives_test_() ->
    {timeout, 120, fun() ->
        #{report := #{figures := Figures}, violations := []} = starl_team_runs:outcome(#{
            app => starl_convoy,
            robots => 6,
            seed => 3100032,
            clock_offset => 0,
            clock_drift => 0,
            distance_error => 0.0,
            faults => [
                {one, 16032, 22134, location_swap, {5, 1}, #{}},
                {two, 4079, 9704, location_swap, {5, 6}, #{}}
            ]
        }),
        ?assertEqual(6, proplists:get_value(there, Figures))
    end}.

%% Wrong positions have left two robots beside each other between two sections, each in the way of the other; or one at the
%% post of a door; or behind a door whose middle it has not come to.
%% Holds: Two robots of a convoy that stand in each other's way between two sections get on, and
%% one at the post of a door does, and one behind a door whose middle it has not come to
%% Red: 133c6985, run: `nobody moves` (seeds 8800199 and 8800071)
who_is_in_the_way_gets_on_test_() ->
    [
        {timeout, 60, fun() ->
            #{report := #{figures := Figures}, violations := []} = starl_team_runs:outcome(More#{
                app => starl_convoy,
                robots => N,
                seed => Seed,
                time => 300,
                heal => 25
            }),
            ?assertEqual(N, proplists:get_value(there, Figures))
        end}
     || {N, Seed, More} <- [
            {5, 8800199, drifts(#{loss => 0.1, longest_fault => 8})},
            {7, 8800071, drifts(#{loss => 0.05, longest_fault => 25})},
            {10, 9900059, #{random_faults => [all], longest_fault => 25}}
        ]
    ].

drifts(More) -> More#{clock_drift => 9999, random_faults => starl_team_runs:borne()}.
