-module(starl_cluster_command_tests).
-include_lib("eunit/include/eunit.hrl").

parse_test_() ->
    [
        ?_assertEqual({Words, Expected}, {Words, starl_cluster_command:parse(Words)})
     || {Words, Expected} <- [
            {["status"], {ok, status}},
            {["heal"], {ok, {heal, all}}},
            {["kill", "3"], {ok, {inject, [{reboot, 3, #{}, 0}]}}},
            {["pause", "3", "2"], {ok, {inject, [{pause, 3, #{}, 2000}]}}},
            {["pause", "3", "0.25"], {ok, {inject, [{pause, 3, #{}, 250}]}}},
            {["lose-store", "3"], {ok, {inject, [{store_lost, 3, #{}, 0}]}}},
            {["set-back", "3"], {ok, {inject, [{store_set_back, 3, #{}, 0}]}}},
            {["cut", "1", "2"], {ok, {inject, starl_run_manual_fault:cut(1, 2, lasting)}}},
            {["fill", "1"], {ok, {inject, [{store_full, 1, #{}, lasting}]}}},
            {["unplug", "1"], {ok, {inject, [{serial_gone, 1, #{}, lasting}]}}},
            {
                ["sense", "2", "camera", "frozen"],
                {ok, {inject, [{sense_frozen, 2, #{sense => camera}, lasting}]}}
            },
            {
                ["sense", "2", "all", "noisy"],
                {ok, {inject, [{sense_noisy, 2, #{sense => all, times => 10}, lasting}]}}
            },
            {["sense", "2", "all", "well"], {ok, {heal, {sense, 2, all}}}},
            {["reload", "lists"], {ok, {reload, lists}}},
            {["reload", "election"], {ok, {reload, starl_election}}},
            {["reload", "/tmp/mine.erl"], {ok, {reload, "/tmp/mine.erl"}}}
        ]
    ].

%% Whatever a terminal sends is answered.
refused_test_() ->
    [
        ?_assertMatch({Words, {error, _}}, {Words, starl_cluster_command:parse(Words)})
     || Words <- [
            [],
            ["kill"],
            ["kill", "x"],
            ["kill", "3x"],
            ["cut", "1", "1"],
            ["mend", "1", "2"],
            ["pause", "3"],
            ["pause", "3", "x"],
            ["pause", "x", "1"],
            ["pause", "3", "1.5s"],
            ["lose-store"],
            ["set-back", "x"]
        ]
    ].

%% A command that users are told of can be parsed with as many words.
words_test_() ->
    [
        ?_assertMatch({ok, _}, starl_cluster_command:parse([Word | lists:sublist(["1", "2"], N)]))
     || Word <- [
            "status",
            "kill",
            "pause",
            "lose-store",
            "set-back",
            "cut",
            "freeze",
            "fill",
            "unplug",
            "heal",
            "stop",
            "reload"
        ],
        N <- [starl_cluster_command:words(Word)]
    ] ++ [?_assertEqual(3, starl_cluster_command:words("sense"))].

senses_and_faults_are_named_test_() ->
    [
        ?_assertMatch(
            {Words, {match, _}},
            begin
                {error, Why} = starl_cluster_command:parse(["sense" | Words]),
                {Words, re:run(Why, Expected)}
            end
        )
     || {Words, Expected} <- [
            {["1", "nose", "gone"], "no sense nose; there are all, bump"},
            {["1", "bump", "odd"], "can be well, gone, frozen, noisy, wrong, not odd"},
            {["x", "bump", "gone"], "a robot by its number"}
        ]
    ].

described_test() ->
    Silent = #{robot => 1, is_silent => true, heard_ms => 7400, why => not_connected},
    Heard = #{robot => 3, is_silent => false, heard_ms => 20, why => none},
    Status = #{
        now_us => 2500000,
        running => 2,
        up => [2],
        ending => none,
        leader => none,
        restarts => #{1 => 1, 2 => 0},
        os_pids => #{2 => "77"}
    },
    ?assertEqual(
        "2.5 s, 2 at work\n"
        "robot 1  down  process -, started 2 times\n"
        "robot 2  up    process 77, started 1 times, hears 1 of 2 others, has not heard robot 1 for 7 s: "
        "its node is not connected\n",
        lists:flatten(starl_cluster_command:described(Status, #{2 => [Silent, Heard]}))
    ).

%% The nodes that a command has not reached are named.
an_answer_names_the_nodes_that_have_not_heard_test_() ->
    [
        ?_assertEqual(
            {ok, Text},
            begin
                {ok, Said} = starl_cluster_command:done(Command, {ok, Robots}),
                {ok, lists:flatten(Said)}
            end
        )
     || {Text, Command, Robots} <- [
            {"done\n", {inject, []}, []},
            {"healed; no answer yet from the node of robot 2\n", {heal, all}, [2]},
            {"done; no answer yet from the nodes of robots 2, 10\n", {inject, []}, [10, 2]}
        ]
    ].

%% A cluster that is busy has not ended.
each_terminal_gets_an_answer_test() ->
    Handler = fun
        (status) ->
            {ok, "up"};
        ({inject, _}) ->
            {error, "no robot 7"};
        (stop) ->
            exit(normal);
        ({heal, all}) ->
            receive
                never -> {ok, ""}
            end
    end,
    {ok, _Pid} = starl_cluster_command:start_link(Handler),
    try
        ?assertEqual({ok, <<"up">>}, asked(["status"], 60_000)),
        ?assertEqual({error, <<"no robot 7">>}, asked(["kill", "7"], 60_000)),
        ?assertMatch({error, <<"kill: robots", _/binary>>}, asked(["kill"], 60_000)),
        ?assertEqual({error, "the cluster has ended"}, asked(["stop"], 60_000)),
        {error, Busy} = asked(["heal"], 1000),
        ?assertEqual("no answer within 1 s; the cluster may be busy", lists:flatten(Busy))
    after
        starl_cluster_command:close()
    end.

%% A user without a home gets a line, not a cluster that never begins.
%% Holds: A user without a home gets one line from `./starl cluster`
%% Red: d7c73771, run: the command waits for ever
no_place_for_the_socket_test() ->
    Before = os:getenv("XDG_CACHE_HOME"),
    true = os:putenv("XDG_CACHE_HOME", "/dev/null/cache"),
    try
        {error, Why} = starl_cluster_command:start_link(fun(_) -> {ok, ""} end),
        ?assertNotEqual(nomatch, string:find(Why, "/dev/null/cache")),
        ?assertNotEqual(nomatch, string:find(Why, "set XDG_CACHE_HOME"))
    after
        case Before of
            false -> os:unsetenv("XDG_CACHE_HOME");
            _ -> os:putenv("XDG_CACHE_HOME", Before)
        end
    end.

asked(Words, Ms) -> starl_cluster_command:ask(Words, list_to_integer(os:getpid()), Ms).
