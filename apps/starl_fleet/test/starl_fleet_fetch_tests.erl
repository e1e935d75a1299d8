%% A robot that lies about its recordings: `ssh' is a program of the test's, which plays the robot.
%%
%% Holds: A robot that is asked for its recordings writes no other file of the operator's
%% Red: 961f67c9: its archive was unpacked
-module(starl_fleet_fetch_tests).
-include_lib("eunit/include/eunit.hrl").
-include_lib("kernel/include/file.hrl").

%% What wc says of some files, and of what is none.
listing_test() ->
    ?assertEqual({ok, #{files => [], odd => []}}, starl_fleet_fetch:listing("")),
    ?assertEqual(
        {ok, #{files => [{"a.mcap", 3}, {"b-1.mcap", 12}], odd => []}},
        starl_fleet_fetch:listing("  3 a.mcap\n 12 b-1.mcap\n 15 total\n")
    ).

%% No name leads elsewhere, begins as an option, or is hidden.
names_test_() ->
    [
        {Name,
            ?_assertMatch(
                {ok, #{files := [], odd := [_]}}, starl_fleet_fetch:listing("3 " ++ Name ++ "\n")
            )}
     || Name <- [
            "../x.mcap",
            "a/b.mcap",
            "/etc/x.mcap",
            ".bashrc",
            ".a.mcap",
            "-rf.mcap",
            "a b.mcap",
            "a;b.mcap",
            "$(id).mcap",
            "a.mcap.sh",
            "a\x{1b}.mcap",
            lists:duplicate(300, $a) ++ ".mcap"
        ]
    ].

%% A size is a number of bytes of which there can be so many.
sizes_test() ->
    ?assertMatch({error, _}, starl_fleet_fetch:listing("999999999999999 a.mcap\n")),
    ?assertMatch({ok, #{files := []}}, starl_fleet_fetch:listing("-1 a.mcap\n")),
    ?assertMatch(
        {ok, #{files := []}}, starl_fleet_fetch:listing(lists:duplicate(400, $9) ++ " a.mcap\n")
    ),
    Many = [io_lib:format("1 a~b.mcap\n", [N]) || N <- lists:seq(1, 10001)],
    ?assertMatch({error, _}, starl_fleet_fetch:listing(lists:flatten(Many))).

%% An honest robot's files are there, and nothing else.
honest_test() ->
    with_robot("printf '3 a.mcap\\n5 b.mcap\\n8 total\\n'", "printf abcde", fun(Dir) ->
        ?assertMatch([{1, {ok, [_, _], []}}], starl_fleet_fetch:fetch(Dir, fleet())),
        ?assertEqual({ok, <<"abc">>}, file:read_file(filename:join([Dir, "robot-1", "a.mcap"]))),
        ?assertEqual({ok, <<"abcde">>}, file:read_file(filename:join([Dir, "robot-1", "b.mcap"]))),
        ?assertEqual({ok, ["robot-1"]}, file:list_dir_all(Dir))
    end).

no_recording_test() ->
    with_robot("true", "false", fun(Dir) ->
        ?assertEqual([{1, {ok, [], []}}], starl_fleet_fetch:fetch(Dir, fleet())),
        ?assertEqual({ok, ["robot-1"]}, file:list_dir_all(Dir))
    end).

%% It sends more than it has said: no more is taken. It sends less: the file is not kept.
length_test() ->
    with_robot("printf '4 a.mcap\\n'", "yes", fun(Dir) ->
        ?assertMatch([{1, {ok, [_], []}}], starl_fleet_fetch:fetch(Dir, fleet())),
        ?assertEqual({ok, <<"y\ny\n">>}, file:read_file(filename:join([Dir, "robot-1", "a.mcap"])))
    end),
    with_robot("printf '4 a.mcap\\n'", "printf x", fun(Dir) ->
        [{1, {error, Line}}] = starl_fleet_fetch:fetch(Dir, fleet()),
        ?assertMatch({match, _}, re:run(Line, "a.mcap came shorter")),
        ?assertEqual({ok, []}, file:list_dir_all(filename:join(Dir, "robot-1"))),
        ?assertEqual({ok, ["robot-1"]}, file:list_dir_all(Dir))
    end).

%% A file of the operator's is reached by no name and by no link that lies where recordings go.
elsewhere_test() ->
    with_robot("printf '3 ../../.bashrc\\n3 a.mcap\\n'", "printf abc", fun(Dir) ->
        ?assertMatch([{1, {ok, [_], [_]}}], starl_fleet_fetch:fetch(Dir, fleet())),
        ?assertEqual({ok, ["a.mcap"]}, file:list_dir_all(filename:join(Dir, "robot-1")))
    end),
    with_robot("printf '3 a.mcap\\n'", "printf abc", fun(Dir) ->
        Own = filename:join(Dir, "operator"),
        ok = file:make_dir(Own),
        ok = file:make_symlink(Own, filename:join(Dir, "robot-1")),
        [{1, {error, Line}}] = starl_fleet_fetch:fetch(Dir, fleet()),
        ?assertMatch({match, _}, re:run(Line, "not a directory")),
        ?assertEqual({ok, []}, file:list_dir_all(Own))
    end),
    %% a link in a file's place is replaced, not followed
    with_robot("printf '3 a.mcap\\n'", "printf abc", fun(Dir) ->
        Own = filename:join(Dir, "operator"),
        ok = file:write_file(Own, "mine"),
        ok = file:make_dir(filename:join(Dir, "robot-1")),
        ok = file:make_symlink(Own, filename:join([Dir, "robot-1", "a.mcap"])),
        ?assertMatch([{1, {ok, [_], []}}], starl_fleet_fetch:fetch(Dir, fleet())),
        ?assertEqual({ok, <<"mine">>}, file:read_file(Own)),
        {ok, #file_info{type = Type}} = file:read_link_info(
            filename:join([Dir, "robot-1", "a.mcap"])
        ),
        ?assertEqual(regular, Type)
    end).

fleet() ->
    #{
        name => "lab",
        home => "starl",
        robots => #{1 => #{user => none, host => "robot1.lab", ssh => []}}
    }.

%% `ssh' answers the question for names by the first line of sh, and each question for a file by the second.
with_robot(Names, Bytes, Test) ->
    Base = string:trim(os:cmd("mktemp -d")),
    Bin = filename:join(Base, "bin"),
    Dir = filename:join(Base, "out"),
    ok = file:make_dir(Bin),
    ok = file:make_dir(Dir),
    Ssh = filename:join(Bin, "ssh"),
    ok = file:write_file(Ssh, [
        "#!/bin/sh\nfor last; do :; done\ncase $last in\n*wc*) ",
        Names,
        ";;\n*head*) ",
        Bytes,
        ";;\nesac\n"
    ]),
    ok = file:change_mode(Ssh, 8#755),
    Path = os:getenv("PATH"),
    true = os:putenv("PATH", Bin ++ ":" ++ Path),
    try
        Test(Dir)
    after
        os:putenv("PATH", Path),
        file:del_dir_r(Base)
    end.

%% The copies are made from the oldest recording to the latest, so that `ls -t' names the latest first.
oldest_first_test() ->
    Said = "7 robot-1.10.mcap\n8 robot-1.2.mcap\n9 robot-1.mcap\n24 total\n",
    {ok, #{files := Files}} = starl_fleet_fetch:listing(Said),
    ?assertEqual(["robot-1.mcap", "robot-1.2.mcap", "robot-1.10.mcap"], [Name || {Name, _} <- Files]).
