%% What the tests of mutation testing mutate the fixture against.
-module(starl_mutate_fixture_tests).
-include_lib("eunit/include/eunit.hrl").

larger_test() ->
    ?assertEqual([2, 2, 2], [
        starl_mutate_fixture:larger(A, B)
     || {A, B} <- [{1, 2}, {2, 1}, {2, 2}]
    ]).

count_test() -> ?assertEqual([0, 2], [starl_mutate_fixture:count(L) || L <- [[], [a, b]]]).

seen_test() -> ?assertEqual([b], maps:keys(starl_mutate_fixture:seen(b, #{}))).
