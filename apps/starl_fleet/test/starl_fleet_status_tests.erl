%% The line on a robot of a fleet.
%%
%% Holds: A robot that answers anything is one line, makes no atoms, and hides no other robot's
%% line
%% Red: 961f67c9: `function_clause`, `badarg`
-module(starl_fleet_status_tests).
-include_lib("eunit/include/eunit.hrl").

line(More) ->
    Status = #{
        release => "1",
        app => line_up,
        started => erlang:system_time(second),
        link => answers,
        result => running,
        crashes => 0
    },
    said(starl_fleet_term:write(maps:merge(Status, More))).

said(Text) ->
    Robot = #{user => none, host => "a"},
    lists:flatten(starl_fleet_status:line(1, Robot, unicode:characters_to_list(Text))).

a_chassis_that_tells_nothing_is_not_told_of_test() ->
    ?assertMatch({_, _}, binary:match(list_to_binary(line(#{})), <<" s\n">>)).

the_body_is_told_of_test() ->
    Chassis = #{
        control => false,
        charge => 12,
        priority => raised,
        senses => [{bump, left}, {drop, 0}, {cliff, [left]}, {docked, true}, {battery, low}]
    },
    Line = line(#{chassis => Chassis}),
    [
        ?assertNotEqual({Part, nomatch}, {Part, string:find(Line, Part)})
     || Part <- [
            "not under control",
            "battery 12 %",
            "low battery",
            "on its dock",
            "bump left",
            "at a cliff",
            "LimitRTPRIO=1"
        ]
    ],
    ?assertEqual(nomatch, string:find(Line, "hangs")).

%% ssh, or a shell, warned of something first.
an_answer_after_a_warning_test() ->
    Status = #{
        release => "1", app => a, started => 0, link => answers, result => running, crashes => 0
    },
    Text = ["Warning: added 'a' to the known hosts.\r\n", starl_fleet_term:write(Status)],
    ?assertNotEqual(nomatch, string:find(said(Text), "a runs, release 1, ")).

a_robot_that_was_stopped_test_() ->
    [
        ?_assertEqual("robot 1 (a): stopped\n", said(Said))
     || Said <- ["stopped\n", "Warning: added 'a' to the known hosts.\r\nstopped\n"]
    ].

what_is_not_known_is_shown_test() ->
    Line = said("bash: cannot set locale\n{no"),
    ?assertNotEqual(nomatch, string:find(Line, "nothing that we know: \"bash: cannot")),
    ?assertNotEqual(nomatch, string:find(said(""), "nothing that we know: []")).

peer(Robot, More) ->
    Well = #{
        robot => Robot,
        is_silent => false,
        heard_ms => 10,
        address => {{10, 0, 0, Robot}, 5001},
        life => 7,
        refused => #{},
        why => none,
        ahead_ms => 2,
        round_trip_us => 1500
    },
    maps:merge(Well, More).

a_team_that_hears_each_other_is_a_few_words_test() ->
    Line = line(#{peers => [peer(2, #{}), peer(3, #{round_trip_us => 4200})]}),
    ?assertNotEqual(nomatch, string:find(Line, ", hears 2 of 2 others (round trip 4.2 ms)\n")).

%% A deaf robot does not look well.
whom_it_does_not_hear_is_told_and_why_test() ->
    Peers = [
        peer(2, #{heard_ms => never, why => {clock, 60_000}}),
        peer(3, #{is_silent => true, heard_ms => 8000, why => seal}),
        peer(4, #{
            ahead_ms => -2000,
            refused => #{
                replay => #{count => 3, ago_ms => 1}, seal => #{count => 1, ago_ms => 61_000}
            }
        }),
        peer(5, #{twin => {8, {{10, 0, 0, 99}, 5001}}})
    ],
    Line = line(#{peers => Peers}),
    [
        ?assertNotEqual({Part, nomatch}, {Part, string:find(Line, Part)})
     || Part <- [
            "hears 2 of 4 others",
            "has not heard robot 2: its clock is 60.0 s ahead of ours",
            "has not heard robot 3 for 8 s: its datagrams are sealed with another key",
            "the clock of robot 4 is 2.0 s behind its own",
            "refused of robot 4: 3 replay\n",
            "hears two robots that speak as robot 5: 10.0.0.5 port 5001 (life 7) is taken, "
            "10.0.0.99 port 5001 (life 8) is refused"
        ]
    ].

%% A reload is told of as long as it is not well on the robot.
a_reload_is_told_until_it_is_well_test_() ->
    [
        ?_assertNotEqual(nomatch, string:find(line(#{reload => Reload}), " s" ++ Words ++ "\n"))
     || {Reload, Words} <- [
            {#{waiting => [app], failed => none}, ", still in a step, takes the new code after it"},
            {#{waiting => [app], failed => "it crashed"}, ", the reload has failed: it crashed"},
            {#{waiting => [], failed => "it crashed"}, ", the reload has failed: it crashed"},
            {#{waiting => [], failed => none}, ""}
        ]
    ].

%% Only a restart helps against a clock of the VM that was wrong at its start.
a_clock_that_was_set_since_the_start_is_told_test() ->
    ?assertEqual(nomatch, string:find(line(#{ahead_us => 20_000}), "clock")),
    Line = line(#{ahead_us => 3_600_000_000}),
    ?assertNotEqual(nomatch, string:find(Line, "clock is 3600.0 s ahead of its computer's")).

%% A robot that answers anything is one line, and no other robot's line is lost by it.
a_robot_that_answers_anything_is_one_line_test_() ->
    Well = #{
        release => "1", app => a, started => 0, link => answers, result => running, crashes => 0
    },
    [
        {Name,
            ?_assertMatch({match, _}, re:run(said(Text), "^robot 1 [(]a[)]: [^\n]+\n$", [unicode]))}
     || {Name, Text} <-
            [{"release only", "#{release => x}.\n"}, {"a list", "[1].\n"}, {"a number", "7.\n"}] ++
                [
                    {
                        lists:flatten(io_lib:format("~0p", [More])),
                        starl_fleet_term:write(maps:merge(Well, More))
                    }
                 || More <- [
                        #{release => [1 | 2]},
                        #{app => {}},
                        #{started => "now"},
                        #{started => 1 bsl 100},
                        #{link => down},
                        #{result => {done, {}}},
                        #{crashes => 3},
                        #{crashes => 1, crash => [a]},
                        #{reload => #{failed => {}, waiting => []}},
                        #{reload => #{failed => none, waiting => [1 | 2]}},
                        #{peers => #{}},
                        #{peers => [peer(2, #{heard_ms => soon})]},
                        #{peers => [peer(2, #{why => "because"})]},
                        #{peers => [peer(2, #{twin => {1, {{1, 2, 3}, 4}}})]},
                        #{peers => [peer(2, #{refused => #{seal => 1}})]},
                        #{chassis => []},
                        #{chassis => #{senses => [bump | 1]}},
                        #{chassis => #{senses => [{bump, {}}]}}
                    ]
                ]
    ].

%% What would be told once only, or done again and again, is one line.
only_status_is_watched_test() ->
    #{run := Run} = starl_fleet_deploy_command:command(),
    [
        ?assertMatch(
            {error, ["--watch: only status" ++ _]},
            Run(#{
                subject => {"f.term", Words}, values => #{example => false, watch => 2}
            })
        )
     || Words <- [[], ["stop"], ["logs"]]
    ].

%% What `status' and `/health' call well, and what the trial of a release calls healthy, is one judgement.
who_is_not_well_test_() ->
    Peer = #{
        robot => 2,
        heard_ms => 10,
        is_silent => false,
        why => none,
        refused => #{},
        ahead_ms => 0,
        round_trip_us => 900,
        life => 7,
        address => none
    },
    Said = fun(More) ->
        Status = #{
            release => "1", app => a, started => 0, link => answers, result => running, crashes => 0
        },
        unicode:characters_to_list(starl_fleet_term:write(maps:merge(Status, More)))
    end,
    [
        ?_assert(starl_fleet_status:is_well(Text))
     || Text <- ["stopped\n", Said(#{}), Said(#{crashes => 1}), Said(#{peers => [Peer]})]
    ] ++
        [
            ?_assertEqual({Text, false}, {Text, starl_fleet_status:is_well(Text)})
         || Text <- [
                "",
                "#{release => x}.",
                Said(#{result => given_up}),
                Said(#{link => silent}),
                Said(#{ahead_us => -3600000000}),
                Said(#{reload => #{waiting => [], failed => "it crashed"}}),
                Said(#{chassis => #{control => false}}),
                Said(#{peers => [Peer#{is_silent => true, heard_ms => never, why => seal}]}),
                Said(#{peers => [Peer#{ahead_ms => 3600000}]}),
                Said(#{peers => [nonsense]})
            ]
        ].

robots_of_different_releases_test() ->
    Of = fun(Release) ->
        unicode:characters_to_list(starl_fleet_term:write(#{release => Release}))
    end,
    Line = fun(Answers) ->
        case starl_fleet_status:releases(Answers) of
            none -> none;
            Text -> lists:flatten(Text)
        end
    end,
    ?assertEqual(none, Line([{1, Of("1-a")}, {2, Of("1-a")}, {3, "stopped\n"}, {4, "no"}])),
    ?assertEqual(
        "the robots run different releases: 1-a on robot 1, 3; 1-b on robot 2",
        Line([{1, Of("1-a")}, {2, Of("1-b")}, {3, Of("1-a")}])
    ).
