%% Sets of sequence numbers, against sets of the library.
-module(starl_sap_numbers_tests).
-include_lib("eunit/include/eunit.hrl").

-define(NUMBERS, lists:seq(1, 12)).

set(Numbers) ->
    lists:foldl(fun starl_sap_numbers:add/2, starl_sap_numbers:new(), Numbers).

members(Set) -> [N || N <- lists:seq(-1, 16), starl_sap_numbers:is_member(N, Set)].

seed() -> list_to_integer(os:getenv("STARL_SEED", "1")).

%% All sets of eight numbers: what is added is there, what is taken is not, the rest is as it was.
all_small_sets_test_() ->
    {timeout, 60, fun() -> [small(Numbers) || Numbers <- subsets(lists:seq(1, 8))] end}.

small(Numbers) ->
    Set = set(Numbers),
    ?assertEqual(Numbers, members(Set)),
    ?assertEqual(Numbers =:= [], starl_sap_numbers:is_empty(Set)),
    [small(N, Numbers, Set) || N <- lists:seq(0, 9)].

small(N, Numbers, Set) ->
    case lists:member(N, Numbers) of
        true ->
            ?assertEqual(member, starl_sap_numbers:add(N, Set)),
            ?assertEqual(Numbers -- [N], members(starl_sap_numbers:remove(N, Set)));
        false ->
            ?assertEqual(absent, starl_sap_numbers:remove(N, Set)),
            ?assertEqual(lists:sort([N | Numbers]), members(starl_sap_numbers:add(N, Set)))
    end,
    {Risen, Left} = starl_sap_numbers:rise(N, Set),
    ?assertEqual(risen(N, Numbers), Risen),
    ?assertEqual([M || M <- Numbers, M > Risen], members(Left)).

risen(Floor, Numbers) ->
    case lists:member(Floor, Numbers) of
        true -> risen(Floor + 1, Numbers);
        false -> Floor
    end.

subsets([]) ->
    [[]];
subsets([N | Rest]) ->
    Subsets = subsets(Rest),
    [[N | Subset] || Subset <- Subsets] ++ Subsets.

%% The order in which numbers come does not show: what touches is one interval.
any_order_test() ->
    lists:foldl(
        fun(_, Random) ->
            {Shuffled, Next} = shuffled(?NUMBERS, Random),
            ?assertEqual({seed(), set(?NUMBERS)}, {seed(), set(Shuffled)}),
            Half = lists:sublist(Shuffled, 6),
            ?assertEqual({seed(), set(lists:sort(Half))}, {seed(), set(Half)}),
            Next
        end,
        rand:seed_s(exsss, seed()),
        lists:seq(1, 200)
    ).

%% A set that was taken from is like one in which the number has never been.
removed_test() ->
    Set = set(?NUMBERS),
    [?assertEqual(set(?NUMBERS -- [N]), starl_sap_numbers:remove(N, Set)) || N <- ?NUMBERS].

%% Numbers that come in order cost next to nothing.
size_test() ->
    Small = erts_debug:flat_size(set([1])),
    ?assertEqual(Small, erts_debug:flat_size(set(lists:seq(1, 1000)))),
    ?assertEqual(Small, erts_debug:flat_size(set(lists:seq(1000, 1, -1)))).

shuffled(List, Random) ->
    {Keyed, Next} = lists:mapfoldl(
        fun(Element, R0) ->
            {Key, R} = rand:uniform_s(R0),
            {{Key, Element}, R}
        end,
        Random,
        List
    ),
    {[Element || {_, Element} <- lists:sort(Keyed)], Next}.
