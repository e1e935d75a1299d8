%% What every digest rests on gives these numbers in every release of OTP (README): they
%% are no part of any protocol, and may never change.
-module(starl_sim_primitives_tests).
-include_lib("eunit/include/eunit.hrl").

-define(RANGE, 4294967296).

hash_test() ->
    Map = #{1 => x, {2, y} => [z]},
    Terms = {17, 1 bsl 70, -3, 2.5, 0.0, -0.0, <<"text">>, [a, "b" | c], Map, 'ż', []},
    ?assertEqual(436664256, erlang:phash2(Terms, ?RANGE)).

%% The order of a large map's keys is OTP's own affair, its hash is not.
hash_of_a_large_map_test() ->
    Large = maps:from_list([{K, K * 0.5} || K <- lists:seq(1, 100)]),
    ?assertEqual(2425768936, erlang:phash2(Large, ?RANGE)).

%% Both zeros hash alike, although OTP 27 and newer tell them apart.
zeros_test() -> ?assertEqual(erlang:phash2(0.0), erlang:phash2(-0.0)).

random_numbers_test() ->
    Ranges = [1, 7, 1 bsl 32, 1 bsl 60],
    {Drawn, Next} = lists:mapfoldl(fun rand:uniform_s/2, rand:seed_s(exsss, 42), Ranges),
    {Fraction, _} = rand:uniform_s(Next),
    ?assertEqual([1, 7, 461228575, 527559813424408515], Drawn),
    ?assertEqual(0.5665765936300625, Fraction).
