-module(starl_cluster_chaos_tests).
-include_lib("eunit/include/eunit.hrl").

-define(SPAN, {5_000_000, 45_000_000}).

%% Two nodes are killed, the leader's first or second; one is halted; what is cut is mended, what freezes
%% thaws; a disk that is full has room again; senses are well again.
draw_test_() ->
    [{"seed " ++ integer_to_list(Seed), fun() -> drawn(Seed) end} || Seed <- lists:seq(1, 50)].

drawn(Seed) ->
    Acts = starl_cluster_chaos:draw(Seed, [1, 2, 3, 4, 5], ?SPAN),
    ?assertEqual(Acts, starl_cluster_chaos:draw(Seed, [1, 2, 3, 4, 5], ?SPAN)),
    ?assertEqual(lists:sort(Acts), Acts),
    ?assertMatch([_, _], [Act || {_, {kill, _}} = Act <- Acts]),
    ?assertMatch([_], [At || {At, {kill, leader}} <- Acts]),
    [{_, Seconds}] = [{At, S} || {At, {pause_at_work, _, S}} <- Acts],
    ?assert(Seconds >= 1 andalso Seconds =< 2),
    [{Frozen, Robot}] = [{At, R} || {At, {freeze, R}} <- Acts],
    ?assertEqual([Frozen + 5_000_000], [At || {At, {thaw, R}} <- Acts, R =:= Robot]),
    [{Full, Filled}] = [{At, R} || {At, {fill, R}} <- Acts],
    ?assertEqual([Full + 5_000_000], [At || {At, {clear, R}} <- Acts, R =:= Filled]),
    [{Spoilt, Who}, {Well, Who}] = [{At, R} || {At, {sense, R, all, _}} <- Acts],
    ?assertEqual([Well], [At || {At, {sense, _, all, well}} <- Acts]),
    ?assertEqual(Spoilt + 5_000_000, Well),
    [?assert(lists:member({At + 10_000_000, {mend, A, B}}, Acts)) || {At, {cut, A, B}} <- Acts],
    ?assert(lists:all(fun begins_in_time/1, Acts)).

begins_in_time({At, {What, _}}) when What =:= kill; What =:= freeze; What =:= fill -> in_time(At);
begins_in_time({At, {pause_at_work, _, _}}) -> in_time(At);
begins_in_time({At, {cut, A, B}}) -> A =/= B andalso in_time(At);
begins_in_time(_) -> true.

in_time(At) -> At >= 5_000_000 andalso At =< 45_000_000.

%% As many as asked for, each put back before the next is pulled.
cables_test() ->
    Acts = starl_cluster_chaos:cables(7, [1, 2, 3], 20),
    ?assertEqual(Acts, starl_cluster_chaos:cables(7, [1, 2, 3], 20)),
    ?assertEqual(Acts, lists:sort(Acts)),
    {Pulls, Plugs} = lists:partition(fun({_, {What, _}}) -> What =:= unplug_in_time end, Acts),
    ?assertEqual([{At + 1_000_000, {plug, R}} || {At, {unplug_in_time, R}} <- Pulls], Plugs),
    ?assertEqual(20, length(Pulls)),
    ?assertEqual([1, 2, 3], lists:usort([R || {_, {_, R}} <- Pulls])).

%% As many as asked for, one after the other.
halts_test() ->
    Acts = starl_cluster_chaos:halts(7, [1, 2, 3], 20),
    ?assertEqual(Acts, starl_cluster_chaos:halts(7, [1, 2, 3], 20)),
    ?assertEqual(Acts, lists:sort(Acts)),
    ?assertEqual(20, length([S || {_, {pause_at_work, _, S}} <- Acts, S >= 1, S =< 2])),
    ?assertEqual([1, 2, 3], lists:usort([R || {_, {_, R, _}} <- Acts])).

stores_test() ->
    Acts = starl_cluster_chaos:stores(7, [1, 2, 3], 20),
    ?assertEqual(Acts, starl_cluster_chaos:stores(7, [1, 2, 3], 20)),
    ?assertEqual(20, length(Acts)),
    ?assertEqual([lose_store, set_back], lists:usort([What || {_, {What, _}} <- Acts])).

%% Each has room again before the next is full.
full_disks_test() ->
    Acts = starl_cluster_chaos:full_disks(7, [1, 2, 3], 20),
    ?assertEqual(Acts, starl_cluster_chaos:full_disks(7, [1, 2, 3], 20)),
    ?assertEqual(40, length(Acts)),
    ?assertEqual([1, 2, 3], lists:usort([R || {_, {fill, R}} <- Acts])),
    [?assert(lists:member({At + 5_000_000, {clear, R}}, Acts)) || {At, {fill, R}} <- Acts].

alone_test() ->
    Acts = starl_cluster_chaos:draw(1, [1], ?SPAN),
    ?assertEqual([], [Act || {_, {cut, _, _}} = Act <- Acts]).

leader_test() ->
    ?assertEqual(none, starl_cluster_chaos:targets({kill, leader}, none)),
    ?assertEqual({kill, 4}, starl_cluster_chaos:targets({kill, leader}, 4)),
    ?assertEqual({cut, 1, 2}, starl_cluster_chaos:targets({cut, 1, 2}, 4)).
