%% The planner's array holds at every place what was put there last, whatever its size, and an older
%% version of it stays what it was.
-module(starl_dpp_array_tests).
-include_lib("eunit/include/eunit.hrl").

holds_what_was_put_test_() ->
    [fun() -> puts(Size, rand:seed_s(exsss, Size)) end || Size <- [1, 31, 32, 33, 63, 64, 1000]].

puts(Size, Rand) ->
    Empty = starl_dpp_array:new(Size, none),
    {Array, Map, _} = lists:foldl(
        fun(I, {A, M, R0}) ->
            {N, R1} = rand:uniform_s(Size, R0),
            {starl_dpp_array:put(N, I, A), M#{N => I}, R1}
        end,
        {Empty, #{}, Rand},
        lists:seq(1, 2 * Size)
    ),
    [
        ?assertEqual({N, maps:get(N, Map, none)}, {N, starl_dpp_array:get(N, Array)})
     || N <- lists:seq(1, Size)
    ],
    [?assertEqual(none, starl_dpp_array:get(N, Empty)) || N <- [1, Size]].
