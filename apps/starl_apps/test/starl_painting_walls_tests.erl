%% Painting among walls: robots paint what they can reach of a picture, and the rest is told.
%%
%% Holds: What of a picture is in walls or behind them is told, the rest is painted, and no wall is
%% touched
%% Red: with pieces that keep no distance, run
-module(starl_painting_walls_tests).
-include_lib("eunit/include/eunit.hrl").

%% Lines through the wall, beside it, in a closet that has no door, and one that is free.
svg() ->
    <<
        "<svg xmlns='http://www.w3.org/2000/svg' viewBox='0 0 5000 3000'>"
        "<path stroke='black' fill='none' d='M400 1500H4000M1000 600H2000M4750 800V2000'/></svg>"
    >>.

%% Two rooms with a door, and a closet that nobody can enter.
closet() ->
    starl_floor:new(#{
        size => {5000, 3000},
        walls => [
            starl_floor:box(2450, 0, 2550, 1800),
            starl_floor:box(2450, 2500, 2550, 3000),
            starl_floor:box(4400, 0, 4500, 3000)
        ],
        rooms => #{closet => starl_floor:box(4500, 0, 5000, 3000)}
    }).

fitted() ->
    {ok, Picture} = starl_picture:parse(svg(), #{
        area => {0, 0, 5000, 3000}, tolerance_mm => 2.0, max_segments => 100
    }),
    starl_painting_walls:fit(Picture, closet(), #{
        robots => 2, tube_radius => 200.0, wall_mm => 181.0, lines => [], near => {500.0, 500.0}
    }).

what_can_be_painted_keeps_away_from_walls_test() ->
    {ok, _Ways, Picture, _Lost} = fitted(),
    Walls = starl_walls:new(closet()),
    Lines = starl_picture:segments(Picture),
    ?assertEqual(3, length(Lines)),
    [?assert(starl_walls:is_free(Line, 181.0, Walls)) || Line <- Lines].

%% The wall and 181 mm on both sides, in steps of 20 mm; the closet is 1.2 m of line.
what_is_left_out_is_told_test() ->
    {ok, _Ways, _Picture, #{walls_mm := At, far_mm := Far} = Lost} = fitted(),
    ?assert(At >= 2 * 181 + 100 andalso At =< 2 * 181 + 100 + 60),
    ?assert(abs(Far - 1200) < 1),
    [Line] = starl_painting_walls:left_out(Lost),
    ?assertEqual(
        "cannot be painted: 0.5 m in walls or too near to them; 1.2 m out of reach, in closet",
        lists:flatten(Line)
    ).

nothing_is_told_where_all_is_painted_test() ->
    ?assertEqual([], starl_painting_walls:left_out(none)),
    ?assertEqual(
        [], starl_painting_walls:left_out(#{walls_mm => 0.0, far_mm => 0.0, rooms => []})
    ).

%% No contract is broken, and all that can be painted is: also with a door that is closed meanwhile.
paints_among_walls_test_() ->
    [
        {timeout, 120, fun() ->
            {ok, Sim} = starl_sim:start(#{
                app => starl_painting,
                floor => "two_rooms",
                robots => N,
                chassis => Chassis,
                time => 900,
                faults => Faults
            }),
            _ = starl_sim:run(Sim),
            {#{violations := Violations}, #{complete := Complete}} = starl_sim:finish(Sim),
            ?assertEqual({N, Chassis, [], true}, {N, Chassis, Violations, Complete})
        end}
     || {N, Chassis} <- [{1, differential}, {2, holonomic}, {3, mixed}],
        Faults <- [[], [{shut, 3000, 90000, closed, all, #{door => 1}}]]
    ].
