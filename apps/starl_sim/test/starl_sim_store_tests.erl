%% The store of a simulated robot, and the faults that strike it.
-module(starl_sim_store_tests).
-include_lib("eunit/include/eunit.hrl").

%% The latest term of each machine is kept, apart from those of the others.
keeps_the_latest_test() ->
    Store = keep([{a, 1}, {b, 2}, {a, 3}], 0, starl_sim_store:new([])),
    ?assertEqual(
        [{stored, 3}, {stored, 2}, none], [starl_sim_store:kept(N, 9, Store) || N <- [a, b, c]]
    ).

%% While it is full nothing is written, and what was kept before stays.
full_test() ->
    Store = keep([{a, 1}], 0, starl_sim_store:new([fault(store_full, 5, 8)])),
    ?assertEqual([full, full], [starl_sim_store:keep(a, 2, T, Store) || T <- [5000, 7999]]),
    ?assertMatch({ok, _}, starl_sim_store:keep(a, 2, 8000, Store)),
    ?assertEqual({stored, 1}, starl_sim_store:kept(a, 6000, Store)).

%% What was kept is damaged for who starts meanwhile; where nothing was, nothing is.
damaged_test() ->
    Store = keep([{a, 1}], 6000, starl_sim_store:new([fault(store_damaged, 5, 8)])),
    ?assertEqual(
        [{stored, 1}, damaged, damaged, {stored, 1}],
        [starl_sim_store:kept(a, T, Store) || T <- [4999, 5000, 7999, 8000]]
    ),
    ?assertEqual(none, starl_sim_store:kept(b, 6000, Store)).

%% Nobody knows what was in a store that is lost: each term is damaged until it is written anew.
outdated_test() ->
    Store = starl_sim_store:outdate(keep([{a, 1}], 0, starl_sim_store:new([]))),
    ?assertEqual([damaged, damaged], [starl_sim_store:kept(N, 9, Store) || N <- [a, b]]),
    Anew = keep([{b, 2}], 9, Store),
    ?assertEqual([damaged, {stored, 2}], [starl_sim_store:kept(N, 9, Anew) || N <- [a, b]]).

%% An image has the terms and the numbers of its time, whatever came after it.
set_back_test() ->
    First = keep([{a, 1}], 0, starl_sim_store:new([])),
    {#{a := 1}, [], Image} = starl_sim_store:strike({save_store, f}, #{a => 1}, First),
    Later = keep([{a, 2}, {b, 1}], 9, Image),
    {Starts, [store_set_back], Back} = starl_sim_store:strike(
        {set_back_store, f}, #{a => 2}, Later
    ),
    ?assertEqual(#{a => 1}, Starts),
    ?assertEqual([{stored, 1}, none], [starl_sim_store:kept(N, 9, Back) || N <- [a, b]]).

keep(Terms, Now, Store) ->
    lists:foldl(
        fun({Name, Term}, S) ->
            {ok, Next} = starl_sim_store:keep(Name, Term, Now, S),
            Next
        end,
        Store,
        Terms
    ).

fault(Kind, From, To) -> starl_run_fault:compile({f, From, To, Kind, 1, #{}}).
