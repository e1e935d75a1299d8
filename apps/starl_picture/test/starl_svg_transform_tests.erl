%% @doc Contract: a transform attribute maps points as SVG 1.1 (7.6) says.
-module(starl_svg_transform_tests).

-include_lib("eunit/include/eunit.hrl").

functions_test_() ->
    [
        ?_test(check(Text, From, To))
     || {Text, From, To} <- [
            {<<>>, {1.0, 2.0}, {1.0, 2.0}},
            {<<"none">>, {1.0, 2.0}, {1.0, 2.0}},
            {<<"translate(10)">>, {1.0, 2.0}, {11.0, 2.0}},
            {<<"translate(10,-20)">>, {1.0, 2.0}, {11.0, -18.0}},
            {<<"scale(2)">>, {1.0, 2.0}, {2.0, 4.0}},
            {<<"scale(2 3)">>, {1.0, 2.0}, {2.0, 6.0}},
            {<<"rotate(90)">>, {1.0, 0.0}, {0.0, 1.0}},
            {<<"rotate(90 1 1)">>, {2.0, 1.0}, {1.0, 2.0}},
            {<<"skewX(45)">>, {1.0, 2.0}, {3.0, 2.0}},
            {<<"skewY(45)">>, {1.0, 2.0}, {1.0, 3.0}},
            {<<"matrix(1 2 3 4 5 6)">>, {1.0, 1.0}, {9.0, 12.0}},
            {<<"matrix(1-2.5.5,4 5 6)">>, {2.0, 2.0}, {8.0, 9.0}}
        ]
    ].

%% The last function of a list is the first to act.
order_test_() ->
    [
        ?_test(check(Text, {1.0, 0.0}, To))
     || {Text, To} <- [
            {<<"translate(10) scale(2)">>, {12.0, 0.0}},
            {<<"scale(2),translate(10)">>, {22.0, 0.0}},
            {<<"  rotate(90)\n translate ( 1 , 0 ) ">>, {0.0, 2.0}}
        ]
    ].

bad_test_() ->
    [
        ?_assertEqual({Text, {error, Why}}, {Text, starl_svg_transform:parse(Text)})
     || {Text, Why} <- [
            {<<"spin(3)">>, syntax},
            {<<"scale">>, syntax},
            {<<"scale(1">>, syntax},
            {<<"scale()">>, syntax},
            {<<"scale(1 2 3)">>, syntax},
            {<<"matrix(1 2 3 4 5)">>, syntax},
            {<<"rotate(1 2)">>, syntax},
            {<<"scale(x)">>, syntax},
            {<<"nonesuch">>, syntax},
            {<<"scale(1) 5">>, syntax},
            {<<"scale(1e30)">>, out_of_range},
            {<<"skewX(90)">>, out_of_range},
            {<<"scale(1e9) scale(1e9)">>, out_of_range}
        ]
    ].

check(Text, From, {X, Y}) ->
    {ok, Matrix} = starl_svg_transform:parse(Text),
    {GotX, GotY} = starl_svg_transform:apply(Matrix, From),
    ?assert(abs(GotX - X) < 1.0e-9 andalso abs(GotY - Y) < 1.0e-9, {Text, {GotX, GotY}}).
