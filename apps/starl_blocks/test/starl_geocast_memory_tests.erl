%% What was delivered is known for good, in bounded memory. The seed of the random test is printed
%% and taken back (STARL_SEED).
-module(starl_geocast_memory_tests).
-include_lib("eunit/include/eunit.hrl").

-define(M, starl_geocast_memory).

added(Ids, Memory) -> lists:foldl(fun ?M:add/2, Memory, Ids).

id(N) -> {7, 1, N}.

each_id_test() ->
    Memory = added([{7, 1, 3}, {7, 2, 3}, {8, 1, 4}, {7, 1, 5}, {7, 1, 4}], ?M:new(10)),
    [
        ?assertEqual({Id, Is}, {Id, ?M:is_member(Id, Memory)})
     || {Is, Ids} <- [
            {true, [{7, 1, 3}, {7, 2, 3}, {8, 1, 4}, {7, 1, 5}, {7, 1, 4}]},
            {false, [{7, 1, 2}, {7, 1, 6}, {7, 2, 2}, {7, 2, 4}, {8, 1, 3}, {9, 1, 4}]}
        ],
        Id <- Ids
    ].

%% Nothing else than what was added, in any order, as long as there is room.
random_test() ->
    Seed = starl_platform_ct:seed(),
    _ = rand:seed(exsss, Seed),
    [
        begin
            Ids = [{rand:uniform(2), rand:uniform(2), rand:uniform(30)} || _ <- lists:seq(1, 40)],
            Memory = added(Ids, ?M:new(60)),
            All = [{S, I, N} || S <- [1, 2], I <- [1, 2], N <- lists:seq(0, 31)],
            Members = [Id || Id <- All, ?M:is_member(Id, Memory)],
            ?assertEqual({Seed, lists:usort(Ids)}, {Seed, Members})
        end
     || _ <- lists:seq(1, 50)
    ].

%% Numbers that follow each other cost nothing.
in_order_test() ->
    Shuffled = [N || {_, N} <- lists:sort([{erlang:phash2(N), N} || N <- lists:seq(1, 500)])],
    Full = added([id(N) || N <- lists:seq(1, 500)], ?M:new(1000)),
    ?assertEqual(Full, added([id(N) || N <- Shuffled], ?M:new(1000))),
    ?assert(erts_debug:flat_size(Full) < 40),
    ?assertEqual(Full, added([id(N) || N <- [1, 250, 500]], Full)).

%% Beyond the room the oldest gap is taken for delivered, and nothing is forgotten.
bounded_test() ->
    Odd = [id(N) || N <- lists:seq(1, 401, 2)],
    Memory = added(Odd, ?M:new(50)),
    ?assert(lists:all(fun(Id) -> ?M:is_member(Id, Memory) end, Odd)),
    Gaps = [N || N <- lists:seq(2, 400, 2), not ?M:is_member(id(N), Memory)],
    ?assertEqual(lists:seq(400 - 2 * 48, 400, 2), Gaps),
    More = added([id(N) || N <- lists:seq(403, 4001, 2)], Memory),
    ?assert(erts_debug:flat_size(More) =< erts_debug:flat_size(Memory) + 10).
