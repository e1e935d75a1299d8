-module(starl_cluster_chaos_tests).
-include_lib("eunit/include/eunit.hrl").

-define(SPAN, {5_000_000, 45_000_000}).

%% Two nodes are killed, the leader's first or second; one is halted; what is cut is mended, what freezes
%% thaws; a disk that is full has room again; senses are well again.
draw_test_() ->
    [{"seed " ++ integer_to_list(Seed), fun() -> drawn(Seed) end} || Seed <- lists:seq(1, 50)].

drawn(Seed) ->
    Hands = starl_cluster_chaos:draw(Seed, [1, 2, 3, 4, 5], ?SPAN),
    ?assertEqual(Hands, starl_cluster_chaos:draw(Seed, [1, 2, 3, 4, 5], ?SPAN)),
    ?assertEqual(lists:sort(Hands), Hands),
    ?assertMatch([_, _], [0 || {_, {reboot, _, _, 0}} <- Hands]),
    ?assertMatch([leader], [R || {_, {reboot, R, _, _}} <- Hands, R =:= leader]),
    [Ms] = [Ms || {_, {pause, _, #{at_work := true}, Ms}} <- Hands],
    ?assert(Ms >= 1000 andalso Ms =< 2000),
    ?assertMatch([5000], [L || {_, {location_frozen, _, _, L}} <- Hands]),
    ?assertMatch([5000], [L || {_, {store_full, _, _, L}} <- Hands]),
    ?assertMatch([5000], [L || {_, {_, _, #{sense := all}, L}} <- Hands]),
    [
        ?assert(lists:member({At, {loss, {B, A}, #{part => 1.0}, 10000}}, Hands))
     || {At, {loss, {A, B}, _, _}} <- Hands
    ],
    ?assert(lists:all(fun({At, _}) -> in_time(At) end, Hands)).

in_time(At) -> At >= 5_000_000 andalso At =< 45_000_000.

%% As many as asked for, each put back before the next is pulled.
cables_test() ->
    Acts = starl_cluster_chaos:cables(7, [1, 2, 3], 20),
    ?assertEqual(Acts, starl_cluster_chaos:cables(7, [1, 2, 3], 20)),
    ?assertEqual(Acts, lists:sort(Acts)),
    Pulls = [{At, R} || {At, {serial_gone, R, #{in_time := true}, 1000}} <- Acts],
    Times = [At || {At, _} <- Pulls],
    ?assertEqual(20, length(Pulls)),
    [?assert(Next > At + 1_000_000) || {At, Next} <- lists:zip(lists:droplast(Times), tl(Times))],
    ?assertEqual([1, 2, 3], lists:usort([R || {_, R} <- Pulls])).

%% As many as asked for, one after the other.
halts_test() ->
    Acts = starl_cluster_chaos:halts(7, [1, 2, 3], 20),
    ?assertEqual(Acts, starl_cluster_chaos:halts(7, [1, 2, 3], 20)),
    ?assertEqual(Acts, lists:sort(Acts)),
    Lengths = [Ms || {_, {pause, _, #{at_work := true}, Ms}} <- Acts, Ms >= 1000, Ms =< 2000],
    ?assertEqual(20, length(Lengths)),
    ?assertEqual([1, 2, 3], lists:usort([R || {_, {_, R, _, _}} <- Acts])).

stores_test() ->
    Acts = starl_cluster_chaos:stores(7, [1, 2, 3], 20),
    ?assertEqual(Acts, starl_cluster_chaos:stores(7, [1, 2, 3], 20)),
    ?assertEqual(20, length(Acts)),
    ?assertEqual(
        [store_lost, store_set_back], lists:usort([Kind || {_, {Kind, _, _, _}} <- Acts])
    ).

%% Each has room again before the next is full.
full_disks_test() ->
    Acts = starl_cluster_chaos:full_disks(7, [1, 2, 3], 20),
    ?assertEqual(Acts, starl_cluster_chaos:full_disks(7, [1, 2, 3], 20)),
    ?assertEqual(20, length(Acts)),
    ?assertEqual([1, 2, 3], lists:usort([R || {_, {store_full, R, _, 5000}} <- Acts])),
    [?assert(At >= 10_000_000) || {At, _} <- Acts].

alone_test() ->
    Acts = starl_cluster_chaos:draw(1, [1], ?SPAN),
    ?assertEqual([], [Act || {_, {loss, _, _, _}} = Act <- Acts]).

leader_test() ->
    ?assertEqual(none, starl_cluster_chaos:aimed({reboot, leader, #{}, 0}, none)),
    ?assertEqual({reboot, 4, #{}, 0}, starl_cluster_chaos:aimed({reboot, leader, #{}, 0}, 4)),
    ?assertEqual({reboot, 2, #{}, 0}, starl_cluster_chaos:aimed({reboot, 2, #{}, 0}, 4)).
