%% @doc Contracts: path data is read by the grammar of SVG 1.1 (8.3.9), a mistake is an error with
%% its offset, and the pen draws what the commands say, relative or absolute.
-module(starl_svg_path_tests).

-include_lib("eunit/include/eunit.hrl").

grammar_test_() ->
    [
        ?_assertEqual({Text, {ok, Commands}}, {Text, parse(Text)})
     || {Text, Commands} <- [
            {<<>>, []},
            {<<" \n ">>, []},
            {<<"none">>, []},
            {<<"M1 2">>, [{$M, [1.0, 2.0]}]},
            {<<"M1-2.5.5e-3-4">>, [{$M, [1.0, -2.5]}, {$L, [0.0005, -4.0]}]},
            {<<"m1,2,3,4 5 6">>, [{$m, [1.0, 2.0]}, {$l, [3.0, 4.0]}, {$l, [5.0, 6.0]}]},
            {<<"M0 0H1 2V3,4">>, [
                {$M, [0.0, 0.0]}, {$H, [1.0]}, {$H, [2.0]}, {$V, [3.0]}, {$V, [4.0]}
            ]},
            {<<"M0,0zM1 1Z">>, [{$M, [0.0, 0.0]}, {$z, []}, {$M, [1.0, 1.0]}, {$Z, []}]},
            {<<"M0 0a1 1 0 01.5.5">>, [{$M, [0.0, 0.0]}, {$a, [1.0, 1.0, 0.0, 0.0, 1.0, 0.5, 0.5]}]},
            {<<"M0 0a1 1 0 1 0-1-1 1,1,0,0,1,2,2">>, [
                {$M, [0.0, 0.0]},
                {$a, [1.0, 1.0, 0.0, 1.0, 0.0, -1.0, -1.0]},
                {$a, [1.0, 1.0, 0.0, 0.0, 1.0, 2.0, 2.0]}
            ]},
            {<<"M0 0c1 2 3 4 5 6S1 2 3 4Q1 2 3 4t1 2">>, [
                {$M, [0.0, 0.0]},
                {$c, [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]},
                {$S, [1.0, 2.0, 3.0, 4.0]},
                {$Q, [1.0, 2.0, 3.0, 4.0]},
                {$t, [1.0, 2.0]}
            ]}
        ]
    ].

errors_test_() ->
    [
        ?_assertEqual({Text, {error, Why}}, {Text, parse(Text)})
     || {Text, Why} <- [
            {<<"L1 1">>, {0, expected_moveto}},
            {<<"  5">>, {2, expected_moveto}},
            {<<"M1">>, {2, expected_number}},
            {<<"M1 2 3">>, {6, expected_number}},
            {<<"M,1 2">>, {1, expected_number}},
            {<<"M1 2,L3 4">>, {5, expected_number}},
            {<<"M1 2,">>, {5, expected_number}},
            {<<"M1 2 X">>, {5, expected_command}},
            {<<"M1 2z3">>, {5, expected_command}},
            {<<"M0 0a1 1 0 2 0 1 1">>, {11, expected_flag}},
            {<<"M0 0L1e20 0">>, {5, out_of_range}},
            {<<"M0 0", 255, 254>>, {4, expected_command}}
        ]
    ].

limit_test() ->
    ?assertEqual({error, too_many}, starl_svg_path:parse(<<"M0 0 1 1 2 2 3 3">>, 3)),
    ?assertMatch({ok, [_, _, _, _]}, starl_svg_path:parse(<<"M0 0 1 1 2 2 3 3">>, 4)).

%% A relative command draws what the absolute one with the pen's place added draws.
relative_test_() ->
    [
        ?_test(same(Relative, Absolute))
     || {Relative, Absolute} <- [
            {<<"m10 20">>, <<"M10 20">>},
            {<<"l1 2 3 4">>, <<"L11 22 14 26">>},
            {<<"h5v6h-5">>, <<"H15V26H10">>},
            {<<"m3 4l1 1z l2 2">>, <<"M13 24L14 25Z L15 26">>},
            {<<"c1 2 3 4 5 6s1 2 3 4">>, <<"C11 22 13 24 15 26S16 28 18 30">>},
            {<<"q1 2 3 4t5 6t1 1">>, <<"Q11 22 13 24T18 30T19 31">>},
            {<<"a5 3 30 0 1 4 2a5 3 30 1 0 4 2">>, <<"A5 3 30 0 1 14 22A5 3 30 1 0 18 24">>}
        ]
    ].

%% The smooth commands mirror the last control point of their own kind, else start from the pen.
smooth_test_() ->
    [
        ?_test(same(Short, Long))
     || {Short, Long} <- [
            {<<"C1 2 3 4 5 6S7 8 9 10">>, <<"C1 2 3 4 5 6C7 8 7 8 9 10">>},
            {<<"S7 8 9 10">>, <<"C10 20 7 8 9 10">>},
            {<<"Q1 2 3 4S7 8 9 10">>, <<"Q1 2 3 4C3 4 7 8 9 10">>},
            {<<"Q1 2 3 4T9 10">>, <<"Q1 2 3 4Q5 6 9 10">>},
            {<<"T9 10T11 12">>, <<"Q10 20 9 10Q8 0 11 12">>},
            {<<"C1 2 3 4 5 6T9 10">>, <<"C1 2 3 4 5 6Q5 6 9 10">>}
        ]
    ].

subpaths_test_() ->
    [
        ?_assertEqual({Text, Expected}, {Text, outlines(Text)})
     || {Text, Expected} <- [
            {<<"M1 1M2 2">>, []},
            {<<"M0 0L1 0L1 1Z">>, [
                [
                    {line, {0.0, 0.0}, {1.0, 0.0}},
                    {line, {1.0, 0.0}, {1.0, 1.0}},
                    {line, {1.0, 1.0}, {0.0, 0.0}}
                ]
            ]},
            {<<"M0 0H1ZV2">>, [
                [{line, {0.0, 0.0}, {1.0, 0.0}}, {line, {1.0, 0.0}, {0.0, 0.0}}],
                [{line, {0.0, 0.0}, {0.0, 2.0}}]
            ]},
            {<<"M0 0H1M5 5V6">>, [
                [{line, {0.0, 0.0}, {1.0, 0.0}}], [{line, {5.0, 5.0}, {5.0, 6.0}}]
            ]}
        ]
    ].

same(A, B) ->
    ?assertEqual(outlines(<<"M10 20", B/binary>>), outlines(<<"M10 20", A/binary>>)).

outlines(Text) ->
    {ok, Commands} = parse(Text),
    starl_svg_shape:drawn(Commands).

parse(Text) -> starl_svg_path:parse(Text, 1000).
