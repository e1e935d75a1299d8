%% A state keeps the number under which it was first met, however the tables grow.
-module(starl_check_visited_tests).
-include_lib("eunit/include/eunit.hrl").

-define(COUNT, 60000).

hash(N) -> erlang:md5(<<N:64>>).

numbers_test() ->
    All = lists:seq(0, ?COUNT - 1),
    Full = lists:foldl(
        fun(N, Visited) ->
            {new, N, Next} = starl_check_visited:meet(hash(N), Visited),
            starl_check_visited:put_way(N, {N div 2, N rem 7, N rem 100}, Next)
        end,
        starl_check_visited:new(),
        All
    ),
    ?assertEqual(?COUNT, starl_check_visited:count(Full)),
    ?assert(lists:all(fun(N) -> is_known(N, Full) end, All)).

is_known(N, Visited) ->
    {known, Number, _} = starl_check_visited:meet(hash(N), Visited),
    {Number, starl_check_visited:way(N, Visited)} =:= {N, {N div 2, N rem 7, N rem 100}}.

%% The two halves of a hash both count.
halves_test() ->
    {new, 0, One} = starl_check_visited:meet(<<5:64, 6:64>>, starl_check_visited:new()),
    {new, 1, Two} = starl_check_visited:meet(<<5:64, (6 + 256):64>>, One),
    {new, 2, Three} = starl_check_visited:meet(<<6:64, 6:64>>, Two),
    ?assertMatch({known, 1, _}, starl_check_visited:meet(<<5:64, (6 + 256):64>>, Three)).

shorter_way_test() ->
    {new, 0, Met} = starl_check_visited:meet(hash(1), starl_check_visited:new()),
    Long = starl_check_visited:put_way(0, {3, 1, 12}, Met),
    Short = starl_check_visited:put_way(0, {4, 2, 11}, Long),
    ?assertEqual({4, 2, 11}, starl_check_visited:way(0, Short)).
