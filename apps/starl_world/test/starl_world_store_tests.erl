%% What becomes of a store before its node starts. The record of facts, a witness, always stays.
-module(starl_world_store_tests).
-include_lib("eunit/include/eunit.hrl").

lives_test() ->
    Dir = filename:join(
        os:getenv("TMPDIR", "/tmp"), "starl-cluster-store-" ++ os:getpid()
    ),
    Spec = #{dir => Dir},
    Live = fun(Fate, Life) ->
        ok = starl_world_store:before_start(Fate, Spec),
        _ = Life =:= 1 andalso starl_live_store:commission(Dir),
        Found = kept(Dir),
        {ok, Store} = starl_live_store:open(Dir),
        ok = starl_live_store:started(#{a => Life}, Store),
        ok = starl_live_store:keep(a, Life, Store),
        {ok, _} = starl_live_record:open(Dir),
        Found
    end,
    try
        Lives = [{kept, 1}, {kept, 2}, {kept, 3}, {set_back, 4}, {lost, 5}, {set_back, 6}],
        Found = [Live(Fate, Life) || {Fate, Life} <- Lives],
        ?assertEqual(
            [none, {stored, 1}, {stored, 2}, {stored, 2}, damaged, damaged],
            Found
        ),
        ?assertEqual(6, length(starl_live_record:starts(Dir)))
    after
        _ = file:del_dir_r(Dir),
        file:del_dir_r(Dir ++ ".earlier")
    end.

kept(Dir) ->
    {ok, Store} = starl_live_store:open(Dir),
    starl_live_store:kept(a, Store).
