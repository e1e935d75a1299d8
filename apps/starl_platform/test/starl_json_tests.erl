%% Holds: All JSON is written alike, objects of pairs in their order
%% Red: with an array that begins with JSON taken for an object, run
-module(starl_json_tests).
-include_lib("eunit/include/eunit.hrl").

%% What is written is read as it was, by the library.
read_back_test_() ->
    [
        ?_assertEqual({ok, Value}, starl_json:decode(written(Value)))
     || Value <- [
            1,
            -1.5,
            1.0e-7,
            12345678901234567,
            true,
            null,
            [],
            [[1, [2.5, <<"x">>]], <<>>],
            #{<<"a">> => [1], <<"b \"c\"">> => #{}},
            <<"\\ \" \n \t", 0, 31, 127>>,
            <<"ä € 𝄞"/utf8>>
        ]
    ].

words_test() ->
    ?assertEqual(<<"[\"pen\",true,{\"a\":1}]">>, written([pen, true, #{a => 1}])).

an_object_of_pairs_keeps_their_order_test_() ->
    Pairs = [{b, 1}, {<<"a">>, []}, {c, [[{d, [1, 2]}]]}],
    Text = <<"{\"b\":1,\"a\":[],\"c\":[{\"d\":[1,2]}]}">>,
    [
        ?_assertEqual(Text, written(Pairs)),
        ?_assertEqual(Text, written({Pairs})),
        ?_assertEqual(<<"{}">>, written({[]}))
    ].

a_float_has_the_decimals_that_are_asked_for_test() ->
    Values = [{0.1234567, 2}, 0.1234567, 3.0, 4],
    Text = iolist_to_binary(starl_json:encode(Values, 6)),
    ?assertEqual(<<"[0.12,0.123457,3.0,4]">>, Text).

a_length_has_no_exponent_test() ->
    Values = [2.0e3, -1.0e5, 1.0e14, 1.5e-7, 1.0e300, 0.1],
    Text = <<"[2000.0,-100000.0,100000000000000.0,1.5e-7,1.0e300,0.1]">>,
    ?assertEqual(Text, iolist_to_binary(starl_json:encode(Values))),
    ?assertEqual({ok, Values}, starl_json:decode(Text)).

what_is_json_already_stays_as_it_is_test() ->
    ?assertEqual(<<"[[ ],1]">>, written([{json, <<"[ ]">>}, 1])).

bytes_that_are_no_text_are_written_all_the_same_test() ->
    ?assertEqual(<<"\"a\\u00ff\"">>, written(<<"a", 255>>)).

a_pretty_object_has_a_line_for_each_pair_test() ->
    Text = iolist_to_binary(starl_json:pretty([{a, 1}, {b, [{c, null}]}])),
    ?assertEqual(<<"{\n  \"a\": 1,\n  \"b\": {\"c\":null}\n}\n">>, Text).

%% No text from outside is more than an error.
garbage_test_() ->
    [
        ?_assertEqual(error, starl_json:decode(Text))
     || Text <- [<<>>, <<"{">>, <<255, 0>>, binary:copy(<<"[">>, 1000), <<"{\"a\"}">>]
    ].

written(Value) -> iolist_to_binary(starl_json:encode(Value)).
