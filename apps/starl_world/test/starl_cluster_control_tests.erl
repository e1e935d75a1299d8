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

%% A user without a home gets a line, not a cluster that never begins.
no_place_for_the_socket_test() ->
    Before = os:getenv("XDG_CACHE_HOME"),
    true = os:putenv("XDG_CACHE_HOME", "/dev/null/cache"),
    try
        {error, Why} = starl_cluster_control:start_link(fun(_) -> {ok, ""} end),
        ?assertNotEqual(nomatch, string:find(Why, "/dev/null/cache")),
        ?assertNotEqual(nomatch, string:find(Why, "set XDG_CACHE_HOME"))
    after
        case Before of
            false -> os:unsetenv("XDG_CACHE_HOME");
            _ -> os:putenv("XDG_CACHE_HOME", Before)
        end
    end.

asked(Words, Ms) -> starl_cluster_control:ask(Words, list_to_integer(os:getpid()), Ms).
