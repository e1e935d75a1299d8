%% Ways on a floor with walls: through every door that is wide enough, around all walls, and with
%% robots that park out of each other's way.
-module(starl_dpp_floor_tests).
-include_lib("eunit/include/eunit.hrl").

-define(R, 181.0).

%% Two rooms, 6 m x 3 m, with a door of this width in the wall between them.
rooms(Door) ->
    starl_floor:new(#{
        size => {6000, 3000},
        walls => [
            starl_floor:box(2950, 0, 3050, 1500 - Door / 2),
            starl_floor:box(2950, 1500 + Door / 2, 3050, 3000)
        ]
    }).

-define(WEST, {{1000.0, 1500.0}, {2000.0, 1500.0}}).
-define(EAST, {{4000.0, 1500.0}, {5000.0, 1500.0}}).

ways(Floor, Lines, Robots) ->
    starl_dpp_floor:new(Floor, #{
        robots => Robots,
        tube_radius => ?R,
        wall_mm => ?R,
        lines => Lines,
        near => {500.0, 500.0}
    }).

a_door_wide_enough_is_a_way_test() ->
    [
        begin
            {ok, _, #{reached := Reached, lost := Lost}} = ways(rooms(Door), [?WEST, ?EAST], 2),
            ?assertEqual({Door, Expected}, {Door, {length(Reached), length(Lost)}})
        end
     || {Door, Expected} <- [{1000, {2, 0}}, {500, {2, 0}}, {360, {1, 1}}, {0, {1, 1}}]
    ].

%% Every leg keeps away from the walls, and spots are apart.
no_way_comes_near_a_wall_test() ->
    {ok, #{points := Points, edges := Edges, spots := Spots}, _} = ways(
        rooms(600), [?WEST, ?EAST], 4
    ),
    Walls = starl_walls:new(rooms(600)),
    All = list_to_tuple(Points),
    Legs =
        [{element(A, All), element(B, All)} || {A, B} <- Edges] ++
            [{P, element(Foot, All)} || {P, Foot} <- Spots],
    ?assertEqual([], [Leg || Leg <- Legs, not starl_walls:is_free(Leg, ?R, Walls)]),
    ?assertEqual([], [
        {P, Q}
     || {P, _} <- Spots, {Q, _} <- Spots, P < Q, starl_geometry:distance(P, Q) < 2 * ?R
    ]).

%% The abstract world checks that tubes are disjoint; here, that they keep away from the walls.
robots_do_all_work_test_() ->
    Seed = seed(),
    [
        {timeout, 120, fun() ->
            Floor = rooms(600),
            Lines = [?WEST, ?EAST, {{4000.0, 600.0}, {5000.0, 2400.0}}],
            {ok, Ways, #{lost := []}} = ways(Floor, Lines, N),
            Walls = starl_walls:new(Floor),
            Plan = #{
                segments => Lines,
                world => {6000.0, 3000.0},
                robots => lists:seq(1, N),
                tube_radius => ?R,
                slack => 10.0,
                patience => infinity,
                ways => Ways
            },
            #{counts := #{free := Free, assigned := Assigned}} = starl_dpp_world:run(#{
                plan => Plan,
                interrupt => 0.05,
                seed => Seed + N,
                trace => fun(_, _, P, _) -> ok = keeps_away(P, Walls) end
            }),
            ?assertEqual({Seed, N, 0, 0}, {Seed, N, Free, Assigned})
        end}
     || N <- [1, 2, 4, 8]
    ].

%% A robot that was stopped may be off its path by the slack.
keeps_away(Plan, Walls) ->
    [] = [
        {Robot, Leg}
     || {Robot, Legs} <- starl_dpp_plan:unsafe(Plan),
        Leg <- Legs,
        starl_walls:clearance(Leg, ?R, Walls) < ?R - 11.0
    ],
    ok.

seed() ->
    case os:getenv("STARL_SEED") of
        false -> erlang:phash2(make_ref(), 1 bsl 24);
        Text -> list_to_integer(Text)
    end.

too_little_room_is_told_test() ->
    Line = fun(Floor, N) ->
        {error, Reason} = ways(Floor, [], N),
        lists:flatten(starl_dpp_floor:format_error(Reason))
    end,
    ?assertMatch(
        "the floor has parking spots out of everybody's way for " ++ _, Line(rooms(600), 90)
    ),
    ?assertMatch("there is no room for a robot" ++ _, Line(starl_floor:empty({300, 5000}), 1)).
