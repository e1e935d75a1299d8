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

%% No text from outside is more than an error.
garbage_test_() ->
    [
        ?_assertEqual(error, starl_json:decode(Text))
     || Text <- [<<>>, <<"{">>, <<255, 0>>, binary:copy(<<"[">>, 1000), <<"{\"a\"}">>]
    ].

written(Value) -> iolist_to_binary(starl_json:encode(Value)).
