-module(starl_cluster_hands_tests).
-include_lib("eunit/include/eunit.hrl").

-define(M, starl_cluster_hands).

%% A cut is in both directions, and so is its end; other cuts stay.
cuts_test() ->
    Cut = done([{cut, 1, 2}, {cut, 1, 3}, {cut, 2, 1}]),
    ?assertEqual([2, 3], ?M:deaf(1, Cut)),
    ?assertEqual([1], ?M:deaf(2, Cut)),
    Mended = ?M:done({mend, 2, 1}, Cut),
    ?assertEqual([{1, 3}, {3, 1}], ?M:cuts(Mended)).

%% Each act and the one that undoes it; a kill holds nothing.
undone_test_() ->
    [
        ?_assertEqual({?M:new(), [2]}, {done([Act, Undo]), Held(done([Act, Act]))})
     || {Act, Undo, Held} <- [
            {{freeze, 2}, {thaw, 2}, fun ?M:frozen/1},
            {{fill, 2}, {clear, 2}, fun ?M:full/1},
            {{unplug, 2}, {plug, 2}, fun ?M:unplugged/1},
            {{unplug_in_time, 2}, {plug, 2}, fun ?M:unplugged/1}
        ]
    ] ++ [?_assertEqual(?M:new(), done([{kill, 2}]))].

%% Each sense has its fault, of which the latest holds; nodes are told of it, and a heal ends all.
senses_test() ->
    Acts = [
        {sense, 2, camera, gone},
        {sense, 2, camera, frozen},
        {sense, 2, bump, wrong},
        {sense, 1, all, gone}
    ],
    Held = done(Acts),
    ?assertEqual(#{camera => frozen, bump => wrong}, ?M:senses(2, Held)),
    ?assertEqual([{1, all, gone}, {2, bump, wrong}, {2, camera, frozen}], ?M:senses(Held)),
    ?assertEqual(#{bump => wrong}, ?M:senses(2, ?M:done({sense, 2, camera, well}, Held))),
    ?assertEqual([], ?M:senses(?M:healed(Held))),
    ?assertEqual([2], ?M:links(hd(Acts))).

%% A store is lost, or set back, once: when its node starts. One that was lost before that stays lost, and
%% no heal brings one back.
stores_test() ->
    Struck = done([{set_back, 1}, {lose_store, 2}, {set_back, 2}, {freeze, 2}]),
    Healed = ?M:healed(Struck),
    ?assertEqual([], ?M:frozen(Healed)),
    {set_back, Left} = ?M:store(1, Healed),
    ?assertMatch({kept, _}, ?M:store(1, Left)),
    ?assertEqual({lost, ?M:new()}, ?M:store(2, Left)).

robots_test() ->
    ?assertEqual([3], ?M:robots({pause, 3, 7})),
    ?assertEqual([3], ?M:robots({pause_at_work, 3, 0.5})),
    ?assertEqual([3], ?M:robots({lose_store, 3})).

done(Acts) -> lists:foldl(fun ?M:done/2, ?M:new(), Acts).
