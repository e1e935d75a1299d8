%% The fleet file: what is wrong is told at once, each with its place.
-module(starl_fleet_file_tests).
-include_lib("eunit/include/eunit.hrl").

%% The example that the command prints is sound.
example_test() ->
    File = filename:join(code:priv_dir(starl_fleet), "fleet.term"),
    {ok, #{app := exercise} = Given} = starl_fleet_file:read(File),
    {ok, Fleet} = starl_fleet_file:check(File, Given, starl_exercise),
    ?assertMatch(
        #{
            transport := udp,
            positioning := {none, #{}},
            robots := #{1 := #{address := "192.168.1.11"}}
        },
        Fleet
    ).

all_at_once_test() ->
    ?assertEqual(
        [
            "f.term: unknown key trasport (did you mean transport?)",
            "f.term: name: a name of letters, digits and '-' expected, not \"a b\"",
            "f.term: the key app is missing: the application",
            "f.term: robots: robot 2 is missing; robots are numbered 1, 2, 3 ...",
            "f.term: robot 1: unknown key hosts (did you mean host?)",
            "f.term: robot 1: the key host is missing: the robot's computer, for ssh",
            "f.term: robot 3: port: a whole number from 1 to 65535 expected, not 0"
        ],
        lines(
            #{
                name => "a b",
                trasport => udp,
                robots => #{1 => #{hosts => "a"}, 3 => #{host => "b", port => 0}}
            },
            unknown
        )
    ).

%% Options that only the simulator has mean nothing to a real robot.
options_test() ->
    ?assertEqual(
        [
            "f.term: options: loss: only the simulator has this",
            "f.term: options: unknown key spee (did you mean speed?)"
        ],
        lines(fleet(#{options => #{loss => 0.1, spee => 3}}), starl_exercise)
    ).

%% A camera's mistakes are told with the robot's number.
camera_test() ->
    Robot = #{host => "a", camera => #{command => "x", ball_mm => 0}},
    ?assertEqual(
        ["f.term: robot 1: camera: ball_mm is the radius of the balls, mm"],
        lines(fleet(#{robots => #{1 => Robot}}), starl_exercise)
    ),
    Sound = Robot#{camera := #{command => "x"}},
    ?assertMatch(
        {ok, #{robots := #{1 := #{camera := #{command := "x"}}}}},
        starl_fleet_file:check("f.term", fleet(#{robots => #{1 => Sound}}), starl_exercise)
    ).

chassis_test() ->
    Robots = #{1 => #{host => "a", chassis => creat}},
    ?assertEqual(
        [
            "f.term: robot 1: chassis: one of none, create, \"exec:PROGRAM\", \"FILE.erl\", or {NAME, #{...}} expected, not creat"
        ],
        lines(fleet(#{robots => Robots}), starl_exercise)
    ).

%% Two robots cannot hear at one place; distribution needs one port and full names.
together_test() ->
    Robots = #{1 => #{host => "a"}, 2 => #{host => "b", address => "a"}},
    ?assertEqual(
        ["f.term: robots 1 and 2 have the same address and port, a port 5001"],
        lines(fleet(#{robots => Robots}), starl_exercise)
    ),
    Nodes = #{1 => #{host => "a.b", port => 1}, 2 => #{host => "c"}},
    ?assertEqual(
        [
            "f.term: transport dist: all robots hear at the same port, each at an address of its own",
            "f.term: robot 2: address: transport dist needs a name with a dot or an IPv4 address"
        ],
        lines(fleet(#{robots => Nodes, transport => dist}), starl_exercise)
    ).

%% Nothing in the file may become more than a word of a command.
words_test() ->
    Bad = [
        #{host => "-v"},
        #{host => "a;b"},
        #{host => "a\n"},
        #{host => "a", user => "a b"},
        #{host => "a", user => "b\n"}
    ],
    [?assertMatch([_], lines(fleet(#{robots => #{1 => R}}), starl_exercise)) || R <- Bad],
    ?assertMatch([_], lines(fleet(#{home => "a $(b)"}), starl_exercise)).

read_test() ->
    ?assertEqual(
        {error, ["no.term: no such file; an example: ./starl deploy --example > fleet.term"]},
        flat(starl_fleet_file:read("no.term"))
    ).

%% The file of a release reads as the one that it was made from.
portable_test() ->
    {ok, Fleet} = starl_fleet_file:check("f.term", fleet(#{}), starl_exercise),
    {ok, Tokens, _} = erl_scan:string(lists:flatten(starl_fleet_file:portable(Fleet, #{}))),
    {ok, Given} = erl_parse:parse_term(Tokens),
    ?assertEqual({ok, Fleet}, starl_fleet_file:check("f.term", Given, starl_exercise)).

%% Values of the simulation are those of the file, the robots are counted.
scenario_test() ->
    Robots = #{1 => #{host => "a"}, 2 => #{host => "b"}},
    {ok, Fleet} = starl_fleet_file:check(
        "f.term", fleet(#{robots => Robots, options => #{speed => 300}}), starl_exercise
    ),
    ?assertEqual(
        #{app => starl_exercise, robots => 2, speed => 300, mode => process},
        starl_fleet_file:scenario(Fleet)
    ).

fleet(More) ->
    maps:merge(#{name => "lab", app => starl_exercise, robots => #{1 => #{host => "a"}}}, More).

lines(Given, App) ->
    {error, Lines} = flat(starl_fleet_file:check("f.term", Given, App)),
    Lines.

flat({error, Lines}) -> {error, [unicode:characters_to_list(Line) || Line <- Lines]};
flat(Other) -> Other.
