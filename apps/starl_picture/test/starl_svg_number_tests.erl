%% @doc Contract: numbers, lists and lengths are read as SVG 1.1 (8.3.9 and 7.10) writes them, and
%% nothing out of range gets past.
-module(starl_svg_number_tests).

-include_lib("eunit/include/eunit.hrl").

scan_test_() ->
    [
        ?_assertEqual({Text, {ok, Value, Rest}}, {Text, starl_svg_number:scan(Text)})
     || {Text, Value, Rest} <- [
            {<<"1">>, 1.0, <<>>},
            {<<"-2.5.5e-3">>, -2.5, <<".5e-3">>},
            {<<".5e-3">>, 0.0005, <<>>},
            {<<"+.25E+2x">>, 25.0, <<"x">>},
            {<<"1-2">>, 1.0, <<"-2">>},
            {<<"1em">>, 1.0, <<"em">>},
            {<<"1e+">>, 1.0, <<"e+">>},
            {<<"007">>, 7.0, <<>>},
            {<<"1.">>, 1.0, <<>>},
            {<<"1e-999999999999">>, 0.0, <<>>},
            {<<"0e999999999999">>, 0.0, <<>>},
            {<<"1000000000">>, 1.0e9, <<>>}
        ]
    ].

%% A decimal text and its float differ by rounding only.
precise_test_() ->
    [
        ?_assert(abs(Value - element(2, starl_svg_number:scan(Text))) =< abs(Value) * 1.0e-15)
     || {Text, Value} <- [
            {<<"0.1000000000000000055511151231257827">>, 0.1},
            {<<"3.14159265358979">>, 3.14159265358979},
            {<<"123456789.123456789123456789">>, 123456789.12345679},
            {<<"00000000000000000000000000000001.5">>, 1.5}
        ]
    ].

not_a_number_test_() ->
    [
        ?_assertEqual({Text, {error, not_a_number}}, {Text, starl_svg_number:scan(Text)})
     || Text <- [<<>>, <<"-">>, <<".">>, <<"+.">>, <<"e5">>, <<"x">>, <<"--1">>, <<"NaN">>]
    ].

out_of_range_test_() ->
    Long = binary:copy(<<"9">>, 10000),
    [
        ?_assertEqual({error, out_of_range}, starl_svg_number:scan(Text))
     || Text <- [<<"1e10">>, <<"1000000001">>, <<"-1e999999">>, Long]
    ].

list_test_() ->
    [
        ?_assertEqual({ok, [1.0, -2.5, 0.5, 0.005]}, starl_svg_number:list(<<"1-2.5.5 5e-3">>)),
        ?_assertEqual({ok, [1.0, 2.0, 3.0]}, starl_svg_number:list(<<" 1,2 , 3\n">>)),
        ?_assertEqual({ok, []}, starl_svg_number:list(<<" \t">>)),
        ?_assertEqual({error, not_a_number}, starl_svg_number:list(<<"1,,2">>)),
        ?_assertEqual({error, not_a_number}, starl_svg_number:list(<<"1,2,">>)),
        ?_assertEqual({error, not_a_number}, starl_svg_number:list(<<"1;2">>))
    ].

length_test_() ->
    [
        ?_test(begin
            {ok, Value} = starl_svg_number:length(Text, 200.0),
            ?assert(abs(Value - Expected) < 1.0e-9, Text)
        end)
     || {Text, Expected} <- [
            {<<"10">>, 10.0},
            {<<" 10px ">>, 10.0},
            {<<"25.4mm">>, 96.0},
            {<<"2.54cm">>, 96.0},
            {<<"1in">>, 96.0},
            {<<"72pt">>, 96.0},
            {<<"6pc">>, 96.0},
            {<<"50%">>, 100.0},
            {<<"1em">>, 16.0},
            {<<"-3e1px">>, -30.0}
        ]
    ].

bad_length_test_() ->
    [
        ?_assertEqual({error, Why}, starl_svg_number:length(Text, 100.0))
     || {Text, Why} <- [
            {<<"10 furlongs">>, not_a_number},
            {<<>>, not_a_number},
            {<<"px">>, not_a_number},
            {<<"1000000000in">>, out_of_range}
        ]
    ].
