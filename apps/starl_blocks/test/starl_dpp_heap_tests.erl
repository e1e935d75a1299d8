%% The queue of a search: what was entered leaves in the order of its keys, each once.
-module(starl_dpp_heap_tests).
-include_lib("eunit/include/eunit.hrl").

sorts_test_() ->
    [fun() -> sorts(Seed) end || Seed <- lists:seq(1, 20)].

%% Entered and taken out by turns, held against a list.
sorts(Seed) ->
    {_, Heap, Known} = lists:foldl(
        fun(I, {Rand0, H, List}) ->
            {Key, Rand} = rand:uniform_s(20, Rand0),
            case Key > 13 of
                true -> {Rand, popped(H, List), tail(List)};
                false -> {Rand, starl_dpp_heap:push(Key, {Key, I}, H), lists:sort([Key | List])}
            end
        end,
        {rand:seed_s(exsss, Seed), starl_dpp_heap:new(), []},
        lists:seq(1, 200)
    ),
    ?assertEqual({Seed, Known}, {Seed, drained(Heap)}).

tail([]) -> [];
tail([_ | Keys]) -> Keys.

popped(Heap, []) ->
    ?assertEqual(empty, starl_dpp_heap:pop(Heap)),
    Heap;
popped(Heap, [Key | _]) ->
    {Key, {Key, _}, Left} = starl_dpp_heap:pop(Heap),
    Left.

drained(Heap) ->
    case starl_dpp_heap:pop(Heap) of
        empty -> [];
        {Key, {Key, _}, Left} -> [Key | drained(Left)]
    end.
