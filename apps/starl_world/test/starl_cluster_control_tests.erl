%% Commands over the socket: what who asks is told by whatever becomes of the answer.
-module(starl_cluster_control_tests).
-include_lib("eunit/include/eunit.hrl").

%% A cluster that is busy has not ended.
answers_test() ->
    Handler = fun
        (["status"]) ->
            {ok, "up"};
        (["kill", N]) ->
            {error, ["no robot ", N]};
        (["die"]) ->
            exit(normal);
        (["busy"]) ->
            receive
                never -> {ok, ""}
            end
    end,
    {ok, _Pid} = starl_cluster_control:start_link(Handler),
    try
        ?assertEqual({ok, <<"up">>}, asked(["status"], 60_000)),
        ?assertEqual({error, <<"no robot 7">>}, asked(["kill", "7"], 60_000)),
        ?assertEqual({error, "the cluster has ended"}, asked(["die"], 60_000)),
        {error, Busy} = asked(["busy"], 1000),
        ?assertEqual("no answer within 1 s; the cluster may be busy", lists:flatten(Busy))
    after
        starl_cluster_control:close()
    end.

asked(Words, Ms) -> starl_cluster_control:ask(Words, list_to_integer(os:getpid()), Ms).
