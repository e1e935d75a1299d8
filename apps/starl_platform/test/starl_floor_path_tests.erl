%% Paths around walls: they keep their distance, are hardly longer than the shortest, and lead where there is one.
-module(starl_floor_path_tests).
-include_lib("eunit/include/eunit.hrl").

-define(MM, 181.0).

%% A wall of 100 mm that leaves a gap at the top.
wall() -> starl_floor:new(#{size => {6000, 3000}, walls => [starl_floor:box(2950, 0, 3050, 2000)]}).

a_straight_line_is_the_path_where_it_is_free_test() ->
    ?assertEqual(
        {ok, [{2000, 500}]}, starl_floor_path:find({{500, 500}, {2000, 500}}, ?MM, wall())
    ).

%% The shortest path is a rope around two discs at the corners of the wall's end.
a_path_is_hardly_longer_than_a_rope_test() ->
    {From, To} = Ends = {{1000.0, 500.0}, {5000.0, 500.0}},
    {ok, Points} = starl_floor_path:find(Ends, ?MM, wall()),
    Rope = 2 * rope(From, {2950.0, 2000.0}, ?MM) + 100.0,
    Length = length_mm([From | Points]),
    ?assertEqual(To, lists:last(Points)),
    ?assert(Length >= Rope - 1.0),
    ?assert(Length =< 1.03 * Rope, {Length, Rope}).

%% From a point to the top of a disc: a tangent and an arc.
rope({X, Y}, {CX, CY}, R) ->
    D = math:sqrt((CX - X) * (CX - X) + (CY - Y) * (CY - Y)),
    Tangent = math:sqrt(D * D - R * R),
    %% the direction of the tangent is the angle by which the rope is turned when it reaches the top
    Angle = math:atan2(CY - Y, CX - X) + math:asin(R / D),
    Tangent + R * Angle.

every_piece_keeps_its_distance_test_() -> {timeout, 120, fun every_piece_keeps_its_distance/0}.

every_piece_keeps_its_distance() ->
    Seed = seed(),
    _ = rand:seed(exsss, Seed),
    Floor = starl_floor:new(#{
        size => {8000, 6000},
        walls => [
            starl_floor:box(2000, 0, 2100, 2500),
            starl_floor:box(2000, 3300, 2100, 6000),
            starl_floor:box(4000, 1000, 5500, 1100),
            starl_floor:box(5400, 1100, 5500, 4000),
            starl_floor:box(4000, 4500, 7000, 4600),
            [{3000, 3000}, {3800, 3800}, {3000, 4600}]
        ]
    }),
    Walls = starl_walls:new(Floor),
    Free = fun(Line) -> starl_walls:is_free(Line, ?MM, Walls) end,
    Around = [
        begin
            {ok, Points} = Found,
            ?assertEqual(To, lists:last(Points)),
            [?assert(Free(Line), {Seed, From, To}) || Line <- legs([From | Points])],
            length(Points)
        end
     || _ <- lists:seq(1, 80),
        From <- [place()],
        To <- [place()],
        Free({From, From}),
        Free({To, To}),
        Found <- [starl_floor_path:find({From, To}, ?MM, Floor)]
    ],
    ?assert(length(Around) > 15),
    ?assert(lists:max(Around) > 2).

place() -> {8000 * rand:uniform(), 6000 * rand:uniform()}.

legs(Points) -> lists:zip(lists:droplast(Points), tl(Points)).

length_mm(Points) -> lists:sum([starl_geometry:distance(A, B) || {A, B} <- legs(Points)]).

%% A door is wide enough, or it is not; whoever is shut in gets nowhere.
doors_test() ->
    Door = fun(Mm) ->
        starl_floor:new(#{
            size => {4000, 3000},
            walls => [
                starl_floor:box(1950, 0, 2050, 1000),
                starl_floor:box(1950, 1000 + Mm, 2050, 3000)
            ]
        })
    end,
    Ends = {{500, 2500}, {3500, 2500}},
    [
        ?assertMatch({Mm, {ok, [_, _ | _]}}, {Mm, starl_floor_path:find(Ends, ?MM, Door(Mm))})
     || Mm <- [440, 700]
    ],
    [
        ?assertEqual({Mm, {error, unreachable}}, {Mm, starl_floor_path:find(Ends, ?MM, Door(Mm))})
     || Mm <- [0, 100, 361]
    ].

%% Through a slanted gap, however narrow, a path keeps its distance, or there is none.
a_narrow_passage_keeps_its_distance_test() ->
    From = {500.0, 500.0},
    Found = [
        begin
            Walls = starl_walls:new(Floor),
            [
                ?assert(starl_walls:is_free(Line, ?MM, Walls), {Mm, Y})
             || Line <- legs([From | Points])
            ]
        end
     || Mm <- lists:seq(364, 460, 4),
        Y <- lists:seq(1000, 1050, 10),
        Floor <- [
            starl_floor:new(#{
                size => {4000, 4000},
                walls => [[{1500, 0}, {2000, Y}], [{2000 - Mm * 0.6, Y + Mm * 0.8}, {1500, 4000}]]
            })
        ],
        {ok, Points} <- [starl_floor_path:find({From, {3500, 3500}}, ?MM, Floor)]
    ],
    ?assert(length(Found) > 20).

a_goal_at_a_wall_is_unreachable_test() ->
    ?assertEqual(
        {error, unreachable}, starl_floor_path:find({{500, 500}, {2800, 500}}, ?MM, wall())
    ),
    ?assertEqual(
        {error, unreachable}, starl_floor_path:find({{500, 500}, {7000, 500}}, ?MM, wall())
    ).

%% A robot that touches a wall leaves it, and never gets nearer.
from_a_wall_test() ->
    Floor = wall(),
    Walls = starl_walls:new(Floor),
    From = {2783.0, 500.0},
    {ok, Points} = starl_floor_path:find({From, {5000, 500}}, ?MM, Floor),
    [First | Others] = legs([From | Points]),
    ?assert(starl_walls:is_free(First, 165.0, Walls)),
    [?assert(starl_walls:is_free(Line, ?MM, Walls)) || Line <- Others].

seed() ->
    case os:getenv("STARL_SEED") of
        false ->
            Seed = erlang:phash2(make_ref(), 1 bsl 24),
            ?debugFmt("seed ~b; the same again with STARL_SEED=~b", [Seed, Seed]),
            Seed;
        Text ->
            list_to_integer(Text)
    end.
