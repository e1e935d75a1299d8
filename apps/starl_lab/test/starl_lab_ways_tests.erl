-module(starl_lab_ways_tests).
-include_lib("eunit/include/eunit.hrl").

-define(WORLD, {4000, 3000}).

%% Robot 1 stands, robot 2 passes it at 300 mm after one second.
least_test() ->
    Pieces = [{1, stands(0, 1000.0, 1300.0)}, {2, drives(0, 500.0, 1000.0, 0.0, 500.0)}],
    {Mm, At, {1, 2}} = starl_lab_ways:least(ways(Pieces, 2000000)),
    ?assert(abs(Mm - 300.0) < 1.0e-6),
    ?assertEqual(1000000, At),
    ?assertEqual(none, starl_lab_ways:least(ways([hd(Pieces)], 2000000))).

%% It leaves the floor at its left edge after two seconds, and is 500 mm off at the end.
off_floor_test() ->
    Out = [{2, drives(0, 1000.0, 1000.0, math:pi(), 500.0)}, {1, stands(0, 10.0, 10.0)}],
    [{2, At, Mm}] = starl_lab_ways:off_floor(ways(Out, 3000000)),
    ?assert(abs(At - 2000000) =< 1),
    ?assert(abs(Mm - 500.0) < 1.0e-6),
    ?assertEqual([], starl_lab_ways:off_floor(ways(Out, 1999000))),
    %% a robot that comes back on an arc was off all the same, and later than the one beside it
    Arc = starl_trajectory:piece(0, {2000.0, 2800.0}, 0.0, 500.0, 1.0),
    Corner = {3, drives(0, 3990.0, 2990.0, math:pi() / 4, 500.0)},
    [{3, _, Far}, {1, First, Top}] = starl_lab_ways:off_floor(ways([{1, Arc}, Corner], 6283185)),
    ?assert(abs(First - round(math:acos(1 - 200 / 500) * 1.0e6)) < 10),
    ?assert(Top > 799.0 andalso Top =< 800.001),
    ?assert(Far > 3000.0).

csv_test() ->
    Pieces = [
        {1, stands(0, 1000.0, 1000.0)},
        {2, drives(0, 500.0, 500.0, 0.0, 500.0)},
        {2, starl_trajectory:standing(2000000, {1500.0, 500.0}, 0.0)},
        {1, stands(0, 1100.0, 1000.0)}
    ],
    ?assertEqual(
        <<
            "time_s,robot,x_mm,y_mm,heading_rad\n"
            "0.000000,1,1100.0,1000.0,0.0000\n"
            "0.000000,2,500.0,500.0,0.0000\n"
            "2.000000,2,1500.0,500.0,0.0000\n"
            "3.000000,1,1100.0,1000.0,0.0000\n"
            "3.000000,2,1500.0,500.0,0.0000\n"
        >>,
        unicode:characters_to_binary(starl_lab_ways:csv(ways(Pieces, 3000000)))
    ).

%% Between the rows of an arc and of a ramp a robot is within 2 mm of a straight, even drive.
csv_is_exact_test() ->
    [
        begin
            Rows = rows(ways([{1, Piece}], 4000000)),
            ?assert(length(Rows) > 3),
            [
                begin
                    T = (T1 + T2) / 2,
                    {X, Y} = starl_trajectory:position(round(T * 1.0e6), Piece),
                    Off = starl_geometry:distance({X, Y}, {(X1 + X2) / 2, (Y1 + Y2) / 2}),
                    ?assert(Off < 2.2, {T1, T2, Off})
                end
             || {[T1, X1, Y1], [T2, X2, Y2]} <- lists:zip(lists:droplast(Rows), tl(Rows))
            ]
        end
     || Piece <- [
            starl_trajectory:piece(0, {1000.0, 1000.0}, 0.0, 500.0, 1.0),
            starl_trajectory:ramp(0, {0.0, 0.0}, 0.0, {500.0, 0.0}, {0.0, 500.0}, 1500000)
        ]
    ].

rows(Ways) ->
    [_ | Lines] = string:lexemes(unicode:characters_to_list(starl_lab_ways:csv(Ways)), "\n"),
    [
        [list_to_float(N) || N <- [T, X, Y]]
     || Line <- Lines, [T, _, X, Y, _] <- [string:split(Line, ",", all)]
    ].

%% Beyond their number pieces are not kept, and the notes say so.
cut_test() ->
    {ok, One} = starl_run_paths_monitor:step(
        {0, 1, chassis, {motion, stands(0, 1.0, 1.0)}}, starl_run_paths_monitor:init(#{most => 1})
    ),
    {ok, Two} = starl_run_paths_monitor:step({5, 1, chassis, {motion, stands(5, 1.0, 1.0)}}, One),
    ?assertMatch({ok, #{is_whole := true}}, starl_run_paths_monitor:finish(9, One)),
    ?assertMatch(
        {ok, #{is_whole := false, until_us := 5, pieces := [_]}},
        starl_run_paths_monitor:finish(9, Two)
    ).

stands(T, X, Y) -> starl_trajectory:standing(T, {X, Y}, 0.0).

drives(T, X, Y, Heading, V) -> starl_trajectory:piece(T, {X, Y}, Heading, V, 0.0).

ways(Pieces, Until) ->
    starl_lab_ways:new(#{pieces => Pieces, until_us => Until, is_whole => true}, ?WORLD).
