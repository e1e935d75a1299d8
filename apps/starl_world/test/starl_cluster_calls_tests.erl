%% Calls to the nodes of a cluster: none keeps the caller waiting for longer than it said.
-module(starl_cluster_calls_tests).
-include_lib("eunit/include/eunit.hrl").

%% A node that stands still keeps nobody: the limit ends the question, and names it. What it answers then
%% comes too late.
limit_test() ->
    Asked = ask(one, [{1, fun() -> yes end}, {2, wait()}], 50, joined([1, 2])),
    {[{one, Answers}], Ended} = starl_cluster_calls:await(Asked),
    ?assertEqual(#{1 => {ok, yes}, 2 => silent}, Answers),
    Next = ask(two, [{2, fun() -> late end}], infinity, Ended),
    ok = go_on(),
    %% the calls to a node are made in their order
    {[{two, #{2 := {ok, late}}}], Last} = starl_cluster_calls:await(Next),
    starl_cluster_calls:stop(Last).

%% A node that ends answers no more; one that has answered already has ended all the same.
lost_test() ->
    Asked = ask(one, [{1, wait()}, {2, fun() -> yes end}], infinity, joined([1, 2])),
    {[], Heard} = starl_cluster_calls:hear(answer(), Asked),
    {[], Without} = starl_cluster_calls:lost(2, Heard),
    {[{one, Answers}], Last} = starl_cluster_calls:lost(1, Without),
    ?assertEqual(#{1 => down, 2 => down}, Answers),
    starl_cluster_calls:stop(Last).

%% Who asks nobody, or only nodes that are down, is answered, too.
nobody_test() ->
    Calls = ask(two, [{1, fun() -> yes end}], 1000, ask(one, [], infinity, joined([]))),
    {Ended, Last} = starl_cluster_calls:await(Calls),
    ?assertEqual([{one, #{}}, {two, #{1 => down}}], lists:sort(Ended)),
    ?assertEqual(unknown, starl_cluster_calls:hear(other, Last)).

joined(Robots) -> lists:foldl(fun starl_cluster_calls:joined/2, starl_cluster_calls:new(), Robots).

ask(Name, Wanted, LimitMs, Calls) -> starl_cluster_calls:ask(Name, Wanted, LimitMs, Calls).

%% A call that waits until the test lets it go on.
wait() ->
    Test = self(),
    fun() ->
        Test ! {waits, self()},
        receive
            go_on -> waited
        end
    end.

go_on() ->
    receive
        {waits, Caller} -> Caller ! go_on
    end,
    ok.

answer() ->
    receive
        Message when element(1, Message) =:= starl_cluster_calls -> Message
    end.
