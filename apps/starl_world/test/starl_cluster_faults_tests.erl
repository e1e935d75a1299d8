%% The faults of a cluster, before a world that tells this test what it is told.
-module(starl_cluster_faults_tests).
-include_lib("eunit/include/eunit.hrl").

%% The process of the node has ended, and nobody has heard of it yet: its disk cannot be filled. The world was told of
%% that fault, and is told that it is over: nobody is excused by it until the end of the run.
a_fault_that_cannot_be_done_is_over_test_() ->
    {timeout, 60, fun a_fault_that_cannot_be_done_is_over/0}.

a_fault_that_cannot_be_done_is_over() ->
    _ = process_flag(trap_exit, true),
    {ok, Nodes} = starl_cluster_nodes:start([1, 2], []),
    {Test, Alias} = {self(), make_ref()},
    World = spawn_link(fun() -> world(Test, Alias) end),
    ok = starl_cluster_nodes:kill(1, Nodes),
    receive
        {starl_peer_ended, _Control, _Status} -> ok
    end,
    Run = #{world => World, clock => starl_live_clock:new(0, 1), speed => 1},
    Faults = starl_cluster_faults:new([1, 2], Run),
    Full = [{store_full, Robot, #{}, lasting} || Robot <- [2, 1]],
    {Answer, Wants, Left} = starl_cluster_faults:act(Full, Nodes, Faults),
    ?assertMatch({error, _}, Answer),
    ?assertEqual([], Wants),
    ?assertEqual([{began, 2}, {began, 1}, {ended, 1}], told(Alias)),
    ?assertEqual([fill, clear], [starl_cluster_faults:disk(Robot, Left) || Robot <- [2, 1]]),
    ok = starl_cluster_nodes:stop(Nodes),
    true = unlink(World),
    exit(World, kill).

world(Test, Alias) ->
    receive
        {'$gen_call', From, {fault, {Is, {_, _, _, store_full, Robot, _}}}} ->
            Test ! {Alias, {Is, Robot}},
            gen_server:reply(From, ok),
            world(Test, Alias)
    end.

told(Alias) ->
    receive
        {Alias, Told} -> [Told | told(Alias)]
    after 0 -> []
    end.
