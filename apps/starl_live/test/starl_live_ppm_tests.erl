%% Pictures from a pipe: in any pieces, one after the other, with comments; and what is none.
-module(starl_live_ppm_tests).
%% PropEr first: both have a macro LET.
-include_lib("proper/include/proper.hrl").
-include_lib("eunit/include/eunit.hrl").

-define(FRAME, <<"P6\n2 1\n255\n", 1, 2, 3, 4, 5, 6>>).

one_after_the_other_test() ->
    {ok, Frame, Rest} = starl_live_ppm:next(<<?FRAME/binary, ?FRAME/binary, "P">>),
    ?assertEqual(#{width => 2, height => 1, pixels => <<1, 2, 3, 4, 5, 6>>}, Frame),
    ?assertEqual({ok, Frame, <<"P">>}, starl_live_ppm:next(Rest)).

comments_test() ->
    Text = <<"P6 # by hand\n# 9 9\n 2\t1 # wide\n255\n", 1, 2, 3, 4, 5, 6>>,
    ?assertMatch({ok, #{width := 2, height := 1}, <<>>}, starl_live_ppm:next(Text)).

%% Every part of a picture asks for more, and for no more than is missing.
every_part_test() ->
    [
        begin
            {more, Bytes} = starl_live_ppm:next(binary:part(?FRAME, 0, N)),
            ?assert(Bytes =< byte_size(?FRAME) - N)
        end
     || N <- lists:seq(0, byte_size(?FRAME) - 1)
    ].

refused_test() ->
    Refused = [
        {<<"JFIF">>, {magic, <<"JF">>}},
        {<<"P5\n2 1\n255\n">>, {magic, <<"P5">>}},
        {<<"P6\n2 1\n65535\n">>, {depth, 65535}},
        {<<"P6\n0 1\n255\n">>, {size, 0, 1}},
        {<<"P6\n99999 99999\n255\n">>, {size, 99999, 99999}},
        {<<"P6\n2 x\n255\n">>, header},
        {<<"P6\n123456789 1\n255\n">>, header},
        {<<"P6\n", (binary:copy(<<" ">>, 5000))/binary>>, header}
    ],
    [
        begin
            ?assertEqual({Text, {error, Why}}, {Text, starl_live_ppm:next(Text)}),
            ?assert(is_list(unicode:characters_to_list(starl_live_ppm:format_error(Why))))
        end
     || {Text, Why} <- Refused
    ].

%% No bytes crash it.
any_bytes_test() ->
    starl_platform_ct:property(
        ?FORALL(
            Bytes,
            proper_types:binary(),
            lists:member(
                element(1, starl_live_ppm:next(<<"P6", Bytes/binary>>)), [ok, more, error]
            )
        ),
        500
    ).
