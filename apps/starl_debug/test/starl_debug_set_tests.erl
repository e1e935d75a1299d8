%% Sets of times against sets of numbers.
-module(starl_debug_set_tests).

-include_lib("eunit/include/eunit.hrl").

-define(DOMAIN, [{0, 60}]).

random() ->
    starl_debug_set:new([
        {A, A + rand:uniform(6) - 2}
     || A <- [rand:uniform(50) || _ <- lists:seq(1, rand:uniform(6))]
    ]).

numbers(Set) -> lists:append([lists:seq(A, B) || {A, B} <- Set]).

is_in(T, Set) -> lists:any(fun({A, B}) -> A =< T andalso T =< B end, Set).

operations_are_those_of_sets_test() ->
    Seed = erlang:system_time(microsecond) rem 1000000,
    _ = rand:seed(exsss, Seed),
    [
        ?assertEqual({seed, Seed, []}, {seed, Seed, wrong(random(), random())})
     || _ <- lists:seq(1, 300)
    ].

wrong(A, B) ->
    [Lo, Hi] = lists:sort([rand:uniform(9) - 5, rand:uniform(9) - 5]),
    Us = rand:uniform(4) - 1,
    Window = lists:seq(Lo, Hi),
    Cases = [
        {union, starl_debug_set:union(A, B), fun(T) -> is_in(T, A) orelse is_in(T, B) end},
        {intersect, starl_debug_set:intersect(A, B), fun(T) -> is_in(T, A) andalso is_in(T, B) end},
        {complement, starl_debug_set:complement(A, ?DOMAIN), fun(T) ->
            is_in(T, ?DOMAIN) andalso not is_in(T, A)
        end},
        {dilate, starl_debug_set:dilate(A, Lo, Hi), fun(T) ->
            lists:any(fun(O) -> is_in(T + O, A) end, Window)
        end},
        {erode, starl_debug_set:erode(A, Lo, Hi), fun(T) ->
            lists:all(fun(O) -> is_in(T + O, A) end, Window)
        end},
        {held, starl_debug_set:held(A, Us), fun(T) ->
            lists:all(fun(D) -> is_in(T - D, A) end, lists:seq(0, Us))
        end},
        {once, starl_debug_set:once(A, Us), fun(T) ->
            lists:any(fun(D) -> is_in(T - D, A) end, lists:seq(0, Us))
        end},
        {at_least, starl_debug_set:at_least(2, [A, B, A]), fun(T) -> is_in(T, A) end}
    ],
    [
        {Name, A, B, {Lo, Hi, Us}, Set}
     || {Name, Set, Is} <- Cases,
        numbers(Set) =/= [T || T <- lists:seq(-20, 80), Is(T)] orelse
            Set =/= starl_debug_set:new(Set)
    ].
